/*
 * The public interface to a whole run: import, topology if it is asked for, patchify and lod, with
 * the files between them in a workspace (api_workspace.c) or, if the run is to be resumable, in a
 * locked folder (api_resume.c), where a file that is there is a stage that is done. Topology is
 * done again whenever a run is resumed, for what it removed is to be told.
 *
 * Levels of a chain file with other topology are such a run, too: what is imported is then the
 * mesh that the chains give (chain_unfold.h), and there is one way to remove a feature, not two.
 */
#include <errno.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#include "api_resume.h"
#include "base/file.h"
#include "mesh/store_hold.h"
#include "simplify/chain_unfold.h"

static const char RAW_NAME[] = "raw.store", STORE_NAME[] = "mesh.store";
static const char CHAINS_NAME[] = "mesh.chains";

/* ---- the three stages ---- */

struct run {
    struct spbm_job *job;
    struct context *ctx;
    const char *const *inputs;
    size_t input_count;
    const char *output;
    const spbm_simplify_options *options;
    spbm_simplify_report *report;
    struct workspace work;
    struct run_folder folder;
    struct run_size size;
    struct clock began;
    struct chain_info chains;
    struct store_hold slabs; /* of the store */
    struct chain_hold hold;  /* of the chains' blocks */
    bool is_unfolding;       /* the input is a chain file */
};

static bool is_resumable(const struct run *run)
{
    return run->folder.fd >= 0;
}

static void stage_end(struct run *run, const char *name, bool resumed)
{
    spbm_simplify_report *report = run->report;
    spbm_stage *stage = &report->stages[report->stage_count++];
    *stage = stage_since(run->ctx, name, &run->began);
    stage->resumed = resumed;
}

static void take_store(struct run *run, const struct store_info *info)
{
    run->size.faces = info->topology.faces;
    run->size.stride = info->attributes.stride;
    copy_store(&run->report->store, info);
}

/* What the import writes. */
static const char *imported_name(const struct run *run)
{
    return run->options->topology ? RAW_NAME : STORE_NAME;
}

static char *imported_path(struct run *run)
{
    return run->options->topology ? run->work.raw : run->work.store;
}

/* What a dead run left of a stage is used if it opens as what it should be; else the stage is done
 * again. */
static bool resume_store(struct run *run)
{
    struct store *store;
    if (!is_resumable(run) ||
        !run_folder_file(&run->folder, imported_name(run), imported_path(run)))
        return false;
    if (store_open(run->ctx, imported_path(run), true, &store) != STATUS_OK) {
        failure_forget(run->ctx);
        return false;
    }
    take_store(run, store_info(store));
    store_close(&store);
    return true;
}

/*
 * What slabs on their way to patchify may take in memory, and again blocks on theirs to lod: a part
 * of what the budget has beyond what the stages need, the seams taking up to half of it. Besides,
 * neither makes a run take more than hold_most_in_use.
 */
static uint64_t spare_memory(const struct run *run)
{
    const uint64_t memory = job_memory(run->job);
    uint64_t needed = 0;
    for (enum run_stage stage = STAGE_IMPORT; stage <= STAGE_LOD; stage++) {
        const unsigned threads = fitting_threads(run->job, stage, &run->size);
        const uint64_t least = stage_least_memory(stage, &run->size, threads);
        needed = least > needed ? least : needed;
    }
    if (memory == UINT64_MAX)
        return UINT64_MAX;
    return memory > needed ? (memory - needed) / 4 : 0;
}

/* Slabs of the store that is made now stay in memory for patchify, if nobody else gets it. */
static void hold_slabs(struct run *run, struct import_options *import)
{
    if (run->work.store_fd < 0)
        return;
    const unsigned threads = fitting_threads(run->job, STAGE_PATCHIFY, &run->size);
    run->slabs.most_bytes = spare_memory(run);
    run->slabs.beside = chain_build_memory_beside(threads, run->size.faces);
    import->hold = &run->slabs;
}

static enum status build_store(struct run *run)
{
    struct store_info info;
    const spbm_simplify_options *options = run->options;
    bool keeps = options->keep_dir != NULL && !options->topology;
    struct import_options import = {.weld = options->import.weld != 0,
                                    .sync = is_resumable(run) || (keeps && options->import.sync)};
    if (!options->topology)
        hold_slabs(run, &import);
    enum status status = stage_begin(run->job, STAGE_IMPORT, &run->size);
    if (status == STATUS_OK)
        status = store_build(run->ctx, run->inputs, run->input_count, imported_path(run), &import,
                             &info);
    if (status == STATUS_OK && is_resumable(run)) {
        status = run_folder_verify(&run->folder);
        if (status != STATUS_OK)
            run_folder_drop(&run->folder, imported_name(run));
    }
    if (status == STATUS_OK)
        take_store(run, &info);
    return status;
}

