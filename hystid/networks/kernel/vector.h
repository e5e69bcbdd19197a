/* Vectors of REAL and their tanh, in the vector extension that gcc and clang share; no library behind it.
 *
 * tanh(x) = s e / (e + 2), e = exp(2|x|) - 1 = 2^n p(r) + (2^n - 1), 2|x| = n ln 2 + r, |r| <= ln 2 / 2, with p the Taylor
 * polynomial of exp(r) - 1. Forming e rather than exp(2|x|) keeps the relative error at a few units in the last place
 * near x = 0. n comes from adding 1.5 * 2^(mantissa bits): the sum's low bits are then n, which needs no conversion. */
#ifndef HYSTID_VECTOR_H
#define HYSTID_VECTOR_H

#include <stdint.h>
#include <string.h>

#ifdef SINGLE
typedef float REAL;
typedef int32_t BITS;
#define MANTISSA 23
#define EXPONENT_BIAS 127
#define SATURATION 10.0f          /* tanh(10) is 1 in single precision */
#else
typedef double REAL;
typedef int64_t BITS;
#define MANTISSA 52
#define EXPONENT_BIAS 1023
#define SATURATION 20.0           /* tanh(20) is 1 in double precision */
#endif

#ifndef VECTOR_BYTES
#define VECTOR_BYTES 64
#endif
#define LANES ((int)(VECTOR_BYTES / sizeof(REAL)))

typedef REAL vec __attribute__((vector_size(VECTOR_BYTES)));
typedef BITS bits __attribute__((vector_size(VECTOR_BYTES)));

static inline vec splat(REAL value) {
    return (vec){0} + value;
}

static inline vec vtanh(vec x) {
    const REAL ln2_high = (REAL)0x1.62e42p-1, ln2_low = (REAL)(0x1.62e42fefa39efp-1 - 0x1.62e42p-1);
    const REAL shift = (REAL)1.5 * ((BITS)1 << MANTISSA);
    const BITS sign_bit = (BITS)((uint64_t)1 << (8 * sizeof(REAL) - 1));
    bits sign = (bits)x & sign_bit;
    vec y = (vec)((bits)x & ~sign_bit);
    bits large = y > SATURATION;
    y = (vec)(((bits)splat(SATURATION) & large) | ((bits)y & ~large));
    y += y;
    vec shifted = y * (REAL)1.4426950408889634 + shift;
    vec n = shifted - shift;
    vec r = (y - n * ln2_high) - n * ln2_low;
    vec power = (vec)(((bits)shifted - (bits)splat(shift) + EXPONENT_BIAS) << MANTISSA);
#ifdef SINGLE
    vec p = r * (REAL)(1 / 5040.0) + (REAL)(1 / 720.0);
#else
    vec p = r * (REAL)(1 / 6227020800.0) + (REAL)(1 / 479001600.0);
    p = p * r + (REAL)(1 / 39916800.0);
    p = p * r + (REAL)(1 / 3628800.0);
    p = p * r + (REAL)(1 / 362880.0);
    p = p * r + (REAL)(1 / 40320.0);
    p = p * r + (REAL)(1 / 5040.0);
    p = p * r + (REAL)(1 / 720.0);
#endif
    p = p * r + (REAL)(1 / 120.0);
    p = p * r + (REAL)(1 / 24.0);
    p = p * r + (REAL)(1 / 6.0);
    p = p * r + (REAL)0.5;
    p = (p * r) * r + r;
    vec e = p * power + (power - 1);
    return (vec)((bits)(e / (e + 2)) | sign);
}

#endif
