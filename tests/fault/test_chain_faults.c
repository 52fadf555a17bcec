/*
 * Patches, chains, seams and the chain file with every allocation and every guarded system call
 * made to fail, one a run: each run ends with a status and words and gives all memory back. (What
 * stage 2 leaves on the disk then is test_pipeline_faults' matter.)
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/memory.h"
#include "mesh/store_hold.h"
#include "simplify/patchify.h"
#include "simplify/simplify.h"
#include "test_alike.h"
#include "test_kit.h"
#include "test_shapes.h"

static char scan_path[256], store_path[256], chain_path[256], other_path[256], kept_path[256];

static int set_up(void **unused)
{
    (void)unused;
    struct context ctx;
    context_init(&ctx);
    snprintf(scan_path, sizeof scan_path, "%s", test_path("faults.ply"));
    snprintf(store_path, sizeof store_path, "%s", test_path("faults.store"));
    snprintf(chain_path, sizeof chain_path, "%s", test_path("faults.chains"));
    snprintf(other_path, sizeof other_path, "%s", test_path("other.chains"));
    snprintf(kept_path, sizeof kept_path, "%s", test_path("kept.chains"));
    struct shape shape = shape_noisy_torus(24, 12, 0.02, 1);
    shape_write(&shape, SHAPE_PLY_LITTLE, scan_path);
    shape_free(&shape);
    struct import_options options = {.slab_shift = 6};
    const char *inputs[] = {scan_path};
    int result = store_build(&ctx, inputs, 1, store_path, &options, NULL) != STATUS_OK;
    context_clear(&ctx);
    return result;
}

static enum status build(struct context *ctx, const char *path)
{
    struct target target = {.count = 1, .values = {100}, .mode = MODE_CLASSIC, .effort = 2};
    struct patch_request request = {.patch_angle = {-1, -1},
                                    .face_angle = {-1, -1},
                                    .smoothings = 1,
                                    .chain_tolerance = -1,
                                    .level = 6};
    return chain_build(ctx, store_path, path, &target, &request, NULL);
}

static enum status run_build(struct context *ctx)
{
    return build(ctx, other_path);
}

static enum status run_check(struct context *ctx)
{
    return chain_file_check(ctx, chain_path);
}

static enum status run_check_kept(struct context *ctx)
{
    return chain_file_check(ctx, kept_path);
}

static enum status run_read(struct context *ctx)
{
    struct chain_file *file;
    enum status status = chain_file_open(ctx, chain_path, &file);
    for (uint32_t i = 0; !status && i < chain_file_info(file)->slab_count; i++) {
        struct chain_block block;
        status = chain_block_read(file, i, &block);
        chain_block_clear(ctx, 0, &block);
    }
    chain_file_close(&file);
    return status;
}

/* Levels of a file that is written again with its trunk, and then those from the trunk. */
static enum status run_keep(struct context *ctx)
{
    struct lod_report report;
    const struct lod_options options = {
        .target = {.count = 1, .values = {60}, .mode = MODE_COLLAPSE, .effort = 1},
        .output = test_path("faults-out.ply"),
        .keeps_trunk = true};
    return lod_build(ctx, kept_path, &options, &report);
}

static enum status run_labels(struct context *ctx)
{
    struct store *store;
    enum status status = store_open(ctx, store_path, true, &store);
    if (status)
        return status;
    struct slab slab = {0};
    struct patch_options options = {.patch_cosine = {0.9, 0}, .face_cosine = {0.9, 0}};
    uint32_t count, *labels = calloc(64, sizeof *labels);
    status = slab_open(store, 1, &slab);
    if (!status)
        status = patch_labels(ctx, &slab, &options, labels, &count);
    slab_close(&slab);
    store_close(&store);
    free(labels);
    return status;
}

