/* Square roots of the blocks of a group of neurons, one neuron in each lane.
 *
 * Three changes: the drift before a sample, P <- growth^2 P + D, as a Cholesky factor built
 * four rows by four; a measurement that y sees along one direction, I - a' a' of rank one;
 * and one of any rank. Every root stays lower triangular and every diagonal positive.
 */
#ifndef PATAGIUM_NODE_ROOT_H
#define PATAGIUM_NODE_ROOT_H

#include "node.h"

#define SMALLEST (SINGLE ? 1e-7 : 1e-15) /* share of a variance that rounding leaves of it */

static inline reals reals_larger(reals a, reals b) {
  masks above = (masks)(a > b);
  return (reals)((above & (masks)a) | (~above & (masks)b));
}

static inline reals reals_root(reals x) {
  for (int c = 0; c < WIDTH; c++) x[c] = SINGLE ? R(sqrtf((float)x[c])) : R(sqrt((double)x[c]));
  return x;
}

/* 1 / x, and 0 where x is not positive. */
static inline reals reals_inverse(reals x) {
  masks some = (masks)(x > reals_all(0));
  return (reals)(some & (masks)(R(1) / x));
}

/* sum += sign times the product of two bands over columns 0 .. columns - 1. */
static inline __attribute__((always_inline)) void tile_product(
    int rows, int others, int columns, reals scale, const REAL *s, const REAL *t,
    reals sum[BAND][BAND]) {
  for (int i = 0; i < columns; i++) {
    reals other[BAND];
    for (int q = 0; q < others; q++) other[q] = row_load(t, (ptrdiff_t)i * others + q);
    for (int r = 0; r < rows; r++) {
      reals here = scale * row_load(s, (ptrdiff_t)i * rows + r);
      for (int q = 0; q < others; q++) sum[r][q] += here * other[q];
    }
  }
}

/* One band of the factor of growth^2 S S' + D, its rows from `first` on. */
static inline __attribute__((always_inline)) void drift_band(
    int rows, int first, reals gain, const REAL *s, const REAL *drift, REAL *after,
    REAL *inverses) {
  const int bands = first / BAND;
  const REAL *mine = s + band_start(bands) * WIDTH;
  REAL *target = after + band_start(bands) * WIDTH;
  for (int b = 0; b <= bands; b++) {
    const int others = b < bands ? BAND : rows, columns = BAND * b;
    const REAL *there = s + band_start(b) * WIDTH;
    REAL *done = after + band_start(b) * WIDTH;
    reals sum[BAND][BAND] = {{{0}}};
    if (b < bands) {
      tile_product(rows, BAND, columns + BAND, gain, mine, there, sum);
      tile_product(rows, BAND, columns, reals_all(R(-1)), target, done, sum);
    } else {
      tile_product(rows, rows, columns + rows, gain, mine, there, sum);
      for (int r = 0; r < rows; r++) sum[r][r] += row_load(drift, first + r);
    }
    reals whole[BAND];
    for (int r = 0; r < rows; r++) whole[r] = sum[r][r];
    if (b == bands) tile_product(rows, rows, columns, reals_all(R(-1)), target, target, sum);
    for (int q = 0; q < others; q++) { /* column q of the tile, by the factor on the diagonal */
      for (int r = b < bands ? 0 : q; r < rows; r++)
        for (int p = 0; p < q; p++) {
          reals low = b < bands ? row_load(done, (ptrdiff_t)(columns + p) * BAND + q) : sum[q][p];
          sum[r][q] -= sum[r][p] * low;
        }
      if (b == bands) {
        reals pivot = reals_larger(sum[q][q], whole[q] * R(SMALLEST));
        sum[q][q] = reals_root(pivot);
        row_store(inverses, first + q, reals_inverse(sum[q][q]));
        for (int r = q + 1; r < rows; r++) sum[r][q] *= row_load(inverses, first + q);
      } else {
        for (int r = 0; r < rows; r++) sum[r][q] *= row_load(inverses, columns + q);
      }
    }
    for (int q = 0; q < others; q++)
      for (int r = 0; r < rows; r++)
        row_store(target, (ptrdiff_t)(columns + q) * rows + r,
                  b < bands || r >= q ? sum[r][q] : (reals){0});
  }
}

