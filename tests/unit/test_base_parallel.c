/* Threads: every job once, results in order, never too many in flight, and the first failure ends
 * it. Timing differs from run to run; none of this may. */
#include "test_kit.h"

#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/memory.h"
#include "base/parallel.h"

enum { JOBS = 1000 };

struct board {
    _Atomic unsigned times[JOBS];
    _Atomic uint64_t begun;
    uint64_t finished;
    uint64_t most_open;
    uint64_t fail_at; /* work */
    uint64_t fail_finish_at;
    uint64_t cut; /* jobs that were made on the way, of: */
    uint64_t jobs, fail_cut_at;
    _Atomic int cutting;
    unsigned threads;
    _Atomic int wrong;
};

static void spin(uint64_t job)
{
    /* Jobs of very different lengths, so that they end out of order. */
    for (volatile uint64_t i = 0; i < (job * 7919 % 97) * 20; i++)
        ;
}

static enum status work(void *user, uint64_t job, unsigned worker)
{
    struct board *board = user;
    board->begun++;
    board->times[job]++;
    if (worker >= board->threads)
        board->wrong++;
    spin(job);
    return job == board->fail_at ? STATUS_BAD_INPUT : STATUS_OK;
}

/* Only ever called by one thread at a time, so plain members do. */
static enum status finish(void *user, uint64_t job)
{
    struct board *board = user;
    if (job != board->finished || board->times[job] != 1)
        board->wrong++;
    uint64_t open = board->begun - board->finished;
    if (open > board->most_open)
        board->most_open = open;
    board->finished++;
    return job == board->fail_finish_at ? STATUS_NO_SPACE : STATUS_OK;
}

static struct board *new_board(unsigned threads)
{
    struct board *board = calloc(1, sizeof *board);
    board->fail_at = board->fail_finish_at = board->fail_cut_at = UINT64_MAX;
    board->threads = threads;
    return board;
}

static void every_job_runs_once(void **state)
{
    (void)state;
    for (unsigned threads = 0; threads <= 8; threads++) {
        struct context ctx;
        context_init(&ctx);
        ctx.threads = threads;
        struct board *board = new_board(threads ? threads : 1);
        assert_int_equal(parallel_for(&ctx, JOBS, work, board), STATUS_OK);
        for (int i = 0; i < JOBS; i++)
            assert_int_equal(board->times[i], 1);
        assert_int_equal(board->wrong, 0);
        assert_int_equal(parallel_for(&ctx, 0, work, board), STATUS_OK);
        assert_int_equal(ctx.memory_now, 0);
        free(board);
        context_clear(&ctx);
    }
}

static void results_come_in_order(void **state)
{
    (void)state;
    for (unsigned threads = 1; threads <= 8; threads++) {
        for (unsigned in_flight = 0; in_flight <= 5; in_flight++) {
            struct context ctx;
            context_init(&ctx);
            ctx.threads = threads;
            struct board *board = new_board(threads);
            assert_int_equal(parallel_ordered(&ctx, JOBS, in_flight, work, finish, board),
                             STATUS_OK);
            assert_int_equal(board->finished, JOBS);
            assert_int_equal(board->wrong, 0);
            /* A begun job may be counted before the last finished one is: hence one more. */
            assert_true(board->most_open <= (in_flight ? in_flight : 2 * threads) + 1);
            assert_int_equal(ctx.memory_now, 0);
            free(board);
            context_clear(&ctx);
        }
    }
}

/* ---- jobs that are cut from a stream ---- */

static enum status cut(void *user, uint64_t job, bool *is_end)
{
    struct board *board = user;
    if (board->cutting++ > 0 || job != board->cut || (job < JOBS && board->times[job]))
        board->wrong++;
    spin(job + 3);
    *is_end = job == board->jobs;
    board->cut += !*is_end;
    board->cutting--;
    return job == board->fail_cut_at ? STATUS_IO : STATUS_OK;
}

