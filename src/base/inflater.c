/*
 * gzip, member after member, by ISA-L.
 *
 * zlib stops and goes on anywhere, and pays for it; libdeflate is quicker but wants all of the
 * input and room for all of the output. ISA-L's igzip streams and is as quick as that. It gets the
 * raw DEFLATE data only: headers and trailers are a few bytes, read here one by one wherever a
 * piece of the file ends, so that one place decides what is damaged and says where.
 *
 * ISA-L takes input up to eight bytes ahead of what it decodes. What is left of that at the end of
 * a member is the trailer's, and is taken back: hence the bytes that stay in front of those to
 * come. Given INFLATER_ROOM it hands on all that it has decoded, also when it then finds damage, so
 * that what comes before a failure does not depend on the pieces in which it is read.
 *
 * Zero bytes behind the last member are padding; anything else there is ignored, as gzip does.
 */
#include "base/inflater.h"

#include <isa-l/igzip_lib.h>
#include <string.h>

#include "base/checksum.h"
#include "base/descriptor.h"
#include "base/memory.h"

enum {
    RAW_BUFFER = INFLATER_FIRST,
    TAKEN_BACK = 8, /* bytes that are kept behind those in use, at most */
    FIXED_HEADER = 10,
    TRAILER = 8
};

enum flag {
    FLAG_HEADER_CRC = 2,
    FLAG_EXTRA = 4,
    FLAG_NAME = 8,
    FLAG_COMMENT = 16,
    FLAGS_RESERVED = 0xe0
};

/* Where the next raw byte belongs; those of a member's header in their order. */
enum place {
    IN_FIXED,
    IN_EXTRA_SIZE,
    IN_EXTRA,
    IN_NAME,
    IN_COMMENT,
    IN_HEADER_CRC,
    IN_DATA,
    IN_TRAILER,
    BETWEEN_MEMBERS,
    BEHIND_MEMBERS,
    ENDED
};

struct inflater {
    const char *name;
    int fd;
    bool raw_ended;     /* read(2) has said so */
    unsigned char *raw; /* TAKEN_BACK and RAW_BUFFER bytes; [raw_begin, raw_end) are not yet used */
    size_t raw_begin, raw_end;
    uint32_t digest;
    uint64_t raw_size;  /* bytes used */
    const char *damage; /* what is wrong behind the bytes that were given; NULL: nothing */
    enum status failed; /* as told */
    uint64_t ignored_from;

    enum place place;
    /* the member: bytes of the field that is being read, and its number, lowest byte first */
    unsigned count;
    uint64_t value;
    unsigned char flags;
    uint32_t header_crc; /* of what was read of the header */
    uint32_t crc;        /* of what was inflated, */
    uint32_t size;       /* and its size modulo 2^32 */
    struct inflate_state isal;
};

/* ---- raw bytes ---- */

static void use_raw(struct inflater *in, size_t size)
{
    in->raw_begin += size;
    in->raw_size += size;
}

static enum status refill_raw(struct context *ctx, struct inflater *in)
{
    const size_t kept = in->raw_begin < TAKEN_BACK ? in->raw_begin : TAKEN_BACK;
    const size_t from = in->raw_begin - kept;
    memmove(in->raw, in->raw + from, in->raw_end - from);
    in->raw_end -= from;
    in->raw_begin = kept;
    size_t got;
    enum status status = descriptor_read(ctx, in->fd, in->name, in->raw + in->raw_end,
                                         TAKEN_BACK + RAW_BUFFER - in->raw_end, &got);
    if (status != STATUS_OK)
        return status;
    in->raw_ended = got == 0;
    in->digest = checksum(in->digest, in->raw + in->raw_end, got);
    in->raw_end += got;
    return STATUS_OK;
}

/* ---- headers and trailers ---- */

static void begin_field(struct inflater *in, enum place place)
{
    in->place = place;
    in->count = 0;
    in->value = 0;
}

static void begin_member(struct inflater *in)
{
    begin_field(in, IN_FIXED);
    in->flags = 0;
    in->header_crc = in->crc = in->size = 0;
    isal_inflate_reset(&in->isal);
}

/* To the header's next field that is there, or to the data. */
static void next_field(struct inflater *in)
{
    static const unsigned char flags[] = {[IN_EXTRA_SIZE] = FLAG_EXTRA,
                                          [IN_EXTRA] = 0,
                                          [IN_NAME] = FLAG_NAME,
                                          [IN_COMMENT] = FLAG_COMMENT,
                                          [IN_HEADER_CRC] = FLAG_HEADER_CRC};
    enum place place = in->place + 1;
    while (place < IN_DATA && !(in->flags & flags[place]))
        place++;
    begin_field(in, place);
}

