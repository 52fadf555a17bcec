/*
 * Triangulations of polygons: whatever the loop, the triangles form a disk with that border; of a
 * simple one, they tile it. Checked by counting edges and areas, never against recorded triangles.
 */
#include "base/memory.h"
#include "geom/ear_clip.h"
#include "geom/triangulate.h"
#include "geom/vec.h"
#include "test_kit.h"
#include "test_shapes.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

static struct context ctx;
static struct triangulation_workspace workspace;

static int set_up(void **state)
{
    (void)state;
    context_init(&ctx);
    return 0;
}

static int tear_down(void **state)
{
    (void)state;
    triangulation_workspace_clear(&ctx, &workspace);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return 0;
}

static int compare_u64(const void *left, const void *right)
{
    uint64_t a = *(const uint64_t *)left, b = *(const uint64_t *)right;
    return (a > b) - (a < b);
}

static bool holds(const uint64_t *edges, size_t count, uint32_t from, uint32_t to)
{
    uint64_t key = (uint64_t)from << 32 | to;
    return bsearch(&key, edges, count, sizeof key, compare_u64) != NULL;
}

/* n - 2 triangles; every directed edge once; each either an edge of the loop or a diagonal that is
 * there the other way round too. Together these make a triangulated disk. */
static void assert_is_disk(const uint32_t *triangles, uint32_t n)
{
    size_t count = 3 * ((size_t)n - 2), loop_edges = 0;
    uint64_t *edges = malloc(count * sizeof *edges);
    assert_non_null(edges);
    for (size_t i = 0; i < count; i++) {
        uint32_t from = triangles[i], to = triangles[i - i % 3 + (i + 1) % 3];
        assert_true(from < n && to < n && from != to);
        edges[i] = (uint64_t)from << 32 | to;
    }
    qsort(edges, count, sizeof *edges, compare_u64);
    for (size_t i = 1; i < count; i++)
        assert_true(edges[i] != edges[i - 1]);
    for (size_t i = 0; i < count; i++) {
        uint32_t from = (uint32_t)(edges[i] >> 32), to = (uint32_t)edges[i];
        if (to == (from + 1) % n)
            loop_edges++;
        else
            assert_true(holds(edges, count, to, from));
    }
    assert_int_equal(loop_edges, n);
    free(edges);
}

static struct vec3 corner_at(const double *points, uint32_t i)
{
    return vec3_load(points + 3 * (size_t)i);
}

/* Twice the area vector of the loop, with the first corner as origin. */
static struct vec3 loop_area(const double *points, uint32_t n)
{
    struct vec3 sum = {0, 0, 0}, origin = corner_at(points, 0);
    for (uint32_t i = 1; i + 1 < n; i++)
        sum =
            vec3_add(sum, triangle_normal(origin, corner_at(points, i), corner_at(points, i + 1)));
    return sum;
}

/* In the projection along `normal`, all triangles are positive (up to the grid) and sum up. */
static void assert_tiles(const double *points, uint32_t n, const uint32_t *triangles,
                         struct vec3 normal)
{
    double total = 0, expected = vec3_dot(loop_area(points, n), normal), least = 0;
    for (uint32_t t = 0; t + 2 < n; t++) {
        double area = vec3_dot(triangle_normal(corner_at(points, triangles[3 * t]),
                                               corner_at(points, triangles[3 * t + 1]),
                                               corner_at(points, triangles[3 * t + 2])),
                               normal);
        total += fabs(area);
        least = area < least ? area : least;
    }
    assert_true(least >= -1e-6 * expected);
    assert_true(fabs(total - expected) <= 1e-6 * expected);
}

static enum triangulation_quality run(const double *points, uint32_t n, const double *normal,
                                      uint32_t *triangles)
{
    enum triangulation_quality quality;
    assert_int_equal(
        triangulate(&ctx, &workspace, points, n, normal, NULL, NULL, triangles, &quality),
        STATUS_OK);
    if (quality != TRIANGULATION_BLOCKED)
        assert_is_disk(triangles, n);
    return quality;
}

/* The polygon must come out tiled, also moved far away, turned in space and as its mirror image
 * seen from behind. Frees the shape. */
