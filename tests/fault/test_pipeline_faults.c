/*
 * The stages and topology simplification on a small mesh with every allocation and every guarded
 * system call made to fail, one a run: each run ends with a status and words, gives all memory and
 * descriptors back, leaves no file but whole ones, and a run that succeeds all the same gives the
 * same bytes.
 *
 * A run has thousands of such calls; the first ones are tried one by one, later ones in growing
 * strides, so that the test takes seconds; every one with SPBM_EVERY_FAULT=1.
 */
#include "test_kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "mesh/store.h"
#include "simplify/simplify.h"
#include "simplify/topology.h"
#include "test_files.h"
#include "test_parts.h"
#include "test_shapes.h"

enum { EVERY = 150 }; /* that many calls are made to fail one by one */

struct place {
    char folder[TEST_PATH];
    char scan[TEST_PATH], store[TEST_PATH], chains[TEST_PATH], level[TEST_PATH];
    struct target target;
};

static int set_up(void **state)
{
    struct place *place = calloc(1, sizeof *place);
    folder_make(place->folder);
    folder_path(place->scan, place->folder, "scan.ply");
    folder_path(place->store, place->folder, "a.store");
    folder_path(place->chains, place->folder, "a.chains");
    folder_path(place->level, place->folder, "level.ply");
    struct shape shape = shape_noisy_torus(24, 12, 0.005, 3);
    shape_write(&shape, SHAPE_PLY_LITTLE, place->scan);
    shape_free(&shape);
    place->target.kind = TARGET_FACES;
    place->target.count = 1;
    place->target.values[0] = 200;
    place->target.mode = MODE_CLASSIC;
    place->target.effort = 1;
    *state = place;
    return 0;
}

static int tear_down(void **state)
{
    struct place *place = *state;
    folder_remove(place->folder);
    free(place);
    return 0;
}

/* A stage: its output's name in *output. */
typedef enum status stage_function(struct context *ctx, struct place *place, const char **output);

static enum status run_import(struct context *ctx, struct place *place, const char **output)
{
    const char *inputs[1] = {place->scan};
    struct import_options options = {.sync = true, .slab_shift = 6};
    *output = place->store;
    return store_build(ctx, inputs, 1, place->store, &options, NULL);
}

static enum status run_patchify(struct context *ctx, struct place *place, const char **output)
{
    struct patch_request request = {.patch_angle = {-1, -1},
                                    .face_angle = {-1, -1},
                                    .smoothings = -1,
                                    .chain_tolerance = -1,
                                    .level = 6,
                                    .sync = true};
    *output = place->chains;
    return chain_build(ctx, place->store, place->chains, &place->target, &request, NULL);
}

static enum status run_lod(struct context *ctx, struct place *place, const char **output)
{
    struct lod_options options = {.target = place->target, .output = place->level};
    options.export.sync = true;
    struct lod_report report;
    *output = place->level;
    enum status status = lod_build(ctx, place->chains, &options, &report);
    /* A level that misses its target is written all the same. */
    return status == STATUS_TARGET_MISSED ? STATUS_OK : status;
}

/* A plate with a hole, a pocket and a crack: all that topology simplification does. */
static void write_part(struct place *place)
{
    struct part_plate plate = plate_make(2, 2, 0.5);
    for (unsigned i = 0; i < 3; i++) {
        struct part_cell *cell = plate_cell(&plate, i % 2, i / 2);
        cell->top_count = 1;
        feature_round(&cell->top[0], 8, 0.5);
        cell->top[0].kind = i == 0 ? PART_HOLE : i == 1 ? PART_POCKET : PART_BUMP;
        cell->top[0].depth = 0.25;
    }
    struct shape shape = plate_shape(&plate);
    shape.face_count--;
    shape_write(&shape, SHAPE_PLY_LITTLE, place->scan);
    shape_free(&shape);
    plate_free(&plate);
}

static struct topology_options all_topology(void)
{
    struct topology_options options;
    topology_defaults(&options);
    options.max_feature.value = 0.7;
    options.smooth_features = true;
    options.drop_components.value = 0.5;
    options.close_cracks.value = 1;
    options.merge_coplanar = true;
    options.export.sync = true;
    return options;
}

static enum status run_topology(struct context *ctx, struct place *place, const char **output)
{
    struct topology_options options = all_topology();
    struct topology_report report = {0};
    *output = place->level;
    enum status status =
        topology_run(ctx, place->store, place->chains, place->level, &options, &report);
    topology_report_clear(ctx, &report);
    remove(place->chains); /* scratch */
    return status;
}

