/*
 * Taking apart what hangs together in an edge of more than two faces or in a single vertex.
 */
#ifndef SPBM_MESH_SEPARATE_H
#define SPBM_MESH_SEPARATE_H

#include "mesh/adjacency.h"
#include "mesh/survey.h"

/*
 * Gives each further fan that the survey found a vertex of its own, and links again the sides in
 * `cut` (adjacency_build's list, NULL for none) whose ends have become the same pair of vertices
 * for just two of them. The draft is numbered anew. *split counts the vertices that were split,
 * *added their copies.
 */
enum status separate_fans(struct draft *draft, struct survey *survey, struct adjacency *cut,
                          uint64_t *split, uint64_t *added) MUST_CHECK;

#endif
