/*
 * Smooth handles and tunnels: a bagel with a small handle, a thin tunnel, or both loses them and
 * keeps its own hole. The bagels are level sets of smooth functions, cut into triangles by marching
 * tetrahedra, so that no edge is sharp.
 */
#include "test_kit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test_topology_kit.h"

/* ---- smooth solids ---- */

enum { HAS_HANDLE = 1, HAS_TUNNEL = 2, HAS_TWO = 4 };

/* Distance from a ring of radius r and thickness t in the plane of the first two numbers. */
static double ring(double x, double y, double z, double r, double t)
{
    return hypot(hypot(x, y) - r, z) - t;
}

/* The smaller of two, rounded where they meet. */
static double blend(double a, double b, double width)
{
    double h = fmax(width - fabs(a - b), 0) / width;
    return fmin(a, b) - h * h * width / 4;
}

/* Negative inside. A bagel of radius 1 and thickness 0.4 (so its own shortest loop has diameter
 * 0.8); handles stand on it at both sides; a tunnel leads through it upwards. */
static double solid(double x, double y, double z, unsigned parts)
{
    double f = ring(x, y, z, 1, 0.4);
    if (parts & HAS_HANDLE)
        f = blend(f, ring(x - 1, z - 0.45, y, 0.2, 0.07), 0.05);
    if (parts & HAS_TWO)
        f = blend(f, ring(x + 1, z + 0.45, y, 0.2, 0.07), 0.05);
    if (parts & HAS_TUNNEL)
        f = -blend(-f, hypot(x, y - 1) - 0.1, 0.05);
    return f;
}

/* ---- marching tetrahedra ---- */

enum { CELLS = 44, SIDE = CELLS + 1 };

struct grid {
    double low, step;
    double *values;
    uint32_t *cuts; /* of edges, eight a grid point: by the direction's bits */
    struct shape shape;
};

static size_t point_at(unsigned i, unsigned j, unsigned k)
{
    return ((size_t)i * SIDE + j) * SIDE + k;
}

/* The vertex on the edge between two corners of a cell, given as bits; `base` is the cell's. */
static uint32_t cut_edge(struct grid *grid, const unsigned base[3], unsigned a, unsigned b)
{
    unsigned low = a & b, direction = a ^ b; /* one is part of the other */
    double p[3];
    size_t from = point_at(base[0] + (low & 1), base[1] + (low >> 1 & 1), base[2] + (low >> 2));
    size_t to = from + (direction & 1 ? (size_t)SIDE * SIDE : 0) + (direction & 2 ? SIDE : 0) +
                (direction & 4 ? 1 : 0);
    uint32_t *cut = &grid->cuts[8 * from + direction];
    if (*cut == UINT32_MAX) {
        double t = grid->values[from] / (grid->values[from] - grid->values[to]);
        for (unsigned c = 0; c < 3; c++)
            p[c] = grid->low + grid->step * (base[c] + (low >> c & 1) + t * (direction >> c & 1));
        *cut = shape_vertex(&grid->shape, (float)p[0], (float)p[1], (float)p[2]);
    }
    return *cut;
}

/* One tetrahedron with its corners in positive order. */
static void march(struct grid *grid, const unsigned base[3], const unsigned corners[4])
{
    unsigned inside[4], outside[4], in = 0, out = 0, parity = 0;
    for (unsigned i = 0; i < 4; i++) {
        unsigned c = corners[i];
        bool is_in =
            grid->values[point_at(base[0] + (c & 1), base[1] + (c >> 1 & 1), base[2] + (c >> 2))] <
            0;
        if (is_in) {
            parity += out; /* swaps that bring it before those outside */
            inside[in++] = c;
        } else
            outside[out++] = c;
    }
    if (in == 0 || out == 0)
        return;
    uint32_t v[4];
    if (in == 1 || out == 1) {
        for (unsigned i = 0; i < 3; i++)
            v[i] = in == 1 ? cut_edge(grid, base, inside[0], outside[i])
                           : cut_edge(grid, base, inside[i], outside[0]);
        if ((parity & 1) != 0)
            shape_triangle(&grid->shape, v[0], v[2], v[1]);
        else
            shape_triangle(&grid->shape, v[0], v[1], v[2]);
        return;
    }
    v[0] = cut_edge(grid, base, inside[0], outside[0]);
    v[1] = cut_edge(grid, base, inside[0], outside[1]);
    v[2] = cut_edge(grid, base, inside[1], outside[1]);
    v[3] = cut_edge(grid, base, inside[1], outside[0]);
    if ((parity & 1) != 0) {
        shape_triangle(&grid->shape, v[0], v[1], v[2]);
        shape_triangle(&grid->shape, v[0], v[2], v[3]);
    } else {
        shape_triangle(&grid->shape, v[0], v[2], v[1]);
        shape_triangle(&grid->shape, v[0], v[3], v[2]);
    }
}