/* A chain file's finest mesh in place of what the import makes. */
static enum status unfold_stage(struct run *run)
{
    struct store_info info;
    const struct import_options import = {.sync = false};
    enum status status = stage_begin(run->job, STAGE_IMPORT, &run->size);
    if (status == STATUS_OK)
        status = chain_unfold(run->ctx, run->inputs[0], run->work.raw, &import, &info);
    if (status == STATUS_OK) {
        take_store(run, &info);
        stage_end(run, "unfold", false);
    }
    return status;
}

static enum status import_stage(struct run *run)
{
    bool resumed = resume_store(run);
    enum status status = resumed ? STATUS_OK : build_store(run);
    if (status == STATUS_OK)
        stage_end(run, stage_name(STAGE_IMPORT), resumed);
    return status;
}

/* The store that patches are grown on is what small features leave of the input's. */
static enum status topology_stage(struct run *run)
{
    const spbm_simplify_options *options = run->options;
    struct workspace *work = &run->work;
    struct topology_report removal = {0};
    struct topology_options wanted = make_topology(options->topology);
    struct import_options rebuild = {.sync = is_resumable(run) ||
                                             (options->keep_dir && options->import.sync)};
    hold_slabs(run, &rebuild);
    budget_begin(run->ctx, job_memory(run->job), run->job->settings.threads);
    enum status status = topology_rebuild(run->ctx, work->raw, work->scratch, work->store, &rebuild,
                                          &wanted, &removal, NULL);
    if (status == STATUS_OK) {
        stage_end(run, "topology", false);
        run->report->has_topology = 1;
        copy_removal(&run->report->removal, options->topology, &removal);
        close_hidden(&work->raw_fd); /* its space is free for what follows */
        close_hidden(&work->scratch_fd);
    }
    topology_report_clear(run->ctx, &removal);
    return status;
}

static bool resume_chains(struct run *run)
{
    struct store *store = NULL;
    uint32_t crc = 0;
    if (!is_resumable(run) || !run_folder_file(&run->folder, CHAINS_NAME, run->work.chains))
        return false;
    enum status status = read_chain_info(run->ctx, run->work.chains, &run->chains);
    if (status == STATUS_OK)
        status = store_open(run->ctx, run->work.store, true, &store);
    if (status == STATUS_OK)
        status = store_crc(store, &crc);
    store_close(&store);
    if (status != STATUS_OK)
        failure_forget(run->ctx);
    return status == STATUS_OK && crc == run->chains.store_crc;
}

static enum status patchify_stage(struct run *run)
{
    const spbm_simplify_options *options = run->options;
    bool keeps = options->keep_dir != NULL, resumed = resume_chains(run);
    struct patch_request request =
        make_request(&options->patch, keeps ? CHAIN_KEPT_LEVEL : 0,
                     is_resumable(run) || (keeps && options->patch.sync));
    request.is_own_store = run->work.store_fd >= 0;
    request.slabs = request.is_own_store ? &run->slabs : NULL;
    if (run->work.chains_fd >= 0) {
        run->hold.most_bytes = spare_memory(run);
        run->hold.most_in_use = hold_most_in_use(run->ctx, run->report->store.topology.vertices);
        request.hold = &run->hold;
    }
    enum status status = STATUS_OK;
    if (!resumed) {
        status = stage_begin(run->job, STAGE_PATCHIFY, &run->size);
        if (status == STATUS_OK)
            status = chain_build(run->ctx, run->work.store, run->work.chains, &run->size.target,
                                 &request, &run->chains);
    }
    store_hold_clear(&run->slabs);
    if (status != STATUS_OK)
        return status;
    stage_end(run, stage_name(STAGE_PATCHIFY), resumed);
    copy_chains(&run->report->chains, &run->chains);
    if (run->work.store_fd >= 0 && ftruncate(run->work.store_fd, 0) != 0)
        return fail_errno(run->ctx, errno, "%s: cannot be emptied", run->work.store);
    return STATUS_OK; /* a hidden store's space is free for what follows */
}

static enum status lod_stage(struct run *run)
{
    struct lod_report levels = {0};
    const spbm_simplify_options *options = run->options;
    const enum chains_are chains_are = run->work.chains_fd >= 0 ? CHAINS_OWN
                                       : !options->keep_dir     ? CHAINS_GIVEN
                                       : options->patch.sync    ? CHAINS_KEPT_SYNCED
                                                                : CHAINS_KEPT;
    enum status status = stage_begin(run->job, STAGE_LOD, &run->size);
    if (status == STATUS_OK)
        status =
            make_levels(run->ctx, run->work.chains, run->output, &options->target, &options->lod,
                        chains_are, chains_are == CHAINS_OWN ? &run->hold : NULL, &levels);
    if (status == STATUS_OK || status == STATUS_TARGET_MISSED) {
        stage_end(run, stage_name(STAGE_LOD), false);
        copy_levels(&run->report->levels, &levels, &run->chains);
    }
    return status;
}

