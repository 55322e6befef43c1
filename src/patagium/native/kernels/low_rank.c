/* Passes over many weights for the filter whose precision is U + F F', U diagonal, F (n, r).
 *
 * The derivative of y for a weight from neuron j to neuron o is the sum over the items of the
 * derivative of y for the sum of o times the activation of j: rows of H' are made where they
 * are needed, a few at a time, beside the rows of F. Three passes a sample: the products of
 * these rows with each other, U^-1 between them; the mlp at points along combinations of
 * them; mean, U and F after the sample. The algebra between is small and the caller's.
 * All in double; only U and F are kept in STORE. What is new is written beside what was.
 */
#include "low_rank.h"
#include "small.h"

enum { SOFTPLUS = 0, TANH = 1, CHUNK = 16 };

#define LEAST 1e-10 /* U beside the squares of a row of F, so that differences keep digits */

/* A walk over the weights of a layer: its weights row by row, then its biases. */
typedef struct {
  int layer, below, above, at; /* weights of the layer passed */
  int o, j;                    /* neuron and input of the next */
  ptrdiff_t first;             /* its first weight */
  const double *inputs, *seeds;
  int neuron[CHUNK], input[CHUNK]; /* of the rows last filled; input == below: a bias */
} walk;

static walk walk_from(const low_rank *f) {
  return (walk){.below = f->widths[0], .above = f->widths[1], .inputs = f->inputs,
                .seeds = f->seeds};
}

static int size_of(const walk *w) { return w->above * (w->below + 1); }

static void next_layer(const low_rank *f, walk *w) {
  w->inputs += f->items * w->below;
  w->seeds += f->items * w->above * f->padded;
  w->first += size_of(w);
  w->at = w->o = w->j = 0;
  w->layer++;
  if (w->layer == f->layers) return;
  w->below = w->above;
  w->above = f->widths[w->layer + 1];
}

/* Rows [F, H'] of the next weights of the layer, `depth` numbers each; gives how many. */
static int fill(const low_rank *f, walk *w, double *rows) {
  const int left = size_of(w) - w->at, count = left < CHUNK ? left : CHUNK;
  for (int r = 0; r < count; r++) {
    const int o = w->o, j = w->j;
    const STORE *columns = f->columns + (w->first + w->at + r) * f->rank;
    double *row = rows + r * f->depth;
    for (int k = 0; k < f->rank; k++) row[k] = (double)columns[k];
    for (int l = 0; l < f->padded; l += WIDE) {
      wide sum = {0};
      for (int t = 0; t < f->items; t++) {
        const double x = j < w->below ? w->inputs[t * w->below + j] : 1;
        sum += x * wide_load(w->seeds + (t * w->above + o) * f->padded + l);
      }
      wide_store(row + f->rank + l, sum); /* what is beyond n_y is zero, and the next row's */
    }
    w->neuron[r] = o, w->input[r] = j;
    if (w->j == w->below) {
      w->o++;
    } else if (++w->j == w->below) {
      w->o++;
      w->j = 0;
      if (w->o == w->above) w->o = 0, w->j = w->below; /* the biases */
    }
  }
  w->at += count;
  return count;
}

/* target <- rows turn, (CHUNK, columns) from (CHUNK, depth); rows behind the last are any. */
static void turn_rows(int depth, int columns, const double *rows, const double *turn,
                      double *target) {
  for (int first = 0; first < CHUNK; first += 8)
    for (int l = 0; l < columns; l += WIDE) {
      wide sum[8];
      for (int r = 0; r < 8; r++) sum[r] = (wide){0};
      for (int k = 0; k < depth; k++) {
        const wide column = wide_load(turn + k * columns + l);
        for (int r = 0; r < 8; r++) sum[r] += rows[(first + r) * depth + k] * column;
      }
      for (int r = 0; r < 8; r++) wide_store(target + (first + r) * columns + l, sum[r]);
    }
}

/* gram <- [F, H']' U^-1 [F, H']. */
void low_rank_products(low_rank *f) {
  const int depth = f->depth;
  double rows[(CHUNK + 1) * depth];
  memset(rows, 0, sizeof rows);
  memset(f->gram, 0, sizeof(double) * depth * depth);
  for (walk w = walk_from(f); w.layer < f->layers; next_layer(f, &w))
    while (w.at < size_of(&w)) {
      const STORE *diagonal = f->diagonal + w.first + w.at;
      const int count = fill(f, &w, rows);
      for (int r = 0; r < count; r++) {
        const double scale = 1 / sqrt((double)diagonal[r]);
        for (int k = 0; k < depth; k++) rows[r * depth + k] *= scale;
      }
      add_products(depth, count, rows, f->gram);
    }
  for (int k = 0; k < depth; k++)
    for (int l = 0; l < k; l++) f->gram[k * depth + l] = f->gram[l * depth + k];
}