/* The factor of growth^2 S S' + diag(drift) of one group; inverses: room for k vectors. */
static void drift_root(int k, double growth, const REAL *s, const REAL *drift, REAL *after,
                       REAL *inverses) {
  const reals gain = reals_all(R(growth * growth));
  int first = 0;
  for (; first + BAND <= k; first += BAND)
    drift_band(BAND, first, gain, s, drift, after, inverses);
  if (k % BAND == 1) drift_band(1, first, gain, s, drift, after, inverses);
  if (k % BAND == 2) drift_band(2, first, gain, s, drift, after, inverses);
  if (k % BAND == 3) drift_band(3, first, gain, s, drift, after, inverses);
}

/* A band after the sample: S_i <- (S_i - b g_i) h_i, b <- b + S_i a_i, columns backwards. */
static inline __attribute__((always_inline)) reals band_shrink(
    int rows, int columns, const REAL *before, REAL *after, const REAL *slopes,
    const REAL *gains, REAL *cross) {
  reals b[BAND] = {{0}}, norm[BAND] = {{0}}, longest = {0};
  for (int i = columns - 1; i >= 0; i--) {
    const reals a = row_load(slopes, i), g = row_load(gains, 2 * i), h = row_load(gains, 2 * i + 1);
    for (int r = 0; r < rows; r++) {
      const reals s = row_load(before, (ptrdiff_t)i * rows + r);
      const reals fresh = (s - b[r] * g) * h;
      b[r] += s * a;
      norm[r] += fresh * fresh;
      row_store(after, (ptrdiff_t)i * rows + r, fresh);
    }
  }
  for (int r = 0; r < rows; r++) {
    row_store(cross, r, b[r]);
    longest = reals_larger(longest, norm[r]);
  }
  return longest;
}

/* The root after a measurement of rank one: S <- growth S (I - alpha a a')^(1/2), triangular.
 *
 * remaining is 1 - alpha a'a > 0; cross <- S a. Carlson's recursion, with A = remaining + the
 * sum of alpha a_i^2 over the columns done, last first: g = alpha a_i / A_before,
 * h = growth (A_before / A)^(1/2). Gives the longest row, squared, of each lane. */
static reals shrink_root(int k, double growth, reals alpha, reals remaining, const REAL *before,
                         REAL *after, const REAL *slopes, REAL *gains, REAL *cross) {
  reals total = remaining;
  for (int i = k - 1; i >= 0; i--) {
    const reals a = row_load(slopes, i), next = total + alpha * a * a;
    row_store(gains, 2 * i, alpha * a / total);
    row_store(gains, 2 * i + 1, R(growth) * reals_root(total / next));
    total = next;
  }
  reals longest = {0};
  int b = 0;
  for (; b < k / BAND; b++)
    longest = reals_larger(
        longest, band_shrink(BAND, BAND * (b + 1), before + band_start(b) * WIDTH,
                             after + band_start(b) * WIDTH, slopes, gains,
                             cross + (ptrdiff_t)BAND * b * WIDTH));
  const REAL *from = before + band_start(b) * WIDTH;
  REAL *to = after + band_start(b) * WIDTH, *rest = cross + (ptrdiff_t)BAND * b * WIDTH;
  reals tail = {0};
  if (k % BAND == 1) tail = band_shrink(1, k, from, to, slopes, gains, rest);
  if (k % BAND == 2) tail = band_shrink(2, k, from, to, slopes, gains, rest);
  if (k % BAND == 3) tail = band_shrink(3, k, from, to, slopes, gains, rest);
  return reals_larger(longest, tail);
}

/* G with G G' = M^-1 in WIDE lanes, upper; M (m, m) is overwritten by its lower factor. A
 * pivot that rounding has taken is raised to a share of `whole`: the block shrinks less. */
