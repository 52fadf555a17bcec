/*
 * quality_of_mesh against what is known of shapes built in code: counts, topology, floor, and every
 * kind of damage.
 */
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "inspect/quality.h"
#include "test_kit.h"
#include "test_shapes.h"

static struct quality quality_of(struct shape shape)
{
    struct context ctx;
    struct mesh mesh;
    struct quality quality;
    context_init(&ctx);
    shape_into_mesh(&ctx, &shape, &mesh);
    assert_int_equal(quality_of_mesh(&ctx, &mesh, &quality), STATUS_OK);
    mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return quality;
}

static void expect(struct quality q, int64_t euler, uint64_t components, uint64_t loops,
                   int64_t genus, uint64_t floor)
{
    assert_true(q.is_manifold);
    assert_int_equal(q.topology.euler, euler);
    assert_int_equal((int64_t)(q.topology.vertices - q.topology.edges + q.topology.faces), euler);
    assert_int_equal(q.topology.components, components);
    assert_int_equal(q.topology.border_loops, loops);
    assert_int_equal(q.genus, genus);
    assert_int_equal(q.topology.floor, floor);
    assert_int_equal(q.nonmanifold_vertices + q.nonmanifold_edges + q.misoriented_edges, 0);
}

static void closed_shapes(void **state)
{
    (void)state;
    expect(quality_of(shape_tetrahedron()), 2, 1, 0, 0, 4);
    expect(quality_of(shape_icosphere(3)), 2, 1, 0, 0, 4);
    expect(quality_of(shape_torus(20, 9)), 0, 1, 0, 1, 14);

    struct quality cube = quality_of(shape_cube_quads());
    expect(cube, 2, 1, 0, 0, 4);
    assert_int_equal(cube.topology.edges, 18);
    assert_true(cube.area > 0 && cube.volume > 0);
    double side = cube.box_high[0] - cube.box_low[0];
    assert_true(fabs(cube.area - 6 * side * side) < 1e-12 * cube.area);
    assert_true(fabs(cube.volume - side * side * side) < 1e-12 * cube.volume);
}

static void volume_far_from_the_origin(void **state)
{
    (void)state;
    struct shape shape = shape_icosphere(2);
    struct quality near = quality_of(shape_icosphere(2));
    shape_move(&shape, 1, 5e6, -3e6, 1e6);
    struct quality far = quality_of(shape);
    assert_true(fabs(far.volume - near.volume) < 1e-7 * near.volume);
    assert_true(fabs(far.area - near.area) < 1e-7 * near.area);
}

static void shapes_with_border(void **state)
{
    (void)state;
    expect(quality_of(shape_single_triangle()), 1, 1, 1, 0, 1);
    expect(quality_of(shape_grid(7, 5)), 1, 1, 1, 0, 1);
    expect(quality_of(shape_spiral_ramp(3, 20)), 1, 1, 1, 0, 1);
    /* 6 holes and the outside: 7 loops, Euler 1 - 6 */
    struct quality holes = quality_of(shape_grid_with_holes(12, 8));
    expect(holes, -5, 1, 7, 0, 31);
    assert_int_equal(holes.topology.border_edges, 2 * (12 + 8) + 6 * 4);
}

static void order_does_not_matter(void **state)
{
    (void)state;
    for (uint64_t seed = 1; seed < 6; seed++) {
        struct shape shape = shape_grid_with_holes(16, 16);
        struct shape other = shape_torus(12, 8);
        shape_append(&shape, &other);
        shape_free(&other);
        shape_fan(&shape);
        shape_shuffle(&shape, seed);
        expect(quality_of(shape), 1 - 16 + 0, 2, 17, 1, 3 * 17 + 30 + 14);
    }
}

static void not_orientable(void **state)
{
    (void)state;
    struct quality mobius = quality_of(shape_mobius(12, 3));
    assert_false(mobius.is_manifold);
    assert_int_equal(mobius.topology.border_loops, 1);
    assert_int_equal(mobius.topology.euler, 0);
    assert_true(mobius.misoriented_edges > 0);
    assert_int_equal(mobius.genus, 0);
    assert_int_equal(mobius.topology.floor, 0);

    struct quality klein = quality_of(shape_klein_bottle(12, 8));
    assert_false(klein.is_manifold);
    assert_int_equal(klein.topology.euler, 0);
    assert_int_equal(klein.genus, 0);
    assert_int_equal(klein.topology.border_loops, 0);
}

static void wrongly_oriented(void **state)
{
    (void)state;
    struct shape shape = shape_torus(10, 8);
    shape_flip(&shape, 17);
    struct quality q = quality_of(shape);
    assert_false(q.is_manifold);
    assert_int_equal(q.misoriented_edges, 3);
    assert_int_equal(q.genus, 1); /* it can be oriented */
    assert_int_equal(q.nonmanifold_edges, 0);
}

static void touching_spheres(void **state)
{
    (void)state;
    struct quality vertex = quality_of(shape_spheres_touching_vertex(1));
    assert_false(vertex.is_manifold);
    assert_int_equal(vertex.nonmanifold_vertices, 1);
    assert_int_equal(vertex.nonmanifold_edges, 0);
    assert_int_equal(vertex.topology.components, 1);
    assert_int_equal(vertex.topology.euler, 3);

    struct quality edge = quality_of(shape_spheres_touching_edge(1));
    assert_false(edge.is_manifold);
    assert_int_equal(edge.nonmanifold_edges, 1);
}

