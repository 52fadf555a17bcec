/*
 * The chain graph: all blocks of a chain file joined into one polygon mesh, whose vertices are
 * chain vertices, whose edges are the pieces of chains between them, and whose faces are the
 * patches.
 *
 * Half-edges come in pairs, h and h ^ 1; edge e has the half-edges 2e and 2e + 1. A half-edge
 * belongs to the patch on its left, or to NO_PATCH beside the mesh border.
 *
 * Invariants, before and after every operation (patch_merge.h); numbers are used in tests:
 *   G1  next and previous are inverse to each other, origin[next[h]] == origin[h ^ 1], and a
 * patch's half-edges form one closed walk of at least three different vertices; G2  the half-edges
 * that start at a vertex form one turn round it, with at most one on the border; `outgoing` names
 * one of them, the one on the border if there is one; G3  no two edges have the same two vertices;
 *   G4  no two triangle patches have the same three vertices, unless the chain file itself has
 * them; G5  with disks for the patches this is a surface homeomorphic to the store's.
 *
 * Memory, in bytes:
 *
 *     a vertex   position 12, outgoing 4, list 4, flags 1                                  21
 *     an edge    2 half-edges of 16, the vertices that it replaces 16                      48
 *     a patch    60, a diagonal 8
 */
#ifndef SPBM_SIMPLIFY_CHAIN_GRAPH_H
#define SPBM_SIMPLIFY_CHAIN_GRAPH_H

#include "base/file.h"
#include "geom/vec.h"
#include "simplify/chain_file.h"

struct half_edge {
    uint32_t next, previous; /* round the patch, or along the border */
    uint32_t origin;
    uint32_t patch; /* NO_PATCH beside the border */
};

/* The removed vertices that an edge replaces: a list through graph->list, so that how far the
 * edge is from the original chains is measured and never merely summed up. */
struct edge_record {
    uint32_t first, last; /* NO_INDEX: none */
    uint32_t count;       /* NO_INDEX: the edge is gone */
    float slack; /* how far vertices that the list has no room for may lie from those it has */
};

/* A patch, or several that were merged into one. */
struct graph_patch {
    float normal[3]; /* unit */
    float area;
    float deviation;    /* of what it replaces from its plane */
    float longest;      /* at least the length of its longest chain */
    uint32_t half_edge; /* one of its own; NO_INDEX: the patch is gone */
    uint32_t size;      /* corners */
    uint32_t open;      /* corners that are no junctions: 0 when all its chains are single edges */
    uint32_t member;    /* ring through the patches of the chain file that it is made of */
    uint32_t interior_first, interior_count; /* vertices inside, of this member */
    uint32_t diagonal_first, diagonal_count; /* of this member, into graph->diagonals */
    uint32_t dissolved; /* edges that merging took out, a list through half_edges[2e].next */
};

enum vertex_flag {
    VERTEX_JUNCTION = 1,
    VERTEX_STORED = 2, /* its stored error is that of the original chain still */
    VERTEX_TAKEN = 4   /* not on a chain, but a vertex of the level in the making */
};

struct chain_graph {
    struct context *ctx;
    uint32_t vertex_count, edge_count, patch_count, diagonal_count; /* of the arrays */
    float *positions;   /* 3 a vertex, relative to the store's origin */
    uint32_t *outgoing; /* NO_INDEX: the vertex is not on any chain (any more) */
    uint32_t *list;     /* the next of those that the same edge replaces */
    uint8_t *flags;     /* enum vertex_flag */
    struct half_edge *half_edges;
    struct edge_record *edges;
    struct graph_patch *patches;
    uint32_t *diagonals; /* 2 each */

    uint64_t live_edges, live_border_edges, live_patches;

    uint32_t stride;      /* of the attribute records */
    struct spool records; /* stride bytes a vertex */
    unsigned char *record_data;
};

/* Where the blocks come from: a chain file, or a test. */
struct block_source {
    uint32_t count;
    uint32_t stride;
    enum status (*read)(void *user, uint32_t index, struct chain_block *block);
    void (*release)(void *user, struct chain_block *block);
    void *user;
};

/*
 * Reads every block twice and joins them. `beside`: a path whose folder may take temporary files
 * (attributes that are too many for memory). STATUS_BAD_INPUT when the blocks contradict G1 to G3.
 */
enum status chain_graph_build(struct context *ctx, const struct block_source *source,
                              const char *beside, struct chain_graph *graph) MUST_CHECK;
enum status chain_graph_open(struct context *ctx, struct chain_file *file, const char *beside,
                             struct chain_graph *graph) MUST_CHECK;
void chain_graph_clear(struct chain_graph *graph);

/* Verifies G1 to G3; STATUS_BAD_INPUT with the first thing that is wrong. Linear. */
enum status chain_graph_check(struct chain_graph *graph) MUST_CHECK;

/*
 * The halving error (chain_simplify.h) of every chain vertex of a graph that no operation has
 * changed yet: errors[0, vertex_count), INFINITY for junctions and for vertices inside patches.
 * `priced`: times the price of the chain's metric, which is the order of operations of mode
 * classic.
 */
enum status chain_graph_errors(struct chain_graph *graph, bool priced, float *errors) MUST_CHECK;

/* Faces that triangulating the patches gives: size - 2 each, summed. */
static inline uint64_t chain_graph_faces(const struct chain_graph *graph)
{
    return 2 * graph->live_edges - graph->live_border_edges - 2 * graph->live_patches;
}

/* ---- walking ---- */

static inline uint32_t half_edge_end(const struct chain_graph *graph, uint32_t h)
{
    return graph->half_edges[h ^ 1].origin;
}

/* The next half-edge with the same origin. */
static inline uint32_t half_edge_turn(const struct chain_graph *graph, uint32_t h)
{
    return graph->half_edges[h ^ 1].next;
}

static inline bool edge_is_live(const struct chain_graph *graph, uint32_t edge)
{
    return graph->edges[edge].count != NO_INDEX;
}

static inline bool vertex_is_live(const struct chain_graph *graph, uint32_t v)
{
    return graph->outgoing[v] != NO_INDEX;
}

static inline bool vertex_is_border(const struct chain_graph *graph, uint32_t v)
{
    return graph->half_edges[graph->outgoing[v]].patch == NO_PATCH;
}

/* Number of edges at a live vertex, or `limit` when there are at least so many. */
static inline uint32_t vertex_degree(const struct chain_graph *graph, uint32_t v, uint32_t limit)
{
    uint32_t degree = 0, h = graph->outgoing[v];
    do {
        degree++;
        h = half_edge_turn(graph, h);
    } while (h != graph->outgoing[v] && degree < limit);
    return degree;
}

static inline struct vec3 vertex_point(const struct chain_graph *graph, uint32_t v)
{
    return vec3_load_float(graph->positions + 3 * (size_t)v);
}

static inline struct vec3 patch_normal(const struct chain_graph *graph, uint32_t patch)
{
    return vec3_load_float(graph->patches[patch].normal);
}

/* True when an edge joins two live vertices. Walks round both at once: costs the smaller degree. */
bool vertices_joined(const struct chain_graph *graph, uint32_t a, uint32_t b);

/* True when the live vertex is a corner of the patch. Costs the smaller of degree and size. */
bool patch_has_corner(const struct chain_graph *graph, uint32_t patch, uint32_t vertex);

#endif
