/* Sine and cosine of several angles at once, without branches.
 *
 * Reduction by pi/2 in three parts of 33 bits (exact products up to 2^20 turns),
 * then the minimax polynomials of Sun's fdlibm (k_sin.c, k_cos.c: coefficients);
 * error below one unit in the last place. Angles beyond 1e5 rad, infinities and
 * NaN go to the C library.
 */
#ifndef PATAGIUM_TRIGONOMETRY_H
#define PATAGIUM_TRIGONOMETRY_H

#include <math.h>

#include "lanes.h"

static inline void lanes_sincos(lanes x, lanes *sine, lanes *cosine) {
  const double magic = 0x1.8p52; /* adding it rounds to an integer in the low bits */
  lanes shifted = x * 0x1.45f306dc9c883p-1 + magic;
  ilanes quadrant = (ilanes)shifted;
  lanes turns = shifted - magic;
  lanes r = x - turns * 0x1.921fb544p+0;
  r = r - turns * 0x1.0b4611a6p-34;
  r = r - turns * 0x1.3198a2e037073p-69;
  lanes z = r * r;
  lanes s = 1.58969099521155010221e-10 * z - 2.50507602534068634195e-08;
  s = s * z + 2.75573137070700676789e-06;
  s = s * z - 1.98412698298579493134e-04;
  s = s * z + 8.33333333332248946124e-03;
  s = s * z - 1.66666666666666324348e-01;
  s = r + (r * z) * s;
  lanes c = -1.13596475577881948265e-11 * z + 2.08757232129817482790e-09;
  c = c * z - 2.75573143513906633035e-07;
  c = c * z + 2.48015872894767294178e-05;
  c = c * z - 1.38888888888741095749e-03;
  c = c * z + 4.16666666666666019037e-02;
  lanes half = 0.5 * z;
  lanes w = 1.0 - half;
  c = w + (((1.0 - w) - half) + z * z * c);
  ilanes swap = -(quadrant & 1);
  ilanes flip_sine = (quadrant & 2) << 62;
  ilanes flip_cosine = ((quadrant + 1) & 2) << 62;
  *sine = (lanes)((ilanes)lanes_select(swap, c, s) ^ flip_sine);
  *cosine = (lanes)((ilanes)lanes_select(swap, s, c) ^ flip_cosine);
  for (int lane = 0; lane < LANES; lane++) {
    if (__builtin_expect(!(x[lane] > -1e5 && x[lane] < 1e5), 0)) {
      (*sine)[lane] = sin(x[lane]);
      (*cosine)[lane] = cos(x[lane]);
    }
  }
}

/* Sines and cosines of `count` angles; the arrays hold a multiple of eight. */
static inline void sincos_many(int count, const double *x, double *sine, double *cosine) {
  for (int k = 0; k < count; k += LANES) {
    lanes s, c;
    lanes_sincos(lanes_load(x + k), &s, &c);
    lanes_store(sine + k, s);
    lanes_store(cosine + k, c);
  }
}

#endif
