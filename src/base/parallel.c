/*
 * A loop and an ordered pipeline over numbered jobs.
 *
 * Cutting the jobs into one share a thread leaves threads idle when jobs differ; so each thread
 * takes the next number. What that changes from run to run is only who does what and when: results
 * belong to the job's number, and where their order matters (a file written front to back) `finish`
 * is called in that order, by whichever thread finds the next one done, while the others work on.
 *
 * Threads are created per call: a call is a stage or a batch of slabs, against which the creation
 * of a thread (some 20 microseconds) is nothing. The caller's thread is worker 0. Where the system
 * refuses a thread, fewer do the same.
 */
#include "base/parallel.h"

#include <pthread.h>
#include <signal.h>

#include "base/memory.h"

/* Stacks are small, so that a limit on address space goes to data and no huge page is spent on one.
 * No worker recurses in proportion to its data. */
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
enum { STACK_BYTES = 16 << 20 };
#else
enum { STACK_BYTES = 1 << 20 };
#endif

struct team {
    struct context *ctx;
    uint64_t jobs;
    uint64_t in_flight; /* at most this many begun and not finished */
    enum status (*work)(void *user, uint64_t job, unsigned worker);
    enum status (*finish)(void *user, uint64_t job); /* NULL: a loop, not a pipeline */
    void *user;

    pthread_mutex_t lock;
    pthread_cond_t changed;
    uint64_t next;     /* job to hand out */
    uint64_t finished; /* jobs [0, finished) are finished (pipeline) */
    bool is_finishing; /* some thread is in finish() */
    bool *is_done;     /* a ring of in_flight flags: work(job) has returned, job % in_flight */
    enum status failed;
    uint64_t failed_job; /* lowest job that failed; its status is the one returned */
};

struct member {
    struct team *team;
    pthread_t thread;
    unsigned worker;
};

/* The lock is held. */
static void note_failure(struct team *team, uint64_t job, enum status status)
{
    if (status == STATUS_OK)
        return;
    if (team->failed == STATUS_OK || job < team->failed_job) {
        team->failed = status;
        team->failed_job = job;
    }
}

static void run_loop(struct team *team, unsigned worker)
{
    pthread_mutex_lock(&team->lock);
    while (team->failed == STATUS_OK && team->next < team->jobs) {
        uint64_t job = team->next++;
        pthread_mutex_unlock(&team->lock);
        enum status status = poll_cancel(team->ctx);
        if (status == STATUS_OK)
            status = team->work(team->user, job, worker);
        pthread_mutex_lock(&team->lock);
        note_failure(team, job, status);
    }
    pthread_mutex_unlock(&team->lock);
}

static bool can_finish(const struct team *team)
{
    return !team->is_finishing && team->finished < team->next &&
           team->is_done[team->finished % team->in_flight];
}

static bool can_begin(const struct team *team)
{
    return team->next < team->jobs && team->next - team->finished < team->in_flight;
}

static void run_pipeline(struct team *team, unsigned worker)
{
    pthread_mutex_lock(&team->lock);
    while (team->failed == STATUS_OK && team->finished < team->jobs) {
        if (can_finish(team)) {
            uint64_t job = team->finished;
            team->is_finishing = true;
            pthread_mutex_unlock(&team->lock);
            enum status status = team->finish(team->user, job);
            pthread_mutex_lock(&team->lock);
            note_failure(team, job, status);
            team->is_done[job % team->in_flight] = false;
            team->is_finishing = false;
            team->finished++;
            pthread_cond_broadcast(&team->changed);
        } else if (can_begin(team)) {
            uint64_t job = team->next++;
            pthread_mutex_unlock(&team->lock);
            enum status status = poll_cancel(team->ctx);
            if (status == STATUS_OK)
                status = team->work(team->user, job, worker);
            pthread_mutex_lock(&team->lock);
            note_failure(team, job, status);
            team->is_done[job % team->in_flight] = true;
            pthread_cond_broadcast(&team->changed);
        } else {
            pthread_cond_wait(&team->changed, &team->lock);
        }
    }
    pthread_mutex_unlock(&team->lock);
}

