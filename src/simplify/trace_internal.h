/*
 * What chain_trace.c (walking loops) and trace_block.c (making the block of what was found) share
 * while one slab is traced.
 */
#ifndef SPBM_SIMPLIFY_TRACE_INTERNAL_H
#define SPBM_SIMPLIFY_TRACE_INTERNAL_H

#include "simplify/chain_trace.h"

/* What meets at a vertex. The lowest two bits count the boundary edges inside the slab, up to 3. */
enum {
    KIND_DEGREE = 3,
    KIND_SEAM = 4,     /* another slab touches it */
    KIND_JUNCTION = 8, /* has a number among the block's junctions */
    KIND_TOUCHED = 16, /* a seam vertex at which a chain of this slab ends */
    KIND_INTERIOR = 32 /* inside a patch, and seen */
};

/* Interior vertices that a patch keeps. */
enum { PATCH_INTERIORS = 1 };

struct patch_sum {
    double normal[3];                 /* sum of cross products, later the unit normal */
    double area;                      /* twice the sum */
    double centre[3];                 /* mean of the boundary's vertices */
    double distance[PATCH_INTERIORS]; /* of `interior` from the boundary's plane, descending */
    uint32_t interior[PATCH_INTERIORS];
    uint32_t first_face;
    uint32_t first_edge; /* face << 2 | edge: the first boundary edge in face order */
    uint32_t loop_count; /* boundary vertices */
    uint32_t interior_count;
};

struct trace {
    struct context *ctx;
    const struct slab *slab;
    const struct slab_local *local;
    const float *normals;
    const uint32_t *labels;
    uint32_t patch_count;
    struct trace_workspace *scratch;
    uint32_t junction_count;
    uint32_t seam_vertex_count;
    size_t chain_count;
    size_t interior_count; /* chain-interior vertices */
    size_t seam_edge_count;
    size_t touched_count;
    size_t patch_interior_count;
    size_t diagonal_count;
    uint64_t most_faces;
};

/* Fails with STATUS_BAD_INPUT: adjacency and labels contradict each other. */
enum status trace_fail(const struct trace *trace, const char *what);

/* ---- trace_block.c: after all loops are walked ---- */

/* Finds the interior vertices that patches keep; then makes block and seams, which the caller
 * clears on failure, too. */
void trace_choose_interiors(struct trace *trace);
enum status trace_make_block(struct trace *trace, struct store *store, uint32_t stride,
                             struct chain_block *block) MUST_CHECK;
enum status trace_take_seams(struct trace *trace, struct slab_seams *seams) MUST_CHECK;

#endif
