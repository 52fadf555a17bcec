/* Exact predicates on the grid, and whether loops are simple: against slow definitions. */
#include <math.h>

#include "geom/point_tree.h"
#include "geom/simple_loop.h"
#include "test_kit.h"
#include "test_shapes.h"

#include <stdlib.h>

static struct grid_point random_point(uint64_t *seed, int32_t size)
{
    return (struct grid_point){(int32_t)random_below(seed, (uint64_t)size + 1),
                               (int32_t)random_below(seed, (uint64_t)size + 1)};
}

static __int128 exact_orientation(struct grid_point a, struct grid_point b, struct grid_point c)
{
    return ((__int128)b.x - a.x) * ((__int128)c.y - a.y) -
           ((__int128)b.y - a.y) * ((__int128)c.x - a.x);
}

static void orientation_is_exact_at_the_ends_of_the_grid(void **state)
{
    (void)state;
    const int32_t ends[] = {0, 1, GRID_SIZE / 2, GRID_SIZE - 1, GRID_SIZE};
    struct grid_point p[25];
    for (int i = 0; i < 25; i++)
        p[i] = (struct grid_point){ends[i % 5], ends[i / 5]};
    for (int a = 0; a < 25; a++)
        for (int b = 0; b < 25; b++)
            for (int c = 0; c < 25; c++)
                assert_true(exact_orientation(p[a], p[b], p[c]) == orientation(p[a], p[b], p[c]));
    /* Nearly in line over the whole grid: doubles would say 0. */
    struct grid_point a = {0, 0}, b = {GRID_SIZE, GRID_SIZE - 1},
                      c = {GRID_SIZE - 1, GRID_SIZE - 2};
    assert_true(orientation(a, b, c) == -1);
}

/* Do the closed segments share a point? All points with denominators up to 60 are not enough, but
 * clipping the parameter range exactly is: solve on rationals by the two lines' parameters. */
static bool touch_by_parameters(struct grid_point a, struct grid_point b, struct grid_point c,
                                struct grid_point d)
{
    __int128 ux = b.x - a.x, uy = b.y - a.y, vx = d.x - c.x, vy = d.y - c.y;
    __int128 wx = c.x - a.x, wy = c.y - a.y, det = ux * vy - uy * vx;
    if (det != 0) { /* a + s u = c + t v */
        __int128 s = wx * vy - wy * vx, t = wx * uy - wy * ux;
        if (det < 0) {
            det = -det;
            s = -s;
            t = -t;
        }
        return s >= 0 && s <= det && t >= 0 && t <= det;
    }
    /* Parallel or without length: some end lies on the other segment. */
    struct grid_point ends[4] = {a, b, c, d};
    for (int i = 0; i < 4; i++) {
        struct grid_point p = ends[i], q = i < 2 ? c : a, r = i < 2 ? d : b;
        __int128 along = ((__int128)p.x - q.x) * ((__int128)p.x - r.x) +
                         ((__int128)p.y - q.y) * ((__int128)p.y - r.y);
        if (exact_orientation(q, r, p) == 0 && along <= 0)
            return true;
    }
    return false;
}

static void segments_agree_with_the_definition(void **state)
{
    (void)state;
    uint64_t seed = 1;
    size_t touching = 0, crossing = 0;
    for (int i = 0; i < 300000; i++) {
        int32_t size = i % 3 == 0 ? 4 : i % 3 == 1 ? 12 : GRID_SIZE;
        struct grid_point a = random_point(&seed, size), b = random_point(&seed, size);
        struct grid_point c = random_point(&seed, size), d = random_point(&seed, size);
        bool expected = touch_by_parameters(a, b, c, d);
        assert_int_equal(segments_touch(a, b, c, d), expected);
        bool crosses = segments_cross(a, b, c, d);
        assert_true(expected || !crosses);
        bool end_on_line = orientation(a, b, c) == 0 || orientation(a, b, d) == 0 ||
                           orientation(c, d, a) == 0 || orientation(c, d, b) == 0;
        assert_int_equal(crosses, expected && !end_on_line);
        touching += expected;
        crossing += crosses;
    }
    assert_true(touching > 30000 && crossing > 10000 && touching < 270000);
}

