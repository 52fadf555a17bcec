/*
 * Placing the vertex of a collapsed edge.
 *
 * The problem: find x on the plane of preserved volume with the least sum of squared volumes. The
 * paper adds linear constraints one by one as long as they are independent by more than one degree,
 * with a last resort in triangle shape; each test branches and the solution jumps when one of them
 * tips over. Here the last resort is always present with a small weight: a pull to the edge's
 * middle, SHAPE_WEIGHT of the matrix's trace, which decides where the triangles leave x free and is
 * not felt where they do not. That leaves one 2 x 2 system in the plane, solved in closed form
 * without a branch, so that the edges of a vertex go through it together, one a lane. Every lane
 * does the same IEEE operations in the same order on any machine.
 */
#include "quadric.h"

#include <math.h>
#include <string.h>

#include "base/lanes.h"

/* Measured on bunny, koala and noisy scans: 1e-6 to 1e-4 are alike, 1e-3 loses 4 % on the bunny. */
static const double SHAPE_WEIGHT = 5e-6;
/* Small faces beside large ones weigh little more than that, and their planes would be left: a
 * solution is refined so many times, which makes the part w of a direction that is lost to the pull
 * w^3 (Riley 1955; a CAD part 100 times longer than thick, at 1 %: a quarter of the mean error). */
enum { REFINEMENTS = 2 };
/* A squared sum of normals below this part of the sum of squares has no meaning as a plane. */
static const double PLANE_FLOOR = 1e-6;
/* Of edge length to the sixth: orders edges in planes, the short ones first. */
static const double TIE_WEIGHT = 1e-8;

/* Eight symmetric matrices. */
struct forms {
    float8 xx, xy, xz, yy, yz, zz;
};

/* The fan's triangles as they are for every lane. */
LANES_INLINE struct forms forms_of(const struct fan *fan)
{
    const float *s = fan->square;
    return (struct forms){lanes_all(s[0]), lanes_all(s[1]), lanes_all(s[2]),
                          lanes_all(s[3]), lanes_all(s[4]), lanes_all(s[5])};
}

LANES_INLINE struct vec3x8 load_lanes(const float lanes[3][LANES])
{
    return lanes_load3(lanes[0], lanes[1], lanes[2]);
}

/* The matrix that the neighbour's triangles give, the two shared ones left to the origin's. */
LANES_INLINE struct forms rest_of_fan(const struct edge_lanes *e)
{
    const struct vec3x8 l = load_lanes(e->left), r = load_lanes(e->right);
    return (struct forms){
        lanes_load(e->square[0]) - l.x * l.x - r.x * r.x,
        lanes_load(e->square[1]) - l.x * l.y - r.x * r.y,
        lanes_load(e->square[2]) - l.x * l.z - r.x * r.z,
        lanes_load(e->square[3]) - l.y * l.y - r.y * r.y,
        lanes_load(e->square[4]) - l.y * l.z - r.y * r.z,
        lanes_load(e->square[5]) - l.z * l.z - r.z * r.z,
    };
}

/* x'Sx, never negative: rounding of a nearly singular S is cut off. */
LANES_INLINE float8 form(const struct forms *s, struct vec3x8 x)
{
    const float8 value = s->xx * x.x * x.x + s->yy * x.y * x.y + s->zz * x.z * x.z +
                         2 * (s->xy * x.x * x.y + s->xz * x.x * x.z + s->yz * x.y * x.z);
    return lanes_where(value > 0, value);
}

static inline float tie(float length)
{
    return (float)TIE_WEIGHT * length * length * length;
}

LANES_INLINE float8 cost_at(const struct forms *own, const struct forms *rest, struct vec3x8 edge,
                            struct vec3x8 x)
{
    const float8 length = lanes_dot(edge, edge);
    return (form(own, x) + form(rest, lanes_sub(x, edge))) / 72 +
           (float)TIE_WEIGHT * length * length * length;
}

LANES_INLINE struct vec3x8 apply_forms(const struct forms *s, struct vec3x8 x)
{
    return (struct vec3x8){s->xx * x.x + s->xy * x.y + s->xz * x.z,
                           s->xy * x.x + s->yy * x.y + s->yz * x.z,
                           s->xz * x.x + s->yz * x.y + s->zz * x.z};
}

