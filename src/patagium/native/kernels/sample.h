/* One sample through a weight filter, whatever its covariance structure.
 *
 * A structure gives five functions over its own memory, which begins with a `weight_filter`; the
 * course of a sample, its screening and its counts stand here once. The returned integers are
 * Outcomes, and whatever is not COMPLETED leaves mean and covariance as they were.
 */
#ifndef PATAGIUM_SAMPLE_H
#define PATAGIUM_SAMPLE_H

#include <math.h>

#include "screening.h"
#include "small.h"
#include "weight_filter_struct.h"

typedef struct {
  int (*predict)(void *);  /* moments of y, in `predicted` and `covariance`; slopes; an Outcome */
  int (*in_range)(void *); /* whether what the sample makes of the root stays a number */
  void (*screen)(void *);  /* slopes and moments without the channels left out */
  /* g with g g' = P_yy^-1, turned its transpose, (stride, stride); 0: not positive definite */
  int (*invert)(void *, double *g, double *turned);
  void (*learn)(void *, const double *gain, const double *g); /* gain: P_yy^-1 (y - mean) */
} structure;

/* Whether the moments of y are numbers. */
static int predicted(const weight_filter *f) {
  double sum = 0;
  for (int k = 0; k < f->outputs * f->outputs; k++) sum += f->covariance[k];
  for (int k = 0; k < f->outputs; k++) sum += f->predicted[k];
  return isfinite(sum) ? COMPLETED : NOT_FINITE;
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
  const int lost = s->predict(memory);
  if (lost) return lost == NOT_FINITE ? unpredicted(f) : lost;
  if (!s->in_range(memory)) return NOT_FINITE;
  const int kept = weigh(f->screen, f->measured, f->predicted, f->covariance, f->innovation);
  if (!kept) return BLIND;
  s->screen(memory);
  if (!s->invert(memory, g, turned)) return COVARIANCE_LOST;
  combine(m, stride, f->innovation, g, inner);
  combine(m, stride, inner, turned, gain);
  for (int k = 0; k < m; k++) nis += inner[k] * inner[k];
  if (!isfinite(nis)) return NOT_FINITE;
  f->nis = nis;
  learn_noise(f->screen, f->measured, gain, stride, g);
  watch(f->screen, nis, kept);
  s->learn(memory, gain, g);
  return COMPLETED;
}

#endif
