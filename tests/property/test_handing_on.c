/*
 * What stages of a run hand on is the same whether it goes through files or memory: every block of
 * a chain file, and every level made of them, whatever part of the blocks is held.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "mesh/store.h"
#include "simplify/simplify.h"
#include "test_chains.h"
#include "test_files.h"
#include "test_kit.h"
#include "test_shapes.h"

#define must(call) must_do(&ctx, (call), __LINE__)

static void must_do(struct context *ctx, enum status status, int line)
{
    if (status != STATUS_OK && status != STATUS_TARGET_MISSED)
        fail_msg("line %d: status %d: %s", line, (int)status, ctx->error);
}

/* The shape, triangles, as a PLY whose vertices have a number. */
static void write_numbered(const struct shape *shape, const char *path)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    fprintf(file,
            "ply\nformat ascii 1.0\nelement vertex %zu\nproperty float x\nproperty float y\n"
            "property float z\nproperty uint number\nelement face %zu\n"
            "property list uchar int vertex_indices\nend_header\n",
            shape->vertex_count, shape->face_count);
    for (size_t v = 0; v < shape->vertex_count; v++) {
        const double *p = shape->positions + 3 * v;
        fprintf(file, "%.9g %.9g %.9g %zu\n", p[0], p[1], p[2], v);
    }
    for (size_t f = 0; f < shape->face_count; f++) {
        const uint32_t *corners = shape->indices + 3 * f;
        fprintf(file, "3 %u %u %u\n", corners[0], corners[1], corners[2]);
    }
    assert_int_equal(fclose(file), 0);
}

static struct shape shape_number(unsigned number)
{
    switch (number) {
    case 0:
        return shape_noisy_sphere(4, 0.01, 3);
    case 1:
        return shape_grid_with_holes(32, 32);
    case 2:
        return shape_noisy_slab(20, 0.3, 2);
    default:
        return shape_single_triangle();
    }
}

enum { SHAPES = 4 };

struct places {
    char folder[TEST_PATH], input[TEST_PATH], store[TEST_PATH], whole[TEST_PATH];
    char chains[TEST_PATH], level[TEST_PATH];
};

static const struct target target = {
    .kind = TARGET_RATIO, .count = 1, .values = {0.1}, .effort = 2};

static enum status build_chains(struct context *ctx, const struct places *places, const char *path,
                                struct chain_hold *hold)
{
    const struct patch_request request = {.patch_angle = {-1, -1},
                                          .face_angle = {-1, -1},
                                          .smoothings = -1,
                                          .chain_tolerance = -1,
                                          .is_own_store = true,
                                          .hold = hold};
    return chain_build(ctx, places->store, path, &target, &request, NULL);
}

/* Returns how many blocks are held. */
static uint32_t blocks_must_be_alike(struct context *outer, const struct places *places,
                                     const struct chain_hold *hold)
{
    struct context ctx;
    struct chain_file *one, *other;
    uint32_t held = 0;
    context_init(&ctx);
    must(chain_file_open(&ctx, places->whole, &one));
    must(chain_file_open(outer, places->chains, &other));
    chain_file_trust(other, hold);
    const struct chain_info *info = chain_file_info(one);
    for (uint32_t i = 0; i < info->slab_count; i++) {
        struct chain_block block, again;
        must(chain_block_read(one, i, &block));
        held += chain_hold_give(hold, i, &again);
        must_do(outer, chain_block_read(other, i, &again), __LINE__);
        blocks_must_agree(&block, &again, info->attributes.stride);
        chain_block_release(one, &block);
        chain_block_release(other, &again);
    }
    chain_file_close(&one);
    chain_file_close(&other);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return held;
}

static void compare_levels(struct context *ctx, const struct places *places, const char *chains,
                           struct chain_hold *hold, struct first_bytes *first, enum lod_mode mode)
{
    struct lod_report report;
    struct lod_options options = {.target = target,
                                  .output = places->level,
                                  .export = {.format = EXPORT_PLY},
                                  .is_own_file = true,
                                  .hold = hold};
    options.target.mode = mode;
    must_do(ctx, lod_build(ctx, chains, &options, &report), __LINE__);
    size_t size;
    unsigned char *bytes = file_read(places->level, &size);
    assert_non_null(bytes);
    first_bytes_compare(first, bytes, size);
}

/* One run of both stages that may hold so many bytes; returns how many it did. */
static uint64_t hand_on(const struct places *places, unsigned threads, uint64_t most_bytes,
                        enum lod_mode mode, struct first_bytes *first)
{
    struct context ctx;
    struct chain_hold hold = {.most_bytes = most_bytes, .most_in_use = UINT64_MAX};
    context_init(&ctx);
    ctx.threads = threads;
    must(build_chains(&ctx, places, places->chains, &hold));
    const uint64_t bytes = atomic_load(&hold.bytes);
    const uint32_t held = blocks_must_be_alike(&ctx, places, &hold), count = hold.slab_count;
    assert_true(bytes <= most_bytes);
    assert_true((bytes > 0) == (held > 0));
    assert_true((most_bytes == UINT64_MAX) == (held == count));
    compare_levels(&ctx, places, places->chains, &hold, first, mode);
    chain_hold_clear(&hold);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return bytes;
}

static void check(const struct places *places, enum lod_mode mode)
{
    struct context ctx;
    struct first_bytes first = {0};
    context_init(&ctx);
    must(build_chains(&ctx, places, places->whole, NULL));
    compare_levels(&ctx, places, places->whole, NULL, &first, mode);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    const uint64_t all = hand_on(places, 1, UINT64_MAX, mode, &first);
    assert_true(all > 0);
    assert_int_equal(hand_on(places, 2, UINT64_MAX, mode, &first), all);
    assert_int_equal(hand_on(places, 2, 0, mode, &first), 0);
    (void)hand_on(places, 1, all - 1, mode, &first);
    (void)hand_on(places, 2, all / 2, mode, &first);
    free(first.bytes);
}

static void test_blocks(void **unused)
{
    (void)unused;
    struct places places;
    folder_make(places.folder);
    folder_path(places.input, places.folder, "in.ply");
    folder_path(places.store, places.folder, "mesh.store");
    folder_path(places.whole, places.folder, "whole.chains");
    folder_path(places.chains, places.folder, "mesh.chains");
    folder_path(places.level, places.folder, "out.ply");
    for (unsigned i = 0; i < 2 * SHAPES; i++) {
        struct context ctx;
        struct shape shape = shape_number(i / 2);
        if (i % 2)
            write_numbered(&shape, places.input);
        else
            shape_write(&shape, SHAPE_PLY_LITTLE, places.input);
        shape_free(&shape);
        const struct import_options options = {.slab_shift = 9};
        const char *inputs[] = {places.input};
        context_init(&ctx);
        must(store_build(&ctx, inputs, 1, places.store, &options, NULL));
        context_clear(&ctx);
        check(&places, MODE_COLLAPSE);
        if (i % 2)
            check(&places, MODE_CLASSIC);
    }
    folder_remove(places.folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_blocks)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
