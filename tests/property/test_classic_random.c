/*
 * Mode classic from mesh file to mesh file: at every number of faces, from all of them down to
 * where the topology ends it, the output is manifold, has the store's topology, N or N - 1 faces
 * (or says why not), and nothing but input vertices with their attributes.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "mesh/import.h"
#include "simplify/simplify.h"
#include "test_chains.h"
#include "test_facts.h"
#include "test_kit.h"
#include "test_shapes.h"

enum { NAME = 4096 };

struct run {
    struct context ctx;
    char store[NAME], chains[NAME], output[NAME];
    struct store_info store_info;
    struct chain_info chain_info;
    struct mesh input; /* as the input file has it */
};

static void keep_path(char path[NAME], const char *name)
{
    snprintf(path, NAME, "%s", test_path(name));
}

/* Writes a PLY whose vertices carry their number and a byte, and runs the first two stages. */
static void run_begin(struct run *run, struct shape shape, double angle)
{
    char path[NAME];
    const char *input = path;
    const struct import_options import = {0};
    context_init(&run->ctx);
    keep_path(path, "input.ply");
    keep_path(run->store, "mesh.store");
    keep_path(run->chains, "mesh.chains");
    keep_path(run->output, "level-%d.ply");
    shape_fan(&shape);
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fprintf(file,
            "ply\nformat ascii 1.0\nelement vertex %zu\nproperty float x\nproperty float y\n"
            "property float z\nproperty int number\nproperty uchar tag\nelement face %zu\n"
            "property list uchar int vertex_indices\nend_header\n",
            shape.vertex_count, shape.face_count);
    for (size_t i = 0; i < shape.vertex_count; i++)
        fprintf(file, "%.9g %.9g %.9g %zu %zu\n", shape.positions[3 * i],
                shape.positions[3 * i + 1], shape.positions[3 * i + 2], i, i * 7 % 256);
    for (size_t i = 0; i < shape.face_count; i++)
        fprintf(file, "3 %u %u %u\n", shape.indices[3 * i], shape.indices[3 * i + 1],
                shape.indices[3 * i + 2]);
    assert_int_equal(fclose(file), 0);
    shape_free(&shape);
    assert_int_equal(mesh_load(&run->ctx, path, &run->input), STATUS_OK);
    assert_int_equal(store_build(&run->ctx, &input, 1, run->store, &import, &run->store_info),
                     STATUS_OK);
    const struct target target = {
        .kind = TARGET_FACES, .count = 1, .values = {10}, .mode = MODE_CLASSIC, .effort = 2};
    const struct patch_request request = {.patch_angle = {angle, -1}, .face_angle = {angle, -1}};
    if (chain_build(&run->ctx, run->store, run->chains, &target, &request, &run->chain_info) !=
        STATUS_OK)
        fail_msg("%s", run->ctx.error);
}

static void run_end(struct run *run)
{
    mesh_clear(&run->ctx, &run->input);
    assert_int_equal(run->ctx.memory_now, 0);
    context_clear(&run->ctx);
}

/* A failure is kept in the context: each call gets its own. */
static enum status make_levels(const struct run *run, const struct lod_options *options,
                               struct lod_report *report)
{
    struct context ctx;
    context_init(&ctx);
    enum status status = lod_build(&ctx, run->chains, options, report);
    if (status != STATUS_OK && ctx.error[0] == '\0')
        fail_msg("a failure without words");
    if (status == STATUS_INTERNAL)
        fail_msg("%s", ctx.error);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return status;
}

static void vertices_are_inputs(const struct run *run, const struct mesh *mesh)
{
    assert_int_equal(mesh->attributes.count, 2);
    for (uint64_t i = 0; i < mesh->vertex_count; i++) {
        const unsigned char *record = mesh->records + i * mesh->attributes.stride;
        uint32_t number;
        memcpy(&number, record + mesh->attributes.list[0].offset, sizeof number);
        assert_true(number < run->input.vertex_count);
        assert_int_equal(record[mesh->attributes.list[1].offset], number * 7 % 256);
        assert_memory_equal(mesh->positions + 3 * i, run->input.positions + 3 * (size_t)number,
                            3 * sizeof(double));
    }
}

