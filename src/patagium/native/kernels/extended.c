/* One sample through the square-root extended Kalman filter of a network's weights.
 *
 * The network is y = offset + readout . mlp(features; W) and linear around the mean: H = dy/dW by
 * reverse accumulation through the mlp, Z = S' H', M = R. What a sample then does to mean and
 * root is the cubature filter's: panels.h; where something is added to the covariance between
 * samples, P is kept: covariance.h. Where the network remembers, the first weights are
 * numbers of the air: features, readout and lags depend on them, and their columns of H come
 * from derivatives along each (lags).
 */
#include "points.h"
#include "covariance.h"

#include "lags_struct.h"
#include "extended_filter_struct.h"

/* Lags and coded numbers at weights: z + S (W - W_m). */
static void place_lags(const lags *g, const double *weights, int known) {
  const double *z = g->x + g->measured, *slopes = z + g->states;
  const double *before = slopes + g->states * g->remembered;
  for (int k = 0; k < g->own; k++)
    g->coded[k] = g->prior[k] + (k < known ? g->reach[k] * weights[k] : 0);
  for (int i = 0; i < g->states; i++) {
    double sum = z[i];
    for (int k = 0; k < g->remembered; k++)
      sum += slopes[i * g->remembered + k] * (weights[k] - before[k]);
    g->state[i] = sum;
  }
}

static void encode_with_lags(const lags *g, panel_filter *f) {
  const double *arguments[4] = {g->x, g->state, g->coded, g->constants};
  double *results[2] = {f->features, f->readout};
  g->encode(arguments, results);
}

/* Features and readout at the mean; the noise of a network that remembers grows with what the
 * remembered weights alone say. */
static void encode_sample(extended_filter *e) {
  panel_filter *f = &e->filter;
  const int count = f->items * f->widths[f->layers];
  if (!e->lags) {
    if (f->encode) f->encode(f->encode_arguments, f->encode_results);
    find_noise(f->screen, count, f->readout);
    return;
  }
  const lags *g = e->lags;
  if (f->screen->share != 0 || f->screen->floor != 0) {
    place_lags(g, g->x + g->measured + g->states * (1 + g->remembered), g->remembered);
    encode_with_lags(g, f);
    find_noise(f->screen, count, f->readout);
  }
  place_lags(g, f->mean, g->own);
  encode_with_lags(g, f);
}

/* target <- sum over `count` of scale[k step] rows of a, `apart` numbers from one to the next. */
static inline void weighted_rows(int stride, int count, const double *scale, int step,
                                 const double *a, int apart, double *target) {
  for (int l = 0; l < stride; l += WIDE) {
    wide sum = {0};
    for (int k = 0; k < count; k++) sum += scale[k * step] * wide_load(a + k * apart + l);
    wide_store(target + l, sum);
  }
}

/* Row of H' of a weight: rows of a block follow each other. */
static double *row_of(const extended_filter *e, int weight) {
  const int at = e->place ? e->place[weight] : weight;
  return e->derivative + (ptrdiff_t)at * e->filter.stride;
}

/* Rows of H' of the weights of one output, from its seeds: sum over the items of x times seed.
 * ROWS weights at once, the last of them again where their number is no multiple. */
static void weight_rows(const extended_filter *e, int in, int out, const double *x,
                        const double *seed, int weight) {
  const int stride = e->filter.stride, items = e->filter.items, apart = out * stride;
  const int used = used_columns(&e->filter);
  const int some = in < ROWS || e->place != NULL;
  for (int j = 0; some && j < in; j++)
    weighted_rows(stride, items, x + j, in, seed, apart, row_of(e, weight + j));
  for (int done = 0; !some && done < in; done += ROWS) {
    const int j = done + ROWS > in ? in - ROWS : done;
    band_product(0, ROWS, used, items, x + j, 1, in, seed, apart, row_of(e, weight + j), stride);
  }
}

/* Rows of H' of the mlp's weights, layer by layer from the last; gives dy / d features. */
static const double *perceptron_slopes(extended_filter *e) {
  panel_filter *f = &e->filter;
  const int own = e->lags ? e->lags->own : 0, stride = f->stride, items = f->items;
  const int room = items * widest_of(f) * stride;
  const double *seeds = f->weighting;
  double ones[items];
  const double *w = f->mean + f->weights;
  int weight = f->weights;
  for (int t = 0; t < items; t++) ones[t] = 1;
  for (int l = f->layers - 1; l >= 0; l--) {
    const int in = f->widths[l], out = f->widths[l + 1];
    const double *x = inputs_of(f, l);
    double *below = e->seeds + l % 2 * room;
    w -= out * (in + 1);
    weight -= out * (in + 1);
    for (int o = 0; o < out; o++) {
      const double *seed = seeds + o * stride;
      weight_rows(e, in, out, x, seed, weight + o * in);
      weighted_rows(stride, items, ones, 1, seed, out * stride, row_of(e, weight + out * in + o));
    }
    if (l == 0 && !own) break;
    for (int t = 0; t < items; t++)
      for (int j = 0; j < in; j++) {
        double *target = below + (t * in + j) * stride;
        weighted_rows(stride, out, w + j, in, seeds + t * out * stride, stride, target);
        if (l == 0) continue;
        const double a = x[t * in + j], slope = f->activation == TANH ? 1 - a * a : -expm1(-a);
        for (int k = 0; k < stride; k++) target[k] *= slope;
      }
    seeds = below;
  }
  return seeds;
}

