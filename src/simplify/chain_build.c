/*
 * STAGE 2: patches and chains of a store. Slabs are jobs: each is mapped, grown, traced and packed
 * by one worker, and its block is written in the order of the slabs, so that neither threads nor
 * memory show in the file. What is held is in proportion to the slabs in flight; the seams go
 * through seam_join, which sorts outside of memory. In a run of all stages slabs may come from
 * memory (store_hold.h) and blocks stay there (chain_hold.h).
 */
#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "simplify/chain_frame.h"
#include "simplify/chain_trace.h"
#include "simplify/patch_fit.h"
#include "simplify/patchify.h"
#include "simplify/seam_join.h"
#include "simplify/simplify.h"

enum { SEAM_LIMIT_MAX = 64 << 20, SEAM_LIMIT_MIN = 1 << 20 };

struct worker {
    struct patch_workspace grow;
    struct trace_workspace trace;
};

/* What a job hands to its finish. */
struct result {
    struct slab_seams seams;
    struct chain_info counts; /* those of the block */
    unsigned char *packed;    /* NULL: it is held */
    size_t packed_size;
};

struct build {
    struct context *ctx;
    struct store *store;
    uint32_t stride;
    uint32_t slab_count;
    struct patch_options options;
    int level;
    struct worker *workers;
    unsigned worker_count;
    struct result *results; /* job j uses place j % in_flight */
    unsigned in_flight;
    struct chain_writer *writer;
    struct seam_join *join;
    struct chain_hold *hold; /* or NULL */
    struct chain_info info;
};

/* ---- one slab ---- */

static void count_block(struct chain_info *info, const struct chain_block *block,
                        const struct trace_counts *counts)
{
    info->patches = block->patch_count;
    info->chains = block->chain_count;
    info->junctions = block->junction_count;
    info->chain_vertices = block->junction_count + counts->chain_interiors;
    info->most_faces = counts->most_faces;
}

static enum status make_block(struct build *build, uint32_t index, struct worker *worker,
                              struct result *result)
{
    struct slab slab = {0};
    struct context *ctx = build->ctx;
    struct chain_block block;
    struct trace_counts counts;
    enum status status =
        patch_growth_open(ctx, build->store, index, &build->options, &worker->grow, &slab);
    if (!status)
        status = chain_trace(ctx, build->store, build->stride, &slab, &worker->grow, &worker->trace,
                             &block, &result->seams, &counts);
    bool is_held = false;
    if (!status && build->hold)
        status = chain_hold_take(build->hold, &block, &is_held);
    if (!status && !is_held) {
        size_t size;
        void *room = trace_free_room(ctx, &worker->trace, &worker->grow, &block, &size);
        status = chain_block_pack(ctx, &block, build->stride, build->level, room, size,
                                  &result->packed, &result->packed_size);
    }
    slab_close(&slab);
    if (!status)
        count_block(&result->counts, &block, &counts);
    return status;
}

static enum status work(void *user, uint64_t job, unsigned worker)
{
    struct build *build = user;
    return make_block(build, (uint32_t)job, &build->workers[worker],
                      &build->results[job % build->in_flight]);
}

static void clear_result(struct build *build, struct result *result)
{
    slab_seams_clear(build->ctx, &result->seams);
    memory_release(build->ctx, &result->packed, result->packed_size, 1);
    memset(result, 0, sizeof *result);
}

static void add_counts(struct chain_info *info, const struct chain_info *counts)
{
    info->patches += counts->patches;
    info->chains += counts->chains;
    info->junctions += counts->junctions;
    info->chain_vertices += counts->chain_vertices;
    info->most_faces += counts->most_faces;
}

static enum status finish(void *user, uint64_t job)
{
    struct build *build = user;
    struct result *result = &build->results[job % build->in_flight];
    enum status status = chain_writer_block(build->writer, result->packed, result->packed_size);
    if (!status)
        status = seam_join_add(build->join, &result->seams);
    add_counts(&build->info, &result->counts);
    clear_result(build, result);
    return status ? status : step(build->ctx, "patchify", job + 1, build->slab_count);
}

/* ---- the seams ---- */

