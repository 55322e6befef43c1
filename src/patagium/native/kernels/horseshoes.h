/* Circulation of strips that induce velocity on each other through horseshoe vortices.
 *
 * The kernel of `aerodynamics.horseshoes`, whose SX function is its oracle: there the
 * equations, shapes and units. Chains of strips; a chain of m strips has m + 1 legs, strip
 * i between legs i and i + 1, and neighbors share a leg. Eight strips are taken at once.
 */
#ifndef PATAGIUM_HORSESHOES_H
#define PATAGIUM_HORSESHOES_H

#include <math.h>

#include "operations.h"

/* Velocity that a leg of unit circulation induces, without 1 / (4 pi). */
static inline void leg_influence(const lanes r[3], const double *direction, double core_square,
                                 lanes k[3]) {
  const double dx = direction[0], dy = direction[1], dz = direction[2];
  const lanes cx = dy * r[2] - dz * r[1], cy = dz * r[0] - dx * r[2], cz = dx * r[1] - dy * r[0];
  const lanes distance = cx * cx + cy * cy + cz * cz;
  const lanes square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + 1e-12 * core_square;
  const lanes along = dx * r[0] + dy * r[1] + dz * r[2];
  const lanes ratio = distance / core_square;
  const lanes e = lanes_select(ratio < 1.0, ratio, lanes_broadcast(1.0)) - 1.0;
  const lanes beyond = lanes_select(ratio < 1.0, lanes_broadcast(core_square), distance);
  const lanes f = (1.0 / beyond - e * (1.0 - e * (1.0 - e)) / core_square) *
                  (1.0 + along / lanes_sqrt(square));
  k[0] = cx * f;
  k[1] = cy * f;
  k[2] = cz * f;
}

static inline void load_vectors(int count, int blocks, const double *from, lanes (*to)[3]) {
  for (int b = 0; b < blocks; b++)
    for (int axis = 0; axis < 3; axis++) {
      lanes x = {0};
      for (int lane = 0; lane < LANES && b * LANES + lane < count; lane++)
        x[lane] = from[3 * (b * LANES + lane) + axis];
      to[b][axis] = x;
    }
}

static inline void load_numbers(int count, int blocks, const double *from, lanes *to) {
  for (int b = 0; b < blocks; b++) {
    lanes x = {0};
    for (int lane = 0; lane < LANES && b * LANES + lane < count; lane++)
      x[lane] = from[b * LANES + lane];
    to[b] = x;
  }
}

/* Solution of the system whose columns (and right side, the last) are given; Gauss-Jordan
   without pivots. Rows beyond `count` are those of the identity. */
static inline void eliminate(int count, int blocks, lanes (*column)[blocks]) {
  for (int p = 0; p < count; p++) {
    const double *pivots = (const double *)column[p];
    const double inverse = 1.0 / pivots[p];
    lanes factor[blocks];
    for (int b = 0; b < blocks; b++) factor[b] = column[p][b] * inverse;
    factor[p / LANES][p % LANES] = 0.0;
    for (int j = p + 1; j <= count; j++) {
      const double value = ((const double *)column[j])[p];
      for (int b = 0; b < blocks; b++) column[j][b] -= factor[b] * value;
      ((double *)column[j])[p] = value * inverse;
    }
  }
}

static inline void horseshoes_double(int chains, const int *size, const double *const *in,
                                     double *const *out) {
  const double *edge = in[2], *direction = in[3], *core_square = in[4];
  const double feedthrough = in[7][0], quarter_pi_inverse = 0x1.45f306dc9c883p-4; /* 1/(4 pi) */
  int count = 0;
  for (int c = 0; c < chains; c++) count += size[c];
  const int legs = count + chains, blocks = (count + LANES - 1) / LANES;

  lanes point[blocks][3], normal[blocks][3], gain[blocks], column[count + 1][blocks];
  lanes influence[legs][blocks][3], normalwash[legs][blocks];
  load_vectors(count, blocks, in[0], point);
  load_vectors(count, blocks, in[1], normal);
  load_numbers(count, blocks, in[5], gain);
  load_numbers(count, blocks, in[6], column[count]);
  for (int leg = 0; leg < legs; leg++)
    for (int b = 0; b < blocks; b++) {
      lanes r[3], *k = influence[leg][b];
      for (int axis = 0; axis < 3; axis++) r[axis] = point[b][axis] - edge[3 * leg + axis];
      leg_influence(r, direction + 3 * leg, core_square[leg], k);
      for (int axis = 0; axis < 3; axis++) k[axis] *= quarter_pi_inverse;
      normalwash[leg][b] = k[0] * normal[b][0] + k[1] * normal[b][1] + k[2] * normal[b][2];
    }

  for (int c = 0, j = 0, leg = 0; c < chains; c++, leg++)
    for (int end = j + size[c]; j < end; j++, leg++) {
      for (int b = 0; b < blocks; b++)
        column[j][b] =
            gain[b] * feedthrough * (normalwash[leg][b] - normalwash[leg + 1][b]);
      column[j][j / LANES][j % LANES] += 1.0;
    }
  for (int b = 0; b < blocks; b++) column[count][b] *= gain[b];
  eliminate(count, blocks, column);

  const double *circulation = (const double *)column[count];
  lanes velocity[blocks][3];
  memset(velocity, 0, sizeof velocity);
  for (int c = 0, j = 0, leg = 0; c < chains; c++)
    for (int k = 0; k <= size[c]; k++, leg++) {
      const double inner = k > 0 ? circulation[j - 1] : 0.0;
      const double outer = k < size[c] ? circulation[j++] : 0.0;
      for (int b = 0; b < blocks; b++)
        for (int axis = 0; axis < 3; axis++)
          velocity[b][axis] += (inner - outer) * influence[leg][b][axis];
    }
  for (int i = 0; i < count; i++) {
    out[0][i] = circulation[i];
    for (int axis = 0; axis < 3; axis++)
      out[1][3 * i + axis] = velocity[i / LANES][axis][i % LANES];
  }
}

/* The same for eight states, one after the other. */
static inline void horseshoes_lanes(int chains, const int *size, const lanes *const *in,
                                    lanes *const *out) {
  int count = 0;
  for (int c = 0; c < chains; c++) count += size[c];
  const int legs = count + chains;
  const int length[8] = {3 * count, 3 * count, 3 * legs, 3 * legs, legs, count, count, 1};
  for (int lane = 0; lane < LANES; lane++) {
    double storage[13 * count + 13 * legs + 1], *from = storage, *to;
    const double *arguments[8];
    for (int k = 0; k < 8; k++) {
      arguments[k] = from;
      for (int i = 0; i < length[k]; i++) *from++ = in[k][i][lane];
    }
    to = from;
    horseshoes_double(chains, size, arguments, (double *const[]){to, to + count});
    for (int i = 0; i < count; i++) out[0][i][lane] = to[i];
    for (int i = 0; i < 3 * count; i++) out[1][i][lane] = to[count + i];
  }
}

#endif
