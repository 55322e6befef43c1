/* The recursion over the columns of a block in parts that do not wait for each other.
 *
 * The step of a column depends on those behind it by M + sum of z z' alone. So the columns are cut
 * into parts, and each lane of a vector goes through one. With L L' = M + sum of z z' of what is
 * behind a part, F = L^-1 Z of its columns and V V' = I + F' F, V upper triangular, shrinks are
 * 1 / V_cc and steps -L^-T F V^-T. Columns stand here from the last to the first, so that V is
 * lower triangular.
 *
 * Products have the square of the condition of what `recur` does. Where a pivot is small beside
 * its variance, or outputs are many, the sample is left to that.
 */
#ifndef PATAGIUM_ABREAST_H
#define PATAGIUM_ABREAST_H

#include "cubature.h"
#include "small.h"

#define LEAST_PIVOT 1e-6 /* over its variance: rounding grows by the inverse at most */
#define DEEP 10           /* columns of a part, at most */
#define MOST_ABREAST 64   /* outputs, whose squares times a vector stand on the stack */

/* x <- x + sign sum over `depth` of a b, `count` sums at once. */
static inline __attribute__((always_inline)) void add_some(
    int sign, int count, int depth, const wide *a, int a_depth, int a_apart, const wide *b,
    int b_depth, wide *x, int apart) {
  wide sum[4];
  for (int r = 0; r < count; r++) sum[r] = x[r * apart];
  for (int i = 0; i < depth; i++)
    for (int r = 0; r < count; r++)
      sum[r] += sign * a[i * a_depth + r * a_apart] * b[i * b_depth];
  for (int r = 0; r < count; r++) x[r * apart] = sum[r];
}

static inline __attribute__((always_inline)) void add_sums(
    int sign, int count, int depth, const wide *a, int a_depth, int a_apart, const wide *b,
    int b_depth, wide *x, int apart) {
  int r = 0;
  for (; r + 4 <= count; r += 4)
    add_some(sign, 4, depth, a + r * a_apart, a_depth, a_apart, b, b_depth, x + r * apart, apart);
  a += r * a_apart;
  x += r * apart;
  if (count - r == 3) add_some(sign, 3, depth, a, a_depth, a_apart, b, b_depth, x, apart);
  else if (count - r == 2) add_some(sign, 2, depth, a, a_depth, a_apart, b, b_depth, x, apart);
  else if (count - r == 1) add_some(sign, 1, depth, a, a_depth, a_apart, b, b_depth, x, apart);
}

/* sum <- sum + x x' on the diagonal and left of it; x: (size, depth). */
static void add_grams(int size, int depth, const wide *x, int row, int column, wide *sum) {
  for (int k = 0; k < size; k++)
    add_sums(1, k + 1, depth, x, column, row, x + k * row, column, sum + k * size, 1);
}

/* Lower factors in the place of matrices, their diagonals inverted; 0: a pivot is small. */
static int factor_all(int size, wide *a) {
  int large = 1;
  for (int l = 0; l < size; l++) {
    wide *row = a + l * size;
    double pivots[WIDE];
    const wide variance = row[l];
    add_sums(-1, size - l, l, row, 1, size, row, 1, row + l, size);
    for (int c = 0; c < WIDE; c++) {
      large &= row[l][c] > LEAST_PIVOT * variance[c];
      pivots[c] = 1 / sqrt(row[l][c]);
    }
    row[l] = wide_load(pivots);
    for (int k = l + 1; k < size; k++) a[k * size + l] *= row[l];
  }
  return large;
}

/* x <- L^-1 x; x: (size, count). */
static void solve_all(int size, int count, const wide *a, wide *x, int row, int column) {
  for (int k = 0; k < size; k++) {
    add_sums(-1, count, k, x, row, column, a + k * size, 1, x + k * row, column);
    for (int c = 0; c < count; c++) x[k * row + c * column] *= a[k * size + k];
  }
}

/* x <- L^-T x. */
static void solve_back(int size, int count, const wide *a, wide *x) {
  for (int k = size - 1; k >= 0; k--) {
    const int next = k + 1;
    add_sums(-1, count, size - next, x + next * count, count, 1, a + next * size + k, size,
             x + k * count, 1);
    for (int c = 0; c < count; c++) x[k * count + c] *= a[k * size + k];
  }
}

/* Steps and shrinks of a block; rest: M and what other blocks add to it. 0: a pivot is small. */
static int recur_abreast(panel_filter *f, int block, const double *rest) {
  const int m = f->outputs, stride = f->stride, start = f->starts[block], count = f->counts[block];
  const int rounds = (count + DEEP * WIDE - 1) / (DEEP * WIDE);
  const int deep = (count + rounds * WIDE - 1) / (rounds * WIDE);
  wide lower[m * m], inner[DEEP * DEEP], z[m * deep];
  double sum[m * m];
  for (int k = 0; k < m; k++)
    for (int l = 0; l <= k; l++) sum[k * m + l] = rest[k * stride + l];
  for (int last = rounds * WIDE * deep - 1; last >= 0; last -= WIDE * deep) {
    memset(z, 0, sizeof z);
    for (int lane = 0; lane < WIDE; lane++)
      for (int c = 0; c < deep; c++) {
        const int column = last - lane * deep - c;
        for (int k = 0; k < m && column < count; k++)
          z[k * deep + c][lane] = (double)f->slopes[(ptrdiff_t)(start + column) * stride + k];
      }
    memset(lower, 0, sizeof lower);
    add_grams(m, deep, z, deep, 1, lower);
    for (int k = 0; k < m; k++)
      for (int l = 0; l <= k; l++) {
        double own[WIDE], behind = sum[k * m + l];
        wide_store(own, lower[k * m + l]);
        for (int lane = 0; lane < WIDE; lane++) {
          const double next = behind + own[lane];
          own[lane] = behind;
          behind = next;
        }
        lower[k * m + l] = wide_load(own);
        sum[k * m + l] = behind;
      }
    if (!factor_all(m, lower)) return 0;
    solve_all(m, deep, lower, z, deep, 1);
    memset(inner, 0, sizeof inner);
    for (int c = 0; c < deep; c++) inner[c * deep + c] += 1;
    add_grams(deep, m, z, 1, deep, inner);
    if (!factor_all(deep, inner)) return 0;
    solve_all(deep, m, inner, z, 1, deep);
    solve_back(m, deep, lower, z);
    for (int lane = 0; lane < WIDE; lane++)
      for (int c = 0; c < deep; c++) {
        const int column = start + last - lane * deep - c;
        if (column >= start + count) continue;
        REAL *step = f->steps + (ptrdiff_t)(column / PANEL) * m * PANEL + column % PANEL;
        f->shrinks[column] = R(inner[c * deep + c][lane]);
        for (int k = 0; k < m; k++) step[k * PANEL] = R(-z[k * deep + c][lane]);
      }
  }
  return 1;
}

#endif