static enum status write_seams(struct build *build)
{
    struct seam_counts counts;
    enum status status = seam_join_link(build->join, &counts);
    if (status)
        return status;
    build->info.chains += counts.chains;
    build->info.seam_chains = counts.chains;
    build->info.junctions += counts.junctions;
    build->info.chain_vertices += counts.vertices;
    for (uint32_t slab = 0; slab < build->slab_count && !status; slab++) {
        struct chain_block block;
        status = seam_join_next(build->join, &block);
        if (status)
            break;
        status = chain_writer_seams(build->writer, &block);
        chain_block_clear(build->ctx, 0, &block);
    }
    return status;
}

/* ---- opening, info, clean-up ---- */

static void fill_info(struct chain_info *info, const struct store_info *store,
                      const struct target *target, const struct patch_options *options)
{
    memset(info, 0, sizeof *info);
    info->topology = store->topology;
    info->attributes = store->attributes;
    memcpy(info->origin, store->origin, sizeof info->origin);
    memcpy(info->box_low, store->box_low, sizeof info->box_low);
    memcpy(info->box_high, store->box_high, sizeof info->box_high);
    info->mean_edge = store->mean_edge;
    info->noise = store->noise;
    info->area = store->area;
    info->is_float32 = store->is_float32;
    info->slab_count = store->slab_count;
    info->options = *options;
    info->mode = (uint32_t)target->mode;
    info->effort = target->effort;
    info->target_kind = (uint32_t)target->kind;
    info->target_count = target->count;
    memcpy(info->targets, target->values, target->count * sizeof *target->values);
}

/*
 * Memory, in bytes of a slab of F faces that a worker has in hand, the worst being that every face
 * is a patch of its own:
 *
 *     faces, normals and their spare      32 F + 2 * 16 F   (all serve twice over)
 *     positions                                      6 F
 *     chains and patches, some to spare       1.0625 * (1.5 * 24) F + 44 F
 *     packed, waiting to be written             2 * 12 F
 *
 * which is 12 MiB for slabs of 2^16 faces, and 46 for a mesh that is one of 2^18; with attributes
 * the slab is mapped (31 F), and their records lie in slab, block and packed block. What is shared
 * is the seams' least, the sample that angles are fitted to, the writer and what there is of each
 * slab: 64 bytes.
 */
enum { WORKER_A_FACE = 184, MAPPED_A_FACE = 32, SHARED_MEMORY = 6 << 20 };
/* On scans a worker takes 78 to 98 bytes a face, of which a slab that is forgotten gives 31 back.
 */
enum { BESIDE_A_FACE = 54 };

/* The number of faces may be a guess by a text's first lines: near the bound, the more. */
static uint64_t slab_faces_of(uint64_t faces)
{
    return (uint64_t)1 << slab_shift_of(faces / 2);
}

static uint64_t least_memory(unsigned threads, uint64_t slab_faces, uint32_t stride)
{
    const uint64_t a_face = WORKER_A_FACE + 3 * (uint64_t)stride + (stride ? MAPPED_A_FACE : 0);
    return SHARED_MEMORY + threads * slab_faces * a_face;
}

uint64_t chain_build_least_memory(unsigned threads, uint64_t faces, uint32_t stride)
{
    return least_memory(threads, slab_faces_of(faces), stride);
}

uint64_t chain_build_memory_beside(unsigned threads, uint64_t faces)
{
    return threads * slab_faces_of(faces) * BESIDE_A_FACE;
}

/* Fewer than asked for where that is all that the budget, or the number of slabs, has room for. */
static unsigned choose_workers(const struct context *ctx, const struct store_info *store)
{
    const uint64_t slab_faces = (uint64_t)1 << store->slab_shift;
    const uint32_t slab_count = store->slab_count, stride = store->attributes.stride;
    unsigned workers = ctx->threads ? ctx->threads : 1;
    if (workers > slab_count)
        workers = slab_count ? slab_count : 1;
    while (workers > 1 && least_memory(workers, slab_faces, stride) > ctx->memory_budget)
        workers--;
    return workers;
}

/* Half of what workers leave. */
static uint64_t seam_limit(const struct build *build)
{
    const uint64_t budget = build->ctx->memory_budget;
    const uint64_t slab_faces = (uint64_t)1 << store_info(build->store)->slab_shift;
    const uint64_t taken = least_memory(build->worker_count, slab_faces, build->stride);
    const uint64_t limit = budget > taken ? (budget - taken) / 2 : 0;
    if (limit > SEAM_LIMIT_MAX)
        return SEAM_LIMIT_MAX;
    return limit < SEAM_LIMIT_MIN ? SEAM_LIMIT_MIN : limit;
}

