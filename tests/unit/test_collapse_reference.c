/*
 * The copy of a mesh that collapses are measured by, against looking at every face.
 */
#include "test_kit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "geom/distance.h"
#include "simplify/collapse_internal.h"
#include "test_shapes.h"

enum { SHAPES = 4 };

/* Round, with a handle, thin with walls that are near each other, with a border. */
static struct shape make_shape(unsigned number)
{
    switch (number) {
    case 0:
        return shape_noisy_sphere(4, 0.01, 7);
    case 1:
        return shape_noisy_torus(60, 30, 0.02, 8);
    case 2:
        return shape_noisy_slab(24, 0.02, 9);
    default:
        return shape_grid_with_holes(40, 40);
    }
}

/* The mesh collapsed to an eighth of its faces, with its reference still there. */
static struct collapse *collapse_measured(struct context *ctx, unsigned number, uint32_t effort,
                                          uint64_t *faces_before)
{
    const struct collapse_options options = {.effort = effort, .measured = true};
    struct shape shape = make_shape(number);
    struct mesh mesh;
    struct collapse *collapse;
    shape_into_mesh(ctx, &shape, &mesh);
    *faces_before = mesh.face_count;
    assert_int_equal(collapse_begin(ctx, &options, mesh.vertex_count, mesh.face_count,
                                    mesh.positions, mesh.faces, NULL, NULL, NULL, &collapse),
                     STATUS_OK);
    assert_int_equal(collapse_run(collapse, mesh.face_count / 8, INFINITY), STATUS_OK);
    mesh_clear(ctx, &mesh);
    return collapse;
}

static struct vec3 live_position(const struct collapse *c, uint32_t v)
{
    return vec3_load_float(c->vertices[v].position);
}

static double distance_from_reference(const struct collapse *c, struct vec3 p)
{
    const struct reference *r = &c->reference;
    double least = INFINITY;
    for (size_t f = 0; f < r->face_count; f++) {
        const uint32_t *corner = r->faces + 3 * f;
        const struct triangle triangle = {vec3_load(r->positions + 3 * (size_t)corner[0]),
                                          vec3_load(r->positions + 3 * (size_t)corner[1]),
                                          vec3_load(r->positions + 3 * (size_t)corner[2])};
        least = fmin(least, triangle_distance_squared(p, &triangle, NULL));
    }
    return sqrt(least);
}

static double distance_from_surface(const struct collapse *c, struct vec3 p)
{
    double least = INFINITY;
    for (size_t f = 0; f < c->face_slots; f++) {
        const struct collapse_corner *corner = c->corners + 3 * f;
        if (corner[0].end == NO_INDEX)
            continue;
        const struct triangle triangle = {live_position(c, corner[0].end),
                                          live_position(c, corner[1].end),
                                          live_position(c, corner[2].end)};
        least = fmin(least, triangle_distance_squared(p, &triangle, NULL));
    }
    return sqrt(least);
}

static struct vec3 between(struct vec3 a, struct vec3 b, double t)
{
    return vec3_add(vec3_scale(a, 1 - t), vec3_scale(b, t));
}

/* Over all vertices, all points, all witnesses and all edges, cut into so many parts; 2: only the
 * surface's. */
static double largest_of_all(const struct collapse *c, unsigned parts)
{
    const struct reference *r = &c->reference;
    double largest = 0;
    for (uint32_t v = 0; v < c->vertex_slots; v++) {
        float offset[3];
        if (c->vertices[v].corner == NO_INDEX)
            continue;
        witness_get(c, v, offset);
        const struct vec3 witness = vec3_add(live_position(c, v), vec3_load_float(offset));
        largest = fmax(largest, distance_from_reference(c, live_position(c, v)));
        largest = fmax(largest, distance_from_surface(c, witness));
    }
    for (uint32_t i = 0; i < 3 * c->face_slots; i++) {
        if (c->corners[i].end == NO_INDEX)
            continue;
        const struct vec3 a = live_position(c, c->corners[i].end);
        const struct vec3 b = live_position(c, corner_vertex(c, i));
        for (unsigned k = 1; k < parts; k++)
            largest = fmax(largest, distance_from_reference(c, between(a, b, (double)k / parts)));
    }
    for (size_t i = 0; parts > 2 && i < 3 * r->face_count; i++) {
        const struct vec3 a = vec3_load(r->positions + 3 * (size_t)r->faces[i]);
        const size_t next = i % 3 == 2 ? i - 2 : i + 1;
        const struct vec3 b = vec3_load(r->positions + 3 * (size_t)r->faces[next]);
        for (unsigned k = 1; k < parts; k++)
            largest = fmax(largest, distance_from_surface(c, between(a, b, (double)k / parts)));
    }
    for (size_t v = 0; v < c->reference.vertex_count; v++)
        largest =
            fmax(largest, distance_from_surface(c, vec3_load(c->reference.positions + 3 * v)));
    return largest;
}

