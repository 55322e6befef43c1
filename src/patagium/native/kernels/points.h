/* A perceptron at a mean of its weights and at points around it.
 *
 * S is lower triangular: column i leaves the weights before i alone. Layers before the one
 * weight i belongs to are at the mean, that layer is linear in the step along the column,
 * only the layers behind it are evaluated anew. WIDTH columns at a time, both sides.
 */
#ifndef PATAGIUM_POINTS_H
#define PATAGIUM_POINTS_H

#include "cubature.h"

static void activate(int activation, int count, REAL *z) {
  if (activation == TANH)
    for (int k = 0; k < count; k++)
      reals_store(z + k * WIDTH, reals_tanh(reals_load(z + k * WIDTH)));
  else
    for (int k = 0; k < count; k++)
      reals_store(z + k * WIDTH, reals_softplus(reals_load(z + k * WIDTH)));
}

/* Numbers a layer at the mean takes: items x widest, in whole vectors. */
static int layer_size(const panel_filter *f) {
  return (f->items * widest_of(&f->base) + WIDTH - 1) / WIDTH * WIDTH;
}

/* What layer l sums at the mean, (items, widths[l + 1]). */
static REAL *sums_of(const panel_filter *f, int l) { return f->at_mean + 2 * l * layer_size(f); }

/* What layer l takes in at the mean, (items, widths[l]). */
static REAL *inputs_of(const panel_filter *f, int l) {
  return f->at_mean + (2 * l + 1) * layer_size(f);
}

/* What a neuron sums, `count` items at once: none waits for the sum of another. */
static inline __attribute__((always_inline)) void sum_items(
    int count, int in, int out, const REAL *w, REAL bias, const REAL *x, REAL *z) {
  REAL sum[8];
  for (int t = 0; t < count; t++) sum[t] = bias;
  for (int j = 0; j < in; j++)
    for (int t = 0; t < count; t++) sum[t] += w[j] * x[t * in + j];
  for (int t = 0; t < count; t++) z[t * out] = sum[t];
}

/* All layers at the mean, in the order of operations of the points. */
static void run_at_mean(panel_filter *f) {
  for (int j = 0; j < f->weights; j++) f->near[j] = R(f->mean[j]);
  const REAL *w = f->near;
  REAL *x = inputs_of(f, 0);
  const double *features = f->features;
  const int features_count = f->items * f->widths[0];
  for (int k = 0; k < features_count; k++) x[k] = R(features[k]);
  for (int l = 0; l < f->layers; l++) {
    const int in = f->widths[l], out = f->widths[l + 1], count = f->items * out;
    REAL *z = sums_of(f, l);
    for (int o = 0; o < out; o++) {
      const REAL *row = w + o * in, bias = w[out * in + o];
      int t = 0;
      for (; t + 8 <= f->items; t += 8) sum_items(8, in, out, row, bias, x + t * in, z + t * out + o);
      for (; t < f->items; t++) sum_items(1, in, out, row, bias, x + t * in, z + t * out + o);
    }
    w += out * (in + 1);
    if (l + 1 == f->layers) break;
    x = inputs_of(f, l + 1);
    memcpy(x, z, sizeof(REAL) * count);
    activate(f->activation, (count + WIDTH - 1) / WIDTH, x);
  }
}

/* The layer the columns belong to: linear in the step, `count` items at once.
 * s: column of row 0; at: first row of the layer; start: first row that is stored. */
static inline __attribute__((always_inline)) void own_layer_of(
    int count, const REAL *s, int at, int start, reals spread, int in, int out, const REAL *x,
    const REAL *z, REAL *above) {
  for (int o = 0; o < out; o++) {
    const int row = at + o * in, bias = at + out * in + o;
    reals slope[4];
    for (int t = 0; t < count; t++)
      slope[t] = bias < start ? (reals){0} : reals_load(s + bias * PANEL);
    for (int j = row < start ? start - row : 0; j < in; j++) {
      reals step = reals_load(s + (row + j) * PANEL);
      for (int t = 0; t < count; t++) slope[t] += x[t * in + j] * step;
    }
    for (int t = 0; t < count; t++) {
      reals_store(above + (t * out + o) * PANEL, z[t * out + o] + spread * slope[t]);
      reals_store(above + (t * out + o) * PANEL + WIDTH, z[t * out + o] - spread * slope[t]);
    }
  }
}

