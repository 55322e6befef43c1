/* One sample through the square-root extended Kalman filter of a network's weights.
 *
 * The network is y = offset + readout . mlp(features; W) and linear around the mean: H = dy/dW by
 * reverse accumulation through the mlp, Z = S' H', M = R. What a sample then does to mean and
 * root is the cubature filter's: panels.h; where something is added to the covariance between
 * samples, P is kept: covariance.h.
 */
#include "points.h"
#include "covariance.h"

#include "extended_filter_struct.h"

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

/* Rows of H' of the mlp's weights, layer by layer from the last. */
static void perceptron_slopes(extended_filter *e) {
  panel_filter *f = &e->filter;
  const int stride = f->stride, items = f->items;
  const int room = items * widest_of(&f->base) * stride;
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
    if (l == 0) break;
    for (int t = 0; t < items; t++)
      for (int j = 0; j < in; j++) {
        double *target = below + (t * in + j) * stride;
        weighted_rows(stride, out, w + j, in, seeds + t * out * stride, stride, target);
        const double a = x[t * in + j], slope = f->activation == TANH ? 1 - a * a : -expm1(-a);
        for (int k = 0; k < stride; k++) target[k] *= slope;
      }
    seeds = below;
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
  const int m = f->outputs, stride = f->stride;
  const int count = f->items * f->widths[f->layers];
  encode(&f->base);
  run_at_mean(f);
  pad_rows(m, stride, count, f->readout, f->weighting);
  const double *center = sums_of(f, f->layers - 1);
  double y[stride];
  combine(count, stride, center, f->weighting, y);
  for (int k = 0; k < m; k++) f->predicted[k] = f->offset[k] + y[k];
  perceptron_slopes(e);
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
