/* One sample through a cubature filter whose covariance is a block for every neuron.
 *
 * Between samples P <- growth^2 P + D (D may be zero); then the points W +- spread S e_i, S a
 * lower triangular block for each neuron, give mean and covariance of y as in cubature.c, and
 *
 *     W_b <- W_b + S_b Z_b P_yy^-1 (y - mean),  P_b <- S_b (I - Z_b P_yy^-1 Z_b') S_b':
 *
 * the posterior of the filter over all weights, its blocks kept and the rest forgotten. Where
 * one linear layer at most follows a neuron, Z_b = a d' with d the direction of y, and
 * I - Z_b P_yy^-1 Z_b' is of rank one. WIDTH neurons of a layer go through it side by side.
 * Nothing is allocated, nothing is raised: the integer is an Outcome, and whatever is not
 * COMPLETED leaves mean and root as they were.
 *
 * Reference: Puskorius & Feldkamp (1991), Decoupled extended Kalman filter training, IJCNN.
 */
#include <math.h>

#include "node_points.h"
#include "node_root.h"

static double *direction_of(const node_filter *f, int node) {
  return f->directions + (ptrdiff_t)node * f->stride;
}

/* total += weight d d' */
static void add_outer(int m, int stride, double weight, const double *d, double *total) {
  if (weight == 0) return;
  for (int k = 0; k < m; k++) {
    const double scaled = weight * d[k];
    for (int l = 0; l < stride; l += WIDE)
      wide_store(total + k * stride + l,
                 wide_load(total + k * stride + l) + scaled * wide_load(d + l));
  }
}

/* Sums over the columns of x: of x itself, and of (x - centered mean)^2, in every lane. */
static void scatter_of(int k, const REAL *x, double centered, double *mean, double *scatter) {
  for (int h = 0; h < WIDTH; h += WIDE) {
    wide sum = {0}, square = {0};
    for (int i = 0; i < k; i++) sum += wide_from(x + (ptrdiff_t)i * WIDTH + h);
    sum /= k;
    for (int i = 0; i < k; i++) {
      const wide apart = wide_from(x + (ptrdiff_t)i * WIDTH + h) - centered * sum;
      square += apart * apart;
    }
    wide_store(mean + h, sum);
    wide_store(scatter + h, square);
  }
}

/* Slopes of a group along one direction of y; its share of Z'Z and of the curvatures. */
static void gather_line(node_filter *f, const group *g, REAL *steps, REAL *slopes,
                        double growth, double *total) {
  const int k = g->size, hidden = g->layer + 1 < f->layers;
  const reals reach = reals_all(R(f->spread * growth)), gain = reals_all(R(0.5 / f->spread));
  double mean[WIDTH], square[WIDTH], middle[WIDTH] = {0}, scatter[WIDTH] = {0};
  for (int i = 0; i < k; i++) {
    const reals step = reach * row_load(steps, i);
    if (!hidden) {
      row_store(slopes, i, R(growth) * row_load(steps, i));
      continue;
    }
    const reals up = change_of(f, g, 0, step), down = change_of(f, g, 0, -step);
    row_store(slopes, i, (up - down) * gain);
    row_store(f->curvatures, i, (up + down) * R(0.5));
  }
  scatter_of(k, slopes, 0, mean, square);
  if (hidden) scatter_of(k, f->curvatures, f->centered, middle, scatter);
  for (int c = 0; c < g->count; c++) {
    double *d = direction_of(f, g->node + c), *center = f->centers + (g->node + c) * f->stride;
    find_direction(f, g->layer, g->first + c, 0, d);
    f->squares[g->node + c] = square[c];
    add_outer(f->outputs, f->stride, square[c] + f->curvature_gain * scatter[c], d, total);
    for (int l = 0; l < f->stride; l++) center[l] = middle[c] * d[l];
  }
}

/* total += scale sum over columns of (x - middle)(x - middle)', all lanes; sums: m x m x WIDE. */
static void add_gram(int k, int m, int stride, double scale, const REAL *x, const double *middle,
                     double *sums, double *total) {
  wide apart[m];
  memset(sums, 0, sizeof(double) * m * m * WIDE);
  for (int i = 0; i < k; i++)
    for (int h = 0; h < WIDTH; h += WIDE) {
      for (int q = 0; q < m; q++)
        apart[q] = wide_from(x + ((ptrdiff_t)i * m + q) * WIDTH + h)
                   - wide_load(middle + q * WIDTH + h);
      for (int p = 0; p < m; p++)
        for (int q = 0; q <= p; q++) {
          double *sum = sums + (p * m + q) * WIDE;
          wide_store(sum, wide_load(sum) + apart[p] * apart[q]);
        }
    }
  for (int p = 0; p < m; p++)
    for (int q = 0; q <= p; q++) {
      double sum = 0;
      for (int c = 0; c < WIDE; c++) sum += scale * sums[(p * m + q) * WIDE + c];
      total[p * stride + q] += sum;
      if (p != q) total[q * stride + p] += sum;
    }
}

