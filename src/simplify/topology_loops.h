/*
 * Closed loops along the borders of sets of patches (dissertation, 5.3.1): walking them, and
 * measuring their size (5.3.3), their plane and on which side they are flat.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_LOOPS_H
#define SPBM_SIMPLIFY_TOPOLOGY_LOOPS_H

#include "simplify/chain_graph.h"
#include "simplify/topology.h"

/* A set of patches is given by a class number a patch; what lies beside the border has NO_CLASS. */
#define NO_CLASS UINT32_MAX

static inline uint32_t class_of(const struct chain_graph *graph, const uint32_t *classes,
                                uint32_t h)
{
    uint32_t patch = graph->half_edges[h].patch;
    return patch == NO_PATCH ? NO_CLASS : classes[patch];
}

/*
 * The half-edge that follows h on the border of its class, which lies on the left: round h's end
 * through what is outside the class, so that loops that touch in a vertex are not joined, and a
 * fill takes exactly the place of what it replaces in the turn round each vertex.
 */
static inline uint32_t loop_next(const struct chain_graph *graph, const uint32_t *classes,
                                 uint32_t h)
{
    uint32_t own = class_of(graph, classes, h), turn = h ^ 1;
    do
        turn = graph->half_edges[turn].previous ^ 1;
    while (class_of(graph, classes, turn) != own);
    return turn;
}

struct surface_loop {
    uint32_t first;     /* half-edge with the class on its left */
    uint32_t count;     /* of edges */
    struct vec3 normal; /* unit: the loop runs counter-clockwise about it */
    struct vec3 centre; /* mean of the vertices, relative to the store's origin */
    double length;
    double flat_left, flat_right; /* means along the loop: patch normal on that side times normal */
    double convexity;             /* mean sine of the edges' angles: positive where convex */
    double low[3], high[3];       /* the box */
};

/* Points of one loop, reused from loop to loop; all zero before its first use. */
struct loop_points {
    double *points; /* 3 each, relative to the store's origin */
    uint32_t *half_edges;
    struct distant *order; /* for the exact diameter */
    size_t point_capacity, half_edge_capacity, order_capacity;
    uint32_t count;
};

void loop_points_clear(struct context *ctx, struct loop_points *points);

/* Walks the loop from half-edge `first`; `points` may be NULL. */
enum status loop_trace(const struct chain_graph *graph, const uint32_t *classes, uint32_t first,
                       struct loop_points *points, struct surface_loop *loop) MUST_CHECK;

/* The size of a loop. LOOP_EXTENT counts as LOOP_EXACT here: it is the same of other points. */
enum status loop_size(struct context *ctx, struct loop_points *points, enum loop_measure measure,
                      struct vec3 normal, double *size) MUST_CHECK;

/*
 * The largest distance between two of the points, 3 doubles each. They are sorted by their distance
 * from the middle, so that most pairs need not be looked at; `enough`: distances above it need not
 * be exact.
 */
enum status points_diameter(struct context *ctx, struct loop_points *scratch, const double *points,
                            size_t count, double enough, double *diameter) MUST_CHECK;

#endif