static void jobs_may_be_cut_on_the_way(void **state)
{
    (void)state;
    static const uint64_t jobs[] = {0, 1, 2, 3, 300};
    for (unsigned threads = 1; threads <= 6; threads++)
        for (unsigned in_flight = 1; in_flight <= 6; in_flight++)
            for (unsigned n = 0; n < 5; n++) {
                struct context ctx;
                context_init(&ctx);
                ctx.threads = threads;
                struct board *board = new_board(threads);
                board->jobs = jobs[n];
                assert_int_equal(parallel_stream(&ctx, in_flight, cut, work, finish, board),
                                 STATUS_OK);
                assert_int_equal(board->cut, jobs[n]);
                assert_int_equal(board->begun, jobs[n]);
                assert_int_equal(board->finished, jobs[n]);
                assert_int_equal(board->wrong, 0);
                assert_true(board->most_open <= in_flight + 1);
                assert_int_equal(ctx.memory_now, 0);
                free(board);
                context_clear(&ctx);
            }
}

static void a_failure_stops_the_cutting(void **state)
{
    (void)state;
    for (unsigned threads = 1; threads <= 4; threads++)
        for (unsigned where = 0; where < 3; where++) {
            struct context ctx;
            context_init(&ctx);
            ctx.threads = threads;
            struct board *board = new_board(threads);
            board->jobs = JOBS;
            board->fail_cut_at = where == 0 ? 30 : UINT64_MAX;
            board->fail_at = where == 1 ? 30 : UINT64_MAX;
            board->fail_finish_at = where == 2 ? 30 : UINT64_MAX;
            static const enum status wanted[] = {STATUS_IO, STATUS_BAD_INPUT, STATUS_NO_SPACE};
            assert_int_equal(parallel_stream(&ctx, 3, cut, work, finish, board), wanted[where]);
            assert_true(board->finished <= 31);
            assert_true(board->cut <= 31 + 3);
            assert_int_equal(board->wrong, 0);
            assert_int_equal(ctx.memory_now, 0);
            free(board);
            context_clear(&ctx);
        }
}

static void a_failure_stops_the_loop(void **state)
{
    (void)state;
    for (unsigned threads = 1; threads <= 4; threads++) {
        struct context ctx;
        context_init(&ctx);
        ctx.threads = threads;
        struct board *board = new_board(threads);
        board->fail_at = 10;
        assert_int_equal(parallel_for(&ctx, JOBS, work, board), STATUS_BAD_INPUT);
        assert_true(board->begun < JOBS);
        memset(board, 0, sizeof *board);
        board->threads = threads;
        board->fail_at = 10;
        board->fail_finish_at = UINT64_MAX;
        assert_int_equal(parallel_ordered(&ctx, JOBS, 0, work, finish, board), STATUS_BAD_INPUT);
        assert_true(board->finished <= 11);
        memset(board, 0, sizeof *board);
        board->threads = threads;
        board->fail_at = UINT64_MAX;
        board->fail_finish_at = 20;
        assert_int_equal(parallel_ordered(&ctx, JOBS, 0, work, finish, board), STATUS_NO_SPACE);
        assert_int_equal(board->finished, 21);
        assert_int_equal(ctx.memory_now, 0);
        free(board);
        context_clear(&ctx);
    }
}

static void no_memory_is_said(void **state)
{
    (void)state;
    for (uint64_t after = 0; after < 2; after++) {
        struct context ctx;
        context_init(&ctx);
        ctx.threads = 3;
        struct board *board = new_board(3);
        ctx.fault_after = after;
        assert_int_equal(parallel_ordered(&ctx, JOBS, 0, work, finish, board), STATUS_NO_MEMORY);
        assert_int_equal(ctx.memory_now, 0);
        free(board);
        context_clear(&ctx);
    }
}

/* ---- threads that are kept ---- */

enum { THREADS_MAX = 8, CALLS = 200 };

struct roll {
    struct context *ctx;
    _Atomic pid_t names[THREADS_MAX + 1]; /* of threads that have been at work; 0: free */
    _Atomic unsigned jobs, wrong;
};

static void sign(struct roll *roll)
{
    const pid_t name = gettid();
    for (int i = 0; i <= THREADS_MAX; i++) {
        pid_t there = 0;
        if (atomic_compare_exchange_strong(&roll->names[i], &there, name) || there == name)
            return;
    }
    roll->wrong++;
}