static void assert_is_tiled(struct shape shape)
{
    uint32_t n = (uint32_t)shape.vertex_count;
    uint32_t *triangles = malloc(3 * (size_t)n * sizeof *triangles);
    double *turned = malloc(3 * (size_t)n * sizeof *turned);
    assert_true(triangles && turned);
    const double up[3] = {0, 0, 1};
    assert_int_equal(run(shape.positions, n, up, triangles), TRIANGULATION_PLANAR);
    assert_tiles(shape.positions, n, triangles, (struct vec3){0, 0, 1});
    assert_int_equal(run(shape.positions, n, NULL, triangles), TRIANGULATION_PLANAR);

    /* Orthonormal axes, chosen without symmetry; then UTM-like coordinates. */
    const struct vec3 w = vec3_normalized((struct vec3){0.3, -0.7, 0.45});
    const struct vec3 u = vec3_normalized(vec3_cross(w, (struct vec3){1, 2, 5}));
    const struct vec3 v = vec3_cross(w, u);
    for (uint32_t i = 0; i < n; i++) {
        const double *p = shape.positions + 3 * i;
        struct vec3 q = vec3_add(vec3_scale(u, p[0]), vec3_scale(v, p[1]));
        vec3_store(turned + 3 * i, vec3_add(q, (struct vec3){500000, 5400000, 300}));
    }
    assert_int_equal(run(turned, n, NULL, triangles), TRIANGULATION_PLANAR);
    assert_tiles(turned, n, triangles, w);

    for (uint32_t i = 0; i < n; i++) /* mirrored, so that the loop runs clockwise */
        turned[3 * i] = -shape.positions[3 * i], turned[3 * i + 1] = shape.positions[3 * i + 1],
                   turned[3 * i + 2] = 0;
    assert_int_equal(run(turned, n, NULL, triangles), TRIANGULATION_PLANAR);
    assert_tiles(turned, n, triangles, (struct vec3){0, 0, -1});
    assert_int_equal(run(turned, n, up, triangles), TRIANGULATION_FORCED);
    assert_tiles(turned, n, triangles, (struct vec3){0, 0, -1});
    free(turned);
    free(triangles);
    shape_free(&shape);
}

static struct shape polygon(uint32_t n, const double (*corners)[2])
{
    struct shape shape = {0};
    for (uint32_t i = 0; i < n; i++)
        shape_vertex(&shape, corners[i][0], corners[i][1], 0);
    return shape;
}

static void simple_loops_are_tiled(void **state)
{
    (void)state;
    for (uint32_t n = 4; n < 80; n++)
        for (uint64_t seed = 0; seed < 12; seed++)
            assert_is_tiled(shape_star_polygon(n, 100 * n + seed));
    assert_is_tiled(shape_star_polygon(3000, 5));
    for (uint32_t teeth = 2; teeth < 60; teeth += 7)
        assert_is_tiled(shape_comb(teeth));
    assert_is_tiled(shape_comb(2000));
}

static void collinear_corners_cause_no_flat_triangles(void **state)
{
    (void)state;
    /* A square with points on all sides; a triangle with points on one, at every place. */
    struct shape square = {0};
    for (uint32_t i = 0; i < 40; i++) {
        uint32_t side = i / 10, t = i % 10;
        double x = side == 0 ? t : side == 1 ? 10 : side == 2 ? 10 - t : 0;
        double y = side == 0 ? 0 : side == 1 ? t : side == 2 ? 10 : 10 - t;
        shape_vertex(&square, x, y, 0);
    }
    assert_is_tiled(square);
    for (uint32_t turn = 0; turn < 12; turn++) {
        struct shape triangle = {0};
        for (uint32_t i = 0; i < 12; i++) {
            uint32_t j = (i + turn) % 12;
            if (j == 11)
                shape_vertex(&triangle, 3, 7, 0);
            else
                shape_vertex(&triangle, j, 0, 0);
        }
        assert_is_tiled(triangle);
    }
    assert_is_tiled(polygon(5, (const double[][2]){{0, 0}, {2, 0}, {4, 0}, {4, 4}, {0, 4}}));
    /* Notches whose tips lie exactly on the lines of other edges. */
    assert_is_tiled(polygon(
        8, (const double[][2]){{0, 0}, {4, 0}, {4, 4}, {3, 4}, {3, 2}, {2, 2}, {2, 4}, {0, 4}}));
}

/* ---- the order of the ears ---- */

static bool is_proper_ear(const struct grid_point *p, const uint32_t *rest, uint32_t count,
                          uint32_t i)
{
    uint32_t a = rest[(i + count - 1) % count], b = rest[i], c = rest[(i + 1) % count];
    if (orientation(p[a], p[b], p[c]) <= 0)
        return false;
    for (uint32_t j = 0; j < count; j++)
        if (rest[j] != a && rest[j] != b && rest[j] != c &&
            triangle_holds(p[a], p[b], p[c], p[rest[j]]))
            return false;
    return true;
}

static double openness(const struct grid_point *p, uint32_t a, uint32_t b, uint32_t c)
{
    double ax = p[a].x - p[b].x, ay = p[a].y - p[b].y, cx = p[c].x - p[b].x, cy = p[c].y - p[b].y;
    return -(ax * cx + ay * cy) / sqrt((ax * ax + ay * ay) * (cx * cx + cy * cy));
}

