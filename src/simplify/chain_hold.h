/*
 * Blocks that go from patchify to lod in one run as they are, where there is memory for them:
 * beside the run's chain file, which says of these that they have no bytes in it.
 */
#ifndef SPBM_SIMPLIFY_CHAIN_HOLD_H
#define SPBM_SIMPLIFY_CHAIN_HOLD_H

#include "simplify/patch.h"

struct context;
struct held_block;

/* All zero holds nothing, and needs no clearing. */
struct chain_hold {
    struct context *ctx;
    uint64_t most_bytes;  /* that may be held */
    uint64_t most_in_use; /* of the context's account, a block counted that is to be held */
    uint32_t stride;      /* of attribute records */
    uint32_t slab_count;
    struct held_block *blocks; /* one a slab */
    _Atomic uint64_t bytes;    /* held */
};

/* Prepares for the blocks of so many slabs; both limits are the caller's. */
enum status chain_hold_begin(struct context *ctx, uint32_t slab_count, uint32_t stride,
                             struct chain_hold *hold) MUST_CHECK;
/* Takes a copy of a block as a chain file would give it, but for its seam chains; *is_held is
 * false, and nothing is done, if the limits forbid it. From any worker, each slab once. */
enum status chain_hold_take(struct chain_hold *hold, const struct chain_block *block,
                            bool *is_held) MUST_CHECK;
/* The block of a slab, whose arrays stay the hold's; false if it is not held. */
bool chain_hold_give(const struct chain_hold *hold, uint32_t slab, struct chain_block *block);
/* The bytes that the block of a slab takes here; 0 if it is not held. `hold` may be NULL. */
size_t chain_hold_size(const struct chain_hold *hold, uint32_t slab);
/* Safe on NULL. */
void chain_hold_clear(struct chain_hold *hold);

#endif
