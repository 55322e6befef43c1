/* From sensor packets to what a learner predicted of them, one after the other.
 *
 * A packet is [time, q, v, a, forces], q of as many numbers as there are coordinates, v and a of
 * dof numbers each, the forces u1 and those known beside it. Inverse dynamics makes x and y of it,
 * memory the rest of x where there is one, the filter predicts y and learns it. The record of a
 * packet says how that went:
 *
 *     [prediction, its deviation, measurement: outputs each; nis, outcome, left out, nanoseconds].
 *
 * Deviations hold the noise of the measurement; a prediction is NaN where none was made. Left
 * out is a number whose bit k stands for channel k. The time is that of the call, writing the
 * record left aside. Nothing is allocated, nothing repaired.
 */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <time.h>

#include "pipeline_struct.h"

enum { COMPLETED = 0, BAD_INPUT = 4, LATE = 5, DUPLICATE = 6 }; /* as errors.Outcome */

static double now_ns(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int learn(pipeline *p, const double *packet) {
  const double *v = packet + 1 + p->coordinates;
  const double *arguments[5] = {packet + 1, v, v + p->dof, v + 2 * p->dof, p->parameters};
  double *results[2] = {p->x, p->y};
  p->air_force(arguments, results);
  *p->stamp = packet[0];
  if (!p->recall) return p->update(p->memory);
  p->recall(p->lags, packet[0]);
  const int outcome = p->update(p->memory);
  p->settle(p->lags, outcome);
  return outcome;
}

static void write_record(const pipeline *p, int outcome, double *record) {
  const int m = p->outputs;
  const int predicted = outcome != BAD_INPUT && outcome != LATE && outcome != DUPLICATE;
  double left_out = 0;
  for (int k = 0; k < m; k++) {
    record[k] = predicted ? p->mean[k] : NAN;
    record[m + k] = predicted ? sqrt(p->covariance[k * m + k]) : NAN;
    if (outcome == COMPLETED && p->left_out[k]) left_out += ldexp(1, k);
  }
  memcpy(record + 2 * m, p->y, sizeof(double) * m);
  record[3 * m] = outcome == COMPLETED ? *p->nis : NAN;
  record[3 * m + 1] = outcome;
  record[3 * m + 2] = left_out;
}

/* Takes packets, rows of so many columns; writes records, rows of 3 outputs + 4. How many
 * were taken: fewer than there are where an alarm was raised, by the last one taken. */
int64_t pipeline_run(pipeline *p, int64_t count, const double *packets, double *records) {
  for (int64_t k = 0; k < count; k++, packets += p->columns, records += 3 * p->outputs + 4) {
    const double started = now_ns();
    const int outcome = learn(p, packets);
    const double ended = now_ns();
    write_record(p, outcome, records);
    records[3 * p->outputs + 3] = ended - started;
    if (*p->alarm) return k + 1;
  }
  return count;
}