/* Edges in planes and vertices that are known to be near are passed over, so what is found may be
 * a little less than the largest, never more. */
static void error_is_the_largest_distance(void **state)
{
    (void)state;
    for (unsigned number = 0; number < SHAPES; number++)
        for (uint32_t effort = 1; effort <= 3; effort++) {
            struct context ctx;
            uint64_t faces;
            double error;
            context_init(&ctx);
            struct collapse *c = collapse_measured(&ctx, number, effort, &faces);
            assert_true(c->reference.face_count > 0);
            assert_true(c->reference.face_count <= faces * 2 / 5);
            assert_int_equal(reference_error(c, &error), STATUS_OK);
            const double middles = largest_of_all(c, 2);
            if (error > middles) /* which takes long to find out */
                assert_true(error <= fmax(largest_of_all(c, 8), c->typical_error) * (1 + 1e-5));
            assert_true(error >= 0.9 * middles);
            collapse_end(&c);
            context_clear(&ctx);
        }
}

/* Every point of the reference hangs at one live vertex. */
static void points_are_shared_out(void **state)
{
    (void)state;
    for (unsigned number = 0; number < SHAPES; number++) {
        struct context ctx;
        uint64_t faces;
        context_init(&ctx);
        struct collapse *c = collapse_measured(&ctx, number, 2, &faces);
        const struct reference *r = &c->reference;
        unsigned char *seen = calloc((size_t)r->vertex_count, 1);
        uint64_t count = 0;
        assert_non_null(seen);
        for (uint32_t v = 0; v < c->vertex_slots; v++) {
            uint32_t u = v;
            if (c->vertices[v].corner == NO_INDEX)
                continue;
            do {
                assert_true(u < r->vertex_count);
                assert_false(seen[u]);
                seen[u] = 1;
                count++;
                u = r->next[u];
            } while (u != v);
        }
        assert_int_equal(count, r->vertex_count);
        free(seen);
        collapse_end(&c);
        context_clear(&ctx);
    }
}

/* What the reference allows puts the new vertex within the bound of it; what would put it farther
 * away is refused. */
static void far_vertices_are_refused(void **state)
{
    (void)state;
    unsigned allowed = 0, refused = 0;
    for (unsigned number = 0; number < SHAPES; number++) {
        struct context ctx;
        uint64_t faces;
        context_init(&ctx);
        struct collapse *c = collapse_measured(&ctx, number, 2, &faces);
        const struct territory whole = {.end = (uint32_t)c->vertex_slots};
        const float step = 1 / c->unit;
        uint32_t leaf = UINT32_MAX;
        for (uint32_t v = 0; v < c->vertex_slots; v += 3) {
            struct vertex_look looks[2];
            struct edge_change change = {.v = v, .looks = {&looks[0], &looks[1]}};
            if (c->vertices[v].corner == NO_INDEX)
                continue;
            vertex_look_round(c, &whole, v, &looks[0]);
            change.w = looks[0].ring.vertices[0];
            vertex_look_round(c, &whole, change.w, &looks[1]);
            while (looks[1].ring.vertices[change.place[1]] != v)
                change.place[1]++;
            for (int k = 0; k < 3; k++) { /* the middle of the edge, lifted by up to an edge */
                const float lift = step * (float)(v % 8) / 8 * (k == 2);
                change.to[0][k] = looks[0].at[k][0] / 2 + lift;
                change.to[1][k] = change.to[0][k] - looks[0].at[k][0];
            }
            (void)edge_shape_allows(c, &change); /* fills in the normals */
            struct vec3 place = live_position(c, v);
            place = vec3_add(place, vec3_load_float(change.to[0]));
            const double away = distance_from_reference(c, place);
            assert_false(reference_allows(c, &change, 0.999 * away - 1e-6, &leaf));
            assert_true(reference_allows(c, &change, INFINITY, &leaf));
            const double bound = 0.5 / (double)c->unit;
            if (reference_allows(c, &change, bound, &leaf)) {
                assert_true(away <= bound * (1 + 1e-5));
                allowed++;
            } else {
                refused++;
            }
        }
        collapse_end(&c);
        context_clear(&ctx);
    }
    assert_true(allowed > 20);
    assert_true(refused > 20);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(error_is_the_largest_distance),
        cmocka_unit_test(points_are_shared_out),
        cmocka_unit_test(far_vertices_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
