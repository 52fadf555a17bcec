/*
 * A triangle mesh in memory or mapped, and the vertex attributes that travel with it.
 *
 * Invariants of every mesh that comes out of the mesh store (numbers are used in tests):
 *   M1  every index is below vertex_count; no face repeats a vertex;
 *   M2  no two faces have the same three vertices;
 *   M3  an edge belongs to one face (border) or two, which run along it in opposite directions;
 *   M4  the faces round a vertex form one fan, closed or open (no bow-tie);
 *   M5  every vertex is used by a face, and vertices are numbered by first use in face order.
 */
#ifndef SPBM_MESH_MESH_H
#define SPBM_MESH_MESH_H

#include "base/report.h"
#include "mesh/corner.h"

/* ---- vertex attributes: the scalar properties of a PLY vertex besides x, y, z ---- */

enum scalar_type { /* the order is part of both file formats */
                   SCALAR_INT8,
                   SCALAR_UINT8,
                   SCALAR_INT16,
                   SCALAR_UINT16,
                   SCALAR_INT32,
                   SCALAR_UINT32,
                   SCALAR_FLOAT32,
                   SCALAR_FLOAT64
};

/* The most vertices, and the most faces, that a mesh can have: UINT32_MAX is no vertex. */
static const uint64_t mesh_limit = (uint64_t)UINT32_MAX - 1;

enum { ATTRIBUTE_NAME_MAX = 63, ATTRIBUTE_MAX = 64 };

struct attribute {
    char name[ATTRIBUTE_NAME_MAX + 1]; /* as in the file, NUL-terminated */
    enum scalar_type type;
    uint32_t offset; /* of the value in a vertex's record, packed without padding, little-endian */
};

struct attributes {
    uint32_t count;
    uint32_t stride; /* bytes a vertex; 0 when there are none */
    struct attribute list[ATTRIBUTE_MAX];
};

static inline uint32_t scalar_size(enum scalar_type type)
{
    static const uint8_t sizes[] = {1, 1, 2, 2, 4, 4, 4, 8};
    return sizes[type];
}

/* ---- a mesh whose arrays lie in memory ---- */

/*
 * Owned by whoever filled it, released by mesh_clear. Positions are in the model's units; where the
 * source had them in float32 (`is_float32`), the doubles are those very values.
 */
struct mesh {
    uint64_t vertex_count;
    uint64_t face_count;
    double *positions; /* 3 a vertex */
    uint32_t *faces;   /* 3 a face, counter-clockwise seen from outside */
    struct attributes attributes;
    unsigned char *records; /* attributes.stride bytes a vertex; NULL when stride is 0 */
    bool is_float32;
};

void mesh_clear(struct context *ctx, struct mesh *mesh);

#endif
