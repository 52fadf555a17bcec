/*
 * One stream for plain files, gzip files and standard input.
 *
 * The naive reader pulls a line or a number at a time through stdio, and pays a call and a copy for
 * each; mapping the file is faster, but not for pipes or gzip, and a file that shrinks under a map
 * kills the program. Here the parser sees a buffer of about 1 MiB, says how much of it it took, and
 * only what it left over (a part of a record) is moved to the front before the next piece is read.
 *
 * gzip (RFC 1952) is inflated by zlib into the same buffer, member after member. Zero bytes behind
 * the last member are padding; anything else there is ignored with a warning, as gzip does.
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
#include <zlib.h>

#include "base/checksum.h"
#include "base/descriptor.h"
#include "base/memory.h"

enum {
    PIECE = 1 << 20,                /* bytes read at once, at most */
    FIRST_CAPACITY = PIECE + 65536, /* a piece and what may be left over of the one before */
    RAW_BUFFER = 256 << 10,         /* compressed bytes read at once */
    LARGEST_RECORD = 64 << 20,
    MAGIC_SIZE = 2
};

enum gzip_state { IN_MEMBER, BETWEEN_MEMBERS, BEHIND_MEMBERS };

struct instream {
    struct context *ctx;
    char *name;
    int fd;
    bool owns_fd;
    bool is_gzip;
    bool raw_ended; /* read(2) has said so */
    bool ended;     /* no more bytes will become visible */

    unsigned char *buffer;
    size_t capacity, begin, end;
    uint64_t position; /* of `begin` in the stream */

    size_t digest_from; /* plain only */
    uint32_t digest;
    uint64_t raw_size; /* gzip: bytes inflate has used; plain: bytes before digest_from */

    unsigned char *raw; /* gzip only: bytes [raw_begin, raw_end) are not yet inflated */
    size_t raw_begin, raw_end;
    enum gzip_state gzip_state;
    z_stream zlib;
    bool zlib_ready;
};

/* ---- zlib's memory, through ours: the size stands in front, as zlib does not give it back ---- */

enum { ZLIB_HEADER = 16 };

static voidpf take_for_zlib(voidpf opaque, uInt items, uInt size)
{
    size_t bytes = (size_t)items * size + ZLIB_HEADER;
    unsigned char *block;
    if (memory_take_zeroed(opaque, bytes, 1, &block) != STATUS_OK)
        return Z_NULL;
    memcpy(block, &bytes, sizeof bytes);
    return block + ZLIB_HEADER;
}

static void release_of_zlib(voidpf opaque, voidpf address)
{
    unsigned char *block = (unsigned char *)address - ZLIB_HEADER;
    size_t bytes;
    memcpy(&bytes, block, sizeof bytes);
    memory_release(opaque, &block, bytes, 1);
}

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
    if (S_ISREG(info.st_mode))
        (void)posix_fadvise(stream->fd, 0, 0, POSIX_FADV_SEQUENTIAL);
    return STATUS_OK;
}

static enum status read_piece(struct instream *stream, unsigned char *to, size_t size, size_t *got)
{
    enum status status = descriptor_read(stream->ctx, stream->fd, stream->name, to, size, got);
    if (status == STATUS_OK && *got == 0)
        stream->raw_ended = true;
    return status;
}

/* What has been read so far is the beginning of a gzip file: it becomes the raw buffer. */
static enum status begin_gzip(struct instream *stream)
{
    enum status status = memory_take(stream->ctx, RAW_BUFFER, 1, &stream->raw);
    if (status != STATUS_OK)
        return status;
    memcpy(stream->raw, stream->buffer, stream->end);
    stream->raw_end = stream->end;
    stream->end = 0;
    stream->is_gzip = true;

