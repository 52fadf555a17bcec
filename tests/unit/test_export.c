/*
 * The writers of mesh files: the bytes of tiny meshes, known by hand or taken apart by code of the
 * test's own; the same bytes from batches of any size; and
 * failures at every call.
 */
#include "test_kit.h"

#include <fcntl.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/bytes.h"
#include "mesh/export.h"
#include "mesh/export_format.h"
#include "mesh/format_number.h"
#include "test_files.h"
#include "test_shapes.h"

static bool same_double(double a, double b)
{
    return memcmp(&a, &b, sizeof a) == 0;
}

/* ---- meshes and the files they become ---- */

struct place {
    char folder[TEST_PATH];
    char messages[4096]; /* all that was told, a line each */
    struct context ctx;
};

static void keep_message(void *user, enum message_level level, const char *text)
{
    (void)level;
    struct place *place = user;
    size_t used = strlen(place->messages);
    snprintf(place->messages + used, sizeof place->messages - used, "%s\n", text);
}

static int set_up(void **state)
{
    struct place *place = calloc(1, sizeof *place);
    folder_make(place->folder);
    context_init(&place->ctx);
    place->ctx.message = keep_message;
    place->ctx.user = place;
    *state = place;
    return 0;
}

static int tear_down(void **state)
{
    struct place *place = *state;
    assert_int_equal(place->ctx.memory_now, 0);
    context_clear(&place->ctx);
    folder_remove(place->folder);
    free(place);
    return 0;
}

/* Writes the mesh and gives back the file's bytes, with a NUL behind them. */
static unsigned char *saved(struct place *place, const char *name, enum export_format format,
                            bool as_float32, const struct mesh *mesh, size_t *size)
{
    char path[TEST_PATH];
    folder_path(path, place->folder, name);
    struct export_options options = {.format = format, .as_float32 = as_float32};
    enum status status = mesh_save(&place->ctx, path, &options, mesh);
    if (status != STATUS_OK)
        fail_msg("%s", place->ctx.error);
    unsigned char *bytes = file_read(path, size);
    assert_non_null(bytes);
    unlink(path);
    return bytes;
}

static void check_file(struct place *place, const char *name, enum export_format format,
                       bool as_float32, const struct mesh *mesh, const char *expected)
{
    size_t size;
    unsigned char *bytes = saved(place, name, format, as_float32, mesh, &size);
    assert_string_equal((char *)bytes, expected);
    assert_int_equal(size, strlen(expected));
    free(bytes);
}

static double square_positions[] = {0, 0, 0, 1, 0, 0, 1, 1, 0.5, 0, 1.25, -3};
static uint32_t square_faces[] = {0, 1, 2, 0, 2, 3};
static unsigned char square_colours[] = {255, 0, 51, 7, 0, 0, 0, 9, 1, 128, 254, 0, 102, 2, 3, 255};

static struct mesh square(void)
{
    return (struct mesh){.vertex_count = 4,
                         .face_count = 2,
                         .positions = square_positions,
                         .faces = square_faces,
                         .is_float32 = true};
}

static struct mesh coloured_square(void)
{
    struct mesh mesh = square();
    mesh.attributes = (struct attributes){.count = 4,
                                          .stride = 4,
                                          .list = {{"red", SCALAR_UINT8, 0},
                                                   {"green", SCALAR_UINT8, 1},
                                                   {"blue", SCALAR_UINT8, 2},
                                                   {"alpha", SCALAR_UINT8, 3}}};
    mesh.records = square_colours;
    return mesh;
}

