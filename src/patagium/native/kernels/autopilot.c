/* A tick of an autopilot: samples of sensors to motion, force of the air and commands.
 *
 * The parts are those of motion_tracker.py, pipeline.c, lqr.py and steered_gait.py, where their
 * equations are explained; the numbers are theirs to rounding. A row of input is
 *
 *     [time, of each sensor: stamp (NaN: no sample), values; forces of the packet],
 *
 * and a record [q, v, a; record of the pipeline; commands; whether commanded now; nanoseconds].
 * Records are NaN where there is none. Nothing is allocated. A sample that cannot be weighed, or
 * is later than now, is left out and counted; a motion that is not finite holds the last commands,
 * and so does a tick whose time falls or jumps: it is nothing but counted.
 */
#define _POSIX_C_SOURCE 199309L
#include <time.h>

#include "autopilot_struct.h"
#include "motion.h"
#include "motion_track_struct.h"
#include "pipeline_struct.h"
#include "regulator_struct.h"

/* Tracks. */

static int64_t slot(const motion_track *t, int64_t k) { return (t->first + k) % t->capacity; }

static double *estimate(const motion_track *t, int64_t k) {
  return t->estimates + slot(t, k) * t->size;
}

/* Estimate of the k-th sample from that before it. */
static void follow(motion_track *t, int64_t k) {
  motion_filter *f = t->filter;
  const int64_t at = slot(t, k), before = slot(t, k - 1);
  const double span = t->time[at] - t->time[before];
  double *from = estimate(t, k - 1), turned[3];
  if (span > 0) {
    predict_motion(f, from, span, t->scratch, turned);
    from = t->scratch;
  }
  const int m = update_motion(f, 1, t->sensor + at, t->values + at * t->width, from,
                              estimate(t, k), t->found);
  if (m < 0) {
    memcpy(estimate(t, k), from, sizeof(double) * t->size);
    t->refused++;
    return;
  }
  double nis = 0;
  for (int i = 0; i < m; i++) nis += t->found[i] * t->found[i];
  t->loud += nis > t->too_loud * m ? 1 : -1;
  if (++t->seen < t->lately) return;
  if (t->loud > 0) {
    for (int c = 0; c < f->own; c++) f->density[c] *= t->enlivened;
    t->raised++;
  }
  t->loud = t->seen = 0;
}

/* Whether a sample tells something of what a filter estimates. */
static int tells(const motion_sensor *sensor, const double *values) {
  int some = sensor->kind != ENCODER;
  for (int k = 0; k < sensor->width; k++)
    if (sensor->kind != ENCODER && !isfinite(values[k]))
      return 0;
    else if (sensor->kind == ENCODER && sensor->place[k] >= 0 && isfinite(values[k]))
      some = 1;
  return some;
}

/* One sample, at its time among those of late. */
static void push(motion_track *t, int sensor, double time, const double *values) {
  const int number = t->numbers[sensor];
  if (number < 0) return;
  const motion_sensor *own = (const motion_sensor *)((motion_filter *)t->filter)->sensors + number;
  if (!tells(own, values)) return;
  int64_t place = t->count;
  while (place > 0 && t->time[slot(t, place - 1)] > time) place--;
  if (place > 0 && t->count == t->capacity) { /* the oldest goes */
    t->first = slot(t, 1);
    t->count--;
    place--;
  }
  if (place == 0) {
    t->late++;
    return;
  }
  for (int64_t k = t->count++; k > place; k--) {
    const int64_t to = slot(t, k), from = slot(t, k - 1);
    t->time[to] = t->time[from];
    t->sensor[to] = t->sensor[from];
    memcpy(t->values + to * t->width, t->values + from * t->width, sizeof(double) * t->width);
  }
  const int64_t at = slot(t, place);
  t->time[at] = time;
  t->sensor[at] = number;
  memcpy(t->values + at * t->width, values, sizeof(double) * own->width);
  for (int64_t k = place; k < t->count; k++) follow(t, k);
  const double oldest = t->time[slot(t, t->count - 1)] - t->memory;
  while (t->count > 1 && t->time[slot(t, 1)] < oldest) {
    t->first = slot(t, 1);
    t->count--;
  }
}

