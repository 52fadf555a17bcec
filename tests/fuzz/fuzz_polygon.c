/*
 * The triangulator on any loop: points on a small grid (so that they meet, line up and cross), or
 * any floats; the loop's own plane or another; diagonals that are forbidden. The result is a
 * triangulation of the loop as triangulate.h promises, and a planar one has the polygon's area.
 */
#include "target.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "geom/triangulate.h"

const bool target_keeps_length = false;

enum { MOST_CORNERS = 300 };

static bool allow(void *user, uint32_t i, uint32_t j)
{
    uint32_t low = i < j ? i : j, high = i < j ? j : i;
    unsigned every = *(const unsigned *)user;
    return every == 0 || (low * 31 + high * 17) % every != 0;
}

static int by_edge(const void *a, const void *b)
{
    return memcmp(a, b, 2 * sizeof(uint32_t));
}

/* Every edge of the loop once, forwards; every other edge once in each direction. */
static void check_triangles(const uint32_t *triangles, uint32_t n, unsigned every)
{
    static uint32_t edges[3 * MOST_CORNERS][2];
    uint32_t count = 0;
    for (uint32_t t = 0; t < n - 2; t++)
        for (uint32_t k = 0; k < 3; k++, count++) {
            edges[count][0] = triangles[3 * t + k];
            edges[count][1] = triangles[3 * t + (k + 1) % 3];
            require(edges[count][0] < n && edges[count][0] != edges[count][1],
                    "corners are corners of the loop");
        }
    qsort(edges, count, sizeof *edges, by_edge);
    uint32_t on_loop = 0;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t a = edges[i][0], b = edges[i][1], back[2] = {b, a};
        require(i == 0 || by_edge(edges[i - 1], edges[i]) != 0, "no edge runs twice the same way");
        if (b == (a + 1) % n) {
            on_loop++;
            continue;
        }
        require(bsearch(back, edges, count, sizeof *edges, by_edge) != NULL,
                "a diagonal has two sides");
        require(allow(&every, a, b), "a forbidden diagonal is not used");
    }
    require(on_loop == n, "every edge of the loop is in a triangle");
}

