/*
 * Geometry that hurts: meshes whose combinatorics are fair and whose coordinates are not, and
 * meshes that are extreme in another way. Each goes through all stages, both modes and three
 * levels, and every output is manifold with the store's components, border loops and Euler
 * characteristic.
 */
#include "mesh/import.h"
#include "simplify/simplify.h"
#include "test_facts.h"
#include "test_kit.h"
#include "test_shapes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static void must(enum status status, const struct context *ctx)
{
    if (status != STATUS_OK && status != STATUS_TARGET_MISSED)
        fail_msg("status %d: %s", (int)status, ctx->error);
}

static struct facts facts_of_store(const char *path)
{
    struct context ctx;
    struct store *store;
    struct mesh mesh;
    context_init(&ctx);
    must(store_open(&ctx, path, true, &store), &ctx);
    must(store_load(store, &mesh), &ctx);
    struct facts facts = facts_of(&mesh);
    assert_true(facts_manifold(&facts));
    mesh_clear(&ctx, &mesh);
    store_close(&store);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return facts;
}

static void check_level(const char *name, const struct level *level, const struct facts *original)
{
    struct context ctx;
    struct mesh mesh;
    context_init(&ctx);
    must(mesh_load(&ctx, test_path(name), &mesh), &ctx);
    for (uint64_t i = 0; i < 3 * mesh.vertex_count; i++)
        assert_true(isfinite(mesh.positions[i]));
    struct facts facts = facts_of(&mesh);
    assert_true(facts_manifold(&facts));
    assert_true(facts_same_topology(&facts, original));
    assert_int_equal(facts.unused, 0);
    assert_true(facts.faces <= original->faces);
    assert_int_equal(facts.faces, level->faces);
    mesh_clear(&ctx, &mesh);
    context_clear(&ctx);
}

static void check_levels(const struct facts *original, enum lod_mode mode, enum placement place)
{
    struct context ctx;
    context_init(&ctx);
    struct target target = {
        .kind = TARGET_FACES,
        .count = 3,
        .values = {(double)(original->faces / 2 + 1), (double)(original->faces / 10 + 1), 1},
        .mode = mode,
        .effort = 2};
    struct patch_request request = {
        .patch_angle = {-1, -1}, .face_angle = {-1, -1}, .smoothings = -1, .chain_tolerance = -1};
    const char *store = test_path("mesh.store"), *chains = test_path("mesh.chains");
    must(chain_build(&ctx, store, chains, &target, &request, NULL), &ctx);
    must(chain_file_check(&ctx, chains), &ctx);
    struct lod_options options = {.target = target,
                                  .place = place,
                                  .output = test_path("level-%d.ply"),
                                  .export = {.format = EXPORT_PLY}};
    struct lod_report report;
    must(lod_build(&ctx, chains, &options, &report), &ctx);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    assert_int_equal(report.level_count, 3);
    check_level("level-0.ply", &report.levels[0], original);
    check_level("level-1.ply", &report.levels[1], original);
    check_level("level-2.ply", &report.levels[2], original);
}

/* Frees the shape. What import found is in *info (may be NULL). */
static struct facts put_through(struct shape *shape, struct store_info *info)
{
    struct context ctx;
    struct store_info own;
    context_init(&ctx);
    const char *input = test_path("mesh.ply"), *store = test_path("mesh.store");
    /* The PLY has one byte for the number of corners. */
    shape_write(shape, shape->sizes[0] > 255 ? SHAPE_OFF : SHAPE_PLY_LITTLE, input);
    shape_free(shape);
    struct import_options options = {.sync = false};
    must(store_build(&ctx, &input, 1, store, &options, info ? info : &own), &ctx);
    must(store_check(&ctx, store), &ctx);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    struct facts facts = facts_of_store(store);
    check_levels(&facts, MODE_COLLAPSE, PLACE_OPTIMAL);
    check_levels(&facts, MODE_COLLAPSE, PLACE_SUBSET);
    check_levels(&facts, MODE_CLASSIC, PLACE_SUBSET);
    return facts;
}

/* ---- coordinates ---- */

