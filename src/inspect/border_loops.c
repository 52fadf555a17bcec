/*
 * Walking along the border from edge to edge needs the next edge at each vertex, which is not there
 * in a mesh without adjacency, and not unique in one that is no manifold. Instead each fan says
 * which border edges are its two ends, and a union-find joins them: a loop is what hangs together.
 *
 * Half-edges are sparse names. A bit a half-edge with counts every 64 turns them into dense
 * numbers without a hash map: 0.6 bytes a face, and 4 bytes a border edge for the union-find.
 */
#include "inspect/border_loops.h"

#include <string.h>

#include "base/forest.h"
#include "base/ranked_bits.h"

struct border_edge {
    uint64_t half_edge;
    uint32_t component;
    uint32_t unused;
};

void border_loops_init(struct context *ctx, const char *beside, uint64_t memory_limit,
                       struct border_loops *loops)
{
    memset(loops, 0, sizeof *loops);
    loops->ctx = ctx;
    spool_init(ctx, &loops->edges, beside, memory_limit);
    spool_init(ctx, &loops->joints, beside, memory_limit);
    spool_init(ctx, &loops->bits, beside, memory_limit);
    spool_init(ctx, &loops->ranks, beside, memory_limit);
    spool_init(ctx, &loops->roots, beside, memory_limit);
}

void border_loops_clear(struct border_loops *loops)
{
    spool_clear(&loops->edges);
    spool_clear(&loops->joints);
    spool_clear(&loops->bits);
    spool_clear(&loops->ranks);
    spool_clear(&loops->roots);
}

enum status border_loops_edge(struct border_loops *loops, uint64_t half_edge, uint32_t component)
{
    struct border_edge edge = {half_edge, component, 0};
    return spool_append(&loops->edges, &edge, sizeof edge);
}

enum status border_loops_join(struct border_loops *loops, uint64_t half_edge, uint64_t other)
{
    uint64_t joint[2] = {half_edge, other};
    return spool_append(&loops->joints, joint, sizeof joint);
}

/* Sets the bits and ranks them; they live until clear. */
static enum status number_edges(struct border_loops *loops, const struct border_edge *edges,
                                uint64_t count, uint64_t half_edges, struct ranked_bits *numbers)
{
    struct context *ctx = loops->ctx;
    void *data;
    numbers->words = bit_words(half_edges);
    enum status status =
        spool_scratch(ctx, &loops->bits, loops->bits.beside, loops->bits.memory_limit,
                      numbers->words * sizeof *numbers->bits, &data);
    if (status != STATUS_OK)
        return status;
    numbers->bits = data;
    status = spool_scratch(ctx, &loops->ranks, loops->ranks.beside, loops->ranks.memory_limit,
                           numbers->words * sizeof *numbers->below, &data);
    if (status != STATUS_OK)
        return status;
    numbers->below = data;
    for (uint64_t i = 0; i < count; i++)
        bit_set(numbers->bits, edges[i].half_edge);
    ranked_bits_sum(numbers);
    return STATUS_OK;
}

enum status border_loops_finish(struct border_loops *loops, uint64_t half_edges,
                                void (*loop)(void *user, uint32_t component), void *user)
{
    struct context *ctx = loops->ctx;
    uint64_t count = loops->edges.size / sizeof(struct border_edge);
    uint64_t joint_count = loops->joints.size / (2 * sizeof(uint64_t));
    if (count == 0)
        return STATUS_OK;
    if (count >= UINT32_MAX)
        return fail(ctx, STATUS_BAD_INPUT,
                    "the mesh has %llu border edges, more than can be told "
                    "apart",
                    (unsigned long long)count);

    void *data;
    enum status status = spool_seal(&loops->edges, &data);
    if (status != STATUS_OK)
        return status;
    const struct border_edge *edges = data;
    status = spool_seal(&loops->joints, &data);
    if (status != STATUS_OK)
        return status;
    const uint64_t *joints = data;

    struct ranked_bits numbers;
    status = number_edges(loops, edges, count, half_edges, &numbers);
    if (status != STATUS_OK)
        return status;
    status = spool_scratch(ctx, &loops->roots, loops->roots.beside, loops->roots.memory_limit,
                           count * sizeof(uint32_t), &data);
    if (status != STATUS_OK)
        return status;
    uint32_t *roots = data;

    for (uint32_t i = 0; i < count; i++)
        roots[i] = i;
    for (uint64_t i = 0; i < joint_count; i++)
        forest_join(roots, rank_of(&numbers, joints[2 * i]), rank_of(&numbers, joints[2 * i + 1]));
    for (uint64_t i = 0; i < count; i++) {
        uint32_t rank = rank_of(&numbers, edges[i].half_edge);
        if (roots[rank] == rank)
            loop(user, edges[i].component);
    }
    return STATUS_OK;
}
