/*
 * Rows of one size, read and converted by all threads.
 *
 * A stream gives its bytes to one reader, and reading is then the longest part of an import that
 * only one thread can do. Of a plain file whose rows have one size it is known where each lies: so
 * each batch is a job, which reads its own bytes, sums them and converts them, and batches are
 * handed on in their order. Whatever is not as expected (a polygon, a coordinate that is not
 * finite, a file that ends early) is left to the reader of the stream, which says so in words. One
 * thread does the same, batch by batch: its bytes then come into memory that stays in its cache.
 */
#include "mesh/ply_body.h"

#include "base/checksum.h"
#include "base/descriptor.h"
#include "base/memory.h"
#include "base/parallel.h"

enum { LEAST_ROWS = 4 * IMPORT_BATCH, IN_FLIGHT_MAX = 6 };

struct slot { /* of a job in flight */
    unsigned char *made;
    uint32_t crc;
    bool is_good;
};

struct splitting {
    const struct ply_split *split;
    struct context *ctx;
    int fd;
    uint64_t position; /* of the first row */
    uint64_t rows;
    unsigned in_flight;
    struct slot slots[IN_FLIGHT_MAX];
    unsigned char *read[IN_FLIGHT_MAX]; /* by each worker, so that they stay in its cache */
    uint64_t taken;                     /* bytes */
    bool is_stopped;                    /* at rows that are not what is expected */
    uint32_t crc;                       /* of these */
};

/* The last batch may be a part of one. */
static size_t rows_of(const struct splitting *s, uint64_t job)
{
    const uint64_t left = s->rows - job * IMPORT_BATCH;
    return left < IMPORT_BATCH ? (size_t)left : IMPORT_BATCH;
}

static enum status read_rows(void *user, uint64_t job, unsigned worker)
{
    struct splitting *s = user;
    const struct ply_split *split = s->split;
    struct slot *slot = &s->slots[job % s->in_flight];
    const size_t count = rows_of(s, job), size = count * split->row_size;
    unsigned char *rows = s->read[worker];
    enum status status =
        descriptor_read_at(s->ctx, s->fd, split->ply->batch.name,
                           s->position + job * IMPORT_BATCH * split->row_size, rows, size);
    if (status != STATUS_OK)
        return status;
    slot->crc = checksum(0, rows, size);
    slot->is_good = split->convert(split->plan, rows, count, slot->made);
    return STATUS_OK;
}

static enum status take_rows(void *user, uint64_t job)
{
    struct splitting *s = user;
    const struct ply_split *split = s->split;
    struct slot *slot = &s->slots[job % s->in_flight];
    if (!slot->is_good) {
        s->is_stopped = true;
        return STATUS_CANCELLED; /* ends the loop; no failure is recorded */
    }
    const size_t count = rows_of(s, job);
    enum status status = split->take(split->ply, split->plan, count, slot->made);
    if (status == STATUS_OK) {
        split->ply->row += count;
        s->taken += count * split->row_size;
        s->crc = checksum_join(s->crc, slot->crc, count * split->row_size);
    }
    return status;
}

static enum status run(struct splitting *s)
{
    const struct ply_split *split = s->split;
    const unsigned threads = s->ctx->threads < s->in_flight ? s->ctx->threads : s->in_flight;
    enum status status = STATUS_OK;
    for (unsigned i = 0; i < threads && status == STATUS_OK; i++)
        status = memory_take(s->ctx, IMPORT_BATCH, split->row_size, &s->read[i]);
    for (unsigned i = 0; i < s->in_flight && status == STATUS_OK; i++)
        status = memory_take(s->ctx, split->made_size, 1, &s->slots[i].made);
    if (status == STATUS_OK)
        status = parallel_ordered(s->ctx, (s->rows + IMPORT_BATCH - 1) / IMPORT_BATCH, s->in_flight,
                                  read_rows, take_rows, s);
    for (unsigned i = 0; i < s->in_flight; i++)
        memory_release(s->ctx, &s->slots[i].made, split->made_size, 1);
    for (unsigned i = 0; i < threads; i++)
        memory_release(s->ctx, &s->read[i], IMPORT_BATCH, split->row_size);
    return status == STATUS_CANCELLED && s->is_stopped ? STATUS_OK : status;
}

enum status ply_read_split(const struct ply_split *split)
{
    struct ply *ply = split->ply;
    struct splitting s = {.split = split, .ctx = ply->ctx};
    uint64_t end;
    text_leave(&ply->text);
    if (!instream_range(ply->text.stream, &s.fd, &s.position, &end) || end < s.position)
        return STATUS_OK;
    const uint64_t rows = ply->element->count - ply->row;
    const uint64_t there = (end - s.position) / split->row_size;
    s.rows = rows < there ? rows : there;
    if (s.rows < LEAST_ROWS)
        return STATUS_OK;
    s.in_flight = ply->ctx->threads + 3 < IN_FLIGHT_MAX ? ply->ctx->threads + 3 : IN_FLIGHT_MAX;
    enum status status = run(&s);
    return status == STATUS_OK ? instream_skip(ply->text.stream, s.taken, s.crc) : status;
}