static enum status small_job(void *user, uint64_t job, unsigned worker)
{
    struct roll *roll = user;
    (void)job;
    (void)worker;
    roll->jobs++;
    return STATUS_OK;
}

static enum status signed_job(void *user, uint64_t job, unsigned worker)
{
    struct roll *roll = user;
    if (worker >= roll->ctx->threads)
        roll->wrong++;
    sign(roll);
    spin(job);
    roll->jobs++;
    return STATUS_OK;
}

static enum status signed_finish(void *user, uint64_t job)
{
    (void)job;
    sign(user);
    return STATUS_OK;
}

static enum status job_of_jobs(void *user, uint64_t job, unsigned worker)
{
    struct roll *roll = user;
    (void)job;
    (void)worker;
    return parallel_for(roll->ctx, 5, small_job, roll);
}

static void kept_threads_are_the_same(void **state)
{
    (void)state;
    for (unsigned threads = 1; threads <= THREADS_MAX; threads++) {
        struct context ctx;
        context_init(&ctx);
        ctx.threads = threads;
        struct roll roll = {.ctx = &ctx};
        parallel_keep_threads(&ctx, true);
        for (unsigned call = 0; call < CALLS; call++) {
            assert_int_equal(parallel_for(&ctx, 1 + call % 11, signed_job, &roll), STATUS_OK);
            assert_int_equal(
                parallel_ordered(&ctx, 1 + call % 7, 3, signed_job, signed_finish, &roll),
                STATUS_OK);
        }
        unsigned names = 0, jobs = 0;
        for (unsigned call = 0; call < CALLS; call++)
            jobs += 1 + call % 11 + 1 + call % 7;
        for (int i = 0; i <= THREADS_MAX; i++)
            names += roll.names[i] != 0;
        assert_int_equal(roll.jobs, jobs);
        assert_int_equal(roll.wrong, 0);
        assert_in_range(names, 1, threads);
        parallel_keep_threads(&ctx, false);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
}

/* A job may ask for threads while all that are kept are at work. */
static void jobs_have_jobs(void **state)
{
    (void)state;
    for (unsigned threads = 1; threads <= 4; threads++)
        for (int keep = 0; keep <= 1; keep++) {
            struct context ctx;
            context_init(&ctx);
            ctx.threads = threads;
            struct roll roll = {.ctx = &ctx};
            parallel_keep_threads(&ctx, keep != 0);
            for (int call = 0; call < 20; call++)
                assert_int_equal(parallel_for(&ctx, 10, job_of_jobs, &roll), STATUS_OK);
            assert_int_equal(roll.jobs, 20 * 10 * 5);
            parallel_keep_threads(&ctx, false);
            assert_int_equal(ctx.memory_now, 0);
            context_clear(&ctx);
        }
}

/* After a failure the same threads do the next call. */
static void failures_leave_threads(void **state)
{
    (void)state;
    struct context ctx;
    context_init(&ctx);
    ctx.threads = 3;
    parallel_keep_threads(&ctx, true);
    for (int call = 0; call < 50; call++) {
        struct board *board = new_board(3);
        board->fail_at = call % 2 ? 10 : UINT64_MAX;
        assert_int_equal(parallel_ordered(&ctx, 100, 0, work, finish, board),
                         call % 2 ? STATUS_BAD_INPUT : STATUS_OK);
        assert_int_equal(board->wrong, 0);
        free(board);
    }
    parallel_keep_threads(&ctx, false);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_job_runs_once),         cmocka_unit_test(results_come_in_order),
        cmocka_unit_test(a_failure_stops_the_loop),    cmocka_unit_test(no_memory_is_said),
        cmocka_unit_test(kept_threads_are_the_same),   cmocka_unit_test(jobs_have_jobs),
        cmocka_unit_test(failures_leave_threads),      cmocka_unit_test(jobs_may_be_cut_on_the_way),
        cmocka_unit_test(a_failure_stops_the_cutting),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
