/*
 * A stage takes and releases large blocks hundreds of times, four times the memory that it has at
 * any moment. When each is a map of its own, its pages come from the system one fault at a time,
 * zeroed, and go back there: a fifth of a run's time. An allocator's heap would keep them, but also
 * what it should give back, and a budget could not be kept to.
 *
 * So maps that are released stay in a short list. The next block takes the smallest that is large
 * enough, or a part of it; if there is none, the largest is lengthened by its page tables (mremap).
 * memory.c sees to it that blocks and spares together are never more than blocks alone have been,
 * so that all this shows in no budget and no peak.
 */
#include "base/spare_maps.h"

#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

void spare_maps_init(struct spare_maps *spares)
{
    memset(spares, 0, sizeof *spares);
    pthread_mutex_init(&spares->lock, NULL);
    atomic_init(&spares->bytes, 0);
}

void spare_maps_clear(struct spare_maps *spares)
{
    spare_maps_trim(spares, 0);
    pthread_mutex_destroy(&spares->lock);
}

/* ---- the list; the lock is held ---- */

static void remove_entry(struct spare_maps *spares, unsigned i)
{
    atomic_fetch_sub(&spares->bytes, spares->list[i].bytes);
    spares->list[i] = spares->list[--spares->count];
}

static void add_entry(struct spare_maps *spares, unsigned char *at, size_t bytes)
{
    spares->list[spares->count++] = (struct spare_map){at, bytes};
    atomic_fetch_add(&spares->bytes, bytes);
}

static unsigned smallest(const struct spare_maps *spares)
{
    unsigned found = 0;
    for (unsigned i = 1; i < spares->count; i++)
        if (spares->list[i].bytes < spares->list[found].bytes)
            found = i;
    return found;
}

/* The smallest with at least so many bytes, else the largest; there is one. */
static unsigned best_for(const struct spare_maps *spares, size_t bytes)
{
    unsigned found = 0;
    for (unsigned i = 1; i < spares->count; i++) {
        const size_t here = spares->list[i].bytes, there = spares->list[found].bytes;
        if (there < bytes ? here > there : here >= bytes && here < there)
            found = i;
    }
    return found;
}

/* ---- the interface ---- */

void spare_maps_put(struct spare_maps *spares, void *map, size_t bytes)
{
    struct spare_map dropped = {map, bytes};
    pthread_mutex_lock(&spares->lock);
    if (spares->are_kept) {
        dropped.bytes = 0;
        if (spares->count == SPARE_MAPS_MAX) { /* the smallest is the least loss */
            const unsigned least = smallest(spares);
            dropped = spares->list[least];
            remove_entry(spares, least);
        }
        add_entry(spares, map, bytes);
    }
    pthread_mutex_unlock(&spares->lock);
    if (dropped.bytes > 0)
        munmap(dropped.at, dropped.bytes);
}

void *spare_maps_take(struct spare_maps *spares, size_t bytes, size_t *used)
{
    struct spare_map spare = {NULL, 0};
    *used = 0;
    pthread_mutex_lock(&spares->lock);
    if (spares->count > 0) {
        const unsigned best = best_for(spares, bytes);
        spare = spares->list[best];
        remove_entry(spares, best);
        if (spare.bytes > bytes) {
            add_entry(spares, spare.at + bytes, spare.bytes - bytes);
            spare.bytes = bytes;
        }
    }
    pthread_mutex_unlock(&spares->lock);
    if (spare.at && spare.bytes < bytes) {
        void *moved = mremap(spare.at, spare.bytes, bytes, MREMAP_MAYMOVE);
        if (moved == MAP_FAILED) {
            munmap(spare.at, spare.bytes);
            spare.at = NULL;
        } else {
            spare.at = moved;
        }
    }
    if (spare.at) {
        *used = spare.bytes;
        return spare.at;
    }
    void *map = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    return map == MAP_FAILED ? NULL : map;
}

void spare_maps_trim(struct spare_maps *spares, uint64_t most)
{
    const size_t page = (size_t)sysconf(_SC_PAGESIZE);
    pthread_mutex_lock(&spares->lock);
    for (uint64_t bytes; (bytes = atomic_load(&spares->bytes)) > most;) {
        /* the end of the smallest that is enough, in one call */
        const uint64_t excess = bytes - most;
        const unsigned i = best_for(spares, (size_t)excess);
        const struct spare_map spare = spares->list[i];
        const size_t kept = spare.bytes > excess ? (spare.bytes - (size_t)excess) / page * page : 0;
        remove_entry(spares, i);
        if (kept > 0)
            add_entry(spares, spare.at, kept);
        munmap(spare.at + kept, spare.bytes - kept);
    }
    pthread_mutex_unlock(&spares->lock);
}
