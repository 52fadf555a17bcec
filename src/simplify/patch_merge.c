/*
 * Operations on the chain graph.
 *
 * The dissertation deletes junctions of degree two as they come and tests a collapse by condition
 * (a) alone. That lets two chains become the same edge, a patch shrink to two corners, or a handle
 * be pinched off: non-manifold output, which then has to be mended. Here nothing is mended: an
 * operation that would leave the invariants is not done. All tests are local; where they walk round
 * a vertex or along a loop they take the shorter way, so that vertices with very many edges and
 * patches with very many corners do not make them slow.
 */
#include "simplify/patch_merge.h"

#include "simplify/chain_simplify.h"
#include "simplify/edge_list.h"

/* ---- a vertex between two edges ---- */

bool vertex_has_two_edges(const struct chain_graph *graph, uint32_t v)
{
    uint32_t h = graph->outgoing[v], other = half_edge_turn(graph, h);
    return other != h && half_edge_turn(graph, other) == h;
}

/* The third corner of the triangle that a loop of four corners is when the origin of `h` goes. */
static uint32_t opposite_after(const struct chain_graph *graph, uint32_t h)
{
    return half_edge_end(graph, graph->half_edges[h].next);
}

static bool loop_has_size(const struct chain_graph *graph, uint32_t h, uint32_t size)
{
    uint32_t patch = graph->half_edges[h].patch;
    return patch != NO_PATCH && graph->patches[patch].size == size;
}

bool vertex_can_go(const struct chain_graph *graph, uint32_t v)
{
    uint32_t h = graph->outgoing[v], other = half_edge_turn(graph, h);
    uint32_t a = half_edge_end(graph, h), b = half_edge_end(graph, other);
    /* A loop of three edges has the new edge already, so every loop keeps three. */
    if (vertices_joined(graph, a, b))
        return false;
    return !(loop_has_size(graph, h, 4) && loop_has_size(graph, other, 4) &&
             opposite_after(graph, h) == opposite_after(graph, other));
}

/* One corner less. */
static void patch_shrink(struct chain_graph *graph, uint32_t patch, bool was_open)
{
    if (patch == NO_PATCH)
        return;
    graph->patches[patch].size--;
    graph->patches[patch].open -= was_open;
}

static void link_after(struct chain_graph *graph, uint32_t h, uint32_t next)
{
    graph->half_edges[h].next = next;
    graph->half_edges[next].previous = h;
}

static void note_length(struct chain_graph *graph, uint32_t edge)
{
    float length = (float)vec3_distance(vertex_point(graph, graph->half_edges[2 * edge].origin),
                                        vertex_point(graph, half_edge_end(graph, 2 * edge)));
    for (uint32_t h = 2 * edge; h <= 2 * edge + 1; h++) {
        uint32_t patch = graph->half_edges[h].patch;
        if (patch != NO_PATCH && graph->patches[patch].longest < length)
            graph->patches[patch].longest = length;
    }
}

/* Takes an edge out of the counts; its half-edges' fields stay. */
static void edge_drop(struct chain_graph *graph, uint32_t edge)
{
    graph->live_edges--;
    for (uint32_t h = 2 * edge; h <= 2 * edge + 1; h++)
        if (graph->half_edges[h].patch == NO_PATCH)
            graph->live_border_edges--;
    graph->edges[edge].count = NO_INDEX;
}

static void patch_keep_half_edge(struct chain_graph *graph, uint32_t lost, uint32_t instead)
{
    uint32_t patch = graph->half_edges[lost].patch;
    if (patch != NO_PATCH && graph->patches[patch].half_edge == lost)
        graph->patches[patch].half_edge = instead;
}

