/*
 * Finding rims.
 *
 * The dissertation follows sharp chains from one to the next until they close, which needs luck
 * where more than two meet. Here the patches are joined over all chains that are not sharp; the
 * borders of the smooth regions that come out are closed loops by themselves, whatever their form.
 * A loop whose region is flat along it (the normals are those of the loop's plane, not orthogonal
 * to it) and lies outside it (the loop runs clockwise about the region's normals) is a rim: the
 * wall of a hole, bump or cavity begins there.
 *
 * This is done several times. First with the sharp angle. Then with small angles, so that planes
 * end where they bend at all: that finds the rims that are chamfered or filleted over several
 * edges, none of which is sharp by itself; the smaller angle finds the first of many steps, the
 * larger one withstands more noise. Whether what lies inside is steep is asked later
 * (topology_features.c).
 *
 * The chamfer is a part of its hole: the inner edge of a countersink, however sharp, is no rim. So
 * a loop whose flat side is a ring that is tilted towards the wall, all round and by the same
 * angle, with something flatter beyond, is looked over.
 */
#include "simplify/topology_rims.h"

#include <string.h>

#include "base/forest.h"
#include "base/memory.h"
#include "simplify/topology_splinters.h"

/* cos 10 and cos 4: beyond it a plane ends. */
static const double plane_cosines[] = {0.984807753012208, 0.99756405025982424};

/* How closely the normals along a rim must follow the loop's: sharp rims may lie on curved walls.
 */
static const double flat_sharp = 0.6, flat_plane = 0.94;

/* What widens inside of a feature has a flat side; where bores meet there is none. */
static const double flat_large = 0.8;

/* By how much the flat side must be flatter than the wall. */
static const double flat_margin = 0.1;

/* A ring is tilted if its normals lean by more than the sine of 3 degrees, everywhere by about as
 * much; what leans by the sine of 2 degrees less is flatter. */
static const double tilt_least = 0.052, tilt_spread = 0.35, tilt_same = 0.07, tilt_flatter = 0.035;
/* How much of a ring's outer edge must lead to what is flatter, and how far from the loop's middle
 * it may lie, by the loop's box. */
static const double flatter_share = 0.6, ring_reach = 1.5;

struct search {
    struct chain_graph *graph;
    const struct rim_options *options;
    const uint32_t *skip;
    struct rim_set *rims;
    float *normals;    /* of patches and their groups, as they can be believed */
    uint32_t *groups;  /* (topology_splinters.h) */
    uint32_t *regions; /* a patch: number of its region, after being a forest of joined patches */
    uint8_t *visited;  /* a half-edge */
    struct loop_points points;
    uint32_t *stamps; /* a patch: the ring that it was last found to be in */
    uint32_t rings;   /* looked at so far */
    uint32_t *ring;   /* patches of the one in hand */
    size_t ring_count, ring_capacity;
};

/* ---- smooth regions ---- */

static bool is_smooth(const struct search *search, uint32_t edge, double least, double most)
{
    const struct half_edge *h = &search->graph->half_edges[2 * (size_t)edge];
    if (h[0].patch == NO_PATCH || h[1].patch == NO_PATCH)
        return false;
    double cosine = vec3_dot(vec3_load_float(search->normals + 3 * (size_t)h[0].patch),
                             vec3_load_float(search->normals + 3 * (size_t)h[1].patch));
    return search->groups[h[0].patch] == search->groups[h[1].patch] || cosine >= least ||
           cosine < most;
}

static void find_regions(struct search *search, double least, double most)
{
    struct chain_graph *graph = search->graph;
    for (uint32_t p = 0; p < graph->patch_count; p++)
        search->regions[p] = p;
    for (uint32_t e = 0; e < graph->edge_count; e++)
        if (is_smooth(search, e, least, most))
            forest_join(search->regions, graph->half_edges[2 * (size_t)e].patch,
                        graph->half_edges[2 * (size_t)e + 1].patch);
    for (uint32_t p = 0; p < graph->patch_count; p++)
        search->regions[p] = forest_root(search->regions, p);
}

/* ---- loops ---- */

