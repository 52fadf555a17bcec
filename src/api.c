/*
 * The public interface: jobs, the three stages, and all three in one run. Options are checked and
 * turned into the stages' own by api_options.c, reports are turned back by api_reports.c; here only
 * the stages are called.
 *
 * A whole run keeps store and chain file in files without a name, which the stages reach through
 * /proc/self/fd: whatever ends the process, even a SIGKILL, nothing stays behind.
 */
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "api_internal.h"
#include "base/file.h"
#include "mesh/export.h"

/* Compression of chain files that are kept: level 6 takes three times as long and makes them 4 %
 * smaller. Those of one run are not compressed. */
enum { KEPT_LEVEL = 1 };

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
    ctx->memory_budget = made->settings.memory ? made->settings.memory : UINT64_MAX;
    ctx->threads = made->settings.threads;
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
    job->ctx.failed = STATUS_OK;
    job->ctx.error[0] = '\0';
    return &job->ctx;
}

spbm_status call_end(spbm_job *job, enum status status)
{
    if (status == STATUS_OK)
        job->ctx.error[0] = '\0';
    else if (!job->ctx.error[0])
        (void)fail(&job->ctx, status, "%s", spbm_status_text((spbm_status)status));
    return (spbm_status)status;
}

/* ---- the stages ---- */

/* A stage that is given another stage's file says which one that is, and what makes the right one.
 */
static enum status check_kind(struct context *ctx, const char *path, spbm_file_kind wanted)
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
    if (status == STATUS_OK) {
        struct import_options import = {.weld = options->weld != 0, .sync = options->sync != 0};
        status = store_build(ctx, inputs, input_count, store, &import, &info);
    }
    if (status == STATUS_OK && figures)
        copy_store(figures, &info);
    return call_end(job, status);
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
    if (status == STATUS_OK) {
        struct target wanted = make_target(target);
        struct patch_request request = make_request(options, KEPT_LEVEL, options->sync != 0);
        status = chain_build(ctx, store, chains, &wanted, &request, &info);
    }
    if (status == STATUS_OK && figures)
        copy_chains(figures, &info);
    return call_end(job, status);
}

/* What lod_build does not report: the figures that words about a level need. */
static enum status read_chain_info(struct context *ctx, const char *chains, struct chain_info *info)
{
    struct chain_file *file;
    enum status status = chain_file_open(ctx, chains, &file);
    if (status == STATUS_OK) {
        *info = *chain_file_info(file);
        chain_file_close(&file);
    }
    return status;
}

