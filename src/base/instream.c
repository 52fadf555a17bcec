/*
 * One stream for plain files, gzip files and standard input.
 *
 * The naive reader pulls a line or a number at a time through stdio, and pays a call and a copy for
 * each; mapping the file is faster, but not for pipes or gzip, and a file that shrinks under a map
 * kills the program. Here the parser sees a buffer of about 1 MiB, says how much of it it took, and
 * only what it left over (a part of a record) is moved to the front before the next piece is read.
 *
 * What is inflated (gunzip.h) comes into the same buffer. Who parses with several threads makes the
 * buffer larger, and more bytes visible in it while those before them are parsed.
 *
 * Invariants: begin <= end <= capacity; the bytes [begin, end) are visible; [digest_from, begin) of
 * a plain stream are taken but not yet in the digest.
 */
#include "base/instream.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/checksum.h"
#include "base/descriptor.h"
#include "base/gunzip.h"
#include "base/memory.h"

enum {
    PIECE = 1 << 20,                /* bytes read at once, at most */
    FIRST_PIECE = 128 << 10,        /* the same at first, since others may read what follows */
    FIRST_CAPACITY = PIECE + 65536, /* a piece and what may be left over of the one before */
    INFLATED_PIECE = 128 << 10,     /* the same, of what is inflated */
    LARGEST_RECORD = 64 << 20,
    MAGIC_SIZE = 2
};

struct instream {
    struct context *ctx;
    char *name;
    int fd;
    bool owns_fd;
    bool raw_ended;     /* read(2) has said so */
    uint64_t file_size; /* 0: no regular file */
    bool ended;         /* no more bytes will become visible */

    unsigned char *buffer;
    size_t capacity, begin, end;
    uint64_t position; /* of `begin` in the stream */

    size_t piece; /* to be read next; plain only, as are: */
    size_t digest_from;
    uint32_t digest;
    uint64_t raw_size; /* bytes before digest_from */

    struct gunzip *gunzip; /* NULL: plain */
};

/* ---- opening ---- */

static enum status open_descriptor(struct instream *stream, const char *path)
{
    struct context *ctx = stream->ctx;
    if (strcmp(path, "-") == 0) {
        stream->fd = STDIN_FILENO;
    } else {
        stream->fd = descriptor_open(ctx, path, O_RDONLY, 0);
        if (stream->fd < 0)
            return fail_errno(ctx, errno, "%s: cannot open", stream->name);
        stream->owns_fd = true;
    }
    struct stat info;
    if (fstat(stream->fd, &info) != 0)
        return fail_errno(ctx, errno, "%s: cannot be examined", stream->name);
    if (S_ISDIR(info.st_mode))
        return fail(ctx, STATUS_BAD_INPUT, "%s: is a directory", stream->name);
    if (S_ISREG(info.st_mode) && info.st_size > 0)
        stream->file_size = (uint64_t)info.st_size;
    if (S_ISREG(info.st_mode))
        (void)posix_fadvise(stream->fd, 0, 0, POSIX_FADV_SEQUENTIAL);
    return STATUS_OK;
}

static enum status read_piece(struct instream *stream, unsigned char *to, size_t size, size_t *got)
{
    /* Here, for a reader may take gigabytes without handing anything on. */
    enum status status = poll_cancel(stream->ctx);
    if (status == STATUS_OK)
        status = descriptor_read(stream->ctx, stream->fd, stream->name, to, size, got);
    if (status == STATUS_OK && *got == 0)
        stream->raw_ended = true;
    return status;
}

/* Reads until the magic of gzip is there or can't be, in reads that a raw buffer holds. */
static enum status recognise(struct instream *stream)
{
    while (stream->end < MAGIC_SIZE && !stream->raw_ended) {
        size_t got;
        enum status status =
            read_piece(stream, stream->buffer + stream->end, GUNZIP_FIRST - stream->end, &got);
        if (status != STATUS_OK)
            return status;
        stream->end += got;
    }
    if (stream->end < MAGIC_SIZE || stream->buffer[0] != 0x1f || stream->buffer[1] != 0x8b)
        return STATUS_OK;
    size_t size = stream->end;
    stream->end = 0;
    return gunzip_open(stream->ctx, stream->name, stream->fd, stream->buffer, size,
                       &stream->gunzip);
}

