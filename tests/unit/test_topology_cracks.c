/*
 * Cracks: sides that lie on each other become one, what gapes is filled, what is larger stays.
 * Closed shapes are cut along random trees of edges, and must come back as they were.
 */
#include "test_kit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test_topology_kit.h"

/* ---- cutting ---- */

static uint32_t root_of(uint32_t *parents, uint32_t i)
{
    while (parents[i] != i)
        i = parents[i] = parents[parents[i]];
    return i;
}

static size_t edge_at(const struct shape *shape, uint32_t a, uint32_t b)
{
    return (size_t)a * shape->vertex_count + b;
}

/*
 * The triangle shape with the edges in `cut` open: a byte a pair of vertices. Corners of a vertex
 * that no uncut edge joins get vertices of their own, each moved by up to `noise`.
 */
static struct shape shape_cut(const struct shape *shape, const unsigned char *cut, double noise,
                              uint64_t *state)
{
    size_t corners = 3 * shape->face_count;
    uint32_t *parents = malloc(corners * sizeof *parents), *numbers = malloc(corners * 4);
    uint32_t *starts = malloc(shape->vertex_count * shape->vertex_count * sizeof *starts);
    struct shape result = {0};
    for (uint32_t c = 0; c < corners; c++) {
        uint32_t next = c % 3 == 2 ? c - 2 : c + 1;
        parents[c] = c;
        numbers[c] = UINT32_MAX;
        starts[edge_at(shape, shape->indices[c], shape->indices[next])] = c;
    }
    for (uint32_t c = 0; c < corners; c++) {
        uint32_t next = c % 3 == 2 ? c - 2 : c + 1;
        uint32_t a = shape->indices[c], b = shape->indices[next];
        uint32_t other = starts[edge_at(shape, b, a)]; /* its corner at b */
        if (cut[edge_at(shape, a, b)])
            continue;
        parents[root_of(parents, next)] = root_of(parents, other);
    }
    for (uint32_t c = 0; c < corners; c++) {
        uint32_t root = root_of(parents, c);
        const double *at = shape->positions + 3 * (size_t)shape->indices[c];
        if (numbers[root] == UINT32_MAX)
            numbers[root] =
                shape_vertex(&result, (float)(at[0] + noise * (2 * random_unit(state) - 1)),
                             (float)(at[1] + noise * (2 * random_unit(state) - 1)),
                             (float)(at[2] + noise * (2 * random_unit(state) - 1)));
    }
    for (uint32_t f = 0; f < shape->face_count; f++)
        shape_triangle(&result, numbers[root_of(parents, 3 * f)],
                       numbers[root_of(parents, 3 * f + 1)], numbers[root_of(parents, 3 * f + 2)]);
    free(parents);
    free(numbers);
    free(starts);
    return result;
}

/* Marks random edges that form a forest. */
static unsigned char *random_trees(const struct shape *shape, unsigned percent, uint64_t *state)
{
    unsigned char *cut = calloc(shape->vertex_count * shape->vertex_count, 1);
    uint32_t *parents = malloc(shape->vertex_count * sizeof *parents);
    for (uint32_t v = 0; v < shape->vertex_count; v++)
        parents[v] = v;
    for (uint32_t c = 0; c < 3 * shape->face_count; c++) {
        uint32_t a = shape->indices[c], b = shape->indices[c % 3 == 2 ? c - 2 : c + 1];
        if (random_below(state, 100) >= percent || root_of(parents, a) == root_of(parents, b))
            continue;
        parents[root_of(parents, a)] = root_of(parents, b);
        cut[edge_at(shape, a, b)] = cut[edge_at(shape, b, a)] = 1;
    }
    free(parents);
    return cut;
}

/* ---- tests ---- */

static struct topology_options closing(double size)
{
    struct topology_options options;
    topology_defaults(&options);
    options.close_cracks.value = size;
    return options;
}

static void expect_closed(const struct operated *out, long euler, size_t faces)
{
    assert_true(facts_manifold(&out->facts));
    assert_int_equal(out->facts.border_edges, 0);
    assert_int_equal(out->facts.euler, euler);
    assert_int_equal(out->facts.faces, faces);
    assert_int_equal(out->report.blocked, 0);
}

