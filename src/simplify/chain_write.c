/*
 * Writing a chain file: one pass, front to back. The blocks come while patches grow, the seams when
 * all slabs are known, the index and the info last; nothing is patched afterwards, so that the file
 * can go into a pipe.
 */
#include <string.h>

#include "base/block_stream.h"
#include "base/bytes.h"
#include "base/memory.h"
#include "simplify/chain_code.h"
#include "simplify/chain_frame.h"

struct chain_writer {
    struct context *ctx;
    struct section_writer file;
    int level;
    uint32_t slab_count;
    uint32_t blocks; /* written so far */
    uint32_t seams;
    struct chain_sizes *sizes;
};

enum status chain_writer_open(struct context *ctx, const char *path, int level, uint32_t slab_count,
                              uint32_t stride, struct chain_writer **out)
{
    (void)stride; /* blocks come packed */
    struct chain_writer *writer;
    *out = NULL;
    enum status status = memory_take_zeroed(ctx, 1, sizeof *writer, &writer);
    if (status)
        return status;
    writer->ctx = ctx;
    writer->level = level;
    writer->slab_count = slab_count;
    status = memory_take_zeroed(ctx, slab_count, sizeof *writer->sizes, &writer->sizes);
    if (!status) {
        status = section_file_create(ctx, path, CHAIN_MAGIC, CHAIN_VERSION, &writer->file);
        if (status)
            memset(&writer->file, 0, sizeof writer->file);
    }
    if (!status)
        status = section_begin(&writer->file, CHAIN_SECTION_BLOCKS);
    if (status)
        chain_writer_discard(&writer);
    *out = writer;
    return status;
}

static void release(struct chain_writer **writer)
{
    struct context *ctx = (*writer)->ctx;
    memory_release(ctx, &(*writer)->sizes, (*writer)->slab_count, sizeof *(*writer)->sizes);
    memory_release(ctx, writer, 1, sizeof **writer);
}

void chain_writer_discard(struct chain_writer **writer)
{
    if (!*writer)
        return;
    section_file_discard(&(*writer)->file);
    release(writer);
}

/* Raw bytes to a packed block; `raw` is released either way, unless its capacity is 0. */
static enum status pack(struct context *ctx, unsigned char *raw, size_t capacity, size_t size,
                        int level, unsigned char **packed, size_t *packed_size)
{
    enum status status =
        size > BLOCK_MAX ? fail(ctx, STATUS_BAD_INPUT, "a block of %zu bytes is too large", size)
                         : block_pack(ctx, raw, size, level, packed, packed_size);
    if (capacity)
        memory_release(ctx, &raw, capacity, 1);
    return status;
}

enum status chain_block_pack(struct context *ctx, const struct chain_block *block, uint32_t stride,
                             int level, void *room, size_t room_size, unsigned char **packed,
                             size_t *size)
{
    unsigned char *raw;
    size_t capacity, raw_size;
    enum status status =
        chain_block_encode(ctx, block, stride, room, room_size, &raw, &capacity, &raw_size);
    if (status)
        return status;
    return pack(ctx, raw, capacity, raw_size, level, packed, size);
}

enum status chain_writer_block(struct chain_writer *writer, const unsigned char *packed,
                               size_t size)
{
    if (writer->blocks == writer->slab_count || size > UINT32_MAX)
        return fail(writer->ctx, STATUS_INTERNAL, "a chain file gets more blocks than slabs");
    writer->sizes[writer->blocks++].block = (uint32_t)size;
    return size ? section_append(&writer->file, packed, size) : STATUS_OK;
}

/* Ends the blocks and begins the seams, once all blocks are there. */
static enum status begin_seams(struct chain_writer *writer)
{
    if (writer->blocks != writer->slab_count)
        return fail(writer->ctx, STATUS_INTERNAL, "a chain file got %u blocks of %u",
                    writer->blocks, writer->slab_count);
    enum status status = section_end(&writer->file);
    return status ? status : section_begin(&writer->file, CHAIN_SECTION_SEAMS);
}

enum status chain_writer_seams(struct chain_writer *writer, const struct chain_block *block)
{
    struct context *ctx = writer->ctx;
    enum status status = STATUS_OK;
    if (writer->seams == 0)
        status = begin_seams(writer);
    if (!status && (writer->seams == writer->slab_count || block->slab != writer->seams))
        status = fail(ctx, STATUS_INTERNAL, "seams of slab %u come out of order", block->slab);
    if (status)
        return status;
    unsigned char *raw, *packed = NULL;
    size_t capacity, raw_size, size = 0;
    status = seam_chains_encode(ctx, block, &raw, &capacity, &raw_size);
    if (!status)
        status = pack(ctx, raw, capacity, raw_size, writer->level, &packed, &size);
    if (!status) {
        writer->sizes[writer->seams++].seams = (uint32_t)size;
        status = section_append(&writer->file, packed, size);
    }
    memory_release(ctx, &packed, size, 1);
    return status;
}

static enum status append_index(struct chain_writer *writer)
{
    enum status status = section_begin(&writer->file, CHAIN_SECTION_INDEX);
    for (uint32_t i = 0; i < writer->slab_count && !status; i++) {
        unsigned char entry[CHAIN_INDEX_ENTRY];
        store_u32(entry, writer->sizes[i].block);
        store_u32(entry + 4, writer->sizes[i].seams);
        status = section_append(&writer->file, entry, sizeof entry);
    }
    return status ? status : section_end(&writer->file);
}

static enum status append_info(struct chain_writer *writer, const struct chain_info *info)
{
    unsigned char bytes[CHAIN_INFO_MAX];
    size_t size = chain_info_encode(info, bytes);
    enum status status = section_begin(&writer->file, CHAIN_SECTION_INFO);
    if (!status)
        status = section_append(&writer->file, bytes, size);
    return status ? status : section_end(&writer->file);
}

enum status chain_writer_commit(struct chain_writer **writer, const struct chain_info *info,
                                bool sync)
{
    struct chain_writer *old = *writer;
    enum status status = STATUS_OK;
    if (old->slab_count == 0)
        status = begin_seams(old);
    if (!status && (old->seams != old->slab_count || info->slab_count != old->slab_count))
        status = fail(old->ctx, STATUS_INTERNAL, "a chain file got %u seams of %u", old->seams,
                      old->slab_count);
    if (!status)
        status = section_end(&old->file);
    if (!status)
        status = append_index(old);
    if (!status)
        status = append_info(old, info);
    if (status)
        section_file_discard(&old->file);
    else
        status = section_file_finish(&old->file, sync);
    release(writer);
    return status;
}