static enum status run_rebuild(struct context *ctx, struct place *place, const char **output)
{
    struct topology_options options = all_topology();
    struct topology_report report = {0};
    struct import_options import = {.sync = true};
    *output = place->level;
    enum status status = topology_rebuild(ctx, place->store, place->chains, place->level, &import,
                                          &options, &report, NULL);
    topology_report_clear(ctx, &report);
    remove(place->chains);
    return status;
}

/* Runs the stage with the call number `after` failing; true if the run has that many calls. */
static bool run_once(struct place *place, stage_function *stage, uint64_t after, int files,
                     const unsigned char *good, size_t good_size)
{
    struct context ctx;
    context_init(&ctx);
    ctx.fault_after = after;
    int open_files = folder_count("/proc/self/fd");
    const char *output;
    enum status status = stage(&ctx, place, &output);
    bool reached = ctx.fault_after == UINT64_MAX;
    if (status != STATUS_OK) {
        if (!reached)
            fail_msg("fails by itself: %s", ctx.error);
        if (strlen(ctx.error) < 10 ||
            (status != STATUS_NO_MEMORY && status != STATUS_NO_SPACE && status != STATUS_IO))
            fail_msg("call %llu: status %d, '%s'", (unsigned long long)after, (int)status,
                     ctx.error);
    }
    if (ctx.memory_now != 0)
        fail_msg("call %llu leaks %llu bytes", (unsigned long long)after,
                 (unsigned long long)ctx.memory_now);
    if (folder_count("/proc/self/fd") != open_files)
        fail_msg("call %llu leaks a descriptor", (unsigned long long)after);
    size_t size;
    unsigned char *bytes = file_read(output, &size);
    if (status == STATUS_OK) {
        assert_non_null(bytes);
        if (good && (size != good_size || memcmp(bytes, good, size) != 0))
            fail_msg("call %llu changes the output", (unsigned long long)after);
    } else if (bytes) {
        fail_msg("call %llu leaves an output", (unsigned long long)after);
    }
    free(bytes);
    if (status == STATUS_OK && good)
        remove(output);
    assert_int_equal(folder_count(place->folder), files + (status == STATUS_OK && !good));
    context_clear(&ctx);
    return reached;
}

/* A good run of the stage, with its output kept for the next one. */
static void run_well(struct place *place, stage_function *stage, int files)
{
    assert_false(run_once(place, stage, UINT64_MAX - 1, files, NULL, 0));
}

static void fail_everywhere(struct place *place, stage_function *stage, int files)
{
    struct context ctx;
    context_init(&ctx);
    const char *output;
    assert_int_equal(stage(&ctx, place, &output), STATUS_OK);
    context_clear(&ctx);
    size_t size;
    unsigned char *good = file_read(output, &size);
    assert_non_null(good);
    remove(output);
    uint64_t after = 0;
    while (run_once(place, stage, after, files, good, size))
        after += after < EVERY || getenv("SPBM_EVERY_FAULT") ? 1 : after / 40;
    assert_true(after > 20);
    free(good);
}

static void import_fails_cleanly(void **state)
{
    fail_everywhere(*state, run_import, 1);
}

static void patchify_fails_cleanly(void **state)
{
    run_well(*state, run_import, 1);
    fail_everywhere(*state, run_patchify, 2);
}

static void classic_levels_fail_cleanly(void **state)
{
    run_well(*state, run_import, 1);
    run_well(*state, run_patchify, 2);
    fail_everywhere(*state, run_lod, 3);
}

static void collapse_levels_fail_cleanly(void **state)
{
    struct place *place = *state;
    place->target.mode = MODE_COLLAPSE;
    run_well(place, run_import, 1);
    run_well(place, run_patchify, 2);
    fail_everywhere(place, run_lod, 3);
}

static void topology_fails_cleanly(void **state)
{
    write_part(*state);
    run_well(*state, run_import, 1);
    fail_everywhere(*state, run_topology, 2);
}

static void rebuilding_fails_cleanly(void **state)
{
    write_part(*state);
    run_well(*state, run_import, 1);
    fail_everywhere(*state, run_rebuild, 2);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(import_fails_cleanly),        TEST(patchify_fails_cleanly),
        TEST(classic_levels_fail_cleanly), TEST(collapse_levels_fail_cleanly),
        TEST(topology_fails_cleanly),      TEST(rebuilding_fails_cleanly),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
