/*
 * What an operation costs.
 *
 * Section 4.2.6 gives conditions and no measure: what passes is done, in the order in which it is
 * met. To reach a given number of faces with the least damage there must be an order, so every
 * operation is priced by the same thing, the tolerance of section 4.2.5: the largest distance of
 * the original chains' vertices from the edges that replace them. Each edge keeps a list of those
 * vertices, so the price is measured against the original however often an edge has been changed.
 * In the metric of chain_simplify.h it is the full distance for sharp chains and borders, and mostly
 * the part along the normal elsewhere.
 *
 * Conditions (b), normals that agree, and (c), short chains first, cannot be absolute when N faces
 * must be reached. They are prices here: what violates them waits until it is cheaper by a factor
 * than all that does not. Condition (a) is about topology and absolute (patch_merge.c).
 */
#include "simplify/operation_cost.h"

#include "geom/plane.h"
#include "simplify/chain_simplify.h"

#define SHARP_PRICE 2.0    /* a collapse that violates (b) */
#define OPEN_PRICE 4.0
#define LONG_PRICE 1.25    /* one that violates (c) */
#define LONG_FRACTION 0.2  /* of (c) */
#define FOLD_PRICE 4.0     /* per length moved, when a loop would cross itself or turn over */
#define SPREAD_EQUAL 1e-6  /* variations of normals that differ by less are equal */
enum { FOLD_CORNERS_MAX = 128 }; /* larger loops are not tested for crossings */

/* ---- distances ---- */

static struct chain_metric metric_between(const struct chain_graph *graph, uint32_t left,
                                          uint32_t right)
{
    if (left == NO_PATCH || right == NO_PATCH)
        return chain_metric_plain();
    return chain_metric_between(patch_normal(graph, left), patch_normal(graph, right));
}

/* Of all that an edge replaces from the segment ab. */
static double list_distance(const struct chain_graph *graph, uint32_t edge,
                            const struct chain_metric *metric, struct vec3 a, struct vec3 b)
{
    const struct edge_record *record = &graph->edges[edge];
    double largest = 0;
    for (uint32_t v = record->first; v != NO_INDEX; v = graph->list[v]) {
        double d = chain_metric_length(metric, segment_offset(vertex_point(graph, v), a, b));
        if (d > largest)
            largest = d;
    }
    return largest + metric->lateral * (double)record->slack;
}

static void raise(double *largest, double value)
{
    if (value > *largest)
        *largest = value;
}

/* Takes an error along a chain into account. */
static void charge(struct operation *operation, const struct chain_metric *metric, double error)
{
    raise(&operation->error, error);
    raise(&operation->key, error * metric->price);
}

/* ---- loops that fold ---- */

/* Would the loop of half-edge h, its origin moved to `*moved` or (NULL) taken out, turn over or
 * cross itself where it did not before? Seen along the patch's normal. */
static bool loop_folds(const struct chain_graph *graph, uint32_t h, const struct vec3 *moved)
{
    struct plane_point points[FOLD_CORNERS_MAX];
    const struct graph_patch *patch = &graph->patches[graph->half_edges[h].patch];
    if (patch->size > FOLD_CORNERS_MAX)
        return false;
    struct vec3 origin = vertex_point(graph, graph->half_edges[h].origin);
    struct plane_frame frame = plane_frame_make(vec3_load_float(patch->normal));
    uint32_t count = 0;
    for (uint32_t g = graph->half_edges[h].next; g != h; g = graph->half_edges[g].next)
        points[count++] = plane_project(
            &frame, vec3_sub(vertex_point(graph, graph->half_edges[g].origin), origin));
    struct plane_point old = {0, 0};
    double rest = plane_polygon_area(points, count);
    double before = rest + plane_turn(points[count - 1], old, points[0]), after = rest;
    uint32_t last = count - 1;
    if (!moved) {
        if (after <= 0 && after < before)
            return true;
        for (uint32_t i = 1; i + 2 < count; i++)
            if (plane_segments_cross(points[last], points[0], points[i], points[i + 1]))
                return true;
        return false;
    }
    struct plane_point to = plane_project(&frame, vec3_sub(*moved, origin));
    after = rest + plane_turn(points[last], to, points[0]);
    if (after <= 0 && after < before)
        return true;
    for (uint32_t i = 0; i + 1 < count; i++)
        if ((i + 1 < last && plane_segments_cross(points[last], to, points[i], points[i + 1])) ||
            (i > 0 && plane_segments_cross(to, points[0], points[i], points[i + 1])))
            return true;
    return false;
}

