/*
 * What stages of a run hand on is the same whether it goes through files or memory: all slabs of a
 * store, all blocks of a chain file, and every level made of them, whatever part is held.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "mesh/store_hold.h"
#include "simplify/simplify.h"
#include "simplify/topology.h"
#include "spbm.h"
#include "test_alike.h"
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

/* Positions that no floats are. */
static struct shape doubles(void)
{
    struct shape shape = shape_noisy_slab(20, 0.3, 2);
    shape_move(&shape, 1.1, 1000.123456789, -20, 1e-3);
    return shape;
}

static struct shape shape_number(unsigned number)
{
    switch (number) {
    case 0:
        return shape_noisy_sphere(4, 0.01, 3);
    case 1:
        return shape_grid_with_holes(32, 32);
    case 2:
        return doubles();
    default:
        return shape_single_triangle();
    }
}

enum { SHAPES = 4, DOUBLES = 2 };

struct places {
    char folder[TEST_PATH], input[TEST_PATH], store[TEST_PATH], short_store[TEST_PATH];
    char whole[TEST_PATH], chains[TEST_PATH], level[TEST_PATH];
};

static const struct target target = {
    .kind = TARGET_RATIO, .count = 1, .values = {0.1}, .effort = 2};

static const struct patch_request no_request = {.patch_angle = {-1, -1},
                                                .face_angle = {-1, -1},
                                                .smoothings = -1,
                                                .chain_tolerance = -1,
                                                .is_own_store = true};

static enum status read_info(struct context *ctx, const char *path, struct chain_info *info)
{
    struct chain_file *file;
    enum status status = chain_file_open(ctx, path, &file);
    if (status == STATUS_OK)
        *info = *chain_file_info(file);
    chain_file_close(&file);
    return status;
}

