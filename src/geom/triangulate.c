/*
 * A triangulation of any loop.
 *
 * Fans are wrong for concave polygons; cutting ears in floating point folds or never ends. Here the
 * loop is projected to its plane and rounded to a grid of 2^30 steps, where all tests are exact:
 *
 *   1. Triangles and quadrangles are decided at once.
 *   2. Others are tested for being simple (part_twins.c makes those simple that only bridges keep
 *      from it) and go to ear_clip.c, which cuts ears by increasing angle and always succeeds on a
 *      simple loop when no diagonal is forbidden.
 *   3. When it runs out of proper ears and the loop (or the rest of a large one) is small, all its
 *      triangulations are weighed by dynamic programming: fewest triangles turned over, then
 *      fewest without area, then least area in space. This finds a triangulation whenever there is
 * one.
 *
 * A sum of triangles that all have positive area on the grid, each lying on the other side of its
 * diagonals, tiles a simple loop exactly; so counting bad triangles is all the proof needed.
 */
#include "geom/triangulate.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "geom/ear_clip.h"
#include "geom/part_twins.h"
#include "geom/vec.h"

enum { TABLE_SIDE = TRIANGULATION_EXHAUSTIVE_MAX };

/* The loop moved to the origin and scaled to unit size, so that nothing overflows or cancels. */
struct frame {
    struct vec3 origin;
    double scale; /* 0 when the loop has no extent, or one that is not finite */
};

struct loop {
    const double *corners; /* 3 each, as given */
    uint32_t n;
    struct grid_point *points;
    struct grid_point *parted; /* room for a copy of them */
    double *heights;           /* not filled in before they are needed */
    double *along;             /* two axes of the plane, before rounding */
    struct vec3 up;            /* the plane's normal, */
    double steps;              /* and the grid's steps a unit */
    struct frame frame;
    bool is_against_normal; /* the given normal could not be used */
    bool (*diagonal_allowed)(void *user, uint32_t i, uint32_t j);
    void *user;
};

void triangulation_workspace_clear(struct context *ctx, struct triangulation_workspace *ws)
{
    scratch_clear(ctx, &ws->loop);
    scratch_clear(ctx, &ws->clipping);
    scratch_clear(ctx, &ws->sweep);
    scratch_clear(ctx, &ws->table);
}

/* ---- projection ---- */

static struct vec3 framed(const struct loop *loop, const struct frame *frame, uint32_t i)
{
    struct vec3 corner = vec3_load(loop->corners + 3 * (size_t)i);
    return vec3_scale(vec3_sub(corner, frame->origin), frame->scale);
}

static struct frame frame_of(const struct loop *loop)
{
    struct frame frame = {vec3_load(loop->corners), 1};
    double extent = 0;
    for (uint32_t i = 1; i < loop->n; i++) {
        struct vec3 d = framed(loop, &frame, i);
        double x = fabs(d.x), y = fabs(d.y), z = fabs(d.z);
        extent = x > extent ? x : extent;
        extent = y > extent ? y : extent;
        extent = z > extent ? z : extent;
    }
    double scale = 1 / extent;
    frame.scale = isfinite(extent) && isfinite(scale) ? scale : 0;
    return frame;
}

/* Newell's normal: the sum of the cross products round the loop, twice the projected area. */
static struct vec3 newell_normal(const struct loop *loop, const struct frame *frame)
{
    struct vec3 sum = {0, 0, 0}, last = framed(loop, frame, loop->n - 1);
    for (uint32_t i = 0; i < loop->n; i++) {
        struct vec3 corner = framed(loop, frame, i);
        sum = vec3_add(sum, vec3_cross(last, corner));
        last = corner;
    }
    return sum;
}

/* Of a loop whose areas cancel: the plane of its first corner, the one farthest from it, and the
 * one farthest from the line of both. Zero when all are in line. */
