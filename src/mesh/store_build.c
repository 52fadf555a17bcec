/*
 * STAGE 1: any inputs in, a mesh store out.
 *
 * The inputs are streamed once into spools. Then the mesh is cleaned in the order that makes each
 * step see what it needs: coincident vertices are welded before faces are judged; faces and
 * vertices get an order local in space before anything looks at neighbours; duplicate faces go
 * before edges are judged, or each would make its edges non-manifold; edges and vertices are
 * separated before orientation is mended, since sides that don't belong together need not agree;
 * and cutting a surface that is not orientable makes new fans to be separated.
 *
 * For a clean scan each of these is one look that finds nothing, and every look costs as much as
 * the mesh has bytes where it does not fit in memory. So faces are numbered while they are read;
 * the box is found while vertices are put in order; what is known of edges between slabs is entered
 * when a slab is looked at (draft_seams.c); and the last look, the survey, writes the store. So
 * faces are read back twice before they stand in the store, neighbours once.
 */
#include "mesh/store.h"

#include <string.h>

#include "base/checksum.h"
#include "base/bytes.h"
#include "mesh/adjacency.h"
#include "mesh/ingest.h"
#include "mesh/order.h"
#include "mesh/orient.h"
#include "mesh/separate.h"
#include "mesh/store_layout.h"
#include "mesh/store_write.h"
#include "mesh/survey.h"
#include "mesh/weld.h"

/* Separate, turn, separate what was cut, count: more rounds mean a defect. */
enum { MENDING_ROUNDS = 6 };

struct build {
    struct context *ctx;
    const struct import_options *options;
    const char *const *inputs; /* or: */
    size_t input_count;
    const struct store_feed *feed;
    struct ingest ingest;
    struct draft draft;
    struct numbering *numbering; /* while faces are read, or NULL */
    uint64_t numbered_ids;
    struct frame frame;
    struct section_writer writer;
    struct store_info info;
};

/* ---- reading ---- */

static void remember_name(struct store_info *info, const char *path)
{
    const char *slash = strrchr(path, '/');
    const char *name = slash ? slash + 1 : path;
    size_t length = strnlen(name, sizeof info->input_name - 1);
    memset(info->input_name, 0, sizeof info->input_name);
    memcpy(info->input_name, name, length);
}

static enum status read_input(struct build *build, const char *path, bool is_first)
{
    struct store_info *info = &build->info;
    struct instream *stream = NULL;
    struct import_sink sink;
    enum status status = instream_open(build->ctx, path, &stream);
    if (status != STATUS_OK)
        return status;
    if (is_first)
        remember_name(info, instream_name(stream));
    /* Text has about as many bytes as what it becomes, and packed text a quarter. */
    build->ingest.credible = 4 * instream_file_size(stream);
    status = ingest_begin(&build->ingest, path, &sink);
    if (status == STATUS_OK)
        status = import_read(build->ctx, stream, &sink);
    if (status == STATUS_OK)
        status = ingest_end(&build->ingest);
    if (status == STATUS_OK) {
        uint32_t digest = instream_digest(stream);
        if (is_first) {
            info->input_digest = digest;
        } else {
            unsigned char bytes[4];
            store_u32(bytes, digest);
            info->input_digest = checksum(info->input_digest, bytes, sizeof bytes);
        }
        info->input_size += instream_raw_size(stream);
    }
    instream_close(&stream);
    return status;
}

static enum status take_feed(struct build *build)
{
    const struct store_info *source = build->feed->source;
    struct store_info *info = &build->info;
    struct import_sink sink;
    memcpy(info->input_name, source->input_name, sizeof info->input_name);
    info->input_digest = source->input_digest;
    info->input_size = source->input_size;
    enum status status = ingest_begin(&build->ingest, info->input_name, &sink);
    if (status == STATUS_OK)
        status = build->feed->give(build->feed->user, &sink);
    return status == STATUS_OK ? ingest_end(&build->ingest) : status;
}

