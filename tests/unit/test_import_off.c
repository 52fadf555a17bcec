/* The OFF reader. */
#include "mesh/import.h"
#include "test_collect.h"
#include "test_kit.h"
#include "test_shapes.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct collected read_text(const char *text)
{
    return collect_text(import_off, text);
}

static void assert_square(struct collected collected)
{
    static const double positions[12] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};
    static const uint32_t indices[7] = {0, 1, 2, 3, 0, 1, 2};
    assert_read(&collected);
    assert_int_equal(collected.vertex_count, 4);
    assert_memory_equal(collected.positions, positions, sizeof positions);
    assert_int_equal(collected.face_count, 2);
    assert_int_equal(collected.sizes[0], 4);
    assert_int_equal(collected.sizes[1], 3);
    assert_memory_equal(collected.indices, indices, sizeof indices);
    assert_true(collected.is_float32);
    collected_free(&collected);
}

static void layout_is_free(void **state)
{
    (void)state;
    static const char *const texts[] = {
        "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n3 0 1 2\n",
        "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n3 0 1 2",
        "OFF 4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n3 0 1 2\n",
        "OFF 4 2\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n3 0 1 2\n",
        "OFF\n4 2\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n3 0 1 2\n",
        "\xef\xbb\xbf\r\nOFF\r\n4 2 0\r\n0 0 0\r\n1 0 0\r\n1 1 0\r\n0 1 0\r\n4 0 1 2 3\r\n"
        "3 0 1 2\r\n",
        "# made by\n\n#x\nOFF # type\n# counts\n4 2 0 # v f e\n\n# vertices\n0 0 0 # first\n\n1 0 "
        "0\n"
        "1 1 0\n#\n0 1 0\n# faces\n 4  0 1 2 3 # one\n\n3 0 1 2 #two\n\n",
    };
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++)
        for (int feed = FEED_FILE; feed <= FEED_BYTES; feed++)
            assert_square(collect(import_off, texts[i], strlen(texts[i]), (enum feed)feed));
}

static void words_may_go_on_in_the_next_line(void **state)
{
    (void)state;
    assert_square(read_text("OFF\n4\n2 0\n0\n0\n0\n1 0\n0\n1 1 0\n0 1 0\n4 0 1\n2 3\n3\n0 1 2\n"));
}

static void colours_become_attributes(void **state)
{
    (void)state;
    struct collected collected =
        read_text("COFF\n3 1 0\n0 0 0 255 0 1\n1 0 0 2 3 4\n0 1 0 9 8 7\n3 0 1 2\n");
    static const unsigned char bytes[9] = {255, 0, 1, 2, 3, 4, 9, 8, 7};
    assert_read(&collected);
    assert_int_equal(collected.attributes.count, 3);
    assert_memory_equal(collected.records, bytes, sizeof bytes);
    collected_free(&collected);

    collected = read_text("COFF\n2 0 0\n0 0 0 1.0 0 0.5 1\n1 0 0 1 1 0 0\n");
    static const unsigned char unit[8] = {255, 0, 128, 255, 255, 255, 0, 0};
    assert_read(&collected);
    assert_int_equal(collected.attributes.count, 4);
    assert_string_equal(collected.attributes.list[3].name, "alpha");
    assert_memory_equal(collected.records, unit, sizeof unit);
    collected_free(&collected);

    collected = read_text("COFF\n2 0 0\n0 0 0 10 20 30 40\n1 0 0 50 60 70\n");
    static const unsigned char mixed[8] = {10, 20, 30, 40, 50, 60, 70, 255};
    assert_read(&collected);
    assert_memory_equal(collected.records, mixed, sizeof mixed);
    collected_free(&collected);

    assert_refused(read_text("COFF\n2 0 0\n0 0 0 1 0 0\n1 0 0\n"), "line 4", "vertex 1",
                   "the colour is missing", NULL);
    assert_refused(read_text("COFF\n1 0 0\n0 0 0 1 0 300\n"), "line 3", "vertex 0", "300", NULL);
}

static void other_things_of_vertices_are_dropped_and_said(void **state)
{
    (void)state;
    struct collected collected =
        read_text("NOFF\n3 1 0\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n3 0 1 2\n");
    assert_read(&collected);
    assert_int_equal(collected.attributes.count, 0);
    assert_true(collected.positions[3] == 1 && collected.positions[5] == 0);
    assert_non_null(strstr(collected.messages, "dropped: normals of the vertices"));
    collected_free(&collected);

    static const char *const keywords[] = {"CNOFF", "STCNOFF"};
    for (unsigned i = 0; i < 2; i++) {
        char text[256];
        snprintf(text, sizeof text, "%s\n1 0 0\n7 8 9 0 0 1 40 50 60%s\n", keywords[i],
                 i ? " 0.5 0.5" : "");
        collected = read_text(text);
        static const unsigned char colour[3] = {40, 50, 60};
        assert_read(&collected);
        assert_int_equal(collected.attributes.count, 3);
        assert_memory_equal(collected.records, colour, 3);
        collected_free(&collected);
    }
    collected = read_text("STOFF\n1 0 0\n7 8 9 0.5 0.5\n");
    assert_read(&collected);
    assert_non_null(strstr(collected.messages, "dropped: texture coordinates"));
    collected_free(&collected);

    collected = read_text("OFF\n3 1 0\n0 0 0 9\n1 0 0\n0 1 0\n3 0 1 2 255 0 0\n");
    assert_read(&collected);
    assert_int_equal(collected.face_count, 1);
    assert_non_null(strstr(collected.messages, "numbers behind the positions"));
    assert_non_null(strstr(collected.messages, "dropped: colours of the faces"));
    collected_free(&collected);

    collected = read_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n9 9 9\n");
    assert_read(&collected);
    assert_non_null(strstr(collected.messages, "what follows the last face"));
    collected_free(&collected);
}

