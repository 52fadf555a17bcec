/*
 * Triangulated levels: manifold at every number of faces, with the rules for what two patches both
 * want; and the diagonals' improvement by flips.
 */
#include "simplify/patch_triangulate.h"

#include "base/memory.h"
#include "simplify/lod_sequence.h"
#include "test_facts.h"
#include "test_kit.h"
#include "test_patches.h"
#include "test_shapes.h"

static struct context ctx;

static int set_up(void **state)
{
    (void)state;
    context_init(&ctx);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return 0;
}

/* The faces as a mesh that borrows them. */
static struct facts level_facts(const struct chain_graph *graph, const struct level_faces *level)
{
    double *positions = test_calloc(3 * (size_t)graph->vertex_count, sizeof *positions);
    struct mesh mesh = {.vertex_count = graph->vertex_count,
                        .face_count = level->count,
                        .positions = positions,
                        .faces = level->faces};
    struct facts facts = facts_of(&mesh);
    test_free(positions);
    return facts;
}

static void level_must_hold(struct chain_graph *graph, struct level_faces *level,
                            const struct facts *whole)
{
    assert_int_equal(level->blocked, 0);
    struct facts facts = level_facts(graph, level);
    assert_true(facts_manifold(&facts));
    assert_true(facts_same_topology(whole, &facts));
}

/* All levels of one cutting, down to where nothing more goes. Returns the fewest faces met. */
static size_t walk_down(struct shape shape, uint32_t most_faces, uint64_t seed)
{
    struct mesh mesh;
    struct patch_set patches;
    struct chain_graph graph;
    struct lod_sequence sequence;
    struct cost_options options = {0.9};
    struct level_faces level = {0};
    size_t fewest = SIZE_MAX;
    shape_into_mesh(&ctx, &shape, &mesh);
    struct facts whole = facts_of(&mesh);
    patch_set_build(&mesh, most_faces, 1 + (uint32_t)seed % 2, seed, &patches);
    patch_set_graph(&ctx, &patches, &graph);
    assert_int_equal(lod_sequence_begin(&graph, &options, &sequence), STATUS_OK);
    while (!sequence.exhausted) {
        assert_int_equal(patch_triangulate(&graph, &level), STATUS_OK);
        assert_int_equal(level.count, chain_graph_faces(&graph) + 2 * level.fans);
        level_must_hold(&graph, &level, &whole);
        fewest = level.count < fewest ? level.count : fewest;
        assert_int_equal(lod_sequence_run(&sequence, chain_graph_faces(&graph) - 1, INFINITY),
                         STATUS_OK);
    }
    level_faces_clear(&ctx, &level);
    lod_sequence_end(&sequence);
    chain_graph_clear(&graph);
    patch_set_free(&patches);
    mesh_clear(&ctx, &mesh);
    return fewest;
}

static void every_level_is_manifold(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed < 9; seed++)
        for (uint32_t most = 1; most <= 64; most *= 4) {
            unsigned a = (unsigned)seed;
            assert_int_equal(walk_down(shape_icosphere(1 + a % 2), most, seed), 4);
            assert_int_equal(walk_down(shape_grid(2 + a, 3 + a % 4), most, seed), 1);
            assert_int_equal(walk_down(shape_spiral_ramp(2, 6), most, seed), 1);
            assert_int_equal(walk_down(shape_noisy_slab(5, 0.02, seed), most, seed), 4);
            assert_in_range(walk_down(shape_torus(3 + a, 3 + a % 5), most, seed), 14, 22);
            assert_in_range(walk_down(shape_grid_with_holes(8, 8), most, seed), 21, 26);
        }
}

/* A tetrahedron, or any sphere, of two patches with one common loop of three corners: the two
 * triangles would be one face twice. */
static void double_triangle_becomes_a_fan(void **state)
{
    (void)state;
    unsigned fans = 0;
    for (uint64_t seed = 1; seed < 20; seed++) {
        struct shape shape = shape_tetrahedron();
        struct mesh mesh;
        struct patch_set patches;
        struct chain_graph graph;
        struct level_faces level = {0};
        shape_into_mesh(&ctx, &shape, &mesh);
        struct facts whole = facts_of(&mesh);
        patch_set_build(&mesh, 4, 1, seed, &patches);
        patch_set_graph(&ctx, &patches, &graph);
        assert_int_equal(patch_triangulate(&graph, &level), STATUS_OK);
        level_must_hold(&graph, &level, &whole);
        assert_int_equal(level.count, 4);
        fans += (unsigned)level.fans;
        level_faces_clear(&ctx, &level);
        chain_graph_clear(&graph);
        patch_set_free(&patches);
        mesh_clear(&ctx, &mesh);
    }
    assert_true(fans > 0);
}

