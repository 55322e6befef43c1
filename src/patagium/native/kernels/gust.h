/* What the strips of wings meet of a gust that travels: gusts.gusts_at_strips.

   A gust is a row of cubics in time between knots, constant before the first and after the
   last one; what is met has lost a share of 1 - exp(decay (knot - time)) on its way. The points
   of a chord, y = cos(angle) from -1 at the trailing to 1 at the leading
   edge, meet it at time - delay - spread y. Neglected: see gusts.py.
*/

#ifndef PATAGIUM_GUST_H
#define PATAGIUM_GUST_H

#include <math.h>

#define PI 3.14159265358979323846

enum { MET = 9 }; /* mean, first moment and rate of a strip, a vector each */

/* The first piece that begins after a time: how many knots are not later. */
static long gust_piece(long knots, const double *knot, double time)
{
    long low = 0, high = knots;
    while (low < high) {
        const long middle = low + (high - low) / 2;
        if (knot[middle] <= time)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Integrals of cos^k over angles from zero to arccos y, k = 0..5. */
static void gust_integrals(double y, double *found)
{
    const double sine = sqrt(fmax(1.0 - y * y, 0.0));
    double power = sine;
    found[0] = acos(y);
    found[1] = sine;
    for (int k = 2; k < 6; ++k) {
        power *= y;
        found[k] = power / k + (k - 1.0) / k * found[k - 2];
    }
}

/* What a part of the chord adds to the nine numbers.

   a: (4, 3), g = fade sum_m a_m (offset + slope y)^m. rates: of offset and slope. between:
   integrals of y^k over the part, (6,). decay: of g in time. */
static void gust_add(const double *a, double offset, double slope, const double *rates,
                     const double *between, double fade, double decay, double *met)
{
    double powers[4][4] = {{1.0}};
    for (int m = 1; m < 4; ++m)
        for (int k = 0; k <= m; ++k)
            powers[m][k] = powers[m - 1][k] * offset + (k ? powers[m - 1][k - 1] * slope : 0.0);
    for (int axis = 0; axis < 3; ++axis) {
        double value[4] = {0.0}, change[4] = {0.0};
        for (int k = 0; k < 4; ++k) {
            for (int m = k; m < 4; ++m)
                value[k] += fade * a[3 * m + axis] * powers[m][k];
            met[axis] += value[k] * between[k] / PI;
            met[3 + axis] += value[k] * between[k + 1] / PI;
            for (int m = k; m < 3; ++m)
                change[k] += fade * (m + 1) * a[3 * (m + 1) + axis] * powers[m][k];
        }
        for (int k = 0; k < 4; ++k) {
            const double rate = change[k] * rates[0] + (k ? change[k - 1] * rates[1] : 0.0) -
                                decay * value[k];
            met[6 + axis] += rate * (between[k] - between[k + 2]) * (2.0 / PI);
        }
    }
}

/* What all strips meet, (9, strips) with the strips one after the other.

   knot: (knots,). cubics: (knots + 1, 4, 3). delays: (4, strips), strip after strip: delay of
   mid-chord, how much later the leading edge is, and the rates of both. decay: [1/s]. */
static void gust_meet(long knots, const double *knot, const double *cubics, double decay,
                      double time, long strips, const double *delays, double *met)
{
    for (long strip = 0; strip < strips; ++strip, delays += 4, met += MET) {
        const double middle = time - delays[0], spread = delays[1];
        const double rates[2] = {1.0 - delays[2], -delays[3]};
        const double side = spread < 0.0 ? -1.0 : 1.0;
        for (int k = 0; k < MET; ++k)
            met[k] = 0.0;
        if (!isfinite(middle) || !isfinite(spread)) {
            met[0] = NAN; /* a state that broke breaks what it meets */
            continue;
        }
        double begin[6], end[6], between[6];
        gust_integrals(side, begin);
        const long last = gust_piece(knots, knot, middle + fabs(spread));
        for (long piece = gust_piece(knots, knot, middle - fabs(spread));; ++piece) {
            const double at = piece < last ? (middle - knot[piece]) / spread : -side;
            gust_integrals(fmin(fmax(at, -1.0), 1.0), end);
            for (int k = 0; k < 6; ++k) {
                between[k] = side * (end[k] - begin[k]);
                begin[k] = end[k];
            }
            const double anchor = knot[piece > 0 ? piece - 1 : 0];
            const double fade = decay > 0.0 ? exp(decay * (anchor - time)) : 1.0;
            gust_add(cubics + 12 * piece, middle - anchor, -spread, rates, between, fade, decay,
                     met);
            if (piece >= last)
                break;
        }
    }
}

#endif