static bool box_exceeds(const struct surface_loop *loop, double size)
{
    for (unsigned c = 0; c < 3; c++)
        if (loop->high[c] - loop->low[c] >= size)
            return true;
    return false;
}

static enum status keep_large(struct search *search, const struct surface_loop *loop)
{
    struct rim_set *rims = search->rims;
    enum status status = memory_reserve(search->graph->ctx, &rims->large, &rims->large_capacity,
                                        rims->large_count + 1, sizeof *rims->large);
    if (status == STATUS_OK)
        rims->large[rims->large_count++] = (struct large_loop){loop->first, loop->normal};
    return status;
}

static void mark_rim(struct search *search, const struct surface_loop *loop, bool is_sharp)
{
    double flat = -loop->flat_left > 1 ? 1 : -loop->flat_left;
    uint8_t strength = (uint8_t)(flat * 100 + (is_sharp ? 100 : 1));
    search->rims->rim_count++;
    for (uint32_t i = 0; i < search->points.count; i++) {
        uint8_t *mark = search->rims->strength + search->points.half_edges[i];
        *mark = strength > *mark ? strength : *mark;
    }
}

/* ---- chamfers ---- */

/* By how much the normals on both sides, left and right, lean away from the loop's middle. */
struct lean {
    double mean[2];
    double spread[2]; /* mean difference from it */
};

static double lean_of(const struct search *search, const struct surface_loop *loop, uint32_t h,
                      uint32_t side, double *length)
{
    const struct chain_graph *graph = search->graph;
    struct vec3 along = vec3_sub(vertex_point(graph, half_edge_end(graph, h)),
                                 vertex_point(graph, graph->half_edges[h].origin));
    uint32_t patch = graph->half_edges[side].patch;
    *length = vec3_length(along);
    /* The loop's normal points into the surface, the flat side is on the left: outside. */
    struct vec3 outward = vec3_normalized(vec3_cross(along, loop->normal));
    return patch == NO_PATCH
               ? 0
               : vec3_dot(vec3_load_float(search->normals + 3 * (size_t)patch), outward);
}

static struct lean find_lean(const struct search *search, const struct surface_loop *loop)
{
    struct lean lean = {{0, 0}, {0, 0}};
    const double share = loop->length > 0 ? 1 / loop->length : 0;
    double length;
    for (uint32_t i = 0; i < search->points.count; i++)
        for (uint32_t side = 0; side < 2; side++) {
            uint32_t h = search->points.half_edges[i];
            double own = lean_of(search, loop, h, h ^ side, &length);
            lean.mean[side] += share * own * length;
        }
    for (uint32_t i = 0; i < search->points.count; i++)
        for (uint32_t side = 0; side < 2; side++) {
            uint32_t h = search->points.half_edges[i];
            double off = fabs(lean_of(search, loop, h, h ^ side, &length) - lean.mean[side]);
            lean.spread[side] += share * off * length;
        }
    return lean;
}

/* In planes noise makes loops, too; but what lies inside of those leans here so and there so. */
static bool is_bent(const struct lean *lean)
{
    double bend = fabs(lean->mean[1] - lean->mean[0]);
    return bend >= tilt_least && bend >= 2 * lean->spread[1];
}

/* Sine of the angle between a patch's normal and the loop's. */
static double tilt_of(const struct search *search, const struct surface_loop *loop, uint32_t patch)
{
    double cosine = vec3_dot(patch_normal(search->graph, patch), loop->normal);
    return cosine * cosine < 1 ? sqrt(1 - cosine * cosine) : 0;
}

static enum status add_to_ring(struct search *search, uint32_t patch)
{
    if (search->stamps[patch] == search->rings)
        return STATUS_OK;
    enum status status = memory_reserve(search->graph->ctx, &search->ring, &search->ring_capacity,
                                        search->ring_count + 1, sizeof *search->ring);
    if (status != STATUS_OK)
        return status;
    search->stamps[patch] = search->rings;
    search->ring[search->ring_count++] = patch;
    return STATUS_OK;
}

/* What lies beyond the edges of a ring: lengths. */
struct beyond {
    double flatter, other;
    bool is_far; /* it reaches too far out to be one */
};

