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

typedef REAL parts __attribute__((vector_size(WIDE * sizeof(REAL))));

/* As many numbers as doubles fit a vector, as doubles. */
static inline wide wide_from(const REAL *p) {
  parts narrow;
  memcpy(&narrow, p, sizeof narrow);
  return __builtin_convertvector(narrow, wide);
}

/* sum <- sum + x_k x_l over `count` rows of x, for `rows` numbers from k on and WIDE from l. */
static inline __attribute__((always_inline)) void add_tile(int rows, int stride, int count,
                                                           const double *x_k, const double *x_l,
                                                           double *sum) {
  wide part[8];
  for (int r = 0; r < rows; r++) part[r] = wide_load(sum + r * stride);
  for (int i = 0; i < count; i++) {
    const wide column = wide_load(x_l + i * stride);
    for (int r = 0; r < rows; r++) part[r] += x_k[i * stride + r] * column;
  }
  for (int r = 0; r < rows; r++) wide_store(sum + r * stride, part[r]);
}

/* sum <- sum + x' x, (stride, stride), on the diagonal and right of it; x: `count` rows. */
static void add_products(int stride, int count, const double *x, double *sum) {
  for (int k = 0; k < stride; k += stride - k < 8 ? 4 : 8)
    for (int l = k / WIDE * WIDE; l < stride; l += WIDE)
      if (stride - k < 8)
        add_tile(4, stride, count, x + k, x + l, sum + k * stride + l);
      else
        add_tile(8, stride, count, x + k, x + l, sum + k * stride + l);
}

/* sum <- sum + the sum of `count` rows of `stride`. */
static inline void add_rows(int stride, int count, const REAL *x, double *sum) {
  for (int k = 0; k < stride; k += WIDE) {
    wide even = wide_load(sum + k), odd = {0};
    int i = 0;
    for (; i + 2 <= count; i += 2) {
      even += wide_from(x + i * stride + k);
      odd += wide_from(x + (i + 1) * stride + k);
    }
    if (i < count) even += wide_from(x + i * stride + k);
    wide_store(sum + k, even + odd);
  }
}

/* x <- x - gain shift in `count` rows of `stride`. */
static inline void move_rows(int stride, int count, double gain, const double *shift, REAL *x) {
  REAL move[stride];
  for (int k = 0; k < stride; k++) move[k] = R(gain * shift[k]);
  for (int i = 0; i < count; i++)
    for (int k = 0; k < stride; k += WIDTH)
      reals_store(x + i * stride + k, reals_load(x + i * stride + k) - reals_load(move + k));
}

/* G with G G' = M^-1: the transposed inverse of the lower factor; 0 where there is none, or a
 * pivot is not more than `least` of its variance. Rows of the factor's transpose stand in upper. */
static int invert_root(int m, int stride, double least, const double *matrix, double *upper,
                       double *g) {
  memcpy(upper, matrix, sizeof(double) * m * stride);
  memset(g, 0, sizeof(double) * m * stride);
  for (int l = 0; l < m; l++) {
    double *row = upper + l * stride, *own = g + l * stride;
    const double pivot = row[l];
    if (!(pivot > least * matrix[l * stride + l]) || !isfinite(pivot)) return 0;
    const double scale = 1 / sqrt(pivot);
    own[l] = 1;
    for (int v = 0; v < stride; v += WIDE) {
      wide_store(row + v, scale * wide_load(row + v));
      wide_store(own + v, scale * wide_load(own + v));
    }
    for (int k = l + 1; k < m; k++) {
      const double share = row[k];
      double *below = upper + k * stride, *later = g + k * stride;
      for (int v = k / WIDE * WIDE; v < stride; v += WIDE)
        wide_store(below + v, wide_load(below + v) - share * wide_load(row + v));
      for (int v = 0; v <= l; v += WIDE)
        wide_store(later + v, wide_load(later + v) - share * wide_load(own + v));
    }
  }
  for (int k = 0; k < m; k++)
    for (int l = 0; l < k; l++) {
      g[l * stride + k] = g[k * stride + l];
      g[k * stride + l] = 0;
    }
  return 1;
}

/* The same for all rows of g, those from m on zeros, and turned its transpose. */
static int invert_turned(int m, int stride, double least, const double *matrix, double *upper,
                         double *g, double *turned) {
  memset(g + m * stride, 0, sizeof(double) * (stride - m) * stride);
  if (!invert_root(m, stride, least, matrix, upper, g)) return 0;
  for (int k = 0; k < stride; k++)
    for (int l = 0; l < stride; l++) turned[k * stride + l] = g[l * stride + k];
  return 1;
}

/* WIDE numbers of the sum over k of scale[k] rows of g, `count` rows of `stride`. */
static inline wide combined(int count, int stride, const double *scale, const double *g) {
  wide part[4] = {{0}, {0}, {0}, {0}};
  int k = 0;
  for (; k + 4 <= count; k += 4)
    for (int c = 0; c < 4; c++) part[c] += scale[k + c] * wide_load(g + (k + c) * stride);
  for (; k < count; k++) part[0] += scale[k] * wide_load(g + k * stride);
  return (part[0] + part[1]) + (part[2] + part[3]);
}

/* target <- sum over k of scale[k] rows of g, `count` rows of `stride`. */
static inline void combine(int count, int stride, const double *scale, const double *g,
                           double *target) {
  for (int l = 0; l < stride; l += WIDE)
    wide_store(target + l, combined(count, stride, scale, g + l));
}

#endif
