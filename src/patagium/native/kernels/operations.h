/* The operations of generated functions, for one number and for several.
 *
 * Those without a vector form are taken lane by lane; the compiler vectorises
 * what it can (square root, absolute value, comparisons).
 */
#ifndef PATAGIUM_OPERATIONS_H
#define PATAGIUM_OPERATIONS_H

#include <math.h>

#include "lanes.h"
#include "trigonometry.h"

/* Entries of the states from k on, side by side; the last state fills what is missing. */
static inline void gather(const double *a, long size, long k, long count, double *tile) {
  for (int lane = 0; lane < LANES; lane++) {
    const double *row = a + (k + lane < count ? k + lane : count - 1) * size;
    for (long entry = 0; entry < size; entry++) tile[entry * LANES + lane] = row[entry];
  }
}

#define UNARY_OPERATION(name, expression) \
  static inline double scalar_##name(double x) { return expression; } \
  static inline lanes lanes_##name(lanes x) { \
    lanes r; \
    for (int lane = 0; lane < LANES; lane++) r[lane] = scalar_##name(x[lane]); \
    return r; \
  }

#define BINARY_OPERATION(name, expression) \
  static inline double scalar_##name(double x, double y) { return expression; } \
  static inline lanes lanes_##name(lanes x, lanes y) { \
    lanes r; \
    for (int lane = 0; lane < LANES; lane++) r[lane] = scalar_##name(x[lane], y[lane]); \
    return r; \
  }

UNARY_OPERATION(exp, exp(x))
UNARY_OPERATION(log, log(x))
UNARY_OPERATION(log1p, log1p(x))
UNARY_OPERATION(expm1, expm1(x))
UNARY_OPERATION(sqrt, sqrt(x))
UNARY_OPERATION(tan, tan(x))
UNARY_OPERATION(asin, asin(x))
UNARY_OPERATION(acos, acos(x))
UNARY_OPERATION(atan, atan(x))
UNARY_OPERATION(sinh, sinh(x))
UNARY_OPERATION(cosh, cosh(x))
UNARY_OPERATION(tanh, tanh(x))
UNARY_OPERATION(fabs, fabs(x))
UNARY_OPERATION(floor, floor(x))
UNARY_OPERATION(ceil, ceil(x))
UNARY_OPERATION(sign, (x > 0) - (x < 0))
UNARY_OPERATION(not, x == 0)
BINARY_OPERATION(pow, pow(x, y))
BINARY_OPERATION(atan2, atan2(x, y))
BINARY_OPERATION(fmin, x < y ? x : y)
BINARY_OPERATION(fmax, x > y ? x : y)
BINARY_OPERATION(fmod, fmod(x, y))
BINARY_OPERATION(hypot, hypot(x, y))
BINARY_OPERATION(copysign, copysign(x, y))
BINARY_OPERATION(lt, x < y)
BINARY_OPERATION(le, x <= y)
BINARY_OPERATION(eq, x == y)
BINARY_OPERATION(ne, x != y)
BINARY_OPERATION(and, x != 0 && y != 0)
BINARY_OPERATION(or, x != 0 || y != 0)
BINARY_OPERATION(if_else_zero, x != 0 ? y : 0.0)

#undef UNARY_OPERATION
#undef BINARY_OPERATION

#endif