void vertex_remove(struct chain_graph *graph, uint32_t v)
{
    struct half_edge *half_edges = graph->half_edges;
    uint32_t h = graph->outgoing[v], t = h ^ 1;         /* v to b, and back */
    uint32_t in = half_edges[h].previous, out = in ^ 1; /* a to v, and back */
    uint32_t b = half_edges[t].origin, before = graph->edges[in / 2].count;
    bool open = !(graph->flags[v] & VERTEX_JUNCTION);

    patch_shrink(graph, half_edges[h].patch, open);
    patch_shrink(graph, half_edges[t].patch, open);
    patch_keep_half_edge(graph, h, in);
    patch_keep_half_edge(graph, t, out);
    link_after(graph, in, half_edges[h].next);
    link_after(graph, half_edges[t].previous, out);
    half_edges[out].origin = b;
    if (graph->outgoing[b] == t)
        graph->outgoing[b] = out;
    graph->outgoing[v] = NO_INDEX;

    list_append(graph, &graph->edges[in / 2], v);
    list_join(graph, &graph->edges[in / 2], &graph->edges[h / 2]);
    edge_drop(graph, h / 2);
    note_length(graph, in / 2);
    list_limit(graph, in / 2, before);
}

/* ---- collapsing an edge ---- */

/* Both sides of edges that collapsing h takes together when the patch of h is a triangle. */
static bool triangle_can_drop(const struct chain_graph *graph, uint32_t h)
{
    uint32_t next = graph->half_edges[h].next, previous = graph->half_edges[h].previous;
    return graph->half_edges[next ^ 1].patch != graph->half_edges[previous ^ 1].patch;
}

/* The patch on the left of h, once the edge h has collapsed, is a triangle on the far edge: would a
 * patch with the same three corners lie on that edge's other side? `gone` and `kept` are the ends
 * of the edge that collapses, left and right the patches beside it. */
static bool makes_double(const struct chain_graph *graph, uint32_t far, uint32_t gone,
                         uint32_t kept, uint32_t left, uint32_t right)
{
    uint32_t beyond = far ^ 1, patch = graph->half_edges[beyond].patch;
    if (patch == NO_PATCH)
        return false;
    uint32_t size = graph->patches[patch].size;
    if (patch == left || patch == right)
        return size == 4;
    if (size != 3)
        return false;
    uint32_t apex = graph->half_edges[graph->half_edges[beyond].previous].origin;
    return apex == gone || apex == kept;
}

/* The patches beside the collapsing edge. */
static bool sides_can_shrink(const struct chain_graph *graph, uint32_t h, uint32_t gone,
                             uint32_t kept)
{
    const struct half_edge *half_edges = graph->half_edges;
    uint32_t left = half_edges[h].patch, right = half_edges[h ^ 1].patch;
    for (uint32_t side = h;; side ^= 1) {
        uint32_t patch = half_edges[side].patch;
        if (patch == NO_PATCH) {
            if (half_edges[half_edges[half_edges[side].next].next].next == side)
                return false; /* a border loop of three edges */
        } else if (graph->patches[patch].size == 3) {
            if (!triangle_can_drop(graph, side))
                return false;
        } else if (graph->patches[patch].size == 4) {
            uint32_t far = half_edges[half_edges[side].next].next;
            if (makes_double(graph, far, gone, kept, left, right))
                return false;
        }
        if (side != h)
            break;
    }
    return true;
}

/* Third corner of the triangle beside h, or NO_INDEX when the patch there is none. */
static uint32_t triangle_apex(const struct chain_graph *graph, uint32_t h)
{
    if (!loop_has_size(graph, h, 3))
        return NO_INDEX;
    return graph->half_edges[graph->half_edges[h].previous].origin;
}

bool edge_can_collapse(const struct chain_graph *graph, uint32_t h)
{
    const struct half_edge *half_edges = graph->half_edges;
    uint32_t gone = half_edges[h].origin, kept = half_edge_end(graph, h);
    uint32_t left = half_edges[h].patch, right = half_edges[h ^ 1].patch;
    if (vertex_is_border(graph, gone) && left != NO_PATCH && right != NO_PATCH)
        return false;
    if (!sides_can_shrink(graph, h, gone, kept))
        return false;
    uint32_t apex = triangle_apex(graph, h), other_apex = triangle_apex(graph, h ^ 1);
    if (apex != NO_INDEX && apex == other_apex)
        return false;
    uint32_t degree = 0;
    for (uint32_t g = half_edge_turn(graph, h); g != h; g = half_edge_turn(graph, g)) {
        uint32_t vertex = half_edge_end(graph, g), patch = half_edges[g].patch;
        if (++degree > COLLAPSE_DEGREE_MAX)
            return false;
        if (vertex != apex && vertex != other_apex && vertices_joined(graph, vertex, kept))
            return false;
        if (patch == NO_PATCH || patch == left || patch == right)
            continue;
        if (patch_has_corner(graph, patch, kept))
            return false;
        if (graph->patches[patch].size == 3 &&
            makes_double(graph, half_edges[g].next, gone, kept, left, right))
            return false;
    }
    return true;
}