static void test_text_formats(void **state)
{
    struct place *place = *state;
    struct mesh mesh = square(), coloured = coloured_square();
    check_file(place, "a.ply", EXPORT_PLY_ASCII, true, &mesh,
               "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
               "property float z\nelement face 2\nproperty list uchar int vertex_indices\n"
               "end_header\n0 0 0\n1 0 0\n1 1 0.5\n0 1.25 -3\n3 0 1 2\n3 0 2 3\n");
    check_file(place, "a.obj", EXPORT_BY_NAME, true, &mesh,
               "v 0 0 0\nv 1 0 0\nv 1 1 0.5\nv 0 1.25 -3\nf 1 2 3\nf 1 3 4\n");
    check_file(place, "a.OFF", EXPORT_BY_NAME, false, &mesh,
               "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0.5\n0 1.25 -3\n3 0 1 2\n3 0 2 3\n");
    assert_string_equal(place->messages, "");

    check_file(place, "c.off", EXPORT_BY_NAME, true, &coloured,
               "COFF\n4 2 0\n0 0 0 255 0 51 7\n1 0 0 0 0 0 9\n1 1 0.5 1 128 254 0\n"
               "0 1.25 -3 102 2 3 255\n3 0 1 2\n3 0 2 3\n");
    assert_string_equal(place->messages, "");
    check_file(place, "c.obj", EXPORT_BY_NAME, true, &coloured,
               "v 0 0 0 1 0 0.2\nv 1 0 0 0 0 0\nv 1 1 0.5 0.003921569 0.5019608 0.99607843\n"
               "v 0 1.25 -3 0.4 0.007843138 0.011764706\nf 1 2 3\nf 1 3 4\n");
    assert_non_null(strstr(place->messages, "c.obj: "));
    assert_non_null(strstr(place->messages, "no place: alpha\n"));
    check_file(place, "c.ply", EXPORT_PLY_ASCII, false, &coloured,
               "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\n"
               "property double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n"
               "property uchar alpha\nelement face 2\n"
               "property list uchar int vertex_indices\nend_header\n0 0 0 255 0 51 7\n"
               "1 0 0 0 0 0 9\n1 1 0.5 1 128 254 0\n0 1.25 -3 102 2 3 255\n3 0 1 2\n3 0 2 3\n");
}

static void test_colours_without_alpha_and_other_types(void **state)
{
    struct place *place = *state;
    struct mesh mesh = coloured_square();
    mesh.attributes.count = 3;
    check_file(place, "c.off", EXPORT_BY_NAME, true, &mesh,
               "COFF\n4 2 0\n0 0 0 255 0 51 255\n1 0 0 0 0 0 255\n1 1 0.5 1 128 254 255\n"
               "0 1.25 -3 102 2 3 255\n3 0 1 2\n3 0 2 3\n");
    assert_string_equal(place->messages, "");
    /* Not bytes: no colours, and said so once a file. */
    mesh.attributes.list[1].type = SCALAR_INT8;
    check_file(place, "d.off", EXPORT_BY_NAME, true, &mesh,
               "OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0.5\n0 1.25 -3\n3 0 1 2\n3 0 2 3\n");
    assert_non_null(strstr(place->messages, "no place: red, green, blue\n"));
}

/* ---- binary PLY with everything ---- */

static const struct attributes all_types = {.count = 8,
                                            .stride = 28,
                                            .list = {{"i1", SCALAR_INT8, 0},
                                                     {"u1", SCALAR_UINT8, 1},
                                                     {"i2", SCALAR_INT16, 2},
                                                     {"u2", SCALAR_UINT16, 4},
                                                     {"i4", SCALAR_INT32, 6},
                                                     {"u4", SCALAR_UINT32, 10},
                                                     {"f4", SCALAR_FLOAT32, 14},
                                                     {"f8", SCALAR_FLOAT64, 18}}};

