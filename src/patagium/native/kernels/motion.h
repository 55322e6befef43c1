/* Extended Kalman filter of a robot's motion on square roots: one span, or one time's samples.
 *
 * An estimate is a row of numbers: levels (order x coordinates), attitude (3 x 3), biases, root of
 * the covariance (states x states). The error-state holds the levels of the estimated coordinates
 * one after the other, then the biases. Equations and order of operations are those of
 * motion_filter.py, where they are explained. Nothing is allocated.
 */
#ifndef PATAGIUM_MOTION_H
#define PATAGIUM_MOTION_H

#include <math.h>
#include <string.h>

#include "lanes.h"
#include "motion_filter_struct.h"
#include "motion_sensor_struct.h"

enum { ENCODER, INERTIAL_UNIT, CAMERA };
enum { MOST_ITERATIONS = 5, LEVELS = 3, LINE = 8 };
static const double NEAR[LEVELS] = {1e-2, 1.0, 10.0}; /* changes within which slopes stay */
static const double SMALL_TURN = 1e-6;

/* Parts of an estimate. */
typedef struct {
  double *levels, *attitude, *biases, *root;
} motion;

static motion motion_parts(const motion_filter *f, double *row) {
  motion m = {.levels = row, .attitude = row + f->order * f->coordinates};
  m.biases = m.attitude + 9;
  m.root = m.biases + f->biases;
  return m;
}

static int padded(int columns) { return (columns + LINE - 1) / LINE * LINE; }

/* out <- a b, (3, 3) each; with `turned` the transpose of a. */
static void times(const double *a, const double *b, int turned, double *out) {
  double found[9];
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) {
      found[3 * i + j] = 0;
      for (int k = 0; k < 3; k++)
        found[3 * i + j] += (turned ? a[3 * k + i] : a[3 * i + k]) * b[3 * k + j];
    }
  memcpy(out, found, sizeof found);
}

/* out <- a x, or a' x. */
static void turn_vector(const double *a, const double *x, int turned, double *out) {
  double found[3] = {0, 0, 0};
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) found[i] += (turned ? a[3 * k + i] : a[3 * i + k]) * x[k];
  memcpy(out, found, sizeof found);
}

/* Matrix of a rotation vector. */
static void rotation_matrix(const double *vector, double *out) {
  const double x = vector[0], y = vector[1], z = vector[2], square = x * x + y * y + z * z;
  const double angle = sqrt(square), s = square < SMALL_TURN ? 1 - square / 6 : sin(angle) / angle;
  const double c = square < SMALL_TURN ? 0.5 - square / 24 : (1 - cos(angle)) / square;
  const double d = 1 - c * square;
  const double found[9] = {d + c * x * x,     c * x * y - s * z, c * x * z + s * y,
                           c * x * y + s * z, d + c * y * y,     c * y * z - s * x,
                           c * x * z - s * y, c * y * z + s * x, d + c * z * z};
  memcpy(out, found, sizeof found);
}

/* Rotation vector of a matrix, at most half a turn long. */
static void rotation_vector(const double *m, double *out) {
  const double cosine = (m[0] + m[4] + m[8] - 1) / 2;
  double axis[3] = {(m[7] - m[5]) / 2, (m[2] - m[6]) / 2, (m[3] - m[1]) / 2}, factor = 1;
  const double sine = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
  if (sine > SMALL_TURN) {
    factor = atan2(sine, cosine) / sine;
  } else if (cosine <= 0) { /* half a turn: m + m' = 2 (2 a a' - 1), its longest column is a */
    int k = m[0] > m[4] ? 0 : 4;
    k = m[8] > m[k] ? 2 : k / 4;
    const double own = sqrt(fmax(0, (m[4 * k] + 1) / 2));
    const double sign = axis[k] < 0 ? -1 : 1;
    for (int i = 0; i < 3; i++)
      axis[i] = sign * (i == k ? own : (m[3 * i + k] + m[3 * k + i]) / (4 * own));
    factor = atan2(sine, cosine);
  }
  for (int i = 0; i < 3; i++) out[i] = factor * axis[i];
}

