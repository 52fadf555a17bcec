/*
 * A growing array that moves to disk.
 *
 * What grows with the mesh can't be a vector: doubling one copies it and needs it three times over,
 * and beyond the memory it fails. A spool stays in memory while it is small and is then a nameless
 * temporary file, written in large pieces and mapped once it is complete. Space of a scratch file
 * is reserved before it is mapped: a full disk must be an error here and not a SIGBUS later.
 */
#include "base/file.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "base/bytes.h"
#include "base/descriptor.h"
#include "base/memory.h"

enum { WRITE_BUFFER = 1 << 20, WRITE_PIECE = 64 << 10 };

static const char spool_name[] = "a temporary file";

void spool_init(struct context *ctx, struct spool *spool, const char *beside, uint64_t memory_limit)
{
    memset(spool, 0, sizeof *spool);
    spool->ctx = ctx;
    spool->beside = beside;
    spool->memory_limit = memory_limit;
    spool->fd = -1;
}

/* In pieces: the system caches what one call writes as one block, and later maps all of that block
 * when a byte of it is looked at. */
static enum status write_pieces(struct spool *spool, const unsigned char *from, size_t size)
{
    enum status status = STATUS_OK;
    while (size > 0 && status == STATUS_OK) {
        size_t piece = size < WRITE_PIECE ? size : WRITE_PIECE;
        status = descriptor_write(spool->ctx, spool->fd, spool_name, from, piece);
        from += piece;
        size -= piece;
    }
    return status;
}

static enum status write_buffered(struct spool *spool)
{
    size_t used = spool->used;
    spool->used = 0;
    return write_pieces(spool, spool->memory, used);
}

/* From here on `memory` is a write buffer. */
static enum status move_to_file(struct spool *spool)
{
    enum status status = temp_open(spool->ctx, spool->beside, &spool->fd);
    if (status == STATUS_OK)
        status = write_buffered(spool);
    if (status == STATUS_OK)
        status = memory_resize(spool->ctx, &spool->memory, spool->capacity, WRITE_BUFFER, 1);
    if (status == STATUS_OK)
        spool->capacity = WRITE_BUFFER;
    return status;
}

static enum status append_to_file(struct spool *spool, const unsigned char *from, size_t size)
{
    enum status status = STATUS_OK;
    if (size > spool->capacity - spool->used)
        status = write_buffered(spool);
    if (status == STATUS_OK && size >= spool->capacity)
        return write_pieces(spool, from, size);
    if (status == STATUS_OK) {
        memcpy(spool->memory + spool->used, from, size);
        spool->used += size;
    }
    return status;
}

enum status spool_append(struct spool *spool, const void *data, size_t size)
{
    if (size == 0)
        return STATUS_OK;
    if (spool->is_sealed)
        return fail(spool->ctx, STATUS_INTERNAL, "a sealed spool was to grow");
    uint64_t new_size;
    if (add_overflows(spool->size, size, &new_size))
        return fail(spool->ctx, STATUS_NO_SPACE, "%s would be too large", spool_name);

    enum status status = STATUS_OK;
    if (spool->fd < 0 && new_size > spool->memory_limit)
        status = move_to_file(spool);
    if (status == STATUS_OK && spool->fd < 0) {
        status = memory_reserve(spool->ctx, &spool->memory, &spool->capacity, (size_t)new_size, 1);
        if (status == STATUS_OK) {
            memcpy(spool->memory + spool->used, data, size);
            spool->used += size;
        }
    } else if (status == STATUS_OK) {
        status = append_to_file(spool, data, size);
    }
    if (status == STATUS_OK)
        spool->size = new_size;
    return status;
}

/* Maps the whole file of a spool for reading and writing. */
static enum status map_file(struct spool *spool)
{
    if (spool->size > SIZE_MAX)
        return fail(spool->ctx, STATUS_NO_MEMORY, "%s is too large to map", spool_name);
    void *map = MAP_FAILED;
    if (fault_due(spool->ctx))
        errno = ENOMEM;
    else
        map = mmap(NULL, (size_t)spool->size, PROT_READ | PROT_WRITE, MAP_SHARED, spool->fd, 0);
    if (map == MAP_FAILED)
        return fail_errno(spool->ctx, errno, "cannot map %s", spool_name);
    (void)madvise(map, (size_t)spool->size, MADV_NOHUGEPAGE);
    spool->map = map;
    return STATUS_OK;
}

enum status spool_reserve(struct spool *spool, uint64_t size)
{
    if (spool->fd >= 0 || spool->is_sealed || size > spool->memory_limit ||
        size <= spool->capacity || size > SIZE_MAX)
        return STATUS_OK;
    enum status status =
        memory_resize(spool->ctx, &spool->memory, spool->capacity, (size_t)size, 1);
    if (status == STATUS_OK)
        spool->capacity = (size_t)size;
    if (status == STATUS_OK)
        memory_use_whole(spool->memory, spool->capacity, 1);
    return status;
}

