/*
 * Open, read and write that finish what they begin: short counts are continued, EINTR is tried
 * again unless the job is cancelled, and every call can be made to fail by fault injection.
 * `name` is for messages.
 */
#ifndef SPBM_BASE_DESCRIPTOR_H
#define SPBM_BASE_DESCRIPTOR_H

#include <sys/types.h>

#include "report.h"

/* open(2) with O_CLOEXEC; -1 and errno on failure, and no words. */
int descriptor_open(struct context *ctx, const char *path, int flags, mode_t mode);

/* Writes all of `size` bytes at the file's own position, or at `offset`. */
enum status descriptor_write(struct context *ctx, int fd, const char *name, const void *data,
                             size_t size) MUST_CHECK;
enum status descriptor_write_at(struct context *ctx, int fd, const char *name, uint64_t offset,
                                const void *data, size_t size) MUST_CHECK;

/* Reads exactly `size` bytes at `offset`; STATUS_BAD_INPUT when the file ends before. */
enum status descriptor_read_at(struct context *ctx, int fd, const char *name, uint64_t offset,
                               void *to, size_t size) MUST_CHECK;
/* What one read(2) gives, at most `size` bytes; *got 0 at the end. */
enum status descriptor_read(struct context *ctx, int fd, const char *name, void *to, size_t size,
                            size_t *got) MUST_CHECK;

#endif
