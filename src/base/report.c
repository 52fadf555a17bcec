/*
 * Keeping the first failure of a job, and calling the caller back.
 *
 * A failure is often followed by others: clean-up that fails too, workers that stop with the same
 * full disk. The naive report, the last one, then hides the cause; so the first one stays, under a
 * lock, because any worker may be the one that fails. Texts are one line whatever a file name
 * holds: control characters are replaced.
 */
#include "base/report.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>

void context_init(struct context *ctx)
{
    memset(ctx, 0, sizeof *ctx);
    ctx->memory_budget = UINT64_MAX;
    ctx->threads = 1;
    ctx->cpu_level_cap = UINT_MAX;
    atomic_init(&ctx->memory_now, 0);
    atomic_init(&ctx->memory_peak, 0);
    atomic_init(&ctx->fault_after, UINT64_MAX);
    atomic_init(&ctx->crew, NULL);
    ctx->failed = STATUS_OK;
    spare_maps_init(&ctx->spares);
    pthread_mutex_init(&ctx->lock, NULL);
    pthread_mutex_init(&ctx->callback_lock, NULL);
}

void context_clear(struct context *ctx)
{
    spare_maps_clear(&ctx->spares);
    pthread_mutex_destroy(&ctx->lock);
    pthread_mutex_destroy(&ctx->callback_lock);
}

/* Bytes below a blank and DEL become '?'; a text stays one line, whatever a name in it holds. */
static void make_one_line(char *text)
{
    for (; *text; text++) {
        unsigned char byte = (unsigned char)*text;
        if (byte < ' ' || byte == 127)
            *text = '?';
    }
}

/* Words and a reason behind them (or NULL). Where names make them too long for `text`, which has
 * the size of ctx->error, it is the middle that goes: the reason stands at the end. */
static void put_words(char *text, size_t size, const char *format, va_list arguments,
                      const char *reason)
{
    static const char gap[] = " [...] ";
    char whole[4 * PATH_MAX];
    int length = vsnprintf(whole, sizeof whole, format, arguments);
    size_t used = length < 0 ? 0 : (size_t)length;
    used = used < sizeof whole - 160 ? used : sizeof whole - 160;
    if (reason)
        used += (size_t)snprintf(whole + used, sizeof whole - used, ": %.140s", reason);
    if (used < size) {
        memcpy(text, whole, used);
        text[used] = '\0';
        return;
    }
    const size_t head = size / 2, tail = size - head - sizeof gap;
    memcpy(text, whole, head);
    memcpy(text + head, gap, sizeof gap - 1);
    memcpy(text + head + sizeof gap - 1, whole + used - tail, tail);
    text[size - 1] = '\0';
}

static void record(struct context *ctx, enum status status, const char *text)
{
    pthread_mutex_lock(&ctx->lock);
    if (ctx->failed == STATUS_OK) {
        ctx->failed = status;
        snprintf(ctx->error, sizeof ctx->error, "%s", text);
        make_one_line(ctx->error);
    }
    pthread_mutex_unlock(&ctx->lock);
}

enum status fail(struct context *ctx, enum status status, const char *format, ...)
{
    char text[sizeof ctx->error];
    va_list arguments;
    va_start(arguments, format);
    put_words(text, sizeof text, format, arguments, NULL);
    va_end(arguments);
    record(ctx, status, text);
    return status;
}

enum status fail_errno(struct context *ctx, int error, const char *format, ...)
{
    char text[sizeof ctx->error], words[128];
    va_list arguments;
    va_start(arguments, format);
    put_words(text, sizeof text, format, arguments, strerror_r(error, words, sizeof words));
    va_end(arguments);
    enum status status = STATUS_IO;
    if (error == ENOSPC || error == EDQUOT)
        status = STATUS_NO_SPACE;
    else if (error == ENOMEM)
        status = STATUS_NO_MEMORY;
    record(ctx, status, text);
    return status;
}

void failure_forget(struct context *ctx)
{
    ctx->failed = STATUS_OK;
    ctx->error[0] = '\0';
}

void tell(struct context *ctx, enum message_level level, const char *format, ...)
{
    if (!ctx->message)
        return;
    char text[sizeof ctx->error];
    va_list arguments;
    va_start(arguments, format);
    put_words(text, sizeof text, format, arguments, NULL);
    va_end(arguments);
    make_one_line(text);
    pthread_mutex_lock(&ctx->callback_lock);
    ctx->message(ctx->user, level, text);
    pthread_mutex_unlock(&ctx->callback_lock);
}

enum status poll_cancel(struct context *ctx)
{
    if (ctx->cancelled && ctx->cancelled(ctx->user))
        return fail(ctx, STATUS_CANCELLED, "cancelled");
    return STATUS_OK;
}

enum status step(struct context *ctx, const char *stage, uint64_t done, uint64_t total)
{
    if (ctx->progress) {
        pthread_mutex_lock(&ctx->callback_lock);
        ctx->progress(ctx->user, stage, done, total);
        pthread_mutex_unlock(&ctx->callback_lock);
    }
    return poll_cancel(ctx);
}
