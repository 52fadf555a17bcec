/* Which reader is chosen, and mesh_load. */
#include "base/memory.h"
#include "mesh/import.h"
#include "test_collect.h"
#include "test_facts.h"
#include "test_kit.h"
#include "test_files.h"
#include "test_gzip.h"
#include "test_shapes.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static enum mesh_format probe(const void *data, size_t size)
{
    struct context ctx;
    struct instream *stream;
    enum mesh_format format;
    context_init(&ctx);
    file_write(test_path("input"), data, size);
    assert_int_equal(instream_open(&ctx, test_path("input"), &stream), STATUS_OK);
    assert_int_equal(import_probe(&ctx, stream, &format), STATUS_OK);
    assert_int_equal(instream_position(stream), 0); /* nothing is taken */
    instream_close(&stream);
    context_clear(&ctx);
    return format;
}

static void formats_are_known_by_content(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        enum mesh_format format;
    } cases[] = {
        {"ply\nformat", FORMAT_PLY},
        {"ply\r\nformat", FORMAT_PLY},
        {"\xef\xbb\xbfply\n", FORMAT_PLY},
        {"\n\nply\n", FORMAT_PLY},
        {"plywood\n", FORMAT_UNKNOWN},
        {"OFF\n", FORMAT_OFF},
        {"OFF 3 1 0\n", FORMAT_OFF},
        {"OFF", FORMAT_OFF},
        {"# a\n#b\n\nCOFF\n", FORMAT_OFF},
        {"NOFF\n", FORMAT_OFF},
        {"CNOFF\n", FORMAT_OFF},
        {"STCNOFF\n", FORMAT_OFF},
        {"OFF BINARY\n", FORMAT_OFF},
        {"4nOFF\n", FORMAT_OFF},
        {"OFFICE\n", FORMAT_UNKNOWN},
        {"v 0 0 0\n", FORMAT_OBJ},
        {"# object\nmtllib a\n", FORMAT_OBJ},
        {"g\nv 0 0 0\n", FORMAT_OBJ},
        {"vn 0 0 1\n", FORMAT_OBJ},
        {"\tv\t0 0 0", FORMAT_OBJ},
        {"hello\n", FORMAT_UNKNOWN},
        {"vertex 0 0 0\n", FORMAT_UNKNOWN},
        {"solid a\nfacet normal 0 0 1\n", FORMAT_STL},
        {"solid\n\n  endsolid\n", FORMAT_STL},
        {"solid a", FORMAT_STL},
        {"", FORMAT_UNKNOWN},
        {"\n\n# only a comment\n", FORMAT_UNKNOWN},
        {"spbmMSH1xxxx", FORMAT_STORE},
        {"spbmCHN1xxxx", FORMAT_UNKNOWN},
        {"<html><body>not here</body></html>\n", FORMAT_UNKNOWN},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        if (probe(cases[i].text, strlen(cases[i].text)) != cases[i].format)
            fail_msg("\"%s\" is not known as format %d", cases[i].text, (int)cases[i].format);
}

static void long_comments_come_before_anything(void **state)
{
    (void)state;
    enum { SIZE = 500000 };
    char *text = malloc(SIZE + 64);
    assert_non_null(text);
    for (size_t i = 0; i < SIZE; i++)
        text[i] = i % 70 == 69 ? '\n' : i % 70 == 0 ? '#' : 'x';
    strcpy(text + SIZE / 70 * 70, "COFF\n");
    assert_int_equal(probe(text, strlen(text)), FORMAT_OFF);
    strcpy(text + SIZE / 70 * 70, "v 0 0 0\n");
    assert_int_equal(probe(text, strlen(text)), FORMAT_OBJ);
    free(text);
}

static void noise_is_no_mesh(void **state)
{
    (void)state;
    uint64_t seed = 5;
    unsigned char data[6000];
    for (int round = 0; round < 200; round++) {
        size_t size = 200 + random_below(&seed, sizeof data - 200);
        for (size_t i = 0; i < size; i++)
            data[i] = (unsigned char)random_next(&seed);
        assert_int_equal(probe(data, size), FORMAT_UNKNOWN);
    }
    memset(data, 0, sizeof data);
    assert_int_equal(probe(data, sizeof data), FORMAT_UNKNOWN);
}