static enum status make_levels(struct context *ctx, const char *chains, const char *output,
                               const spbm_target *target, const spbm_lod_options *options,
                               struct lod_report *report)
{
    struct lod_options lod = {
        .target = make_target(target),
        .place = (enum placement)options->place,
        .output = output,
        .export = {.format = (enum export_format)options->format, .sync = options->sync != 0},
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
    if (status == STATUS_OK)
        status = make_levels(ctx, chains, output, target, options, &report);
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

/* ---- all three ---- */

static enum status workspace_keep(struct workspace *work, const char *keep_dir)
{
    struct context *ctx = work->ctx;
    struct stat info;
    if (mkdir(keep_dir, 0777) != 0 && errno != EEXIST)
        return fail_errno(ctx, errno, "%s: cannot create the directory", keep_dir);
    if (stat(keep_dir, &info) == 0 && !S_ISDIR(info.st_mode))
        return fail(ctx, STATUS_IO, "%s: is not a directory", keep_dir);
    int store = snprintf(work->store, sizeof work->store, "%s/mesh.store", keep_dir);
    int chains = snprintf(work->chains, sizeof work->chains, "%s/mesh.chains", keep_dir);
    if (store >= (int)sizeof work->store || chains >= (int)sizeof work->chains)
        return fail(ctx, STATUS_MISUSE, "%s: the name is too long", keep_dir);
    enum status status = check_writable(ctx, work->store);
    return status == STATUS_OK ? check_writable(ctx, work->chains) : status;
}

void workspace_init(struct workspace *work, struct context *ctx)
{
    *work = (struct workspace){.ctx = ctx,
                               .tmp_dir = ctx->tmp_dir,
                               .store_fd = -1,
                               .chains_fd = -1,
                               .raw_fd = -1,
                               .scratch_fd = -1};
}

/* The stages see no output for temporary files to lie beside, so they are told the place. */
static void choose_folder(struct workspace *work, const char *output)
{
    struct context *ctx = work->ctx;
    struct stat info;
    if (!ctx->tmp_dir && !is_standard_stream(output) &&
        (stat(output, &info) != 0 || S_ISREG(info.st_mode))) {
        folder_of(output, work->folder);
        ctx->tmp_dir = work->folder;
    }
}

/* A file without a name, and the path (PATH_MAX bytes) by which the stages reach it. */
static enum status hide_file(struct context *ctx, int *fd, char *path)
{
    enum status status = temp_open(ctx, NULL, fd);
    if (status != STATUS_OK)
        return status;
    snprintf(path, PATH_MAX, "/proc/self/fd/%d", *fd);
    if (access(path, R_OK | W_OK) != 0)
        return fail_errno(ctx, errno, "%s: cannot be opened (is /proc mounted?)", path);
    return STATUS_OK;
}

enum status workspace_hide(struct workspace *work, const char *output)
{
    choose_folder(work, output);
    enum status status = hide_file(work->ctx, &work->store_fd, work->store);
    return status == STATUS_OK ? hide_file(work->ctx, &work->chains_fd, work->chains) : status;
}

enum status workspace_hide_raw(struct workspace *work, const char *output)
{
    choose_folder(work, output);
    enum status status = hide_file(work->ctx, &work->raw_fd, work->raw);
    return status == STATUS_OK ? hide_file(work->ctx, &work->scratch_fd, work->scratch) : status;
}

/* The files of a workspace that may have no name. */
struct hidden_file {
    int fd;
    const char *path, *words;
};

static void list_hidden(const struct workspace *work, struct hidden_file files[4])
{
    files[0] = (struct hidden_file){work->store_fd, work->store, "mesh store"};
    files[1] = (struct hidden_file){work->chains_fd, work->chains, "chain file"};
    files[2] = (struct hidden_file){work->raw_fd, work->raw, "mesh store"};
    files[3] = (struct hidden_file){work->scratch_fd, work->scratch, "chain file"};
}

void workspace_explain(struct workspace *work)
{
    struct context *ctx = work->ctx;
    struct hidden_file files[4];
    list_hidden(work, files);
    for (unsigned i = 0; i < 4; i++) {
        const char *path = files[i].path;
        char text[sizeof ctx->error + PATH_MAX + 64], *at = strstr(ctx->error, path);
        if (files[i].fd < 0 || !at)
            continue;
        *at = '\0';
        snprintf(text, sizeof text, "%sthe temporary %s in %s%s", ctx->error, files[i].words,
                 ctx->tmp_dir ? ctx->tmp_dir : "/var/tmp", at + strlen(path));
        text[sizeof ctx->error - 1] = '\0';
        memcpy(ctx->error, text, sizeof ctx->error);
    }
}

static void close_hidden(int *fd)
{
    if (*fd >= 0)
        close(*fd);
    *fd = -1;
}

void workspace_close(struct workspace *work)
{
    close_hidden(&work->store_fd);
    close_hidden(&work->chains_fd);
    close_hidden(&work->raw_fd);
    close_hidden(&work->scratch_fd);
    work->ctx->tmp_dir = work->tmp_dir;
}

struct clock {
    double wall, cpu;
};

static struct clock clock_now(void)
{
    struct timespec wall, cpu;
    clock_gettime(CLOCK_MONOTONIC, &wall);
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &cpu);
    return (struct clock){(double)wall.tv_sec + 1e-9 * (double)wall.tv_nsec,
                          (double)cpu.tv_sec + 1e-9 * (double)cpu.tv_nsec};
}

static void stage_end(struct context *ctx, spbm_simplify_report *report, const char *name,
                      struct clock *begin)
{
    struct clock now = clock_now();
    report->stages[report->stage_count++] = (spbm_stage){
        .name = name,
        .wall_seconds = now.wall - begin->wall,
        .cpu_seconds = now.cpu - begin->cpu,
        .memory_peak = atomic_load(&ctx->memory_peak),
    };
    *begin = now;
}

/* The store that patches are grown on: of the input, or of what small features leave of it. */
static enum status run_import(struct workspace *work, const char *const *inputs, size_t input_count,
                              const spbm_simplify_options *options, spbm_simplify_report *report,
                              struct clock *begin)
{
    struct context *ctx = work->ctx;
    const spbm_topology_options *topology = options->topology;
    bool is_kept = options->keep_dir != NULL;
    struct store_info store;
    struct import_options import = {.weld = options->import.weld != 0,
                                    .sync = is_kept && !topology && options->import.sync};
    enum status status =
        store_build(ctx, inputs, input_count, topology ? work->raw : work->store, &import, &store);
    if (status != STATUS_OK)
        return status;
    stage_end(ctx, report, "import", begin);
    copy_store(&report->store, &store);
    if (!topology)
        return STATUS_OK;

