/*
 * Patchify could hand its blocks to lod through the chain file alone, as two runs do. But coding,
 * checksums, copies and decoding are 3 % of what a run computes (scan of 1.1 million faces), only
 * to get back what was there. As they are blocks take twice the room, in memory that must not go
 * beyond what the run takes anyway. So a block is copied into one piece of memory as long as the
 * limits allow, and is coded else. A level is the same whichever way its blocks went: coding loses
 * nothing, since patches have normals that a code has from the first (chain_trace.c).
 */
#include "simplify/chain_hold.h"

#include <string.h>

#include "base/memory.h"

struct held_block {
    struct chain_block block;
    unsigned char *memory; /* all its arrays; NULL: it is not held */
    size_t size;
};

enum status chain_hold_begin(struct context *ctx, uint32_t slab_count, uint32_t stride,
                             struct chain_hold *hold)
{
    hold->ctx = ctx;
    hold->stride = stride;
    hold->slab_count = slab_count;
    return memory_take_zeroed(ctx, slab_count, sizeof *hold->blocks, &hold->blocks);
}

void chain_hold_clear(struct chain_hold *hold)
{
    if (!hold)
        return;
    for (uint32_t i = 0; hold->blocks && i < hold->slab_count; i++)
        memory_release(hold->ctx, &hold->blocks[i].memory, hold->blocks[i].size, 1);
    if (hold->ctx)
        memory_release(hold->ctx, &hold->blocks, hold->slab_count, sizeof *hold->blocks);
    memset(hold, 0, sizeof *hold);
}

/* Whether `size` bytes more may be held; they count as held if so. */
static bool fits(struct chain_hold *hold, size_t size)
{
    const uint64_t now = atomic_load(&hold->ctx->memory_now);
    const uint64_t held = atomic_fetch_add(&hold->bytes, size);
    if (now + size <= hold->most_in_use && held + size <= hold->most_bytes)
        return true;
    atomic_fetch_sub(&hold->bytes, size);
    return false;
}

/* Where a piece of `bytes` lies in the memory whose first *used bytes are taken. */
static size_t place_piece(size_t *used, size_t bytes)
{
    const size_t at = *used;
    *used = at + (bytes + 15) / 16 * 16;
    return at;
}

static void *copy_piece(unsigned char *to, const void *from, size_t bytes)
{
    if (bytes)
        memcpy(to, from, bytes);
    return to;
}

enum status chain_hold_take(struct chain_hold *hold, const struct chain_block *block, bool *is_held)
{
    struct held_block *held = &hold->blocks[block->slab];
    struct chain_block *to = &held->block;
    const size_t positions = block->vertex_count * (3 * sizeof(float));
    const size_t records = block->records ? block->vertex_count * (size_t)hold->stride : 0;
    const size_t seams = block->seam_vertex_count * sizeof *block->seam_vertices;
    const size_t chains = block->chain_count * sizeof *block->chains;
    const size_t patches = block->patch_count * sizeof *block->patches;
    const size_t diagonals = block->diagonal_count * (2 * sizeof *block->diagonals);
    size_t size = 0;
    const size_t positions_at = place_piece(&size, positions);
    const size_t records_at = place_piece(&size, records);
    const size_t seams_at = place_piece(&size, seams);
    const size_t chains_at = place_piece(&size, chains);
    const size_t patches_at = place_piece(&size, patches);
    const size_t diagonals_at = place_piece(&size, diagonals);
    *is_held = fits(hold, size);
    if (!*is_held)
        return STATUS_OK;
    enum status status = memory_take(hold->ctx, size, 1, &held->memory);
    if (status)
        return status;
    unsigned char *memory = held->memory;
    held->size = size;
    *to = *block;
    to->seam_chains = NULL;
    to->seam_lists = NULL;
    to->seam_chain_count = to->seam_list_count = 0;
    to->positions = copy_piece(memory + positions_at, block->positions, positions);
    to->records = records ? copy_piece(memory + records_at, block->records, records) : NULL;
    to->seam_vertices = copy_piece(memory + seams_at, block->seam_vertices, seams);
    to->chains = copy_piece(memory + chains_at, block->chains, chains);
    to->patches = copy_piece(memory + patches_at, block->patches, patches);
    to->diagonals = copy_piece(memory + diagonals_at, block->diagonals, diagonals);
    return STATUS_OK;
}

bool chain_hold_give(const struct chain_hold *hold, uint32_t slab, struct chain_block *block)
{
    if (slab >= hold->slab_count || !hold->blocks[slab].memory)
        return false;
    *block = hold->blocks[slab].block;
    return true;
}

size_t chain_hold_size(const struct chain_hold *hold, uint32_t slab)
{
    return hold && slab < hold->slab_count && hold->blocks[slab].memory ? hold->blocks[slab].size
                                                                        : 0;
}
