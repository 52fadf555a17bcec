/*
 * Threads: a loop over numbered jobs, and pipelines whose results come out in order. What is
 * computed never depends on the number of threads; only when.
 */
#ifndef SPBM_BASE_PARALLEL_H
#define SPBM_BASE_PARALLEL_H

#include <pthread.h>

#include "report.h"

/* A thread of its own, which takes no signals; to be joined. False when the system refuses it. */
bool thread_begin(pthread_t *thread, void *(*main_of)(void *argument), void *argument);

/* Whether threads are kept from one call to the next, so that they need not be created again: off
 * at first; off again, they end. No worker may be at work. */
void parallel_keep_threads(struct context *ctx, bool keep);

/* Calls work(user, job, worker) for every job in [0, jobs), from up to ctx->threads threads
 * (worker is their number, below ctx->threads); the first failure stops the handing out of further
 * jobs, as does a caller that wants to cancel. Returns when no thread is at work any more. With one
 * thread, jobs run in order on the caller's. */
enum status parallel_for(struct context *ctx, uint64_t jobs,
                         enum status (*work)(void *user, uint64_t job, unsigned worker),
                         void *user) MUST_CHECK;

/* The same, and after each job `finish(user, job)` on one thread at a time, strictly in the order
 * of the jobs. At most `in_flight` jobs are begun and not yet finished (0: twice the threads), so
 * that their results are bounded: what job j makes can live in place j % in_flight. No I/O needs to
 * happen in work. After a failure some jobs have been worked on and are not finished: the caller
 * clears all places. */
enum status parallel_ordered(struct context *ctx, uint64_t jobs, unsigned in_flight,
                             enum status (*work)(void *user, uint64_t job, unsigned worker),
                             enum status (*finish)(void *user, uint64_t job),
                             void *user) MUST_CHECK;

/* The same for jobs whose number shows on the way: some time before each job's work `begin(user,
 * job, &is_end)` on one thread at a time, strictly in the order of the jobs. It may say that there
 * is no such job: then it is the end, once those before it are finished. in_flight is at least 1.
 */
enum status parallel_stream(struct context *ctx, unsigned in_flight,
                            enum status (*begin)(void *user, uint64_t job, bool *is_end),
                            enum status (*work)(void *user, uint64_t job, unsigned worker),
                            enum status (*finish)(void *user, uint64_t job), void *user) MUST_CHECK;

#endif
