/*
 * Triangulating all patches of a level (dissertation, section 4.2.8) so that the triangles together
 * are a manifold: no diagonal is used twice or repeats an edge.
 */
#ifndef SPBM_SIMPLIFY_PATCH_TRIANGULATE_H
#define SPBM_SIMPLIFY_PATCH_TRIANGULATE_H

#include "geom/triangulate.h"
#include "simplify/chain_graph.h"
#include "simplify/patch_flip.h"

/* Unordered pairs of vertices with an owner each; grows. 12 bytes a place. */
struct pair_table {
    uint64_t *pairs;
    uint32_t *owners;
    size_t capacity; /* a power of two, or 0 */
    size_t count;
};

/* The faces of a level, in the order of the patches. All zero before its first use; reused from
 * level to level. */
struct level_faces {
    uint32_t *faces; /* 3 a face: graph vertices, counter-clockwise */
    size_t count;
    uint64_t fans;    /* patches that were cut into a fan round a vertex of their own: 2 faces more
                         than size - 2 each */
    uint64_t blocked; /* patches for which nothing was found; they have no faces here */
    uint64_t bad;     /* patches with a triangle that is turned over or has no area, as projected */

    /* private */
    struct chain_graph *graph;
    size_t capacity;
    struct pair_table diagonals;
    size_t *first_faces; /* of each patch, while the level is looked at */
    uint32_t *corners;
    double *points;
    uint32_t *triangles;
    size_t corner_capacity, point_capacity, triangle_capacity;
    uint32_t *spares; /* vertices taken from the insides of patches */
    size_t spare_count, spare_capacity;
    struct triangulation_workspace workspace;
    struct flip_room flips;
};

/*
 * Triangulates every live patch. Depends on the graph alone. Vertices are those of the graph, and
 * of patches that could not be cut without a diagonal that is taken, one more that no one else
 * uses: one inside the patch, or one that was removed from its chains, or from a neighbour's.
 */
enum status patch_triangulate(struct chain_graph *graph, struct level_faces *level) MUST_CHECK;

/* Adds faces by twos, at most `pairs` times, by putting unused vertices of patches into their
 * triangles, the patches that deviate most from their planes first. */
enum status patch_refine(struct level_faces *level, uint64_t pairs) MUST_CHECK;

void level_faces_clear(struct context *ctx, struct level_faces *level);

#endif
