/*
 * Splinters.
 *
 * A triangle that is narrower than the noise of the vertices may face anywhere. Its place tells
 * more than its normal: it lies in the surface that is beyond its long sides, for the splinters of
 * a plane fan out from its corners, and an edge that bends is seldom longer than both surfaces are
 * wide. So splinters are joined to what lies beyond their sides, longest sides first, until the
 * group has a patch that is none, or is wide enough itself, as the wall of a thin bore is.
 */
#include "simplify/topology_splinters.h"

#include <stdlib.h>

#include "base/forest.h"
#include "base/memory.h"

/* Width of a splinter by its length, at most. */
static const double thin_share = 0.1;

struct side {
    double length;
    uint32_t edge;
};

/* Normals of a group that lean by more than this cosine from their mean are not believed, if that
 * is at least so long. */
static const double agreeing = 0.7, mean_least = 0.5;

/* What is known of a group, at the root of its tree. */
struct group {
    double area, outline; /* of the splinters in it, and the length of their border */
    struct vec3 sum;      /* of normals, by area */
    uint32_t model;       /* a patch in it that is no splinter, or NO_INDEX */
};

struct joiner {
    const struct chain_graph *graph;
    double noise;
    struct group *groups;
    uint32_t *parents; /* a forest of patches */
    struct side *sides;
    size_t side_count, side_capacity;
};

static double edge_length(const struct chain_graph *graph, uint32_t h)
{
    return vec3_distance(vertex_point(graph, graph->half_edges[h].origin),
                         vertex_point(graph, half_edge_end(graph, h)));
}

static bool is_wide(const struct joiner *joiner, double area, double outline)
{
    double length = outline / 2, width = length > 0 ? 2 * area / length : 0;
    return width >= joiner->noise || width >= thin_share * length;
}

static void begin_group(struct joiner *joiner, uint32_t patch)
{
    const struct chain_graph *graph = joiner->graph;
    const double area = (double)graph->patches[patch].area;
    struct group *group = &joiner->groups[patch];
    uint32_t first = graph->patches[patch].half_edge, h = first;
    *group = (struct group){
        .area = area, .sum = vec3_scale(patch_normal(graph, patch), area), .model = NO_INDEX};
    do {
        group->outline += edge_length(graph, h);
        h = graph->half_edges[h].next;
    } while (h != first);
    if (is_wide(joiner, area, group->outline))
        group->model = patch;
}

static int compare_sides(const void *a, const void *b)
{
    const struct side *x = a, *y = b;
    if (x->length != y->length)
        return x->length > y->length ? -1 : 1;
    return x->edge < y->edge ? -1 : x->edge > y->edge;
}

static enum status list_sides(struct joiner *joiner)
{
    const struct chain_graph *graph = joiner->graph;
    for (uint32_t e = 0; e < graph->edge_count; e++) {
        uint32_t a = graph->half_edges[2 * (size_t)e].patch;
        uint32_t b = graph->half_edges[2 * (size_t)e + 1].patch;
        if (a == NO_PATCH || b == NO_PATCH ||
            (joiner->groups[a].model == a && joiner->groups[b].model == b))
            continue;
        enum status status = memory_reserve(graph->ctx, &joiner->sides, &joiner->side_capacity,
                                            joiner->side_count + 1, sizeof *joiner->sides);
        if (status != STATUS_OK)
            return status;
        joiner->sides[joiner->side_count++] = (struct side){edge_length(graph, 2 * e), e};
    }
    return STATUS_OK;
}

/* True when nothing need be joined to the group any more. */
static bool is_settled(const struct joiner *joiner, const struct group *group)
{
    return group->model != NO_INDEX || is_wide(joiner, group->area, group->outline);
}

static void join_side(struct joiner *joiner, const struct side *side)
{
    const struct half_edge *h = &joiner->graph->half_edges[2 * (size_t)side->edge];
    uint32_t a = forest_root(joiner->parents, h[0].patch);
    uint32_t b = forest_root(joiner->parents, h[1].patch);
    struct group *one = &joiner->groups[a], *other = &joiner->groups[b];
    if (a == b) {
        one->outline -= 2 * side->length;
        return;
    }
    if (is_settled(joiner, one) && is_settled(joiner, other))
        return;
    const struct group both = {.area = one->area + other->area,
                               .outline = one->outline + other->outline - 2 * side->length,
                               .sum = vec3_add(one->sum, other->sum),
                               .model = one->model != NO_INDEX ? one->model : other->model};
    forest_join(joiner->parents, a, b);
    joiner->groups[forest_root(joiner->parents, a)] = both;
}

/* The normal of a splinter in a group. */
static struct vec3 choose_normal(const struct joiner *joiner, uint32_t patch,
                                 const struct group *group)
{
    struct vec3 own = patch_normal(joiner->graph, patch);
    if (group->model != NO_INDEX)
        return patch_normal(joiner->graph, group->model);
    struct vec3 mean = vec3_normalized(group->sum);
    bool is_alone = vec3_length(group->sum) < mean_least * group->area;
    return is_alone || vec3_dot(mean, own) >= agreeing ? own : mean;
}

static void give_normals(const struct joiner *joiner, const uint8_t *is_thin, float *normals,
                         uint32_t *groups)
{
    for (uint32_t p = 0; p < joiner->graph->patch_count; p++) {
        uint32_t root = forest_root(joiner->parents, p);
        struct vec3 normal = is_thin[p] ? choose_normal(joiner, p, &joiner->groups[root])
                                        : patch_normal(joiner->graph, p);
        normals[3 * (size_t)p] = (float)normal.x;
        normals[3 * (size_t)p + 1] = (float)normal.y;
        normals[3 * (size_t)p + 2] = (float)normal.z;
        groups[p] = root;
    }
}

enum status splinters_join(struct chain_graph *graph, double noise, float *normals,
                           uint32_t *groups)
{
    struct context *ctx = graph->ctx;
    struct joiner joiner = {.graph = graph, .noise = noise, .parents = groups};
    const uint32_t patches = graph->patch_count;
    uint8_t *is_thin = NULL;
    enum status status = memory_take(ctx, patches, 1, &is_thin);
    if (status == STATUS_OK)
        status = memory_take(ctx, patches, sizeof *joiner.groups, &joiner.groups);
    for (uint32_t p = 0; p < patches && status == STATUS_OK; p++) {
        groups[p] = p;
        begin_group(&joiner, p);
        is_thin[p] = joiner.groups[p].model == NO_INDEX;
    }
    if (status == STATUS_OK)
        status = list_sides(&joiner);
    if (status == STATUS_OK && joiner.side_count > 0)
        qsort(joiner.sides, joiner.side_count, sizeof *joiner.sides, compare_sides);
    for (size_t i = 0; i < joiner.side_count && status == STATUS_OK; i++)
        join_side(&joiner, &joiner.sides[i]);
    if (status == STATUS_OK)
        give_normals(&joiner, is_thin, normals, groups);
    memory_release(ctx, &is_thin, patches, 1);
    memory_release(ctx, &joiner.groups, patches, sizeof *joiner.groups);
    memory_release(ctx, &joiner.sides, joiner.side_capacity, sizeof *joiner.sides);
    return status;
}
