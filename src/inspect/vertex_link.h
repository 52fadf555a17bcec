/*
 * The faces round one vertex and how they hang together: edges, fans and the ends of open fans.
 * Works for any set of faces, manifold or not.
 */
#ifndef SPBM_INSPECT_VERTEX_LINK_H
#define SPBM_INSPECT_VERTEX_LINK_H

#include "base/report.h"

/* A face seen from the vertex: the vertex, then `next`, then `previous`. */
struct link_face {
    uint32_t next, previous;
    uint32_t face;
};

/* One of the two edges that a face has at the vertex, which leads to `neighbour`; `other` is the
 * face's third vertex. */
struct link_end {
    uint32_t neighbour, other;
    uint32_t place;   /* of the face, in faces[] */
    bool is_outgoing; /* the face runs along the edge away from the vertex */
};

struct vertex_link {
    struct context *ctx;
    uint32_t vertex;
    uint32_t degree; /* faces */
    struct link_face *faces;
    struct link_end *ends; /* 2 * degree, sorted by neighbour, then other, then place */
    uint32_t *fan;         /* of each face: the place of one face of its fan */
    size_t face_capacity, end_capacity, fan_capacity;
};

void vertex_link_init(struct context *ctx, struct vertex_link *link);
void vertex_link_clear(struct vertex_link *link);

/* Starts a new vertex without faces. */
void vertex_link_begin(struct vertex_link *link, uint32_t vertex);
enum status vertex_link_add(struct vertex_link *link, struct link_face face) MUST_CHECK;

/* Sorts the ends and joins the faces that share an edge, however many share it; *fans becomes the
 * number of fans. */
enum status vertex_link_finish(struct vertex_link *link, uint32_t *fans) MUST_CHECK;

/* The number of ends from `first` on that lead to the same neighbour. */
static inline size_t vertex_link_group(const struct vertex_link *link, size_t first)
{
    size_t end = first + 1, count = 2 * (size_t)link->degree;
    while (end < count && link->ends[end].neighbour == link->ends[first].neighbour)
        end++;
    return end - first;
}

#endif
