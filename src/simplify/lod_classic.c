/*
 * Mode classic.
 *
 * The chain graph is built once and simplified by one sequence of operations (lod_sequence.h); a
 * level is the graph at the moment when it has few enough faces: its patches are triangulated, the
 * triangles written, and the sequence goes on. How many faces a graph gives is known without
 * triangulating it, corners less two a patch, except where a patch must be cut into a fan, which
 * has two faces more. So a level is made by going to N, triangulating, and as long as the fans make
 * it too many, going on by as much. When in the end fewer fans are needed than were reckoned with,
 * unused vertices are put back into patches: N or N - 1 is met. Where nothing more can be taken
 * away, a graph with fewer patches may need more fans, and give more faces, than the one before:
 * the level before is written again then, for no level has more faces than a finer one.
 */
#include "simplify/lod_classic.h"

#include <string.h>

#include "base/memory.h"
#include "simplify/lod_output.h"
#include "simplify/lod_sequence.h"
#include "simplify/lod_target.h"
#include "simplify/patch_triangulate.h"

/* Patches may be grown with a smaller angle than merged: what finer patches tell of the shape is
 * used until the level has no room for it. 25 degrees, the paper's alpha1. */
#define MERGE_COSINE 0.9063077870366499

struct classic {
    struct context *ctx;
    const struct lod_options *options;
    const struct chain_info *info;
    struct chain_graph graph;
    struct lod_sequence sequence;
    struct level_faces faces;
    uint32_t *numbers;  /* of graph vertices in the level; NO_INDEX: not in it */
    uint32_t *vertices; /* of the level: graph vertices, by first use */
    size_t vertex_count, vertex_capacity;

    /* The level before, whose vertices are the above: NULL while there is none. */
    uint32_t *last_faces; /* corners are numbers of the level's vertices */
    size_t last_count, last_capacity;
    double last_error;
};

/* ---- writing a level ---- */

static void fetch_vertices(void *user, uint64_t first, size_t count, double *positions,
                           unsigned char *records)
{
    const struct classic *classic = user;
    const struct chain_graph *graph = &classic->graph;
    size_t stride = graph->stride;
    for (size_t i = 0; i < count; i++) {
        size_t v = classic->vertices[first + i];
        for (size_t k = 0; k < 3; k++) {
            double value = (double)graph->positions[3 * v + k], origin = classic->info->origin[k];
            positions[3 * i + k] = origin != 0 ? origin + value : value; /* -0 stays -0 */
        }
        if (stride > 0)
            memcpy(records + i * stride, graph->record_data + v * stride, stride);
    }
}

/* Gives the level's vertices their numbers, in the faces too. */
static enum status number_vertices(struct classic *classic)
{
    uint32_t *corners = classic->faces.faces;
    size_t corner_count = 3 * classic->faces.count;
    classic->vertex_count = 0;
    memset(classic->numbers, 0xff, classic->graph.vertex_count * sizeof *classic->numbers);
    for (size_t i = 0; i < corner_count; i++) {
        uint32_t *number = &classic->numbers[corners[i]];
        if (*number == NO_INDEX) {
            enum status status =
                memory_reserve(classic->ctx, &classic->vertices, &classic->vertex_capacity,
                               classic->vertex_count + 1, sizeof *classic->vertices);
            if (status != STATUS_OK)
                return status;
            *number = (uint32_t)classic->vertex_count;
            classic->vertices[classic->vertex_count++] = corners[i];
        }
        corners[i] = *number;
    }
    return STATUS_OK;
}

/* Exchanges the faces just made, whose corners are numbered, with those of the level before. */
static void exchange_with_last(struct classic *classic)
{
    struct level_faces *faces = &classic->faces;
    uint32_t *array = faces->faces;
    const size_t count = faces->count, capacity = faces->capacity;
    faces->faces = classic->last_faces;
    faces->count = classic->last_count;
    faces->capacity = classic->last_capacity;
    classic->last_faces = array;
    classic->last_count = count;
    classic->last_capacity = capacity;
}

static enum status write_level(struct classic *classic, uint32_t index, struct level *level)
{
    level->vertices = classic->vertex_count;
    level->faces = classic->last_count;
    level->error = classic->last_error;
    level->reason = lod_stop_reason(level, classic->sequence.exhausted);
    struct level_source source = {.vertex_count = classic->vertex_count,
                                  .face_count = classic->last_count,
                                  .faces = classic->last_faces,
                                  .attributes = &classic->info->attributes,
                                  .is_float32 = classic->info->is_float32,
                                  .fetch = fetch_vertices,
                                  .user = classic};
    return lod_output_write(classic->ctx, classic->options, index, &source);
}