/* Matrix of a quaternion w, x, y, z of any length. */
static void quaternion_matrix(const double *q, double *out) {
  const double w = q[0], x = q[1], y = q[2], z = q[3];
  const double s = 2 / (w * w + x * x + y * y + z * z);
  const double found[9] = {1 - s * (y * y + z * z), s * (x * y - w * z),     s * (x * z + w * y),
                           s * (x * y + w * z),     1 - s * (x * x + z * z), s * (y * z - w * x),
                           s * (x * z - w * y),     s * (y * z + w * x), 1 - s * (x * x + y * y)};
  memcpy(out, found, sizeof found);
}

static double lanes_sum(lanes x) {
  double sum = 0;
  for (int k = 0; k < LANES; k++) sum += x[k];
  return sum;
}

static double dot(int count, const double *a, const double *b) {
  lanes sum = {0};
  int k = 0;
  for (; k + LANES <= count; k += LANES) sum += lanes_load(a + k) * lanes_load(b + k);
  double rest = lanes_sum(sum);
  for (; k < count; k++) rest += a[k] * b[k];
  return rest;
}

/* Reflect `count` rows of w, wide numbers apart, by v from a column on. */
static inline __attribute__((always_inline)) void reflect(int count, int from, int wide,
                                                          const double *v, double scale,
                                                          double *w) {
  lanes sums[4] = {{0}, {0}, {0}, {0}};
  for (int k = from; k < wide; k += LANES) {
    const lanes own = lanes_load(v + k);
    for (int r = 0; r < count; r++) sums[r] += own * lanes_load(w + r * wide + k);
  }
  lanes share[4];
  for (int r = 0; r < count; r++) share[r] = lanes_broadcast(scale * lanes_sum(sums[r]));
  for (int k = from; k < wide; k += LANES) {
    const lanes own = lanes_load(v + k);
    for (int r = 0; r < count; r++)
      lanes_store(w + r * wide + k, lanes_load(w + r * wide + k) - share[r] * own);
  }
}

/* w (rows, wide) becomes [T, *] with T T' = w w', T lower triangular; v: wide numbers. */
static void lower_triangle(int rows, int wide, double *w, double *v) {
  for (int i = 0; i < rows; i++) {
    double *own = w + i * wide, square = 0;
    const int from = i / LANES * LANES;
    for (int k = i; k < wide; k++) square += own[k] * own[k];
    if (square == 0) continue;
    const double length = copysign(sqrt(square), own[i]);
    for (int k = from; k < wide; k++) v[k] = k < i ? 0 : own[k];
    v[i] += length;
    const double scale = 1 / (length * v[i]);
    own[i] = -length;
    int r = i + 1;
    for (; r + 4 <= rows; r += 4) reflect(4, from, wide, v, scale, w + r * wide);
    for (; r < rows; r++) reflect(1, from, wide, v, scale, w + r * wide);
  }
}

/* Motion after a span, but for the root; the rotation vector over it in body axes. */
static void move_mean(const motion_filter *f, const motion *from, double span, motion *to,
                      double *turned) {
  const int n = f->coordinates;
  double power[5] = {1};
  for (int k = 1; k < f->order; k++) power[k] = power[k - 1] * span / k;
  for (int i = 0; i < f->order; i++)
    for (int c = 0; c < n; c++) {
      double sum = 0;
      for (int j = i; j < f->order; j++) sum += power[j - i] * from->levels[j * n + c];
      to->levels[i * n + c] = sum;
    }
  memcpy(to->attitude, from->attitude, 9 * sizeof(double));
  memcpy(to->biases, from->biases, f->biases * sizeof(double));
  turned[0] = turned[1] = turned[2] = 0;
  if (!f->turn) return;
  const int32_t *turn = f->base + 3;
  double spin[3], rate[3], step[9];
  for (int k = 0; k < 3; k++) {
    turned[k] = to->levels[turn[k]];
    spin[k] = from->levels[n + turn[k]];
    rate[k] = from->levels[2 * n + turn[k]];
    to->levels[turn[k]] = 0;
  }
  for (int k = 0; k < 3; k++) { /* body axes turn while they turn */
    const int a = (k + 1) % 3, b = (k + 2) % 3;
    turned[k] += span * span * span / 12 * (spin[a] * rate[b] - spin[b] * rate[a]);
  }
  rotation_matrix(turned, step);
  times(from->attitude, step, 0, to->attitude);
}

