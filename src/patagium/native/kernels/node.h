/* Memory of one learner whose covariance is a block for every neuron.
 *
 * Neurons of a layer are taken WIDTH at a time, one in each lane: a group. Its weights are
 * k = inputs + 1 rows (the bias last) of vectors; its square root is packed by bands of four
 * rows, each from the first column to its diagonal, column by column.
 */
#ifndef PATAGIUM_NODE_H
#define PATAGIUM_NODE_H

#include <stddef.h>

#include "activations.h"
#include "sample.h"
#include "node_filter_struct.h"

enum { SOFTPLUS = 0, TANH = 1 };

#define BAND 4 /* rows of a band */

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
