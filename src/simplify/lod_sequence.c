/*
 * One sequence of operations.
 *
 * The dissertation runs three phases for each level: chains at a tolerance, then merging and
 * collapsing, recursively. To meet N faces the tolerance must be searched, each try being a whole
 * run. But all three kinds of operation are priced in the same unit (operation_cost.h), so one
 * priority queue does them in order of increasing tolerance: the state after the operations up to
 * tolerance e is the level of e, finer levels come first, and N is met by stopping.
 *
 * An item of the queue is a vertex (the cheapest way to take it away) or a patch (its cheapest
 * merge). Chain vertices begin with their stored halving error, which makes them go in the order of
 * the bottom-up hierarchy of section 4.2.5. Keys are not kept up to date everywhere: what an
 * operation changes nearby is priced again at once, and every item once more when it comes to the
 * front, where it goes back if it has become dearer. What had become impossible may be possible
 * again later, so an empty queue is filled again from all that lives until that brings nothing.
 */
#include "simplify/lod_sequence.h"

#include <string.h>

#include "base/memory.h"

enum { STEP_OPERATIONS = 1 << 14, MERGE_NEIGHBOURS_MAX = 64, SLIDE_PASSES = 2 };

/* ---- the heap: least key first, then lowest number ---- */

static bool goes_before(const struct lod_sequence *s, uint32_t a, uint32_t b)
{
    return s->keys[a] != s->keys[b] ? s->keys[a] < s->keys[b] : a < b;
}

static void put(struct lod_sequence *s, uint32_t place, uint32_t item)
{
    s->heap[place] = item;
    s->places[item] = place;
}

static void move_up(struct lod_sequence *s, uint32_t place, uint32_t item)
{
    while (place > 0 && goes_before(s, item, s->heap[(place - 1) / 2])) {
        put(s, place, s->heap[(place - 1) / 2]);
        place = (place - 1) / 2;
    }
    put(s, place, item);
}

static void move_down(struct lod_sequence *s, uint32_t place, uint32_t item)
{
    for (;;) {
        size_t child = 2 * (size_t)place + 1;
        if (child >= s->heap_count)
            break;
        if (child + 1 < s->heap_count && goes_before(s, s->heap[child + 1], s->heap[child]))
            child++;
        if (!goes_before(s, s->heap[child], item))
            break;
        put(s, place, s->heap[child]);
        place = (uint32_t)child;
    }
    put(s, place, item);
}

static void heap_drop(struct lod_sequence *s, uint32_t item)
{
    uint32_t place = s->places[item];
    if (place == NO_INDEX)
        return;
    s->places[item] = NO_INDEX;
    uint32_t last = s->heap[--s->heap_count];
    if (last == item)
        return;
    if (place > 0 && goes_before(s, last, s->heap[(place - 1) / 2]))
        move_up(s, place, last);
    else
        move_down(s, place, last);
}

/* Puts the item where its key belongs; INFINITY: out of the heap. */
static void heap_set(struct lod_sequence *s, uint32_t item, float key)
{
    float before = s->keys[item];
    s->keys[item] = key;
    if (key == INFINITY)
        heap_drop(s, item);
    else if (s->places[item] == NO_INDEX)
        move_up(s, s->heap_count++, item);
    else if (key < before)
        move_up(s, s->places[item], item);
    else
        move_down(s, s->places[item], item);
}

/* ---- pricing ---- */

static uint32_t patch_item(const struct lod_sequence *s, uint32_t patch)
{
    return s->graph->vertex_count + patch;
}

static void price(const struct lod_sequence *s, uint32_t item, struct operation *operation)
{
    if (item < s->graph->vertex_count)
        vertex_cost(s->graph, &s->options, item, operation);
    else
        patch_cost(s->graph, &s->options, item - s->graph->vertex_count, operation);
}

static bool item_is_live(const struct lod_sequence *s, uint32_t item)
{
    const struct chain_graph *graph = s->graph;
    return item < graph->vertex_count
               ? vertex_is_live(graph, item)
               : graph->patches[item - graph->vertex_count].half_edge != NO_INDEX;
}

static void renew(struct lod_sequence *s, uint32_t item)
{
    struct operation operation;
    price(s, item, &operation);
    if (item < s->graph->vertex_count)
        s->graph->flags[item] &= (uint8_t)~VERTEX_STORED;
    heap_set(s, item, (float)operation.key);
}

static void refill(struct lod_sequence *s)
{
    for (uint32_t item = 0; item < s->item_count; item++)
        if (s->places[item] == NO_INDEX && item_is_live(s, item))
            renew(s, item);
    s->done_at_refill = s->done;
}

