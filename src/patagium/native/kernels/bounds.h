/* What a sensor can say: bounds of inputs and outputs, ahead of a filter. Memory is the caller's;
 * Python's twin, equation by equation and array by array, is `bounds.py`, which reads the numbers
 * defined here.
 */
#ifndef PATAGIUM_BOUNDS_H
#define PATAGIUM_BOUNDS_H

#include <math.h>
#include <stdint.h>

#include "bounds_struct.h"
#include "screening_struct.h"

#define KNOWN 20          /* values of a channel that moves before its range is known, */
#define MANY 100          /* before its median step is, */
#define BOUNDLESS 1e9     /* and scales that a value has at most until then */
#define INPUT_REACH 3.0   /* widths of the range that an input may lie outside of it, */
#define OUTPUT_REACH 10.0 /* and an output */
#define LEAST_SHARE 0.01  /* width of an output, at least, over the widest, both scaled */
#define JUMP 15.0         /* median steps that an input may move, */
#define JUMP_SHARE 0.25   /* or widths, */
#define AHEAD 2.0         /* and median steps for each usual step of time in between */
#define GAP 20.0          /* usual steps of time after which an input may have moved anywhere */
#define SMOOTH 5.0        /* median steps that an input moves at most in a usual step of time, smoothly */
#define GROWTH 0.25       /* widths by which one value widens a range */
#define LEAK 1e-4         /* of a range that a sample forgets */
#define ODD 1e4           /* widths beyond which a range never opens */
#define ODD_RUN 100       /* values refused, less those taken, after which it does */
#define FAST 0.5          /* share by which a value moves the median step before it is known, */
#define SLOW 0.02         /* and at last */
#define STANDS 5.0        /* samples, and rests of late twice, that an input stands before it is stuck */
#define REST_STEPS 3.0    /* median steps by which a rest ends */
#define STEPS 10.0        /* samples over which the usual time step is found, steps it counts at most */

enum { IN_RANGE, OUTSIDE, JUMPED };

/* As fmax and fmin of two numbers, without their calls. */
static double larger(double a, double b) { return a > b ? a : b; }
static double smaller(double a, double b) { return a < b ? a : b; }

static double width_of(const bounds *b, int k) {
  return isnan(b->low[k]) ? 0 : b->high[k] - b->low[k];
}

/* Whether inputs are compared with the last ones taken. After a gap they are not; a jump is refused
 * for as many samples as the inputs went on smoothly before it. */
static int compares(const bounds *b, double ahead) {
  const double missed = b->clock[2];
  return ahead <= missed + GAP && missed < larger(GAP, smaller(b->track[0], ODD_RUN));
}

static int judged(const bounds *b, int k, double value, double width, double ahead) {
  if (b->taken[k] < KNOWN) return fabs(value) <= BOUNDLESS * b->scale[k] ? IN_RANGE : OUTSIDE;
  const double reach = (k < b->inputs ? INPUT_REACH : OUTPUT_REACH) * width;
  if (!(b->low[k] - value <= reach && value - b->high[k] <= reach)) return OUTSIDE;
  if (k >= b->smooth || b->taken[k] < MANY || !compares(b, ahead)) return IN_RANGE;
  const double most = larger(JUMP_SHARE * width, JUMP * b->step[k]);
  const double far = b->track[1] > 0 ? SMOOTH * b->step[k] * ahead
                                     : most + AHEAD * b->step[k] * (ahead - 1);
  return fabs(value - b->before[k]) > far ? JUMPED : IN_RANGE;
}

static void take(const bounds *b, int k, double value, double width) {
  const int known = b->taken[k] >= KNOWN;
  const double low = b->low[k], high = b->high[k], moved = fabs(value - b->before[k]);
  const double most = known ? GROWTH * width : INFINITY;
  const double rate = !known ? FAST : SLOW * larger(MANY / (double)b->taken[k], 1);
  b->high[k] = value > high ? smaller(value, high + most) : high - LEAK * (high - low);
  b->low[k] = value < low ? larger(value, low - most) : low + LEAK * (high - low);
  if (isnan(low)) b->low[k] = b->high[k] = value;
  if (moved > 0) {
    const double step = b->step[k];
    b->taken[k]++;
    b->step[k] = step > 0 ? step + step * (moved > step ? rate : -rate) : moved;
  }
  b->before[k] = value;
  b->odd_run[k] -= b->odd_run[k] > 0;
}

static void refuse(screening *s, int k, double value, double width, int why) {
  const bounds *b = s->bounds;
  if (!isfinite(value)) return;
  s->counts[why == JUMPED ? JUMPS : OUT_OF_RANGE]++;
  const double beyond = fmax(b->low[k] - value, value - b->high[k]);
  if (!(b->taken[k] >= KNOWN && beyond <= ODD * width)) {
    b->odd_run[k] = 0;
  } else if (value != b->odd[k]) {
    const int more = b->odd_run[k] > 0;
    b->odd_low[k] = more ? fmin(value, b->odd_low[k]) : value;
    b->odd_high[k] = more ? fmax(value, b->odd_high[k]) : value;
    b->odd[k] = value;
    b->odd_run[k]++;
  }
  if (b->odd_run[k] < ODD_RUN) return;
  b->low[k] = fmin(b->low[k], b->odd_low[k]);
  b->high[k] = fmax(b->high[k], b->odd_high[k]);
  b->before[k] = value;
  b->odd_run[k] = 0;
  s->counts[REOPENED]++;
}