static void what_is_no_mesh_is_refused_in_words(void **state)
{
    (void)state;
    assert_refused(collect(import_read, "", 0, FEED_FILE), "the file is empty", NULL);
    assert_refused(collect_text(import_read, "hello"), "not a mesh in PLY, OBJ, STL or OFF", NULL);
    assert_refused(collect_text(import_read, "spbmMSH1"), "is a mesh store already", NULL);
    assert_refused(collect_text(import_read, "spbmCHN1"), "is a chain file", NULL);
}

/* ---- mesh_load ---- */

static void load(struct context *ctx, const char *path, struct mesh *mesh)
{
    if (mesh_load(ctx, path, mesh) != STATUS_OK)
        fail_msg("%s", ctx->error);
}

static void every_format_gives_the_same_mesh(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh expected, mesh;
    context_init(&ctx);
    struct shape shape = shape_torus(24, 16);
    shape_to_mesh(&ctx, &shape, &expected);
    struct facts facts = facts_of(&expected);
    for (int format = SHAPE_PLY_ASCII; format <= SHAPE_STL_ASCII; format++) {
        shape_write(&shape, (enum shape_format)format, test_path("mesh"));
        load(&ctx, test_path("mesh"), &mesh);
        assert_true(mesh.is_float32);
        assert_int_equal(mesh.vertex_count, expected.vertex_count);
        assert_int_equal(mesh.face_count, expected.face_count);
        struct facts loaded = facts_of(&mesh);
        assert_true(facts_manifold(&loaded) && facts_same_topology(&facts, &loaded));
        if (format < SHAPE_STL_BINARY) {
            assert_memory_equal(mesh.positions, expected.positions,
                                3 * mesh.vertex_count * sizeof(double));
            assert_memory_equal(mesh.faces, expected.faces, 3 * mesh.face_count * sizeof(uint32_t));
        }
        /* Numbered otherwise in an STL, but each face has the same corners. */
        for (size_t i = 0; i < 3 * mesh.face_count; i++)
            assert_memory_equal(mesh.positions + 3 * (size_t)mesh.faces[i],
                                expected.positions + 3 * (size_t)expected.faces[i],
                                3 * sizeof(double));
        mesh_clear(&ctx, &mesh);
    }
    mesh_clear(&ctx, &expected);
    assert_int_equal(ctx.memory_now, 0);
    shape_free(&shape);
    context_clear(&ctx);
}

