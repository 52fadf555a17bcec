/* The STL reader, text and binary. */
#include "base/bytes.h"
#include "mesh/import.h"
#include "test_collect.h"
#include "test_kit.h"
#include "test_shapes.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A binary file of `facets` facets, the header beginning with `words`; to be freed. */
static unsigned char *make_binary(const char *words, uint32_t facets, size_t *size)
{
    *size = 84 + 50 * (size_t)facets;
    unsigned char *data = calloc(*size, 1);
    assert_non_null(data);
    memset(data, ' ', 80);
    memcpy(data, words, strlen(words));
    store_u32(data + 80, facets);
    for (uint32_t f = 0; f < facets; f++)
        for (unsigned i = 0; i < 9; i++)
            store_f32(data + 84 + 50 * (size_t)f + 12 + 4 * i, (float)(f + 0.5 * i));
    return data;
}

static void assert_is_made(struct collected collected, uint32_t facets)
{
    assert_read(&collected);
    assert_true(collected.is_soup);
    assert_true(collected.is_float32);
    assert_int_equal(collected.vertex_count, 3 * facets);
    assert_int_equal(collected.face_count, facets);
    for (uint32_t i = 0; i < 3 * facets; i++)
        assert_int_equal(collected.indices[i], i);
    for (uint32_t i = 0; i < 9 * facets; i++)
        assert_true(collected.positions[i] == i / 9 + 0.5 * (i % 9));
    collected_free(&collected);
}

static void binary_files_are_read(void **state)
{
    (void)state;
    static const uint32_t counts[] = {1, 2, 100, 5000, 60000};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        size_t size;
        unsigned char *data = make_binary("exported", counts[i], &size);
        assert_is_made(collect(import_stl, data, size, FEED_FILE), counts[i]);
        assert_is_made(collect(import_stl, data, size, FEED_PIECES), counts[i]);
        free(data);
    }
}

/* The header may begin like the text form; only the content tells. */
static void solid_in_a_binary_header_is_no_text(void **state)
{
    (void)state;
    static const char *const headers[] = {
        "solid",         "solid part",        "solid a\n",
        "solid a\nb\nc", "solid\xef\xbb\xbf", "\xef\xbb\xbfsolid"};
    for (size_t i = 0; i < sizeof headers / sizeof *headers; i++) {
        size_t size;
        unsigned char *data = make_binary(headers[i], 7, &size);
        assert_is_made(collect(import_stl, data, size, FEED_FILE), 7);
        assert_is_made(collect(import_read, data, size, FEED_BYTES), 7);
        free(data);
    }
}

static void attributes_and_trailing_bytes_are_ignored(void **state)
{
    (void)state;
    size_t size;
    unsigned char *data = make_binary("exported", 3, &size);
    store_u16(data + 84 + 48, 0x7c00);
    data = realloc(data, size + 33);
    assert_non_null(data);
    memset(data + size, 'x', 33);
    struct collected collected = collect(import_stl, data, size + 33, FEED_FILE);
    assert_non_null(strstr(collected.messages, "dropped: attributes of the facets"));
    assert_is_made(collected, 3);

    store_u32(data + 80, 0); /* written to a pipe: the count could not be filled in */
    store_u16(data + 84 + 48, 0);
    collected = collect(import_stl, data, size, FEED_FILE);
    assert_non_null(strstr(collected.messages, "0 facets, but 3 follow"));
    assert_is_made(collected, 3);
    free(data);
}

static void truncated_binary_files_are_refused(void **state)
{
    (void)state;
    size_t size;
    unsigned char *data = make_binary("exported", 4, &size);
    for (size_t cut = 0; cut < size; cut++) {
        struct collected collected = collect(import_stl, data, cut, FEED_FILE);
        if (cut < 84)
            assert_refused(collected, "within the header", NULL);
        else
            assert_refused(collected, "within the facets", "of 4 are there", NULL);
    }
    /* Seen through the probe, what has a facet is still known as STL. */
    assert_refused(collect(import_read, data, size - 20, FEED_FILE), "3 of 4 are there", NULL);
    store_f32(data + 84 + 50 * 2 + 12 + 4 * 4, (float)NAN);
    assert_refused(collect(import_stl, data, size, FEED_FILE), "facet 2", "y of a corner", NULL);
    store_u32(data + 80, UINT32_MAX / 3 + 1);
    assert_refused(collect(import_stl, data, size, FEED_FILE), "1431655766 facets", NULL);
    free(data);
}

static const char two_facets[] =
    "solid part of two\n  facet normal 0 0 1\n    outer loop\n      vertex 0 0 0\n"
    "      vertex 1e0 0.0 0\n      vertex 0 1 -0\n    endloop\n  endfacet\n"
    "facet normal nan nan nan\nouter loop\nvertex 0 0 0 vertex 0 1 0\nvertex -1 0 0\nendloop\n"
    "endfacet\nendsolid part of two\n";

static void assert_two_facets(struct collected collected)
{
    static const double positions[18] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, -1, 0, 0};
    assert_read(&collected);
    assert_true(collected.is_soup);
    assert_int_equal(collected.vertex_count, 6);
    assert_int_equal(collected.face_count, 2);
    for (size_t i = 0; i < 18; i++)
        assert_true(collected.positions[i] == positions[i]);
    collected_free(&collected);
}

