/*
 * Bridges (Eberly, "Triangulation by ear clipping").
 *
 * Holes are taken rightmost first. The ray to the right from a hole's rightmost corner meets an
 * edge of the polygon so far; the edge's right end is seen from there, unless a corner lies in the
 * triangle between; then it is the one nearest in angle to the ray.
 *
 * To ask all edges for each hole is quadratic: a plate can have many thousands. So the plane is cut
 * into bands of equal height, as many as keep the edges in few bands each, and only the edges of
 * the ray's band are asked, and the corners of the triangle's. The polygon is a linked list; a
 * corner that a bridge comes to is doubled by a new one before it, so that its edge stays its own.
 */
#include "simplify/topology_bridges.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "mesh/corner.h"

/* Bands that an edge reaches on average, at most. */
enum { BANDS_AN_EDGE = 4 };

struct bridge_node {
    double x, y;
    uint32_t vertex;
    uint32_t next, previous;
};

struct hole_start {
    double x;      /* of its rightmost corner */
    uint32_t node; /* that one */
    uint32_t loop;
};

struct band_entry {
    uint32_t node; /* a corner, or the edge that begins there */
    uint32_t next;
};

void bridge_workspace_clear(struct context *ctx, struct bridge_workspace *space)
{
    memory_release(ctx, &space->nodes, space->node_capacity, sizeof *space->nodes);
    memory_release(ctx, &space->holes, space->hole_capacity, sizeof *space->holes);
    memory_release(ctx, &space->edge_bands, space->edge_band_capacity, sizeof *space->edge_bands);
    memory_release(ctx, &space->corner_bands, space->corner_band_capacity,
                   sizeof *space->corner_bands);
    memory_release(ctx, &space->entries, space->entry_capacity, sizeof *space->entries);
    memset(space, 0, sizeof *space);
}

/* ---- bands ---- */

static uint32_t band_of(const struct bridge_workspace *space, double y)
{
    double band = (y - space->low) * space->scale;
    if (!(band > 0))
        return 0;
    return band < (double)space->band_count ? (uint32_t)band : space->band_count - 1;
}

/* So many bands that all edges together reach into a few times as many as they are. */
static enum status choose_bands(struct context *ctx, struct bridge_workspace *space)
{
    double low = INFINITY, high = -INFINITY, heights = 0;
    for (size_t i = 0; i < space->node_count; i++) {
        const struct bridge_node *node = &space->nodes[i];
        low = node->y < low ? node->y : low;
        high = node->y > high ? node->y : high;
        heights += fabs(space->nodes[node->next].y - node->y);
    }
    double count = (double)space->node_count, span = high - low;
    double bands = heights > 0 ? BANDS_AN_EDGE * count * span / heights : 1;
    bands = bands < count ? bands : count;
    space->band_count = bands > 1 ? (uint32_t)bands : 1;
    space->low = low;
    space->scale = span > 0 ? (double)space->band_count / span : 0;
    space->entry_count = 0;
    enum status status = memory_reserve(ctx, &space->edge_bands, &space->edge_band_capacity,
                                        space->band_count, sizeof *space->edge_bands);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &space->corner_bands, &space->corner_band_capacity,
                                space->band_count, sizeof *space->corner_bands);
    if (status == STATUS_OK) {
        memset(space->edge_bands, 0xff, space->band_count * sizeof *space->edge_bands);
        memset(space->corner_bands, 0xff, space->band_count * sizeof *space->corner_bands);
    }
    return status;
}

static enum status add_entry(struct context *ctx, struct bridge_workspace *space, uint32_t *first,
                             uint32_t node)
{
    enum status status = memory_reserve(ctx, &space->entries, &space->entry_capacity,
                                        space->entry_count + 1, sizeof *space->entries);
    if (status == STATUS_OK) {
        space->entries[space->entry_count] = (struct band_entry){node, *first};
        *first = (uint32_t)space->entry_count++;
    }
    return status;
}

/* A corner and the edge that begins there become part of the polygon. The inside is left of it: the
 * edges that a ray to the right meets from inside go up, and no others are listed. */
