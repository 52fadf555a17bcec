/*
 * Four floats at a time, as every machine has them: with a form of vectors that gcc and clang turn
 * into the machine's own, and the same results everywhere, since each lane rounds like a float.
 */
#ifndef SPBM_SIMPLIFY_FLOAT4_H
#define SPBM_SIMPLIFY_FLOAT4_H

typedef float float4 __attribute__((vector_size(16), may_alias));

/* From 16 bytes that lie on a multiple of 16. */
static inline float4 float4_load(const float *from)
{
    return *(const float4 *)(const void *)from;
}

static inline void float4_store(float *to, float4 value)
{
    *(float4 *)(void *)to = value;
}

/* The dot products of a's and b's first three lanes with c's and d's, each (0 + 1) + 2, in the
 * first two lanes. */
static inline float4 float4_dots(float4 a, float4 c, float4 b, float4 d)
{
    float4 p = a * c, q = b * d;
    float4 low = __builtin_shufflevector(p, q, 0, 4, 1, 5);
    float4 high = __builtin_shufflevector(p, q, 2, 6, 3, 7);
    return low + __builtin_shufflevector(low, low, 2, 3, 2, 3) + high;
}

/* The sum of the first three lanes, (0 + 1) + 2. */
static inline float float4_sum3(float4 a)
{
    return a[0] + a[1] + a[2];
}

#endif
