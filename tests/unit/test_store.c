/*
 * store_build and the readers on meshes whose outcome is known beforehand: what is closed stays
 * closed, what is refused is refused with words, coordinates and attributes keep their bits.
 */
#include "test_kit.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mesh/store.h"
#include "test_alike.h"
#include "test_facts.h"
#include "test_files.h"
#include "test_shapes.h"

static void note(void *user, enum message_level level, const char *text)
{
    (void)level;
    char *notes = user;
    strncat(notes, text, 4000 - strlen(notes));
}

struct built {
    struct store_info info;
    struct mesh mesh;
    char notes[4096];
};

static void build_files(const char *const *paths, size_t count, struct import_options options,
                        struct built *b)
{
    const char *output = test_path("a.store");
    struct context ctx;
    context_init(&ctx);
    memset(b, 0, sizeof *b);
    ctx.message = note;
    ctx.user = b->notes;
    if (store_build(&ctx, paths, count, output, &options, &b->info) != STATUS_OK)
        fail_msg("%s", ctx.error);
    if (store_check(&ctx, output) != STATUS_OK)
        fail_msg("%s", ctx.error);
    struct store *store;
    assert_int_equal(store_open(&ctx, output, true, &store), STATUS_OK);
    assert_int_equal(store_load(store, &b->mesh), STATUS_OK);
    store_close(&store);
    context_clear(&ctx);
}

static void build_shape(struct shape shape, struct import_options options, struct built *b)
{
    const char *path = test_path("a.ply");
    shape_write(&shape, SHAPE_PLY_LITTLE, path);
    shape_free(&shape);
    build_files(&path, 1, options, b);
}

static void built_free(struct built *b)
{
    struct context ctx;
    context_init(&ctx);
    ctx.memory_now = UINT64_MAX / 2;
    mesh_clear(&ctx, &b->mesh);
    context_clear(&ctx);
}