static void invert_roots(int m, double *matrix, const double *whole, int stride, double *g) {
  for (int k = 0; k < m; k++)
    for (int l = 0; l <= k; l++) {
      wide sum = wide_load(matrix + (k * m + l) * WIDE);
      for (int i = 0; i < l; i++)
        sum -= wide_load(matrix + (k * m + i) * WIDE) * wide_load(matrix + (l * m + i) * WIDE);
      if (k > l) sum *= wide_load(matrix + (l * m + l) * WIDE); /* the diagonal is inverted */
      for (int c = 0; k == l && c < WIDE; c++)
        sum[c] = 1 / sqrt(fmax(sum[c], 1e-14 * whole[k * stride + k]));
      wide_store(matrix + (k * m + l) * WIDE, sum);
    }
  for (int l = 0; l < m; l++)
    for (int k = 0; k < m; k++) {
      wide sum = {0};
      const wide inverse = wide_load(matrix + (k * m + k) * WIDE);
      for (int i = l; i < k; i++)
        sum -= wide_load(matrix + (k * m + i) * WIDE) * wide_load(g + (l * m + i) * WIDE);
      wide_store(g + (l * m + k) * WIDE, k == l ? inverse : sum * inverse);
    }
}

/* Steps e / sqrt(a) and shrinks 1 / sqrt(a) of Carlson's recursion (see cubature.c) in WIDE
 * lanes for every column, last first, from G (m, m); gains: columns of m + 1 vectors. */
static void find_gains(int k, int m, const REAL *slopes, double *g, REAL *gains) {
  wide inner[m], step[m];
  for (int i = k - 1; i >= 0; i--) {
    const REAL *z = slopes + (ptrdiff_t)i * m * WIDTH;
    REAL *gain = gains + (ptrdiff_t)i * (m + 1) * WIDTH;
    wide alpha = wide_all(1);
    for (int l = 0; l < m; l++) inner[l] = (wide){0};
    for (int q = 0; q < m; q++) {
      const wide here = wide_from(z + q * WIDTH);
      for (int l = 0; l < m; l++) inner[l] += here * wide_load(g + (q * m + l) * WIDE);
    }
    for (int l = 0; l < m; l++) alpha += inner[l] * inner[l];
    wide root = alpha;
    for (int c = 0; c < WIDE; c++) root[c] = sqrt(root[c]);
    for (int q = 0; q < m; q++) {
      wide sum = {0};
      for (int l = 0; l < m; l++) sum += wide_load(g + (q * m + l) * WIDE) * inner[l];
      wide_to(gain + q * WIDTH, sum);
      step[q] = sum / (alpha + root);
    }
    wide_to(gain + m * WIDTH, 1 / root);
    for (int q = 0; q < m; q++)
      for (int l = 0; l < m; l++) {
        double *here = g + (q * m + l) * WIDE;
        wide_store(here, wide_load(here) - step[q] * inner[l]);
      }
  }
}

/* The root after a measurement of any rank: S_i <- growth (S_i - C e_i) / sqrt(a_i),
 * C <- C + S_i z_i'. Gives the longest row, squared, of each lane; cross: rows of m. */
static reals shrink_root_by(int k, int m, double growth, const REAL *before, REAL *after,
                            const REAL *slopes, const REAL *gains, REAL *cross) {
  reals longest = {0};
  for (int j = 0; j < k; j++) {
    const int b = j / BAND, rows = k - BAND * b < BAND ? k - BAND * b : BAND;
    const ptrdiff_t at = band_start(b) + j % BAND;
    REAL *c = cross + (ptrdiff_t)j * m * WIDTH;
    reals norm = {0};
    memset(c, 0, sizeof(REAL) * WIDTH * m);
    for (int i = j; i >= 0; i--) {
      const REAL *gain = gains + (ptrdiff_t)i * (m + 1) * WIDTH;
      const REAL *z = slopes + (ptrdiff_t)i * m * WIDTH;
      const reals s = row_load(before, at + (ptrdiff_t)i * rows);
      reals fresh = s;
      for (int q = 0; q < m; q++) {
        const reals here = row_load(c, q);
        fresh -= here * row_load(gain, q);
        row_store(c, q, here + s * row_load(z, q));
      }
      fresh *= R(growth) * row_load(gain, m);
      norm += fresh * fresh;
      row_store(after, at + (ptrdiff_t)i * rows, fresh);
    }
    longest = reals_larger(longest, norm);
  }
  return longest;
}

#endif
