/*
 * measure on pairs whose distances are known, its counts of flipped and crossing faces, and that
 * neither threads, order, pieces nor the kind of file change what it says.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "inspect/colour.h"
#include "inspect/measure.h"
#include "mesh/import.h"
#include "test_kit.h"
#include "test_shapes.h"

static void write_shape(struct shape shape, const char *name)
{
    shape_write(&shape, SHAPE_PLY_LITTLE, test_path(name));
    shape_free(&shape);
}

/* Measures two files of the test folder; the vertex errors are not kept. */
static struct measurement measure_files(const char *original, const char *simplified,
                                        unsigned threads)
{
    struct context ctx;
    struct mesh mesh;
    struct measurement result;
    struct measure_options options = {.samples_per_face = 0, .self_intersections = true};
    context_init(&ctx);
    ctx.threads = threads;
    if (measure(&ctx, test_path(original), test_path(simplified), &options, &result, &mesh) !=
        STATUS_OK)
        fail_msg("%s", ctx.error);
    assert_int_equal(result.vertex_error_count, mesh.vertex_count);
    measurement_clear(&ctx, &result);
    mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return result;
}

static struct measurement measure_pair(struct shape original, struct shape simplified)
{
    write_shape(original, "original.ply");
    write_shape(simplified, "simplified.ply");
    return measure_files("original.ply", "simplified.ply", 2);
}

static void assert_near(double value, double expected, double tolerance)
{
    if (!(fabs(value - expected) <= tolerance))
        fail_msg("%.17g instead of %.17g", value, expected);
}

static void equal_meshes(void **state)
{
    (void)state;
    struct measurement r = measure_pair(shape_torus(30, 20), shape_torus(30, 20));
    assert_near(r.hausdorff, 0, 1e-7);
    assert_near(r.forward.mean + r.backward.mean, 0, 1e-8);
    assert_int_equal(r.flipped_faces + r.self_intersecting_faces, 0);
    assert_near(r.normal_mean, 0, 1e-3);
    assert_true(r.samples_per_face >= 10);
    assert_true(r.forward.samples >= 600 + 1200);
    assert_true(r.backward.samples >= 600 + 10 * 1200);
    assert_true(r.original.is_manifold && r.simplified.is_manifold);
}

static void parallel_planes(void **state)
{
    (void)state;
    struct shape above = shape_grid(6, 6);
    shape_move(&above, 1, 0, 0, 0.25);
    struct measurement r = measure_pair(shape_grid(12, 12), above);
    /* The smaller one is over a part of the larger one. */
    assert_near(r.backward.largest, 0.25, 1e-12);
    assert_near(r.backward.mean, 0.25, 1e-12);
    assert_near(r.backward.rms, 0.25, 1e-12);
    assert_near(r.normal_largest, 0, 1e-3);
    assert_near(r.forward.largest, sqrt(36 + 36 + 0.0625), 1e-9);
    assert_near(r.hausdorff, r.forward.largest, 0);
    /* The mean distance of the L-shaped rest can be integrated: check it roughly. */
    assert_true(r.forward.mean > 1.5 && r.forward.mean < 3);
    assert_near(r.diagonal, sqrt(288), 1e-12);
}

/* A plane tilted by 60 degrees at a common edge. */
static void known_angle(void **state)
{
    (void)state;
    struct shape tilted = shape_grid(4, 4);
    for (size_t v = 0; v < tilted.vertex_count; v++) {
        double *p = tilted.positions + 3 * v;
        p[2] = p[1] * sqrt(0.75);
        p[1] *= 0.5;
    }
    struct measurement r = measure_pair(shape_grid(4, 4), tilted);
    assert_near(r.normal_mean, 60, 1e-4);
    assert_near(r.normal_largest, 60, 1e-4);
    assert_near(r.backward.largest, 4 * sqrt(0.75), 1e-6);
    assert_near(r.backward.mean, 2 * sqrt(0.75), 0.01);
    assert_int_equal(r.flipped_faces, 0);
}

static void turned_inside_out(void **state)
{
    (void)state;
    struct shape inside = shape_icosphere(2);
    for (size_t f = 0; f < inside.face_count; f++)
        shape_flip(&inside, f);
    struct measurement r = measure_pair(shape_icosphere(2), inside);
    assert_int_equal(r.flipped_faces, 320);
    assert_near(r.normal_mean, 180, 1e-3);
    assert_near(r.hausdorff, 0, 1e-7);
    assert_near(r.simplified.volume, -r.original.volume, 1e-6);
}

