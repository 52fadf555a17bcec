/*
 * Faces and vertices in random order give the same store whatever the memory: read at once, looked
 * at by ids, put in order in memory or far from it; with all that is dropped on the way.
 */
#include "test_kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mesh/store.h"
#include "test_alike.h"
#include "test_files.h"
#include "test_shapes.h"

struct case_of {
    bool has_doubles, has_colours, has_dirt;
    bool is_far;     /* one part far away: the rough order is none */
    bool is_soup;    /* coincident vertices */
    bool has_strips; /* local in space, but too little: strips in random order */
    unsigned shift;
};

static void append(unsigned char **to, const void *bytes, size_t size)
{
    memcpy(*to, bytes, size);
    *to += size;
}

/* A PLY of the shape, whose vertices may have colours. */
static void write_ply(const struct shape *shape, const struct case_of *c, const char *path)
{
    const char *type = c->has_doubles ? "double" : "float";
    const size_t size = 1024 + shape->vertex_count * 27 + shape->face_count * 13;
    unsigned char *bytes = malloc(size), *at = bytes;
    assert_non_null(bytes);
    at += snprintf((char *)at, 1024,
                   "ply\nformat binary_little_endian 1.0\nelement vertex %zu\nproperty %s x\n"
                   "property %s y\nproperty %s z\n%selement face %zu\n"
                   "property list uchar int vertex_indices\nend_header\n",
                   shape->vertex_count, type, type, type,
                   c->has_colours ? "property uchar red\nproperty uchar green\n"
                                    "property uchar blue\n"
                                  : "",
                   shape->face_count);
    for (size_t v = 0; v < shape->vertex_count; v++) {
        const double *p = shape->positions + 3 * v;
        const float floats[3] = {(float)p[0], (float)p[1], (float)p[2]};
        const unsigned char colour[3] = {(unsigned char)v, (unsigned char)(v >> 8), 7};
        append(&at, c->has_doubles ? (const void *)p : floats, c->has_doubles ? 24 : 12);
        if (c->has_colours)
            append(&at, colour, sizeof colour);
    }
    const uint32_t *corners = shape->indices;
    for (size_t f = 0; f < shape->face_count; f++, corners += 3) {
        const unsigned char three = 3;
        append(&at, &three, 1);
        append(&at, corners, 12);
    }
    file_write(path, bytes, (size_t)(at - bytes));
    free(bytes);
}

/* Faces that repeat a vertex or another face, vertices that no face names. */
static void add_dirt(struct shape *shape)
{
    const uint32_t count = (uint32_t)shape->vertex_count;
    for (uint32_t i = 0; i < 300; i++) {
        const uint32_t *corners = shape->indices + 3 * (size_t)(31 * i);
        const uint32_t a = corners[0], b = corners[1], c = corners[2];
        shape_vertex(shape, 1000.0 + i, -1e6, 5);
        shape_triangle(shape, i, i, (i + 9) % count);
        shape_triangle(shape, c, a, b);
    }
    shape_vertex(shape, -0.0, 0.0, -0.0);
}

enum { STRIP = 600 }; /* faces: two rings of the torus */

static void shuffle_strips(struct shape *shape)
{
    const size_t count = shape->face_count / STRIP, size = STRIP * 3 * sizeof(uint32_t);
    uint32_t *spare = malloc(size);
    uint64_t seed = 9;
    assert_non_null(spare);
    for (size_t i = count; i > 1; i--) {
        uint32_t *one = shape->indices + (i - 1) * STRIP * 3;
        uint32_t *other = shape->indices + random_below(&seed, i) * STRIP * 3;
        memcpy(spare, one, size);
        memmove(one, other, size);
        memcpy(other, spare, size);
    }
    free(spare);
}

static struct shape make(const struct case_of *c)
{
    struct shape shape = shape_noisy_torus(150, 80, 0.01, 3);
    if (c->is_far) {
        struct shape other = shape_tetrahedron();
        shape_move(&other, 1, 1e5, 1e5, 1e5);
        shape_append(&shape, &other);
        shape_free(&other);
    }
    if (c->has_dirt)
        add_dirt(&shape);
    if (c->has_strips)
        shuffle_strips(&shape);
    else
        shape_shuffle(&shape, 5);
    return shape;
}

static void build(const char *input, const struct case_of *c, int run, unsigned char **bytes,
                  size_t *size, struct store_info *info)
{
    const char *output = test_path("o.store");
    struct context ctx;
    context_init(&ctx);
    ctx.threads = 1 + (unsigned)run % 3;
    struct import_options options = {.slab_shift = c->shift, .weld = c->is_soup};
    if (run == 1)
        ctx.memory_budget = 9 << 20;
    if (run > 1)
        options.working_memory = (uint64_t)1 << (24 - 2 * run);
    if (store_build(&ctx, &input, 1, output, &options, info) != STATUS_OK)
        fail_msg("run %d: %s", run, ctx.error);
    assert_int_equal(store_check(&ctx, output), STATUS_OK);
    *bytes = file_read(output, size);
    context_clear(&ctx);
}

static void memory_changes_no_byte(void **state)
{
    (void)state;
    static const struct case_of cases[] = {
        {.shift = 9},
        {.shift = 9, .has_doubles = true, .has_dirt = true},
        {.shift = 11, .has_colours = true, .has_dirt = true},
        {.shift = 9, .is_far = true},
        {.shift = 10, .is_soup = true, .has_dirt = true},
        {.shift = 10, .has_strips = true},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const struct case_of *c = &cases[i];
        struct shape shape = make(c);
        const char *input = test_path("o.ply");
        struct first_bytes first = {NULL, 0};
        write_ply(&shape, c, input);
        for (int run = 0; run < 6; run++) {
            struct store_info info;
            unsigned char *bytes;
            size_t size;
            build(input, c, run, &bytes, &size, &info);
            assert_int_equal(info.cleaning.hilbert_ordered, 1);
            assert_int_equal(info.cleaning.degenerate_faces, c->has_dirt ? 300 : 0);
            assert_int_equal(info.cleaning.duplicate_faces, c->has_dirt ? 300 : 0);
            assert_int_equal(info.cleaning.unreferenced_vertices, c->has_dirt ? 301 : 0);
            assert_int_equal(info.topology.vertices, 12000 + (c->is_far ? 4 : 0));
            first_bytes_compare(&first, bytes, size);
        }
        free(first.bytes);
        shape_free(&shape);
    }
}

/* Which of -0 and 0 the box has must not depend on which vertex is looked at first. */
static void the_box_has_no_minus_zero(void **state)
{
    (void)state;
    struct shape shape = shape_grid(120, 100);
    for (size_t v = 0; v < shape.vertex_count; v += 2)
        shape.positions[3 * v + 2] = -0.0;
    shape_shuffle(&shape, 8);
    const struct case_of c = {.shift = 9};
    const char *input = test_path("o.ply");
    write_ply(&shape, &c, input);
    for (int run = 0; run < 6; run++) {
        struct store_info info;
        unsigned char *bytes;
        size_t size;
        const double zero = 0;
        build(input, &c, run, &bytes, &size, &info);
        assert_memory_equal(&info.box_low[2], &zero, sizeof zero);
        assert_memory_equal(&info.box_high[2], &zero, sizeof zero);
        free(bytes);
    }
    shape_free(&shape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(memory_changes_no_byte),
        cmocka_unit_test(the_box_has_no_minus_zero),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
