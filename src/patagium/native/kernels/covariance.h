/* Covariance P itself by panels, for filters that add to it between two samples.
 *
 * P <- decay P + diag(drift) takes n additions here, and n^3 / 3 to a square root. A sample costs
 * n^2 / 2 n_y more: P <- P - U U' with U = C G, C the covariance of the weights with y and
 * G G' = P_yy^-1. The linear filter needs P alone, C = P H'. Points need columns of a root as well,
 * the Cholesky factor's, found at every sample. y is linear in the weights of the last layer, and
 * with H of these the columns of the others, S_1 with its rows below L, are enough: the last ones
 * add (P_2 - L L') H' to C and no curvature. With h weights before the last layer of n that is
 * h^3 / 6 + h^2 (n - h) / 2. All is in double; a float filter has its points in float.
 * A difference of matrices is definite up to rounding only. What is added at every sample lifts
 * P above that; a variance or pivot that is not positive makes the sample COVARIANCE_LOST.
 */
#ifndef PATAGIUM_COVARIANCE_H
#define PATAGIUM_COVARIANCE_H

#include "panels.h"
#include "points.h"

#define SPAN (VECTORS * WIDE) /* columns of a tile of ROWS rows */

/* sum <- sum + a b; a: (ROWS, depth), b: (depth, vectors WIDE). */
static inline __attribute__((always_inline)) void add_tile_of(
    int vectors, int depth, const double *a, int a_row, int a_depth, const double *b, int b_stride,
    wide sum[ROWS][VECTORS]) {
  for (int k = 0; k < depth; k++)
    for (int v = 0; v < vectors; v++) {
      wide column = wide_load(b + (ptrdiff_t)k * b_stride + v * WIDE);
      IN_REGISTER(column);
      for (int r = 0; r < ROWS; r++)
        sum[r][v] += a[(ptrdiff_t)r * a_row + (ptrdiff_t)k * a_depth] * column;
    }
}

/* target <- (keep ? target : 0) + a b, ROWS rows of `columns`. */
static inline __attribute__((always_inline)) void multiply_rows(
    int keep, int columns, int depth, const double *a, int a_row, int a_depth, const double *b,
    int b_stride, double *target, int stride) {
  for (int v = 0; v < columns; v += SPAN) {
    const int vectors = columns - v < SPAN ? 1 : VECTORS;
    wide sum[ROWS][VECTORS];
    for (int r = 0; r < ROWS; r++)
      for (int c = 0; c < vectors; c++)
        sum[r][c] = keep ? wide_load(target + r * stride + v + c * WIDE) : (wide){0};
    if (vectors == 1) add_tile_of(1, depth, a, a_row, a_depth, b + v, b_stride, sum);
    else add_tile_of(VECTORS, depth, a, a_row, a_depth, b + v, b_stride, sum);
    for (int r = 0; r < ROWS; r++)
      for (int c = 0; c < vectors; c++)
        wide_store(target + r * stride + v + c * WIDE, sum[r][c]);
  }
}

/* Largest variance of a weight before the sample, in `largest` its root; 0 where one is none. */
static int find_largest(panel_filter *f) {
  double largest = 0;
  int positive = 1;
  for (int b = 0; b < f->blocks; b++)
    for (int j = 0; j < f->counts[b]; j++) {
      const ptrdiff_t row = f->starts[b] + j;
      const double *p = f->kept + panel_at(f, b, j / PANEL) + row * PANEL;
      const double variance = f->decay * p[j % PANEL] + f->drift[row];
      positive &= variance > 0;
      largest = fmax(largest, variance);
    }
  f->largest = sqrt(largest);
  return positive;
}

/* Whether the covariance of weights with y stays a number. */
static int covariance_in_range(void *memory) {
  const panel_filter *f = memory;
  return f->largest * largest_deviation(&f->base) < 1e300;
}

/* sensed <- (decay P + diag(drift)) x over the weights of a block from `from` on, a panel's first;
 * x: their rows, of `stride` numbers. */
static void sense_block(panel_filter *f, int block, int from, const double *x) {
  const int start = f->starts[block] + from, end = f->starts[block + 1], stride = f->stride;
  double *sensed = f->sensed;
  memset(sensed + (ptrdiff_t)start * stride, 0, sizeof(double) * (end - start) * stride);
  for (int first = start; first < end; first += PANEL) {
    const double *p = f->kept + panel_at(f, block, (first - start + from) / PANEL);
    const double *here = x + (ptrdiff_t)(first - start) * stride;
    const int below = first + PANEL;
    for (int i = first; i < end; i += ROWS)
      multiply_rows(1, stride, PANEL, p + (ptrdiff_t)i * PANEL, PANEL, 1, here, stride,
                    sensed + (ptrdiff_t)i * stride, stride);
    for (int c = 0; c < PANEL && below < end; c += ROWS)
      multiply_rows(1, stride, end - below, p + (ptrdiff_t)below * PANEL + c, 1, PANEL,
                    here + PANEL * stride, stride, sensed + (ptrdiff_t)(first + c) * stride,
                    stride);
  }
  for (int j = start; j < end; j++)
    for (int k = 0; k < stride; k += WIDE) {
      double *own = sensed + (ptrdiff_t)j * stride + k;
      wide_store(own, f->decay * wide_load(own) +
                          f->drift[j] * wide_load(x + (ptrdiff_t)(j - start) * stride + k));
    }
}

