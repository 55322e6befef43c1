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

/* Derivatives along dknot and dvalue of the functions above, and along dx. */
static inline double table_slope_forward(int k, int knots, const double *knot, const double *value,
                                         const double *dknot, const double *dvalue, int stride) {
  if (k < 0 || k + 1 >= knots) return 0.0;
  const int a = k * stride, b = (k + 1) * stride;
  const double slope = table_slope(k, knots, knot, value, stride);
  return (dvalue[b] - dvalue[a] - slope * (dknot[b] - dknot[a])) / (knot[b] - knot[a]);
}

static inline double table_corner_forward(int k, int knots, double x, const double *knot,
                                          const double *value, double dx, const double *dknot,
                                          const double *dvalue, int stride) {
  if (k < 0 || k >= knots) return 0.0;
  const int first = k > 0 ? k - 1 : 0, last = k + 1 < knots ? k : knots - 2;
  const int a = first * stride, b = last * stride;
  const double before = knot[a + stride] - knot[a], after = knot[b + stride] - knot[b];
  const double of_before = before < after ? 1.0 : before > after ? 0.0 : 0.5;
  const double half = 0.5 * scalar_fmin(before, after);
  const double t = (x - knot[k * stride]) / half;
  if (t <= -1.0 || t >= 1.0) return 0.0;
  const double dhalf = 0.5 * (of_before * (dknot[a + stride] - dknot[a]) +
                              (1.0 - of_before) * (dknot[b + stride] - dknot[b]));
  const double dt = (dx - dknot[k * stride] - t * dhalf) / half;
  const double square = t * t;
  const double even = square * (17.5 + square * (-8.75 + square * (3.5 - 0.625 * square))) / 16.0;
  const double odd = t * (35.0 + square * (-35.0 + square * (21.0 - 5.0 * square))) / 16.0;
  const double bend = 0.5 * (t + even) + 0.13671875 - scalar_fmax(0.0, t);
  const double dbend = (0.5 * (1.0 + odd) - (t >= 0.0 ? 1.0 : 0.0)) * dt;
  const double turn = table_slope(k, knots, knot, value, stride) -
                      table_slope(k - 1, knots, knot, value, stride);
  const double dturn = table_slope_forward(k, knots, knot, value, dknot, dvalue, stride) -
                       table_slope_forward(k - 1, knots, knot, value, dknot, dvalue, stride);
  return dturn * half * bend + turn * (dhalf * bend + half * dbend);
}

static inline void fwd1_table_strided(int knots, int columns, const double *x, const double *knot,
                                      const double *value, const double *dx, const double *dknot,
                                      const double *dvalue, double *out, int stride) {
  int k = -1;
  while (k + 1 < knots && knot[(k + 1) * stride] <= x[0]) k++;
  const int anchor = (k > 0 ? k : 0) * stride;
  const double away = x[0] - knot[anchor], daway = dx[0] - dknot[anchor];
  for (int c = 0; c < columns; c++, value += knots * stride, dvalue += knots * stride)
    out[c * stride] =
        dvalue[anchor] + table_slope(k, knots, knot, value, stride) * daway +
        table_slope_forward(k, knots, knot, value, dknot, dvalue, stride) * away +
        table_corner_forward(k, knots, x[0], knot, value, dx[0], dknot, dvalue, stride) +
        table_corner_forward(k + 1, knots, x[0], knot, value, dx[0], dknot, dvalue, stride);
}

/* The derivative along in[4..6], as CasADi asks for it; in[3] is not looked at. */
static inline void fwd1_table_double(int sizes, const int *size, const double *const *in,
                                     double *const *out) {
  (void)sizes;
  fwd1_table_strided(size[0], size[1], in[0], in[1], in[2], in[4], in[5], in[6], out[0], 1);
}

static inline void fwd1_table_lanes(int sizes, const int *size, const lanes *const *in,
                                    lanes *const *out) {
  (void)sizes;
  const double *given[7];
  for (int lane = 0; lane < LANES; lane++) {
    for (int k = 0; k < 7; k++) given[k] = (const double *)in[k] + lane;
    fwd1_table_strided(size[0], size[1], given[0], given[1], given[2], given[4], given[5],
                       given[6], (double *)out[0] + lane, LANES);
  }
}

#endif
