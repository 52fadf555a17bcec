/*
 * Edge collapse on meshes small enough to say what must come out.
 */
#include "test_kit.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/bytes.h"
#include "base/cpu.h"
#include "base/memory.h"
#include "geom/bvh.h"
#include "mesh/import.h"
#include "mesh/mesh.h"
#include "simplify/collapse.h"
#include "test_facts.h"
#include "test_shapes.h"

static struct collapse *begin(struct context *ctx, const struct mesh *mesh, uint32_t effort,
                              bool subset)
{
    const struct collapse_options options = {.effort = effort, .subset = subset};
    struct collapse *collapse;
    assert_int_equal(collapse_begin(ctx, &options, mesh->vertex_count, mesh->face_count,
                                    mesh->positions, mesh->faces, &mesh->attributes, mesh->records,
                                    NULL, &collapse),
                     STATUS_OK);
    return collapse;
}

static void simplify(struct context *ctx, struct mesh *mesh, uint64_t faces, uint32_t effort,
                     bool subset, struct mesh *out)
{
    struct collapse *collapse = begin(ctx, mesh, effort, subset);
    assert_int_equal(collapse_run(collapse, faces, INFINITY), STATUS_OK);
    assert_int_equal(collapse_extract(collapse, out, NULL), STATUS_OK);
    collapse_end(&collapse);
}

static void volume_is_kept(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh, out;
    context_init(&ctx);
    for (uint32_t effort = 1; effort <= 3; effort++) {
        struct shape shape = shape_icosphere(4);
        shape_into_mesh(&ctx, &shape, &mesh);
        simplify(&ctx, &mesh, 320, effort, false, &out);
        assert_int_equal(out.face_count, 320);
        /* an inscribed icosphere of 320 faces has lost 4 % of the volume */
        assert_true(fabs(mesh_volume(&out) / mesh_volume(&mesh) - 1) < 1e-4);
        mesh_clear(&ctx, &out);
        mesh_clear(&ctx, &mesh);
    }
    context_clear(&ctx);
}

/* A flat square keeps its outline: nothing else can be had for fewer than 2 faces. */
static void flat_square_keeps_its_border(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh, out;
    context_init(&ctx);
    for (int subset = 0; subset < 2; subset++)
        for (uint32_t effort = 1; effort <= 3; effort++) {
            struct shape shape = shape_grid(20, 20);
            shape_into_mesh(&ctx, &shape, &mesh);
            simplify(&ctx, &mesh, 10, effort, subset, &out);
            assert_in_range(out.face_count, 9, 10);
            assert_true(fabs(mesh_area(&out) / mesh_area(&mesh) - 1) < 1e-5);
            mesh_clear(&ctx, &out);
            mesh_clear(&ctx, &mesh);
        }
    context_clear(&ctx);
}

static void cube_keeps_its_corners(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh, out;
    context_init(&ctx);
    /* a box of 6 grids, welded by hand: a surface of 8x8 cells a side over lattice points */
    enum { N = 8 };
    struct shape shape = {0};
    uint32_t number[N + 1][N + 1][N + 1];
    memset(number, 0xff, sizeof number);
    for (uint32_t axis = 0; axis < 3; axis++)
        for (uint32_t side = 0; side < 2; side++)
            for (uint32_t i = 0; i < N; i++)
                for (uint32_t j = 0; j < N; j++) {
                    uint32_t corner[4];
                    for (uint32_t k = 0; k < 4; k++) {
                        uint32_t at[3];
                        at[axis] = side * N;
                        at[(axis + 1) % 3] = i + (k == 1 || k == 2);
                        at[(axis + 2) % 3] = j + (k >= 2);
                        uint32_t *slot = &number[at[0]][at[1]][at[2]];
                        if (*slot == UINT32_MAX)
                            *slot = shape_vertex(&shape, at[0], at[1], at[2]);
                        corner[k] = *slot;
                    }
                    if (side)
                        shape_quad(&shape, corner[0], corner[1], corner[2], corner[3]);
                    else
                        shape_quad(&shape, corner[3], corner[2], corner[1], corner[0]);
                }
    shape_into_mesh(&ctx, &shape, &mesh);
    simplify(&ctx, &mesh, 12, 2, false, &out);
    assert_int_equal(out.face_count, 12);
    assert_int_equal(out.vertex_count, 8);
    for (size_t i = 0; i < 24; i++)
        assert_true(fabs(out.positions[i]) < 1e-4 || fabs(out.positions[i] - N) < 1e-4);
    mesh_clear(&ctx, &out);
    mesh_clear(&ctx, &mesh);
    context_clear(&ctx);
}

