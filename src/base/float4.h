/*
 * Four numbers at a time, as every machine has them: GCC's and Clang's vector types, which the
 * compiler turns into the machine's own, with the same results everywhere, since each lane rounds
 * as a number alone does.
 */
#ifndef SPBM_BASE_FLOAT4_H
#define SPBM_BASE_FLOAT4_H

#include <stdint.h>
#include <string.h>

typedef float float4 __attribute__((vector_size(16)));
typedef uint32_t uint4 __attribute__((vector_size(16)));
typedef int32_t int4 __attribute__((vector_size(16))); /* of comparisons: 0 or -1 */
typedef double double4 __attribute__((vector_size(32)));
typedef int64_t long4 __attribute__((vector_size(32))); /* of comparisons of doubles */

/* The same in memory that is written and read as floats. (Through memcpy gcc 12 loads it into a
 * register of its own before each use.) */
typedef float float4_in_memory __attribute__((vector_size(16), may_alias));

/* From 16 bytes that lie on a multiple of 16. */
static inline float4 float4_load(const float *from)
{
    return *(const float4_in_memory *)(const void *)from;
}

static inline void float4_store(float *to, float4 value)
{
    *(float4_in_memory *)(void *)to = value;
}

/* a where the mask is set, else b. */
static inline float4 float4_choose(int4 mask, float4 a, float4 b)
{
    return (float4)((mask & (int4)a) | (~mask & (int4)b));
}

/* One bit a lane, of a mask. */
static inline unsigned float4_bits(float4 mask)
{
#if defined(__x86_64__)
    return (unsigned)__builtin_ia32_movmskps(mask);
#else
    uint32_t words[4];
    memcpy(words, &mask, sizeof words);
    return (words[0] >> 31) | (words[1] >> 31) << 1 | (words[2] >> 31) << 2 | (words[3] >> 31) << 3;
#endif
}

/* Rows become columns. */
static inline __attribute__((always_inline)) void float4_transpose(float4 r[4])
{
    const float4 a = __builtin_shufflevector(r[0], r[1], 0, 4, 1, 5);
    const float4 b = __builtin_shufflevector(r[0], r[1], 2, 6, 3, 7);
    const float4 c = __builtin_shufflevector(r[2], r[3], 0, 4, 1, 5);
    const float4 d = __builtin_shufflevector(r[2], r[3], 2, 6, 3, 7);
    r[0] = __builtin_shufflevector(a, c, 0, 1, 4, 5);
    r[1] = __builtin_shufflevector(a, c, 2, 3, 6, 7);
    r[2] = __builtin_shufflevector(b, d, 0, 1, 4, 5);
    r[3] = __builtin_shufflevector(b, d, 2, 3, 6, 7);
}

/* The dot products of a's and b's first three lanes with c's and d's, each (0 + 1) + 2, in the
 * first two lanes. */
static inline float4 float4_dots(float4 a, float4 c, float4 b, float4 d)
{
    const float4 p = a * c, q = b * d;
    const float4 low = __builtin_shufflevector(p, q, 0, 4, 1, 5);
    const float4 high = __builtin_shufflevector(p, q, 2, 6, 3, 7);
    return low + __builtin_shufflevector(low, low, 2, 3, 2, 3) + high;
}

/* The sum of the first three lanes, (0 + 1) + 2. */
static inline float float4_sum3(float4 a)
{
    return a[0] + a[1] + a[2];
}

#endif
