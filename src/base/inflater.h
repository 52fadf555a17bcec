/*
 * Inflating gzip files (RFC 1952) of any number of members from a descriptor, in the caller's
 * thread: what gunzip.c runs ahead of its reader.
 */
#ifndef SPBM_BASE_INFLATER_H
#define SPBM_BASE_INFLATER_H

#include "report.h"

struct inflater;

enum {
    INFLATER_FIRST = 256 << 10, /* raw bytes that were read already, at most */
    INFLATER_ROOM = 96 << 10    /* for bytes, at least */
};

/* Begins with the `size` bytes at `first` and goes on with what `fd` gives. `name`, for messages,
 * and the descriptor are borrowed. */
enum status inflater_open(struct context *ctx, const char *name, int fd, const unsigned char *first,
                          size_t size, struct inflater **out) MUST_CHECK;
void inflater_close(struct context *ctx, struct inflater **inflater);

/* At least one byte and at most `room` (at least INFLATER_ROOM) to `to`; *got 0 at the end. A call
 * that gives bytes records no failure. Damage is STATUS_BAD_INPUT with the offset, told in `ctx`
 * and from then on by each call, once all that stood before it has been given. */
enum status inflater_read(struct context *ctx, struct inflater *inflater, unsigned char *to,
                          size_t room, size_t *got) MUST_CHECK;

/* CRC-32 of the raw bytes read so far, and how many of them were used; at the end, of all. */
uint32_t inflater_digest(const struct inflater *inflater);
uint64_t inflater_raw_size(const struct inflater *inflater);
/* At the end: the first byte behind the last member that is not zero; UINT64_MAX: there is none. */
uint64_t inflater_ignored_from(const struct inflater *inflater);

#endif
