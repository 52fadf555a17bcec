/*
 * Blocks that stand alone.
 *
 * Compressing a whole stream makes it small, but to read its middle everything before must be
 * inflated, one flipped bit spoils all that follows, and threads can't share the work. Blocks of a
 * slab each cost a few bytes more and have none of that. Sizes are stated and checked before
 * anything is allocated for them.
 *
 * A block is stored as it is when deflate does not make it smaller; then both sizes are equal,
 * which is how a reader tells.
 */
#include "base/block_stream.h"

#include <libdeflate.h>
#include <string.h>

#include "base/bytes.h"
#include "base/checksum.h"
#include "base/memory.h"

static const unsigned char block_magic[4] = {'b', 'l', 'k', '1'};

enum {
    STORED_SIZE_AT = 4,
    RAW_SIZE_AT = 8,
    RAW_CRC_AT = 12,
    STORED_CRC_AT = 16,
    HEADER_CRC_AT = 20,
    LARGEST_RATIO = 1032 /* deflate: a 258-byte match in 2 bits */
};

/* Compresses into `to` if the result is smaller than `raw_size`; *stored is 0 if it is not. */
static enum status compress_block(struct context *ctx, const void *raw, size_t raw_size, int level,
                                  unsigned char *to, size_t *stored)
{
    *stored = 0;
    if (level == 0 || raw_size < 2)
        return STATUS_OK;
    struct libdeflate_compressor *compressor =
        fault_due(ctx) ? NULL : libdeflate_alloc_compressor(level);
    if (!compressor)
        return fail(ctx, STATUS_NO_MEMORY, "not enough memory to compress a block");
    *stored = libdeflate_deflate_compress(compressor, raw, raw_size, to, raw_size - 1);
    libdeflate_free_compressor(compressor);
    return STATUS_OK;
}

enum status block_pack(struct context *ctx, const void *raw, size_t raw_size, int level,
                       unsigned char **block, size_t *size)
{
    *block = NULL;
    *size = 0;
    if (raw_size > BLOCK_MAX || level < 0 || level > 12)
        return fail(ctx, STATUS_INTERNAL, "a block of %zu bytes at level %d can't be packed",
                    raw_size, level);
    size_t capacity = BLOCK_HEADER_SIZE + raw_size;
    unsigned char *made;
    enum status status = memory_take(ctx, capacity, 1, &made);
    if (status != STATUS_OK)
        return status;

    size_t stored;
    status = compress_block(ctx, raw, raw_size, level, made + BLOCK_HEADER_SIZE, &stored);
    if (status != STATUS_OK)
        goto failed;
    if (stored == 0) {
        stored = raw_size;
        if (raw_size > 0)
            memcpy(made + BLOCK_HEADER_SIZE, raw, raw_size);
    }
    memcpy(made, block_magic, sizeof block_magic);
    store_u32(made + STORED_SIZE_AT, (uint32_t)stored);
    store_u32(made + RAW_SIZE_AT, (uint32_t)raw_size);
    store_u32(made + RAW_CRC_AT, checksum(0, raw, raw_size));
    store_u32(made + STORED_CRC_AT, checksum(0, made + BLOCK_HEADER_SIZE, stored));
    store_u32(made + HEADER_CRC_AT, checksum(0, made, HEADER_CRC_AT));

    status = memory_resize(ctx, &made, capacity, BLOCK_HEADER_SIZE + stored, 1);
    if (status != STATUS_OK)
        goto failed;
    *block = made;
    *size = BLOCK_HEADER_SIZE + stored;
    return STATUS_OK;
failed:
    memory_release(ctx, &made, capacity, 1);
    return status;
}

/* Checks the header, and that the block is all there; sizes are to be believed after that. */
static enum status check_header(struct context *ctx, const char *what, const unsigned char *block,
                                size_t available)
{
    if (available < BLOCK_HEADER_SIZE)
        return fail(ctx, STATUS_BAD_INPUT, "%s: the block is cut off in its header", what);
    if (memcmp(block, block_magic, sizeof block_magic) != 0)
        return fail(ctx, STATUS_BAD_INPUT, "%s: no block begins here", what);
    if (!checksum_agrees(checksum(0, block, HEADER_CRC_AT), load_u32(block + HEADER_CRC_AT)))
        return fail(ctx, STATUS_BAD_INPUT, "%s: the block's header is damaged", what);

    uint64_t stored = load_u32(block + STORED_SIZE_AT);
    uint64_t raw = load_u32(block + RAW_SIZE_AT);
    if (raw > BLOCK_MAX || stored > raw || raw > LARGEST_RATIO * stored)
        return fail(ctx, STATUS_BAD_INPUT,
                    "%s: the block's sizes are impossible: %llu bytes stored, %llu unpacked", what,
                    (unsigned long long)stored, (unsigned long long)raw);
    if (stored > available - BLOCK_HEADER_SIZE)
        return fail(ctx, STATUS_BAD_INPUT,
                    "%s: the block is cut off: %zu of its %llu bytes are there", what,
                    available - BLOCK_HEADER_SIZE, (unsigned long long)stored);
    return STATUS_OK;
}

static enum status inflate_block(struct context *ctx, const char *what, const unsigned char *from,
                                 size_t stored, unsigned char *to, size_t raw_size)
{
    struct libdeflate_decompressor *decompressor =
        fault_due(ctx) ? NULL : libdeflate_alloc_decompressor();
    if (!decompressor)
        return fail(ctx, STATUS_NO_MEMORY, "%s: not enough memory to unpack the block", what);
    size_t taken, made;
    enum libdeflate_result result =
        libdeflate_deflate_decompress_ex(decompressor, from, stored, to, raw_size, &taken, &made);
    libdeflate_free_decompressor(decompressor);
    if (result != LIBDEFLATE_SUCCESS || taken != stored || made != raw_size)
        return fail(ctx, STATUS_BAD_INPUT, "%s: the block does not unpack to the size it states",
                    what);
    return STATUS_OK;
}

enum status block_unpack(struct context *ctx, const char *what, const unsigned char *block,
                         size_t available, unsigned char **raw, size_t *raw_size, size_t *taken)
{
    *raw = NULL;
    *raw_size = *taken = 0;
    enum status status = check_header(ctx, what, block, available);
    if (status != STATUS_OK)
        return status;
    size_t stored = load_u32(block + STORED_SIZE_AT);
    size_t size = load_u32(block + RAW_SIZE_AT);
    const unsigned char *from = block + BLOCK_HEADER_SIZE;
    if (!checksum_agrees(checksum(0, from, stored), load_u32(block + STORED_CRC_AT)))
        return fail(ctx, STATUS_BAD_INPUT, "%s: the block is damaged", what);

    unsigned char *made;
    status = memory_take(ctx, size, 1, &made);
    if (status != STATUS_OK)
        return status;
    if (stored == size)
        memcpy(made, from, size);
    else
        status = inflate_block(ctx, what, from, stored, made, size);
    if (status == STATUS_OK &&
        !checksum_agrees(checksum(0, made, size), load_u32(block + RAW_CRC_AT)))
        status = fail(ctx, STATUS_BAD_INPUT, "%s: the block is damaged", what);
    if (status != STATUS_OK) {
        memory_release(ctx, &made, size, 1);
        return status;
    }
    *raw = made;
    *raw_size = size;
    *taken = BLOCK_HEADER_SIZE + stored;
    return STATUS_OK;
}