/* Looks over the edges of one patch of the ring, which grows by neighbours of the same tilt. */
static enum status widen_ring(struct search *search, const struct surface_loop *loop, double tilt,
                              uint32_t patch, struct beyond *beyond)
{
    const struct chain_graph *graph = search->graph;
    const double reach = ring_reach * vec3_distance(vec3_load(loop->low), vec3_load(loop->high));
    uint32_t first = graph->patches[patch].half_edge, h = first;
    enum status status = STATUS_OK;
    do {
        struct vec3 from = vertex_point(graph, graph->half_edges[h].origin);
        double length = vec3_distance(from, vertex_point(graph, half_edge_end(graph, h)));
        uint32_t other = graph->half_edges[h ^ 1].patch;
        double there = other == NO_PATCH ? 1 : tilt_of(search, loop, other);
        beyond->is_far |= vec3_distance(from, loop->centre) > reach;
        if (other != NO_PATCH && fabs(there - tilt) <= tilt_same)
            status = add_to_ring(search, other);
        else if (there < tilt - tilt_flatter)
            beyond->flatter += length;
        else
            beyond->other += length;
        h = graph->half_edges[h].next;
    } while (h != first && status == STATUS_OK);
    return status;
}

/* Is the flat side of the loop in hand a chamfer, or a step of a fillet, of what lies inside? */
static enum status find_chamfer(struct search *search, const struct surface_loop *loop,
                                const struct lean *lean, bool *is_chamfer)
{
    const struct chain_graph *graph = search->graph;
    struct beyond beyond = {0, 0, false};
    enum status status = STATUS_OK;
    *is_chamfer = false;
    if (fabs(lean->mean[0]) < tilt_least || lean->mean[0] * lean->mean[1] <= 0 ||
        lean->spread[0] > tilt_spread * fabs(lean->mean[0]))
        return STATUS_OK;
    search->rings++;
    search->ring_count = 0;
    for (uint32_t i = 0; i < search->points.count && status == STATUS_OK; i++)
        status = add_to_ring(search, graph->half_edges[search->points.half_edges[i]].patch);
    for (size_t i = 0; i < search->ring_count && status == STATUS_OK && !beyond.is_far; i++)
        status = widen_ring(search, loop, fabs(lean->mean[0]), search->ring[i], &beyond);
    beyond.other -= loop->length; /* which leads to the wall */
    *is_chamfer = !beyond.is_far && beyond.flatter > 0 &&
                  beyond.flatter >= flatter_share * (beyond.flatter + beyond.other);
    return status;
}

static enum status judge_loop(struct search *search, uint32_t first, bool is_sharp)
{
    struct chain_graph *graph = search->graph;
    struct surface_loop loop;
    double size = 0;
    enum status status = loop_trace(graph, search->regions, first, &search->points, &loop);
    if (status != STATUS_OK)
        return status;
    for (uint32_t i = 0; i < search->points.count; i++)
        search->visited[search->points.half_edges[i]] = 1;
    bool is_large = box_exceeds(&loop, search->options->size);
    if (!is_large) {
        status =
            loop_size(graph->ctx, &search->points, search->options->measure, loop.normal, &size);
        is_large = size >= search->options->size;
    }
    if (status != STATUS_OK)
        return status;
    if (is_large) {
        bool is_flat = fmax(fabs(loop.flat_left), fabs(loop.flat_right)) >= flat_large;
        return is_sharp && is_flat ? keep_large(search, &loop) : STATUS_OK;
    }
    double flat = is_sharp ? flat_sharp : flat_plane;
    bool is_chamfer = false;
    if (-loop.flat_left < flat ||
        (is_sharp && -loop.flat_left < fabs(loop.flat_right) + flat_margin))
        return STATUS_OK;
    const struct lean lean = find_lean(search, &loop);
    if (!is_sharp && !is_bent(&lean))
        return STATUS_OK;
    status = find_chamfer(search, &loop, &lean, &is_chamfer);
    if (!is_chamfer)
        mark_rim(search, &loop, is_sharp);
    return status;
}

