/*
 * Inflating a gzip file (RFC 1952): of any number of members as a stream from a descriptor, in the
 * caller's thread or in one of its own that runs ahead; or of one member in one piece.
 */
#ifndef SPBM_BASE_GUNZIP_H
#define SPBM_BASE_GUNZIP_H

#include "report.h"

struct gunzip;

/* Begins with the `size` bytes at `first` (at most GUNZIP_FIRST) and goes on with what `fd` gives.
 * `name`, for messages, and the descriptor are borrowed. With more than one thread in the context,
 * another one inflates ahead. */
enum { GUNZIP_FIRST = 256 << 10 };
enum status gunzip_open(struct context *ctx, const char *name, int fd, const unsigned char *first,
                        size_t size, struct gunzip **out) MUST_CHECK;
void gunzip_close(struct gunzip **gunzip);

/* At least one byte and at most `room` (at least 1) to `to`; *got 0 at the end. Damaged data is
 * STATUS_BAD_INPUT with the offset, once all that stood before it has been given. Bytes behind the
 * last member that are not zero are told as a warning. */
enum status gunzip_read(struct gunzip *gunzip, unsigned char *to, size_t room,
                        size_t *got) MUST_CHECK;

/* CRC-32 and count of the raw bytes that were inflated to what has been given; at the end, of all.
 */
uint32_t gunzip_digest(const struct gunzip *gunzip);
uint64_t gunzip_raw_size(const struct gunzip *gunzip);

/*
 * All of the regular file of `size` bytes at once, if it is a single member and it and what it
 * becomes take at most `most` bytes together: *made_size bytes (never 0) at *made, to be released,
 * and the CRC-32 of the file. *made is NULL if it is not so, or is damaged: it is then to be read
 * as a stream, which finds out why. The descriptor's position stays.
 */
enum status gunzip_whole(struct context *ctx, const char *name, int fd, uint64_t size,
                         uint64_t most, unsigned char **made, size_t *made_size,
                         uint32_t *digest) MUST_CHECK;

#endif
