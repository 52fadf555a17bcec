/*
 * The bytes of a block before packing, as chain_format.md describes them: columns of small numbers
 * and planes of bytes, which deflate makes small.
 *
 * Decoding trusts nothing: counts are bounded by the bytes that are there before anything is
 * allocated, and every index is in range afterwards. Whether loops close is chain_loops.h's matter.
 */
#ifndef SPBM_SIMPLIFY_CHAIN_CODE_H
#define SPBM_SIMPLIFY_CHAIN_CODE_H

#include "simplify/chain_file.h"

/* Encodes all but the seam chains. The bytes are put into `room` (may be NULL) if `room_size` bytes
 * are enough, *capacity is 0 then; else *raw (*capacity bytes, *size of them used) is released with
 * memory_release(ctx, &raw, capacity, 1). STATUS_INTERNAL when the block's order is not the one
 * that patch.h and chain_format.md ask for. */
enum status chain_block_encode(struct context *ctx, const struct chain_block *block,
                               uint32_t stride, void *room, size_t room_size, unsigned char **raw,
                               size_t *capacity, size_t *size) MUST_CHECK;

/* Fills *block, seam chains left out; `what` names file and block for messages. On failure there is
 * nothing to clear. */
enum status chain_block_decode(struct context *ctx, const char *what, const unsigned char *raw,
                               size_t size, uint32_t slab, uint32_t stride,
                               struct chain_block *block) MUST_CHECK;

/* The seam chains of a block, its seam fields alone; decoding adds them to a block whose other
 * fields are there, and leaves clearing it to the caller. */
enum status seam_chains_encode(struct context *ctx, const struct chain_block *block,
                               unsigned char **raw, size_t *capacity, size_t *size) MUST_CHECK;
enum status seam_chains_decode(struct context *ctx, const char *what, const unsigned char *raw,
                               size_t size, uint32_t slab_count,
                               struct chain_block *block) MUST_CHECK;

#endif
