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

enum { LEAST_JOBS = 4, IN_FLIGHT_MAX = 6 };

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
    unsigned in_flight;
    struct slot slots[IN_FLIGHT_MAX];
    unsigned char *rows[IN_FLIGHT_MAX]; /* of each worker, so that they stay in its cache */
    uint64_t taken;                     /* bytes */
    bool is_stopped;                    /* at rows that are not what is expected */
    uint32_t crc;                       /* of these */
};

static enum status read_rows(void *user, uint64_t job, unsigned worker)
{
    struct splitting *s = user;
    const struct ply_split *split = s->split;
    struct slot *slot = &s->slots[job % s->in_flight];
    const size_t size = IMPORT_BATCH * split->row_size;
    unsigned char *rows = s->rows[worker];
    enum status status = descriptor_read_at(s->ctx, s->fd, split->ply->batch.name,
                                            s->position + job * size, rows, size);
    if (status != STATUS_OK)
        return status;
    slot->crc = checksum(0, rows, size);
    slot->is_good = split->convert(split->plan, rows, IMPORT_BATCH, slot->made);
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
    enum status status = split->take(split->ply, split->plan, IMPORT_BATCH, slot->made);
    if (status == STATUS_OK) {
        split->ply->row += IMPORT_BATCH;
        s->taken += IMPORT_BATCH * split->row_size;
        s->crc = checksum_join(s->crc, slot->crc, IMPORT_BATCH * split->row_size);
    }
    return status;
}

static enum status run(struct splitting *s, uint64_t jobs)
{
    const struct ply_split *split = s->split;
    const unsigned threads = s->ctx->threads < s->in_flight ? s->ctx->threads : s->in_flight;
    enum status status = STATUS_OK;
    for (unsigned i = 0; i < threads && status == STATUS_OK; i++)
        status = memory_take(s->ctx, IMPORT_BATCH, split->row_size, &s->rows[i]);
    for (unsigned i = 0; i < s->in_flight && status == STATUS_OK; i++)
        status = memory_take(s->ctx, split->made_size, 1, &s->slots[i].made);
    if (status == STATUS_OK)
        status = parallel_ordered(s->ctx, jobs, s->in_flight, read_rows, take_rows, s);
    for (unsigned i = 0; i < s->in_flight; i++)
        memory_release(s->ctx, &s->slots[i].made, split->made_size, 1);
    for (unsigned i = 0; i < threads; i++)
        memory_release(s->ctx, &s->rows[i], IMPORT_BATCH, split->row_size);
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
    const uint64_t size = IMPORT_BATCH * split->row_size;
    uint64_t jobs = (ply->element->count - ply->row) / IMPORT_BATCH;
    jobs = jobs < (end - s.position) / size ? jobs : (end - s.position) / size;
    if (jobs < LEAST_JOBS)
        return STATUS_OK;
    s.in_flight = ply->ctx->threads + 3 < IN_FLIGHT_MAX ? ply->ctx->threads + 3 : IN_FLIGHT_MAX;
    enum status status = run(&s, jobs);
    return status == STATUS_OK ? instream_skip(ply->text.stream, s.taken, s.crc) : status;
}
