/*
 * Placing the vertex of a collapsed edge.
 *
 * The problem: find x on the plane of preserved volume with the least sum of squared volumes. The
 * paper adds linear constraints one by one as long as they are independent by more than one degree,
 * with a last resort in triangle shape; each test branches and the solution jumps when one of them
 * tips over. Here the last resort is always present with a small weight: a pull to the edge's
 * middle, SHAPE_WEIGHT of the matrix's trace, which decides where the triangles leave x free and is
 * not felt where they do not. That leaves one 2 x 2 system in the plane, solved in closed form
 * without a branch, so that the edges of a vertex go through it together, one a lane. Loops over
 * lanes are simple enough for the compiler to make vector instructions of; every lane does the same
 * IEEE operations in the same order on any machine.
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

/* The matrix that the neighbour's triangles give, the two shared ones left to the origin's. */
LANES_INLINE void rest_of_fan(const struct edge_lanes *e, float square[6][LANES],
                              float normal[3][LANES])
{
    for (int i = 0; i < LANES; i++) {
        const float lx = e->left[0][i], ly = e->left[1][i], lz = e->left[2][i];
        const float rx = e->right[0][i], ry = e->right[1][i], rz = e->right[2][i];
        square[0][i] = e->square[0][i] - lx * lx - rx * rx;
        square[1][i] = e->square[1][i] - lx * ly - rx * ry;
        square[2][i] = e->square[2][i] - lx * lz - rx * rz;
        square[3][i] = e->square[3][i] - ly * ly - ry * ry;
        square[4][i] = e->square[4][i] - ly * lz - ry * rz;
        square[5][i] = e->square[5][i] - lz * lz - rz * rz;
        normal[0][i] = e->normal[0][i] - lx - rx;
        normal[1][i] = e->normal[1][i] - ly - ry;
        normal[2][i] = e->normal[2][i] - lz - rz;
    }
}

/* x'Sx, never negative: rounding of a nearly singular S is cut off. */
LANES_INLINE float form(float xx, float xy, float xz, float yy, float yz, float zz, float x,
                        float y, float z)
{
    const float value =
        xx * x * x + yy * y * y + zz * z * z + 2 * (xy * x * y + xz * x * z + yz * y * z);
    return value > 0 ? value : 0;
}

LANES_INLINE float tie(float length)
{
    return (float)TIE_WEIGHT * length * length * length;
}

LANES_INLINE float cost_at(const struct fan *fan, float rest[6][LANES], const struct edge_lanes *e,
                           int i, float x, float y, float z)
{
    const float *s = fan->square;
    const float ex = e->edge[0][i], ey = e->edge[1][i], ez = e->edge[2][i];
    const float here = form(s[0], s[1], s[2], s[3], s[4], s[5], x, y, z);
    const float there = form(rest[0][i], rest[1][i], rest[2][i], rest[3][i], rest[4][i], rest[5][i],
                             x - ex, y - ey, z - ez);
    return (here + there) / 72 + tie(ex * ex + ey * ey + ez * ez);
}

