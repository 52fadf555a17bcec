/*
 * A reader of the chain file that knows the format pages only (read_chains.py) and ours agree on
 * every count and sum.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "simplify/chain_trunk.h"
#include "simplify/simplify.h"
#include "test_chains.h"
#include "test_files.h"
#include "test_kit.h"
#include "test_shapes.h"

#define must(call) assert_int_equal((call), STATUS_OK)

enum { TEXT_MAX = 4096 };

/* What read_chains.py prints, by our own reader. */
static void summarise(const char *path, char text[TEXT_MAX])
{
    struct context ctx;
    context_init(&ctx);
    struct chain_file *file;
    must(chain_file_open(&ctx, path, &file));
    const struct chain_info *info = chain_file_info(file);
    double sums[3] = {0}, area = 0;
    unsigned long long diagonals = 0, record_sum = 0;
    for (uint32_t i = 0; i < info->slab_count; i++) {
        struct chain_block block;
        must(chain_block_read(file, i, &block));
        for (size_t v = 0; v < block.vertex_count; v++)
            for (unsigned c = 0; c < 3; c++)
                sums[c] += block.positions[3 * v + c];
        for (size_t b = 0; b < (size_t)block.vertex_count * info->attributes.stride; b++)
            record_sum += block.records[b];
        for (uint32_t p = 0; p < block.patch_count; p++)
            area += block.patches[p].area;
        diagonals += block.diagonal_count;
        chain_block_clear(&ctx, info->attributes.stride, &block);
    }
    int used = snprintf(
        text, TEXT_MAX,
        "slabs %u\npatches %llu\nchains %llu\nseam_chains %llu\njunctions %llu\n"
        "chain_vertices %llu\nmost_faces %llu\ndiagonals %llu\nattributes",
        info->slab_count, (unsigned long long)info->patches, (unsigned long long)info->chains,
        (unsigned long long)info->seam_chains, (unsigned long long)info->junctions,
        (unsigned long long)info->chain_vertices, (unsigned long long)info->most_faces, diagonals);
    for (uint32_t i = 0; i < info->attributes.count; i++)
        used +=
            snprintf(text + used, (size_t)(TEXT_MAX - used), " %s", info->attributes.list[i].name);
    snprintf(text + used, (size_t)(TEXT_MAX - used),
             "%s\nrecord_sum %llu\nx %.17g\ny %.17g\nz %.17g\narea %.17g\n",
             info->attributes.count ? "" : " -", record_sum, sums[0], sums[1], sums[2], area);
    for (int i = 0; i < 2; i++) {
        struct trunk trunk;
        must(chain_trunk_read(file, i == 1, &trunk));
        const struct collapse_state *state = &trunk.state;
        double sum = 0;
        record_sum = 0;
        for (size_t j = 0; j < 3 * state->vertex_count; j++)
            sum += (double)state->positions[j];
        for (size_t j = 0; j < state->vertex_count * info->attributes.stride; j++)
            record_sum += state->records[j];
        used = (int)strlen(text);
        if (trunk.finest > 0)
            snprintf(text + used, (size_t)(TEXT_MAX - used), "%s %u %llu %llu %llu %llu %.17g\n",
                     i ? "lower" : "trunk", trunk.effort, (unsigned long long)trunk.finest,
                     (unsigned long long)state->vertex_count, (unsigned long long)state->face_count,
                     record_sum, sum);
        chain_trunk_clear(&ctx, info->attributes.stride, &trunk);
    }
    chain_file_close(&file);
    context_clear(&ctx);
}

/* Output of the Python reader; its exit code. */
static int run_reader(const char *path, char text[TEXT_MAX])
{
    const char *source = getenv("SPBM_SOURCE");
    char command[2048];
    snprintf(command, sizeof command, "python3 '%s/tests/format/read_chains.py' '%s' 2>&1",
             source ? source : ".", path);
    FILE *pipe = popen(command, "r");
    assert_non_null(pipe);
    size_t size = fread(text, 1, TEXT_MAX - 1, pipe);
    text[size] = 0;
    return pclose(pipe);
}

