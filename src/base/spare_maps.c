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
 *
 * Where the system puts a map, a large page (2 MiB) fits only from the first multiple of its size
 * on, and what lies before and behind comes in small ones, hundreds of faults for each block. So
 * large maps are put at such multiples, cut back to them, and not made of smaller ones.
 */
#include "base/spare_maps.h"

#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

enum { LARGE_PAGE = 2 << 20 };

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

/* A new map, a large one at an address where all of it can be large pages; NULL when the system
 * refuses. */
static void *map_new(size_t bytes)
{
    const size_t slack = bytes >= LARGE_PAGE ? LARGE_PAGE : 0;
    unsigned char *map =
        mmap(NULL, bytes + slack, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (map == MAP_FAILED)
        return NULL;
    if (slack == 0)
        return map;
    const size_t before = -(uintptr_t)map % LARGE_PAGE;
    if (before > 0)
        munmap(map, before);
    if (before < slack)
        munmap(map + before + bytes, slack - before);
    return map + before;
}

void *map_resize(void *map, size_t old_bytes, size_t new_bytes)
{
    void *moved = mremap(map, old_bytes, new_bytes, new_bytes < LARGE_PAGE ? MREMAP_MAYMOVE : 0);
    if (moved != MAP_FAILED || new_bytes < LARGE_PAGE)
        return moved == MAP_FAILED ? NULL : moved;
    void *place = map_new(new_bytes);
    if (!place)
        return NULL;
    moved = mremap(map, old_bytes, new_bytes, MREMAP_MAYMOVE | MREMAP_FIXED, place);
    if (moved == MAP_FAILED)
        munmap(place, new_bytes);
    return moved == MAP_FAILED ? NULL : moved;
}

/* ---- the interface ---- */

/* A large map that begins with less than a large page begins with small ones. */
static bool is_worth_it(size_t spare, size_t bytes)
{
    return bytes < LARGE_PAGE || spare >= LARGE_PAGE;
}

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
    const unsigned best = spares->count > 0 ? best_for(spares, bytes) : 0;
    if (spares->count > 0 && is_worth_it(spares->list[best].bytes, bytes)) {
        spare = spares->list[best];
        remove_entry(spares, best);
        if (spare.bytes > bytes) {
            add_entry(spares, spare.at + bytes, spare.bytes - bytes);
            spare.bytes = bytes;
        }
    }
    pthread_mutex_unlock(&spares->lock);
    if (spare.at && spare.bytes < bytes) {
        void *moved = map_resize(spare.at, spare.bytes, bytes);
        if (!moved)
            munmap(spare.at, spare.bytes);
        spare.at = moved;
    }
    if (spare.at) {
        *used = spare.bytes;
        return spare.at;
    }
    return map_new(bytes);
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
        const size_t rest = spare.bytes > excess ? spare.bytes - (size_t)excess : 0;
        const size_t kept = rest - rest % (rest < LARGE_PAGE ? page : LARGE_PAGE);
        remove_entry(spares, i);
        if (kept > 0)
            add_entry(spares, spare.at, kept);
        munmap(spare.at + kept, spare.bytes - kept);
    }
    pthread_mutex_unlock(&spares->lock);
}
