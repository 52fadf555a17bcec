/*
 * Unordered pairs of vertices in one open table: is there an edge between these two? A pair is one
 * 64-bit number, mixed by a multiplication; places are tried one after the other.
 */
#include "simplify/topology_pairs.h"

#include <string.h>

#include "base/memory.h"

static uint64_t pair_of(uint32_t a, uint32_t b)
{
    return a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
}

static size_t pair_place(const struct pair_set *set, uint64_t pair)
{
    size_t at = (size_t)((pair ^ pair >> 29) * UINT64_C(0x9e3779b97f4a7c15) >> 20);
    for (at &= set->capacity - 1; set->pairs[at] != 0 && set->pairs[at] != pair;)
        at = (at + 1) & (set->capacity - 1);
    return at;
}

void pair_set_clear(struct context *ctx, struct pair_set *set)
{
    memory_release(ctx, &set->pairs, set->capacity, sizeof *set->pairs);
    memset(set, 0, sizeof *set);
}

static enum status pair_set_grow(struct context *ctx, struct pair_set *set)
{
    struct pair_set larger = {.capacity = set->capacity ? 2 * set->capacity : 256,
                              .count = set->count};
    enum status status =
        memory_take_zeroed(ctx, larger.capacity, sizeof *larger.pairs, &larger.pairs);
    if (status != STATUS_OK)
        return status;
    for (size_t i = 0; i < set->capacity; i++)
        if (set->pairs[i])
            larger.pairs[pair_place(&larger, set->pairs[i])] = set->pairs[i];
    memory_release(ctx, &set->pairs, set->capacity, sizeof *set->pairs);
    *set = larger;
    return STATUS_OK;
}

enum status pair_set_add(struct context *ctx, struct pair_set *set, uint32_t a, uint32_t b)
{
    if (2 * (set->count + 1) > set->capacity) {
        enum status status = pair_set_grow(ctx, set);
        if (status != STATUS_OK)
            return status;
    }
    uint64_t pair = pair_of(a, b);
    size_t at = pair_place(set, pair);
    set->count += set->pairs[at] == 0;
    set->pairs[at] = pair;
    return STATUS_OK;
}

bool pair_set_has(const struct pair_set *set, uint32_t a, uint32_t b)
{
    uint64_t pair = pair_of(a, b);
    return set->capacity > 0 && set->pairs[pair_place(set, pair)] == pair;
}
