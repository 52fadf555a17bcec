/*
 * The sections of a chain file from which levels begin: levels are the same with and without them,
 * they change nothing else in the file, every changed byte is found, and forged contents, checksums
 * and all, are refused in words.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/block_stream.h"
#include "base/bytes.h"
#include "base/memory.h"
#include "simplify/chain_frame.h"
#include "simplify/chain_trunk.h"
#include "simplify/simplify.h"
#include "test_alike.h"
#include "test_chains.h"
#include "test_files.h"
#include "test_kit.h"
#include "test_shapes.h"

#define must(call) assert_int_equal((call), STATUS_OK)

static char plain[256], kept[256], output[2][256];

/* A torus in a few slabs, of which a chain file is made for 600 and 200 faces; one copy of it gets
 * a trunk, both its states. */
static int set_up(void **unused)
{
    (void)unused;
    struct context ctx;
    struct mesh mesh;
    struct slab_set slabs;
    struct chain_set set;
    struct shape shape = shape_noisy_torus(60, 30, 0.02, 5);
    const struct patch_options options = test_patch_options(9, 8, 1);
    snprintf(plain, sizeof plain, "%s", test_path("plain.chains"));
    snprintf(kept, sizeof kept, "%s", test_path("kept.chains"));
    snprintf(output[0], sizeof output[0], "%s", test_path("plain-%d.ply"));
    snprintf(output[1], sizeof output[1], "%s", test_path("kept-%d.ply"));
    context_init(&ctx);
    shape_into_mesh(&ctx, &shape, &mesh);
    slab_set_build(&mesh, 700, &slabs);
    chain_set_build(&ctx, &slabs, &options, &set);
    set.info.effort = 2;
    set.info.target_count = 2;
    set.info.targets[0] = 600;
    set.info.targets[1] = 200;
    chain_set_write(&set, plain, 1);
    chain_set_write(&set, kept, 1);
    chain_set_free(&set);
    slab_set_free(&slabs);
    mesh_clear(&ctx, &mesh);
    struct lod_report report;
    const struct lod_options lod = {.target = {.count = 2, .values = {600, 200}, .effort = 2},
                                    .output = test_path("first-%d.ply"),
                                    .keeps_trunk = true};
    const enum status status = lod_build(&ctx, kept, &lod, &report);
    context_clear(&ctx);
    return status != STATUS_OK;
}

static void read_trunk(struct context *ctx, const char *path, bool is_lower, struct trunk *trunk)
{
    struct chain_file *file;
    must(chain_file_open(ctx, path, &file));
    must(chain_trunk_read(file, is_lower, trunk));
    chain_file_close(&file);
}