/* A triangle strip with a record of every type for each vertex. */
static struct mesh strip(size_t vertex_count)
{
    struct mesh mesh = {.vertex_count = vertex_count,
                        .face_count = vertex_count - 2,
                        .positions = malloc(vertex_count * 3 * sizeof(double)),
                        .faces = malloc((vertex_count - 2) * 3 * sizeof(uint32_t)),
                        .attributes = all_types,
                        .records = calloc(vertex_count, 28),
                        .is_float32 = true};
    uint64_t seed = vertex_count + 1;
    for (size_t v = 0; v < vertex_count; v++) {
        mesh.positions[3 * v] = (double)(float)v * 0.25;
        mesh.positions[3 * v + 1] = v % 2 ? 1 : 0;
        mesh.positions[3 * v + 2] = (double)((float)(random_next(&seed) % 1000000) / 1000.0f);
        unsigned char *record = mesh.records + 28 * v;
        for (unsigned at = 0; at < 14; at++)
            record[at] = (unsigned char)random_next(&seed);
        store_f32(record + 14, (float)random_next(&seed) / 7.0f);
        store_f64(record + 18, (double)(int64_t)random_next(&seed) / 7.0);
    }
    for (uint32_t f = 0; f + 2 < vertex_count; f++) {
        mesh.faces[3 * f] = f;
        mesh.faces[3 * f + 1] = f % 2 ? f + 2 : f + 1;
        mesh.faces[3 * f + 2] = f % 2 ? f + 1 : f + 2;
    }
    return mesh;
}

static void strip_free(struct mesh *mesh)
{
    free(mesh->positions);
    free(mesh->faces);
    free(mesh->records);
}

/* `size` bytes, of the order asked for, as a number of the machine. */
static uint64_t take(const unsigned char **at, unsigned size, bool is_big)
{
    uint64_t value = 0;
    for (unsigned i = 0; i < size; i++)
        value |= (uint64_t)(*at)[i] << 8 * (is_big ? size - 1 - i : i);
    *at += size;
    return value;
}

static void check_binary_ply(struct place *place, bool is_big, bool as_float32)
{
    static const unsigned sizes[] = {1, 1, 2, 2, 4, 4, 4, 8};
    struct mesh mesh = strip(1000);
    size_t size;
    unsigned char *bytes =
        saved(place, "b.ply", is_big ? EXPORT_PLY_BIG : EXPORT_BY_NAME, as_float32, &mesh, &size);
    char header[1024];
    const char *real = as_float32 ? "float" : "double";
    snprintf(header, sizeof header,
             "ply\nformat binary_%s_endian 1.0\nelement vertex 1000\nproperty %s x\n"
             "property %s y\nproperty %s z\nproperty char i1\nproperty uchar u1\n"
             "property short i2\nproperty ushort u2\nproperty int i4\nproperty uint u4\n"
             "property float f4\nproperty double f8\nelement face 998\n"
             "property list uchar int vertex_indices\nend_header\n",
             is_big ? "big" : "little", real, real, real);
    size_t header_size = strlen(header);
    assert_int_equal(size, header_size + 1000 * ((as_float32 ? 12 : 24) + 26) + 998 * 13);
    assert_memory_equal(bytes, header, header_size);

    const unsigned char *at = bytes + header_size;
    for (size_t v = 0; v < 1000; v++) {
        for (unsigned axis = 0; axis < 3; axis++) {
            uint64_t bits = take(&at, as_float32 ? 4 : 8, is_big);
            uint32_t low = (uint32_t)bits;
            float narrow;
            double value;
            memcpy(&narrow, &low, 4);
            memcpy(&value, &bits, 8);
            if (as_float32)
                value = (double)narrow;
            assert_true(same_double(value, mesh.positions[3 * v + axis]));
        }
        const unsigned char *record = mesh.records + 28 * v;
        for (unsigned i = 0; i < 8; i++)
            assert_int_equal(take(&at, sizes[i], is_big), take(&record, sizes[i], false));
    }
    for (size_t f = 0; f < 998; f++) {
        assert_int_equal(*at++, 3);
        for (unsigned k = 0; k < 3; k++)
            assert_int_equal(take(&at, 4, is_big), mesh.faces[3 * f + k]);
    }
    assert_true(at == bytes + size);
    free(bytes);
    strip_free(&mesh);
    assert_string_equal(place->messages, "");
}

static void test_binary_ply(void **state)
{
    check_binary_ply(*state, false, true);
    check_binary_ply(*state, false, false);
    check_binary_ply(*state, true, true);
    check_binary_ply(*state, true, false);
}

