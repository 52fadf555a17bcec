/*
 * The public interface: jobs and the three stages, one at a time. Options are checked and turned
 * into the stages' own by api_options.c, reports are turned back by api_reports.c; here only the
 * stages are called. All three in one run: api_simplify.c.
 */
#include <stdlib.h>

#include "api_internal.h"
#include "base/file.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "mesh/export.h"

_Static_assert((int)SPBM_OK == STATUS_OK && (int)SPBM_BAD_INPUT == STATUS_BAD_INPUT &&
                   (int)SPBM_MISUSE == STATUS_MISUSE &&
                   (int)SPBM_TARGET_MISSED == STATUS_TARGET_MISSED &&
                   (int)SPBM_NO_MEMORY == STATUS_NO_MEMORY &&
                   (int)SPBM_NO_SPACE == STATUS_NO_SPACE && (int)SPBM_IO == STATUS_IO &&
                   (int)SPBM_CANCELLED == STATUS_CANCELLED && (int)SPBM_INTERNAL == STATUS_INTERNAL,
               "status codes");
_Static_assert((int)SPBM_NOTE == MESSAGE_NOTE && (int)SPBM_WARNING == MESSAGE_WARNING, "messages");
_Static_assert((int)SPBM_COLLAPSE == MODE_COLLAPSE && (int)SPBM_CLASSIC == MODE_CLASSIC, "modes");
_Static_assert((int)SPBM_BY_FACES == TARGET_FACES && (int)SPBM_BY_RATIO == TARGET_RATIO &&
                   (int)SPBM_BY_ERROR == TARGET_ERROR,
               "targets");
_Static_assert((int)SPBM_TARGETS_MAX == TARGETS_MAX && (int)SPBM_ATTRIBUTES_MAX == ATTRIBUTE_MAX,
               "limits");
_Static_assert((int)SPBM_PLACE_DEFAULT == PLACE_DEFAULT && (int)SPBM_PLACE_SUBSET == PLACE_SUBSET &&
                   (int)SPBM_PLACE_OPTIMAL == PLACE_OPTIMAL,
               "placement");
_Static_assert((int)SPBM_FORMAT_BY_NAME == EXPORT_BY_NAME && (int)SPBM_FORMAT_PLY == EXPORT_PLY &&
                   (int)SPBM_FORMAT_PLY_ASCII == EXPORT_PLY_ASCII &&
                   (int)SPBM_FORMAT_PLY_BIG == EXPORT_PLY_BIG &&
                   (int)SPBM_FORMAT_OBJ == EXPORT_OBJ && (int)SPBM_FORMAT_STL == EXPORT_STL &&
                   (int)SPBM_FORMAT_OFF == EXPORT_OFF,
               "formats");
_Static_assert((int)SPBM_STOP_REACHED == STOP_REACHED && (int)SPBM_STOP_TOPOLOGY == STOP_TOPOLOGY &&
                   (int)SPBM_STOP_TOO_FINE == STOP_TOO_FINE && (int)SPBM_STOP_ERROR == STOP_ERROR,
               "reasons to stop");

/* ---- words ---- */

const char *spbm_status_text(spbm_status status)
{
    switch (status) {
    case SPBM_OK:
        return "done";
    case SPBM_BAD_INPUT:
        return "bad input";
    case SPBM_MISUSE:
        return "misuse";
    case SPBM_TARGET_MISSED:
        return "target not reached";
    case SPBM_NO_MEMORY:
        return "not enough memory";
    case SPBM_NO_SPACE:
        return "no space left on the disk";
    case SPBM_IO:
        return "input or output failed";
    case SPBM_CANCELLED:
        return "cancelled";
    case SPBM_INTERNAL:
        break;
    }
    return "internal error";
}

const char *spbm_stop_text(spbm_stop stop)
{
    switch (stop) {
    case SPBM_STOP_REACHED:
        return "target reached";
    case SPBM_STOP_TOPOLOGY:
        return "topology exhausted";
    case SPBM_STOP_TOO_FINE:
        return "too fine for the chain file";
    case SPBM_STOP_ERROR:
        return "error bound reached";
    }
    return "unknown";
}

const char *spbm_version(void)
{
    return SPBM_VERSION;
}

/* ---- jobs ---- */

static void forward_progress(void *user, const char *stage, uint64_t done, uint64_t total)
{
    const spbm_settings *settings = user;
    settings->progress(settings->user, stage, done, total);
}

static void forward_message(void *user, enum message_level level, const char *text)
{
    const spbm_settings *settings = user;
    settings->message(settings->user, (spbm_message_kind)level, text);
}

static bool forward_cancelled(void *user)
{
    const spbm_settings *settings = user;
    return settings->cancelled(settings->user) != 0;
}