static void refuse(const char *path, enum status wanted, const char *words)
{
    const char *output = test_path("refused.store");
    struct context ctx;
    context_init(&ctx);
    struct import_options options = {0};
    enum status status = store_build(&ctx, &path, 1, output, &options, NULL);
    assert_int_equal(status, wanted);
    if (!strstr(ctx.error, words))
        fail_msg("'%s' is not in '%s'", words, ctx.error);
    size_t size;
    assert_null(file_read(output, &size));
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void refuse_text(const char *text, const char *words)
{
    const char *path = test_path("bad");
    file_write(path, text, strlen(text));
    refuse(path, STATUS_BAD_INPUT, words);
}

/* ---- topology ---- */

static struct shape cube_at(double x, double y, double z)
{
    struct shape cube = shape_cube_quads();
    double low[3] = {INFINITY, INFINITY, INFINITY};
    for (size_t i = 0; i < 3 * cube.vertex_count; i++)
        low[i % 3] = fmin(low[i % 3], cube.positions[i]);
    double high = -INFINITY;
    for (size_t i = 0; i < 3 * cube.vertex_count; i++)
        high = fmax(high, cube.positions[i] - low[i % 3]);
    double at[3] = {x, y, z};
    for (size_t i = 0; i < 3 * cube.vertex_count; i++)
        cube.positions[i] = at[i % 3] + (cube.positions[i] - low[i % 3]) / high;
    return cube;
}

/* Two unit cubes that share what their positions share. */
static void check_two_cubes(double x, double y, double z, uint64_t edges, uint64_t vertices)
{
    struct shape cubes = cube_at(0, 0, 0), other = cube_at(x, y, z);
    struct built b;
    shape_append(&cubes, &other);
    shape_free(&other);
    shape_fan(&cubes);
    build_shape(cubes, (struct import_options){.weld = true, .slab_shift = 3}, &b);
    assert_int_equal(b.info.cleaning.nonmanifold_edges, edges);
    assert_int_equal(b.info.cleaning.nonmanifold_vertices, vertices);
    assert_int_equal(b.info.cleaning.vertices_added, vertices);
    assert_int_equal(b.info.topology.vertices, 16);
    assert_int_equal(b.info.topology.components, 2);
    assert_int_equal(b.info.topology.border_edges, 0);
    assert_int_equal(b.info.topology.euler, 4);
    assert_int_equal(b.info.topology.floor, 8);
    assert_true(fabs(mesh_volume(&b.mesh)) == 2);
    built_free(&b);
}

static void cubes_that_touch_stay_closed(void **state)
{
    (void)state;
    check_two_cubes(1, 1, 0, 1, 2); /* in an edge */
    check_two_cubes(1, 1, 1, 0, 1); /* in a vertex */
    check_two_cubes(2, 0, 0, 0, 0);
}

static void touching_spheres_stay_closed(void **state)
{
    (void)state;
    struct built b;
    build_shape(shape_spheres_touching_edge(3), (struct import_options){.slab_shift = 5}, &b);
    assert_int_equal(b.info.cleaning.nonmanifold_edges, 1);
    assert_int_equal(b.info.topology.border_edges, 0);
    assert_int_equal(b.info.topology.components, 2);
    built_free(&b);
    build_shape(shape_spheres_touching_vertex(3), (struct import_options){.slab_shift = 5}, &b);
    assert_int_equal(b.info.cleaning.nonmanifold_vertices, 1);
    assert_int_equal(b.info.topology.border_edges, 0);
    assert_int_equal(b.info.topology.components, 2);
    built_free(&b);
}

/* A strip is cut once across, which leaves a disk; a Klein bottle becomes a tube. */
static void surfaces_that_are_not_orientable_are_cut(void **state)
{
    (void)state;
    struct built b;
    for (unsigned shift = 3; shift <= 18; shift += 5) {
        build_shape(shape_mobius(40, 5), (struct import_options){.slab_shift = shift}, &b);
        assert_int_equal(b.info.cleaning.nonorientable_components, 1);
        assert_int_equal(b.info.cleaning.cut_edges, 5);
        assert_int_equal(b.info.cleaning.vertices_added, 6);
        assert_int_equal(b.info.topology.euler, 1);
        assert_int_equal(b.info.topology.border_loops, 1);
        assert_non_null(strstr(b.notes, "not orientable"));
        built_free(&b);
        build_shape(shape_klein_bottle(20, 9), (struct import_options){.slab_shift = shift}, &b);
        assert_int_equal(b.info.cleaning.nonorientable_components, 1);
        assert_true(b.info.cleaning.cut_edges >= 9);
        assert_int_equal(b.info.cleaning.cut_edges, b.info.cleaning.vertices_added);
        assert_int_equal(b.info.topology.border_edges, 2 * b.info.cleaning.cut_edges);
        assert_int_equal(b.info.topology.euler, 0);
        built_free(&b);
    }
}

static void the_majority_of_a_component_is_right(void **state)
{
    (void)state;
    struct shape shape = shape_icosphere(3), small = shape_icosphere(1);
    for (size_t i = 0; i < small.vertex_count; i++)
        small.positions[3 * i] += 4;
    const double whole = 2 * 3.9;
    shape_append(&shape, &small);
    shape_free(&small);
    for (size_t f = 0; f < 1280; f += 3)
        shape_flip(&shape, f);
    for (size_t f = 1280; f < 1280 + 60; f++)
        shape_flip(&shape, f);
    struct built b;
    build_shape(shape, (struct import_options){.slab_shift = 6}, &b);
    assert_int_equal(b.info.cleaning.flipped_faces, 427 + 20);
    /* The first shows its outside, the second (60 of 80 were turned) its inside. */
    assert_true(mesh_volume(&b.mesh) > 0.3 && mesh_volume(&b.mesh) < whole / 2);
    struct facts facts = facts_of(&b.mesh);
    assert_true(facts_manifold(&facts));
    built_free(&b);
}

static void floors_of_known_surfaces(void **state)
{
    (void)state;
    const struct {
        struct shape shape;
        uint64_t floor;
    } cases[] = {
        {shape_single_triangle(), 1}, {shape_grid(5, 4), 1},   {shape_icosphere(2), 4},
        {shape_torus(9, 8), 14},      {shape_mobius(9, 2), 1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct built b;
        build_shape(cases[i].shape, (struct import_options){0}, &b);
        assert_int_equal(b.info.topology.floor, cases[i].floor);
        built_free(&b);
    }
    /* A ring, seven faces wide: an annulus. */
    struct shape ring = {0};
    for (unsigned i = 0; i < 9; i++) {
        shape_vertex(&ring, i, 0, 0);
        shape_vertex(&ring, i, 1, 0);
    }
    for (uint32_t i = 0; i < 9; i++)
        shape_quad(&ring, 2 * i, (2 * i + 2) % 18, (2 * i + 3) % 18, 2 * i + 1);
    struct built b;
    build_shape(ring, (struct import_options){0}, &b);
    assert_int_equal(b.info.topology.border_loops, 2);
    assert_int_equal(b.info.topology.floor, 6);
    built_free(&b);
}

/* ---- inputs ---- */

static void bad_inputs_are_refused(void **state)
{
    (void)state;
    refuse_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "names vertex 3");
    refuse_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 1\n", "has no faces but degenerate ones");
    refuse_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "has no faces");
    refuse_text("", "");
    refuse(test_path("does not exist"), STATUS_IO, "does not exist");
}