static void coarse_sphere(void **state)
{
    (void)state;
    struct measurement r = measure_pair(shape_icosphere(5), shape_icosphere(2));
    /* Both have the same 162 vertices; the coarse one lies inside. */
    assert_true(r.forward.largest > 0.005 && r.forward.largest < 0.05);
    assert_true(r.backward.largest > 0.005 && r.backward.largest < 0.05);
    assert_true(r.forward.mean < r.forward.rms && r.forward.rms < r.forward.largest);
    assert_near(r.forward.mean, r.backward.mean, 0.1 * r.forward.mean);
    assert_true(r.simplified.volume < r.original.volume);
    assert_int_equal(r.original.genus, 0);
}

static void crossing_faces(void **state)
{
    (void)state;
    assert_int_equal(measure_pair(shape_icosphere(2), shape_icosphere(3)).self_intersecting_faces,
                     0);

    struct shape spheres = shape_icosphere(2), other = shape_icosphere(2);
    shape_move(&other, 1, 0.5, 0.1, 0.2);
    shape_append(&spheres, &other);
    shape_free(&other);
    struct measurement r = measure_pair(shape_icosphere(2), spheres);
    assert_true(r.self_intersecting_faces >= 40 && r.self_intersecting_faces < 300);

    /* One triangle goes through another; neighbours that share a vertex or an edge do not. */
    struct shape few = shape_grid(1, 1);
    shape_fan(&few);
    uint32_t v[3] = {shape_vertex(&few, 0.5, 0.25, -1), shape_vertex(&few, 0.5, 0.25, 1),
                     shape_vertex(&few, 3, 0.25, 0)};
    shape_triangle(&few, v[0], v[1], v[2]);
    assert_int_equal(measure_pair(shape_grid(1, 1), few).self_intersecting_faces, 2);

    /* Folded flat: both faces of an edge on the same side of it. */
    struct shape folded = {0};
    uint32_t c[4] = {shape_vertex(&folded, 0, 0, 0), shape_vertex(&folded, 1, 0, 0),
                     shape_vertex(&folded, 0.3f, 1, 0), shape_vertex(&folded, 0.6f, 0.5f, 0)};
    shape_triangle(&folded, c[0], c[1], c[2]);
    shape_triangle(&folded, c[1], c[0], c[3]);
    assert_int_equal(measure_pair(shape_grid(1, 1), folded).self_intersecting_faces, 2);
}

/* More than one piece; shuffled, with other threads: the largest distance is the same number, and
 * with the same order everything is, bit for bit. */
static void pieces_threads_and_order(void **state)
{
    (void)state;
    write_shape(shape_noisy_sphere(6, 0.01, 5), "large.ply"); /* 81,920 faces */
    write_shape(shape_icosphere(3), "small.ply");
    struct measurement one = measure_files("large.ply", "small.ply", 1);
    struct measurement three = measure_files("large.ply", "small.ply", 3);
    one.vertex_error = three.vertex_error = NULL;
    assert_memory_equal(&one.forward, &three.forward, sizeof one.forward);
    assert_memory_equal(&one.backward, &three.backward, sizeof one.backward);
    assert_true(one.normal_mean == three.normal_mean && one.hausdorff == three.hausdorff);

    struct shape shuffled = shape_noisy_sphere(6, 0.01, 5);
    shape_shuffle(&shuffled, 11);
    write_shape(shuffled, "large.ply");
    struct measurement other = measure_files("large.ply", "small.ply", 2);
    assert_near(other.backward.largest, one.backward.largest, 1e-12);
    assert_near(other.backward.mean, one.backward.mean, 1e-9 * one.backward.mean);
    assert_near(other.forward.mean, one.forward.mean, 0.01 * one.forward.mean);
}

/* A store of the same mesh says the same, up to the order of faces. */
static void store_as_original(void **state)
{
    (void)state;
    struct context ctx;
    context_init(&ctx);
    write_shape(shape_noisy_torus(300, 150, 0.02, 3), "large.ply"); /* 90,000 faces */
    write_shape(shape_torus(40, 30), "small.ply");
    const char *input = test_path("large.ply");
    struct import_options options = {.weld = false};
    if (store_build(&ctx, &input, 1, test_path("large.spbm"), &options, NULL) != STATUS_OK)
        fail_msg("%s", ctx.error);
    context_clear(&ctx);
    struct measurement file = measure_files("large.ply", "small.ply", 2);
    struct measurement store = measure_files("large.spbm", "small.ply", 2);
    assert_near(store.backward.largest, file.backward.largest, 1e-12);
    assert_near(store.backward.mean, file.backward.mean, 1e-9 * file.backward.mean);
    assert_near(store.forward.mean, file.forward.mean, 0.01 * file.forward.mean);
    assert_near(store.original.area, file.original.area, 1e-9 * file.original.area);
    assert_near(store.original.volume, file.original.volume, 1e-9 * file.original.volume);
    assert_int_equal(store.original.genus, file.original.genus);
    assert_int_equal(store.original.topology.floor, file.original.topology.floor);
    /* And a store can be the simplified mesh. */
    struct measurement back = measure_files("small.ply", "large.spbm", 2);
    assert_int_equal(back.simplified.topology.faces, 90000);
}

