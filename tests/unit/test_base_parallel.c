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
    board->fail_at = board->fail_finish_at = UINT64_MAX;
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_job_runs_once),
        cmocka_unit_test(results_come_in_order),
        cmocka_unit_test(a_failure_stops_the_loop),
        cmocka_unit_test(no_memory_is_said),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
