/*
 * A chain file of any bytes, with whatever checksums. Checking, reading block by block and making
 * levels must refuse it or do their work; levels of a file that passes its check are manifold, and
 * there are no levels of a file that does not pass which are not.
 */
#include "target.h"

#include <stdio.h>
#include <stdlib.h>

#include "mesh/import.h"
#include "simplify/simplify.h"
#include "test_files.h"
#include "test_shapes.h"

const bool target_keeps_length = true;

static bool check_and_read(const char *path)
{
    struct context ctx;
    target_context(&ctx);
    enum status checked = chain_file_check(&ctx, path);
    target_end(&ctx, checked);

    target_context(&ctx);
    struct chain_file *file = NULL;
    enum status status = chain_file_open(&ctx, path, &file);
    uint32_t slabs = status == STATUS_OK ? chain_file_info(file)->slab_count : 0;
    for (uint32_t i = 0; i < slabs && status == STATUS_OK; i++) {
        struct chain_block block;
        status = chain_block_read(file, i, &block);
        if (status == STATUS_OK)
            chain_block_clear(&ctx, chain_file_info(file)->attributes.stride, &block);
    }
    chain_file_close(&file);
    require(checked != STATUS_OK || status == STATUS_OK, "what passes the check can be read");
    target_end(&ctx, status);
    return checked == STATUS_OK;
}

static void make_level(const char *path, bool must_work, const struct target *target,
                       enum placement place)
{
    struct context ctx;
    target_context(&ctx);
    struct lod_options options = {.target = *target,
                                  .place = place,
                                  .output = target_path("level.ply"),
                                  .export = {.format = EXPORT_PLY}};
    struct lod_report report;
    enum status status = lod_build(&ctx, path, &options, &report);
    if (must_work && status == STATUS_BAD_INPUT)
        fprintf(stderr, "%s\n", ctx.error);
    require(!must_work || status == STATUS_OK || status == STATUS_TARGET_MISSED,
            "a sound chain file gives its levels");
    target_end(&ctx, status);
    bool is_there = status == STATUS_OK || status == STATUS_TARGET_MISSED;
    if (is_there)
        require_manifold_file(target_path("level.ply"));
    target_clear(is_there ? "level.ply" : NULL);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size > 1u << 20)
        return 0;
    /* The bytes choose the level too, so that one input is one case. */
    uint32_t choice = 0;
    for (size_t i = 0; i < size; i++)
        choice = choice * 31 + data[i];
    struct target target = {.kind = choice & 4 ? TARGET_ERROR : TARGET_FACES,
                            .count = 1,
                            .values = {choice & 4 ? 0.1 : (double)(choice >> 8 & 63)},
                            .error_is_relative = true,
                            .mode = choice & 1 ? MODE_CLASSIC : MODE_COLLAPSE,
                            .effort = 1 + (choice >> 4) % 3};
    if (target.values[0] < 0.1)
        target.values[0] = 1;
    struct byte_file file = byte_file_open(data, size);
    bool is_sound = check_and_read(file.path);
    make_level(file.path, is_sound, &target, choice & 2 ? PLACE_SUBSET : PLACE_DEFAULT);
    byte_file_close(&file);
    return 0;
}

void target_seeds(const struct seed_taker *taker)
{
    static const unsigned slab_shifts[] = {0, 3, 5};
    for (unsigned which = 0; which < TARGET_SHAPES; which++)
        for (unsigned i = 0; i < 6; i++) {
            struct shape shape = target_shape(which);
            size_t size;
            unsigned char *ply = shape_encode(&shape, SHAPE_PLY_LITTLE, &size);
            struct byte_file file = byte_file_open(ply, size);
            const char *path = file.path;
            struct context ctx;
            target_context(&ctx);
            struct import_options import = {.slab_shift = slab_shifts[i / 2]};
            struct target target = {.kind = TARGET_FACES,
                                    .count = 1,
                                    .values = {20},
                                    .mode = i % 2 ? MODE_CLASSIC : MODE_COLLAPSE,
                                    .effort = 2};
            struct patch_request request = {.patch_angle = {-1, -1},
                                            .face_angle = {-1, -1},
                                            .smoothings = -1,
                                            .chain_tolerance = -1,
                                            .level = i == 2 ? 6 : 0};
            const char *store = test_path("store"), *chains = test_path("chains");
            require(store_build(&ctx, &path, 1, store, &import, NULL) == STATUS_OK,
                    "a seed can be imported");
            require(chain_build(&ctx, store, chains, &target, &request, NULL) == STATUS_OK,
                    "a seed can be patchified");
            if (i == 4) { /* with the section from which levels begin */
                const struct lod_options lod = {.target = target,
                                                .output = target_path("level.ply"),
                                                .export = {.format = EXPORT_PLY},
                                                .keeps_trunk = true};
                struct lod_report report;
                const enum status made = lod_build(&ctx, chains, &lod, &report);
                require(made == STATUS_OK || made == STATUS_TARGET_MISSED,
                        "a seed gives its level");
                target_clear("level.ply");
            }
            unsigned char *bytes = file_read(chains, &size);
            require(bytes != NULL, "a seed can be read");
            taker->take(taker->user, bytes, size);
            free(bytes);
            context_clear(&ctx);
            byte_file_close(&file);
            free(ply);
            shape_free(&shape);
        }
}