static void soup_is_welded(void **state)
{
    (void)state;
    struct shape shape = shape_icosphere(3);
    shape_write(&shape, SHAPE_STL_BINARY, test_path("soup.stl"));
    write_shape(shape, "same.ply");
    struct measurement r = measure_files("soup.stl", "same.ply", 1);
    assert_true(r.original.is_manifold);
    assert_int_equal(r.original.topology.vertices, 642);
    assert_int_equal(r.original.unreferenced_vertices, 0);
    assert_int_equal(r.original.coincident_vertices, 0);
    assert_near(r.hausdorff, 0, 1e-6);
}

static void bad_inputs(void **state)
{
    (void)state;
    struct shape empty = {0};
    write_shape(empty, "empty.ply");
    write_shape(shape_grid(2, 2), "good.ply");
    const struct {
        const char *original, *simplified;
        uint32_t samples;
        enum status status;
    } cases[] = {{"empty.ply", "good.ply", 0, STATUS_BAD_INPUT},
                 {"good.ply", "empty.ply", 0, STATUS_BAD_INPUT},
                 {"good.ply", "good.ply", 1000000, STATUS_MISUSE},
                 {"missing.ply", "good.ply", 0, STATUS_IO},
                 {"good.ply", "missing.ply", 0, STATUS_IO}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct context ctx;
        struct mesh mesh;
        struct measurement result;
        struct measure_options options = {.samples_per_face = cases[i].samples};
        context_init(&ctx);
        enum status status = measure(&ctx, test_path(cases[i].original),
                                     test_path(cases[i].simplified), &options, &result, &mesh);
        assert_true(status == cases[i].status || (i >= 3 && status != STATUS_OK));
        assert_true(ctx.error[0] != 0);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
}

static void failing_calls(void **state)
{
    (void)state;
    write_shape(shape_noisy_sphere(2, 0.1, 1), "original.ply");
    write_shape(shape_icosphere(1), "simplified.ply");
    bool done = false;
    for (uint64_t n = 0; !done; n++) {
        struct context ctx;
        struct mesh mesh;
        struct measurement result;
        struct measure_options options = {.samples_per_face = 1, .self_intersections = true};
        context_init(&ctx);
        atomic_store(&ctx.fault_after, n);
        enum status status = measure(&ctx, test_path("original.ply"), test_path("simplified.ply"),
                                     &options, &result, &mesh);
        done = status == STATUS_OK;
        assert_true(done || ctx.error[0]);
        if (done) {
            measurement_clear(&ctx, &result);
            mesh_clear(&ctx, &mesh);
        }
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
        assert_true(n < 10000);
    }
}

static void error_as_attributes(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh, again;
    struct measurement result;
    struct measure_options options = {.samples_per_face = 1};
    struct export_options output = {.format = EXPORT_BY_NAME, .as_float32 = true};
    context_init(&ctx);
    write_shape(shape_icosphere(4), "original.ply");
    write_shape(shape_noisy_sphere(1, 0.2, 4), "simplified.ply");
    if (measure(&ctx, test_path("original.ply"), test_path("simplified.ply"), &options, &result,
                &mesh) != STATUS_OK ||
        measure_save(&ctx, test_path("error.ply"), &output, &result, &mesh) != STATUS_OK ||
        mesh_load(&ctx, test_path("error.ply"), &again) != STATUS_OK)
        fail_msg("%s", ctx.error);
    assert_int_equal(again.vertex_count, mesh.vertex_count);
    assert_int_equal(again.attributes.count, 4);
    assert_string_equal(again.attributes.list[0].name, "quality");
    uint64_t worst = 0;
    for (uint64_t v = 0; v < mesh.vertex_count; v++) {
        float value;
        memcpy(&value, again.records + again.attributes.stride * v, sizeof value);
        assert_true(value >= result.vertex_error[v]);
        if (result.vertex_error[v] > result.vertex_error[worst])
            worst = v;
    }
    /* The largest error has the map's last colour. */
    const unsigned char *record = again.records + again.attributes.stride * worst;
    assert_int_equal(record[4] << 16 | record[5] << 8 | record[6], colour_map(1));
    mesh_clear(&ctx, &again);
    mesh_clear(&ctx, &mesh);
    measurement_clear(&ctx, &result);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equal_meshes),
        cmocka_unit_test(parallel_planes),
        cmocka_unit_test(known_angle),
        cmocka_unit_test(turned_inside_out),
        cmocka_unit_test(coarse_sphere),
        cmocka_unit_test(crossing_faces),
        cmocka_unit_test(pieces_threads_and_order),
        cmocka_unit_test(store_as_original),
        cmocka_unit_test(soup_is_welded),
        cmocka_unit_test(bad_inputs),
        cmocka_unit_test(failing_calls),
        cmocka_unit_test(error_as_attributes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
