/* What a sample does to mean and root once slopes of y are known: what it is worth, the steps
 * of all columns, the new root, the new mean. For all filters of weights with a root by panels;
 * they differ in how they predict y. The returned integers are Outcomes.
 */
#ifndef PATAGIUM_SAMPLE_H
#define PATAGIUM_SAMPLE_H

#include <math.h>

#include "transform.h"

/* sum over the weights of a block of x x', (stride, stride), from rows of x. */
static void gram(const panel_filter *f, int block, const REAL *x, double *sum) {
  const int stride = f->stride, size = stride * stride, count = f->counts[block];
  double *doubles = f->small + 4 * size; /* stride rows at a time */
  memset(sum, 0, sizeof(double) * size);
  x += (ptrdiff_t)f->starts[block] * stride;
  for (int i = 0; i < count; i += stride) {
    const int rows = count - i < stride ? count - i : stride;
    for (int k = 0; k < rows * stride; k += WIDE) wide_store(doubles + k, wide_from(x + k));
    add_products(stride, rows, doubles, sum);
    x += size;
  }
  for (int k = 0; k < stride; k++)
    for (int l = 0; l < k; l++) sum[k * stride + l] = sum[l * stride + k];
}

static double *gram_of(const panel_filter *f, int block) {
  return f->small + (5 + block) * f->stride * f->stride;
}

/* Whether the moments of y are numbers. */
static int predicted(const panel_filter *f) {
  double sum = 0;
  for (int k = 0; k < f->outputs * f->outputs; k++) sum += f->covariance[k];
  for (int k = 0; k < f->outputs; k++) sum += f->predicted[k];
  return isfinite(sum) ? COMPLETED : NOT_FINITE;
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

/* Steps and shrinks of all blocks, each with M and what the other blocks add to it; g becomes
 * the root of P_yy^-1, turned its transpose. 0 where M is not positive definite. */
static int plan(panel_filter *f, double *g, double *turned) {
  const int m = f->outputs, stride = f->stride, size = stride * stride;
  double *remainder = f->small, *work = remainder + size, *rest = remainder + 4 * size;
  for (int b = 0; b < f->blocks; b++) {
    memcpy(rest, remainder, sizeof(double) * size);
    for (int other = 0; other < f->blocks; other++)
      for (int k = 0; k < size && other != b; k++) rest[k] += gram_of(f, other)[k];
    memset(g, 0, sizeof(double) * size);
    if (!invert_root(m, stride, rest, work, g)) return 0;
    for (int k = 0; k < stride; k++)
      for (int l = 0; l < stride; l++) turned[k * stride + l] = g[l * stride + k];
    recur(f, b, g, turned);
  }
  return 1;
}

/* Whether C stays a number in the precision of S: |C_j| <= |S_j| (largest variance of y)^(1/2).
 * `largest` bounds |S_j|; growth makes it too large in time, and it is then found anew. */
static int in_range(panel_filter *f) {
  const double limit = SINGLE ? 1e36 : 1e300;
  double reach = 0;
  for (int k = 0; k < f->outputs; k++)
    reach = fmax(reach, f->covariance[k * f->outputs + k]);
  if (f->growth * f->largest * sqrt(reach) < limit) return 1;
  f->largest = longest_row(f);
  return f->growth * f->largest * sqrt(reach) < limit;
}

/* Why there is no prediction. */
static int unseen(const panel_filter *f) {
  const int features = f->items * f->widths[0], rows = f->items * f->widths[f->layers];
  if (are_numbers(features, f->features) && are_numbers(rows * f->outputs, f->readout))
    return NOT_FINITE;
  f->screen->counts[BAD_INPUTS]++;
  return BAD_INPUT;
}

/* Slopes and moments of y as the screen has them. */
static void screen_moments(panel_filter *f) {
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

/* Learn one sample, which `predict` predicts: moments of y and slopes. */
static int learn_sample(panel_filter *f, int (*predict)(panel_filter *)) {
  const int m = f->outputs, stride = f->stride, size = stride * stride;
  double *g = f->small + 2 * size, *turned = g + size, inner[stride], gain[stride], nis = 0;
  const int refused = admit(f->screen);
  if (refused) return refused;
  if (predict(f) != COMPLETED) return unseen(f);
  if (!in_range(f)) return NOT_FINITE;
  const int kept = weigh(f->screen, f->measured, f->predicted, f->covariance, f->innovation);
  if (!kept) return BLIND;
  screen_moments(f);
  if (!plan(f, g, turned)) return COVARIANCE_LOST;
  combine(m, stride, f->innovation, g, inner);
  combine(m, stride, inner, turned, gain);
  for (int k = 0; k < m; k++) nis += inner[k] * inner[k];
  if (!isfinite(nis)) return NOT_FINITE;
  f->nis = nis;
  learn_noise(f->screen, gain, stride, g);
  watch(f->screen, nis, kept);
  f->largest *= f->growth;
  memset(f->cross, 0, sizeof(REAL) * f->rows * stride);
  int weight = 0;
  for (int b = 0; b < f->blocks; b++) {
    for (int panel = (f->counts[b] - 1) / PANEL; panel >= 0; panel--) change_panel(f, b, panel);
    for (int j = f->starts[b]; j < f->starts[b] + f->counts[b]; j++) {
      double step = 0;
      for (int k = 0; k < m; k++) step += (double)f->cross[j * stride + k] * gain[k];
      f->mean[weight++] += step;
    }
  }
  return COMPLETED;
}

#endif