static void an_input_is_not_its_own_output(void **state)
{
    (void)state;
    const char *path = test_path("same.ply");
    struct shape shape = shape_tetrahedron();
    shape_write(&shape, SHAPE_PLY_LITTLE, path);
    shape_free(&shape);
    struct context ctx;
    context_init(&ctx);
    struct import_options options = {0};
    assert_int_equal(store_build(&ctx, &path, 1, path, &options, NULL), STATUS_MISUSE);
    size_t size;
    unsigned char *bytes = file_read(path, &size);
    assert_true(size > 100 && memcmp(bytes, "ply", 3) == 0);
    free(bytes);
    context_clear(&ctx);
}

/* OBJ: a face may name vertices that come later, and a polygon too. */
static void faces_may_come_before_their_vertices(void **state)
{
    (void)state;
    const char *text = "v 0 0 0\nf 1 2 3\nf 1 3 4 5\nv 1 0 0\nv 0 1 0\nv -1 1 0\nv -1 0 0\n";
    const char *path = test_path("a.obj");
    struct built b;
    file_write(path, text, strlen(text));
    build_files(&path, 1, (struct import_options){0}, &b);
    assert_int_equal(b.info.topology.vertices, 5);
    assert_int_equal(b.info.topology.faces, 3);
    assert_int_equal(b.info.cleaning.input_faces, 2);
    assert_int_equal(b.info.cleaning.triangulated_faces, 2);
    built_free(&b);
}

static void several_inputs_are_one_mesh(void **state)
{
    (void)state;
    const char *first = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float "
                        "y\nproperty float z\nproperty uchar red\nproperty float quality\nelement "
                        "face 1\nproperty list uchar int vertex_indices\nend_header\n"
                        "0 0 0 10 0.5\n1 0 0 11 1.5\n0 1 0 12 2.5\n3 0 1 2\n";
    const char *second =
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float "
        "y\nproperty float z\nproperty int red\nproperty double extra\nproperty "
        "float quality\nelement face 1\nproperty list uchar int "
        "vertex_indices\nend_header\n"
        "5 0 0 1 9 7.5\n6 0 0 2 9 8.5\n5 1 0 3 9 9.5\n3 0 1 2\n";
    const char *paths[2] = {test_path("1.ply"), test_path("2.ply")};
    struct built b;
    file_write(paths[0], first, strlen(first));
    file_write(paths[1], second, strlen(second));
    build_files(paths, 2, (struct import_options){0}, &b);
    assert_int_equal(b.info.topology.vertices, 6);
    assert_int_equal(b.info.topology.components, 2);
    assert_int_equal(b.info.attributes.count, 1); /* red has two types, extra is in one */
    assert_string_equal(b.info.attributes.list[0].name, "quality");
    assert_int_equal(b.info.attributes.stride, 4);
    for (int v = 0; v < 6; v++) {
        float quality;
        memcpy(&quality, b.mesh.records + 4 * v, 4);
        assert_true(quality == (v < 3 ? 0.5f + (float)v : 4.5f + (float)v));
    }
    assert_non_null(strstr(b.notes, "'red'"));
    assert_non_null(strstr(b.notes, "'extra'"));
    assert_string_equal(b.info.input_name, "1.ply");
    built_free(&b);
}

