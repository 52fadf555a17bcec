/*
 * The way back from chains to a store: what comes out is a manifold of the same topology, whose
 * vertices are vertices of what went in, over the seams of many slabs, and with small patches it is
 * the very mesh.
 */
#include "test_kit.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mesh/store.h"
#include "simplify/chain_unfold.h"
#include "simplify/simplify.h"
#include "test_facts.h"
#include "test_shapes.h"

struct unfolded {
    struct context ctx;
    struct mesh before, after;
    struct store_info info;
};

static void load(struct context *ctx, const char *path, struct mesh *mesh)
{
    struct store *store;
    assert_int_equal(store_open(ctx, path, true, &store), STATUS_OK);
    assert_int_equal(store_load(store, mesh), STATUS_OK);
    store_close(&store);
}

/* There and back, with patches of `angle` degrees. */
static void unfold(const struct shape *shape, unsigned slab_shift, double angle,
                   struct unfolded *out)
{
    char input[4096], store[4096], chains[4096], again[4096];
    const struct import_options import = {.slab_shift = slab_shift};
    const struct target target = {
        .kind = TARGET_FACES, .count = 1, .values = {1e9}, .mode = MODE_COLLAPSE, .effort = 2};
    const struct patch_request request = {
        .patch_angle = {angle, angle}, .face_angle = {angle, angle}, .chain_tolerance = -1};
    snprintf(input, sizeof input, "%s", test_path("shape.ply"));
    snprintf(store, sizeof store, "%s", test_path("shape.store"));
    snprintf(chains, sizeof chains, "%s", test_path("shape.chains"));
    snprintf(again, sizeof again, "%s", test_path("again.store"));
    const char *inputs[] = {input};
    memset(out, 0, sizeof *out);
    context_init(&out->ctx);
    shape_write(shape, SHAPE_PLY_LITTLE, input);
    assert_int_equal(store_build(&out->ctx, inputs, 1, store, &import, NULL), STATUS_OK);
    assert_int_equal(chain_build(&out->ctx, store, chains, &target, &request, NULL), STATUS_OK);
    assert_int_equal(chain_unfold(&out->ctx, chains, again, &import, &out->info), STATUS_OK);
    load(&out->ctx, store, &out->before);
    load(&out->ctx, again, &out->after);
    struct facts before = facts_of(&out->before), after = facts_of(&out->after);
    assert_true(facts_manifold(&after));
    assert_true(facts_same_topology(&before, &after));
}

static int compare_points(const void *a, const void *b)
{
    return memcmp(a, b, 3 * sizeof(double));
}

/* Every vertex of what came out is one of what went in. */
static void expect_subset(struct unfolded *out)
{
    double *points = out->before.positions;
    size_t count = (size_t)out->before.vertex_count;
    qsort(points, count, 3 * sizeof *points, compare_points);
    for (size_t v = 0; v < out->after.vertex_count; v++)
        assert_non_null(bsearch(out->after.positions + 3 * v, points, count, 3 * sizeof *points,
                                compare_points));
}

static void unfolded_clear(struct unfolded *out)
{
    mesh_clear(&out->ctx, &out->before);
    mesh_clear(&out->ctx, &out->after);
    assert_int_equal(atomic_load(&out->ctx.memory_now), 0);
    context_clear(&out->ctx);
}

static void topology_and_vertices_are_kept(void **state)
{
    (void)state;
    struct shape shapes[] = {shape_noisy_sphere(4, 0.01, 3), shape_noisy_torus(60, 30, 0.01, 5),
                             shape_grid_with_holes(16, 12), shape_noisy_slab(24, 0.1, 9)};
    for (unsigned i = 0; i < sizeof shapes / sizeof shapes[0]; i++)
        for (unsigned shift = 0; shift <= 8; shift += 4) {
            struct unfolded out;
            unfold(&shapes[i], shift, 10, &out);
            assert_true(out.after.face_count <= out.before.face_count);
            expect_subset(&out);
            unfolded_clear(&out);
        }
    for (unsigned i = 0; i < sizeof shapes / sizeof shapes[0]; i++)
        shape_free(&shapes[i]);
}

/* Patches of one face each give all of them back. */
static void single_faces_come_back(void **state)
{
    (void)state;
    struct shape shape = shape_noisy_sphere(3, 0.02, 1);
    struct unfolded out;
    unfold(&shape, 6, 0, &out);
    assert_int_equal(out.after.face_count, shape.face_count);
    assert_int_equal(out.after.vertex_count, shape.vertex_count);
    assert_true(fabs(mesh_volume(&out.after) - mesh_volume(&out.before)) <= 1e-12);
    expect_subset(&out);
    unfolded_clear(&out);
    shape_free(&shape);
}

/* Far from the origin positions are doubles relative to one. */
static void far_places_are_kept(void **state)
{
    (void)state;
    struct shape shape = shape_icosphere(3);
    struct unfolded out;
    shape_move(&shape, 0.1, 1e6, -2e6, 3);
    unfold(&shape, 5, 3, &out);
    assert_false(out.info.is_float32);
    for (unsigned c = 0; c < 3; c++) {
        double middle = (out.info.box_low[c] + out.info.box_high[c]) / 2;
        assert_true(fabs(middle - (c == 0 ? 1e6 : c == 1 ? -2e6 : 3)) < 1e-6);
    }
    unfolded_clear(&out);
    shape_free(&shape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(topology_and_vertices_are_kept),
        cmocka_unit_test(single_faces_come_back),
        cmocka_unit_test(far_places_are_kept),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
