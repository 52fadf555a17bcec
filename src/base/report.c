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
    ctx->failed = STATUS_OK;
    pthread_mutex_init(&ctx->lock, NULL);
    pthread_mutex_init(&ctx->callback_lock, NULL);
}

void context_clear(struct context *ctx)
{
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
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    record(ctx, status, text);
    return status;
}

enum status fail_errno(struct context *ctx, int error, const char *format, ...)
{
    char text[sizeof ctx->error];
    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);

    size_t used = length < 0 ? 0 : (size_t)length;
    if (used < sizeof text) {
        char words[128];
        snprintf(text + used, sizeof text - used, ": %s", strerror_r(error, words, sizeof words));
    }
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
    vsnprintf(text, sizeof text, format, arguments);
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
