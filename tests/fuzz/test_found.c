/*
 * What fuzzing found, each built in code.
 */
#include "base/memory.h"
#include "mesh/export.h"
#include "mesh/parse_number.h"
#include "simplify/chain_frame.h"
#include "simplify/collapse.h"
#include "simplify/simplify.h"
#include "test_files.h"
#include "test_kit.h"
#include "test_shapes.h"
#include "test_topology_kit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static struct chain_info fair_info(void)
{
    struct chain_info info = {.box_high = {1, 1, 1},
                              .is_float32 = true,
                              .slab_count = 1,
                              .effort = 2,
                              .mean_edge = 1,
                              .topology = {.vertices = 3,
                                           .edges = 3,
                                           .faces = 1,
                                           .border_edges = 3,
                                           .border_loops = 1,
                                           .components = 1,
                                           .euler = 1},
                              .options = {.most_faces = 1},
                              .attributes = {.count = 1, .stride = 1}};
    strcpy(info.attributes.list[0].name, "red");
    info.attributes.list[0].type = SCALAR_UINT8;
    return info;
}

static const char *decode(const struct chain_info *info)
{
    unsigned char bytes[4096];
    struct chain_info read;
    size_t size = chain_info_encode(info, bytes);
    assert_true(size <= sizeof bytes);
    return chain_info_decode(bytes, size, &read);
}

/* Levels were written with coordinates that the origin had moved beyond all bounds. */
static void a_chain_file_with_a_forged_origin_or_box(void **state)
{
    (void)state;
    struct chain_info info = fair_info();
    assert_null(decode(&info));
    info.origin[1] = -5.48612e303;
    assert_non_null(strstr(decode(&info), "origin"));
    info.is_float32 = false;
    assert_null(decode(&info));
    info.box_low[2] = 2;
    assert_non_null(strstr(decode(&info), "box"));
}

/* Four thousand million faces in a file of 11 kB: lod said that it needs 131 GB (exit 4). */
static void a_chain_file_that_claims_many_faces(void **state)
{
    (void)state;
    struct chain_info info = fair_info();
    info.topology.faces = 4000000000;
    assert_non_null(strstr(decode(&info), "contradict each other"));
    info.slab_count = 15259;
    assert_null(decode(&info));
}

/* The name of an attribute goes into the header of a PLY: a line end in it would be a line of its
 * own. */
static void a_chain_file_with_a_forged_attribute(void **state)
{
    (void)state;
    static const char *const names[] = {"red\nelement face 9", "re d", "\x7f", "a\tb"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        struct chain_info info = fair_info();
        strcpy(info.attributes.list[0].name, names[i]);
        assert_non_null(strstr(decode(&info), "attribute"));
    }
}