static enum status list_node(struct context *ctx, struct bridge_workspace *space, uint32_t i)
{
    const struct bridge_node *node = &space->nodes[i], *end = &space->nodes[node->next];
    enum status status = add_entry(ctx, space, &space->corner_bands[band_of(space, node->y)], i);
    if (!(end->y > node->y))
        return status;
    uint32_t last = band_of(space, end->y);
    for (uint32_t band = band_of(space, node->y); band <= last && status == STATUS_OK; band++)
        status = add_entry(ctx, space, &space->edge_bands[band], i);
    return status;
}

/* ---- what a corner sees ---- */

static double turn_of(const struct bridge_node *a, const struct bridge_node *b,
                      const struct bridge_node *c)
{
    return (b->x - a->x) * (c->y - a->y) - (b->y - a->y) * (c->x - a->x);
}

/* Does m lie in the corner at a node? The doubles of a corner differ in this. */
static bool corner_sees(const struct bridge_workspace *space, const struct bridge_node *q,
                        const struct bridge_node *m)
{
    const struct bridge_node *before = &space->nodes[q->previous], *after = &space->nodes[q->next];
    bool is_reflex = turn_of(before, q, after) < 0;
    bool left_of_before = turn_of(before, q, m) > 0, left_of_after = turn_of(q, after, m) > 0;
    return is_reflex ? left_of_before || left_of_after : left_of_before && left_of_after;
}

/* The right end of the edge that the ray from m meets first, where it meets it in *hit. NO_INDEX:
 * there is none. */
static uint32_t find_edge(const struct bridge_workspace *space, const struct bridge_node *m,
                          struct bridge_node *hit)
{
    uint32_t best = NO_INDEX;
    *hit = (struct bridge_node){.x = INFINITY, .y = m->y};
    for (uint32_t e = space->edge_bands[band_of(space, m->y)]; e != NO_INDEX;
         e = space->entries[e].next) {
        uint32_t node = space->entries[e].node;
        const struct bridge_node *a = &space->nodes[node], *b = &space->nodes[a->next];
        if (!(a->y <= m->y && b->y > m->y))
            continue;
        double x = a->x + (b->x - a->x) * (m->y - a->y) / (b->y - a->y);
        uint32_t end = a->x > b->x ? node : a->next;
        if (x >= m->x && (x < hit->x || (x == hit->x && end < best))) {
            hit->x = x;
            best = end;
        }
    }
    return best;
}

static uint32_t find_bridge(const struct bridge_workspace *space, const struct bridge_node *m)
{
    struct bridge_node hit;
    uint32_t end = find_edge(space, m, &hit), chosen = end;
    if (end == NO_INDEX)
        return NO_INDEX;
    const struct bridge_node *p = &space->nodes[end];
    double least = INFINITY, nearest = INFINITY;
    bool is_above = p->y > m->y;
    uint32_t low = band_of(space, is_above ? m->y : p->y);
    uint32_t high = band_of(space, is_above ? p->y : m->y);
    for (uint32_t band = low; band <= high; band++)
        for (uint32_t e = space->corner_bands[band]; e != NO_INDEX; e = space->entries[e].next) {
            uint32_t i = space->entries[e].node;
            const struct bridge_node *q = &space->nodes[i];
            if (q->x <= m->x)
                continue;
            double x = turn_of(m, &hit, q), y = turn_of(&hit, p, q), z = turn_of(p, m, q);
            if (!(is_above ? x >= 0 && y >= 0 && z >= 0 : x <= 0 && y <= 0 && z <= 0) ||
                !corner_sees(space, q, m))
                continue;
            double far = q->x - m->x, slope = fabs(q->y - m->y) / far;
            bool is_better = slope < least ||
                             (slope == least && (far < nearest || (far == nearest && i < chosen)));
            if (is_better) {
                least = slope;
                nearest = far;
                chosen = i;
            }
        }
    return chosen;
}

/* ---- the polygon ---- */

static int compare_holes(const void *a, const void *b)
{
    const struct hole_start *x = a, *y = b;
    if (x->x != y->x)
        return x->x > y->x ? -1 : 1;
    return x->loop < y->loop ? -1 : x->loop > y->loop;
}