/* Rows of the small rotation in the error-state, `wide` apart, turned by a matrix. */
static void turn_rows(const motion_filter *f, const double *half, int columns, int wide,
                      const double *from, int from_wide, double *to) {
  const double *a = from + f->turn[0] * from_wide;
  const double *b = from + f->turn[1] * from_wide;
  const double *c = from + f->turn[2] * from_wide;
  for (int k = 0; k < columns; k++) {
    const double x = a[k], y = b[k], z = c[k];
    for (int i = 0; i < 3; i++)
      to[i * wide + k] = half[3 * i] * x + half[3 * i + 1] * y + half[3 * i + 2] * z;
  }
}

/* Root after a span: the lower triangle of [F S, root of the process noise]. */
static void move_root(const motion_filter *f, const double *root, double span,
                      const double *turned, double *to) {
  const int s = f->states, own = f->own, main = f->order * own, wide = padded(2 * s);
  double *w = f->work, *v = w + s * wide, *rows = v + wide, half[9];
  double power[5] = {1};
  for (int k = 1; k < f->order; k++) power[k] = power[k - 1] * span / k;
  memset(w, 0, sizeof(double) * s * wide);
  if (f->turn) {
    const double back[3] = {-0.5 * turned[0], -0.5 * turned[1], -0.5 * turned[2]};
    rotation_matrix(back, half);
    turn_rows(f, half, s, s, root, s, rows);
  }
  for (int i = 0; i < f->order; i++)
    for (int c = 0; c < own; c++) {
      double *target = w + (i * own + c) * wide;
      for (int j = i; j < f->order; j++) {
        const double *source = root + (j * own + c) * s, factor = power[j - i];
        for (int k = 0; j == 0 && f->turn && k < 3; k++)
          if (f->turn[k] == c) source = rows + k * s;
        for (int k = 0; k < s; k++) target[k] += factor * source[k];
      }
      const double scale = sqrt(span * f->density[c]) * pow(span, f->order - 1 - i);
      for (int j = 0; j <= i; j++) target[s + j * own + c] = scale * f->noise[i * f->order + j];
    }
  for (int k = main; k < s; k++) {
    memcpy(w + k * wide, root + k * s, sizeof(double) * s);
    w[k * wide + s + k] = sqrt(span * f->walk[k - main]);
  }
  if (f->turn) {
    turn_rows(f, half, s, s, w, wide, rows);
    for (int k = 0; k < 3; k++) memcpy(w + f->turn[k] * wide, rows + k * s, sizeof(double) * s);
  }
  lower_triangle(s, wide, w, v);
  for (int i = 0; i < s; i++)
    for (int k = 0; k < s; k++) to[i * s + k] = k <= i ? w[i * wide + k] : 0;
}

/* Levels in the axes of the reference attitude, LEVELS x coordinates. */
static void in_reference(const motion_filter *f, const motion *now, double *seen) {
  const int n = f->coordinates;
  memcpy(seen, now->levels, sizeof(double) * LEVELS * n);
  for (int level = 0; f->base && level < LEVELS; level++) {
    double place[3];
    for (int k = 0; k < 3; k++) place[k] = seen[level * n + f->base[k]];
    turn_vector(now->attitude, place, 1, place);
    for (int k = 0; k < 3; k++) seen[level * n + f->base[k]] = place[k];
  }
}

/* Column of a slope, 6 numbers, by a coordinate in world axes, from those in the reference's. */
static void slope_column(const motion_filter *f, const double *turn, const double *slope,
                         int coordinate, double *out) {
  for (int k = 0; f->base && k < 3; k++)
    if (f->base[k] == coordinate) {
      for (int r = 0; r < 6; r++) {
        out[r] = 0;
        for (int i = 0; i < 3; i++) out[r] += turn[3 * k + i] * slope[6 * f->base[i] + r];
      }
      return;
    }
  memcpy(out, slope + 6 * coordinate, 6 * sizeof(double));
}