    struct topology_report removal = {0};
    struct topology_options wanted = make_topology(topology);
    struct import_options rebuild = {.sync = is_kept && options->import.sync};
    status = topology_rebuild(ctx, work->raw, work->scratch, work->store, &rebuild, &wanted,
                              &removal, NULL);
    if (status == STATUS_OK) {
        stage_end(ctx, report, "topology", begin);
        report->has_topology = 1;
        copy_removal(&report->removal, topology, &removal);
        close_hidden(&work->raw_fd); /* its space is free for what follows */
        close_hidden(&work->scratch_fd);
    }
    topology_report_clear(ctx, &removal);
    return status;
}

static enum status run_stages(struct workspace *work, const char *const *inputs, size_t input_count,
                              const char *output, const spbm_simplify_options *options,
                              spbm_simplify_report *report)
{
    struct context *ctx = work->ctx;
    struct clock begin = clock_now();
    bool is_kept = options->keep_dir != NULL;
    enum status status = run_import(work, inputs, input_count, options, report, &begin);
    if (status != STATUS_OK)
        return status;

    struct chain_info chains;
    struct target target = make_target(&options->target);
    struct patch_request request =
        make_request(&options->patch, is_kept ? KEPT_LEVEL : 0, is_kept && options->patch.sync);
    status = chain_build(ctx, work->store, work->chains, &target, &request, &chains);
    if (status != STATUS_OK)
        return status;
    stage_end(ctx, report, "patchify", &begin);
    copy_chains(&report->chains, &chains);
    if (!is_kept && ftruncate(work->store_fd, 0) != 0) /* its space is free for what follows */
        return fail_errno(ctx, errno, "%s: cannot be emptied", work->store);

    struct lod_report levels = {0};
    status = make_levels(ctx, work->chains, output, &options->target, &options->lod, &levels);
    if (status == STATUS_OK || status == STATUS_TARGET_MISSED) {
        stage_end(ctx, report, "lod", &begin);
        copy_levels(&report->levels, &levels, &chains);
    }
    return status;
}

spbm_status spbm_simplify(spbm_job *job, const char *const *inputs, size_t input_count,
                          const char *output, const spbm_simplify_options *options,
                          spbm_simplify_report *report)
{
    struct context *ctx = call_begin(job);
    struct workspace work;
    spbm_simplify_report unwanted;
    workspace_init(&work, ctx);
    report = report ? report : &unwanted;
    memset(report, 0, sizeof *report);

    enum status status =
        check_levels(ctx, inputs, input_count, output, &options->target, &options->lod);
    if (status == STATUS_OK)
        status = check_patch_options(ctx, &options->patch);
    if (status == STATUS_OK && options->topology)
        status = check_topology(ctx, options->topology);
    if (status == STATUS_OK && options->keep_dir)
        status = workspace_keep(&work, options->keep_dir);
    if (status == STATUS_OK && options->keep_dir)
        status = check_inputs(ctx, inputs, input_count, work.store);
    if (status == STATUS_OK && options->keep_dir)
        status = check_inputs(ctx, inputs, input_count, work.chains);
    if (status == STATUS_OK && !options->keep_dir)
        status = workspace_hide(&work, output);
    if (status == STATUS_OK && options->topology)
        status = workspace_hide_raw(&work, output);
    if (status == STATUS_OK)
        status = run_stages(&work, inputs, input_count, output, options, report);
    workspace_explain(&work);
    workspace_close(&work);
    return call_end(job, status);
}