enum status spool_extend(struct spool *spool, uint64_t size, void **room)
{
    uint64_t new_size;
    *room = NULL;
    if (spool->fd >= 0 || spool->is_sealed || add_overflows(spool->size, size, &new_size) ||
        new_size > spool->memory_limit)
        return STATUS_OK;
    enum status status = spool_reserve(spool, new_size);
    if (status == STATUS_OK && new_size <= spool->capacity) {
        *room = spool->memory + spool->used;
        spool->used += (size_t)size;
        spool->size = new_size;
    }
    return status;
}

void *spool_room(const struct spool *spool, uint64_t size)
{
    const bool is_there = spool->fd < 0 && !spool->is_sealed && spool->memory &&
                          size <= spool->capacity - spool->used &&
                          spool->size + size <= spool->memory_limit;
    return is_there ? spool->memory + spool->used : NULL;
}

void spool_fill(struct spool *spool, uint64_t size)
{
    spool->used += (size_t)size;
    spool->size += size;
}

enum status spool_set_private(struct spool *spool, bool is_private)
{
    if (!spool->map)
        return STATUS_OK;
    const int flags = is_private ? MAP_PRIVATE | MAP_NORESERVE : MAP_SHARED;
    void *map = MAP_FAILED;
    if (fault_due(spool->ctx))
        errno = ENOMEM;
    else
        map = mmap(spool->map, (size_t)spool->size, PROT_READ | PROT_WRITE, flags | MAP_FIXED,
                   spool->fd, 0);
    if (map == MAP_FAILED)
        return fail_errno(spool->ctx, errno, "cannot map %s", spool_name);
    (void)madvise(map, (size_t)spool->size, MADV_NOHUGEPAGE);
    return STATUS_OK;
}

enum status spool_seal(struct spool *spool, void **data)
{
    *data = NULL;
    enum status status = STATUS_OK;
    if (spool->fd < 0) {
        /* Exactly what is used; size 0 too gets a pointer to give out. */
        if (!spool->is_sealed)
            status = memory_resize(spool->ctx, &spool->memory, spool->capacity, spool->used, 1);
        if (status == STATUS_OK) {
            spool->capacity = spool->used;
            *data = spool->memory;
        }
    } else if (!spool->is_sealed) {
        status = write_buffered(spool);
        memory_release(spool->ctx, &spool->memory, spool->capacity, 1);
        spool->capacity = 0;
        if (status == STATUS_OK)
            status = map_file(spool);
    }
    if (status != STATUS_OK)
        return status;
    spool->is_sealed = true;
    if (spool->map)
        *data = spool->map;
    return STATUS_OK;
}

void spool_clear(struct spool *spool)
{
    if (!spool->ctx)
        return;
    if (spool->map)
        munmap(spool->map, (size_t)spool->size);
    if (spool->fd >= 0)
        close(spool->fd);
    memory_release(spool->ctx, &spool->memory, spool->capacity, 1);
    memset(spool, 0, sizeof *spool);
    spool->fd = -1;
}

/* Takes the space of `size` bytes from the disk now. */
static enum status reserve_file(struct spool *spool, uint64_t size)
{
    struct context *ctx = spool->ctx;
    if (size > INT64_MAX)
        return fail(ctx, STATUS_NO_SPACE, "%s would be too large", spool_name);
    enum status status = temp_open(ctx, spool->beside, &spool->fd);
    if (status != STATUS_OK)
        return status;
    int error;
    do
        error = fault_due(ctx) ? ENOSPC : posix_fallocate(spool->fd, 0, (off_t)size);
    while (error == EINTR && !(ctx->cancelled && ctx->cancelled(ctx->user)));
    if (error == EINTR)
        return fail(ctx, STATUS_CANCELLED, "cancelled");
    if (error)
        return fail_errno(ctx, error, "cannot reserve %llu bytes for %s", (unsigned long long)size,
                          spool_name);
    return STATUS_OK;
}

enum status spool_scratch(struct context *ctx, struct spool *spool, const char *beside,
                          uint64_t memory_limit, uint64_t size, void **data)
{
    *data = NULL;
    spool_init(ctx, spool, beside, memory_limit);
    enum status status;
    if (size <= memory_limit && size <= SIZE_MAX) {
        status = memory_take_zeroed(ctx, (size_t)size, 1, &spool->memory);
        if (status == STATUS_OK) {
            spool->capacity = spool->used = (size_t)size;
            memory_use_whole(spool->memory, spool->capacity, 1);
        }
    } else {
        status = reserve_file(spool, size);
    }
    if (status == STATUS_OK) {
        spool->size = size;
        spool->is_sealed = true;
        if (spool->fd >= 0)
            status = map_file(spool);
    }
    if (status != STATUS_OK) {
        spool_clear(spool);
        return status;
    }
    *data = spool->map ? spool->map : spool->memory;
    return STATUS_OK;
}
