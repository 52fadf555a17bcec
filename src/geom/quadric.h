/*
 * Quadratic error of a vertex placed among triangles, and where it is least: the arithmetic of
 * Lindstrom and Turk, "Fast and Memory Efficient Polygonal Simplification" (1998), section 4.
 *
 * A `fan` holds what the triangles round one vertex add to it. With the vertex itself as origin the
 * planes of all those triangles pass through 0, so that the sums over their normals n (cross
 * products, twice the area long) are all there is: the squared volumes that appear when the vertex
 * moves to x add up to x'Ax / 36 with A = sum(n n'), and the signed volume is x'(sum n) / 6.
 * Nine floats a vertex serve all edges at it, and being relative to the vertex they lose nothing to
 * cancellation.
 *
 * Symmetric 3 x 3 matrices are six numbers: xx, xy, xz, yy, yz, zz.
 */
#ifndef SPBM_GEOM_QUADRIC_H
#define SPBM_GEOM_QUADRIC_H

#include <stdbool.h>

#include "base/cpu.h"
#include "base/lanes.h"

struct fan {
    float square[6]; /* sum of n n' */
    float normal[3]; /* sum of n */
};

/* LANES edges from one vertex, the origin, to neighbours. In lanes without an edge the inputs are
 * any finite numbers. */
struct edge_lanes {
    /* in */
    float square[6][LANES]; /* the neighbour's fan */
    float normal[3][LANES];
    float edge[3][LANES]; /* the neighbour */
    float left[3][LANES]; /* normals of the two faces at the edge; 0 where there is none */
    float right[3][LANES];
    /* out */
    float at[3][LANES]; /* where the vertex goes */
    float cost[LANES];
    float cost_here[LANES];  /* of staying at the origin */
    float cost_there[LANES]; /* of going to the neighbour */
};

/*
 * Fills `at` and `cost`: the place on the plane that preserves the volume where the sum of squared
 * volumes is least. Directions that hardly change it are drawn to the edge's middle. No place is
 * further from the middle than the square root of `reach_square`.
 */
void edge_lanes_place(enum cpu_level level, const struct fan *fan, float reach_square,
                      struct edge_lanes *lanes);
/* Divides the costs by the fourth root of the sum of squared areas round the edge; what is no
 * longer a finite number becomes INFINITY. */
void edge_lanes_weigh(enum cpu_level level, const struct fan *fan, struct edge_lanes *lanes);
/* Fills `cost_here` and `cost_there`. */
void edge_lanes_ends(enum cpu_level level, const struct fan *fan, struct edge_lanes *lanes);

/* ---- an edge at the border ---- */

/* The border edges at both ends: what a vertex at x does to the area along them (section 4.3),
 * sum |e1 x v + e2|^2 with e1 = q - p, e2 = p x q for an edge from p to q. */
struct border_sum {
    double square[6];
    double linear[3]; /* sum of e1 x e2 */
    double constant;  /* sum of |e2|^2 */
};

void border_sum_add(struct border_sum *sum, const double from[3], const double to[3]);

/* One lane again, with the border's term weighted against the volume's. */
void edge_border_place(const struct fan *fan, float reach_square, const struct border_sum *border,
                       double weight, struct edge_lanes *lanes, unsigned lane);
/* Adds the border's term to both ends' costs of one lane. */
void edge_border_ends(const struct border_sum *border, double weight, struct edge_lanes *lanes,
                      unsigned lane);

static inline void cross_product(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static inline double dot_product(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

#endif
