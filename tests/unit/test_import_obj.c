/* The OBJ reader. */
#include "mesh/import.h"
#include "test_collect.h"
#include "test_kit.h"
#include "test_shapes.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct collected read_text(const char *text)
{
    return collect_text(import_obj, text);
}

static void assert_faces(const struct collected *collected, size_t faces, const uint32_t *sizes,
                         const uint32_t *indices)
{
    size_t corners = 0;
    assert_read(collected);
    assert_int_equal(collected->face_count, faces);
    for (size_t f = 0; f < faces; f++) {
        assert_int_equal(collected->sizes[f], sizes[f]);
        corners += sizes[f];
    }
    assert_int_equal(collected->index_count, corners);
    assert_memory_equal(collected->indices, indices, corners * sizeof *indices);
}

static void all_forms_of_corners_are_understood(void **state)
{
    (void)state;
    struct collected collected =
        read_text("# a comment\nmtllib a.mtl\no thing\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
                  "vt 0 0\nvt 1 1 0\nvn 0 0 1\ng front\nusemtl red\ns 1\n"
                  "f 1 2 3\nf 1/1 2/2 3/1\nf 1//1 2//1 3//1 4//1\nf 1/1/1 2/2/1 3/1/1\n"
                  "f -4 -3 -2\nf -4/-2/-1 -3//-1 -2/-1\nf 1/ 2/ 3/\nv 5 5 5\nf -5 -1 2\n");
    static const uint32_t sizes[] = {3, 3, 4, 3, 3, 3, 3, 3};
    static const uint32_t indices[] = {0, 1, 2, 0, 1, 2, 0, 1, 2, 3, 0, 1, 2,
                                       0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 4, 1};
    assert_faces(&collected, 8, sizes, indices);
    assert_int_equal(collected.vertex_count, 5);
    assert_int_equal(collected.attributes.count, 0);
    assert_non_null(
        strstr(collected.messages, "dropped: texture coordinates, normals, materials\n"));
    assert_ptr_equal(strchr(collected.messages, '\n') + 1,
                     collected.messages + strlen(collected.messages)); /* said once */
    collected_free(&collected);
}

static void layout_is_free(void **state)
{
    (void)state;
    static const uint32_t sizes[] = {3, 5}, indices[] = {0, 1, 2, 0, 1, 2, 1, 0};
    static const char *const texts[] = {
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 3 2 1",
        "\xef\xbb\xbf\r\n\r\nv 0 0 0\r\nv 1 0 0\r\nv 0 1 0\r\nf 1 2 3\r\nf 1 2 3 2 1\r\n",
        "  v   0\t0 0  \nv 1 0 0# one\nv 0 1 0 # two\n\tf 1 2 3 # face\nf\t1 2 3 2 1\n#end",
        "v 0 0 \\\n0\nv 1 0 0\nv 0 \\\r\n1 0\nf 1 2\\\n 3\nf 1 2 \\\n3 \\\n2 \\\n1\n",
        "f 1 2 3\nf 1 2 3 2 1\nv 0 0 0\nv 1 0 0\nv 0 1 0\n",
        "v 0 0 0 1\nv 1 0 0 0.5\nv 0 1 0 1\nf 1 2 3\nfo 1 2 3 2 1\n", /* weights; an old name */
        "g a\\\nb v 9 9 9\nusemtl C:\\x\\y\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 3 2 1 \\",
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++)
        for (int feed = FEED_FILE; feed <= FEED_BYTES; feed++) {
            struct collected collected =
                collect(import_obj, texts[i], strlen(texts[i]), (enum feed)feed);
            assert_faces(&collected, 2, sizes, indices);
            assert_int_equal(collected.vertex_count, 3);
            assert_true(collected.positions[3] == 1 && collected.positions[7] == 1);
            collected_free(&collected);
        }
}

static void colours_become_attributes(void **state)
{
    (void)state;
    struct collected collected =
        read_text("v 0 0 0 1 0 0\nv 1 0 0 0.5 0.25 0.002\nv 0 1 0 1 1 1\nv 1 1 1\nf 1 2 3\n");
    static const unsigned char unit[12] = {255, 0, 0, 128, 64, 1, 255, 255, 255, 255, 255, 255};
    assert_read(&collected);
    assert_int_equal(collected.attributes.count, 3);
    assert_int_equal(collected.attributes.stride, 3);
    assert_string_equal(collected.attributes.list[0].name, "red");
    assert_string_equal(collected.attributes.list[2].name, "blue");
    assert_int_equal(collected.attributes.list[1].type, SCALAR_UINT8);
    assert_memory_equal(collected.records, unit, sizeof unit);
    collected_free(&collected);

    collected = read_text("v 0 0 0 200 0 1\nv 1 0 0 1 254 255\n");
    static const unsigned char bytes[6] = {200, 0, 1, 1, 254, 255};
    assert_read(&collected);
    assert_memory_equal(collected.records, bytes, sizeof bytes);
    collected_free(&collected);

    collected = read_text("v 0 0 0\nv 1 0 0 1 0 0\n");
    assert_read(&collected);
    assert_int_equal(collected.attributes.count, 0);
    assert_non_null(strstr(collected.messages, "colours that only some vertices have"));
    collected_free(&collected);

    assert_refused(read_text("v 0 0 0 1 0 -0.1\n"), "line 1", "vertex 0", "-0.1", NULL);
    assert_refused(read_text("v 0 0 0 1 0 256\n"), "line 1", "vertex 0", "256", NULL);
}

