/* Circulation of strips that induce velocity on each other through horseshoe vortices.
 *
 * The kernel of `aerodynamics.horseshoes`, whose SX function is its oracle: there the
 * equations, shapes and units. Chains of strips; a chain of m strips has m + 1 legs, strip
 * i between legs i and i + 1, and neighbors share a leg. Of the numbers in `size` the first is
 * that of the chains which are no images of others. Eight strips are taken at once.
 */
#ifndef PATAGIUM_HORSESHOES_H
#define PATAGIUM_HORSESHOES_H

#include <math.h>

#include "operations.h"

/* Velocity that a leg of unit circulation induces, without 1 / (4 pi); `ahead` is 0 where it
   begins abreast of a strip, of its own chain, and else 1. */
static inline void leg_influence(const lanes r[3], const double *direction, double core_square,
                                 lanes ahead, lanes k[3]) {
  const double dx = direction[0], dy = direction[1], dz = direction[2];
  const lanes cx = dy * r[2] - dz * r[1], cy = dz * r[0] - dx * r[2], cz = dx * r[1] - dy * r[0];
  const lanes distance = cx * cx + cy * cy + cz * cz;
  const lanes square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + 1e-12 * core_square;
  const lanes along = dx * r[0] + dy * r[1] + dz * r[2];
  const lanes ratio = distance / core_square;
  const lanes e = lanes_select(ratio < 1.0, ratio, lanes_broadcast(1.0)) - 1.0;
  const lanes beyond = lanes_select(ratio < 1.0, lanes_broadcast(core_square), distance);
  const lanes f = (1.0 / beyond - e * (1.0 - e * (1.0 - e)) / core_square) *
                  (1.0 + ahead * along / lanes_sqrt(square));
  k[0] = cx * f;
  k[1] = cy * f;
  k[2] = cz * f;
}

/* Rows of `width` numbers, eight at once; those beyond `count` are zero. */
static inline void load_rows(int count, int width, const double *from, lanes *to) {
  for (int first = 0; first < count; first += LANES)
    for (int k = 0; k < width; k++) {
      lanes x = {0};
      for (int lane = 0; lane < LANES && first + lane < count; lane++)
        x[lane] = from[width * (first + lane) + k];
      *to++ = x;
    }
}

static inline int sum_of(int count, const int *size) {
  int sum = 0;
  for (int c = 0; c < count; c++) sum += size[c];
  return sum;
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

/* 0 for the strips of a chain and of each `wings` chains before and after it, else 1. */
static inline void strips_of_others(int chain, int wings, int chains, const int *size, int blocks,
                                    lanes *to) {
  for (int b = 0; b < blocks; b++) to[b] = lanes_broadcast(1.0);
  for (int c = 0, strip = 0; c < chains; strip += size[c++])
    for (int k = strip; k < strip + size[c] && (c - chain) % wings == 0; k++)
      to[k / LANES][k % LANES] = 0.0;
}

/* Velocity that the bound vortex between the beginnings of two legs induces, of unit circulation,
   and without 1 / (4 pi). */
static inline void bound_influence(const lanes r[3], const lanes s[3], const double *length,
                                   double core, lanes others, lanes k[3]) {
  lanes c[3], square = {0}, r2 = {0}, s2 = {0}, rl = {0}, sl = {0};
  double l2 = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    const int i = (axis + 1) % 3, j = (axis + 2) % 3;
    c[axis] = r[i] * s[j] - r[j] * s[i];
    square += c[axis] * c[axis];
    r2 += r[axis] * r[axis];
    s2 += s[axis] * s[axis];
    rl += r[axis] * length[axis];
    sl += s[axis] * length[axis];
    l2 += length[axis] * length[axis];
  }
  const lanes along = rl / lanes_sqrt(r2 + 1e-12 * core) - sl / lanes_sqrt(s2 + 1e-12 * core);
  const lanes f = others * along / (square + core * l2);
  for (int axis = 0; axis < 3; axis++) k[axis] = c[axis] * f;
}

