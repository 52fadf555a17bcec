/*
 * Making the block of a traced slab. Block numbers are known only when all junctions have been
 * counted; until then chains have codes of a kind and a number in it (trace_internal.h), which then
 * become block numbers by one addition each.
 */
#include "simplify/trace_internal.h"

#include <string.h>

#include "base/memory.h"
#include "simplify/unit_code.h"

/* ---- seam vertices ---- */

/* Codes of the seam vertices inside the slab: those of its edges over which another slab lies. */
static void mark_seams(struct trace *trace)
{
    const struct slab_local *local = trace->local;
    const uint32_t seam = link_beyond(local, BEYOND_SEAM),
                   marked = (uint32_t)KIND_SEAM << CODE_SHIFT;
    uint32_t *codes = trace->scratch->codes;
    for (size_t i = 0; i < local->seam_face_count; i++) {
        const uint32_t f = local->seam_faces[i];
        for (unsigned k = 0; k < 3; k++)
            if (face_link(local, f, k) == seam)
                codes[edge_start(local, f, k)] = codes[edge_end(local, f, k)] = marked;
    }
}

static void number_seam(struct trace *trace, uint32_t vertex)
{
    trace->scratch->seam_vertices[trace->seam_vertex_count] =
        local_vertex_number(trace->local, vertex);
    trace->scratch->codes[vertex] =
        (uint32_t)KIND_SEAM << CODE_SHIFT | (uint32_t)trace->seam_vertex_count++;
}

enum status trace_number_seams(struct trace *trace)
{
    const struct slab_local *local = trace->local;
    struct trace_workspace *scratch = trace->scratch;
    uint32_t *codes = scratch->codes;
    size_t most = 2 * local->seam_links + local->vertex_count - local->own_count;
    enum status status =
        memory_reserve(trace->ctx, &scratch->seam_vertices, &scratch->seam_vertex_capacity, most,
                       sizeof *scratch->seam_vertices);
    if (status)
        return status;
    memset(codes, 0xff, local->vertex_count * sizeof *codes);
    if (local->seam_links)
        mark_seams(trace);
    /* In the order of store numbers: foreign ones below the slab's range, its own, those above. */
    uint32_t foreign = local->own_count;
    while (foreign < local->vertex_count &&
           local_vertex_number(local, foreign) < local->vertex_first)
        number_seam(trace, foreign++);
    for (uint32_t v = 0; v < local->own_count && local->seam_links; v++)
        if (codes[v] != CODE_NONE)
            number_seam(trace, v);
    while (foreign < local->vertex_count)
        number_seam(trace, foreign++);
    return STATUS_OK;
}

/* The seam vertices as local ones again: foreign ones below the slab's range, its own, foreign ones
 * above, as they were numbered; *foreign counts the foreign ones. */
static uint32_t local_seam_vertex(const struct slab_local *local, uint32_t number,
                                  uint32_t *foreign)
{
    uint32_t own = number - local->vertex_first;
    return own < local->own_count ? own : local->own_count + (*foreign)++;
}

enum status trace_take_seams(struct trace *trace, const struct chain_block *block,
                             struct slab_seams *seams)
{
    const struct trace_workspace *scratch = trace->scratch;
    struct context *ctx = trace->ctx;
    const size_t vertices = trace->seam_vertex_count;
    seams->slab = block->slab;
    seams->block_junctions = block->junction_count;
    seams->vertex_count = vertices;
    seams->edge_count = trace->seam_edge_count;
    enum status status = memory_take(ctx, vertices, sizeof *seams->vertices, &seams->vertices);
    if (!status)
        status = memory_take(ctx, vertices, 3 * sizeof *seams->positions, &seams->positions);
    if (!status)
        status = memory_take(ctx, seams->edge_count, sizeof *seams->edges, &seams->edges);
    if (!status)
        status = memory_take(ctx, vertices, sizeof *seams->junctions, &seams->junctions);
    if (status)
        return status;
    if (vertices) {
        memcpy(seams->vertices, scratch->seam_vertices, vertices * sizeof *seams->vertices);
        memcpy(seams->positions, block->positions + 3 * (size_t)block->junction_count,
               vertices * (3 * sizeof *seams->positions));
    }
    if (seams->edge_count)
        memcpy(seams->edges, scratch->seam_edges, seams->edge_count * sizeof *seams->edges);
    uint32_t foreign = 0;
    for (size_t i = 0; i < vertices; i++) {
        uint32_t number = scratch->seam_vertices[i];
        uint32_t vertex = local_seam_vertex(trace->local, number, &foreign);
        seams->junctions[seams->junction_count] = number;
        seams->junction_count += (scratch->codes[vertex] & CODE_TOUCHED) != 0;
    }
    return STATUS_OK;
}