/* ---- reaching a level ---- */

/* Takes away until the triangulated patches have at most `most` faces, if that is possible without
 * an operation that costs more than `most_error`. */
static enum status reach_faces(struct classic *classic, uint64_t most, double most_error)
{
    uint64_t goal = most;
    enum status status = lod_sequence_run(&classic->sequence, goal, most_error);
    while (status == STATUS_OK) {
        status = patch_triangulate(&classic->graph, &classic->faces);
        if (status != STATUS_OK)
            return status;
        uint64_t total = classic->faces.count, base = chain_graph_faces(&classic->graph);
        bool blocked = classic->faces.blocked > 0;
        bool has_ended = classic->sequence.exhausted || base > goal; /* the rest is too dear */
        if (!blocked && (total <= most || has_ended || most == 0))
            return STATUS_OK;
        if (classic->sequence.exhausted)
            return fail(classic->ctx, STATUS_INTERNAL,
                        "a patch can't be triangulated and nothing more can be taken away");
        uint64_t excess = total > most && most > 0 ? total - most : 1;
        goal = base > excess ? base - excess : 1;
        status = lod_sequence_run(&classic->sequence, goal, blocked ? INFINITY : most_error);
    }
    return status;
}

/* Estimated largest distance to the original: what operations did, and what the patches are. */
static double present_error(const struct classic *classic)
{
    double error = classic->sequence.error;
    for (uint32_t i = 0; i < classic->graph.patch_count; i++) {
        const struct graph_patch *patch = &classic->graph.patches[i];
        if (patch->half_edge != NO_INDEX && (double)patch->deviation > error)
            error = (double)patch->deviation;
    }
    return error;
}

static enum status make_level(struct classic *classic, uint32_t index, struct level *level)
{
    enum status status = reach_faces(classic, level->wanted_faces, lod_error_bound(level));
    if (status == STATUS_OK && classic->sequence.done > 0 &&
        classic->faces.count + 1 < level->wanted_faces)
        status = patch_refine(&classic->faces, (level->wanted_faces - classic->faces.count) / 2);
    if (status != STATUS_OK)
        return status;
    if (classic->last_faces && classic->faces.count > classic->last_count)
        return write_level(classic, index, level);
    status = number_vertices(classic);
    if (status != STATUS_OK)
        return status;
    exchange_with_last(classic);
    classic->last_error = present_error(classic);
    if (classic->faces.bad > 0)
        tell(classic->ctx, MESSAGE_NOTE,
             "level %u: %llu patches were triangulated although their outline overlaps itself",
             index, (unsigned long long)classic->faces.bad);
    return write_level(classic, index, level);
}

enum status lod_classic(struct context *ctx, struct chain_file *file,
                        const struct lod_options *options, struct lod_report *report)
{
    struct classic classic = {.ctx = ctx, .options = options, .info = chain_file_info(file)};
    struct cost_options cost = {classic.info->options.patch_cosine[0]};
    if (cost.patch_cosine > MERGE_COSINE)
        cost.patch_cosine = MERGE_COSINE;
    if (options->place == PLACE_OPTIMAL)
        return fail(ctx, STATUS_MISUSE,
                    "mode classic keeps input vertices where they are: --place optimal needs "
                    "--mode collapse");
    enum status status = chain_graph_open(ctx, file, options->output, &classic.graph);
    chain_hold_clear(options->hold);
    if (status != STATUS_OK)
        return status;
    status = lod_sequence_begin(&classic.graph, &cost, &classic.sequence);
    if (status != STATUS_OK)
        goto done;
    status =
        memory_take(ctx, classic.graph.vertex_count, sizeof *classic.numbers, &classic.numbers);
    for (uint32_t i = 0; i < report->level_count && status == STATUS_OK; i++)
        status = make_level(&classic, i, &report->levels[i]);
    lod_sequence_end(&classic.sequence);
done:
    level_faces_clear(ctx, &classic.faces);
    memory_release(ctx, &classic.last_faces, classic.last_capacity, sizeof *classic.last_faces);
    memory_release(ctx, &classic.numbers, classic.graph.vertex_count, sizeof *classic.numbers);
    memory_release(ctx, &classic.vertices, classic.vertex_capacity, sizeof *classic.vertices);
    chain_graph_clear(&classic.graph);
    return status;
}
