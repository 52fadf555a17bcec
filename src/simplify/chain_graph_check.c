/*
 * Looking at the chain graph: is it one, what is joined to what, and what would the chains be at
 * any tolerance.
 *
 * Whether a graph is a surface is usually asked of sorted edges. Here all is local and linear:
 * every loop is walked once and every vertex turned round once, with an array that remembers who
 * came by last. Questions about two vertices, or a vertex and a patch, walk round both at the same
 * time and end with the shorter way.
 */
#include "simplify/chain_graph.h"

#include <string.h>

#include "base/memory.h"
#include "simplify/chain_simplify.h"

/* ---- verification ---- */

/* G1 for one patch. `seen` tells for every vertex the patch that last came by, plus 1. */
static enum status check_loop(const struct chain_graph *graph, uint32_t patch, uint32_t *seen)
{
    uint32_t first = graph->patches[patch].half_edge, h = first, size = 0;
    if (first == NO_INDEX)
        return STATUS_OK;
    do {
        const struct half_edge *half_edge = &graph->half_edges[h];
        if (half_edge->patch != patch || seen[half_edge->origin] == patch + 1 ||
            graph->half_edges[half_edge->next].origin != half_edge_end(graph, h) ||
            graph->half_edges[half_edge->next].previous != h)
            return fail(graph->ctx, STATUS_BAD_INPUT, "the boundary of patch %u is not one loop",
                        patch);
        seen[half_edge->origin] = patch + 1;
        size++;
        h = half_edge->next;
    } while (h != first);
    if (size < 3 || size != graph->patches[patch].size)
        return fail(graph->ctx, STATUS_BAD_INPUT, "patch %u has several loops, or one of %u edges",
                    patch, size);
    return STATUS_OK;
}

/* G2 and G3 for one vertex. `degrees`: half-edges that start there. */
static enum status check_star(const struct chain_graph *graph, uint32_t v, const uint32_t *degrees,
                              uint32_t *seen)
{
    uint32_t first = graph->outgoing[v], h = first, degree = 0, borders = 0;
    if (first == NO_INDEX)
        return STATUS_OK;
    do {
        uint32_t end = half_edge_end(graph, h);
        if (end == v || seen[end] == v + 1)
            return fail(graph->ctx, STATUS_BAD_INPUT,
                        "two chain edges run between the same two vertices");
        seen[end] = v + 1;
        borders += graph->half_edges[h].patch == NO_PATCH;
        degree++;
        h = half_edge_turn(graph, h);
    } while (h != first && degree <= degrees[v]);
    if (degree != degrees[v] || borders > 1 || degree < 2 ||
        (borders == 1 && graph->half_edges[first].patch != NO_PATCH))
        return fail(graph->ctx, STATUS_BAD_INPUT,
                    "the patches at a chain vertex do not lie round it in one turn");
    return STATUS_OK;
}

enum status chain_graph_check(struct chain_graph *graph)
{
    struct context *ctx = graph->ctx;
    size_t vertices = graph->vertex_count;
    uint32_t *seen = NULL, *degrees = NULL;
    enum status status = memory_take_zeroed(ctx, vertices, sizeof *seen, &seen);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, vertices, sizeof *degrees, &degrees);
    /* Loops are walked only when every link is known to lead back. */
    for (uint32_t h = 0; h < 2 * graph->edge_count && status == STATUS_OK; h++) {
        const struct half_edge *half_edge = &graph->half_edges[h];
        if (!edge_is_live(graph, h / 2))
            continue;
        if (half_edge->next == NO_INDEX || half_edge->previous == NO_INDEX ||
            graph->half_edges[half_edge->previous].next != h ||
            graph->half_edges[half_edge->next].origin != half_edge_end(graph, h))
            status = fail(ctx, STATUS_BAD_INPUT, "a chain edge is not continued on both sides");
        degrees[half_edge->origin]++;
    }
    for (uint32_t i = 0; i < graph->patch_count && status == STATUS_OK; i++)
        if (graph->patches[i].half_edge == NO_INDEX && graph->live_patches == graph->patch_count)
            status = fail(ctx, STATUS_BAD_INPUT, "patch %u has no chains", i);
        else
            status = check_loop(graph, i, seen);
    if (status == STATUS_OK)
        memset(seen, 0, vertices * sizeof *seen);
    for (uint32_t v = 0; v < vertices && status == STATUS_OK; v++)
        status = check_star(graph, v, degrees, seen);
    memory_release(ctx, &seen, vertices, sizeof *seen);
    memory_release(ctx, &degrees, vertices, sizeof *degrees);
    return status;
}

