/* Activation functions of networks over one vector of numbers at once.
 *
 * REAL is double or float; a vector is what the processor has (AVX-512: 64 bytes, AVX: 32,
 * else 16), since compilers lower wider ones badly. Both activations stand on
 * expm1(-x), x >= 0: reduction by ln 2, then a polynomial (Chebyshev fit, error
 * below half a unit in the last place). Errors, checked by the tests: 2 units in
 * the last place. No branches; NaN in, NaN out; infinite in, NaN out.
 */
#ifndef PATAGIUM_ACTIVATIONS_H
#define PATAGIUM_ACTIVATIONS_H

#include <stdint.h>
#include <string.h>

#ifndef REAL
#define REAL double
#endif
#ifndef SINGLE
#define SINGLE 0 /* 1 where REAL is float */
#endif

#if SINGLE
typedef int32_t bits;
#define SIGN ((bits)0x80000000)
#define MANTISSA 23
#define EXPONENT_BIAS 127
#define ROUNDING 0x1.8p23f
#define LARGEST 87.0f
#define LN2_HIGH 0x1.62e4p-1f
#define LN2_LOW 0x1.7f7d1cp-20f
#else
typedef int64_t bits;
#define SIGN ((bits)0x8000000000000000)
#define MANTISSA 52
#define EXPONENT_BIAS 1023
#define ROUNDING 0x1.8p52
#define LARGEST 708.0
#define LN2_HIGH 0x1.62e42fefa3800p-1
#define LN2_LOW 0x1.ef35793c76730p-45
#endif

#if defined(__AVX512F__)
#define VECTOR_BYTES 64
#elif defined(__AVX__)
#define VECTOR_BYTES 32
#else
#define VECTOR_BYTES 16
#endif
#define WIDTH ((int)(VECTOR_BYTES / sizeof(REAL)))
#define R(x) ((REAL)(x))

typedef REAL reals __attribute__((vector_size(VECTOR_BYTES)));
typedef bits masks __attribute__((vector_size(VECTOR_BYTES)));
typedef REAL halves __attribute__((vector_size(VECTOR_BYTES / 2)));

static inline reals reals_all(REAL x) { return x - (reals){0}; }

static inline reals reals_load(const REAL *p) {
  reals x;
  memcpy(&x, p, sizeof x);
  return x;
}

/* A vector that several sums use stays in a register: GCC would load it again for each. */
#if defined(__x86_64__)
#define IN_REGISTER(x) __asm__("" : "+v"(x))
#else
#define IN_REGISTER(x) (void)(x)
#endif

static inline void reals_store(REAL *p, reals x) { memcpy(p, &x, sizeof x); }

static inline reals reals_magnitude(reals x) { return (reals)((masks)x & ~SIGN); }

/* b where a > b, else a (NaN stays). */
static inline reals reals_at_most(reals a, REAL b) {
  masks above = (masks)(a > b);
  return (reals)((above & (masks)reals_all(b)) | (~above & (masks)a));
}

/* expm1(-x) for x >= 0, and e^(-x) in *whole. */
static inline reals reals_decay(reals x, reals *whole) {
  reals y = -reals_at_most(x, LARGEST);
  reals shifted = y * R(0x1.71547652b82fep0) + ROUNDING;
  reals k = shifted - ROUNDING;
  reals r = (y - k * LN2_HIGH) - k * LN2_LOW;
#if SINGLE
  reals p = 0.0013926183587713494542f * r + 0.0083631790527225773704f;
  p = p * r + 0.041666554617204574203f;
  p = p * r + 0.16666576989698775683f;
  p = p * r + 0.5f;
#else
  reals p = 2.5100385495510319078e-8 * r + 2.7620088445409748161e-7;
  p = p * r + 2.7557268459997064772e-6;
  p = p * r + 0.000024801521295954375131;
  p = p * r + 0.00019841269863053616878;
  p = p * r + 0.0013888888917213716901;
  p = p * r + 0.0083333333333300618325;
  p = p * r + 0.041666666666624127873;
  p = p * r + 0.16666666666666667453;
  p = p * r + 0.50000000000000010221;
#endif
  p = p * (r * r) + r;
  reals scale = (reals)(((masks)shifted + EXPONENT_BIAS) << MANTISSA);
  *whole = p * scale + scale;
  return p * scale + (scale - R(1));
}

/* softplus(z) = ln(1 + e^z) = max(z, 0) + ln(1 + e^-|z|), ln(1 + e) = 2 atanh(e / (2 + e)). */
static inline reals reals_softplus(reals z) {
  reals magnitude = reals_magnitude(z), e;
  reals_decay(magnitude, &e);
  reals s = e / (e + R(2));
  reals t = s * s;
#if SINGLE
  reals p = 0.11612164612011674416f * t + 0.10853287900440186323f;
  p = p * t + 0.14296178997151418861f;
  p = p * t + 0.19999853165964858701f;
  p = p * t + 0.33333333660263706234f;
#else
  reals p = 0.080820228059717661105 * t + 0.044003692430723369411;
  p = p * t + 0.060005364047953562676;
  p = p * t + 0.066570721048274680752;
  p = p * t + 0.076927850324793115517;
  p = p * t + 0.090908947180664290846;
  p = p * t + 0.11111111358713931495;
  p = p * t + 0.14285714283554378581;
  p = p * t + 0.20000000000007291337;
  p = p * t + 0.33333333333333329281;
#endif
  reals twice = s + s;
  return (z + magnitude) * R(0.5) + (p * t * twice + twice);
}

/* tanh(z) = -m / (2 + m), m = expm1(-2|z|), with the sign of z. */
static inline reals reals_tanh(reals z) {
  reals whole;
  reals m = reals_decay(reals_magnitude(z) * R(2), &whole);
  reals t = reals_magnitude(m / (m + R(2)));
  return (reals)((masks)t | ((masks)z & SIGN));
}

#endif
