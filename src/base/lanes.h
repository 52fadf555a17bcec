/*
 * Eight floats at a time, the same on any machine: GCC's and Clang's vector types, from which the
 * compiler makes two halves where vectors have four lanes. A kernel is written once as LANES_INLINE
 * and has two callers, one of them LANES_AVX2, chosen at run time by cpu.h; both do the same IEEE
 * operations in the same order (no fused multiply-add), so that their results are the same bits.
 *
 * (Left to find such loops by itself, a compiler may unroll them to single floats first.)
 */
#ifndef SPBM_BASE_LANES_H
#define SPBM_BASE_LANES_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#include "base/float4.h"

#define LANES_INLINE static inline __attribute__((always_inline))

#if defined(__x86_64__)
#define LANES_AVX2 __attribute__((target("avx2")))
#else
#define LANES_AVX2 /* never called */
#endif

enum { LANES = 8 };

typedef float float8 __attribute__((vector_size(32)));
typedef int32_t int8x32 __attribute__((vector_size(32))); /* of comparisons: 0 or -1 */

LANES_INLINE float8 lanes_load(const float *from)
{
    float8 v;
    memcpy(&v, from, sizeof v);
    return v;
}

LANES_INLINE void lanes_store(float *to, float8 v)
{
    memcpy(to, &v, sizeof v);
}

/* (As a shuffle: of a list of eight times the same, or of lanes set one by one, gcc 12 makes seven
 * insertions, not a broadcast, where the machine's level is that of the caller alone.) */
LANES_INLINE float8 lanes_all(float x)
{
    const float8 v = {x};
    return __builtin_shufflevector(v, v, 0, 0, 0, 0, 0, 0, 0, 0);
}

/* first, first + 1, ... */
LANES_INLINE int8x32 lanes_count_from(uint32_t first)
{
    const int8x32 steps = {0, 1, 2, 3, 4, 5, 6, 7};
    return steps + (int32_t)first;
}

/* a where the mask is set, 0 elsewhere. */
LANES_INLINE float8 lanes_where(int8x32 mask, float8 a)
{
    return (float8)(mask & (int8x32)a);
}

LANES_INLINE float8 lanes_choose(int8x32 mask, float8 a, float8 b)
{
    return (float8)((mask & (int8x32)a) | (~mask & (int8x32)b));
}

LANES_INLINE float8 lanes_sqrt(float8 v)
{
    for (int i = 0; i < LANES; i++)
        v[i] = sqrtf(v[i]);
    return v;
}

LANES_INLINE float8 lanes_least(float8 a, float8 b)
{
    return lanes_choose(a < b, a, b);
}

/* The least of the eight, in all of them. */
LANES_INLINE float8 lanes_all_least(float8 v)
{
    v = lanes_least(v, __builtin_shufflevector(v, v, 4, 5, 6, 7, 0, 1, 2, 3));
    v = lanes_least(v, __builtin_shufflevector(v, v, 2, 3, 0, 1, 6, 7, 4, 5));
    return lanes_least(v, __builtin_shufflevector(v, v, 1, 0, 3, 2, 5, 4, 7, 6));
}

LANES_INLINE float4 lanes_low(float8 v)
{
    return __builtin_shufflevector(v, v, 0, 1, 2, 3);
}

LANES_INLINE float4 lanes_high(float8 v)
{
    return __builtin_shufflevector(v, v, 4, 5, 6, 7);
}

/* One bit a lane. */
LANES_INLINE unsigned lanes_bits(int8x32 mask)
{
    return float4_bits(lanes_low((float8)mask)) | float4_bits(lanes_high((float8)mask)) << 4;
}

LANES_INLINE bool lanes_any(int8x32 mask)
{
    return lanes_bits(mask) != 0;
}

/* The lane of the lowest bit, of which there is one. */
LANES_INLINE unsigned lowest_bit(unsigned bits)
{
    return (unsigned)__builtin_ctz(bits);
}

/* Sum in a fixed order. */
LANES_INLINE float lanes_sum(float8 s)
{
    return ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]));
}

LANES_INLINE float lanes_largest(float8 v)
{
    float largest = v[0];
    for (int i = 1; i < LANES; i++)
        largest = v[i] > largest ? v[i] : largest;
    return largest;
}

/* Rows become columns. */
LANES_INLINE void lanes_transpose(float8 r[8])
{
    float8 a[8], b[8];
    for (int i = 0; i < 8; i += 2) {
        a[i] = __builtin_shufflevector(r[i], r[i + 1], 0, 8, 1, 9, 4, 12, 5, 13);
        a[i + 1] = __builtin_shufflevector(r[i], r[i + 1], 2, 10, 3, 11, 6, 14, 7, 15);
    }
    for (int i = 0; i < 8; i += 4)
        for (int k = 0; k < 2; k++) {
            b[i + 2 * k] =
                __builtin_shufflevector(a[i + k], a[i + k + 2], 0, 1, 8, 9, 4, 5, 12, 13);
            b[i + 2 * k + 1] =
                __builtin_shufflevector(a[i + k], a[i + k + 2], 2, 3, 10, 11, 6, 7, 14, 15);
        }
    for (int i = 0; i < 4; i++) {
        r[i] = __builtin_shufflevector(b[i], b[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        r[i + 4] = __builtin_shufflevector(b[i], b[i + 4], 4, 5, 6, 7, 12, 13, 14, 15);
    }
}

/* Three coordinates, eight of each. */
struct vec3x8 {
    float8 x, y, z;
};

LANES_INLINE struct vec3x8 lanes_load3(const float *x, const float *y, const float *z)
{
    return (struct vec3x8){lanes_load(x), lanes_load(y), lanes_load(z)};
}

LANES_INLINE struct vec3x8 lanes_sub(struct vec3x8 a, struct vec3x8 b)
{
    return (struct vec3x8){a.x - b.x, a.y - b.y, a.z - b.z};
}

LANES_INLINE struct vec3x8 lanes_cross(struct vec3x8 a, struct vec3x8 b)
{
    return (struct vec3x8){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

LANES_INLINE float8 lanes_dot(struct vec3x8 a, struct vec3x8 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

#endif
