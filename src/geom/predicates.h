/*
 * Exact tests in the plane, on an integer grid.
 *
 * Signs of determinants in doubles are wrong when points are nearly in line, and a triangulation
 * that trusts wrong signs loops or folds. Adaptive exact arithmetic on the input's doubles is the
 * general answer; here points are first rounded to a grid of 2^30 steps a side (which is finer than
 * the float32 that most inputs have), where every product fits into 61 bits and plain int64
 * arithmetic is exact. What the rounding moves together counts as touching.
 */
#ifndef SPBM_GEOM_PREDICATES_H
#define SPBM_GEOM_PREDICATES_H

#include <stdbool.h>
#include <stdint.h>

enum { GRID_SIZE = 1 << 30 }; /* coordinates are in [0, GRID_SIZE] */

struct grid_point {
    int32_t x, y;
};

static inline bool grid_equal(struct grid_point a, struct grid_point b)
{
    return a.x == b.x && a.y == b.y;
}

/* Twice the signed area of the triangle: positive when a, b, c run counter-clockwise, 0 when they
 * are in line. Exact for points of the grid. */
static inline int64_t orientation(struct grid_point a, struct grid_point b, struct grid_point c)
{
    return (int64_t)(b.x - a.x) * (c.y - a.y) - (int64_t)(b.y - a.y) * (c.x - a.x);
}

/* Scalar product of the vectors from `at` to a and to b, exact. */
static inline int64_t grid_dot(struct grid_point at, struct grid_point a, struct grid_point b)
{
    return (int64_t)(a.x - at.x) * (b.x - at.x) + (int64_t)(a.y - at.y) * (b.y - at.y);
}

/* Square of the distance between them. */
static inline double grid_square(struct grid_point a, struct grid_point b)
{
    const double x = (double)(a.x - b.x), y = (double)(a.y - b.y);
    return x * x + y * y;
}

/* Order along a sweep: by x, then by y. */
static inline bool grid_before(struct grid_point a, struct grid_point b)
{
    return a.x != b.x ? a.x < b.x : a.y < b.y;
}

/* True when the closed segments ab and cd have at least one point in common. */
bool segments_touch(struct grid_point a, struct grid_point b, struct grid_point c,
                    struct grid_point d);

/* True when the segments cross in one point that is an end of neither. */
bool segments_cross(struct grid_point a, struct grid_point b, struct grid_point c,
                    struct grid_point d);

/* True when the edges from `at` to a and to b have more than the point `at` in common: one lies
 * along the other (or has no length). */
bool edges_overlap(struct grid_point at, struct grid_point a, struct grid_point b);

/* True when p lies in the triangle or on its border; the triangle runs counter-clockwise. */
static inline bool triangle_holds(struct grid_point a, struct grid_point b, struct grid_point c,
                                  struct grid_point p)
{
    return orientation(a, b, p) >= 0 && orientation(b, c, p) >= 0 && orientation(c, a, p) >= 0;
}

#endif