/* ---- the block ---- */

/* What to add to a code's number, by its kind; a vertex that is on no chain has none. */
static inline uint32_t block_number(const uint32_t bases[4], uint32_t code)
{
    return bases[code >> CODE_SHIFT] + (code & CODE_NUMBER);
}

static void number_chains(struct trace *trace, const uint32_t bases[4])
{
    struct chain *chains = trace->scratch->chains;
    for (size_t i = 0; i < trace->chain_count; i++) {
        chains[i].start = block_number(bases, chains[i].start);
        chains[i].end = block_number(bases, chains[i].end);
        chains[i].interior_first += bases[KIND_CHAIN];
    }
}

static enum status number_diagonals(struct trace *trace, const uint32_t bases[4])
{
    const uint32_t *codes = trace->scratch->codes;
    uint32_t *diagonals = trace->scratch->diagonals;
    bool is_sound = true;
    for (size_t i = 0; i < 2 * trace->diagonal_count; i++) {
        uint32_t code = codes[diagonals[i]];
        is_sound &= code != CODE_NONE;
        diagonals[i] = block_number(bases, code);
    }
    return is_sound ? STATUS_OK : trace_fail(trace, "a patch is no disk");
}

/* Copies the values of local vertices to the block's vertices from `to` on. */
static enum status gather_vertices(struct trace *trace, struct store *store, uint32_t stride,
                                   const uint32_t *vertices, size_t count, size_t to)
{
    const struct slab_local *local = trace->local;
    float *positions = trace->positions + 3 * to;
    for (size_t i = 0; i < count; i++)
        memcpy(positions + 3 * i, local->positions + 3 * (size_t)vertices[i], 3 * sizeof(float));
    enum status status = STATUS_OK;
    for (size_t i = 0; i < count && stride && !status; i++) {
        unsigned char *record = trace->scratch->records + (to + i) * stride;
        if (vertices[i] >= local->own_count)
            status = store_record(store, local_vertex_number(local, vertices[i]), record);
        else
            memcpy(record, trace->slab->records + (size_t)vertices[i] * stride, stride);
    }
    return status;
}

static enum status gather_all(struct trace *trace, struct store *store, uint32_t stride)
{
    struct trace_workspace *scratch = trace->scratch;
    size_t to = 0;
    enum status status =
        gather_vertices(trace, store, stride, scratch->junctions, trace->junction_count, to);
    to += trace->junction_count;
    uint32_t foreign = 0;
    for (size_t i = 0; i < trace->seam_vertex_count && !status; i++) {
        uint32_t vertex = local_seam_vertex(trace->local, scratch->seam_vertices[i], &foreign);
        status = gather_vertices(trace, store, stride, &vertex, 1, to++);
    }
    if (!status)
        status =
            gather_vertices(trace, store, stride, scratch->interiors, trace->interior_count, to);
    to += trace->interior_count;
    if (!status)
        status = gather_vertices(trace, store, stride, scratch->patch_interiors,
                                 trace->patch_interior_count, to);
    return status;
}

/* Of the block, at the end of the slab's faces, which are not looked at any more. */
static enum status take_positions(struct trace *trace, size_t vertices)
{
    struct trace_workspace *scratch = trace->scratch;
    const size_t values = 3 * vertices, there = FACE_STRIDE * (size_t)trace->local->face_count;
    if (values <= there) {
        trace->positions = (float *)(void *)(trace->local->faces + (there - values));
        return STATUS_OK;
    }
    enum status status =
        memory_reserve(trace->ctx, &scratch->positions, &scratch->position_capacity, vertices,
                       3 * sizeof *scratch->positions);
    trace->positions = scratch->positions;
    return status;
}

enum status trace_own_notes(struct trace *trace, size_t needed)
{
    struct trace_workspace *scratch = trace->scratch;
    const struct patch_note *lent = scratch->notes;
    const size_t wanted = needed + needed / 16 + 64;
    scratch->notes = NULL;
    scratch->note_capacity = 0;
    scratch->has_lent_notes = false;
    enum status status = memory_take(trace->ctx, wanted, sizeof *scratch->notes, &scratch->notes);
    if (status)
        return status;
    scratch->note_capacity = wanted;
    memcpy(scratch->notes, lent, trace->patch_count * sizeof *lent);
    return STATUS_OK;
}

/* Makes so much room for patches where the notes are that they can become them: there is in what
 * was lent, but for slabs of fewer than a vertex for four faces. Nothing but their notes and
 * vertices' codes is needed any more of what growth has in its room. */
