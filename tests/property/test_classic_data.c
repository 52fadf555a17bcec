/*
 * Mode classic on real meshes: the counts of the dissertation's table 1 with the store's topology
 * kept, and, on the fandisk, sharp edges that stay where they were.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/memory.h"
#include "geom/polyline.h"
#include "mesh/import.h"
#include "simplify/simplify.h"
#include "test_facts.h"
#include "test_kit.h"
#include "test_shapes.h"

enum { NAME = 4096, SAMPLES = 16 };

struct levels {
    struct store_info store;
    struct mesh original;
    struct mesh meshes[TARGETS_MAX];
    uint32_t count;
};

static void make_mesh_levels(struct context *ctx, const char *input, double patch_angle,
                             double face_angle, const struct target *target, struct levels *levels)
{
    char store[NAME], chains[NAME], output[NAME], name[64];
    const struct import_options import = {0};
    const struct patch_request request = {.patch_angle = {patch_angle, -1},
                                          .face_angle = {face_angle, -1},
                                          .smoothings = patch_angle > 0 ? 0 : -1,
                                          .chain_tolerance = -1};
    struct lod_report report;
    snprintf(store, NAME, "%s", test_path("data.store"));
    snprintf(chains, NAME, "%s", test_path("data.chains"));
    snprintf(output, NAME, "%s", test_path("data-%d.ply"));
    struct lod_options options = {.target = *target, .output = output};
    if (store_build(ctx, &input, 1, store, &import, &levels->store) != STATUS_OK ||
        chain_build(ctx, store, chains, target, &request, NULL) != STATUS_OK ||
        lod_build(ctx, chains, &options, &report) != STATUS_OK)
        fail_msg("%s: %s", input, ctx->error);
    assert_int_equal(mesh_load(ctx, input, &levels->original), STATUS_OK);
    levels->count = report.level_count;
    for (uint32_t i = 0; i < report.level_count; i++) {
        snprintf(name, sizeof name, "data-%u.ply", i);
        assert_int_equal(mesh_load(ctx, test_path(name), &levels->meshes[i]), STATUS_OK);
        struct facts facts = facts_of(&levels->meshes[i]);
        assert_true(facts_manifold(&facts));
        assert_int_equal(facts.components, levels->store.topology.components);
        assert_int_equal(facts.border_loops, levels->store.topology.border_loops);
        assert_int_equal(facts.euler, levels->store.topology.euler);
        assert_true(facts.faces == report.levels[i].wanted_faces ||
                    facts.faces + 1 == report.levels[i].wanted_faces);
    }
}

static void levels_clear(struct context *ctx, struct levels *levels)
{
    mesh_clear(ctx, &levels->original);
    for (uint32_t i = 0; i < levels->count; i++)
        mesh_clear(ctx, &levels->meshes[i]);
}

static void counts_of_table_1(void **state)
{
    (void)state;
    static const struct {
        const char *file;
        struct target target;
    } runs[] = {
        {"stanford_bunny_ascii.ply", {.count = 3, .values = {1504, 1000, 525}}},
        {"femur.off", {.count = 2, .values = {997, 270}}},
        {"fandisk.off.gz", {.count = 3, .values = {460, 266, 150}}},
        {"stanford_dragon.ply.gz", {.count = 1, .values = {20000}}},
    };
    for (size_t i = 0; i < sizeof runs / sizeof *runs; i++) {
        const char *input = test_data(runs[i].file);
        struct target target = runs[i].target;
        struct levels levels = {0};
        struct context ctx;
        if (!input)
            skip();
        target.kind = TARGET_FACES;
        target.mode = MODE_CLASSIC;
        target.effort = 2;
        context_init(&ctx);
        make_mesh_levels(&ctx, input, -1, -1, &target, &levels);
        levels_clear(&ctx, &levels);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
}

/* ---- sharp edges ---- */

struct edge {
    uint32_t low, high, face;
};

struct segments {
    struct vec3 *ends; /* 2 each */
    size_t count;
};

static int compare_edges(const void *left, const void *right)
{
    const struct edge *a = left, *b = right;
    if (a->low != b->low)
        return a->low < b->low ? -1 : 1;
    return (a->high > b->high) - (a->high < b->high);
}

static struct vec3 point_of(const struct mesh *mesh, uint32_t v)
{
    return vec3_load(mesh->positions + 3 * (size_t)v);
}

static struct vec3 face_normal(const struct mesh *mesh, uint32_t f)
{
    const uint32_t *face = mesh->faces + 3 * (size_t)f;
    return vec3_normalized(
        triangle_normal(point_of(mesh, face[0]), point_of(mesh, face[1]), point_of(mesh, face[2])));
}