static struct vec3 spanning_normal(const struct loop *loop, const struct frame *frame)
{
    struct vec3 along = {0, 0, 0}, best = {0, 0, 0};
    for (uint32_t i = 1; i < loop->n; i++) {
        struct vec3 corner = framed(loop, frame, i);
        if (vec3_length_squared(corner) > vec3_length_squared(along))
            along = corner;
    }
    for (uint32_t i = 1; i < loop->n; i++) {
        struct vec3 normal = vec3_cross(along, framed(loop, frame, i));
        if (vec3_length_squared(normal) > vec3_length_squared(best))
            best = normal;
    }
    return best;
}

/* Two unit vectors that make a right-handed frame with the unit vector w. */
static void plane_axes(struct vec3 w, struct vec3 *u, struct vec3 *v)
{
    double x = fabs(w.x), y = fabs(w.y), z = fabs(w.z);
    struct vec3 axis = {x <= y && x <= z, y < x && y <= z, z < x && z < y};
    *u = vec3_normalized(vec3_cross(axis, w));
    *v = vec3_cross(w, *u);
}

/* Along both axes. */
typedef double pair __attribute__((vector_size(16)));

/* Up to GRID_SIZE but for rounding, which the half that is added outweighs. */
static int32_t to_grid(double value)
{
    return value > 0 ? (int32_t)(value + 0.5) : 0; /* 0 when it is not a number, too */
}

/* Places the corners on the plane; *low: the least along each axis. Returns the larger extent. */
static double place_corners(struct loop *loop, pair *low)
{
    struct vec3 u, v;
    plane_axes(loop->up, &u, &v);
    const pair x = {u.x, v.x}, y = {u.y, v.y}, z = {u.z, v.z};
    double low_u = 0, low_v = 0, high_u = 0, high_v = 0; /* the first corner is at 0, 0 */
    for (uint32_t i = 0; i < loop->n; i++) {
        const struct vec3 corner = framed(loop, &loop->frame, i);
        const pair along = (pair){corner.x, corner.x} * x + (pair){corner.y, corner.y} * y +
                           (pair){corner.z, corner.z} * z;
        memcpy(loop->along + 2 * (size_t)i, &along, sizeof along);
        low_u = along[0] < low_u ? along[0] : low_u;
        high_u = along[0] > high_u ? along[0] : high_u;
        low_v = along[1] < low_v ? along[1] : low_v;
        high_v = along[1] > high_v ? along[1] : high_v;
    }
    *low = (pair){low_u, low_v};
    return high_u - low_u > high_v - low_v ? high_u - low_u : high_v - low_v;
}

/* Fills the points; returns whether the loop encloses a positive area on the grid. */
static bool project(struct loop *loop, struct vec3 normal)
{
    double largest = fmax(fabs(normal.x), fmax(fabs(normal.y), fabs(normal.z)));
    loop->up = (struct vec3){0, 0, 1};
    if (largest > 0 && isfinite(largest))
        loop->up = vec3_normalized(
            (struct vec3){normal.x / largest, normal.y / largest, normal.z / largest});
    pair low;
    const double extent = place_corners(loop, &low);
    /* a loop without extent stays in one place */
    loop->steps = extent > 1e-290 ? GRID_SIZE / extent : 0;
    __int128 area = 0;
    struct grid_point last = {0, 0};
    for (uint32_t i = 0; i < loop->n; i++) {
        pair along;
        memcpy(&along, loop->along + 2 * (size_t)i, sizeof along);
        along = (along - low) * (pair){loop->steps, loop->steps};
        const struct grid_point p = {to_grid(along[0]), to_grid(along[1])};
        loop->points[i] = p;
        if (i > 0)
            area += (int64_t)last.x * p.y - (int64_t)last.y * p.x;
        last = p;
    }
    struct grid_point first = loop->points[0];
    area += (int64_t)last.x * first.y - (int64_t)last.y * first.x;
    return area > 0;
}

/* Heights over the plane, which only loops that are not simple are asked for. */
static void fill_heights(const struct loop *loop)
{
    for (uint32_t i = 0; i < loop->n; i++)
        loop->heights[i] = vec3_dot(framed(loop, &loop->frame, i), loop->up) * loop->steps;
}

