/*
 * The edges of a small mesh while it is built.
 *
 * Whether an edge is there is asked for every segment of a chain and twice for every diagonal, and
 * nearly always it is not. A hash map of edges would be a cache miss each time, and so is going
 * through the edges of a vertex, few as they are. So with its list each vertex has a word with a
 * bit for each of the other ends, several having the same: where it is not set, no edge is.
 * Vertices are numbered along the chains, so that the words of those round a patch are mostly in
 * the cache. A vertex at which thousands of chains meet would have all bits set, and a list that is
 * gone through again and again: where all are set, edges go to the lists of their other ends.
 */
#include "base/memory.h"
#include "simplify/small_internal.h"

/* Arrays that grow bit by bit move, and touch memory that nobody has touched. */
enum status small_edges_reserve(struct small_builder *b, size_t edges)
{
    size_t capacity = b->entry_capacity;
    enum status status = memory_reserve(b->ctx, &b->entries, &capacity, edges, sizeof *b->entries);
    b->entry_capacity = (uint32_t)capacity;
    return status;
}

void small_edges_drop(struct small_builder *b)
{
    for (uint32_t i = 0; i < b->entry_count; i++) {
        struct edge_entry *entry = &b->entries[i];
        if (entry->chain != NO_INDEX && b->states[entry->chain] == CHAIN_GIVEN_BACK)
            entry->other = NO_INDEX; /* which no vertex is */
    }
}