static void run(struct team *team, unsigned worker)
{
    if (team->finish)
        run_pipeline(team, worker);
    else
        run_loop(team, worker);
}

static void *begin_member(void *argument)
{
    struct member *member = argument;
    run(member->team, member->worker);
    return NULL;
}

/* Signals are the business of the caller's thread, but for those that a fault of the thread's own
 * raises. */
bool thread_begin(pthread_t *thread, void *(*main_of)(void *argument), void *argument)
{
    sigset_t blocked, before;
    sigfillset(&blocked);
    sigdelset(&blocked, SIGSEGV);
    sigdelset(&blocked, SIGBUS);
    sigdelset(&blocked, SIGFPE);
    sigdelset(&blocked, SIGILL);
    pthread_sigmask(SIG_SETMASK, &blocked, &before);
    int error = pthread_create(thread, NULL, main_of, argument);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    return error == 0;
}

/* Runs the team on up to `threads` threads and waits for all of them. */
static enum status run_team(struct team *team, unsigned threads)
{
    struct context *ctx = team->ctx;
    struct member *members = NULL;
    enum status status = memory_take(ctx, threads, sizeof *members, &members);
    if (status != STATUS_OK)
        return status;
    pthread_mutex_init(&team->lock, NULL);
    pthread_cond_init(&team->changed, NULL);

    unsigned created = 1;
    for (; created < threads; created++) {
        struct member *member = &members[created];
        member->team = team;
        member->worker = created;
        if (!thread_begin(&member->thread, begin_member, member))
            break;
    }

    run(team, 0);
    for (unsigned i = 1; i < created; i++)
        pthread_join(members[i].thread, NULL);
    pthread_cond_destroy(&team->changed);
    pthread_mutex_destroy(&team->lock);
    memory_release(ctx, &members, threads, sizeof *members);
    return team->failed;
}

static unsigned useful_threads(const struct context *ctx, uint64_t jobs)
{
    unsigned threads = ctx->threads > 0 ? ctx->threads : 1;
    return threads < jobs ? threads : (unsigned)jobs;
}

enum status parallel_for(struct context *ctx, uint64_t jobs,
                         enum status (*work)(void *user, uint64_t job, unsigned worker), void *user)
{
    unsigned threads = useful_threads(ctx, jobs);
    if (threads <= 1) {
        for (uint64_t job = 0; job < jobs; job++) {
            enum status status = poll_cancel(ctx);
            if (status == STATUS_OK)
                status = work(user, job, 0);
            if (status != STATUS_OK)
                return status;
        }
        return STATUS_OK;
    }
    struct team team = {.ctx = ctx, .jobs = jobs, .work = work, .user = user};
    return run_team(&team, threads);
}

enum status parallel_ordered(struct context *ctx, uint64_t jobs, unsigned in_flight,
                             enum status (*work)(void *user, uint64_t job, unsigned worker),
                             enum status (*finish)(void *user, uint64_t job), void *user)
{
    unsigned threads = useful_threads(ctx, jobs);
    if (in_flight > 0 && in_flight < threads)
        threads = in_flight;
    if (threads <= 1) {
        for (uint64_t job = 0; job < jobs; job++) {
            enum status status = poll_cancel(ctx);
            if (status == STATUS_OK)
                status = work(user, job, 0);
            if (status == STATUS_OK)
                status = finish(user, job);
            if (status != STATUS_OK)
                return status;
        }
        return STATUS_OK;
    }

    struct team team = {.ctx = ctx, .jobs = jobs, .work = work, .finish = finish, .user = user};
    team.in_flight = in_flight > 0 ? in_flight : 2 * (uint64_t)threads;
    enum status status =
        memory_take_zeroed(ctx, (size_t)team.in_flight, sizeof *team.is_done, &team.is_done);
    if (status != STATUS_OK)
        return status;
    status = run_team(&team, threads);
    memory_release(ctx, &team.is_done, (size_t)team.in_flight, sizeof *team.is_done);
    return status;
}