/* A layer behind it, `count` items at once, so that each weight is moved once; where it is of
 * another block its weights stay. */
static inline __attribute__((always_inline)) void later_layer_of(
    int count, int moves, const REAL *w, const REAL *s, reals spread, int in, int out, const REAL *below,
    REAL *above) {
  for (int o = 0; o < out; o++) {
    reals plus[4], minus[4];
    reals step = moves ? spread * reals_load(s + (out * in + o) * PANEL) : (reals){0};
    for (int t = 0; t < count; t++) {
      plus[t] = w[out * in + o] + step;
      minus[t] = w[out * in + o] - step;
    }
    for (int j = 0; j < in; j++) {
      reals move = moves ? spread * reals_load(s + (o * in + j) * PANEL) : (reals){0};
      reals up = w[o * in + j] + move, down = w[o * in + j] - move;
      for (int t = 0; t < count; t++) {
        const REAL *x = below + (t * in + j) * PANEL;
        plus[t] += up * reals_load(x);
        minus[t] += down * reals_load(x + WIDTH);
      }
    }
    for (int t = 0; t < count; t++) {
      reals_store(above + (t * out + o) * PANEL, plus[t]);
      reals_store(above + (t * out + o) * PANEL + WIDTH, minus[t]);
    }
  }
}

static void own_layer(const panel_filter *f, int l, const REAL *s, int at, int start, reals spread,
                      REAL *above) {
  const int in = f->widths[l], out = f->widths[l + 1];
  const REAL *x = inputs_of(f, l), *z = sums_of(f, l);
  int t = 0;
  for (; t + 4 <= f->items; t += 4)
    own_layer_of(4, s, at, start, spread, in, out, x + t * in, z + t * out,
                 above + t * out * PANEL);
  for (; t < f->items; t++)
    own_layer_of(1, s, at, start, spread, in, out, x + t * in, z + t * out,
                 above + t * out * PANEL);
}

static inline __attribute__((always_inline)) void later_layer(
    const panel_filter *f, int moves, int l, const REAL *w, const REAL *s, reals spread,
    const REAL *below, REAL *above) {
  const int in = f->widths[l], out = f->widths[l + 1];
  int t = 0;
  for (; t + 4 <= f->items; t += 4)
    later_layer_of(4, moves, w, s, spread, in, out, below + t * in * PANEL,
                   above + t * out * PANEL);
  for (; t < f->items; t++)
    later_layer_of(1, moves, w, s, spread, in, out, below + t * in * PANEL,
                   above + t * out * PANEL);
}

/* The mlp at WIDTH points on either side: columns of a block from `first` on. Returns its
 * outputs. */
static REAL *run_at_points(const panel_filter *f, int block, int first) {
  const int panel = first / PANEL, start = f->starts[block] + panel * PANEL;
  const REAL *s = panel_of(f, block, panel) + first % PANEL;
  const reals spread = reals_all(R(f->spread * f->growth));
  REAL *here = f->points, *there = here + f->items * widest_of(&f->base) * PANEL;
  int l = 0, at = 0, before = 0;
  for (int b = 0; b < block; b++) before += f->counts[b];
  const int shift = f->starts[block] - before, end = before + f->counts[block];
  while (at + f->widths[l + 1] * (f->widths[l] + 1) <= before + first)
    at += f->widths[l + 1] * (f->widths[l] + 1), l++;
  own_layer(f, l, s, at + shift, start, spread, here);
  for (int next = l + 1; next < f->layers; next++) {
    at += f->widths[next] * (f->widths[next - 1] + 1);
    activate(f->activation, f->items * f->widths[next] * 2, here);
    if (at < end)
      later_layer(f, 1, next, f->near + at, s + (ptrdiff_t)(at + shift) * PANEL, spread, here,
                  there);
    else
      later_layer(f, 0, next, f->near + at, s, spread, here, there);
    REAL *swap = here;
    here = there;
    there = swap;
  }
  return here;
}

#endif
