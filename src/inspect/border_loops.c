/*
 * Walking along the border from edge to edge needs the next edge at each vertex, which is not there
 * in a mesh without adjacency, and not unique in one that is no manifold. Instead each fan says
 * which border edges are its two ends, and a union-find joins them: a loop is what hangs together.
 *
 * Half-edges are sparse names. A bit a half-edge with counts every 512 bits turns them into dense
 * numbers without a hash map: 0.4 bytes a face, and 4 bytes a border edge for the union-find.
 */
#include "inspect/border_loops.h"

#include <string.h>

struct border_edge {
    uint64_t half_edge;
    uint32_t component;
    uint32_t unused;
};

enum { WORDS_A_RANK = 8 };

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

static uint32_t rank_of(const uint64_t *bits, const uint32_t *ranks, uint64_t half_edge)
{
    uint64_t word = half_edge / 64;
    uint64_t first = word / WORDS_A_RANK * WORDS_A_RANK;
    uint32_t rank = ranks[word / WORDS_A_RANK];
    for (uint64_t i = first; i < word; i++)
        rank += (uint32_t)__builtin_popcountll(bits[i]);
    uint64_t below = ((uint64_t)1 << half_edge % 64) - 1;
    return rank + (uint32_t)__builtin_popcountll(bits[word] & below);
}

static uint32_t find_root(uint32_t *roots, uint32_t i)
{
    while (roots[i] != i) {
        roots[i] = roots[roots[i]];
        i = roots[i];
    }
    return i;
}

/* Sets the bits and counts them; *bits and *ranks live until clear. */
static enum status number_edges(struct border_loops *loops, const struct border_edge *edges,
                                uint64_t count, uint64_t **bits, uint32_t **ranks)
{
    struct context *ctx = loops->ctx;
    uint64_t rank_count = (loops->word_count + WORDS_A_RANK - 1) / WORDS_A_RANK;
    void *data;
    enum status status =
        spool_scratch(ctx, &loops->bits, loops->bits.beside, loops->bits.memory_limit,
                      loops->word_count * sizeof **bits, &data);
    if (status != STATUS_OK)
        return status;
    *bits = data;
    status = spool_scratch(ctx, &loops->ranks, loops->ranks.beside, loops->ranks.memory_limit,
                           rank_count * sizeof **ranks, &data);
    if (status != STATUS_OK)
        return status;
    *ranks = data;

    for (uint64_t i = 0; i < count; i++)
        (*bits)[edges[i].half_edge / 64] |= (uint64_t)1 << edges[i].half_edge % 64;
    uint32_t before = 0;
    for (uint64_t word = 0; word < loops->word_count; word++) {
        if (word % WORDS_A_RANK == 0)
            (*ranks)[word / WORDS_A_RANK] = before;
        before += (uint32_t)__builtin_popcountll((*bits)[word]);
    }
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
    loops->word_count = half_edges / 64 + 1;

    void *data;
    enum status status = spool_seal(&loops->edges, &data);
    if (status != STATUS_OK)
        return status;
    const struct border_edge *edges = data;
    status = spool_seal(&loops->joints, &data);
    if (status != STATUS_OK)
        return status;
    const uint64_t *joints = data;

    uint64_t *bits;
    uint32_t *ranks;
    status = number_edges(loops, edges, count, &bits, &ranks);
    if (status != STATUS_OK)
        return status;
    status = spool_scratch(ctx, &loops->roots, loops->roots.beside, loops->roots.memory_limit,
                           count * sizeof(uint32_t), &data);
    if (status != STATUS_OK)
        return status;
    uint32_t *roots = data;

    for (uint32_t i = 0; i < count; i++)
        roots[i] = i;
    for (uint64_t i = 0; i < joint_count; i++) {
        uint32_t a = find_root(roots, rank_of(bits, ranks, joints[2 * i]));
        uint32_t b = find_root(roots, rank_of(bits, ranks, joints[2 * i + 1]));
        roots[a > b ? a : b] = a > b ? b : a;
    }
    for (uint64_t i = 0; i < count; i++) {
        uint32_t rank = rank_of(bits, ranks, edges[i].half_edge);
        if (roots[rank] == rank)
            loop(user, edges[i].component);
    }
    return STATUS_OK;
}