/* Whether a coordinate and its velocity rest: they stand, and the velocity is zero. */
static int rests(const bounds *b, int64_t k) {
  const int64_t n = b->dof, first = b->coordinates, v = k < first ? k + n : k, q = v - n;
  return n && v >= first && v < first + n && b->x[v] == 0 && b->before[v] == 0 &&
         b->x[q] == b->before[q];
}

/* Whether an input stands longer than at rest while another moves; a rest that ended is kept. */
static int stuck_input(const bounds *b, int k, int others) {
  const double moved = fabs(b->x[k] - b->before[k]);
  if (moved == 0) b->stood[k] += others;
  if (moved > 0 && moved <= REST_STEPS * b->step[k])
    b->rest[k] = larger(b->rest[k], (double)b->stood[k]);
  b->rest[k] *= 1.0 - LEAK;
  if (moved > 0 || rests(b, k)) b->stood[k] = 0;
  const double over = (double)b->stood[k] - 2.0 * b->rest[k] - STANDS;
  return b->taken[k] >= MANY && over > 0 && over <= ODD_RUN;
}

/* Usual steps since the last sample that was taken; infinite where none can be told. */
static double ahead_of(const bounds *b, double step) {
  if (!isfinite(step)) return 1 + b->clock[2];
  return step > 0 && b->clock[1] > 0 ? fmax(step / b->clock[1], 1) : INFINITY;
}

/* Usual step of time after one more; the median steps of the channels grow and shrink with it. */
static void keep_step(const bounds *b, double step, int channels) {
  const double usual = b->clock[1];
  b->clock[1] = usual > 0 ? usual + (fmin(step, STEPS * usual) - usual) / STEPS : step;
  for (int k = 0; usual > 0 && k < channels; k++) b->step[k] *= b->clock[1] / usual;
}

/* Whether the inputs can be learned from; outputs that are refused become NaN. */
static int bound(screening *s, double *measured) {
  const bounds *b = s->bounds;
  const int n = (int)b->inputs;
  const double stamp = s->numbers[0], step = stamp - b->clock[0], ahead = ahead_of(b, step);
  double widths[n + s->channels], widest = 0;
  int odd = 0, stuck = 0, others = 0;
  for (int k = 0; k < b->smooth; k++) others |= fabs(b->x[k] - b->before[k]) > 0;
  for (int k = 0; k < b->smooth; k++) stuck += stuck_input(b, k, others);
  s->counts[STUCK] += stuck;
  int along = b->track[1] > 0 && compares(b, ahead), fell = 0;
  for (int k = 0; k < b->smooth; k++) along &= fabs(b->x[k] - b->seen[k]) <= SMOOTH * b->step[k];
  for (int k = 0; k < n; k++) b->seen[k] = b->x[k];
  for (int k = 0; k < n; k++) {
    widths[k] = larger(width_of(b, k), b->scale[k]);
    odd += judged(b, k, b->x[k], widths[k], ahead) != IN_RANGE;
  }
  if (odd || stuck || along) {
    for (int k = 0; k < n; k++) {
      const int why = judged(b, k, b->x[k], widths[k], ahead);
      if (why != IN_RANGE) refuse(s, k, b->x[k], widths[k], why);
      fell |= why == JUMPED;
    }
    if (along && !odd) s->counts[JUMPS]++;
    if (fell) b->track[1] = 1;
    b->clock[2]++;
    s->counts[BAD_INPUTS]++;
    return 0;
  }
  const int jumped = b->track[1] > 0, believed = jumped && !compares(b, ahead);
  int smooth = !jumped;
  for (int k = 0; k < b->smooth; k++) {
    const double moved = fabs(b->x[k] - b->before[k]);
    smooth &= !(moved > SMOOTH * b->step[k] * ahead) && (double)b->stood[k] <= STANDS;
    if (believed && moved > JUMP * b->step[k]) b->step[k] = moved / JUMP;
  }
  b->track[0] = smooth ? b->track[0] + 1 : 0;
  if (isfinite(step) && step > 0) keep_step(b, step, n + s->channels);
  b->clock[0] = stamp;
  b->clock[2] = b->track[1] = 0;
  for (int k = 0; k < n; k++) take(b, k, b->x[k], widths[k]);
  for (int k = n; k < n + s->channels; k++)
    widest = larger(widest, (widths[k] = width_of(b, k)) / b->scale[k]);
  for (int k = 0; k < s->channels; k++) {
    const double width = larger(widths[n + k], LEAST_SHARE * widest * b->scale[n + k]);
    if (judged(b, n + k, measured[k], width, ahead) == IN_RANGE) {
      take(b, n + k, measured[k], width);
    } else {
      refuse(s, n + k, measured[k], width, OUTSIDE);
      measured[k] = NAN;
    }
  }
  return 1;
}

#endif