LANES_INLINE void place_lanes(const struct fan *fan, float reach_square, struct edge_lanes *e)
{
    const struct forms own = forms_of(fan), rest = rest_of_fan(e);
    const struct forms sum = {rest.xx + own.xx, rest.xy + own.xy, rest.xz + own.xz,
                              rest.yy + own.yy, rest.yz + own.yz, rest.zz + own.zz};
    const struct vec3x8 edge = load_lanes(e->edge), g = apply_forms(&rest, edge);
    const struct vec3x8 beside =
        lanes_sub(lanes_sub(load_lanes(e->normal), load_lanes(e->left)), load_lanes(e->right));
    const float8 offset = lanes_dot(beside, edge);
    const float8 trace = sum.xx + sum.yy + sum.zz, pull = (float)SHAPE_WEIGHT * trace;
    const float8 one = lanes_all(1), reach = lanes_all(reach_square);

    /* unit normal and height of the plane */
    const struct vec3x8 normal = {beside.x + fan->normal[0], beside.y + fan->normal[1],
                                  beside.z + fan->normal[2]};
    const float8 square = lanes_dot(normal, normal);
    const int8x32 has_plane = square > (float)PLANE_FLOOR * trace;
    const float8 scale = 1 / lanes_sqrt(lanes_choose(has_plane, square, one));
    const struct vec3x8 u = {normal.x * scale, normal.y * scale,
                             lanes_choose(has_plane, normal.z * scale, one)};
    const float8 height = offset * scale;

    /* an orthonormal frame s, t of it, without a branch on its direction */
    const float8 sign = lanes_choose(u.z < 0, -one, one);
    const float8 a = -1 / (sign + u.z), b = u.x * u.y * a;
    const struct vec3x8 s = {1 + sign * u.x * u.x * a, sign * b, -sign * u.x};
    const struct vec3x8 t = {b, sign + u.y * u.y * a, -u.y};

    /* x = height u + p s + q t: the form's gradient along s and t is to vanish */
    const struct vec3x8 ms = apply_forms(&sum, s), mt = apply_forms(&sum, t);
    const float8 m00 = lanes_dot(s, ms) + pull, m01 = lanes_dot(s, mt);
    const float8 m11 = lanes_dot(t, mt) + pull;
    const struct vec3x8 c = {g.x + pull * edge.x / 2, g.y + pull * edge.y / 2,
                             g.z + pull * edge.z / 2};
    const float8 g0 = lanes_dot(s, c) - height * lanes_dot(u, ms);
    const float8 g1 = lanes_dot(t, c) - height * lanes_dot(u, mt);
    const float8 determinant = 1 / (m00 * m11 - m01 * m01);
    float8 p = (m11 * g0 - m01 * g1) * determinant;
    float8 q = (m00 * g1 - m01 * g0) * determinant;
    /* what the pull did where it was not meant: what is left to solve is the pull itself */
    float8 dp = p - lanes_dot(s, edge) / 2, dq = q - lanes_dot(t, edge) / 2;
    for (int round = 0; round < REFINEMENTS; round++) {
        const float8 rp = pull * dp, rq = pull * dq;
        dp = (m11 * rp - m01 * rq) * determinant;
        dq = (m00 * rq - m01 * rp) * determinant;
        p += dp;
        q += dq;
    }
    const struct vec3x8 middle = {edge.x / 2, edge.y / 2, edge.z / 2};
    const struct vec3x8 away = {height * u.x + p * s.x + q * t.x - middle.x,
                                height * u.y + p * s.y + q * t.y - middle.y,
                                height * u.z + p * s.z + q * t.z - middle.z};

    /* too far (or not a number): the middle's foot on the plane, or the middle itself */
    const int8x32 near = has_plane & (lanes_dot(away, away) <= reach);
    const float8 lift = height - lanes_dot(u, edge) / 2;
    const float8 safe_lift = lanes_where(has_plane & (lift * lift <= reach), lift);
    const struct vec3x8 at = {middle.x + lanes_choose(near, away.x, safe_lift * u.x),
                              middle.y + lanes_choose(near, away.y, safe_lift * u.y),
                              middle.z + lanes_choose(near, away.z, safe_lift * u.z)};
    lanes_store(e->at[0], at.x);
    lanes_store(e->at[1], at.y);
    lanes_store(e->at[2], at.z);
    lanes_store(e->cost, cost_at(&own, &rest, edge, at));
}