/* Faces are numbered when they come, where all their vertices have come before. */
static enum status take_triangles(void *user, struct ingest *ingest, size_t count,
                                  const uint32_t *indices, bool *taken)
{
    struct build *build = user;
    enum status status = STATUS_OK;
    size_t dropped = 0;
    if (!build->numbering) {
        const uint64_t expected = ingest->inputs[0].expected_faces;
        build->numbered_ids = ingest->vertex_count;
        status =
            number_begin(&build->draft, ingest->vertex_count, true, expected, &build->numbering);
    }
    *taken = ingest->vertex_count == build->numbered_ids;
    if (status == STATUS_OK && *taken)
        status =
            number_take(build->numbering, indices, count, &ingest->face_spool, &dropped, taken);
    ingest->face_count -= dropped;
    build->info.cleaning.degenerate_faces += dropped;
    return status;
}

static enum status read_inputs(struct build *build)
{
    enum status status = STATUS_OK;
    ingest_init(build->ctx, &build->ingest, &build->draft.room);
    build->ingest.index_limit = build->draft.index_limit;
    sieve_open(build->ctx, &build->ingest.sieve, room_left(&build->draft.room) / 4);
    if (!build->options->weld)
        build->ingest.taker = (struct ingest_taker){build, take_triangles};
    if (build->feed)
        status = take_feed(build);
    for (size_t i = 0; i < build->input_count && status == STATUS_OK; i++)
        status = read_input(build, build->inputs[i], i == 0);
    const uint64_t held = build->ingest.sieve.held;
    sieve_close(&build->ingest.sieve);
    if (status == STATUS_OK)
        status = ingest_finish(&build->ingest);
    struct cleaning *cleaning = &build->info.cleaning;
    cleaning->input_vertices = build->ingest.vertex_count + held;
    cleaning->welded_vertices = held;
    cleaning->input_faces = build->ingest.input_faces;
    cleaning->triangulated_faces = build->ingest.polygon_faces;
    return status;
}

/* ---- cleaning ---- */

static enum status has_no_faces(struct build *build, const char *why)
{
    return fail(build->ctx, STATUS_BAD_INPUT, "%s: has no faces%s", build->ingest.inputs[0].name,
                why);
}

/* What the ingest has becomes the draft's. */
static enum status take_over(struct build *build)
{
    struct ingest *ingest = &build->ingest;
    struct draft *draft = &build->draft;
    draft->is_float32 = ingest->is_float32;
    draft->record_size = ingest->attributes.stride;
    draft->positions = ingest->positions;
    draft->records = ingest->records;
    draft->position_spool = ingest->position_spool;
    draft->record_spool = ingest->record_spool;
    memset(&ingest->position_spool, 0, sizeof ingest->position_spool);
    memset(&ingest->record_spool, 0, sizeof ingest->record_spool);
    spool_jumps(&draft->position_spool);
    spool_jumps(&draft->record_spool);
    return draft_adopt_faces(draft, &ingest->face_spool);
}

/* Weld, drop degenerate faces, number by first use. */
static enum status take_faces(struct build *build)
{
    struct ingest *ingest = &build->ingest;
    struct cleaning *cleaning = &build->info.cleaning;
    struct draft *draft = &build->draft;
    struct spool merged_spool = {0};
    uint32_t *merged = NULL;
    uint64_t degenerate = 0, welded;
    const uint64_t triangles = ingest->face_count + cleaning->degenerate_faces;
    if (ingest->face_count == 0 && cleaning->degenerate_faces == 0)
        return has_no_faces(build, "");
    if (!build->options->slab_shift)
        draft->slab_shift = slab_shift_of(triangles);
    enum status status = weld_find(ingest, build->options->weld, &merged_spool, &merged, &welded);
    cleaning->welded_vertices += welded;
    if (status == STATUS_OK)
        status = take_over(build);
    const bool is_numbered =
        build->numbering && number_count(build->numbering) == draft->face_count && !merged;
    const bool jumps = build->numbering && number_has_jumped(build->numbering);
    if (status == STATUS_OK && is_numbered)
        status = number_finish(&build->numbering, ingest->vertex_count);
    else if (status == STATUS_OK && build->numbering)
        status = number_take_back(&build->numbering);
    if (status == STATUS_OK && merged)
        status = draft_map_corners(draft, &merged_spool, merged, ingest->vertex_count);
    spool_clear(&merged_spool);
    if (status == STATUS_OK && !is_numbered)
        status = draft_number_first(draft, ingest->vertex_count, jumps, &degenerate);
    if (status != STATUS_OK)
        return status;
    cleaning->degenerate_faces += degenerate;
    cleaning->unreferenced_vertices =
        cleaning->input_vertices - cleaning->welded_vertices - build->draft.vertex_count;
    if (build->draft.face_count == 0)
        return has_no_faces(build, " but degenerate ones");
    return frame_find(&build->draft, &build->frame);
}

