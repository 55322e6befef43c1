/* A sample on its way into a filter: what of it is believed, and how much.
 *
 * Channels that are no numbers or stand still are left out; one that lies too far off has its
 * noise raised until it lies just that far off; innovations that grew raise an alarm. Memory is
 * the caller's; Python's twin, equation by equation and array by array, is `screening.py`.
 */
#ifndef PATAGIUM_SCREENING_H
#define PATAGIUM_SCREENING_H

#include <math.h>
#include <stdint.h>

enum { COMPLETED = 0, NOT_FINITE = 1, COVARIANCE_LOST = 2 };          /* as errors.Outcome */
enum { BAD_INPUT = 4, LATE = 5, DUPLICATE = 6, BLIND = 7 };
enum { MISSING, OUTLIERS, STUCK, BAD_INPUTS, BEHIND, DUPLICATES, RESETS, BLINDS, REFUSED, CHANGES };
enum { OUT_OF_RANGE = CHANGES + 1, JUMPS, REOPENED }; /* events as well */
enum { STAMP, LAST_STAMP, LATE_STAMP, RECENT, BEFORE };               /* of `numbers` */
enum { LATE_RUN, FILLED, PLACE, ALARM, LEARNED };                     /* of `whole` */

#define CLOCK_RUN 10      /* late samples in a row, each later than the one before: a new clock */
#define FAR 1e6           /* deviations beyond which an innovation tells nothing, but in a row of */
#define FAR_RUN 10        /* samples: the weights are wrong then, and not the sensor */
#define LARGEST_NIS 1e6   /* a channel, as the monitor of changes takes it */

#include "bounds.h"
#include "misfit.h"

/* Whether the sample is later than the one before; an event otherwise. */
static int admit(screening *s) {
  const double stamp = s->numbers[STAMP];
  if (isnan(stamp)) return COMPLETED;
  if (isfinite(stamp) && stamp > s->numbers[LAST_STAMP]) {
    s->numbers[LAST_STAMP] = stamp;
    s->whole[LATE_RUN] = 0;
    return COMPLETED;
  }
  if (stamp == s->numbers[LAST_STAMP]) {
    s->counts[DUPLICATES]++;
    return DUPLICATE;
  }
  s->whole[LATE_RUN] = s->whole[LATE_RUN] && stamp > s->numbers[LATE_STAMP] ? s->whole[LATE_RUN] + 1 : 1;
  s->numbers[LATE_STAMP] = stamp;
  if (isfinite(stamp) && s->whole[LATE_RUN] == CLOCK_RUN) {
    s->numbers[LAST_STAMP] = stamp;
    s->whole[LATE_RUN] = 0;
    s->counts[RESETS]++;
    return COMPLETED;
  }
  s->counts[BEHIND]++;
  return LATE;
}

/* Variance of each channel at this sample; readout: rows of m numbers. */
static void find_noise(screening *s, int rows, const double *readout) {
  if (s->floor == 0) return;
  const int m = s->channels;
  for (int k = 0; k < m; k++) s->load[k] = 0;
  for (int r = 0; r < rows; r++)
    for (int k = 0; k < m; k++) s->load[k] += readout[r * m + k] * readout[r * m + k];
  assume(s);
}

/* Whether a channel that moved before repeats one value. */
static int stands(screening *s, int k, double y) {
  if (y == s->last[k]) return ++s->still[k] >= s->stuck_samples && s->moved[k];
  if (!isnan(s->last[k])) s->moved[k] = 1;
  s->still[k] = 1;
  s->last[k] = y;
  return 0;
}

/* Innovation of every channel, what is left out and what is doubted; how many are left. */
static int weigh(screening *s, const double *measured, const double *predicted,
                 const double *covariance, double *innovation) {
  const int m = s->channels;
  int kept = 0;
  for (int k = 0; k < m; k++) {
    const double variance = covariance[k * m + k], y = measured[k];
    s->extra[k] = innovation[k] = 0;
    s->left_out[k] = 1;
    if (!isfinite(y)) {
      s->counts[MISSING]++;
      continue;
    }
    if (s->stuck_samples && stands(s, k, y)) {
      s->counts[STUCK]++;
      continue;
    }
    const double apart = y - predicted[k], reach = fabs(apart) / sqrt(variance);
    if (reach > s->limit) {
      s->counts[OUTLIERS]++;
      if (!(reach < FAR) && ++s->far[k] < FAR_RUN) continue;
      s->extra[k] = apart / s->limit * (apart / s->limit) - variance;
    }
    s->left_out[k] = 0;
    s->far[k] = 0;
    innovation[k] = apart;
    kept++;
  }
  if (!kept) s->counts[BLINDS]++;
  return kept;
}

/* Channels that are left out see no weight; others have their extra noise. matrix: of y without
 * what the weights add, or with it; rows of stride. */
static void leave_out(const screening *s, int stride, double *matrix) {
  const int m = s->channels;
  for (int k = 0; k < m; k++) {
    matrix[k * stride + k] += s->extra[k];
    if (!s->left_out[k]) continue;
    for (int l = 0; l < m; l++) matrix[k * stride + l] = matrix[l * stride + k] = 0;
    matrix[k * stride + k] = 1;
  }
}

/* Whether innovations grew, see `ChangeMonitor`; the test then starts anew. */
static void watch(screening *s, double nis, int kept) {
  if (!s->window) return;
  const int64_t size = s->window + s->reference, place = s->whole[PLACE];
  const double value = fmin(nis / kept, LARGEST_NIS), oldest = s->past[place];
  s->past[place] = value;
  s->numbers[RECENT] += value;
  if (s->whole[FILLED] >= s->window) {
    const double moved = s->past[(place + size - s->window) % size];
    s->numbers[RECENT] -= moved;
    s->numbers[BEFORE] += moved;
  }
  s->whole[PLACE] = (place + 1) % size;
  if (s->whole[FILLED] >= size) s->numbers[BEFORE] -= oldest;
  else if (++s->whole[FILLED] < size) return;
  const double before = fmax(s->numbers[BEFORE] / (double)s->reference, 1);
  if (s->numbers[RECENT] / s->window <= s->ratio * before) return;
  s->numbers[RECENT] = s->numbers[BEFORE] = 0;
  s->whole[FILLED] = s->whole[PLACE] = 0;
  s->whole[ALARM] = 1;
  s->counts[CHANGES]++;
}

/* Whether a network was given numbers. */
static int are_numbers(int count, const double *x) {
  double sum = 0;
  for (int k = 0; k < count; k++) sum += x[k] - x[k];
  return sum == 0;
}

#endif
