/* A compiled filter through many samples without anyone in between: a study's loop.
 *
 * Stamps are not known; what was predicted before each sample is kept. */
#include <stdint.h>
#include <string.h>

/* Samples that were not learned from. x (count, inputs) and y (count, outputs) row by row are
 * copied to where the filter reads them, seen and measured; mean is copied to predicted. */
int64_t drive(int (*update)(void *), void *memory, int64_t count, int64_t inputs, int64_t outputs,
              const double *x, const double *y, double *seen, double *measured,
              const double *mean, double *predicted) {
  int64_t refused = 0;
  for (int64_t k = 0; k < count; k++) {
    memcpy(seen, x + k * inputs, sizeof(double) * (size_t)inputs);
    memcpy(measured, y + k * outputs, sizeof(double) * (size_t)outputs);
    refused += update(memory) != 0;
    memcpy(predicted + k * outputs, mean, sizeof(double) * (size_t)outputs);
  }
  return refused;
}