void spbm_settings_defaults(spbm_settings *settings)
{
    *settings = (spbm_settings){.threads = 1, .cpu_cap = UINT32_MAX};
}

spbm_status spbm_job_open(const spbm_settings *settings, spbm_job **job)
{
    *job = NULL;
    if (settings && settings->threads == 0)
        return SPBM_MISUSE;
    struct spbm_job *made = calloc(1, sizeof *made);
    if (!made)
        return SPBM_NO_MEMORY;
    if (settings)
        made->settings = *settings;
    else
        spbm_settings_defaults(&made->settings);

    struct context *ctx = &made->ctx;
    context_init(ctx);
    budget_begin(ctx, job_memory(made), made->settings.threads);
    ctx->cpu_level_cap = made->settings.cpu_cap;
    ctx->tmp_dir = made->settings.tmp_dir;
    ctx->progress = made->settings.progress ? forward_progress : NULL;
    ctx->message = made->settings.message ? forward_message : NULL;
    ctx->cancelled = made->settings.cancelled ? forward_cancelled : NULL;
    ctx->user = &made->settings;
    *job = made;
    return SPBM_OK;
}

void spbm_job_close(spbm_job **job)
{
    if (!*job)
        return;
    context_clear(&(*job)->ctx);
    free(*job);
    *job = NULL;
}

const char *spbm_job_error(const spbm_job *job)
{
    return job->ctx.error;
}

uint64_t spbm_job_memory_peak(const spbm_job *job)
{
    return atomic_load(&job->ctx.memory_peak);
}

struct context *call_begin(spbm_job *job)
{
    failure_forget(&job->ctx);
    budget_begin(&job->ctx, job_memory(job), job->settings.threads);
    memory_keep_spares(&job->ctx, true);
    parallel_keep_threads(&job->ctx, true);
    return &job->ctx;
}

spbm_status call_end(spbm_job *job, enum status status)
{
    parallel_keep_threads(&job->ctx, false);
    memory_keep_spares(&job->ctx, false);
    if (status == STATUS_OK)
        job->ctx.error[0] = '\0';
    else if (!job->ctx.error[0])
        (void)fail(&job->ctx, status, "%s", spbm_status_text((spbm_status)status));
    return (spbm_status)status;
}

/* ---- the stages ---- */

enum status check_kind(struct context *ctx, const char *path, spbm_file_kind wanted)
{
    static const char *const names[] = {"a mesh file", "a mesh store", "a chain file"};
    static const char *const ways[] = {"", "import makes one of a mesh",
                                       "patchify makes one of a mesh store"};
    spbm_file_kind found = wanted;
    uint64_t size = 0;
    if (is_standard_stream(path))
        return STATUS_OK;
    enum status status = recognise_file(ctx, path, &found, &size);
    if (status != STATUS_OK || found == wanted || size == 0)
        return status;
    if (found == SPBM_FILE_MESH) /* or anything else */
        return fail(ctx, STATUS_BAD_INPUT, "%s: is not %s; %s", path, names[wanted], ways[wanted]);
    return fail(ctx, STATUS_BAD_INPUT, "%s: is %s, not %s; %s", path, names[found], names[wanted],
                ways[wanted]);
}

spbm_status spbm_import(spbm_job *job, const char *const *inputs, size_t input_count,
                        const char *store, const spbm_import_options *options,
                        spbm_store_figures *figures)
{
    struct context *ctx = call_begin(job);
    spbm_import_options defaults;
    if (!options) {
        spbm_import_defaults(&defaults);
        options = &defaults;
    }
    struct store_info info;
    enum status status = check_writable(ctx, store);
    if (status == STATUS_OK)
        status = check_inputs(ctx, inputs, input_count, store);
    if (status == STATUS_OK)
        status = stage_begin(job, STAGE_IMPORT, &(struct run_size){0});
    if (status == STATUS_OK) {
        struct import_options import = {.weld = options->weld != 0, .sync = options->sync != 0};
        status = store_build(ctx, inputs, input_count, store, &import, &info);
    }
    if (status == STATUS_OK && figures)
        copy_store(figures, &info);
    return call_end(job, status);
}

static enum status size_of_store(struct context *ctx, const char *path, struct run_size *size)
{
    struct store *store;
    enum status status = store_open(ctx, path, true, &store);
    if (status == STATUS_OK) {
        size->faces = store_info(store)->topology.faces;
        size->stride = store_info(store)->attributes.stride;
        store_close(&store);
    }
    return status;
}