/* Chooses the plane and projects: the given normal, else Newell's, else any that spans the loop. */
static void project_best(struct loop *loop, const double normal[3])
{
    loop->frame = frame_of(loop);
    loop->is_against_normal = false;
    if (normal && project(loop, vec3_load(normal)))
        return;
    loop->is_against_normal = normal != NULL;
    if (!project(loop, newell_normal(loop, &loop->frame)))
        (void)project(loop, spanning_normal(loop, &loop->frame));
}

/* ---- quadrangles ---- */

static bool quad_diagonal_is_good(const struct loop *loop, uint32_t from)
{
    const struct grid_point *p = loop->points;
    uint32_t to = from + 2, other = (from + 3) & 3;
    return orientation(p[from], p[from + 1], p[to]) > 0 &&
           orientation(p[to], p[other], p[from]) > 0 &&
           (!loop->diagonal_allowed || loop->diagonal_allowed(loop->user, from, to));
}

/* Larger for smaller angles. */
static double quad_cosine(const struct loop *loop, uint32_t i)
{
    struct grid_point b = loop->points[i], a = loop->points[(i + 3) & 3],
                      c = loop->points[(i + 1) & 3];
    double ax = a.x - b.x, ay = a.y - b.y, cx = c.x - b.x, cy = c.y - b.y;
    return (ax * cx + ay * cy) / sqrt((ax * ax + ay * ay) * (cx * cx + cy * cy));
}

/* False when neither diagonal gives two good triangles. With a choice, the corner of the smallest
 * angle is cut off. */
static bool cut_quad(const struct loop *loop, uint32_t *triangles)
{
    bool from_0 = quad_diagonal_is_good(loop, 0), from_1 = quad_diagonal_is_good(loop, 1);
    if (!from_0 && !from_1)
        return false;
    if (from_0 && from_1) {
        double at_0 = quad_cosine(loop, 0), at_1 = quad_cosine(loop, 1);
        double at_2 = quad_cosine(loop, 2), at_3 = quad_cosine(loop, 3);
        from_1 = fmax(at_0, at_2) >= fmax(at_1, at_3);
    }
    static const uint32_t halves[2][6] = {{0, 1, 2, 2, 3, 0}, {1, 2, 3, 3, 0, 1}};
    memcpy(triangles, halves[from_1], sizeof halves[0]);
    return true;
}

/* ---- all triangulations of a small loop ---- */

struct cost {
    uint32_t bad; /* TURNED for a triangle turned over, 1 for one without area; DEAR: impossible */
    uint32_t split;
    double area; /* twice the area in space */
};

enum { TURNED = 2 * TABLE_SIDE /* more than all without area */, DEAR = 1 << 20 };

static void add_triangle(const struct loop *loop, uint32_t a, uint32_t b, uint32_t c,
                         struct cost *cost)
{
    int64_t turn = orientation(loop->points[a], loop->points[b], loop->points[c]);
    cost->bad += turn > 0 ? 0 : turn == 0 ? 1 : TURNED;
    struct vec3 normal = triangle_normal(vec3_load(loop->corners + 3 * (size_t)a),
                                         vec3_load(loop->corners + 3 * (size_t)b),
                                         vec3_load(loop->corners + 3 * (size_t)c));
    cost->area += vec3_length(normal);
}

static bool is_cheaper(const struct cost *a, const struct cost *b)
{
    return a->bad != b->bad ? a->bad < b->bad : a->area < b->area;
}

