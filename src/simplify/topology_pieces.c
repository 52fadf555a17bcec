/*
 * Cutting the surface along rims.
 *
 * Patches that share an edge which is no rim are in one piece; a forest over patches finds them,
 * numbered by their lowest patch. Each piece's patches and cut edges are listed one after the other
 * in two arrays, by counting.
 */
#include "simplify/topology_pieces.h"

#include <string.h>

#include "base/forest.h"
#include "base/memory.h"

/* Turns the forest into numbers from 0, in the order of the lowest patches. */
static uint32_t number_roots(uint32_t *parents, uint32_t count)
{
    uint32_t next = 0;
    for (uint32_t p = 0; p < count; p++)
        parents[p] = forest_root(parents, p);
    /* A root is its own parent and precedes its members, so its place can take the number: numbers
     * never exceed places. */
    for (uint32_t p = 0; p < count; p++)
        parents[p] = parents[p] == p ? next++ : parents[parents[p]];
    return next;
}

static void widen_piece(struct piece *piece, struct vec3 at)
{
    piece->low = vec3_make(at.x < piece->low.x ? at.x : piece->low.x,
                           at.y < piece->low.y ? at.y : piece->low.y,
                           at.z < piece->low.z ? at.z : piece->low.z);
    piece->high = vec3_make(at.x > piece->high.x ? at.x : piece->high.x,
                            at.y > piece->high.y ? at.y : piece->high.y,
                            at.z > piece->high.z ? at.z : piece->high.z);
}

static enum status take_pieces(struct piece_set *set)
{
    struct chain_graph *graph = set->graph;
    struct context *ctx = graph->ctx;
    uint32_t *piece_of = set->piece_of;
    for (uint32_t p = 0; p < graph->patch_count; p++)
        piece_of[p] = p;
    for (uint32_t e = 0; e < graph->edge_count; e++) {
        uint32_t a = patch_of(set, 2 * e), b = patch_of(set, 2 * e + 1);
        if (a != NO_PATCH && b != NO_PATCH && rim_flat_side(&set->rims, e) == NO_INDEX)
            forest_join(piece_of, a, b);
    }
    set->piece_count = number_roots(piece_of, graph->patch_count);
    enum status status = memory_take(ctx, set->piece_count, sizeof *set->pieces, &set->pieces);
    if (status != STATUS_OK)
        return status;
    const struct piece empty = {.low = {INFINITY, INFINITY, INFINITY},
                                .high = {-INFINITY, -INFINITY, -INFINITY},
                                .large = NO_INDEX,
                                .follower = NO_INDEX,
                                .last_follower = NO_INDEX,
                                .next_follower = NO_INDEX};
    for (uint32_t i = 0; i < set->piece_count; i++)
        set->pieces[i] = empty;
    for (uint32_t h = 0; h < 2 * graph->edge_count; h++)
        if (patch_of(set, h) != NO_PATCH)
            widen_piece(&set->pieces[piece_of[patch_of(set, h)]],
                        vertex_point(graph, graph->half_edges[h].origin));
    return STATUS_OK;
}

/* True when the edge of h is cut, with another piece on each side. */
static bool parts_pieces(const struct piece_set *set, uint32_t h)
{
    uint32_t a = patch_of(set, h), b = patch_of(set, h ^ 1);
    return a != NO_PATCH && rim_flat_side(&set->rims, h / 2) != NO_INDEX &&
           (b == NO_PATCH || set->piece_of[a] != set->piece_of[b]);
}

/* Lists each piece's cut edges and patches. A rim that parts nothing, as at a hole whose other end
 * is large, is none. */
static enum status list_pieces(struct piece_set *set)
{
    struct chain_graph *graph = set->graph;
    struct context *ctx = graph->ctx;
    struct piece *pieces = set->pieces;
    for (uint32_t h = 0; h < 2 * graph->edge_count; h++) {
        uint32_t flat = rim_flat_side(&set->rims, h / 2);
        if (!parts_pieces(set, h))
            continue;
        struct piece *piece = &pieces[set->piece_of[patch_of(set, h)]];
        piece->edge_count++;
        piece->flat_edges += flat == h;
        piece->wall_edges += flat != h;
        set->edge_total++;
    }
    for (uint32_t p = 0; p < graph->patch_count; p++)
        pieces[set->piece_of[p]].patch_count++;
    enum status status = memory_take(ctx, set->edge_total, sizeof *set->edges, &set->edges);
    if (status == STATUS_OK)
        status = memory_take(ctx, graph->patch_count, sizeof *set->patches, &set->patches);
    if (status != STATUS_OK)
        return status;
    for (uint32_t i = 1; i < set->piece_count; i++) {
        pieces[i].first_edge = pieces[i - 1].first_edge + pieces[i - 1].edge_count;
        pieces[i].first_patch = pieces[i - 1].first_patch + pieces[i - 1].patch_count;
    }
    for (uint32_t i = 0; i < set->piece_count; i++)
        pieces[i].edge_count = pieces[i].patch_count = 0;
    for (uint32_t h = 0; h < 2 * graph->edge_count; h++) {
        if (!parts_pieces(set, h))
            continue;
        struct piece *piece = &pieces[set->piece_of[patch_of(set, h)]];
        set->edges[piece->first_edge + piece->edge_count++] = h;
    }
    for (uint32_t p = 0; p < graph->patch_count; p++) {
        struct piece *piece = &pieces[set->piece_of[p]];
        set->patches[piece->first_patch + piece->patch_count++] = p;
    }
    return STATUS_OK;
}

/* Large loops count against the piece that they lie in; those along a rim are the flat side's. */
static enum status list_large(struct piece_set *set)
{
    enum status status = memory_take(set->graph->ctx, set->rims.large_count,
                                     sizeof *set->large_next, &set->large_next);
    for (size_t i = 0; i < set->rims.large_count && status == STATUS_OK; i++) {
        uint32_t h = set->rims.large[i].first;
        struct piece *piece = &set->pieces[set->piece_of[patch_of(set, h)]];
        set->large_next[i] = piece->large;
        piece->large = (uint32_t)i;
    }
    return status;
}

enum status pieces_cut(struct piece_set *set)
{
    struct context *ctx = set->graph->ctx;
    enum status status =
        memory_take(ctx, set->graph->patch_count, sizeof *set->piece_of, &set->piece_of);
    if (status == STATUS_OK)
        status = take_pieces(set);
    if (status == STATUS_OK)
        status = list_pieces(set);
    return status == STATUS_OK ? list_large(set) : status;
}

void piece_set_clear(struct piece_set *set)
{
    struct context *ctx = set->graph->ctx;
    const size_t patches = set->graph->patch_count;
    memory_release(ctx, &set->large_next, set->rims.large_count, sizeof *set->large_next);
    rim_set_clear(ctx, &set->rims);
    memory_release(ctx, &set->piece_of, patches, sizeof *set->piece_of);
    memory_release(ctx, &set->patches, patches, sizeof *set->patches);
    memory_release(ctx, &set->pieces, set->piece_count, sizeof *set->pieces);
    memory_release(ctx, &set->edges, set->edge_total, sizeof *set->edges);
}