/* What a chain file can't record would make one that no reader takes. */
static enum status check_request(struct context *ctx, const struct target *target,
                                 const struct patch_request *request)
{
    bool is_finite = isfinite(request->chain_tolerance);
    for (uint32_t i = 0; i < target->count && i < TARGETS_MAX; i++)
        is_finite = is_finite && isfinite(target->values[i]);
    if (target->count > TARGETS_MAX || target->effort < 1 || target->effort > 3 || !is_finite)
        return fail(ctx, STATUS_MISUSE, "patchify is given a target out of range");
    if (request->smoothings > SMOOTHINGS_MAX)
        return fail(ctx, STATUS_MISUSE, "face normals can be smoothed %d times at most, not %d",
                    (int)SMOOTHINGS_MAX, (int)request->smoothings);
    return STATUS_OK;
}

static enum status open_all(struct build *build, const char *store_path, const char *chain_path,
                            const struct target *target, const struct patch_request *request)
{
    struct context *ctx = build->ctx;
    enum status status = check_request(ctx, target, request);
    if (!status)
        status = paths_must_differ(ctx, store_path, chain_path);
    if (!status)
        status = request->is_own_store
                     ? store_open_own(ctx, store_path, request->slabs, &build->store)
                     : store_open(ctx, store_path, true, &build->store);
    if (status)
        return status;
    const struct store_info *store = store_info(build->store);
    status = patch_fit(ctx, build->store, target, request, &build->options);
    if (status)
        return status;
    fill_info(&build->info, store, target, &build->options);
    build->info.tolerance = build->options.chain_tolerance;
    build->stride = store->attributes.stride;
    build->slab_count = store->slab_count;
    build->level = request->level;
    build->hold = request->hold;
    build->worker_count = choose_workers(ctx, store);
    /* One for each at work, and one to be written; no more threads are used than are in flight. */
    build->in_flight = build->worker_count + (build->worker_count == ctx->threads);
    status = store_crc(build->store, &build->info.store_crc);
    if (!status)
        status =
            memory_take_zeroed(ctx, build->worker_count, sizeof *build->workers, &build->workers);
    if (!status)
        status = memory_take_zeroed(ctx, build->in_flight, sizeof *build->results, &build->results);
    if (!status && build->hold)
        status = chain_hold_begin(ctx, build->slab_count, build->stride, build->hold);
    if (!status)
        status = chain_writer_open(ctx, chain_path, build->level, build->slab_count, build->stride,
                                   &build->writer);
    if (!status)
        status =
            seam_join_open(ctx, chain_path, seam_limit(build), build->slab_count, &build->join);
    return status;
}

static void release_workers(struct build *build)
{
    struct context *ctx = build->ctx;
    for (unsigned i = 0; build->workers && i < build->worker_count; i++) {
        struct worker *worker = &build->workers[i];
        patch_workspace_clear(ctx, &worker->grow);
        trace_workspace_clear(ctx, &worker->trace);
    }
    for (unsigned i = 0; build->results && i < build->in_flight; i++)
        clear_result(build, &build->results[i]);
    memory_release(ctx, &build->workers, build->worker_count, sizeof *build->workers);
    memory_release(ctx, &build->results, build->in_flight, sizeof *build->results);
}

enum status chain_build(struct context *ctx, const char *store_path, const char *chain_path,
                        const struct target *target, const struct patch_request *request,
                        struct chain_info *info)
{
    struct build build = {.ctx = ctx};
    enum status status = open_all(&build, store_path, chain_path, target, request);
    if (!status)
        status = parallel_ordered(ctx, build.slab_count, build.in_flight, work, finish, &build);
    release_workers(&build); /* before the seams take their share */
    if (!status)
        status = write_seams(&build);
    if (!status)
        status = chain_writer_commit(&build.writer, &build.info, request->sync);
    chain_writer_discard(&build.writer);
    seam_join_close(&build.join);
    store_close(&build.store);
    if (!status && info)
        *info = build.info;
    return status;
}
