/*
 * A stream of bytes from a plain file, a gzip file (any number of members) or standard input,
 * recognised by content. Parsers look at a buffer and say how much of it they took.
 */
#ifndef SPBM_BASE_INSTREAM_H
#define SPBM_BASE_INSTREAM_H

#include "report.h"

struct instream;

/* Opens `path` (`-` is standard input). A directory, a missing or unreadable file, or a damaged
 * gzip header is an error with words. */
enum status instream_open(struct context *ctx, const char *path, struct instream **out) MUST_CHECK;
void instream_close(struct instream **stream);

/*
 * Makes at least `wanted` bytes visible at *data, or all that are left: *available < wanted only at
 * the end of the stream (0: nothing is left). More than wanted may be visible; a parser should use
 * all that it can. The pointer is valid until the next call on this stream. A large plain file
 * shows pieces of about 1 MiB or more. `wanted` above 64 MiB is refused as bad input ("a single
 * record of more than 64 MiB"). Damaged gzip data is STATUS_BAD_INPUT, with the offset.
 */
enum status instream_peek(struct instream *stream, size_t wanted, const unsigned char **data,
                          size_t *available) MUST_CHECK;
/* Takes `size` of the visible bytes. */
void instream_take(struct instream *stream, size_t size);

/*
 * For who lets several threads look at what is visible. instream_reserve: a buffer of at least
 * `room` bytes, of which half or more are visible or may become so by instream_extend; what is
 * visible may move. instream_extend: at most `most` further bytes behind the visible ones, which do
 * not move, be it that others look at them or take them (one thread at a time extends). *got 0: the
 * buffer is full, or the stream at its end, or damaged: instream_peek says so.
 */
enum status instream_reserve(struct instream *stream, size_t room, const unsigned char **data,
                             size_t *available) MUST_CHECK;
enum status instream_extend(struct instream *stream, size_t most, size_t *got) MUST_CHECK;

/* Position of the next byte in the (inflated) stream; name as given, or "standard input". */
uint64_t instream_position(const struct instream *stream);
/*
 * A plain file can be read by several threads at once. instream_range: whether the stream is one,
 * and its descriptor, the position of the next byte and that of the file's end. instream_skip: the
 * next `size` bytes, whose CRC-32 is `crc`, were read so, and the stream goes on behind them.
 */
bool instream_range(const struct instream *stream, int *fd, uint64_t *position, uint64_t *end);
enum status instream_skip(struct instream *stream, uint64_t size, uint32_t crc) MUST_CHECK;

/* Bytes of the file as it lies there; 0 for what is no regular file. */
uint64_t instream_file_size(const struct instream *stream);
const char *instream_name(const struct instream *stream);
bool instream_is_gzip(const struct instream *stream);
/* CRC-32 and count of all raw bytes taken so far (gzip: inflated so far): the provenance. They are
 * those of the whole file once peek has shown the end (*available 0), which a parser that stops
 * early should ask for, taking what is left. */
uint32_t instream_digest(const struct instream *stream);
uint64_t instream_raw_size(const struct instream *stream);

#endif