/* Slopes of a group along all of y; its share of Z'Z and of the curvatures. */
static void gather(node_filter *f, const group *g, REAL *steps, REAL *slopes, double growth,
                   double *total) {
  const int k = g->size, m = f->outputs, terms = terms_of(f, g);
  const reals reach = reals_all(R(f->spread * growth)), gain = reals_all(R(0.5 / f->spread));
  REAL *change = f->outputs_at, *up = change + f->items * WIDTH;
  REAL *down = up + (ptrdiff_t)terms * WIDTH, *room = down + (ptrdiff_t)terms * WIDTH;
  double middle[m * WIDTH], none[m * WIDTH];
  memset(middle, 0, sizeof middle);
  memset(none, 0, sizeof none);
  find_towards(f, g);
  for (int i = 0; i < k; i++) {
    for (int side = 0; side < 2; side++) {
      for (int t = 0; t < f->items; t++) {
        const reals step = reach * row_load(steps, (ptrdiff_t)i * f->items + t);
        row_store(change, t, change_of(f, g, t, side ? -step : step));
      }
      run_on(f, g, change, room, side ? down : up);
    }
    for (int q = 0; q < m; q++) {
      reals slope = {0}, curvature = {0};
      for (int r = 0; r < terms; r++) {
        const reals towards = row_load(f->towards, (ptrdiff_t)r * m + q);
        slope += towards * (row_load(up, r) - row_load(down, r));
        curvature += towards * (row_load(up, r) + row_load(down, r));
      }
      row_store(slopes, (ptrdiff_t)i * m + q, slope * gain);
      row_store(f->curvatures, (ptrdiff_t)i * m + q, curvature * R(0.5));
      for (int c = 0; c < WIDTH; c++) middle[q * WIDTH + c] += (double)curvature[c] * (0.5 / k);
    }
  }
  add_gram(k, m, f->stride, 1, slopes, none, f->wide_small, total);
  for (int c = 0; c < g->count; c++)
    for (int q = 0; q < m; q++) f->centers[(g->node + c) * f->stride + q] = middle[q * WIDTH + c];
  for (int q = 0; q < m * WIDTH; q++) middle[q] *= f->centered;
  add_gram(k, m, f->stride, f->curvature_gain, f->curvatures, middle, f->wide_small, total);
}

/* Mean of y moved by the curvatures; what centering them leaves of the covariance; the noise. */
static void finish_moments(node_filter *f, double *total) {
  const int m = f->outputs, stride = f->stride;
  double shift[stride], apart[stride];
  memset(shift, 0, sizeof shift);
  for (group g = {0}; next_group(f, &g);)
    for (int c = 0; c < g.count; c++)
      for (int l = 0; l < stride; l++)
        shift[l] += g.size / (f->spread * f->spread) * f->centers[(g.node + c) * stride + l];
  if (f->centered != 0)
    for (group g = {0}; next_group(f, &g);)
      for (int c = 0; c < g.count; c++) {
        for (int l = 0; l < stride; l++) apart[l] = f->centers[(g.node + c) * stride + l] - shift[l];
        add_outer(m, stride, f->curvature_gain * g.size, apart, total);
      }
  add_outer(m, stride, f->shift_gain, shift, total);
  for (int k = 0; k < m; k++) {
    f->predicted[k] += shift[k];
    total[k * stride + k] += f->screen->noise[k];
    for (int l = 0; l < m; l++) f->covariance[k * m + l] = total[k * stride + l];
  }
}

/* The root before the next sample, where something is added to the covariance. */
static void drift(node_filter *f) {
  if (!f->drifts || f->drifted) return;
  for (group g = {0}; next_group(f, &g);)
    drift_root(g.size, f->growth, f->root + g.entries * WIDTH, f->drift + g.rows * WIDTH,
               f->grown + g.entries * WIDTH, f->gains);
  f->drifted = 1;
}

