/* A sample on its way into a filter: what of it is believed, and how much.
 *
 * Channels that are no numbers or stand still are left out; one that lies too far off has its
 * noise raised until it lies just that far off; the variance of the measurement is estimated
 * from what the innovations leave of it; innovations that grew raise an alarm. Memory is the
 * caller's; Python's twin, equation by equation and array by array, is `screening.py`.
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
#define FIRST_MEMORY 9    /* samples over which the first variance is estimated, less one */
#define LARGEST_NIS 1e6   /* a channel, as the monitor of changes takes it */
#define FIRST_SAMPLES 20  /* whose noise is a share of the scale; it is estimated from then on */
#define LEAST_NOISE 1e-6  /* variance that is found, at least, over the square of the scale */
#define LEAST_SCALE 1e-2  /* square of a scale, at least, over the network's own */

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

/* Noise of a channel begun as a share of a squared scale; without any scale, 1 takes its place. */
static void start_noise(screening *s, int k, double scale) {
  const double own = scale > 0 ? scale : 1;
  s->largest[k] = own;
  s->residual[k] = s->relative * s->relative * own;
  s->steady[k] = s->loaded[k] = s->residual[k] / 2;
}

/* Scale of a channel after a measurement. The noise is a share of that of the first samples, and
 * grows as the scale does. */
static void follow_scale(screening *s, int k, double y) {
  const double n = (double)++s->seen[k], apart = y - s->offset[k];
  s->scale[k] += (apart * apart - s->scale[k]) / n;
  const double scale = fmax(s->scale[k], LEAST_SCALE * s->load[k]);
  const double growth = scale / s->largest[k];
  s->smallest[k] = LEAST_NOISE * (scale > 0 ? scale : s->largest[k]) / 2;
  if (n <= FIRST_SAMPLES) start_noise(s, k, scale);
  else if (growth > 1) {
    s->largest[k] = scale;
    s->steady[k] *= growth;
    s->loaded[k] *= growth;
  }
}

/* Variance of each channel at this sample; readout: rows of m numbers. */
static void find_noise(screening *s, int rows, const double *readout) {
  if (s->share == 0 && s->floor == 0) return;
  const int m = s->channels;
  int measured = 0; /* whether y has a scale of its own */
  for (int k = 0; k < m && s->floor != 0; k++) measured |= s->level[k] > 0;
  for (int k = 0; k < m && !measured; k++) s->load[k] = 0;
  for (int r = 0; r < rows && !measured; r++)
    for (int k = 0; k < m; k++) s->load[k] += readout[r * m + k] * readout[r * m + k];
  if (s->floor != 0) {
    assume(s);
    return;
  }
  for (int k = 0; k < m; k++) {
    if (s->relative > 0 && !s->seen[k]) start_noise(s, k, s->load[k]);
    const double relative = s->mean_load[k] > 0 ? s->load[k] / s->mean_load[k] : 1;
    s->noise[k] = s->steady[k] + s->loaded[k] * relative + s->stated[k];
  }
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

/* The variances after a sample: expectation of the noise given the sample, a share of it.
 * measured: y; gain: P_yy^-1 e; inverse: G with G G' = P_yy^-1, rows of stride. */
static void learn_noise(screening *s, const double *measured, const double *gain, int stride,
                        const double *inverse) {
  s->whole[LEARNED]++;
  if (s->share == 0) return;
  const int m = s->channels;
  const double fresh = fmax(s->share, 1.0 / (double)s->whole[LEARNED]);
  const double share = fmax(s->share, 1.0 / (double)(s->whole[LEARNED] + FIRST_MEMORY));
  double least[m];
  for (int k = 0; k < m; k++)
    if (s->relative > 0 && !s->left_out[k] && s->extra[k] == 0) follow_scale(s, k, measured[k]);
  find_least(s, s->scale, least);
  for (int k = 0; k < m; k++) {
    const double relative = s->mean_load[k] > 0 ? s->load[k] / s->mean_load[k] : 1;
    const int early = s->relative > 0 && s->extra[k] == 0 && s->seen[k] <= FIRST_SAMPLES;
    const double smallest = fmax(s->smallest[k], least[k] / 2), left = s->noise[k] * gain[k];
    s->mean_load[k] += fresh * (s->load[k] - s->mean_load[k]);
    double square = 0;
    for (int l = 0; l < m; l++) square += inverse[k * stride + l] * inverse[k * stride + l];
    const double raised = (s->noise[k] + s->extra[k]) / s->noise[k];
    const double larger = fmax(s->steady[k], s->loaded[k] * relative);
    const double own = s->noise[k] - s->stated[k];
    const double rate = s->left_out[k] || early ? 0 : share;
    const double move = rate * raised * own / larger * (gain[k] * gain[k] - square);
    s->residual[k] += rate * (left * left - s->residual[k]);
    s->steady[k] = fmax(s->steady[k] + s->steady[k] * s->steady[k] * move, smallest);
    s->loaded[k] = fmax(s->loaded[k] + s->loaded[k] * s->loaded[k] * relative * move, smallest);
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
