/*
 * A gzip file inflated beside what becomes of it.
 *
 * Inflating takes about as long as parsing what comes out, so a thread of its own inflates some
 * pieces ahead of a reader that takes one after the other; a beginning is not worth a thread, and
 * readers that have several threads at work see to it themselves. It must not be seen from outside
 * who inflates: with several threads, a failure is told in words of a context of its own, kept, and
 * told again when the reader gets there, which may fail before over what it read.
 */
#include "base/gunzip.h"

#include <pthread.h>
#include <string.h>

#include "base/memory.h"
#include "base/parallel.h"

enum { PIECES = 4, PIECE = 256 << 10, ALONE = 1 << 20 /* bytes that are read without a thread */ };

struct piece {
    unsigned char *data; /* PIECE bytes */
    size_t begin, end;   /* not yet given */
    enum status status;  /* of what comes behind; the end, if there are no bytes and it is OK */
    uint32_t digest;
    uint64_t raw_size;
};

struct gunzip {
    struct context *ctx;
    const char *name;
    struct inflater *inflater;
    struct context own;        /* for what fails ahead of the reader */
    struct context *inflating; /* that, or ctx where there is but one thread */
    bool is_told;              /* the warning */
    uint32_t digest;
    uint64_t raw_size;

    /* running ahead; pieces filled % PIECES to taken % PIECES are waiting to be taken */
    uint64_t alone; /* bytes that gunzip_read has given without it */
    bool has_thread;
    pthread_t thread;
    pthread_mutex_t lock;
    pthread_cond_t changed;
    uint64_t filled, taken;
    bool is_closing;
    struct piece pieces[PIECES];
};

/* ---- running ahead ---- */

/* As much as a piece holds, or comes before the end or a failure. */
static void fill_piece(struct gunzip *g, struct piece *piece)
{
    piece->begin = piece->end = 0;
    piece->status = STATUS_OK;
    size_t got = 1;
    while (got > 0 && PIECE - piece->end >= GUNZIP_ROOM && piece->status == STATUS_OK) {
        piece->status = inflater_read(g->inflating, g->inflater, piece->data + piece->end,
                                      PIECE - piece->end, &got);
        piece->end += got;
    }
    piece->digest = inflater_digest(g->inflater);
    piece->raw_size = inflater_raw_size(g->inflater);
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
        fill_piece(g, piece);
        is_last = piece->status != STATUS_OK || piece->end == 0;
        pthread_mutex_lock(&g->lock);
        g->filled++;
        pthread_cond_signal(&g->changed);
    }
    pthread_mutex_unlock(&g->lock);
    return NULL;
}

/* The status is of what comes behind the bytes, if there are none. */
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
        return piece->status;
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
    if (status == STATUS_OK)
        g->has_thread = thread_begin(&g->thread, run_ahead, g);
    return status;
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
    g->name = name;
    context_init(&g->own);
    g->own.cancelled = ctx->cancelled;
    g->own.user = ctx->user;
    g->inflating = ctx->threads > 1 ? &g->own : ctx;
    pthread_mutex_init(&g->lock, NULL);
    pthread_cond_init(&g->changed, NULL);
    status = inflater_open(ctx, name, fd, first, size, &g->inflater);
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
    inflater_close(g->ctx, &g->inflater);
    pthread_cond_destroy(&g->changed);
    pthread_mutex_destroy(&g->lock);
    context_clear(&g->own);
    for (unsigned i = 0; i < PIECES; i++)
        memory_release(g->ctx, &g->pieces[i].data, PIECE, 1);
    memory_release(g->ctx, gunzip, 1, sizeof *g);
}

static enum status read_some(struct gunzip *g, unsigned char *to, size_t room, size_t *got)
{
    if (g->has_thread)
        return take_ahead(g, to, room, got);
    enum status status = inflater_read(g->inflating, g->inflater, to, room, got);
    g->digest = inflater_digest(g->inflater);
    g->raw_size = inflater_raw_size(g->inflater);
    return status;
}

void gunzip_read_quietly(struct gunzip *g, unsigned char *to, size_t room, size_t *got)
{
    /* What fails is kept: by the inflater or in the piece. */
    enum status status = read_some(g, to, room, got);
    (void)status;
}

enum status gunzip_read(struct gunzip *g, unsigned char *to, size_t room, size_t *got)
{
    *got = 0;
    enum status status = STATUS_OK;
    if (g->alone >= ALONE && g->ctx->threads > 1 && !g->pieces[0].data)
        status = start_thread(g);
    if (status != STATUS_OK)
        return status;
    status = read_some(g, to, room, got);
    g->alone += *got;
    if (status != STATUS_OK && g->inflating == &g->own)
        return fail(g->ctx, status, "%s", g->own.error);
    /* At the end the thread, if there is one, does no more. */
    const uint64_t ignored = *got == 0 ? inflater_ignored_from(g->inflater) : UINT64_MAX;
    if (status == STATUS_OK && ignored != UINT64_MAX && !g->is_told) {
        tell(g->ctx, MESSAGE_WARNING, "%s: bytes behind the gzip data are ignored, from %llu on",
             g->name, (unsigned long long)ignored);
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
