/*
 * Stage 2 on real stores: meshes of every kind, imported with small slabs, and real scans. Each
 * file passes the full check; labels made again fit its patches; the bytes do not depend on threads
 * or memory.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "mesh/store.h"
#include "simplify/patchify.h"
#include "simplify/simplify.h"
#include "test_alike.h"
#include "test_chains.h"
#include "test_files.h"
#include "test_kit.h"
#include "test_shapes.h"

#define must(call) must_do(&ctx, (call), __LINE__)

static void must_do(struct context *ctx, enum status status, int line)
{
    if (status)
        fail_msg("line %d: status %d: %s", line, (int)status, ctx->error);
}

struct request {
    struct target target;
    struct patch_request patch;
};

static struct request default_request(void)
{
    return (struct request){.target = {.kind = TARGET_FACES,
                                       .count = 1,
                                       .values = {100},
                                       .mode = MODE_CLASSIC,
                                       .effort = 2},
                            .patch = {.patch_angle = {-1, -1},
                                      .face_angle = {-1, -1},
                                      .smoothings = -1,
                                      .chain_tolerance = -1,
                                      .level = 6}};
}

static struct request angles(double patch, double face, int32_t smoothings)
{
    struct request request = default_request();
    request.patch.patch_angle[0] = patch;
    request.patch.face_angle[0] = face;
    request.patch.smoothings = smoothings;
    return request;
}

/* Patches of the file against labels grown again: as many, disks, with the same areas. */
static void labels_must_fit(const char *store_path, const char *chain_path)
{
    struct context ctx;
    context_init(&ctx);
    struct store *store;
    struct chain_file *file;
    must(store_open(&ctx, store_path, true, &store));
    must(chain_file_open(&ctx, chain_path, &file));
    const struct chain_info *info = chain_file_info(file);
    double area = 0;
    for (uint32_t i = 0; i < info->slab_count; i++) {
        struct slab slab = {0};
        struct chain_block block;
        must(slab_open(store, i, &slab));
        must(chain_block_read(file, i, &block));
        uint32_t count, *labels = calloc(slab.face_count, sizeof *labels);
        must(patch_labels(&ctx, &slab, &info->options, labels, &count));
        assert_int_equal(count, block.patch_count);
        patches_must_be_disks(&slab, labels, count, PATCH_FACES_MAX);
        for (uint32_t p = 0; p < count; p++)
            area += block.patches[p].area;
        free(labels);
        chain_block_clear(&ctx, info->attributes.stride, &block);
        slab_close(&slab);
    }
    assert_true(area >= info->area * (1 - 1e-5) && area <= info->area * (1 + 1e-5));
    chain_file_close(&file);
    store_close(&store);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void build_and_check(const char *store_path, const struct request *request,
                            unsigned threads_max)
{
    struct context ctx;
    char first[256], path[256];
    snprintf(first, sizeof first, "%s", test_path("one.chains"));
    snprintf(path, sizeof path, "%s", test_path("other.chains"));
    for (unsigned threads = 1; threads <= threads_max; threads++) {
        struct chain_info info;
        context_init(&ctx);
        ctx.threads = threads;
        must(chain_build(&ctx, store_path, threads == 1 ? first : path, &request->target,
                         &request->patch, &info));
        assert_int_equal(ctx.memory_now, 0);
        if (threads > 1)
            files_must_be_alike(first, path);
        context_clear(&ctx);
    }
    context_init(&ctx);
    must(chain_file_check(&ctx, first));
    labels_must_fit(store_path, first);
    context_clear(&ctx);
}

static struct shape shape_number(unsigned number)
{
    switch (number) {
    case 0:
        return shape_mobius(40, 5);
    case 1:
        return shape_klein_bottle(24, 16);
    case 2:
        return shape_spheres_touching_vertex(3);
    case 3:
        return shape_spheres_touching_edge(3);
    case 4:
        return shape_noisy_torus(40, 20, 0.03, 1);
    case 5:
        return shape_grid_with_holes(32, 32);
    case 6:
        return shape_noisy_slab(24, 0.3, 2);
    case 7:
        return shape_single_triangle();
    default:
        return shape_spiral_ramp(3, 40);
    }
}

static void meshes_of_every_kind(void **unused)
{
    (void)unused;
    for (unsigned number = 0; number < 9; number++) {
        for (unsigned shift = 4; shift <= 18; shift += 7) {
            struct context ctx;
            context_init(&ctx);
            char scan[256], store[256];
            snprintf(scan, sizeof scan, "%s", test_path("kind.ply"));
            snprintf(store, sizeof store, "%s", test_path("kind.store"));
            struct shape shape = shape_number(number);
            if (number % 2)
                shape_shuffle(&shape, number);
            shape_write(&shape, SHAPE_PLY_LITTLE, scan);
            shape_free(&shape);
            struct import_options import = {.slab_shift = shift};
            const char *inputs[] = {scan};
            must(store_build(&ctx, inputs, 1, store, &import, NULL));
            struct request request = shift == 4 ? angles(180, 180, 0) : angles(20, 15, 1);
            if (shift == 4)
                request.patch.patch_angle[1] = request.patch.face_angle[1] = 180;
            build_and_check(store, &request, 3);
            context_clear(&ctx);
        }
    }
}

static void real_scan(const char *name, const struct request *request)
{
    struct context ctx;
    const char *data = test_data(name);
    if (!data)
        skip();
    context_init(&ctx);
    ctx.threads = 2;
    char scan[256], store[256];
    snprintf(scan, sizeof scan, "%s", data);
    snprintf(store, sizeof store, "%s", test_path("real.store"));
    struct import_options import = {0};
    const char *inputs[] = {scan};
    must(store_build(&ctx, inputs, 1, store, &import, NULL));
    build_and_check(store, request, 2);
    context_clear(&ctx);
}

static void bunny(void **unused)
{
    (void)unused;
    struct request request = angles(12, 10, 1);
    real_scan("stanford_bunny_ascii.ply", &request);
}

/* Chapter 4's angles; its chain file takes at most 15 % of the binary PLY: 12 bytes a vertex and 13
 * a face. */
static void dragon(void **unused)
{
    (void)unused;
    struct request request = angles(25, 20, 0);
    real_scan("stanford_dragon.ply.gz", &request);
    size_t size;
    unsigned char *bytes = file_read(test_path("one.chains"), &size);
    free(bytes);
    assert_true(size <= (size_t)(0.15 * (13.0 * 871414 + 12.0 * 437645)));
}

static void parts_and_broken_scans(void **unused)
{
    (void)unused;
    struct request request = default_request();
    real_scan("fandisk.off.gz", &request);
    real_scan("cad_cycloidal_coloured_nonmanifold.ply", &request);
    real_scan("stanford_dragon_res3_nonmanifold.ply.gz", &request);
    real_scan("photogrammetry_birdbath_holes.ply", &request);
}

/* ---- memory ---- */

static void build_store(struct shape shape, const char *store, unsigned slab_shift)
{
    struct context ctx;
    context_init(&ctx);
    char scan[256];
    snprintf(scan, sizeof scan, "%s", test_path("memory.ply"));
    shape_write(&shape, SHAPE_PLY_LITTLE, scan);
    shape_free(&shape);
    struct import_options import = {.slab_shift = slab_shift};
    const char *inputs[] = {scan};
    must(store_build(&ctx, inputs, 1, store, &import, NULL));
    context_clear(&ctx);
}

/* Builds within a budget and returns what was in use at the peak. */
static uint64_t build_within(const char *store, const char *chains, const struct request *request,
                             unsigned threads, uint64_t budget)
{
    struct context ctx;
    context_init(&ctx);
    ctx.threads = threads;
    ctx.memory_budget = budget;
    must(chain_build(&ctx, store, chains, &request->target, &request->patch, NULL));
    assert_int_equal(ctx.memory_now, 0);
    uint64_t peak = ctx.memory_peak;
    context_clear(&ctx);
    return peak;
}

/* Any number of threads, in the least memory of one and of all: the same bytes. */
static void budgets_do_not_show(void **unused)
{
    (void)unused;
    char store[256], first[256], path[256];
    snprintf(store, sizeof store, "%s", test_path("memory.store"));
    snprintf(first, sizeof first, "%s", test_path("one.chains"));
    snprintf(path, sizeof path, "%s", test_path("other.chains"));
    build_store(shape_noisy_sphere(5, 0.02, 3), store, 9);
    const struct request request = angles(12, 10, 1);
    (void)build_within(store, first, &request, 1, UINT64_MAX);
    static const unsigned threads[] = {1, 2, 3, 8, 64};
    for (unsigned i = 0; i < 5; i++) {
        for (unsigned all = 0; all < 2; all++) {
            uint64_t least = chain_build_least_memory(all ? threads[i] : 1, 0, 0);
            assert_true(build_within(store, path, &request, threads[i], least) <= least);
            files_must_be_alike(first, path);
        }
    }
}

/* The worst that a closed mesh can do: whole slabs, and each face a patch of its own. */
static void shattered_slabs_fit(void **unused)
{
    (void)unused;
    char store[256], path[256];
    snprintf(store, sizeof store, "%s", test_path("memory.store"));
    snprintf(path, sizeof path, "%s", test_path("other.chains"));
    build_store(shape_noisy_sphere(7, 0.02, 3), store, 0);
    struct request request = angles(0, 0, 0);
    request.patch.level = 0;
    for (unsigned threads = 1; threads <= 2; threads++) {
        uint64_t least = chain_build_least_memory(threads, 0, 0);
        (void)build_within(store, path, &request, threads, least);
    }
}

/* From a patch a face to one for many: what is noted of patches lies in room that is lent, where it
 * is enough (for 0.625 a face of a closed surface), or never did. */
static void patches_of_any_number(void **unused)
{
    (void)unused;
    char store[256];
    snprintf(store, sizeof store, "%s", test_path("number.store"));
    build_store(shape_noisy_sphere(4, 0.02, 5), store, 0);
    double part = 1, most_lent = 0;
    for (double angle = 8; part > 0.3; angle *= 1.03) {
        struct context ctx;
        struct chain_file *file;
        const struct request request = angles(angle, angle, 0);
        build_and_check(store, &request, 1);
        context_init(&ctx);
        must(chain_file_open(&ctx, test_path("one.chains"), &file));
        const struct chain_info *info = chain_file_info(file);
        part = (double)info->patches / (double)info->topology.faces;
        most_lent = part < 0.62 && part > most_lent ? part : most_lent;
        chain_file_close(&file);
        context_clear(&ctx);
    }
    assert_true(most_lent > 0.59);
}

static void same_file_for_input_and_output(void **unused)
{
    (void)unused;
    struct context ctx;
    context_init(&ctx);
    char scan[256], store[256];
    snprintf(scan, sizeof scan, "%s", test_path("same.ply"));
    snprintf(store, sizeof store, "%s", test_path("same.store"));
    struct shape shape = shape_icosphere(2);
    shape_write(&shape, SHAPE_PLY_LITTLE, scan);
    shape_free(&shape);
    struct import_options import = {0};
    const char *inputs[] = {scan};
    must(store_build(&ctx, inputs, 1, store, &import, NULL));
    struct request request = default_request();
    assert_int_equal(chain_build(&ctx, store, store, &request.target, &request.patch, NULL),
                     STATUS_MISUSE);
    context_clear(&ctx);
    context_init(&ctx);
    must(store_check(&ctx, store)); /* untouched */
    assert_int_equal(
        chain_build(&ctx, scan, test_path("x.chains"), &request.target, &request.patch, NULL),
        STATUS_BAD_INPUT);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(meshes_of_every_kind),
        cmocka_unit_test(bunny),
        cmocka_unit_test(dragon),
        cmocka_unit_test(parts_and_broken_scans),
        cmocka_unit_test(budgets_do_not_show),
        cmocka_unit_test(shattered_slabs_fit),
        cmocka_unit_test(patches_of_any_number),
        cmocka_unit_test(same_file_for_input_and_output),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