static enum status run_stages(struct run *run)
{
    run->began = clock_now();
    enum status status = run->is_unfolding ? unfold_stage(run) : import_stage(run);
    if (status == STATUS_OK && run->options->topology)
        status = topology_stage(run);
    if (status == STATUS_OK)
        status = patchify_stage(run);
    return status == STATUS_OK ? lod_stage(run) : status;
}

/* Damage in what was resumed shows when it is used: then all is done again. */
static enum status run_again_if_damaged(struct run *run)
{
    enum status status = run_stages(run);
    if (status != STATUS_BAD_INPUT || run->report->stage_count == 0 ||
        !run->report->stages[0].resumed)
        return status;
    failure_forget(run->ctx);
    tell(run->ctx, MESSAGE_WARNING, "%s: what was to be resumed is damaged; all is done again",
         run->folder.path);
    run_folder_drop(&run->folder, imported_name(run));
    run_folder_drop(&run->folder, STORE_NAME);
    run_folder_drop(&run->folder, CHAINS_NAME);
    memset(run->report, 0, sizeof *run->report);
    return run_stages(run);
}

/* ---- the run ---- */

/* What the inputs claim of their size, so that too little memory is told before they are read. */
static enum status estimate_size(struct spbm_job *job, const char *const *inputs, size_t count,
                                 struct run_size *size, struct mesh_estimate *sum)
{
    *sum = (struct mesh_estimate){.is_counted = true};
    for (size_t i = 0; i < count; i++) {
        struct mesh_estimate one;
        enum status status = mesh_estimate(&job->ctx, inputs[i], &one);
        if (status != STATUS_OK)
            return status;
        sum->file_size += one.file_size;
        sum->faces += one.faces;
        sum->vertices += one.vertices;
        sum->stride = one.stride > sum->stride ? one.stride : sum->stride;
        sum->is_text |= one.is_text;
        sum->is_gzip |= one.is_gzip;
        sum->is_soup |= one.is_soup;
        sum->is_counted &= one.is_counted;
    }
    size->faces = sum->faces;
    size->stride = sum->stride;
    return stages_fit(job, STAGE_IMPORT, STAGE_LOD, size);
}

enum status check_simplify(struct spbm_job *job, const char *const *inputs, size_t input_count,
                           const char *output, const spbm_simplify_options *options,
                           struct run_size *size, struct mesh_estimate *sum)
{
    struct context *ctx = &job->ctx;
    enum status status =
        check_levels(ctx, inputs, input_count, output, &options->target, &options->lod);
    if (status == STATUS_OK)
        status = check_patch_options(ctx, &options->patch);
    if (status == STATUS_OK && options->topology)
        status = check_topology(ctx, options->topology);
    if (status == STATUS_OK && options->keep_dir && options->resume_dir)
        status = fail(ctx, STATUS_MISUSE, "a run keeps its files or can be resumed, but not both");
    if (status != STATUS_OK)
        return status;
    size->target = make_target(&options->target);
    return estimate_size(job, inputs, input_count, size, sum);
}

static enum status open_folder(struct run *run)
{
    struct workspace *work = &run->work;
    enum status status = run_folder_open(run->ctx, run->options->resume_dir, run->inputs,
                                         run->input_count, run->output, run->options, &run->folder);
    if (status == STATUS_OK) {
        (void)run_folder_file(&run->folder, STORE_NAME, work->store);
        (void)run_folder_file(&run->folder, CHAINS_NAME, work->chains);
    }
    if (status == STATUS_OK && run->options->topology) {
        status = workspace_hide_raw(work, run->output); /* for the scratch; the store is named: */
        close_hidden(&work->raw_fd);
        (void)run_folder_file(&run->folder, RAW_NAME, work->raw);
    }
    return status;
}

static enum status open_places(struct run *run)
{
    struct workspace *work = &run->work;
    const spbm_simplify_options *options = run->options;
    if (options->resume_dir)
        return open_folder(run);
    enum status status = STATUS_OK;
    if (options->keep_dir) {
        status = workspace_keep(work, options->keep_dir);
        if (status == STATUS_OK)
            status = check_inputs(run->ctx, run->inputs, run->input_count, work->store);
        if (status == STATUS_OK)
            status = check_inputs(run->ctx, run->inputs, run->input_count, work->chains);
    } else {
        status = workspace_hide(work, run->output);
    }
    if (status == STATUS_OK && options->topology)
        status = workspace_hide_raw(work, run->output);
    return status;
}

