/*
 * measure against brute force on 50 random small pairs: all samples against all triangles, with a
 * point-triangle distance of the test's own. And the tree against brute force, on meshes and on
 * soups of needles, far from the origin too.
 */
#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "geom/bvh.h"
#include "inspect/measure.h"
#include "inspect/sample.h"
#include "test_kit.h"
#include "test_shapes.h"

/* ---- the other way to compute it ---- */

static long double dot(const long double a[3], const long double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static long double segment_square(const long double p[3], const long double a[3],
                                  const long double b[3])
{
    long double ab[3], ap[3];
    for (int k = 0; k < 3; k++) {
        ab[k] = b[k] - a[k];
        ap[k] = p[k] - a[k];
    }
    long double length = dot(ab, ab), t = length > 0 ? dot(ap, ab) / length : 0;
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    for (int k = 0; k < 3; k++)
        ap[k] -= t * ab[k];
    return dot(ap, ap);
}

/* The least of: the three edges, and the plane where the foot is inside (2x2 normal equations). */
static double brute_distance(struct vec3 point, struct vec3 u, struct vec3 v, struct vec3 w)
{
    long double p[3] = {point.x, point.y, point.z}, a[3] = {u.x, u.y, u.z};
    long double b[3] = {v.x, v.y, v.z}, c[3] = {w.x, w.y, w.z}, ab[3], ac[3], ap[3];
    long double best = segment_square(p, a, b);
    long double other = segment_square(p, b, c);
    best = other < best ? other : best;
    other = segment_square(p, c, a);
    best = other < best ? other : best;
    for (int k = 0; k < 3; k++) {
        ab[k] = b[k] - a[k];
        ac[k] = c[k] - a[k];
        ap[k] = p[k] - a[k];
    }
    long double bb = dot(ab, ab), bc = dot(ab, ac), cc = dot(ac, ac);
    long double determinant = bb * cc - bc * bc;
    if (determinant > 1e-18L * bb * cc) {
        long double s = (cc * dot(ab, ap) - bc * dot(ac, ap)) / determinant;
        long double t = (bb * dot(ac, ap) - bc * dot(ab, ap)) / determinant;
        if (s >= 0 && t >= 0 && s + t <= 1) {
            for (int k = 0; k < 3; k++)
                ap[k] -= s * ab[k] + t * ac[k];
            other = dot(ap, ap);
            best = other < best ? other : best;
        }
    }
    return (double)sqrtl(best);
}

static struct triangle triangle_of(const struct mesh *mesh, uint64_t face)
{
    const uint32_t *c = mesh->faces + 3 * face;
    return (struct triangle){vec3_load(mesh->positions + 3 * (size_t)c[0]),
                             vec3_load(mesh->positions + 3 * (size_t)c[1]),
                             vec3_load(mesh->positions + 3 * (size_t)c[2])};
}

static double brute_nearest(const struct mesh *mesh, struct vec3 p)
{
    double best = INFINITY;
    for (uint64_t f = 0; f < mesh->face_count; f++) {
        struct triangle t = triangle_of(mesh, f);
        best = fmin(best, brute_distance(p, t.a, t.b, t.c));
    }
    return best;
}

static double area_of(const struct triangle *t)
{
    return vec3_length(triangle_normal(t->a, t->b, t->c)) / 2;
}

struct brute {
    double largest, weight, sum, squares;
};

static void brute_sample(struct brute *brute, const struct mesh *to, struct vec3 p, double weight)
{
    double distance = brute_nearest(to, p);
    brute->largest = fmax(brute->largest, distance);
    brute->weight += weight;
    brute->sum += weight * distance;
    brute->squares += weight * distance * distance;
}

/* `area` is that of `from`, as measured: a last bit of it may decide where a sample is. */
static struct brute brute_forward(const struct mesh *from, const struct mesh *to, double area,
                                  uint32_t least)
{
    struct brute brute = {0, 0, 0, 0};
    uint64_t wanted = least * to->face_count;
    wanted = wanted < from->face_count ? from->face_count : wanted;
    struct sample_walk walk = sample_walk_begin(area / (double)wanted, 0);
    for (uint64_t f = 0; f < from->face_count; f++) {
        struct triangle t = triangle_of(from, f);
        uint32_t count = sample_walk_face(&walk, area_of(&t));
        for (uint32_t k = 0; k < count; k++)
            brute_sample(&brute, to, sample_point(&t, f, k), 1);
    }
    for (uint64_t v = 0; v < from->vertex_count; v++)
        brute_sample(&brute, to, vec3_load(from->positions + 3 * v), 0);
    return brute;
}

static struct brute brute_backward(const struct mesh *from, const struct mesh *to, double area,
                                   uint32_t least)
{
    struct brute brute = {0, 0, 0, 0};
    for (uint64_t f = 0; f < from->face_count; f++) {
        struct triangle t = triangle_of(from, f);
        uint32_t count = sample_share(area_of(&t), area, least * from->face_count, least);
        for (uint32_t k = 0; k < count; k++)
            brute_sample(&brute, to, sample_point(&t, f, k), area_of(&t) / count);
    }
    for (uint64_t v = 0; v < from->vertex_count; v++)
        brute_sample(&brute, to, vec3_load(from->positions + 3 * v), 0);
    return brute;
}

static void assert_close(double value, double expected)
{
    if (!(fabs(value - expected) <= 1e-6 * fabs(expected)))
        fail_msg("%.17g instead of %.17g", value, expected);
}

static void compare(const struct deviation *deviation, const struct brute *brute)
{
    assert_close(deviation->largest, brute->largest);
    assert_close(deviation->mean, brute->sum / brute->weight);
    assert_close(deviation->rms, sqrt(brute->squares / brute->weight));
}

/* ---- pairs ---- */

static struct shape random_shape(uint64_t *state)
{
    double noise = 0.02 + 0.3 * random_unit(state);
    uint64_t seed = random_next(state);
    struct shape shape;
    switch (random_below(state, 4)) {
    case 0:
        shape = shape_noisy_sphere((unsigned)random_below(state, 3), noise, seed);
        break;
    case 1:
        shape = shape_noisy_torus(3 + (unsigned)random_below(state, 8),
                                  3 + (unsigned)random_below(state, 5), noise, seed);
        break;
    case 2:
        shape = shape_noisy_slab(1 + (unsigned)random_below(state, 5), noise, seed);
        break;
    default: /* a soup of triangles of all sizes, needles among them */
        memset(&shape, 0, sizeof shape);
        for (uint64_t i = 0, count = 1 + random_below(state, 60); i < count; i++) {
            uint32_t v[3];
            double size = i % 3 ? random_unit(state) : 1e-3;
            double x = random_unit(state), y = random_unit(state), z = random_unit(state);
            for (int k = 0; k < 3; k++)
                v[k] = shape_vertex(&shape, (float)(x + size * random_unit(state)),
                                    (float)(y + size * random_unit(state)),
                                    (float)(z + (i % 5 ? size : 1e-4) * random_unit(state)));
            shape_triangle(&shape, v[0], v[1], v[2]);
        }
    }
    shape_fan(&shape);
    return shape;
}

static void random_pairs(void **unused)
{
    (void)unused;
    uint64_t state = 20261122;
    for (int pair = 0; pair < 50; pair++) {
        struct shape first = random_shape(&state), second = random_shape(&state);
        if (pair % 5 == 0) { /* far from the origin, in float64 */
            shape_move(&first, 10, 4e6, 5e5, 100);
            shape_move(&second, 10, 4e6, 5e5, 100);
        }
        shape_write(&first, SHAPE_PLY_LITTLE, test_path("first.ply"));
        shape_write(&second, SHAPE_PLY_LITTLE, test_path("second.ply"));

        struct context ctx;
        context_init(&ctx);
        ctx.threads = 1 + (unsigned)(pair % 3);
        struct mesh from, to;
        shape_into_mesh(&ctx, &first, &from);
        shape_into_mesh(&ctx, &second, &to);
        struct measure_options options = {.samples_per_face = 10};
        struct measurement result;
        struct mesh mesh;
        enum status status = measure(&ctx, test_path("first.ply"), test_path("second.ply"),
                                     &options, &result, &mesh);
        if (status != STATUS_OK)
            fail_msg("pair %d: %s", pair, ctx.error);
        struct brute forward = brute_forward(&from, &to, result.original.area, 10);
        struct brute backward = brute_backward(&to, &from, result.simplified.area, 10);
        compare(&result.forward, &forward);
        compare(&result.backward, &backward);
        assert_close(result.hausdorff, fmax(forward.largest, backward.largest));
        for (uint64_t v = 0; v < to.vertex_count; v++) {
            double expected = brute_nearest(&from, vec3_load(to.positions + 3 * v));
            assert_true(fabs((double)result.vertex_error[v] - expected) <= 1e-6 * expected + 1e-12);
        }
        measurement_clear(&ctx, &result);
        mesh_clear(&ctx, &mesh);
        mesh_clear(&ctx, &from);
        mesh_clear(&ctx, &to);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
}

/* ---- the tree ---- */

static bool mark(void *user, uint32_t triangle)
{
    bool *seen = user;
    assert_false(seen[triangle]);
    seen[triangle] = true;
    return true;
}

static void check_touching(const struct mesh *mesh, const struct bvh *tree, uint64_t *state)
{
    bool *seen = calloc((size_t)mesh->face_count, sizeof *seen);
    struct vec3 low = vec3_load(mesh->positions), high = low;
    low = vec3_sub(low, vec3_make(random_unit(state), random_unit(state), random_unit(state)));
    high = vec3_add(high, vec3_make(random_unit(state), random_unit(state), random_unit(state)));
    bvh_touching(tree, low, high, mark, seen);
    for (uint64_t f = 0; f < mesh->face_count; f++) {
        struct triangle t = triangle_of(mesh, f);
        bool touches =
            fmin(fmin(t.a.x, t.b.x), t.c.x) <= high.x && fmax(fmax(t.a.x, t.b.x), t.c.x) >= low.x &&
            fmin(fmin(t.a.y, t.b.y), t.c.y) <= high.y && fmax(fmax(t.a.y, t.b.y), t.c.y) >= low.y &&
            fmin(fmin(t.a.z, t.b.z), t.c.z) <= high.z && fmax(fmax(t.a.z, t.b.z), t.c.z) >= low.z;
        assert_true(!touches || seen[f]);
    }
    free(seen);
}

/* Near and not near, with and without the machine's vectors, from the root and from any leaf. */
static void check_near(struct bvh *tree, struct vec3 p, double square)
{
    const enum cpu_level level = tree->level;
    const uint32_t leaves = (tree->count + BVH_WIDTH - 1) / BVH_WIDTH;
    for (int round = 0; round < 2; round++) {
        for (uint32_t from = 0; from <= leaves; from += 1 + leaves / 4) {
            uint32_t leaf = from < leaves ? from : UINT32_MAX, found = leaf;
            assert_false(bvh_is_near(tree, p, square * 0.999999, &found));
            assert_int_equal(found, leaf);
            assert_true(bvh_is_near(tree, p, square, &leaf));
            assert_true(leaf < leaves);
            found = leaf;
            assert_true(bvh_is_near(tree, p, 4 * square, &found));
            assert_int_equal(found, leaf);
        }
        uint32_t leaf = UINT32_MAX;
        assert_true(bvh_is_near(tree, p, square, &leaf));
        tree->level = CPU_SCALAR;
    }
    tree->level = level;
}

/* A tree over a copy of the faces in the order of the other, which is returned. */
static uint32_t *sort_faces(struct context *ctx, const struct mesh *mesh, const struct bvh *tree,
                            struct bvh *sorting)
{
    const size_t count = (size_t)mesh->face_count, bytes = count * 3 * sizeof(uint32_t);
    uint32_t *faces = malloc(bytes);
    assert_non_null(faces);
    for (size_t i = 0; i < count; i++)
        memcpy(faces + 3 * i, mesh->faces + 3 * (size_t)tree->order[i], 3 * sizeof *faces);
    assert_int_equal(bvh_build_sorted(ctx, mesh->positions, faces, (uint32_t)count, true, sorting),
                     STATUS_OK);
    assert_null(sorting->order);
    assert_int_equal(sorting->node_count, tree->node_count);
    return faces;
}

static void tree_finds_the_nearest(void **unused)
{
    (void)unused;
    uint64_t state = 7;
    for (int round = 0; round < 60; round++) {
        struct context ctx;
        struct mesh mesh;
        struct bvh tree, copy, sorting;
        context_init(&ctx);
        struct shape shape = random_shape(&state);
        double far = round % 4 == 0 ? 1e6 : 0;
        shape_move(&shape, round % 3 == 0 ? 1e-20 : 1, far, -far, far);
        shape_into_mesh(&ctx, &shape, &mesh);
        assert_int_equal(
            bvh_build(&ctx, mesh.positions, mesh.faces, (uint32_t)mesh.face_count, true, &tree),
            STATUS_OK);
        uint32_t *faces = sort_faces(&ctx, &mesh, &tree, &sorting);
        assert_int_equal(bvh_copy(&ctx, round % 2 ? &tree : &sorting, mesh.positions,
                                  round % 2 ? mesh.faces : faces, &copy),
                         STATUS_OK);
        for (int i = 0; i < 100; i++) {
            double reach = i % 10 == 0 ? 1e30 : i % 3 ? 2 : 0.1;
            struct vec3 p = vec3_load(mesh.positions + 3 * random_below(&state, mesh.vertex_count));
            p = vec3_add_scaled(p, reach,
                                vec3_make(random_unit(&state) - 0.5, random_unit(&state) - 0.5,
                                          random_unit(&state) - 0.5));
            struct nearest nearest = {INFINITY, UINT32_MAX, {0, 0, 0}};
            bvh_nearest(&tree, p, &nearest);
            double expected = brute_nearest(&mesh, p);
            assert_true(nearest.triangle < mesh.face_count);
            assert_close(sqrt(nearest.distance_squared), expected);

            /* A bound just above is enough, one below finds nothing. */
            struct nearest again = {nearest.distance_squared * 1.000001, UINT32_MAX, {0, 0, 0}};
            bvh_nearest(&tree, p, &again);
            assert_int_equal(again.triangle, nearest.triangle);
            again = (struct nearest){nearest.distance_squared * 0.999999, UINT32_MAX, {0, 0, 0}};
            bvh_nearest(&tree, p, &again);
            assert_int_equal(again.triangle, UINT32_MAX);
            check_near(&copy, p, nearest.distance_squared);
        }
        check_touching(&mesh, &tree, &state);
        free(faces);
        bvh_clear(&ctx, &sorting);
        bvh_clear(&ctx, &copy);
        bvh_clear(&ctx, &tree);
        mesh_clear(&ctx, &mesh);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
}

static bool count(void *user, uint32_t triangle)
{
    (void)triangle;
    ++*(unsigned *)user;
    return true;
}

/* A vertex 1e10 away: boxes of the rest stay apart, so that a search looks at few of them. */
static void tree_bears_a_stray_vertex(void **unused)
{
    (void)unused;
    struct context ctx;
    struct mesh mesh;
    struct bvh tree;
    uint64_t state = 3;
    context_init(&ctx);
    struct shape shape = shape_noisy_sphere(4, 0.02, 1);
    shape.positions[3 * 17] = 1e10;
    shape_into_mesh(&ctx, &shape, &mesh);
    assert_int_equal(
        bvh_build(&ctx, mesh.positions, mesh.faces, (uint32_t)mesh.face_count, true, &tree),
        STATUS_OK);
    for (int i = 0; i < 100; i++) {
        struct vec3 p = vec3_load(mesh.positions + 3 * random_below(&state, mesh.vertex_count));
        if (p.x > 1e9)
            continue;
        struct nearest nearest = {INFINITY, UINT32_MAX, {0, 0, 0}};
        bvh_nearest(&tree, p, &nearest);
        assert_true(nearest.distance_squared < 1e-12);
        unsigned visits = 0;
        bvh_touching(&tree, p, p, count, &visits);
        assert_true(visits > 0 && visits < mesh.face_count / 20);
    }
    bvh_clear(&ctx, &tree);
    mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void distance_to_degenerate_triangles(void **unused)
{
    (void)unused;
    uint64_t state = 99;
    for (int i = 0; i < 20000; i++) {
        struct vec3 c[3], p;
        for (int k = 0; k < 3; k++)
            c[k] = vec3_make(random_unit(&state), random_unit(&state), random_unit(&state));
        double thin = i % 4 == 0 ? 0 : i % 4 == 1 ? 1e-15 : i % 4 == 2 ? 1e-9 : 1e-6;
        switch (i % 3) { /* a point, a segment with a corner inside, a needle */
        case 0:
            c[1] = vec3_add_scaled(c[0], thin, c[1]);
            c[2] = vec3_add_scaled(c[0], thin, c[2]);
            break;
        case 1:
            c[2] = vec3_add_scaled(vec3_scale(vec3_add(c[0], c[1]), 0.5), thin, c[2]);
            break;
        default:
            c[2] = vec3_add_scaled(c[1], thin, c[2]);
        }
        p = vec3_make(random_unit(&state), random_unit(&state), random_unit(&state));
        struct triangle t = {c[i % 3], c[(i + 1) % 3], c[(i + 2) % 3]};
        struct vec3 nearest;
        double distance = sqrt(triangle_distance_squared(p, &t, &nearest));
        double expected = brute_distance(p, t.a, t.b, t.c);
        if (!(fabs(distance - expected) < 1e-7 * (1 + expected)))
            fail_msg("%d: %.17g instead of %.17g", i, distance, expected);
        assert_true(fabs(vec3_distance(p, nearest) - distance) < 1e-9);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(distance_to_degenerate_triangles),
        cmocka_unit_test(tree_finds_the_nearest),
        cmocka_unit_test(tree_bears_a_stray_vertex),
        cmocka_unit_test(random_pairs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