/* The result does not depend on the model's unit as long as floats can say it. */
static void assert_same_mesh(const struct mesh *a, const struct mesh *b)
{
    assert_int_equal(a->face_count, b->face_count);
    assert_int_equal(a->vertex_count, b->vertex_count);
    assert_memory_equal(a->faces, b->faces, 3 * (size_t)a->face_count * sizeof *a->faces);
    assert_memory_equal(a->positions, b->positions,
                        3 * (size_t)a->vertex_count * sizeof *a->positions);
}

/* A copy is made at first and with a reference; it goes on as the original does when the variant is
 * 0, in an order of its own else, and neither disturbs the other. */
static void copies_go_on_by_themselves(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh, out, of_copy;
    context_init(&ctx);
    for (uint32_t variant = 0; variant < 3; variant++)
        for (int with_reference = 0; with_reference < 2; with_reference++) {
            const struct collapse_options options = {.effort = 2, .measured = true};
            struct collapse *collapse, *copy;
            double error, error_of_copy;
            struct shape shape = shape_noisy_sphere(5, 0.01, 7);
            shape_into_mesh(&ctx, &shape, &mesh);
            assert_int_equal(collapse_begin(&ctx, &options, mesh.vertex_count, mesh.face_count,
                                            mesh.positions, mesh.faces, NULL, NULL, NULL,
                                            &collapse),
                             STATUS_OK);
            if (with_reference)
                assert_int_equal(collapse_run(collapse, 4000, INFINITY), STATUS_OK);
            else
                assert_int_equal(collapse_approach(collapse, 8000, INFINITY), STATUS_OK);
            assert_int_equal(collapse_copy(collapse, &copy), STATUS_OK);
            collapse_set_variant(copy, variant);
            assert_int_equal(collapse_run(copy, 1000, INFINITY), STATUS_OK);
            assert_int_equal(collapse_run(collapse, 1000, INFINITY), STATUS_OK);
            assert_int_equal(collapse_error(collapse, &error), STATUS_OK);
            assert_int_equal(collapse_error(copy, &error_of_copy), STATUS_OK);
            assert_int_equal(collapse_extract(collapse, &out, NULL), STATUS_OK);
            collapse_end(&collapse);
            assert_int_equal(collapse_extract(copy, &of_copy, NULL), STATUS_OK);
            collapse_end(&copy);
            if (variant == 0) {
                assert_same_mesh(&out, &of_copy);
                assert_true(error == error_of_copy);
            } else {
                assert_in_range(of_copy.face_count, 999, 1000);
                assert_true(error != error_of_copy);
                struct facts facts = facts_of(&of_copy);
                assert_true(facts_manifold(&facts) && facts.euler == 2);
            }
            mesh_clear(&ctx, &out);
            mesh_clear(&ctx, &of_copy);
            mesh_clear(&ctx, &mesh);
            assert_int_equal(ctx.memory_now, 0);
        }
    context_clear(&ctx);
}

/* A blade 130 long and 0.65 thick, of planes and straight bevels in 16,222 faces: 324 can say
 * nearly all of it. */
