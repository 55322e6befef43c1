/* Lags of strips from sample to sample, with their slopes for the weights they depend on.
 *
 * begin and step are compiled functions of a network (`hidden_equations.py`); this walks a block
 * of samples through them. What is carried from one sample to the next is one row of numbers:
 *
 *     [z, dz/dw, w_e, dw_e/dw, semichords a second],   slopes column by column,
 *
 * for the coded numbers w. Nothing is allocated or repaired. Python's twin is `lag_memory.py`.
 */
#include <math.h>
#include <stdint.h>
#include <string.h>

enum { BAD_INPUT = 4, LATE = 5, DUPLICATE = 6 }; /* as errors.Outcome */
#define LONGEST_STEP 0.01 /* as live_memory.py */
#define USUAL_STEPS 3.0
#define SHARE 0.01

typedef void (*function)(const double *const *, double *const *);

typedef struct {
  int32_t measured;   /* of x */
  int32_t states;     /* z */
  int32_t remembered; /* weights that z depends on */
  int32_t strips;
  function begin;     /* x, coded, constants -> carried */
  function step;      /* x, coded, constants, length, carried -> carried */
  double *coded;
  const double *constants;
  const double *reach;   /* remembered: d coded / d weights */
  double *weights;       /* remembered: that hold over the block */
  double *carried;       /* two rows: of the sample before, and of the next */
} recollection;

/* Where the five parts of what is carried lie. */
static void parts_of(const recollection *r, double *row, double *part[5]) {
  const int sizes[4] = {r->states, r->states * r->remembered, r->strips, r->strips * r->remembered};
  part[0] = row;
  for (int k = 0; k < 4; k++) part[k + 1] = part[k] + sizes[k];
}

static int size_of(const recollection *r) {
  return (r->states + r->strips) * (1 + r->remembered) + r->strips;
}

/* The next sample from the one before: what is carried behind what was carried, and its row
 * [z, vec S, W], S = dz/dW. */
static void recall_one(const recollection *r, int anew, const double *x, const double *step,
                       double *row) {
  const int n = r->states, m = r->remembered;
  double *before[5], *after[5];
  parts_of(r, r->carried, before);
  parts_of(r, r->carried + size_of(r), after);
  if (anew) {
    r->begin((const double *[]){x, r->coded, r->constants}, after);
  } else {
    r->step((const double *[]){x, r->coded, r->constants, step, before[0], before[1], before[2],
                               before[3], before[4]},
            after);
  }
  memcpy(row, after[0], sizeof(double) * n);
  for (int i = 0; i < n; i++)
    for (int j = 0; j < m; j++) row[n + i * m + j] = after[1][j * n + i] * r->reach[j];
  memcpy(row + n * (1 + m), r->weights, sizeof(double) * m);
}

/* Rows of `count` samples; anew: whether memory begins with a sample, steps: from the one before
 * [s]. What is carried stands first afterwards. */
void recall_block(recollection *r, int64_t count, const double *x, const int8_t *anew,
                  const double *steps, double *rows) {
  const int length = r->states * (1 + r->remembered) + r->remembered;
  for (int64_t k = 0; k < count; k++, x += r->measured, rows += length) {
    recall_one(r, anew[k], x, steps + k, rows);
    memcpy(r->carried, r->carried + size_of(r), sizeof(double) * size_of(r));
  }
}

/* Memory of samples that come one by one, as `live_memory.py` has it. */
typedef struct {
  recollection lags;   /* its weights and coded numbers are written here */
  int32_t own;         /* coded numbers */
  const double *prior; /* own: coded = prior + reach W */
  const double *reach; /* own */
  const double *mean;  /* W of the filter */
  double *x;           /* of the filter: measured, then what is recalled */
  double *clock;       /* last stamp, usual step, the next stamp */
  int64_t *counts;     /* whether there is a memory; how often it began anew */
} live_lags;

static int follows(const live_lags *g) {
  const double step = g->clock[2] - g->clock[0], usual = g->clock[1];
  const double longest = isnan(usual) ? INFINITY : fmax(LONGEST_STEP, USUAL_STEPS * usual);
  return g->counts[0] && step > 0 && step <= longest;
}

/* The rest of the input of the next sample. */
void recall_live(live_lags *g, double stamp) {
  const recollection *r = &g->lags;
  const double step = stamp - g->clock[0];
  g->clock[2] = stamp;
  for (int k = 0; k < g->own; k++) r->coded[k] = g->prior[k] + g->reach[k] * g->mean[k];
  memcpy(r->weights, g->mean, sizeof(double) * r->remembered);
  recall_one(r, !follows(g), g->x, &step, g->x + r->measured);
}

/* The filter is done with that sample: the memory moves on, along its slopes. */
void settle_live(live_lags *g, int outcome) {
  const recollection *r = &g->lags;
  const int length = r->states * (1 + r->remembered) + r->remembered;
  const double step = g->clock[2] - g->clock[0], usual = g->clock[1];
  double sum = 0, *part[5];
  for (int k = 0; k < length; k++) sum += g->x[r->measured + k] - g->x[r->measured + k];
  if (sum != 0 || outcome == BAD_INPUT || outcome == LATE || outcome == DUPLICATE) return;
  if (g->counts[0]) {
    g->counts[1] += !follows(g);
    if (step > 0)
      g->clock[1] = isnan(usual) ? step : usual + SHARE * (fmin(step, USUAL_STEPS * usual) - usual);
  }
  g->clock[0] = g->clock[2];
  g->counts[0] = 1;
  memcpy(r->carried, r->carried + size_of(r), sizeof(double) * size_of(r));
  parts_of(r, r->carried, part);
  for (int j = 0; j < r->remembered; j++) {
    const double change = (g->mean[j] - r->weights[j]) * r->reach[j];
    for (int i = 0; i < r->states; i++) part[0][i] += part[1][j * r->states + i] * change;
    for (int i = 0; i < r->strips; i++) part[2][i] += part[3][j * r->strips + i] * change;
  }
}
