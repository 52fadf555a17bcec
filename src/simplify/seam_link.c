/*
 * The edges that two patches share over a seam, in no order but that of their first vertices. A
 * patch's boundary passes a vertex once, so at most one of them starts at each vertex and at most
 * one ends there: which follows which is found by binary search, and chains are read off from
 * junction to junction. What is left then are closed loops, which get three junctions each.
 */
#include "simplify/seam_internal.h"

#include <string.h>

#include "base/memory.h"

/* Adds the chain over the `count` vertices in join->list, which is walked with `edge->left` on its
 * left, to both its slabs; in the order of places, for the sorter. */
static enum status add_chain(struct seam_join *join, const struct pair_edge *edge, size_t count)
{
    if (count >> PLACE_SHIFT)
        return fail(join->ctx, STATUS_BAD_INPUT, "mesh store: a seam chain of %zu vertices", count);
    uint64_t first_place = join->chain_count++ << PLACE_SHIFT;
    enum status status = STATUS_OK;
    for (size_t i = 0; i < count && !status; i++) {
        struct chain_vertex views[2] = {
            {.side = edge->left,
             .place = first_place + i,
             .vertex = join->list[i],
             .other_slab = (uint32_t)(edge->right >> 32),
             .other_patch = (uint32_t)edge->right,
             .count = (uint32_t)count},
            {.side = edge->right,
             .place = first_place + i,
             .vertex = join->list[count - 1 - i],
             .other_slab = (uint32_t)(edge->left >> 32),
             .other_patch = (uint32_t)edge->left,
             .count = (uint32_t)count},
        };
        status = sorter_add(join->chains, views, 2);
    }
    return status;
}

/* A seam loop without junctions, all of whose edges lie between the same two patches: it gets
 * three. join->list holds its `count` vertices. */
static enum status cut_closed_loop(struct seam_join *join, const struct pair_edge *edge,
                                   size_t count, struct seam_counts *counts)
{
    struct context *ctx = join->ctx;
    uint32_t slab = (uint32_t)(edge->left >> 32);
    if (count < 3)
        return fail(ctx, STATUS_BAD_INPUT, "mesh store: two patches share a loop of two edges");
    float *positions = NULL;
    uint32_t *loop = NULL;
    enum status status = memory_take(ctx, count, 3 * sizeof *positions, &positions);
    if (!status)
        status = memory_take(ctx, count, sizeof *loop, &loop);
    if (status)
        goto end;
    memcpy(loop, join->list, count * sizeof *loop);
    for (size_t i = 0; i < count; i++) {
        uint32_t place;
        status = seam_find_vertex(join, slab, loop[i], &place);
        if (status)
            goto end;
        memcpy(positions + 3 * i, join->positions + 3 * (join->parts[slab].vertex_offset + place),
               3 * sizeof *positions);
    }
    size_t chosen[3];
    loop_choose_three(count, positions, loop, chosen);
    counts->junctions += 3;
    for (unsigned i = 0; i < 3 && !status; i++) {
        size_t to = i == 2 ? chosen[0] + count : chosen[i + 1], length = 0;
        for (size_t j = chosen[i]; j <= to; j++)
            join->list[length++] = loop[j % count];
        status = add_chain(join, edge, length);
    }
end:
    memory_release(ctx, &positions, count, 3 * sizeof *positions);
    memory_release(ctx, &loop, count, sizeof *loop);
    return status;
}

/* Links the group's edges, which are ascending by `from`: next[i] is the edge that starts where i
 * ends, or `count`. */
static enum status link_group(struct seam_join *join, size_t count)
{
    enum status status =
        memory_reserve(join->ctx, &join->next, &join->next_capacity, count, sizeof *join->next);
    if (!status) /* a closed loop's chains repeat one vertex at most */
        status = memory_reserve(join->ctx, &join->list, &join->list_capacity, count + 1,
                                sizeof *join->list);
    if (status)
        return status;
    const struct pair_edge *group = join->group;
    for (size_t i = 0; i < count; i++) {
        if (i && group[i].from == group[i - 1].from)
            return fail(join->ctx, STATUS_BAD_INPUT,
                        "mesh store: the boundary of a patch passes vertex %u twice",
                        group[i].from);
        size_t low = 0, high = count;
        while (low < high) {
            size_t middle = low + (high - low) / 2;
            if (group[middle].from < group[i].to)
                low = middle + 1;
            else
                high = middle;
        }
        join->next[i] = (uint32_t)(low < count && group[low].from == group[i].to ? low : count);
    }
    return STATUS_OK;
}

/* Follows the group from `edge` to a junction, or round to where it began; visited edges lose their
 * link and are marked by from_junction 2. */
static size_t follow(struct seam_join *join, size_t count, size_t edge, bool *closed)
{
    struct pair_edge *group = join->group;
    size_t length = 0, first = edge;
    join->list[length++] = group[edge].from;
    *closed = false;
    for (;;) {
        group[edge].from_junction = 2;
        size_t next = join->next[edge];
        if (next == first) { /* only from an edge that does not start at a junction */
            *closed = true;
            return length;
        }
        join->list[length++] = group[edge].to;
        if (next == count || group[next].from_junction)
            return length;
        edge = next;
    }
}

enum status seam_link_group(struct seam_join *join, size_t count, struct seam_counts *counts)
{
    enum status status = link_group(join, count);
    for (size_t i = 0; i < count && !status; i++) {
        if (join->group[i].from_junction != 1)
            continue;
        bool closed;
        size_t length = follow(join, count, i, &closed);
        if (closed)
            return fail(join->ctx, STATUS_BAD_INPUT,
                        "mesh store: a seam chain ends at the junction that it began at");
        status = add_chain(join, &join->group[i], length);
    }
    for (size_t i = 0; i < count && !status; i++) {
        if (join->group[i].from_junction != 0)
            continue;
        bool closed;
        size_t length = follow(join, count, i, &closed);
        if (!closed)
            return fail(join->ctx, STATUS_BAD_INPUT,
                        "mesh store: a seam chain begins at no junction");
        status = cut_closed_loop(join, &join->group[i], length, counts);
    }
    return status;
}
