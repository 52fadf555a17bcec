/*
 * From labels to records: traces the chains between the patches of one slab, sums up the patches,
 * and notes what the slab's seams need to be joined (seam_join.h). See patch.h for P1 to P3.
 */
#ifndef SPBM_SIMPLIFY_CHAIN_TRACE_H
#define SPBM_SIMPLIFY_CHAIN_TRACE_H

#include "simplify/patch.h"
#include "simplify/patchify.h"

/* One edge between two slabs, as one of them sees it. */
struct seam_edge {
    uint64_t key; /* lower store vertex << 32 | higher */
    uint32_t slab;
    uint32_t
        side; /* patch << 1 | 1 when the slab's face runs from the higher vertex to the lower */
};

/* What one slab knows of its seams. Owned by whoever called chain_trace. */
struct slab_seams {
    struct seam_edge *edges;
    size_t edge_count;
    uint32_t *junctions; /* store numbers of the seam vertices at which a chain of the slab ends */
    size_t junction_count;
};

/* Scratch of one worker, all zero before its first use, kept from slab to slab. */
struct trace_workspace {
    uint8_t *kinds;    /* a local vertex: what meets there */
    uint32_t *numbers; /* a local vertex: among the junctions, or among the seam vertices */
    size_t vertex_capacity;
    struct patch_sum *sums;
    size_t patch_capacity;
    uint32_t *loop_vertices; /* one patch's boundary: where each edge starts, what lies over it */
    uint32_t *loop_others;
    struct chain *chains; /* local vertex numbers until the slab is done */
    size_t chain_capacity;
    uint32_t *interiors; /* local vertices */
    size_t interior_capacity;
    struct seam_edge *seam_edges;
    size_t seam_edge_capacity;
};

/* Counts that a block does not hold itself. */
struct trace_counts {
    uint64_t most_faces; /* faces that the full chains give: loop vertices - 2, over all patches */
};

/*
 * Makes the block of `slab` (without its seam chains; the caller owns it, chain_block_clear) and
 * its seams from `labels`. `space` is the one that patch_grow has just used for this slab. `store`
 * is asked for the attributes of foreign vertices and may be NULL when `stride` is 0.
 * STATUS_BAD_INPUT when adjacency and labels contradict each other.
 */
enum status chain_trace(struct context *ctx, struct store *store, uint32_t stride,
                        const struct slab *slab, const struct patch_workspace *space,
                        const uint32_t *labels, uint32_t patch_count,
                        struct trace_workspace *scratch, struct chain_block *block,
                        struct slab_seams *seams, struct trace_counts *counts) MUST_CHECK;
void slab_seams_clear(struct context *ctx, struct slab_seams *seams);
void trace_workspace_clear(struct context *ctx, struct trace_workspace *scratch);

/*
 * Chooses three of the `count` (at least 3) points of a closed loop, which is to get junctions: the
 * one with the lowest number, the one farthest from it, and the one farthest from their line; ties
 * go to the lowest number. `chosen` gets their places on the loop, ascending.
 */
void loop_choose_three(size_t count, const float *positions, const uint32_t *numbers,
                       size_t chosen[3]);

#endif
