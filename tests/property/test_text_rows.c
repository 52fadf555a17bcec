/*
 * Rows of an ASCII PLY are parsed in pieces by several threads where a line is a row, and one by
 * one where it is not. Random texts, some of them unusual in places, say the same whichever way
 * they are read, wherever the pieces begin, and whoever carries the bytes; and an error names its
 * line.
 */
#include "mesh/import.h"
#include "test_collect.h"
#include "test_kit.h"
#include "test_shapes.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    TEXTS = 24,
    VERTICES = 9000,
    FACES = 9000, /* more than are read by one thread */
    ROOM = 3 << 20,
    NOWHERE = -1
};

struct text_maker {
    uint64_t seed;
    char *text;
    size_t size;
    unsigned oddness; /* one row in so many is unusual; 0: none */
    bool is_tokens;   /* every token has a line of its own */
    bool has_colour, has_polygons, has_flags;
    int decimals;
    int wrong_vertex, wrong_face; /* NOWHERE: none */
    const char *wrong;            /* in place of the last token of that row */
    unsigned wrong_line;          /* where that came to stand */
};

static void put(struct text_maker *maker, const char *text)
{
    const size_t length = strlen(text);
    assert_true(maker->size + length < ROOM);
    memcpy(maker->text + maker->size, text, length);
    maker->size += length;
}

static unsigned line_of(const struct text_maker *maker)
{
    unsigned line = 1;
    for (size_t i = 0; i < maker->size; i++)
        line += maker->text[i] == '\n';
    return line;
}

/* What stands between tokens, and behind the last of a row. Draws alike in both layouts. */
static void put_gap(struct text_maker *maker, bool is_last, bool is_odd)
{
    static const char *const inside[] = {"  ", "\t", "\n", " \n\n", "\r\n"};
    static const char *const behind[] = {" ", "\r\n", " \n \n", "\t\n", "  "};
    const unsigned drawn = (unsigned)random_below(&maker->seed, 5);
    if (maker->is_tokens)
        put(maker, "\n");
    else if (is_odd)
        put(maker, is_last ? behind[drawn] : inside[drawn]);
    else
        put(maker, is_last ? drawn < 2 ? " \n" : "\n" : " ");
}

static void put_row(struct text_maker *maker, char tokens[][40], unsigned count, bool is_wrong)
{
    const bool is_odd = maker->oddness && random_below(&maker->seed, maker->oddness) == 0;
    for (unsigned i = 0; i < count; i++) {
        const bool is_last = i + 1 == count;
        if (is_last && is_wrong)
            maker->wrong_line = line_of(maker);
        put(maker, is_last && is_wrong ? maker->wrong : tokens[i]);
        put_gap(maker, is_last, is_odd);
    }
}

static void put_vertices(struct text_maker *maker)
{
    char tokens[6][40];
    for (int v = 0; v < VERTICES; v++) {
        const unsigned count = maker->has_colour ? 5 : 3;
        const int decimals = maker->decimals + (int)random_below(&maker->seed, 3);
        for (unsigned i = 0; i < 3; i++)
            snprintf(tokens[i], sizeof tokens[i], random_below(&maker->seed, 100) ? "%.*f" : "%.*e",
                     decimals, 200 * random_unit(&maker->seed) - 100);
        for (unsigned i = 3; i < count; i++)
            snprintf(tokens[i], sizeof tokens[i], "%u", (unsigned)random_below(&maker->seed, 256));
        put_row(maker, tokens, count, v == maker->wrong_vertex);
    }
}

static void put_faces(struct text_maker *maker)
{
    char tokens[10][40];
    for (int f = 0; f < FACES; f++) {
        unsigned count = 0, corners = 3;
        if (maker->has_polygons && random_below(&maker->seed, 50) == 0)
            corners = (unsigned)random_below(&maker->seed, 7);
        if (maker->has_flags)
            snprintf(tokens[count++], sizeof tokens[0], "%d", -1);
        snprintf(tokens[count++], sizeof tokens[0], "%u", corners);
        for (unsigned i = 0; i < corners; i++)
            snprintf(tokens[count++], sizeof tokens[0], "%u",
                     (unsigned)random_below(&maker->seed, VERTICES));
        put_row(maker, tokens, count, f == maker->wrong_face);
    }
}