/* Two triangles with one vertex in common: a bow-tie with two loops, one through each. */
static void bow_tie_loops(void **state)
{
    (void)state;
    struct shape shape = {0};
    uint32_t v[5];
    for (uint32_t i = 0; i < 5; i++)
        v[i] = shape_vertex(&shape, i, i * i, 0);
    shape_triangle(&shape, v[0], v[1], v[2]);
    shape_triangle(&shape, v[0], v[3], v[4]);
    struct quality q = quality_of(shape);
    assert_int_equal(q.nonmanifold_vertices, 1);
    assert_int_equal(q.topology.border_loops, 2);
    assert_int_equal(q.topology.border_edges, 6);
}

static void bad_faces(void **state)
{
    (void)state;
    struct shape shape = shape_grid(4, 4);
    shape_fan(&shape);
    size_t faces = shape.face_count;
    uint32_t a = shape.indices[0], b = shape.indices[1], c = shape.indices[2];
    shape_triangle(&shape, b, c, a);
    shape_triangle(&shape, c, b, a);
    shape_triangle(&shape, a, b, b);
    shape_triangle(&shape, c, c, c);
    shape_vertex(&shape, 9, 9, 9);
    shape_vertex(&shape, 9, 9, 9);
    uint32_t d = shape_vertex(&shape, 20, 0, 0), e = shape_vertex(&shape, 21, 0, 0),
             f = shape_vertex(&shape, 22, 0, 0);
    shape_triangle(&shape, d, e, f);
    struct quality q = quality_of(shape);
    assert_int_equal(q.duplicate_faces, 2);
    assert_int_equal(q.degenerate_faces, 2);
    assert_int_equal(q.unreferenced_vertices, 2);
    assert_int_equal(q.coincident_vertices, 1);
    assert_int_equal(q.zero_area_faces, 1);
    assert_int_equal(q.topology.faces, faces + 3);
    assert_int_equal(q.topology.components, 2);
    assert_false(q.is_manifold);
    assert_true(q.box_high[0] == 22); /* unreferenced vertices do not count */
    assert_true(q.box_high[1] < 9);
}

static void empty_mesh(void **state)
{
    (void)state;
    struct shape shape = {0};
    struct quality q = quality_of(shape);
    assert_int_equal(q.topology.euler, 0);
    assert_int_equal(q.topology.components, 0);
    assert_true(q.box_low[0] == 0 && q.box_high[0] == 0);
}

static void index_out_of_range(void **state)
{
    (void)state;
    struct context ctx;
    struct quality quality;
    double positions[9] = {0};
    uint32_t faces[6] = {0, 1, 2, 1, 2, 3};
    struct mesh mesh = {.vertex_count = 3, .face_count = 2, .positions = positions, .faces = faces};
    context_init(&ctx);
    assert_int_equal(quality_of_mesh(&ctx, &mesh, &quality), STATUS_BAD_INPUT);
    assert_non_null(strstr(ctx.error, "face 1"));
    context_clear(&ctx);
}

/* A cone's tip has thousands of faces; a budget so small that corners are sorted on disk. */
static void large_vertex_small_memory(void **state)
{
    (void)state;
    enum { FACES = 20000 };
    struct shape shape = {0};
    uint32_t tip = shape_vertex(&shape, 0, 0, 1);
    uint32_t first = shape_vertex(&shape, 1, 0, 0);
    for (uint32_t i = 1; i < FACES; i++)
        shape_vertex(&shape, cos(i * 6.2831853 / FACES), sin(i * 6.2831853 / FACES), 0);
    for (uint32_t i = 0; i < FACES; i++)
        shape_triangle(&shape, tip, first + i, first + (i + 1) % FACES);
    shape_shuffle(&shape, 3);

    struct context ctx;
    struct mesh mesh;
    struct quality quality;
    context_init(&ctx);
    shape_into_mesh(&ctx, &shape, &mesh);
    ctx.memory_budget = ctx.memory_now + (3 << 20);
    assert_int_equal(quality_of_mesh(&ctx, &mesh, &quality), STATUS_OK);
    expect(quality, 1, 1, 1, 0, 1);
    assert_int_equal(quality.topology.border_edges, FACES);
    mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

/* Every allocation and write fails once: an error comes back and nothing is lost. */
static void failing_calls(void **state)
{
    (void)state;
    bool done = false;
    for (uint64_t n = 0; !done; n++) {
        struct context ctx;
        struct mesh mesh;
        struct quality quality;
        struct shape shape = shape_grid_with_holes(8, 8);
        shape_flip(&shape, 3);
        context_init(&ctx);
        shape_into_mesh(&ctx, &shape, &mesh);
        atomic_store(&ctx.fault_after, n);
        enum status status = quality_of_mesh(&ctx, &mesh, &quality);
        done = status == STATUS_OK;
        assert_true(done || ctx.error[0]);
        mesh_clear(&ctx, &mesh);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
        assert_true(n < 10000);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(closed_shapes),      cmocka_unit_test(volume_far_from_the_origin),
        cmocka_unit_test(shapes_with_border), cmocka_unit_test(order_does_not_matter),
        cmocka_unit_test(not_orientable),     cmocka_unit_test(wrongly_oriented),
        cmocka_unit_test(touching_spheres),   cmocka_unit_test(bow_tie_loops),
        cmocka_unit_test(bad_faces),          cmocka_unit_test(empty_mesh),
        cmocka_unit_test(index_out_of_range), cmocka_unit_test(large_vertex_small_memory),
        cmocka_unit_test(failing_calls),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
