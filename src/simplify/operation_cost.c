/*
 * What an operation costs.
 *
 * Section 4.2.6 gives conditions and no measure: what passes is done, in the order in which it is
 * met. To reach a given number of faces with the least damage there must be an order, so every
 * operation is priced by the same thing, the tolerance of section 4.2.5: the largest distance of
 * the original chains' vertices from the edges that replace them. Each edge keeps a list of those
 * vertices, so the price is measured against the original however often an edge has been changed.
 * In the metric of chain_simplify.h it is the full distance for sharp chains and borders, and
 * mostly the part along the normal elsewhere.
 *
 * Three of the conditions cannot be absolute when N faces must be reached with edges kept sharp:
 * (b), that a chain is collapsed only between patches whose normals agree; (c), that it is short;
 * and of (1), that all chains of both patches are single edges before they are merged, which would
 * keep the two halves of a flat face apart until its round outline has become a triangle. They are
 * prices here: what violates them waits until it is cheaper by a factor than all that does not.
 * Absolute are (2), normals that agree for merging, and what is about topology: (a), and that
 * patches share one chain only (patch_merge.c).
 */
#include "simplify/operation_cost.h"

#include "geom/plane.h"
#include "simplify/chain_simplify.h"

#define OPEN_PRICE 4.0           /* a merge that violates (1) */
#define SHARP_PRICE 2.0          /* a collapse that violates (b) */
#define LONG_PRICE 1.25          /* one that violates (c) */
#define LONG_FRACTION 0.2        /* of (c) */
#define FOLD_PRICE 4.0           /* per length moved, when a loop would cross itself or turn over */
#define SPREAD_EQUAL 1e-6        /* variations of normals that differ by less are equal */
#define STEEP_COSINE 0.7         /* of a loop's own normal with its patch's: 45 degrees */
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

/* A loop's shape with one corner open: the others in the plane, from the one behind it to the one
 * before it, and the area vector of the polygon that they make (twice the area long). */
struct open_loop {
    struct plane_frame frame;
    struct vec3 normal; /* of the patch */
    struct vec3 origin; /* the open corner; all is relative to it */
    struct vec3 first, last, area;
    struct plane_point points[FOLD_CORNERS_MAX];
    uint32_t count;
};

static void open_loop_read(const struct chain_graph *graph, uint32_t h, struct open_loop *loop)
{
    struct vec3 before = {0, 0, 0};
    loop->normal = patch_normal(graph, graph->half_edges[h].patch);
    loop->frame = plane_frame_make(loop->normal);
    loop->origin = vertex_point(graph, graph->half_edges[h].origin);
    loop->area = before;
    loop->count = 0;
    for (uint32_t g = graph->half_edges[h].next; g != h; g = graph->half_edges[g].next) {
        struct vec3 p = vec3_sub(vertex_point(graph, graph->half_edges[g].origin), loop->origin);
        if (loop->count == 0)
            loop->first = p;
        else
            loop->area = vec3_add(loop->area, triangle_normal(loop->first, before, p));
        loop->points[loop->count++] = plane_project(&loop->frame, p);
        before = p;
    }
    loop->last = before;
}

/* Is the loop, with `area` as its area vector, turned over or steep, and more so than before? */
static bool loop_tilts(const struct open_loop *loop, struct vec3 area)
{
    struct vec3 nowhere = {0, 0, 0};
    struct vec3 old = vec3_add(loop->area, triangle_normal(loop->last, nowhere, loop->first));
    double up = vec3_dot(area, loop->normal), length = vec3_length(area);
    if (up >= STEEP_COSINE * length)
        return false;
    return up * vec3_length(old) < vec3_dot(old, loop->normal) * length;
}

/* Would the loop of half-edge h, its origin moved to `*moved` or (NULL) taken out, cross itself,
 * turn over or become steep? Seen along the patch's normal. */