/* All stages with what they hand on in memory. */
static enum status run_held(struct context *ctx)
{
    char store[256];
    snprintf(store, sizeof store, "%s", test_path("held.store"));
    struct store_hold slabs = {.most_bytes = UINT64_MAX};
    struct chain_hold blocks = {.most_bytes = UINT64_MAX, .most_in_use = UINT64_MAX};
    const struct import_options import = {.slab_shift = 6, .hold = &slabs};
    const struct target target = {.count = 1, .values = {60}, .mode = MODE_COLLAPSE, .effort = 1};
    const struct patch_request request = {.patch_angle = {-1, -1},
                                          .face_angle = {-1, -1},
                                          .smoothings = 1,
                                          .chain_tolerance = -1,
                                          .is_own_store = true,
                                          .slabs = &slabs,
                                          .hold = &blocks};
    struct lod_options options = {.target = target, .is_own_file = true, .hold = &blocks};
    char output[256];
    snprintf(output, sizeof output, "%s", test_path("faults-out.ply"));
    options.output = output;
    const char *inputs[] = {scan_path};
    struct lod_report report;
    enum status status = store_build(ctx, inputs, 1, store, &import, NULL);
    if (!status)
        status = chain_build(ctx, store, other_path, &target, &request, NULL);
    store_hold_clear(&slabs);
    if (!status)
        status = lod_build(ctx, other_path, &options, &report);
    chain_hold_clear(&blocks);
    return status;
}

static void every_fault(enum status (*run)(struct context *ctx), unsigned threads)
{
    for (uint64_t after = 0;; after++) {
        struct context ctx;
        context_init(&ctx);
        ctx.threads = threads;
        ctx.fault_after = after;
        enum status status = run(&ctx);
        bool is_through = ctx.fault_after != UINT64_MAX; /* it never came to that call */
        if (ctx.memory_now != 0)
            fail_msg("after %llu calls: %llu bytes are not given back", (unsigned long long)after,
                     (unsigned long long)ctx.memory_now);
        assert_true(status == STATUS_OK || ctx.error[0] != 0);
        context_clear(&ctx);
        if (is_through) {
            assert_int_equal(status, STATUS_OK);
            assert_true(after > 5);
            return;
        }
    }
}

static void labels(void **unused)
{
    (void)unused;
    every_fault(run_labels, 1);
}

static void building(void **unused)
{
    (void)unused;
    every_fault(run_held, 1);
    every_fault(run_build, 1);
    every_fault(run_build, 2);
}

static void reading_and_checking(void **unused)
{
    (void)unused;
    struct context ctx;
    context_init(&ctx);
    assert_int_equal(build(&ctx, chain_path), STATUS_OK);
    context_clear(&ctx);
    every_fault(run_read, 1);
    every_fault(run_check, 1);
}

static void keeping_a_trunk(void **unused)
{
    (void)unused;
    struct context ctx;
    context_init(&ctx);
    assert_int_equal(build(&ctx, kept_path), STATUS_OK);
    context_clear(&ctx);
    struct stat before, after;
    assert_int_equal(stat(kept_path, &before), 0);
    every_fault(run_keep, 1);
    assert_int_equal(stat(kept_path, &after), 0);
    assert_true(after.st_size > before.st_size);
    every_fault(run_keep, 1);
    every_fault(run_check_kept, 1);
}

/* Whatever the budget: the same file or no memory. */
static void small_budgets(void **unused)
{
    (void)unused;
    bool succeeded = false, refused = false;
    for (uint64_t budget = 1 << 14; budget < 1 << 26; budget += budget / 2) {
        struct context ctx;
        context_init(&ctx);
        ctx.memory_budget = budget;
        enum status status = run_build(&ctx);
        assert_true(status == STATUS_OK || status == STATUS_NO_MEMORY);
        assert_true(ctx.memory_peak <= budget);
        assert_int_equal(ctx.memory_now, 0);
        succeeded |= status == STATUS_OK;
        refused |= status != STATUS_OK;
        context_clear(&ctx);
        if (status)
            continue;
        files_must_be_alike(chain_path, other_path);
    }
    assert_true(succeeded && refused);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(labels),
        cmocka_unit_test(building),
        cmocka_unit_test(reading_and_checking),
        cmocka_unit_test(keeping_a_trunk),
        cmocka_unit_test(small_budgets),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