/* Sums of a layer, (items, above, 2, padded), at points W +- U^-1 [F, H'] turn; below: what
 * the layer takes in, (items, below, 2, padded), NULL for the first. */
static void pass_layer(const low_rank *f, walk *w, double *rows, double *steps,
                       const double *below, double *above) {
  const int padded = f->padded, side = 2 * padded;
  memset(above, 0, sizeof(double) * f->items * w->above * side);
  while (w->at < size_of(w)) {
    const ptrdiff_t first = w->first + w->at;
    const int count = fill(f, w, rows);
    turn_rows(f->depth, padded, rows, f->turn, steps);
    for (int r = 0; r < count; r++) {
      const int o = w->neuron[r], j = w->input[r];
      const double weight = f->mean[first + r], scale = 1 / (double)f->diagonal[first + r];
      for (int l = 0; l < padded; l += WIDE) {
        const wide step = scale * wide_load(steps + r * padded + l);
        for (int t = 0; t < f->items; t++) {
          double *sum = above + (t * w->above + o) * side + l;
          wide up = (j < w->below ? w->inputs[t * w->below + j] : 1) - (wide){0}, down = up;
          if (below && j < w->below) {
            up = wide_load(below + (t * w->below + j) * side + l);
            down = wide_load(below + (t * w->below + j) * side + padded + l);
          }
          wide_store(sum, wide_load(sum) + (weight + step) * up);
          wide_store(sum + padded, wide_load(sum + padded) + (weight - step) * down);
        }
      }
    }
  }
}

/* Outputs of the mlp at the points, (items, outputs of the mlp, 2, padded), in `points`. */
void low_rank_points(low_rank *f) {
  double rows[(CHUNK + 1) * f->depth], steps[CHUNK * f->padded];
  double *here = f->points, *there = f->points + f->room;
  memset(rows, 0, sizeof rows);
  const double *below = 0;
  for (walk w = walk_from(f); w.layer < f->layers; next_layer(f, &w)) {
    const int count = f->items * w.above * 2 * f->padded;
    pass_layer(f, &w, rows, steps, below, here);
    if (w.layer + 1 == f->layers) break;
    for (int k = 0; k < count; k += WIDTH)
      reals_store(here + k, f->activation == TANH ? reals_tanh(reals_load(here + k))
                                                  : reals_softplus(reals_load(here + k)));
    below = here;
    here = there;
    there = (double *)below;
  }
  if (here != f->points)
    memcpy(f->points, here, sizeof(double) * f->items * f->widths[f->layers] * 2 * f->padded);
}

static inline double sum_of(wide x) {
  double sum = 0;
  for (int c = 0; c < WIDE; c++) sum += x[c];
  return sum;
}

/* Mean, U and F after the sample, beside what they were: W + U^-1 [F, H'] gains, the first
 * columns of [F, H'] turn, and to growth U the squares of the others. 0 where one is no number. */
int low_rank_change(low_rank *f) {
  const int depth = f->depth;
  const double most = sizeof(STORE) == 4 ? 1e76 : 1e300; /* squared, of a number that is kept */
  double rows[(CHUNK + 1) * depth], turned[CHUNK * depth], drops[depth];
  int whole = 1;
  memset(rows, 0, sizeof rows);
  for (int k = 0; k < depth; k++) drops[k] = k < f->rank ? 0 : 1;
  for (walk w = walk_from(f); w.layer < f->layers; next_layer(f, &w))
    while (w.at < size_of(&w)) {
      const ptrdiff_t first = w.first + w.at;
      const int count = fill(f, &w, rows);
      turn_rows(depth, depth, rows, f->turn, turned);
      for (int r = 0; r < count; r++) {
        const double diagonal = (double)f->diagonal[first + r];
        STORE *columns = f->next_columns + (first + r) * f->rank;
        wide step = {0}, dropped = {0}, all = {0};
        for (int k = 0; k < depth; k += WIDE) {
          const wide column = wide_load(turned + r * depth + k), square = column * column;
          step += wide_load(rows + r * depth + k) * wide_load(f->gains + k);
          dropped += wide_load(drops + k) * square;
          all += square;
        }
        for (int k = 0; k < f->rank; k++) columns[k] = (STORE)turned[r * depth + k];
        const STORE after = (STORE)fmax(f->growth * diagonal + sum_of(dropped), LEAST * sum_of(all));
        const double mean = f->mean[first + r] + sum_of(step) / diagonal;
        f->next_diagonal[first + r] = after;
        f->next_mean[first + r] = mean;
        whole &= sum_of(all) < most && isfinite(after) && isfinite(mean);
      }
    }
  return whole;
}

/* Numbers of a vector: the caller pads by it. */
int low_rank_lanes(void) { return WIDE; }
