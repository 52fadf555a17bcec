/*
 * Damaged mesh files: bytes changed, taken out, doubled and cut off at random, numbers replaced by
 * extreme ones. A reader either reads or refuses in one line of words; it never crashes, never asks
 * for memory that the file's size does not justify, and never hands on what import.h rules out (the
 * collecting sink checks that).
 */
#include "mesh/import.h"
#include "test_collect.h"
#include "test_kit.h"
#include "test_shapes.h"

#include <stdlib.h>
#include <string.h>

struct bytes {
    unsigned char *data;
    size_t size;
};

static struct bytes copy_of(const unsigned char *data, size_t size)
{
    /* Room for what the changes add. */
    struct bytes copy = {malloc(2 * size + 1024), size};
    assert_non_null(copy.data);
    memcpy(copy.data, data, size);
    return copy;
}

static void insert(struct bytes *bytes, size_t at, const void *what, size_t size)
{
    memmove(bytes->data + at + size, bytes->data + at, bytes->size - at);
    memcpy(bytes->data + at, what, size);
    bytes->size += size;
}

static void change(struct bytes *bytes, uint64_t *seed)
{
    static const char *const words[] = {"-1",
                                        "4294967295",
                                        "99999999999999999999",
                                        "nan",
                                        "1e999",
                                        "0",
                                        "\n",
                                        " ",
                                        "#",
                                        "/",
                                        "\\\n",
                                        "element ",
                                        "list ",
                                        "\r",
                                        "-",
                                        ".",
                                        "e",
                                        "ply\n",
                                        "end_header\n",
                                        "vertex "};
    if (bytes->size < 2)
        return;
    size_t at = random_below(seed, bytes->size);
    switch (random_below(seed, 6)) {
    case 0:
        bytes->data[at] = (unsigned char)random_next(seed);
        break;
    case 1:
        bytes->data[at] ^= (unsigned char)(1u << random_below(seed, 8));
        break;
    case 2: {
        const char *word = words[random_below(seed, sizeof words / sizeof *words)];
        insert(bytes, at, word, strlen(word));
        break;
    }
    case 3: { /* some bytes are missing */
        size_t size = random_below(seed, bytes->size - at < 20 ? bytes->size - at : 20);
        memmove(bytes->data + at, bytes->data + at + size, bytes->size - at - size);
        bytes->size -= size;
        break;
    }
    case 4: { /* or there twice */
        unsigned char twice[20];
        size_t size = random_below(seed, bytes->size - at < 20 ? bytes->size - at : 20);
        memcpy(twice, bytes->data + at, size);
        insert(bytes, at, twice, size);
        break;
    }
    default:
        if (random_below(seed, 8) == 0)
            bytes->size = at;
        else
            memset(bytes->data + at, random_below(seed, 2) ? 0xff : 0,
                   bytes->size - at < 4 ? 1 : 4);
    }
}

static void try(import_function reader, const struct bytes *bytes)
{
    struct collected collected = collect(reader, bytes->data, bytes->size, FEED_FILE);
    if (collected.status == STATUS_OK)
        collected_free(&collected);
    else
        assert_refused(collected, NULL);
}

static void damaged_files_are_read_or_refused(void **state)
{
    (void)state;
    static const import_function readers[] = {import_ply, import_ply, import_ply, import_obj,
                                              import_off, import_stl, import_stl};
    struct shape shape = shape_cube_quads();
    uint64_t seed = 11;
    for (int format = SHAPE_PLY_ASCII; format <= SHAPE_STL_ASCII; format++) {
        size_t size;
        unsigned char *data = shape_encode(&shape, (enum shape_format)format, &size);
        for (unsigned round = 0; round < 600; round++) {
            struct bytes bytes = copy_of(data, size);
            for (uint64_t changes = 1 + random_below(&seed, 4); changes > 0; changes--)
                change(&bytes, &seed);
            try(round % 4 ? readers[format] : import_read, &bytes);
            free(bytes.data);
        }
        free(data);
    }
    shape_free(&shape);
}

/* A header with everything in it, so that its parser and the slow row reader get their share. */
static void damaged_ply_headers_are_read_or_refused(void **state)
{
    (void)state;
    static const char text[] =
        "ply\nformat ascii 1.0\ncomment c\nobj_info o\nelement first 2\n"
        "property list uchar short a\nelement vertex 3\nproperty uchar red\nproperty double z\n"
        "property list ushort float w\nproperty short x\nproperty float y\nelement face 1\n"
        "property list ushort uchar vertex_indices\nproperty list char int e\nelement tristrips 1\n"
        "property list int int vertex_indices\nend_header\n2 1 2\n0\n1 2 1 5 3 4\n7 8 0 9 10\n"
        "1 2 0 3 4\n3 0 1 2 1 9\n5 0 1 2 -1 0\n";
    uint64_t seed = 12;
    for (unsigned round = 0; round < 3000; round++) {
        struct bytes bytes = copy_of((const unsigned char *)text, sizeof text - 1);
        if (round % 3) { /* as binary, the rows are noise */
            const char *format = round % 3 == 1 ? "binary_little_endian" : "binary_big_endian";
            size_t at = strlen("ply\nformat ");
            memmove(bytes.data + at, bytes.data + at + 5, bytes.size - at - 5);
            bytes.size -= 5;
            insert(&bytes, at, format, strlen(format));
        }
        for (uint64_t changes = 1 + random_below(&seed, 4); changes > 0; changes--)
            change(&bytes, &seed);
        try(import_ply, &bytes);
        free(bytes.data);
    }
}

static void noise_behind_any_beginning_is_refused_or_read(void **state)
{
    (void)state;
    static const char *const beginnings[] = {
        "",
        "OFF\n3 1 0\n",
        "COFF 2 2\n",
        "v ",
        "f ",
        "solid a\nfacet ",
        "solid",
        "ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\n"
        "property double y\nproperty short z\nelement face 9\nproperty list uchar int "
        "vertex_indices\nend_header\n",
        "ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty float x\n"
        "property float y\nproperty float z\nelement face 4000000000\nproperty list uint uchar "
        "vertex_index\nend_header\n"};
    static const import_function readers[] = {import_read, import_ply, import_obj, import_stl,
                                              import_off};
    uint64_t seed = 13;
    unsigned char data[4096];
    for (unsigned round = 0; round < 3000; round++) {
        const char *beginning = beginnings[round % (sizeof beginnings / sizeof *beginnings)];
        struct bytes bytes = {data, strlen(beginning) + random_below(&seed, 3000)};
        memcpy(data, beginning, strlen(beginning));
        for (size_t i = strlen(beginning); i < bytes.size; i++) /* all bytes, or those of numbers */
            data[i] = round % 2 ? (unsigned char)random_next(&seed)
                                : (unsigned char)"0123456789 \n-.e"[random_below(&seed, 15)];
        try(readers[random_below(&seed, 5)], &bytes);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(damaged_files_are_read_or_refused),
        cmocka_unit_test(damaged_ply_headers_are_read_or_refused),
        cmocka_unit_test(noise_behind_any_beginning_is_refused_or_read),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