/* ASCII holds the very same values. */
static void test_ascii_ply_values(void **state)
{
    struct mesh mesh = strip(1000);
    size_t size;
    unsigned char *bytes = saved(*state, "t.ply", EXPORT_PLY_ASCII, false, &mesh, &size);
    char *at = strstr((char *)bytes, "end_header\n");
    assert_non_null(at);
    at += strlen("end_header\n");
    for (size_t v = 0; v < 1000; v++) {
        const unsigned char *record = mesh.records + 28 * v;
        for (unsigned axis = 0; axis < 3; axis++)
            assert_true(same_double(strtod(at, &at), mesh.positions[3 * v + axis]));
        assert_int_equal(strtol(at, &at, 10), (int8_t)record[0]);
        assert_int_equal(strtol(at, &at, 10), record[1]);
        assert_int_equal(strtol(at, &at, 10), (int16_t)load_u16(record + 2));
        assert_int_equal(strtol(at, &at, 10), load_u16(record + 4));
        assert_int_equal(strtol(at, &at, 10), (int32_t)load_u32(record + 6));
        assert_int_equal(strtol(at, &at, 10), load_u32(record + 10));
        assert_true(strtof(at, &at) == load_f32(record + 14));
        assert_true(strtod(at, &at) == load_f64(record + 18));
        assert_int_equal(*at++, '\n');
    }
    free(bytes);
    strip_free(&mesh);
}

/* Indices are signed as long as they can be. */
static void test_ply_index_type(void **state)
{
    struct place *place = *state;
    char path[TEST_PATH];
    folder_path(path, place->folder, "large.ply");
    struct export_options options = {.format = EXPORT_PLY};
    for (unsigned more = 0; more < 2; more++) {
        struct exporter *exporter;
        assert_int_equal(
            export_open(&place->ctx, path, &options, (1ull << 31) + more, 5, NULL, &exporter),
            STATUS_OK);
        const char *type = more ? "list uchar uint vertex" : "list uchar int vertex";
        assert_non_null(memmem(exporter->buffer, exporter->used, type, strlen(type)));
        export_discard(&exporter);
        assert_null(exporter);
    }
    assert_int_equal(folder_count(place->folder), 0);
}

/* ---- STL ---- */

static void check_stl(const struct mesh *mesh, const unsigned char *bytes, size_t size)
{
    assert_int_equal(size, 84 + 50 * mesh->face_count);
    assert_memory_not_equal(bytes, "solid", 5);
    assert_int_equal(load_u32(bytes + 80), mesh->face_count);
    for (uint64_t f = 0; f < mesh->face_count; f++) {
        const unsigned char *face = bytes + 84 + 50 * f;
        double corner[3][3], normal[3], edge[2][3];
        for (unsigned axis = 0; axis < 3; axis++) {
            normal[axis] = (double)load_f32(face + 4 * axis);
            for (unsigned k = 0; k < 3; k++) {
                corner[k][axis] = (double)load_f32(face + 12 + 12 * k + 4 * axis);
                double given = mesh->positions[3 * (size_t)mesh->faces[3 * f + k] + axis];
                assert_true(same_double(corner[k][axis], (double)(float)given));
            }
            edge[0][axis] = corner[1][axis] - corner[0][axis];
            edge[1][axis] = corner[2][axis] - corner[0][axis];
        }
        assert_int_equal(load_u16(face + 48), 0);
        double cross[3], length = 0, along = 0, own = 0;
        for (unsigned axis = 0; axis < 3; axis++) {
            unsigned b = (axis + 1) % 3, c = (axis + 2) % 3;
            cross[axis] = edge[0][b] * edge[1][c] - edge[0][c] * edge[1][b];
            length += cross[axis] * cross[axis];
            along += cross[axis] * normal[axis];
            own += normal[axis] * normal[axis];
        }
        if (length == 0) {
            assert_true(own == 0);
        } else { /* a unit vector that points the same way */
            assert_true(fabs(own - 1) < 1e-6);
            assert_true(along > (1 - 1e-6) * sqrt(length));
        }
    }
}

