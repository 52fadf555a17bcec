/* Writers and readers together: what was written comes back bit for bit. */
#include "base/bytes.h"
#include "base/memory.h"
#include "mesh/export.h"
#include "mesh/import.h"
#include "test_files.h"
#include "test_kit.h"
#include "test_shapes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- meshes ---- */

static void save(struct context *ctx, const char *path, enum export_format format,
                 const struct mesh *mesh)
{
    struct export_options options = {format, mesh->is_float32, false};
    if (mesh_save(ctx, path, &options, mesh) != STATUS_OK)
        fail_msg("%s", ctx->error);
}

static void load(struct context *ctx, const char *path, struct mesh *mesh)
{
    if (mesh_load(ctx, path, mesh) != STATUS_OK)
        fail_msg("%s", ctx->error);
}

/* Attributes of all types, with values at both ends. */
static void give_attributes(struct context *ctx, struct mesh *mesh)
{
    static const char *const names[] = {"red", "green", "blue", "alpha", "i8",     "i16",
                                        "u16", "i32",   "u32",  "nx",    "quality"};
    static const enum scalar_type types[] = {
        SCALAR_UINT8,  SCALAR_UINT8, SCALAR_UINT8,  SCALAR_UINT8,   SCALAR_INT8,   SCALAR_INT16,
        SCALAR_UINT16, SCALAR_INT32, SCALAR_UINT32, SCALAR_FLOAT32, SCALAR_FLOAT64};
    struct attributes *attributes = &mesh->attributes;
    memset(attributes, 0, sizeof *attributes);
    for (uint32_t i = 0; i < sizeof types / sizeof *types; i++) {
        struct attribute *attribute = &attributes->list[attributes->count++];
        strcpy(attribute->name, names[i]);
        attribute->type = types[i];
        attribute->offset = attributes->stride;
        attributes->stride += scalar_size(types[i]);
    }
    assert_int_equal(memory_take(ctx, mesh->vertex_count, attributes->stride, &mesh->records),
                     STATUS_OK);
    uint64_t seed = 3;
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        unsigned char *record = mesh->records + v * attributes->stride;
        for (uint32_t b = 0; b < attributes->stride; b++)
            record[b] = (unsigned char)random_next(&seed);
        for (unsigned i = 0; i < 4 && v < 256; i++) /* every colour value */
            record[i] = (unsigned char)(v + 85 * i);
        store_f32(record + attributes->list[9].offset, (float)random_unit(&seed) - 0.5f);
        store_f64(record + attributes->list[10].offset, random_unit(&seed) * 1e9);
    }
}

static void make(struct context *ctx, bool is_double, struct mesh *mesh)
{
    struct shape shape = shape_noisy_sphere(4, 0.01, 9);
    if (is_double)
        shape_move(&shape, 3, 500000, 5400000, -0.1);
    shape_into_mesh(ctx, &shape, mesh);
    if (is_double) { /* doubles of few digits, which look like floats */
        mesh->positions[0] = 0.1;
        mesh->positions[1] = 5400000.3;
        mesh->positions[2] = 16777217;
        mesh->positions[3] = nextafter(0.5, 1);
    } else {
        mesh->positions[0] = (double)1e-30f;
        mesh->positions[1] = (double)123456790.f;
        mesh->positions[2] = -0.0;
    }
}

static void assert_same_mesh(const struct mesh *a, const struct mesh *b)
{
    assert_int_equal(a->vertex_count, b->vertex_count);
    assert_int_equal(a->face_count, b->face_count);
    assert_int_equal(a->is_float32, b->is_float32);
    assert_memory_equal(a->positions, b->positions, 3 * a->vertex_count * sizeof(double));
    assert_memory_equal(a->faces, b->faces, 3 * a->face_count * sizeof(uint32_t));
}

