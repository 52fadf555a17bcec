/*
 * Sharp loops (dissertation, 5.3.1): where the rims of small holes, bumps and cavities run, and on
 * which side of them the surface is flat.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_RIMS_H
#define SPBM_SIMPLIFY_TOPOLOGY_RIMS_H

#include "simplify/topology_loops.h"

struct rim_options {
    double size; /* loops smaller than it can be rims; a length */
    enum loop_measure measure;
    double noise; /* a length: the normals of triangles thinner than it say nothing */
    double
        sharp_cosine[2]; /* an edge is sharp when the cosine of its angle is between [1] and [0] */
};

/* A loop that is not small and flat on one side, found between two smooth regions. */
struct large_loop {
    uint32_t first; /* half-edge */
    struct vec3 normal;
};

struct rim_set {
    uint8_t
        *strength; /* a half-edge: 0, or how surely its own patch lies on the flat side of a rim */
    size_t half_edge_count;
    struct large_loop *large;
    size_t large_count, large_capacity;
    uint64_t rim_count;
};

/* Of two half-edges of an edge, the one whose patch is on the flat side; NO_INDEX: no rim. */
static inline uint32_t rim_flat_side(const struct rim_set *rims, uint32_t edge)
{
    uint8_t a = rims->strength[2 * (size_t)edge], b = rims->strength[2 * (size_t)edge + 1];
    return a > b ? 2 * edge : b > a ? 2 * edge + 1 : NO_INDEX;
}

/* `rims` is all zero before; the caller releases it. Patches with skip[patch] != NO_INDEX are
 * looked over. */
enum status rims_find(struct chain_graph *graph, const struct rim_options *options,
                      const uint32_t *skip, struct rim_set *rims) MUST_CHECK;
void rim_set_clear(struct context *ctx, struct rim_set *rims);

#endif