/* Residual, slope (rows of `wide`) and deviation of the samples of a sensor; their number. */
static int see(const motion_filter *f, const motion_sensor *sensor, const double *row,
               const motion *now, int wide, double *residual, double *slope, double *deviation) {
  const int n = f->coordinates, own = f->own;
  if (sensor->kind == ENCODER) {
    int count = 0;
    for (int k = 0; k < sensor->values; k++) {
      const int place = sensor->place[k];
      if (place < 0 || isnan(row[k])) continue;
      residual[count] = row[k] - now->levels[f->columns[place]];
      memset(slope + count * wide, 0, sizeof(double) * wide);
      slope[count * wide + place] = 1;
      deviation[count++] = sqrt(sensor->variance[k]);
    }
    return count;
  }
  double *seen = f->work + f->spare, *shown = seen + LEVELS * n, *found = shown + 24;
  double *moved = found + 6 * LEVELS * n;
  const double *up = now->attitude + 6;
  in_reference(f, now, seen);
  memset(slope, 0, sizeof(double) * 6 * wide);
  if (sensor->kind == INERTIAL_UNIT) {
    const double *arguments[] = {seen, seen + n, seen + 2 * n, up, sensor->offset, sensor->parameters};
    double *results[] = {shown, found};
    sensor->frame(arguments, results);
    turn_vector(sensor->mount, shown, 1, shown);
    turn_vector(sensor->mount, shown + 3, 1, shown + 3);
    for (int k = 0; k < 6; k++) residual[k] = row[k] - (shown[k] + now->biases[sensor->bias + k]);
    for (int k = 0; k < 6; k++) slope[k * wide + f->order * own + sensor->bias + k] = 1;
  } else {
    double attitude[9], given[9], *place = shown, *turned = shown + 3, *slopes = moved + 3 * n;
    const double *arguments[] = {seen, sensor->offset, sensor->parameters};
    double *results[] = {place, turned, moved, slopes};
    sensor->frame(arguments, results);
    for (int c = 0; c < n; c++) { /* position in world axes; attitude follows below */
      turn_vector(now->attitude, moved + 3 * c, 0, found + 6 * c);
      memcpy(found + 6 * c + 3, slopes + 3 * c, 3 * sizeof(double));
    }
    for (int i = 0; i < 3; i++) /* the rotation stands by columns */
      for (int j = 0; j < 3; j++) given[3 * i + j] = turned[3 * j + i];
    times(now->attitude, given, 0, attitude);
    times(attitude, sensor->mount, 0, attitude);
    turn_vector(now->attitude, place, 0, place);
    for (int k = 0; k < 3; k++) residual[k] = row[k] - place[k];
    quaternion_matrix(row + 3, given);
    times(attitude, given, 1, given);
    rotation_vector(given, residual + 3);
  }
  for (int level = 0; level < (sensor->kind == CAMERA ? 1 : LEVELS); level++)
    for (int c = 0; c < own; c++) {
      double column[6];
      slope_column(f, now->attitude, found + 6 * level * n, f->columns[c], column);
      if (sensor->kind == INERTIAL_UNIT) turn_vector(sensor->mount, column, 1, column);
      turn_vector(sensor->mount, column + 3, 1, column + 3);
      for (int r = 0; r < 6; r++) slope[r * wide + level * own + c] = column[r];
    }
  for (int k = 0; k < 6; k++) deviation[k] = sqrt(sensor->variance[k]);
  return 6;
}

/* Mean moved by an error-state. */
static void correct(const motion_filter *f, const motion *from, const double *change, motion *to) {
  const int n = f->coordinates, own = f->own;
  memcpy(to->levels, from->levels, sizeof(double) * f->order * n);
  for (int level = 0; level < f->order; level++)
    for (int c = 0; c < own; c++) to->levels[level * n + f->columns[c]] += change[level * own + c];
  memcpy(to->attitude, from->attitude, 9 * sizeof(double));
  if (f->turn) {
    double small[3], step[9];
    for (int k = 0; k < 3; k++) {
      double *level = to->levels + f->base[3 + k];
      small[k] = *level;
      *level = 0;
    }
    rotation_matrix(small, step);
    times(from->attitude, step, 0, to->attitude);
  }
  for (int k = 0; k < f->biases; k++)
    to->biases[k] = from->biases[k] + change[f->order * own + k];
}

/* x <- L^-1 x for rows of `wide`; L (m, m) stands in rows of `apart`. */
static void solve_lower(int m, int apart, const double *lower, int wide, double *x) {
  for (int i = 0; i < m; i++) {
    double *own = x + i * wide;
    for (int j = 0; j < i; j++) {
      const double factor = lower[i * apart + j], *other = x + j * wide;
      for (int k = 0; k < wide; k++) own[k] -= factor * other[k];
    }
    const double scale = 1 / lower[i * apart + i];
    for (int k = 0; k < wide; k++) own[k] *= scale;
  }
}