enum status instream_open(struct context *ctx, const char *path, struct instream **out)
{
    *out = NULL;
    struct instream *stream;
    enum status status = memory_take_zeroed(ctx, 1, sizeof *stream, &stream);
    if (status != STATUS_OK)
        return status;
    stream->ctx = ctx;
    stream->fd = -1;
    stream->piece = FIRST_PIECE;

    const char *name = strcmp(path, "-") == 0 ? "standard input" : path;
    status = memory_take(ctx, strlen(name) + 1, 1, &stream->name);
    if (status == STATUS_OK) {
        memcpy(stream->name, name, strlen(name) + 1);
        status = open_descriptor(stream, path);
    }
    if (status == STATUS_OK)
        status = memory_take(ctx, FIRST_CAPACITY, 1, &stream->buffer);
    if (status == STATUS_OK) {
        stream->capacity = FIRST_CAPACITY;
        status = recognise(stream);
    }
    if (status == STATUS_OK && stream->gunzip) {
        /* Look at the header now, so that a damaged one shows at opening. */
        const unsigned char *data;
        size_t available;
        status = instream_peek(stream, 1, &data, &available);
    }
    if (status != STATUS_OK) {
        instream_close(&stream);
        return status;
    }
    *out = stream;
    return STATUS_OK;
}

void instream_close(struct instream **stream)
{
    struct instream *closing = *stream;
    if (!closing)
        return;
    *stream = NULL;
    struct context *ctx = closing->ctx;
    gunzip_close(&closing->gunzip);
    if (closing->owns_fd)
        close(closing->fd);
    memory_release(ctx, &closing->buffer, closing->capacity, 1);
    if (closing->name)
        memory_release(ctx, &closing->name, strlen(closing->name) + 1, 1);
    memory_release(ctx, &closing, 1, sizeof *closing);
}

/* ---- plain ---- */

static void digest_taken(struct instream *stream)
{
    size_t size = stream->begin - stream->digest_from;
    stream->digest = checksum(stream->digest, stream->buffer + stream->digest_from, size);
    stream->raw_size += size;
    stream->digest_from = stream->begin;
}

static enum status fill_plain(struct instream *stream)
{
    const size_t room = stream->capacity - stream->end, piece = stream->piece;
    size_t got;
    enum status status =
        read_piece(stream, stream->buffer + stream->end, room < piece ? room : piece, &got);
    if (status != STATUS_OK)
        return status;
    stream->piece = 2 * piece < PIECE ? 2 * piece : PIECE;
    stream->end += got;
    stream->ended = stream->raw_ended;
    return STATUS_OK;
}

static enum status fill_gzip(struct instream *stream)
{
    size_t room = stream->capacity - stream->end, got;
    enum status status = gunzip_read(stream->gunzip, stream->buffer + stream->end,
                                     room < INFLATED_PIECE ? room : INFLATED_PIECE, &got);
    stream->end += got;
    stream->ended = status == STATUS_OK && got == 0;
    return status;
}

/* ---- the interface ---- */

/* Moves what is visible to the front. */
static void make_room(struct instream *stream)
{
    if (!stream->gunzip)
        digest_taken(stream);
    if (stream->begin == 0)
        return;
    memmove(stream->buffer, stream->buffer + stream->begin, stream->end - stream->begin);
    stream->end -= stream->begin;
    stream->begin = 0;
    stream->digest_from = 0;
}

static enum status grow(struct instream *stream, size_t capacity)
{
    enum status status = memory_resize(stream->ctx, &stream->buffer, stream->capacity, capacity, 1);
    if (status == STATUS_OK)
        stream->capacity = capacity;
    return status;
}

/* That a piece can be read to. */
static size_t least_room(const struct instream *stream)
{
    return stream->gunzip ? GUNZIP_ROOM : 1;
}