/* sum <- sum + x' sensed over the weights of a block from `from` on, (stride, stride). */
static void add_sensed_gram(const panel_filter *f, int block, int from, const double *x,
                            double *sum) {
  const int stride = f->stride, count = f->counts[block] - from;
  const double *sensed = f->sensed + (ptrdiff_t)(f->starts[block] + from) * stride;
  double tile[ROWS * stride];
  for (int k = 0; k < stride; k += ROWS) {
    multiply_rows(0, stride, count, x + k, 1, stride, sensed, stride, tile, stride);
    for (int l = 0; l < ROWS * stride; l++) sum[k * stride + l] += tile[l];
  }
  for (int k = 0; k < stride; k++)
    for (int l = 0; l < k; l++) sum[k * stride + l] = sum[l * stride + k];
}

/* Columns of S of a block that points need, in whole panels: those before the last layer. */
static int pointed(const panel_filter *f, int block) {
  const int last = f->widths[f->layers] * (f->widths[f->layers - 1] + 1);
  int before = f->weights - last;
  for (int b = 0; b < block; b++) before -= f->counts[b];
  const int whole = before > 0 ? (before + PANEL - 1) / PANEL * PANEL : 0;
  const int rows = f->starts[block + 1] - f->starts[block];
  return whole < rows ? whole : rows;
}

/* Factor L of the tile on a diagonal, (PANEL, PANEL) in rows of s, of which `count` rows are
 * weights, and its inverse, transposed. 0 where it is not positive definite. */
static int factor_tile(int count, double *s, double *inverse) {
  double own[PANEL * PANEL], upper[PANEL * PANEL];
  memcpy(upper, s, sizeof upper);
  memset(own, 0, sizeof own);
  for (int c = 0; c < PANEL; c++) own[c * PANEL + c] = 1;
  for (int c = 0; c < count; c++) {
    double *row = upper + c * PANEL, *with = own + c * PANEL;
    const double pivot = row[c];
    if (!(pivot > 0) || !isfinite(pivot)) return 0;
    const double scale = 1 / sqrt(pivot);
    for (int k = 0; k < PANEL; k += WIDE) {
      wide_store(row + k, scale * wide_load(row + k));
      wide_store(with + k, scale * wide_load(with + k));
    }
    for (int r = c + 1; r < count; r++) {
      const double share = row[r];
      for (int k = 0; k < PANEL; k += WIDE) {
        double *left = upper + r * PANEL + k, *right = own + r * PANEL + k;
        wide_store(left, wide_load(left) - share * wide_load(row + k));
        wide_store(right, wide_load(right) - share * wide_load(with + k));
      }
    }
  }
  for (int r = 0; r < PANEL; r++)
    for (int c = 0; c < PANEL; c++) {
      s[r * PANEL + c] = c <= r && r < count ? upper[c * PANEL + r] : 0;
      inverse[c * PANEL + r] = c <= r && r < count ? own[r * PANEL + c] : 0;
    }
  return 1;
}

/* Rows of a panel before its own factor is found: decay P + diag(drift) less what the panels
 * before say. */
static void reduce_rows(const panel_filter *f, int block, int panel, int i, double *s) {
  const int first = f->starts[block] + panel * PANEL;
  const double *p = f->kept + panel_at(f, block, panel) + (ptrdiff_t)i * PANEL;
  s += (ptrdiff_t)i * PANEL;
  for (int v = 0; v < PANEL; v += SPAN) {
    wide sum[ROWS][VECTORS];
    memset(sum, 0, sizeof sum);
    for (int q = 0; q < panel; q++)
      add_tile_of(VECTORS, PANEL, f->factor + panel_at(f, block, q) + (ptrdiff_t)i * PANEL, PANEL,
                  1, f->turned + (ptrdiff_t)q * PANEL * PANEL + v, PANEL, sum);
    for (int r = 0; r < ROWS; r++)
      for (int c = 0; c < VECTORS; c++) {
        const int at = r * PANEL + v + c * WIDE;
        wide_store(s + at, f->decay * wide_load(p + at) - sum[r][c]);
      }
  }
  for (int r = 0; r < ROWS && i - first < PANEL; r++)
    s[r * PANEL + i - first + r] += f->drift[i + r];
}

