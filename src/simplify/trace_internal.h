/*
 * What chain_trace.c (patch by patch) and trace_block.c (making the block of what was found) share
 * while one slab is traced.
 */
#ifndef SPBM_SIMPLIFY_TRACE_INTERNAL_H
#define SPBM_SIMPLIFY_TRACE_INTERNAL_H

#include "simplify/chain_trace.h"

/*
 * A vertex has a code while block numbers are not known yet: its kind in the two highest bits and a
 * number that counts up in each kind. CODE_TOUCHED is set for a seam vertex at which a chain of the
 * slab ends.
 */
enum vertex_kind { KIND_JUNCTION = 0, KIND_CHAIN = 1, KIND_SEAM = 2, KIND_NONE = 3 };

enum { CODE_SHIFT = 30 };
#define CODE_NONE UINT32_MAX /* not met on any chain yet */
#define CODE_TOUCHED (1u << 29)
#define CODE_NUMBER (CODE_TOUCHED - 1)

static inline enum vertex_kind code_kind(uint32_t code)
{
    return (enum vertex_kind)(code >> CODE_SHIFT);
}

/* What is known of a patch while others are still grown: little of what struct patch has in its 44
 * bytes, since memory holds this beside all that growth needs. */
struct patch_note {
    uint32_t normal; /* its code, unit_code.h */
    float area;
    float deviation;
    uint32_t diagonals; /* how many it has; NO_INDEX: none, but an interior vertex */
};

struct trace {
    struct context *ctx;
    const struct slab *slab;
    struct patch_workspace *space;
    const struct slab_local *local;
    struct trace_workspace *scratch;
    float *positions; /* of the block */
    size_t patch_count;
    size_t chain_count;
    size_t junction_count;
    size_t interior_count; /* of chains */
    size_t patch_interior_count;
    size_t diagonal_count;
    size_t seam_vertex_count;
    size_t seam_edge_count;
    uint64_t most_faces;
};

/* Fails with STATUS_BAD_INPUT: the adjacency contradicts itself. */
enum status trace_fail(const struct trace *trace, const char *what);

/* ---- trace_block.c ---- */

/* Gives the slab's seam vertices their codes, in the order of their store numbers, and all others
 * none: before the first patch. */
enum status trace_number_seams(struct trace *trace) MUST_CHECK;

/* After the last patch: makes block numbers of all codes, and gathers the vertices. */
enum status trace_make_block(struct trace *trace, struct store *store, uint32_t stride,
                             struct chain_block *block) MUST_CHECK;
/* Moves notes that lie in growth's room to a vector of their own, with room for `needed`. */
enum status trace_own_notes(struct trace *trace, size_t needed) MUST_CHECK;

enum status trace_take_seams(struct trace *trace, const struct chain_block *block,
                             struct slab_seams *seams) MUST_CHECK;

#endif