static bool is_simple_by_pairs(const struct grid_point *p, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++)
        for (uint32_t j = i + 1; j < n; j++) {
            uint32_t i_end = (i + 1) % n, j_end = (j + 1) % n;
            if (i_end == j || j_end == i) {
                struct grid_point at = i_end == j ? p[j] : p[i];
                struct grid_point a = i_end == j ? p[i] : p[j],
                                  b = i_end == j ? p[j_end] : p[i_end];
                if (exact_orientation(at, a, b) == 0 && grid_dot(at, a, b) >= 0)
                    return false;
            } else if (touch_by_parameters(p[i], p[i_end], p[j], p[j_end])) {
                return false;
            }
        }
    return true;
}

static bool is_simple(struct context *ctx, struct scratch *scratch, const struct grid_point *p,
                      uint32_t n)
{
    bool simple;
    assert_int_equal(loop_is_simple(ctx, scratch, p, n, &simple), STATUS_OK);
    return simple;
}

/* A loop round the centre with points at random distances is simple; moving one may break it. */
static void make_star(struct grid_point *p, uint32_t n, int32_t size, uint64_t *seed)
{
    struct shape shape = shape_star_polygon(n, random_next(seed));
    for (uint32_t i = 0; i < n; i++) {
        p[i].x = (int32_t)((shape.positions[3 * i] + 1) / 2 * size);
        p[i].y = (int32_t)((shape.positions[3 * i + 1] + 1) / 2 * size);
    }
    shape_free(&shape);
}

/* Bends a loop to a horseshoe, of which no place sees all. */
static void bend(struct grid_point *p, uint32_t n, int32_t size)
{
    for (uint32_t i = 0; i < n; i++) {
        const double angle = 5.5 * p[i].x / size, radius = 0.3 + 0.2 * p[i].y / size;
        p[i].x = (int32_t)((0.5 + radius * cos(angle)) * size);
        p[i].y = (int32_t)((0.5 + radius * sin(angle)) * size);
    }
}