/* Columns of S of a block before the sample: the Cholesky factor's, panel by panel, as many as
 * points need. 0: not definite. */
static int factor_block(panel_filter *f, int block) {
  const int start = f->starts[block], end = f->starts[block + 1], count = f->counts[block];
  double inverse[PANEL * PANEL], rows[ROWS * PANEL];
  for (int panel = 0; panel * PANEL < pointed(f, block); panel++) {
    const int first = start + panel * PANEL, left = count - panel * PANEL;
    double *s = f->factor + panel_at(f, block, panel);
    for (int q = 0; q < panel; q++) {
      const double *t = f->factor + panel_at(f, block, q) + (ptrdiff_t)first * PANEL;
      double *turned = f->turned + (ptrdiff_t)q * PANEL * PANEL;
      for (int k = 0; k < PANEL; k++)
        for (int c = 0; c < PANEL; c++) turned[k * PANEL + c] = t[c * PANEL + k];
    }
    for (int i = first; i < first + PANEL; i += ROWS) reduce_rows(f, block, panel, i, s);
    if (!factor_tile(left < PANEL ? left : PANEL, s + (ptrdiff_t)first * PANEL, inverse)) return 0;
    for (int i = first + PANEL; i < end; i += ROWS) {
      double *own = s + (ptrdiff_t)i * PANEL;
      reduce_rows(f, block, panel, i, s);
      memcpy(rows, own, sizeof rows);
      multiply_rows(0, PANEL, PANEL, rows, PANEL, 1, inverse, PANEL, own, PANEL);
    }
  }
  return 1;
}

/* S of all blocks before the sample, also in the precision of the points. 0: not definite. */
static int factor_covariance(panel_filter *f) {
  ptrdiff_t count = 0;
  for (int b = 0; b < f->blocks; b++) {
    const int rows = f->starts[b + 1] - f->starts[b];
    if (!factor_block(f, b)) return 0;
    count += rows_before(rows, rows / PANEL) * PANEL;
  }
  for (ptrdiff_t k = 0; SINGLE && k < count; k++) f->root[k] = R(f->factor[k]);
  return 1;
}

/* Rows of H' of the last layer's weights, from a weight of the network on. */
static void linear_rows(const panel_filter *f, int from, int count, double *x) {
  const int l = f->layers - 1, in = f->widths[l], out = f->widths[l + 1], stride = f->stride;
  const REAL *below = inputs_of(f, l);
  memset(x, 0, sizeof(double) * count * stride);
  for (int r = 0, at = from - f->weights + out * (in + 1); r < count; r++, at++) {
    const int bias = at >= out * in, o = bias ? at - out * in : at / in, j = at - o * in;
    for (int t = 0; t < f->items; t++) {
      const double share = bias ? 1 : (double)below[t * in + j];
      const double *readout = f->readout + (ptrdiff_t)(t * out + o) * f->outputs;
      for (int k = 0; k < f->outputs; k++) x[(ptrdiff_t)r * stride + k] += share * readout[k];
    }
  }
}

/* The weights of a block behind those that points need: sensed <- (P_2 - L L') H', and H times
 * this added to the block's Z'Z. */
static void sense_linear(panel_filter *f, int block) {
  const int at = pointed(f, block), start = f->starts[block], end = f->starts[block + 1];
  const int stride = f->stride, rows = end - start - at;
  double *x = f->linear, *seen = f->whitened;
  int before = at;
  if (rows <= 0) return;
  for (int b = 0; b < block; b++) before += f->counts[b];
  memset(x, 0, sizeof(double) * rows * stride);
  linear_rows(f, before, f->counts[block] - at, x);
  sense_block(f, block, at, x);
  for (int q = 0; q < at; q += ROWS)
    multiply_rows(0, stride, rows,
                  f->factor + panel_at(f, block, q / PANEL) + (ptrdiff_t)(start + at) * PANEL +
                      q % PANEL,
                  1, PANEL, x, stride, seen + (ptrdiff_t)q * stride, stride);
  for (int k = 0; k < at * stride; k++) seen[k] = -seen[k];
  for (int i = start + at; i < end; i += ROWS)
    for (int q = 0; q < at; q += PANEL)
      multiply_rows(1, stride, PANEL,
                    f->factor + panel_at(f, block, q / PANEL) + (ptrdiff_t)i * PANEL, PANEL, 1,
                    seen + (ptrdiff_t)q * stride, stride, f->sensed + (ptrdiff_t)i * stride,
                    stride);
  add_sensed_gram(f, block, at, x, gram_of(f, block));
}

