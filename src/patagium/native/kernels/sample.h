/* One sample through a weight filter, whatever its covariance structure.
 *
 * A structure gives five functions over its own memory, which begins with a `weight_filter`; the
 * course of a sample, its screening and its counts stand here once. The returned integers are
 * Outcomes, and whatever is not COMPLETED leaves mean and covariance as they were.
 */
#ifndef PATAGIUM_SAMPLE_H
#define PATAGIUM_SAMPLE_H

#include <math.h>
#include <string.h>

#include "screening.h"
#include "small.h"
#include "weight_filter_struct.h"

static int widest_of(const weight_filter *f) {
  int widest = 0;
  for (int l = 0; l <= f->layers; l++)
    if (f->widths[l] > widest) widest = f->widths[l];
  return widest;
}

typedef struct {
  int (*predict)(void *);  /* moments of y, in `predicted` and `covariance`; slopes; an Outcome */
  int (*in_range)(void *); /* whether what the sample makes of the root stays a number */
  void (*screen)(void *);  /* slopes and moments without the channels left out */
  /* g with g g' = P_yy^-1, turned its transpose, (stride, stride); 0: not positive definite */
  int (*invert)(void *, double *g, double *turned);
  void (*learn)(void *, const double *gain, const double *g); /* gain: P_yy^-1 (y - mean) */
} structure;

/* Features and readout of this sample, and the noise of its channels. */
static void encode(const weight_filter *f) {
  if (f->encode) f->encode(f->encode_arguments, f->encode_results);
  find_noise(f->screen, f->items * f->widths[f->layers], f->readout);
}

/* Largest standard deviation of an output. */
static double largest_deviation(const weight_filter *f) {
  double largest = 0;
  for (int k = 0; k < f->outputs; k++)
    largest = fmax(largest, f->covariance[k * f->outputs + k]);
  return sqrt(largest);
}

/* Whether the moments of y are numbers. */
static int predicted(const weight_filter *f) {
  double sum = 0;
  for (int k = 0; k < f->outputs * f->outputs; k++) sum += f->covariance[k];
  for (int k = 0; k < f->outputs; k++) sum += f->predicted[k];
  return isfinite(sum) ? COMPLETED : NOT_FINITE;
}

/* Normalized innovation squared by the stated variances; g g' = P_yy^-1. */
static double stated_nis(const weight_filter *f, const double *g) {
  const int m = f->outputs, stride = f->stride;
  double scaled[stride], inner[stride], nis = 0;
  memset(scaled, 0, sizeof scaled);
  for (int k = 0; k < m; k++)
    if (!f->screen->left_out[k])
      scaled[k] = (f->innovation[k] - f->screen->carried[k]) *
                  sqrt(f->covariance[k * m + k] / f->screen->interval[k]);
  combine(m, stride, scaled, g, inner);
  for (int k = 0; k < m; k++) nis += inner[k] * inner[k];
  return nis;
}

/* Covariance of y as the filter states it, in the place of that which it assumes. */
static void state(const weight_filter *f) {
  const int m = f->outputs;
  double scale[m];
  if (f->screen->floor == 0) return;
  for (int k = 0; k < m; k++) scale[k] = sqrt(f->screen->interval[k] / f->covariance[k * m + k]);
  for (int k = 0; k < m; k++)
    for (int l = 0; l < m; l++) f->covariance[k * m + l] *= scale[k] * scale[l];
}

/* Moments with what of the last error is still there, as the filter states them. */
static void state_carried(const weight_filter *f) {
  for (int k = 0; k < f->outputs && f->screen->floor != 0; k++)
    f->predicted[k] += f->screen->carried[k];
  state(f);
}

/* Moments that the weights alone give, as the filter states them. */
static int stated(const weight_filter *f, int outcome) {
  if (outcome != COMPLETED) return outcome;
  state_interval(f->screen, f->covariance, 0);
  state(f);
  return COMPLETED;
}

/* Why there is no prediction. */
static int unpredicted(const weight_filter *f) {
  const int features = f->items * f->widths[0], rows = f->items * f->widths[f->layers];
  if (are_numbers(features, f->features) && are_numbers(rows * f->outputs, f->readout))
    return NOT_FINITE;
  f->screen->counts[BAD_INPUTS]++;
  return BAD_INPUT;
}

/* Learn one sample; memory: of the structure, beginning with f. */
static int learn_sample(weight_filter *f, void *memory, const structure *s) {
  const int m = f->outputs, stride = f->stride, size = stride * stride;
  double *g = f->small + 2 * size, *turned = g + size, inner[stride], gain[stride], nis = 0;
  const int refused = admit(f->screen);
  if (refused) return refused;
  if (!bound(f->screen, f->measured)) return BAD_INPUT;
  follow(f->screen, f->measured);
  const int lost = s->predict(memory);
  if (lost) return lost == NOT_FINITE ? unpredicted(f) : lost;
  if (!s->in_range(memory)) return NOT_FINITE;
  state_interval(f->screen, f->covariance, 1);
  const int kept = weigh(f->screen, f->measured, f->predicted, f->covariance, f->innovation);
  if (!kept) {
    state_carried(f);
    return BLIND;
  }
  s->screen(memory);
  if (!s->invert(memory, g, turned)) return COVARIANCE_LOST;
  combine(m, stride, f->innovation, g, inner);
  combine(m, stride, inner, turned, gain);
  for (int k = 0; k < m; k++) nis += inner[k] * inner[k];
  if (!isfinite(nis)) return NOT_FINITE;
  f->nis = f->screen->floor == 0 ? nis : stated_nis(f, g);
  learn_noise(f->screen, f->measured, gain, stride, g);
  learn_misfit(f->screen, f->covariance, f->innovation, gain);
  watch(f->screen, f->nis, kept);
  for (int k = 0; f->pull > 0 && k < f->weights; k++)
    f->mean[k] += f->pull * (f->prior[k] - f->mean[k]);
  s->learn(memory, gain, g);
  state_carried(f);
  return COMPLETED;
}

#endif