static void loops_agree_with_the_definition(void **state)
{
    (void)state;
    struct context ctx;
    context_init(&ctx);
    struct scratch scratch = {0};
    struct grid_point p[100];
    uint64_t seed = 2;
    size_t simple = 0, total = 0;
    for (uint32_t round = 0; round < 6000; round++) {
        uint32_t n = 3 + (uint32_t)random_below(&seed, round % 2 ? 12 : 90);
        int32_t size = round % 5 == 0 ? 6 : round % 5 == 1 ? 1000 : GRID_SIZE;
        if (round % 4 == 0)
            for (uint32_t i = 0; i < n; i++)
                p[i] = random_point(&seed, size);
        else
            make_star(p, n, size, &seed);
        if (round % 7 < 2)
            bend(p, n, size);
        if (round % 4 == 2)
            p[random_below(&seed, n)] = random_point(&seed, size);
        if (round % 4 == 3) /* a touch: a corner moved into another, or onto an edge's middle */
            p[random_below(&seed, n)] = p[random_below(&seed, n)];
        bool expected = is_simple_by_pairs(p, n);
        assert_int_equal(is_simple(&ctx, &scratch, p, n), expected);
        simple += expected;
        total++;
    }
    assert_true(simple > total / 6 && simple < total * 5 / 6);
    scratch_clear(&ctx, &scratch);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

/* Pentagrams and the like turn left all the way and go round their middle more than once. */
static void loops_that_go_round_twice_are_not_simple(void **state)
{
    (void)state;
    struct context ctx;
    context_init(&ctx);
    struct scratch scratch = {0};
    struct grid_point p[61];
    for (uint32_t n = 5; n <= 61; n += 2)
        for (uint32_t rounds = 1; rounds <= 2; rounds++) {
            for (uint32_t i = 0; i < n; i++) {
                const double angle = 2 * acos(-1) * rounds * i / n, radius = i % 2 ? 0.4 : 0.3;
                p[i].x = (int32_t)((0.5 + radius * cos(angle)) * GRID_SIZE);
                p[i].y = (int32_t)((0.5 + radius * sin(angle)) * GRID_SIZE);
            }
            assert_int_equal(is_simple(&ctx, &scratch, p, n), rounds == 1);
        }
    scratch_clear(&ctx, &scratch);
    context_clear(&ctx);
}

static void straight_and_vertical_edges_are_no_crossing(void **state)
{
    (void)state;
    struct context ctx;
    context_init(&ctx);
    struct scratch scratch = {0};
    struct grid_point p[80];
    uint32_t n = 0;
    /* A rectangular spiral comb of many corners in line, clockwise and not convex: all edges are
     * axis-parallel, many corners share x or y. */
    for (int32_t i = 0; i < 20; i++) {
        p[n++] = (struct grid_point){10 * i, i % 2 ? 50 : 0};
        p[n++] = (struct grid_point){10 * i + 10, i % 2 ? 50 : 0};
    }
    for (int32_t i = 20; i >= 0; i--)
        p[n++] = (struct grid_point){10 * i, 100};
    assert_true(is_simple_by_pairs(p, n));
    assert_true(is_simple(&ctx, &scratch, p, n));
    p[5].y = 100; /* now it reaches the top side */
    assert_false(is_simple(&ctx, &scratch, p, n));
    scratch_clear(&ctx, &scratch);
    context_clear(&ctx);
}

static void large_combs_are_tested_quickly(void **state)
{
    (void)state;
    struct context ctx;
    context_init(&ctx);
    struct scratch scratch = {0};
    enum { TEETH = 40000 };
    struct grid_point *p = malloc((2 * TEETH + 2) * sizeof *p);
    assert_non_null(p);
    /* Long slanting teeth: every tooth's bounding box overlaps most others. */
    uint32_t n = 0;
    for (int32_t i = 0; i < TEETH; i++) {
        p[n++] = (struct grid_point){5000 * i, 100};
        p[n++] = (struct grid_point){5000 * i + 800000000, 800000000};
    }
    p[n - 1] = (struct grid_point){GRID_SIZE, 860000000};
    p[n++] = (struct grid_point){1000000000, 1};
    p[n++] = (struct grid_point){0, 1};
    assert_true(is_simple(&ctx, &scratch, p, n));
    p[n / 2 - n / 2 % 2].x += 5001;
    assert_false(is_simple(&ctx, &scratch, p, n));
    free(p);
    scratch_clear(&ctx, &scratch);
    context_clear(&ctx);
}

static bool accept_all(const void *user, uint32_t point)
{
    (void)user;
    (void)point;
    return true;
}

static void tree_finds_what_a_plain_loop_finds(void **state)
{
    (void)state;
    uint64_t seed = 3;
    size_t found_some = 0;
    for (uint32_t round = 0; round < 60; round++) {
        uint32_t n = 1 + (uint32_t)random_below(&seed, 700);
        struct grid_point *p = malloc(n * sizeof *p);
        uint8_t *is_on = malloc(n);
        void *memory = malloc(point_tree_size(n));
        assert_true(p && is_on && memory);
        for (uint32_t i = 0; i < n; i++) {
            p[i] = random_point(&seed, round % 2 ? 40 : GRID_SIZE);
            is_on[i] = random_below(&seed, 4) == 0;
        }
        struct point_tree tree;
        point_tree_build(&tree, p, n, is_on, memory);
        for (uint32_t query = 0; query < 200; query++) {
            point_tree_switch(&tree, (uint32_t)random_below(&seed, n), random_below(&seed, 2));
            struct grid_point a = random_point(&seed, round % 2 ? 40 : GRID_SIZE),
                              b = random_point(&seed, round % 2 ? 40 : GRID_SIZE),
                              c = random_point(&seed, round % 2 ? 40 : GRID_SIZE);
            if (orientation(a, b, c) <= 0)
                continue;
            bool expected = false;
            for (uint32_t i = 0; i < n; i++)
                expected |= is_on[i] && triangle_holds(a, b, c, p[i]);
            uint32_t found = point_tree_find(&tree, a, b, c, accept_all, NULL);
            assert_int_equal(found != UINT32_MAX, expected);
            if (expected)
                assert_true(is_on[found] && triangle_holds(a, b, c, p[found]));
            found_some += expected;
        }
        free(memory);
        free(is_on);
        free(p);
    }
    assert_true(found_some > 1000);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(orientation_is_exact_at_the_ends_of_the_grid),
        cmocka_unit_test(segments_agree_with_the_definition),
        cmocka_unit_test(loops_agree_with_the_definition),
        cmocka_unit_test(loops_that_go_round_twice_are_not_simple),
        cmocka_unit_test(straight_and_vertical_edges_are_no_crossing),
        cmocka_unit_test(large_combs_are_tested_quickly),
        cmocka_unit_test(tree_finds_what_a_plain_loop_finds),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