static void what_is_dropped_is_said(void **state)
{
    (void)state;
    struct collected collected = read_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3\np 1\n"
                                           "vp 0.5\ncurv 0 1 1 2\nweird 1 2 3\nf 1 2 3\n");
    assert_read(&collected);
    assert_non_null(strstr(collected.messages, "dropped: lines, points, free-form curves and "
                                               "surfaces, unknown statements\n"));
    collected_free(&collected);
    collected = read_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\nf 1 2 3\nf\nf 3\n");
    assert_read(&collected);
    assert_int_equal(collected.face_count, 1);
    assert_non_null(strstr(collected.messages, "3 faces of fewer than 3 corners"));
    collected_free(&collected);
}

static void large_coordinates_keep_their_digits(void **state)
{
    (void)state;
    struct collected collected = read_text("v 500123.456 5400987.654 123.4\nv 0.1 0.2 0.3\n");
    assert_read(&collected);
    assert_false(collected.is_float32);
    assert_true(collected.positions[0] == 500123.456);
    assert_true(collected.positions[1] == 5400987.654);
    assert_true(collected.positions[2] == (double)123.4f); /* enough for what is written */
    assert_true(collected.positions[3] == (double)0.1f);
    collected_free(&collected);
}

static void wrong_lines_are_refused_with_their_place(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        const char *fragments[3];
    } cases[] = {
        {"v 0 0\n", {"line 1", "vertex 0", "2 coordinates"}},
        {"v 0 0 0\n\nv 1 x 0\n", {"line 3", "vertex 1", "\"x\" is not a number"}},
        {"v 0 0 0\nv 0 inf 0\n", {"line 2", "vertex 1", "y is not finite"}},
        {"v 1 2 3 4 5 6 7 8 9\n", {"line 1", "vertex 0", "more than 8 numbers"}},
        {"v 0 0 0\nf 1 0 1\n", {"line 2", "face 0", "vertex 0"}},
        {"v 0 0 0\nf 1 1 1\nf 1 1 -2\n", {"line 3", "face 1", "vertex -2, but only 1"}},
        {"v 0 0 0\nf 1 1 4294967295\n", {"line 2", "face 0", "beyond the limit"}},
        {"v 0 0 0\nf 1 1 99999999999999999999\n", {"line 2", "face 0", "a corner is not"}},
        {"v 0 0 0\nf 1 1 1.5\n", {"line 2", "face 0", "a corner is not"}},
        {"v 0 0 0\nf 1 1 1/1/1/1\n", {"line 2", "face 0", "a corner is not"}},
        {"v 0 0 0\nf 1 1 /1\n", {"line 2", "face 0", "a corner is not"}},
        {"v 0 0 0\n\x01\x02\n", {"line 2", "not a statement", ""}},
        {"v 0 0 0\n\\ f\n", {"line 2", "not a statement", ""}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        assert_refused(read_text(cases[i].text), cases[i].fragments[0], cases[i].fragments[1],
                       cases[i].fragments[2], NULL);
    char *text = malloc(20000);
    assert_non_null(text);
    memset(text, '1', 20000);
    memcpy(text, "v ", 2);
    text[19999] = 0;
    assert_refused(read_text(text), "line 1", "a word of more than", NULL);
    memset(text + 2, ' ', 19990); /* but blanks may be many */
    memcpy(text + 19990, "1 2 3\n", 7);
    struct collected collected = read_text(text);
    assert_read(&collected);
    assert_int_equal(collected.vertex_count, 1);
    collected_free(&collected);
    free(text);
}

static void large_polygons_are_read(void **state)
{
    (void)state;
    enum { CORNERS = 100000 };
    char *text = malloc(CORNERS * 30), *at = text;
    assert_non_null(text);
    for (int i = 0; i < CORNERS; i++)
        at += sprintf(at, "v %d 0 0\n", i);
    at += sprintf(at, "f");
    for (int i = 0; i < CORNERS; i++)
        at += sprintf(at, " %d", i + 1);
    struct collected collected = collect(import_obj, text, (size_t)(at - text), FEED_PIECES);
    assert_read(&collected);
    assert_int_equal(collected.face_count, 1);
    assert_int_equal(collected.sizes[0], CORNERS);
    for (uint32_t i = 0; i < CORNERS; i++)
        assert_int_equal(collected.indices[i], i);
    collected_free(&collected);
    free(text);
}

static void any_truncation_ends_well(void **state)
{
    (void)state;
    static const char text[] =
        "# c\nv 0 0 0 1 0.5 0\nv 1 0 0 0 0 0\nv 0 1 \\\n0 1 1 1\nvt 1 2\ng a\n"
        "f 1/1/1 2//3 -1\nf 1 2 3 1\n";
    for (size_t cut = 0; cut < sizeof text - 1; cut++) {
        struct collected collected = collect(import_obj, text, cut, FEED_FILE);
        if (collected.status == STATUS_OK)
            collected_free(&collected);
        else
            assert_refused(collected, "line", NULL);
    }
}

static void pieces_of_any_size_make_no_difference(void **state)
{
    (void)state;
    struct shape shape = shape_noisy_torus(150, 100, 0.01, 3);
    assert_reads_shape(import_obj, &shape, SHAPE_OBJ, true);
    shape_free(&shape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(all_forms_of_corners_are_understood),
        cmocka_unit_test(layout_is_free),
        cmocka_unit_test(colours_become_attributes),
        cmocka_unit_test(what_is_dropped_is_said),
        cmocka_unit_test(large_coordinates_keep_their_digits),
        cmocka_unit_test(wrong_lines_are_refused_with_their_place),
        cmocka_unit_test(large_polygons_are_read),
        cmocka_unit_test(any_truncation_ends_well),
        cmocka_unit_test(pieces_of_any_size_make_no_difference),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
