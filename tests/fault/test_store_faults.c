/*
 * Every allocation and every guarded system call of building, checking and exporting a store, made
 * to fail one after the other: each run ends with a status and words, no file is left that was not
 * there, nothing leaks, and the next run succeeds.
 */
#include "test_kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mesh/export.h"
#include "mesh/store.h"
#include "test_files.h"
#include "test_shapes.h"

struct place {
    char folder[TEST_PATH];
    char input[TEST_PATH];
    char store[TEST_PATH];
    char output[TEST_PATH];
    uint64_t working_memory;
    bool weld;
};

typedef enum status job_function(struct context *ctx, struct place *place);

/* Something of everything: a scan-like part, touching spheres, a strip that is not orientable,
 * duplicates, turned faces, degenerate ones. */
static struct shape messy_shape(void)
{
    struct shape shape = shape_spheres_touching_edge(1), other = shape_mobius(12, 2);
    shape_append(&shape, &other);
    shape_free(&other);
    other = shape_grid_with_holes(8, 8);
    shape_append(&shape, &other);
    shape_free(&other);
    shape_fan(&shape);
    shape_triangle(&shape, 1, 1, 2);
    for (size_t f = 0; f < 20; f++) {
        const uint32_t *face = shape.indices + 3 * f;
        uint32_t copy[3] = {face[1], face[0], face[2]};
        shape_face(&shape, 3, copy);
        shape_flip(&shape, 3 * f);
    }
    shape_shuffle(&shape, 9);
    return shape;
}

static int set_up(void **state)
{
    struct place *place = calloc(1, sizeof *place);
    folder_make(place->folder);
    folder_path(place->input, place->folder, "in.ply");
    folder_path(place->store, place->folder, "a.store");
    folder_path(place->output, place->folder, "out.ply");
    struct shape shape = messy_shape();
    shape_write(&shape, SHAPE_PLY_LITTLE, place->input);
    shape_free(&shape);
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

static void fail_everywhere(struct place *place, job_function *job, const char *made)
{
    const int open_files = folder_count("/proc/self/fd");
    uint64_t failures = 0;
    for (uint64_t after = 0;; after++) {
        struct context ctx;
        context_init(&ctx);
        ctx.fault_after = after;
        if (made)
            remove(made);
        const int files = folder_count(place->folder);
        enum status status = job(&ctx, place);
        const bool reached = ctx.fault_after == UINT64_MAX;
        if (!reached)
            assert_int_equal(status, STATUS_OK);
        if (status != STATUS_OK) {
            failures++;
            assert_int_equal(ctx.failed, status);
            assert_true(strlen(ctx.error) > 10 && !strchr(ctx.error, '\n'));
            assert_true(status == STATUS_NO_MEMORY || status == STATUS_NO_SPACE ||
                        status == STATUS_IO);
            assert_int_equal(folder_count(place->folder), files);
        }
        assert_int_equal(ctx.memory_now, 0);
        assert_int_equal(folder_count("/proc/self/fd"), open_files);
        context_clear(&ctx);
        if (!reached)
            break;
        assert_true(after < 100000);
    }
    assert_true(failures > 20);
}

static enum status build(struct context *ctx, struct place *place)
{
    const char *input = place->input;
    struct import_options options = {.slab_shift = 5,
                                     .weld = place->weld,
                                     .sync = place->working_memory == 0,
                                     .working_memory = place->working_memory};
    return store_build(ctx, &input, 1, place->store, &options, NULL);
}

static enum status check(struct context *ctx, struct place *place)
{
    return store_check(ctx, place->store);
}

static enum status export_ply(struct context *ctx, struct place *place)
{
    struct store *store;
    struct export_options options = {.format = EXPORT_PLY};
    enum status status = store_open(ctx, place->store, true, &store);
    if (status == STATUS_OK)
        status = store_export(store, place->output, &options);
    store_close(&store);
    return status;
}

static enum status load(struct context *ctx, struct place *place)
{
    struct store *store;
    struct mesh mesh = {0};
    enum status status = store_open(ctx, place->store, true, &store);
    if (status == STATUS_OK)
        status = store_load(store, &mesh);
    store_close(&store);
    mesh_clear(ctx, &mesh);
    return status;
}

static void building_in_memory(void **state)
{
    struct place *place = *state;
    fail_everywhere(place, build, place->store);
    place->weld = true;
    fail_everywhere(place, build, place->store);
}

static void building_on_disk(void **state)
{
    struct place *place = *state;
    place->working_memory = 32 << 10;
    fail_everywhere(place, build, place->store);
}

static void reading(void **state)
{
    struct place *place = *state;
    struct context ctx;
    context_init(&ctx);
    assert_int_equal(build(&ctx, place), STATUS_OK);
    context_clear(&ctx);
    fail_everywhere(place, check, NULL);
    fail_everywhere(place, export_ply, place->output);
    fail_everywhere(place, load, NULL);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(building_in_memory, set_up, tear_down),
        cmocka_unit_test_setup_teardown(building_on_disk, set_up, tear_down),
        cmocka_unit_test_setup_teardown(reading, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
