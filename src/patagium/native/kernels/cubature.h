/* Memory of one learner: mean and square root of its weights, and room to work in.
 *
 * Everything is owned by the caller, zero to begin with, on cache lines. Python's twin of
 * the struct is `kernel_filter.py`, field by field.
 */
#ifndef PATAGIUM_CUBATURE_H
#define PATAGIUM_CUBATURE_H

#include <stddef.h>

#include "activations.h"
#include "screening.h"

enum { SOFTPLUS = 0, TANH = 1 };

#define PANEL (2 * WIDTH) /* columns of S in a panel */

typedef struct {
  int32_t weights;       /* n */
  int32_t rows;          /* of all blocks, each rounded up to a multiple of PANEL by zeros */
  int32_t outputs;       /* n_y */
  int32_t stride;        /* n_y rounded up to a multiple of WIDTH and 4 */
  int32_t items;         /* how often the mlp is evaluated for one y */
  int32_t layers;        /* of the mlp */
  int32_t activation;
  int32_t blocks;        /* of weights whose covariance is kept: 1, or one a layer */
  const int32_t *widths; /* layers + 1 */
  const int32_t *starts; /* blocks + 1: first row of each block */
  const int32_t *counts; /* blocks: its weights */
  double spread;
  double growth;         /* 1 / sqrt(forgetting factor) */
  double bend_gain;      /* M = bend_gain sum (c - centered D)(c - centered D)' */
  double centered;       /*     + shift_gain D D' + diag(noise); c: half sums less the */
  double shift_gain;     /*     value at the mean, D = sum c / spread^2 */
  double largest;        /* no row of S is longer */
  double nis;            /* normalized innovation squared of the last sample */
  double *mean;          /* n */
  screening *screen;     /* what samples go through; holds the variances of the measurement */
  REAL *root;            /* S by blocks: panels of (its rows - first column) x PANEL */
  REAL *near;            /* rows: mean in the precision of the points */
  REAL *slopes;          /* rows x stride: Z */
  REAL *bends;           /* rows x stride: c */
  REAL *steps;           /* rows / PANEL x outputs x PANEL: -e / sqrt(a), by panels */
  REAL *shrinks;         /* rows: 1 / sqrt(a) */
  REAL *cross;           /* rows x stride: C */
  REAL *points;          /* 2 x items x widest x PANEL: the mlp at the points */
  REAL *at_mean;         /* 2 x layers x padded: sums and activations at the mean */
  REAL *weighting;       /* items widths[layers] x stride: readout, transposed */
  double *small;         /* (5 + blocks) x stride x stride */
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
} cubature;

/* Rows stored by the first panels of a block of `rows` rows, panel by panel. */
static inline ptrdiff_t rows_before(ptrdiff_t rows, ptrdiff_t panel) {
  return panel * rows - PANEL * panel * (panel - 1) / 2;
}

/* Row 0 of a panel of a block, as if all rows of all blocks were stored. */
static REAL *panel_of(const cubature *f, int block, int panel) {
  ptrdiff_t before = 0;
  for (int b = 0; b < block; b++) {
    const int rows = f->starts[b + 1] - f->starts[b];
    before += rows_before(rows, rows / PANEL);
  }
  before += rows_before(f->starts[block + 1] - f->starts[block], panel);
  return f->root + (before - f->starts[block] - (ptrdiff_t)panel * PANEL) * PANEL;
}

#endif
