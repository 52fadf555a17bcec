/*
 * Unordered pairs of vertices: the edges that must not be there twice.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_PAIRS_H
#define SPBM_SIMPLIFY_TOPOLOGY_PAIRS_H

#include "base/report.h"

/* Grows; all zero is empty. */
struct pair_set {
    uint64_t *pairs; /* 0: empty; a vertex pair never is, for its larger number is not 0 */
    size_t capacity; /* a power of two, or 0 */
    size_t count;
};

void pair_set_clear(struct context *ctx, struct pair_set *set);
enum status pair_set_add(struct context *ctx, struct pair_set *set, uint32_t a,
                         uint32_t b) MUST_CHECK;
bool pair_set_has(const struct pair_set *set, uint32_t a, uint32_t b);

#endif
