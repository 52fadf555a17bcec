/*
 * How the memory budget is divided at import. The account of memory.h bounds what is allocated;
 * code, stacks and the resident parts of mapped temporary files come on top, so that room for them
 * is set aside here, and everything whose size can be chosen is sized from what is left.
 */
#ifndef SPBM_MESH_ROOM_H
#define SPBM_MESH_ROOM_H

#include "base/file.h"

struct room {
    struct context *ctx;
    const char *beside;   /* borrowed: where temporary files go */
    uint64_t bytes;       /* for all that is allocated or mapped at a time; UINT64_MAX: no limit */
    uint64_t spools;      /* of these, for spools in memory, together */
    uint64_t sorter;      /* of these, for each sort beside the work on slabs */
    uint64_t floor;       /* what is taken to be left at least */
    unsigned in_flight;   /* slabs worked on at a time, which also limits the threads */
    unsigned block_shift; /* log2 of the bytes in which mapped spools become resident */
};

/*
 * The least context.memory_budget for building a store, whatever the input's order:
 *     ROOM_FIXED + (ROOM_A_FACE + stride) * 2^slab_shift + faces / ROOM_FACES_A_BYTE
 * for `faces` faces (0: not known) whose vertices have attribute records of `stride` bytes. The
 * last term is the bit a vertex that tells which slabs share it, of a mesh of two faces a vertex.
 */
enum {
    ROOM_FIXED = 4 << 20, /* buffers of streams and spools, windows of sweeps */
    ROOM_A_FACE = 160,    /* a slab at work: mapped, matched or surveyed at its worst */
    ROOM_FACES_A_BYTE = 16
};
uint64_t room_least(unsigned slab_shift, uint64_t faces, uint32_t stride);

/* Divides the context's budget. `working_memory`, for tests, replaces it if not 0: then there is
 * room for so many bytes beyond what every run needs. */
void room_divide(struct context *ctx, struct room *room, const char *beside, unsigned slab_shift,
                 uint64_t working_memory);

/* Room for spools of `spools` bytes in memory and sorts of `sorts`, whatever the budget. */
void room_set(struct context *ctx, struct room *room, const char *beside, uint64_t spools,
              uint64_t sorts);

/* What is left for something that is taken now; UINT64_MAX without a limit. */
uint64_t room_left(const struct room *room);

/* A growing spool's limit when `count` of them grow together. */
uint64_t room_spool_limit(const struct room *room, unsigned count);

/* Whether room_scratch would put so many bytes into memory. */
bool room_fits(const struct room *room, uint64_t size);

/* Zeroed scratch bytes, in memory or in a mapped file. */
enum status room_scratch(const struct room *room, struct spool *spool, uint64_t size,
                         void *data) MUST_CHECK;

/* ---- residency of mapped spools ---- */

/* The pages of [offset, offset + size) leave the process, and stay in the file: looking at them
 * brings them back. Without effect on a spool in memory. */
void spool_forget(const struct spool *spool, uint64_t offset, uint64_t size);

/* All of it. */
static inline void spool_forget_all(const struct spool *spool)
{
    spool_forget(spool, 0, spool->size);
}

/* A look at a page of it reads no others from now on; what is to be read at once is expected. */
void spool_jumps(const struct spool *spool);

/* The pages of [offset, offset + size) will be looked at soon: the system begins to read what of
 * them it does not hold. */
void spool_expect(const struct spool *spool, uint64_t offset, uint64_t size);

/* A sweep from the front has come to `offset`: what is behind leaves, what comes next is expected.
 */
enum { SWEEP_AHEAD = 4 << 20 };
static inline void spool_pass(const struct spool *spool, uint64_t offset)
{
    spool_forget(spool, 0, offset);
    spool_expect(spool, offset, SWEEP_AHEAD);
}

/* Elements of a long sweep between two calls. */
enum { FORGET_EVERY = 1 << 17 };

/*
 * Looking at places of a spool in any order: the blocks that have become resident are counted, and
 * when there are too many, all of them leave. One per thread.
 */
struct visits {
    const struct spool *spool;
    struct context *ctx;
    uint8_t *seen; /* a block: the epoch in which it was last looked at; NULL: spool in memory */
    uint64_t block_count;
    unsigned block_shift;
    uint64_t first; /* of the map within its first block: blocks are aligned in memory */
    uint8_t epoch;
    uint64_t resident, most;
    uint64_t total; /* blocks that have become resident, counted each time */
};

enum status visits_begin(const struct room *room, struct visits *visits, const struct spool *spool,
                         uint64_t most_bytes) MUST_CHECK;
void visits_end(struct visits *visits); /* the spool's pages leave; safe when all zero */
void visits_first(struct visits *visits, uint64_t block); /* private */

/* Call it before looking at the byte there. */
static inline void visit(struct visits *visits, uint64_t offset)
{
    uint64_t block = (visits->first + offset) >> visits->block_shift;
    if (visits->seen && visits->seen[block] != visits->epoch)
        visits_first(visits, block);
}

#endif
