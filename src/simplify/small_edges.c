/*
 * The edges of a small mesh while it is built.
 *
 * Whether an edge is there is asked for every segment of a chain and twice for every diagonal, and
 * nearly always it is not. A hash map of edges would be a cache miss each time, and so is a list of
 * the edges at a vertex, short as it is. So before the list a bit is looked at: each edge has one
 * of about eight times as many as there are edges, few enough to stay in the cache. Where it is not
 * set, no edge is; only else the list is walked through.
 */
#include <string.h>

#include "base/memory.h"
#include "simplify/small_internal.h"

enum { BITS_AN_EDGE = 8, SEEN_LOG_LEAST = 6, SEEN_LOG_MOST = 30 };

/* Arrays that grow bit by bit move, and touch memory that nobody has touched. */
enum status small_edges_reserve(struct small_builder *b, size_t edges)
{
    size_t capacity = b->entry_capacity;
    enum status status = memory_reserve(b->ctx, &b->entries, &capacity, edges, sizeof *b->entries);
    b->entry_capacity = (uint32_t)capacity;
    return status;
}

enum status small_edges_take_seen(struct small_builder *b, size_t edges)
{
    unsigned log = SEEN_LOG_LEAST;
    while (log < SEEN_LOG_MOST && (size_t)1 << log < BITS_AN_EDGE * edges)
        log++;
    b->seen_shift = 32 - log;
    b->seen_words = bit_words((uint64_t)1 << log);
    return memory_take(b->ctx, b->seen_words, sizeof *b->seen, &b->seen);
}

void small_edges_forget(struct small_builder *b)
{
    b->entry_count = 0;
    memset(b->heads, 0xff, b->block->vertex_count * sizeof *b->heads);
    memset(b->seen, 0, b->seen_words * sizeof *b->seen);
}

void small_edges_drop(struct small_builder *b)
{
    for (uint32_t i = 0; i < b->entry_count; i++) {
        struct edge_entry *entry = &b->entries[i];
        if (entry->chain != NO_INDEX && b->states[entry->chain] == CHAIN_GIVEN_BACK)
            entry->high = NO_INDEX; /* which no vertex is */
    }
}