static void text_files_are_read(void **state)
{
    (void)state;
    assert_two_facets(collect_text(import_stl, two_facets));
    assert_two_facets(collect(import_read, two_facets, sizeof two_facets - 1, FEED_BYTES));
    /* Without the last newline, with CRLF, in capitals, behind a byte order mark. */
    char text[2 * sizeof two_facets];
    size_t size = 0;
    memcpy(text, "\xef\xbb\xbf\r\n", 5);
    size = 5;
    for (const char *c = two_facets; *c; c++) {
        if (*c == '\n')
            text[size++] = '\r';
        text[size++] = *c;
    }
    assert_two_facets(collect(import_stl, text, size, FEED_FILE));
    assert_two_facets(collect(import_stl, text, size - 2, FEED_FILE));
    for (size_t i = 0; i < size; i++)
        if (text[i] >= 'a' && text[i] <= 'z' && text[i] != 'n' && text[i] != 'e')
            text[i] = (char)(text[i] - 32);
    assert_two_facets(collect(import_read, text, size, FEED_FILE));
}

static void several_solids_are_one_mesh(void **state)
{
    (void)state;
    char text[4 * sizeof two_facets];
    strcpy(text, two_facets);
    strcat(text, "\nsolid\nendsolid\n");
    strcat(text, two_facets);
    struct collected collected = collect_text(import_stl, text);
    assert_read(&collected);
    assert_int_equal(collected.face_count, 4);
    collected_free(&collected);
    collected = collect_text(import_read, "solid nothing\nendsolid nothing\n");
    assert_read(&collected);
    assert_int_equal(collected.face_count, 0);
    collected_free(&collected);
}

static void wrong_text_is_refused_with_its_place(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        const char *fragments[3];
    } cases[] = {
        {"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 x\n", {"line 4", "facet 0", "\"x\""}},
        {"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 inf 0\n",
         {"line 4", "y is not finite", ""}},
        {"solid a\nfacet normal 0 0 1\nouter loop\nvortex 0 0 0\n", {"line 4", "\"vortex\"", ""}},
        {"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0\n", {"line 5", "file ends here", ""}},
        {"solid a\nfacet normal 0 0 1\nouter loop\nendsolid\n", {"line 4", "\"endsolid\"", ""}},
        {"solid a\nfacet normal 0 0 1\n", {"line 3", "without endsolid", ""}},
        {"solid a\n  facet normal 0 0 1\n outer loop\n vertex 0 0 0\n vertex 0 0 0\n vertex 0 0 0\n"
         "endloop\nendfacet\n",
         {"line 9", "without endsolid", ""}},
        {"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0 0 0\nvertex 0 0 0\n"
         "endloop\nendfacet\nendsolid\nfacet normal",
         {"line 10", "facet 1", "\"facet\""}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        assert_refused(collect_text(import_stl, cases[i].text), cases[i].fragments[0],
                       cases[i].fragments[1], cases[i].fragments[2], NULL);
}

static void any_truncation_of_text_is_refused(void **state)
{
    (void)state;
    size_t whole = strlen(two_facets) - strlen(" part of two\n");
    for (size_t cut = 0; cut < strlen(two_facets); cut++) {
        struct collected collected = collect(import_stl, two_facets, cut, FEED_FILE);
        if (cut >= whole)
            assert_two_facets(collected);
        else
            assert_refused(collected, NULL);
    }
}

/* The same text gives the same number wherever it stands, or welding would leave cracks. */
static void equal_texts_are_equal_numbers(void **state)
{
    (void)state;
    enum { FACETS = 6000 };
    char *text = malloc(FACETS * 200), *at = text;
    assert_non_null(text);
    at += sprintf(at, "solid a\n");
    for (int f = 0; f < FACETS; f++) /* only some batches need doubles */
        at += sprintf(at,
                      "facet normal 0 0 0\nouter loop\nvertex 0.1 0.2 0.3\nvertex %s 1 1\n"
                      "vertex 0.7 0.9 0.11\nendloop\nendfacet\n",
                      f == FACETS - 1 ? "500123.456" : "0.123");
    at += sprintf(at, "endsolid a\n");
    struct collected collected = collect(import_stl, text, (size_t)(at - text), FEED_FILE);
    assert_read(&collected);
    assert_false(collected.is_float32);
    for (int f = 1; f < FACETS; f++)
        assert_memory_equal(collected.positions, collected.positions + 9 * f, 3 * sizeof(double));
    collected_free(&collected);
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(binary_files_are_read),
        cmocka_unit_test(solid_in_a_binary_header_is_no_text),
        cmocka_unit_test(attributes_and_trailing_bytes_are_ignored),
        cmocka_unit_test(truncated_binary_files_are_refused),
        cmocka_unit_test(text_files_are_read),
        cmocka_unit_test(several_solids_are_one_mesh),
        cmocka_unit_test(wrong_text_is_refused_with_its_place),
        cmocka_unit_test(any_truncation_of_text_is_refused),
        cmocka_unit_test(equal_texts_are_equal_numbers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