/* All corners tested against all before every cut: the definition, in cubic time. */
static void cut_slowly(const struct grid_point *p, uint32_t n, uint32_t *triangles)
{
    uint32_t rest[64];
    for (uint32_t i = 0; i < n; i++)
        rest[i] = i;
    for (uint32_t count = n; count > 3; count--) {
        uint32_t best = UINT32_MAX;
        double least = 2;
        for (uint32_t i = 0; i < count; i++) {
            uint32_t a = rest[(i + count - 1) % count], c = rest[(i + 1) % count];
            if (is_proper_ear(p, rest, count, i) && openness(p, a, rest[i], c) < least) {
                least = openness(p, a, rest[i], c);
                best = i;
            }
        }
        assert_true(best < count);
        *triangles++ = rest[(best + count - 1) % count];
        *triangles++ = rest[best];
        *triangles++ = rest[(best + 1) % count];
        memmove(rest + best, rest + best + 1, (count - best - 1) * sizeof *rest);
    }
    memcpy(triangles, rest, 3 * sizeof *rest);
}

static int compare_triangles(const void *left, const void *right)
{
    return memcmp(left, right, 3 * sizeof(uint32_t));
}

/* Each triangle with its lowest corner in front, all sorted. */
static void put_in_order(uint32_t *triangles, uint32_t n)
{
    for (uint32_t t = 0; t + 2 < n; t++) {
        uint32_t *triangle = triangles + 3 * (size_t)t, turned[3];
        uint32_t low = triangle[1] < triangle[0] ? 1 : 0;
        low = triangle[2] < triangle[low] ? 2 : low;
        for (uint32_t k = 0; k < 3; k++)
            turned[k] = triangle[(low + k) % 3];
        memcpy(triangle, turned, sizeof turned);
    }
    qsort(triangles, n - 2, 3 * sizeof *triangles, compare_triangles);
}

/* A loop through random points of the grid, whose crossings are undone one by one, each making the
 * loop shorter: winding, with spirals inside. Counter-clockwise. */
static void make_winding(struct grid_point *p, uint32_t n, uint64_t *seed)
{
    for (uint32_t i = 0; i < n; i++)
        p[i] = (struct grid_point){(int32_t)random_below(seed, GRID_SIZE),
                                   (int32_t)random_below(seed, GRID_SIZE)};
    p[0].x = 0; /* the box is as wide as the grid */
    p[1].x = GRID_SIZE;
    for (bool clear = false; !clear;) {
        clear = true;
        for (uint32_t i = 0; i + 2 < n; i++)
            for (uint32_t j = i + 2; j < n; j++) {
                if (!segments_cross(p[i], p[i + 1], p[j], p[(j + 1) % n]))
                    continue;
                clear = false;
                for (uint32_t low = i + 1, high = j; low < high; low++, high--) {
                    struct grid_point swap = p[low];
                    p[low] = p[high];
                    p[high] = swap;
                }
            }
    }
    __int128 area = 0;
    for (uint32_t i = 0; i < n; i++)
        area += (__int128)p[i].x * p[(i + 1) % n].y - (__int128)p[i].y * p[(i + 1) % n].x;
    for (uint32_t low = 0, high = n - 1; area < 0 && low < high; low++, high--) {
        struct grid_point swap = p[low];
        p[low] = p[high];
        p[high] = swap;
    }
}

static void ears_are_cut_by_increasing_angle(void **state)
{
    (void)state;
    for (uint32_t n = 5; n < 64; n++)
        for (uint64_t round = 0; round < 12; round++) {
            double points[3 * 64] = {0};
            struct grid_point grid[64];
            uint32_t fast[3 * 64], slow[3 * 64];
            uint64_t seed = 100 * n + round;
            make_winding(grid, n, &seed);
            for (uint32_t i = 0; i < n; i++) { /* the projection changes nothing but axes */
                points[3 * i] = grid[i].x * 0x1p-30;
                points[3 * i + 1] = grid[i].y * 0x1p-30;
            }
            const double up[3] = {0, 0, 1};
            assert_int_equal(run(points, n, up, fast), TRIANGULATION_PLANAR);
            cut_slowly(grid, n, slow);
            put_in_order(fast, n);
            put_in_order(slow, n);
            assert_memory_equal(fast, slow, 3 * (n - 2) * sizeof *fast);
        }
}

static void spirals_are_tiled(void **state)
{
    (void)state;
    struct shape shape = {0};
    enum { STEPS = 200 };
    for (int i = 0; i <= STEPS; i++) {
        double angle = 0.2 * i, radius = 1 + 0.1 * i;
        shape_vertex(&shape, radius * cos(angle), radius * sin(angle), 0);
    }
    for (int i = STEPS; i >= 0; i--) {
        double angle = 0.2 * i, radius = 1.9 + 0.1 * i;
        shape_vertex(&shape, radius * cos(angle), radius * sin(angle), 0);
    }
    for (size_t i = 0; i < 3 * shape.vertex_count; i += 3) /* counter-clockwise */
        shape.positions[i] = -shape.positions[i];
    assert_is_tiled(shape);
}