static void place_lanes_scalar(const struct fan *fan, float reach_square, struct edge_lanes *e)
{
    place_lanes(fan, reach_square, e);
}

LANES_AVX2 static void place_lanes_avx2(const struct fan *fan, float reach_square,
                                        struct edge_lanes *e)
{
    place_lanes(fan, reach_square, e);
}

void edge_lanes_place(enum cpu_level level, const struct fan *fan, float reach_square,
                      struct edge_lanes *e)
{
    if (level >= CPU_AVX2)
        place_lanes_avx2(fan, reach_square, e);
    else
        place_lanes_scalar(fan, reach_square, e);
}

LANES_INLINE void weigh_lanes(const struct fan *fan, struct edge_lanes *e)
{
    const float own = fan->square[0] + fan->square[3] + fan->square[5];
    const float8 squares =
        own + (lanes_load(e->square[0]) + lanes_load(e->square[3]) + lanes_load(e->square[5]));
    const float8 root = lanes_sqrt(lanes_sqrt(lanes_where(squares > 0, squares)));
    const float8 cost = lanes_load(e->cost) / (root + 1e-30f);
    lanes_store(e->cost, lanes_choose(cost < 3e38f, cost, lanes_all(INFINITY)));
}

static void weigh_lanes_scalar(const struct fan *fan, struct edge_lanes *e)
{
    weigh_lanes(fan, e);
}

LANES_AVX2 static void weigh_lanes_avx2(const struct fan *fan, struct edge_lanes *e)
{
    weigh_lanes(fan, e);
}

void edge_lanes_weigh(enum cpu_level level, const struct fan *fan, struct edge_lanes *e)
{
    if (level >= CPU_AVX2)
        weigh_lanes_avx2(fan, e);
    else
        weigh_lanes_scalar(fan, e);
}

LANES_INLINE void ends_of_lanes(const struct fan *fan, struct edge_lanes *e)
{
    const struct forms own = forms_of(fan), rest = rest_of_fan(e);
    const struct vec3x8 edge = load_lanes(e->edge);
    const struct vec3x8 here = {lanes_all(0), lanes_all(0), lanes_all(0)};
    lanes_store(e->cost_here, cost_at(&own, &rest, edge, here));
    lanes_store(e->cost_there, cost_at(&own, &rest, edge, edge));
}

static void ends_of_lanes_scalar(const struct fan *fan, struct edge_lanes *e)
{
    ends_of_lanes(fan, e);
}

LANES_AVX2 static void ends_of_lanes_avx2(const struct fan *fan, struct edge_lanes *e)
{
    ends_of_lanes(fan, e);
}

void edge_lanes_ends(enum cpu_level level, const struct fan *fan, struct edge_lanes *e)
{
    if (level >= CPU_AVX2)
        ends_of_lanes_avx2(fan, e);
    else
        ends_of_lanes_scalar(fan, e);
}

/* ---- the border ---- */

void border_sum_add(struct border_sum *sum, const double from[3], const double to[3])
{
    double e1[3], e2[3], e3[3];
    for (int k = 0; k < 3; k++)
        e1[k] = to[k] - from[k];
    cross_product(from, to, e2);
    cross_product(e1, e2, e3);
    /* [e1]x' [e1]x = |e1|^2 I - e1 e1' */
    sum->square[0] += e1[1] * e1[1] + e1[2] * e1[2];
    sum->square[1] -= e1[0] * e1[1];
    sum->square[2] -= e1[0] * e1[2];
    sum->square[3] += e1[0] * e1[0] + e1[2] * e1[2];
    sum->square[4] -= e1[1] * e1[2];
    sum->square[5] += e1[0] * e1[0] + e1[1] * e1[1];
    for (int k = 0; k < 3; k++)
        sum->linear[k] += e3[k];
    sum->constant += dot_product(e2, e2);
}

static void apply(const double s[6], const double x[3], double out[3])
{
    out[0] = s[0] * x[0] + s[1] * x[1] + s[2] * x[2];
    out[1] = s[1] * x[0] + s[3] * x[1] + s[4] * x[2];
    out[2] = s[2] * x[0] + s[4] * x[1] + s[5] * x[2];
}

static double form_of(const double s[6], const double x[3])
{
    double y[3];
    apply(s, x, y);
    const double value = dot_product(x, y);
    return value > 0 ? value : 0;
}

