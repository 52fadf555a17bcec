/*
 * gzip, member after member, by zlib.
 *
 * Inflating takes as long as parsing what comes out, so a thread of its own inflates some pieces
 * ahead. It must not be seen from outside that it does: a failure is kept with the piece at which
 * it happened, in words of the thread's own context, and is told when the reader gets there, which
 * may fail before over what it read.
 *
 * Zero bytes behind the last member are padding; anything else there is ignored with a warning, as
 * gzip does.
 */
#include "base/gunzip.h"

#include <pthread.h>
#include <string.h>
#include <zlib.h>

#include "base/checksum.h"
#include "base/descriptor.h"
#include "base/memory.h"
#include "base/parallel.h"

enum { RAW_BUFFER = GUNZIP_FIRST, MAGIC_SIZE = 2, PIECES = 4, PIECE = 256 << 10 };

enum gzip_state { IN_MEMBER, BETWEEN_MEMBERS, BEHIND_MEMBERS, ENDED };

struct inflater {
    struct context *ctx;
    const char *name;
    int fd;
    bool raw_ended;     /* read(2) has said so */
    unsigned char *raw; /* bytes [raw_begin, raw_end) are not yet inflated */
    size_t raw_begin, raw_end;
    enum gzip_state state;
    z_stream zlib;
    bool zlib_ready;
    uint32_t digest;
    uint64_t raw_size;     /* bytes inflate has used */
    enum status failed;    /* behind bytes that are to be given first */
    uint64_t ignored_from; /* first byte behind the members that is not zero; UINT64_MAX: none */
};

struct piece {
    unsigned char *data; /* PIECE bytes */
    size_t begin, end;   /* not yet given */
    enum status status;  /* of what comes behind; the end, if there are no bytes and it is OK */
    uint32_t digest;
    uint64_t raw_size;
};

struct gunzip {
    struct context *ctx;
    struct inflater inflater;
    bool is_told; /* the warning */
    uint32_t digest;
    uint64_t raw_size;

    /* running ahead; pieces filled % PIECES to taken % PIECES are waiting to be taken */
    bool has_thread;
    pthread_t thread;
    struct context own; /* the thread's, for its failure */
    pthread_mutex_t lock;
    pthread_cond_t changed;
    uint64_t filled, taken;
    bool is_closing;
    struct piece pieces[PIECES];
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

/* ---- inflating ---- */

static void use_raw(struct inflater *in, size_t size)
{
    in->digest = checksum(in->digest, in->raw + in->raw_begin, size);
    in->raw_begin += size;
    in->raw_size += size;
}

static enum status refill_raw(struct inflater *in)
{
    memmove(in->raw, in->raw + in->raw_begin, in->raw_end - in->raw_begin);
    in->raw_end -= in->raw_begin;
    in->raw_begin = 0;
    size_t got;
    enum status status = descriptor_read(in->ctx, in->fd, in->name, in->raw + in->raw_end,
                                         RAW_BUFFER - in->raw_end, &got);
    if (status == STATUS_OK && got == 0)
        in->raw_ended = true;
    in->raw_end += got;
    return status;
}

/* Inflates as far as the raw bytes at hand and the room go. */
static enum status inflate_some(struct inflater *in, unsigned char *to, size_t room, size_t *got)
{
    size_t raw = in->raw_end - in->raw_begin;
    in->zlib.next_in = in->raw + in->raw_begin;
    in->zlib.avail_in = (uInt)raw;
    in->zlib.next_out = to;
    in->zlib.avail_out = (uInt)room;
    int result = inflate(&in->zlib, Z_NO_FLUSH);
    use_raw(in, raw - in->zlib.avail_in);
    *got = room - in->zlib.avail_out;