static void quadrangles_get_the_right_diagonal(void **state)
{
    (void)state;
    const double up[3] = {0, 0, 1};
    uint32_t triangles[6];
    /* Concave at each corner in turn: the diagonal must start there. */
    const double arrow[4][2] = {{0, 0}, {4, 0}, {1, 1}, {0, 4}};
    for (uint32_t turn = 0; turn < 4; turn++) {
        double points[12] = {0};
        for (uint32_t i = 0; i < 4; i++)
            memcpy(points + 3 * i, arrow[(i + turn) % 4], 2 * sizeof(double));
        assert_int_equal(run(points, 4, turn % 2 ? up : NULL, triangles), TRIANGULATION_PLANAR);
        assert_tiles(points, 4, triangles, (struct vec3){0, 0, 1});
        uint32_t concave = (6 - turn) % 4, uses = 0;
        for (uint32_t i = 0; i < 6; i++)
            uses += triangles[i] == concave;
        assert_int_equal(uses, 2);
    }
    /* A rhombus is cut by its short diagonal: its sharp corners are the ears. */
    double rhombus[12] = {0, 0, 0, 5, -1, 0, 10, 0, 0, 5, 1, 0};
    assert_int_equal(run(rhombus, 4, NULL, triangles), TRIANGULATION_PLANAR);
    for (uint32_t t = 0; t < 2; t++) {
        bool has_1 = false, has_3 = false;
        for (uint32_t i = 0; i < 3; i++) {
            has_1 |= triangles[3 * t + i] == 1;
            has_3 |= triangles[3 * t + i] == 3;
        }
        assert_true(has_1 && has_3);
    }
    /* Not flat: neither triangle may be turned over, seen along the quadrangle's own normal. */
    uint64_t seed = 9;
    for (int i = 0; i < 2000; i++) {
        double points[12];
        for (int k = 0; k < 12; k++)
            points[k] = random_unit(&seed);
        struct vec3 area = loop_area(points, 4);
        if (run(points, 4, NULL, triangles) == TRIANGULATION_PLANAR)
            assert_tiles(points, 4, triangles, area);
    }
}

static void any_loop_gives_a_disk(void **state)
{
    (void)state;
    uint64_t seed = 4;
    size_t count[4] = {0};
    double *points = malloc(3 * 400 * sizeof *points);
    uint32_t *triangles = malloc(3 * 400 * sizeof *triangles);
    assert_true(points && triangles);
    for (uint32_t round = 0; round < 1500; round++) {
        uint32_t n = 3 + (uint32_t)random_below(&seed, round % 50 == 0 ? 397 : 30);
        uint64_t size = round % 3 == 0 ? 3 : 1u << 20; /* few places: many corners coincide */
        for (uint32_t i = 0; i < 3 * n; i++)
            points[i] = (double)random_below(&seed, size);
        const double normal[3] = {random_unit(&seed) - 0.5, random_unit(&seed) - 0.5,
                                  random_unit(&seed) - 0.5};
        count[run(points, n, round % 2 ? normal : NULL, triangles)]++;
    }
    assert_true(count[TRIANGULATION_PLANAR] > 0 && count[TRIANGULATION_FORCED] > 0);
    assert_int_equal(count[TRIANGULATION_BLOCKED], 0);
    free(triangles);
    free(points);
}

static void hopeless_loops_still_give_a_disk(void **state)
{
    (void)state;
    enum { MOST = 300 };
    static double points[3 * MOST];
    static uint32_t triangles[3 * MOST];
    const double up[3] = {0, 0, 1}, none[3] = {0, 0, 0};
    const double bad[3] = {(double)NAN, 1, (double)INFINITY};
    for (uint32_t n = 3; n < MOST; n += n < 8 ? 1 : 41) {
        memset(points, 0, sizeof points); /* all in one place */
        assert_int_equal(run(points, n, NULL, triangles), TRIANGULATION_FORCED);
        assert_int_equal(run(points, n, up, triangles), TRIANGULATION_FORCED);
        for (uint32_t i = 0; i < n; i++) /* in line */
            points[3 * i] = points[3 * i + 1] = points[3 * i + 2] = i;
        assert_int_equal(run(points, n, NULL, triangles), TRIANGULATION_FORCED);
        assert_int_equal(run(points, n, none, triangles), TRIANGULATION_FORCED);
        for (uint32_t i = 0; i < n; i++) /* upright: in line as seen along the normal only */
            points[3 * i + 1] = 0, points[3 * i + 2] = (double)(i * (n - i));
        assert_int_equal(run(points, n, up, triangles), TRIANGULATION_FORCED);
        assert_true(run(points, n, bad, triangles) >= TRIANGULATION_PLANAR);
        for (uint32_t i = 0; i < 3 * n; i++) /* sizes at which products overflow */
            points[i] = (i * 7 % 5 ? 1e308 : -1e308) / (double)(1 + i % 11);
        (void)run(points, n, NULL, triangles);
    }
    /* A figure of eight has no area of its own. */
    const double eight[12] = {0, 0, 0, 1, 1, 0, 1, 0, 0, 0, 1, 0};
    assert_int_equal(run(eight, 4, NULL, triangles), TRIANGULATION_FORCED);
}