static double border_at(const struct border_sum *sum, const double x[3])
{
    double y[3];
    apply(sum->square, x, y);
    const double value = dot_product(x, y) - 2 * dot_product(sum->linear, x) + sum->constant;
    return value > 0 ? value : 0;
}

static double length_square(const struct edge_lanes *e, unsigned i)
{
    const double edge[3] = {(double)e->edge[0][i], (double)e->edge[1][i], (double)e->edge[2][i]};
    return dot_product(edge, edge);
}

/* The cost of section 4.5 with lambda 1/2: volume / 72 + length^2 border / 8. */
static double border_term(const struct border_sum *border, double weight, double length,
                          const double x[3])
{
    return weight * length * border_at(border, x) / 8;
}

/* Solves S x = g by Cramer's rule; false when S is singular. */
static bool solve3(const double s[6], const double g[3], double x[3])
{
    const double c0 = s[3] * s[5] - s[4] * s[4], c1 = s[2] * s[4] - s[1] * s[5];
    const double c2 = s[1] * s[4] - s[2] * s[3], c3 = s[0] * s[5] - s[2] * s[2];
    const double c4 = s[1] * s[2] - s[0] * s[4], c5 = s[0] * s[3] - s[1] * s[1];
    const double determinant = s[0] * c0 + s[1] * c1 + s[2] * c2;
    if (!(determinant > 0))
        return false;
    x[0] = (c0 * g[0] + c1 * g[1] + c2 * g[2]) / determinant;
    x[1] = (c1 * g[0] + c3 * g[1] + c4 * g[2]) / determinant;
    x[2] = (c2 * g[0] + c4 * g[1] + c5 * g[2]) / determinant;
    return true;
}

void edge_border_place(const struct fan *fan, float reach_square, const struct border_sum *border,
                       double weight, struct edge_lanes *e, unsigned i)
{
    float rest_lanes[6][LANES];
    double own[6], rest[6], sum[6], g[3], x[3], middle[3], edge[3];
    const struct forms forms = rest_of_fan(e);
    memcpy(rest_lanes, &forms, sizeof rest_lanes);
    const double length = length_square(e, i), scale = 9 * weight * length;
    for (int k = 0; k < 6; k++) {
        own[k] = (double)fan->square[k];
        rest[k] = (double)rest_lanes[k][i];
        sum[k] = own[k] + rest[k] + scale * border->square[k];
    }
    for (int k = 0; k < 3; k++) {
        edge[k] = (double)e->edge[k][i];
        middle[k] = edge[k] / 2;
    }
    const double pull = SHAPE_WEIGHT * (sum[0] + sum[3] + sum[5]);
    apply(rest, edge, g);
    for (int k = 0; k < 3; k++)
        g[k] += scale * border->linear[k] + pull * middle[k];
    sum[0] += pull;
    sum[3] += pull;
    sum[5] += pull;
    double away[3] = {INFINITY, 0, 0};
    if (solve3(sum, g, x)) {
        double change[3], left[3];
        for (int k = 0; k < 3; k++)
            change[k] = x[k] - middle[k];
        for (int round = 0; round < REFINEMENTS; round++) {
            for (int k = 0; k < 3; k++)
                left[k] = pull * change[k];
            solve3(sum, left, change);
            for (int k = 0; k < 3; k++)
                x[k] += change[k];
        }
        for (int k = 0; k < 3; k++)
            away[k] = x[k] - middle[k];
    }
    if (!(dot_product(away, away) <= (double)reach_square))
        memcpy(x, middle, sizeof x);
    for (int k = 0; k < 3; k++) {
        e->at[k][i] = (float)x[k];
        away[k] = x[k] - edge[k];
    }
    e->cost[i] = (float)((form_of(own, x) + form_of(rest, away)) / 72 +
                         border_term(border, weight, length, x)) +
                 tie((float)length);
}

void edge_border_ends(const struct border_sum *border, double weight, struct edge_lanes *e,
                      unsigned i)
{
    static const double zero[3] = {0, 0, 0};
    const double edge[3] = {(double)e->edge[0][i], (double)e->edge[1][i], (double)e->edge[2][i]};
    const double length = length_square(e, i);
    e->cost_here[i] += (float)border_term(border, weight, length, zero);
    e->cost_there[i] += (float)border_term(border, weight, length, edge);
}
