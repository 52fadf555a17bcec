/*
 * The system calls on descriptors, with everything that read(2) and write(2) may do short of what
 * was asked: short counts, EINTR, and more bytes than one call takes. One place for it, so that no
 * caller forgets one of them.
 */
#include "base/descriptor.h"

#include <errno.h>
#include <fcntl.h>
#include <unistd.h>

#include "base/memory.h"

enum { LARGEST_CALL = 1 << 30 }; /* bytes for one call; Linux itself stops at 2 GiB */

/* What to do about errno `error`: STATUS_OK to try again, else the failure to return. */
static enum status judge(struct context *ctx, int error, const char *verb, const char *name)
{
    if (error != EINTR)
        return fail_errno(ctx, error, "%s: cannot %s", name, verb);
    if (ctx->cancelled && ctx->cancelled(ctx->user))
        return fail(ctx, STATUS_CANCELLED, "cancelled");
    return STATUS_OK;
}

static size_t at_most(size_t size, size_t limit)
{
    return size < limit ? size : limit;
}

enum status descriptor_write(struct context *ctx, int fd, const char *name, const void *data,
                             size_t size)
{
    const unsigned char *from = data;
    while (size > 0) {
        if (fault_due(ctx))
            return fail_errno(ctx, ENOSPC, "%s: cannot write", name);
        ssize_t written = write(fd, from, at_most(size, LARGEST_CALL));
        if (written < 0) {
            enum status status = judge(ctx, errno, "write", name);
            if (status != STATUS_OK)
                return status;
            continue;
        }
        from += written;
        size -= (size_t)written;
    }
    return STATUS_OK;
}

enum status descriptor_write_at(struct context *ctx, int fd, const char *name, uint64_t offset,
                                const void *data, size_t size)
{
    const unsigned char *from = data;
    while (size > 0) {
        if (fault_due(ctx))
            return fail_errno(ctx, ENOSPC, "%s: cannot write", name);
        ssize_t written = pwrite(fd, from, at_most(size, LARGEST_CALL), (off_t)offset);
        if (written < 0) {
            enum status status = judge(ctx, errno, "write", name);
            if (status != STATUS_OK)
                return status;
            continue;
        }
        from += written;
        offset += (size_t)written;
        size -= (size_t)written;
    }
    return STATUS_OK;
}

enum status descriptor_read_at(struct context *ctx, int fd, const char *name, uint64_t offset,
                               void *to, size_t size)
{
    unsigned char *into = to;
    while (size > 0) {
        if (fault_due(ctx))
            return fail_errno(ctx, EIO, "%s: cannot read", name);
        ssize_t got = pread(fd, into, at_most(size, LARGEST_CALL), (off_t)offset);
        if (got < 0) {
            enum status status = judge(ctx, errno, "read", name);
            if (status != STATUS_OK)
                return status;
            continue;
        }
        if (got == 0)
            return fail(ctx, STATUS_BAD_INPUT, "%s: the file ends at byte %llu, %zu bytes early",
                        name, (unsigned long long)offset, size);
        into += got;
        offset += (size_t)got;
        size -= (size_t)got;
    }
    return STATUS_OK;
}

enum status descriptor_read(struct context *ctx, int fd, const char *name, void *to, size_t size,
                            size_t *got)
{
    *got = 0;
    for (;;) {
        if (fault_due(ctx))
            return fail_errno(ctx, EIO, "%s: cannot read", name);
        ssize_t count = read(fd, to, at_most(size, LARGEST_CALL));
        if (count >= 0) {
            *got = (size_t)count;
            return STATUS_OK;
        }
        enum status status = judge(ctx, errno, "read", name);
        if (status != STATUS_OK)
            return status;
    }
}

/* The open of a pipe waits for its other end, and can be interrupted like the others. */
int descriptor_open(struct context *ctx, const char *path, int flags, mode_t mode)
{
    if (fault_due(ctx)) {
        errno = EACCES;
        return -1;
    }
    for (;;) {
        int fd = open(path, flags | O_CLOEXEC, mode);
        if (fd >= 0 || errno != EINTR || (ctx->cancelled && ctx->cancelled(ctx->user)))
            return fd;
    }
}