/* Any loop at the vertex, which goes (along `h`, or by removal: NO_INDEX). */
static bool vertex_folds(const struct chain_graph *graph, uint32_t v, uint32_t h)
{
    uint32_t left = NO_PATCH, right = NO_PATCH, g = graph->outgoing[v];
    struct vec3 to = {0, 0, 0};
    if (h != NO_INDEX) {
        left = graph->half_edges[h].patch;
        right = graph->half_edges[h ^ 1].patch;
        to = vertex_point(graph, half_edge_end(graph, h));
    }
    do {
        uint32_t patch = graph->half_edges[g].patch;
        if (patch != NO_PATCH) {
            bool taken_out = h == NO_INDEX || patch == left || patch == right;
            bool dropped = taken_out && graph->patches[patch].size == 3;
            if (!dropped && loop_folds(graph, g, taken_out ? NULL : &to))
                return true;
        }
        g = half_edge_turn(graph, g);
    } while (g != graph->outgoing[v]);
    return false;
}

/* ---- prices ---- */

static void remove_cost(const struct chain_graph *graph, uint32_t v, struct operation *operation)
{
    const struct half_edge *half_edges = graph->half_edges;
    uint32_t h = graph->outgoing[v], other = half_edge_turn(graph, h);
    struct vec3 a = vertex_point(graph, half_edge_end(graph, h));
    struct vec3 b = vertex_point(graph, half_edge_end(graph, other));
    struct chain_metric metric =
        metric_between(graph, half_edges[h].patch, half_edges[other].patch);
    struct vec3 offset = segment_offset(vertex_point(graph, v), a, b);
    *operation = (struct operation){.kind = OPERATION_REMOVE, .vertex = v};
    charge(operation, &metric, chain_metric_length(&metric, offset));
    charge(operation, &metric, list_distance(graph, h / 2, &metric, a, b));
    charge(operation, &metric, list_distance(graph, other / 2, &metric, a, b));
    if (vertex_folds(graph, v, NO_INDEX))
        operation->key += FOLD_PRICE * vec3_length(offset);
}

/* The patch that lies beyond the triangle beside the collapsing edge, over the triangle's edge `g`
 * at the vertex that goes; `across` is that triangle's edge at the one that stays. */
static struct chain_metric metric_after(const struct chain_graph *graph, uint32_t h, uint32_t g)
{
    const struct half_edge *half_edges = graph->half_edges;
    uint32_t left = half_edges[g].patch, right = half_edges[g ^ 1].patch;
    for (uint32_t side = h;; side ^= 1) {
        uint32_t patch = half_edges[side].patch;
        if (patch != NO_PATCH && graph->patches[patch].size == 3 &&
            (left == patch || right == patch)) {
            uint32_t across = side == h ? half_edges[side].next : half_edges[side].previous;
            uint32_t beyond = half_edges[across ^ 1].patch;
            if (left == patch)
                left = beyond;
            else
                right = beyond;
        }
        if (side != h)
            break;
    }
    return metric_between(graph, left, right);
}

static void collapse_cost(const struct chain_graph *graph, const struct cost_options *options,
                          uint32_t h, struct operation *operation)
{
    const struct half_edge *half_edges = graph->half_edges;
    struct vec3 gone = vertex_point(graph, half_edges[h].origin);
    struct vec3 kept = vertex_point(graph, half_edge_end(graph, h));
    double moved = vec3_distance(gone, kept), nearest = INFINITY, heir = INFINITY;
    *operation = (struct operation){.kind = OPERATION_COLLAPSE, .half_edge = h};
    for (uint32_t g = half_edge_turn(graph, h); g != h; g = half_edge_turn(graph, g)) {
        struct vec3 end = vertex_point(graph, half_edge_end(graph, g));
        struct chain_metric metric = metric_after(graph, h, g);
        struct vec3 offset = segment_offset(gone, kept, end);
        double distance = vec3_length(offset);
        charge(operation, &metric, chain_metric_length(&metric, offset));
        charge(operation, &metric, list_distance(graph, g / 2, &metric, kept, end));
        if (distance < nearest) {
            nearest = distance;
            operation->list_to = g / 2;
        }
        /* The vertex stays a witness where it matters most: on a sharp chain, else the nearest. */
        double rank = metric.lateral >= 0.5 ? distance - moved : distance;
        if (rank < heir) {
            heir = rank;
            operation->vertex_to = g / 2;
        }
    }
    uint32_t left = half_edges[h].patch, right = half_edges[h ^ 1].patch;
    struct chain_metric metric = metric_between(graph, left, right);
    uint32_t g = 2 * operation->list_to;
    struct vec3 a = vertex_point(graph, half_edges[g].origin);
    struct vec3 b = vertex_point(graph, half_edges[g ^ 1].origin);
    if (half_edges[g].origin == half_edges[h].origin)
        a = kept;
    else
        b = kept;
    charge(operation, &metric, list_distance(graph, h / 2, &metric, a, b));
    if (left != NO_PATCH && right != NO_PATCH) {
        double longest = (double)graph->patches[left].longest;
        if (longest < (double)graph->patches[right].longest)
            longest = (double)graph->patches[right].longest;
        if (vec3_dot(patch_normal(graph, left), patch_normal(graph, right)) <
            options->patch_cosine)
            operation->key *= SHARP_PRICE;
        if (moved > LONG_FRACTION * longest)
            operation->key *= LONG_PRICE;
    }
    if (vertex_folds(graph, half_edges[h].origin, h))
        operation->key += FOLD_PRICE * moved;
}