static void test_stl(void **state)
{
    struct place *place = *state;
    struct mesh mesh = square();
    size_t size;
    unsigned char *bytes = saved(place, "s.stl", EXPORT_BY_NAME, true, &mesh, &size);
    check_stl(&mesh, bytes, size);
    assert_string_equal(place->messages, "");
    free(bytes);

    /* A face without area, and the largest floats there are. */
    double extreme[] = {-3e38, 0, 0, 3e38, 3e38, 0, 0, 0, 3e38, 1, 1, 1, 1, 1, 1, 1, 1, 1};
    uint32_t faces[] = {0, 1, 2, 3, 4, 5};
    mesh = (struct mesh){.vertex_count = 6,
                         .face_count = 2,
                         .positions = extreme,
                         .faces = faces,
                         .is_float32 = true};
    for (unsigned i = 0; i < 9; i++)
        extreme[i] = (double)(float)extreme[i];
    bytes = saved(place, "e.stl", EXPORT_BY_NAME, true, &mesh, &size);
    check_stl(&mesh, bytes, size);
    free(bytes);
}

static void test_stl_spools_to_disk(void **state)
{
    struct place *place = *state;
    struct mesh mesh = strip(20000);
    size_t size, other_size;
    unsigned char *bytes = saved(place, "s.stl", EXPORT_BY_NAME, true, &mesh, &size);
    check_stl(&mesh, bytes, size);
    assert_non_null(strstr(place->messages, "no place: i1, u1, i2, u2, i4, u4, f4, f8\n"));
    place->ctx.memory_budget = 1860 << 10; /* the positions are 240 KB, an eighth is less */
    unsigned char *other = saved(place, "t.stl", EXPORT_BY_NAME, true, &mesh, &other_size);
    place->ctx.memory_budget = UINT64_MAX;
    assert_int_equal(size, other_size);
    assert_memory_equal(bytes, other, size);
    free(bytes);
    free(other);
    strip_free(&mesh);
}

static void test_loss_is_told_once(void **state)
{
    struct place *place = *state;
    double positions[] = {4321000.25, 0, 0, 4321001.2, 0, 0, 4321000.25, 1, 0};
    uint32_t faces[] = {0, 1, 2};
    struct mesh mesh = {.vertex_count = 3, .face_count = 1, .positions = positions, .faces = faces};
    size_t size;
    unsigned char *bytes = saved(place, "far.stl", EXPORT_BY_NAME, false, &mesh, &size);
    free(bytes);
    const char *told = strstr(place->messages, "rounded to float32, by up to 0.2");
    assert_non_null(told);
    assert_null(strstr(told + 1, "rounded"));
    check_file(place, "far.obj", EXPORT_BY_NAME, false, &mesh,
               "v 4321000.25 0 0\nv 4321001.2 0 0\nv 4321000.25 1 0\nf 1 2 3\n");
}

/* ---- batches ---- */

static const struct {
    const char *name;
    enum export_format format;
} all_formats[] = {{"x.ply", EXPORT_PLY}, {"x.ply", EXPORT_PLY_ASCII}, {"x.ply", EXPORT_PLY_BIG},
                   {"x.obj", EXPORT_OBJ}, {"x.stl", EXPORT_STL},       {"x.off", EXPORT_OFF}};
enum { FORMATS = sizeof all_formats / sizeof *all_formats };

static enum status write_in_batches(struct context *ctx, const char *path,
                                    const struct export_options *options, const struct mesh *mesh,
                                    size_t batch)
{
    struct exporter *exporter;
    enum status status = export_open(ctx, path, options, mesh->vertex_count, mesh->face_count,
                                     &mesh->attributes, &exporter);
    if (status != STATUS_OK)
        return status;
    for (size_t at = 0; at < mesh->vertex_count && status == STATUS_OK; at += batch) {
        size_t left = mesh->vertex_count - at;
        status = export_vertices(exporter, left < batch ? left : batch, mesh->positions + 3 * at,
                                 mesh->records + mesh->attributes.stride * at);
    }
    for (size_t at = 0; at < mesh->face_count && status == STATUS_OK; at += batch) {
        size_t left = mesh->face_count - at;
        status = export_faces(exporter, left < batch ? left : batch, mesh->faces + 3 * at);
    }
    if (status == STATUS_OK)
        return export_commit(&exporter);
    export_discard(&exporter);
    return status;
}

