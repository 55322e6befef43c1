/* A table between its knots: straight lines, their corners rounded.
 *
 * The kernel of `aerodynamics.polars`, whose SX function is its oracle and
 * has the equation.
 * Numbers of several states stand `stride` apart.
 */
#ifndef PATAGIUM_TABLE_H
#define PATAGIUM_TABLE_H

#include "operations.h"

/* Slope of the line after knot k; zero before the first and after the last. */
static inline double table_slope(int k, int knots, const double *knot, const double *value,
                                 int stride) {
  if (k < 0 || k + 1 >= knots) return 0.0;
  return (value[(k + 1) * stride] - value[k * stride]) /
         (knot[(k + 1) * stride] - knot[k * stride]);
}

/* What rounding adds at knot k. */
static inline double table_corner(int k, int knots, double x, const double *knot,
                                  const double *value, int stride) {
  if (k < 0 || k >= knots) return 0.0;
  double before = INFINITY, after = INFINITY;
  if (k > 0) before = knot[k * stride] - knot[(k - 1) * stride];
  if (k + 1 < knots) after = knot[(k + 1) * stride] - knot[k * stride];
  const double half = 0.5 * scalar_fmin(before, after), t = (x - knot[k * stride]) / half;
  if (t <= -1.0 || t >= 1.0) return 0.0;
  const double square = t * t;
  const double even = square * (17.5 + square * (-8.75 + square * (3.5 - 0.625 * square))) / 16.0;
  const double turn = table_slope(k, knots, knot, value, stride) -
                      table_slope(k - 1, knots, knot, value, stride);
  return turn * half * (0.5 * (t + even) + 0.13671875 - scalar_fmax(0.0, t));
}

static inline void table_strided(int knots, int columns, const double *x, const double *knot,
                                 const double *value, double *out, int stride) {
  int k = -1;
  while (k + 1 < knots && knot[(k + 1) * stride] <= x[0]) k++;
  const int anchor = k > 0 ? k : 0;
  for (int c = 0; c < columns; c++, value += knots * stride)
    out[c * stride] = value[anchor * stride] +
                      table_slope(k, knots, knot, value, stride) * (x[0] - knot[anchor * stride]) +
                      table_corner(k, knots, x[0], knot, value, stride) +
                      table_corner(k + 1, knots, x[0], knot, value, stride);
}

static inline void table_double(int sizes, const int *size, const double *const *in,
                                double *const *out) {
  (void)sizes;
  table_strided(size[0], size[1], in[0], in[1], in[2], out[0], 1);
}

static inline void table_lanes(int sizes, const int *size, const lanes *const *in,
                               lanes *const *out) {
  (void)sizes;
  for (int lane = 0; lane < LANES; lane++)
    table_strided(size[0], size[1], (const double *)in[0] + lane, (const double *)in[1] + lane,
                  (const double *)in[2] + lane, (double *)out[0] + lane, LANES);
}

#endif
