/* How a sample changes the square root of the covariance: the recursion over the columns,
 * small and in double, and what it does to S and C, panel by panel.
 *
 * A panel of columns is changed at once. A number of S takes n_y multiplications for C e, PANEL
 * for what the columns do to each other, half of them with zeros, and stride for C.
 */
#ifndef PATAGIUM_TRANSFORM_H
#define PATAGIUM_TRANSFORM_H

#include "cubature.h"
#include "small.h"

/* Rows and vectors of a block of a product that stay in registers. */
#define VECTORS 2
#if VECTOR_BYTES == 64
#define ROWS 8
#else
#define ROWS 4
#endif
#define FEW (ROWS < WIDTH ? ROWS : WIDTH) /* rows where they are the points of one vector */

/* sum <- sum + a b for one block of rows; a is (rows, depth). */
static inline __attribute__((always_inline)) void add_block(
    int rows, int vectors, int depth, const REAL *a, int a_row, int a_depth, const REAL *b,
    int b_stride, reals sum[ROWS][VECTORS]) {
  for (int k = 0; k < depth; k++)
    for (int v = 0; v < vectors; v++) {
      reals column = reals_load(b + k * b_stride + v * WIDTH);
      IN_REGISTER(column);
      for (int r = 0; r < rows; r++) sum[r][v] += a[r * a_row + k * a_depth] * column;
    }
}

/* target <- (keep ? target : 0) + a b for one block of rows. */
static inline __attribute__((always_inline)) void block_product(
    int keep, int rows, int vectors, int depth, const REAL *a, int a_row, int a_depth,
    const REAL *b, int b_stride, REAL *target, int stride) {
  reals sum[ROWS][VECTORS];
  for (int r = 0; r < rows; r++)
    for (int v = 0; v < vectors; v++)
      sum[r][v] = keep ? reals_load(target + r * stride + v * WIDTH) : (reals){0};
  add_block(rows, vectors, depth, a, a_row, a_depth, b, b_stride, sum);
  for (int r = 0; r < rows; r++)
    for (int v = 0; v < vectors; v++) reals_store(target + r * stride + v * WIDTH, sum[r][v]);
}

/* The same for half a vector of columns. */
static inline __attribute__((always_inline)) void half_product(
    int keep, int rows, int depth, const REAL *a, int a_row, int a_depth, const REAL *b,
    int b_stride, REAL *target, int stride) {
  halves sum[ROWS] = {{0}}, column;
  for (int r = 0; r < rows && keep; r++) memcpy(sum + r, target + r * stride, sizeof column);
  for (int k = 0; k < depth; k++) {
    memcpy(&column, b + k * b_stride, sizeof column);
    for (int r = 0; r < rows; r++) sum[r] += a[r * a_row + k * a_depth] * column;
  }
  for (int r = 0; r < rows; r++) memcpy(target + r * stride, sum + r, sizeof column);
}

/* The same over all columns of the target, a multiple of half a vector. */
static inline __attribute__((always_inline)) void band_product(
    int keep, int rows, int columns, int depth, const REAL *a, int a_row, int a_depth,
    const REAL *b, int b_stride, REAL *target, int stride) {
  int v = 0;
  for (; v + VECTORS * WIDTH <= columns; v += VECTORS * WIDTH)
    block_product(keep, rows, VECTORS, depth, a, a_row, a_depth, b + v, b_stride, target + v,
                  stride);
  for (; v + WIDTH <= columns; v += WIDTH)
    block_product(keep, rows, 1, depth, a, a_row, a_depth, b + v, b_stride, target + v, stride);
  if (v < columns)
    half_product(keep, rows, depth, a, a_row, a_depth, b + v, b_stride, target + v, stride);
}

/* Columns that hold outputs: of `stride`, what is not half a vector of zeros. ROWS sums of one
 * vector would wait for themselves where ROWS is 4: there, whole blocks. */
static int used_columns(const panel_filter *f) {
  const int unit = ROWS < 8 ? VECTORS * WIDTH : WIDTH / 2;
  const int used = (f->outputs + unit - 1) / unit * unit;
  return used < f->stride ? used : f->stride;
}

/* The recursion over WIDE columns from `first` on, the last one first. rows: (m, stride + WIDE),
 * G' and beside it the f of all these columns, which change as G' does, so that none waits. */