static void polygons_are_triangulated_well(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh;
    context_init(&ctx);
    struct shape shape = shape_cube_quads();
    shape_write(&shape, SHAPE_OFF, test_path("cube"));
    load(&ctx, test_path("cube"), &mesh);
    struct facts facts = facts_of(&mesh);
    assert_true(facts_manifold(&facts));
    assert_int_equal(mesh.face_count, 12);
    assert_true(mesh_volume(&mesh) == 1);
    mesh_clear(&ctx, &mesh);
    shape_free(&shape);

    shape = shape_comb(200); /* a fan would have twice its area and more */
    double area = 0;
    for (size_t i = 0, n = shape.vertex_count; i < n; i++) {
        const double *p = shape.positions + 3 * i, *q = shape.positions + 3 * ((i + 1) % n);
        area += (p[0] * q[1] - p[1] * q[0]) / 2;
    }
    shape_write(&shape, SHAPE_OBJ, test_path("comb"));
    load(&ctx, test_path("comb"), &mesh);
    facts = facts_of(&mesh);
    assert_true(facts_manifold(&facts));
    assert_int_equal(facts.border_edges, shape.vertex_count);
    double difference = mesh_area(&mesh) - area;
    assert_true(difference < 1e-6 * area && difference > -1e-6 * area);
    mesh_clear(&ctx, &mesh);
    shape_free(&shape);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void gzip_and_doubles_load_too(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh;
    context_init(&ctx);
    struct shape shape = shape_noisy_sphere(3, 0.01, 1);
    shape_move(&shape, 10, 500000, 5400000, 300);
    for (int format = SHAPE_PLY_ASCII; format <= SHAPE_OFF; format++) {
        size_t size;
        unsigned char *data = shape_encode(&shape, (enum shape_format)format, &size);
        gzip_write(test_path("mesh.gz"), data, size);
        free(data);
        load(&ctx, test_path("mesh.gz"), &mesh);
        assert_false(mesh.is_float32);
        assert_memory_equal(mesh.positions, shape.positions,
                            3 * shape.vertex_count * sizeof(double));
        mesh_clear(&ctx, &mesh);
    }
    shape_free(&shape);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void wrong_indices_are_refused(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh;
    context_init(&ctx);
    static const char text[] = "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1 3\n";
    file_write(test_path("bad.off"), text, sizeof text - 1);
    assert_int_equal(mesh_load(&ctx, test_path("bad.off"), &mesh), STATUS_BAD_INPUT);
    assert_non_null(strstr(ctx.error, "bad.off"));
    assert_non_null(strstr(ctx.error, "face 1"));
    assert_non_null(strstr(ctx.error, "vertex 3"));
    assert_null(mesh.positions);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void corners_of_an_stl_are_welded_exactly(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh;
    context_init(&ctx);
    /* 0 and -0 are the same place; the next float is not. */
    static const char text[] =
        "solid a\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 "
        "0\nendloop\n"
        "endfacet\nfacet normal 0 0 0\nouter loop\nvertex -0 0 -0\nvertex 0 1 0\nvertex 0 0 1\n"
        "endloop\nendfacet\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 0 0 1\n"
        "vertex 1.00000012 0 0\nendloop\nendfacet\nendsolid a\n";
    file_write(test_path("a.stl"), text, sizeof text - 1);
    load(&ctx, test_path("a.stl"), &mesh);
    static const uint32_t faces[9] = {0, 1, 2, 0, 2, 3, 0, 3, 4};
    assert_int_equal(mesh.vertex_count, 5);
    assert_int_equal(mesh.face_count, 3);
    assert_memory_equal(mesh.faces, faces, sizeof faces);
    mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

/* Every allocation and system call failing in turn ends in words and leaves nothing. */
static void any_fault_is_survived(void **state)
{
    (void)state;
    struct shape shape = shape_cube_quads();
    static const enum shape_format formats[] = {SHAPE_PLY_ASCII, SHAPE_PLY_LITTLE, SHAPE_OBJ,
                                                SHAPE_OFF,       SHAPE_STL_BINARY, SHAPE_STL_ASCII};
    for (size_t i = 0; i < sizeof formats / sizeof *formats; i++) {
        shape_write(&shape, formats[i], test_path("mesh"));
        for (uint64_t after = 0;; after++) {
            struct context ctx;
            struct mesh mesh;
            context_init(&ctx);
            atomic_store(&ctx.fault_after, after);
            enum status status = mesh_load(&ctx, test_path("mesh"), &mesh);
            bool is_done = status == STATUS_OK;
            if (!is_done)
                assert_true(ctx.error[0] != 0);
            mesh_clear(&ctx, &mesh);
            assert_int_equal(ctx.memory_now, 0);
            context_clear(&ctx);
            if (is_done) {
                assert_true(after > 8);
                break;
            }
        }
    }
    shape_free(&shape);
}

/* What the files of the data folder are known to hold. */
static void real_files_have_their_counts(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        size_t vertices, faces;
        long euler;
    } files[] = {{"cube_poly.off", 8, 12, 2},           {"double-torus-example.off", 231, 466, -2},
                 {"fandisk.off.gz", 6475, 12946, 2},    {"femur.off", 3897, 7798, -2},
                 {"skull.obj.gz", 49999, 100002, -2},   {"cad_42400.stl", 5500, 11036, -18},
                 {"cad_gears.stl.gz", 9723, 19426, 10}, {"koala.obj.gz", 49999, 99994, 2}};
    size_t found = 0;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        const char *path = test_data(files[i].name);
        struct context ctx;
        struct mesh mesh;
        if (!path)
            continue;
        found++;
        context_init(&ctx);
        load(&ctx, path, &mesh);
        struct facts facts = facts_of(&mesh);
        assert_int_equal(mesh.vertex_count, files[i].vertices);
        assert_int_equal(mesh.face_count, files[i].faces);
        assert_int_equal(facts.euler, files[i].euler);
        mesh_clear(&ctx, &mesh);
        context_clear(&ctx);
    }
    if (found == 0)
        skip();
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(formats_are_known_by_content),
        cmocka_unit_test(long_comments_come_before_anything),
        cmocka_unit_test(noise_is_no_mesh),
        cmocka_unit_test(what_is_no_mesh_is_refused_in_words),
        cmocka_unit_test(every_format_gives_the_same_mesh),
        cmocka_unit_test(polygons_are_triangulated_well),
        cmocka_unit_test(gzip_and_doubles_load_too),
        cmocka_unit_test(wrong_indices_are_refused),
        cmocka_unit_test(corners_of_an_stl_are_welded_exactly),
        cmocka_unit_test(any_fault_is_survived),
        cmocka_unit_test(real_files_have_their_counts),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