/* The best triangulation of the part of the ring from i to j, closed by a diagonal or an edge. */
static void weigh_part(const struct loop *loop, const uint32_t *ring, uint32_t count,
                       struct cost (*table)[TABLE_SIDE], uint32_t i, uint32_t j)
{
    struct cost best = {.bad = DEAR};
    bool is_diagonal = i + 1 < j && !(i == 0 && j + 1 == count);
    if (!is_diagonal || !loop->diagonal_allowed ||
        loop->diagonal_allowed(loop->user, ring[i], ring[j]))
        for (uint32_t k = i + 1; k < j; k++) {
            struct cost cost = {.bad = table[i][k].bad + table[k][j].bad,
                                .split = k,
                                .area = table[i][k].area + table[k][j].area};
            if (cost.bad >= DEAR)
                continue;
            add_triangle(loop, ring[i], ring[k], ring[j], &cost);
            if (is_cheaper(&cost, &best))
                best = cost;
        }
    table[i][j] = best;
}

/* Writes the triangles of the best triangulation of the ring; *found is false when there is none.
 */
static enum status weigh_all(struct context *ctx, struct scratch *scratch, const struct loop *loop,
                             const uint32_t *ring, uint32_t count, uint32_t *triangles, bool *found)
{
    struct cost(*table)[TABLE_SIDE];
    enum status status = scratch_reserve(ctx, scratch, TABLE_SIDE * sizeof *table);
    if (status != STATUS_OK)
        return status;
    table = (struct cost(*)[TABLE_SIDE])(void *)scratch->block;
    for (uint32_t i = 0; i + 1 < count; i++)
        table[i][i + 1] = (struct cost){0};
    for (uint32_t width = 2; width < count; width++)
        for (uint32_t i = 0; i + width < count; i++)
            weigh_part(loop, ring, count, table, i, i + width);
    *found = table[0][count - 1].bad < DEAR;
    if (!*found)
        return STATUS_OK;

    struct {
        uint32_t i, j;
    } stack[TABLE_SIDE];
    unsigned depth = 1;
    stack[0].i = 0;
    stack[0].j = count - 1;
    while (depth > 0) {
        uint32_t i = stack[--depth].i, j = stack[depth].j;
        if (j == i + 1)
            continue;
        uint32_t k = table[i][j].split;
        /* What is left is a ring, too. NOLINTNEXTLINE(clang-analyzer-core.uninitialized.Assign) */
        *triangles++ = ring[i];
        *triangles++ = ring[k];
        *triangles++ = ring[j];
        stack[depth].i = k;
        stack[depth++].j = j;
        stack[depth].i = i;
        stack[depth++].j = k;
    }
    return STATUS_OK;
}

/* ---- the whole ---- */

/* Chooses the points by which ears are cut, and says whether they make a simple loop. */
static enum status choose_points(struct context *ctx, struct triangulation_workspace *ws,
                                 const struct loop *loop, struct ear_input *input, bool *is_simple)
{
    enum status status = loop_is_simple(ctx, &ws->sweep, loop->points, loop->n, is_simple);
    input->points = loop->points;
    input->is_simple = *is_simple;
    if (status != STATUS_OK || *is_simple)
        return status;
    bool has_twins;
    status = part_twins(ctx, &ws->sweep, loop->points, loop->n, loop->parted, &has_twins);
    if (status == STATUS_OK && has_twins)
        status = loop_is_simple(ctx, &ws->sweep, loop->parted, loop->n, &input->is_simple);
    if (status == STATUS_OK && input->is_simple)
        input->points = loop->parted;
    else
        fill_heights(loop);
    return status;
}

static bool all_have_area(const struct loop *loop, const uint32_t *triangles)
{
    for (size_t i = 0; i < 3 * ((size_t)loop->n - 2); i += 3)
        if (orientation(loop->points[triangles[i]], loop->points[triangles[i + 1]],
                        loop->points[triangles[i + 2]]) <= 0)
            return false;
    return true;
}

/* The rest that the ears left, or, if the loop is small, all of it anew: what was cut may have been
 * the wrong thing to cut. *found is false if there is no triangulation of it. */
