/*
 * Joins border edges to loops. Edges are named by half-edge: 3 * face + which of its three edges.
 */
#ifndef SPBM_INSPECT_BORDER_LOOPS_H
#define SPBM_INSPECT_BORDER_LOOPS_H

#include "base/file.h"

struct border_loops {
    struct context *ctx;
    struct spool edges;  /* struct border_edge, as added */
    struct spool joints; /* pairs of half-edges */
    struct spool bits;   /* one a half-edge: is a border edge */
    struct spool ranks;  /* of each 64 bits: number of border edges before them */
    struct spool roots;  /* union-find over border edges by rank */
};

void border_loops_init(struct context *ctx, const char *beside, uint64_t memory_limit,
                       struct border_loops *loops);
void border_loops_clear(struct border_loops *loops);

/* A border edge, with the component (any number) that its loop is to be counted for. */
enum status border_loops_edge(struct border_loops *loops, uint64_t half_edge,
                              uint32_t component) MUST_CHECK;
/* Both border edges belong to the same loop. May be called before either is added. */
enum status border_loops_join(struct border_loops *loops, uint64_t half_edge,
                              uint64_t other) MUST_CHECK;

/* Joins them; calls loop(user, component) once a loop. `half_edges` is above all names used. */
enum status border_loops_finish(struct border_loops *loops, uint64_t half_edges,
                                void (*loop)(void *user, uint32_t component),
                                void *user) MUST_CHECK;

#endif
