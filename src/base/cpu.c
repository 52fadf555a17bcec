/*
 * The CPU level at run time: one binary for all machines, and tests that run every form that the
 * machine has by lowering the cap. The compiler's own query also asks whether the system saves the
 * wide registers, which a bare CPUID would not say.
 */
#include "base/cpu.h"

static enum cpu_level machine_level(unsigned cap)
{
#if defined(__x86_64__) || defined(__i386__)
    __builtin_cpu_init();
    if (cap >= CPU_AVX512 && __builtin_cpu_supports("avx512f") &&
        __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
        __builtin_cpu_supports("avx512bw"))
        return CPU_AVX512;
    if (cap >= CPU_AVX2 && __builtin_cpu_supports("avx2"))
        return CPU_AVX2;
#elif defined(__aarch64__)
    if (cap >= CPU_NEON)
        return CPU_NEON;
#endif
    (void)cap;
    return CPU_SCALAR;
}

enum cpu_level cpu_level(const struct context *ctx)
{
    return machine_level(ctx->cpu_level_cap);
}

const char *cpu_level_name(enum cpu_level level)
{
    switch (level) {
    case CPU_NEON:
        return "neon";
    case CPU_AVX2:
        return "avx2";
    case CPU_AVX512:
        return "avx512";
    case CPU_SCALAR:
        break;
    }
    return "scalar";
}
