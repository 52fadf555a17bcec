/*
 * gzip in one piece, by libdeflate.
 *
 * zlib stops and goes on anywhere, and pays for it: libdeflate, which is given all of the input and
 * room for all of the output, takes a third to two thirds of the time. How much room is told by the
 * last four bytes of the file, which may lie, are the size modulo 2^32, and are of the last member
 * only. So they are believed only as far as the caller would spend the memory anyway, and unless
 * all of the file turns out to be one member of that size, it is as if nothing had been tried: the
 * stream of gunzip.c says what is wrong, or finds the other members.
 */
#include <libdeflate.h>

#include "base/bytes.h"
#include "base/checksum.h"
#include "base/descriptor.h"
#include "base/gunzip.h"
#include "base/memory.h"
#include "base/prefault.h"

enum {
    SMALLEST = 18,       /* bytes of a gzip file */
    LARGEST_RATIO = 1032 /* bytes that deflate makes of one, at most */
};

struct whole {
    unsigned char *raw;
    size_t raw_size;
    unsigned char *made;
    size_t made_size;
    bool is_good;
};

/* Reads the file into w->raw, unless what it becomes is too much. */
static enum status read_raw(struct context *ctx, const char *name, int fd, uint64_t size,
                            uint64_t most, struct whole *w)
{
    unsigned char tail[4];
    if (size < SMALLEST || size > most)
        return STATUS_OK;
    enum status status = descriptor_read_at(ctx, fd, name, size - 4, tail, sizeof tail);
    if (status != STATUS_OK)
        return status;
    const uint64_t made = load_u32(tail);
    if (made == 0 || made > most - size || made / LARGEST_RATIO > size)
        return STATUS_OK;
    status = memory_take(ctx, (size_t)size, 1, &w->raw);
    if (status != STATUS_OK)
        return status;
    w->raw_size = (size_t)size;
    memory_use_whole(w->raw, w->raw_size, 1);
    status = descriptor_read_at(ctx, fd, name, 0, w->raw, w->raw_size);
    if (status == STATUS_OK)
        status = memory_take(ctx, (size_t)made, 1, &w->made);
    if (status == STATUS_OK) {
        w->made_size = (size_t)made;
        memory_use_whole(w->made, w->made_size, 1);
    }
    return status;
}

static enum status inflate_raw(struct context *ctx, const char *name, struct whole *w)
{
    struct libdeflate_decompressor *decompressor =
        fault_due(ctx) ? NULL : libdeflate_alloc_decompressor();
    if (!decompressor)
        return fail(ctx, STATUS_NO_MEMORY, "not enough memory to inflate %s", name);
    size_t taken = 0, made = 0;
    struct prefault prefault = {0};
    prefault_add(&prefault, w->made, w->made_size);
    prefault_begin(ctx, &prefault);
    enum libdeflate_result result = libdeflate_gzip_decompress_ex(
        decompressor, w->raw, w->raw_size, w->made, w->made_size, &taken, &made);
    prefault_end(&prefault);
    libdeflate_free_decompressor(decompressor);
    w->is_good = result == LIBDEFLATE_SUCCESS && taken == w->raw_size && made == w->made_size;
    return poll_cancel(ctx);
}

enum status gunzip_whole(struct context *ctx, const char *name, int fd, uint64_t size,
                         uint64_t most, unsigned char **made, size_t *made_size, uint32_t *digest)
{
    struct whole w = {0};
    *made = NULL;
    *made_size = 0;
    enum status status = read_raw(ctx, name, fd, size, most, &w);
    if (status == STATUS_OK && w.made)
        status = inflate_raw(ctx, name, &w);
    if (status == STATUS_OK && w.is_good) {
        *digest = checksum(0, w.raw, w.raw_size);
        *made = w.made;
        *made_size = w.made_size;
    } else {
        memory_release(ctx, &w.made, w.made_size, 1);
    }
    memory_release(ctx, &w.raw, w.raw_size, 1);
    return status;
}
