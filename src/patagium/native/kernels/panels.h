/* Covariance by panels of its square root: what a sample does to mean and root once slopes of y
 * are known. Its filters differ in how they predict y.
 */
#ifndef PATAGIUM_PANELS_H
#define PATAGIUM_PANELS_H

#include <math.h>

#include "abreast.h"
#include "sample.h"
#include "transform.h"

/* sum over the weights of a block of x x', (stride, stride), from rows of x. */
static void gram(const panel_filter *f, int block, const REAL *x, double *sum) {
  const int stride = f->stride, size = stride * stride, count = f->counts[block];
  memset(sum, 0, sizeof(double) * size);
  x += (ptrdiff_t)f->starts[block] * stride;
#if SINGLE
  double *doubles = f->small + 4 * size; /* stride rows at a time */
  for (int i = 0; i < count; i += stride) {
    const int rows = count - i < stride ? count - i : stride;
    for (int k = 0; k < rows * stride; k += WIDE) wide_store(doubles + k, wide_from(x + k));
    add_products(stride, rows, doubles, sum);
    x += size;
  }
#else
  add_products(stride, count, x, sum);
#endif
  for (int k = 0; k < stride; k++)
    for (int l = 0; l < k; l++) sum[k * stride + l] = sum[l * stride + k];
}

static double *gram_of(const panel_filter *f, int block) {
  return f->small + (5 + block) * f->stride * f->stride;
}

/* Length of the longest row of S. */
static double longest_row(const panel_filter *f) {
  double longest = 0;
  for (int b = 0; b < f->blocks; b++)
    for (int j = f->starts[b]; j < f->starts[b + 1]; j++) {
      double square = 0;
      for (int panel = 0; panel <= (j - f->starts[b]) / PANEL; panel++)
        for (int c = 0; c < PANEL; c++) {
          const double s = (double)panel_of(f, b, panel)[(ptrdiff_t)j * PANEL + c];
          square += s * s;
        }
      longest = fmax(longest, sqrt(square));
    }
  return longest;
}

/* What y has beside a block, (stride, stride): M and what the other blocks add to it. */
static const double *beside(const panel_filter *f, int block) {
  const int size = f->stride * f->stride;
  double *rest = f->small + 4 * size;
  memcpy(rest, f->small, sizeof(double) * size);
  for (int other = 0; other < f->blocks; other++)
    for (int k = 0; k < size && other != block; k++) rest[k] += gram_of(f, other)[k];
  return rest;
}

/* Steps and shrinks of all blocks, in parts abreast or, where a pivot is small or outputs are
 * many, column by column; g becomes the root of P_yy^-1, turned its transpose. 0 where M is not
 * positive definite. */
static int invert_panels(void *memory, double *g, double *turned) {
  panel_filter *f = memory;
  const int m = f->outputs, stride = f->stride;
  double *work = f->small + stride * stride;
  int done = m <= MOST_ABREAST
             && invert_turned(m, stride, LEAST_PIVOT, beside(f, f->blocks), work, g, turned);
  for (int b = 0; done && b < f->blocks; b++) done = recur_abreast(f, b, beside(f, b));
  for (int b = 0; !done && b < f->blocks; b++) {
    if (!invert_turned(m, stride, 0, beside(f, b), work, g, turned)) return 0;
    recur(f, b, g, turned);
  }
  return 1;
}

/* Whether C stays a number in the precision of S: |C_j| <= |S_j| (largest variance of y)^(1/2).
 * `largest` bounds |S_j|; growth makes it too large in time, and it is then found anew. */
static int panels_in_range(void *memory) {
  panel_filter *f = memory;
  const double limit = SINGLE ? 1e36 : 1e300;
  const double reach = largest_deviation(&f->base);
  if (f->growth * f->largest * reach < limit) return 1;
  f->largest = longest_row(f);
  return f->growth * f->largest * reach < limit;
}

/* Slopes and moments of y without the channels left out, with the noise of those doubted. */
static void screen_panels(void *memory) {
  panel_filter *f = memory;
  const screening *s = f->screen;
  const int stride = f->stride;
  leave_out(s, stride, f->small);
  for (int k = 0; k < f->outputs; k++) {
    if (!s->left_out[k]) continue;
    for (int i = 0; i < f->rows; i++) f->slopes[i * stride + k] = R(0);
    for (int b = 0; b < f->blocks; b++)
      for (int l = 0; l < f->outputs; l++)
        gram_of(f, b)[k * stride + l] = gram_of(f, b)[l * stride + k] = 0;
  }
}

/* Mean and root after the sample; gain: P_yy^-1 (y - mean). */
static void learn_panels(void *memory, const double *gain, const double *g) {
  panel_filter *f = memory;
  const int m = f->outputs, stride = f->stride;
  (void)g;
  f->largest *= f->growth;
  memset(f->cross, 0, sizeof(REAL) * f->rows * stride);
  int weight = 0;
  for (int b = 0; b < f->blocks; b++) {
    for (int panel = (f->counts[b] - 1) / PANEL; panel >= 0; panel--) change_panel(f, b, panel);
    for (int j = f->starts[b]; j < f->starts[b] + f->counts[b]; j++) {
      double step = 0;
      for (int k = 0; k < m; k++) step += (double)f->cross[j * stride + k] * gain[k];
      f->mean[f->order[weight++]] += step;
    }
  }
}

#endif
