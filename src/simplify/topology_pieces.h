/*
 * The pieces into which all rims together cut the surface: what lies between rims.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_PIECES_H
#define SPBM_SIMPLIFY_TOPOLOGY_PIECES_H

#include "simplify/topology_rims.h"

enum piece_state { PIECE_STAYS = 0, PIECE_WAITS, PIECE_GOES, PIECE_FOLLOWS };

struct piece {
    struct vec3 low, high;
    uint32_t first_edge, edge_count;   /* its cut edges: half-edges on its own side */
    uint32_t first_patch, patch_count; /* its patches */
    uint32_t flat_edges;               /* cut edges whose flat side it has, and whose wall stays */
    uint32_t wall_edges;
    uint32_t large;                   /* list of large loops inside it */
    uint32_t follower, last_follower; /* flat pieces that are parts of this one: a list */
    uint32_t next_follower;
    uint8_t state;
};

struct piece_set {
    struct chain_graph *graph;
    struct rim_set rims; /* where to cut; released with the set */
    uint32_t *piece_of;  /* a patch */
    struct piece *pieces;
    uint32_t piece_count;
    uint32_t *edges;   /* half-edges by piece */
    uint32_t *patches; /* by piece */
    size_t edge_total;
    uint32_t *large_next; /* a large loop: the next in the same piece */
};

static inline uint32_t patch_of(const struct piece_set *set, uint32_t h)
{
    return set->graph->half_edges[h].patch;
}

/* Cuts along set->rims, which is filled already; all else but the graph is zero. A set is to be
 * cleared whatever came of it. */
enum status pieces_cut(struct piece_set *set) MUST_CHECK;
void piece_set_clear(struct piece_set *set);

#endif
