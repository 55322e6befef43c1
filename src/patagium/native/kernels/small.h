/* Algebra of the measurement: matrices of n_y x n_y, in double, rows of `stride` numbers.
 *
 * stride is n_y rounded up to a multiple of WIDE; what lies beyond n_y is zero.
 */
#ifndef PATAGIUM_SMALL_H
#define PATAGIUM_SMALL_H

#include <math.h>
#include <string.h>

#include "activations.h"

#define WIDE ((int)(VECTOR_BYTES / sizeof(double))) /* a vector of the small algebra */

typedef double wide __attribute__((vector_size(VECTOR_BYTES)));

static inline wide wide_load(const double *p) {
  wide x;
  memcpy(&x, p, sizeof x);
  return x;
}

static inline void wide_store(double *p, wide x) { memcpy(p, &x, sizeof x); }

/* G with G G' = M^-1: the transposed inverse of the lower factor; 0 where there is none. */
static int invert_root(int m, int stride, const double *matrix, double *lower, double *g) {
  for (int k = 0; k < m; k++)
    for (int l = 0; l <= k; l++) {
      double sum = matrix[k * stride + l];
      for (int i = 0; i < l; i++) sum -= lower[k * stride + i] * lower[l * stride + i];
      if (k > l) {
        lower[k * stride + l] = sum * lower[l * stride + l]; /* the diagonal is inverted */
      } else {
        if (!(sum > 0) || !isfinite(sum)) return 0;
        lower[k * stride + k] = 1 / sqrt(sum);
      }
    }
  for (int l = 0; l < m; l++) {
    g[l * stride + l] = lower[l * stride + l];
    for (int k = l + 1; k < m; k++) {
      double sum = 0;
      for (int i = l; i < k; i++) sum -= lower[k * stride + i] * g[l * stride + i];
      g[l * stride + k] = sum * lower[k * stride + k];
    }
  }
  return 1;
}

/* target <- sum over k of scale[k] rows of g, `count` rows of `stride`. */
static inline void combine(int count, int stride, const double *scale, const double *g,
                           double *target) {
  for (int l = 0; l < stride; l += WIDE) {
    wide even = {0}, odd = {0};
    int k = 0;
    for (; k + 2 <= count; k += 2) {
      even += scale[k] * wide_load(g + k * stride + l);
      odd += scale[k + 1] * wide_load(g + (k + 1) * stride + l);
    }
    if (k < count) even += scale[k] * wide_load(g + k * stride + l);
    wide_store(target + l, even + odd);
  }
}

#endif
