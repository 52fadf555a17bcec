/*
 * Attributes travel with their vertices: through slabs, both modes, both placements and topology
 * simplification. One of them is the vertex' own number in the input, so that every output vertex
 * tells where it comes from.
 */
#include "mesh/import.h"
#include "simplify/simplify.h"
#include "simplify/topology.h"
#include "test_facts.h"
#include "test_kit.h"
#include "test_shapes.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { RECORD = 4 + 1 + 4 }; /* number, red, height */

struct paths {
    char input[256], store[256], chains[256], output[256], level[2][256];
};

static struct paths make_paths(void)
{
    struct paths paths;
    snprintf(paths.input, sizeof paths.input, "%s", test_path("in.ply"));
    snprintf(paths.store, sizeof paths.store, "%s", test_path("mesh.store"));
    snprintf(paths.chains, sizeof paths.chains, "%s", test_path("mesh.chains"));
    snprintf(paths.output, sizeof paths.output, "%s", test_path("out-%d.ply"));
    snprintf(paths.level[0], sizeof paths.level[0], "%s", test_path("out-0.ply"));
    snprintf(paths.level[1], sizeof paths.level[1], "%s", test_path("out-1.ply"));
    return paths;
}

static void must(enum status status, const struct context *ctx)
{
    if (status != STATUS_OK && status != STATUS_TARGET_MISSED)
        fail_msg("status %d: %s", (int)status, ctx->error);
}

/* The shape as a PLY whose vertices have number (uint), red (uchar) and height (float: z). */
static void write_numbered(const struct shape *shape, const char *path)
{
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    fprintf(file,
            "ply\nformat binary_little_endian 1.0\nelement vertex %zu\nproperty float x\n"
            "property uint number\nproperty float y\nproperty uchar red\nproperty float z\n"
            "property float height\nelement face %zu\nproperty list uchar int vertex_indices\n"
            "end_header\n",
            shape->vertex_count, shape->face_count);
    for (size_t v = 0; v < shape->vertex_count; v++) {
        const double *p = shape->positions + 3 * v;
        const float x = (float)p[0], y = (float)p[1], z = (float)p[2];
        const uint32_t number = (uint32_t)v;
        fwrite(&x, 4, 1, file);
        fwrite(&number, 4, 1, file);
        fwrite(&y, 4, 1, file);
        fputc((int)(v % 251), file);
        fwrite(&z, 4, 1, file);
        fwrite(&z, 4, 1, file);
    }
    for (size_t f = 0; f < shape->face_count; f++) {
        fputc(3, file);
        fwrite(shape->indices + 3 * f, 4, 3, file);
    }
    assert_int_equal(fclose(file), 0);
}

static void load(const char *path, struct context *ctx, struct mesh *mesh)
{
    context_init(ctx);
    must(mesh_load(ctx, path, mesh), ctx);
    assert_int_equal(mesh->attributes.count, 3);
    assert_int_equal(mesh->attributes.stride, RECORD);
    assert_string_equal(mesh->attributes.list[0].name, "number");
    assert_string_equal(mesh->attributes.list[2].name, "height");
    struct facts facts = facts_of(mesh);
    assert_true(facts_manifold(&facts));
}

/* Each vertex is the input's vertex of that number, bit for bit, with all that it had. */
static void check_subset(const char *path, const struct shape *shape)
{
    struct context ctx;
    struct mesh mesh;
    load(path, &ctx, &mesh);
    for (uint64_t v = 0; v < mesh.vertex_count; v++) {
        const unsigned char *record = mesh.records + v * RECORD;
        uint32_t number;
        float height;
        memcpy(&number, record, 4);
        memcpy(&height, record + 5, 4);
        assert_true(number < shape->vertex_count);
        assert_int_equal(record[4], number % 251);
        for (unsigned k = 0; k < 3; k++)
            assert_true(mesh.positions[3 * v + k] == shape->positions[3 * (size_t)number + k]);
        assert_true((double)height == shape->positions[3 * (size_t)number + 2]);
    }
    mesh_clear(&ctx, &mesh);
    context_clear(&ctx);
}

/* Vertices may have moved: labels are labels of the input, and heights follow the surface. */
static void check_optimal(const char *path, const struct shape *shape, double slack)
{
    struct context ctx;
    struct mesh mesh;
    load(path, &ctx, &mesh);
    for (uint64_t v = 0; v < mesh.vertex_count; v++) {
        uint32_t number;
        float height;
        memcpy(&number, mesh.records + v * RECORD, 4);
        memcpy(&height, mesh.records + v * RECORD + 5, 4);
        assert_true(number < shape->vertex_count);
        assert_true(fabs((double)height - mesh.positions[3 * v + 2]) <= slack);
    }
    mesh_clear(&ctx, &mesh);
    context_clear(&ctx);
}