/* Returns whether the file has a trunk, both its states. */
static bool readers_must_agree(const char *path)
{
    char ours[TEXT_MAX], theirs[TEXT_MAX];
    summarise(path, ours);
    int code = run_reader(path, theirs);
    if (code)
        print_message("%s\n", theirs);
    assert_int_equal(code, 0);
    assert_string_equal(ours, theirs);
    return strstr(theirs, "\ntrunk ") && strstr(theirs, "\nlower ");
}

static bool agree_on(struct shape shape, uint32_t slab_faces, const struct patch_options *options,
                     uint32_t stride, int level)
{
    struct context ctx;
    context_init(&ctx);
    struct mesh mesh;
    shape_into_mesh(&ctx, &shape, &mesh);
    struct slab_set slabs;
    slab_set_build(&mesh, slab_faces, &slabs);
    struct chain_set set;
    chain_set_build(&ctx, &slabs, options, &set);
    char path[256];
    snprintf(path, sizeof path, "%s", test_path("format.chains"));
    if (stride) {
        set.info.attributes.count = 1;
        set.info.attributes.stride = 1;
        strcpy(set.info.attributes.list[0].name, "intensity");
        set.info.attributes.list[0].type = SCALAR_UINT8;
        for (uint32_t i = 0; i < slabs.slab_count; i++) {
            struct chain_block *block = set.blocks + i;
            must(memory_take(&ctx, block->vertex_count, 1, &block->records));
            for (uint32_t v = 0; v < block->vertex_count; v++)
                block->records[v] = (unsigned char)(100 * block->positions[3 * v] + 100);
        }
    }
    set.info.target_kind = TARGET_RATIO;
    set.info.target_count = 1;
    set.info.targets[0] = 0.3;
    set.info.effort = 1;
    chain_set_write(&set, path, level);
    assert_false(readers_must_agree(path));
    struct lod_report report;
    const struct lod_options lod = {
        .target = {.kind = TARGET_RATIO, .count = 1, .values = {0.2}, .effort = 1},
        .output = test_path("format.ply"),
        .keeps_trunk = true};
    const enum status made = lod_build(&ctx, path, &lod, &report);
    assert_true(made == STATUS_OK || made == STATUS_TARGET_MISSED);
    const bool has_trunk = readers_must_agree(path);
    for (uint32_t i = 0; stride && i < slabs.slab_count; i++)
        memory_release(&ctx, &set.blocks[i].records, set.blocks[i].vertex_count, 1);
    chain_set_free(&set);
    slab_set_free(&slabs);
    mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return has_trunk;
}

static void small_meshes(void **unused)
{
    (void)unused;
    struct patch_options fine = test_patch_options(12, 10, 1), all = test_patch_options(25, 20, 0);
    struct patch_options closed = test_patch_options(180, 180, 0);
    closed.patch_cosine[1] = closed.face_cosine[1] = -1;
    agree_on(shape_single_triangle(), 1 << 18, &fine, 0, 6);
    agree_on(shape_tetrahedron(), 2, &closed, 0, 0);
    agree_on(shape_tetrahedron(), 3, &closed, 0, 0);
    agree_on(shape_noisy_sphere(3, 0.03, 1), 1 << 18, &fine, 0, 6);
    assert_true(agree_on(shape_noisy_sphere(4, 0.03, 2), 512, &fine, 1, 6));
    agree_on(shape_noisy_torus(30, 14, 0.05, 3), 128, &all, 1, 0);
    agree_on(shape_grid_with_holes(24, 24), 256, &closed, 0, 12);
    agree_on(shape_noisy_slab(20, 0.3, 4), 64, &all, 0, 6);
    agree_on(shape_grid(40, 40), 1 << 18, &fine, 0, 6);
    struct shape pieces = shape_grid(2, 2), more = shape_grid(6, 6);
    for (size_t v = 0; v < more.vertex_count; v++)
        more.positions[3 * v + 2] = 5;
    shape_append(&pieces, &more);
    shape_free(&more);
    agree_on(pieces, 16, &closed, 0, 6);
}

static void damage_is_noticed(void **unused)
{
    (void)unused;
    struct context ctx;
    context_init(&ctx);
    const char *path = test_path("damaged.chains");
    file_write(path, "spbmCHN1", 8);
    char text[TEXT_MAX];
    assert_int_not_equal(run_reader(path, text), 0);
    assert_non_null(strstr(text, "too short"));
    context_clear(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(small_meshes),
        cmocka_unit_test(damage_is_noticed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