    stream->zlib.zalloc = take_for_zlib;
    stream->zlib.zfree = release_of_zlib;
    stream->zlib.opaque = stream->ctx;
    if (inflateInit2(&stream->zlib, MAX_WBITS + 16) != Z_OK) /* 16: gzip's header and trailer */
        return fail(stream->ctx, STATUS_NO_MEMORY, "not enough memory to inflate %s", stream->name);
    stream->zlib_ready = true;
    return STATUS_OK;
}

/* Reads until the magic of gzip is there or can't be, in reads that a raw buffer holds. */
static enum status recognise(struct instream *stream)
{
    while (stream->end < MAGIC_SIZE && !stream->raw_ended) {
        size_t got;
        enum status status =
            read_piece(stream, stream->buffer + stream->end, RAW_BUFFER - stream->end, &got);
        if (status != STATUS_OK)
            return status;
        stream->end += got;
    }
    if (stream->end >= MAGIC_SIZE && stream->buffer[0] == 0x1f && stream->buffer[1] == 0x8b)
        return begin_gzip(stream);
    return STATUS_OK;
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
    if (status == STATUS_OK && stream->is_gzip) {
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
    if (closing->zlib_ready)
        inflateEnd(&closing->zlib);
    if (closing->owns_fd)
        close(closing->fd);
    memory_release(ctx, &closing->raw, RAW_BUFFER, 1);
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
    size_t room = stream->capacity - stream->end;
    size_t got;
    enum status status =
        read_piece(stream, stream->buffer + stream->end, room < PIECE ? room : PIECE, &got);
    if (status != STATUS_OK)
        return status;
    stream->end += got;
    stream->ended = stream->raw_ended;
    return STATUS_OK;
}

/* ---- gzip ---- */

static void use_raw(struct instream *stream, size_t size)
{
    stream->digest = checksum(stream->digest, stream->raw + stream->raw_begin, size);
    stream->raw_begin += size;
    stream->raw_size += size;
}

static enum status refill_raw(struct instream *stream)
{
    memmove(stream->raw, stream->raw + stream->raw_begin, stream->raw_end - stream->raw_begin);
    stream->raw_end -= stream->raw_begin;
    stream->raw_begin = 0;
    size_t got;
    enum status status =
        read_piece(stream, stream->raw + stream->raw_end, RAW_BUFFER - stream->raw_end, &got);
    stream->raw_end += got;
    return status;
}

/* Inflates into the room that the buffer has, as far as the raw bytes at hand go. */
static enum status inflate_some(struct instream *stream)
{
    size_t raw = stream->raw_end - stream->raw_begin;
    size_t room = stream->capacity - stream->end;
    stream->zlib.next_in = stream->raw + stream->raw_begin;
    stream->zlib.avail_in = (uInt)raw;
    stream->zlib.next_out = stream->buffer + stream->end;
    stream->zlib.avail_out = (uInt)room;
    int result = inflate(&stream->zlib, Z_NO_FLUSH);
    use_raw(stream, raw - stream->zlib.avail_in);
    stream->end += room - stream->zlib.avail_out;