static inline void horseshoes_double(int numbers, const int *size, const double *const *in,
                                     double *const *out) {
  const int chains = numbers - 1, wings = *size++;
  const double *edge = in[2], *direction = in[3], *core_square = in[4];
  const double feedthrough = in[7][0], quarter_pi_inverse = 0x1.45f306dc9c883p-4; /* 1/(4 pi) */
  const int count = sum_of(chains, size), legs = count + chains;
  const int blocks = (count + LANES - 1) / LANES;

  lanes point[blocks][3], normal[blocks][3], gain[blocks], column[count + 1][blocks];
  lanes influence[legs][blocks][3], normalwash[legs][blocks], others[blocks];
  load_rows(count, 3, in[0], point[0]);
  load_rows(count, 3, in[1], normal[0]);
  load_rows(count, 1, in[5], gain);
  load_rows(count, 1, in[6], column[count]);
  for (int c = 0, leg = 0; c < chains; c++) {
    strips_of_others(c, chains, chains, size, blocks, others);
    for (int end = leg + size[c] + 1; leg < end; leg++)
      for (int b = 0; b < blocks; b++) {
        lanes r[3], *k = influence[leg][b];
        for (int axis = 0; axis < 3; axis++) r[axis] = point[b][axis] - edge[3 * leg + axis];
        leg_influence(r, direction + 3 * leg, core_square[leg], others[b], k);
        for (int axis = 0; axis < 3; axis++) k[axis] *= quarter_pi_inverse;
        normalwash[leg][b] = k[0] * normal[b][0] + k[1] * normal[b][1] + k[2] * normal[b][2];
      }
  }

  lanes bound[count][blocks][3];
  memset(bound, 0, sizeof bound);
  for (int c = 0, j = 0, leg = 0; c < chains; c++, leg++) {
    strips_of_others(c, wings, chains, size, blocks, others);
    for (int end = j + size[c]; j < end; j++, leg++) {
      const double *from = edge + 3 * leg, *to = from + 3;
      const double length[3] = {to[0] - from[0], to[1] - from[1], to[2] - from[2]};
      const double core = 0.5 * (core_square[leg] + core_square[leg + 1]);
      for (int b = 0; b < blocks; b++) {
        lanes r[3], s[3], *k = bound[j][b], wash = normalwash[leg][b] - normalwash[leg + 1][b];
        for (int axis = 0; axis < 3 && wings > 1; axis++) {
          r[axis] = point[b][axis] - from[axis];
          s[axis] = point[b][axis] - to[axis];
        }
        if (wings > 1) bound_influence(r, s, length, core, others[b], k);
        for (int axis = 0; axis < 3 && wings > 1; axis++) {
          k[axis] *= quarter_pi_inverse;
          wash -= k[axis] * normal[b][axis];
        }
        column[j][b] = gain[b] * feedthrough * wash;
      }
      column[j][j / LANES][j % LANES] += 1.0;
    }
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
  for (int j = 0; j < count && wings > 1; j++)
    for (int b = 0; b < blocks; b++)
      for (int axis = 0; axis < 3; axis++) velocity[b][axis] += circulation[j] * bound[j][b][axis];
  for (int i = 0; i < count; i++) {
    out[0][i] = circulation[i];
    for (int axis = 0; axis < 3; axis++)
      out[1][3 * i + axis] = velocity[i / LANES][axis][i % LANES];
  }
}

/* The derivative of `leg_influence` along dr, its leg's and its core's; and itself, k. */
static inline void leg_influence_forward(const lanes r[3], const double *d, double core,
                                         const lanes dr[3], const double *dd, double dcore,
                                         lanes ahead, lanes k[3], lanes dk[3]) {
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
  const lanes root = lanes_sqrt(square), h = 1.0 + ahead * along / root;
  const lanes dh = ahead * (dalong - along * dsquare / (2.0 * square)) / root;
  for (int axis = 0; axis < 3; axis++) {
    k[axis] = c[axis] * g * h;
    dk[axis] = dc[axis] * g * h + c[axis] * (dg * h + g * dh);
  }
}

/* The derivative of `bound_influence` along dr, ds, the length's and the core's; and itself, k. */
static inline void bound_influence_forward(const lanes r[3], const lanes s[3], const double *l,
                                           double core, const lanes dr[3], const lanes ds[3],
                                           const double *dl, double dcore, lanes others,
                                           lanes k[3], lanes dk[3]) {
  lanes c[3], dc[3], square = {0}, dsquare = {0}, r2 = {0}, s2 = {0}, rl = {0}, sl = {0};
  lanes dr2 = {0}, ds2 = {0}, drl = {0}, dsl = {0};
  double l2 = 0.0, dl2 = 0.0;
  for (int axis = 0; axis < 3; axis++) {
    const int i = (axis + 1) % 3, j = (axis + 2) % 3;
    c[axis] = r[i] * s[j] - r[j] * s[i];
    dc[axis] = dr[i] * s[j] + r[i] * ds[j] - dr[j] * s[i] - r[j] * ds[i];
    square += c[axis] * c[axis];
    dsquare += 2.0 * c[axis] * dc[axis];
    r2 += r[axis] * r[axis];
    s2 += s[axis] * s[axis];
    dr2 += 2.0 * r[axis] * dr[axis];
    ds2 += 2.0 * s[axis] * ds[axis];
    rl += r[axis] * l[axis];
    sl += s[axis] * l[axis];
    drl += dr[axis] * l[axis] + r[axis] * dl[axis];
    dsl += ds[axis] * l[axis] + s[axis] * dl[axis];
    l2 += l[axis] * l[axis];
    dl2 += 2.0 * l[axis] * dl[axis];
  }
  r2 += 1e-12 * core;
  s2 += 1e-12 * core;
  dr2 += 1e-12 * dcore;
  ds2 += 1e-12 * dcore;
  const lanes ri = 1.0 / lanes_sqrt(r2), si = 1.0 / lanes_sqrt(s2);
  const lanes along = rl * ri - sl * si;
  const lanes dalong = (drl - rl * dr2 / (2.0 * r2)) * ri - (dsl - sl * ds2 / (2.0 * s2)) * si;
  const lanes below = square + core * l2, dbelow = dsquare + dcore * l2 + core * dl2;
  const lanes f = others * along / below, df = (others * dalong - f * dbelow) / below;
  for (int axis = 0; axis < 3; axis++) {
    k[axis] = c[axis] * f;
    dk[axis] = dc[axis] * f + c[axis] * df;
  }
}

/* Its derivative along in[10..17], as CasADi asks for it; in[8] and in[9] are not looked at. */
static inline void fwd1_horseshoes_double(int numbers, const int *size, const double *const *in,
                                          double *const *out) {
  const int chains = numbers - 1, wings = *size++;
  const double feedthrough = in[7][0], dfeedthrough = in[17][0];
  const double quarter_pi_inverse = 0x1.45f306dc9c883p-4; /* 1/(4 pi) */
  const int count = sum_of(chains, size), legs = count + chains;
  const int blocks = (count + LANES - 1) / LANES;

  lanes point[blocks][3], normal[blocks][3], gain[blocks], wash[blocks];
  lanes dpoint[blocks][3], dnormal[blocks][3], dgain[blocks], dwash[blocks];
  lanes influence[legs][blocks][3], dinfluence[legs][blocks][3];
  lanes normalwash[legs][blocks], dnormalwash[legs][blocks], others[blocks];
  load_rows(count, 3, in[0], point[0]);
  load_rows(count, 3, in[1], normal[0]);
  load_rows(count, 1, in[5], gain);
  load_rows(count, 1, in[6], wash);
  load_rows(count, 3, in[10], dpoint[0]);
  load_rows(count, 3, in[11], dnormal[0]);
  load_rows(count, 1, in[15], dgain);
  load_rows(count, 1, in[16], dwash);
  for (int c = 0, leg = 0; c < chains; c++) {
    strips_of_others(c, chains, chains, size, blocks, others);
    for (int end = leg + size[c] + 1; leg < end; leg++)
      for (int b = 0; b < blocks; b++) {
        lanes r[3], dr[3], *k = influence[leg][b], *dk = dinfluence[leg][b];
        for (int axis = 0; axis < 3; axis++) {
          r[axis] = point[b][axis] - in[2][3 * leg + axis];
          dr[axis] = dpoint[b][axis] - in[12][3 * leg + axis];
        }
        leg_influence_forward(r, in[3] + 3 * leg, in[4][leg], dr, in[13] + 3 * leg, in[14][leg],
                              others[b], k, dk);
        normalwash[leg][b] = dnormalwash[leg][b] = lanes_broadcast(0.0);
        for (int axis = 0; axis < 3; axis++) {
          k[axis] *= quarter_pi_inverse;
          dk[axis] *= quarter_pi_inverse;
          normalwash[leg][b] += k[axis] * normal[b][axis];
          dnormalwash[leg][b] += dk[axis] * normal[b][axis] + k[axis] * dnormal[b][axis];
        }
      }
  }

  lanes matrix[count + 1][blocks], column[count + 1][blocks];
  lanes between[count][blocks], dbetween[count][blocks];
  lanes bound[count][blocks][3], dbound[count][blocks][3];
  memset(bound, 0, sizeof bound);
  memset(dbound, 0, sizeof dbound);
  for (int c = 0, j = 0, leg = 0; c < chains; c++, leg++) {
    strips_of_others(c, wings, chains, size, blocks, others);
    for (int end = j + size[c]; j < end; j++, leg++) {
      const double *from = in[2] + 3 * leg, *to = from + 3;
      const double *dfrom = in[12] + 3 * leg, *dto = dfrom + 3;
      const double length[3] = {to[0] - from[0], to[1] - from[1], to[2] - from[2]};
      const double dlength[3] = {dto[0] - dfrom[0], dto[1] - dfrom[1], dto[2] - dfrom[2]};
      const double core = 0.5 * (in[4][leg] + in[4][leg + 1]);
      const double dcore = 0.5 * (in[14][leg] + in[14][leg + 1]);
      for (int b = 0; b < blocks; b++) {
        lanes r[3], s[3], dr[3], ds[3], *k = bound[j][b], *dk = dbound[j][b];
        for (int axis = 0; axis < 3 && wings > 1; axis++) {
          r[axis] = point[b][axis] - from[axis];
          s[axis] = point[b][axis] - to[axis];
          dr[axis] = dpoint[b][axis] - dfrom[axis];
          ds[axis] = dpoint[b][axis] - dto[axis];
        }
        if (wings > 1)
          bound_influence_forward(r, s, length, core, dr, ds, dlength, dcore, others[b], k, dk);
        between[j][b] = normalwash[leg][b] - normalwash[leg + 1][b];
        dbetween[j][b] = dnormalwash[leg][b] - dnormalwash[leg + 1][b];
        for (int axis = 0; axis < 3 && wings > 1; axis++) {
          k[axis] *= quarter_pi_inverse;
          dk[axis] *= quarter_pi_inverse;
          between[j][b] -= k[axis] * normal[b][axis];
          dbetween[j][b] -= dk[axis] * normal[b][axis] + k[axis] * dnormal[b][axis];
        }
        matrix[j][b] = gain[b] * feedthrough * between[j][b];
      }
      matrix[j][j / LANES][j % LANES] += 1.0;
    }
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
    for (int j = 0; j < count; j++)
      matrix[count][b] -= circulation[j] * (dgained * between[j][b] + gained * dbetween[j][b]);
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
  for (int j = 0; j < count && wings > 1; j++)
    for (int b = 0; b < blocks; b++)
      for (int axis = 0; axis < 3; axis++)
        velocity[b][axis] += dcirculation[j] * bound[j][b][axis] +
                             circulation[j] * dbound[j][b][axis];
  for (int i = 0; i < count; i++) {
    out[0][i] = dcirculation[i];
    for (int axis = 0; axis < 3; axis++)
      out[1][3 * i + axis] = velocity[i / LANES][axis][i % LANES];
  }
}

/* The same for eight states, one after the other. */
typedef void horseshoes_of_one(int, const int *, const double *const *, double *const *);

static inline void horseshoes_in_turn(horseshoes_of_one *one, int inputs, int numbers,
                                      const int *size, const lanes *const *in, lanes *const *out) {
  const int count = sum_of(numbers - 1, size + 1), legs = count + numbers - 1;
  const int length[8] = {3 * count, 3 * count, 3 * legs, 3 * legs, legs, count, count, 1};
  for (int lane = 0; lane < LANES; lane++) {
    double storage[(9 * count + 7 * legs + 1) * (inputs / 8) + 4 * count], *from = storage;
    const double *arguments[inputs];
    for (int k = 0; k < inputs; k++) {
      arguments[k] = from;
      const int numbers = k < 8 ? length[k] : k < 10 ? 0 : length[k - 10];
      for (int i = 0; i < numbers; i++) *from++ = in[k][i][lane];
    }
    one(numbers, size, arguments, (double *const[]){from, from + count});
    for (int i = 0; i < count; i++) out[0][i][lane] = from[i];
    for (int i = 0; i < 3 * count; i++) out[1][i][lane] = from[count + i];
  }
}

static inline void horseshoes_lanes(int numbers, const int *size, const lanes *const *in,
                                    lanes *const *out) {
  horseshoes_in_turn(horseshoes_double, 8, numbers, size, in, out);
}

static inline void fwd1_horseshoes_lanes(int numbers, const int *size, const lanes *const *in,
                                         lanes *const *out) {
  horseshoes_in_turn(fwd1_horseshoes_double, 18, numbers, size, in, out);
}

#endif
