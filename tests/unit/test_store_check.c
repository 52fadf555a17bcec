/*
 * Damaged stores: any single flipped bit and any truncation is found; a store that lies with right
 * checksums is refused with what is wrong, and never leads a reader out of bounds.
 */
#include "test_files.h"
#include "test_kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/checksum.h"
#include "mesh/store.h"
#include "mesh/store_layout.h"
#include "test_shapes.h"

struct file {
    unsigned char *bytes;
    size_t size;
};

/* A small store with several slabs, a border and attributes of 3 bytes. */
static struct file make_store(void)
{
    static const char head[] =
        "ply\nformat ascii 1.0\nelement vertex 30\nproperty float x\nproperty "
        "float y\nproperty float z\nproperty short tag\nproperty uchar "
        "red\nelement face 40\nproperty list uchar int "
        "vertex_indices\nend_header\n";
    char text[4096];
    size_t used = (size_t)sprintf(text, "%s", head);
    for (int v = 0; v < 30; v++)
        used +=
            (size_t)sprintf(text + used, "%d %d %d %d %d\n", v % 6, v / 6, v * v % 5, 1000 + v, v);
    for (int y = 0; y < 4; y++) {
        for (int x = 0; x < 5; x++) {
            int v = 6 * y + x;
            used += (size_t)sprintf(text + used, "3 %d %d %d\n3 %d %d %d\n", v, v + 1, v + 7, v,
                                    v + 7, v + 6);
        }
    }
    const char *input = test_path("in.ply"), *output = test_path("good.store");
    file_write(input, text, used);
    struct context ctx;
    context_init(&ctx);
    struct import_options options = {.slab_shift = 4};
    assert_int_equal(store_build(&ctx, &input, 1, output, &options, NULL), STATUS_OK);
    assert_int_equal(store_check(&ctx, output), STATUS_OK);
    context_clear(&ctx);
    struct file file;
    file.bytes = file_read(output, &file.size);
    return file;
}

/* A new file each time: to rewrite one in place makes some file systems wait for the disk. */
static const char *bad_path(const unsigned char *bytes, size_t size)
{
    const char *path = test_path("bad.store");
    remove(path);
    file_write(path, bytes, size);
    return path;
}

static enum status check_bytes(const unsigned char *bytes, size_t size, char error[1024])
{
    const char *path = bad_path(bytes, size);
    struct context ctx;
    context_init(&ctx);
    enum status status = store_check(&ctx, path);
    assert_int_equal(ctx.memory_now, 0);
    strcpy(error, ctx.error);
    context_clear(&ctx);
    return status;
}

