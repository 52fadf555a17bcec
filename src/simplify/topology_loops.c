/*
 * Loops and their sizes.
 *
 * The exact diameter of n points by looking at all pairs is quadratic, by a convex hull in space a
 * program of its own. Sorted by distance from the middle of their box, outermost first, a pair can
 * only be farther apart than the best one found if its two distances from the middle together are;
 * for loops met in practice a few pairs a point are looked at.
 */
#include "simplify/topology_loops.h"

#include <string.h>
#include <stdlib.h>

#include "base/memory.h"

struct distant {
    double distance; /* from the middle */
    uint32_t index;
};

void loop_points_clear(struct context *ctx, struct loop_points *points)
{
    memory_release(ctx, &points->points, points->point_capacity, sizeof *points->points);
    memory_release(ctx, &points->half_edges, points->half_edge_capacity,
                   sizeof *points->half_edges);
    memory_release(ctx, &points->order, points->order_capacity, sizeof *points->order);
    memset(points, 0, sizeof *points);
}

/* ---- walking ---- */

static enum status add_point(struct context *ctx, struct loop_points *points, uint32_t h,
                             struct vec3 at)
{
    size_t n = points->count;
    enum status status = memory_reserve(ctx, &points->points, &points->point_capacity, 3 * (n + 1),
                                        sizeof *points->points);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &points->half_edges, &points->half_edge_capacity, n + 1,
                                sizeof *points->half_edges);
    if (status != STATUS_OK)
        return status;
    vec3_store(points->points + 3 * n, at);
    points->half_edges[n] = h;
    points->count++;
    return STATUS_OK;
}

static void widen(struct surface_loop *loop, struct vec3 at)
{
    const double p[3] = {at.x, at.y, at.z};
    for (unsigned c = 0; c < 3; c++) {
        loop->low[c] = p[c] < loop->low[c] ? p[c] : loop->low[c];
        loop->high[c] = p[c] > loop->high[c] ? p[c] : loop->high[c];
    }
}

/* What an edge adds to the sums of a loop whose normal is known. */
static void weigh_edge(const struct chain_graph *graph, struct surface_loop *loop, uint32_t h)
{
    uint32_t left = graph->half_edges[h].patch, right = graph->half_edges[h ^ 1].patch;
    struct vec3 along = vec3_sub(vertex_point(graph, half_edge_end(graph, h)),
                                 vertex_point(graph, graph->half_edges[h].origin));
    double length = vec3_length(along);
    loop->length += length;
    if (left != NO_PATCH)
        loop->flat_left += length * vec3_dot(patch_normal(graph, left), loop->normal);
    if (right != NO_PATCH)
        loop->flat_right += length * vec3_dot(patch_normal(graph, right), loop->normal);
    if (left != NO_PATCH && right != NO_PATCH)
        loop->convexity +=
            vec3_dot(vec3_cross(patch_normal(graph, left), patch_normal(graph, right)), along);
}

enum status loop_trace(const struct chain_graph *graph, const uint32_t *classes, uint32_t first,
                       struct loop_points *points, struct surface_loop *loop)
{
    struct vec3 start = vertex_point(graph, graph->half_edges[first].origin), sum = {0, 0, 0};
    *loop = (struct surface_loop){.first = first,
                                  .low = {INFINITY, INFINITY, INFINITY},
                                  .high = {-INFINITY, -INFINITY, -INFINITY}};
    if (points)
        points->count = 0;
    uint32_t h = first;
    do {
        struct vec3 a = vertex_point(graph, graph->half_edges[h].origin);
        struct vec3 b = vertex_point(graph, half_edge_end(graph, h));
        if (points) {
            enum status status = add_point(graph->ctx, points, h, a);
            if (status != STATUS_OK)
                return status;
        }
        widen(loop, a);
        sum = vec3_add(sum, vec3_sub(a, start));
        loop->normal = vec3_add(loop->normal, triangle_normal(start, a, b));
        loop->count++;
        h = loop_next(graph, classes, h);
    } while (h != first);
    loop->centre = vec3_add_scaled(start, 1 / (double)loop->count, sum);
    loop->normal = vec3_normalized(loop->normal);
    do {
        weigh_edge(graph, loop, h);
        h = loop_next(graph, classes, h);
    } while (h != first);
    if (loop->length > 0) {
        loop->flat_left /= loop->length;
        loop->flat_right /= loop->length;
        loop->convexity /= loop->length;
    }
    return STATUS_OK;
}