static inline __attribute__((always_inline)) void recur_columns(
    int vectors, const panel_filter *f, int first, double *slopes, double *rows) {
  const int m = f->outputs, stride = f->stride, width = vectors * WIDE, last = width - WIDE;
  for (int k = 0; k < m; k++)
    for (int c = 0; c < WIDE; c++)
      slopes[k * WIDE + c] = (double)f->slopes[(first + c) * stride + k];
  for (int k = 0; k < m; k++)
    wide_store(rows + k * width + last, combined(m, WIDE, rows + k * width, slopes));
  for (int c = WIDE - 1; c >= 0; c--) {
    const double *own = rows + last + c; /* f, at every width */
    wide even[vectors], odd[vectors];
    for (int v = 0; v < vectors; v++) even[v] = odd[v] = (wide){0};
    for (int k = 0; k + 1 < m; k += 2)
      for (int v = 0; v < vectors; v++) {
        even[v] += own[k * width] * wide_load(rows + k * width + v * WIDE);
        odd[v] += own[(k + 1) * width] * wide_load(rows + (k + 1) * width + v * WIDE);
      }
    for (int v = 0; v < vectors; v++) {
      if (m % 2) even[v] += own[(m - 1) * width] * wide_load(rows + (m - 1) * width + v * WIDE);
      even[v] += odd[v];
      wide_store(slopes + v * WIDE, even[v]);
    }
    const double alpha = 1 + slopes[last + c], root = sqrt(alpha);
    const double shrink = 1 / root, gain = 1 / (alpha + root);
    for (int v = 0; v < vectors; v++) even[v] *= gain;
    for (int k = 0; k < m; k++) {
      const double scale = own[k * width];
      for (int v = 0; v < vectors; v++) {
        double *here = rows + k * width + v * WIDE;
        wide_store(here, wide_load(here) - scale * even[v]);
      }
    }
    f->shrinks[first + c] = R(shrink);
    REAL *step = f->steps + (ptrdiff_t)(first / PANEL) * m * PANEL + first % PANEL + c;
    for (int k = 0; k < m; k++) step[k * PANEL] = R(-shrink * slopes[k]);
  }
}

/* The recursion over the columns of a block: steps, shrinks; g becomes the root of P_yy^-1,
 * turned its transpose, kept beside it. */
static void recur(panel_filter *f, int block, double *g, double *turned) {
  const int m = f->outputs, stride = f->stride, width = stride + WIDE, start = f->starts[block];
  const size_t row = sizeof(double) * stride;
  double *slopes = f->small + stride * stride, *rows = turned; /* over what has been used */
  for (int k = m - 1; k >= 0; k--) memmove(rows + k * width, turned + k * stride, row);
  for (int first = start + (f->counts[block] - 1) / WIDE * WIDE; first >= start; first -= WIDE)
    if (width == 3 * WIDE)
      recur_columns(3, f, first, slopes, rows);
    else if (width == 2 * WIDE)
      recur_columns(2, f, first, slopes, rows);
    else
      recur_columns(width / WIDE, f, first, slopes, rows);
  for (int k = 0; k < m; k++) memmove(turned + k * stride, rows + k * width, row);
  memset(turned + m * stride, 0, row * (stride - m));
  for (int k = 0; k < stride; k++)
    for (int l = 0; l < stride; l++) g[l * stride + k] = turned[k * stride + l];
}

/* ROWS rows of a panel of S after the sample, and their part of C: PANEL columns are VECTORS. */
static inline __attribute__((always_inline)) void change_rows(
    int used, int m, int stride, const REAL *steps, const REAL *mix, const REAL *grown, REAL *s,
    REAL *cross) {
  reals fresh[ROWS][VECTORS];
  int depth = PANEL;
  __asm__("" : "+r"(depth)); /* written out, the products would not fit the registers */
  memset(fresh, 0, sizeof fresh);
  add_block(ROWS, VECTORS, m, cross, stride, 1, steps, PANEL, fresh);
  add_block(ROWS, VECTORS, depth, s, PANEL, 1, mix, PANEL, fresh);
  band_product(1, ROWS, used, depth, s, PANEL, 1, grown, stride, cross, stride);
  memcpy(s, fresh, sizeof fresh); /* a row is VECTORS */
}

/* What the columns of a panel do to each other, (PANEL, PANEL), and their slopes, both grown. */
static void mix_columns(const panel_filter *f, int first, const REAL *steps, REAL *mix, REAL *grown) {
  const int stride = f->stride, rows = FEW;
  const REAL growth = R(f->growth);
  for (int i = 0; i < PANEL; i += rows)
    block_product(0, rows, VECTORS, f->outputs, f->slopes + (first + i) * stride, stride, 1, steps,
                  PANEL, mix + i * PANEL, PANEL);
  for (int i = 0; i < PANEL; i++) {
    for (int j = 0; j < PANEL; j++) mix[i * PANEL + j] *= j < i ? growth : R(0);
    mix[i * PANEL + i] = growth * f->shrinks[first + i];
  }
  for (int k = 0; k < PANEL * stride; k++) grown[k] = growth * f->slopes[first * stride + k];
}

/* A panel of S of a block after the sample, and its part of C. */
static void change_panel(panel_filter *f, int block, int panel) {
  const int start = f->starts[block] + panel * PANEL, m = f->outputs, stride = f->stride;
  const int used = used_columns(f);
  const REAL *steps = f->steps + (ptrdiff_t)start * m;
  REAL *s = panel_of(f, block, panel), mix[PANEL * PANEL], grown[PANEL * stride];
  mix_columns(f, start, steps, mix, grown);
  for (int j = start; j < f->starts[block + 1]; j += ROWS)
    change_rows(used, m, stride, steps, mix, grown, s + (ptrdiff_t)j * PANEL,
                f->cross + (ptrdiff_t)j * stride);
}

#endif