/* `shift` bytes of comment move where the pieces begin. */
static void make_text(struct text_maker *maker, unsigned shift)
{
    char line[256];
    maker->size = 0;
    snprintf(line, sizeof line, "ply\nformat ascii 1.0\ncomment %.*s\nelement vertex %d\n",
             (int)shift, "----------------------------------------------------------------",
             VERTICES);
    put(maker, line);
    put(maker, "property float x\nproperty float y\nproperty float z\n");
    if (maker->has_colour)
        put(maker, "property uchar red\nproperty float32 quality\n");
    snprintf(line, sizeof line, "element face %d\n", FACES);
    put(maker, line);
    put(maker, maker->has_flags ? "property int flags\n" : "");
    put(maker, "property list uchar int vertex_indices\nend_header\n");
    put_vertices(maker);
    put_faces(maker);
}

static struct text_maker random_maker(uint64_t seed, char *room)
{
    static const unsigned oddness[] = {0, 3000, 40, 2};
    struct text_maker maker = {.seed = seed, .text = room};
    maker.oddness = oddness[seed % 4];
    maker.has_colour = random_below(&maker.seed, 2);
    maker.has_polygons = random_below(&maker.seed, 2);
    maker.has_flags = random_below(&maker.seed, 4) == 0;
    maker.decimals = 3 + (int)random_below(&maker.seed, 7);
    maker.wrong_vertex = maker.wrong_face = NOWHERE;
    return maker;
}

static void assert_same(struct collected one, struct collected other)
{
    assert_read(&one);
    assert_read(&other);
    assert_int_equal(one.vertex_count, other.vertex_count);
    assert_int_equal(one.face_count, other.face_count);
    assert_int_equal(one.index_count, other.index_count);
    assert_int_equal(one.is_float32, other.is_float32);
    assert_memory_equal(one.positions, other.positions, 3 * one.vertex_count * sizeof(double));
    if (one.attributes.stride)
        assert_memory_equal(one.records, other.records, one.vertex_count * one.attributes.stride);
    assert_memory_equal(one.sizes, other.sizes, one.face_count * sizeof(uint32_t));
    assert_memory_equal(one.indices, other.indices, one.index_count * sizeof(uint32_t));
    collected_free(&one);
    collected_free(&other);
}

/* A message behind the name of the input, which differs. */
static const char *behind_name(const char *message)
{
    const char *found = strstr(message, ": ");
    return found ? found : message;
}

static void rows_say_the_same_however_they_stand(void **state)
{
    (void)state;
    char *room = malloc(ROOM);
    assert_non_null(room);
    for (unsigned seed = 0; seed < TEXTS; seed++) {
        struct text_maker lines = random_maker(seed, room), tokens = lines;
        make_text(&lines, seed * 5 % 64);
        const enum feed file = seed / 4 % 2 ? FEED_GZIP : FEED_FILE;
        struct collected by_threads = collect(import_ply, room, lines.size, file);
        struct collected by_pipe = collect(import_ply, room, lines.size, FEED_PIECES);
        assert_int_equal(by_threads.vertex_count, VERTICES);
        tokens.is_tokens = true;
        make_text(&tokens, 0);
        struct collected by_tokens = collect(import_ply, room, tokens.size, file);
        assert_string_equal(by_tokens.messages, by_threads.messages);
        struct collected again = collect(import_ply, room, tokens.size, FEED_PIECES);
        assert_same(by_threads, by_tokens);
        assert_same(by_pipe, again);
    }
    free(room);
}