/* Estimate after a span of time; turned: rotation vector over it, body axes. */
static void predict_motion(const motion_filter *f, double *from, double span, double *to,
                           double *turned) {
  const motion before = motion_parts(f, from);
  motion after = motion_parts(f, to);
  move_mean(f, &before, span, &after, turned);
  move_root(f, before.root, span, turned, after.root);
}

/* Estimate after samples of one time: their numbers, and their values one after the other.
 * found: innovation (m), slope (m, states), both normalized, and gain (states, m). Returns m, or
 * -1 where the estimate would not be finite. */
static int update_motion(const motion_filter *f, int count, const int32_t *numbers,
                         const double *values, double *from, double *to, double *found) {
  const motion_sensor *sensors = f->sensors;
  const motion before = motion_parts(f, from);
  motion after = motion_parts(f, to);
  const int s = f->states, most = f->values, wide = padded(s), apart = padded(most + s);
  double *slope = f->work, *seen = slope + most * wide, *factor = seen + most * wide;
  double *v = factor + most * apart, *gain = v + apart, *residual = gain + s * most;
  double *deviation = residual + most, *innovation = deviation + most;
  double *change = innovation + most, *last = change + s, *white = f->work + f->spare;
  int m = 0, linear = 1;
  memset(change, 0, sizeof(double) * s);
  correct(f, &before, change, &after);
  for (int iteration = 0; iteration < MOST_ITERATIONS; iteration++) {
    const double *row = values;
    m = 0;
    for (int k = 0; k < count; k++) {
      const motion_sensor *sensor = sensors + numbers[k];
      m += see(f, sensor, row, &after, wide, residual + m, slope + m * wide, deviation + m);
      row += sensor->width;
      linear &= sensor->kind == ENCODER;
    }
    memset(seen, 0, sizeof(double) * m * wide);
    memset(factor, 0, sizeof(double) * m * apart);
    for (int i = 0; i < m; i++) {
      double *own = seen + i * wide;
      innovation[i] = residual[i];
      for (int k = 0; k < s; k++) {
        const double entry = slope[i * wide + k], *root = before.root + k * s;
        if (entry == 0) continue;
        innovation[i] += entry * change[k];
        for (int l = 0; l < s; l++) own[l] += entry * root[l];
      }
      factor[i * apart + i] = deviation[i];
      memcpy(factor + i * apart + m, own, sizeof(double) * s);
    }
    lower_triangle(m, apart, factor, v);
    for (int j = 0; j < m; j++)
      if (factor[j * apart + j] < 0)
        for (int i = j; i < m; i++) factor[i * apart + j] *= -1;
    solve_lower(m, apart, factor, 1, innovation);
    memcpy(white, seen, sizeof(double) * m * wide);
    solve_lower(m, apart, factor, wide, white);
    memcpy(last, change, sizeof(double) * s);
    for (int i = 0; i < s; i++) {
      const double *root = before.root + i * s;
      double sum = 0;
      for (int k = 0; k < m; k++) {
        gain[i * m + k] = dot(s, root, white + k * wide);
        sum += gain[i * m + k] * innovation[k];
      }
      change[i] = sum;
      if (!isfinite(sum)) return -1;
    }
    correct(f, &before, change, &after);
    int far = 0;
    for (int i = 0; i < LEVELS * f->own; i++)
      far |= fabs(change[i] - last[i]) > NEAR[i / f->own];
    if (linear || !far) break;
  }
  solve_lower(m, apart, factor, wide, slope);
  for (int i = 0; i < m; i++) {
    found[i] = innovation[i];
    memcpy(found + m + i * s, slope + i * wide, sizeof(double) * s);
    factor[i * apart + i] += deviation[i];
  }
  memcpy(found + m + m * s, gain, sizeof(double) * s * m);
  solve_lower(m, apart, factor, wide, seen);
  memcpy(after.root, before.root, sizeof(double) * s * s);
  for (int i = 0; i < s; i++)
    for (int k = 0; k < m; k++) {
      const double share = gain[i * m + k], *row = seen + k * wide;
      for (int l = 0; l < s; l++) after.root[i * s + l] -= share * row[l];
    }
  return m;
}

#endif
