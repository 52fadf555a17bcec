/*
 * Dividing the budget, and keeping mapped spools within it.
 *
 * What is resident of a mapped file counts as memory of the process, and nobody bounds it: a sweep
 * leaves all that it has seen. So sweeps forget what is behind them, and whoever looks at places in
 * any order counts the blocks that this brings in. A fault brings in what stands round it: an
 * aligned block of 64 KiB, and since Linux 6.18 all that was written by one call, for which spools
 * are written in pieces of that size. So a byte a block is all the book-keeping.
 *
 * What the system reads ahead of its own accord may be megabytes round each fault, most of which is
 * dropped again before it is looked at where memory is short. So a draft's maps are marked as read
 * at random, and what is to be read at once is said: what a sweep comes to next, a slab, a block.
 *
 * The maps are shared maps of files without names, so that MADV_DONTNEED only takes pages out of
 * the process's page tables: what was written stays in the file's pages, which the system may write
 * out and drop as it likes.
 */
#include "mesh/room.h"

#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "base/memory.h"

enum { BLOCK_SHIFT = 16, TEST_BLOCK_SHIFT = 7, FLOOR = 256 << 10 };

uint64_t room_least(unsigned slab_shift, uint64_t faces, uint32_t stride)
{
    return ROOM_FIXED + ((uint64_t)(ROOM_A_FACE + stride) << slab_shift) +
           faces / ROOM_FACES_A_BYTE;
}

void room_divide(struct context *ctx, struct room *room, const char *beside, unsigned slab_shift,
                 uint64_t working_memory)
{
    const uint64_t a_slab = (uint64_t)ROOM_A_FACE << slab_shift;
    *room = (struct room){.ctx = ctx,
                          .beside = beside,
                          .bytes = UINT64_MAX,
                          .floor = FLOOR,
                          .spools = UINT64_MAX,
                          .sorter = UINT64_MAX,
                          .in_flight = ctx->threads + 1,
                          .block_shift = BLOCK_SHIFT};
    if (working_memory) {
        room->bytes = atomic_load(&ctx->memory_now) + working_memory;
        room->block_shift = TEST_BLOCK_SHIFT;
        room->spools = room->sorter = room->floor = working_memory / 4;
        return;
    }
    if (ctx->memory_budget == UINT64_MAX)
        return;
    room->bytes = ctx->memory_budget > ROOM_FIXED ? ctx->memory_budget - ROOM_FIXED : 0;
    uint64_t slabs = room->bytes / 4 * 3 / a_slab;
    if (slabs < room->in_flight)
        room->in_flight = slabs > 1 ? (unsigned)slabs : 1;
    uint64_t work = room->in_flight * a_slab;
    uint64_t rest = work < room->bytes ? room->bytes - work : 0;
    room->spools = rest / 2;
    room->sorter = rest / 8;
}

void room_set(struct context *ctx, struct room *room, const char *beside, uint64_t spools,
              uint64_t sorts)
{
    const uint64_t now = atomic_load(&ctx->memory_now);
    *room = (struct room){.ctx = ctx,
                          .beside = beside,
                          .bytes = now + spools + 2 * sorts, /* sorts take half of what is left */
                          .spools = now + spools,
                          .sorter = sorts,
                          .floor = sorts,
                          .in_flight = ctx->threads + 1,
                          .block_shift = BLOCK_SHIFT};
}

uint64_t room_left(const struct room *room)
{
    if (room->bytes == UINT64_MAX)
        return UINT64_MAX;
    uint64_t now = atomic_load(&room->ctx->memory_now);
    uint64_t left = now < room->bytes ? room->bytes - now : 0;
    /* what is left may be filled with pages of files, which nothing would weigh against spare maps
     */
    const uint64_t spare = memory_limit_spares(room->ctx, left / 8);
    left -= spare;
    return left > room->floor ? left : room->floor;
}

uint64_t room_spool_limit(const struct room *room, unsigned count)
{
    /* A vector that grows has up to half more room than it needs. */
    return room->spools == UINT64_MAX ? UINT64_MAX : room->spools / count / 3 * 2;
}

bool room_fits(const struct room *room, uint64_t size)
{
    if (room->spools == UINT64_MAX)
        return true;
    uint64_t now = atomic_load(&room->ctx->memory_now);
    return now <= room->spools && size <= room->spools - now;
}

enum status room_scratch(const struct room *room, struct spool *spool, uint64_t size, void *data)
{
    void *bytes;
    enum status status = spool_scratch(room->ctx, spool, room->beside,
                                       room_fits(room, size) ? size : 0, size, &bytes);
    if (status == STATUS_OK) {
        spool_jumps(spool);
        memcpy(data, &bytes, sizeof bytes);
    }
    return status;
}

/* ---- residency ---- */

void spool_forget(const struct spool *spool, uint64_t offset, uint64_t size)
{
    if (!spool->map || offset >= spool->size)
        return;
    const uint64_t page = (uint64_t)sysconf(_SC_PAGESIZE);
    uint64_t end = size < spool->size - offset ? offset + size : spool->size;
    offset = offset / page * page; /* a page that is still in use comes back */
    if (end > offset)
        (void)madvise((char *)spool->map + offset, (size_t)(end - offset), MADV_DONTNEED);
}

void spool_jumps(const struct spool *spool)
{
    if (spool->map)
        (void)madvise(spool->map, (size_t)spool->size, MADV_RANDOM);
}

void spool_expect(const struct spool *spool, uint64_t offset, uint64_t size)
{
    enum { CALL = 1 << 20 }; /* more than the system's own limit in one call is not read */
    if (!spool->map || offset >= spool->size)
        return;
    const uint64_t page = (uint64_t)sysconf(_SC_PAGESIZE);
    const uint64_t end = size < spool->size - offset ? offset + size : spool->size;
    for (offset = offset / page * page; offset < end; offset += CALL) {
        const uint64_t left = end - offset;
        (void)madvise((char *)spool->map + offset, (size_t)(left < CALL ? left : CALL),
                      MADV_WILLNEED);
    }
}

enum status visits_begin(const struct room *room, struct visits *visits, const struct spool *spool,
                         uint64_t most_bytes)
{
    *visits = (struct visits){.spool = spool, .ctx = room->ctx, .block_shift = room->block_shift};
    if (!spool->map)
        return STATUS_OK;
    visits->epoch = 1;
    visits->most = most_bytes >> room->block_shift;
    if (visits->most < 4)
        visits->most = 4;
    visits->first = (uintptr_t)spool->map & (((uint64_t)1 << room->block_shift) - 1);
    visits->block_count = ((visits->first + spool->size) >> room->block_shift) + 1;
    return memory_take_zeroed(room->ctx, (size_t)visits->block_count, 1, &visits->seen);
}

void visits_end(struct visits *visits)
{
    if (!visits->seen)
        return;
    spool_forget_all(visits->spool);
    memory_release(visits->ctx, &visits->seen, (size_t)visits->block_count, 1);
}

void visits_first(struct visits *visits, uint64_t block)
{
    if (visits->resident == visits->most) {
        spool_forget_all(visits->spool);
        visits->resident = 0;
        if (++visits->epoch == 0) {
            memset(visits->seen, 0, (size_t)visits->block_count);
            visits->epoch = 1;
        }
    }
    const uint64_t begin = block << visits->block_shift;
    const uint64_t size = (uint64_t)1 << visits->block_shift;
    spool_expect(visits->spool, begin > visits->first ? begin - visits->first : 0, size);
    visits->seen[block] = visits->epoch;
    visits->resident++;
    visits->total++;
}