static void level_must_hold(struct run *run, uint32_t index, const struct level *level)
{
    char path[NAME], name[64];
    struct mesh mesh;
    snprintf(name, sizeof name, "level-%u.ply", index);
    keep_path(path, name);
    assert_int_equal(mesh_load(&run->ctx, path, &mesh), STATUS_OK);
    struct facts facts = facts_of(&mesh);
    assert_true(facts_manifold(&facts));
    assert_int_equal(facts.unused, 0);
    assert_int_equal(facts.components, run->store_info.topology.components);
    assert_int_equal(facts.border_loops, run->store_info.topology.border_loops);
    assert_int_equal(facts.euler, run->store_info.topology.euler);
    assert_int_equal(facts.faces, level->faces);
    assert_int_equal(facts.vertices, level->vertices);
    assert_true(level->faces >= run->store_info.topology.floor);
    vertices_are_inputs(run, &mesh);
    mesh_clear(&run->ctx, &mesh);
    remove(path);
}

static void verdict_must_fit(const struct run *run, enum status status,
                             const struct lod_report *report)
{
    bool missed = false;
    for (uint32_t i = 0; i < report->level_count; i++) {
        const struct level *level = &report->levels[i];
        bool met = level->faces == level->wanted_faces || level->faces + 1 == level->wanted_faces;
        assert_int_equal(met, level->reason == STOP_REACHED);
        if (!met && level->faces > level->wanted_faces)
            assert_int_equal(level->reason, STOP_TOPOLOGY);
        if (!met && level->faces < level->wanted_faces) {
            assert_int_equal(level->reason, STOP_TOO_FINE);
            assert_true(level->wanted_faces > run->chain_info.most_faces);
        }
        missed = missed || !met;
    }
    assert_int_equal(status, missed ? STATUS_TARGET_MISSED : STATUS_OK);
}

/* Every count in [1, most + 2], sixteen levels a run. Returns the fewest faces met. */
static uint64_t try_all_counts(struct run *run)
{
    uint64_t fewest = UINT64_MAX;
    uint64_t most = run->chain_info.most_faces + 2;
    for (uint64_t high = most; high >= 1; high = high > TARGETS_MAX ? high - TARGETS_MAX : 0) {
        struct lod_options options = {
            .target = {.kind = TARGET_FACES, .mode = MODE_CLASSIC, .effort = 2},
            .output = run->output};
        struct lod_report report;
        for (uint64_t n = high; n >= 1 && options.target.count < TARGETS_MAX; n--)
            options.target.values[options.target.count++] = (double)n;
        enum status status = make_levels(run, &options, &report);
        assert_int_equal(report.level_count, options.target.count);
        verdict_must_fit(run, status, &report);
        for (uint32_t i = 0; i < report.level_count; i++) {
            level_must_hold(run, i, &report.levels[i]);
            if (i > 0)
                assert_true(report.levels[i].faces <= report.levels[i - 1].faces);
            if (report.levels[i].faces < fewest)
                fewest = report.levels[i].faces;
        }
    }
    return fewest;
}

/* At every count; `at_most`: what must be reachable (the floor itself where that is easy). */
static void all_counts(struct shape shape, double angle, uint64_t at_most)
{
    struct run run;
    run_begin(&run, shape, angle);
    uint64_t fewest = try_all_counts(&run);
    if (fewest > at_most)
        fail_msg("only %llu faces were reached", (unsigned long long)fewest);
    run_end(&run);
}

