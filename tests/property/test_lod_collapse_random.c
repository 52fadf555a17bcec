/*
 * Mode collapse over many small slabs: the small meshes of random patches, joined, are manifold
 * with the topology they came from; so is every level that lod_build writes, whatever the threads,
 * with the faces asked for, and the same in any company.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "mesh/import.h"
#include "simplify/simplify.h"
#include "simplify/small_bulge.h"
#include "simplify/small_mesh.h"
#include "test_chains.h"
#include "test_facts.h"
#include "test_files.h"
#include "test_kit.h"
#include "test_patches.h"
#include "test_shapes.h"

#define must(call) assert_int_equal((call), STATUS_OK)

enum { SHAPES = 7 };

static struct shape make_shape(unsigned kind, uint64_t *random)
{
    const double noise = 0.04 * random_unit(random);
    struct shape shape, other;
    switch (kind) {
    case 0:
        return shape_noisy_sphere(3, noise, random_next(random));
    case 1:
        return shape_noisy_torus(30, 14, noise, random_next(random));
    case 2:
        return shape_noisy_slab(20, noise, random_next(random));
    case 3:
        return shape_grid_with_holes(20, 16);
    case 4:
        return shape_spiral_ramp(3, 24);
    case 5:
        return shape_grid(20, 20);
    default:
        shape = shape_icosphere(3);
        other = shape_tetrahedron();
        shape_append(&shape, &other);
        shape_free(&other);
        return shape;
    }
}

/* A small mesh as a mesh, for counting. */
static struct mesh as_mesh(struct context *ctx, const struct small_mesh *small)
{
    const struct collapse_mesh *from = &small->triangles;
    struct mesh mesh = {.vertex_count = from->vertex_count, .face_count = from->face_count};
    must(memory_take(ctx, mesh.vertex_count, 24, &mesh.positions));
    must(memory_take(ctx, mesh.face_count, 12, &mesh.faces));
    for (size_t i = 0; i < 3 * mesh.vertex_count; i++)
        mesh.positions[i] = (double)from->positions[i];
    memcpy(mesh.faces, from->faces, 12 * mesh.face_count);
    return mesh;
}

/* Joins blocks [0, count) pair by pair along the curve, checking each mesh on the way. */
static void join_all(struct context *ctx, struct small_mesh *parts, uint32_t count,
                     struct small_mesh *whole)
{
    uint32_t span = 1, nodes = count;
    while (nodes > 1) {
        uint32_t parents = 0;
        for (uint32_t i = 0; i < nodes; i += 3) {
            const uint32_t width = nodes - i < 3 ? nodes - i : 3;
            struct small_mesh joined;
            const uint32_t end = (i + width) * span < count ? (i + width) * span : count;
            must(small_mesh_join(ctx, 0, i * span, end, parts + i, width, &joined));
            struct mesh mesh = as_mesh(ctx, &joined);
            const struct facts facts = facts_of(&mesh);
            assert_true(facts_manifold(&facts));
            mesh_clear(ctx, &mesh);
            parts[parents++] = joined;
        }
        nodes = parents;
        span *= 3;
    }
    *whole = parts[0];
    assert_int_equal(whole->seam_count, 0);
}

/* Small meshes of random patches of a shape, which is freed. */
static void check_small_meshes(struct context *ctx, struct shape *shape, unsigned round,
                               uint64_t *random)
{
    struct mesh mesh;
    struct patch_set set;
    struct small_workspace space = {0};
    shape_into_mesh(ctx, shape, &mesh);
    const struct facts was = facts_of(&mesh);
    const uint32_t blocks = 1 + (uint32_t)random_below(random, 12);
    patch_set_build(&mesh, 1 + (uint32_t)random_below(random, 60), blocks, random_next(random),
                    &set);
    const double tolerance = round % 4 == 0   ? 0
                             : round % 4 == 1 ? INFINITY
                                              : random_unit(random) * 0.3;
    const double given_back = round % 3 == 0 ? 0 : 0.4;
    struct small_mesh *parts = calloc(set.block_count, sizeof *parts), whole;
    assert_non_null(parts);
    for (uint32_t i = 0; i < set.block_count; i++) {
        const enum status status =
            small_mesh_build(ctx, &space, 0, &set.blocks[i], tolerance, given_back, &parts[i]);
        if (status != STATUS_OK)
            fail_msg("round %u: %s", round, ctx->error);
        if (round % 2 == 0) /* what is joined may be split or not */
            must(small_mesh_split(ctx, 0, &parts[i]));
        if (round % 2 == 1 && set.block_count > 1)
            continue;
        struct mesh part = as_mesh(ctx, &parts[i]);
        const struct facts facts = facts_of(&part);
        assert_true(facts_manifold(&facts));
        mesh_clear(ctx, &part);
    }
    join_all(ctx, parts, set.block_count, &whole);
    struct mesh joined = as_mesh(ctx, &whole);
    const struct facts is = facts_of(&joined);
    assert_true(facts_manifold(&is));
    assert_true(facts_same_topology(&was, &is));
    mesh_clear(ctx, &joined);
    small_mesh_clear(ctx, 0, &whole);
    small_workspace_clear(ctx, &space);
    free(parts);
    patch_set_free(&set);
    mesh_clear(ctx, &mesh);
}