static void cut_trees_close_again(void **state)
{
    (void)state;
    uint64_t random = 5;
    for (unsigned i = 0; i < 60; i++) {
        struct shape whole = i % 2 ? shape_noisy_sphere(2, 0.02, i) : shape_torus(16, 10);
        double noise = i % 3 == 2 ? 1e-3 : 0;
        shape_fan(&whole);
        unsigned char *cut = random_trees(&whole, 2 + i / 2, &random);
        struct shape shape = shape_cut(&whole, cut, noise, &random);
        struct topology_options options = closing(100);
        struct operated out;
        operate(&shape, &options, i % 5 ? 0 : 5, &out);
        expect_closed(&out, i % 2 ? 2 : 0, whole.face_count);
        assert_int_equal(out.facts.vertices, whole.vertex_count);
        assert_int_equal(out.report.zipped, shape.vertex_count - whole.vertex_count);
        struct mesh mesh;
        shape_to_mesh(&out.ctx, &whole, &mesh);
        double area = mesh_area(&mesh), moved = noise > 0 ? 0.05 : 1e-9;
        assert_true(fabs(mesh_area(&out.mesh) - area) <= moved * area);
        mesh_clear(&out.ctx, &mesh);
        operated_clear(&out);
        shape_free(&shape);
        shape_free(&whole);
        free(cut);
    }
}

/* A ball cut open along random trees of edges. *faces: of the whole one. */
static struct shape cut_ball(unsigned level, uint64_t seed, size_t *faces)
{
    struct shape whole = shape_icosphere(level);
    unsigned char *cut = random_trees(&whole, 10, &seed);
    struct shape shape = shape_cut(&whole, cut, 0, &seed);
    *faces = whole.face_count;
    shape_free(&whole);
    free(cut);
    return shape;
}

/* Without zipping the same cracks are covered by faces without area. */
static void tolerance_nought_only_fills(void **state)
{
    (void)state;
    size_t faces;
    struct shape shape = cut_ball(2, 9, &faces);
    struct topology_options options = closing(100);
    struct operated out;
    options.zip_tolerance.value = 0;
    operate(&shape, &options, 0, &out);
    assert_true(facts_manifold(&out.facts));
    assert_int_equal(out.facts.border_edges, 0);
    assert_int_equal(out.facts.euler, 2);
    assert_int_equal(out.report.zipped, 0);
    assert_true(out.facts.faces > faces);
    operated_clear(&out);
    shape_free(&shape);
}

/* One edge against three on the other side: the vertices go into the edge, and no face is added
 * for show. */
static void t_junctions_are_put_in(void **state)
{
    (void)state;
    for (unsigned turned = 0; turned < 2; turned++) {
        struct shape shape = {0};
        double y = turned ? -1 : 1;
        uint32_t a = shape_vertex(&shape, 0, 0, 0), b = shape_vertex(&shape, 4, 0, 0);
        uint32_t one = shape_vertex(&shape, 1, 0.001, 0), two = shape_vertex(&shape, 3, 0, 0.001);
        uint32_t top = shape_vertex(&shape, 2, 3 * y, 0), low = shape_vertex(&shape, 2, -3 * y, 0);
        uint32_t tip = shape_vertex(&shape, 2, 0, 5);
        const uint32_t faces[][3] = {{a, b, top},   {one, a, low}, {two, one, low}, {b, two, low},
                                     {a, top, tip}, {top, b, tip}, {low, a, tip},   {b, low, tip}};
        for (unsigned i = 0; i < 8; i++)
            if (turned)
                shape_triangle(&shape, faces[i][0], faces[i][2], faces[i][1]);
            else
                shape_triangle(&shape, faces[i][0], faces[i][1], faces[i][2]);
        struct topology_options options = closing(10);
        struct operated out;
        operate(&shape, &options, 0, &out);
        expect_closed(&out, 2, 10);
        assert_int_equal(out.report.zipped, 2);
        assert_int_equal(out.facts.vertices, 7);
        for (size_t f = 0; f < out.mesh.face_count; f++) {
            const uint32_t *c = out.mesh.faces + 3 * f;
            const double *p[3] = {out.mesh.positions + 3 * (size_t)c[0],
                                  out.mesh.positions + 3 * (size_t)c[1],
                                  out.mesh.positions + 3 * (size_t)c[2]};
            double u[3], v[3];
            for (unsigned k = 0; k < 3; k++) {
                u[k] = p[1][k] - p[0][k];
                v[k] = p[2][k] - p[0][k];
            }
            double x = u[1] * v[2] - u[2] * v[1], z = u[0] * v[1] - u[1] * v[0];
            double w = u[2] * v[0] - u[0] * v[2];
            assert_true(sqrt(x * x + w * w + z * z) > 1);
        }
        operated_clear(&out);
        shape_free(&shape);
    }
}