/* q, v and a at a time, after all samples so far. */
static void motion_now(const autopilot *p, double time, double *out) {
  const int n = p->dof;
  double attitude[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  memset(out, 0, sizeof(double) * 3 * n);
  for (int k = 0; k < p->tracks; k++) {
    motion_track *t = (motion_track *)p->track + k;
    const motion_filter *f = t->filter;
    const motion from = motion_parts(f, estimate(t, t->count - 1));
    motion to = motion_parts(f, t->scratch);
    double turned[3];
    move_mean(f, &from, time - t->time[slot(t, t->count - 1)], &to, turned);
    for (int level = 0; level < LEVELS; level++)
      for (int c = 0; c < f->own; c++) {
        const int column = f->columns[c];
        out[level * n + column] = to.levels[level * n + column];
      }
    if (f->turn) memcpy(attitude, to.attitude, sizeof attitude);
  }
  if (!p->turn) return;
  double angles[3], spin[3], rate[3], rates[3], second[3], slope[81];
  angles[0] = atan2(attitude[7], attitude[8]);
  angles[1] = -asin(fmax(-1, fmin(1, attitude[6])));
  angles[2] = atan2(attitude[3], attitude[0]);
  for (int k = 0; k < 3; k++) {
    spin[k] = out[n + p->turn[k]];
    rate[k] = out[2 * n + p->turn[k]];
  }
  const double *arguments[] = {angles, spin, rate};
  double *results[] = {rates, second, slope};
  p->euler(arguments, results);
  for (int k = 0; k < 3; k++) {
    out[p->turn[k]] = angles[k];
    out[n + p->turn[k]] = rates[k];
    out[2 * n + p->turn[k]] = second[k];
  }
}

/* The steered gait: pieces of [time, own time, targets, slopes, c0, c1, c2]. */

static double *piece(const regulator *r, int64_t k) {
  return r->pieces + k * (2 + 5 * r->responses);
}

/* Own time, in `own`, and values and two rates of all responses, (3, responses), of a piece. */
static void respond(const regulator *r, const double *at, double time, double *own, double *out) {
  const int m = r->responses;
  const double *target = at + 2, *slope = target + m, *c0 = slope + m, *c1 = c0 + m, *c2 = c1 + m;
  const double t = time - at[0];
  for (int i = 0; i < m; i++) {
    const double k = r->sharpness[i], fading = exp(-k * t), a = c0[i], b = c1[i], c = c2[i];
    out[i] = target[i] + slope[i] * (t - 3 / k) + fading * (a + (b + c * t) * t);
    out[m + i] = slope[i] + fading * (b - k * a + (2 * c - k * b) * t - k * c * t * t);
    out[2 * m + i] = fading * (2 * c - 2 * k * b + k * k * a +
                               (k * k * b - 4 * k * c) * t + k * k * c * t * t);
    if (i) continue;
    const double whole = a / k + b / (k * k) + 2 * c / (k * k * k);
    const double left = whole + (b / k + 2 * c / (k * k)) * t + c / k * t * t;
    *own = at[1] + (target[0] + slope[0] * (t / 2 - 3 / k)) * t + whole - fading * left;
  }
}

/* Go on to other targets from a time on. */
static void append(regulator *r, double time, const double *target, const double *slope) {
  const int m = r->responses;
  double *next = piece(r, r->count), state[3 * m];
  respond(r, piece(r, r->count - 1), time, next + 1, state);
  next[0] = time;
  memcpy(next + 2, target, sizeof(double) * m);
  memcpy(next + 2 + m, slope, sizeof(double) * m);
  for (int i = 0; i < m; i++) {
    const double k = r->sharpness[i], gap = state[i] - target[i] + 3 * slope[i] / k;
    const double first = state[m + i] - slope[i] + k * gap;
    next[2 + 2 * m + i] = gap;
    next[2 + 3 * m + i] = first;
    next[2 + 4 * m + i] = (state[2 * m + i] + 2 * k * first - k * k * gap) / 2;
  }
  r->count++;
}

static const double *piece_at(const regulator *r, double time) {
  int64_t k = r->count - 1;
  while (k > 0 && piece(r, k)[0] > time) k--;
  return piece(r, k);
}

/* Targets at which every joint keeps its limits. */
static void keep_limits(regulator *r) {
  const int m = r->responses, n = r->joints;
  double *target = r->target, *amplitude = target + 1, *offset = amplitude + n;
  for (int i = 0; i < m; i++) target[i] = fmin(fmax(target[i], r->range[i]), r->range[m + i]);
  for (int k = 0; k < n; k++) {
    amplitude[k] = fmin(amplitude[k], r->largest[k]);
    const double low = r->room[k] - amplitude[k] * r->reach[k];
    const double high = r->room[n + k] - amplitude[k] * r->reach[n + k];
    offset[k] = fmin(fmax(offset[k], fmin(low, 0)), fmax(high, 0));
  }
}

/* Go to r->target from a time on, at the rates that actuators have. */
static void command(regulator *r, double time) {
  const int m = r->responses;
  double now[m], lasting[m], rate[m], aim[m], slope[m], end = 0;
  keep_limits(r);
  while (r->count > 1 && piece(r, r->count - 1)[0] > time) r->count--;
  const double *last = piece(r, r->count - 1);
  for (int i = 0; i < m; i++) {
    now[i] = last[2 + i] + last[2 + m + i] * (time - last[0]);
    const double gap = r->target[i] - now[i];
    lasting[i] = fabs(gap) / r->rates[i];
    rate[i] = lasting[i] > 0 ? copysign(r->rates[i], gap) : 0;
  }
  memmove(piece(r, 0), last, sizeof(double) * (2 + 5 * m));
  r->count = 1;
  while (isfinite(end)) {
    double next = INFINITY;
    for (int i = 0; i < m; i++) {
      const int going = lasting[i] > end;
      aim[i] = going ? now[i] + rate[i] * end : r->target[i];
      slope[i] = going ? rate[i] : 0;
      if (going) next = fmin(next, lasting[i]);
    }
    append(r, time + end, aim, slope);
    end = next;
  }
}

/* Turn horizontal vectors of a state by an angle. */
static void turn(const regulator *r, double angle, double *state) {
  const double c = cos(angle), s = sin(angle);
  for (int i = 0; i < r->vectors; i++) {
    double *x = state + r->pairs[2 * i], *y = state + r->pairs[2 * i + 1], was = *x;
    *x = c * was - s * *y;
    *y = s * was + c * *y;
  }
}

/* Departure from the orbit at the beginning of an interval; see Course.catch_up and apart. */
static void depart(regulator *r, int64_t first, const double *now, double *away) {
  const int64_t part = first % r->parts;
  const double beat = (double)(first / r->parts), *own = r->along + part * r->states;
  const int x = r->pairs[0], y = r->pairs[1], bends = r->turn != 0;
  const double radius[2] = {own[x] - r->center_x, own[y] - r->center_y};
  double along[r->states], turned;
  for (int again = 0; again <= bends; again++) {
    turned = beat * r->turn + r->lead;
    memcpy(along, own, sizeof along);
    along[x] = radius[0], along[y] = radius[1];
    turn(r, turned, along);
    along[x] += r->center_x + (bends ? 0 : beat * r->travel[0]);
    along[y] += r->center_y + (bends ? 0 : beat * r->travel[1]);
    turn(r, r->heading, along);
    along[x] += r->origin[0], along[y] += r->origin[1];
    along[r->z] += beat * r->travel[2] + r->origin[2];
    if (r->yaw >= 0) along[r->yaw] += r->heading + turned;
    for (int k = 0; k < r->states; k++)
      away[k] = r->sources[k] < 0 ? 0 : now[r->sources[k]] - along[k];
    turn(r, -r->heading - turned, away);
    if (again == bends) break;
    const double way = atan2(radius[0] * away[y] - radius[1] * away[x],
                             radius[0] * (radius[0] + away[x]) + radius[1] * (radius[1] + away[y]));
    if (isfinite(way)) r->lead += way;
  }
  if (r->yaw >= 0) away[r->yaw] = remainder(away[r->yaw], 6.283185307179586);
  const double way = away[x];
  for (int k = 0; k < r->states; k++) away[k] -= way * r->ahead[part * r->states + k];
}

/* Commands for the interval that begins now; 0 where the last ones are held. */
static int regulate(regulator *r, double time, const double *now) {
  const int nu = r->commands, m = r->responses, size = r->kept + r->lags + nu;
  const int64_t first = llround(time / r->period), part = first % r->parts;
  double whole[size], away[r->states], state[3 * m], own, next[nu];
  int at = 0;
  depart(r, first, now, away);
  for (int i = 0; i < r->kept; i++) whole[at++] = away[r->places[i]];
  respond(r, piece_at(r, time), time, &own, state);
  for (int i = 0; i < nu; i++) {
    const int k = r->answers[i];
    if (r->chains[i] == 4) whole[at++] = own - time;
    whole[at++] = state[k] - r->neutral[i];
    whole[at++] = state[m + k];
    whole[at++] = state[2 * m + k];
  }
  memcpy(whole + at, r->before, sizeof(double) * nu);
  for (int i = 0; i < nu; i++) {
    const double change = -dot(size, r->gains + (part * nu + i) * size, whole);
    if (!isfinite(change)) return 0;
    const double value = r->neutral[i] + r->before[i] + fmin(fmax(change, -r->fastest[i]), r->fastest[i]);
    next[i] = fmin(fmax(value, r->low[i]), r->high[i]) - r->neutral[i];
  }
  memcpy(r->before, next, sizeof next);
  for (int i = 0; i < nu; i++)
    for (int k = 0; k < m; k++)
      if (r->moves[i * m + k]) r->target[k] = r->neutral[i] + next[i];
  command(r, time);
  return 1;
}

static double now_ns(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

/* Whether the time of a tick neither fell nor jumped, or jumped for ten ticks that rise.
 *
 * A clock was set ahead then, or nothing is known of what was longer ago than the memory: the
 * samples so far are moved ahead, so that the last tick is a memory ago.
 */
static int counts(autopilot *p, double time) {
  const double jump = time - p->time - p->memory, most = 1e15 * ((regulator *)p->regulator)->period;
  if (!(time >= p->time)) {
    p->late++;
    return 0;
  }
  if (jump > 0) {
    p->again = p->again && time >= p->ahead ? p->again + (time > p->ahead) : 1;
    p->ahead = time;
  }
  if (!(fabs(time) < most) || (jump > 0 && p->again < 10)) {
    p->held++;
    return 0;
  }
  for (motion_track *t = p->track; jump > 0 && t < (motion_track *)p->track + p->tracks; t++)
    for (int64_t k = 0; k < t->count; k++) t->time[slot(t, k)] += jump;
  p->time = time;
  p->again = 0;
  return 1;
}

static void give(const autopilot *p, double *commanded) {
  const regulator *r = p->regulator;
  for (int i = 0; i < r->commands; i++)
    commanded[i] = (r->neutral[i] + r->before[i]) / r->scale[i];
}

static void tick(autopilot *p, const double *row, double *record) {
  const int n = p->dof;
  const double time = row[0], *sample = row + 1;
  if (!counts(p, time)) {
    for (int k = 0; k < p->record; k++) record[k] = NAN;
    give(p, record + 3 * n + p->learned);
    record[p->record - 2] = 0;
    return;
  }
  for (int k = 0; k < p->sensors; sample += p->widths[k++]) {
    motion_track *tracks = p->track;
    if (isnan(sample[0])) continue;
    if (sample[0] > time + 1e-9) tracks->refused++; /* later than now: it would end the filter */
    for (int i = 0; i < p->tracks && sample[0] <= time + 1e-9; i++)
      push(tracks + i, k, sample[0], sample + 1);
  }
  motion_now(p, time, record);
  double *learned = record + 3 * n, *commanded = learned + p->learned;
  for (int k = 0; k < p->learned; k++) learned[k] = NAN;
  if (p->run && p->ticks % p->every == 0) {
    p->packet[0] = time;
    memcpy(p->packet + 1, record, sizeof(double) * 3 * n);
    memcpy(p->packet + 1 + 3 * n, sample, sizeof(double) * p->forces);
    p->run(p->pipeline, 1, p->packet, learned);
  }
  regulator *r = p->regulator;
  double *given = commanded + r->commands;
  *given = 0;
  if (time >= r->next - 1e-9) {
    *given = regulate(r, time, record);
    r->held += *given == 0;
    r->next = (double)(llround(time / r->period) + 1) * r->period;
  }
  give(p, commanded);
  p->ticks++;
}

/* Ticks of rows; how many were taken: fewer than there are where the learner raised an alarm. */
int64_t autopilot_run(autopilot *p, int64_t count, const double *rows, double *records) {
  for (int64_t k = 0; k < count; k++, rows += p->columns, records += p->record) {
    const double started = now_ns();
    tick(p, rows, records);
    records[p->record - 1] = now_ns() - started;
    if (p->run && *((pipeline *)p->pipeline)->alarm) return k + 1;
  }
  return count;
}