/* A border, or an edge between patches that meet at a sharp angle. */
static bool edge_is_sharp(const struct chain_graph *graph, uint32_t edge)
{
    uint32_t left = graph->half_edges[2 * edge].patch,
             right = graph->half_edges[2 * edge + 1].patch;
    if (left == NO_PATCH || right == NO_PATCH)
        return true;
    struct chain_metric metric =
        chain_metric_between(patch_normal(graph, left), patch_normal(graph, right));
    return metric.lateral >= CHAIN_SHARP_LATERAL;
}

/* Gives an edge that is gone to a patch, which may need a vertex of its list. */
static void put_dissolved(struct chain_graph *graph, uint32_t patch, uint32_t edge)
{
    graph->half_edges[2 * edge].next = graph->patches[patch].dissolved;
    graph->patches[patch].dissolved = edge;
}

/* The patch at `h`'s left has shrunk to the half-edges h and g, its next: drops it and makes one
 * edge of the two; the one of h stays, and h takes the place of g's other side. */
static void drop_slit(struct chain_graph *graph, uint32_t h)
{
    struct half_edge *half_edges = graph->half_edges;
    uint32_t g = half_edges[h].next, outer = g ^ 1;
    uint32_t from = half_edges[h].origin, to = half_edges[g].origin;
    uint32_t patch = half_edges[h].patch, beside = half_edges[outer].patch;
    uint32_t before = graph->edges[h / 2].count;

    patch_keep_half_edge(graph, outer, h);
    if (graph->outgoing[from] == outer)
        graph->outgoing[from] = h;
    if (graph->outgoing[to] == g)
        graph->outgoing[to] = h ^ 1;
    link_after(graph, half_edges[outer].previous, h);
    link_after(graph, h, half_edges[outer].next);
    /* Where one of the edges is sharp and the other is not, the patch was part of what lies beyond
     * the other, and that is no chain any more. */
    bool keeps = edge_is_sharp(graph, h / 2), joins = edge_is_sharp(graph, g / 2);
    if (joins && !keeps) {
        struct edge_record record = graph->edges[h / 2];
        graph->edges[h / 2] = graph->edges[g / 2];
        graph->edges[g / 2] = record;
    } else if (joins == keeps) {
        list_join(graph, &graph->edges[h / 2], &graph->edges[g / 2]);
    }
    edge_drop(graph, g / 2);
    half_edges[h].patch = beside;
    if (beside == NO_PATCH)
        graph->live_border_edges++;
    note_length(graph, h / 2);
    list_limit(graph, h / 2, before);

    /* What the patch was made of goes to a neighbour, which may need a vertex of it. */
    uint32_t heir = beside != NO_PATCH ? beside : half_edges[h ^ 1].patch;
    put_dissolved(graph, heir, g / 2);
    uint32_t after = graph->patches[patch].member;
    graph->patches[patch].member = graph->patches[heir].member;
    graph->patches[heir].member = after;
    graph->patches[patch].half_edge = NO_INDEX;
    graph->live_patches--;
}

static void make_junction(struct chain_graph *graph, uint32_t v)
{
    uint32_t first = graph->outgoing[v], h = first;
    graph->flags[v] |= VERTEX_JUNCTION;
    do {
        if (graph->half_edges[h].patch != NO_PATCH)
            graph->patches[graph->half_edges[h].patch].open--;
        h = half_edge_turn(graph, h);
    } while (h != first);
}