static void make_levels(const struct paths *paths, enum lod_mode mode, enum placement place)
{
    struct context ctx;
    context_init(&ctx);
    struct target target = {
        .kind = TARGET_FACES, .count = 2, .values = {600, 80}, .mode = mode, .effort = 2};
    struct patch_request request = {
        .patch_angle = {-1, -1}, .face_angle = {-1, -1}, .smoothings = -1, .chain_tolerance = -1};
    must(chain_build(&ctx, paths->store, paths->chains, &target, &request, NULL), &ctx);
    must(chain_file_check(&ctx, paths->chains), &ctx);
    struct lod_options options = {.target = target,
                                  .place = place,
                                  .output = paths->output,
                                  .export = {.format = EXPORT_PLY}};
    struct lod_report report;
    must(lod_build(&ctx, paths->chains, &options, &report), &ctx);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void import(const struct paths *paths, unsigned slab_shift)
{
    struct context ctx;
    context_init(&ctx);
    struct import_options options = {.slab_shift = slab_shift};
    const char *input = paths->input;
    must(store_build(&ctx, &input, 1, paths->store, &options, NULL), &ctx);
    must(store_check(&ctx, paths->store), &ctx);
    context_clear(&ctx);
}

static void levels_keep_what_vertices_have(void **state)
{
    (void)state;
    static const unsigned slab_shifts[] = {0, 4, 6, 9};
    const struct paths paths = make_paths();
    for (unsigned which = 0; which < 2; which++) {
        struct shape shape =
            which ? shape_grid_with_holes(32, 32) : shape_noisy_sphere(4, 0.01, 11);
        write_numbered(&shape, paths.input);
        for (unsigned i = 0; i < 4; i++) {
            import(&paths, slab_shifts[i]);
            for (unsigned how = 0; how < 3; how++) {
                make_levels(&paths, how == 2 ? MODE_CLASSIC : MODE_COLLAPSE,
                            how ? PLACE_SUBSET : PLACE_OPTIMAL);
                for (unsigned level = 0; level < 2; level++)
                    if (how)
                        check_subset(paths.level[level], &shape);
                    else
                        check_optimal(paths.level[level], &shape, 0.15);
            }
        }
        shape_free(&shape);
    }
}

/* Specks go, planes are triangulated anew; what stays has what it had. */
static void topology_keeps_what_vertices_have(void **state)
{
    (void)state;
    const struct paths paths = make_paths();
    struct shape shape = shape_noisy_slab(24, 0.002, 5), speck = shape_icosphere(1);
    struct shape floor = shape_grid(16, 16);
    shape_move(&floor, 0.125, -4, -4, -4);
    shape_append(&shape, &floor);
    shape_free(&floor);
    shape_fan(&shape);
    size_t whole = shape.face_count;
    shape_move(&speck, 1.0 / 64, 4, 4, 4);
    for (size_t i = 0; i < 3 * speck.vertex_count; i++)
        speck.positions[i] = (double)(float)speck.positions[i];
    shape_append(&shape, &speck);
    shape_free(&speck);
    write_numbered(&shape, paths.input);
    for (unsigned how = 0; how < 4; how++) {
        struct context ctx;
        struct topology_options options;
        struct topology_report report = {0};
        import(&paths, how & 2 ? 5 : 0);
        topology_defaults(&options);
        options.drop_components = (struct length_option){.value = 0.1, .is_relative = true};
        options.max_feature = (struct length_option){.value = 0.05, .is_relative = true};
        options.merge_coplanar = how & 1;
        options.export.format = EXPORT_PLY;
        context_init(&ctx);
        must(topology_run(&ctx, paths.store, paths.chains, paths.level[0], &options, &report),
             &ctx);
        assert_int_equal(report.counts[FEATURE_COMPONENT], 1);
        assert_true(how & 1 ? report.faces + 300 < whole : report.faces <= whole);
        topology_report_clear(&ctx, &report);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
        check_subset(paths.level[0], &shape);
    }
    shape_free(&shape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(levels_keep_what_vertices_have),
        cmocka_unit_test(topology_keeps_what_vertices_have),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
