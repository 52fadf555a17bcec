/*
 * A slab in its own small numbers: what patch growth and chain tracing walk over. Local vertices
 * are the slab's own ones in order, then its foreign ones; local faces count from the slab's first.
 */
#ifndef SPBM_SIMPLIFY_SLAB_LOCAL_H
#define SPBM_SIMPLIFY_SLAB_LOCAL_H

#include "mesh/store.h"

/*
 * A link says what lies over an edge: a face of the slab, as face << 3 | the edge's place there <<
 * 1; or one of two more "faces" behind the last, which can be looked up without asking:
 * BEYOND_BORDER (a border edge of the mesh) and BEYOND_SEAM (the face is another slab's).
 */
enum { BEYOND_BORDER = 0, BEYOND_SEAM = 1, BEYOND_COUNT = 2 };

/*
 * Eight numbers a face, half a line of the cache. Vertex k is the one opposite edge k, link k leads
 * over that edge:
 *
 *     vertex 0, link 1, vertex 1, link 2, vertex 2, link 0, a number for the user, link 1
 *
 * So a link, with no arithmetic, is the index of the vertex opposite the edge that it leads over,
 * and what follows at FACE_NEXT and FACE_PREVIOUS are the links over the next edge there and the
 * one before.
 */
enum { FACE_STRIDE = 8, FACE_USER = 6, FACE_NEXT = 1, FACE_PREVIOUS = 3 };

static inline uint32_t link_face(uint32_t link)
{
    return link >> 3;
}

/* Where the user's number of a link's face lies. */
static inline uint32_t link_user(uint32_t link)
{
    return link | FACE_USER;
}

/* Arrays grow as slabs ask for it and are reused from one slab to the next by the same worker. */
struct slab_local {
    uint32_t face_count;
    uint32_t own_count;    /* local vertices [0, own_count) are the slab's own */
    uint32_t vertex_count; /* own and foreign */
    uint32_t vertex_first; /* store number of local vertex 0 */
    uint32_t *foreign;     /* store numbers of the foreign ones */
    size_t seam_links;     /* links that lead to another slab */
    uint32_t *seam_faces;  /* the faces that have such, ascending */
    size_t seam_face_count;
    uint32_t *faces;  /* FACE_STRIDE a face, and for what is beyond; the user's numbers are 0 */
    float *positions; /* 3 a local vertex, and room for another, so that four can be read */
    size_t vertex_capacity;
    size_t foreign_capacity;
    size_t seam_face_capacity;
};

static inline uint32_t link_beyond(const struct slab_local *local, unsigned beyond)
{
    return (local->face_count + beyond) << 3;
}

static inline uint32_t face_vertex(const struct slab_local *local, uint32_t face, unsigned k)
{
    return local->faces[FACE_STRIDE * (size_t)face + 2 * k];
}

static inline uint32_t face_link(const struct slab_local *local, uint32_t face, unsigned k)
{
    return local->faces[FACE_STRIDE * (size_t)face + 2 * previous3(k) + 1];
}

/* Where edge k of a face starts and where it ends. */
static inline uint32_t edge_start(const struct slab_local *local, uint32_t face, unsigned k)
{
    return face_vertex(local, face, next3(k));
}

static inline uint32_t edge_end(const struct slab_local *local, uint32_t face, unsigned k)
{
    return face_vertex(local, face, previous3(k));
}

/* Store number of a local vertex. */
static inline uint32_t local_vertex_number(const struct slab_local *local, uint32_t vertex)
{
    return vertex < local->own_count ? local->vertex_first + vertex
                                     : local->foreign[vertex - local->own_count];
}

/* Numbers that so many faces take, and what is beyond them. */
static inline size_t slab_local_numbers(size_t faces)
{
    return FACE_STRIDE * (faces + BEYOND_COUNT);
}

/* Fills `local` (all zero before its first use) from a slab, which may be closed afterwards.
 * `faces` has room for slab_local_numbers(its faces). A vertex that the slab's tables do not have,
 * or an edge number above 2, is STATUS_BAD_INPUT. */
enum status slab_local_fill(struct context *ctx, const struct slab *slab, uint32_t *faces,
                            struct slab_local *local) MUST_CHECK;
void slab_local_clear(struct context *ctx, struct slab_local *local);

#endif