void edge_collapse(struct chain_graph *graph, uint32_t h, uint32_t vertex_to, uint32_t list_to)
{
    struct half_edge *half_edges = graph->half_edges;
    uint32_t t = h ^ 1, gone = half_edges[h].origin, kept = half_edges[t].origin;
    uint32_t after_h = half_edges[h].next, after_t = half_edges[t].next;
    uint32_t before[2] = {graph->edges[vertex_to].count,
                          list_to == NO_INDEX ? 0 : graph->edges[list_to].count};
    bool open = !(graph->flags[gone] & VERTEX_JUNCTION);

    if (!open && !(graph->flags[kept] & VERTEX_JUNCTION))
        make_junction(graph, kept);
    for (uint32_t g = half_edge_turn(graph, h); g != h; g = half_edge_turn(graph, g)) {
        half_edges[g].origin = kept;
        note_length(graph, g / 2);
    }
    patch_shrink(graph, half_edges[h].patch, open);
    patch_shrink(graph, half_edges[t].patch, open);
    patch_keep_half_edge(graph, h, after_h);
    patch_keep_half_edge(graph, t, after_t);
    link_after(graph, half_edges[h].previous, after_h);
    link_after(graph, half_edges[t].previous, after_t);
    if (graph->outgoing[kept] == t)
        graph->outgoing[kept] = half_edges[t].patch == NO_PATCH ? after_t : after_h;
    graph->outgoing[gone] = NO_INDEX;
    list_append(graph, &graph->edges[vertex_to], gone);
    if (list_to != NO_INDEX)
        list_join(graph, &graph->edges[list_to], &graph->edges[h / 2]);
    edge_drop(graph, h / 2);

    if (loop_has_size(graph, after_h, 2))
        drop_slit(graph, after_h);
    if (edge_is_live(graph, after_t / 2) && loop_has_size(graph, after_t, 2))
        drop_slit(graph, after_t);
    if (edge_is_live(graph, vertex_to))
        list_limit(graph, vertex_to, before[0]);
    if (list_to != vertex_to && list_to != NO_INDEX && edge_is_live(graph, list_to))
        list_limit(graph, list_to, before[1]);
    uint32_t around = graph->half_edges[graph->outgoing[kept]].patch;
    if (around == NO_PATCH)
        around = graph->half_edges[graph->outgoing[kept] ^ 1].patch;
    put_dissolved(graph, around, h / 2);
}

/* ---- merging patches ---- */

/* The half-edge before (after) which the common chain of both patches beside h begins (ends), or
 * h's own again when the chain is a closed loop. */
static uint32_t chain_first(const struct chain_graph *graph, uint32_t h)
{
    uint32_t g = h;
    while (vertex_has_two_edges(graph, graph->half_edges[g].origin)) {
        g = graph->half_edges[g].previous;
        if (g == h)
            break;
    }
    return g;
}

static uint32_t chain_last(const struct chain_graph *graph, uint32_t h)
{
    uint32_t g = h;
    while (vertex_has_two_edges(graph, half_edge_end(graph, g))) {
        g = graph->half_edges[g].next;
        if (g == h)
            break;
    }
    return g;
}

/* Does the rest of a loop, from half-edge g to before `end`, touch the other patch, in more than
 * the two vertices where it begins and ends? */
static bool rest_touches(const struct chain_graph *graph, uint32_t g, uint32_t end, uint32_t other)
{
    const struct half_edge *half_edges = graph->half_edges;
    uint32_t turns = 0;
    for (; g != end; g = half_edges[g].next) {
        uint32_t around = half_edges[g].next;
        if (half_edges[g ^ 1].patch == other)
            return true;
        if (around == end)
            break;
        for (uint32_t k = half_edge_turn(graph, around); k != around; k = half_edge_turn(graph, k))
            if (half_edges[k].patch == other || ++turns > 8 * MERGE_CORNERS_MAX)
                return true;
    }
    return false;
}

/* The merged patch is a triangle: does another with the same corners lie beyond it? Then that one
 * has all three edges. */