static void all_vertices_at_one_point(void **state)
{
    (void)state;
    struct shape shape = shape_icosphere(3);
    shape_move(&shape, 0, 1, 2, 3);
    struct facts facts = put_through(&shape, NULL);
    assert_int_equal(facts.euler, 2);
    shape = shape_grid_with_holes(16, 8);
    shape_move(&shape, 0, 0, 0, 0);
    facts = put_through(&shape, NULL);
    assert_int_equal(facts.border_loops, 9);
}

static void all_vertices_on_a_line(void **state)
{
    (void)state;
    struct shape shape = shape_icosphere(3);
    for (size_t v = 0; v < shape.vertex_count; v++)
        shape.positions[3 * v + 1] = shape.positions[3 * v + 2] = 0;
    struct store_info info;
    put_through(&shape, &info);
    assert_int_equal(info.cleaning.zero_area_faces, info.topology.faces);
}

static void all_vertices_in_a_plane(void **state)
{
    (void)state;
    struct shape shape = shape_icosphere(3); /* pressed flat: two layers */
    for (size_t v = 0; v < shape.vertex_count; v++)
        shape.positions[3 * v + 2] = 0;
    struct facts facts = put_through(&shape, NULL);
    assert_int_equal(facts.euler, 2);
    shape = shape_grid_with_holes(24, 16);
    put_through(&shape, NULL);
}

/* Squares of such lengths overflow, and scaled down the small number would be none. */
static void numbers_of_all_sizes(void **state)
{
    (void)state;
    uint64_t seed = 1;
    for (int round = 0; round < 20; round++) {
        struct shape shape = shape_torus(6, 4);
        for (int i = 0; i < 12; i++)
            shape.positions[random_below(&seed, 72)] =
                (random_unit(&seed) - 0.5) * pow(10, 54 * random_unit(&seed) - 17);
        struct facts facts = put_through(&shape, NULL);
        assert_int_equal(facts.euler, 0);
    }
}

/* The height and what float32 makes of it differ by the whole height. */
static void flatter_than_float32_can_tell(void **state)
{
    (void)state;
    struct shape shape = shape_grid_with_holes(8, 4);
    shape_move(&shape, 1, 0, 0, 0);
    for (size_t v = 0; v < shape.vertex_count; v++)
        shape.positions[3 * v + 2] = v % 3 == 0 ? 1e-45 : 0;
    shape.positions[1] = 42949672950.0; /* no float32: doubles */
    put_through(&shape, NULL);
}

static void differences_in_the_last_bit(void **state)
{
    (void)state;
    struct shape shape = shape_icosphere(3);
    for (size_t i = 0; i < 3 * shape.vertex_count; i++) /* a ball of three steps' radius */
        shape.positions[i] = 1 + rint(3 * shape.positions[i]) / (1 << 23);
    struct store_info info;
    put_through(&shape, &info);
    assert_true(info.is_float32);
}

static void slivers(void **state)
{
    (void)state;
    struct shape shape = shape_grid(40, 20);
    for (size_t v = 0; v < shape.vertex_count; v++)
        shape.positions[3 * v] *= 1e7;
    put_through(&shape, NULL);
    shape = shape_noisy_torus(40, 12, 0.01, 3);
    for (size_t v = 0; v < shape.vertex_count; v++)
        shape.positions[3 * v + 2] = (double)(float)(shape.positions[3 * v + 2] * 1e-7);
    struct facts facts = put_through(&shape, NULL);
    assert_int_equal(facts.euler, 0);
}

