/*
 * Which vector instructions this machine has. Kernels come in a scalar form, which is the
 * reference, and in faster forms with the same bits as result; the level says which to call.
 */
#ifndef SPBM_BASE_CPU_H
#define SPBM_BASE_CPU_H

#include "report.h"

/* Ordered so that a cap (context.cpu_level_cap) is one comparison; a machine has scalar and either
 * NEON or the two others. */
enum cpu_level {
    CPU_SCALAR = 0,
    CPU_NEON = 1,   /* aarch64: always there */
    CPU_AVX2 = 2,   /* with FMA left unused: it would change results */
    CPU_AVX512 = 3, /* F, DQ, VL and BW */
};

/* The best level of this machine that is not above ctx->cpu_level_cap. Ask once a stage. */
enum cpu_level cpu_level(const struct context *ctx);

/* A word for reports: "scalar", "neon", "avx2", "avx512". */
const char *cpu_level_name(enum cpu_level level);

#endif
