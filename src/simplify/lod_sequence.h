/*
 * The one sequence of operations, by increasing error, that all levels of detail of mode classic
 * are cut from (dissertation, sections 4.2.4 to 4.2.6).
 */
#ifndef SPBM_SIMPLIFY_LOD_SEQUENCE_H
#define SPBM_SIMPLIFY_LOD_SEQUENCE_H

#include "simplify/operation_cost.h"

/* 12 bytes a vertex and 12 a patch. */
struct lod_sequence {
    struct chain_graph *graph;
    struct cost_options options;
    size_t item_count; /* vertices, then patches */
    float *keys;
    uint32_t *places; /* in the heap; NO_INDEX: not in it */
    uint32_t *heap;
    uint32_t heap_count;
    uint64_t done; /* operations so far */
    uint64_t done_at_refill;
    uint64_t slide_at; /* faces at which vertices are next put where they serve best */
    double error;      /* largest error of an operation so far; the deviation of a merge counts */
    bool exhausted;    /* nothing more is possible without changing the topology */
};

/* The graph must be as built; it stays the caller's, and nobody else changes it meanwhile. */
enum status lod_sequence_begin(struct chain_graph *graph, const struct cost_options *options,
                               struct lod_sequence *sequence) MUST_CHECK;

/* Does operations until the patches give at most `most_faces` faces (chain_graph_faces), or the
 * next one has an error above `most_error`, or none is possible. May be called again with lower
 * targets. */
enum status lod_sequence_run(struct lod_sequence *sequence, uint64_t most_faces,
                             double most_error) MUST_CHECK;

void lod_sequence_end(struct lod_sequence *sequence);

#endif