static void bridged_holes_are_tiled(void **state)
{
    (void)state;
    /* A square with a square hole, joined by a bridge that is walked twice. */
    const double keyhole[][2] = {{0, 0}, {9, 0}, {9, 9}, {0, 9}, {0, 0},
                                 {3, 3}, {3, 6}, {6, 6}, {6, 3}, {3, 3}};
    struct shape shape = polygon(10, keyhole);
    uint32_t triangles[3 * 100];
    assert_int_equal(run(shape.positions, 10, NULL, triangles), TRIANGULATION_OVERLAPPING);
    assert_tiles(shape.positions, 10, triangles, (struct vec3){0, 0, 1});
    shape_free(&shape);

    /* Many holes along a strip, more corners than the exhaustive search takes. */
    enum { HOLES = 14 };
    struct shape strip = {0};
    shape_vertex(&strip, 0, 10, 0);
    for (int i = 0; i < HOLES; i++) {
        double x = 10.0 * i + 5;
        shape_vertex(&strip, x, 0, 0);
        shape_vertex(&strip, x, 4, 0);
        shape_vertex(&strip, x - 2, 6, 0);
        shape_vertex(&strip, x + 2, 6, 0);
        shape_vertex(&strip, x, 4, 0);
        shape_vertex(&strip, x, 0, 0);
    }
    shape_vertex(&strip, 10.0 * HOLES, 10, 0);
    uint32_t n = (uint32_t)strip.vertex_count;
    assert_true(n > 2 * TRIANGULATION_EXHAUSTIVE_MAX && 3 * n < 300);
    assert_int_equal(run(strip.positions, n, NULL, triangles), TRIANGULATION_OVERLAPPING);
    assert_tiles(strip.positions, n, triangles, (struct vec3){0, 0, 1});
    shape_free(&strip);
}

/* A square with columns of diamond-shaped holes, each column strung on a bridge that comes up from
 * the lower side: thousands of corners in pairs in one place. */
static void many_bridged_holes_are_tiled(void **state)
{
    (void)state;
    for (uint32_t side = 2; side < 26; side += 6) {
        struct shape shape = {0};
        uint64_t seed = side;
        shape_vertex(&shape, 0, 0, 0);
        for (uint32_t column = 0; column < side; column++) {
            double x = 10.0 * column + 5, holes[32][3]; /* height, half width, half height */
            for (uint32_t row = 0; row < side; row++) {
                holes[row][0] = 10.0 * row + 6;
                holes[row][1] = 1 + 3.5 * random_unit(&seed);
                holes[row][2] = 1 + 3 * random_unit(&seed);
            }
            shape_vertex(&shape, x, 0, 0);
            for (uint32_t row = 0; row < side; row++) { /* up on their left sides */
                shape_vertex(&shape, x, holes[row][0] - holes[row][2], 0);
                shape_vertex(&shape, x - holes[row][1], holes[row][0], 0);
                shape_vertex(&shape, x, holes[row][0] + holes[row][2], 0);
            }
            for (uint32_t row = side; row-- > 0;) { /* down on their right sides */
                if (row + 1 < side)
                    shape_vertex(&shape, x, holes[row][0] + holes[row][2], 0);
                shape_vertex(&shape, x + holes[row][1], holes[row][0], 0);
                shape_vertex(&shape, x, holes[row][0] - holes[row][2], 0);
            }
            shape_vertex(&shape, x, 0, 0);
        }
        shape_vertex(&shape, 10 * side, 0, 0);
        shape_vertex(&shape, 10 * side, 10 * side, 0);
        shape_vertex(&shape, 0, 10 * side, 0);
        uint32_t n = (uint32_t)shape.vertex_count;
        uint32_t *triangles = malloc(3 * n * sizeof *triangles);
        assert_non_null(triangles);
        assert_int_equal(run(shape.positions, n, NULL, triangles), TRIANGULATION_OVERLAPPING);
        assert_tiles(shape.positions, n, triangles, (struct vec3){0, 0, 1});
        free(triangles);
        shape_free(&shape);
    }
}

/* A star-shaped hole in a star, bridged along a ray: at any time, corners in one place with others
 * are among those of the ears that are left. */