/* Faces come by twos, the mesh stays one, and no vertex is taken twice. */
static void refining_adds_pairs(void **state)
{
    (void)state;
    struct shape shape = shape_icosphere(3);
    struct mesh mesh;
    struct patch_set patches;
    struct chain_graph graph;
    struct level_faces level = {0};
    shape_into_mesh(&ctx, &shape, &mesh);
    struct facts whole = facts_of(&mesh);
    patch_set_build(&mesh, 60, 2, 3, &patches);
    patch_set_graph(&ctx, &patches, &graph);
    for (uint64_t pairs = 0; pairs < 12; pairs++) {
        assert_int_equal(patch_triangulate(&graph, &level), STATUS_OK);
        size_t before = level.count;
        assert_int_equal(patch_refine(&level, pairs), STATUS_OK);
        assert_int_equal(level.count, before + 2 * pairs);
        level_must_hold(&graph, &level, &whole);
    }
    level_faces_clear(&ctx, &level);
    chain_graph_clear(&graph);
    patch_set_free(&patches);
    mesh_clear(&ctx, &mesh);
}

/* Forbidden by a caller, for the tests of flips. */
static bool all_but_one(void *user, uint32_t i, uint32_t j)
{
    const uint32_t *pair = user;
    return !((pair[0] == i && pair[1] == j) || (pair[0] == j && pair[1] == i));
}

static double area_of(const double *points, const uint32_t *triangles, uint32_t n)
{
    double area = 0;
    for (uint32_t t = 0; t < n - 2; t++)
        area += vec3_length(triangle_normal(vec3_load(points + 3 * (size_t)triangles[3 * t]),
                                            vec3_load(points + 3 * (size_t)triangles[3 * t + 1]),
                                            vec3_load(points + 3 * (size_t)triangles[3 * t + 2])));
    return area / 2;
}

/* A quarter of a pipe, cut badly: flips must find the diagonals along it, whose area is least. */
static void flips_follow_the_bend(void **state)
{
    (void)state;
    enum { STEPS = 6, N = 2 * (STEPS + 1) };
    double points[3 * N], normal[3] = {0, 0.7, 0.7};
    uint32_t fan[3 * (N - 2)], nothing[2] = {N, N};
    struct flip_room room = {0};
    for (int i = 0; i <= STEPS; i++) {
        double angle = 1.5707963 * i / STEPS;
        for (int side = 0; side < 2; side++) {
            double *p = points + 3 * (side == 0 ? i : N - 1 - i);
            p[0] = side == 0 ? 0 : 4;
            p[1] = cos(angle);
            p[2] = sin(angle);
        }
    }
    for (uint32_t t = 0; t < N - 2; t++) {
        fan[3 * t] = 0;
        fan[3 * t + 1] = t + 1;
        fan[3 * t + 2] = t + 2;
    }
    double before = area_of(points, fan, N), strip = 0;
    for (int i = 0; i < STEPS; i++)
        strip += 4 * 2 * sin(1.5707963 / STEPS / 2);
    assert_int_equal(patch_flip(&ctx, &room, points, N, normal, all_but_one, nothing, fan),
                     STATUS_OK);
    double after = area_of(points, fan, N);
    assert_true(after < before);
    assert_true(fabs(after - strip) < 0.02 * strip);
    flip_room_clear(&ctx, &room);
}

/* A flat quadrangle with one good diagonal, which is taken when it is allowed. */
static void flips_ask_first(void **state)
{
    (void)state;
    double points[12] = {0, 0, 0, 10, -1, 0, 20, 0, 0, 10, 1, 0}, normal[3] = {0, 0, 1};
    struct flip_room room = {0};
    for (int allowed = 0; allowed < 2; allowed++) {
        uint32_t triangles[6] = {0, 1, 2, 0, 2, 3};
        uint32_t pair[2] = {allowed ? 0 : 1, allowed ? 2 : 3};
        assert_int_equal(patch_flip(&ctx, &room, points, 4, normal, all_but_one, pair, triangles),
                         STATUS_OK);
        bool flipped = false;
        for (int c = 0; c < 6; c++) {
            uint32_t a = triangles[c], b = triangles[c - c % 3 + (c + 1) % 3];
            flipped = flipped || (a == 1 && b == 3);
        }
        assert_int_equal(flipped, allowed);
    }
    flip_room_clear(&ctx, &room);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(every_level_is_manifold, set_up, tear_down),
        cmocka_unit_test_setup_teardown(double_triangle_becomes_a_fan, set_up, tear_down),
        cmocka_unit_test_setup_teardown(refining_adds_pairs, set_up, tear_down),
        cmocka_unit_test_setup_teardown(flips_follow_the_bend, set_up, tear_down),
        cmocka_unit_test_setup_teardown(flips_ask_first, set_up, tear_down),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
