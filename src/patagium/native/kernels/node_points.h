/* A perceptron at a mean of its weights, and at points that move one neuron each.
 *
 * A column of a neuron's square root moves what the neuron sums, z, by s'[x; 1] and nothing
 * else before it; WIDTH neurons of a layer move at once, each in a lane of its own, through
 * the layers behind. Where nothing but linear layers follow, y moves along one direction.
 */
#ifndef PATAGIUM_NODE_POINTS_H
#define PATAGIUM_NODE_POINTS_H

#include "node.h"

static inline reals activation_of(int activation, reals z) {
  return activation == TANH ? reals_tanh(z) : reals_softplus(z);
}

/* Numbers of one item of a layer at the mean, in whole vectors. */
static int padded_of(const node_filter *f) {
  return (widest_of(&f->base) + WIDTH - 1) / WIDTH * WIDTH;
}

/* What layer l sums at the mean, (items, padded); what it takes in. */
static REAL *sums_of(const node_filter *f, int l) {
  return f->at_mean + (ptrdiff_t)2 * l * f->items * padded_of(f);
}

static REAL *inputs_of(const node_filter *f, int l) {
  return f->at_mean + ((ptrdiff_t)2 * l + 1) * f->items * padded_of(f);
}

/* All layers at the mean. */
static void run_at_mean(const node_filter *f) {
  const int padded = padded_of(f), in = f->widths[0];
  for (int t = 0; t < f->items; t++)
    for (int j = 0; j < in; j++) inputs_of(f, 0)[t * padded + j] = R(f->features[t * in + j]);
  for (group g = {0}; next_group(f, &g);) {
    const REAL *w = f->near + g.rows * WIDTH;
    const int hidden = g.layer + 1 < f->layers;
    for (int t = 0; t < f->items; t++) {
      const REAL *x = inputs_of(f, g.layer) + t * padded;
      reals even = row_load(w, g.size - 1), odd = {0};
      int j = 0;
      for (; j + 2 < g.size; j += 2) {
        even += x[j] * row_load(w, j);
        odd += x[j + 1] * row_load(w, j + 1);
      }
      if (j + 1 < g.size) even += x[j] * row_load(w, j);
      even += odd;
      reals_store(sums_of(f, g.layer) + t * padded + g.first, even);
      if (hidden)
        reals_store(inputs_of(f, g.layer + 1) + t * padded + g.first,
                    activation_of(f->activation, even));
    }
  }
}

/* steps <- sum over a band's rows j of S_ji x_j, columns i of the band; x of one item. */
static inline __attribute__((always_inline)) void band_steps(
    int rows, int columns, const REAL *s, const REAL *x, int items, REAL *steps) {
  for (int i = 0; i < columns; i++) {
    reals sum = row_load(steps, (ptrdiff_t)i * items);
    for (int r = 0; r < rows; r++) sum += x[r] * row_load(s, (ptrdiff_t)i * rows + r);
    row_store(steps, (ptrdiff_t)i * items, sum);
  }
}

/* How far each column moves z of its neuron, one standard deviation, each item. */
static void find_steps(const node_filter *f, const group *g, const REAL *s, REAL *steps) {
  const int k = g->size, padded = padded_of(f), full = k / BAND;
  memset(steps, 0, sizeof(REAL) * WIDTH * k * f->items);
  for (int t = 0; t < f->items; t++) {
    const REAL *below = inputs_of(f, g->layer) + t * padded;
    REAL x[k + BAND];
    for (int j = 0; j + 1 < k; j++) x[j] = below[j];
    x[k - 1] = R(1);
    for (int b = 0; b < full; b++)
      band_steps(BAND, BAND * (b + 1), s + band_start(b) * WIDTH, x + BAND * b, f->items,
                 steps + t * WIDTH);
    const REAL *tail = s + band_start(full) * WIDTH;
    if (k % BAND == 1) band_steps(1, k, tail, x + k - 1, f->items, steps + t * WIDTH);
    if (k % BAND == 2) band_steps(2, k, tail, x + k - 2, f->items, steps + t * WIDTH);
    if (k % BAND == 3) band_steps(3, k, tail, x + k - 3, f->items, steps + t * WIDTH);
  }
}

