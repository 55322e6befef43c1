/* Numbers side by side, as many as the processor's vectors hold, in GCC and clang
 * vector extensions. Wider ones than it has would compile, and run ten times slower.
 *
 * Selection is by bits, so nothing here branches.
 */
#ifndef PATAGIUM_LANES_H
#define PATAGIUM_LANES_H

#include <stdint.h>
#include <string.h>

#if defined(__AVX512F__)
#define LANES 8
#elif defined(__AVX__)
#define LANES 4
#else
#define LANES 2
#endif

typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef int64_t ilanes __attribute__((vector_size(8 * LANES)));

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

#endif