    if (result == Z_STREAM_END) {
        in->state = BETWEEN_MEMBERS;
        return STATUS_OK;
    }
    if (result == Z_OK || result == Z_BUF_ERROR)
        return STATUS_OK;
    if (result == Z_MEM_ERROR)
        return fail(in->ctx, STATUS_NO_MEMORY, "not enough memory to inflate %s", in->name);
    return fail(in->ctx, STATUS_BAD_INPUT, "%s: damaged gzip data near byte %llu: %s", in->name,
                (unsigned long long)in->raw_size,
                in->zlib.msg ? in->zlib.msg : "a preset dictionary is asked for");
}

/* Behind a member, with at least two raw bytes or all that are left: is there another one? */
static enum status look_behind_member(struct inflater *in)
{
    const unsigned char *next = in->raw + in->raw_begin;
    size_t raw = in->raw_end - in->raw_begin;
    if (raw >= MAGIC_SIZE && next[0] == 0x1f && next[1] == 0x8b) {
        in->state = IN_MEMBER;
        return inflateReset(&in->zlib) == Z_OK
                   ? STATUS_OK
                   : fail(in->ctx, STATUS_INTERNAL, "%s: zlib can't begin again", in->name);
    }
    in->state = BEHIND_MEMBERS;
    return STATUS_OK;
}

/* Reads what stands behind the last member to its end (the digest is one of all bytes). */
static enum status skip_rest(struct inflater *in)
{
    for (;;) {
        size_t raw = in->raw_end - in->raw_begin;
        for (size_t i = 0; i < raw && in->ignored_from == UINT64_MAX; i++) {
            if (in->raw[in->raw_begin + i] != 0)
                in->ignored_from = in->raw_size + i;
        }
        use_raw(in, raw);
        if (in->raw_ended)
            break;
        enum status status = refill_raw(in);
        if (status != STATUS_OK)
            return status;
    }
    in->state = ENDED;
    return STATUS_OK;
}

/* Makes progress: bytes, or raw bytes used or read, or the end found. */
static enum status advance(struct inflater *in, unsigned char *to, size_t room, size_t *got)
{
    *got = 0;
    if (in->state == BEHIND_MEMBERS)
        return skip_rest(in);
    size_t raw = in->raw_end - in->raw_begin;
    size_t needed = in->state == BETWEEN_MEMBERS ? MAGIC_SIZE : 1;
    if (raw < needed && !in->raw_ended)
        return refill_raw(in);
    if (in->state == BETWEEN_MEMBERS)
        return look_behind_member(in);
    enum status status = inflate_some(in, to, room, got);
    /* Out of input: zlib may still hold output back for want of room, so ask it first. */
    if (status == STATUS_OK && raw == 0 && *got == 0 && in->state == IN_MEMBER)
        return fail(in->ctx, STATUS_BAD_INPUT, "%s: the gzip data is cut off at byte %llu",
                    in->name, (unsigned long long)in->raw_size);
    return status;
}

/* At least one byte, if nothing fails; *got 0 at the end. */
static enum status inflate_at_least_one(struct inflater *in, unsigned char *to, size_t room,
                                        size_t *got)
{
    *got = 0;
    while (*got == 0 && in->state != ENDED && in->failed == STATUS_OK)
        in->failed = advance(in, to, room, got);
    return *got ? STATUS_OK : in->failed;
}

/* ---- running ahead ---- */

/* As much as a piece holds, or comes before the end or a failure. */
static void fill_piece(struct inflater *in, struct piece *piece)
{
    piece->begin = piece->end = 0;
    piece->status = STATUS_OK;
    while (piece->end < PIECE && in->state != ENDED && piece->status == STATUS_OK) {
        size_t got;
        piece->status =
            inflate_at_least_one(in, piece->data + piece->end, PIECE - piece->end, &got);
        piece->end += got;
    }
    piece->digest = in->digest;
    piece->raw_size = in->raw_size;
}

static void *run_ahead(void *argument)
{
    struct gunzip *g = argument;
    bool is_last = false;
    pthread_mutex_lock(&g->lock);
    while (!g->is_closing && !is_last) {
        if (g->filled - g->taken == PIECES) {
            pthread_cond_wait(&g->changed, &g->lock);
            continue;
        }
        struct piece *piece = &g->pieces[g->filled % PIECES];
        pthread_mutex_unlock(&g->lock);
        fill_piece(&g->inflater, piece);
        is_last = piece->status != STATUS_OK || piece->end == 0;
        pthread_mutex_lock(&g->lock);
        g->filled++;
        pthread_cond_signal(&g->changed);
    }
    pthread_mutex_unlock(&g->lock);
    return NULL;
}

static enum status take_ahead(struct gunzip *g, unsigned char *to, size_t room, size_t *got)
{
    pthread_mutex_lock(&g->lock);
    while (g->filled == g->taken)
        pthread_cond_wait(&g->changed, &g->lock);
    struct piece *piece = &g->pieces[g->taken % PIECES];
    pthread_mutex_unlock(&g->lock);
    size_t size = piece->end - piece->begin;
    *got = size < room ? size : room;
    memcpy(to, piece->data + piece->begin, *got);
    piece->begin += *got;
    g->digest = piece->digest;
    g->raw_size = piece->raw_size;
    if (*got == 0)
        return piece->status == STATUS_OK ? STATUS_OK
                                          : fail(g->ctx, piece->status, "%s", g->own.error);
    if (piece->begin == piece->end && piece->status == STATUS_OK) {
        pthread_mutex_lock(&g->lock);
        g->taken++;
        pthread_cond_signal(&g->changed);
        pthread_mutex_unlock(&g->lock);
    }
    return STATUS_OK;
}

/* Where no thread can be had, the reader inflates. */
static enum status start_thread(struct gunzip *g)
{
    enum status status = STATUS_OK;
    for (unsigned i = 0; i < PIECES && status == STATUS_OK; i++)
        status = memory_take(g->ctx, PIECE, 1, &g->pieces[i].data);
    if (status != STATUS_OK)
        return status;
    context_init(&g->own);
    g->own.cancelled = g->ctx->cancelled;
    g->own.user = g->ctx->user;
    g->inflater.ctx = &g->own;
    pthread_mutex_init(&g->lock, NULL);
    pthread_cond_init(&g->changed, NULL);
    g->has_thread = thread_begin(&g->thread, run_ahead, g);
    if (!g->has_thread) {
        g->inflater.ctx = g->ctx;
        pthread_cond_destroy(&g->changed);
        pthread_mutex_destroy(&g->lock);
        context_clear(&g->own);
    }
    return STATUS_OK;
}

static void end_thread(struct gunzip *g)
{
    if (!g->has_thread)
        return;
    pthread_mutex_lock(&g->lock);
    g->is_closing = true;
    pthread_cond_signal(&g->changed);
    pthread_mutex_unlock(&g->lock);
    pthread_join(g->thread, NULL);
    pthread_cond_destroy(&g->changed);
    pthread_mutex_destroy(&g->lock);
    context_clear(&g->own);
}

/* ---- the interface ---- */

enum status gunzip_open(struct context *ctx, const char *name, int fd, const unsigned char *first,
                        size_t size, struct gunzip **out)
{
    *out = NULL;
    struct gunzip *g;
    enum status status = memory_take_zeroed(ctx, 1, sizeof *g, &g);
    if (status != STATUS_OK)
        return status;
    g->ctx = ctx;
    struct inflater *in = &g->inflater;
    *in = (struct inflater){.ctx = ctx, .name = name, .fd = fd, .ignored_from = UINT64_MAX};
    status = memory_take(ctx, RAW_BUFFER, 1, &in->raw);
    if (status == STATUS_OK) {
        memcpy(in->raw, first, size);
        in->raw_end = size;
        in->zlib.zalloc = take_for_zlib;
        in->zlib.zfree = release_of_zlib;
        in->zlib.opaque = ctx;
        in->zlib_ready = inflateInit2(&in->zlib, MAX_WBITS + 16) == Z_OK; /* 16: gzip */
        if (!in->zlib_ready)
            status = fail(ctx, STATUS_NO_MEMORY, "not enough memory to inflate %s", name);
    }
    if (status == STATUS_OK && ctx->threads > 1)
        status = start_thread(g);
    if (status != STATUS_OK)
        gunzip_close(&g);
    *out = g;
    return status;
}

void gunzip_close(struct gunzip **gunzip)
{
    struct gunzip *g = *gunzip;
    if (!g)
        return;
    end_thread(g);
    if (g->inflater.zlib_ready)
        inflateEnd(&g->inflater.zlib);
    memory_release(g->ctx, &g->inflater.raw, RAW_BUFFER, 1);
    for (unsigned i = 0; i < PIECES; i++)
        memory_release(g->ctx, &g->pieces[i].data, PIECE, 1);
    memory_release(g->ctx, gunzip, 1, sizeof *g);
}

enum status gunzip_read(struct gunzip *g, unsigned char *to, size_t room, size_t *got)
{
    enum status status;
    if (g->has_thread) {
        status = take_ahead(g, to, room, got);
    } else {
        status = inflate_at_least_one(&g->inflater, to, room, got);
        g->digest = g->inflater.digest;
        g->raw_size = g->inflater.raw_size;
    }
    /* At the end the thread, if there is one, does no more. */
    if (status == STATUS_OK && *got == 0 && g->inflater.ignored_from != UINT64_MAX && !g->is_told) {
        tell(g->ctx, MESSAGE_WARNING, "%s: bytes behind the gzip data are ignored, from %llu on",
             g->inflater.name, (unsigned long long)g->inflater.ignored_from);
        g->is_told = true;
    }
    return status;
}

uint32_t gunzip_digest(const struct gunzip *gunzip)
{
    return gunzip->digest;
}

uint64_t gunzip_raw_size(const struct gunzip *gunzip)
{
    return gunzip->raw_size;
}