static void small_shapes_at_every_count(void **state)
{
    (void)state;
    const double angles[] = {0, 12, 40, 179};
    for (int i = 0; i < 4; i++) {
        all_counts(shape_tetrahedron(), angles[i], 4);
        all_counts(shape_single_triangle(), angles[i], 1);
        all_counts(shape_cube_quads(), angles[i], 4);
        all_counts(shape_icosphere(1), angles[i], 4);
        all_counts(shape_torus(9, 3), angles[i], 20); /* one triangle's width round */
        all_counts(shape_torus(6, 5), angles[i], 20);
        all_counts(shape_mobius(9, 2), angles[i], 12); /* cut open on import */
        all_counts(shape_klein_bottle(6, 5), angles[i], 40);
        all_counts(shape_spheres_touching_vertex(1), angles[i], 8);
        all_counts(shape_spheres_touching_edge(1), angles[i], 12);
        all_counts(shape_spiral_ramp(2, 8), angles[i], 1);
        all_counts(shape_grid_with_holes(8, 4), angles[i], 14);
        all_counts(shape_grid(7, 5), angles[i], 1);
    }
}

/* Two tori side by side, a sphere inside a sphere: components do not mix. */
static void several_components(void **state)
{
    (void)state;
    struct shape both = shape_torus(5, 4), other = shape_torus(7, 3), sphere = shape_icosphere(1);
    shape_move(&other, 1, 8, 0, 0);
    shape_move(&sphere, 0.25, 0, 0, 0);
    shape_append(&both, &other);
    shape_append(&both, &sphere);
    shape_free(&other);
    shape_free(&sphere);
    for (size_t i = 0; i < 3 * both.vertex_count; i++)
        both.positions[i] = (double)(float)both.positions[i];
    all_counts(both, 20, 46);
}

static void noisy_shapes_at_random_counts(void **state)
{
    (void)state;
    uint64_t random = 21;
    for (unsigned round = 0; round < 24; round++) {
        struct shape shape = round % 3 == 0   ? shape_noisy_sphere(3, 0.05, round)
                             : round % 3 == 1 ? shape_noisy_torus(24, 12, 0.05, round)
                                              : shape_noisy_slab(16, 0.03, round);
        struct run run;
        struct lod_report report;
        run_begin(&run, shape, 5 + 40 * random_unit(&random));
        struct lod_options options = {
            .target = {.kind = TARGET_FACES, .mode = MODE_CLASSIC, .effort = 2, .count = 6},
            .output = run.output};
        for (int i = 0; i < 6; i++)
            options.target.values[i] = (double)(1 + random_below(&random, 900));
        verdict_must_fit(&run, make_levels(&run, &options, &report), &report);
        for (uint32_t i = 0; i < report.level_count; i++)
            level_must_hold(&run, i, &report.levels[i]);
        run_end(&run);
    }
}

/* Ratios of the store's faces; errors, in model units and relative: coarser levels for larger ones.
 */
static void other_targets(void **state)
{
    (void)state;
    struct run run;
    struct lod_report report;
    run_begin(&run, shape_noisy_sphere(3, 0.02, 5), 20);
    struct lod_options options = {.target = {.kind = TARGET_RATIO,
                                             .mode = MODE_CLASSIC,
                                             .effort = 2,
                                             .count = 2,
                                             .values = {0.02, 0.1}},
                                  .output = run.output};
    assert_int_equal(make_levels(&run, &options, &report), STATUS_OK);
    uint64_t faces = run.store_info.topology.faces;
    assert_int_equal(report.levels[0].wanted_faces, faces / 10);
    assert_int_equal(report.levels[1].wanted_faces, faces / 50);
    options.target = (struct target){.kind = TARGET_ERROR,
                                     .mode = MODE_CLASSIC,
                                     .effort = 2,
                                     .count = 3,
                                     .values = {0.9, 0.3, 0.45}};
    assert_int_equal(make_levels(&run, &options, &report), STATUS_OK);
    for (uint32_t i = 0; i < 3; i++) {
        level_must_hold(&run, i, &report.levels[i]);
        assert_true(report.levels[i].error <= report.levels[i].wanted_error);
        assert_true(i == 0 || report.levels[i].faces < report.levels[i - 1].faces);
        assert_true(i == 0 || report.levels[i].wanted_error > report.levels[i - 1].wanted_error);
    }
    run_end(&run);
}

