/*
 * From patches to records: grows the patches of one slab and traces each, as soon as it is done,
 * into the chains between it and the patches before; notes what the slab's seams need to be joined
 * (seam_join.h). See patch.h for P1 to P3.
 */
#ifndef SPBM_SIMPLIFY_CHAIN_TRACE_H
#define SPBM_SIMPLIFY_CHAIN_TRACE_H

#include "simplify/patch.h"
#include "simplify/patchify.h"

/* One edge between two slabs, as one of them sees it. */
struct seam_edge {
    uint64_t key; /* lower store vertex << 32 | higher */
    uint32_t slab;
    uint32_t side; /* patch << 1 | 1 when the slab's face runs from higher to lower */
};

/* What one slab knows of its seams. Owned by whoever called chain_trace. */
struct slab_seams {
    uint32_t slab;
    uint32_t block_junctions; /* of its block: the number of the first seam vertex */
    uint32_t *vertices;       /* store numbers of its seam vertices, ascending */
    float *positions;         /* 3 each */
    size_t vertex_count;
    struct seam_edge *edges;
    size_t edge_count;
    uint32_t
        *junctions; /* store numbers of those at which a chain of the slab ends; room for all */
    size_t junction_count;
};

/* Arrays of one worker, all zero before its first use, kept from slab to slab; a traced block lies
 * in them and in what growth has done with. */
struct trace_workspace {
    uint32_t *codes;      /* a local vertex, in the room of growth: trace_internal.h */
    uint32_t *breaks;     /* of a boundary: where chains end */
    struct piece *pieces; /* of a boundary */
    struct chain *chains;
    size_t chain_capacity;
    uint32_t *junctions; /* local vertices */
    size_t junction_capacity;
    uint32_t *interiors; /* of chains: local vertices */
    size_t interior_capacity;
    uint32_t *patch_interiors;
    size_t patch_interior_capacity;
    struct patch_note *notes; /* of patches, which they become in the end where they lie */
    size_t note_capacity;
    bool has_lent_notes; /* they lie in the rest of growth's room */
    uint32_t *diagonals;
    size_t diagonal_capacity;
    struct seam_edge *seam_edges;
    size_t seam_edge_capacity;
    uint32_t *seam_vertices;
    size_t seam_vertex_capacity;
    float *positions; /* only where they are more than growth's faces have room for */
    size_t position_capacity;
    unsigned char *records;
    size_t record_capacity;
};

/* Counts that a block does not hold itself. */
struct trace_counts {
    uint64_t chain_interiors;
    uint64_t most_faces; /* faces that the full chains give: loop vertices - 2, over all patches */
};

/*
 * Makes the block of `slab` (without its seam chains) and its seams. `space` is one on which
 * patch_growth_begin has just been called for this slab; its faces are used up afterwards.
 * `store` is asked for the attributes of foreign vertices and may be NULL when `stride` is 0. The
 * block's arrays are those of the workspace and of `space`, until the next use of either.
 * STATUS_BAD_INPUT when the adjacency contradicts itself.
 */
enum status chain_trace(struct context *ctx, struct store *store, uint32_t stride,
                        const struct slab *slab, struct patch_workspace *space,
                        struct trace_workspace *scratch, struct chain_block *block,
                        struct slab_seams *seams, struct trace_counts *counts) MUST_CHECK;
/* Memory of growth that is free as long as the block that was traced last is needed; NULL: there is
 * none, or what there was has been released. */
void *trace_free_room(struct context *ctx, const struct trace_workspace *scratch,
                      struct patch_workspace *space, const struct chain_block *block, size_t *size);
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