spbm_status spbm_patchify(spbm_job *job, const char *store, const char *chains,
                          const spbm_target *target, const spbm_patch_options *options,
                          spbm_chain_figures *figures)
{
    struct context *ctx = call_begin(job);
    spbm_patch_options defaults;
    if (!options) {
        spbm_patch_defaults(&defaults);
        options = &defaults;
    }
    struct run_size size = {0};
    struct chain_info info;
    enum status status = check_target(ctx, target);
    if (status == STATUS_OK)
        status = check_patch_options(ctx, options);
    if (status == STATUS_OK)
        status = check_writable(ctx, chains);
    if (status == STATUS_OK)
        status = check_inputs(ctx, &store, 1, chains);
    if (status == STATUS_OK)
        status = check_kind(ctx, store, SPBM_FILE_STORE);
    if (status == STATUS_OK)
        status = size_of_store(ctx, store, &size);
    if (status == STATUS_OK)
        status = stage_begin(job, STAGE_PATCHIFY, &size);
    if (status == STATUS_OK) {
        struct target wanted = make_target(target);
        struct patch_request request = make_request(options, CHAIN_KEPT_LEVEL, options->sync != 0);
        status = chain_build(ctx, store, chains, &wanted, &request, &info);
    }
    if (status == STATUS_OK && figures)
        copy_chains(figures, &info);
    return call_end(job, status);
}

/* What lod_build does not report: the figures that words about a level need. */
enum status read_chain_info(struct context *ctx, const char *chains, struct chain_info *info)
{
    struct chain_file *file;
    enum status status = chain_file_open(ctx, chains, &file);
    if (status == STATUS_OK) {
        *info = *chain_file_info(file);
        chain_file_close(&file);
    }
    return status;
}

enum status make_levels(struct context *ctx, const char *chains, const char *output,
                        const spbm_target *target, const spbm_lod_options *options,
                        enum chains_are chains_are, struct chain_hold *hold,
                        struct lod_report *report)
{
    struct lod_options lod = {
        .target = make_target(target),
        .place = (enum placement)options->place,
        .output = output,
        .export = {.format = (enum export_format)options->format, .sync = options->sync != 0},
        .is_own_file = chains_are == CHAINS_OWN,
        .hold = hold,
        .keeps_trunk = chains_are == CHAINS_KEPT || chains_are == CHAINS_KEPT_SYNCED,
        .syncs_trunk = chains_are == CHAINS_KEPT_SYNCED,
    };
    return lod_build(ctx, chains, &lod, report);
}

spbm_status spbm_lod(spbm_job *job, const char *chains, const char *output,
                     const spbm_target *target, const spbm_lod_options *options,
                     spbm_levels *levels)
{
    struct context *ctx = call_begin(job);
    spbm_lod_options defaults;
    if (!options) {
        spbm_lod_defaults(&defaults);
        options = &defaults;
    }
    struct chain_info info;
    struct lod_report report = {0};
    enum status status = check_levels(ctx, &chains, 1, output, target, options);
    if (status == STATUS_OK)
        status = check_kind(ctx, chains, SPBM_FILE_CHAINS);
    if (status == STATUS_OK)
        status = read_chain_info(ctx, chains, &info);
    if (status == STATUS_OK) {
        const struct target wanted = make_target(target);
        struct run_size size = {.faces = info.topology.faces,
                                .stride = info.attributes.stride,
                                .target = lod_whole_target(&wanted, &info)};
        status = stage_begin(job, STAGE_LOD, &size);
    }
    if (status == STATUS_OK)
        status = make_levels(ctx, chains, output, target, options,
                             !options->cache ? CHAINS_GIVEN
                             : options->sync ? CHAINS_KEPT_SYNCED
                                             : CHAINS_KEPT,
                             NULL, &report);
    if (levels && (status == STATUS_OK || status == STATUS_TARGET_MISSED))
        copy_levels(levels, &report, &info);
    return call_end(job, status);
}

spbm_status spbm_export(spbm_job *job, const char *store, const char *output, spbm_format format)
{
    struct context *ctx = call_begin(job);
    struct store *opened = NULL;
    enum status status = check_writable(ctx, output);
    if (status == STATUS_OK)
        status = check_format(ctx, output, format);
    if (status == STATUS_OK)
        status = check_inputs(ctx, &store, 1, output);
    if (status == STATUS_OK)
        status = check_kind(ctx, store, SPBM_FILE_STORE);
    if (status == STATUS_OK)
        status = store_open(ctx, store, true, &opened);
    if (status == STATUS_OK) {
        struct export_options options = {.format = (enum export_format)format,
                                         .as_float32 = store_info(opened)->is_float32,
                                         .sync = true};
        status = store_export(opened, output, &options);
        store_close(&opened);
    }
    return call_end(job, status);
}
