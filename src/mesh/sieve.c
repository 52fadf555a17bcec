/*
 * Welding most of a soup before it is one.
 *
 * A soup has each vertex six times, and to sort all corners by their coordinates takes, of memory
 * or of disk, six times what the mesh is. But corners that coincide come near each other in all
 * files but shuffled ones. So vertices that came by are remembered in a table of a bounded size, by
 * a hash of their coordinates; a corner that is there is no new vertex. What the table has
 * forgotten, or never had room for, becomes one more vertex, which weld.c finds: it sees to what is
 * right, the sieve only to how much that is. So neither the size of the table nor what it forgets
 * shapes a store, as the first of vertices that coincide is the first either way.
 *
 * The table is of sets of four places, a line of the cache each. It doubles while vertices come and
 * there is room; then the place in a set that an id falls on is taken over. Where the file is
 * shuffled and the table is full it holds little, and after a while nothing is looked up any more.
 */
#include "mesh/sieve.h"

#include <string.h>

#include "base/memory.h"

enum { SET = 4, LEAST_PLACES = 1 << 12, LEAST_IDS = 1 << 15, MOST_IDLE = 16 };

void sieve_open(struct context *ctx, struct sieve *sieve, uint64_t memory)
{
    memset(sieve, 0, sizeof *sieve);
    sieve->ctx = ctx;
    sieve->most_places = memory / sizeof(struct sieve_place);
}

void sieve_close(struct sieve *sieve)
{
    if (!sieve->ctx)
        return;
    memory_release(sieve->ctx, &sieve->places, sieve->place_count, sizeof *sieve->places);
    memory_release(sieve->ctx, &sieve->ids, sieve->id_capacity, sizeof *sieve->ids);
    memory_release(sieve->ctx, &sieve->kept, sieve->kept_capacity, sizeof *sieve->kept);
    memset(sieve, 0, sizeof *sieve);
}

void sieve_restart(struct sieve *sieve)
{
    sieve->first = 0;
    sieve->id_count = 0;
}

/* ---- the table ---- */

/* Set of four places for these coordinates. */
static inline struct sieve_place *set_of(const struct sieve *sieve, const uint32_t bits[3])
{
    uint64_t x = (bits[0] | (uint64_t)bits[1] << 32) * UINT64_C(0x9e3779b97f4a7c15);
    x = (x ^ x >> 32 ^ bits[2]) * UINT64_C(0xd6e8feb86659fd93);
    x ^= x >> 32;
    return sieve->places + (x & (sieve->place_count - 1) & ~(uint64_t)(SET - 1));
}

static inline struct sieve_place *find(struct sieve_place *set, const uint32_t bits[3])
{
    for (int i = 0; i < SET; i++) {
        if (set[i].id != UINT32_MAX && memcmp(set[i].bits, bits, sizeof set[i].bits) == 0)
            return &set[i];
    }
    return NULL;
}

/* A free place of the set, else the one that the id falls on. */
static inline void put(struct sieve *sieve, struct sieve_place *set, const uint32_t bits[3],
                       uint32_t id)
{
    unsigned at = 0;
    while (at < SET && set[at].id != UINT32_MAX)
        at++;
    sieve->filled += at < SET;
    at = at < SET ? at : id % SET;
    memcpy(set[at].bits, bits, sizeof set[at].bits);
    set[at].id = id;
}

/* Doubles the table, if there is room for both. */
static enum status grow(struct sieve *sieve)
{
    const size_t count = sieve->place_count;
    const size_t wanted = count ? 2 * count : LEAST_PLACES;
    struct sieve_place *old = sieve->places, *places;
    sieve->is_full = count && wanted + count > sieve->most_places;
    if (sieve->is_full)
        return STATUS_OK;
    enum status status = memory_take(sieve->ctx, wanted, sizeof *places, &places);
    if (status != STATUS_OK)
        return status;
    memset(places, 0xff, wanted * sizeof *places);
    sieve->places = places;
    sieve->place_count = wanted;
    sieve->filled = 0;
    for (size_t i = 0; i < count; i++) {
        if (old[i].id != UINT32_MAX)
            put(sieve, set_of(sieve, old[i].bits), old[i].bits, old[i].id);
    }
    memory_release(sieve->ctx, &old, count, sizeof *old);
    return STATUS_OK;
}

/* ---- corners ---- */

static enum status reserve_ids(struct sieve *sieve, size_t count)
{
    const size_t needed = sieve->id_count + count;
    return memory_reserve(sieve->ctx, &sieve->ids, &sieve->id_capacity,
                          needed < LEAST_IDS ? LEAST_IDS : needed, sizeof *sieve->ids);
}

enum status sieve_take(struct sieve *sieve, const float *floats, size_t count, uint64_t next_id,
                       size_t *kept)
{
    size_t made = 0;
    if (sieve->idle == MOST_IDLE) {
        *kept = count;
        sieve->out = floats;
        return sieve_pass(sieve, count, next_id);
    }
    *kept = 0;
    enum status status = reserve_ids(sieve, count);
    if (status == STATUS_OK)
        status = memory_reserve(sieve->ctx, &sieve->kept, &sieve->kept_capacity, 3 * count,
                                sizeof *sieve->kept);
    for (size_t i = 0; i < count && status == STATUS_OK; i++) {
        const float *p = floats + 3 * i;
        const float positive[3] = {p[0] + 0.0f, p[1] + 0.0f, p[2] + 0.0f};
        uint32_t bits[3];
        memcpy(bits, positive, sizeof bits);
        if (sieve->filled >= sieve->place_count / 4 * 3 && !sieve->is_full)
            status = grow(sieve);
        if (status != STATUS_OK)
            break;
        struct sieve_place *set = set_of(sieve, bits), *found = find(set, bits);
        if (found) {
            sieve->ids[sieve->id_count++] = found->id;
            continue;
        }
        const uint32_t id = (uint32_t)(next_id + made);
        put(sieve, set, bits, id);
        sieve->ids[sieve->id_count++] = id;
        memcpy(sieve->kept + 3 * made++, p, 3 * sizeof *p);
    }
    sieve->held += count - made;
    sieve->idle = sieve->is_full && count - made < count / 2 ? sieve->idle + 1 : 0;
    sieve->out = sieve->kept;
    *kept = made;
    return status;
}

enum status sieve_pass(struct sieve *sieve, size_t count, uint64_t next_id)
{
    enum status status = reserve_ids(sieve, count);
    for (size_t i = 0; i < count && status == STATUS_OK; i++)
        sieve->ids[sieve->id_count++] = (uint32_t)(next_id + i);
    return status;
}

enum status sieve_name(struct sieve *sieve, uint32_t *corners, size_t count)
{
    size_t past = 0; /* the last one named */
    for (size_t i = 0; i < count; i++) {
        const uint64_t at = corners[i] - sieve->first; /* wraps where it has been named */
        if (at >= sieve->id_count)
            return fail(sieve->ctx, STATUS_INTERNAL, "a face of a soup is not at its corners");
        past = at >= past ? (size_t)at + 1 : past;
        corners[i] = sieve->ids[at];
    }
    sieve->id_count -= past;
    sieve->first += past;
    memmove(sieve->ids, sieve->ids + past, sieve->id_count * sizeof *sieve->ids);
    return STATUS_OK;
}