/* Rows of H' of the encoder's weights; through: dy / d features. */
static void lag_slopes(extended_filter *e, const double *through) {
  panel_filter *f = &e->filter;
  const lags *g = e->lags;
  const int seen = f->items * f->widths[0], outputs = f->items * f->widths[f->layers];
  const double *slopes = g->x + g->measured + g->states, *m = sums_of(f, f->layers - 1);
  double *sample = g->sample;
  const struct { int count; const double *from; } parts[] = {
      {g->measured, g->x}, {g->states, g->state}, {g->own, g->coded}, {outputs, m},
      {g->constants_count, g->constants}};
  for (int k = 0; k < 5; k++) {
    memcpy(sample, parts[k].from, sizeof(double) * parts[k].count);
    sample += parts[k].count;
  }
  for (int k = 0; k < g->remembered; k++)
    for (int i = 0; i < g->states; i++)
      g->moved[k * g->states + i] = slopes[i * g->remembered + k] / g->reach[k];
  const double *arguments[3] = {g->moved, g->along, g->sample};
  double *results[2] = {g->of_features, g->of_y};
  g->slopes(arguments, results, g->own, g->directions);
  for (int k = 0; k < g->own; k++) {
    double *row = row_of(e, k);
    weighted_rows(f->stride, seen, g->of_features + k, g->directions, through, f->stride, row);
    for (int y = 0; y < f->outputs; y++)
      row[y] = (row[y] + g->of_y[y * g->directions + k]) * g->reach[k];
  }
}

/* Rows of m numbers as the beginnings of rows of stride. */
static void pad_rows(int m, int stride, int count, const double *rows, double *padded) {
  const int last = m - WIDE, whole = last < 0 ? 0 : m;
  for (int r = 0; r < count; r++, rows += m, padded += stride) {
    for (int k = 0; k < last; k += WIDE) wide_store(padded + k, wide_load(rows + k));
    if (whole) wide_store(padded + last, wide_load(rows + last)); /* over some again */
    for (int k = whole; k < m; k++) padded[k] = rows[k];
  }
}

/* y at the mean in `predicted`, and H'. */
static void visit(extended_filter *e) {
  panel_filter *f = &e->filter;
  const int own = e->lags ? e->lags->own : 0, m = f->outputs, stride = f->stride;
  const int count = f->items * f->widths[f->layers];
  encode_sample(e);
  run_at_mean(f, own);
  pad_rows(m, stride, count, f->readout, f->weighting);
  const double *center = sums_of(f, f->layers - 1);
  double y[stride];
  combine(count, stride, center, f->weighting, y);
  for (int k = 0; k < m; k++) f->predicted[k] = f->offset[k] + y[k];
  const double *through = perceptron_slopes(e);
  if (own) lag_slopes(e, through);
}

/* Z = S' H' where the root is kept, and Z'Z of every block. */
static void see_by_root(extended_filter *e) {
  panel_filter *f = &e->filter;
  const int stride = f->stride, used = used_columns(f);
  for (int b = 0, before = 0; b < f->blocks; before += f->counts[b++])
    for (int first = 0; first < f->counts[b]; first += FEW) {
      const int at = f->starts[b] + first;
      const double *s = panel_of(f, b, first / PANEL) + (ptrdiff_t)at * PANEL + first % PANEL;
      double *z = f->slopes + (ptrdiff_t)at * stride;
      band_product(0, FEW, used, f->counts[b] - first, s, 1, PANEL,
                   e->derivative + (ptrdiff_t)(before + first) * stride, stride, z, stride);
      for (int k = 0; f->growth != 1 && k < FEW * stride; k++) z[k] *= f->growth;
    }
  for (int b = 0; b < f->blocks; b++) gram(f, b, f->slopes, gram_of(f, b));
}

/* P H' where P is kept, and H P H' of every block. */
static void see_by_covariance(extended_filter *e) {
  panel_filter *f = &e->filter;
  const double *x = e->derivative;
  for (int b = 0; b < f->blocks; x += (ptrdiff_t)f->counts[b++] * f->stride) {
    memset(gram_of(f, b), 0, sizeof(double) * f->stride * f->stride);
    sense_block(f, b, 0, x);
    add_sensed_gram(f, b, 0, x, gram_of(f, b));
  }
}

/* Mean and covariance of y (noise included) before it is measured. */
static int predict(void *memory) {
  panel_filter *f = memory;
  const int m = f->outputs, stride = f->stride;
  if (f->kept && !find_largest(f)) return COVARIANCE_LOST;
  visit(memory);
  if (f->kept) see_by_covariance(memory);
  else see_by_root(memory);
  memset(f->small, 0, sizeof(double) * stride * stride);
  for (int k = 0; k < m; k++) {
    f->small[k * stride + k] = f->screen->noise[k];
    for (int l = 0; l < m; l++) {
      double *sum = f->covariance + k * m + l;
      *sum = f->small[k * stride + l];
      for (int b = 0; b < f->blocks; b++) *sum += gram_of(f, b)[k * stride + l];
    }
  }
  return predicted(&f->base);
}

int extended_predict(extended_filter *e) { return stated(&e->filter.base, predict(e)); }

/* Learn one sample. */
int extended_update(extended_filter *e) { return learn_by_panels(&e->filter, predict); }

/* Lanes of a vector: the caller lays out the memory by it. */
int extended_lanes(void) { return WIDTH; }