/* Patches of a forged chain file that do not join were called a defect of ours. */
static void a_chain_file_whose_patches_do_not_join(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh;
    struct collapse *collapse;
    context_init(&ctx);
    struct shape shape = shape_spheres_touching_edge(1);
    shape_into_mesh(&ctx, &shape, &mesh);
    const struct collapse_options options = {.effort = 2, .source = "scan.chains"};
    assert_int_equal(collapse_begin(&ctx, &options, mesh.vertex_count, mesh.face_count,
                                    mesh.positions, mesh.faces, NULL, NULL, NULL, &collapse),
                     STATUS_BAD_INPUT);
    assert_null(collapse);
    assert_non_null(strstr(ctx.error, "scan.chains: is damaged"));
    mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

/* An edge that two faces use the same way made the search for a border corner read far behind the
 * corners: what is left over by exclusive or is none of them then. */
static void a_chain_file_whose_faces_share_an_edge_wrongly(void **state)
{
    (void)state;
    static const double positions[15] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 0, 1};
    static const uint32_t faces[9] = {4, 0, 2, 2, 0, 1, 3, 2, 0};
    struct context ctx;
    struct collapse *collapse;
    context_init(&ctx);
    const struct collapse_options options = {.effort = 2, .source = "scan.chains"};
    assert_int_equal(
        collapse_begin(&ctx, &options, 5, 3, positions, faces, NULL, NULL, NULL, &collapse),
        STATUS_BAD_INPUT);
    assert_non_null(strstr(ctx.error, "scan.chains: is damaged"));
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

/* memcpy from NULL, of no bytes (undefined all the same: the sanitizer is what fails here). */
static void a_ply_without_attributes(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh;
    context_init(&ctx);
    struct shape shape = shape_tetrahedron();
    shape_into_mesh(&ctx, &shape, &mesh);
    assert_null(mesh.records);
    const struct export_options options = {.format = EXPORT_PLY, .as_float32 = true};
    assert_int_equal(mesh_save(&ctx, test_path("out.ply"), &options, &mesh), STATUS_OK);
    size_t size;
    unsigned char *bytes = file_read(test_path("out.ply"), &size);
    assert_non_null(bytes);
    assert_true(size > 4 * 12 + 4 * 13);
    free(bytes);
    mesh_clear(&ctx, &mesh);
    context_clear(&ctx);
}

/* A thousand zeros in front got a number past the limit that its header states. */
static void a_number_that_is_too_long(void **state)
{
    (void)state;
    static unsigned char text[NUMBER_LENGTH_MAX + 2];
    struct parsed_number number;
    memset(text, '0', sizeof text);
    text[sizeof text - 1] = '8';
    assert_null(parse_real(text, text + sizeof text, &number));
    assert_ptr_equal(parse_real(text + 2, text + sizeof text, &number), text + sizeof text);
    assert_true(number.value == 8);
}

/* A triangle without area whose border is closed as a crack: all lies in one plane, which has no
 * outline, and an empty list was sorted (undefined: the sanitizer is what fails here). */
static void a_closed_mesh_in_one_plane(void **state)
{
    (void)state;
    struct shape shape = {0};
    struct topology_options options;
    struct operated out;
    uint32_t a = shape_vertex(&shape, 0, 1.5, 0), b = shape_vertex(&shape, -0.125, -0.125, -0.125);
    uint32_t c = shape_vertex(&shape, -0.125, -0.125, -0.125);
    shape_triangle(&shape, a, c, b);
    topology_defaults(&options);
    options.close_cracks = (struct length_option){0.46, true};
    options.crack_inscribed = true;
    options.merge_coplanar = true;
    options.export.format = EXPORT_PLY;
    operate(&shape, &options, 0, &out);
    assert_true(facts_manifold(&out.facts));
    operated_clear(&out);
    shape_free(&shape);
}

/* Two planes within the same three edges, one of one face and one of three, became the same
 * triangle twice when planes were merged. */
static void planes_that_share_their_outline(void **state)
{
    (void)state;
    struct shape shape = {0};
    struct topology_options options;
    struct operated out;
    uint32_t a = shape_vertex(&shape, 1, 1, 1), b = shape_vertex(&shape, -1, -1, 1);
    uint32_t c = shape_vertex(&shape, 2.5, 3.375, 0.125), d = shape_vertex(&shape, 1, 1, 1);
    shape_triangle(&shape, a, c, b);
    shape_triangle(&shape, a, b, d);
    shape_triangle(&shape, a, d, c);
    shape_triangle(&shape, b, c, d);
    topology_defaults(&options);
    options.merge_coplanar = true;
    options.export.format = EXPORT_PLY;
    operate(&shape, &options, 0, &out);
    assert_true(facts_manifold(&out.facts));
    assert_int_equal(out.facts.euler, 2);
    operated_clear(&out);
    shape_free(&shape);
}

/* The list of junctions was written one behind its end where a patch ended a list that was just
 * full (the sanitizer is what fails here): spheres on a coarse grid, one a size. */
static void lists_of_junctions_that_are_just_full(void **state)
{
    (void)state;
    const char *input = test_path("sphere.ply"), *store = test_path("store");
    const char *chains = test_path("chains");
    for (unsigned step = 4; step <= 64; step *= 2) {
        struct context ctx;
        struct shape shape = shape_icosphere(2);
        for (size_t i = 0; i < 3 * shape.vertex_count; i++)
            shape.positions[i] = rint(shape.positions[i] * step) / step;
        shape_write(&shape, SHAPE_PLY_LITTLE, input);
        shape_free(&shape);
        struct import_options import = {.slab_shift = 0};
        struct target target = {
            .kind = TARGET_FACES, .count = 1, .values = {20}, .mode = MODE_COLLAPSE, .effort = 2};
        struct patch_request request = {.patch_angle = {-1, -1},
                                        .face_angle = {-1, -1},
                                        .smoothings = -1,
                                        .chain_tolerance = -1};
        context_init(&ctx);
        assert_int_equal(store_build(&ctx, &input, 1, store, &import, NULL), STATUS_OK);
        assert_int_equal(chain_build(&ctx, store, chains, &target, &request, NULL), STATUS_OK);
        assert_int_equal(chain_file_check(&ctx, chains), STATUS_OK);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_chain_file_with_a_forged_origin_or_box),
        cmocka_unit_test(a_chain_file_that_claims_many_faces),
        cmocka_unit_test(a_chain_file_with_a_forged_attribute),
        cmocka_unit_test(a_chain_file_whose_patches_do_not_join),
        cmocka_unit_test(a_chain_file_whose_faces_share_an_edge_wrongly),
        cmocka_unit_test(a_ply_without_attributes),
        cmocka_unit_test(a_number_that_is_too_long),
        cmocka_unit_test(a_closed_mesh_in_one_plane),
        cmocka_unit_test(planes_that_share_their_outline),
        cmocka_unit_test(lists_of_junctions_that_are_just_full),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
