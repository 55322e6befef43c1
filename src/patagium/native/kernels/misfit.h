/* Error of the model, found from the data: the noise that a filter assumes, what of the last
 * error is still there, and the interval that the filter states. Python's twin, equation by equation and array by array, is `misfit.py`.
 */
#ifndef PATAGIUM_MISFIT_H
#define PATAGIUM_MISFIT_H

#include <math.h>
#include <stdint.h>

#include "screening_struct.h"

#define STEP 10.0       /* samples over which the mean step is found, steps it counts at most */
#define FIRST 10        /* samples after which one value no longer changes a mean by much */
#define WILD 100        /* times its mean that a square counts at most */
#define UNSEEN 3.0      /* samples in a span of correlation, before they are known */
#define MOST 1e3        /* samples in a span of correlation, at most */
#define STILL 1e-6      /* variance of a channel that does not move, over the largest */
#define LEAST 1e-12     /* variance, at least, over the largest of a channel */
#define SLIGHT 1e-7     /* and over the one it would have if forces of strips did not cancel; */
#define COARSE 1e-3     /* this share of it, but at most, */
#define MUCH 1e5        /* over the mean square of what samples leave */
#define START 0.02      /* of the variance of a channel: what is left, to begin with */
#define LEFT 3.0        /* variance over the mean square of what a sample leaves */
#define LONG 100.0      /* spans over which what is left is averaged, */
#define SHORT 5.0       /* and innovations, over the last fifth of all samples at most */
#define MIDDLE 20.0     /* and the correlation of errors from sample to sample */
#define QUANTILE 3.8415 /* of chi-square that holds 95 %, */
#define OUTSIDE 0.05    /* the share that it does not hold, */
#define TURN 0.3       /* and the step of the logarithm of the width at each miss */
#define STAYS 0.99      /* of an error from sample to sample, at most: none outlives a gap */
#define BEYOND 15.0     /* factor on the variance of the weights beyond the usual one */
#define REST 1e-2       /* of the usual variance of the weights, and of the measurement: rest */

static double capped(double square, double mean, int64_t count) {
  return count > FIRST && mean > 0 ? fmin(square, WILD * mean) : square;
}

/* Root of a square, with the sign of what was squared. */
static double rooted(double value, double square) { return copysign(sqrt(square), value); }

/* What of the last error is still there at this sample. */
static void advance(screening *s) {
  const double stamp = s->numbers[STAMP], step = stamp - s->clock[0];
  double ahead = 1;
  if (isfinite(step) && step > 0) {
    s->clock[1] = s->clock[1] > 0 ? s->clock[1] + (fmin(step, STEP * s->clock[1]) - s->clock[1]) / STEP : step;
    ahead = step / s->clock[1];
  }
  s->clock[0] = stamp;
  for (int k = 0; k < s->channels; k++) {
    const double rho = s->power[k] > 0 ? fmin(fmax(s->lagged[k] / s->power[k], 0), STAYS) : 0;
    s->carried[k] = s->left[k] * pow(rho, ahead);
  }
}

/* Variances of the measurements, to which their offset counts as one of them, and mean squares of
 * their changes. */
static void follow(screening *s, const double *measured) {
  if (s->floor == 0) return;
  advance(s);
  for (int k = 0; k < s->channels; k++) {
    const double y = measured[k], apart = y - s->before[k];
    if (!isfinite(y)) continue;
    const int64_t n = ++s->heard[k];
    const double own = y - s->center[k], square = capped(own * own, s->level[k], n);
    s->center[k] += rooted(own, square) / (double)(n + 1);
    s->level[k] += (square * (double)n / (double)(n + 1) - s->level[k]) / (double)n;
    if (n == 1) s->residual[k] = START * s->level[k];
    else s->change[k] += (capped(apart * apart, s->change[k], n) - s->change[k]) / (double)(n - 1);
    s->before[k] = y;
  }
}

/* Square of what the network scales an output by: unlike units are compared in it. */
static double unit_of(const screening *s, int k) {
  const double scale = s->bounds->scale[s->bounds->inputs + k];
  return scale * scale;
}

/* Samples in a span of correlation: deviation of the measurements over the rms of their changes. */
static double span_of(const screening *s, double largest) {
  double sum = 0;
  int count = 0;
  for (int k = 0; k < s->channels; k++) {
    if (!(s->level[k] / unit_of(s, k) > STILL * largest) || !(s->change[k] > 0)) continue;
    sum += log(s->level[k] / s->change[k]) / 2;
    count++;
  }
  return count ? fmin(fmax(exp(sum / count), 1), MOST) : UNSEEN;
}

/* Least variance of each channel's noise, as if forces of strips did not cancel; square: mean
 * squares of the measurements. */
