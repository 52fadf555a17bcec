/*
 * Planes: a frame orthogonal to a direction, a polygon's own normal, and whether the edges of a
 * projected polygon cross.
 *
 * Decisions here are made in doubles, for judging what is better; what must be exact is done on the
 * grid of predicates.h.
 */
#ifndef SPBM_GEOM_PLANE_H
#define SPBM_GEOM_PLANE_H

#include <stdbool.h>
#include <stdint.h>

#include "geom/vec.h"

struct plane_point {
    double x, y;
};

/* Two unit vectors that make a right-handed system with the direction they were made for. */
struct plane_frame {
    struct vec3 across, up;
};

/* Of a direction of any length; the zero vector counts as (0, 0, 1). Any two equal directions give
 * the same frame. */
struct plane_frame plane_frame_make(struct vec3 normal);

static inline struct plane_point plane_project(const struct plane_frame *frame, struct vec3 p)
{
    return (struct plane_point){vec3_dot(frame->across, p), vec3_dot(frame->up, p)};
}

/* Twice the area of the triangle, positive when a, b, c run counter-clockwise. */
static inline double plane_turn(struct plane_point a, struct plane_point b, struct plane_point c)
{
    return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

/* Twice the signed area of a polygon; positive when it runs counter-clockwise. */
double plane_polygon_area(const struct plane_point *points, uint32_t count);

/* True when the segments ab and cd cross in a point inside both (as far as doubles can tell). */
static inline bool plane_segments_cross(struct plane_point a, struct plane_point b,
                                        struct plane_point c, struct plane_point d)
{
    return (plane_turn(a, b, c) > 0) != (plane_turn(a, b, d) > 0) &&
           (plane_turn(c, d, a) > 0) != (plane_turn(c, d, b) > 0);
}

#endif
