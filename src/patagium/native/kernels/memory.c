/* Lag states of a network from sample to sample, which depend on none of its weights.
 *
 * begin and step are compiled functions of a network; this walks a block of samples through them.
 * What is carried from one sample to the next is one row of numbers, [z, driver]. Nothing is
 * allocated or repaired. Python's twin is `memory.py`, field by field.
 */
#include <math.h>
#include <stdint.h>
#include <string.h>

enum { BAD_INPUT = 4, LATE = 5, DUPLICATE = 6 }; /* as errors.Outcome */
#define LONGEST_STEP 0.01 /* as memory.py */
#define USUAL_STEPS 3.0
#define SHARE 0.01

typedef void (*function)(const double *const *, double *const *);

typedef struct {
  int32_t measured;   /* of x */
  int32_t states;     /* z that the network reads, the first ones */
  int32_t all;        /* z */
  int32_t driver;     /* numbers of the sample that the next step starts from */
  function begin;     /* x, constants -> carried */
  function step;      /* x, constants, time step, carried -> carried */
  const double *constants;
  double *carried;    /* two rows: of the sample before, and of the next */
  /* of samples that come one by one, as `ModelMemory` has them */
  double *x;          /* of the filter: measured, then z */
  double *clock;      /* last stamp, usual step, the next stamp */
  int64_t *counts;    /* whether there is a memory; how often it began anew */
} lags;

static int carried_size(const lags *g) { return g->all + g->driver; }

/* The next sample from the one before: the second row of carried from the first, and z. */
static void advance(const lags *g, int anew, const double *x, const double *step, double *row) {
  double *before = g->carried, *after = g->carried + carried_size(g);
  double *const found[] = {after, after + g->all};
  if (anew) g->begin((const double *[]){x, g->constants}, found);
  else g->step((const double *[]){x, g->constants, step, before, before + g->all}, found);
  memcpy(row, after, sizeof(double) * g->states);
}

/* Rows of `count` samples; anew: whether memory begins with a sample, steps: from the one before
 * [s]. What is carried stands in the first row afterwards. */
void memory_block(lags *g, int64_t count, const double *x, const int8_t *anew,
                  const double *steps, double *rows) {
  for (int64_t k = 0; k < count; k++, x += g->measured, rows += g->states) {
    advance(g, anew[k], x, steps + k, rows);
    memcpy(g->carried, g->carried + carried_size(g), sizeof(double) * carried_size(g));
  }
}

static int follows(const lags *g) {
  const double step = g->clock[2] - g->clock[0], usual = g->clock[1];
  const double longest = isnan(usual) ? INFINITY : fmax(LONGEST_STEP, USUAL_STEPS * usual);
  return g->counts[0] && step > 0 && step <= longest;
}

/* The rest of the input of the next sample. */
void memory_next(lags *g, double stamp) {
  const double step = stamp - g->clock[0];
  g->clock[2] = stamp;
  advance(g, !follows(g), g->x, &step, g->x + g->measured);
}

/* The filter is done with that sample: the memory goes on. */
void memory_settle(lags *g, int outcome) {
  const double step = g->clock[2] - g->clock[0], usual = g->clock[1];
  double sum = 0;
  for (int k = 0; k < g->states; k++) sum += g->x[g->measured + k] - g->x[g->measured + k];
  if (sum != 0 || outcome == BAD_INPUT || outcome == LATE || outcome == DUPLICATE) return;
  if (g->counts[0]) {
    g->counts[1] += !follows(g);
    if (step > 0)
      g->clock[1] = isnan(usual) ? step : usual + SHARE * (fmin(step, USUAL_STEPS * usual) - usual);
  }
  g->clock[0] = g->clock[2];
  g->counts[0] = 1;
  memcpy(g->carried, g->carried + carried_size(g), sizeof(double) * carried_size(g));
}