static void take_fixed_byte(struct inflater *in, unsigned char byte)
{
    static const unsigned char wanted[] = {0x1f, 0x8b, 8};
    if (in->count < sizeof wanted && byte != wanted[in->count])
        in->damage = in->count < 2 ? "no member begins here" : "an unknown compression method";
    if (in->count == 3)
        in->flags = byte;
    if (in->flags & FLAGS_RESERVED)
        in->damage = "unknown header flags";
    if (++in->count == FIXED_HEADER)
        next_field(in);
}

/* Adds a byte to the number of so many bytes; true when it is whole. */
static bool take_number_byte(struct inflater *in, unsigned char byte, unsigned bytes)
{
    in->value |= (uint64_t)byte << (8 * in->count);
    return ++in->count == bytes;
}

static void take_header_byte(struct inflater *in, unsigned char byte)
{
    switch (in->place) {
    case IN_FIXED:
        take_fixed_byte(in, byte);
        break;
    case IN_EXTRA_SIZE:
        if (take_number_byte(in, byte, 2)) {
            const uint64_t size = in->value;
            begin_field(in, IN_EXTRA);
            in->value = size;
            if (size == 0)
                next_field(in);
        }
        break;
    case IN_EXTRA:
        if (++in->count == in->value)
            next_field(in);
        break;
    default: /* name, comment */
        if (byte == 0)
            next_field(in);
    }
}

/* As far as the raw bytes at hand go. */
static void read_header(struct inflater *in)
{
    const size_t first = in->raw_begin;
    while (in->raw_begin < in->raw_end && in->place < IN_HEADER_CRC && !in->damage) {
        take_header_byte(in, in->raw[in->raw_begin]);
        use_raw(in, 1);
    }
    in->header_crc = checksum(in->header_crc, in->raw + first, in->raw_begin - first);
    while (in->raw_begin < in->raw_end && in->place == IN_HEADER_CRC) {
        if (take_number_byte(in, in->raw[in->raw_begin], 2)) {
            if (!checksum_agrees((uint32_t)in->value, in->header_crc & 0xffff))
                in->damage = "incorrect header check";
            next_field(in);
        }
        use_raw(in, 1);
    }
}

static void read_trailer(struct inflater *in)
{
    bool is_whole = false;
    while (in->raw_begin < in->raw_end && !is_whole) {
        is_whole = take_number_byte(in, in->raw[in->raw_begin], TRAILER);
        use_raw(in, 1);
    }
    if (!is_whole)
        return;
    if (!checksum_agrees((uint32_t)in->value, in->crc))
        in->damage = "incorrect data check";
    else if (!checksum_agrees((uint32_t)(in->value >> 32), in->size))
        in->damage = "incorrect length check";
    begin_field(in, BETWEEN_MEMBERS);
}

/* ---- data ---- */

static const char *words_for(int result)
{
    return result == ISAL_INVALID_BLOCK      ? "an invalid block"
           : result == ISAL_INVALID_SYMBOL   ? "an invalid symbol"
           : result == ISAL_INVALID_LOOKBACK ? "an invalid distance"
                                             : "it can't be inflated";
}

/* As far as the raw bytes at hand and the room go. */
static void inflate_some(struct inflater *in, unsigned char *to, size_t room, size_t *got)
{
    struct inflate_state *isal = &in->isal;
    const size_t raw = in->raw_end - in->raw_begin;
    const enum isal_block_state before = isal->block_state;
    isal->next_in = in->raw + in->raw_begin;
    isal->avail_in = (uint32_t)raw;
    isal->next_out = to;
    isal->avail_out = (uint32_t)(room < INT32_MAX ? room : INT32_MAX);
    const int result = isal_inflate(isal);
    /* At an invalid symbol ISA-L may say that it took a byte more than there is. */
    const size_t used = isal->avail_in <= raw ? raw - isal->avail_in : raw;
    *got = (size_t)(isal->next_out - to);
    use_raw(in, used);
    in->crc = checksum(in->crc, to, *got);
    in->size += (uint32_t)*got;
    const bool is_stuck = raw > 0 && used == 0 && *got == 0 && isal->block_state == before;
    if (result != ISAL_DECOMP_OK || is_stuck) {
        in->damage = words_for(result);
    } else if (isal->block_state == ISAL_BLOCK_FINISH) {
        size_t ahead = isal->read_in_length > 0 ? (size_t)isal->read_in_length / 8 : 0;
        ahead = ahead < in->raw_begin ? ahead : in->raw_begin;
        in->raw_begin -= ahead;
        in->raw_size -= ahead;
        begin_field(in, IN_TRAILER);
    }
}

