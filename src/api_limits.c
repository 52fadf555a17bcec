/*
 * The memory budget of a call.
 *
 * What a user gives is what the whole process may have resident. So a part is set aside for what no
 * allocation shows: code, libraries, the heap's own tables, and each thread's stack and heap; the
 * rest is the stages' (context.memory_budget), who count blocks and windows against it. Each stage
 * tells the least it needs with so many threads. That is asked before anything is read, with what
 * the inputs claim of themselves, and again when a stage begins, with what is known then; where
 * fewer threads fit, fewer are used, which changes no byte of what comes out.
 */
#include "api_internal.h"

enum {
    /* Measured: VmHWM of a run less its account's peak is 2 to 4 MiB with one thread. */
    PROCESS_MEMORY = 5 << 20,
    THREAD_MEMORY = 512 << 10
};

static uint64_t set_aside(unsigned threads)
{
    return PROCESS_MEMORY + (uint64_t)threads * THREAD_MEMORY;
}

static uint64_t least_memory(enum run_stage stage, const struct run_size *size, unsigned threads)
{
    switch (stage) {
    case STAGE_IMPORT:
        return store_build_least_memory(threads, size->faces, size->stride);
    case STAGE_PATCHIFY:
        return chain_build_least_memory(threads, size->faces, size->stride);
    case STAGE_LOD:
        return lod_least_memory(&size->target, size->faces, threads, size->stride);
    case RUN_STAGES:
        break;
    }
    return 0;
}

const char *stage_name(enum run_stage stage)
{
    static const char *const names[] = {"import", "patchify", "lod"};
    return stage < RUN_STAGES ? names[stage] : "";
}

uint64_t stage_least_memory(enum run_stage stage, const struct run_size *size, unsigned threads)
{
    uint64_t least = least_memory(stage, size, threads);
    return least > UINT64_MAX / 2 ? least : least + set_aside(threads);
}

void budget_begin(struct context *ctx, uint64_t memory, unsigned threads)
{
    uint64_t aside = set_aside(threads);
    ctx->threads = threads;
    ctx->memory_aside = memory == UINT64_MAX ? 0 : aside;
    ctx->memory_budget = memory == UINT64_MAX ? UINT64_MAX : memory > aside ? memory - aside : 0;
}

static double mebibytes(uint64_t bytes)
{
    return (double)bytes / (1 << 20);
}

/* Rounded up to a tenth, so that what is said is enough. */
static enum status refuse(struct context *ctx, uint64_t memory, enum run_stage stage,
                          uint64_t needed)
{
    uint64_t tenths = needed / ((1 << 20) / 10) + 1;
    return fail(ctx, STATUS_NO_MEMORY,
                "a memory budget of %.1f MiB is too little: %s needs %llu.%llu MiB at least",
                mebibytes(memory), stage_name(stage), (unsigned long long)(tenths / 10),
                (unsigned long long)(tenths % 10));
}

enum status stages_fit(struct spbm_job *job, enum run_stage first, enum run_stage last,
                       const struct run_size *size)
{
    uint64_t memory = job_memory(job), most = 0;
    enum run_stage neediest = first;
    for (enum run_stage stage = first; stage <= last; stage++) {
        uint64_t needed = stage_least_memory(stage, size, 1);
        if (needed > most) {
            most = needed;
            neediest = stage;
        }
    }
    return most > memory ? refuse(&job->ctx, memory, neediest, most) : STATUS_OK;
}

unsigned fitting_threads(const struct spbm_job *job, enum run_stage stage,
                         const struct run_size *size)
{
    unsigned threads = job->settings.threads;
    while (threads > 1 && stage_least_memory(stage, size, threads) > job_memory(job))
        threads--;
    return threads;
}

enum status stage_begin(struct spbm_job *job, enum run_stage stage, const struct run_size *size)
{
    struct context *ctx = &job->ctx;
    uint64_t memory = job_memory(job);
    unsigned wanted = job->settings.threads, threads = fitting_threads(job, stage, size);
    uint64_t needed = stage_least_memory(stage, size, threads);
    if (needed > memory)
        return refuse(ctx, memory, stage, needed);
    if (threads < wanted)
        tell(ctx, MESSAGE_NOTE,
             "%s: %u of %u threads, which is what the memory budget has room for",
             stage_name(stage), threads, wanted);
    budget_begin(ctx, memory, threads);
    return STATUS_OK;
}