static void wrong_files_are_refused_with_their_place(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        const char *fragments[3];
    } cases[] = {
        {"OOF\n", {"line 1", "does not begin with \"OFF\"", ""}},
        {"OFFX\n", {"line 1", "does not begin with \"OFF\"", ""}},
        {"4OFF\n1 0 0\n0 0 0 0\n", {"line 1", "three dimensions", ""}},
        {"nOFF 3\n1 0 0\n0 0 0\n", {"line 1", "three dimensions", ""}},
        {"OFF BINARY\n1234", {"line 1", "binary OFF", ""}},
        {"OFF\n", {"before the number of vertices", "", ""}},
        {"OFF\n4\n", {"before the number of faces", "", ""}},
        {"OFF\n4 x\n", {"line 2", "\"x\" is not an integer", ""}},
        {"OFF\n-4 2 0\n", {"line 2", "number of vertices is negative", ""}},
        {"OFF\n4294967295 2 0\n", {"line 2", "4294967294", ""}},
        {"OFF\n2 1 0\n0 0 0\n1 0 o\n", {"line 4", "vertex 1", "\"o\" is not a number"}},
        {"OFF\n2 1 0\n0 0 0\n1 0 nan\n", {"line 4", "vertex 1", "z is not finite"}},
        {"OFF\n2 1 0\nnan 0 0\n1 0 0\n", {"line 3", "vertex 0", "x is not finite"}},
        {"OFF\n2 1 0\n0 0 0\n", {"ends within the vertices", "1 of 2", ""}},
        {"OFF\n2 1 0\n", {"ends within the vertices", "0 of 2", ""}},
        {"OFF\n1 2 0\n0 0 0\n3 0 0 0\n", {"ends within the faces", "1 of 2", ""}},
        {"OFF\n1 2 0\n0 0 0\n3 0 0 0\n3 0 0\n", {"ends within the faces", "1 of 2", ""}},
        {"OFF\n1 1 0\n0 0 0\n3 0 0 -1\n", {"line 4", "face 0", "\"-1\" is not an index"}},
        {"OFF\n1 1 0\n0 0 0\n3 0 0 4294967296\n", {"line 4", "face 0", "is not an index"}},
        {"OFF\n1 1 0\n0 0 0\n3.0 0 0 0\n", {"line 4", "face 0", "\"3.0\" is not an index"}},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        assert_refused(read_text(cases[i].text), cases[i].fragments[0], cases[i].fragments[1],
                       cases[i].fragments[2], NULL);
}

static void empty_meshes_and_short_faces_pass(void **state)
{
    (void)state;
    struct collected collected = read_text("OFF\n0 0 0\n");
    assert_read(&collected);
    assert_int_equal(collected.vertex_count + collected.face_count, 0);
    collected_free(&collected);
    collected = read_text("OFF\n3 4 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n3 0 1 2\n1 0\n0\n");
    assert_read(&collected);
    assert_int_equal(collected.face_count, 1);
    assert_non_null(strstr(collected.messages, "3 faces of fewer than 3 corners"));
    collected_free(&collected);
}

static void any_truncation_ends_well(void **state)
{
    (void)state;
    static const char text[] = "COFF\n4 2 0\n0 0 0 1 2 3\n1 0 0 4 5 6 7\n1 1 0 8 9 10\n"
                               "0 1 0 1 1 1\n4 0 1 2 3 1.0 0\n3 0 1 2\n";
    for (size_t cut = 0; cut < sizeof text - 1; cut++) {
        struct collected collected = collect(import_off, text, cut, FEED_FILE);
        if (cut + 2 >= sizeof text - 1 && collected.status == STATUS_OK)
            collected_free(&collected);
        else
            assert_refused(collected, NULL);
    }
}

static void pieces_of_any_size_make_no_difference(void **state)
{
    (void)state;
    struct shape shape = shape_noisy_torus(150, 100, 0.01, 3);
    shape_move(&shape, 1, 500000, 5400000, 0); /* doubles */
    assert_reads_shape(import_off, &shape, SHAPE_OFF, false);
    shape_free(&shape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(layout_is_free),
        cmocka_unit_test(words_may_go_on_in_the_next_line),
        cmocka_unit_test(colours_become_attributes),
        cmocka_unit_test(other_things_of_vertices_are_dropped_and_said),
        cmocka_unit_test(wrong_files_are_refused_with_their_place),
        cmocka_unit_test(empty_meshes_and_short_faces_pass),
        cmocka_unit_test(any_truncation_ends_well),
        cmocka_unit_test(pieces_of_any_size_make_no_difference),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