static enum status judge_loops(struct search *search, bool is_sharp)
{
    struct chain_graph *graph = search->graph;
    enum status status = STATUS_OK;
    memset(search->visited, 0, 2 * (size_t)graph->edge_count);
    for (uint32_t h = 0; h < 2 * graph->edge_count && status == STATUS_OK; h++) {
        uint32_t left = class_of(graph, search->regions, h);
        if (left == NO_CLASS || search->visited[h] ||
            search->skip[graph->half_edges[h].patch] != NO_INDEX ||
            left == class_of(graph, search->regions, h ^ 1))
            continue;
        status = judge_loop(search, h, is_sharp);
    }
    return status;
}

static uint32_t longest_side(const struct chain_graph *graph, uint32_t h, double *longest)
{
    uint32_t best = h;
    *longest = -1;
    for (uint32_t k = 0; k < 3; k++, h = graph->half_edges[h].next) {
        double length = vec3_distance(vertex_point(graph, graph->half_edges[h].origin),
                                      vertex_point(graph, half_edge_end(graph, h)));
        if (length > *longest || (length == *longest && h < best)) {
            *longest = length;
            best = h;
        }
    }
    return best;
}

/* A triangle cut off all round has nothing inside: it goes back to its neighbour over the longest
 * side. */
static void heal_triangles(struct search *search)
{
    struct chain_graph *graph = search->graph;
    for (uint32_t p = 0; p < graph->patch_count; p++) {
        uint32_t h = graph->patches[p].half_edge;
        double longest;
        bool is_cut = graph->patches[p].size == 3;
        for (uint32_t k = 0; k < 3 && is_cut; k++, h = graph->half_edges[h].next)
            is_cut = rim_flat_side(search->rims, h / 2) != NO_INDEX;
        if (!is_cut)
            continue;
        uint32_t side = longest_side(graph, h, &longest);
        search->rims->strength[side] = search->rims->strength[side ^ 1] = 0;
    }
}

enum status rims_find(struct chain_graph *graph, const struct rim_options *options,
                      const uint32_t *skip, struct rim_set *rims)
{
    struct context *ctx = graph->ctx;
    struct search search = {.graph = graph, .options = options, .skip = skip, .rims = rims};
    size_t half_edges = 2 * (size_t)graph->edge_count;
    rims->half_edge_count = half_edges;
    enum status status = memory_take_zeroed(ctx, half_edges, 1, &rims->strength);
    if (status == STATUS_OK)
        status = memory_take(ctx, half_edges, 1, &search.visited);
    if (status == STATUS_OK)
        status = memory_take(ctx, graph->patch_count, sizeof *search.regions, &search.regions);
    if (status == STATUS_OK)
        status = memory_take(ctx, graph->patch_count, 3 * sizeof *search.normals, &search.normals);
    if (status == STATUS_OK)
        status = memory_take(ctx, graph->patch_count, sizeof *search.groups, &search.groups);
    if (status == STATUS_OK)
        status = splinters_join(graph, options->noise, search.normals, search.groups);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, graph->patch_count, sizeof *search.stamps, &search.stamps);
    if (status == STATUS_OK) {
        find_regions(&search, options->sharp_cosine[0], options->sharp_cosine[1]);
        status = judge_loops(&search, true);
    }
    for (unsigned i = 0; i < 2 && status == STATUS_OK; i++) {
        find_regions(&search, plane_cosines[i], -2);
        status = judge_loops(&search, false);
    }
    if (status == STATUS_OK)
        heal_triangles(&search);
    loop_points_clear(ctx, &search.points);
    memory_release(ctx, &search.visited, half_edges, 1);
    memory_release(ctx, &search.regions, graph->patch_count, sizeof *search.regions);
    memory_release(ctx, &search.normals, graph->patch_count, 3 * sizeof *search.normals);
    memory_release(ctx, &search.groups, graph->patch_count, sizeof *search.groups);
    memory_release(ctx, &search.stamps, graph->patch_count, sizeof *search.stamps);
    memory_release(ctx, &search.ring, search.ring_capacity, sizeof *search.ring);
    return status;
}

void rim_set_clear(struct context *ctx, struct rim_set *rims)
{
    memory_release(ctx, &rims->strength, rims->half_edge_count, 1);
    memory_release(ctx, &rims->large, rims->large_capacity, sizeof *rims->large);
    memset(rims, 0, sizeof *rims);
}