    if (result == Z_STREAM_END) {
        stream->gzip_state = BETWEEN_MEMBERS;
        return STATUS_OK;
    }
    if (result == Z_OK || result == Z_BUF_ERROR)
        return STATUS_OK;
    if (result == Z_MEM_ERROR)
        return fail(stream->ctx, STATUS_NO_MEMORY, "not enough memory to inflate %s", stream->name);
    return fail(stream->ctx, STATUS_BAD_INPUT, "%s: damaged gzip data near byte %llu: %s",
                stream->name, (unsigned long long)stream->raw_size,
                stream->zlib.msg ? stream->zlib.msg : "a preset dictionary is asked for");
}

/* Behind a member, with at least two raw bytes or all that are left: is there another one? */
static enum status look_behind_member(struct instream *stream)
{
    const unsigned char *next = stream->raw + stream->raw_begin;
    size_t raw = stream->raw_end - stream->raw_begin;
    if (raw >= MAGIC_SIZE && next[0] == 0x1f && next[1] == 0x8b) {
        stream->gzip_state = IN_MEMBER;
        return inflateReset(&stream->zlib) == Z_OK
                   ? STATUS_OK
                   : fail(stream->ctx, STATUS_INTERNAL, "%s: zlib can't begin again", stream->name);
    }
    stream->gzip_state = BEHIND_MEMBERS;
    return STATUS_OK;
}

/* Reads what stands behind the last member to its end (the digest is one of all bytes). */
static enum status skip_rest(struct instream *stream)
{
    bool told = false;
    for (;;) {
        size_t raw = stream->raw_end - stream->raw_begin;
        for (size_t i = 0; i < raw && !told; i++) {
            if (stream->raw[stream->raw_begin + i] == 0)
                continue;
            tell(stream->ctx, MESSAGE_WARNING,
                 "%s: bytes behind the gzip data are ignored, from %llu on", stream->name,
                 (unsigned long long)(stream->raw_size + i));
            told = true;
        }
        use_raw(stream, raw);
        if (stream->raw_ended)
            break;
        enum status status = refill_raw(stream);
        if (status != STATUS_OK)
            return status;
    }
    stream->ended = true;
    return STATUS_OK;
}

/* Makes progress: more bytes visible, or raw bytes used or read, or the end found. */
static enum status fill_gzip(struct instream *stream)
{
    if (stream->gzip_state == BEHIND_MEMBERS)
        return skip_rest(stream);

    size_t raw = stream->raw_end - stream->raw_begin;
    size_t needed = stream->gzip_state == BETWEEN_MEMBERS ? MAGIC_SIZE : 1;
    if (raw < needed && !stream->raw_ended)
        return refill_raw(stream);
    if (stream->gzip_state == BETWEEN_MEMBERS)
        return look_behind_member(stream);
    size_t end = stream->end;
    enum status status = inflate_some(stream);
    /* Out of input: zlib may still hold output back for want of room, so ask it first. */
    if (status == STATUS_OK && raw == 0 && stream->end == end && stream->gzip_state == IN_MEMBER)
        return fail(stream->ctx, STATUS_BAD_INPUT, "%s: the gzip data is cut off at byte %llu",
                    stream->name, (unsigned long long)stream->raw_size);
    return status;
}

/* ---- the interface ---- */

/* Moves what is visible to the front. */
static void make_room(struct instream *stream)
{
    if (!stream->is_gzip)
        digest_taken(stream);
    if (stream->begin == 0)
        return;
    memmove(stream->buffer, stream->buffer + stream->begin, stream->end - stream->begin);
    stream->end -= stream->begin;
    stream->begin = 0;
    stream->digest_from = 0;
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
    while (stream->end < wanted && !stream->ended) {
        if (stream->end == stream->capacity) {
            /* Doubling, as the bytes come: a size that a damaged file claims costs nothing. */
            enum status status = memory_resize(stream->ctx, &stream->buffer, stream->capacity,
                                               2 * stream->capacity, 1);
            if (status != STATUS_OK)
                return status;
            stream->capacity *= 2;
        }
        enum status status = stream->is_gzip ? fill_gzip(stream) : fill_plain(stream);
        if (status != STATUS_OK)
            return status;
    }
    *data = stream->buffer;
    *available = stream->end;
    return STATUS_OK;
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

const char *instream_name(const struct instream *stream)
{
    return stream->name;
}

bool instream_is_gzip(const struct instream *stream)
{
    return stream->is_gzip;
}

uint32_t instream_digest(const struct instream *stream)
{
    if (stream->is_gzip)
        return stream->digest;
    return checksum(stream->digest, stream->buffer + stream->digest_from,
                    stream->begin - stream->digest_from);
}

uint64_t instream_raw_size(const struct instream *stream)
{
    if (stream->is_gzip)
        return stream->raw_size;
    return stream->raw_size + (stream->begin - stream->digest_from);
}
