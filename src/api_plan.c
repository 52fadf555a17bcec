/*
 * What a run will take, from its inputs' beginnings and constants that were measured.
 *
 * A trial on a part of the mesh would tell more, but needs the part to be read and cleaned; here
 * nothing is read but headers. The constants are those of a generated scan of 4 million faces on
 * one core of 2022 (doc/memory.md has the runs), so times are right to a factor of two or so on
 * other machines and meshes; space and memory are nearer, for they follow from the formats.
 */
#include <math.h>
#include <string.h>
#include <sys/statvfs.h>

#include "api_internal.h"

/* Microseconds of one core a face. */
static const double IMPORT_BINARY = 0.18, IMPORT_TEXT = 0.30, IMPORT_SOUP = 0.38, INFLATE = 0.06;
static const double PATCHIFY = 0.17, PATCHIFY_SMALL = 0.15, CLASSIC = 2.6, OUTPUT = 0.1;
/* A face of the small mesh that the chains give, mode collapse, by effort. */
static const double COLLAPSE[3] = {2.3, 2.1, 2.4};
/* Faces of that mesh: for each of the finest level, and of all, by effort. */
static const double SMALL_OF_LEVEL[3] = {13, 25, 55}, SMALL_OF_ALL = 0.03;
/* Part of a stage that threads share. */
static const double SHARED_PATCHIFY = 0.95, SHARED_LOD = 0.8;

enum {
    STORE_VERTEX = 64,   /* bytes: 12 + 4, and 25 for each of about two faces less what packs */
    CHAIN_FACE = 5,      /* bytes of the chain file a face of the store */
    CHAIN_SMALL = 16,    /* and a face of the small mesh */
    SPOOLED_FACE = 28,   /* temporary bytes of the import while the store is made */
    SPOOLED_CORNER = 2,  /* more for each corner of a soup, if it is not in random order */
    HELD_FACE = 34,      /* bytes of memory a face with which the import sorts nothing on disk */
    HELD_CORNER = 1,     /* more for each corner of a soup */
    OUTPUT_FACE = 19     /* of a binary PLY: 13, and 12 for each of half as many vertices */
};

struct guess {
    const struct mesh_estimate *inputs;
    double faces, vertices; /* of the store */
    double finest;          /* faces of the finest level; 0: by error */
    double small;           /* faces of the mesh that the chains give */
    unsigned effort;        /* from 0 */
};

static struct guess make_guess(const struct run_size *size, const struct mesh_estimate *inputs)
{
    const struct target *target = &size->target;
    struct guess guess = {
        .inputs = inputs, .faces = (double)inputs->faces, .effort = target->effort - 1};
    guess.vertices = inputs->is_soup ? guess.faces / 2 : (double)inputs->vertices;
    for (uint32_t i = 0; i < target->count; i++) {
        double wanted = target->kind == TARGET_FACES   ? target->values[i]
                        : target->kind == TARGET_RATIO ? target->values[i] * guess.faces
                                                       : guess.faces / 20;
        guess.finest = fmax(guess.finest, fmin(wanted, guess.faces));
    }
    guess.small =
        fmin(guess.faces, SMALL_OF_LEVEL[guess.effort] * guess.finest + SMALL_OF_ALL * guess.faces);
    return guess;
}

static double with_threads(double seconds, double shared, unsigned threads)
{
    return seconds * (1 - shared + shared / (threads ? threads : 1));
}

static void plan_times(const struct guess *guess, const struct run_size *size, spbm_plan *plan)
{
    double face = guess->inputs->is_soup   ? IMPORT_SOUP
                  : guess->inputs->is_text ? IMPORT_TEXT
                                           : IMPORT_BINARY;
    if (guess->inputs->is_gzip)
        face += INFLATE;
    plan->stages[STAGE_IMPORT].wall_seconds = 1e-6 * face * guess->faces;
    double patchify = 1e-6 * (PATCHIFY * guess->faces + PATCHIFY_SMALL * guess->small);
    plan->stages[STAGE_PATCHIFY].wall_seconds =
        with_threads(patchify, SHARED_PATCHIFY, plan->stages[STAGE_PATCHIFY].threads);
    if (size->target.mode == MODE_CLASSIC)
        plan->stages[STAGE_LOD].wall_seconds = 1e-6 * CLASSIC * guess->faces;
    else
        plan->stages[STAGE_LOD].wall_seconds =
            with_threads(1e-6 * COLLAPSE[guess->effort] * guess->small, SHARED_LOD,
                         plan->stages[STAGE_LOD].threads);
    plan->stages[STAGE_LOD].wall_seconds += 1e-6 * OUTPUT * guess->finest;
    for (unsigned i = 0; i < RUN_STAGES; i++)
        plan->seconds += plan->stages[i].wall_seconds;
}

