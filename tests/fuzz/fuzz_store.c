/*
 * A mesh store of any bytes, with whatever checksums. Opening, reading slab by slab, checking,
 * exporting and patchifying must refuse it or do their work; a store that passes its check is a
 * manifold, and its chain file passes too.
 */
#include "target.h"

#include <stdlib.h>
#include <string.h>

#include "mesh/export.h"
#include "mesh/import.h"
#include "mesh/store.h"
#include "simplify/simplify.h"
#include "test_files.h"
#include "test_shapes.h"

const bool target_keeps_length = true;

static void read_slabs(const char *path)
{
    struct context ctx;
    target_context(&ctx);
    struct store *store = NULL;
    enum status status = store_open(&ctx, path, true, &store);
    uint32_t slabs = status == STATUS_OK ? store_info(store)->slab_count : 0;
    double sum = 0;
    for (uint32_t i = 0; i < slabs && status == STATUS_OK; i++) {
        struct slab slab;
        status = slab_open(store, i, &slab);
        if (status != STATUS_OK)
            break;
        for (uint32_t c = 0; c < 3 * slab.face_count; c++)
            sum += (double)slab_position(&slab, slab.faces[c])[0];
        unsigned char record[ATTRIBUTE_MAX * 8];
        if (slab.face_count > 0 && store_info(store)->attributes.stride > 0)
            status = store_record(store, slab.faces[0], record);
        slab_close(&slab);
    }
    require(status != STATUS_OK || sum == sum || slabs == 0, "positions are numbers");
    store_close(&store);
    target_end(&ctx, status);
}

static bool is_sound(const char *path)
{
    struct context ctx;
    target_context(&ctx);
    enum status status = store_check(&ctx, path);
    target_end(&ctx, status);
    if (status == STATUS_OK)
        require_manifold_store(path);
    return status == STATUS_OK;
}

/* What lies in one slab is manifold or refused, forged or not. */
static void export_it(const char *path)
{
    struct context ctx;
    target_context(&ctx);
    struct store *store = NULL;
    struct export_options options = {.format = EXPORT_PLY};
    enum status status = store_open(&ctx, path, true, &store);
    bool is_one_slab = status == STATUS_OK && store_info(store)->slab_count == 1;
    if (status == STATUS_OK)
        status = store_export(store, target_path("out.ply"), &options);
    store_close(&store);
    target_end(&ctx, status);
    if (status == STATUS_OK && is_one_slab)
        require_manifold_file(target_path("out.ply"));
    target_clear(status == STATUS_OK ? "out.ply" : NULL);
}

static void patchify_it(const char *path, bool must_be_sound, enum lod_mode mode)
{
    struct context ctx;
    target_context(&ctx);
    struct target target = {
        .kind = TARGET_FACES, .count = 1, .values = {10}, .mode = mode, .effort = 2};
    struct patch_request request = {.patch_angle = {-1, -1},
                                    .face_angle = {-1, -1},
                                    .smoothings = -1,
                                    .chain_tolerance = -1,
                                    .level = 0};
    enum status status = chain_build(&ctx, path, target_path("chains"), &target, &request, NULL);
    require_fair_end(&ctx, status);
    require(ctx.memory_now == 0, "all memory is given back");
    require(!must_be_sound || status == STATUS_OK, "a sound store can be patchified");
    context_clear(&ctx);
    if (status == STATUS_OK && must_be_sound) {
        target_context(&ctx);
        require(chain_file_check(&ctx, target_path("chains")) == STATUS_OK,
                "the chain file passes its check");
        context_clear(&ctx);
    }
    target_clear(status == STATUS_OK ? "chains" : NULL);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size > 1u << 20)
        return 0;
    struct byte_file file = byte_file_open(data, size);
    read_slabs(file.path);
    bool sound = is_sound(file.path);
    export_it(file.path);
    patchify_it(file.path, sound, size && data[size / 2] % 2 ? MODE_CLASSIC : MODE_COLLAPSE);
    byte_file_close(&file);
    return 0;
}

void target_seeds(const struct seed_taker *taker)
{
    static const unsigned slab_shifts[] = {0, 2, 3, 5};
    for (unsigned which = 0; which < TARGET_SHAPES; which++)
        for (unsigned i = 0; i < 4; i += 1 + which % 2) {
            struct shape shape = target_shape(which);
            size_t size;
            unsigned char *ply = shape_encode(&shape, SHAPE_PLY_LITTLE, &size);
            struct byte_file file = byte_file_open(ply, size);
            const char *path = file.path;
            struct context ctx;
            target_context(&ctx);
            struct import_options options = {.slab_shift = slab_shifts[i]};
            require(store_build(&ctx, &path, 1, target_path("store"), &options, NULL) == STATUS_OK,
                    "a seed can be imported");
            unsigned char *store = file_read(target_path("store"), &size);
            require(store != NULL, "a seed can be read");
            target_clear("store");
            taker->take(taker->user, store, size);
            free(store);
            context_clear(&ctx);
            byte_file_close(&file);
            free(ply);
            shape_free(&shape);
        }
}