static void test_batches_make_no_difference(void **state)
{
    struct place *place = *state;
    static const size_t batches[] = {1, 2, 7, 511, 512, 513, 2999, 5000};
    struct mesh mesh = strip(3000);
    for (unsigned i = 0; i < FORMATS; i++) {
        size_t size, other_size;
        unsigned char *bytes =
            saved(place, all_formats[i].name, all_formats[i].format, true, &mesh, &size);
        for (unsigned b = 0; b < sizeof batches / sizeof *batches; b++) {
            char path[TEST_PATH];
            folder_path(path, place->folder, "batches");
            struct export_options options = {.format = all_formats[i].format, .as_float32 = true};
            assert_int_equal(write_in_batches(&place->ctx, path, &options, &mesh, batches[b]),
                             STATUS_OK);
            unsigned char *other = file_read(path, &other_size);
            assert_int_equal(size, other_size);
            assert_memory_equal(bytes, other, size);
            free(other);
            unlink(path);
        }
        free(bytes);
    }
    strip_free(&mesh);
}

static void test_empty_mesh(void **state)
{
    struct place *place = *state;
    struct mesh mesh = {.is_float32 = true};
    check_file(place, "n.obj", EXPORT_BY_NAME, true, &mesh, "");
    check_file(place, "n.off", EXPORT_BY_NAME, true, &mesh, "OFF\n0 0 0\n");
    size_t size;
    unsigned char *bytes = saved(place, "n.stl", EXPORT_BY_NAME, true, &mesh, &size);
    assert_int_equal(size, 84);
    assert_int_equal(load_u32(bytes + 80), 0);
    free(bytes);
}

/* ---- what is refused ---- */

static void check_refused(struct place *place, enum status status, enum status expected,
                          const char *words)
{
    assert_int_equal(status, expected);
    assert_int_equal(place->ctx.failed, expected);
    if (!strstr(place->ctx.error, words))
        fail_msg("\"%s\" does not say \"%s\"", place->ctx.error, words);
    assert_int_equal(folder_count(place->folder), 0);
    place->ctx.failed = STATUS_OK;
    place->ctx.error[0] = 0;
}

static void test_formats_refused(void **state)
{
    struct place *place = *state;
    struct mesh mesh = square();
    static const char *const names[] = {"a.gltf", "a", "a.ply.gz", "a.ply/b", ".plyx"};
    struct export_options options = {.format = EXPORT_BY_NAME};
    for (unsigned i = 0; i < sizeof names / sizeof *names; i++) {
        char path[TEST_PATH];
        folder_path(path, place->folder, names[i]);
        check_refused(place, mesh_save(&place->ctx, path, &options, &mesh), STATUS_MISUSE,
                      ".ply, .obj, .stl or .off");
    }
    check_refused(place, mesh_save(&place->ctx, "-", &options, &mesh), STATUS_MISUSE,
                  "standard output");
    options.format = (enum export_format)99;
    check_refused(place, mesh_save(&place->ctx, "a.ply", &options, &mesh), STATUS_MISUSE, "99");
    char path[TEST_PATH];
    folder_path(path, place->folder, "many.stl");
    struct exporter *exporter;
    options.format = EXPORT_STL;
    check_refused(place, export_open(&place->ctx, path, &options, 3, 1ull << 32, NULL, &exporter),
                  STATUS_MISUSE, "4294967295");
    assert_null(exporter);
}