/* A tube cut lengthwise from one open end to the other: the seam has no end to zip from. */
static void a_seam_between_two_openings(void **state)
{
    (void)state;
    enum { AROUND = 12, LONG = 10 };
    struct shape shape = {0};
    uint32_t at[LONG + 1][AROUND + 1];
    for (unsigned i = 0; i <= LONG; i++)
        for (unsigned j = 0; j <= AROUND; j++) {
            double angle = 6.283185307179586 * (j % AROUND) / AROUND;
            at[i][j] = shape_vertex(&shape, (float)cos(angle), (float)sin(angle), i);
        }
    for (unsigned i = 0; i < LONG; i++)
        for (unsigned j = 0; j < AROUND; j++) {
            shape_triangle(&shape, at[i][j], at[i][j + 1], at[i + 1][j + 1]);
            shape_triangle(&shape, at[i][j], at[i + 1][j + 1], at[i + 1][j]);
        }
    struct topology_options options = closing(11);
    struct operated out;
    operate(&shape, &options, 0, &out);
    expect_closed(&out, 2, 2 * AROUND * LONG + 2 * (AROUND - 2));
    assert_int_equal(out.report.zipped, LONG + 1);
    operated_clear(&out);
    options.close_cracks.value = 9; /* the one loop is longer */
    operate(&shape, &options, 0, &out);
    assert_int_equal(out.facts.border_loops, 1);
    assert_int_equal(out.facts.border_edges, 2 * AROUND + 2 * LONG);
    assert_int_equal(out.report.zipped, 0);
    operated_clear(&out);
    shape_free(&shape);
}

/* A triangle by itself has no fill but itself: it is closed round a new vertex, records and all. */
static void a_triangle_alone_is_closed(void **state)
{
    (void)state;
    struct shape shape = shape_icosphere(1), alone = shape_single_triangle();
    shape_move(&alone, 0.25, 8, 0, 0);
    shape_append(&shape, &alone);
    struct topology_options options = closing(1);
    struct operated out;
    operate(&shape, &options, 0, &out);
    expect_closed(&out, 4, 80 + 4);
    assert_int_equal(out.facts.components, 2);
    assert_int_equal(out.facts.vertices, 42 + 4);
    operated_clear(&out);
    /* Where it is the lost piece of a hole, it goes back. */
    shape_free(&shape);
    shape_free(&alone);
    shape = shape_icosphere(1);
    for (unsigned k = 0; k < 3; k++) {
        const double *p = shape.positions + 3 * (size_t)shape.indices[k];
        shape.indices[k] = shape_vertex(&shape, p[0], p[1], p[2]);
    }
    operate(&shape, &options, 0, &out);
    expect_closed(&out, 2, 80);
    assert_int_equal(out.report.zipped, 3);
    operated_clear(&out);
    shape_free(&shape);
}

/* Two triangles folded onto each other must not become one twice. */
static void a_folded_pair_is_closed(void **state)
{
    (void)state;
    struct shape shape = {0};
    uint32_t a = shape_vertex(&shape, 0, 0, 0), b = shape_vertex(&shape, 4, 0, 0);
    uint32_t c = shape_vertex(&shape, 2, 3, 0), d = shape_vertex(&shape, 2, 3, 0);
    shape_triangle(&shape, a, b, c);
    shape_triangle(&shape, b, a, d);
    struct topology_options options = closing(10);
    struct operated out;
    operate(&shape, &options, 0, &out);
    expect_closed(&out, 2, 4);
    operated_clear(&out);
    shape_free(&shape);
}

/* No circle fits in a slit, however long it is; and the search for one ends. */
static void slits_are_small_by_their_circle(void **state)
{
    (void)state;
    size_t faces;
    struct shape shape = cut_ball(3, 3, &faces);
    struct topology_options options = closing(0.05);
    struct operated out;
    options.crack_inscribed = true;
    operate(&shape, &options, 0, &out);
    expect_closed(&out, 2, faces);
    operated_clear(&out);
    shape_free(&shape);
}

/* Two openings of one tube that meet are not sewn together: that would be a handle. */
static void no_handle_is_made(void **state)
{
    (void)state;
    enum { AROUND = 16, ALONG = 24 };
    struct shape torus = shape_torus(ALONG, AROUND);
    shape_fan(&torus);
    unsigned char *cut = calloc(torus.vertex_count * torus.vertex_count, 1);
    for (uint32_t i = 0; i < AROUND; i++) { /* once round the tube */
        uint32_t a = ALONG * i, b = ALONG * ((i + 1) % AROUND);
        cut[edge_at(&torus, a, b)] = cut[edge_at(&torus, b, a)] = 1;
    }
    uint64_t random = 1;
    struct shape shape = shape_cut(&torus, cut, 0, &random);
    struct topology_options options = closing(10);
    struct operated out;
    operate(&shape, &options, 0, &out);
    assert_true(facts_manifold(&out.facts));
    assert_int_equal(out.facts.border_edges, 0);
    assert_int_equal(out.facts.euler, 2);
    operated_clear(&out);
    shape_free(&shape);
    shape_free(&torus);
    free(cut);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cut_trees_close_again),
        cmocka_unit_test(tolerance_nought_only_fills),
        cmocka_unit_test(t_junctions_are_put_in),
        cmocka_unit_test(a_seam_between_two_openings),
        cmocka_unit_test(a_triangle_alone_is_closed),
        cmocka_unit_test(no_handle_is_made),
        cmocka_unit_test(a_folded_pair_is_closed),
        cmocka_unit_test(slits_are_small_by_their_circle),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
