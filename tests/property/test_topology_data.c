/*
 * Cracks of real scans: below the size asked for all are closed, those above are as they were, and
 * what comes out is a manifold.
 */
#include "test_kit.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mesh/import.h"
#include "mesh/store.h"
#include "test_topology_kit.h"

/* The border loops of a mesh whose diameter is at least `size`: how many, and the sum of their
 * vertices' coordinates. */
struct large_loops {
    size_t count, small;
    double sum;
};

static double squared_distance(const double *a, const double *b)
{
    double x = a[0] - b[0], y = a[1] - b[1], z = a[2] - b[2];
    return x * x + y * y + z * z;
}

static int compare_pairs(const void *a, const void *b)
{
    return memcmp(a, b, 2 * sizeof(uint32_t));
}

/* Border edges by their first vertex: sorting tells which edges have no other side. */
static uint32_t *find_next(const struct mesh *mesh)
{
    size_t count = 3 * mesh->face_count;
    uint32_t(*pairs)[3] = malloc(count * sizeof *pairs);
    uint32_t *next = malloc(mesh->vertex_count * sizeof *next);
    memset(next, 0xff, mesh->vertex_count * sizeof *next);
    for (size_t c = 0; c < count; c++) {
        uint32_t a = mesh->faces[c], b = mesh->faces[c % 3 == 2 ? c - 2 : c + 1];
        pairs[c][0] = a < b ? a : b;
        pairs[c][1] = a < b ? b : a;
        pairs[c][2] = a < b;
    }
    qsort(pairs, count, sizeof *pairs, compare_pairs);
    for (size_t i = 0; i < count; i++) {
        bool is_border = (i == 0 || compare_pairs(pairs[i - 1], pairs[i]) != 0) &&
                         (i + 1 == count || compare_pairs(pairs[i], pairs[i + 1]) != 0);
        if (is_border && pairs[i][2])
            next[pairs[i][0]] = pairs[i][1];
        else if (is_border)
            next[pairs[i][1]] = pairs[i][0];
    }
    free(pairs);
    return next;
}

static struct large_loops find_large(const struct mesh *mesh, double size)
{
    struct large_loops large = {0};
    uint32_t *next = find_next(mesh);
    for (uint32_t first = 0; first < mesh->vertex_count; first++) {
        double most = 0, sum = 0;
        if (next[first] == UINT32_MAX)
            continue;
        uint32_t a = first;
        do {
            const double *p = mesh->positions + 3 * (size_t)a;
            sum += p[0] + 2 * p[1] + 3 * p[2];
            for (uint32_t b = next[a]; b != first; b = next[b]) {
                double far = squared_distance(p, mesh->positions + 3 * (size_t)b);
                most = far > most ? far : most;
            }
            a = next[a];
        } while (a != first);
        large.count += most >= size * size;
        large.small += most < size * size;
        large.sum += most >= size * size ? sum : 0;
        do {
            uint32_t after = next[a];
            next[a] = UINT32_MAX;
            a = after;
        } while (next[a] != UINT32_MAX);
    }
    free(next);
    return large;
}

static void try_scan(const char *name, const double *percents, unsigned count)
{
    char store[4096], chains[4096], output[4096];
    const char *input = test_data(name);
    if (!input)
        skip();
    struct context ctx;
    struct store *opened;
    struct mesh before, after;
    struct import_options import = {.sync = false};
    context_init(&ctx);
    snprintf(store, sizeof store, "%s", test_path("scan.store"));
    snprintf(chains, sizeof chains, "%s", test_path("scan.chains"));
    snprintf(output, sizeof output, "%s", test_path("scan-out.ply"));
    assert_int_equal(store_build(&ctx, &input, 1, store, &import, NULL), STATUS_OK);
    assert_int_equal(store_open(&ctx, store, true, &opened), STATUS_OK);
    const struct store_info *info = store_info(opened);
    double diagonal = sqrt(squared_distance(info->box_low, info->box_high));
    assert_int_equal(store_load(opened, &before), STATUS_OK);
    for (unsigned i = 0; i < count; i++) {
        double size = percents[i] / 100 * diagonal;
        struct topology_options options;
        struct topology_report report = {0};
        topology_defaults(&options);
        options.close_cracks.value = size;
        assert_int_equal(topology_run(&ctx, store, chains, output, &options, &report), STATUS_OK);
        assert_int_equal(report.blocked, 0);
        assert_int_equal(mesh_load(&ctx, output, &after), STATUS_OK);
        struct facts facts = facts_of(&after);
        struct large_loops was = find_large(&before, size), is = find_large(&after, size);
        assert_true(facts_manifold(&facts));
        assert_int_equal(is.small, 0);
        assert_int_equal(is.count, was.count);
        assert_true(fabs(is.sum - was.sum) <= 1e-9 * (fabs(was.sum) + diagonal));
        assert_int_equal(report.counts[FEATURE_CRACK], was.small);
        mesh_clear(&ctx, &after);
        topology_report_clear(&ctx, &report);
    }
    mesh_clear(&ctx, &before);
    store_close(&opened);
    context_clear(&ctx);
}

static void bunny(void **state)
{
    (void)state;
    static const double percents[] = {1, 5, 10, 20};
    try_scan("stanford_bunny_ascii.ply", percents, 4);
}

static void birdbath(void **state)
{
    (void)state;
    static const double percents[] = {0.5, 2, 10};
    try_scan("photogrammetry_birdbath_holes.ply", percents, 3);
}

static void cranium(void **state)
{
    (void)state;
    static const double percents[] = {2};
    try_scan("ct_cranium_open.ply.gz", percents, 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bunny),
        cmocka_unit_test(birdbath),
        cmocka_unit_test(cranium),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
