/*
 * Counts and topology of a mesh as it is, clean or not: what `spbm info`, `check` and `measure`
 * say.
 */
#ifndef SPBM_INSPECT_QUALITY_H
#define SPBM_INSPECT_QUALITY_H

#include "geom/vec.h"
#include "mesh/mesh.h"
#include "mesh/store.h"

/*
 * Degenerate faces are counted and otherwise left out: topology, area and volume are those of the
 * other faces (topology.faces counts these, duplicates included) and of the vertices they use.
 * Faces belong to one component when they share a vertex, and to one fan when they share an edge,
 * however many faces it has.
 */
struct quality {
    struct topology topology; /* of referenced vertices; the floor is 0 unless manifold */
    uint64_t unreferenced_vertices;
    uint64_t nonmanifold_edges;    /* of more than two faces */
    uint64_t nonmanifold_vertices; /* faces form more than one fan */
    uint64_t misoriented_edges;    /* two faces run along them the same way */
    uint64_t degenerate_faces;     /* a repeated index */
    uint64_t duplicate_faces;      /* the same three vertices as an earlier one */
    uint64_t zero_area_faces;
    int64_t genus;    /* summed over closed, orientable components; of a component with
                         border: of the surface with its loops filled */
    bool is_manifold; /* M1 to M4 hold */
    double box_low[3], box_high[3];
    double area;
    double volume;                /* signed; meaningful when closed */
    uint64_t coincident_vertices; /* that have the same position as an earlier one */
};

/* Arrays that may be mapped files; nothing is owned. */
struct quality_input {
    uint64_t vertex_count, face_count;
    uint64_t double_first; /* positions, 3 a vertex: of the vertices before this one ... */
    const float *floats;   /* ... here, */
    const double *doubles; /* of this one and all others here */
    const uint32_t *faces; /* 3 a face */
    const char *beside;    /* for temporary files, as in temp_open; may be NULL */
    /* NULL, or a bit a vertex (bit v%8 of byte v/8), zeroed by the caller: set for the vertices of
     * faces that are not degenerate. */
    unsigned char *referenced;
    void (*rest)(void *user); /* NULL, or called between batches: mapped pages may be dropped */
    void *user;
};

/* Position of a vertex of the input. */
static inline struct vec3 position_of(const struct quality_input *input, uint64_t vertex)
{
    return vertex < input->double_first
               ? vec3_load_float(input->floats + 3 * vertex)
               : vec3_load(input->doubles + 3 * (vertex - input->double_first));
}

/*
 * Looks at every face twice and sorts all corners by vertex outside of memory: 5 bytes a vertex and
 * a constant are held beyond the input. An index out of range is STATUS_BAD_INPUT.
 */
enum status quality_of_arrays(struct context *ctx, const struct quality_input *input,
                              struct quality *quality) MUST_CHECK;

/* The same for a mesh in memory. */
enum status quality_of_mesh(struct context *ctx, const struct mesh *mesh,
                            struct quality *quality) MUST_CHECK;

#endif