/* Vertices are renumbered and copied; their attributes go with them. */
static void attributes_follow_their_vertices(void **state)
{
    (void)state;
    struct shape shape = shape_spheres_touching_edge(2);
    shape_shuffle(&shape, 4);
    size_t capacity = 400 + 64 * (shape.vertex_count + shape.face_count), used = 0;
    char *text = calloc(1, capacity);
    used += (size_t)sprintf(text + used,
                            "ply\nformat ascii 1.0\nelement vertex %zu\nproperty float x\nproperty "
                            "short tag\nproperty float y\nproperty float z\nproperty uchar "
                            "low\nelement face %zu\nproperty list uchar int "
                            "vertex_indices\nend_header\n",
                            shape.vertex_count, shape.face_count);
    for (size_t v = 0; v < shape.vertex_count; v++)
        used += (size_t)sprintf(text + used, "%zu %zu 0.5 0 %zu\n", v, v, v & 255);
    for (size_t f = 0; f < shape.face_count; f++)
        used += (size_t)sprintf(text + used, "3 %u %u %u\n", shape.indices[3 * f],
                                shape.indices[3 * f + 1], shape.indices[3 * f + 2]);
    const char *path = test_path("tags.ply");
    file_write(path, text, used);
    free(text);
    shape_free(&shape);
    struct built b;
    build_files(&path, 1, (struct import_options){.slab_shift = 4}, &b);
    assert_int_equal(b.info.attributes.stride, 3);
    assert_int_equal(b.info.cleaning.vertices_added, 2);
    struct context ctx;
    context_init(&ctx);
    struct store *store;
    assert_int_equal(store_open(&ctx, test_path("a.store"), true, &store), STATUS_OK);
    for (uint32_t v = 0; v < b.mesh.vertex_count; v++) {
        const unsigned char *record = b.mesh.records + 3 * v;
        unsigned char again[3];
        unsigned input = (unsigned)b.mesh.positions[3 * v];
        assert_int_equal(record[0] | record[1] << 8, input);
        assert_int_equal(record[2], input & 255);
        assert_int_equal(store_record(store, v, again), STATUS_OK);
        assert_memory_equal(record, again, 3);
    }
    unsigned char record[3];
    assert_int_equal(store_record(store, (uint32_t)b.mesh.vertex_count, record), STATUS_MISUSE);
    store_close(&store);
    context_clear(&ctx);
    built_free(&b);
}

/* ---- coordinates ---- */

static void float32_coordinates_keep_their_bits(void **state)
{
    (void)state;
    struct shape shape = shape_noisy_sphere(3, 0.1, 3);
    for (size_t i = 0; i < 3 * shape.vertex_count; i++)
        shape.positions[i] = (double)(float)(shape.positions[i] * 1e-3 + 7e5);
    double *kept = malloc(3 * sizeof *kept * shape.vertex_count);
    memcpy(kept, shape.positions, 3 * sizeof *kept * shape.vertex_count);
    uint32_t *faces = malloc(sizeof *faces * shape.index_count);
    memcpy(faces, shape.indices, sizeof *faces * shape.index_count);
    struct built b;
    build_shape(shape, (struct import_options){.slab_shift = 5}, &b);
    assert_true(b.info.is_float32);
    assert_true(b.info.origin[0] == 0 && b.info.origin[1] == 0 && b.info.origin[2] == 0);
    for (size_t c = 0; c < 3 * b.mesh.face_count; c++) {
        for (size_t k = 0; k < 3; k++)
            assert_true(b.mesh.positions[3 * (size_t)b.mesh.faces[c] + k] ==
                        kept[3 * (size_t)faces[c] + k]);
    }
    free(kept);
    free(faces);
    built_free(&b);
}