/* (The fan by value: else the compiler sees to it at run time that it is none of the lanes.) */
LANES_INLINE void place_lanes(const struct fan fan, float reach_square, struct edge_lanes *e)
{
    float rest[6][LANES], normal[3][LANES];
    rest_of_fan(e, rest, normal);
    const float *own = fan.square;
    for (int i = 0; i < LANES; i++) {
        const float ex = e->edge[0][i], ey = e->edge[1][i], ez = e->edge[2][i];
        const float offset = normal[0][i] * ex + normal[1][i] * ey + normal[2][i] * ez;
        const float xx = rest[0][i] + own[0], xy = rest[1][i] + own[1], xz = rest[2][i] + own[2];
        const float yy = rest[3][i] + own[3], yz = rest[4][i] + own[4], zz = rest[5][i] + own[5];
        const float gx = rest[0][i] * ex + rest[1][i] * ey + rest[2][i] * ez;
        const float gy = rest[1][i] * ex + rest[3][i] * ey + rest[4][i] * ez;
        const float gz = rest[2][i] * ex + rest[4][i] * ey + rest[5][i] * ez;
        const float trace = xx + yy + zz;
        const float pull = (float)SHAPE_WEIGHT * trace;

        /* unit normal and height of the plane */
        const float nx = normal[0][i] + fan.normal[0], ny = normal[1][i] + fan.normal[1];
        const float nz = normal[2][i] + fan.normal[2];
        const float square = nx * nx + ny * ny + nz * nz;
        const bool has_plane = square > (float)PLANE_FLOOR * trace;
        const float scale = 1 / sqrtf(has_plane ? square : 1);
        const float ux = nx * scale, uy = ny * scale, uz = has_plane ? nz * scale : 1;
        const float height = offset * scale;

        /* an orthonormal frame s, t of it, without a branch on its direction */
        const float sign = uz < 0 ? -1.0f : 1.0f;
        const float a = -1 / (sign + uz), b = ux * uy * a;
        const float sx = 1 + sign * ux * ux * a, sy = sign * b, sz = -sign * ux;
        const float tx = b, ty = sign + uy * uy * a, tz = -uy;

        /* x = height u + p s + q t: the form's gradient along s and t is to vanish */
        const float msx = xx * sx + xy * sy + xz * sz, msy = xy * sx + yy * sy + yz * sz;
        const float msz = xz * sx + yz * sy + zz * sz;
        const float mtx = xx * tx + xy * ty + xz * tz, mty = xy * tx + yy * ty + yz * tz;
        const float mtz = xz * tx + yz * ty + zz * tz;
        const float m00 = sx * msx + sy * msy + sz * msz + pull;
        const float m01 = sx * mtx + sy * mty + sz * mtz;
        const float m11 = tx * mtx + ty * mty + tz * mtz + pull;
        const float cx = gx + pull * ex / 2, cy = gy + pull * ey / 2, cz = gz + pull * ez / 2;
        const float g0 = sx * cx + sy * cy + sz * cz - height * (ux * msx + uy * msy + uz * msz);
        const float g1 = tx * cx + ty * cy + tz * cz - height * (ux * mtx + uy * mty + uz * mtz);
        const float determinant = 1 / (m00 * m11 - m01 * m01);
        float p = (m11 * g0 - m01 * g1) * determinant;
        float q = (m00 * g1 - m01 * g0) * determinant;
        /* what the pull did where it was not meant: what is left to solve is the pull itself */
        float dp = p - (sx * ex + sy * ey + sz * ez) / 2;
        float dq = q - (tx * ex + ty * ey + tz * ez) / 2;
        for (int round = 0; round < REFINEMENTS; round++) {
            const float rp = pull * dp, rq = pull * dq;
            dp = (m11 * rp - m01 * rq) * determinant;
            dq = (m00 * rq - m01 * rp) * determinant;
            p += dp;
            q += dq;
        }
        const float px = height * ux + p * sx + q * tx - ex / 2;
        const float py = height * uy + p * sy + q * ty - ey / 2;
        const float pz = height * uz + p * sz + q * tz - ez / 2;

        /* too far (or not a number): the middle's foot on the plane, or the middle itself */
        const bool near = has_plane && px * px + py * py + pz * pz <= reach_square;
        const float lift = height - (ux * ex + uy * ey + uz * ez) / 2;
        const float safe_lift = has_plane && lift * lift <= reach_square ? lift : 0;
        e->at[0][i] = ex / 2 + (near ? px : safe_lift * ux);
        e->at[1][i] = ey / 2 + (near ? py : safe_lift * uy);
        e->at[2][i] = ez / 2 + (near ? pz : safe_lift * uz);
    }
    for (int i = 0; i < LANES; i++)
        e->cost[i] = cost_at(&fan, rest, e, i, e->at[0][i], e->at[1][i], e->at[2][i]);
}

static void place_lanes_scalar(const struct fan *fan, float reach_square, struct edge_lanes *e)
{
    place_lanes(*fan, reach_square, e);
}

LANES_AVX2 static void place_lanes_avx2(const struct fan *fan, float reach_square,
                                        struct edge_lanes *e)
{
    place_lanes(*fan, reach_square, e);
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
    for (int i = 0; i < LANES; i++) {
        const float squares = own + (e->square[0][i] + e->square[3][i] + e->square[5][i]);
        const float cost = e->cost[i] / (sqrtf(sqrtf(squares > 0 ? squares : 0)) + 1e-30f);
        e->cost[i] = cost < 3e38f ? cost : INFINITY;
    }
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

void edge_lanes_ends(const struct fan *fan, struct edge_lanes *e)
{
    float rest[6][LANES], normal[3][LANES];
    rest_of_fan(e, rest, normal);
    for (int i = 0; i < LANES; i++) {
        e->cost_here[i] = cost_at(fan, rest, e, i, 0, 0, 0);
        e->cost_there[i] = cost_at(fan, rest, e, i, e->edge[0][i], e->edge[1][i], e->edge[2][i]);
    }
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
    float rest_lanes[6][LANES], normal[3][LANES];
    double own[6], rest[6], sum[6], g[3], x[3], middle[3], edge[3];
    rest_of_fan(e, rest_lanes, normal);
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