/* Mean and covariance of y (noise included) before it is measured. */
static int predict(void *memory) {
  node_filter *f = memory;
  const int m = f->outputs, last = f->widths[f->layers], padded = padded_of(f);
  const double growth = f->drifts ? 1 : f->growth;
  double *total = f->small;
  drift(f);
  encode(&f->base);
  run_at_mean(f);
  for (int k = 0; k < m; k++) f->predicted[k] = f->offset[k];
  for (int t = 0; t < f->items; t++)
    for (int o = 0; o < last; o++)
      for (int k = 0; k < m; k++)
        f->predicted[k] += f->readout[((ptrdiff_t)t * last + o) * m + k] *
                           (double)sums_of(f, f->layers - 1)[t * padded + o];
  memset(total, 0, sizeof(double) * f->stride * f->stride);
  for (group g = {0}; next_group(f, &g);) {
    const REAL *s = (f->drifts ? f->grown : f->root) + g.entries * WIDTH;
    REAL *steps = f->steps, *slopes = f->slopes + g.rows * m * WIDTH;
    find_steps(f, &g, s, steps);
    if (is_line(f, &g)) gather_line(f, &g, steps, slopes, growth, total);
    else gather(f, &g, steps, slopes, growth, total);
  }
  finish_moments(f, total);
  return predicted(&f->base);
}

int node_predict(node_filter *f) { return stated(&f->base, predict(f)); }

/* Weights of a group by their steps: growth times cross (rows of `terms`) times gain. */
static void move(node_filter *f, const group *g, int terms, double growth, const double *gain) {
  for (int j = 0; j < g->size; j++) {
    double step[WIDTH] = {0};
    for (int q = 0; q < terms; q++)
      for (int c = 0; c < WIDTH; c++)
        step[c] += (double)f->cross[((ptrdiff_t)j * terms + q) * WIDTH + c] * gain[q * WIDTH + c];
    REAL *near = f->near + (g->rows + j) * WIDTH;
    for (int c = 0; c < g->count; c++) {
      const int weight = weight_of(f, g, j, c);
      f->mean[weight] += growth * step[c];
      f->plain[weight] = near[c] = R(f->mean[weight]);
    }
  }
}

/* A group whose slopes are of rank one after the sample. */
static reals learn_line(node_filter *f, const group *g, double growth, const REAL *before,
                        const REAL *slopes, const double *inverse, const double *step) {
  const int m = f->outputs, stride = f->stride;
  double inner[stride], gain[WIDTH] = {0};
  reals shares = {0}, remaining = reals_all(1);
  for (int c = 0; c < g->count; c++) {
    const double *d = direction_of(f, g->node + c);
    double alpha = 0;
    combine(m, stride, d, inverse, inner);
    for (int l = 0; l < stride; l++) alpha += inner[l] * inner[l];
    for (int l = 0; l < m; l++) gain[c] += d[l] * step[l];
    shares[c] = R(alpha);
    remaining[c] = R(fmax(1 - alpha * f->squares[g->node + c], 1e-14));
  }
  const reals longest = shrink_root(g->size, growth, shares, remaining, before,
                                    f->root + g->entries * WIDTH, slopes, f->gains, f->cross);
  move(f, g, 1, growth, gain);
  return longest;
}

/* A group whose slopes are of any rank after the sample. */
static reals learn(node_filter *f, const group *g, double growth, const REAL *before,
                   const REAL *slopes, const double *step) {
  const int m = f->outputs, k = g->size;
  double *rest = f->wide_small, *inverse = rest + (ptrdiff_t)m * m * WIDE;
  double gain[m * WIDTH];
  for (int h = 0; h < WIDTH; h += WIDE) {
    for (int p = 0; p < m; p++)
      for (int q = 0; q <= p; q++) {
        wide sum = wide_all(f->small[p * f->stride + q]);
        for (int i = 0; i < k; i++)
          sum -= wide_from(slopes + ((ptrdiff_t)i * m + p) * WIDTH + h) *
                 wide_from(slopes + ((ptrdiff_t)i * m + q) * WIDTH + h);
        wide_store(rest + (p * m + q) * WIDE, sum);
      }
    invert_roots(m, rest, f->small, f->stride, inverse);
    find_gains(k, m, slopes + h, inverse, f->gains + h);
  }
  for (int q = 0; q < m; q++)
    for (int c = 0; c < WIDTH; c++) gain[q * WIDTH + c] = step[q];
  const reals longest = shrink_root_by(k, m, growth, before, f->root + g->entries * WIDTH, slopes,
                                       f->gains, f->cross);
  move(f, g, m, growth, gain);
  return longest;
}