static void a_star_in_a_star_is_tiled(void **state)
{
    (void)state;
    for (uint32_t round = 0; round < 600; round++) {
        enum { MOST = 60 };
        uint32_t size = 3 + round % (MOST - 2), n = 2 * size + 2, triangles[3 * (2 * MOST + 2)];
        struct shape shape = shape_star_polygon(size, round);
        struct grid_point points[2 * MOST + 2];
        for (uint32_t i = 0; i < n; i++) {
            uint32_t corner = (i <= size ? i : n - 1 - i) % size;
            double scale = i <= size ? 0x1p29 : 0x1p28 * (0.1 + 0.9 * (round % 7) / 7);
            points[i].x = (int32_t)(0x1p29 + shape.positions[3 * corner] * scale);
            points[i].y = (int32_t)(0x1p29 + shape.positions[3 * corner + 1] * scale);
        }
        shape_free(&shape);
        double corners[3 * (2 * MOST + 2)] = {0};
        for (uint32_t i = 0; i < n; i++) {
            corners[3 * i] = points[i].x;
            corners[3 * i + 1] = points[i].y;
        }
        assert_int_equal(run(corners, n, NULL, triangles), TRIANGULATION_OVERLAPPING);
        assert_tiles(corners, n, triangles, (struct vec3){0, 0, 1});
    }
}

/* Two diamonds and more, each touching the next in one point, which the loop passes twice. Each has
 * two triangles of its own; those that join it to the next can't but have no area. */
static void pinched_chains_are_tiled(void **state)
{
    (void)state;
    for (uint32_t round = 0; round < 40; round++) {
        enum { MOST = 10 };
        struct shape shape = {0};
        uint64_t seed = round;
        uint32_t diamonds = 2 + round % (MOST - 1), triangles[3 * 4 * MOST];
        double way[MOST + 1];
        for (uint32_t i = 0; i <= diamonds; i++) /* through the points */
            way[i] = round % 2 ? 3 * random_unit(&seed) : 0;
        for (uint32_t i = 0; i < diamonds; i++) { /* there on the lower sides */
            shape_vertex(&shape, 2 * i, way[i], 0);
            shape_vertex(&shape, 2 * i + 1, -4 - random_unit(&seed), 0);
        }
        shape_vertex(&shape, 2 * diamonds, way[diamonds], 0);
        for (uint32_t i = diamonds; i-- > 0;) { /* and back on the upper ones */
            shape_vertex(&shape, 2 * i + 1, 8 + random_unit(&seed), 0);
            if (i > 0)
                shape_vertex(&shape, 2 * i, way[i], 0);
        }
        uint32_t n = (uint32_t)shape.vertex_count;
        assert_int_equal(run(shape.positions, n, NULL, triangles), TRIANGULATION_FORCED);
        assert_tiles(shape.positions, n, triangles, (struct vec3){0, 0, 1});
        shape_free(&shape);
    }
}

/* The border of a ramp that winds twice round: seen from above it crosses nothing but covers
 * everything twice. No triangle may be turned over, whatever the number of corners. */
static void ramps_keep_their_sheets_apart(void **state)
{
    (void)state;
    const double up[3] = {0, 0, 1};
    for (uint32_t round = 0; round < 40; round++) {
        uint32_t cells = 8 + 10 * round, n = 2 * (2 * cells + 1);
        uint64_t seed = round;
        double *points = malloc(3 * n * sizeof *points);
        uint32_t *triangles = malloc(3 * n * sizeof *triangles);
        assert_true(points && triangles);
        for (uint32_t i = 0; i < n; i++) {
            bool is_outer = i < n / 2;
            uint32_t at = is_outer ? i : n - 1 - i;
            double angle = 6.283185307179586 * at / cells + 0.1, radius = is_outer ? 2 : 1;
            if (round % 2) /* jagged on both sides */
                radius += 0.8 * (random_unit(&seed) - 0.5);
            vec3_store(points + 3 * i,
                       (struct vec3){radius * cos(angle), radius * sin(angle), 8.0 * at / cells});
        }
        assert_int_equal(run(points, n, up, triangles), TRIANGULATION_OVERLAPPING);
        assert_tiles(points, n, triangles, (struct vec3){0, 0, 1});
        free(triangles);
        free(points);
    }
}

/* ---- forbidden diagonals ---- */

struct ban {
    uint32_t n;
    bool is_banned[16][16];
    size_t questions;
};

static bool is_allowed(void *user, uint32_t i, uint32_t j)
{
    struct ban *ban = user;
    uint32_t apart = i < j ? j - i : i - j;
    ban->questions++;
    assert_true(apart > 1 && apart < ban->n - 1); /* edges of the loop are not asked for */
    return !ban->is_banned[i][j];
}

/* Is there any triangulation of the corners from i to j? */
static bool exists(const struct ban *ban, uint32_t i, uint32_t j)
{
    if (j == i + 1)
        return true;
    bool is_edge = i == 0 && j == ban->n - 1;
    if (!is_edge && ban->is_banned[i][j])
        return false;
    for (uint32_t k = i + 1; k < j; k++)
        if (exists(ban, i, k) && exists(ban, k, j))
            return true;
    return false;
}