static void ply_comes_back_with_all_attributes(void **state)
{
    (void)state;
    for (int format = EXPORT_PLY; format <= EXPORT_PLY_BIG; format++)
        for (int is_double = 0; is_double < 2; is_double++) {
            struct context ctx;
            struct mesh mesh, back;
            context_init(&ctx);
            make(&ctx, is_double, &mesh);
            give_attributes(&ctx, &mesh);
            save(&ctx, test_path("a.ply"), (enum export_format)format, &mesh);
            load(&ctx, test_path("a.ply"), &back);
            assert_same_mesh(&mesh, &back);
            assert_memory_equal(&mesh.attributes, &back.attributes, sizeof mesh.attributes);
            assert_memory_equal(mesh.records, back.records,
                                mesh.vertex_count * mesh.attributes.stride);
            mesh_clear(&ctx, &mesh);
            mesh_clear(&ctx, &back);
            assert_int_equal(ctx.memory_now, 0);
            context_clear(&ctx);
        }
}

static void obj_and_off_come_back_with_colours(void **state)
{
    (void)state;
    for (int format = EXPORT_OBJ; format <= EXPORT_OFF; format += EXPORT_OFF - EXPORT_OBJ)
        for (int variant = 0; variant < 4; variant++) {
            struct context ctx;
            struct mesh mesh, back;
            context_init(&ctx);
            make(&ctx, variant & 1, &mesh);
            if (variant & 2)
                give_attributes(&ctx, &mesh);
            const char *path = test_path(format == EXPORT_OBJ ? "a.obj" : "a.off");
            save(&ctx, path, EXPORT_BY_NAME, &mesh);
            load(&ctx, path, &back);
            assert_same_mesh(&mesh, &back);
            uint32_t colours = variant & 2 ? format == EXPORT_OFF ? 4 : 3 : 0;
            assert_int_equal(back.attributes.stride, colours);
            for (size_t v = 0; v < mesh.vertex_count && colours; v++)
                assert_memory_equal(mesh.records + v * mesh.attributes.stride,
                                    back.records + v * colours, colours);
            mesh_clear(&ctx, &mesh);
            mesh_clear(&ctx, &back);
            context_clear(&ctx);
        }
}

static void stl_comes_back_face_by_face(void **state)
{
    (void)state;
    for (uint64_t budget = 0; budget < 2; budget++) { /* the spool in memory, and on disk */
        struct context ctx;
        struct mesh mesh, back;
        context_init(&ctx);
        make(&ctx, false, &mesh);
        uint64_t left = ctx.memory_now + (600 << 10); /* less than 8 times the positions */
        if (budget) {
            ctx.memory_budget = left;
            assert_true(left / 8 < mesh.vertex_count * 12 * 8);
        }
        save(&ctx, test_path("a.stl"), EXPORT_BY_NAME, &mesh);
        ctx.memory_budget = UINT64_MAX;
        load(&ctx, test_path("a.stl"), &back);
        assert_int_equal(back.face_count, mesh.face_count);
        assert_int_equal(back.vertex_count, mesh.vertex_count);
        for (size_t i = 0; i < 3 * mesh.face_count; i++) {
            const double *p = mesh.positions + 3 * (size_t)mesh.faces[i];
            const double *q = back.positions + 3 * (size_t)back.faces[i];
            assert_true(p[0] == q[0] && p[1] == q[1] && p[2] == q[2]);
        }
        size_t size;
        unsigned char *data = file_read(test_path("a.stl"), &size);
        assert_int_equal(size, 84 + 50 * mesh.face_count);
        for (size_t f = 0; f < mesh.face_count; f += 97) { /* normals look outwards, length 1 */
            const unsigned char *facet = data + 84 + 50 * f;
            double length = 0, outwards = 0;
            for (unsigned k = 0; k < 3; k++) {
                double n = (double)load_f32(facet + 4 * k);
                length += n * n;
                outwards += n * (double)load_f32(facet + 12 + 4 * k);
            }
            assert_true(fabs(length - 1) < 1e-5 && outwards > 0);
        }
        free(data);
        mesh_clear(&ctx, &mesh);
        mesh_clear(&ctx, &back);
        context_clear(&ctx);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ply_comes_back_with_all_attributes),
        cmocka_unit_test(obj_and_off_come_back_with_colours),
        cmocka_unit_test(stl_comes_back_face_by_face),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
