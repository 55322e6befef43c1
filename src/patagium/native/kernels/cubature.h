/* Square root of the covariance by panels of columns: its layout in memory. */
#ifndef PATAGIUM_CUBATURE_H
#define PATAGIUM_CUBATURE_H

#include <stddef.h>

#include "activations.h"
#include "sample.h"
#include "panel_filter_struct.h"

enum { SOFTPLUS = 0, TANH = 1 };

#define PANEL (2 * WIDTH) /* columns of S in a panel */

/* Rows stored by the first panels of a block of `rows` rows, panel by panel. */
static inline ptrdiff_t rows_before(ptrdiff_t rows, ptrdiff_t panel) {
  return panel * rows - PANEL * panel * (panel - 1) / 2;
}

/* Number where row 0 of a panel of a block stands, as if all rows of all blocks were stored. */
static ptrdiff_t panel_at(const panel_filter *f, int block, int panel) {
  ptrdiff_t before = 0;
  for (int b = 0; b < block; b++) {
    const int rows = f->starts[b + 1] - f->starts[b];
    before += rows_before(rows, rows / PANEL);
  }
  before += rows_before(f->starts[block + 1] - f->starts[block], panel);
  return (before - f->starts[block] - (ptrdiff_t)panel * PANEL) * PANEL;
}

/* Row 0 of a panel of S. */
static REAL *panel_of(const panel_filter *f, int block, int panel) {
  return f->root + panel_at(f, block, panel);
}

#endif
