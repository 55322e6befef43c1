/* Lags of strips from sample to sample, with their slopes for the weights they depend on.
 *
 * begin and step are compiled functions of a network (`hidden_equations.py`); this walks a block
 * of samples through them. What is carried from one sample to the next is one row of numbers:
 *
 *     [z, dz/dw, w_e, dw_e/dw, semichords a second],   slopes column by column,
 *
 * for the coded numbers w. Nothing is allocated or repaired. Python's twin is `lag_memory.py`.
 */
#include <stdint.h>
#include <string.h>

typedef void (*function)(const double *const *, double *const *);

typedef struct {
  int32_t measured;   /* of x */
  int32_t states;     /* z */
  int32_t remembered; /* weights that z depends on */
  int32_t strips;
  function begin;     /* x, coded, constants -> carried */
  function step;      /* x, coded, constants, length, carried -> carried */
  const double *coded;
  const double *constants;
  const double *reach;   /* remembered: d coded / d weights */
  const double *weights; /* remembered: that hold over the block */
  double *carried;       /* two rows: of the sample before, and of the next */
} recollection;

/* Where the five parts of what is carried lie. */
static void parts_of(const recollection *r, double *row, double *part[5]) {
  const int sizes[4] = {r->states, r->states * r->remembered, r->strips, r->strips * r->remembered};
  part[0] = row;
  for (int k = 0; k < 4; k++) part[k + 1] = part[k] + sizes[k];
}

/* Rows [z, vec S, W] of `count` samples, S = dz/dW; anew: whether memory begins with a sample,
 * steps: from the one before [s]. What is carried stands first afterwards. */
void recall_block(recollection *r, int64_t count, const double *x, const int8_t *anew,
                  const double *steps, double *rows) {
  const int n = r->states, m = r->remembered, size = (n + r->strips) * (1 + m) + r->strips;
  double *before[5], *after[5];
  for (int64_t k = 0; k < count; k++, x += r->measured, rows += n * (1 + m) + m) {
    parts_of(r, r->carried, before);
    parts_of(r, r->carried + size, after);
    if (anew[k]) {
      r->begin((const double *[]){x, r->coded, r->constants}, after);
    } else {
      r->step((const double *[]){x, r->coded, r->constants, steps + k, before[0], before[1],
                                 before[2], before[3], before[4]},
              after);
    }
    memcpy(r->carried, r->carried + size, sizeof(double) * size);
    memcpy(rows, before[0], sizeof(double) * n);
    for (int i = 0; i < n; i++)
      for (int j = 0; j < m; j++) rows[n + i * m + j] = before[1][j * n + i] * r->reach[j];
    memcpy(rows + n * (1 + m), r->weights, sizeof(double) * m);
  }
}
