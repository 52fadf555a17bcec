/*
 * The operations of level of detail on the chain graph (dissertation, sections 4.2.5 to 4.2.7):
 * a chain vertex goes, two patches are merged, a chain of one edge is collapsed. Each has a test
 * that says whether it keeps G1 to G5 (chain_graph.h); the operation itself must only be done after
 * it. Whether an operation is worth it is not asked here (operation_cost.h).
 */
#ifndef SPBM_SIMPLIFY_PATCH_MERGE_H
#define SPBM_SIMPLIFY_PATCH_MERGE_H

#include "simplify/chain_graph.h"

/* Two patches with more corners together are not merged, and a vertex of more edges is not
 * collapsed away, so that no operation costs more than a constant. */
enum { MERGE_CORNERS_MAX = 512, COLLAPSE_DEGREE_MAX = 48 };

/* A vertex between exactly two edges, which become one. */
bool vertex_has_two_edges(const struct chain_graph *graph, uint32_t v);
bool vertex_can_go(const struct chain_graph *graph, uint32_t v);
void vertex_remove(struct chain_graph *graph, uint32_t v);

/*
 * Collapsing the edge of half-edge h to its end: the origin goes, and its other edges then start at
 * the end. A patch of three corners beside it is dropped, its two other edges become one.
 *
 * Possible when: no other patch has both ends as corners (condition (a) of section 4.2.6); whatever
 * else is joined to both ends spans a triangle patch with them (the link condition); what results
 * has three different corners everywhere. The border rule of section 4.2.7, in the sense of figure
 * 19: a vertex on the border moves along the border only, so that what is collapsed into the border
 * leaves it where it is.
 */
bool edge_can_collapse(const struct chain_graph *graph, uint32_t h);
/* `vertex_to`, `list_to`: other edges of the origin, with which the origin and what the collapsed
 * edge replaced are compared from now on (`list_to` NO_INDEX: with none). */
void edge_collapse(struct chain_graph *graph, uint32_t h, uint32_t vertex_to, uint32_t list_to);

/*
 * Merging the patches on both sides of h by taking the chain of h out, with the vertices on it
 * (which have two edges each). Possible when this chain is the only thing that they share, so that
 * the result is a disk (section 4.2.6, condition (1)).
 */
bool patches_can_merge(const struct chain_graph *graph, uint32_t h);
/* The number of the merged patch is that of the larger one. `deviation`: of the merged loop from
 * its plane. */
uint32_t patches_merge(struct chain_graph *graph, uint32_t h, double deviation);

/*
 * Puts `to`, one of the vertices that the edges of half-edges `in` and `out` (both starting at v)
 * replace, in the place of v. What these edges replace, v among it, is divided between them anew,
 * by where it is nearer. Nothing about the topology changes.
 */
void vertex_slide(struct chain_graph *graph, uint32_t v, uint32_t in, uint32_t out, uint32_t to);

#endif
