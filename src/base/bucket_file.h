/*
 * Many queues in one temporary file: records of one size are put into buckets, each of which gives
 * them back in the order they came. Whoever knows which bucket each element of a sequence went to
 * can put all of it in, work on one bucket at a time, and take everything out again in the
 * sequence's order, with nothing but sequential reading and writing: a join without a sort.
 */
#ifndef SPBM_BASE_BUCKET_FILE_H
#define SPBM_BASE_BUCKET_FILE_H

#include <string.h>

#include "report.h"

struct bucket {
    unsigned char *buffer; /* records [begin, end) of it are waiting to be written or taken */
    size_t begin, end;     /* bytes */
    uint64_t size;         /* bytes put in, ever */
    uint64_t taken;        /* bytes read back into the buffer, so far */
    uint32_t *blocks;      /* places in the file, in blocks */
    size_t block_count, block_capacity;
};

struct bucket_file {
    struct context *ctx; /* NULL: never opened */
    const char *beside;  /* borrowed */
    size_t record_size;
    size_t block_size; /* bytes, a multiple of record_size */
    size_t bucket_count;
    struct bucket *buckets;
    unsigned char *buffers;
    int fd;
    uint32_t blocks_written;
    bool is_sealed;
};

/* `memory`: bytes for all buffers together; a block has at least one record and at most 64 KiB.
 * Safe to close on failure. */
enum status bucket_file_open(struct context *ctx, struct bucket_file *file, size_t bucket_count,
                             size_t record_size, uint64_t memory, const char *beside) MUST_CHECK;
void bucket_file_close(struct bucket_file *file); /* safe when all zero, and twice */

/* Ends the putting, or begins the taking of all buckets from the front again. */
enum status bucket_file_rewind(struct bucket_file *file) MUST_CHECK;

/* Records in a bucket. */
static inline uint64_t bucket_records(const struct bucket_file *file, size_t bucket)
{
    return file->buckets[bucket].size / file->record_size;
}

enum status bucket_flush(struct bucket_file *file, size_t bucket) MUST_CHECK; /* private */
enum status bucket_fill(struct bucket_file *file, size_t bucket) MUST_CHECK;  /* private */

/* Puts a record in. `size` must be the file's record_size: a constant makes it a single move. */
static inline enum status bucket_put_sized(struct bucket_file *file, size_t bucket,
                                           const void *record, size_t size)
{
    struct bucket *b = &file->buckets[bucket];
    if (b->end == file->block_size) {
        enum status status = bucket_flush(file, bucket);
        if (status != STATUS_OK)
            return status;
    }
    memcpy(b->buffer + b->end, record, size);
    b->end += size;
    b->size += size;
    return STATUS_OK;
}

static inline enum status bucket_put(struct bucket_file *file, size_t bucket, const void *record)
{
    return bucket_put_sized(file, bucket, record, file->record_size);
}

/* The next record comes out. STATUS_INTERNAL when the bucket has no more. `size` as above. */
static inline enum status bucket_take_sized(struct bucket_file *file, size_t bucket, void *record,
                                            size_t size)
{
    struct bucket *b = &file->buckets[bucket];
    if (b->begin == b->end) {
        enum status status = bucket_fill(file, bucket);
        if (status != STATUS_OK)
            return status;
    }
    memcpy(record, b->buffer + b->begin, size);
    b->begin += size;
    return STATUS_OK;
}

static inline enum status bucket_take(struct bucket_file *file, size_t bucket, void *record)
{
    return bucket_take_sized(file, bucket, record, file->record_size);
}

#endif
