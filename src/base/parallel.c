/*
 * A loop and an ordered pipeline over numbered jobs.
 *
 * Cutting the jobs into one share a thread leaves threads idle when jobs differ; so each thread
 * takes the next number. What that changes from run to run is only who does what and when: results
 * belong to the job's number, and where their order matters (a file written front to back) `finish`
 * is called in that order, by whichever thread finds the next one done, while the others work on. A
 * stream that only one can read at a time is cut into jobs by `begin` in the same way. No thread
 * has a part of its own: it finishes what it can, else cuts what it may, else works.
 *
 * A thread that is created for each call costs 20 microseconds, and 100 before it runs; where other
 * processes are at work it may be milliseconds, and its end is waited for though it did nothing. To
 * a stage that is nothing, but the sweeps of a small mesh are shorter. So a *crew* of threads
 * sleeps between two calls, and nobody waits for a thread that has not come before the work was
 * done. The caller's thread is worker 0. Where the system refuses a thread, fewer do the same.
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
    enum status (*begin)(void *user, uint64_t job, bool *is_end); /* NULL: there is nothing to do */
    enum status (*work)(void *user, uint64_t job, unsigned worker);
    enum status (*finish)(void *user, uint64_t job); /* NULL: a loop, not a pipeline */
    void *user;

    pthread_mutex_t lock;
    pthread_cond_t changed;
    uint64_t cut;      /* jobs [0, cut) are there to be begun (if there is `begin`) */
    uint64_t next;     /* job to hand out */
    uint64_t finished; /* jobs [0, finished) are finished (pipeline) */
    bool is_cutting;   /* some thread is in begin() */
    bool is_finishing; /* some thread is in finish() */
    bool *is_done;     /* a ring of in_flight flags: work(job) has returned, job % in_flight */
    enum status failed;
    uint64_t failed_job; /* lowest job that failed; its status is the one returned */
};