/* ---- size ---- */

static int compare_distant(const void *a, const void *b)
{
    const struct distant *x = a, *y = b;
    if (x->distance != y->distance)
        return x->distance > y->distance ? -1 : 1;
    return x->index < y->index ? -1 : x->index > y->index;
}

static double box_diagonal(const double *points, size_t count, struct vec3 *middle)
{
    struct vec3 low = vec3_load(points), high = low;
    for (size_t i = 1; i < count; i++) {
        struct vec3 p = vec3_load(points + 3 * i);
        low = vec3_make(p.x < low.x ? p.x : low.x, p.y < low.y ? p.y : low.y,
                        p.z < low.z ? p.z : low.z);
        high = vec3_make(p.x > high.x ? p.x : high.x, p.y > high.y ? p.y : high.y,
                         p.z > high.z ? p.z : high.z);
    }
    *middle = vec3_scale(vec3_add(low, high), 0.5);
    return vec3_distance(low, high);
}

enum status points_diameter(struct context *ctx, struct loop_points *scratch, const double *points,
                            size_t count, double enough, double *diameter)
{
    *diameter = 0;
    if (count == 0)
        return STATUS_OK;
    enum status status = memory_reserve(ctx, &scratch->order, &scratch->order_capacity, count,
                                        sizeof *scratch->order);
    if (status != STATUS_OK)
        return status;
    struct vec3 middle;
    struct distant *order = scratch->order;
    (void)box_diagonal(points, count, &middle);
    for (size_t i = 0; i < count; i++)
        order[i] = (struct distant){vec3_distance(middle, vec3_load(points + 3 * i)), (uint32_t)i};
    qsort(order, count, sizeof *order, compare_distant);
    double best = 0;
    for (size_t i = 1; i < count && best <= enough; i++) {
        struct vec3 p = vec3_load(points + 3 * (size_t)order[i].index);
        if (order[i].distance + order[0].distance <= best)
            break;
        for (size_t j = 0; j < i && order[i].distance + order[j].distance > best; j++) {
            double far = vec3_distance(p, vec3_load(points + 3 * (size_t)order[j].index));
            best = far > best ? far : best;
        }
    }
    *diameter = best;
    return STATUS_OK;
}

/* Does the loop turn to one side only, as seen along its normal? */
static bool loop_is_convex(const struct loop_points *points, struct vec3 normal)
{
    uint32_t n = points->count;
    for (uint32_t i = 0; i < n; i++) {
        struct vec3 a = vec3_load(points->points + 3 * (size_t)i);
        struct vec3 b = vec3_load(points->points + 3 * (size_t)((i + 1) % n));
        struct vec3 c = vec3_load(points->points + 3 * (size_t)((i + 2) % n));
        if (vec3_dot(triangle_normal(a, b, c), normal) < 0)
            return false;
    }
    return true;
}

/* Diameter of the circle through three points; of their longest side if they are in line. */
static double circle_diameter(struct vec3 a, struct vec3 b, struct vec3 c)
{
    double x = vec3_distance(b, c), y = vec3_distance(c, a), z = vec3_distance(a, b);
    double span = vec3_length(triangle_normal(a, b, c));
    double longest = x > y ? x : y;
    longest = z > longest ? z : longest;
    return span > 1e-9 * longest * longest ? x * y * z / span : longest;
}

static double sampled_size(const struct loop_points *points, struct vec3 normal)
{
    const double *p = points->points;
    size_t n = points->count;
    if (loop_is_convex(points, normal))
        return vec3_distance(vec3_load(p), vec3_load(p + 3 * (n / 2)));
    return circle_diameter(vec3_load(p), vec3_load(p + 3 * (n / 3)),
                           vec3_load(p + 3 * (2 * n / 3)));
}

enum status loop_size(struct context *ctx, struct loop_points *points, enum loop_measure measure,
                      struct vec3 normal, double *size)
{
    struct vec3 middle;
    if (measure == LOOP_SAMPLED)
        *size = sampled_size(points, normal);
    else if (measure == LOOP_BOX)
        *size = box_diagonal(points->points, points->count, &middle);
    else
        return points_diameter(ctx, points, points->points, points->count, INFINITY, size);
    return STATUS_OK;
}
