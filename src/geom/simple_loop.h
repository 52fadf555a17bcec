/*
 * Is a closed loop of straight edges simple, that is, does no edge touch another except its two
 * neighbours in their common point?
 */
#ifndef SPBM_GEOM_SIMPLE_LOOP_H
#define SPBM_GEOM_SIMPLE_LOOP_H

#include "base/report.h"
#include "geom/predicates.h"

/* Scratch that grows and is reused from call to call; all zero at first. */
struct scratch {
    unsigned char *block;
    size_t size;
};

/* At least `size` bytes at scratch->block; what was there is lost when it grows. */
enum status scratch_reserve(struct context *ctx, struct scratch *scratch, size_t size) MUST_CHECK;
void scratch_clear(struct context *ctx, struct scratch *scratch);

/* A point's place in an order; sorted by key, ties by index. */
struct grid_key {
    uint64_t key;
    uint32_t index;
};

/* Sorts in O(n log n); `other` is room for as many. The result is in `keys`. */
void sort_grid_keys(struct grid_key *keys, struct grid_key *other, uint32_t count);

/* The order of points by x, then y, in `order`, which has room for twice as many. */
void sort_grid_points(const struct grid_point *points, uint32_t count, struct grid_key *order);

/* Edges run from each point to the next and from the last to the first; n is at least 3. O(n log n)
 * for any loop; nothing is allocated for small or convex ones. */
enum status loop_is_simple(struct context *ctx, struct scratch *scratch,
                           const struct grid_point *points, uint32_t n, bool *simple) MUST_CHECK;

#endif