static struct shape bagel(unsigned parts)
{
    /* Six tetrahedra round the cell's diagonal; those of odd permutations are turned. */
    static const unsigned corners[6][4] = {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7},
                                           {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}};
    struct grid grid = {.low = -1.7, .step = 3.4 / CELLS};
    size_t points = (size_t)SIDE * SIDE * SIDE;
    grid.values = malloc(points * sizeof *grid.values);
    grid.cuts = malloc(8 * points * sizeof *grid.cuts);
    memset(grid.cuts, 0xff, 8 * points * sizeof *grid.cuts);
    for (unsigned i = 0; i < SIDE; i++)
        for (unsigned j = 0; j < SIDE; j++)
            for (unsigned k = 0; k < SIDE; k++)
                grid.values[point_at(i, j, k)] =
                    solid(grid.low + grid.step * i, grid.low + grid.step * j,
                          grid.low + grid.step * k, parts);
    for (unsigned i = 0; i < CELLS; i++)
        for (unsigned j = 0; j < CELLS; j++)
            for (unsigned k = 0; k < CELLS; k++)
                for (unsigned t = 0; t < 6; t++)
                    march(&grid, (const unsigned[]){i, j, k}, corners[t]);
    free(grid.values);
    free(grid.cuts);
    return grid.shape;
}

/* ---- tests ---- */

static void expect_genus(const struct shape *shape, double size, bool smooth, unsigned slab_shift,
                         long genus, size_t handles)
{
    struct topology_options options;
    struct operated out;
    topology_defaults(&options);
    options.max_feature.value = size;
    options.smooth_features = smooth;
    operate(shape, &options, slab_shift, &out);
    assert_true(facts_manifold(&out.facts));
    assert_int_equal(out.facts.border_edges, 0);
    assert_int_equal(out.facts.components, 1);
    assert_int_equal(out.facts.euler, 2 - 2 * genus);
    assert_int_equal(out.report.counts[FEATURE_HANDLE], handles);
    for (size_t i = 0; i < out.report.feature_count; i++)
        assert_true(out.report.features[i].size < size);
    operated_clear(&out);
}

static void small_handles_go_and_the_bagel_stays(void **state)
{
    (void)state;
    static const struct {
        unsigned parts;
        long genus;
    } cases[] = {{0, 1},
                 {HAS_HANDLE, 2},
                 {HAS_TUNNEL, 2},
                 {HAS_HANDLE | HAS_TUNNEL, 3},
                 {HAS_HANDLE | HAS_TWO | HAS_TUNNEL, 4}};
    for (unsigned i = 0; i < 5; i++) {
        struct shape shape = bagel(cases[i].parts);
        long genus = cases[i].genus;
        expect_genus(&shape, 0.4, false, 0, genus, 0);
        expect_genus(&shape, 0.06, true, 0, genus, 0);
        expect_genus(&shape, 0.4, true, 0, 1, (size_t)(genus - 1));
        expect_genus(&shape, 0.4, true, 9, 1, (size_t)(genus - 1)); /* many slabs */
        expect_genus(&shape, 2, true, 0, 0, (size_t)genus);
        shape_free(&shape);
    }
}

/* A thin tube is cut once, not once at every place where it could be. */
static void a_thin_ring_is_cut_once(void **state)
{
    (void)state;
    struct shape shape = shape_torus(120, 12);
    for (size_t i = 0; i < shape.vertex_count; i++) {
        double *p = shape.positions + 3 * i, r = hypot(p[0], p[1]), f = (1 + (r - 1) / 8) / r;
        p[0] = (float)(p[0] * f);
        p[1] = (float)(p[1] * f);
        p[2] = (float)(p[2] / 8);
    }
    expect_genus(&shape, 0.05, true, 0, 1, 0);
    expect_genus(&shape, 0.2, true, 0, 0, 1);
    shape_free(&shape);
}

/* What closes the borders of a surface is no handle. */
static void openings_are_no_handles(void **state)
{
    (void)state;
    struct shape shape = shape_grid_with_holes(12, 12);
    struct topology_options options;
    struct operated out;
    topology_defaults(&options);
    options.max_feature.value = 4;
    options.smooth_features = true;
    operate(&shape, &options, 0, &out);
    assert_int_equal(out.facts.border_loops, 10);
    assert_int_equal(out.report.feature_count, 0);
    operated_clear(&out);
    shape_free(&shape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(small_handles_go_and_the_bagel_stays),
        cmocka_unit_test(a_thin_ring_is_cut_once),
        cmocka_unit_test(openings_are_no_handles),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
