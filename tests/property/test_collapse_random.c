/*
 * Edge collapse on random meshes, with and without border, with random locks, to random counts, at
 * every effort and placement: every level is manifold with the topology it began with, has N or
 * N - 1 faces unless nothing more could go, respects locks and placement, and is the same again.
 */
#include "test_kit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "mesh/mesh.h"
#include "simplify/collapse.h"
#include "test_facts.h"
#include "test_shapes.h"

enum { SHAPES = 9, ROUNDS = 3 };

static struct shape make_shape(unsigned kind, uint64_t *random)
{
    struct shape shape, other;
    const double noise = 0.05 * random_unit(random);
    switch (kind) {
    case 0:
        return shape_noisy_sphere(3, noise, random_next(random));
    case 1:
        return shape_noisy_torus(24, 12, noise, random_next(random));
    case 2:
        return shape_noisy_slab(16, noise, random_next(random));
    case 3:
        return shape_grid(17, 13); /* flat: all costs are 0 */
    case 4:
        return shape_grid_with_holes(16, 12);
    case 5:
        return shape_spiral_ramp(3, 20);
    case 6: /* components, some of them at the floor already */
        shape = shape_icosphere(2);
        other = shape_tetrahedron();
        shape_append(&shape, &other);
        shape_free(&other);
        other = shape_single_triangle();
        shape_append(&shape, &other);
        shape_free(&other);
        return shape;
    case 7: /* wide fans: two hubs */
        return shape_noisy_torus(200, 3, 0, 1);
    default: /* needle-like faces */
        shape = shape_noisy_sphere(2, 0.3, random_next(random));
        for (size_t v = 0; v < shape.vertex_count; v++)
            shape.positions[3 * v] *= 1024;
        return shape;
    }
}

/* One byte a vertex: locked with the given probability. */
static unsigned char *make_locks(const struct mesh *mesh, double probability, uint64_t *random)
{
    unsigned char *locked = calloc(mesh->vertex_count, 1);
    assert_non_null(locked);
    for (size_t v = 0; v < mesh->vertex_count; v++)
        locked[v] = random_unit(random) < probability;
    return locked;
}

