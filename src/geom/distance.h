/*
 * Exact distances and crossings of single triangles, in double precision, for any triangle:
 * needles, segments and points too.
 */
#ifndef SPBM_GEOM_DISTANCE_H
#define SPBM_GEOM_DISTANCE_H

#include <stdbool.h>

#include "geom/vec.h"

struct triangle {
    struct vec3 a, b, c;
};

/* Squared distance of `p` from the triangle (its interior counts); *nearest, unless NULL, becomes a
 * point of the triangle that has it. Units: those of the coordinates, squared. */
double triangle_distance_squared(struct vec3 p, const struct triangle *triangle,
                                 struct vec3 *nearest);

/*
 * On which side of the plane through a, b, c the point d is: 1 when a, b, c look clockwise from d
 * (d is behind), -1 when counter-clockwise (d is in front), 0 when double precision cannot tell.
 * Never wrong: the sign is given only when it is larger than the bound on rounding in Shewchuk,
 * "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates" (1997),
 * section 4.4.
 */
int plane_side(struct vec3 a, struct vec3 b, struct vec3 c, struct vec3 d);

/*
 * True when the triangles cross for certain: an edge of one passes through the inside of the
 * other. Triangles that only touch (in a shared vertex or edge, too), and those whose crossing
 * is within rounding error, do not cross.
 */
bool triangles_cross(const struct triangle *s, const struct triangle *t);

#endif