/* sensed <- S Z of a block, from the factor and the slopes of the points, beside what the weights
 * without points gave. */
static void sense_points(panel_filter *f, int block) {
  const int start = f->starts[block], end = f->starts[block + 1], stride = f->stride;
  const int last = start + pointed(f, block);
  double *slopes = f->whitened; /* in double, until it is needed itself */
  for (int k = start * stride; k < last * stride; k++) slopes[k] = (double)f->slopes[k];
  for (int i = start; i < end; i += ROWS)
    for (int first = start; first <= i && first < last; first += PANEL)
      multiply_rows(first > start || i >= last, stride, PANEL,
                    f->factor + panel_at(f, block, (first - start) / PANEL) + (ptrdiff_t)i * PANEL,
                    PANEL, 1, slopes + (ptrdiff_t)first * stride, stride,
                    f->sensed + (ptrdiff_t)i * stride, stride);
}

/* P <- decay P + diag(drift) - U U' of a block. */
static void shrink_block(panel_filter *f, int block) {
  const int start = f->starts[block], end = f->starts[block + 1], m = f->outputs;
  for (int first = start; first < end; first += PANEL) {
    double *p = f->kept + panel_at(f, block, (first - start) / PANEL), *turned = f->turned;
    for (int k = 0; k < m; k++)
      for (int c = 0; c < PANEL; c++)
        turned[k * PANEL + c] = f->whitened[(ptrdiff_t)(first + c) * f->stride + k];
    for (int i = first; i < end; i += ROWS)
      for (int v = 0; v < PANEL; v += SPAN) {
        wide sum[ROWS][VECTORS];
        memset(sum, 0, sizeof sum);
        add_tile_of(VECTORS, m, f->whitened + (ptrdiff_t)i * f->stride, f->stride, 1, turned + v,
                    PANEL, sum);
        for (int r = 0; r < ROWS; r++)
          for (int c = 0; c < VECTORS; c++) {
            double *own = p + (ptrdiff_t)(i + r) * PANEL + v + c * WIDE;
            wide_store(own, f->decay * wide_load(own) - sum[r][c]);
          }
      }
    for (int c = 0; c < PANEL; c++) p[(ptrdiff_t)(first + c) * PANEL + c] += f->drift[first + c];
  }
}

/* G with G G' = P_yy^-1, turned its transpose; 0 where P_yy is not positive definite. */
static int invert_covariance(void *memory, double *g, double *turned) {
  panel_filter *f = memory;
  const int size = f->stride * f->stride;
  double *work = f->small + size, *total = f->small + 4 * size;
  memcpy(total, f->small, sizeof(double) * size);
  for (int b = 0; b < f->blocks; b++)
    for (int k = 0; k < size; k++) total[k] += gram_of(f, b)[k];
  return invert_turned(f->outputs, f->stride, 0, total, work, g, turned);
}

/* The same as `screen_panels`, for what the weights and y share as well. */
static void screen_covariance(void *memory) {
  panel_filter *f = memory;
  screen_panels(f);
  for (int k = 0; k < f->outputs; k++)
    for (int i = 0; f->screen->left_out[k] && i < f->rows; i++)
      f->sensed[(ptrdiff_t)i * f->stride + k] = 0;
}

/* Mean and P after the sample; gain: P_yy^-1 (y - mean). */
static void learn_covariance(void *memory, const double *gain, const double *g) {
  panel_filter *f = memory;
  const int m = f->outputs, stride = f->stride;
  int weight = 0;
  for (int b = 0; b < f->blocks; b++) {
    if (f->factor) sense_points(f, b);
    for (int i = f->starts[b]; i < f->starts[b + 1]; i += ROWS)
      multiply_rows(0, stride, m, f->sensed + (ptrdiff_t)i * stride, stride, 1, g, stride,
                    f->whitened + (ptrdiff_t)i * stride, stride);
    for (int j = f->starts[b]; j < f->starts[b] + f->counts[b]; j++) {
      double step = 0;
      for (int k = 0; k < m; k++) step += f->sensed[(ptrdiff_t)j * stride + k] * gain[k];
      f->mean[f->order[weight++]] += step;
    }
    shrink_block(f, b);
  }
}

/* Learn one sample, which `predict` predicts: moments of y and slopes. */
static int learn_by_panels(panel_filter *f, int (*predict)(void *)) {
  const structure panels = {predict, panels_in_range, screen_panels, invert_panels, learn_panels};
  const structure covariance = {predict, covariance_in_range, screen_covariance,
                                invert_covariance, learn_covariance};
  return learn_sample(&f->base, f, f->kept ? &covariance : &panels);
}

#endif
