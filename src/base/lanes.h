/*
 * Loops over the lanes of a vector: written once, compiled for the machine that all have (the
 * reference) and again for AVX2, chosen at run time by cpu.h. Both do the same IEEE operations in
 * the same order (no fused multiply-add), so that their results are the same bits.
 */
#ifndef SPBM_BASE_LANES_H
#define SPBM_BASE_LANES_H

#define LANES_INLINE static inline __attribute__((always_inline))

#if defined(__x86_64__)
#define LANES_AVX2 __attribute__((target("avx2")))
#else
#define LANES_AVX2 /* never called */
#endif

/* Sum of eight lanes, in a fixed order. */
static inline float lanes_sum(const float s[8])
{
    return ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]));
}

#endif