/* Everything a reader may do, without checksums: must not crash, whatever the bytes. */
static void use_store(const unsigned char *bytes, size_t size)
{
    const char *path = bad_path(bytes, size);
    struct context ctx;
    context_init(&ctx);
    struct store *store;
    if (store_open(&ctx, path, false, &store) == STATUS_OK) {
        double sum = 0;
        for (uint32_t i = 0; i < store_info(store)->slab_count; i++) {
            struct slab slab;
            if (slab_open(store, i, &slab) != STATUS_OK)
                continue;
            for (size_t c = 0; c < 3 * (size_t)slab.face_count; c++)
                sum += (double)slab_position(&slab, slab.faces[c])[0];
            slab_close(&slab);
        }
        struct mesh mesh;
        if (store_load(store, &mesh) == STATUS_OK) {
            for (size_t c = 0; c < 3 * mesh.face_count; c++)
                sum += mesh.positions[3 * (size_t)mesh.faces[c]];
            mesh_clear(&ctx, &mesh);
        }
        assert_true(sum == sum);
        store_close(&store);
    }
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void any_flipped_bit_is_found(void **state)
{
    (void)state;
    struct file file = make_store();
    char error[1024];
    for (size_t i = 0; i < 8 * file.size; i++) {
        file.bytes[i / 8] ^= (unsigned char)(1u << i % 8);
        if (check_bytes(file.bytes, file.size, error) != STATUS_BAD_INPUT)
            fail_msg("bit %zu of byte %zu may be flipped", i % 8, i / 8);
        assert_true(strlen(error) > 10);
        if (i % 8 == i / 8 % 8)
            use_store(file.bytes, file.size);
        file.bytes[i / 8] ^= (unsigned char)(1u << i % 8);
    }
    assert_int_equal(check_bytes(file.bytes, file.size, error), STATUS_OK);
    free(file.bytes);
}

static void any_truncation_is_found(void **state)
{
    (void)state;
    struct file file = make_store();
    char error[1024];
    for (size_t size = 0; size < file.size; size++) {
        assert_int_equal(check_bytes(file.bytes, size, error), STATUS_BAD_INPUT);
        use_store(file.bytes, size);
    }
    free(file.bytes);
}

/* ---- lies with right checksums ---- */

static size_t section_at(const struct file *file, uint32_t kind, size_t *entry)
{
    size_t table = (size_t)load_u64(file->bytes + file->size - 32);
    for (*entry = table; *entry < file->size - 32; *entry += 24) {
        if (load_u32(file->bytes + *entry) == kind)
            return (size_t)load_u64(file->bytes + *entry + 8);
    }
    fail_msg("no such section");
    return 0;
}

/* Makes all checksums right again. */
static void sign(struct file *file)
{
    size_t entry, slabs = section_at(file, STORE_KIND_SLABS, &entry);
    size_t table = section_at(file, STORE_KIND_TABLE, &entry);
    uint64_t table_size = load_u64(file->bytes + entry + 16);
    for (size_t at = table; at < table + table_size; at += 32) {
        uint64_t offset = load_u64(file->bytes + at);
        struct slab_entry slab;
        struct slab_layout layout;
        slab_entry_decode(file->bytes + at, &slab);
        slab_layout_find(&slab, 3, &layout);
        if (offset < file->size && layout.size < file->size - slabs - offset)
            store_u32(file->bytes + at + 24,
                      checksum(0, file->bytes + slabs + offset, (size_t)layout.size));
    }
    static const uint32_t kinds[] = {STORE_KIND_SLABS, STORE_KIND_TABLE, STORE_KIND_ATTRIBUTES,
                                     STORE_KIND_INFO};
    for (size_t i = 0; i < 4; i++) {
        size_t at = section_at(file, kinds[i], &entry);
        store_u32(file->bytes + entry + 4,
                  checksum(0, file->bytes + at, (size_t)load_u64(file->bytes + entry + 16)));
    }
    unsigned char *end = file->bytes + file->size - 32;
    store_u32(end + 12, 0);
    uint32_t crc = checksum(0, file->bytes, 32);
    size_t frame = (size_t)load_u64(end);
    store_u32(end + 12, checksum(crc, file->bytes + frame, file->size - frame));
}

static struct file copy_of(const struct file *file)
{
    struct file copy = {malloc(file->size), file->size};
    assert_non_null(copy.bytes);
    memcpy(copy.bytes, file->bytes, file->size);
    return copy;
}

static void lie(const struct file *good, uint32_t kind, size_t at, size_t size, uint64_t value,
                const char *words)
{
    struct file bad = copy_of(good);
    char error[1024];
    size_t entry, base = section_at(&bad, kind, &entry);
    for (size_t i = 0; i < size; i++)
        bad.bytes[base + at + i] = (unsigned char)(value >> 8 * i);
    sign(&bad);
    enum status status = check_bytes(bad.bytes, bad.size, error);
    if (status != STATUS_BAD_INPUT || !strstr(error, words))
        fail_msg("%zu bytes at %zu: status %d, '%s' is not in '%s'", size, at, status, words,
                 error);
    use_store(bad.bytes, bad.size);
    free(bad.bytes);
}

static void each_field_is_believed_only_when_it_fits(void **state)
{
    (void)state;
    struct file good = make_store();
    struct file same = copy_of(&good);
    char error[1024];
    sign(&same);
    assert_memory_equal(same.bytes, good.bytes, good.size);
    assert_int_equal(check_bytes(same.bytes, same.size, error), STATUS_OK);
    free(same.bytes);

    const uint32_t info = STORE_KIND_INFO, table = STORE_KIND_TABLE;
    const uint32_t attributes = STORE_KIND_ATTRIBUTES, slabs = STORE_KIND_SLABS;
    lie(&good, info, 0, 4, 1, "slab size");
    lie(&good, info, 0, 4, 19, "slab size");
    lie(&good, info, 0, 4, 5, "number of slabs");
    lie(&good, info, 4, 4, 4, "number of slabs");
    lie(&good, info, 4, 4, 0xffffffff, "number of slabs");
    lie(&good, info, 8, 4, 4, "flags");
    lie(&good, info, 24, 8, 31, "topology contradicts");
    lie(&good, info, 24, 8, UINT64_MAX, "impossible");
    lie(&good, info, 32, 8, 69 + (UINT64_C(1) << 63), "topology contradicts"); /* twice it is 138 */
    lie(&good, info, 40, 8, 0, "impossible");
    lie(&good, info, 40, 8, UINT64_MAX, "impossible");
    lie(&good, info, 48, 8, 20, "topology contradicts");
    lie(&good, info, 56, 8, 2, "topology is not");
    lie(&good, info, 64, 8, 2, "topology is not");
    lie(&good, info, 72, 8, 2, "topology contradicts");
    lie(&good, info, 80, 8, 2, "topology is not");
    lie(&good, info, 192, 8, 1, "measures");
    lie(&good, info, 208 + 6, 2, 0x7ff0, "bounding box");
    lie(&good, info, 208 + 6, 2, 0x3ff0, "origin");
    lie(&good, info, 232 + 6, 2, 0xfff0, "bounding box");
    lie(&good, info, 232 + 6, 2, 0xbff0, "bounding box");
    lie(&good, info, 280 + 6, 2, 0x7ff8, "measure");
    lie(&good, info, 280, 1, 1, "measures");
    lie(&good, info, 304 + 200, 1, 'x', "behind the input's name");
    lie(&good, table, 0, 8, 64, "out of place");
    lie(&good, table, 32, 8, UINT64_MAX - 63, "out of place");
    lie(&good, table, 8, 4, 1, "out of order");
    lie(&good, table, 12, 4, 0xffffffff, "more vertices");
    lie(&good, table, 12, 4, 1, "");
    lie(&good, table, 16, 4, 1, "foreign vertices");
    lie(&good, table, 48, 4, 40, "more vertices");
    lie(&good, table, 20, 4, 15, "number of faces");
    lie(&good, table, 28, 4, 1, "not zero");
    lie(&good, attributes, 0, 4, 3, "size");
    lie(&good, attributes, 0, 4, 65, "too many");
    lie(&good, attributes, 4, 4, 4, "stride");
    lie(&good, attributes, 8, 1, 0, "no name");
    lie(&good, attributes, 8 + 63, 1, 'x', "attribute");
    lie(&good, attributes, 8 + 64, 4, 8, "unknown type");
    lie(&good, attributes, 8 + 68, 4, 1, "out of place");

    struct slab_entry entry = {.vertex_count = 0};
    size_t unused, at = section_at(&good, table, &unused);
    struct slab_layout layout;
    slab_entry_decode(good.bytes + at, &entry);
    slab_layout_find(&entry, 3, &layout);
    lie(&good, slabs, 0, 4, 29, "does not have");
    lie(&good, slabs, 0, 4, 0xffffffff, "does not have");
    lie(&good, slabs, 0, 4, 2, "");
    lie(&good, slabs, 4, 4, 2, "first use");
    lie(&good, slabs, 16, 4, 0, "twice");
    lie(&good, slabs, layout.neighbours, 4, 40, "neighbour");
    lie(&good, slabs, layout.neighbours, 4, 5, "");
    lie(&good, slabs, layout.mates, 1, 0xc0, "bits that are not zero");
    lie(&good, slabs, layout.mates, 1, 0xff, "");
    lie(&good, slabs, layout.positions + 2, 2, 0x7f80, "not finite");
    lie(&good, slabs, layout.positions, 4, 0x3f000000, "measures");
    lie(&good, slabs, layout.mates + 20, 1, 1, "padding");
    const size_t second = (size_t)layout.size;
    slab_entry_decode(good.bytes + at + 32, &entry);
    slab_layout_find(&entry, 3, &layout);
    lie(&good, slabs, second + layout.foreign, 4, 0xffffffff, "foreign");
    lie(&good, slabs, second + layout.foreign, 4, 29, "foreign");
    lie(&good, slabs, second + layout.foreign_positions, 4, 0x40000000, "where its own slab");
    free(good.bytes);
}

static void random_lies_never_crash(void **state)
{
    (void)state;
    struct file good = make_store();
    uint64_t seed = 5;
    for (int round = 0; round < 3000; round++) {
        struct file bad = copy_of(&good);
        char error[1024];
        for (uint64_t i = 0; i < 1 + random_below(&seed, 3); i++) {
            size_t at = 64 + random_below(&seed, bad.size - 64 - 32 - 96);
            bad.bytes[at] = (unsigned char)(random_below(&seed, 2) ? random_next(&seed) : 255);
        }
        sign(&bad);
        (void)check_bytes(bad.bytes, bad.size, error);
        use_store(bad.bytes, bad.size);
        free(bad.bytes);
    }
    free(good.bytes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(any_flipped_bit_is_found),
        cmocka_unit_test(any_truncation_is_found),
        cmocka_unit_test(each_field_is_believed_only_when_it_fits),
        cmocka_unit_test(random_lies_never_crash),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
