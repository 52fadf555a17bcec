/*
 * Reading at offsets, and windows onto large files: maps of a part, counted as memory in use for as
 * long as they are open, so that a budget covers what is resident of a file.
 */
#include "base/file.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/bytes.h"
#include "base/descriptor.h"
#include "base/memory.h"

enum status input_open(struct context *ctx, const char *path, struct input_file *file)
{
    memset(file, 0, sizeof *file);
    file->ctx = ctx;
    /* O_NONBLOCK: a pipe is refused, not waited for. It means nothing to a regular file. */
    file->fd = descriptor_open(ctx, path, O_RDONLY | O_NONBLOCK, 0);
    if (file->fd < 0)
        return fail_errno(ctx, errno, "%s: cannot open", path);

    struct stat info;
    enum status status = STATUS_OK;
    if (fault_due(ctx) || fstat(file->fd, &info) != 0)
        status = fail_errno(ctx, EIO, "%s: cannot be examined", path);
    else if (S_ISDIR(info.st_mode))
        status = fail(ctx, STATUS_BAD_INPUT, "%s: is a directory", path);
    else if (!S_ISREG(info.st_mode))
        status = fail(ctx, STATUS_BAD_INPUT,
                      "%s: is not a regular file, and this format needs one (it is mapped)", path);
    else
        status = memory_take(ctx, strlen(path) + 1, 1, &file->path);
    if (status != STATUS_OK) {
        input_close(file);
        return status;
    }
    memcpy(file->path, path, strlen(path) + 1);
    file->size = (uint64_t)info.st_size;
    return STATUS_OK;
}

void input_close(struct input_file *file)
{
    if (!file->ctx)
        return;
    if (file->fd >= 0)
        close(file->fd);
    if (file->path)
        memory_release(file->ctx, &file->path, strlen(file->path) + 1, 1);
    memset(file, 0, sizeof *file);
    file->fd = -1;
}

enum status input_read(struct input_file *file, uint64_t offset, void *to, size_t size)
{
    uint64_t end;
    if (add_overflows(offset, size, &end) || end > file->size)
        return fail(file->ctx, STATUS_BAD_INPUT,
                    "%s: the file ends at byte %llu, but %zu bytes at %llu were to be read",
                    file->path, (unsigned long long)file->size, size, (unsigned long long)offset);
    return descriptor_read_at(file->ctx, file->fd, file->path, offset, to, size);
}

enum status window_open(struct input_file *file, uint64_t offset, uint64_t size,
                        struct window *window)
{
    static const unsigned char nothing;
    memset(window, 0, sizeof *window);
    uint64_t end;
    struct stat info;
    if (add_overflows(offset, size, &end) || end > file->size)
        return fail(file->ctx, STATUS_BAD_INPUT,
                    "%s: the file ends at byte %llu, but %llu bytes at %llu were to be mapped",
                    file->path, (unsigned long long)file->size, (unsigned long long)size,
                    (unsigned long long)offset);
    if (size == 0) {
        window->data = &nothing;
        return STATUS_OK;
    }
    /* The size may have changed since: a map beyond the end would be a SIGBUS. */
    if (fstat(file->fd, &info) != 0 || (uint64_t)info.st_size < end)
        return fail(file->ctx, STATUS_BAD_INPUT, "%s: the file has become shorter", file->path);

    uint64_t page = (uint64_t)sysconf(_SC_PAGESIZE);
    uint64_t before = offset % page;
    if (size > SIZE_MAX - before)
        return fail(file->ctx, STATUS_NO_MEMORY, "%s: %llu bytes are too many to map", file->path,
                    (unsigned long long)size);
    size_t map_size = (size_t)(size + before);
    enum status status = memory_hold(file->ctx, map_size);
    if (status != STATUS_OK)
        return status;
    void *map = MAP_FAILED;
    if (fault_due(file->ctx))
        errno = ENOMEM;
    else
        map = mmap(NULL, map_size, PROT_READ, MAP_SHARED, file->fd, (off_t)(offset - before));
    if (map == MAP_FAILED) {
        int error = errno;
        memory_unhold(file->ctx, map_size);
        return fail_errno(file->ctx, error, "%s: cannot map", file->path);
    }
    window->ctx = file->ctx;
    window->map = map;
    window->map_size = map_size;
    window->data = (const unsigned char *)map + before;
    window->size = (size_t)size;
    return STATUS_OK;
}

void window_close(struct window *window)
{
    if (window->map) {
        munmap(window->map, window->map_size);
        memory_unhold(window->ctx, window->map_size);
    }
    memset(window, 0, sizeof *window);
}
