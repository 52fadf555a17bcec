/*
 * Slabs that go from import to the next stage of the same run in the very memory that import had
 * them in: beside the run's store, whose section of slabs lacks them.
 */
#ifndef SPBM_MESH_STORE_HOLD_H
#define SPBM_MESH_STORE_HOLD_H

#include <pthread.h>

#include "mesh/store.h"

struct draft;
struct frame;
struct slab_scope;
struct held_slab;

/* An array of the draft whose front is given back as slabs are done with. */
struct held_array {
    unsigned char *base; /* where it begins, or began */
    unsigned char *rest; /* the block that there is still */
    size_t rest_size;
};

/* What the account may have with what is held for the next stage: what it had before, or so many
 * bytes a vertex, which is what an import takes whose order is not a scan's. */
enum { HOLD_VERTEX = 86 };
static inline uint64_t hold_most_in_use(const struct context *ctx, uint64_t vertices)
{
    const uint64_t peak = atomic_load(&ctx->memory_peak), plain = HOLD_VERTEX * vertices;
    return peak > plain ? peak : plain;
}

/* All zero holds nothing, and needs no clearing. */
struct store_hold {
    struct context *ctx;
    uint64_t most_bytes;  /* the caller's: what may be held; 0: nothing */
    uint64_t beside;      /* the caller's: what will be taken beside them, less what slabs at work
                             are forgotten for */
    uint32_t slab_count;  /* held: the first so many of the store */
    uint32_t done_before; /* all slabs before it are forgotten */
    unsigned slab_shift;
    uint32_t stride;
    struct held_array faces, neighbours, mates, positions, records;
    struct held_slab *slabs;
    pthread_mutex_t lock; /* of done_before, is_done and the rests; while there are slabs */
};

/* ---- for store_write ---- */

/* Chooses how many slabs will be held of a draft that is done: none where it is not in memory. What
 * was begun before is dropped. */
enum status store_hold_begin(struct store_hold *hold, const struct draft *draft) MUST_CHECK;
/* Keeps what the draft does not: the list of foreign vertices with their positions. */
enum status store_hold_add(struct store_hold *hold, const struct slab_scope *scope, uint32_t slab,
                           const float *foreign_positions) MUST_CHECK;
/* Takes the slabs' arrays from the draft, of which only draft_clear makes sense then. */
enum status store_hold_take(struct store_hold *hold, const struct frame *frame,
                            struct draft *draft) MUST_CHECK;

/* ---- for store_read ---- */

static inline bool store_hold_has(const struct store_hold *hold, uint32_t slab)
{
    return hold && slab < hold->slab_count;
}

/* Points a slab that is held to its arrays, which stay the hold's. */
void store_hold_give(const struct store_hold *hold, uint32_t index, struct slab *slab);
/* Nobody will look at the slab's faces, neighbours and positions any more: their memory is given
 * back as soon as those before it are forgotten, too. From any worker. */
void store_hold_forget(struct store_hold *hold, uint32_t slab);

void store_hold_clear(struct store_hold *hold);

#endif