/* Edges whose faces' normals differ by more than `degrees`. */
static struct segments sharp_edges(const struct mesh *mesh, double degrees)
{
    size_t count = 3 * (size_t)mesh->face_count;
    struct edge *edges = malloc(count * sizeof *edges);
    struct segments sharp = {malloc(2 * count * sizeof *sharp.ends), 0};
    double least = cos(degrees * 3.14159265358979 / 180);
    assert_true(edges && sharp.ends);
    for (uint32_t c = 0; c < count; c++) {
        uint32_t a = mesh->faces[c], b = mesh->faces[c - c % 3 + (c + 1) % 3];
        edges[c] = (struct edge){a < b ? a : b, a < b ? b : a, c / 3};
    }
    qsort(edges, count, sizeof *edges, compare_edges);
    for (size_t i = 0; i + 1 < count; i++)
        if (compare_edges(&edges[i], &edges[i + 1]) == 0 &&
            vec3_dot(face_normal(mesh, edges[i].face), face_normal(mesh, edges[i + 1].face)) <
                least) {
            sharp.ends[2 * sharp.count] = point_of(mesh, edges[i].low);
            sharp.ends[2 * sharp.count + 1] = point_of(mesh, edges[i].high);
            sharp.count++;
        }
    free(edges);
    return sharp;
}

/* Largest distance of a point on one of `from` to the nearest of `to`. */
static double farthest(const struct segments *from, const struct segments *to)
{
    double largest = 0;
    for (size_t i = 0; i < from->count; i++)
        for (int s = 0; s <= SAMPLES; s++) {
            struct vec3 a = from->ends[2 * i], b = from->ends[2 * i + 1];
            struct vec3 p = vec3_add_scaled(a, (double)s / SAMPLES, vec3_sub(b, a));
            double nearest = INFINITY;
            for (size_t k = 0; k < to->count; k++) {
                double d =
                    vec3_length_squared(segment_offset(p, to->ends[2 * k], to->ends[2 * k + 1]));
                nearest = d < nearest ? d : nearest;
            }
            largest = nearest > largest ? nearest : largest;
        }
    return sqrt(largest);
}

static double diagonal_of(const struct store_info *info)
{
    double sum = 0;
    for (int k = 0; k < 3; k++)
        sum += (info->box_high[k] - info->box_low[k]) * (info->box_high[k] - info->box_low[k]);
    return sqrt(sum);
}

/* What is sharp for certain (60 degrees) in one must be sharp at all (30 degrees) in the other. */
static double sharp_distance(const struct mesh *from, const struct mesh *to)
{
    struct segments certain = sharp_edges(from, 60), possible = sharp_edges(to, 30);
    assert_true(certain.count > 0 && possible.count > 0);
    double distance = farthest(&certain, &possible);
    free(certain.ends);
    free(possible.ends);
    return distance;
}

/*
 * 0.5 % of the diagonal, both ways. At 150 faces that is not possible with input vertices: the
 * sharp edges alone, each chain cut greedily into the longest pieces within 0.5 %, need 78 vertices
 * (edges of 45 degrees and more), which on a sphere are 152 faces; 1.2 % is demanded there.
 */
static void fandisk_stays_sharp(void **state)
{
    (void)state;
    const char *input = test_data("fandisk.off.gz");
    const double limits[3] = {0.005, 0.005, 0.012};
    const struct target target = {.kind = TARGET_FACES,
                                  .count = 3,
                                  .values = {460, 266, 150},
                                  .mode = MODE_CLASSIC,
                                  .effort = 2};
    struct levels levels = {0};
    struct context ctx;
    if (!input)
        skip();
    context_init(&ctx);
    make_mesh_levels(&ctx, input, 15, 12, &target, &levels);
    for (uint32_t i = 0; i < levels.count; i++) {
        double there = sharp_distance(&levels.meshes[i], &levels.original);
        double back = sharp_distance(&levels.original, &levels.meshes[i]);
        double limit = limits[i] * diagonal_of(&levels.store);
        printf("fandisk, %u faces: sharp edges %.2f %% and %.2f %% of the diagonal\n",
               (unsigned)levels.meshes[i].face_count, 100 * there / diagonal_of(&levels.store),
               100 * back / diagonal_of(&levels.store));
        assert_true(there <= limit);
        assert_true(back <= limit);
    }
    levels_clear(&ctx, &levels);
    context_clear(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(counts_of_table_1),
        cmocka_unit_test(fandisk_stays_sharp),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