/* ---- doing ---- */

/* A patch all of whose chains are single edges now may be merged, whatever its neighbours are. */
static void renew_patch(struct lod_sequence *s, uint32_t patch)
{
    if (patch != NO_PATCH && s->graph->patches[patch].half_edge != NO_INDEX)
        renew(s, patch_item(s, patch));
}

static void do_remove(struct lod_sequence *s, uint32_t v)
{
    struct chain_graph *graph = s->graph;
    uint32_t h = graph->outgoing[v], other = half_edge_turn(graph, h);
    uint32_t ends[2] = {half_edge_end(graph, h), half_edge_end(graph, other)};
    uint32_t sides[2] = {graph->half_edges[h].patch, graph->half_edges[other].patch};
    heap_drop(s, v);
    vertex_remove(graph, v);
    for (int i = 0; i < 2; i++)
        if (!(graph->flags[ends[i]] & VERTEX_STORED))
            renew(s, ends[i]);
    for (int i = 0; i < 2; i++)
        if (sides[i] != NO_PATCH && graph->patches[sides[i]].open == 0)
            renew_patch(s, sides[i]);
}

static void do_collapse(struct lod_sequence *s, const struct operation *operation)
{
    struct chain_graph *graph = s->graph;
    const struct half_edge *half_edges = graph->half_edges;
    uint32_t h = operation->half_edge, count = 0;
    uint32_t ends[COLLAPSE_DEGREE_MAX + 1], sides[COLLAPSE_DEGREE_MAX + 1];
    uint32_t gone = half_edges[h].origin, g = h;
    do { /* what the operation changes; edge_can_collapse bounds the degree */
        ends[count] = half_edge_end(graph, g);
        sides[count++] = half_edges[g].patch;
        g = half_edge_turn(graph, g);
    } while (g != h);
    heap_drop(s, gone);
    edge_collapse(graph, h, operation->vertex_to, operation->list_to);
    for (uint32_t i = 0; i < count; i++)
        renew(s, ends[i]);
    for (uint32_t i = 0; i < count; i++)
        if (sides[i] != NO_PATCH && graph->patches[sides[i]].half_edge == NO_INDEX)
            heap_drop(s, patch_item(s, sides[i]));
}

static void do_merge(struct lod_sequence *s, const struct operation *operation)
{
    struct chain_graph *graph = s->graph;
    const struct half_edge *half_edges = graph->half_edges;
    uint32_t h = operation->half_edge;
    uint32_t sides[2] = {half_edges[h].patch, half_edges[h ^ 1].patch};
    for (int i = 0; i < 2; i++)
        heap_drop(s, patch_item(s, sides[i]));
    /* From end to end of the common chain: the vertices on it go. */
    while (vertex_has_two_edges(graph, half_edges[h].origin))
        h = half_edges[h].previous;
    uint32_t ends[2] = {half_edges[h].origin, half_edge_end(graph, h)};
    for (; vertex_has_two_edges(graph, ends[1]); ends[1] = half_edge_end(graph, h)) {
        heap_drop(s, ends[1]);
        h = half_edges[h].next;
    }
    uint32_t patch = patches_merge(graph, h, operation->error);
    for (int i = 0; i < 2; i++)
        renew(s, ends[i]);
    renew_patch(s, patch);
    if (graph->patches[patch].size > MERGE_NEIGHBOURS_MAX)
        return;
    uint32_t first = graph->patches[patch].half_edge, g = first;
    do {
        renew_patch(s, half_edges[g ^ 1].patch);
        g = half_edges[g].next;
    } while (g != first);
}

/* ---- putting vertices where they serve best ---- */

/* One pass over all vertices; returns how many moved. */
static uint64_t slide_all(struct lod_sequence *s)
{
    struct chain_graph *graph = s->graph;
    uint64_t moved = 0;
    for (uint32_t v = 0; v < graph->vertex_count; v++) {
        struct slide slide;
        if (!vertex_is_live(graph, v) || !vertex_slide_find(graph, v, &slide))
            continue;
        heap_drop(s, v);
        vertex_slide(graph, v, slide.in, slide.out, slide.to);
        renew(s, slide.to);
        uint32_t h = graph->outgoing[slide.to];
        do {
            renew(s, half_edge_end(graph, h));
            h = half_edge_turn(graph, h);
        } while (h != graph->outgoing[slide.to]);
        moved++;
    }
    return moved;
}

/* Removing vertices one by one leaves chains with segments of length one and two side by side; on a
 * chain with the same number of vertices, evenly spread ones are nearer to it. */
