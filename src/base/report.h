/*
 * The context: what every stage is given besides its data. It carries the caller's callbacks
 * (progress, messages, cancelling), the limits (memory, threads, place for temporary files), the
 * account of memory, and the words for the first failure. One context serves one job at a time;
 * workers of that job may share it. There is no other state: the library has no globals.
 */
#ifndef SPBM_BASE_REPORT_H
#define SPBM_BASE_REPORT_H

#include <pthread.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "spare_maps.h"
#include "status.h"

struct crew;

enum message_level { MESSAGE_NOTE, MESSAGE_WARNING };

struct context {
    /* Set by the caller before the job, never written by the stages. */
    uint64_t memory_budget; /* bytes that blocks, windows and whatever else is resident may take
                               (memory.h): what the user allows less what the process takes by
                               being there; UINT64_MAX: no limit */
    uint64_t memory_aside;  /* that part, for words */
    unsigned threads;       /* at least 1 */
    const char *tmp_dir;    /* borrowed; NULL: beside the output */
    unsigned cpu_level_cap; /* highest enum cpu_level (cpu.h) to use; for tests, else UINT_MAX */
    /* progress and message: called from any worker, but never two at a time. */
    void (*progress)(void *user, const char *stage, uint64_t done, uint64_t total);
    void (*message)(void *user, enum message_level level, const char *text);
    bool (*cancelled)(void *user); /* polled between batches, from any worker */
    void *user;

    /* Written by memory.c. */
    _Atomic uint64_t memory_now;  /* bytes allocated through memory.h */
    _Atomic uint64_t memory_peak; /* largest memory_now so far */
    struct spare_maps spares;     /* not counted in them */
    _Atomic uint64_t fault_after; /* fault injection: this many more guarded calls succeed, then
                                     one fails; UINT64_MAX (the default): none fails */
    bool fault_kills; /* for tests, set before the job: only system calls count, and the one that is
                         due is the process's last: SIGKILL comes in its place */

    /* Written by parallel.c. */
    bool keeps_threads;
    _Atomic(struct crew *) crew; /* threads that sleep; NULL: none, or they are at work */

    /* Written by fail(): the first failure stays. */
    pthread_mutex_t lock;
    enum status failed;
    char error[1024];

    pthread_mutex_t callback_lock; /* held while progress or message runs */
};

/* Prepares a context with no callbacks, no budget, one thread. */
void context_init(struct context *ctx);
void context_clear(struct context *ctx);

/*
 * Records why a call fails and returns `status`, so that a function can end with
 * `return fail(ctx, STATUS_BAD_INPUT, ...)`. Only the first failure of a job is kept: clean-up that
 * fails after it does not hide it. The text is one line, without a full stop, and names file,
 * position and reason. Safe from any worker.
 */
enum status fail(struct context *ctx, enum status status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* The same, with ": " and the text of errno `error` appended; ENOSPC and EDQUOT turn into
 * STATUS_NO_SPACE, ENOMEM into STATUS_NO_MEMORY, all else into STATUS_IO. */
enum status fail_errno(struct context *ctx, int error, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Forgets the first failure: it was dealt with, and the job goes on. No worker may be at work. */
void failure_forget(struct context *ctx);

/* Tells the user something that is not a failure (what was dropped, what was chosen). */
void tell(struct context *ctx, enum message_level level, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* STATUS_CANCELLED, with words, if the caller wants to stop. Cheap enough for every few thousand
 * elements; loops over jobs ask by themselves (parallel.h). */
enum status poll_cancel(struct context *ctx) MUST_CHECK;

/* Reports `done` of `total` steps of a stage and polls the cancel callback: STATUS_CANCELLED if the
 * caller wants to stop. Cheap enough for once a batch, not for once a face. */
enum status step(struct context *ctx, const char *stage, uint64_t done, uint64_t total) MUST_CHECK;

#endif