static void find_least(const screening *s, const double *square, double *least) {
  for (int k = 0; k < s->channels; k++) least[k] = 0;
  for (int i = 0; i < s->strips; i++) {
    double force = 0;
    for (int j = 0; j < s->channels; j++) force = fmax(force, s->told[j * s->strips + i] * square[j]);
    for (int k = 0; k < s->channels; k++) least[k] += s->spread[k * s->strips + i] * force;
  }
  for (int k = 0; k < s->channels; k++)
    least[k] = fmax(SLIGHT * least[k], fmin(COARSE * least[k], MUCH * s->residual[k]));
}

/* Variances that the filter assumes; load: of the channels, where nothing was measured yet. */
static void assume(screening *s) {
  double largest = 0; /* mean square of a scaled channel */
  for (int k = 0; k < s->channels; k++) largest = fmax(largest, s->level[k] / unit_of(s, k));
  find_least(s, s->level, s->noise);
  s->span = span_of(s, largest);
  s->least = LEAST * largest;
  for (int k = 0; k < s->channels; k++) {
    const double load = LEAST * (s->load[k] > 0 ? s->load[k] : 1);
    const double own = largest > 0 ? s->least * unit_of(s, k) : load;
    const double least = fmax(own, s->noise[k]);
    const double left = fmin(LEFT * s->residual[k], s->level[k]);
    const double misfit = fmax(s->floor * s->floor * s->level[k], left);
    s->noise[k] = s->steady[k] + s->stated[k] + fmax(s->span * misfit, least);
  }
}

/* Mean square of the errors of late, at the noise that came with this sample. */
static double expected(const screening *s, const double *error, int k) {
  return fmax(error[k] - s->sampled[k], 0) + s->stated[k];
}

/* Variance that the filter states; covariance: of y, noise included; carried: whether what the
 * last sample left is part of the prediction. */
static void state_interval(screening *s, const double *covariance, int carried) {
  const double *recent = carried ? s->recent : s->alone;
  if (s->floor == 0) return;
  for (int k = 0; k < s->channels; k++) {
    const double all = covariance[k * s->channels + k], weights = all - s->noise[k];
    const double beyond = BEYOND * fmax(weights - s->usual[k], 0);
    const double stated = (expected(s, recent, k) + beyond) * (carried ? exp(2 * s->width[k]) : 1);
    s->interval[k] = stated > 0 ? fmax(stated, s->least * unit_of(s, k)) : all;
  }
}

/* Whether the output that varies most is at rest, which says nothing of the flow of late. */
static int at_rest(const screening *s, const double *covariance) {
  int top = 0;
  for (int k = 1; k < s->channels; k++)
    if (s->level[k] / unit_of(s, k) > s->level[top] / unit_of(s, top)) top = k;
  const double weights = covariance[top * s->channels + top] - s->noise[top];
  return weights < REST * s->usual[top] && s->before[top] * s->before[top] < REST * s->level[top];
}

/* After a sample; gain: P_yy^-1 e. */
static void learn_misfit(screening *s, const double *covariance, const double *innovation,
                         const double *gain) {
  if (s->floor == 0) return;
  const double count = (double)s->whole[LEARNED];
  const double slow = fmax(1 / (count + FIRST), 1 / (LONG * s->span));
  const double middle = fmax(1 / (count + FIRST), 1 / (MIDDLE * s->span));
  const double late = fmax(SHORT / (count + SHORT - 1), 1 / (SHORT * s->span));
  const double fast = at_rest(s, covariance) ? 0 : late;
  for (int k = 0; k < s->channels; k++) {
    const double left = s->noise[k] * gain[k], before = s->left[k];
    const double remains = capped(left * left, s->residual[k], s->whole[LEARNED]);
    const double e = innovation[k] - s->carried[k];
    const double square = capped(innovation[k] * innovation[k], s->alone[k], s->whole[LEARNED]);
    s->left[k] = s->left_out[k] || s->extra[k] > 0 ? s->carried[k] : rooted(left, remains);
    if (s->left_out[k]) continue;
    const double weights = covariance[k * s->channels + k] - s->noise[k];
    s->lagged[k] += middle * (rooted(innovation[k], square) * before - s->lagged[k]);
    s->power[k] += middle * (before * before - s->power[k]);
    const int missed = e * e > QUANTILE * s->interval[k];
    if (missed || s->interval[k] > s->least * unit_of(s, k)) s->width[k] += TURN * (missed - OUTSIDE);
    s->residual[k] += slow * (remains - s->residual[k]);
    s->recent[k] += fast * (capped(e * e, s->recent[k], s->whole[LEARNED]) - s->recent[k]);
    s->alone[k] += fast * (square - s->alone[k]);
    s->sampled[k] += fast * (s->stated[k] - s->sampled[k]);
    s->usual[k] = s->usual[k] > 0 && weights > 0 ? s->usual[k] * pow(weights / s->usual[k], fast)
                                                 : fmax(weights, 0);
  }
}

#endif