static void plan_space(const struct guess *guess, const struct run_size *size, uint64_t memory,
                       spbm_plan *plan)
{
    double store = guess->vertices * (STORE_VERTEX + size->stride);
    double chains = CHAIN_FACE * guess->faces + CHAIN_SMALL * guess->small;
    double corners = guess->inputs->is_soup ? 3 * guess->faces : 0;
    double held = HELD_FACE * guess->faces + HELD_CORNER * corners;
    double spooled =
        held > 0.8 * (double)memory ? SPOOLED_FACE * guess->faces + SPOOLED_CORNER * corners : 0;
    plan->temporary_bytes = (uint64_t)(store + fmax(chains, spooled));
    plan->output_bytes = 0;
    for (uint32_t i = 0; i < size->target.count; i++) {
        double value = size->target.values[i];
        double faces = size->target.kind == TARGET_FACES   ? fmin(value, guess->faces)
                       : size->target.kind == TARGET_RATIO ? value * guess->faces
                                                           : guess->finest;
        plan->output_bytes += (uint64_t)(OUTPUT_FACE * faces);
    }
}

static void plan_memory(const struct spbm_job *job, const struct guess *guess,
                        const struct run_size *size, spbm_plan *plan)
{
    double corners = guess->inputs->is_soup ? 3 * guess->faces : 0;
    double most = HELD_FACE * guess->faces + HELD_CORNER * corners;
    for (enum run_stage stage = STAGE_IMPORT; stage < RUN_STAGES; stage++) {
        unsigned threads = fitting_threads(job, stage, size);
        uint64_t least = stage_least_memory(stage, size, 1);
        double wanted = (double)stage_least_memory(stage, size, threads);
        plan->stages[stage].threads = threads;
        plan->stages[stage].name = stage_name(stage);
        plan->memory_least = least > plan->memory_least ? least : plan->memory_least;
        most = fmax(most, wanted);
    }
    double budget = (double)job_memory(job);
    plan->memory_peak = (uint64_t)fmin(most, budget);
}

static void find_free_space(const char *folder, spbm_plan *plan)
{
    struct statvfs info;
    if (statvfs(folder, &info) == 0)
        plan->free_bytes = (uint64_t)info.f_bavail * info.f_frsize;
}

spbm_status spbm_simplify_plan(spbm_job *job, const char *const *inputs, size_t input_count,
                               const char *output, const spbm_simplify_options *options,
                               spbm_plan *plan)
{
    struct context *ctx = call_begin(job);
    struct run_size size = {0};
    struct mesh_estimate sum;
    char folder[PATH_MAX];
    memset(plan, 0, sizeof *plan);
    enum status status = STATUS_OK;
    for (size_t i = 0; i < input_count && status == STATUS_OK; i++)
        if (is_standard_stream(inputs[i]))
            status = fail(ctx, STATUS_MISUSE, "standard input can't be looked at beforehand");
    if (status == STATUS_OK)
        status = check_simplify(job, inputs, input_count, output, options, &size, &sum);
    if (status == STATUS_OK && sum.faces == 0)
        status = fail(ctx, STATUS_BAD_INPUT, "%s: nothing can be foretold from its beginning",
                      inputs[0]);
    if (status == STATUS_OK) {
        struct guess guess = make_guess(&size, &sum);
        plan->faces = sum.faces;
        plan->vertices = (uint64_t)guess.vertices;
        plan->is_counted = sum.is_counted;
        plan_memory(job, &guess, &size, plan);
        plan_times(&guess, &size, plan);
        plan_space(&guess, &size, job_memory(job), plan);
        folder_of(output, folder);
        find_free_space(job->ctx.tmp_dir ? job->ctx.tmp_dir : folder, plan);
    }
    return call_end(job, status);
}
