/* One sample through the square-root cubature filter of a network's weights.
 *
 * State: mean W (n) and the lower triangular square root S of the covariance, P = S S'.
 * Points W +- spread S e_i go through the network y = offset + readout . mlp(features; W),
 * eight (float: sixteen) at a time; their half differences are Z = d / spread, and what is
 * left of the covariance of y beside Z'Z is M. With G G' = M^-1 to begin with, the columns
 * are taken from the last to the first:
 *
 *     f = G' z_j,   a = 1 + f'f,   e = G f,
 *     S_j <- (S_j - C e) / sqrt(a),   C <- C + S_j z_j',   G <- G - e f' / (a + sqrt(a)),
 *
 * S_j in C being the old one. That is P <- P - S Z P_yy^-1 Z' S' with S triangular again:
 * the Cholesky factor of the new P, without factorizing it (Carlson 1973, Potter). In the
 * end C = S Z, G G' = P_yy^-1, and W <- W + C P_yy^-1 (y - mean).
 *
 * A triangular S halves the work, and column i leaves the weights before i alone: layers
 * before the one weight i belongs to are at the mean, that layer is linear in the step.
 * S is stored by panels of two vectors of columns, each from its first row on. It may be of
 * one block a layer: then each block sees M and what the others add to it, as if they were
 * noise, and what the posterior has between blocks is forgotten. The small
 * algebra (n_y x n_y) is in double. What a sample is worth, and how noisy it is, is found on the
 * way: screening.h. Nothing is allocated, nothing is raised: the returned integer is an Outcome,
 * and whatever is not COMPLETED leaves mean and S as they were.
 */
#include <math.h>

#include "points.h"
#include "transform.h"

/* Slopes and bends of y over WIDTH columns, from the mlp's outputs at their points. */
static void read_out(const cubature *f, int first, REAL *outputs) {
  const int count = f->items * f->widths[f->layers];
  const REAL *center = sums_of(f, f->layers - 1);
  const reals half = reals_all(R(0.5)), gain = reals_all(R(0.5 / f->spread));
  for (int r = 0; r < count; r++) {
    REAL *pair = outputs + r * PANEL;
    reals up = reals_load(pair), down = reals_load(pair + WIDTH);
    reals_store(pair, (up - down) * gain);
    reals_store(pair + WIDTH, (up - center[r]) * half + (down - center[r]) * half);
  }
  for (int k = 0; k < WIDTH; k += FEW) {
    const int at = (first + k) * f->stride;
    band_product(0, FEW, f->stride, count, outputs + k, 1, PANEL, f->weighting, f->stride,
                 f->slopes + at, f->stride);
    band_product(0, FEW, f->stride, count, outputs + WIDTH + k, 1, PANEL, f->weighting, f->stride,
                 f->bends + at, f->stride);
  }
}

/* All points through the network: slopes, bends, and y at the mean in `predicted`. */
static void visit(cubature *f) {
  const int count = f->items * f->widths[f->layers], m = f->outputs;
  if (f->encode) f->encode(f->encode_arguments, f->encode_results);
  find_noise(f->screen, count, f->readout);
  for (int r = 0; r < count; r++)
    for (int k = 0; k < m; k++) f->weighting[r * f->stride + k] = R(f->readout[r * m + k]);
  run_at_mean(f);
  for (int b = 0; b < f->blocks; b++)
    for (int first = 0; first < f->counts[b]; first += WIDTH)
      read_out(f, f->starts[b] + first, run_at_points(f, b, first));
  const REAL *center = sums_of(f, f->layers - 1);
  for (int k = 0; k < m; k++) {
    double y = f->offset[k];
    for (int r = 0; r < count; r++) y += f->readout[r * m + k] * (double)center[r];
    f->predicted[k] = y;
  }
}

/* sum over the weights of a block of x x', (stride, stride), from rows of x. */
static void gram(const cubature *f, int block, const REAL *x, double *sum) {
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

static double *gram_of(const cubature *f, int block) {
  return f->small + (5 + block) * f->stride * f->stride;
}

/* Mean of y, M and P_yy from slopes and bends; Z'Z of every block. */
static void moments(cubature *f, double *remainder, double *work) {
  const int m = f->outputs, stride = f->stride, size = stride * stride;
  double shift[stride];
  memset(shift, 0, sizeof shift);
  memset(remainder, 0, sizeof(double) * size);
  for (int b = 0; b < f->blocks; b++)
    add_rows(stride, f->counts[b], f->bends + (ptrdiff_t)f->starts[b] * stride, shift);
  for (int k = 0; k < stride; k++) shift[k] /= f->spread * f->spread;
  for (int b = 0; b < f->blocks; b++) {
    if (f->centered != 0)
      move_rows(stride, f->counts[b], f->centered, shift,
                f->bends + (ptrdiff_t)f->starts[b] * stride);
    gram(f, b, f->bends, work);
    gram(f, b, f->slopes, gram_of(f, b));
    for (int k = 0; k < size; k++) remainder[k] += work[k];
  }
  for (int k = 0; k < m; k++) {
    f->predicted[k] += shift[k];
    for (int l = 0; l < m; l++) {
      double *sum = remainder + k * stride + l;
      *sum = f->bend_gain * *sum + f->shift_gain * shift[k] * shift[l];
      if (k == l) *sum += f->screen->noise[k];
      f->covariance[k * m + l] = *sum;
      for (int b = 0; b < f->blocks; b++)
        f->covariance[k * m + l] += gram_of(f, b)[k * stride + l];
    }
  }
}

/* Mean and covariance of y (noise included) before it is measured. */
int cubature_predict(cubature *f) {
  const int m = f->outputs;
  visit(f);
  moments(f, f->small, f->small + f->stride * f->stride);
  double sum = 0;
  for (int k = 0; k < m * m; k++) sum += f->covariance[k];
  for (int k = 0; k < m; k++) sum += f->predicted[k];
  return isfinite(sum) ? COMPLETED : NOT_FINITE;
}

/* Length of the longest row of S. */
static double longest_row(const cubature *f) {
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
static int plan(cubature *f, double *g, double *turned) {
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
static int in_range(cubature *f) {
  const double limit = SINGLE ? 1e36 : 1e300;
  double reach = 0;
  for (int k = 0; k < f->outputs; k++)
    reach = fmax(reach, f->covariance[k * f->outputs + k]);
  if (f->growth * f->largest * sqrt(reach) < limit) return 1;
  f->largest = longest_row(f);
  return f->growth * f->largest * sqrt(reach) < limit;
}

/* Why there is no prediction. */
static int unseen(const cubature *f) {
  const int features = f->items * f->widths[0], rows = f->items * f->widths[f->layers];
  if (are_numbers(features, f->features) && are_numbers(rows * f->outputs, f->readout))
    return NOT_FINITE;
  f->screen->counts[BAD_INPUTS]++;
  return BAD_INPUT;
}

/* Slopes and moments of y as the screen has them. */
static void screen_moments(cubature *f) {
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

/* Learn one sample. */
int cubature_update(cubature *f) {
  const int m = f->outputs, stride = f->stride, size = stride * stride;
  double *g = f->small + 2 * size, *turned = g + size, inner[stride], gain[stride], nis = 0;
  const int refused = admit(f->screen);
  if (refused) return refused;
  if (cubature_predict(f) != COMPLETED) return unseen(f);
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

/* Lanes of a vector: the caller lays out the memory by it. */
int cubature_lanes(void) { return WIDTH; }

/* The activation over many numbers (a multiple of WIDTH), for its test. */
void cubature_activate(int activation, int count, REAL *z) {
  activate(activation, count / WIDTH, z);
}
