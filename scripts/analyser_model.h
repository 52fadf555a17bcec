/*
 * What clang's analyser must be told of functions in other files, as it sees one file at a time: a
 * failure is not STATUS_OK, and what was taken is there. scripts/analyse.sh includes it in front of
 * every file but the two that define these functions; no build does.
 */
#ifndef SPBM_ANALYSER_MODEL_H
#define SPBM_ANALYSER_MODEL_H

#include "base/memory.h"
#include "base/report.h"

static inline enum status analysed_failure(enum status status)
{
    if (status == STATUS_OK)
        __builtin_unreachable();
    return status;
}

static inline enum status analysed_taken(enum status status, const void *out)
{
    if (status == STATUS_OK && !*(void *const *)out)
        __builtin_unreachable();
    return status;
}

#define fail(...) analysed_failure(fail(__VA_ARGS__))
#define fail_errno(...) analysed_failure(fail_errno(__VA_ARGS__))
#define memory_take(ctx, count, size, out) analysed_taken(memory_take(ctx, count, size, out), out)
#define memory_take_zeroed(ctx, count, size, out)                                                  \
    analysed_taken(memory_take_zeroed(ctx, count, size, out), out)
#define memory_reserve(ctx, inout, capacity, needed, size)                                         \
    analysed_taken(memory_reserve(ctx, inout, capacity, needed, size), inout)

#endif
