/*
 * Words of edges, by which a loop of patches tells whether it goes round a handle or through a
 * tunnel.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_WORDS_H
#define SPBM_SIMPLIFY_TOPOLOGY_WORDS_H

#include "simplify/chain_graph.h"

struct edge_words {
    struct chain_graph *graph;
    uint32_t *gone; /* a patch: 0 it is there, 1 it is not; the user's to change */
    uint64_t *word; /* an edge */

    /* private */
    uint8_t *uses;     /* an edge: enum edge_use */
    uint32_t *forest;  /* of patches */
    uint32_t *parents; /* a vertex: half-edge from its parent, NO_INDEX: a root; of the tree */
    uint32_t *order;   /* vertices, parents first */
    uint64_t *sums;    /* a vertex */
    uint8_t *visited;  /* a half-edge; scratch of the user, too */
};

static inline bool patch_is_there(const struct edge_words *words, uint32_t h)
{
    uint32_t patch = words->graph->half_edges[h].patch;
    return patch != NO_PATCH && !words->gone[patch];
}

/* All zero before but for the graph; to be cleared whatever came of it. Every patch is there. */
enum status edge_words_begin(struct edge_words *words) MUST_CHECK;
void edge_words_clear(struct edge_words *words);

/*
 * Gives every edge its word, of what is there now. The words of the edges that a loop of patches
 * crosses add up (exclusive or) to 0 exactly if the loop parts the surface, its borders closed.
 * False if all are 0: there is no handle.
 */
bool edge_words_find(struct edge_words *words);

#endif
