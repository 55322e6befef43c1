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

/* The derivative of `leg_influence` along dr, its leg's and its core's; and itself, k. */
static inline void leg_influence_forward(const lanes r[3], const double *d, double core,
                                         const lanes dr[3], const double *dd, double dcore,
                                         lanes k[3], lanes dk[3]) {
  lanes c[3], dc[3], distance = {0}, ddistance = {0}, square = {0}, dsquare = {0};
  lanes along = {0}, dalong = {0};
  for (int axis = 0; axis < 3; axis++) {
    const int i = (axis + 1) % 3, j = (axis + 2) % 3;
    c[axis] = d[i] * r[j] - d[j] * r[i];
    dc[axis] = dd[i] * r[j] + d[i] * dr[j] - dd[j] * r[i] - d[j] * dr[i];
    distance += c[axis] * c[axis];
    ddistance += 2.0 * c[axis] * dc[axis];
    square += r[axis] * r[axis];
    dsquare += 2.0 * r[axis] * dr[axis];
    along += d[axis] * r[axis];
    dalong += dd[axis] * r[axis] + d[axis] * dr[axis];
  }
  square += 1e-12 * core;
  dsquare += 1e-12 * dcore;
  const lanes none = {0}, ratio = distance / core;
  const lanes e = lanes_select(ratio < 1.0, ratio, lanes_broadcast(1.0)) - 1.0;
  const lanes de = lanes_select(ratio < 1.0, (ddistance - ratio * dcore) / core, none);
  const lanes beyond = lanes_select(ratio < 1.0, lanes_broadcast(core), distance);
  const lanes dbeyond = lanes_select(ratio < 1.0, lanes_broadcast(dcore), ddistance);
  const lanes bend = e * (1.0 - e * (1.0 - e)), dbend = (1.0 - e * (2.0 - 3.0 * e)) * de;
  const lanes g = 1.0 / beyond - bend / core;
  const lanes dg = -dbeyond / (beyond * beyond) - (dbend - bend * (dcore / core)) / core;
  const lanes root = lanes_sqrt(square), h = 1.0 + along / root;
  const lanes dh = (dalong - along * dsquare / (2.0 * square)) / root;
  for (int axis = 0; axis < 3; axis++) {
    k[axis] = c[axis] * g * h;
    dk[axis] = dc[axis] * g * h + c[axis] * (dg * h + g * dh);
  }
}