/* Cuts one side of some edges in the middle and fills the gap with a face of no area. */
static void zero_area_faces_in_a_closed_surface(void **state)
{
    (void)state;
    struct shape ball = shape_icosphere(3), shape = {0};
    for (size_t v = 0; v < ball.vertex_count; v++) /* so coarse that middles are exact */
        shape_vertex(&shape, rint(ball.positions[3 * v] * 4096) / 4096,
                     rint(ball.positions[3 * v + 1] * 4096) / 4096,
                     rint(ball.positions[3 * v + 2] * 4096) / 4096);
    size_t cuts = 0;
    for (size_t f = 0; f < ball.face_count; f++) {
        const uint32_t *corner = ball.indices + 3 * f;
        uint32_t a = corner[0], b = corner[1], c = corner[2];
        if (f % 3 != 0) {
            shape_triangle(&shape, a, b, c);
            continue;
        }
        const double *p = shape.positions + 3 * (size_t)a, *q = shape.positions + 3 * (size_t)b;
        uint32_t middle =
            shape_vertex(&shape, (p[0] + q[0]) / 2, (p[1] + q[1]) / 2, (p[2] + q[2]) / 2);
        shape_triangle(&shape, a, middle, c);
        shape_triangle(&shape, middle, b, c);
        shape_triangle(&shape, a, b, middle);
        cuts++;
    }
    shape_free(&ball);
    struct store_info info;
    struct facts facts = put_through(&shape, &info);
    assert_int_equal(info.cleaning.zero_area_faces, cuts);
    assert_int_equal(facts.border_edges, 0);
    assert_int_equal(facts.euler, 2);
}

static void faces_folded_on_themselves(void **state)
{
    (void)state;
    struct shape shape = shape_grid(24, 24);
    for (size_t v = 0; v < shape.vertex_count; v++) { /* like a letter, both ways */
        shape.positions[3 * v] = fabs(shape.positions[3 * v] - 12);
        shape.positions[3 * v + 1] = fabs(shape.positions[3 * v + 1] - 9);
    }
    put_through(&shape, NULL);
    shape = shape_noisy_sphere(4, 0.4, 5); /* noise of many edge lengths: turned over everywhere */
    put_through(&shape, NULL);
}

static void far_from_the_origin(void **state)
{
    (void)state;
    struct shape shape = shape_noisy_sphere(4, 0.002, 9);
    shape_move(&shape, 1, 5e6, -5e6, 123.456);
    struct store_info info;
    put_through(&shape, &info);
    assert_false(info.is_float32);
    struct context ctx;
    struct mesh mesh;
    context_init(&ctx);
    must(mesh_load(&ctx, test_path("level-0.ply"), &mesh), &ctx); /* mode classic: input vertices */
    assert_false(mesh.is_float32);
    struct shape again = shape_noisy_sphere(4, 0.002, 9);
    shape_move(&again, 1, 5e6, -5e6, 123.456);
    for (uint64_t v = 0; v < mesh.vertex_count; v += 7) {
        double least = INFINITY;
        for (size_t w = 0; w < again.vertex_count; w++) {
            double distance = 0;
            for (unsigned k = 0; k < 3; k++)
                distance =
                    fmax(distance, fabs(mesh.positions[3 * v + k] - again.positions[3 * w + k]));
            least = fmin(least, distance);
        }
        assert_true(least <= 2.1 / (1 << 24)); /* of the extent, 2 and a little */
    }
    shape_free(&again);
    mesh_clear(&ctx, &mesh);
    context_clear(&ctx);
}

/* ---- combinatorics ---- */

/* Two fans with a common ring of n corners, in a plane but for their tips. */
static struct shape bipyramid(uint32_t n, double height)
{
    struct shape shape = {0};
    uint32_t north = shape_vertex(&shape, 0, 0, height);
    uint32_t south = shape_vertex(&shape, 0, 0, -height);
    for (uint32_t i = 0; i < n; i++) {
        double angle = 6.283185307179586 * i / n;
        shape_vertex(&shape, (double)(float)cos(angle), (double)(float)sin(angle), 0);
    }
    for (uint32_t i = 0; i < n; i++) {
        shape_triangle(&shape, north, 2 + i, 2 + (i + 1) % n);
        shape_triangle(&shape, south, 2 + (i + 1) % n, 2 + i);
    }
    return shape;
}

static void ten_thousand_faces_at_a_vertex(void **state)
{
    (void)state;
    struct shape shape = bipyramid(10000, 0.5);
    struct facts facts = put_through(&shape, NULL);
    assert_int_equal(facts.faces, 20000);
}

static void a_sphere_of_two_patches(void **state)
{
    (void)state;
    struct shape shape = bipyramid(64, 1.0 / 1024);
    struct facts facts = put_through(&shape, NULL);
    assert_int_equal(facts.euler, 2);
    shape = bipyramid(3, 0); /* and the smallest of them */
    put_through(&shape, NULL);
}