enum status instream_peek(struct instream *stream, size_t wanted, const unsigned char **data,
                          size_t *available)
{
    *data = stream->buffer + stream->begin;
    *available = stream->end - stream->begin;
    if (*available >= wanted)
        return STATUS_OK;
    *available = 0;
    if (wanted > LARGEST_RECORD)
        return fail(stream->ctx, STATUS_BAD_INPUT,
                    "%s: a single record of more than 64 MiB at byte %llu", stream->name,
                    (unsigned long long)stream->position);

    make_room(stream);
    const size_t least = least_room(stream);
    while (stream->end < wanted && !stream->ended) {
        /* Doubling, as the bytes come: a size that a damaged file claims costs nothing. */
        if (stream->capacity - stream->end < least) {
            enum status status = grow(stream, 2 * stream->capacity);
            if (status != STATUS_OK)
                return status;
        }
        enum status status = stream->gunzip ? fill_gzip(stream) : fill_plain(stream);
        if (status != STATUS_OK)
            return status;
    }
    *data = stream->buffer;
    *available = stream->end;
    return STATUS_OK;
}

enum status instream_reserve(struct instream *stream, size_t room, const unsigned char **data,
                             size_t *available)
{
    enum status status = STATUS_OK;
    if (stream->end - stream->begin < room / 2) {
        if (stream->capacity - stream->end < room / 2)
            make_room(stream);
        if (stream->capacity < room)
            status = grow(stream, room);
    }
    *data = stream->buffer + stream->begin;
    *available = stream->end - stream->begin;
    return status;
}

enum status instream_extend(struct instream *stream, size_t most, size_t *got)
{
    const size_t left = stream->capacity - stream->end, room = left < most ? left : most;
    enum status status = STATUS_OK;
    *got = 0;
    if (stream->ended || room < least_room(stream))
        return STATUS_OK;
    if (stream->gunzip) {
        gunzip_read_quietly(stream->gunzip, stream->buffer + stream->end, room, got);
    } else {
        status = read_piece(stream, stream->buffer + stream->end, room, got);
        stream->ended = stream->raw_ended;
    }
    stream->end += *got;
    return status;
}

void instream_take(struct instream *stream, size_t size)
{
    stream->begin += size;
    stream->position += size;
}

uint64_t instream_position(const struct instream *stream)
{
    return stream->position;
}

bool instream_range(const struct instream *stream, int *fd, uint64_t *position, uint64_t *end)
{
    struct stat info;
    if (stream->gunzip || !stream->owns_fd || stream->file_size == 0 ||
        fstat(stream->fd, &info) != 0)
        return false;
    *fd = stream->fd;
    *position = stream->position;
    *end = (uint64_t)info.st_size;
    return true;
}

enum status instream_skip(struct instream *stream, uint64_t size, uint32_t crc)
{
    digest_taken(stream);
    stream->digest = checksum_join(stream->digest, crc, size);
    stream->raw_size += size;
    stream->position += size;
    stream->begin = stream->end = stream->digest_from = 0;
    stream->ended = stream->raw_ended = false;
    stream->piece = FIRST_PIECE;
    if (lseek(stream->fd, (off_t)stream->position, SEEK_SET) < 0)
        return fail_errno(stream->ctx, errno, "%s: cannot be read", stream->name);
    return STATUS_OK;
}

uint64_t instream_file_size(const struct instream *stream)
{
    return stream->file_size;
}

const char *instream_name(const struct instream *stream)
{
    return stream->name;
}

bool instream_is_gzip(const struct instream *stream)
{
    return stream->gunzip;
}

uint32_t instream_digest(const struct instream *stream)
{
    if (stream->gunzip)
        return gunzip_digest(stream->gunzip);
    return checksum(stream->digest, stream->buffer + stream->digest_from,
                    stream->begin - stream->digest_from);
}

uint64_t instream_raw_size(const struct instream *stream)
{
    if (stream->gunzip)
        return gunzip_raw_size(stream->gunzip);
    return stream->raw_size + (stream->begin - stream->digest_from);
}