/* Adjacency in the input's order if that is local in space, else in Hilbert order. */
static enum status order_and_match(struct build *build, struct adjacency *adjacency)
{
    struct draft *draft = &build->draft;
    bool too_much = draft->id_count || draft_is_scattered(draft);
    if (!too_much) {
        enum status status = order_crosses_too_much(draft, &too_much);
        if (status != STATUS_OK)
            return status;
    }
    if (!too_much) {
        enum status status = adjacency_build(draft, order_crossing_limit(draft), adjacency);
        if (status != STATUS_OK || !adjacency->is_over_limit)
            return status;
        adjacency_clear(adjacency);
        draft_forget_adjacency(draft);
    }
    draft_forget_adjacency(draft); /* of whatever has been made ready */
    build->info.cleaning.hilbert_ordered = 1;
    enum status status = order_along_curve(draft, &build->frame);
    if (status == STATUS_OK)
        status = adjacency_build(draft, UINT64_MAX, adjacency);
    return status;
}

/* Faces, adjacency and slabs without duplicates. */
static enum status match_faces(struct build *build, struct adjacency *adjacency)
{
    struct draft *draft = &build->draft;
    enum status status = order_and_match(build, adjacency);
    while (status == STATUS_OK && adjacency->has_duplicates) {
        uint64_t degenerate, dropped;
        status = draft_drop_faces(draft, adjacency->duplicates, &dropped);
        build->info.cleaning.duplicate_faces += dropped;
        adjacency_clear(adjacency);
        if (status == STATUS_OK)
            status = draft_number(draft, draft->vertex_count, NULL, NULL, 0, &degenerate);
        if (status == STATUS_OK)
            status = adjacency_build(draft, UINT64_MAX, adjacency);
    }
    return status;
}

static enum status mend_orientation(struct build *build, struct survey *survey)
{
    struct cleaning *cleaning = &build->info.cleaning;
    struct orient_counts counts = {0};
    enum status status = orient_draft(&build->draft, survey, &counts);
    cleaning->flipped_faces += counts.flipped;
    cleaning->nonorientable_components += counts.twisted;
    cleaning->cut_edges += counts.cut;
    return status;
}

/* One step towards a manifold that is oriented; `cut` lists what the matching opened. */
static enum status mend_once(struct build *build, struct survey *survey, struct adjacency *cut)
{
    struct cleaning *cleaning = &build->info.cleaning;
    uint64_t split = 0;
    if (!survey->fan_count)
        return mend_orientation(build, survey);
    /* Sides are to be joined again only where the separating found them. */
    enum status status =
        separate_fans(&build->draft, survey, cut, &split, &cleaning->vertices_added);
    if (cut)
        cleaning->nonmanifold_vertices = split;
    return status;
}

/* Until the survey finds nothing; its topology is then that of the store. */
static enum status mend(struct build *build, struct survey *survey, struct adjacency *cut)
{
    enum status status = draft_settle_seams(&build->draft);
    for (int round = 0; status == STATUS_OK && !survey_is_clean(survey); round++) {
        if (round == MENDING_ROUNDS)
            return fail(build->ctx, STATUS_INTERNAL, "mending the mesh does not end");
        status = mend_once(build, survey, round == 0 ? cut : NULL);
        survey_clear(survey);
        if (status == STATUS_OK)
            status = survey_draft(&build->draft, survey);
    }
    build->info.topology = survey->topology;
    if (status == STATUS_OK && build->info.cleaning.nonorientable_components)
        tell(build->ctx, MESSAGE_WARNING,
             "%llu components are not orientable and were cut along %llu edges",
             (unsigned long long)build->info.cleaning.nonorientable_components,
             (unsigned long long)build->info.cleaning.cut_edges);
    return status;
}

/* ---- the whole ---- */

static void describe(struct build *build)
{
    struct store_info *info = &build->info;
    info->attributes = build->ingest.attributes;
    info->is_float32 = build->draft.is_float32;
    info->slab_count = build->draft.slab_count;
    info->slab_shift = build->draft.slab_shift;
    info->welded = build->options->weld;
    memcpy(info->origin, build->frame.origin, sizeof info->origin);
    memcpy(info->box_low, build->frame.low, sizeof info->box_low);
    memcpy(info->box_high, build->frame.high, sizeof info->box_high);
}

