/*
 * Which faces of a mesh lie in one plane.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_COPLANAR_H
#define SPBM_SIMPLIFY_TOPOLOGY_COPLANAR_H

#include "geom/vec.h"
#include "mesh/mesh.h"

struct plane {
    struct vec3 normal;
    double offset;
    uint32_t face_count;
    uint32_t first_loop, loop_count;
    bool frozen; /* stays as it is */
};

struct outline_loop {
    uint32_t plane;
    uint32_t first; /* half-edge */
};

struct coplanar {
    size_t face_count;
    uint32_t *twins;    /* a half-edge 3f+k; NO_INDEX at the border */
    uint32_t *plane_of; /* a face */
    struct plane *planes;
    size_t plane_count, plane_capacity;
    struct outline_loop *loops; /* by plane */
    size_t loop_count, loop_capacity;
};

/* Neighbours lie in one plane if their normals are within `cosine` of its, and their corners within
 * `tolerance`. *set is all zero before; to be cleared whatever came of it. */
enum status coplanar_find(struct context *ctx, const struct mesh *mesh, double cosine,
                          double tolerance, struct coplanar *set) MUST_CHECK;
void coplanar_clear(struct context *ctx, struct coplanar *set);

static inline struct vec3 point_of(const struct mesh *mesh, uint32_t vertex)
{
    return vec3_load(mesh->positions + 3 * (size_t)vertex);
}

static inline uint32_t start_of(const struct mesh *mesh, uint32_t h)
{
    return mesh->faces[h];
}

static inline uint32_t next_in_face(uint32_t h)
{
    return h % 3 == 2 ? h - 2 : h + 1;
}

static inline bool is_outline(const struct coplanar *set, uint32_t h)
{
    uint32_t twin = set->twins[h];
    return twin == NO_INDEX || set->plane_of[twin / 3] != set->plane_of[h / 3];
}

/* The outline's next half-edge: round the end of h through the plane's own faces. */
static inline uint32_t next_outline(const struct coplanar *set, uint32_t h)
{
    for (h = next_in_face(h); !is_outline(set, h);)
        h = next_in_face(set->twins[h]);
    return h;
}

#endif