/* UTM: seven digits before the point, millimetres behind it. */
static void large_coordinates_keep_their_precision(void **state)
{
    (void)state;
    struct shape shape = shape_noisy_sphere(4, 0.05, 8);
    shape_move(&shape, 37.123, 691234.567, 5334567.891, 519.25);
    double *kept = malloc(3 * sizeof *kept * shape.vertex_count);
    memcpy(kept, shape.positions, 3 * sizeof *kept * shape.vertex_count);
    uint32_t *faces = malloc(sizeof *faces * shape.index_count);
    memcpy(faces, shape.indices, sizeof *faces * shape.index_count);
    struct built b;
    build_shape(shape, (struct import_options){.slab_shift = 8}, &b);
    assert_false(b.info.is_float32);
    double extent = 0, worst = 0;
    for (int k = 0; k < 3; k++)
        extent = fmax(extent, b.info.box_high[k] - b.info.box_low[k]);
    for (size_t c = 0; c < 3 * b.mesh.face_count; c++) {
        for (size_t k = 0; k < 3; k++)
            worst = fmax(worst, fabs(b.mesh.positions[3 * (size_t)b.mesh.faces[c] + k] -
                                     kept[3 * (size_t)faces[c] + k]));
    }
    assert_true(worst > 0 && worst <= ldexp(extent, -24));
    free(kept);
    free(faces);
    built_free(&b);
}

static void sizes_that_float32_cannot_hold_are_refused(void **state)
{
    (void)state;
    const double scales[] = {1e300, 1e39, 1e-40};
    for (size_t i = 0; i < 3; i++) {
        struct shape shape = shape_icosphere(0);
        const char *path = test_path("huge.ply");
        shape_move(&shape, scales[i], 0, 0, 0);
        shape_write(&shape, SHAPE_PLY_LITTLE, path);
        shape_free(&shape);
        refuse(path, STATUS_BAD_INPUT, "a store holds models from");
    }
}

static void measures_of_a_known_mesh(void **state)
{
    (void)state;
    struct built b;
    build_shape(shape_grid(64, 64), (struct import_options){.slab_shift = 7}, &b);
    double side = b.info.box_high[0] - b.info.box_low[0];
    assert_true(fabs(b.info.area - side * (b.info.box_high[1] - b.info.box_low[1])) < 1e-9 * side);
    double mean = (2 * 64 * 65 + 64 * 64 * sqrt(2)) / (2 * 64 * 65 + 64 * 64) * side / 64;
    assert_true(fabs(b.info.mean_edge - mean) < 1e-6 * mean);
    assert_true(b.info.noise == 0);
    assert_int_equal(b.info.cleaning.zero_area_faces, 0);
    built_free(&b);
    /* Twice the noise gives twice the estimate. */
    double noise[2];
    for (int i = 0; i < 2; i++) {
        build_shape(shape_noisy_sphere(5, i ? 0.008 : 0.004, 1), (struct import_options){0}, &b);
        noise[i] = b.info.noise * b.info.mean_edge;
        built_free(&b);
    }
    assert_true(noise[1] / noise[0] > 1.8 && noise[1] / noise[0] < 2.2);
}

static void zero_area_faces_stay(void **state)
{
    (void)state;
    struct shape shape = {0};
    for (unsigned i = 0; i < 4; i++)
        shape_vertex(&shape, i, 0, 0);
    shape_vertex(&shape, 1, 1, 0);
    shape_triangle(&shape, 0, 1, 4);
    shape_triangle(&shape, 1, 0, 2);
    struct built b;
    build_shape(shape, (struct import_options){0}, &b);
    assert_int_equal(b.info.topology.faces, 2);
    assert_int_equal(b.info.cleaning.zero_area_faces, 1);
    built_free(&b);
}

/* ---- the limit of vertices and faces ---- */

/* With no more than `most` vertices and faces, `said` is what it ends with; NULL: it succeeds. */
static void limit_to(uint64_t most, const char *const *paths, size_t count, const char *said)
{
    const char *output = test_path("limit.store");
    struct context ctx;
    context_init(&ctx);
    remove(output);
    const struct import_options options = {.index_limit = most};
    enum status status = store_build(&ctx, paths, count, output, &options, NULL);
    assert_int_equal(status, said ? STATUS_BAD_INPUT : STATUS_OK);
    FILE *file = fopen(output, "rb");
    assert_true((file != NULL) == (said == NULL));
    if (file)
        fclose(file);
    if (said && !strstr(ctx.error, said))
        fail_msg("%s, not %s", ctx.error, said);
    assert_null(strchr(ctx.error, '\n'));
    context_clear(&ctx);
}

