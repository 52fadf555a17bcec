/*
 * What a slab of a store must be before anything is made of it, whatever its checksum says.
 */
#ifndef SPBM_MESH_SLAB_JUDGE_H
#define SPBM_MESH_SLAB_JUDGE_H

#include "mesh/store.h"

/*
 * NULL if every number in the slab may be used, else what is wrong. Holds then: vertices are the
 * slab's own, numbered by first use and all used, or in its ascending foreign list; no face names
 * one twice; coordinates are finite; a neighbour exists, and one within the slab has the same two
 * vertices at its edge, runs the other way and leads back. For neighbours in other slabs *seams
 * gets a sum that is 0 over all slabs of a store if both sides of every edge between slabs say the
 * same of it. (Chance meets that once in 2^64; whoever wants to can, and gets a wrong mesh, not a
 * crash: indices are in range all the same.)
 */
const char *slab_judge(const struct slab *slab, uint64_t face_count, uint64_t *seams);

/*
 * Whether the surface is a manifold as far as the slab alone shows, for a slab that slab_judge has
 * passed: *wrong is NULL, or what is wrong: a vertex with two fans of faces, or two edges between
 * the same two vertices (which two faces with the same vertices have, too). What can't be seen:
 * fans and edges that meet only across a slab's border. Takes 4 bytes a vertex and 3 bits a face.
 */
enum status slab_judge_stars(struct context *ctx, const struct slab *slab,
                             const char **wrong) MUST_CHECK;

#endif
