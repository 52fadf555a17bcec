/*
 * What a triangle mesh is, counted the slow and sure way for tests: by sorting edges and by walking
 * fans, without any code under test.
 */
#ifndef SPBM_TEST_FACTS_H
#define SPBM_TEST_FACTS_H

#include "mesh/mesh.h"

struct facts {
    size_t vertices; /* used by a face */
    size_t unused;   /* vertices that no face uses */
    size_t edges;    /* different vertex pairs */
    size_t faces;    /* all */
    size_t border_edges;
    size_t border_loops; /* closed walks along border edges; 0 unless every vertex is manifold */
    size_t components;   /* of faces joined by common edges */
    long euler;          /* vertices - edges + faces */
    size_t
        out_of_range;  /* faces with an index too large; the rest is not counted if there are any */
    size_t degenerate; /* faces that repeat a vertex */
    size_t duplicate;  /* faces with the same three vertices as an earlier one */
    size_t nonmanifold_edges;    /* of more than two faces */
    size_t nonmanifold_vertices; /* whose faces form more than one fan */
    size_t misoriented_edges;    /* of two faces that run along it in the same direction */
};

struct facts facts_of(const struct mesh *mesh);
/* True if nothing contradicts M1 to M4 of mesh.h; says on stderr what does. */
bool facts_manifold(const struct facts *facts);
/* True if components, border loops and Euler characteristic agree; says what does not. */
bool facts_same_topology(const struct facts *a, const struct facts *b);
/* Sum of the triangles' signed volumes with the origin. */
double mesh_volume(const struct mesh *mesh);
double mesh_area(const struct mesh *mesh);

#endif