static void test_coordinates_refused(void **state)
{
    struct place *place = *state;
    double positions[] = {0, 0, 0, 1, 0, 0, 0, 1e39, 0};
    uint32_t faces[] = {0, 1, 2};
    struct mesh mesh = {.vertex_count = 3, .face_count = 1, .positions = positions, .faces = faces};
    struct export_options options = {.format = EXPORT_BY_NAME};
    char path[TEST_PATH];
    folder_path(path, place->folder, "a.stl");
    check_refused(place, mesh_save(&place->ctx, path, &options, &mesh), STATUS_BAD_INPUT,
                  "vertex 2: the coordinate 1e+39");
    folder_path(path, place->folder, "a.ply");
    positions[4] = NAN;
    check_refused(place, mesh_save(&place->ctx, path, &options, &mesh), STATUS_BAD_INPUT,
                  "vertex 1");
}

/* Opens a file for the square's counts; each case below then breaks the rules in one way. */
static struct exporter *open_square(struct place *place, enum export_format format)
{
    char path[TEST_PATH];
    folder_path(path, place->folder, "broken");
    struct export_options options = {.format = format};
    struct exporter *exporter;
    assert_int_equal(export_open(&place->ctx, path, &options, 4, 2, NULL, &exporter), STATUS_OK);
    return exporter;
}

static void test_counts_must_be_true(void **state)
{
    struct place *place = *state;
    for (unsigned i = 0; i < FORMATS; i++) {
        enum export_format format = all_formats[i].format;
        struct exporter *exporter = open_square(place, format);
        check_refused(place, export_commit(&exporter), STATUS_INTERNAL, "announced");
        assert_null(exporter);

        exporter = open_square(place, format); /* a face too few */
        assert_int_equal(export_vertices(exporter, 4, square_positions, NULL), STATUS_OK);
        assert_int_equal(export_faces(exporter, 1, square_faces), STATUS_OK);
        check_refused(place, export_commit(&exporter), STATUS_INTERNAL, "announced");

        exporter = open_square(place, format); /* a face too many */
        assert_int_equal(export_vertices(exporter, 4, square_positions, NULL), STATUS_OK);
        assert_int_equal(export_faces(exporter, 1, square_faces), STATUS_OK);
        assert_int_equal(export_faces(exporter, 2, square_faces), STATUS_INTERNAL);
        check_refused(place, export_commit(&exporter), STATUS_INTERNAL, "more than the 2 faces");

        exporter = open_square(place, format); /* a vertex too many */
        assert_int_equal(export_vertices(exporter, 3, square_positions, NULL), STATUS_OK);
        assert_int_equal(export_vertices(exporter, 2, square_positions, NULL), STATUS_INTERNAL);
        /* The failure stays, whatever follows. */
        assert_int_equal(export_faces(exporter, 2, square_faces), STATUS_INTERNAL);
        check_refused(place, export_commit(&exporter), STATUS_INTERNAL, "more than the 4 vertices");

        exporter = open_square(place, format); /* faces first */
        assert_int_equal(export_faces(exporter, 1, square_faces), STATUS_INTERNAL);
        check_refused(place, export_commit(&exporter), STATUS_INTERNAL, "before all vertices");

        exporter = open_square(place, format); /* a vertex that is not there */
        uint32_t faces[] = {0, 1, 2, 0, 2, 4};
        assert_int_equal(export_vertices(exporter, 4, square_positions, NULL), STATUS_OK);
        assert_int_equal(export_faces(exporter, 2, faces), STATUS_INTERNAL);
        check_refused(place, export_commit(&exporter), STATUS_INTERNAL, "face 1 names vertex 4");
    }
}

static void test_attributes_must_fit(void **state)
{
    struct place *place = *state;
    struct export_options options = {.format = EXPORT_PLY};
    struct exporter *exporter;
    struct attributes wrong[4] = {all_types, all_types, all_types, all_types};
    wrong[0].stride = 25;
    wrong[1].list[3].offset = UINT32_MAX;
    memcpy(wrong[2].list[2].name, "a b", 4);
    wrong[3].list[0].name[0] = 0;
    char path[TEST_PATH];
    folder_path(path, place->folder, "wrong.ply");
    for (unsigned i = 0; i < 4; i++)
        check_refused(place, export_open(&place->ctx, path, &options, 1, 0, &wrong[i], &exporter),
                      STATUS_INTERNAL, "described wrongly");
    assert_int_equal(export_open(&place->ctx, path, &options, 1, 0, &all_types, &exporter),
                     STATUS_OK);
    assert_int_equal(export_vertices(exporter, 1, square_positions, NULL), STATUS_INTERNAL);
    check_refused(place, export_commit(&exporter), STATUS_INTERNAL, "without their properties");
}