/* 42 vertices and 80 faces; a soup has a vertex a corner until it is welded. */
static void what_exceeds_the_limit_is_refused(void **state)
{
    (void)state;
    static const struct {
        enum shape_format format;
        const char *name;
        bool is_soup;
    } inputs[] = {{SHAPE_PLY_LITTLE, "l.ply", false}, {SHAPE_PLY_BIG, "b.ply", false},
                  {SHAPE_PLY_ASCII, "a.ply", false},  {SHAPE_OBJ, "a.obj", false},
                  {SHAPE_OFF, "a.off", false},        {SHAPE_STL_BINARY, "b.stl", true},
                  {SHAPE_STL_ASCII, "a.stl", true}};
    struct shape shape = shape_icosphere(1);
    for (size_t i = 0; i < sizeof inputs / sizeof *inputs; i++) {
        const char *path = test_path(inputs[i].name);
        const char *twice[2] = {path, path};
        shape_write(&shape, inputs[i].format, path);
        if (inputs[i].is_soup) {
            limit_to(240, &path, 1, NULL);
            limit_to(239, &path, 1, "more than 239 vertices");
            limit_to(479, twice, 2, "more than 479 vertices");
        } else {
            limit_to(80, &path, 1, NULL);
            limit_to(79, &path, 1, "more than 79 triangles");
            limit_to(159, twice, 2, "more than 159 triangles");
            limit_to(41, &path, 1, "41 vertices");
        }
    }
    shape_free(&shape);
}

/* Triangles that polygons give count, and so do vertices that separating gives. */
static void what_grows_beyond_the_limit_is_refused(void **state)
{
    (void)state;
    const char *path = test_path("g.ply");
    struct shape cube = shape_cube_quads(), star = {0};
    shape_write(&cube, SHAPE_PLY_LITTLE, path);
    shape_free(&cube);
    limit_to(12, &path, 1, NULL);
    limit_to(11, &path, 1, "more than 11 triangles");
    enum { POINTS = 5 };
    const uint32_t middle = shape_vertex(&star, 0, 0, 0);
    for (uint32_t i = 0; i < POINTS; i++) {
        const uint32_t a = shape_vertex(&star, 1, i, 0), b = shape_vertex(&star, 1, i + 0.5, 0);
        shape_triangle(&star, middle, a, b);
    }
    shape_write(&star, SHAPE_PLY_LITTLE, path);
    shape_free(&star);
    limit_to(3 * POINTS, &path, 1, NULL);
    limit_to(3 * POINTS - 1, &path, 1, "separating non-manifold vertices gives 15");
}

/* ---- determinism ---- */

/* Slabs of 2^shift faces of the mesh in t.ply, by several threads and within several budgets. */
static void all_runs_agree(unsigned shift)
{
    const char *input = test_path("t.ply"), *output = test_path("t.store");
    struct first_bytes first = {NULL, 0};
    for (int run = 0; run < 7; run++) {
        struct context ctx;
        context_init(&ctx);
        ctx.threads = run == 0 ? 1 : (unsigned)run + 1;
        struct import_options options = {.slab_shift = shift};
        if (run == 3)
            ctx.memory_budget = 9 << 20;
        if (run > 3) /* spools and sorts go to disk, tables are read in windows or by buckets */
            options.working_memory = (uint64_t)1 << (29 - 3 * run);
        if (store_build(&ctx, &input, 1, output, &options, NULL) != STATUS_OK)
            fail_msg("run %d: %s", run, ctx.error);
        size_t size;
        unsigned char *bytes = file_read(output, &size);
        first_bytes_compare(&first, bytes, size);
        context_clear(&ctx);
    }
    free(first.bytes);
    struct context ctx;
    context_init(&ctx);
    assert_int_equal(store_check(&ctx, output), STATUS_OK);
    ctx.memory_budget = 9 << 20;
    assert_int_equal(store_check(&ctx, output), STATUS_OK);
    context_clear(&ctx);
}