static void what_costs_nothing_goes_first(void **state)
{
    (void)state;
    const char *input = test_data("blade.off.gz");
    if (!input)
        skip();
    for (uint32_t effort = 1; effort <= 3; effort++) {
        struct context ctx;
        struct mesh mesh, out;
        struct bvh tree;
        double sum = 0;
        context_init(&ctx);
        assert_int_equal(mesh_load(&ctx, input, &mesh), STATUS_OK);
        simplify(&ctx, &mesh, 324, effort, false, &out);
        assert_in_range(out.face_count, 323, 324);
        assert_int_equal(
            bvh_build(&ctx, out.positions, out.faces, (uint32_t)out.face_count, false, &tree),
            STATUS_OK);
        for (size_t v = 0; v < mesh.vertex_count; v++) {
            struct nearest nearest = {INFINITY, 0, {0, 0, 0}};
            bvh_nearest(&tree, vec3_load(mesh.positions + 3 * v), &nearest);
            sum += sqrt(nearest.distance_squared);
        }
        assert_true(sum / (double)mesh.vertex_count < 6e-4); /* 4e-6 of the diagonal */
        bvh_clear(&ctx, &tree);
        mesh_clear(&ctx, &out);
        mesh_clear(&ctx, &mesh);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
}

static void unit_does_not_matter(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh, plain, scaled;
    context_init(&ctx);
    const int exponents[] = {-60, 60};
    for (int i = 0; i < 2; i++) {
        struct shape shape = shape_noisy_torus(40, 20, 0.02, 5);
        shape_into_mesh(&ctx, &shape, &mesh);
        simplify(&ctx, &mesh, 200, 2, false, &plain);
        for (size_t j = 0; j < mesh.vertex_count * 3; j++)
            mesh.positions[j] = ldexp(mesh.positions[j], exponents[i]);
        simplify(&ctx, &mesh, 200, 2, false, &scaled);
        assert_int_equal(plain.vertex_count, scaled.vertex_count);
        assert_memory_equal(plain.faces, scaled.faces, plain.face_count * 12);
        for (size_t j = 0; j < plain.vertex_count * 3; j++)
            assert_true(ldexp(plain.positions[j], exponents[i]) == scaled.positions[j]);
        mesh_clear(&ctx, &plain);
        mesh_clear(&ctx, &scaled);
        mesh_clear(&ctx, &mesh);
    }
    context_clear(&ctx);
}

/* Coordinates with seven digits before the point lose nothing that matters. */
static void far_from_the_origin(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh, out;
    context_init(&ctx);
    struct shape shape = shape_icosphere(4);
    shape_move(&shape, 1, 4512345.678, 5612345.678, 321.5);
    shape_into_mesh(&ctx, &shape, &mesh);
    simplify(&ctx, &mesh, 500, 2, false, &out);
    assert_false(out.is_float32);
    for (size_t v = 0; v < out.vertex_count; v++) {
        const double x = out.positions[3 * v] - 4512345.678;
        const double y = out.positions[3 * v + 1] - 5612345.678;
        const double z = out.positions[3 * v + 2] - 321.5;
        assert_true(fabs(sqrt(x * x + y * y + z * z) - 1) < 0.03);
    }
    mesh_clear(&ctx, &out);
    mesh_clear(&ctx, &mesh);
    context_clear(&ctx);
}

/* A float attribute that is linear in the position stays near it; labels keep to values there are.
 */
static void attributes_travel(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh, out;
    context_init(&ctx);
    for (int subset = 0; subset < 2; subset++) {
        struct shape shape = shape_icosphere(4);
        shape_into_mesh(&ctx, &shape, &mesh);
        mesh.attributes = (struct attributes){.count = 3,
                                              .stride = 13,
                                              .list = {{"label", SCALAR_UINT8, 0},
                                                       {"height", SCALAR_FLOAT32, 1},
                                                       {"depth", SCALAR_FLOAT64, 5}}};
        assert_int_equal(memory_take(&ctx, mesh.vertex_count, 13, &mesh.records), STATUS_OK);
        for (size_t v = 0; v < mesh.vertex_count; v++) {
            unsigned char *record = mesh.records + 13 * v;
            record[0] = mesh.positions[3 * v] < 0 ? 17 : 200;
            store_f32(record + 1, (float)mesh.positions[3 * v + 2]);
            store_f64(record + 5, -mesh.positions[3 * v + 2]);
        }
        simplify(&ctx, &mesh, 640, 2, subset, &out);
        assert_int_equal(out.attributes.stride, 13);
        for (size_t v = 0; v < out.vertex_count; v++) {
            const unsigned char *record = out.records + 13 * v;
            const double z = out.positions[3 * v + 2], within = subset ? 0 : 0.1;
            assert_true(record[0] == 17 || record[0] == 200);
            assert_true(fabs((double)load_f32(record + 1) - z) <= within);
            assert_true(fabs(load_f64(record + 5) + z) <= within);
        }
        mesh_clear(&ctx, &out);
        mesh_clear(&ctx, &mesh);
    }
    context_clear(&ctx);
}

static double error_of(const struct collapse *collapse)
{
    double error;
    assert_int_equal(collapse_error(collapse, &error), STATUS_OK);
    return error;
}

static void error_bound_holds(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh, out;
    context_init(&ctx);
    struct shape shape = shape_icosphere(5);
    shape_into_mesh(&ctx, &shape, &mesh);
    struct collapse *collapse = begin(&ctx, &mesh, 2, false);
    uint64_t faces = mesh.face_count;
    for (double bound = 0.003; bound < 0.1; bound *= 3) {
        assert_int_equal(collapse_run(collapse, 0, bound), STATUS_OK);
        assert_true(error_of(collapse) <= bound * (1 + 1e-6));
        assert_false(collapse_exhausted(collapse)); /* the bound stopped it, nothing else */
        assert_true(collapse_faces(collapse) < faces);
        faces = collapse_faces(collapse);
        assert_int_equal(collapse_extract(collapse, &out, NULL), STATUS_OK);
        for (size_t v = 0; v < out.vertex_count; v++) {
            const double *p = out.positions + 3 * v;
            assert_true(fabs(sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) - 1) < 2 * bound);
        }
        mesh_clear(&ctx, &out);
    }
    collapse_end(&collapse);
    mesh_clear(&ctx, &mesh);
    context_clear(&ctx);
}

