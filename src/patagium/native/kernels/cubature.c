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
 * algebra (n_y x n_y) is in double. Where something is added to the covariance between samples, P
 * is kept and columns of S are its Cholesky factor's at each: covariance.h. What a sample is worth, and how noisy it is, is found on the
 * way: screening.h. Nothing is allocated, nothing is raised: the returned integer is an Outcome,
 * and whatever is not COMPLETED leaves mean and S as they were.
 */
#include "points.h"
#include "covariance.h"

/* Slopes and curvatures of y over WIDTH columns, from the mlp's outputs at their points. */
static void read_out(const panel_filter *f, int first, REAL *outputs) {
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
                 f->curvatures + at, f->stride);
  }
}

/* All points through the network: slopes, curvatures, and y at the mean in `predicted`. */
static void visit(panel_filter *f) {
  const int count = f->items * f->widths[f->layers], m = f->outputs;
  encode(&f->base);
  for (int r = 0; r < count; r++)
    for (int k = 0; k < m; k++) f->weighting[r * f->stride + k] = R(f->readout[r * m + k]);
  run_at_mean(f);
  for (int b = 0; b < f->blocks; b++)
    for (int first = 0; first < f->counts[b] && (!f->kept || first < pointed(f, b)); first += WIDTH)
      read_out(f, f->starts[b] + first, run_at_points(f, b, first));
  const REAL *center = sums_of(f, f->layers - 1);
  for (int k = 0; k < m; k++) {
    double y = f->offset[k];
    for (int r = 0; r < count; r++) y += f->readout[r * m + k] * (double)center[r];
    f->predicted[k] = y;
  }
}

/* Mean of y, M and P_yy from slopes and curvatures; Z'Z of every block. */
static void moments(panel_filter *f, double *remainder, double *work) {
  const int m = f->outputs, stride = f->stride, size = stride * stride;
  double shift[stride];
  memset(shift, 0, sizeof shift);
  memset(remainder, 0, sizeof(double) * size);
  for (int b = 0; f->kept && b < f->blocks; b++) {
    const ptrdiff_t linear = f->starts[b] + pointed(f, b);
    memset(f->curvatures + linear * stride, 0, sizeof(REAL) * (f->starts[b + 1] - linear) * stride);
  }
  for (int b = 0; b < f->blocks; b++)
    add_rows(stride, f->counts[b], f->curvatures + (ptrdiff_t)f->starts[b] * stride, shift);
  for (int k = 0; k < stride; k++) shift[k] /= f->spread * f->spread;
  for (int b = 0; b < f->blocks; b++) {
    if (f->centered != 0)
      move_rows(stride, f->counts[b], f->centered, shift,
                f->curvatures + (ptrdiff_t)f->starts[b] * stride);
    gram(f, b, f->curvatures, work);
    gram(f, b, f->slopes, gram_of(f, b));
    if (f->kept) sense_linear(f, b);
    for (int k = 0; k < size; k++) remainder[k] += work[k];
  }
  for (int k = 0; k < m; k++) {
    f->predicted[k] += shift[k];
    for (int l = 0; l < m; l++) {
      double *sum = remainder + k * stride + l;
      *sum = f->curvature_gain * *sum + f->shift_gain * shift[k] * shift[l];
      if (k == l) *sum += f->screen->noise[k];
      f->covariance[k * m + l] = *sum;
      for (int b = 0; b < f->blocks; b++)
        f->covariance[k * m + l] += gram_of(f, b)[k * stride + l];
    }
  }
}

/* Mean and covariance of y (noise included) before it is measured. */
static int predict(void *memory) {
  panel_filter *f = memory;
  if (f->kept && !(find_largest(f) && factor_covariance(f))) return COVARIANCE_LOST;
  visit(f);
  moments(f, f->small, f->small + f->stride * f->stride);
  return predicted(&f->base);
}

int cubature_predict(panel_filter *f) { return stated(&f->base, predict(f)); }

/* Learn one sample. */
int cubature_update(panel_filter *f) { return learn_by_panels(f, predict); }

/* Lanes of a vector: the caller lays out the memory by it. */
int cubature_lanes(void) { return WIDTH; }

/* The activation over many numbers (a multiple of WIDTH), for its test. */
void cubature_activate(int activation, int count, REAL *z) {
  activate(activation, count / WIDTH, z);
}