static bool merge_makes_double(const struct chain_graph *graph, uint32_t first, uint32_t last)
{
    const struct half_edge *half_edges = graph->half_edges;
    uint32_t patch = NO_PATCH, count = 0;
    for (int side = 0; side < 2; side++) {
        uint32_t g = side == 0 ? half_edges[last].next : half_edges[first ^ 1].next;
        uint32_t end = side == 0 ? first : last ^ 1;
        for (; g != end; g = half_edges[g].next, count++) {
            uint32_t other = half_edges[g ^ 1].patch;
            if (other == NO_PATCH || (count > 0 && other != patch))
                return false;
            patch = other;
        }
    }
    return graph->patches[patch].size == 3;
}

bool patches_can_merge(const struct chain_graph *graph, uint32_t h)
{
    const struct half_edge *half_edges = graph->half_edges;
    uint32_t left = half_edges[h].patch, right = half_edges[h ^ 1].patch, edges = 1;
    if (left == NO_PATCH || right == NO_PATCH || left == right)
        return false;
    const struct graph_patch *a = &graph->patches[left], *b = &graph->patches[right];
    if (a->size + b->size > MERGE_CORNERS_MAX)
        return false;
    uint32_t first = chain_first(graph, h), last = chain_last(graph, h);
    for (uint32_t g = first; g != last && edges < a->size; g = half_edges[g].next)
        edges++;
    if (edges + 1 > a->size || edges + 1 > b->size) /* all of a loop but at most one edge */
        return false;
    uint32_t size = a->size + b->size - 2 * edges;
    if (size < 3 || (size == 3 && merge_makes_double(graph, first, last)))
        return false;
    /* Walk the smaller loop behind the chain: none of its corners may be the other's. */
    if (a->size <= b->size)
        return !rest_touches(graph, half_edges[last].next, first, right);
    return !rest_touches(graph, half_edges[first ^ 1].next, last ^ 1, left);
}

/* The mean of both normals by area; when they cancel out, that of the larger. */
static void mix_normals(struct graph_patch *into, const struct graph_patch *from)
{
    double weight = (double)into->area, other = (double)from->area;
    if (!(weight + other > 0))
        weight = other = 1;
    struct vec3 sum = vec3_add(vec3_scale(vec3_load_float(into->normal), weight),
                               vec3_scale(vec3_load_float(from->normal), other));
    if (!(vec3_length(sum) > 1e-6 * (weight + other)))
        return;
    sum = vec3_normalized(sum);
    into->normal[0] = (float)sum.x;
    into->normal[1] = (float)sum.y;
    into->normal[2] = (float)sum.z;
}

/* Puts the shorter of two lists of dissolved edges before the other; costs its length. */
static uint32_t dissolved_join(struct chain_graph *graph, uint32_t a, uint32_t b)
{
    uint32_t end_a = a, end_b = b;
    if (a == NO_INDEX || b == NO_INDEX)
        return a == NO_INDEX ? b : a;
    for (;;) {
        uint32_t after_a = graph->half_edges[2 * end_a].next;
        uint32_t after_b = graph->half_edges[2 * end_b].next;
        if (after_a == NO_INDEX) {
            graph->half_edges[2 * end_a].next = b;
            return a;
        }
        if (after_b == NO_INDEX) {
            graph->half_edges[2 * end_b].next = a;
            return b;
        }
        end_a = after_a;
        end_b = after_b;
    }
}

/* Takes the chain's edges from `first` to `last` out; they become diagonals, each with its list and
 * the vertex behind it, for those who need a spare vertex. */
static uint32_t dissolve_chain(struct chain_graph *graph, uint32_t first, uint32_t last,
                               uint32_t dissolved)
{
    struct half_edge *half_edges = graph->half_edges;
    for (uint32_t h = first, after;; h = after) {
        after = half_edges[h].next;
        if (h != last) {
            uint32_t v = half_edge_end(graph, h);
            list_append(graph, &graph->edges[h / 2], v);
            graph->outgoing[v] = NO_INDEX;
        }
        edge_drop(graph, h / 2);
        half_edges[h & ~UINT32_C(1)].next = dissolved;
        dissolved = h / 2;
        if (h == last)
            return dissolved;
    }
}