static double cross(const double *a, const double *b, const double *c)
{
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

/* For loops with small integers in the plane z = 0: all sums are exact. */
static void check_area(const double *points, uint32_t n, const uint32_t *triangles)
{
    double whole = 0, sum = 0;
    for (uint32_t i = 1; i + 1 < n; i++)
        whole += cross(points, points + 3 * i, points + 3 * (i + 1));
    for (uint32_t t = 0; t < n - 2; t++)
        sum += fabs(cross(points + 3 * triangles[3 * t], points + 3 * triangles[3 * t + 1],
                          points + 3 * triangles[3 * t + 2]));
    require(fabs(whole) == sum, "planar triangles tile the polygon");
}

/* The same loops: no edges cross. (One may touch another: the triangulator's grid rounds.) */
static void check_simple(const double *points, uint32_t n)
{
    for (uint32_t i = 0; i + 2 < n; i++)
        for (uint32_t k = i + 2; k < n - (i == 0); k++) {
            struct grid_point ends[4];
            for (unsigned e = 0; e < 4; e++) {
                const double *p = points + 3 * (((e < 2 ? i : k) + e % 2) % n);
                ends[e] = (struct grid_point){(int32_t)p[0] + 128, (int32_t)p[1] + 128};
            }
            require(!segments_cross(ends[0], ends[1], ends[2], ends[3]),
                    "what is planar is simple");
        }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static double points[3 * MOST_CORNERS];
    static uint32_t triangles[3 * MOST_CORNERS];
    if (size < 2)
        return 0;
    unsigned flags = data[0], every = flags & 1 ? 2 + data[1] % 7u : 0;
    bool is_grid = flags & 2, is_flat = flags & 4;
    size_t step = is_grid ? (is_flat ? 2 : 3) : 3 * sizeof(float);
    data += 2;
    size -= 2;
    uint32_t n = (uint32_t)(size / step < MOST_CORNERS ? size / step : MOST_CORNERS);
    if (n < 3)
        return 0;
    for (uint32_t i = 0; i < n; i++)
        for (unsigned k = 0; k < 3; k++) {
            float value = 0;
            if (!is_grid)
                memcpy(&value, data + i * step + k * sizeof value, sizeof value);
            else if (k < step)
                value = (float)(int8_t)data[i * step + k];
            points[3 * i + k] = isfinite(value) ? (double)value : 1e38;
        }
    static const double up[3] = {0, 0, 1};
    const double *normal = flags & 8 ? up : NULL;

    struct context ctx;
    target_context(&ctx);
    struct triangulation_workspace workspace;
    memset(&workspace, 0, sizeof workspace);
    enum triangulation_quality quality;
    enum status status = triangulate(&ctx, &workspace, points, n, normal, every ? allow : NULL,
                                     &every, triangles, &quality);
    require(status == STATUS_OK, "any loop is triangulated");
    require(every || quality != TRIANGULATION_BLOCKED,
            "without forbidden diagonals nothing is blocked");
    if (quality != TRIANGULATION_BLOCKED)
        check_triangles(triangles, n, every);
    if (quality == TRIANGULATION_PLANAR && is_grid && is_flat) {
        check_area(points, n, triangles);
        check_simple(points, n);
    }
    triangulation_workspace_clear(&ctx, &workspace);
    require(ctx.memory_now == 0, "all memory is given back");
    context_clear(&ctx);
    return 0;
}

void target_seeds(const struct seed_taker *taker)
{
    /* Flags, the rule of forbidden diagonals, then corners on the grid. */
    static const uint8_t square[] = {6, 0, 0, 0, 9, 0, 9, 9, 0, 9};
    static const uint8_t comb[] = {14, 0, 0, 0, 9, 0, 9, 9, 8, 9, 8, 1, 6,
                                   1,  6, 9, 4, 9, 4, 1, 2, 1, 2, 9, 0, 9};
    static const uint8_t bridged[] = {6, 0, 0, 0, 9, 0, 9, 9, 0, 9, 0,
                                      0, 3, 3, 3, 6, 6, 6, 6, 3, 3, 3};
    static const uint8_t eight[] = {7, 3, 0, 0, 9, 9, 9, 0, 0, 9};
    static const uint8_t line[] = {6, 0, 0, 0, 1, 0, 5, 0, 3, 0, 2, 0};
    static const uint8_t bent[] = {2, 0, 0, 0, 0, 9, 0, 5, 9, 9, 0, 0, 9, 7, 4, 4, 4};
    taker->take(taker->user, square, sizeof square);
    taker->take(taker->user, comb, sizeof comb);
    taker->take(taker->user, bridged, sizeof bridged);
    taker->take(taker->user, eight, sizeof eight);
    taker->take(taker->user, line, sizeof line);
    taker->take(taker->user, bent, sizeof bent);
    uint8_t round[2 + 2 * 120] = {6, 0};
    for (unsigned i = 0; i < 120; i++) { /* a star of many corners */
        double angle = i * 6.283185307179586 / 120, radius = i % 2 ? 120 : 40;
        round[2 + 2 * i] = (uint8_t)(int8_t)(radius * cos(angle));
        round[3 + 2 * i] = (uint8_t)(int8_t)(radius * sin(angle));
    }
    taker->take(taker->user, round, sizeof round);
    struct {
        uint8_t head[2];
        uint8_t floats[36 * 4];
    } any = {.head = {0, 0}};
    for (unsigned i = 0; i < 36; i++) {
        float value = i % 3 == 2 ? 0.01f * (float)(i % 5)
                                 : (float)(i % 3 ? sin(i / 3 * 0.5236) : cos(i / 3 * 0.5236));
        memcpy(any.floats + 4 * i, &value, sizeof value);
    }
    taker->take(taker->user, &any, sizeof any);
}