/* What y does with a unit of the output of neuron o of one of the last two layers. */
static void find_direction(const node_filter *f, int layer, int o, int t, double *y) {
  const int last = f->widths[f->layers], m = f->outputs, in = f->widths[f->layers - 1];
  const double *readout = f->readout + (ptrdiff_t)t * last * m;
  const double *w = f->mean + f->weights - last * (in + 1);
  for (int k = 0; k < f->stride; k++) y[k] = 0;
  if (layer + 1 == f->layers)
    for (int k = 0; k < m; k++) y[k] = readout[o * m + k];
  else
    for (int q = 0; q < last; q++)
      for (int k = 0; k < m; k++) y[k] += w[q * in + o] * readout[q * m + k];
}

/* Directions of y in lanes, (terms, n_y), for groups whose slopes have more than one rank. */
static void find_towards(const node_filter *f, const group *g) {
  const int m = f->outputs, terms = terms_of(f, g);
  if (!is_late(f, g)) {
    for (int k = 0; k < terms * m; k++) row_store(f->towards, k, reals_all(R(f->readout[k])));
    return;
  }
  double y[f->stride];
  memset(f->towards, 0, sizeof(REAL) * WIDTH * terms * m);
  for (int t = 0; t < terms; t++)
    for (int c = 0; c < g->count; c++) {
      find_direction(f, g->layer, g->first + c, t, y);
      for (int k = 0; k < m; k++) f->towards[((ptrdiff_t)t * m + k) * WIDTH + c] = R(y[k]);
    }
}

/* Change of a neuron's output when z moves by step: none of it is rounded away by z. */
static inline reals change_of(const node_filter *f, const group *g, int t, reals step) {
  if (g->layer + 1 == f->layers) return step;
  const int padded = padded_of(f);
  reals z = reals_load(sums_of(f, g->layer) + t * padded + g->first);
  reals u = reals_load(inputs_of(f, g->layer + 1) + t * padded + g->first);
  return activation_of(f->activation, z + step) - u;
}

/* Outputs of the mlp, as changes from the mean, when each lane's neuron changes by `change`
 * (items); gives them as (terms). room: 2 x widest vectors. */
static void run_on(const node_filter *f, const group *g, const REAL *change, REAL *room,
                   REAL *terms) {
  const int padded = padded_of(f), last = f->widths[f->layers];
  if (is_late(f, g)) {
    memcpy(terms, change, sizeof(REAL) * WIDTH * f->items);
    return;
  }
  for (int t = 0; t < f->items; t++) {
    REAL *below = room, *above = room + (ptrdiff_t)widest_of(&f->base) * WIDTH;
    const REAL *w = f->plain + g->at + f->widths[g->layer + 1] * g->size;
    for (int l = g->layer + 1; l < f->layers; l++) {
      const int in = f->widths[l], out = f->widths[l + 1], first = l == g->layer + 1;
      for (int o = 0; o < out; o++) {
        reals sum = {0};
        if (first) /* lanes beyond the group have other weights and no change */
          sum = reals_load(w + o * in + g->first) * row_load(change, t);
        else
          for (int j = 0; j < in; j++) sum += w[o * in + j] * row_load(below, j);
        if (l + 1 < f->layers) {
          const REAL z = sums_of(f, l)[t * padded + o], u = inputs_of(f, l + 1)[t * padded + o];
          sum = activation_of(f->activation, z + sum) - u;
        }
        row_store(l + 1 < f->layers ? above : terms, l + 1 < f->layers ? o : t * last + o, sum);
      }
      w += out * (in + 1);
      REAL *swap = below;
      below = above;
      above = swap;
    }
  }
}

#endif