/* What the same command can go on from is kept when the run ended for a reason that may pass. */
static void close_places(struct run *run, enum status status)
{
    bool may_pass = status == STATUS_NO_MEMORY || status == STATUS_NO_SPACE ||
                    status == STATUS_IO || status == STATUS_CANCELLED;
    bool keeps = is_resumable(run) && may_pass && run->report->stage_count > 0;
    if (keeps)
        tell(run->ctx, MESSAGE_NOTE, "%s: finished stages are kept for the same command to go on",
             run->folder.path);
    store_hold_clear(&run->slabs);
    chain_hold_clear(&run->hold);
    run_folder_close(&run->folder, keeps);
    workspace_explain(&run->work);
    workspace_close(&run->work);
}

spbm_status spbm_simplify(spbm_job *job, const char *const *inputs, size_t input_count,
                          const char *output, const spbm_simplify_options *options,
                          spbm_simplify_report *report)
{
    struct context *ctx = call_begin(job);
    spbm_simplify_report unwanted;
    struct run run = {.job = job,
                      .ctx = ctx,
                      .inputs = inputs,
                      .input_count = input_count,
                      .output = output,
                      .options = options,
                      .report = report ? report : &unwanted,
                      .folder = {.fd = -1}};
    memset(run.report, 0, sizeof *run.report);
    workspace_init(&run.work, ctx);

    struct mesh_estimate sum;
    enum status status = check_simplify(job, inputs, input_count, output, options, &run.size, &sum);
    if (status == STATUS_OK)
        status = open_places(&run);
    if (status == STATUS_OK)
        status = run_again_if_damaged(&run);
    close_places(&run, status);
    return call_end(job, status);
}

/* ---- from a chain file on ---- */

/* Ratios are of the faces of the chain file's store, not of the mesh that its chains give. */
static void count_targets(spbm_target *target, uint64_t faces)
{
    for (uint32_t i = 0; target->kind == SPBM_BY_RATIO && i < target->count; i++) {
        double wanted = floor(target->values[i] * (double)faces);
        target->values[i] = wanted < 1 ? 1 : wanted;
    }
    target->kind = target->kind == SPBM_BY_RATIO ? SPBM_BY_FACES : target->kind;
}

/* All that the chains tell of the surface is to be told again: patches are as good as plane. */
static const spbm_patch_options plane_patches = {
    .patch_angle = {1, 1}, .face_angle = {1, 1}, .chain_tolerance = -1};

static enum status check_chains(struct run *run, spbm_simplify_options *options)
{
    struct context *ctx = run->ctx;
    enum status status =
        check_levels(ctx, run->inputs, 1, run->output, &options->target, &options->lod);
    if (status == STATUS_OK)
        status = check_topology(ctx, options->topology);
    if (status == STATUS_OK)
        status = check_kind(ctx, run->inputs[0], SPBM_FILE_CHAINS);
    if (status == STATUS_OK)
        status = read_chain_info(ctx, run->inputs[0], &run->chains);
    if (status != STATUS_OK)
        return status;
    count_targets(&options->target, run->chains.topology.faces);
    run->size = (struct run_size){.faces = run->chains.topology.faces,
                                  .stride = run->chains.attributes.stride,
                                  .target = make_target(&options->target)};
    return stages_fit(run->job, STAGE_IMPORT, STAGE_LOD, &run->size);
}

spbm_status spbm_lod_topology(spbm_job *job, const char *chains, const char *output,
                              const spbm_target *target, const spbm_lod_options *options,
                              const spbm_topology_options *topology, spbm_simplify_report *report)
{
    struct context *ctx = call_begin(job);
    spbm_simplify_report unwanted;
    spbm_simplify_options all;
    struct run run = {.job = job,
                      .ctx = ctx,
                      .inputs = &chains,
                      .input_count = 1,
                      .output = output,
                      .options = &all,
                      .report = report ? report : &unwanted,
                      .folder = {.fd = -1},
                      .is_unfolding = true};
    memset(run.report, 0, sizeof *run.report);
    workspace_init(&run.work, ctx);
    spbm_simplify_defaults(&all);
    all.target = *target;
    all.lod = options ? *options : all.lod;
    all.patch = plane_patches;
    all.topology = topology;

    enum status status = check_chains(&run, &all);
    const uint64_t original_faces = run.chains.topology.faces;
    if (status == STATUS_OK)
        status = open_places(&run);
    if (status == STATUS_OK)
        status = run_stages(&run);
    run.report->levels.original_faces = original_faces;
    close_places(&run, status);
    return call_end(job, status);
}