/* A point of the original that the mesh has lost counts at once, and goes on counting. */
static void witnesses_count(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh;
    struct collapse_mesh small = {0};
    context_init(&ctx);
    struct shape shape = shape_icosphere(2);
    shape_into_mesh(&ctx, &shape, &mesh);
    const size_t vertices = (size_t)mesh.vertex_count, faces = (size_t)mesh.face_count;
    small.vertex_count = vertices;
    small.face_count = faces;
    assert_int_equal(memory_take(&ctx, vertices, 3 * sizeof(float), &small.positions), STATUS_OK);
    assert_int_equal(memory_take(&ctx, vertices, 3 * sizeof(float), &small.witnesses), STATUS_OK);
    assert_int_equal(memory_take(&ctx, faces, 3 * sizeof(uint32_t), &small.faces), STATUS_OK);
    for (size_t i = 0; i < 3 * vertices; i++)
        small.positions[i] = small.witnesses[i] = (float)mesh.positions[i];
    memcpy(small.faces, mesh.faces, faces * 3 * sizeof *small.faces);
    for (int k = 0; k < 3; k++)
        small.witnesses[k] *= 1.25f; /* of the first vertex: a quarter above the sphere */
    const struct collapse_options options = {.effort = 2};
    struct collapse *collapse;
    assert_int_equal(collapse_begin_giving(&ctx, &options, &small, NULL, &collapse), STATUS_OK);
    assert_true(fabs(error_of(collapse) - 0.25) < 0.001);
    assert_int_equal(collapse_run(collapse, faces / 4, INFINITY), STATUS_OK);
    assert_true(fabs(error_of(collapse) - 0.25) < 0.1);
    collapse_end(&collapse);
    mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

/* A thin speck as a scan had it: the place for its first edge's vertex that keeps the volume is as
 * far from it as the speck is long, which must be seen also where errors are only guessed. */
static void specks_do_not_become_needles(void **state)
{
    (void)state;
    static const double corners[5][3] = {{-0.031, -0.858, 0.016},
                                         {0.083, 0, 0},
                                         {0.024, 1.534, 0.103},
                                         {-0.125, 1, 0},
                                         {-0.003, 1.005, -0.079}};
    static const uint32_t faces[6][3] = {{0, 3, 2}, {0, 2, 1}, {0, 1, 4},
                                         {0, 4, 3}, {1, 2, 4}, {2, 3, 4}};
    struct context ctx;
    struct mesh mesh, out;
    struct collapse *collapse;
    context_init(&ctx);
    struct shape shape = shape_icosphere(4); /* there is enough else to collapse */
    for (size_t i = 0; i < 3 * shape.vertex_count; i++)
        shape.positions[i] = 7 * shape.positions[i] - (i % 3 == 0 ? 9 : 0);
    const uint32_t first = (uint32_t)shape.vertex_count;
    for (int v = 0; v < 5; v++)
        shape_vertex(&shape, corners[v][0], corners[v][1], corners[v][2]);
    for (int f = 0; f < 6; f++)
        shape_triangle(&shape, first + faces[f][0], first + faces[f][1], first + faces[f][2]);
    shape_into_mesh(&ctx, &shape, &mesh);
    const struct collapse_options options = {.effort = 2, .keep_guards = true, .roughly = true};
    assert_int_equal(collapse_begin(&ctx, &options, mesh.vertex_count, mesh.face_count,
                                    mesh.positions, mesh.faces, NULL, NULL, NULL, &collapse),
                     STATUS_OK);
    assert_int_equal(collapse_run(collapse, 500, INFINITY), STATUS_OK);
    assert_int_equal(collapse_extract(collapse, &out, NULL), STATUS_OK);
    double lowest = 0;
    for (size_t v = 0; v < out.vertex_count; v++)
        if (out.positions[3 * v] > -1)
            lowest = fmin(lowest, out.positions[3 * v + 1]);
    assert_true(lowest > -1.5);
    collapse_end(&collapse);
    mesh_clear(&ctx, &mesh);
    mesh_clear(&ctx, &out);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void bad_meshes_are_refused(void **state)
{
    (void)state;
    struct shape (*const makers[])(unsigned) = {shape_spheres_touching_vertex,
                                                shape_spheres_touching_edge};
    for (int i = 0; i < 2; i++) {
        struct context ctx;
        struct mesh mesh;
        struct collapse *collapse;
        context_init(&ctx);
        struct shape shape = makers[i](1);
        shape_into_mesh(&ctx, &shape, &mesh);
        const struct collapse_options options = {.effort = 2};
        assert_int_equal(collapse_begin(&ctx, &options, mesh.vertex_count, mesh.face_count,
                                        mesh.positions, mesh.faces, NULL, NULL, NULL, &collapse),
                         STATUS_INTERNAL);
        assert_null(collapse);
        assert_non_null(strstr(ctx.error, "not manifold"));
        mesh_clear(&ctx, &mesh);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
}

static void empty_mesh(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh = {0}, out;
    context_init(&ctx);
    simplify(&ctx, &mesh, 10, 2, false, &out);
    assert_int_equal(out.face_count, 0);
    assert_int_equal(out.vertex_count, 0);
    mesh_clear(&ctx, &out);
    context_clear(&ctx);
}

static void memory_stays_below_sixty_bytes_a_face(void **state)
{
    (void)state;
    struct context ctx;
    struct mesh mesh;
    context_init(&ctx);
    struct shape shape = shape_icosphere(6);
    shape_into_mesh(&ctx, &shape, &mesh);
    const uint64_t before = ctx.memory_now;
    ctx.memory_peak = before;
    struct collapse *collapse = begin(&ctx, &mesh, 3, false);
    assert_int_equal(collapse_run(collapse, 1000, INFINITY), STATUS_OK);
    assert_true(ctx.memory_peak - before <= 60 * mesh.face_count);
    collapse_end(&collapse);
    assert_int_equal(ctx.memory_now, before);
    mesh_clear(&ctx, &mesh);
    context_clear(&ctx);
}

/* Guards against work that is quadratic at a hub: a disk of 200,000 faces round one vertex. */
static void hub_is_not_quadratic(void **state)
{
    (void)state;
    enum { SPOKES = 200000 };
    struct context ctx;
    struct mesh mesh, out;
    context_init(&ctx);
    struct shape shape = {0};
    shape_vertex(&shape, 0, 0, 0);
    for (int i = 0; i < SPOKES; i++) {
        const double angle = 6.283185307179586 * i / SPOKES;
        shape_vertex(&shape, (float)cos(angle), (float)sin(angle), 0);
    }
    for (uint32_t i = 0; i < SPOKES; i++)
        shape_triangle(&shape, 0, 1 + i, 1 + (i + 1) % SPOKES);
    shape_into_mesh(&ctx, &shape, &mesh);
    const clock_t start = clock();
    simplify(&ctx, &mesh, 1000, 3, false, &out);
    assert_in_range(out.face_count, 999, 1000);
    assert_true((double)(clock() - start) / CLOCKS_PER_SEC < 20);
    assert_true(fabs(mesh_area(&out) / mesh_area(&mesh) - 1) < 1e-3);
    mesh_clear(&ctx, &out);
    mesh_clear(&ctx, &mesh);
    context_clear(&ctx);
}

/* Every allocation that fails ends in a clean STATUS_NO_MEMORY. */
static void failed_allocations(void **state)
{
    (void)state;
    for (uint64_t n = 0;; n++) {
        struct context ctx;
        struct mesh mesh, out;
        struct collapse *collapse = NULL;
        context_init(&ctx);
        struct shape shape = shape_icosphere(3);
        shape_into_mesh(&ctx, &shape, &mesh);
        const uint64_t before = ctx.memory_now;
        const struct collapse_options options = {.effort = 2};
        ctx.fault_after = n;
        enum status status =
            collapse_begin(&ctx, &options, mesh.vertex_count, mesh.face_count, mesh.positions,
                           mesh.faces, NULL, NULL, NULL, &collapse);
        if (status == STATUS_OK)
            status = collapse_run(collapse, 100, INFINITY);
        if (status == STATUS_OK)
            status = collapse_extract(collapse, &out, NULL);
        collapse_end(&collapse);
        if (status == STATUS_OK)
            mesh_clear(&ctx, &out);
        else
            assert_int_equal(status, STATUS_NO_MEMORY);
        assert_int_equal(ctx.memory_now, before);
        ctx.fault_after = UINT64_MAX;
        mesh_clear(&ctx, &mesh);
        context_clear(&ctx);
        if (status == STATUS_OK) {
            assert_true(n > 5);
            return;
        }
    }
}

/* Lanes compiled for the widest vectors of this machine and for what all machines have: the same
 * bits, with border and without, at every effort. */
static void vectors_change_no_bit(void **state)
{
    (void)state;
    for (uint32_t effort = 1; effort <= 3; effort++)
        for (int closed = 0; closed < 2; closed++) {
            struct mesh out[2];
            struct context ctx[2];
            for (int wide = 0; wide < 2; wide++) {
                struct mesh mesh;
                struct shape shape =
                    closed ? shape_noisy_torus(40, 20, 0.05, 7) : shape_grid_with_holes(16, 12);
                context_init(&ctx[wide]);
                ctx[wide].cpu_level_cap = wide ? UINT_MAX : CPU_SCALAR;
                shape_into_mesh(&ctx[wide], &shape, &mesh);
                simplify(&ctx[wide], &mesh, 200, effort, false, &out[wide]);
                mesh_clear(&ctx[wide], &mesh);
            }
            assert_int_equal(out[0].face_count, out[1].face_count);
            assert_int_equal(out[0].vertex_count, out[1].vertex_count);
            assert_memory_equal(out[0].faces, out[1].faces, 12 * (size_t)out[0].face_count);
            assert_memory_equal(out[0].positions, out[1].positions,
                                24 * (size_t)out[0].vertex_count);
            for (int wide = 0; wide < 2; wide++) {
                mesh_clear(&ctx[wide], &out[wide]);
                context_clear(&ctx[wide]);
            }
        }
}

/* One mesh in several threads: the same bytes for any number of them, manifold, with N faces. */
static void threads_change_no_bit(void **state)
{
    (void)state;
    struct mesh out[4];
    struct context ctx[4];
    const unsigned threads[4] = {1, 2, 3, 8};
    for (int i = 0; i < 4; i++) {
        const struct collapse_options options = {.effort = 2, .together = true};
        struct collapse *collapse;
        struct mesh mesh;
        struct shape shape = shape_noisy_sphere(5, 0.01, 3);
        context_init(&ctx[i]);
        ctx[i].threads = threads[i];
        shape_into_mesh(&ctx[i], &shape, &mesh);
        assert_true(mesh.vertex_count > 2 * 4096); /* enough to be shared out */
        assert_int_equal(collapse_begin(&ctx[i], &options, mesh.vertex_count, mesh.face_count,
                                        mesh.positions, mesh.faces, NULL, NULL, NULL, &collapse),
                         STATUS_OK);
        assert_int_equal(collapse_run(collapse, 1500, INFINITY), STATUS_OK);
        assert_int_equal(collapse_extract(collapse, &out[i], NULL), STATUS_OK);
        collapse_end(&collapse);
        mesh_clear(&ctx[i], &mesh);
        const struct facts facts = facts_of(&out[i]);
        assert_true(facts_manifold(&facts));
        assert_in_range(out[i].face_count, 1499, 1500);
        assert_int_equal(out[i].vertex_count, out[0].vertex_count);
        assert_memory_equal(out[i].faces, out[0].faces, 12 * (size_t)out[0].face_count);
        assert_memory_equal(out[i].positions, out[0].positions, 24 * (size_t)out[0].vertex_count);
    }
    for (int i = 0; i < 4; i++) {
        mesh_clear(&ctx[i], &out[i]);
        context_clear(&ctx[i]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(vectors_change_no_bit),
        cmocka_unit_test(threads_change_no_bit),
        cmocka_unit_test(volume_is_kept),
        cmocka_unit_test(flat_square_keeps_its_border),
        cmocka_unit_test(cube_keeps_its_corners),
        cmocka_unit_test(copies_go_on_by_themselves),
        cmocka_unit_test(what_costs_nothing_goes_first),
        cmocka_unit_test(unit_does_not_matter),
        cmocka_unit_test(far_from_the_origin),
        cmocka_unit_test(attributes_travel),
        cmocka_unit_test(error_bound_holds),
        cmocka_unit_test(witnesses_count),
        cmocka_unit_test(specks_do_not_become_needles),
        cmocka_unit_test(bad_meshes_are_refused),
        cmocka_unit_test(empty_mesh),
        cmocka_unit_test(memory_stays_below_sixty_bytes_a_face),
        cmocka_unit_test(hub_is_not_quadratic),
        cmocka_unit_test(failed_allocations),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
