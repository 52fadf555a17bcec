/*
 * Point against triangle, triangle against triangle.
 *
 * The usual point-triangle test sorts the point into seven regions by dot products alone. On
 * needles these cancel: the region comes out wrong and the distance with it. Here the inside is
 * told by barycentric coordinates from cross products, which keep their precision; a point whose
 * foot is outside is nearest to one of the edges that it lies beyond, so only those (at most two)
 * are looked at. Where the normal itself is lost in rounding, the triangle is as good as its three
 * edges.
 *
 * Two triangles cross properly when an edge of one goes through the inside of the other. Each of
 * the six edges is tried with signs that are certain or zero (plane_side), so that neighbours that
 * share a vertex or an edge, which give exact zeros, need no case of their own.
 */
#include "geom/distance.h"

#include <stddef.h>

/* Below this square of a sine of the corner at `a` the normal's direction is worth less than the
 * triangle's width. */
static const double least_sine_squared = 1e-16;

static double segment_distance_squared(struct vec3 p, struct vec3 a, struct vec3 b,
                                       struct vec3 *nearest)
{
    struct vec3 along = vec3_sub(b, a);
    double length_squared = vec3_length_squared(along);
    double t = length_squared > 0 ? vec3_dot(vec3_sub(p, a), along) / length_squared : 0;
    /* From the nearer end, so that a foot close to b is as exact as one close to a. */
    if (t <= 0)
        *nearest = a;
    else if (t >= 1)
        *nearest = b;
    else if (t <= 0.5)
        *nearest = vec3_add_scaled(a, t, along);
    else
        *nearest = vec3_add_scaled(b, t - 1, along);
    return vec3_distance_squared(p, *nearest);
}

double triangle_distance_squared(struct vec3 p, const struct triangle *triangle,
                                 struct vec3 *nearest)
{
    struct vec3 ab = vec3_sub(triangle->b, triangle->a);
    struct vec3 ac = vec3_sub(triangle->c, triangle->a);
    struct vec3 ap = vec3_sub(p, triangle->a);
    struct vec3 normal = vec3_cross(ab, ac);
    double normal_squared = vec3_length_squared(normal);
    bool beyond_ab = true, beyond_bc = true, beyond_ca = true;

    if (normal_squared > least_sine_squared * vec3_length_squared(ab) * vec3_length_squared(ac)) {
        double weight_b = vec3_dot(vec3_cross(ap, ac), normal);
        double weight_c = vec3_dot(vec3_cross(ab, ap), normal);
        double weight_a = normal_squared - weight_b - weight_c;
        beyond_ab = weight_c < 0;
        beyond_bc = weight_a < 0;
        beyond_ca = weight_b < 0;
        if (!beyond_ab && !beyond_bc && !beyond_ca) {
            double height = vec3_dot(ap, normal);
            if (nearest)
                *nearest = vec3_add_scaled(p, -height / normal_squared, normal);
            return height * height / normal_squared;
        }
    }

    double best = INFINITY;
    struct vec3 best_point = triangle->a;
    const struct vec3 *corner[4] = {&triangle->a, &triangle->b, &triangle->c, &triangle->a};
    const bool is_beyond[3] = {beyond_ab, beyond_bc, beyond_ca};
    for (unsigned k = 0; k < 3; k++) {
        struct vec3 point;
        if (!is_beyond[k])
            continue;
        double distance = segment_distance_squared(p, *corner[k], *corner[k + 1], &point);
        if (distance < best) {
            best = distance;
            best_point = point;
        }
    }
    if (nearest)
        *nearest = best_point;
    return best;
}

int plane_side(struct vec3 a, struct vec3 b, struct vec3 c, struct vec3 d)
{
    static const double epsilon = 0x1p-53;
    static const double bound_factor = (7.0 + 56.0 * 0x1p-53) * 0x1p-53;
    struct vec3 u = vec3_sub(a, d), v = vec3_sub(b, d), w = vec3_sub(c, d);
    double vw_x = v.x * w.y, wv_x = w.x * v.y;
    double wu_x = w.x * u.y, uw_x = u.x * w.y;
    double uv_x = u.x * v.y, vu_x = v.x * u.y;
    double determinant = u.z * (vw_x - wv_x) + v.z * (wu_x - uw_x) + w.z * (uv_x - vu_x);
    double permanent = (fabs(vw_x) + fabs(wv_x)) * fabs(u.z) +
                       (fabs(wu_x) + fabs(uw_x)) * fabs(v.z) +
                       (fabs(uv_x) + fabs(vu_x)) * fabs(w.z);
    double bound = bound_factor * permanent;
    /* The bound holds without underflow only; products of tiny differences count as zero. */
    if (permanent < 0x1p-900 * epsilon)
        return 0;
    return determinant > bound ? 1 : determinant < -bound ? -1 : 0;
}

/* The segment pq, whose ends are for certain on different sides of abc, goes through its inside. */
static bool passes_through(struct vec3 p, struct vec3 q, const struct triangle *t)
{
    int side = plane_side(p, q, t->a, t->b);
    return side != 0 && plane_side(p, q, t->b, t->c) == side &&
           plane_side(p, q, t->c, t->a) == side;
}

/* An edge of `s` goes through `t`; *apart becomes true when s lies on one side of t's plane. */
static bool edge_passes(const struct triangle *s, const struct triangle *t, bool *apart)
{
    int side_a = plane_side(t->a, t->b, t->c, s->a);
    int side_b = plane_side(t->a, t->b, t->c, s->b);
    int side_c = plane_side(t->a, t->b, t->c, s->c);
    *apart = side_a * side_b >= 0 && side_b * side_c >= 0 && side_c * side_a >= 0;
    if (*apart)
        return false;
    return (side_a * side_b < 0 && passes_through(s->a, s->b, t)) ||
           (side_b * side_c < 0 && passes_through(s->b, s->c, t)) ||
           (side_c * side_a < 0 && passes_through(s->c, s->a, t));
}

bool triangles_cross(const struct triangle *s, const struct triangle *t)
{
    bool apart;
    if (edge_passes(s, t, &apart))
        return true;
    if (apart)
        return false;
    return edge_passes(t, s, &apart);
}