static enum status write_store(struct build *build, struct survey *survey)
{
    describe(build);
    return store_write(&build->draft, &build->frame, &build->writer, &build->info, survey,
                       build->options->hold);
}

/*
 * Where nothing speaks against it, the mesh is taken to be clean, and is written while it is
 * surveyed: most scans are, and it saves a look at all slabs. If it is not, it is written again
 * when it has been mended.
 */
static enum status clean_and_write(struct build *build)
{
    struct adjacency adjacency = {0};
    struct survey survey = {0};
    bool is_written = false;
    enum status status = match_faces(build, &adjacency);
    build->info.cleaning.nonmanifold_edges = adjacency.cut_edges;
    if (status == STATUS_OK && adjacency.cut_edges == 0 && output_can_restart(&build->writer.out)) {
        status = write_store(build, &survey);
        is_written = status == STATUS_OK && survey_is_clean(&survey);
        if (status == STATUS_OK && !is_written)
            status = section_file_restart(&build->writer);
    } else if (status == STATUS_OK) {
        status = survey_draft(&build->draft, &survey);
    }
    if (status == STATUS_OK && !is_written)
        status = mend(build, &survey, &adjacency);
    survey_clear(&survey);
    adjacency_clear(&adjacency);
    return status == STATUS_OK && !is_written ? write_store(build, NULL) : status;
}

static enum status run(struct build *build, const char *store_path)
{
    for (size_t i = 0; i < build->input_count; i++) {
        enum status status = paths_must_differ(build->ctx, build->inputs[i], store_path);
        if (status != STATUS_OK)
            return status;
    }
    /* First of all, so that a place that can't be written is told before the work. */
    enum status status =
        section_file_create(build->ctx, store_path, STORE_MAGIC, STORE_VERSION, &build->writer);
    if (status != STATUS_OK)
        return status;
    status = read_inputs(build);
    if (status == STATUS_OK)
        status = take_faces(build);
    if (status == STATUS_OK)
        status = clean_and_write(build);
    if (status == STATUS_OK)
        return section_file_finish(&build->writer, build->options->sync);
    section_file_discard(&build->writer);
    return status;
}

uint64_t store_build_least_memory(unsigned threads, uint64_t faces, uint32_t stride)
{
    (void)threads;
    return room_least(SLAB_SHIFT_MAX, faces, stride);
}

static enum status build_store(struct build *build, const char *store_path, struct store_info *info)
{
    const unsigned shift = build->options->slab_shift;
    if (shift && (shift < STORE_SHIFT_MIN || shift > SLAB_SHIFT_MAX))
        return fail(build->ctx, STATUS_MISUSE, "slabs can't have 2^%u faces", shift);
    const uint64_t least = room_least(shift ? shift : SLAB_SHIFT_MAX, 0, 0);
    if (build->ctx->memory_budget < least)
        return fail(build->ctx, STATUS_NO_MEMORY,
                    "import needs a memory budget of at least %llu bytes",
                    (unsigned long long)(least + build->ctx->memory_aside));
    draft_init(build->ctx, &build->draft, store_path, shift, build->options->working_memory);
    if (build->options->index_limit)
        build->draft.index_limit = build->options->index_limit;
    enum status status = run(build, store_path);
    number_drop(&build->numbering);
    draft_clear(&build->draft);
    ingest_clear(&build->ingest);
    if (status == STATUS_OK && info)
        *info = build->info;
    return status;
}

enum status store_build(struct context *ctx, const char *const *inputs, size_t input_count,
                        const char *store_path, const struct import_options *options,
                        struct store_info *info)
{
    struct build build = {
        .ctx = ctx, .options = options, .inputs = inputs, .input_count = input_count};
    if (input_count == 0)
        return fail(ctx, STATUS_MISUSE, "no input is given");
    return build_store(&build, store_path, info);
}

enum status store_build_from(struct context *ctx, const struct store_feed *feed,
                             const char *store_path, const struct import_options *options,
                             struct store_info *info)
{
    struct build build = {.ctx = ctx, .options = options, .feed = feed};
    return build_store(&build, store_path, info);
}
