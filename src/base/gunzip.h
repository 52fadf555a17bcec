/*
 * Inflating a gzip file (RFC 1952) of any number of members as a stream from a descriptor, in the
 * caller's thread or in one of its own that runs ahead.
 */
#ifndef SPBM_BASE_GUNZIP_H
#define SPBM_BASE_GUNZIP_H

#include "inflater.h"

struct gunzip;

/* Begins with the `size` bytes at `first` (at most GUNZIP_FIRST) and goes on with what `fd` gives.
 * `name`, for messages, and the descriptor are borrowed. */
enum { GUNZIP_FIRST = INFLATER_FIRST, GUNZIP_ROOM = INFLATER_ROOM };
enum status gunzip_open(struct context *ctx, const char *name, int fd, const unsigned char *first,
                        size_t size, struct gunzip **out) MUST_CHECK;
void gunzip_close(struct gunzip **gunzip);

/* At least one byte and at most `room` (at least GUNZIP_ROOM) to `to`; *got 0 at the end. Damaged
 * data is STATUS_BAD_INPUT with the offset, once all that stood before it has been given. Bytes
 * behind the last member that are not zero are told as a warning. With several threads in the
 * context, another one inflates ahead of who reads much in this way. */
enum status gunzip_read(struct gunzip *gunzip, unsigned char *to, size_t room,
                        size_t *got) MUST_CHECK;
/* The same for who shares the inflating among threads that have other work too: here and now, and
 * nothing is told. *got 0: gunzip_read says why. */
void gunzip_read_quietly(struct gunzip *gunzip, unsigned char *to, size_t room, size_t *got);

/* CRC-32 and count of the raw bytes that were inflated to what has been given, or of some more; at
 * the end, of all. */
uint32_t gunzip_digest(const struct gunzip *gunzip);
uint64_t gunzip_raw_size(const struct gunzip *gunzip);

#endif
