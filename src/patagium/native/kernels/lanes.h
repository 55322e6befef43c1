/* Eight numbers side by side, in GCC and clang vector extensions.
 *
 * The compiler lowers them to whatever the processor has (AVX-512, AVX2, SSE,
 * NEON). Selection is by bits, so nothing here branches.
 */
#ifndef PATAGIUM_LANES_H
#define PATAGIUM_LANES_H

#include <stdint.h>
#include <string.h>

#define LANES 8

typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef int64_t ilanes __attribute__((vector_size(8 * LANES)));
typedef float lanesf __attribute__((vector_size(4 * LANES)));
typedef int32_t ilanesf __attribute__((vector_size(4 * LANES)));

static inline lanes lanes_broadcast(double x) { return x - (lanes){0}; }

static inline lanes lanes_load(const double *p) {
  lanes x;
  memcpy(&x, p, sizeof x);
  return x;
}

static inline void lanes_store(double *p, lanes x) { memcpy(p, &x, sizeof x); }

/* a where mask is all ones, b where it is zero. */
static inline lanes lanes_select(ilanes mask, lanes a, lanes b) {
  return (lanes)((mask & (ilanes)a) | (~mask & (ilanes)b));
}

static inline lanesf lanesf_broadcast(float x) { return x - (lanesf){0}; }

static inline lanesf lanesf_select(ilanesf mask, lanesf a, lanesf b) {
  return (lanesf)((mask & (ilanesf)a) | (~mask & (ilanesf)b));
}

#endif
