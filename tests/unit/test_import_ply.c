/* The PLY reader: every variant of header and body, and every way in which a file can be wrong. */
#include "base/bytes.h"
#include "mesh/import.h"
#include "test_collect.h"
#include "test_kit.h"
#include "test_shapes.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char triangle_header[] = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
                                      "property float y\nproperty float z\nelement face 1\n"
                                      "property list uchar int vertex_indices\nend_header\n";

static struct collected read_text(const char *text)
{
    return collect_text(import_ply, text);
}

static void assert_triangle(struct collected collected)
{
    static const double positions[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    static const uint32_t indices[3] = {0, 1, 2};
    assert_read(&collected);
    assert_int_equal(collected.vertex_count, 3);
    assert_int_equal(collected.face_count, 1);
    assert_memory_equal(collected.positions, positions, sizeof positions);
    assert_memory_equal(collected.indices, indices, sizeof indices);
    assert_true(collected.is_float32);
    collected_free(&collected);
}

/* ---- bytes of a binary file, in either order ---- */

struct builder {
    unsigned char data[8192];
    size_t size;
    bool is_big;
};

static void add_text(struct builder *builder, const char *text)
{
    memcpy(builder->data + builder->size, text, strlen(text));
    builder->size += strlen(text);
}

static void add_integer(struct builder *builder, int64_t value, unsigned size)
{
    for (unsigned i = 0; i < size; i++)
        builder->data[builder->size + (builder->is_big ? size - 1 - i : i)] =
            (unsigned char)((uint64_t)value >> 8 * i);
    builder->size += size;
}

static void add_real(struct builder *builder, double value, bool is_double)
{
    float single = (float)value;
    uint32_t bits32;
    uint64_t bits64;
    memcpy(&bits32, &single, 4);
    memcpy(&bits64, &value, 8);
    add_integer(builder, (int64_t)(is_double ? bits64 : bits32), is_double ? 8 : 4);
}

static struct collected read_bytes(const struct builder *builder)
{
    return collect(import_ply, builder->data, builder->size, FEED_FILE);
}

/* ---- headers ---- */

static void a_plain_text_file_is_read(void **state)
{
    (void)state;
    char text[1024];
    snprintf(text, sizeof text, "%s0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", triangle_header);
    struct collected collected = read_text(text);
    assert_int_equal(collected.expected_vertices, 3);
    assert_int_equal(collected.expected_faces, 1);
    assert_false(collected.is_soup);
    assert_int_equal(collected.attributes.count, 0);
    assert_string_equal(collected.messages, "");
    assert_triangle(collected);
}

static void layout_of_a_text_file_is_free(void **state)
{
    (void)state;
    char text[1024];
    /* No final newline; everything on one line; CRLF; a byte order mark; blank lines in front. */
    snprintf(text, sizeof text, "%s0 0 0\n1 0 0\n0 1 0\n3 0 1 2", triangle_header);
    assert_triangle(read_text(text));
    snprintf(text, sizeof text, "%s0 0 0 1 0 0 0 1 0 3 0 1 2", triangle_header);
    assert_triangle(read_text(text));
    snprintf(text, sizeof text, "\xef\xbb\xbf\n\n%s\t0   0 0\n\n1 0\n0 0 1 0\n3 0\n1 2\n\n \n",
             triangle_header);
    assert_triangle(read_text(text));
    static const char crlf[] =
        "ply\r\nformat ascii 1.0\r\ncomment made \xc3\xa9\r\nobj_info x = 1\r\nelement vertex 3\r\n"
        "property float32 x\r\nproperty float64 y\r\nproperty  float \t z\r\n"
        "element face 1\r\nproperty list uint8 int32 vertex_index\r\nend_header\r\n"
        "0 0 0\r\n1 0 0\r\n0 1 0\r\n3 0 1 2\r\n";
    assert_triangle(read_text(crlf));
    char mac[sizeof crlf];
    size_t size = 0;
    for (size_t i = 0; i < sizeof crlf; i++)
        if (crlf[i] != '\n')
            mac[size++] = crlf[i];
    assert_triangle(read_text(mac));
}

static void both_sets_of_type_names_are_known(void **state)
{
    (void)state;
    static const char *const names[8][2] = {
        {"char", "int8"}, {"uchar", "uint8"}, {"short", "int16"},   {"ushort", "uint16"},
        {"int", "int32"}, {"uint", "uint32"}, {"float", "float32"}, {"double", "float64"}};
    for (unsigned t = 0; t < 8; t++)
        for (unsigned n = 0; n < 2; n++) {
            char text[512];
            snprintf(text, sizeof text,
                     "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
                     "property float z\nproperty %s quality\nelement face 0\nproperty list uchar "
                     "int vertex_indices\nend_header\n1 2 3 100\n",
                     names[t][n]);
            struct collected collected = read_text(text);
            assert_read(&collected);
            assert_int_equal(collected.attributes.count, 1);
            assert_int_equal(collected.attributes.list[0].type, t);
            assert_int_equal(collected.attributes.stride, scalar_size((enum scalar_type)t));
            assert_string_equal(collected.attributes.list[0].name, "quality");
            if (t < SCALAR_FLOAT32)
                assert_int_equal(collected.records[0], 100);
            else
                assert_true((t == SCALAR_FLOAT32 ? (double)load_f32(collected.records)
                                                 : load_f64(collected.records)) == 100);
            collected_free(&collected);
        }
}

static void bad_headers_are_refused_with_their_line(void **state)
{
    (void)state;
    static const struct {
        const char *text, *first, *second;
    } cases[] = {
        {"plx\n", "line 1", "does not begin with \"ply\""},
        {"ply\nformat ascii 2.0\nend_header\n", "line 2", "version"},
        {"ply\nformat text 1.0\nend_header\n", "line 2", "format"},
        {"ply\nelement vertex 1\nend_header\n", "line 3", "without a format"},
        {"ply\nformat ascii 1.0\nelement vertex\nend_header\n", "line 3", "element without"},
        {"ply\nformat ascii 1.0\nelement vertex -3\nend_header\n", "line 3", "element without"},
        {"ply\nformat ascii 1.0\nelement vertex 3x\nend_header\n", "line 3", "element without"},
        {"ply\nformat ascii 1.0\nelement vertex 99999999999999999999\n", "line 3", "element"},
        {"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "line 3", "before the first"},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty real x\n", "line 4", "unknown type"},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty float\n", "line 4",
         "a property without"},
        {"ply\nformat ascii 1.0\nelement f 1\nproperty list float int v\n", "line 4",
         "size is not an integer"},
        {"ply\nformat ascii 1.0\nelement vertex 1\nelement vertex 2\n", "line 4", "already"},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty int x\nproperty int x\n", "line 5",
         "already"},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty float \033[2Jx\nend_header\n", "line 4",
         "no text"},
        {"ply\nformat ascii 1.0\nelement a\177b 1\nend_header\n", "line 3", "no text"},
        {"ply\nformat ascii 1.0\nelephant\n", "line 3", "not a line of a PLY header"},
        {"ply\nformat ascii 1.0\nelement vertex 1\n", "line 4", "ends within the header"},
        {"ply\nformat ascii 1.0\nelement face 0\nproperty list uchar int vertex_indices\n"
         "end_header\n",
         "no element", "vertex"},
        {"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float "
         "y\nend_header\n",
         "no scalar property", "\"z\""},
        {"ply\nformat ascii 1.0\nelement vertex 4294967295\nproperty float x\nproperty float y\n"
         "property float z\nend_header\n",
         "4294967295 vertices", "4294967294"},
        {"ply\nformat ascii 1.0\nelement vertex 0\nproperty float x\nproperty float y\n"
         "property float z\nelement face 2\nproperty list uchar float vertex_indices\nend_header\n",
         "\"face\"", "no list of integers"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        assert_refused(read_text(cases[i].text), cases[i].first, cases[i].second, NULL);
    char *text = malloc(300000);
    assert_non_null(text);
    memset(text, 'x', 300000);
    memcpy(text, "ply\ncomment ", 12);
    text[299999] = 0;
    assert_refused(read_text(text), "line 2", "a line of more than", NULL);
    free(text);
}

/* ---- properties ---- */

/* A vertex with everything in an odd order, as text and binary in both orders, must be the same. */
static void any_order_and_types_are_understood(void **state)
{
    (void)state;
    for (int format = 0; format < 3; format++) {
        struct builder builder = {.is_big = format == 2};
        static const char *const formats[] = {"ascii", "binary_little_endian", "binary_big_endian"};
        add_text(&builder, "ply\nformat ");
        add_text(&builder, formats[format]);
        add_text(&builder, " 1.0\nelement first 2\nproperty list uchar short a\nproperty double b\n"
                           "element vertex 2\nproperty uchar red\nproperty double z\n"
                           "property list ushort float weights\nproperty short x\n"
                           "property float confidence\nproperty int8 y\nproperty uint label\n"
                           "element middle 3\nproperty int c\nproperty ushort d\n"
                           "element face 2\nproperty float area\n"
                           "property list ushort uchar vertex_indices\nproperty list char int e\n"
                           "element last 1\nproperty list int double f\nend_header\n");
        if (format == 0) {
            add_text(&builder, "2 -1 -2 0.5\n0 1e300\n"
                               "200 0.1 3 1.5 2.5 3.5 -300 0.25 -128 4000000000\n"
                               "7 -2.5e-3 0 32767 nan 127 1\n"
                               "1 2\n3 4\n5 6\n"
                               "1.5 3 0 1 0 1 9\n0 4 1 0 1 0 0\n"
                               "3 1 2 3\n");
        } else {
            struct builder *b = &builder;
            add_integer(b, 2, 1), add_integer(b, -1, 2), add_integer(b, -2, 2),
                add_real(b, .5, true);
            add_integer(b, 0, 1), add_real(b, 1e300, true);
            add_integer(b, 200, 1), add_real(b, 0.1, true), add_integer(b, 3, 2);
            add_real(b, 1.5, false), add_real(b, 2.5, false), add_real(b, 3.5, false);
            add_integer(b, -300, 2), add_real(b, 0.25, false), add_integer(b, -128, 1);
            add_integer(b, 4000000000, 4);
            add_integer(b, 7, 1), add_real(b, -2.5e-3, true), add_integer(b, 0, 2);
            add_integer(b, 32767, 2), add_integer(b, 0x7fc00000, 4), add_integer(b, 127, 1);
            add_integer(b, 1, 4);
            for (int i = 1; i < 7; i++)
                add_integer(b, i, i % 2 ? 4 : 2);
            add_real(b, 1.5, false), add_integer(b, 3, 2), add_integer(b, 0, 1);
            add_integer(b, 1, 1), add_integer(b, 0, 1), add_integer(b, 1, 1), add_integer(b, 9, 4);
            add_real(b, 0, false), add_integer(b, 4, 2), add_integer(b, 1, 1), add_integer(b, 0, 1);
            add_integer(b, 1, 1), add_integer(b, 0, 1), add_integer(b, 0, 1);
            add_integer(b, 3, 4), add_real(b, 1, true), add_real(b, 2, true), add_real(b, 3, true);
        }
        struct collected collected = read_bytes(&builder);
        assert_read(&collected);
        static const double positions[6] = {-300, -128, 0.1, 32767, 127, -2.5e-3};
        assert_int_equal(collected.vertex_count, 2);
        assert_memory_equal(collected.positions, positions, sizeof positions);
        assert_false(collected.is_float32);
        assert_int_equal(collected.attributes.count, 3);
        assert_int_equal(collected.attributes.stride, 9);
        assert_string_equal(collected.attributes.list[1].name, "confidence");
        assert_int_equal(collected.records[0], 200);
        assert_true(load_f32(collected.records + 1) == 0.25f);
        assert_true(load_u32(collected.records + 5) == 4000000000);
        assert_int_equal(load_u32(collected.records + 10) & 0x7fc00000, 0x7fc00000);
        assert_int_equal(collected.face_count, 2);
        assert_int_equal(collected.sizes[1], 4);
        static const uint32_t indices[7] = {0, 1, 0, 1, 0, 1, 0};
        assert_memory_equal(collected.indices, indices, sizeof indices);
        assert_non_null(strstr(collected.messages, "elements dropped: first, middle, last\n"));
        assert_non_null(strstr(collected.messages, "face properties dropped: area, e\n"));
        assert_non_null(strstr(collected.messages, "vertex properties dropped: weights\n"));
        collected_free(&collected);
    }
}

static void faces_may_come_before_vertices(void **state)
{
    (void)state;
    assert_triangle(read_text("ply\nformat ascii 1.0\nelement face 1\n"
                              "property list uchar int vertex_indices\nelement vertex 3\n"
                              "property float x\nproperty float y\nproperty float z\nend_header\n"
                              "3 0 1 2\n0 0 0\n1 0 0\n0 1 0\n"));
}

/* The layouts of the fast path, with something before and behind each part, in both orders. */
static void plain_binary_rows_are_read(void **state)
{
    (void)state;
    for (int variant = 0; variant < 16; variant++) {
        bool extras = variant & 1, is_unsigned = variant & 2, is_double = variant & 8;
        struct builder builder = {.is_big = variant & 4};
        add_text(&builder, "ply\nformat binary_");
        add_text(&builder, builder.is_big ? "big" : "little");
        add_text(&builder, "_endian 1.0\nelement vertex 5\n");
        if (extras)
            add_text(&builder, "property short before\n");
        for (unsigned k = 0; k < 3; k++) {
            char line[64];
            snprintf(line, sizeof line, "property %s %c\n", is_double ? "double" : "float",
                     "xyz"[k]);
            add_text(&builder, line);
        }
        if (extras)
            add_text(&builder, "property uchar red\nproperty double after\n");
        add_text(&builder, "element face 5\n");
        if (extras)
            add_text(&builder, "property uchar flag\n");
        add_text(&builder, is_unsigned ? "property list uchar uint vertex_indices\n"
                                       : "property list char int vertex_indices\n");
        if (extras)
            add_text(&builder, "property ushort group\n");
        add_text(&builder, "end_header\n");
        for (int v = 0; v < 5; v++) {
            if (extras)
                add_integer(&builder, 1000 + v, 2);
            for (int k = 0; k < 3; k++)
                add_real(&builder, 0.5 * v + k, is_double);
            if (extras)
                add_integer(&builder, 100 + v, 1), add_real(&builder, v + 0.1, true);
        }
        static const uint32_t sizes[5] = {3, 3, 5, 3, 4};
        for (int f = 0; f < 5; f++) {
            if (extras)
                add_integer(&builder, f, 1);
            add_integer(&builder, sizes[f], 1);
            for (uint32_t i = 0; i < sizes[f]; i++)
                add_integer(&builder, (f + i) % 5, 4);
            if (extras)
                add_integer(&builder, f, 2);
        }
        for (int feed = FEED_FILE; feed <= FEED_BYTES; feed++) {
            struct collected collected =
                collect(import_ply, builder.data, builder.size, (enum feed)feed);
            assert_read(&collected);
            assert_int_equal(collected.vertex_count, 5);
            assert_int_equal(collected.face_count, 5);
            assert_true(collected.is_float32);
            for (size_t i = 0; i < 15; i++)
                assert_true(collected.positions[i] == 0.5 * (double)(i / 3) + (double)(i % 3));
            for (size_t f = 0, at = 0; f < 5; at += sizes[f++]) {
                assert_int_equal(collected.sizes[f], sizes[f]);
                for (size_t i = 0; i < sizes[f]; i++)
                    assert_int_equal(collected.indices[at + i], (f + i) % 5);
            }
            if (extras)
                for (unsigned v = 0; v < 5; v++) {
                    const unsigned char *record = collected.records + 11 * v;
                    assert_int_equal(load_u16(record), 1000 + v);
                    assert_int_equal(record[2], 100 + v);
                    assert_true(load_f64(record + 3) == v + 0.1);
                }
            collected_free(&collected);
        }
    }
}

static void too_much_for_attributes_is_dropped_and_said(void **state)
{
    (void)state;
    char text[16384] = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
                       "property float y\nproperty float z\n";
    for (unsigned i = 0; i < ATTRIBUTE_MAX + 2; i++)
        snprintf(text + strlen(text), sizeof text - strlen(text), "property uchar p%u\n", i);
    strcat(text, "element face 0\nproperty list uchar int vertex_indices\nend_header\n0 0 0");
    for (unsigned i = 0; i < ATTRIBUTE_MAX + 2; i++)
        snprintf(text + strlen(text), sizeof text - strlen(text), " %u", i);
    struct collected collected = read_text(text);
    assert_read(&collected);
    assert_int_equal(collected.attributes.count, ATTRIBUTE_MAX);
    for (unsigned i = 0; i < ATTRIBUTE_MAX; i++)
        assert_int_equal(collected.records[i], i);
    assert_non_null(strstr(collected.messages, "vertex properties dropped: p64, p65\n"));
    collected_free(&collected);

    snprintf(text, sizeof text,
             "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
             "property float z\nproperty int %0100d\nend_header\n0 0 0 5\n",
             7);
    collected = read_text(text);
    assert_read(&collected);
    assert_int_equal(collected.attributes.count, 0);
    assert_non_null(strstr(collected.messages, "vertex properties dropped: 000000"));
    collected_free(&collected);
}

/* ---- precision ---- */

static struct collected read_coordinate(const char *type, const char *coordinate)
{
    char text[512];
    snprintf(text, sizeof text,
             "ply\nformat ascii 1.0\nelement vertex 1\nproperty %s x\nproperty float y\n"
             "property float z\nend_header\n%s 0 0\n",
             type, coordinate);
    return read_text(text);
}

static void text_keeps_its_digits(void **state)
{
    (void)state;
    static const struct {
        const char *type, *text;
        double value;
        bool is_float32;
    } cases[] = {{"float", "0.1", (double)0.1f, true},
                 {"float", "500123.456", 500123.456, false},
                 {"float", "5400123.4", 5400123.4, false},
                 {"float", "500123.5", 500123.5, true},
                 {"float", "0.100000001490116", (double)0.1f, true},
                 {"float", "0.10000000000000001", 0.1, false},
                 {"double", "0.1", 0.1, false}, /* a double: no float32 is this number */
                 {"double", "0.5", 0.5, true},
                 {"int", "16777216", 16777216, true},
                 {"int", "16777217", 16777217, false}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct collected collected = read_coordinate(cases[i].type, cases[i].text);
        assert_read(&collected);
        assert_true(collected.positions[0] == cases[i].value);
        assert_int_equal(collected.is_float32, cases[i].is_float32);
        collected_free(&collected);
    }
}

/* ---- strips ---- */

static void strips_become_triangles(void **state)
{
    (void)state;
    for (int is_binary = 0; is_binary < 2; is_binary++) {
        struct builder builder = {0};
        add_text(&builder, "ply\nformat ");
        add_text(&builder, is_binary ? "binary_little_endian" : "ascii");
        add_text(&builder, " 1.0\nelement vertex 6\nproperty float x\nproperty float y\n"
                           "property float z\nelement tristrips 2\n"
                           "property list int int vertex_indices\nend_header\n");
        static const int strips[2][12] = {{11, 0, 1, 2, 3, -1, 3, 4, 5, 5, 0, 1}, {2, 0, 1}};
        for (int v = 0; v < 18; v++)
            if (is_binary)
                add_real(&builder, v, false);
            else
                add_text(&builder, v % 3 == 2 ? "1\n" : "1 ");
        for (int s = 0; s < 2; s++)
            for (int i = 0; i <= strips[s][0]; i++) {
                char word[16];
                snprintf(word, sizeof word, "%d ", strips[s][i]);
                if (is_binary)
                    add_integer(&builder, strips[s][i], 4);
                else
                    add_text(&builder, word);
            }
        struct collected collected = read_bytes(&builder);
        assert_read(&collected);
        /* 0123: two, the second turned; 3 4 5 5 0 1: 345, then 455 and 550 only join, 501. */
        static const uint32_t expected[] = {0, 1, 2, 2, 1, 3, 3, 4, 5, 0, 5, 1};
        assert_int_equal(collected.face_count, 4);
        /* The last: corners 5 0 1 at an odd place: turned. */
        assert_memory_equal(collected.indices, expected, sizeof expected);
        collected_free(&collected);
    }
    assert_refused(read_text("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
                             "property float y\nproperty float z\nelement tristrips 1\n"
                             "property list int int vertex_indices\nend_header\n0 0 0\n3 0 -2 0\n"),
                   "line 11", "strip 0", "-2", NULL);
}

/* ---- wrong bodies ---- */

static void wrong_rows_are_refused_with_their_place(void **state)
{
    (void)state;
    static const struct {
        const char *body;
        const char *fragments[3];
    } cases[] = {
        {"0 0 0\n1 0 zero\n", {"line 11", "vertex 1", "\"zero\" is not a number"}},
        {"0 0 0\n1 nan 0\n", {"line 11", "vertex 1", "y is not finite"}},
        {"0 0 0\n1 1e999 0\n", {"line 11", "vertex 1", "y is not finite"}},
        {"0 0 -inf\n", {"line 10", "vertex 0", "z is not finite"}},
        {"0 0 1,5\n", {"line 10", "vertex 0", "\"1,5\" is not a number"}},
        {"0 0 0\n1 0 0\n0 1 0\n3 0 1 -2\n", {"line 13", "face 0", "\"-2\" is not an index"}},
        {"0 0 0\n1 0 0\n0 1 0\n3 0 1 4294967296\n", {"line 13", "face 0", "is not an index"}},
        {"0 0 0\n1 0 0\n0 1 0\n3 0 1 2.5\n", {"line 13", "face 0", "\"2.5\" is not an index"}},
        {"0 0 0\n1 0 0\n0 1 0\nthree\n", {"line 13", "face 0", "\"three\" is not an index"}},
        {"0 0 0\n1 0 0\n0 1\n", {"ends within element \"vertex\"", "2 of 3", ""}},
        {"0 0 0\n1 0 0\n0 1 0\n", {"ends within element \"face\"", "0 of 1", ""}},
        {"0 0 0\n1 0 0\n0 1 0\n3 0 1", {"ends within element \"face\"", "0 of 1", ""}},
        {"", {"ends within element \"vertex\"", "0 of 3", ""}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[1024];
        snprintf(text, sizeof text, "%s%s", triangle_header, cases[i].body);
        assert_refused(read_text(text), cases[i].fragments[0], cases[i].fragments[1],
                       cases[i].fragments[2], NULL);
    }
    assert_refused(read_text("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
                             "property float y\nproperty float z\nproperty uchar red\nend_header\n"
                             "0 0 0 256\n"),
                   "line 9", "vertex 0", "256", "red", NULL);
    assert_refused(read_text("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\n"
                             "property float y\nproperty float z\nproperty int red\nend_header\n"
                             "0 0 0 2.5\n"),
                   "line 9", "vertex 0", "2.5", "red", NULL);
}

static void wrong_binary_rows_are_refused(void **state)
{
    (void)state;
    for (int is_big = 0; is_big < 2; is_big++) {
        struct builder start = {.is_big = is_big};
        add_text(&start, is_big ? "ply\nformat binary_big_endian 1.0\n"
                                : "ply\nformat binary_little_endian 1.0\n");
        add_text(&start, "element vertex 2\nproperty float x\nproperty float y\nproperty float z\n"
                         "element face 2\nproperty list char int vertex_indices\nend_header\n");
        struct builder bad = start;
        for (int i = 0; i < 6; i++)
            add_real(&bad, i == 4 ? (double)INFINITY : 1, false);
        assert_refused(read_bytes(&bad), "vertex 1", "y is not finite", NULL);

        for (int i = 0; i < 6; i++)
            add_real(&start, i, false);
        add_integer(&start, 3, 1);
        for (int i = 0; i < 3; i++)
            add_integer(&start, i, 4);
        bad = start;
        add_integer(&bad, 3, 1), add_integer(&bad, 0, 4), add_integer(&bad, -7, 4);
        assert_refused(read_bytes(&bad), "element \"face\"", "1 of 2", NULL);
        add_integer(&bad, 0, 4);
        assert_refused(read_bytes(&bad), "face 1", "index -7 is negative", NULL);
        bad = start;
        add_integer(&bad, 4, 1), add_integer(&bad, 0, 4), add_integer(&bad, 0, 4);
        add_integer(&bad, 0, 4), add_integer(&bad, -8, 4);
        assert_refused(read_bytes(&bad), "face 1", "index -8 is negative", NULL);
        bad = start;
        add_integer(&bad, -3, 1);
        assert_refused(read_bytes(&bad), "face 1", "size is negative", NULL);
    }
    /* A list that claims more than the file has must not be believed. */
    struct builder huge = {0};
    add_text(&huge, "ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty float x\n"
                    "property float y\nproperty float z\nelement face 1\n"
                    "property list uint uint vertex_indices\nend_header\n");
    add_integer(&huge, UINT32_MAX, 4);
    add_integer(&huge, 1, 4);
    assert_refused(read_bytes(&huge), "element \"face\"", "0 of 1", NULL);
    struct builder skipped = {0};
    add_text(&skipped, "ply\nformat binary_little_endian 1.0\nelement other 9000000000000000000\n"
                       "property double a\nproperty double b\nelement vertex 0\n"
                       "property float x\nproperty float y\nproperty float z\nend_header\n");
    assert_refused(read_bytes(&skipped), "element \"other\"", NULL);
}

static void short_faces_are_left_out_and_counted(void **state)
{
    (void)state;
    struct collected collected =
        read_text("ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                  "property float z\nelement face 5\nproperty list uchar int vertex_indices\n"
                  "end_header\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n3 0 1 2\n0\n1 2\n3 2 1 0\n");
    assert_read(&collected);
    assert_int_equal(collected.face_count, 2);
    assert_int_equal(collected.first_face, 4); /* the numbers are those of the file */
    static const uint32_t indices[6] = {0, 1, 2, 2, 1, 0};
    assert_memory_equal(collected.indices, indices, sizeof indices);
    assert_non_null(strstr(collected.messages, "3 faces of fewer than 3 corners"));
    collected_free(&collected);
}

static void what_follows_is_said(void **state)
{
    (void)state;
    char text[1024];
    snprintf(text, sizeof text, "%s0 0 0\n1 0 0\n0 1 0\n3 0 1 2\nmore\n", triangle_header);
    struct collected collected = read_text(text);
    assert_non_null(strstr(collected.messages, "what follows the last element"));
    assert_triangle(collected);
}

static void point_clouds_and_empty_files_reach_the_sink(void **state)
{
    (void)state;
    struct collected collected = read_text("ply\nformat ascii 1.0\nelement vertex 2\n"
                                           "property float x\nproperty float y\nproperty float z\n"
                                           "end_header\n1 2 3\n4 5 6\n");
    assert_read(&collected);
    assert_int_equal(collected.vertex_count, 2);
    assert_int_equal(collected.face_count, 0);
    collected_free(&collected);
    collected = read_text("ply\nformat binary_big_endian 1.0\nelement vertex 0\nproperty float x\n"
                          "property float y\nproperty float z\nend_header\n");
    assert_read(&collected);
    collected_free(&collected);
}

/* Every prefix of a file either is refused in words or, once it is whole, read. */
static void any_truncation_is_refused(void **state)
{
    (void)state;
    struct shape shape = shape_cube_quads();
    for (int format = SHAPE_PLY_ASCII; format <= SHAPE_PLY_BIG; format++) {
        size_t size;
        unsigned char *data = shape_encode(&shape, (enum shape_format)format, &size);
        for (size_t cut = 0; cut < size; cut++) {
            struct collected collected = collect(import_ply, data, cut, FEED_FILE);
            /* Without its last newline, or a digit of its last number, a text is whole. */
            bool may_be_whole = format == SHAPE_PLY_ASCII && cut + 1 >= size;
            if (may_be_whole && collected.status == STATUS_OK)
                collected_free(&collected);
            else
                assert_refused(collected, NULL);
        }
        free(data);
    }
    shape_free(&shape);
}

/* Larger than any buffer, through a pipe in odd pieces: the same as from memory. */
static void pieces_of_any_size_make_no_difference(void **state)
{
    (void)state;
    struct shape shape = shape_noisy_sphere(6, 0.01, 3);
    for (int format = SHAPE_PLY_ASCII; format <= SHAPE_PLY_BIG; format++)
        assert_reads_shape(import_ply, &shape, (enum shape_format)format, true);
    shape_free(&shape);
}

/* ---- rows that several threads read ---- */

enum { MANY_VERTICES = 40000, MANY_FACES = 70000, VERTEX_ROW = 13, FACE_ROW = 13 };

struct many {
    unsigned char *data;
    size_t size, vertices, faces; /* where the rows begin */
};

static struct many make_many(void)
{
    char header[512];
    snprintf(header, sizeof header,
             "ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\n"
             "property uchar red\nproperty float y\nproperty float z\nelement face %d\n"
             "property list uchar int vertex_indices\nend_header\n",
             MANY_VERTICES, MANY_FACES);
    struct many many = {.vertices = strlen(header)};
    many.faces = many.vertices + (size_t)MANY_VERTICES * VERTEX_ROW;
    many.size = many.faces + (size_t)MANY_FACES * FACE_ROW;
    many.data = malloc(many.size + 4);
    assert_non_null(many.data);
    memcpy(many.data, header, many.vertices);
    uint64_t seed = 3;
    for (size_t i = 0; i < MANY_VERTICES; i++) {
        unsigned char *row = many.data + many.vertices + i * VERTEX_ROW;
        const float point[3] = {(float)i, (float)(i % 7), (float)(i % 11) / 3};
        memcpy(row, &point[0], 4);
        row[4] = (unsigned char)i;
        memcpy(row + 5, &point[1], 8);
    }
    for (size_t i = 0; i < MANY_FACES; i++) {
        unsigned char *row = many.data + many.faces + i * FACE_ROW;
        row[0] = 3;
        for (unsigned k = 0; k < 3; k++)
            store_u32(row + 1 + 4 * k, (uint32_t)random_below(&seed, MANY_VERTICES));
    }
    return many;
}

/* A file, which three threads read, and a pipe, of which that can't be, give the same. */
static void assert_split_alike(const struct many *many)
{
    struct collected file = collect(import_ply, many->data, many->size, FEED_FILE);
    struct collected pipe = collect(import_ply, many->data, many->size, FEED_PIECES);
    assert_int_equal(file.status, pipe.status);
    if (file.status == STATUS_OK) {
        assert_int_equal(file.vertex_count, pipe.vertex_count);
        assert_int_equal(file.face_count, pipe.face_count);
        assert_int_equal(file.index_count, pipe.index_count);
        assert_memory_equal(file.positions, pipe.positions, 24 * file.vertex_count);
        assert_memory_equal(file.records, pipe.records, file.vertex_count);
        assert_memory_equal(file.sizes, pipe.sizes, 4 * file.face_count);
        assert_memory_equal(file.indices, pipe.indices, 4 * file.index_count);
        assert_int_equal(file.first_face, pipe.first_face);
        assert_int_equal(file.digest, pipe.digest);
    } else {
        const char *words[2] = {strstr(file.error, ": "), strstr(pipe.error, ": ")};
        assert_non_null(words[0]);
        assert_non_null(words[1]);
        assert_string_equal(words[0], words[1]);
    }
    collected_free(&file);
    collected_free(&pipe);
}

static void rows_that_threads_share_are_those_of_a_stream(void **state)
{
    (void)state;
    struct many many = make_many();
    unsigned char kept[VERTEX_ROW];
    assert_split_alike(&many);

    unsigned char *row = many.data + many.vertices + 30000 * (size_t)VERTEX_ROW;
    memcpy(kept, row, sizeof kept);
    memset(row + 5, 0xff, 4); /* not a number */
    assert_split_alike(&many);
    memcpy(row, kept, sizeof kept);

    row = many.data + many.faces + 33000 * (size_t)FACE_ROW;
    memcpy(kept, row, sizeof kept);
    store_u32(row + 5, 0xfffffff0); /* negative */
    assert_split_alike(&many);
    memcpy(row, kept, sizeof kept);

    many.size -= 5 * FACE_ROW + 1; /* cut off */
    assert_split_alike(&many);
    many.size -= 40000 * (size_t)FACE_ROW;
    assert_split_alike(&many);
    many.size += 40005 * (size_t)FACE_ROW + 1;

    memmove(row + 4, row, many.size - (size_t)(row - many.data)); /* one with four corners */
    row[0] = 4;
    store_u32(row + 13, 1);
    many.size += 4;
    assert_split_alike(&many);
    free(many.data);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_plain_text_file_is_read),
        cmocka_unit_test(layout_of_a_text_file_is_free),
        cmocka_unit_test(both_sets_of_type_names_are_known),
        cmocka_unit_test(bad_headers_are_refused_with_their_line),
        cmocka_unit_test(any_order_and_types_are_understood),
        cmocka_unit_test(faces_may_come_before_vertices),
        cmocka_unit_test(plain_binary_rows_are_read),
        cmocka_unit_test(rows_that_threads_share_are_those_of_a_stream),
        cmocka_unit_test(too_much_for_attributes_is_dropped_and_said),
        cmocka_unit_test(text_keeps_its_digits),
        cmocka_unit_test(strips_become_triangles),
        cmocka_unit_test(wrong_rows_are_refused_with_their_place),
        cmocka_unit_test(wrong_binary_rows_are_refused),
        cmocka_unit_test(short_faces_are_left_out_and_counted),
        cmocka_unit_test(what_follows_is_said),
        cmocka_unit_test(point_clouds_and_empty_files_reach_the_sink),
        cmocka_unit_test(any_truncation_is_refused),
        cmocka_unit_test(pieces_of_any_size_make_no_difference),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