/* Nodes of all loops, each closed by itself, and the holes in order. */
static enum status make_nodes(struct context *ctx, struct bridge_workspace *space,
                              const struct outline_corner *corners, const uint32_t *starts,
                              uint32_t loop_count)
{
    uint32_t holes = loop_count - 1;
    enum status status =
        memory_reserve(ctx, &space->nodes, &space->node_capacity,
                       (size_t)starts[loop_count] + 2 * (size_t)holes, sizeof *space->nodes);
    if (status == STATUS_OK)
        status =
            memory_reserve(ctx, &space->holes, &space->hole_capacity, holes, sizeof *space->holes);
    if (status != STATUS_OK)
        return status;
    space->node_count = starts[loop_count];
    for (uint32_t loop = 0; loop < loop_count; loop++) {
        uint32_t first = starts[loop], end = starts[loop + 1], rightmost = first;
        for (uint32_t i = first; i < end; i++) {
            space->nodes[i] = (struct bridge_node){.x = corners[i].x,
                                                   .y = corners[i].y,
                                                   .vertex = corners[i].vertex,
                                                   .next = i + 1 == end ? first : i + 1,
                                                   .previous = (i == first ? end : i) - 1};
            rightmost = corners[i].x > corners[rightmost].x ? i : rightmost;
        }
        if (loop > 0)
            space->holes[loop - 1] = (struct hole_start){corners[rightmost].x, rightmost, loop};
    }
    if (holes > 1)
        qsort(space->holes, holes, sizeof *space->holes, compare_holes);
    return STATUS_OK;
}

/* A double of a node, before it in the list. */
static uint32_t double_node(struct bridge_workspace *space, uint32_t i)
{
    uint32_t made = (uint32_t)space->node_count++;
    space->nodes[made] = space->nodes[i];
    space->nodes[made].next = i;
    space->nodes[space->nodes[i].previous].next = made;
    space->nodes[i].previous = made;
    return made;
}

/* Joins the loop of node m to the polygon at node j. */
static enum status join_hole(struct context *ctx, struct bridge_workspace *space, uint32_t m,
                             uint32_t j)
{
    struct bridge_node *nodes = space->nodes; /* there is room for all */
    uint32_t way_in = double_node(space, j), way_out = double_node(space, m);
    enum status status = STATUS_OK;
    /* ... way_in -> m ... way_out -> j ... */
    nodes[way_in].next = m;
    nodes[m].previous = way_in;
    nodes[way_out].next = j;
    nodes[j].previous = way_out;
    status = list_node(ctx, space, way_in);
    for (uint32_t i = m; i != j && status == STATUS_OK; i = nodes[i].next)
        status = list_node(ctx, space, i);
    return status;
}

enum status bridge_holes(struct context *ctx, struct bridge_workspace *space,
                         const struct outline_corner *corners, const uint32_t *starts,
                         uint32_t loop_count, const struct pair_set *taken, uint32_t *polygon,
                         bool *possible)
{
    enum status status = make_nodes(ctx, space, corners, starts, loop_count);
    *possible = true;
    if (status == STATUS_OK)
        status = choose_bands(ctx, space);
    for (uint32_t i = 0; i < starts[1] && status == STATUS_OK; i++)
        status = list_node(ctx, space, i);
    for (uint32_t i = 0; i + 1 < loop_count && *possible && status == STATUS_OK; i++) {
        uint32_t m = space->holes[i].node, vertex = space->nodes[m].vertex;
        uint32_t bridge = find_bridge(space, &space->nodes[m]);
        *possible = bridge != NO_INDEX && space->nodes[bridge].vertex != vertex &&
                    !pair_set_has(taken, space->nodes[bridge].vertex, vertex);
        if (*possible)
            status = join_hole(ctx, space, m, bridge);
    }
    for (size_t i = 0, at = 0; i < space->node_count && *possible && status == STATUS_OK; i++) {
        polygon[i] = space->nodes[at].vertex;
        at = space->nodes[at].next;
    }
    return status;
}
