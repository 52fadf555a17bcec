/*
 * Every real file that there is: what import found must be what a slow count on the raw input
 * finds, and the store must be a manifold with the topology that it says. Counts that are known
 * from elsewhere (the data's README, DESIGN.md) are checked against the files they belong to.
 */
#include "test_kit.h"

#include <stdio.h>
#include <string.h>

#include "mesh/import.h"
#include "mesh/store.h"
#include "test_facts.h"
#include "test_shapes.h"

struct known {
    const char *name;
    uint64_t vertices, triangles;            /* of the input */
    int64_t floor, border_edges, components; /* of the store; -1: not known beforehand */
};

static const struct known files[] = {
    {"blade.off.gz", 8231, 16222, -1, -1, -1},
    {"blobby-shuffled.off", 2027, 4050, 4, 0, 1},
    {"cad_42400.stl", 33108, 11036, -1, 0, -1},
    {"cad_box.stl", 36, 12, 4, 0, 1},
    {"cad_cycloidal_coloured_nonmanifold.ply", 21384, 43368, -1, -1, -1},
    {"cad_gears.stl.gz", 58278, 19426, -1, 0, 7},
    {"cad_m3_hex_nut.stl", 1860, 620, -1, 0, 1},
    {"couplingdown.off", 1841, 3714, 60, 0, 1},
    {"ct_cranium_open.ply.gz", 205777, 399757, 6823, 14135, 393},
    {"cube_poly.off", 8, 12, 4, 0, 1},
    {"double-torus-example.off", 231, 466, 24, 0, 1},
    {"fandisk.off.gz", 6475, 12946, 4, 0, 1},
    {"femur.off", 3897, 7798, 24, 0, 1},
    {"holes.off", 4291, 8288, -1, 304, 1},
    {"koala.obj.gz", 49999, 99994, 4, 0, 1},
    {"mech-holes-shark.off", 5246, 10192, -1, 304, 1},
    {"mri_brain_3m.ply.gz", 1531048, 3062768, 5056, 0, 523},
    {"mushroom.off", 2337, 4608, -1, 64, 1},
    {"photogrammetry_birdbath_holes.ply", 18796, 35079, -1, -1, -1},
    {"refined_elephant.off.gz", 44460, 88928, -1, 0, 1},
    {"rotor.off", 600, 1200, 14, 0, 1},
    {"skull.obj.gz", 49999, 100002, 24, 0, 1},
    {"stanford_bunny_ascii.ply", 35947, 69451, -1, 223, 1},
    {"stanford_dragon.ply.gz", 437645, 871414, 1615, 4270, 151},
    {"stanford_dragon_res2_nonmanifold.ply.gz", 100250, 202520, -1, -1, -1},
    {"stanford_dragon_res3_nonmanifold.ply.gz", 22998, 47794, -1, -1, -1},
};

static void compare_input(const struct facts *raw, const struct store_info *info)
{
    const struct cleaning *c = &info->cleaning;
    assert_int_equal(c->degenerate_faces, raw->degenerate);
    assert_int_equal(c->duplicate_faces, raw->duplicate);
    assert_int_equal(info->topology.faces + c->degenerate_faces + c->duplicate_faces, raw->faces);
    assert_int_equal(info->topology.vertices, raw->vertices + c->vertices_added);
    if (raw->degenerate || raw->duplicate)
        return;
    assert_int_equal(c->nonmanifold_edges, raw->nonmanifold_edges);
    /* A vertex at an edge of more than two faces may come out whole only if the edge did. */
    assert_true(c->nonmanifold_vertices >= raw->nonmanifold_vertices || raw->nonmanifold_edges > 0);
    if (raw->misoriented_edges == 0) {
        assert_int_equal(c->flipped_faces, 0);
        assert_int_equal(c->nonorientable_components, 0);
    } else {
        assert_true(c->flipped_faces + c->cut_edges > 0);
    }
    if (c->vertices_added == 0) {
        assert_int_equal(info->topology.edges, raw->edges);
        assert_int_equal(info->topology.border_edges, raw->border_edges);
        assert_int_equal(info->topology.border_loops, raw->border_loops);
        assert_int_equal(info->topology.components, raw->components);
    }
}

static void compare_known(const struct known *known, const struct store_info *info)
{
    const struct cleaning *c = &info->cleaning;
    assert_int_equal(c->input_vertices, known->vertices);
    assert_int_equal(info->topology.faces + c->degenerate_faces + c->duplicate_faces,
                     known->triangles);
    if (known->floor >= 0)
        assert_int_equal(info->topology.floor, known->floor);
    if (known->border_edges >= 0)
        assert_int_equal(info->topology.border_edges, known->border_edges);
    if (known->components >= 0)
        assert_int_equal(info->topology.components, known->components);
}

static void compare_store(struct context *ctx, const char *path, const struct store_info *info)
{
    struct store *store;
    struct mesh mesh;
    assert_int_equal(store_open(ctx, path, true, &store), STATUS_OK);
    assert_int_equal(store_load(store, &mesh), STATUS_OK);
    struct facts facts = facts_of(&mesh);
    assert_true(facts_manifold(&facts));
    assert_int_equal(facts.unused, 0);
    assert_int_equal(info->topology.vertices, facts.vertices);
    assert_int_equal(info->topology.edges, facts.edges);
    assert_int_equal(info->topology.faces, facts.faces);
    assert_int_equal(info->topology.border_edges, facts.border_edges);
    assert_int_equal(info->topology.border_loops, facts.border_loops);
    assert_int_equal(info->topology.components, facts.components);
    assert_int_equal(info->topology.euler, facts.euler);
    mesh_clear(ctx, &mesh);
    store_close(&store);
}

static void check_file(const struct known *known, const char *path)
{
    const char *output = test_path("data.store");
    struct context ctx;
    struct store_info info;
    struct mesh raw;
    struct import_options options = {0};
    context_init(&ctx);
    ctx.threads = 2;
    if (store_build(&ctx, &path, 1, output, &options, &info) != STATUS_OK)
        fail_msg("%s", ctx.error);
    if (store_check(&ctx, output) != STATUS_OK)
        fail_msg("%s", ctx.error);
    compare_known(known, &info);
    assert_int_equal(mesh_load(&ctx, path, &raw), STATUS_OK);
    struct facts facts = facts_of(&raw);
    mesh_clear(&ctx, &raw);
    compare_input(&facts, &info);
    compare_store(&ctx, output, &info);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    remove(output);
}

static void real_files(void **state)
{
    (void)state;
    size_t found = 0;
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        const char *path = test_data(files[i].name);
        if (!path)
            continue;
        found++;
        print_message("%s\n", files[i].name);
        check_file(&files[i], path);
    }
    if (found == 0) {
        print_message("the folder of real meshes is absent: skipped\n");
        skip();
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(real_files),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