static void misuse_is_refused(void **state)
{
    (void)state;
    struct run run;
    struct lod_report report;
    char bad[NAME], percent[NAME];
    run_begin(&run, shape_icosphere(1), 20);
    struct lod_options options = {.target = {.kind = TARGET_FACES,
                                             .mode = MODE_CLASSIC,
                                             .effort = 2,
                                             .count = 2,
                                             .values = {20, 10}},
                                  .output = run.output};
    options.place = PLACE_OPTIMAL;
    assert_int_equal(make_levels(&run, &options, &report), STATUS_MISUSE);
    options.place = PLACE_SUBSET;
    keep_path(bad, "level.ply");
    options.output = bad;
    assert_int_equal(make_levels(&run, &options, &report), STATUS_MISUSE);
    keep_path(bad, "level-%s.ply");
    assert_int_equal(make_levels(&run, &options, &report), STATUS_MISUSE);
    options.target.count = 1;
    assert_int_equal(make_levels(&run, &options, &report), STATUS_MISUSE);
    options.output = run.chains;
    assert_int_equal(make_levels(&run, &options, &report), STATUS_MISUSE);
    options.output = run.output;
    options.target.values[0] = 0;
    assert_int_equal(make_levels(&run, &options, &report), STATUS_MISUSE);
    options.target.kind = TARGET_RATIO;
    options.target.values[0] = 1.5;
    assert_int_equal(make_levels(&run, &options, &report), STATUS_MISUSE);
    options.target.kind = TARGET_FACES;
    options.target.values[0] = 10;
    keep_path(bad, "level-50%%.ply");
    options.output = bad;
    assert_int_equal(make_levels(&run, &options, &report), STATUS_OK);
    keep_path(percent, "level-50%.ply");
    assert_int_equal(remove(percent), 0);
    run_end(&run);
}

/* Seams between many slabs are like any other chain: blocks of a few dozen faces each. */
static void many_slabs(void **state)
{
    (void)state;
    uint64_t random = 2;
    for (unsigned round = 0; round < 12; round++) {
        struct shape shape =
            round % 2 ? shape_noisy_torus(20, 10, 0.03, round) : shape_grid_with_holes(16, 16);
        struct run run = {0};
        struct slab_set slabs;
        struct chain_set set;
        struct lod_report report;
        context_init(&run.ctx);
        shape_into_mesh(&run.ctx, &shape, &run.input);
        struct facts whole = facts_of(&run.input);
        slab_set_build(&run.input, 40 + (uint32_t)random_below(&random, 100), &slabs);
        struct patch_options patch = test_patch_options(15 + 5 * (round % 3), 15, 0);
        chain_set_build(&run.ctx, &slabs, &patch, &set);
        keep_path(run.chains, "many.chains");
        keep_path(run.output, "many-%d.ply");
        chain_set_write(&set, run.chains, 0);
        struct lod_options options = {.target = {.kind = TARGET_FACES,
                                                 .mode = MODE_CLASSIC,
                                                 .effort = 2,
                                                 .count = 3,
                                                 .values = {200, 120, 90}},
                                      .output = run.output};
        assert_int_equal(make_levels(&run, &options, &report), STATUS_OK);
        for (uint32_t i = 0; i < 3; i++) {
            char path[NAME], name[64];
            struct mesh mesh;
            snprintf(name, sizeof name, "many-%u.ply", i);
            keep_path(path, name);
            assert_int_equal(mesh_load(&run.ctx, path, &mesh), STATUS_OK);
            struct facts facts = facts_of(&mesh);
            assert_true(facts_manifold(&facts));
            assert_true(facts_same_topology(&whole, &facts));
            mesh_clear(&run.ctx, &mesh);
        }
        chain_set_free(&set);
        slab_set_free(&slabs);
        run_end(&run);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(small_shapes_at_every_count),
        cmocka_unit_test(several_components),
        cmocka_unit_test(noisy_shapes_at_random_counts),
        cmocka_unit_test(other_targets),
        cmocka_unit_test(misuse_is_refused),
        cmocka_unit_test(many_slabs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