/* Variation of the patch normals round a vertex: 0 where they all agree. */
static double normal_spread(const struct chain_graph *graph, uint32_t v)
{
    struct vec3 sum = {0, 0, 0};
    uint32_t count = 0, h = graph->outgoing[v];
    do {
        if (graph->half_edges[h].patch != NO_PATCH) {
            sum = vec3_add(sum, patch_normal(graph, graph->half_edges[h].patch));
            count++;
        }
        h = half_edge_turn(graph, h);
    } while (h != graph->outgoing[v] && count <= COLLAPSE_DEGREE_MAX);
    return count > COLLAPSE_DEGREE_MAX ? 1 : 1 - vec3_length(sum) / count;
}

/* Section 4.2.6: the end with the larger variation of normals stays; 4.2.7: what lies on the border
 * stays, and along the border either end may. `spread` is that of the origin. */
static bool goes_the_right_way(const struct chain_graph *graph, uint32_t h, double spread)
{
    uint32_t kept = half_edge_end(graph, h);
    if (vertex_is_border(graph, kept))
        return true;
    return normal_spread(graph, kept) >= spread - SPREAD_EQUAL;
}

void vertex_cost(const struct chain_graph *graph, const struct cost_options *options,
                 uint32_t vertex, struct operation *best)
{
    *best = (struct operation){.kind = OPERATION_NONE, .key = INFINITY};
    bool two_edges = vertex_has_two_edges(graph, vertex);
    if (two_edges && vertex_can_go(graph, vertex)) {
        remove_cost(graph, vertex, best);
        return;
    }
    if (vertex_degree(graph, vertex, COLLAPSE_DEGREE_MAX + 1) > COLLAPSE_DEGREE_MAX)
        return;
    double spread = normal_spread(graph, vertex);
    uint32_t h = graph->outgoing[vertex];
    do {
        /* A chain of one edge: both ends are junctions. */
        bool is_single = two_edges || ((graph->flags[vertex] & VERTEX_JUNCTION) &&
                                       (graph->flags[half_edge_end(graph, h)] & VERTEX_JUNCTION));
        if (is_single && goes_the_right_way(graph, h, spread) && edge_can_collapse(graph, h)) {
            struct operation operation;
            collapse_cost(graph, options, h, &operation);
            if (operation.key < best->key)
                *best = operation;
        }
        h = half_edge_turn(graph, h);
    } while (h != graph->outgoing[vertex]);
}

/* ---- merging ---- */

/* Widens [low, high] by the offsets of a loop's corners along the normal. */
static void loop_range(const struct chain_graph *graph, uint32_t h, struct vec3 normal, double *low,
                       double *high)
{
    uint32_t g = h;
    do {
        double offset = vec3_dot(normal, vertex_point(graph, graph->half_edges[g].origin));
        *low = offset < *low ? offset : *low;
        *high = offset > *high ? offset : *high;
        g = graph->half_edges[g].next;
    } while (g != h);
}

/* The merged polygon's deviation from its plane. */
static void merge_cost(const struct chain_graph *graph, uint32_t h, struct operation *operation)
{
    const struct graph_patch *a = &graph->patches[graph->half_edges[h].patch];
    const struct graph_patch *b = &graph->patches[graph->half_edges[h ^ 1].patch];
    struct vec3 normal = vec3_add(vec3_scale(vec3_load_float(a->normal), (double)a->area),
                                  vec3_scale(vec3_load_float(b->normal), (double)b->area));
    double low = INFINITY, high = -INFINITY;
    normal = vec3_normalized(normal);
    loop_range(graph, h, normal, &low, &high);
    loop_range(graph, h ^ 1, normal, &low, &high);
    double error = (high - low) / 2;
    raise(&error, (double)a->deviation);
    raise(&error, (double)b->deviation);
    *operation = (struct operation){
        .kind = OPERATION_MERGE, .half_edge = h, .error = error, .key = error};
    if (a->open > 0 || b->open > 0)
        operation->key *= OPEN_PRICE;
}

void patch_cost(const struct chain_graph *graph, const struct cost_options *options, uint32_t patch,
                struct operation *best)
{
    *best = (struct operation){.kind = OPERATION_NONE, .key = INFINITY};
    const struct graph_patch *from = &graph->patches[patch];
    if (from->size > MERGE_CORNERS_MAX)
        return;
    uint32_t h = from->half_edge;
    do {
        uint32_t other = graph->half_edges[h ^ 1].patch;
        if (other != NO_PATCH &&
            vec3_dot(patch_normal(graph, patch), patch_normal(graph, other)) >=
                options->patch_cosine &&
            patches_can_merge(graph, h)) {
            struct operation operation;
            merge_cost(graph, h, &operation);
            if (operation.key < best->key)
                *best = operation;
        }
        h = graph->half_edges[h].next;
    } while (h != from->half_edge);
}