static enum status make_patch_room(struct trace *trace)
{
    struct trace_workspace *scratch = trace->scratch;
    const size_t bytes = trace->patch_count * sizeof(struct patch);
    const size_t notes = (bytes + sizeof *scratch->notes - 1) / sizeof *scratch->notes;
    enum status status = STATUS_OK;
    if (scratch->has_lent_notes) {
        const struct patch_workspace *space = trace->space;
        const unsigned char *end = space->room + space->room_capacity;
        if (bytes <= (size_t)(end - (unsigned char *)space->rest))
            return STATUS_OK;
        status = trace_own_notes(trace, notes);
    } else if (notes > scratch->note_capacity) {
        status = memory_resize(trace->ctx, &scratch->notes, scratch->note_capacity, notes,
                               sizeof *scratch->notes);
        scratch->note_capacity = status ? scratch->note_capacity : notes;
    }
    return status;
}

/* From the last to the first, so that no note is written over before it is read. */
static void make_patches(const struct trace *trace, size_t patch_interior_first)
{
    unsigned char *notes = (unsigned char *)trace->scratch->notes;
    struct patch *patches = (struct patch *)(void *)notes;
    size_t interior = patch_interior_first + trace->patch_interior_count;
    size_t diagonal = trace->diagonal_count;
    for (size_t p = trace->patch_count; p-- > 0;) {
        struct patch_note note;
        struct patch patch;
        memcpy(&note, notes + p * sizeof note, sizeof note);
        const bool has_interior = note.diagonals == NO_INDEX;
        patch.area = note.area;
        patch.deviation = note.deviation;
        patch.interior_count = has_interior;
        patch.diagonal_count = has_interior ? 0 : note.diagonals;
        interior -= patch.interior_count;
        diagonal -= patch.diagonal_count;
        patch.interior_first = (uint32_t)interior;
        patch.diagonal_first = (uint32_t)diagonal;
        (void)unit_decode(note.normal, patch.normal); /* as the file will give it */
        memcpy(&patches[p], &patch, sizeof patch);
    }
}

void *trace_free_room(struct context *ctx, const struct trace_workspace *scratch,
                      struct patch_workspace *space, const struct chain_block *block, size_t *size)
{
    if (!scratch->has_lent_notes) { /* so many patches that their coding takes more */
        memory_release(ctx, &space->room, space->room_capacity, 1);
        space->room_capacity = *size = 0;
        return NULL;
    }
    unsigned char *from = (unsigned char *)(block->patches + block->patch_count);
    unsigned char *faces = (unsigned char *)space->local.faces;
    const size_t behind = space->room_capacity - (size_t)(from - space->room);
    const size_t before = block->positions == scratch->positions
                              ? 0
                              : (size_t)((unsigned char *)block->positions - faces);
    *size = before > behind ? before : behind;
    return before > behind ? faces : from;
}

enum status trace_make_block(struct trace *trace, struct store *store, uint32_t stride,
                             struct chain_block *block)
{
    struct trace_workspace *scratch = trace->scratch;
    const size_t interior_first = trace->junction_count + trace->seam_vertex_count;
    const size_t patch_interior_first = interior_first + trace->interior_count;
    const size_t vertices = patch_interior_first + trace->patch_interior_count;
    const uint32_t bases[4] = {[KIND_JUNCTION] = 0,
                               [KIND_CHAIN] = (uint32_t)interior_first,
                               [KIND_SEAM] = (uint32_t)trace->junction_count};
    enum status status = take_positions(trace, vertices);
    if (!status)
        status = memory_reserve(trace->ctx, &scratch->records, &scratch->record_capacity,
                                vertices * stride, 1);
    if (!status)
        status = gather_all(trace, store, stride);
    if (!status)
        status = number_diagonals(trace, bases);
    if (!status)
        status = make_patch_room(trace);
    if (status)
        return status;
    number_chains(trace, bases);
    make_patches(trace, patch_interior_first);
    *block = (struct chain_block){.slab = trace->slab->index,
                                  .vertex_count = (uint32_t)vertices,
                                  .junction_count = (uint32_t)trace->junction_count,
                                  .seam_vertex_count = (uint32_t)trace->seam_vertex_count,
                                  .chain_count = (uint32_t)trace->chain_count,
                                  .patch_count = (uint32_t)trace->patch_count,
                                  .diagonal_count = (uint32_t)trace->diagonal_count,
                                  .positions = trace->positions,
                                  .records = stride ? scratch->records : NULL,
                                  .seam_vertices = scratch->seam_vertices,
                                  .chains = scratch->chains,
                                  .patches = (struct patch *)(void *)scratch->notes,
                                  .diagonals = scratch->diagonals};
    return STATUS_OK;
}