static void threads_and_budgets_change_no_byte(void **state)
{
    (void)state;
    struct shape shape = shape_noisy_torus(150, 80, 0.01, 2);
    for (size_t f = 0; f < 900; f += 7)
        shape_flip(&shape, f);
    shape_shuffle(&shape, 6);
    shape_write(&shape, SHAPE_PLY_LITTLE, test_path("t.ply"));
    shape_free(&shape);
    all_runs_agree(9);
}

/* Slabs of whole pages: what is known of the edges between them is kept beside the neighbours, for
 * a mesh that is written at once (0), one that has to be turned (1), and one with edges and faces
 * too many (2), some of them between slabs. */
static void seams_beside_the_neighbours_change_no_byte(void **state)
{
    (void)state;
    for (int kind = 0; kind < 3; kind++) {
        struct shape shape = shape_noisy_torus(150, 80, 0.01, 2);
        const size_t faces = shape.face_count;
        for (size_t f = 0; f < faces && kind == 1; f += 7)
            shape_flip(&shape, f);
        for (uint32_t v = 0; v + 500 < 12000 && kind == 2; v += 40) {
            shape_triangle(&shape, v, v + 1, v + 500);
            shape_triangle(&shape, v + 1, v, v + 500);
            shape_triangle(&shape, v + 1, v, v + 150);
        }
        shape_write(&shape, SHAPE_PLY_LITTLE, test_path("t.ply"));
        shape_free(&shape);
        all_runs_agree(12);
    }
}

static void too_little_memory_is_refused_at_once(void **state)
{
    (void)state;
    const char *input = test_path("is-not-there.ply"), *output = test_path("t.store");
    struct context ctx;
    context_init(&ctx);
    ctx.memory_budget = store_build_least_memory(1, 0, 0) - 1;
    struct import_options options = {0};
    assert_int_equal(store_build(&ctx, &input, 1, output, &options, NULL), STATUS_NO_MEMORY);
    assert_non_null(strstr(ctx.error, "needs a memory budget of at least"));
    context_clear(&ctx);
}

static void a_store_takes_at_most_72_bytes_a_vertex(void **state)
{
    (void)state;
    struct built b;
    build_shape(shape_icosphere(6), (struct import_options){0}, &b);
    size_t size;
    unsigned char *bytes = file_read(test_path("a.store"), &size);
    assert_true(size <= 72 * b.info.topology.vertices);
    free(bytes);
    built_free(&b);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cubes_that_touch_stay_closed),
        cmocka_unit_test(touching_spheres_stay_closed),
        cmocka_unit_test(surfaces_that_are_not_orientable_are_cut),
        cmocka_unit_test(the_majority_of_a_component_is_right),
        cmocka_unit_test(floors_of_known_surfaces),
        cmocka_unit_test(bad_inputs_are_refused),
        cmocka_unit_test(an_input_is_not_its_own_output),
        cmocka_unit_test(faces_may_come_before_their_vertices),
        cmocka_unit_test(several_inputs_are_one_mesh),
        cmocka_unit_test(attributes_follow_their_vertices),
        cmocka_unit_test(float32_coordinates_keep_their_bits),
        cmocka_unit_test(large_coordinates_keep_their_precision),
        cmocka_unit_test(sizes_that_float32_cannot_hold_are_refused),
        cmocka_unit_test(measures_of_a_known_mesh),
        cmocka_unit_test(zero_area_faces_stay),
        cmocka_unit_test(what_exceeds_the_limit_is_refused),
        cmocka_unit_test(what_grows_beyond_the_limit_is_refused),
        cmocka_unit_test(threads_and_budgets_change_no_byte),
        cmocka_unit_test(seams_beside_the_neighbours_change_no_byte),
        cmocka_unit_test(too_little_memory_is_refused_at_once),
        cmocka_unit_test(a_store_takes_at_most_72_bytes_a_vertex),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
