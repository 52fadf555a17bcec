/*
 * The small mesh: the triangles that fine chains and their patches give, from which mode `collapse`
 * starts. One block of the chain file makes one; blocks are joined at their seams.
 *
 * The mesh of a block, once it is split, holds M1 to M4 and has the topology of its slab; seam
 * vertices are on its border. Two blocks never make the same edge twice: an edge between two seam
 * vertices is a piece of a seam chain, which both cut alike, or an edge of the store.
 */
#ifndef SPBM_SIMPLIFY_SMALL_MESH_H
#define SPBM_SIMPLIFY_SMALL_MESH_H

#include "geom/triangulate.h"
#include "simplify/chain_file.h"
#include "simplify/collapse.h"

/* A vertex on a seam, and the slabs that are known to meet there: lowest and highest. It is inside
 * of a range of slabs when both are. */
struct seam_tag {
    uint32_t number; /* of the vertex in the store */
    uint32_t vertex;
    uint32_t lowest, highest;
};

/* All arrays are owned; all zero is empty. Positions are relative to the store's origin; witnesses
 * are what the mesh lacks already. */
struct small_mesh {
    struct collapse_mesh triangles;
    uint32_t seam_count;
    struct seam_tag *seams; /* ascending by number; several of one number are copies */
    double lost; /* small_mesh_build: how far what was left out lies from the mesh, at most */
    bool is_cut; /* chains have vertices that were left out */
};

void small_mesh_clear(struct context *ctx, uint32_t stride, struct small_mesh *mesh);

/* Scratch of one worker; all zero at first. */
struct small_workspace {
    struct triangulation_workspace triangulation;
};

void small_workspace_clear(struct context *ctx, struct small_workspace *space);

/* Chains are cut to what `tolerance` (model units) needs, and patches triangulated. Vertices inside
 * are moved by the part `given_back` of the bulge of the patches round them (small_bulge.h; 0: all
 * stay where they are). M4 holds but at seam vertices: those are still to be split. */
enum status small_mesh_build(struct context *ctx, struct small_workspace *space, uint32_t stride,
                             const struct chain_block *block, double tolerance, double given_back,
                             struct small_mesh *mesh) MUST_CHECK;

/* A slab may have several fans of faces at a seam vertex, which meet only in other slabs: each gets
 * a copy of the vertex, with a tag of the same number, so that M4 holds. (What is going to be
 * joined need not be split before.) */
enum status small_mesh_split(struct context *ctx, uint32_t stride,
                             struct small_mesh *mesh) MUST_CHECK;

/* Locks seam vertices, and all that lies next to one with several copies: it must not come next to
 * the other copy too. */
void small_mesh_lock(const struct small_mesh *mesh, unsigned char *locked);

/*
 * Joins the meshes of `count` neighbouring ranges of slabs, together [slab_first, slab_end), into
 * one, and splits it; the parts are cleared on the way. A seam vertex takes position and record of
 * its first copy. Seam vertices that are inside of the range lose their tag.
 */
enum status small_mesh_join(struct context *ctx, uint32_t stride, uint32_t slab_first,
                            uint32_t slab_end, struct small_mesh *parts, uint32_t count,
                            struct small_mesh *mesh) MUST_CHECK;

#endif
