/*
 * A slab in its own small numbers: what patch growth and chain tracing walk over. Local vertices
 * are the slab's own ones in order, then its foreign ones; local faces count from the slab's first.
 */
#ifndef SPBM_SIMPLIFY_SLAB_LOCAL_H
#define SPBM_SIMPLIFY_SLAB_LOCAL_H

#include "mesh/store.h"

/*
 * A link says what lies over an edge: a face of the slab, as face << 2 | the edge's place there; or
 * one of two more "faces" behind the last, so that arrays over the faces with two more entries can
 * be looked up without asking: BEYOND_BORDER (a border edge of the mesh) and BEYOND_SEAM (the face
 * is another slab's).
 */
enum { BEYOND_BORDER = 0, BEYOND_SEAM = 1, BEYOND_COUNT = 2 };

/* Arrays grow as slabs ask for it and are reused from one slab to the next by the same worker. */
struct slab_local {
    uint32_t face_count;
    uint32_t own_count;      /* local vertices [0, own_count) are the slab's own */
    uint32_t vertex_count;   /* own and foreign */
    uint32_t vertex_first;   /* store number of local vertex 0 */
    const uint32_t *foreign; /* borrowed from the slab: store numbers of the foreign ones */
    size_t seam_links;       /* links that lead to another slab */
    uint32_t *corners;       /* 3 a face: local vertices */
    uint32_t *links;         /* 3 a face: over edge k */
    float *positions;        /* 3 a local vertex */
    size_t face_capacity;
    size_t vertex_capacity;
};

static inline bool link_is_face(const struct slab_local *local, uint32_t link)
{
    return link >> 2 < local->face_count;
}

static inline uint32_t link_beyond(const struct slab_local *local, unsigned beyond)
{
    return (local->face_count + beyond) << 2;
}

/* Store number of a local vertex. */
static inline uint32_t local_vertex_number(const struct slab_local *local, uint32_t vertex)
{
    return vertex < local->own_count ? local->vertex_first + vertex
                                     : local->foreign[vertex - local->own_count];
}

/* Fills `local` (all zero before its first use) from a slab that stays open while `local` is used.
 * A vertex that the slab's tables do not have, or an edge number above 2, is STATUS_BAD_INPUT. */
enum status slab_local_fill(struct context *ctx, const struct slab *slab,
                            struct slab_local *local) MUST_CHECK;
void slab_local_clear(struct context *ctx, struct slab_local *local);

#endif