/* Slopes and moments of y without the channels left out, with the noise of those doubted. */
static void screen_neurons(void *memory) {
  node_filter *f = memory;
  const screening *s = f->screen;
  const int m = f->outputs;
  leave_out(s, f->stride, f->small);
  for (int k = 0; k < m; k++) {
    if (!s->left_out[k]) continue;
    for (group g = {0}; next_group(f, &g);) {
      REAL *slopes = f->slopes + g.rows * m * WIDTH;
      if (is_line(f, &g))
        for (int c = 0; c < g.count; c++) direction_of(f, g.node + c)[k] = 0;
      else
        for (int i = 0; i < g.size; i++) row_store(slopes, (ptrdiff_t)i * m + k, (reals){0});
    }
  }
}

static int neurons_in_range(void *memory) {
  const node_filter *f = memory;
  return f->largest * largest_deviation(&f->base) < (SINGLE ? 1e36 : 1e300);
}

static int invert_total(void *memory, double *g, double *turned) {
  node_filter *f = memory;
  double *work = f->small + f->stride * f->stride;
  return invert_turned(f->outputs, f->stride, 0, f->small, work, g, turned);
}

/* Mean and root after the sample; gain: P_yy^-1 (y - mean), g g' = P_yy^-1. */
static void learn_neurons(void *memory, const double *gain, const double *g) {
  node_filter *f = memory;
  const double growth = f->drifts ? 1 : f->growth;
  reals longest = {0};
  for (group one = {0}; next_group(f, &one);) {
    const REAL *before = (f->drifts ? f->grown : f->root) + one.entries * WIDTH;
    const REAL *slopes = f->slopes + one.rows * f->outputs * WIDTH;
    longest = reals_larger(longest, is_line(f, &one)
                                        ? learn_line(f, &one, growth, before, slopes, g, gain)
                                        : learn(f, &one, growth, before, slopes, gain));
  }
  f->largest = 0;
  for (int c = 0; c < WIDTH; c++)
    f->largest = (double)longest[c] <= f->largest * f->largest ? f->largest : sqrt((double)longest[c]);
  f->drifted = 0;
}

/* Learn one sample. */
int node_update(node_filter *f) {
  static const structure neurons = {predict, neurons_in_range, screen_neurons, invert_total,
                                    learn_neurons};
  return learn_sample(&f->base, f, &neurons);
}

/* Lanes of a vector: the caller lays out the memory by it. */
int node_lanes(void) { return WIDTH; }

/* Roots packed by bands from, and to, dense lower blocks (k, k) of every neuron, one after the
 * other, in double; and the mean into the precision of the points. */
void node_pack(node_filter *f, const double *blocks) {
  ptrdiff_t at = 0;
  for (group g = {0}; next_group(f, &g);)
    for (int c = 0; c < g.count; c++, at += (ptrdiff_t)g.size * g.size)
      for (int j = 0; j < g.size; j++) {
        const int b = j / BAND, rows = g.size - BAND * b < BAND ? g.size - BAND * b : BAND;
        REAL *row = f->root + (g.entries + band_start(b) + j % BAND) * WIDTH + c;
        double norm = 0;
        for (int i = 0; i <= j; i++) {
          row[(ptrdiff_t)i * rows * WIDTH] = R(blocks[at + (ptrdiff_t)j * g.size + i]);
          norm += blocks[at + (ptrdiff_t)j * g.size + i] * blocks[at + (ptrdiff_t)j * g.size + i];
        }
        f->largest = fmax(f->largest, sqrt(norm));
        const int weight = weight_of(f, &g, j, c);
        f->plain[weight] = f->near[(g.rows + j) * WIDTH + c] = R(f->mean[weight]);
      }
}

void node_unpack(const node_filter *f, double *blocks) {
  ptrdiff_t at = 0;
  for (group g = {0}; next_group(f, &g);)
    for (int c = 0; c < g.count; c++, at += (ptrdiff_t)g.size * g.size)
      for (int j = 0; j < g.size; j++) {
        const int b = j / BAND, rows = g.size - BAND * b < BAND ? g.size - BAND * b : BAND;
        const REAL *row = f->root + (g.entries + band_start(b) + j % BAND) * WIDTH + c;
        for (int i = 0; i <= j; i++)
          blocks[at + (ptrdiff_t)j * g.size + i] = (double)row[(ptrdiff_t)i * rows * WIDTH];
      }
}