static void forbidden_diagonals_are_not_used(void **state)
{
    (void)state;
    uint64_t seed = 6;
    size_t blocked = 0, planar = 0;
    for (uint32_t round = 0; round < 3000; round++) {
        struct ban ban = {.n = 4 + (uint32_t)random_below(&seed, 8)};
        struct shape shape = shape_star_polygon(ban.n, round);
        for (uint32_t i = 0; i < ban.n; i++)
            for (uint32_t j = 0; j < i; j++)
                ban.is_banned[i][j] = ban.is_banned[j][i] = random_below(&seed, 10) < 1 + round % 7;
        uint32_t triangles[3 * 16];
        enum triangulation_quality quality;
        assert_int_equal(triangulate(&ctx, &workspace, shape.positions, ban.n, NULL, is_allowed,
                                     &ban, triangles, &quality),
                         STATUS_OK);
        assert_int_equal(quality == TRIANGULATION_BLOCKED, !exists(&ban, 0, ban.n - 1));
        if (quality != TRIANGULATION_BLOCKED) {
            assert_is_disk(triangles, ban.n);
            for (uint32_t i = 0; i < 3 * (ban.n - 2); i++) {
                uint32_t a = triangles[i], b = triangles[i - i % 3 + (i + 1) % 3];
                uint32_t apart = a < b ? b - a : a - b;
                assert_true(apart == 1 || apart == ban.n - 1 || !ban.is_banned[a][b]);
            }
        }
        if (quality == TRIANGULATION_PLANAR)
            assert_tiles(shape.positions, ban.n, triangles, (struct vec3){0, 0, 1});
        blocked += quality == TRIANGULATION_BLOCKED;
        planar += quality == TRIANGULATION_PLANAR;
        shape_free(&shape);
    }
    assert_true(blocked > 300 && planar > 300);
}

/* Loops of few corners have a way of their own to the same ears: as far as there are proper ones,
 * the general one cuts the very same triangles. */
static void few_corners_are_cut_like_many(void **state)
{
    (void)state;
    uint64_t seed = 11;
    size_t whole = 0, stopped = 0;
    for (uint32_t round = 0; round < 2000; round++) {
        struct ban ban = {.n = 5 + (uint32_t)random_below(&seed, 12)};
        for (uint32_t i = 0; i < ban.n; i++)
            for (uint32_t j = 0; j < i; j++)
                ban.is_banned[i][j] = ban.is_banned[j][i] = random_below(&seed, 12) < round % 4;
        struct grid_point points[16];
        const double heights[16] = {0};
        uint32_t few[3 * 16], many[3 * 16];
        make_winding(points, ban.n, &seed);
        struct ear_input input = {.points = points,
                                  .heights = heights,
                                  .n = ban.n,
                                  .is_simple = true,
                                  .diagonal_allowed = is_allowed,
                                  .user = &ban,
                                  .give_back_max = EAR_FEW_MAX};
        struct ear_result result, other;
        assert_int_equal(cut_ears(&ctx, &workspace.clipping, &input, few, &result), STATUS_OK);
        assert_int_equal(result.cut + (result.rest_count ? result.rest_count : 2), ban.n);
        for (uint32_t i = 0; i < result.rest_count; i++) /* in the order of the loop */
            assert_true(i == 0 || result.rest[i] > result.rest[i - 1]);
        whole += result.rest_count == 0;
        stopped += result.rest_count > 0;
        input.give_back_max = 0;
        assert_int_equal(cut_ears(&ctx, &workspace.clipping, &input, many, &other), STATUS_OK);
        assert_true(other.cut >= result.cut);
        assert_memory_equal(few, many, 3 * result.cut * sizeof *few);
    }
    assert_true(whole > 300 && stopped > 100);
}

static bool allow_nothing(void *user, uint32_t i, uint32_t j)
{
    (void)i;
    (void)j;
    ++*(size_t *)user;
    return false;
}

static bool allow_fan(void *user, uint32_t i, uint32_t j)
{
    (void)user;
    return i == 0 || j == 0;
}

static void large_loops_can_be_blocked_too(void **state)
{
    (void)state;
    struct shape shape = shape_star_polygon(500, 3);
    uint32_t triangles[3 * 500];
    enum triangulation_quality quality;
    size_t questions = 0;
    assert_int_equal(triangulate(&ctx, &workspace, shape.positions, 500, NULL, allow_nothing,
                                 &questions, triangles, &quality),
                     STATUS_OK);
    assert_int_equal(quality, TRIANGULATION_BLOCKED);
    assert_true(questions > 0 && questions < 2000);
    assert_int_equal(triangulate(&ctx, &workspace, shape.positions, 40, NULL, allow_fan, NULL,
                                 triangles, &quality),
                     STATUS_OK);
    assert_true(quality != TRIANGULATION_BLOCKED);
    assert_is_disk(triangles, 40);
    shape_free(&shape);
}