/* ---- members ---- */

/* Behind a member, with at least two raw bytes or all that are left: is there another one? */
static void look_behind_member(struct inflater *in)
{
    const unsigned char *next = in->raw + in->raw_begin;
    if (in->raw_end - in->raw_begin >= 2 && next[0] == 0x1f && next[1] == 0x8b)
        begin_member(in);
    else
        in->place = BEHIND_MEMBERS;
}

/* What stands behind the last member is read to its end (the digest is one of all bytes). */
static void skip_rest(struct inflater *in)
{
    const size_t raw = in->raw_end - in->raw_begin;
    for (size_t i = 0; i < raw && in->ignored_from == UINT64_MAX; i++) {
        if (in->raw[in->raw_begin + i] != 0)
            in->ignored_from = in->raw_size + i;
    }
    use_raw(in, raw);
    if (in->raw_ended)
        in->place = ENDED;
}

/* Makes progress: bytes, or raw bytes used or read, or the end or a failure found. */
static enum status advance(struct context *ctx, struct inflater *in, unsigned char *to, size_t room,
                           size_t *got)
{
    const size_t raw = in->raw_end - in->raw_begin;
    const enum place before = in->place;
    const size_t needed = before == BETWEEN_MEMBERS ? 2 : 1;
    if (in->damage)
        return fail(ctx, STATUS_BAD_INPUT, "%s: damaged gzip data near byte %llu: %s", in->name,
                    (unsigned long long)in->raw_size, in->damage);
    if (raw < needed && !in->raw_ended)
        return refill_raw(ctx, in);
    if (in->place == IN_DATA)
        inflate_some(in, to, room, got);
    else if (in->place < IN_DATA)
        read_header(in);
    else if (in->place == IN_TRAILER)
        read_trailer(in);
    else if (in->place == BETWEEN_MEMBERS)
        look_behind_member(in);
    else
        skip_rest(in);
    /* Out of input: ISA-L may still hold output back for want of room, so it was asked first. */
    if (raw == 0 && *got == 0 && in->place == before && before <= IN_TRAILER && !in->damage)
        return fail(ctx, STATUS_BAD_INPUT, "%s: the gzip data is cut off at byte %llu", in->name,
                    (unsigned long long)in->raw_size);
    return STATUS_OK;
}

enum status inflater_read(struct context *ctx, struct inflater *in, unsigned char *to, size_t room,
                          size_t *got)
{
    *got = 0;
    while (*got == 0 && in->place != ENDED && in->failed == STATUS_OK)
        in->failed = advance(ctx, in, to, room, got);
    return *got ? STATUS_OK : in->failed;
}

enum status inflater_open(struct context *ctx, const char *name, int fd, const unsigned char *first,
                          size_t size, struct inflater **out)
{
    struct inflater *in;
    *out = NULL;
    enum status status = memory_take_zeroed(ctx, 1, sizeof *in, &in);
    if (status != STATUS_OK)
        return status;
    in->name = name;
    in->fd = fd;
    in->ignored_from = UINT64_MAX;
    isal_inflate_init(&in->isal); /* crc_flag 0: no header, no trailer */
    begin_member(in);
    status = memory_take(ctx, TAKEN_BACK + RAW_BUFFER, 1, &in->raw);
    if (status != STATUS_OK) {
        inflater_close(ctx, &in);
        return status;
    }
    memcpy(in->raw, first, size);
    in->raw_end = size;
    in->digest = checksum(0, first, size);
    *out = in;
    return STATUS_OK;
}

void inflater_close(struct context *ctx, struct inflater **inflater)
{
    if (!*inflater)
        return;
    memory_release(ctx, &(*inflater)->raw, TAKEN_BACK + RAW_BUFFER, 1);
    memory_release(ctx, inflater, 1, sizeof **inflater);
}

uint32_t inflater_digest(const struct inflater *inflater)
{
    return inflater->digest;
}

uint64_t inflater_raw_size(const struct inflater *inflater)
{
    return inflater->raw_size;
}

uint64_t inflater_ignored_from(const struct inflater *inflater)
{
    return inflater->ignored_from;
}