/* ---- standard output, cancelling, faults ---- */

static void test_standard_output(void **state)
{
    struct place *place = *state;
    char path[TEST_PATH];
    folder_path(path, place->folder, "caught");
    struct mesh mesh = square();
    struct export_options options = {.format = EXPORT_OBJ, .as_float32 = true, .sync = true};
    fflush(stdout);
    int kept = dup(STDOUT_FILENO);
    int file = open(path, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    assert_true(kept >= 0 && file >= 0);
    dup2(file, STDOUT_FILENO);
    enum status status = mesh_save(&place->ctx, "-", &options, &mesh);
    dup2(kept, STDOUT_FILENO);
    close(kept);
    close(file);
    assert_int_equal(status, STATUS_OK);
    size_t size;
    unsigned char *bytes = file_read(path, &size);
    assert_string_equal((char *)bytes,
                        "v 0 0 0\nv 1 0 0\nv 1 1 0.5\nv 0 1.25 -3\nf 1 2 3\nf 1 3 4\n");
    free(bytes);
}

static bool always(void *user)
{
    (void)user;
    return true;
}

static void test_cancelled(void **state)
{
    struct place *place = *state;
    struct mesh mesh = square();
    struct export_options options = {.format = EXPORT_BY_NAME};
    char path[TEST_PATH];
    folder_path(path, place->folder, "c.ply");
    place->ctx.cancelled = always;
    check_refused(place, mesh_save(&place->ctx, path, &options, &mesh), STATUS_CANCELLED, "cancel");
}

/* Every guarded call fails once: words, no leak, no descriptor, no file. */
static void test_faults(void **state)
{
    struct place *place = *state;
    struct mesh mesh = strip(20000);
    char path[TEST_PATH];
    folder_path(path, place->folder, "fault");
    int descriptors = folder_count("/proc/self/fd");
    for (unsigned i = 0; i < FORMATS; i++) {
        struct export_options options = {
            .format = all_formats[i].format, .as_float32 = true, .sync = true};
        uint64_t after = 0;
        for (bool reached = true; reached; after++) {
            struct context ctx;
            context_init(&ctx);
            ctx.fault_after = after;
            ctx.memory_budget = 1860 << 10; /* so that STL's spool moves to disk */
            enum status status = write_in_batches(&ctx, path, &options, &mesh, 1000);
            reached = ctx.fault_after == UINT64_MAX;
            if (status == STATUS_OK) {
                assert_int_equal(unlink(path), 0);
            } else {
                assert_true(reached);
                assert_int_equal(ctx.failed, status);
                assert_true(status == STATUS_NO_MEMORY || status == STATUS_NO_SPACE ||
                            status == STATUS_IO);
                assert_true(strlen(ctx.error) > 10);
            }
            assert_int_equal(ctx.memory_now, 0);
            assert_int_equal(folder_count(place->folder), 0);
            assert_int_equal(folder_count("/proc/self/fd"), descriptors);
            context_clear(&ctx);
            assert_true(after < 1000);
        }
        assert_true(after > 8);
    }
    strip_free(&mesh);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_text_formats, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_colours_without_alpha_and_other_types, set_up,
                                        tear_down),
        cmocka_unit_test_setup_teardown(test_binary_ply, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_ascii_ply_values, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_ply_index_type, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_stl, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_stl_spools_to_disk, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_loss_is_told_once, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_batches_make_no_difference, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_empty_mesh, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_formats_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_coordinates_refused, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_counts_must_be_true, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_attributes_must_fit, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_standard_output, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_cancelled, set_up, tear_down),
        cmocka_unit_test_setup_teardown(test_faults, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