/* Threads that wait for a team to work in. */
struct crew {
    pthread_mutex_t lock;
    pthread_cond_t called; /* a team wants members, or it is the end */
    pthread_cond_t left;   /* nobody is at work any more */
    struct team *team;     /* that may be joined while it wants members */
    unsigned wanted;
    unsigned joined; /* so far, the caller counted: the next one's number */
    unsigned at_work;
    bool is_ending;
    unsigned most, count; /* of threads */
    pthread_t threads[];
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

/* Begins the next job and does it, unlocked; the lock is held before and after. Returns which. */
static uint64_t do_next(struct team *team, unsigned worker)
{
    const uint64_t job = team->next++;
    pthread_mutex_unlock(&team->lock);
    enum status status = poll_cancel(team->ctx);
    if (status == STATUS_OK)
        status = team->work(team->user, job, worker);
    pthread_mutex_lock(&team->lock);
    note_failure(team, job, status);
    return job;
}

static void run_loop(struct team *team, unsigned worker)
{
    pthread_mutex_lock(&team->lock);
    while (team->failed == STATUS_OK && team->next < team->jobs)
        (void)do_next(team, worker);
    pthread_mutex_unlock(&team->lock);
}

static bool can_finish(const struct team *team)
{
    return !team->is_finishing && team->finished < team->next &&
           team->is_done[team->finished % team->in_flight];
}

static bool can_cut(const struct team *team)
{
    return team->begin && !team->is_cutting && team->cut < team->jobs &&
           team->cut - team->finished < team->in_flight;
}

static bool can_begin(const struct team *team)
{
    return team->next < (team->begin ? team->cut : team->jobs) &&
           team->next - team->finished < team->in_flight;
}

/* Whether the thread that finishes need not wake others yet: it goes on finishing, and to be woken
 * for one job costs as much as many a job. */
static bool goes_on_finishing(const struct team *team)
{
    return can_finish(team) && 2 * (team->next - team->finished) > team->in_flight;
}

/* The lock is held before and after these, as for do_next. */
static void finish_next(struct team *team)
{
    const uint64_t job = team->finished;
    team->is_finishing = true;
    pthread_mutex_unlock(&team->lock);
    enum status status = team->finish(team->user, job);
    pthread_mutex_lock(&team->lock);
    note_failure(team, job, status);
    team->is_done[job % team->in_flight] = false;
    team->is_finishing = false;
    team->finished++;
}

static void cut_next(struct team *team)
{
    bool is_end = false;
    team->is_cutting = true;
    pthread_mutex_unlock(&team->lock);
    enum status status = poll_cancel(team->ctx);
    if (status == STATUS_OK)
        status = team->begin(team->user, team->cut, &is_end);
    pthread_mutex_lock(&team->lock);
    note_failure(team, team->cut, status);
    team->is_cutting = false;
    if (is_end)
        team->jobs = team->cut;
    else
        team->cut++;
}

static void run_pipeline(struct team *team, unsigned worker)
{
    pthread_mutex_lock(&team->lock);
    while (team->failed == STATUS_OK && team->finished < team->jobs) {
        if (can_finish(team)) {
            finish_next(team);
            if (team->failed == STATUS_OK && goes_on_finishing(team))
                continue;
        } else if (can_cut(team)) {
            cut_next(team);
        } else if (can_begin(team)) {
            team->is_done[do_next(team, worker) % team->in_flight] = true;
        } else {
            pthread_cond_wait(&team->changed, &team->lock);
            continue;
        }
        pthread_cond_broadcast(&team->changed);
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

/* Signals are the business of the caller's thread, but for those that a fault of the thread's own
 * raises. */
bool thread_begin(pthread_t *thread, void *(*main_of)(void *argument), void *argument)
{
    pthread_attr_t attributes;
    sigset_t blocked, before;
    if (pthread_attr_init(&attributes) != 0)
        return false;
    (void)pthread_attr_setstacksize(&attributes, STACK_BYTES);
    sigfillset(&blocked);
    sigdelset(&blocked, SIGSEGV);
    sigdelset(&blocked, SIGBUS);
    sigdelset(&blocked, SIGFPE);
    sigdelset(&blocked, SIGILL);
    pthread_sigmask(SIG_SETMASK, &blocked, &before);
    int error = pthread_create(thread, &attributes, main_of, argument);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    pthread_attr_destroy(&attributes);
    return error == 0;
}

/* ---- the crew ---- */

static void *serve(void *argument)
{
    struct crew *crew = argument;
    pthread_mutex_lock(&crew->lock);
    while (!crew->is_ending) {
        if (crew->wanted == 0) {
            pthread_cond_wait(&crew->called, &crew->lock);
            continue;
        }
        struct team *team = crew->team;
        const unsigned worker = crew->joined++;
        crew->wanted--;
        crew->at_work++;
        pthread_mutex_unlock(&crew->lock);
        run(team, worker);
        pthread_mutex_lock(&crew->lock);
        if (--crew->at_work == 0)
            pthread_cond_signal(&crew->left);
    }
    pthread_mutex_unlock(&crew->lock);
    return NULL;
}

static size_t crew_bytes(unsigned most)
{
    const struct crew *crew = NULL;
    return sizeof *crew + most * sizeof *crew->threads;
}

static void crew_end(struct context *ctx, struct crew *crew)
{
    if (!crew)
        return;
    pthread_mutex_lock(&crew->lock);
    crew->is_ending = true;
    pthread_cond_broadcast(&crew->called);
    pthread_mutex_unlock(&crew->lock);
    for (unsigned i = 0; i < crew->count; i++)
        pthread_join(crew->threads[i], NULL);
    pthread_cond_destroy(&crew->left);
    pthread_cond_destroy(&crew->called);
    pthread_mutex_destroy(&crew->lock);
    memory_release(ctx, &crew, 1, crew_bytes(crew->most));
}

/* The one that is kept, if nobody has it, or one without threads. */
static enum status crew_get(struct context *ctx, unsigned most, struct crew **out)
{
    *out = atomic_exchange(&ctx->crew, NULL);
    if (*out && (*out)->most >= most)
        return STATUS_OK;
    crew_end(ctx, *out);
    enum status status = memory_take_zeroed(ctx, 1, crew_bytes(most), out);
    if (status != STATUS_OK)
        return status;
    (*out)->most = most;
    pthread_mutex_init(&(*out)->lock, NULL);
    pthread_cond_init(&(*out)->called, NULL);
    pthread_cond_init(&(*out)->left, NULL);
    return STATUS_OK;
}

static void crew_give_back(struct context *ctx, struct crew *crew)
{
    struct crew *none = NULL;
    if (!ctx->keeps_threads || !atomic_compare_exchange_strong(&ctx->crew, &none, crew))
        crew_end(ctx, crew);
}

void parallel_keep_threads(struct context *ctx, bool keep)
{
    ctx->keeps_threads = keep;
    if (!keep)
        crew_end(ctx, atomic_exchange(&ctx->crew, NULL));
}

/* Runs the team on up to `threads` threads and waits for all that have joined it. */
static enum status run_team(struct team *team, unsigned threads)
{
    struct crew *crew;
    enum status status = crew_get(team->ctx, team->ctx->threads, &crew);
    if (status != STATUS_OK)
        return status;
    pthread_mutex_init(&team->lock, NULL);
    pthread_cond_init(&team->changed, NULL);

    pthread_mutex_lock(&crew->lock);
    crew->team = team;
    crew->wanted = threads - 1;
    crew->joined = 1;
    const unsigned asleep = crew->count;
    for (unsigned i = 0; i < asleep && i < crew->wanted; i++)
        pthread_cond_signal(&crew->called);
    pthread_mutex_unlock(&crew->lock);
    while (crew->count < threads - 1 && thread_begin(&crew->threads[crew->count], serve, crew))
        crew->count++;

    run(team, 0);
    pthread_mutex_lock(&crew->lock);
    crew->wanted = 0;
    while (crew->at_work > 0)
        pthread_cond_wait(&crew->left, &crew->lock);
    crew->team = NULL;
    pthread_mutex_unlock(&crew->lock);
    pthread_cond_destroy(&team->changed);
    pthread_mutex_destroy(&team->lock);
    crew_give_back(team->ctx, crew);
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

static enum status run_in_order(struct team *team)
{
    enum status status = STATUS_OK;
    bool is_end = false;
    for (uint64_t job = 0; job < team->jobs && status == STATUS_OK && !is_end; job++) {
        status = poll_cancel(team->ctx);
        if (status == STATUS_OK && team->begin)
            status = team->begin(team->user, job, &is_end);
        if (status == STATUS_OK && !is_end)
            status = team->work(team->user, job, 0);
        if (status == STATUS_OK && !is_end)
            status = team->finish(team->user, job);
    }
    return status;
}

static enum status run_ordered(struct team *team, unsigned in_flight)
{
    unsigned threads = useful_threads(team->ctx, team->jobs);
    if (in_flight > 0 && in_flight < threads)
        threads = in_flight;
    if (threads <= 1)
        return run_in_order(team);
    team->in_flight = in_flight > 0 ? in_flight : 2 * (uint64_t)threads;
    const size_t places = (size_t)team->in_flight;
    enum status status =
        memory_take_zeroed(team->ctx, places, sizeof *team->is_done, &team->is_done);
    if (status != STATUS_OK)
        return status;
    status = run_team(team, threads);
    memory_release(team->ctx, &team->is_done, places, sizeof *team->is_done);
    return status;
}

enum status parallel_ordered(struct context *ctx, uint64_t jobs, unsigned in_flight,
                             enum status (*work)(void *user, uint64_t job, unsigned worker),
                             enum status (*finish)(void *user, uint64_t job), void *user)
{
    struct team team = {.ctx = ctx, .jobs = jobs, .work = work, .finish = finish, .user = user};
    return run_ordered(&team, in_flight);
}

enum status parallel_stream(struct context *ctx, unsigned in_flight,
                            enum status (*begin)(void *user, uint64_t job, bool *is_end),
                            enum status (*work)(void *user, uint64_t job, unsigned worker),
                            enum status (*finish)(void *user, uint64_t job), void *user)
{
    struct team team = {.ctx = ctx, .jobs = UINT64_MAX, .begin = begin, .user = user};
    team.work = work;
    team.finish = finish;
    return run_ordered(&team, in_flight);
}
