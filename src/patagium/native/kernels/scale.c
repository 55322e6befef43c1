/* The encoder of a dense network: each input less its center, over its scale.
 *
 * arg: x (n), constants (2 n + readout: centers, scales, readout row by row); res: features (n),
 * readout. The constants are preceded by n and the size of the readout. */
#include <string.h>

void scale_encode(const double *const *arg, double *const *res) {
  const double *x = arg[0], *constants = arg[1] + 2;
  const int n = (int)arg[1][0], size = (int)arg[1][1];
  for (int k = 0; k < n; k++) res[0][k] = (x[k] - constants[k]) / constants[n + k];
  memcpy(res[1], constants + 2 * n, sizeof(double) * (size_t)size);
}