static enum status weigh_rest(struct context *ctx, struct triangulation_workspace *ws,
                              const struct loop *loop, const struct ear_result *result,
                              uint32_t *triangles, bool *found)
{
    uint32_t ring[TABLE_SIDE], count = loop->n, done = 0;
    for (uint32_t i = 0; i < count && count <= TABLE_SIDE; i++)
        ring[i] = i;
    if (count > TABLE_SIDE) {
        count = result->rest_count;
        done = result->cut;
        memcpy(ring, result->rest, count * sizeof *ring);
    }
    return weigh_all(ctx, &ws->table, loop, ring, count, triangles + 3 * (size_t)done, found);
}

static enum status clip(struct context *ctx, struct triangulation_workspace *ws,
                        const struct loop *loop, uint32_t *triangles,
                        enum triangulation_quality *quality)
{
    struct ear_input input = {.heights = loop->heights,
                              .n = loop->n,
                              .diagonal_allowed = loop->diagonal_allowed,
                              .user = loop->user,
                              .give_back_max = TRIANGULATION_EXHAUSTIVE_MAX};
    bool is_simple;
    enum status status = choose_points(ctx, ws, loop, &input, &is_simple);
    struct ear_result result;
    if (status == STATUS_OK)
        status = cut_ears(ctx, &ws->clipping, &input, triangles, &result);
    if (status != STATUS_OK)
        return status;

    bool found = !result.is_stuck;
    bool is_good = found && result.rest_count == 0 && all_have_area(loop, triangles);
    if (result.rest_count > 0 || (found && !is_good && loop->n <= TRIANGULATION_EXHAUSTIVE_MAX)) {
        status = weigh_rest(ctx, ws, loop, &result, triangles, &found);
        is_good = status == STATUS_OK && found && all_have_area(loop, triangles);
    }
    *quality = !found      ? TRIANGULATION_BLOCKED
               : !is_good  ? TRIANGULATION_FORCED
               : is_simple ? TRIANGULATION_PLANAR
                           : TRIANGULATION_OVERLAPPING;
    return status;
}

static void keep_triangle(const double *points, const double *normal, uint32_t *triangles,
                          enum triangulation_quality *quality)
{
    for (uint32_t i = 0; i < 3; i++)
        triangles[i] = i;
    struct vec3 own =
        triangle_normal(vec3_load(points), vec3_load(points + 3), vec3_load(points + 6));
    bool is_good = normal ? vec3_dot(own, vec3_load(normal)) > 0 : vec3_length_squared(own) > 0;
    *quality = is_good ? TRIANGULATION_PLANAR : TRIANGULATION_FORCED;
}

/* Room for the projection of a loop in the workspace. */
static enum status place_loop(struct context *ctx, struct scratch *scratch, struct loop *loop)
{
    enum status status = scratch_reserve(
        ctx, scratch, loop->n * (3 * sizeof(double) + 2 * sizeof(struct grid_point)));
    if (status != STATUS_OK)
        return status;
    loop->heights = (double *)(void *)scratch->block;
    loop->along = loop->heights + loop->n;
    loop->points = (struct grid_point *)(void *)(loop->along + 2 * (size_t)loop->n);
    loop->parted = loop->points + loop->n;
    return STATUS_OK;
}

enum status triangulate(struct context *ctx, struct triangulation_workspace *ws,
                        const double *points, uint32_t n, const double normal[3],
                        bool (*diagonal_allowed)(void *user, uint32_t i, uint32_t j), void *user,
                        uint32_t *triangles, enum triangulation_quality *quality)
{
    if (n == 3) {
        keep_triangle(points, normal, triangles, quality);
        return STATUS_OK;
    }
    struct loop loop = {
        .corners = points, .n = n, .diagonal_allowed = diagonal_allowed, .user = user};
    enum status status = place_loop(ctx, &ws->loop, &loop);
    if (status != STATUS_OK)
        return status;
    project_best(&loop, normal);
    *quality = TRIANGULATION_PLANAR;
    if (n != 4 || !cut_quad(&loop, triangles))
        status = clip(ctx, ws, &loop, triangles, quality);
    if (loop.is_against_normal && *quality < TRIANGULATION_FORCED)
        *quality = TRIANGULATION_FORCED;
    return status;
}