static void a_hundred_thousand_components(void **state)
{
    (void)state;
    struct shape shape = {0};
    for (unsigned i = 0; i < 100000; i++) {
        double x = i % 320, y = i / 320;
        uint32_t a = shape_vertex(&shape, x, y, 0), b = shape_vertex(&shape, x + 0.5, y, 0);
        uint32_t c = shape_vertex(&shape, x, y + 0.5, 0);
        shape_triangle(&shape, a, b, c);
        if (i % 2) {
            uint32_t d = shape_vertex(&shape, x, y, 0.5);
            shape_triangle(&shape, b, a, d);
            shape_triangle(&shape, c, b, d);
            shape_triangle(&shape, a, c, d);
        }
    }
    struct facts facts = put_through(&shape, NULL);
    assert_int_equal(facts.components, 100000);
}

static void components_in_and_through_each_other(void **state)
{
    (void)state;
    struct shape shape = shape_icosphere(3);
    for (unsigned i = 0; i < 4; i++) {
        struct shape other = i % 2 ? shape_icosphere(3) : shape_torus(20, 8);
        shape_move(&other, 0.25 + 0.25 * i, 0.125 * i, 0, 0);
        shape_append(&shape, &other);
        shape_free(&other);
    }
    struct facts facts = put_through(&shape, NULL);
    assert_int_equal(facts.components, 5);
}

static void a_comb(void **state)
{
    (void)state;
    struct shape shape = shape_comb(500);
    struct facts facts = put_through(&shape, NULL);
    assert_int_equal(facts.faces, 1998);
    assert_int_equal(facts.border_loops, 1);
}

static void a_spiral_ramp(void **state)
{
    (void)state;
    struct shape shape = shape_spiral_ramp(12, 40);
    struct facts facts = put_through(&shape, NULL);
    assert_int_equal(facts.euler, 1);
}

static void surfaces_that_are_not_orientable(void **state)
{
    (void)state;
    struct store_info info;
    struct shape shape = shape_klein_bottle(24, 12);
    put_through(&shape, &info);
    assert_int_equal(info.cleaning.nonorientable_components, 1);
    assert_true(info.cleaning.cut_edges > 0);
    shape = shape_mobius(30, 4);
    put_through(&shape, &info);
    assert_int_equal(info.cleaning.nonorientable_components, 1);
}

/* The least torus: seven vertices, each joined to each (Moebius 1861, Csaszar 1949). */
static void tori_that_are_thin(void **state)
{
    (void)state;
    struct shape shape = shape_torus(500, 3);
    struct facts facts = put_through(&shape, NULL);
    assert_int_equal(facts.euler, 0);
    memset(&shape, 0, sizeof shape);
    for (unsigned i = 0; i < 7; i++)
        shape_vertex(&shape, i, i * i % 7, i * i * i % 5);
    for (uint32_t i = 0; i < 7; i++) {
        shape_triangle(&shape, i, (i + 1) % 7, (i + 3) % 7);
        shape_triangle(&shape, i, (i + 3) % 7, (i + 2) % 7);
    }
    facts = put_through(&shape, NULL);
    assert_int_equal(facts.faces, 14);
    assert_int_equal(facts.euler, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_vertices_at_one_point),
        cmocka_unit_test(all_vertices_on_a_line),
        cmocka_unit_test(all_vertices_in_a_plane),
        cmocka_unit_test(numbers_of_all_sizes),
        cmocka_unit_test(flatter_than_float32_can_tell),
        cmocka_unit_test(differences_in_the_last_bit),
        cmocka_unit_test(slivers),
        cmocka_unit_test(zero_area_faces_in_a_closed_surface),
        cmocka_unit_test(faces_folded_on_themselves),
        cmocka_unit_test(far_from_the_origin),
        cmocka_unit_test(ten_thousand_faces_at_a_vertex),
        cmocka_unit_test(a_sphere_of_two_patches),
        cmocka_unit_test(a_hundred_thousand_components),
        cmocka_unit_test(components_in_and_through_each_other),
        cmocka_unit_test(a_comb),
        cmocka_unit_test(a_spiral_ramp),
        cmocka_unit_test(surfaces_that_are_not_orientable),
        cmocka_unit_test(tori_that_are_thin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