static int compare_pairs(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

/* The edges between locked vertices, by input number, sorted; and how many faces have three. */
static uint64_t *locked_edges(const struct mesh *mesh, const uint32_t *sources,
                              const unsigned char *locked, size_t *count, size_t *faces)
{
    uint64_t *edges = malloc((mesh->face_count * 3 + 1) * sizeof *edges);
    assert_non_null(edges);
    *count = *faces = 0;
    for (size_t f = 0; f < mesh->face_count; f++) {
        unsigned of_face = 0;
        for (unsigned k = 0; k < 3; k++) {
            uint64_t a = mesh->faces[3 * f + k], b = mesh->faces[3 * f + (k + 1) % 3];
            if (sources) {
                a = sources[a];
                b = sources[b];
            }
            of_face += locked[a];
            if (locked[a] && locked[b])
                edges[(*count)++] = a < b ? a << 32 | b : b << 32 | a;
        }
        *faces += of_face == 3;
    }
    qsort(edges, *count, sizeof *edges, compare_pairs);
    return edges;
}

static void check_locks(const struct mesh *before, const struct mesh *after,
                        const uint32_t *sources, const unsigned char *locked)
{
    size_t kept = 0, wanted = 0, before_count, after_count, before_faces, after_faces;
    for (size_t v = 0; v < before->vertex_count; v++)
        wanted += locked[v];
    for (size_t v = 0; v < after->vertex_count; v++)
        if (locked[sources[v]]) {
            kept++;
            assert_memory_equal(after->positions + 3 * v,
                                before->positions + 3 * (size_t)sources[v], 24);
        }
    assert_int_equal(kept, wanted);
    uint64_t *old = locked_edges(before, NULL, locked, &before_count, &before_faces);
    uint64_t *new = locked_edges(after, sources, locked, &after_count, &after_faces);
    assert_true(after_faces <= before_faces);
    for (size_t i = 0; i < after_count; i++)
        assert_non_null(bsearch(&new[i], old, before_count, sizeof *old, compare_pairs));
    free(old);
    free(new);
}

static void check_level(struct context *ctx, const struct mesh *before, const struct facts *was,
                        struct collapse *collapse, uint64_t wanted, bool subset,
                        const unsigned char *locked, struct mesh *after)
{
    uint32_t *sources = NULL;
    assert_int_equal(collapse_extract(collapse, after, &sources), STATUS_OK);
    const struct facts is = facts_of(after);
    assert_true(facts_manifold(&is));
    assert_true(facts_same_topology(was, &is));
    assert_int_equal(is.unused, 0);
    assert_int_equal(after->face_count, collapse_faces(collapse));
    if (!collapse_exhausted(collapse))
        assert_true(after->face_count == wanted || after->face_count + 1 == wanted);
    assert_true(after->face_count <= before->face_count);
    for (size_t v = 0; v < after->vertex_count; v++) {
        assert_true(sources[v] < before->vertex_count);
        for (int k = 0; k < 3; k++)
            assert_true(isfinite(after->positions[3 * v + (size_t)k]));
        if (subset)
            assert_memory_equal(after->positions + 3 * v,
                                before->positions + 3 * (size_t)sources[v], 24);
    }
    check_locks(before, after, sources, locked);
    memory_release(ctx, &sources, after->vertex_count, sizeof *sources);
}

static void collapse_random(void **state)
{
    (void)state;
    uint64_t random = 20261122;
    struct context ctx;
    context_init(&ctx);
    for (unsigned kind = 0; kind < SHAPES; kind++)
        for (unsigned round = 0; round < ROUNDS * 6; round++) {
            struct shape shape = make_shape(kind, &random);
            struct mesh mesh, levels[2][3];
            shape_shuffle(&shape, random_next(&random));
            shape_into_mesh(&ctx, &shape, &mesh);
            for (size_t i = 0; i < mesh.vertex_count * 3; i++)
                mesh.positions[i] = (double)(float)mesh.positions[i];
            const struct facts was = facts_of(&mesh);
            const double probability = round % 3 == 0 ? 0 : random_unit(&random) * 0.5;
            unsigned char *locked = make_locks(&mesh, probability, &random);
            const struct collapse_options options = {.subset = round & 1, .effort = 1 + round % 3};
            uint64_t wanted[3] = {mesh.face_count / 2 + random_below(&random, 8),
                                  mesh.face_count / 5 + random_below(&random, 8), 0};
            for (int again = 0; again < 2; again++) {
                struct collapse *collapse;
                assert_int_equal(collapse_begin(&ctx, &options, mesh.vertex_count, mesh.face_count,
                                                mesh.positions, mesh.faces, NULL, NULL, locked,
                                                &collapse),
                                 STATUS_OK);
                for (int level = 0; level < 3; level++) {
                    assert_int_equal(collapse_run(collapse, wanted[level], INFINITY), STATUS_OK);
                    check_level(&ctx, &mesh, &was, collapse, wanted[level], options.subset, locked,
                                &levels[again][level]);
                }
                assert_true(collapse_exhausted(collapse));
                collapse_end(&collapse);
                assert_null(collapse);
            }
            for (int level = 0; level < 3; level++) {
                const struct mesh *a = &levels[0][level], *b = &levels[1][level];
                assert_int_equal(a->face_count, b->face_count);
                assert_memory_equal(a->faces, b->faces, a->face_count * 12);
                assert_memory_equal(a->positions, b->positions, a->vertex_count * 24);
                mesh_clear(&ctx, &levels[0][level]);
                mesh_clear(&ctx, &levels[1][level]);
            }
            free(locked);
            mesh_clear(&ctx, &mesh);
        }
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(collapse_random)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