static void errors_name_their_line(void **state)
{
    (void)state;
    static const char *const wrongs[] = {"1x", "nan", "-", "99999999999999999999999"};
    char *room = malloc(ROOM);
    assert_non_null(room);
    for (unsigned seed = 0; seed < TEXTS; seed++) {
        struct text_maker maker = random_maker(seed, room);
        const bool in_face = seed / 4 % 2;
        const int row = (int)random_below(&maker.seed, VERTICES);
        maker.has_colour = false;
        maker.wrong = wrongs[seed / 8 % 2 + 2 * in_face];
        maker.wrong_face = in_face ? row : NOWHERE;
        maker.wrong_vertex = in_face ? NOWHERE : row;
        make_text(&maker, seed * 5 % 64);
        char line[40], item[40];
        snprintf(line, sizeof line, "input: line %u: ", maker.wrong_line);
        snprintf(item, sizeof item, in_face ? "face %d: " : "vertex %d: ", row);
        const enum feed file = seed % 2 ? FEED_GZIP : FEED_FILE;
        struct collected by_threads = collect(import_ply, room, maker.size, file);
        struct collected by_pipe = collect(import_ply, room, maker.size, FEED_PIECES);
        assert_int_equal(by_pipe.status, STATUS_BAD_INPUT);
        assert_string_equal(behind_name(by_pipe.error), behind_name(by_threads.error));
        collected_free(&by_pipe);
        assert_refused(by_threads, line, item, NULL);
    }
    free(room);
}

/* Cut off anywhere: what is there is counted, and a last line needs no end. */
static void texts_that_end_early_are_refused(void **state)
{
    (void)state;
    char *room = malloc(ROOM);
    assert_non_null(room);
    struct text_maker maker = random_maker(4, room);
    maker.has_flags = maker.has_polygons = false;
    make_text(&maker, 0);
    while (room[maker.size - 1] <= ' ')
        maker.size--;
    struct collected whole = collect(import_ply, room, maker.size, FEED_FILE);
    assert_read(&whole);
    assert_int_equal(whole.face_count, FACES);
    collected_free(&whole);
    for (size_t cut = 1; cut < maker.size / 2; cut = cut * 3 + 1) {
        size_t size = maker.size - cut;
        while (room[size - 1] > ' ') /* to the end of a token */
            size--;
        assert_refused(collect(import_ply, room, size, FEED_FILE), "ends within element", NULL);
    }
    free(room);
}

/* Texts that fill the shared window several times, with a row here and there that is no line. */
static void texts_may_be_long(void **state)
{
    (void)state;
    enum { ROWS = 90000, LINE = 48 };
    char *text = malloc((size_t)2 * ROWS * LINE + 1000), *at = text;
    assert_non_null(text);
    at += sprintf(at,
                  "ply\nformat ascii 1.0\nelement vertex %d\nproperty float x\nproperty float y\n"
                  "property float z\nelement face %d\nproperty list uchar int vertex_indices\n"
                  "end_header\n",
                  ROWS, ROWS);
    uint64_t seed = 5;
    for (int i = 0; i < ROWS; i++)
        at += sprintf(at, "%.5f %.3f%s%d.5\n", i * 0.37, i * -0.011,
                      random_below(&seed, 20000) ? " " : "\n", i);
    for (int i = 0; i < ROWS; i++)
        at += sprintf(at, "3 %d %d%s%d\n", i, (i + 7) % ROWS,
                      random_below(&seed, 20000) ? " " : " \n ", (i * 31 + 1) % ROWS);
    const size_t size = (size_t)(at - text);
    assert_true(size > 4 << 20);
    struct collected by_pipe = collect(import_ply, text, size, FEED_PIECES);
    struct collected by_file = collect(import_ply, text, size, FEED_FILE);
    assert_int_equal(by_file.vertex_count, ROWS);
    assert_int_equal(by_file.face_count, ROWS);
    for (int i = 0; i < ROWS; i++) {
        assert_int_equal(by_file.indices[3 * i], i);
        assert_true(by_file.positions[3 * i + 2] == i + 0.5);
    }
    assert_same(by_pipe, by_file);
    assert_same(collect(import_ply, text, size, FEED_GZIP),
                collect(import_ply, text, size, FEED_FILE));
    free(text);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rows_say_the_same_however_they_stand),
        cmocka_unit_test(errors_name_their_line),
        cmocka_unit_test(texts_that_end_early_are_refused),
        cmocka_unit_test(texts_may_be_long),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