/* The file without its trunk is the plain one, but for the frame. */
static void the_rest_is_as_it_was(void **unused)
{
    (void)unused;
    struct context ctx;
    struct section_reader readers[2];
    struct trunk trunk;
    context_init(&ctx);
    must(section_file_open(&ctx, plain, CHAIN_MAGIC, CHAIN_VERSION, "it", &readers[0]));
    must(section_file_open(&ctx, kept, CHAIN_MAGIC, CHAIN_VERSION, "it", &readers[1]));
    assert_int_equal(readers[0].count, 4);
    assert_int_equal(readers[1].count, 6);
    for (unsigned i = 0; i < 4; i++)
        assert_memory_equal(&readers[0].table[i], &readers[1].table[i], sizeof(struct section));
    section_file_close(&readers[0]);
    section_file_close(&readers[1]);
    must(chain_file_check(&ctx, kept));
    for (int i = 0; i < 2; i++) {
        read_trunk(&ctx, plain, i == 1, &trunk);
        assert_int_equal(trunk.finest, 0);
        read_trunk(&ctx, kept, i == 1, &trunk);
        assert_int_equal(trunk.finest, 600);
        assert_true(i == 1 ? trunk.state.face_count <= 200 : trunk.state.face_count > 600);
        chain_trunk_clear(&ctx, 0, &trunk);
    }
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

/* Whatever is asked for: the trunk's levels, others, or those that have no use for it. */
static void levels_are_the_same(void **unused)
{
    (void)unused;
    const struct target targets[] = {
        {.count = 5, .values = {600, 500, 200, 90, 30}, .effort = 2},
        {.count = 3, .values = {150, 100, 20}, .effort = 2},
        {.count = 2, .values = {100, 60}, .effort = 2},   /* of the lower state alone */
        {.count = 2, .values = {1100, 300}, .effort = 2}, /* finer than what it was made for */
        {.count = 2, .values = {600, 100}, .effort = 1},
        {.count = 2, .values = {600, 100}, .effort = 3},
        {.count = 2, .values = {600, 100}, .effort = 2, .error_bound = 0.1},
        {.count = 1, .values = {0.05}, .kind = TARGET_ERROR, .effort = 2},
    };
    for (unsigned i = 0; i < 2 * sizeof targets / sizeof *targets; i++) {
        struct lod_report reports[2];
        struct context ctx;
        context_init(&ctx);
        for (unsigned j = 0; j < 2; j++) {
            const struct lod_options lod = {.target = targets[i / 2],
                                            .place = i % 2 ? PLACE_SUBSET : PLACE_OPTIMAL,
                                            .output = output[j]};
            ctx.threads = 1 + j;
            const enum status status = lod_build(&ctx, j ? kept : plain, &lod, &reports[j]);
            assert_true(status == STATUS_OK || status == STATUS_TARGET_MISSED);
        }
        assert_int_equal(reports[0].small_faces, reports[1].small_faces);
        for (unsigned level = 0; level < reports[0].level_count; level++) {
            char name[2][32];
            for (unsigned j = 0; j < 2; j++) {
                const char *what = j ? "kept" : "plain";
                if (reports[0].level_count > 1)
                    snprintf(name[j], sizeof name[j], "%s-%u.ply", what, level);
                else
                    snprintf(name[j], sizeof name[j], "%s-0.ply", what);
            }
            assert_true(reports[0].levels[level].error == reports[1].levels[level].error);
            files_must_be_alike(test_path(name[0]), test_path(name[1]));
        }
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
}

static void make_keeping(const char *path, const struct target *target)
{
    struct context ctx;
    struct lod_report report;
    const struct lod_options lod = {
        .target = *target, .output = test_path("later-%d.ply"), .keeps_trunk = true};
    context_init(&ctx);
    must(lod_build(&ctx, path, &lod, &report));
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

/* A level at which the trunk does not come so far keeps the upper state alone; another one adds the
 * lower one, and a third nothing. Of another effort both are others. */
static void the_lower_state_may_come_later(void **unused)
{
    (void)unused;
    char path[256];
    const struct target finest = {.count = 1, .values = {600}, .effort = 2};
    const struct target coarse = {.count = 1, .values = {150}, .effort = 2};
    const struct target other = {.count = 1, .values = {150}, .effort = 1};
    struct trunk trunk;
    struct context ctx;
    size_t size;
    snprintf(path, sizeof path, "%s", test_path("later.chains"));
    unsigned char *bytes = file_read(plain, &size);
    file_write(path, bytes, size);
    free(bytes);
    context_init(&ctx);
    make_keeping(path, &finest);
    read_trunk(&ctx, path, true, &trunk);
    assert_int_equal(trunk.finest, 0);
    make_keeping(path, &coarse);
    files_must_be_alike(path, kept);
    make_keeping(path, &coarse);
    files_must_be_alike(path, kept);
    make_keeping(path, &other);
    must(chain_file_check(&ctx, path));
    for (int i = 0; i < 2; i++) {
        read_trunk(&ctx, path, i == 1, &trunk);
        assert_int_equal(trunk.effort, 1);
        chain_trunk_clear(&ctx, 0, &trunk);
    }
    make_keeping(path, &finest);
    read_trunk(&ctx, path, true, &trunk);
    assert_int_equal(trunk.finest, 0);
    context_clear(&ctx);
}

/* ---- damage and forgery ---- */

static const uint32_t kinds[2] = {CHAIN_SECTION_TRUNK, CHAIN_SECTION_LOWER};

/* Makes a level that begins with the upper or the lower state. */
static enum status read_and_use(const char *path, int lower, char error[512])
{
    struct context ctx;
    struct lod_report report;
    context_init(&ctx);
    const struct lod_options lod = {
        .target = {.count = 1, .values = {lower ? 100 : 600}, .effort = 2},
        .output = test_path("damaged.ply")};
    const enum status status = lod_build(&ctx, path, &lod, &report);
    snprintf(error, 512, "%.500s", ctx.error);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return status;
}

static void every_changed_byte_is_found(void **unused)
{
    (void)unused;
    char error[512], path[256];
    struct context ctx;
    struct section_reader reader;
    size_t size;
    snprintf(path, sizeof path, "%s", test_path("changed.chains"));
    unsigned char *bytes = file_read(kept, &size);
    context_init(&ctx);
    must(section_file_open(&ctx, kept, CHAIN_MAGIC, CHAIN_VERSION, "it", &reader));
    const struct section sections[2] = {*section_find(&reader, kinds[0]),
                                        *section_find(&reader, kinds[1])};
    section_file_close(&reader);
    context_clear(&ctx);
    for (int i = 0; i < 2; i++)
        for (uint64_t at = 0; at < sections[i].length; at += at < BLOCK_HEADER_SIZE ? 1 : 211) {
            bytes[sections[i].offset + at] ^= 0x10;
            file_write(path, bytes, size);
            assert_int_equal(read_and_use(path, i, error), STATUS_BAD_INPUT);
            assert_non_null(strstr(error, i ? "LOWR" : "TRNK"));
            bytes[sections[i].offset + at] ^= 0x10;
        }
    free(bytes);
}

/* The plain file with these bytes, rightly summed, as its upper or lower state. */
static void write_forged(const char *path, int lower, const unsigned char *raw, size_t raw_size)
{
    struct context ctx;
    struct section_reader reader;
    struct section_writer writer;
    unsigned char *bytes, *packed;
    size_t size;
    context_init(&ctx);
    must(section_file_open(&ctx, plain, CHAIN_MAGIC, CHAIN_VERSION, "it", &reader));
    must(section_file_create(&ctx, path, CHAIN_MAGIC, CHAIN_VERSION, &writer));
    for (unsigned i = 0; i < reader.count; i++) {
        must(section_load(&reader, &reader.table[i], UINT64_MAX, &bytes));
        must(section_begin(&writer, reader.table[i].kind));
        must(section_append(&writer, bytes, reader.table[i].length));
        must(section_end(&writer));
        memory_release(&ctx, &bytes, reader.table[i].length, 1);
    }
    must(block_pack(&ctx, raw, raw_size, 0, &packed, &size));
    must(section_begin(&writer, kinds[lower]));
    must(section_append(&writer, packed, size));
    must(section_end(&writer));
    must(section_file_finish(&writer, false));
    memory_release(&ctx, &packed, size, 1);
    section_file_close(&reader);
    context_clear(&ctx);
}

static unsigned char *raw_trunk(int lower, size_t *size)
{
    struct context ctx, *its;
    struct chain_file *file;
    unsigned char *raw, *copy;
    context_init(&ctx);
    must(chain_file_open(&ctx, kept, &file));
    must(chain_file_trunk_bytes(file, kinds[lower], "it", &its, &raw, size));
    copy = malloc(*size);
    assert_non_null(copy);
    memcpy(copy, raw, *size);
    memory_release(&ctx, &raw, *size, 1);
    chain_file_close(&file);
    context_clear(&ctx);
    return copy;
}

static void forged_fields_are_told(void **unused)
{
    (void)unused;
    static const struct {
        unsigned at, size;
        uint64_t value;
        const char *words;
    } fields[] = {
        {0, 4, 2, "not made for anything"},
        {4, 4, 0, "not made for anything"},
        {4, 4, 4, "not made for anything"},
        {8, 8, 0, "not made for anything"},
        {16, 8, 1ull << 32, "a count"},
        {24, 8, 0x7ff0000000000000, "an error"},
        {24, 8, 0xbff0000000000000, "an error"},
        {32, 8, 1 << 30, "a count"},
        {32, 8, 1 << 20, "does not fit"},
        {40, 8, 1ull << 40, "a count"},
        {40, 8, 3, "left over"},
        {48, 8, 0, "a count"},
        {48, 8, 1ull << 32, "a count"},
        {56, 8, 0x3ff8000000000000, "scale"},
        {56, 8, 0, "scale"},
        {56, 8, 0x0010000000000000, "not finite"},
        {64, 8, 0x7fe0000000000000, "scale"},
        {72, 8, 0x7ff8000000000000, "an error"},
        {80, 8, 0x7fe0000000000000, "an error"},
        {88, 8, 0xbff0000000000000, "an error"},
        {96, 8, UINT64_MAX, "a count"},
        {104, 8, UINT64_MAX, "a count"},
        {112, 4, 3, "not made for anything"},
        {116, 4, 2, "not made for anything"},
    };
    char error[512], path[256];
    snprintf(path, sizeof path, "%s", test_path("forged.chains"));
    for (int lower = 0; lower < 2; lower++) {
        size_t size;
        unsigned char *raw = raw_trunk(lower, &size), was[8];
        write_forged(path, lower, raw, size);
        assert_int_equal(read_and_use(path, lower, error), STATUS_OK);
        for (unsigned i = 0; i < sizeof fields / sizeof *fields; i++) {
            memcpy(was, raw + fields[i].at, sizeof was);
            if (fields[i].size == 8)
                store_u64(raw + fields[i].at, fields[i].value);
            else
                store_u32(raw + fields[i].at, (uint32_t)fields[i].value);
            write_forged(path, lower, raw, size);
            if (read_and_use(path, lower, error) != STATUS_BAD_INPUT ||
                !strstr(error, fields[i].words) || !strstr(error, lower ? "LOWR" : "TRNK"))
                fail_msg("field at %u, case %u: \"%s\"", fields[i].at, i, error);
            memcpy(raw + fields[i].at, was, sizeof was);
        }
        for (size_t cut = 1; cut < size; cut += 1 + size / 97) {
            write_forged(path, lower, raw, size - cut);
            assert_int_equal(read_and_use(path, lower, error), STATUS_BAD_INPUT);
        }
        free(raw);
    }
}

/* Faces that are no manifold, or of another topology, by changes of their bytes: refused, or a
 * manifold; what passes the check has the file's topology. */
static void forged_faces_do_no_harm(void **unused)
{
    (void)unused;
    char error[512], path[256];
    snprintf(path, sizeof path, "%s", test_path("forged.chains"));
    for (int lower = 0; lower < 2; lower++) {
        size_t size;
        unsigned char *raw = raw_trunk(lower, &size);
        const size_t vertices = (size_t)load_u64(raw + 32), faces = 120 + 20 * vertices;
        unsigned refused = 0;
        for (size_t at = faces; at < size; at += 1 + (size - faces) / 61) {
            raw[at] ^= 2;
            write_forged(path, lower, raw, size);
            const enum status status = read_and_use(path, lower, error);
            assert_true(status == STATUS_OK || status == STATUS_TARGET_MISSED ||
                        status == STATUS_BAD_INPUT);
            refused += status == STATUS_BAD_INPUT;
            raw[at] ^= 2;
        }
        assert_true(refused > 50);
        free(raw);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_rest_is_as_it_was),
        cmocka_unit_test(levels_are_the_same),
        cmocka_unit_test(the_lower_state_may_come_later),
        cmocka_unit_test(every_changed_byte_is_found),
        cmocka_unit_test(forged_fields_are_told),
        cmocka_unit_test(forged_faces_do_no_harm),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