/* Its derivative along in[10..17], as CasADi asks for it; in[8] and in[9] are not looked at. */
static inline void fwd1_horseshoes_double(int chains, const int *size, const double *const *in,
                                          double *const *out) {
  const double feedthrough = in[7][0], dfeedthrough = in[17][0];
  const double quarter_pi_inverse = 0x1.45f306dc9c883p-4; /* 1/(4 pi) */
  int count = 0;
  for (int c = 0; c < chains; c++) count += size[c];
  const int legs = count + chains, blocks = (count + LANES - 1) / LANES;

  lanes point[blocks][3], normal[blocks][3], gain[blocks], wash[blocks];
  lanes dpoint[blocks][3], dnormal[blocks][3], dgain[blocks], dwash[blocks];
  lanes influence[legs][blocks][3], dinfluence[legs][blocks][3];
  lanes normalwash[legs][blocks], dnormalwash[legs][blocks];
  load_vectors(count, blocks, in[0], point);
  load_vectors(count, blocks, in[1], normal);
  load_numbers(count, blocks, in[5], gain);
  load_numbers(count, blocks, in[6], wash);
  load_vectors(count, blocks, in[10], dpoint);
  load_vectors(count, blocks, in[11], dnormal);
  load_numbers(count, blocks, in[15], dgain);
  load_numbers(count, blocks, in[16], dwash);
  for (int leg = 0; leg < legs; leg++)
    for (int b = 0; b < blocks; b++) {
      lanes r[3], dr[3], *k = influence[leg][b], *dk = dinfluence[leg][b];
      for (int axis = 0; axis < 3; axis++) {
        r[axis] = point[b][axis] - in[2][3 * leg + axis];
        dr[axis] = dpoint[b][axis] - in[12][3 * leg + axis];
      }
      leg_influence_forward(r, in[3] + 3 * leg, in[4][leg], dr, in[13] + 3 * leg, in[14][leg], k,
                            dk);
      normalwash[leg][b] = dnormalwash[leg][b] = lanes_broadcast(0.0);
      for (int axis = 0; axis < 3; axis++) {
        k[axis] *= quarter_pi_inverse;
        dk[axis] *= quarter_pi_inverse;
        normalwash[leg][b] += k[axis] * normal[b][axis];
        dnormalwash[leg][b] += dk[axis] * normal[b][axis] + k[axis] * dnormal[b][axis];
      }
    }

  lanes matrix[count + 1][blocks], column[count + 1][blocks];
  for (int c = 0, j = 0, leg = 0; c < chains; c++, leg++)
    for (int end = j + size[c]; j < end; j++, leg++) {
      for (int b = 0; b < blocks; b++)
        matrix[j][b] = gain[b] * feedthrough * (normalwash[leg][b] - normalwash[leg + 1][b]);
      matrix[j][j / LANES][j % LANES] += 1.0;
    }
  for (int b = 0; b < blocks; b++) matrix[count][b] = gain[b] * wash[b];
  memcpy(column, matrix, sizeof matrix);
  eliminate(count, blocks, column);
  double circulation[count];
  memcpy(circulation, column[count], sizeof circulation);

  /* M dc = d(gain wash) - dM c */
  for (int b = 0; b < blocks; b++) {
    matrix[count][b] = dgain[b] * wash[b] + gain[b] * dwash[b];
    const lanes gained = gain[b] * feedthrough;
    const lanes dgained = dgain[b] * feedthrough + gain[b] * dfeedthrough;
    for (int c = 0, j = 0, leg = 0; c < chains; c++, leg++)
      for (int end = j + size[c]; j < end; j++, leg++) {
        const lanes between = normalwash[leg][b] - normalwash[leg + 1][b];
        const lanes dbetween = dnormalwash[leg][b] - dnormalwash[leg + 1][b];
        matrix[count][b] -= circulation[j] * (dgained * between + gained * dbetween);
      }
  }
  eliminate(count, blocks, matrix);

  const double *dcirculation = (const double *)matrix[count];
  lanes velocity[blocks][3];
  memset(velocity, 0, sizeof velocity);
  for (int c = 0, j = 0, leg = 0; c < chains; c++)
    for (int k = 0; k <= size[c]; k++, leg++) {
      const double inner = k > 0 ? circulation[j - 1] : 0.0;
      const double dinner = k > 0 ? dcirculation[j - 1] : 0.0;
      const double outer = k < size[c] ? circulation[j] : 0.0;
      const double douter = k < size[c] ? dcirculation[j++] : 0.0;
      for (int b = 0; b < blocks; b++)
        for (int axis = 0; axis < 3; axis++)
          velocity[b][axis] += (dinner - douter) * influence[leg][b][axis] +
                               (inner - outer) * dinfluence[leg][b][axis];
    }
  for (int i = 0; i < count; i++) {
    out[0][i] = dcirculation[i];
    for (int axis = 0; axis < 3; axis++)
      out[1][3 * i + axis] = velocity[i / LANES][axis][i % LANES];
  }
}

/* The same for eight states, one after the other. */
typedef void horseshoes_of_one(int, const int *, const double *const *, double *const *);

static inline void horseshoes_in_turn(horseshoes_of_one *one, int inputs, int chains,
                                      const int *size, const lanes *const *in, lanes *const *out) {
  int count = 0;
  for (int c = 0; c < chains; c++) count += size[c];
  const int legs = count + chains;
  const int length[8] = {3 * count, 3 * count, 3 * legs, 3 * legs, legs, count, count, 1};
  for (int lane = 0; lane < LANES; lane++) {
    double storage[(9 * count + 7 * legs + 1) * (inputs / 8) + 4 * count], *from = storage;
    const double *arguments[inputs];
    for (int k = 0; k < inputs; k++) {
      arguments[k] = from;
      const int numbers = k < 8 ? length[k] : k < 10 ? 0 : length[k - 10];
      for (int i = 0; i < numbers; i++) *from++ = in[k][i][lane];
    }
    one(chains, size, arguments, (double *const[]){from, from + count});
    for (int i = 0; i < count; i++) out[0][i][lane] = from[i];
    for (int i = 0; i < 3 * count; i++) out[1][i][lane] = from[count + i];
  }
}

static inline void horseshoes_lanes(int chains, const int *size, const lanes *const *in,
                                    lanes *const *out) {
  horseshoes_in_turn(horseshoes_double, 8, chains, size, in, out);
}

static inline void fwd1_horseshoes_lanes(int chains, const int *size, const lanes *const *in,
                                         lanes *const *out) {
  horseshoes_in_turn(fwd1_horseshoes_double, 18, chains, size, in, out);
}

#endif
