/*
 * Segment tests from the signs of four orientations. Where three points are in line, the question
 * becomes one of order along the line, which the bounding box answers exactly.
 */
#include "geom/predicates.h"

/* p is in line with a and b: does it lie between them? */
static bool is_between(struct grid_point a, struct grid_point b, struct grid_point p)
{
    return (a.x < b.x ? a.x <= p.x && p.x <= b.x : b.x <= p.x && p.x <= a.x) &&
           (a.y < b.y ? a.y <= p.y && p.y <= b.y : b.y <= p.y && p.y <= a.y);
}

static bool have_different_signs(int64_t a, int64_t b)
{
    return (a > 0 && b < 0) || (a < 0 && b > 0);
}

bool segments_cross(struct grid_point a, struct grid_point b, struct grid_point c,
                    struct grid_point d)
{
    return have_different_signs(orientation(a, b, c), orientation(a, b, d)) &&
           have_different_signs(orientation(c, d, a), orientation(c, d, b));
}

bool segments_touch(struct grid_point a, struct grid_point b, struct grid_point c,
                    struct grid_point d)
{
    /* most pairs are told apart by the line of one of them */
    int64_t abc = orientation(a, b, c), abd = orientation(a, b, d);
    if ((abc > 0 && abd > 0) || (abc < 0 && abd < 0))
        return false;
    int64_t cda = orientation(c, d, a), cdb = orientation(c, d, b);
    if (have_different_signs(abc, abd) && have_different_signs(cda, cdb))
        return true;
    return (abc == 0 && is_between(a, b, c)) || (abd == 0 && is_between(a, b, d)) ||
           (cda == 0 && is_between(c, d, a)) || (cdb == 0 && is_between(c, d, b));
}

bool edges_overlap(struct grid_point at, struct grid_point a, struct grid_point b)
{
    if (grid_equal(at, a) || grid_equal(at, b))
        return true;
    return orientation(at, a, b) == 0 && grid_dot(at, a, b) > 0;
}