static void slide_chains(struct lod_sequence *s)
{
    for (int pass = 0; pass < SLIDE_PASSES; pass++)
        if (slide_all(s) == 0)
            break;
}

/* Done whenever a quarter of the faces has gone, and for each level. */
static void slide_when_due(struct lod_sequence *s)
{
    if (chain_graph_faces(s->graph) > s->slide_at)
        return;
    while (chain_graph_faces(s->graph) <= s->slide_at)
        s->slide_at -= s->slide_at / 4 + 1;
    slide_chains(s);
}

static void do_operation(struct lod_sequence *s, const struct operation *operation)
{
    if (operation->error > s->error)
        s->error = operation->error;
    if (operation->kind == OPERATION_REMOVE)
        do_remove(s, operation->vertex);
    else if (operation->kind == OPERATION_COLLAPSE)
        do_collapse(s, operation);
    else
        do_merge(s, operation);
    s->done++;
}

/* The next operation, if it is not dearer than `most_error`. */
enum progress { PROGRESS_DONE, PROGRESS_PRICED, PROGRESS_TOO_DEAR, PROGRESS_NONE };

static enum progress do_next(struct lod_sequence *s, double most_error)
{
    if (s->heap_count == 0) {
        if (s->done == s->done_at_refill)
            return PROGRESS_NONE;
        refill(s);
        return PROGRESS_PRICED;
    }
    uint32_t item = s->heap[0];
    struct operation operation;
    price(s, item, &operation);
    if ((float)operation.key > s->keys[item]) {
        heap_set(s, item, (float)operation.key);
        return PROGRESS_PRICED;
    }
    if (operation.error > most_error)
        return PROGRESS_TOO_DEAR;
    do_operation(s, &operation);
    return PROGRESS_DONE;
}

enum status lod_sequence_run(struct lod_sequence *s, uint64_t most_faces, double most_error)
{
    uint64_t begin = chain_graph_faces(s->graph), done = s->done, reported = done;
    while (chain_graph_faces(s->graph) > most_faces) {
        enum progress progress = do_next(s, most_error);
        if (progress == PROGRESS_NONE)
            s->exhausted = true;
        if (progress == PROGRESS_NONE || progress == PROGRESS_TOO_DEAR)
            break;
        slide_when_due(s);
        if (s->done - reported >= STEP_OPERATIONS) {
            reported = s->done;
            enum status status = step(s->graph->ctx, "simplifying",
                                      begin - chain_graph_faces(s->graph), begin - most_faces);
            if (status != STATUS_OK)
                return status;
        }
    }
    if (s->done > done)
        slide_chains(s);
    return STATUS_OK;
}

enum status lod_sequence_begin(struct chain_graph *graph, const struct cost_options *options,
                               struct lod_sequence *s)
{
    struct context *ctx = graph->ctx;
    *s = (struct lod_sequence){.graph = graph, .options = *options};
    s->item_count = (size_t)graph->vertex_count + graph->patch_count;
    if (s->item_count >= NO_INDEX)
        return fail(ctx, STATUS_BAD_INPUT, "more than %u chain vertices and patches", NO_INDEX - 1);
    enum status status = memory_take(ctx, s->item_count, sizeof *s->keys, &s->keys);
    if (status == STATUS_OK)
        status = memory_take(ctx, s->item_count, sizeof *s->places, &s->places);
    if (status == STATUS_OK)
        status = memory_take(ctx, s->item_count, sizeof *s->heap, &s->heap);
    if (status == STATUS_OK)
        status = chain_graph_errors(graph, true, s->keys);
    if (status != STATUS_OK) {
        lod_sequence_end(s);
        return status;
    }
    memset(s->places, 0xff, s->item_count * sizeof *s->places);
    for (uint32_t v = 0; v < graph->vertex_count; v++)
        if (s->keys[v] != INFINITY) {
            graph->flags[v] |= VERTEX_STORED;
            move_up(s, s->heap_count++, v);
        }
    for (uint32_t i = 0; i < graph->patch_count; i++)
        s->keys[patch_item(s, i)] = INFINITY;
    s->slide_at = chain_graph_faces(graph);
    s->slide_at -= s->slide_at / 4 + 1;
    refill(s);
    s->done_at_refill = UINT64_MAX;
    return STATUS_OK;
}

void lod_sequence_end(struct lod_sequence *s)
{
    struct context *ctx = s->graph->ctx;
    memory_release(ctx, &s->keys, s->item_count, sizeof *s->keys);
    memory_release(ctx, &s->places, s->item_count, sizeof *s->places);
    memory_release(ctx, &s->heap, s->item_count, sizeof *s->heap);
}
