/*
 * Queues in blocks of one file.
 *
 * A temporary file a bucket would do, but there are hundreds of them in several sets. So each
 * bucket has a buffer of one block; a full one goes to the end of the common file, and the bucket
 * remembers where: 4 bytes a block. What is smaller than a block never leaves the memory.
 *
 * Invariants: while putting, the buffer holds the records behind the last block; while taking,
 * records [begin, end) of the buffer are next, and `taken` counts what has been in the buffer.
 */
#include "base/bucket_file.h"

#include <unistd.h>

#include "base/descriptor.h"
#include "base/file.h"
#include "base/memory.h"

enum { LARGEST_BLOCK = 64 << 10 };

static const char bucket_name[] = "a temporary file of buckets";

enum status bucket_file_open(struct context *ctx, struct bucket_file *file, size_t bucket_count,
                             size_t record_size, uint64_t memory, const char *beside)
{
    uint64_t block = memory / bucket_count;
    if (block > LARGEST_BLOCK)
        block = LARGEST_BLOCK;
    size_t records = (size_t)block / record_size;
    *file = (struct bucket_file){.ctx = ctx,
                                 .beside = beside,
                                 .record_size = record_size,
                                 .block_size = (records ? records : 1) * record_size,
                                 .bucket_count = bucket_count,
                                 .fd = -1};
    enum status status =
        memory_take_zeroed(ctx, bucket_count, sizeof *file->buckets, &file->buckets);
    if (status == STATUS_OK)
        status = memory_take(ctx, bucket_count, file->block_size, &file->buffers);
    for (size_t i = 0; i < bucket_count && status == STATUS_OK; i++)
        file->buckets[i].buffer = file->buffers + i * file->block_size;
    return status;
}

void bucket_file_close(struct bucket_file *file)
{
    if (!file->ctx)
        return;
    for (size_t i = 0; file->buckets && i < file->bucket_count; i++)
        memory_release(file->ctx, &file->buckets[i].blocks, file->buckets[i].block_capacity,
                       sizeof(uint32_t));
    memory_release(file->ctx, &file->buckets, file->bucket_count, sizeof *file->buckets);
    memory_release(file->ctx, &file->buffers, file->bucket_count, file->block_size);
    if (file->fd >= 0)
        close(file->fd);
    memset(file, 0, sizeof *file);
}

/* The buffer, which is full (or the last), becomes the bucket's next block. */
enum status bucket_flush(struct bucket_file *file, size_t bucket)
{
    struct context *ctx = file->ctx;
    struct bucket *b = &file->buckets[bucket];
    if (file->blocks_written == UINT32_MAX)
        return fail(ctx, STATUS_NO_SPACE, "%s would be too large", bucket_name);
    enum status status = STATUS_OK;
    if (file->fd < 0)
        status = temp_open(ctx, file->beside, &file->fd);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &b->blocks, &b->block_capacity, b->block_count + 1,
                                sizeof *b->blocks);
    if (status == STATUS_OK)
        status = descriptor_write_at(ctx, file->fd, bucket_name,
                                     (uint64_t)file->blocks_written * file->block_size, b->buffer,
                                     b->end);
    if (status != STATUS_OK)
        return status;
    b->blocks[b->block_count++] = file->blocks_written++;
    b->end = 0;
    return STATUS_OK;
}

enum status bucket_file_rewind(struct bucket_file *file)
{
    for (size_t i = 0; i < file->bucket_count; i++) {
        struct bucket *b = &file->buckets[i];
        if (b->block_count == 0) { /* all of it is in the buffer, and stays there */
            b->begin = 0;
            b->end = (size_t)b->size;
            b->taken = b->size;
            continue;
        }
        if (!file->is_sealed && b->end > 0) {
            enum status status = bucket_flush(file, i);
            if (status != STATUS_OK)
                return status;
        }
        b->begin = b->end = 0;
        b->taken = 0;
    }
    file->is_sealed = true;
    return STATUS_OK;
}

/* The next block comes into the buffer, all of which has been taken. */
enum status bucket_fill(struct bucket_file *file, size_t bucket)
{
    struct bucket *b = &file->buckets[bucket];
    if (!file->is_sealed || b->taken == b->size)
        return fail(file->ctx, STATUS_INTERNAL, "a bucket has no more records");
    uint64_t left = b->size - b->taken;
    size_t size = left < file->block_size ? (size_t)left : file->block_size;
    uint64_t block = b->blocks[b->taken / file->block_size];
    enum status status = descriptor_read_at(file->ctx, file->fd, bucket_name,
                                            block * file->block_size, b->buffer, size);
    if (status != STATUS_OK)
        return status;
    b->taken += size;
    b->begin = 0;
    b->end = size;
    return STATUS_OK;
}