/* ---- size ---- */

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Every shape that makes one or the other method quadratic. A quadratic one takes minutes. */
static void large_loops_are_quick(void **state)
{
    (void)state;
    enum { MANY = 65532 };
    const double limit = 10; /* with sanitizers, on a busy machine; 0.3 without */
    double *points = malloc(3 * MANY * sizeof *points);
    uint32_t *triangles = malloc(3 * (size_t)MANY * sizeof *triangles);
    assert_true(points && triangles);

    for (int kind = 0; kind < 3; kind++) {
        struct shape shape = kind == 0   ? shape_star_polygon(MANY, 8)
                             : kind == 1 ? shape_comb(MANY / 4)
                                         : shape_comb(MANY / 4);
        uint32_t n = (uint32_t)shape.vertex_count;
        for (uint32_t i = 0; i < n; i++) {
            double x = shape.positions[3 * i], y = shape.positions[3 * i + 1];
            if (kind == 1) /* long slanting teeth */
                y *= 3000, x += y * 0.41;
            if (kind == 2) /* long, in a ring, all corners crowded at two places */
                y *= 300, x *= 1e-2;
            vec3_store(points + 3 * i, (struct vec3){x, y, 0});
        }
        shape_free(&shape);
        double start = seconds();
        assert_int_equal(run(points, n, NULL, triangles), TRIANGULATION_PLANAR);
        double taken = seconds() - start;
        print_message("%u corners, kind %d: %.3f s\n", n, kind, taken);
        assert_true(taken < limit);
        assert_tiles(points, n, triangles, (struct vec3){0, 0, 1});
    }

    for (uint32_t i = 0; i < MANY; i++) /* a scribble that crosses itself everywhere */
        vec3_store(points + 3 * i,
                   (struct vec3){cos(2.399963 * i) * i, sin(2.399963 * i) * i, 0.001 * i});
    double start = seconds();
    (void)run(points, MANY, NULL, triangles);
    print_message("%u corners, scribble: %.3f s\n", (unsigned)MANY, seconds() - start);
    assert_true(seconds() - start < limit);
    free(triangles);
    free(points);
}

static void a_used_workspace_allocates_nothing(void **state)
{
    (void)state;
    uint32_t triangles[3 * 12];
    struct shape shape = shape_star_polygon(12, 3);
    (void)run(shape.positions, 12, NULL, triangles);
    uint64_t used = ctx.memory_now;
    atomic_store(&ctx.fault_after, 0); /* any allocation would fail */
    for (uint32_t n = 3; n <= 12; n++) {
        enum triangulation_quality quality;
        assert_int_equal(triangulate(&ctx, &workspace, shape.positions, n, NULL, NULL, NULL,
                                     triangles, &quality),
                         STATUS_OK);
    }
    assert_int_equal(ctx.memory_now, used);
    atomic_store(&ctx.fault_after, UINT64_MAX);
    shape_free(&shape);
}

static void failing_memory_is_reported(void **state)
{
    (void)state;
    struct shape shape = shape_comb(50); /* which is no star, so that the sweep takes memory, too */
    uint32_t triangles[3 * 200];
    assert_int_equal(shape.vertex_count, 200);
    for (uint64_t after = 0;; after++) {
        struct context failing;
        struct triangulation_workspace fresh = {0};
        enum triangulation_quality quality;
        context_init(&failing);
        atomic_store(&failing.fault_after, after);
        enum status status = triangulate(&failing, &fresh, shape.positions, 200, NULL, NULL, NULL,
                                         triangles, &quality);
        triangulation_workspace_clear(&failing, &fresh);
        assert_int_equal(failing.memory_now, 0);
        context_clear(&failing);
        if (status == STATUS_OK) {
            assert_true(after >= 3);
            break;
        }
        assert_int_equal(status, STATUS_NO_MEMORY);
    }
    shape_free(&shape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(simple_loops_are_tiled),
        cmocka_unit_test(collinear_corners_cause_no_flat_triangles),
        cmocka_unit_test(ears_are_cut_by_increasing_angle),
        cmocka_unit_test(spirals_are_tiled),
        cmocka_unit_test(quadrangles_get_the_right_diagonal),
        cmocka_unit_test(any_loop_gives_a_disk),
        cmocka_unit_test(hopeless_loops_still_give_a_disk),
        cmocka_unit_test(bridged_holes_are_tiled),
        cmocka_unit_test(many_bridged_holes_are_tiled),
        cmocka_unit_test(a_star_in_a_star_is_tiled),
        cmocka_unit_test(pinched_chains_are_tiled),
        cmocka_unit_test(ramps_keep_their_sheets_apart),
        cmocka_unit_test(forbidden_diagonals_are_not_used),
        cmocka_unit_test(few_corners_are_cut_like_many),
        cmocka_unit_test(large_loops_can_be_blocked_too),
        cmocka_unit_test(large_loops_are_quick),
        cmocka_unit_test(a_used_workspace_allocates_nothing),
        cmocka_unit_test(failing_memory_is_reported),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
