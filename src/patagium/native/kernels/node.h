/* Memory of one learner whose covariance is a block for every neuron.
 *
 * Neurons of a layer are taken WIDTH at a time, one in each lane: a group. Its weights are
 * k = inputs + 1 rows (the bias last) of vectors; its square root is packed by bands of four
 * rows, each from the first column to its diagonal, column by column. Everything is owned by
 * the caller, zero to begin with, on cache lines; Python's twin is `node_filter.py`.
 */
#ifndef PATAGIUM_NODE_H
#define PATAGIUM_NODE_H

#include <stddef.h>

#include "activations.h"
#include "screening.h"
#include "small.h"

enum { SOFTPLUS = 0, TANH = 1 };

#define BAND 4 /* rows of a band */

typedef struct {
  int32_t weights;       /* n */
  int32_t outputs;       /* n_y */
  int32_t stride;        /* n_y rounded up to a multiple of 8    */
  int32_t items;         /* how often the mlp is evaluated for one y */
  int32_t layers;        /* of the mlp */
  int32_t activation;
  int32_t drifts;        /* 1: drift and decay act before each sample, 0: growth does */
  int32_t drifted;       /* 1: `grown` is the root before the next sample */
  const int32_t *widths; /* layers + 1 */
  double spread;
  double growth;         /* 1 / sqrt(forgetting factor) */
  double bend_gain;      /* see cubature.h */
  double centered;
  double shift_gain;
  double largest;        /* no row of the root is longer */
  double nis;            /* normalized innovation squared of the last sample */
  double *mean;          /* n, in the order of the network */
  screening *screen;     /* what samples go through; holds the variances of the measurement */
  REAL *root;            /* of all groups */
  REAL *grown;           /* the same after the drift, where there is one */
  REAL *drift;           /* variances added before a sample, rows of all groups */
  REAL *near;            /* mean in the precision of the points, rows of all groups */
  REAL *plain;           /* the same in the order of the network, and WIDTH zeros */
  REAL *steps;           /* columns of all groups: how far z moves, (items) */
  REAL *slopes;          /* columns of all groups: 1 number where rank one, else n_y */
  REAL *bends;           /* columns of one group: n_y numbers */
  REAL *gains;           /* columns of one group: n_y + 1 numbers */
  REAL *cross;           /* rows of one group: n_y numbers */
  REAL *outputs_at;      /* 4 x items x widest */
  REAL *towards;         /* terms x n_y: what y does with an output of the mlp */
  REAL *at_mean;         /* 2 x layers x items x padded */
  double *directions;    /* nodes x items x stride: y for a unit of each neuron's output */
  double *centers;       /* nodes x stride: mean of the bends */
  double *squares;       /* nodes: a'a where slopes are of rank one */
  double *small;         /* 4 x stride x stride */
  double *wide_small;    /* 2 x n_y x n_y x WIDE */
  /* one sample */
  void (*encode)(const double *const *, double *const *); /* or NULL: features, readout given */
  const double *const *encode_arguments;
  double *const *encode_results;
  double *features;      /* items x widths[0] */
  double *readout;       /* items widths[layers] x n_y: transposed */
  double *offset;        /* n_y */
  double *measured;      /* n_y */
  double *predicted;     /* n_y */
  double *innovation;    /* n_y */
  double *covariance;    /* n_y x n_y */
} node_filter;

/* WIDTH neurons of one layer. */
typedef struct {
  int layer, first, count; /* neurons first .. first + count - 1 */
  int size;                /* k */
  int node;                /* neurons before it, in all */
  int at;                  /* first weight of its layer */
  ptrdiff_t rows;          /* rows (or columns) of groups before it */
  ptrdiff_t entries;       /* entries of the roots of groups before it */
} group;

/* Doubles of WIDE lanes, `half` by half, as the small algebra takes them. */
#define HALVES (WIDTH / WIDE)

typedef REAL parts __attribute__((vector_size(WIDE * sizeof(REAL))));

static inline wide wide_of(const REAL *p) {
  parts x;
  memcpy(&x, p, sizeof x);
  return __builtin_convertvector(x, wide);
}

static inline void wide_to(REAL *p, wide x) {
  parts narrow = __builtin_convertvector(x, parts);
  memcpy(p, &narrow, sizeof narrow);
}

static inline wide wide_all(double x) { return x - (wide){0}; }

static inline reals row_load(const REAL *p, ptrdiff_t k) { return reals_load(p + k * WIDTH); }
static inline void row_store(REAL *p, ptrdiff_t k, reals x) { reals_store(p + k * WIDTH, x); }

/* Entries of a packed root of k rows before its band b. */
static inline ptrdiff_t band_start(int b) { return (ptrdiff_t)BAND * BAND / 2 * b * (b + 1); }

static inline ptrdiff_t root_entries(int k) {
  return band_start(k / BAND) + (ptrdiff_t)(k % BAND) * k;
}

/* The first group (of a group of zeros), then the next; 0 when there is none. */
static int next_group(const node_filter *f, group *g) {
  if (g->count) {
    g->rows += g->size;
    g->entries += root_entries(g->size);
    g->node += g->count;
    g->first += g->count;
    if (g->first == f->widths[g->layer + 1]) {
      g->at += f->widths[g->layer + 1] * g->size;
      g->layer++;
      g->first = 0;
    }
  }
  if (g->layer == f->layers) return 0;
  const int left = f->widths[g->layer + 1] - g->first;
  g->count = left < WIDTH ? left : WIDTH;
  g->size = f->widths[g->layer] + 1;
  return 1;
}

/* Where row j of lane c stands in the network's vector of weights. */
static inline int weight_of(const node_filter *f, const group *g, int j, int c) {
  const int in = g->size - 1, o = g->first + c;
  return g->at + (j < in ? o * in + j : f->widths[g->layer + 1] * in + o);
}

/* Whether one linear layer at most follows the neurons. */
static inline int is_late(const node_filter *f, const group *g) { return g->layer + 2 >= f->layers; }

/* Whether y moves along one direction when a neuron changes: slopes of rank one. */
static inline int is_line(const node_filter *f, const group *g) {
  return is_late(f, g) && f->items == 1;
}

/* How many numbers a change of one neuron is before the readout. */
static inline int terms_of(const node_filter *f, const group *g) {
  return is_late(f, g) ? f->items : f->items * f->widths[f->layers];
}

#endif