static void small_meshes_keep_the_topology(void **state)
{
    (void)state;
    uint64_t random = 7;
    struct context ctx;
    context_init(&ctx);
    for (unsigned round = 0; round < 20 * SHAPES; round++) {
        struct shape shape = make_shape(round % SHAPES, &random);
        check_small_meshes(&ctx, &shape, round, &random);
    }
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

/* Rings round a vertex at which more edges meet than a list of edges has bits. */
static struct shape shape_hub(unsigned around, unsigned rings)
{
    struct shape shape = {0};
    const uint32_t hub = shape_vertex(&shape, 0, 0, 1);
    for (unsigned ring = 0; ring < rings; ring++)
        for (unsigned i = 0; i < around; i++) {
            const double angle = 2 * acos(-1) * i / around, radius = ring + 1;
            shape_vertex(&shape, radius * cos(angle), radius * sin(angle), i % 2 ? -0.3 : 0);
        }
    for (unsigned i = 0; i < around; i++) {
        const uint32_t a = hub + 1 + i, b = hub + 1 + (i + 1) % around;
        shape_triangle(&shape, hub, a, b);
        for (unsigned ring = 1; ring < rings; ring++) {
            const uint32_t in = (ring - 1) * around, out = ring * around;
            shape_triangle(&shape, a + in, a + out, b + out);
            shape_triangle(&shape, a + in, b + out, b + in);
        }
    }
    return shape;
}

static void hubs_keep_the_topology(void **state)
{
    (void)state;
    uint64_t random = 8;
    struct context ctx;
    context_init(&ctx);
    for (unsigned round = 0; round < 12; round++) {
        struct shape shape = shape_hub(400, 3);
        check_small_meshes(&ctx, &shape, round, &random);
    }
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void make_levels(struct context *ctx, const char *chains, const struct target *target,
                        enum placement place, const char *output, struct lod_report *report)
{
    const struct lod_options options = {.target = *target, .place = place, .output = output};
    const enum status status = lod_build(ctx, chains, &options, report);
    if (status != STATUS_TARGET_MISSED)
        assert_int_equal(status, STATUS_OK);
}

static void check_level(struct context *ctx, const char *path, const struct facts *was,
                        const struct level *level)
{
    struct mesh mesh;
    must(mesh_load(ctx, path, &mesh));
    const struct facts is = facts_of(&mesh);
    assert_true(facts_manifold(&is));
    assert_true(facts_same_topology(was, &is));
    assert_int_equal(mesh.face_count, level->faces);
    if (level->reason == STOP_REACHED && level->wanted_faces > 0)
        assert_true(level->faces == level->wanted_faces || level->faces + 1 == level->wanted_faces);
    mesh_clear(ctx, &mesh);
}

/* A random mesh, and the chain file of it in small slabs, made for counts of these parts of its
 * faces. */
static void make_chains(struct context *ctx, unsigned round, uint64_t *random, const double *parts,
                        uint32_t count, const char *chains, struct mesh *mesh)
{
    struct shape shape = make_shape(round % SHAPES, random);
    struct slab_set slabs;
    struct chain_set set;
    shape_into_mesh(ctx, &shape, mesh);
    slab_set_build(mesh, 60 + (uint32_t)random_below(random, 700), &slabs);
    const double angle = 4 + 20 * random_unit(random);
    const struct patch_options patch =
        test_patch_options(angle, angle * 0.9, (uint32_t)random_below(random, 3));
    chain_set_build(ctx, &slabs, &patch, &set);
    set.info.area = mesh_area(mesh);
    set.info.topology.faces = mesh->face_count;
    set.info.target_kind = TARGET_FACES;
    set.info.target_count = count;
    for (uint32_t i = 0; i < count; i++)
        set.info.targets[i] = floor(parts[i] * (double)mesh->face_count);
    chain_set_write(&set, chains, 0);
    chain_set_free(&set);
    slab_set_free(&slabs);
}

static void must_be_alike(const char *path, const char *other)
{
    size_t size[2];
    unsigned char *bytes[2] = {file_read(path, &size[0]), file_read(other, &size[1])};
    assert_non_null(bytes[0]);
    assert_non_null(bytes[1]);
    assert_int_equal(size[0], size[1]);
    assert_memory_equal(bytes[0], bytes[1], size[0]);
    free(bytes[0]);
    free(bytes[1]);
}

static void levels_keep_the_topology(void **state)
{
    (void)state;
    const double parts[] = {0.25, 0.1};
    uint64_t random = 11;
    for (unsigned round = 0; round < 6 * SHAPES; round++) {
        struct context ctx;
        struct mesh mesh;
        char path[2][256], output[2][256], chains[256];
        snprintf(chains, sizeof chains, "%s", test_path("lod.chains"));
        context_init(&ctx);
        make_chains(&ctx, round, &random, parts, round % 3, chains, &mesh);
        const struct facts was = facts_of(&mesh);
        struct target target = {.kind = TARGET_FACES, .count = 2, .mode = MODE_COLLAPSE};
        target.effort = 1 + round % 3;
        target.values[0] = (double)(mesh.face_count / 4);
        target.values[1] = (double)(mesh.face_count / 10);
        struct lod_report report;
        for (unsigned threads = 1; threads <= 2; threads++) {
            ctx.threads = threads;
            snprintf(output[threads - 1], sizeof output[0], "%s",
                     test_path(threads == 1 ? "one-%d.ply" : "two-%d.ply"));
            make_levels(&ctx, chains, &target, round % 2 ? PLACE_SUBSET : PLACE_OPTIMAL,
                        output[threads - 1], &report);
        }
        for (unsigned level = 0; level < report.level_count; level++) {
            for (int i = 0; i < 2; i++) {
                char name[32];
                snprintf(name, sizeof name, "%s-%u.ply", i ? "two" : "one", level);
                snprintf(path[i], sizeof path[i], "%s", test_path(name));
            }
            check_level(&ctx, path[0], &was, &report.levels[level]);
            must_be_alike(path[0], path[1]);
        }
        mesh_clear(&ctx, &mesh);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
}

/* A level is the same, byte for byte, made alone or with any others that are not finer than what
 * the file was made for; also where levels are made several times, and below the file's own. */
static void levels_do_not_depend_on_company(void **state)
{
    (void)state;
    const double parts[] = {0.5, 0.2, 0.06};
    /* of the file's own, between them, below them, and nearly alike */
    const double wanted[] = {0.5, 0.45, 0.21, 0.2, 0.19, 0.1, 0.06, 0.055, 0.02};
    enum { WANTED = sizeof wanted / sizeof *wanted };
    uint64_t random = 23;
    for (unsigned round = 0; round < 3 * SHAPES; round++) {
        struct context ctx;
        struct mesh mesh;
        struct lod_report all, one;
        char chains[256], path[256], name[32];
        snprintf(chains, sizeof chains, "%s", test_path("company.chains"));
        context_init(&ctx);
        make_chains(&ctx, round, &random, parts, 1 + round % 3, chains, &mesh);
        const enum placement place = round % 2 ? PLACE_SUBSET : PLACE_OPTIMAL;
        struct target target = {.kind = TARGET_FACES, .count = WANTED, .mode = MODE_COLLAPSE};
        target.effort = 1 + round / SHAPES % 3;
        for (unsigned i = 0; i < WANTED; i++)
            target.values[i] = floor(wanted[i] * (double)mesh.face_count);
        make_levels(&ctx, chains, &target, place, test_path("all-%d.ply"), &all);
        target.count = 1;
        for (unsigned i = 0; i < WANTED; i++) {
            target.values[0] = floor(wanted[i] * (double)mesh.face_count);
            snprintf(path, sizeof path, "%s", test_path("alone.ply"));
            make_levels(&ctx, chains, &target, place, path, &one);
            assert_int_equal(one.levels[0].faces, all.levels[i].faces);
            assert_true(one.levels[0].error == all.levels[i].error);
            assert_int_equal(one.levels[0].reason, all.levels[i].reason);
            snprintf(name, sizeof name, "all-%u.ply", i);
            must_be_alike(test_path(name), path);
        }
        mesh_clear(&ctx, &mesh);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
}

/* Six times the volume that the small mesh of a shape's patches encloses. */
static double small_volume(struct shape shape, double given_back)
{
    struct context ctx;
    struct mesh mesh;
    struct slab_set slabs;
    struct chain_set set;
    struct small_workspace space = {0};
    struct small_mesh small;
    double volume = 0;
    context_init(&ctx);
    shape_into_mesh(&ctx, &shape, &mesh);
    slab_set_build(&mesh, (uint32_t)mesh.face_count, &slabs);
    const struct patch_options patch = test_patch_options(12, 11, 0);
    chain_set_build(&ctx, &slabs, &patch, &set);
    must(small_mesh_build(&ctx, &space, 0, &set.blocks[0], 0, given_back, &small));
    for (size_t f = 0; f < (size_t)small.triangles.face_count; f++) {
        const float *p[3];
        for (size_t k = 0; k < 3; k++)
            p[k] = small.triangles.positions + 3 * (size_t)small.triangles.faces[3 * f + k];
        for (int k = 0; k < 3; k++) {
            const int l = (k + 1) % 3, m = (k + 2) % 3;
            volume += (double)p[0][k] *
                      ((double)p[1][l] * (double)p[2][m] - (double)p[1][m] * (double)p[2][l]);
        }
    }
    small_mesh_clear(&ctx, 0, &small);
    small_workspace_clear(&ctx, &space);
    chain_set_free(&set);
    slab_set_free(&slabs);
    mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return volume;
}

/* Flat patches on a sphere lose a part of its volume; most of it comes back. */
static void bulges_are_given_back(void **state)
{
    (void)state;
    const double whole = 8 * acos(-1);
    const double none = whole - small_volume(shape_icosphere(5), 0);
    const double most = whole - small_volume(shape_icosphere(5), 0.4);
    assert_true(none > 0.01 * whole);
    assert_true(fabs(most) < 0.5 * none);
}

static void what_is_held_or_flat_stays(void **state)
{
    (void)state;
    const uint32_t loop[3] = {0, 1, 2};
    const float up[3] = {0, 0, 1};
    struct bulge bulges[3] = {{{0}, 0}};
    float place[3] = {1, 2, 3};
    bulge_hold(bulges, 1);
    bulge_note(bulges, loop, 3, up, 1, 0.5);
    bulge_note(bulges, loop, 1, up, 1, 0);
    bulge_move(&bulges[0], 0.4, place); /* half of the height of two patches */
    assert_true(fabsf(place[2] - 3.1f) < 1e-6f && place[0] == 1 && place[1] == 2);
    bulge_move(&bulges[2], 0.4, place);
    assert_true(fabsf(place[2] - 3.3f) < 1e-6f);
    const float before = place[2];
    bulge_move(&bulges[1], 0.4, place);
    assert_true(place[2] == before);
    struct bulge other[3] = {{{0}, 0}};
    bulge_move(&other[0], 0.4, place);          /* of no patch */
    bulge_note(other, loop, 3, up, 1e6f, 1e-3); /* rounding, beside the patch's size */
    bulge_move(&other[0], 0.4, place);
    bulge_note(other, loop, 3, up, 1, 1e39); /* beyond floats */
    bulge_move(&other[0], 0.4, place);
    assert_true(place[2] == before && place[0] == 1 && place[1] == 2);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(what_is_held_or_flat_stays),
                                       cmocka_unit_test(bulges_are_given_back),
                                       cmocka_unit_test(small_meshes_keep_the_topology),
                                       cmocka_unit_test(hubs_keep_the_topology),
                                       cmocka_unit_test(levels_keep_the_topology),
                                       cmocka_unit_test(levels_do_not_depend_on_company)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