static enum status build_chains(struct context *ctx, const struct places *places, const char *path,
                                struct chain_hold *hold)
{
    struct patch_request request = no_request;
    request.hold = hold;
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

static void make_places(struct places *places)
{
    folder_make(places->folder);
    folder_path(places->input, places->folder, "in.ply");
    folder_path(places->store, places->folder, "mesh.store");
    folder_path(places->short_store, places->folder, "short.store");
    folder_path(places->whole, places->folder, "whole.chains");
    folder_path(places->chains, places->folder, "mesh.chains");
    folder_path(places->level, places->folder, "out.ply");
}

static void import(struct context *outer, const struct places *places, const char *store,
                   struct store_hold *hold)
{
    const struct import_options options = {.slab_shift = 9, .hold = hold};
    const char *inputs[] = {places->input};
    must_do(outer, store_build(outer, inputs, 1, store, &options, NULL), __LINE__);
}

/* The shape in a file, every other time with attributes; and its store. */
static void make_store(const struct places *places, unsigned number)
{
    struct context ctx;
    struct shape shape = shape_number(number / 2);
    if (number % 2)
        write_numbered(&shape, places->input);
    else
        shape_write(&shape, SHAPE_PLY_LITTLE, places->input);
    shape_free(&shape);
    context_init(&ctx);
    import(&ctx, places, places->store, NULL);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void slabs_must_agree(const struct slab *one, const struct slab *other, uint32_t stride)
{
    const size_t faces = one->face_count, own = one->vertex_end - one->vertex_first;
    assert_int_equal(one->index, other->index);
    assert_int_equal(one->face_first, other->face_first);
    assert_int_equal(one->face_count, other->face_count);
    assert_int_equal(one->vertex_first, other->vertex_first);
    assert_int_equal(one->vertex_end, other->vertex_end);
    assert_int_equal(one->foreign_count, other->foreign_count);
    assert_memory_equal(one->faces, other->faces, 12 * faces);
    assert_memory_equal(one->neighbours, other->neighbours, 12 * faces);
    assert_memory_equal(one->mates, other->mates, faces);
    assert_memory_equal(one->positions, other->positions, 12 * own);
    assert_memory_equal(one->foreign, other->foreign, 4 * (size_t)one->foreign_count);
    assert_memory_equal(one->foreign_positions, other->foreign_positions,
                        12 * (size_t)one->foreign_count);
    if (stride)
        assert_memory_equal(one->records, other->records, stride * own);
}

/* The store whose slabs are held against the whole one. */
static void slabs_must_be_alike(struct context *outer, const struct places *places,
                                struct store_hold *hold)
{
    struct context ctx;
    struct store *one, *other;
    context_init(&ctx);
    must(store_open(&ctx, places->store, true, &one));
    must_do(outer, store_open_own(outer, places->short_store, hold, &other), __LINE__);
    const struct store_info *info = store_info(one);
    const uint32_t stride = info->attributes.stride;
    assert_memory_equal(&info->topology, &store_info(other)->topology, sizeof info->topology);
    assert_true(info->mean_edge == store_info(other)->mean_edge);
    assert_true(info->noise == store_info(other)->noise && info->area == store_info(other)->area);
    for (uint32_t i = 0; i < info->slab_count; i++) {
        struct slab slab, again;
        must(slab_open(one, i, &slab));
        must_do(outer, slab_open(other, i, &again), __LINE__);
        slabs_must_agree(&slab, &again, stride);
        slab_close(&again);
        uint32_t faces, vertices;
        const size_t size = slab_size(other, i, &faces, &vertices);
        void *buffer = aligned_alloc(64, size);
        assert_non_null(buffer);
        must_do(outer, slab_read(other, i, buffer, &again), __LINE__);
        slabs_must_agree(&slab, &again, stride);
        slab_close(&again);
        free(buffer);
        slab_close(&slab);
    }
    for (uint32_t v = 0; stride && v < info->topology.vertices; v += 7) {
        unsigned char record[64], again[64];
        must(store_record(one, v, record));
        must_do(outer, store_record(other, v, again), __LINE__);
        assert_memory_equal(record, again, stride);
    }
    store_close(&one);
    store_close(&other);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

/* A run in which import may hand on so many bytes in memory; returns how many slabs it did. */
static uint32_t hand_on_slabs(const struct places *places, unsigned threads, uint64_t most_bytes,
                              struct first_bytes *first)
{
    struct context ctx;
    struct store_hold slabs = {.most_bytes = most_bytes};
    struct chain_hold blocks = {.most_bytes = UINT64_MAX, .most_in_use = UINT64_MAX};
    context_init(&ctx);
    ctx.threads = threads;
    memory_keep_spares(&ctx, true);
    import(&ctx, places, places->short_store, &slabs);
    const uint32_t count = slabs.slab_count;
    slabs_must_be_alike(&ctx, places, &slabs);
    struct patch_request request = no_request;
    request.slabs = &slabs;
    request.hold = &blocks;
    must(chain_build(&ctx, places->short_store, places->chains, &target, &request, NULL));
    assert_int_equal(slabs.done_before, count);
    store_hold_clear(&slabs);
    (void)blocks_must_be_alike(&ctx, places, &blocks);
    compare_levels(&ctx, places, places->chains, &blocks, first, MODE_COLLAPSE);
    chain_hold_clear(&blocks);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return count;
}

static void test_slabs(void **unused)
{
    (void)unused;
    struct places places;
    make_places(&places);
    for (unsigned i = 0; i < 2 * SHAPES; i++) {
        struct context ctx;
        struct first_bytes first = {0};
        make_store(&places, i);
        context_init(&ctx);
        must(build_chains(&ctx, &places, places.whole, NULL));
        compare_levels(&ctx, &places, places.whole, NULL, &first, MODE_COLLAPSE);
        struct chain_info info = {0};
        must(read_info(&ctx, places.whole, &info));
        assert_true(info.is_float32 == (i / 2 != DOUBLES));
        context_clear(&ctx);
        assert_int_equal(hand_on_slabs(&places, 1, UINT64_MAX, &first), info.slab_count);
        assert_int_equal(hand_on_slabs(&places, 2, UINT64_MAX, &first), info.slab_count);
        assert_int_equal(hand_on_slabs(&places, 2, 0, &first), 0);
        const uint64_t half = info.topology.faces * 25 / 2 + info.topology.vertices * 6;
        const uint32_t part = hand_on_slabs(&places, 2, half, &first);
        assert_true(part < info.slab_count && (part > 0 || info.slab_count < 3));
        free(first.bytes);
    }
    folder_remove(places.folder);
}

static void test_blocks(void **unused)
{
    (void)unused;
    struct places places;
    make_places(&places);
    for (unsigned i = 0; i < 2 * SHAPES; i++) {
        make_store(&places, i);
        check(&places, MODE_COLLAPSE);
        if (i % 2)
            check(&places, MODE_CLASSIC);
    }
    folder_remove(places.folder);
}

/* The store that topology makes of another, holes filled; `hold` may be NULL. */
static void rebuild(struct context *outer, const struct places *places, const char *store,
                    struct store_hold *hold)
{
    const struct import_options options = {.slab_shift = 9, .hold = hold};
    struct topology_options wanted;
    struct topology_report report = {0};
    topology_defaults(&wanted);
    wanted.close_cracks.value = 1.6;
    must_do(outer,
            topology_rebuild(outer, places->whole, places->chains, store, &options, &wanted,
                             &report, NULL),
            __LINE__);
    topology_report_clear(outer, &report);
}

static void test_topology(void **unused)
{
    (void)unused;
    struct context ctx;
    struct places places;
    struct store_hold slabs = {.most_bytes = UINT64_MAX};
    make_places(&places);
    struct shape shape = shape_grid_with_holes(32, 32);
    shape_write(&shape, SHAPE_PLY_LITTLE, places.input);
    shape_free(&shape);
    context_init(&ctx);
    import(&ctx, &places, places.whole, NULL);
    rebuild(&ctx, &places, places.store, NULL);
    rebuild(&ctx, &places, places.short_store, &slabs);
    assert_true(slabs.slab_count > 1);
    slabs_must_be_alike(&ctx, &places, &slabs);
    store_hold_clear(&slabs);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    folder_remove(places.folder);
}

/* The whole run, with slabs of the program's own size: files are kept, the budget leaves nothing
 * for holding, and no budget. */
static void test_runs(void **unused)
{
    (void)unused;
    struct places places;
    char keep[TEST_PATH + 8];
    struct first_bytes first = {0};
    make_places(&places);
    snprintf(keep, sizeof keep, "%s/keep", places.folder);
    struct shape shape = shape_noisy_torus(800, 400, 0.001, 5);
    shape_move(&shape, 1.1, 1000.123456789, -20, 1e-3);
    shape_write(&shape, SHAPE_PLY_LITTLE, places.input);
    shape_free(&shape);
    for (unsigned i = 0; i < 3; i++) {
        spbm_settings settings;
        spbm_job *job;
        spbm_simplify_options options;
        spbm_settings_defaults(&settings);
        settings.memory = i == 1 ? 64 << 20 : 0;
        settings.threads = 1 + i / 2;
        assert_int_equal(spbm_job_open(&settings, &job), SPBM_OK);
        spbm_simplify_defaults(&options);
        options.target.kind = SPBM_BY_FACES;
        options.target.count = 1;
        options.target.values[0] = 1000;
        options.target.effort = 1;
        options.keep_dir = i == 0 ? keep : NULL;
        const char *inputs[] = {places.input};
        const spbm_status status = spbm_simplify(job, inputs, 1, places.level, &options, NULL);
        if (status != SPBM_OK)
            fail_msg("run %u: status %d: %s", i, (int)status, spbm_job_error(job));
        size_t size;
        unsigned char *bytes = file_read(places.level, &size);
        assert_non_null(bytes);
        first_bytes_compare(&first, bytes, size);
        spbm_job_close(&job);
    }
    free(first.bytes);
    folder_remove(keep);
    folder_remove(places.folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_slabs), cmocka_unit_test(test_blocks),
                                       cmocka_unit_test(test_topology),
                                       cmocka_unit_test(test_runs)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