uint32_t patches_merge(struct chain_graph *graph, uint32_t h, double deviation)
{
    struct half_edge *half_edges = graph->half_edges;
    struct graph_patch *patches = graph->patches;
    if (patches[half_edges[h].patch].size < patches[half_edges[h ^ 1].patch].size)
        h ^= 1;
    uint32_t kept = half_edges[h].patch, lost = half_edges[h ^ 1].patch;
    uint32_t first = chain_first(graph, h), last = chain_last(graph, h), edges = 1;
    struct graph_patch *into = &patches[kept], *from = &patches[lost];

    for (uint32_t g = first; g != last; g = half_edges[g].next)
        edges++;
    for (uint32_t g = half_edges[first ^ 1].next; g != (last ^ 1); g = half_edges[g].next)
        half_edges[g].patch = kept;
    uint32_t start = half_edges[first].origin, end = half_edge_end(graph, last);
    if (graph->outgoing[start] == first)
        graph->outgoing[start] = half_edge_turn(graph, first);
    if (graph->outgoing[end] == (last ^ 1))
        graph->outgoing[end] = half_edge_turn(graph, last ^ 1);
    uint32_t before_first = half_edges[first].previous, after_last = half_edges[last].next;
    uint32_t open_inside = 0;
    for (uint32_t g = first; g != last; g = half_edges[g].next)
        open_inside += !(graph->flags[half_edge_end(graph, g)] & VERTEX_JUNCTION);
    link_after(graph, before_first, half_edges[first ^ 1].next);
    link_after(graph, half_edges[last ^ 1].previous, after_last);
    into->half_edge = after_last;
    into->dissolved = dissolved_join(graph, into->dissolved, from->dissolved);
    into->dissolved = dissolve_chain(graph, first, last, into->dissolved);

    mix_normals(into, from);
    into->area += from->area;
    if (from->deviation > into->deviation)
        into->deviation = from->deviation;
    if ((float)deviation > into->deviation)
        into->deviation = (float)deviation;
    into->size += from->size - 2 * edges;
    into->open += from->open - 2 * open_inside;
    if (from->longest > into->longest)
        into->longest = from->longest;
    uint32_t after = into->member;
    into->member = from->member;
    from->member = after;
    from->dissolved = NO_INDEX;
    from->half_edge = NO_INDEX;
    graph->live_patches--;
    return kept;
}

/* ---- moving a vertex along its chain ---- */

void vertex_slide(struct chain_graph *graph, uint32_t v, uint32_t in, uint32_t out, uint32_t to)
{
    struct edge_record *records[2] = {&graph->edges[in / 2], &graph->edges[out / 2]};
    struct vec3 ends[2] = {vertex_point(graph, half_edge_end(graph, in)),
                           vertex_point(graph, half_edge_end(graph, out))};
    struct vec3 middle = vertex_point(graph, to);
    struct edge_record all = *records[0];
    list_join(graph, &all, records[1]);
    list_append(graph, &all, v);
    for (int i = 0; i < 2; i++)
        *records[i] = (struct edge_record){NO_INDEX, NO_INDEX, 0, all.slack};
    for (uint32_t w = all.first, after; w != NO_INDEX; w = after) {
        after = graph->list[w];
        if (w == to)
            continue;
        struct vec3 p = vertex_point(graph, w);
        double first = vec3_length_squared(segment_offset(p, ends[0], middle));
        double second = vec3_length_squared(segment_offset(p, middle, ends[1]));
        list_append(graph, records[second < first], w);
    }
    graph->outgoing[to] = graph->outgoing[v];
    graph->outgoing[v] = NO_INDEX;
    graph->flags[to] = graph->flags[v];
    uint32_t h = graph->outgoing[to];
    do {
        graph->half_edges[h].origin = to;
        note_length(graph, h / 2);
        h = half_edge_turn(graph, h);
    } while (h != graph->outgoing[to]);
}