static bool loop_folds(const struct chain_graph *graph, uint32_t h, const struct vec3 *moved)
{
    struct open_loop loop;
    if (graph->patches[graph->half_edges[h].patch].size > FOLD_CORNERS_MAX)
        return false;
    open_loop_read(graph, h, &loop);
    const struct plane_point *points = loop.points;
    uint32_t last = loop.count - 1;
    if (!moved) {
        if (loop_tilts(&loop, loop.area))
            return true;
        for (uint32_t i = 1; i + 1 < last; i++)
            if (plane_segments_cross(points[last], points[0], points[i], points[i + 1]))
                return true;
        return false;
    }
    struct vec3 there = vec3_sub(*moved, loop.origin);
    if (loop_tilts(&loop, vec3_add(loop.area, triangle_normal(loop.last, there, loop.first))))
        return true;
    struct plane_point to = plane_project(&loop.frame, there);
    for (uint32_t i = 0; i < last; i++)
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

/* Is half-edge g, at the vertex that collapses along h, the edge of a triangle that is dropped? */
static bool is_dropped(const struct chain_graph *graph, uint32_t h, uint32_t g)
{
    const struct half_edge *half_edges = graph->half_edges;
    for (uint32_t side = h;; side ^= 1) {
        uint32_t patch = half_edges[side].patch;
        if (patch != NO_PATCH && graph->patches[patch].size == 3 &&
            (half_edges[g].patch == patch || half_edges[g ^ 1].patch == patch))
            return true;
        if (side != h)
            return false;
    }
}

/*
 * Where the vertex that goes, and what the collapsing edge replaces, are remembered: each with the
 * edge to which it is nearest among those of its own kind. A sharp chain is not to be compared with
 * vertices that never were on it.
 */
struct heirs {
    double vertex_rank, list_rank;
    bool list_is_sharp;
};

static void rank_heir(struct operation *operation, struct heirs *heirs, uint32_t edge,
                      bool is_sharp, double distance, double moved)
{
    double rank = is_sharp ? distance - 4 * moved : distance;
    if (rank < heirs->vertex_rank) {
        heirs->vertex_rank = rank;
        operation->vertex_to = edge;
    }
    if (is_sharp == heirs->list_is_sharp && distance < heirs->list_rank) {
        heirs->list_rank = distance;
        operation->list_to = edge;
    }
}

static void collapse_cost(const struct chain_graph *graph, const struct cost_options *options,
                          uint32_t h, struct operation *operation)
{
    const struct half_edge *half_edges = graph->half_edges;
    uint32_t left = half_edges[h].patch, right = half_edges[h ^ 1].patch;
    struct vec3 gone = vertex_point(graph, half_edges[h].origin);
    struct vec3 kept = vertex_point(graph, half_edge_end(graph, h));
    struct chain_metric own = metric_between(graph, left, right);
    struct heirs heirs = {INFINITY, INFINITY, own.lateral >= CHAIN_SHARP_LATERAL};
    double moved = vec3_distance(gone, kept);
    *operation =
        (struct operation){.kind = OPERATION_COLLAPSE, .half_edge = h, .list_to = NO_INDEX};
    for (uint32_t g = half_edge_turn(graph, h); g != h; g = half_edge_turn(graph, g)) {
        struct vec3 end = vertex_point(graph, half_edge_end(graph, g));
        struct chain_metric metric =
            metric_between(graph, half_edges[g].patch, half_edges[g ^ 1].patch);
        struct vec3 offset = segment_offset(gone, kept, end);
        charge(operation, &metric, chain_metric_length(&metric, offset));
        charge(operation, &metric, list_distance(graph, g / 2, &metric, kept, end));
        double distance = vec3_length(offset) + (is_dropped(graph, h, g) ? 2 * moved : 0);
        rank_heir(operation, &heirs, g / 2, metric.lateral >= CHAIN_SHARP_LATERAL, distance, moved);
    }
    if (operation->list_to != NO_INDEX) {
        uint32_t g = 2 * operation->list_to;
        struct vec3 a = vertex_point(graph, half_edges[g].origin);
        struct vec3 b = vertex_point(graph, half_edges[g ^ 1].origin);
        if (half_edges[g].origin == half_edges[h].origin)
            a = kept;
        else
            b = kept;
        charge(operation, &own, list_distance(graph, h / 2, &own, a, b));
    }
    if (left != NO_PATCH && right != NO_PATCH) {
        double longest = (double)graph->patches[left].longest;
        if (longest < (double)graph->patches[right].longest)
            longest = (double)graph->patches[right].longest;
        if (vec3_dot(patch_normal(graph, left), patch_normal(graph, right)) < options->patch_cosine)
            operation->key *= SHARP_PRICE;
        if (moved > LONG_FRACTION * longest)
            operation->key *= LONG_PRICE;
    }
}

/* Variation of the patch normals round a vertex: 1 less the cosine between those that differ most.
 */
static double normal_spread(const struct chain_graph *graph, uint32_t v)
{
    struct vec3 normals[COLLAPSE_DEGREE_MAX];
    uint32_t count = 0, h = graph->outgoing[v];
    double least = 1;
    do {
        if (graph->half_edges[h].patch != NO_PATCH) {
            if (count == COLLAPSE_DEGREE_MAX)
                return 2; /* a hub stays */
            normals[count++] = patch_normal(graph, graph->half_edges[h].patch);
        }
        h = half_edge_turn(graph, h);
    } while (h != graph->outgoing[v]);
    for (uint32_t i = 0; i < count; i++)
        for (uint32_t k = 0; k < i; k++) {
            double cosine = vec3_dot(normals[i], normals[k]);
            least = cosine < least ? cosine : least;
        }
    return 1 - least;
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

/* All collapses that may take the vertex away. */
static uint32_t list_collapses(const struct chain_graph *graph, const struct cost_options *options,
                               uint32_t vertex, bool two_edges, struct operation *operations)
{
    double spread = two_edges ? 0 : normal_spread(graph, vertex);
    uint32_t h = graph->outgoing[vertex], count = 0;
    do {
        /* A chain of one edge: both ends are junctions. */
        bool is_single = two_edges || ((graph->flags[vertex] & VERTEX_JUNCTION) &&
                                       (graph->flags[half_edge_end(graph, h)] & VERTEX_JUNCTION));
        if (is_single && (two_edges || goes_the_right_way(graph, h, spread)) &&
            edge_can_collapse(graph, h))
            collapse_cost(graph, options, h, &operations[count++]);
        h = half_edge_turn(graph, h);
    } while (h != graph->outgoing[vertex]);
    return count;
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
    /* Whether a loop folds is asked last, and only of what is cheapest so far: it can but make it
     * dearer. */
    struct operation operations[COLLAPSE_DEGREE_MAX];
    bool tested[COLLAPSE_DEGREE_MAX] = {false};
    uint32_t count = list_collapses(graph, options, vertex, two_edges, operations), best_place = 0;
    while (count > 0) {
        for (uint32_t i = 0; i < count; i++)
            if (operations[i].key < operations[best_place].key)
                best_place = i;
        if (tested[best_place])
            break;
        tested[best_place] = true;
        uint32_t h = operations[best_place].half_edge;
        if (vertex_folds(graph, vertex, h))
            operations[best_place].key +=
                FOLD_PRICE * vec3_distance(vertex_point(graph, vertex),
                                           vertex_point(graph, half_edge_end(graph, h)));
    }
    if (count > 0)
        *best = operations[best_place];
}

/* ---- sliding ---- */

enum { SLIDE_CANDIDATES_MAX = 48 };
#define SLIDE_GAIN 0.95 /* a new place must be better than this times the old */

/* The two edges of the chain that the vertex stands on: its only two, or its only two sharp ones.
 */
static bool chain_through(const struct chain_graph *graph, uint32_t v, struct slide *slide)
{
    uint32_t h = graph->outgoing[v], found = 0, degree = 0;
    bool two_edges = vertex_has_two_edges(graph, v);
    do {
        struct chain_metric metric =
            metric_between(graph, graph->half_edges[h].patch, graph->half_edges[h ^ 1].patch);
        if (++degree > COLLAPSE_DEGREE_MAX)
            return false;
        if (two_edges || metric.lateral >= CHAIN_SHARP_LATERAL) {
            if (found == 2)
                return false;
            if (found++ == 0)
                slide->in = h;
            else
                slide->out = h;
        }
        h = half_edge_turn(graph, h);
    } while (h != graph->outgoing[v]);
    return found == 2;
}

/* What the two edges replace, and the vertex itself if it moves, from the two segments over `at`.
 */
static double chain_cost_at(const struct chain_graph *graph, uint32_t v, const struct slide *slide,
                            struct vec3 at, bool moves, double bound)
{
    const struct half_edge *half_edges = graph->half_edges;
    uint32_t sides[2] = {slide->in, slide->out};
    struct chain_metric metric[2];
    struct vec3 ends[2];
    double largest = 0;
    for (int i = 0; i < 2; i++) {
        metric[i] =
            metric_between(graph, half_edges[sides[i]].patch, half_edges[sides[i] ^ 1].patch);
        ends[i] = vertex_point(graph, half_edge_end(graph, sides[i]));
        if (!moves)
            raise(&largest,
                  metric[i].price * list_distance(graph, sides[i] / 2, &metric[i], at, ends[i]));
    }
    for (int i = 0; i < 3 && moves && largest < bound; i++) {
        uint32_t w = i < 2 ? graph->edges[sides[i] / 2].first : v;
        for (; w != NO_INDEX && largest < bound; w = i < 2 ? graph->list[w] : NO_INDEX) {
            struct vec3 p = vertex_point(graph, w);
            double cost[2];
            for (int k = 0; k < 2; k++)
                cost[k] = metric[k].price *
                          chain_metric_length(&metric[k], segment_offset(p, at, ends[k]));
            raise(&largest, cost[0] < cost[1] ? cost[0] : cost[1]);
        }
    }
    return largest;
}

/* What the vertex's other edges replace, and the vertex, from where they would be. */
static double others_cost_at(const struct chain_graph *graph, uint32_t v, const struct slide *slide,
                             struct vec3 at, bool moves)
{
    struct vec3 from = vertex_point(graph, v);
    double largest = 0;
    for (uint32_t h = half_edge_turn(graph, slide->in); h != slide->in;
         h = half_edge_turn(graph, h)) {
        if (h == slide->out)
            continue;
        struct chain_metric metric =
            metric_between(graph, graph->half_edges[h].patch, graph->half_edges[h ^ 1].patch);
        struct vec3 end = vertex_point(graph, half_edge_end(graph, h));
        raise(&largest, metric.price * list_distance(graph, h / 2, &metric, at, end));
        if (moves)
            raise(&largest,
                  metric.price * chain_metric_length(&metric, segment_offset(from, at, end)));
    }
    return largest;
}

static bool loops_fold_at(const struct chain_graph *graph, uint32_t v, struct vec3 at)
{
    uint32_t h = graph->outgoing[v];
    do {
        if (graph->half_edges[h].patch != NO_PATCH && loop_folds(graph, h, &at))
            return true;
        h = half_edge_turn(graph, h);
    } while (h != graph->outgoing[v]);
    return false;
}

static bool replaces_anything(const struct chain_graph *graph, uint32_t v)
{
    uint32_t h = graph->outgoing[v], turns = 0;
    do {
        if (graph->edges[h / 2].count > 0)
            return true;
        h = half_edge_turn(graph, h);
    } while (h != graph->outgoing[v] && ++turns < COLLAPSE_DEGREE_MAX);
    return false;
}

bool vertex_slide_find(const struct chain_graph *graph, uint32_t v, struct slide *slide)
{
    if (!replaces_anything(graph, v) || !chain_through(graph, v, slide))
        return false;
    uint32_t edges[2] = {slide->in / 2, slide->out / 2};
    uint32_t count = graph->edges[edges[0]].count + graph->edges[edges[1]].count;
    if (count == 0)
        return false;
    struct vec3 here = vertex_point(graph, v);
    double cost = chain_cost_at(graph, v, slide, here, false, INFINITY);
    raise(&cost, others_cost_at(graph, v, slide, here, false));
    double best = cost * SLIDE_GAIN;
    uint32_t stride = count / SLIDE_CANDIDATES_MAX + 1, place = 0;
    slide->to = NO_INDEX;
    for (int i = 0; i < 2; i++)
        for (uint32_t w = graph->edges[edges[i]].first; w != NO_INDEX; w = graph->list[w]) {
            if (place++ % stride != 0)
                continue;
            struct vec3 at = vertex_point(graph, w);
            double there = chain_cost_at(graph, v, slide, at, true, best);
            if (there < best)
                raise(&there, others_cost_at(graph, v, slide, at, true));
            if (there < best && !loops_fold_at(graph, v, at)) {
                best = there;
                slide->to = w;
            }
        }
    return slide->to != NO_INDEX;
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
    *operation =
        (struct operation){.kind = OPERATION_MERGE, .half_edge = h, .error = error, .key = error};
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
        /* Each chain once, at its first edge. */
        if (other != NO_PATCH &&
            vec3_dot(patch_normal(graph, patch), patch_normal(graph, other)) >=
                options->patch_cosine &&
            !vertex_has_two_edges(graph, graph->half_edges[h].origin)) {
            struct operation operation;
            merge_cost(graph, h, &operation);
            if (operation.key < best->key && patches_can_merge(graph, h))
                *best = operation;
        }
        h = graph->half_edges[h].next;
    } while (h != from->half_edge);
}