/* ---- what others ask ---- */

bool vertices_joined(const struct chain_graph *graph, uint32_t a, uint32_t b)
{
    uint32_t first = graph->outgoing[a], other_first = graph->outgoing[b];
    uint32_t h = first, other = other_first;
    do {
        if (half_edge_end(graph, h) == b)
            return true;
        h = half_edge_turn(graph, h);
        other = half_edge_turn(graph, other);
    } while (h != first && other != other_first);
    if (h == first)
        return false;
    /* The turn round b ended first; its edges have not been looked at. */
    other = other_first;
    do {
        if (half_edge_end(graph, other) == a)
            return true;
        other = half_edge_turn(graph, other);
    } while (other != other_first);
    return false;
}

bool patch_has_corner(const struct chain_graph *graph, uint32_t patch, uint32_t vertex)
{
    uint32_t first = graph->outgoing[vertex], h = first;
    uint32_t loop_first = graph->patches[patch].half_edge, loop = loop_first;
    do {
        if (graph->half_edges[h].patch == patch || graph->half_edges[loop].origin == vertex)
            return true;
        h = half_edge_turn(graph, h);
        loop = graph->half_edges[loop].next;
    } while (h != first && loop != loop_first);
    return false;
}

/* ---- halving errors ---- */

struct chain_room {
    float *positions, *errors;
    size_t position_capacity, error_capacity;
};

static enum status chain_errors_of(struct chain_graph *graph, uint32_t first, uint32_t end,
                                   struct chain_room *room, bool priced, float *errors)
{
    struct context *ctx = graph->ctx;
    const struct half_edge *half_edges = graph->half_edges;
    size_t count = (size_t)(end - first) + 1;
    enum status status = memory_reserve(ctx, &room->positions, &room->position_capacity, 3 * count,
                                        sizeof *room->positions);
    if (status == STATUS_OK)
        status =
            memory_reserve(ctx, &room->errors, &room->error_capacity, count, sizeof *room->errors);
    if (status != STATUS_OK)
        return status;
    for (size_t k = 0; k < count; k++) {
        size_t h = k + 1 < count ? 2 * (first + k) : 2 * (size_t)end - 1;
        memcpy(room->positions + 3 * k, graph->positions + 3 * (size_t)half_edges[h].origin,
               3 * sizeof(float));
    }
    uint32_t left = half_edges[2 * (size_t)first].patch;
    uint32_t right = half_edges[2 * (size_t)first + 1].patch;
    struct chain_metric metric =
        right == NO_PATCH
            ? chain_metric_plain()
            : chain_metric_between(patch_normal(graph, left), patch_normal(graph, right));
    chain_errors(room->positions, count, HALVING_BOTTOM_UP, &metric, room->errors);
    for (size_t k = 1; k + 1 < count; k++)
        errors[half_edges[2 * (first + k)].origin] =
            room->errors[k] * (priced ? (float)metric.price : 1);
    return STATUS_OK;
}

enum status chain_graph_errors(struct chain_graph *graph, bool priced, float *errors)
{
    struct chain_room room = {0};
    enum status status = STATUS_OK;
    for (uint32_t v = 0; v < graph->vertex_count; v++)
        errors[v] = INFINITY;
    /* Edges of a chain follow each other in the order in which they were made. */
    for (uint32_t first = 0, end; first < graph->edge_count && status == STATUS_OK; first = end) {
        end = first + 1;
        while (!(graph->flags[half_edge_end(graph, 2 * end - 2)] & VERTEX_JUNCTION))
            end++;
        if (end - first > 1)
            status = chain_errors_of(graph, first, end, &room, priced, errors);
    }
    memory_release(graph->ctx, &room.positions, room.position_capacity, sizeof *room.positions);
    memory_release(graph->ctx, &room.errors, room.error_capacity, sizeof *room.errors);
    return status;
}
