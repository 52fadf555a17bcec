/*
 * The store is written front to back, a slab's block at a time: workers gather positions and
 * records, measure and compute the CRC; one thread appends. Faces and adjacency go out as they lie
 * in the draft. Slabs that are held (store_hold.h) are measured only.
 */
#include "mesh/store_write.h"

#include <string.h>

#include "base/checksum.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "mesh/store_layout.h"

enum { PIECES = 7, FOREIGN_BYTES = 2 << 20 };

struct piece {
    const void *data;
    uint64_t size;
    uint64_t offset; /* in the block */
    uint32_t crc;
};

struct block { /* a slab in flight */
    struct slab_scope scope;
    const float *own; /* positions: those of the draft, or `positions` */
    float *positions;
    size_t positions_capacity;
    float *foreign_positions;
    size_t foreign_capacity;
    struct piece pieces[PIECES];
    struct slab_measures measures;
    struct slab_entry entry;
    struct slab_layout layout;
};

struct writing {
    struct draft *draft;
    const struct frame *frame;
    struct section_writer *writer;
    struct block *blocks;
    unsigned in_flight;
    unsigned char *table; /* the entries, encoded */
    struct slab_measures measures;
    uint64_t offset;
    struct surveying *surveying; /* NULL: it was done before */
    struct store_hold *hold;     /* or NULL */
};

static const unsigned char zeros[STORE_PIECE_ALIGN];

/* ---- in a worker ---- */

/* Positions as they are stored. Those of the slab's own vertices lie in the draft, and are taken
 * from there if they are what is stored; the foreign ones, few, lie anywhere before. */
static enum status gather(struct writing *w, struct block *b)
{
    const struct draft *draft = w->draft;
    struct context *ctx = draft->ctx;
    const struct slab_scope *scope = &b->scope;
    struct visits visits;
    enum status status = STATUS_OK;
    if (draft->is_float32) {
        b->own = (const float *)draft->positions + 3 * (size_t)scope->vertex_first;
    } else {
        status = memory_reserve(ctx, &b->positions, &b->positions_capacity,
                                3 * (size_t)scope->own_count, sizeof(float));
        for (uint32_t i = 0; i < scope->own_count && status == STATUS_OK; i++)
            frame_position(w->frame, draft, scope->vertex_first + i, b->positions + 3 * (size_t)i);
        b->own = b->positions;
    }
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &b->foreign_positions, &b->foreign_capacity,
                                3 * (size_t)scope->foreign_count, sizeof(float));
    if (status == STATUS_OK)
        status = visits_begin(&draft->room, &visits, &draft->position_spool, FOREIGN_BYTES);
    if (status != STATUS_OK)
        return status;
    for (uint32_t i = 0; i < scope->foreign_count; i++) {
        visit(&visits, scope->foreign[i] * draft_position_size(draft));
        frame_position(w->frame, draft, scope->foreign[i], b->foreign_positions + 3 * (size_t)i);
    }
    visits_end(&visits);
    return STATUS_OK;
}

static void lay_out(struct writing *w, struct block *b)
{
    const struct draft *draft = w->draft;
    const struct slab_scope *scope = &b->scope;
    const uint64_t faces = scope->face_count, own = scope->own_count;
    const uint64_t foreign = scope->foreign_count, first = scope->face_first;
    b->entry = (struct slab_entry){.vertex_first = scope->vertex_first,
                                   .vertex_count = scope->own_count,
                                   .foreign_count = scope->foreign_count,
                                   .face_count = scope->face_count};
    struct slab_layout *at = &b->layout;
    slab_layout_find(&b->entry, draft->record_size, at);
    struct piece *p = b->pieces;
    p[0] = (struct piece){draft->faces + 3 * first, 12 * faces, at->faces, 0};
    p[1] = (struct piece){draft->neighbours + 3 * first, 12 * faces, at->neighbours, 0};
    p[2] = (struct piece){draft->mates + first, faces, at->mates, 0};
    p[3] = (struct piece){b->own, 12 * own, at->positions, 0};
    p[4] = (struct piece){scope->foreign, 4 * foreign, at->foreign, 0};
    p[5] = (struct piece){b->foreign_positions, 12 * foreign, at->foreign_positions, 0};
    p[6] = (struct piece){draft->records + scope->vertex_first * (size_t)draft->record_size,
                          own * draft->record_size, at->records, 0};
}

/* Bytes of padding behind piece i. */
static size_t gap_behind(const struct block *b, int i)
{
    uint64_t end = b->pieces[i].offset + b->pieces[i].size;
    uint64_t next = i + 1 < PIECES ? b->pieces[i + 1].offset : b->layout.size;
    return (size_t)(next - end);
}

static void expect_vertices(const struct draft *draft, uint64_t slab)
{
    const uint64_t first = draft->vertex_first[slab], count = draft->vertex_first[slab + 1] - first;
    const uint64_t size = draft_position_size(draft);
    spool_expect(&draft->position_spool, first * size, count * size);
    spool_expect(&draft->record_spool, first * draft->record_size, count * draft->record_size);
}

static enum status prepare_block(void *user, uint64_t job, unsigned worker)
{
    struct writing *w = user;
    struct block *b = &w->blocks[job % w->in_flight];
    draft_enter_slab(w->draft, job);
    expect_vertices(w->draft, job);
    enum status status = scope_enter(w->draft, (uint32_t)job, &b->scope);
    if (status == STATUS_OK && w->surveying)
        status = survey_take(w->surveying, &b->scope, job, worker);
    if (status == STATUS_OK)
        status = gather(w, b);
    if (status != STATUS_OK)
        return status;
    measure_slab(w->draft, &b->scope, b->own, b->foreign_positions, &b->measures);
    lay_out(w, b);
    b->entry.crc = 0;
    if (store_hold_has(w->hold, (uint32_t)job))
        return STATUS_OK; /* not written, and so not to be found damaged */
    for (int i = 0; i < PIECES; i++) {
        struct piece *piece = &b->pieces[i];
        piece->crc = piece->size ? checksum(0, piece->data, (size_t)piece->size) : 0;
        b->entry.crc = checksum_join(b->entry.crc, piece->crc, piece->size);
        b->entry.crc = checksum(b->entry.crc, zeros, gap_behind(b, i));
    }
    return STATUS_OK;
}

/* ---- in order ---- */

static enum status append_block(void *user, uint64_t job)
{
    struct writing *w = user;
    struct block *b = &w->blocks[job % w->in_flight];
    measures_add(&w->measures, &b->measures);
    const bool is_held = store_hold_has(w->hold, (uint32_t)job);
    b->entry.offset = w->offset;
    w->offset += is_held ? 0 : b->layout.size;
    slab_entry_encode(&b->entry, w->table + job * STORE_SLAB_ENTRY_SIZE);
    enum status status = w->surveying ? survey_add(w->surveying, job) : STATUS_OK;
    if (status == STATUS_OK && is_held)
        status = store_hold_add(w->hold, &b->scope, (uint32_t)job, b->foreign_positions);
    for (int i = 0; i < PIECES && status == STATUS_OK && !is_held; i++) {
        const struct piece *piece = &b->pieces[i];
        status = section_append_summed(w->writer, piece->data, (size_t)piece->size, piece->crc);
        if (status == STATUS_OK)
            status = section_append(w->writer, zeros, gap_behind(b, i));
    }
    draft_forget_slab(w->draft, job);
    spool_forget_all(&w->draft->position_spool);
    spool_forget_all(&w->draft->record_spool);
    if (status == STATUS_OK)
        status = step(w->draft->ctx, "import: write", job, w->draft->slab_count);
    return status;
}

static enum status write_section(struct section_writer *writer, uint32_t kind, const void *data,
                                 size_t size)
{
    enum status status = section_begin(writer, kind);
    if (status == STATUS_OK)
        status = section_append(writer, data, size);
    if (status == STATUS_OK)
        status = section_end(writer);
    return status;
}

static enum status write_attributes(struct context *ctx, const struct attributes *attributes,
                                    struct section_writer *writer)
{
    size_t size = store_attributes_size(attributes);
    unsigned char *bytes;
    enum status status = memory_take(ctx, size, 1, &bytes);
    if (status != STATUS_OK)
        return status;
    store_attributes_encode(attributes, bytes);
    status = write_section(writer, STORE_KIND_ATTRIBUTES, bytes, size);
    memory_release(ctx, &bytes, size, 1);
    return status;
}

static enum status write_slabs(struct writing *w)
{
    enum status status = section_begin(w->writer, STORE_KIND_SLABS);
    if (status == STATUS_OK)
        status = parallel_ordered(w->draft->ctx, w->draft->slab_count, w->in_flight, prepare_block,
                                  append_block, w);
    if (status == STATUS_OK)
        status = section_end(w->writer);
    return status;
}

static void release(struct writing *w)
{
    struct context *ctx = w->draft->ctx;
    for (unsigned i = 0; w->blocks && i < w->in_flight; i++) {
        struct block *b = &w->blocks[i];
        scope_clear(&b->scope);
        memory_release(ctx, &b->positions, b->positions_capacity, sizeof(float));
        memory_release(ctx, &b->foreign_positions, b->foreign_capacity, sizeof(float));
    }
    memory_release(ctx, &w->blocks, w->in_flight, sizeof *w->blocks);
    memory_release(ctx, &w->table, w->draft->slab_count, STORE_SLAB_ENTRY_SIZE);
}

/* The sections behind the slabs. */
static enum status write_rest(struct writing *w, struct store_info *info)
{
    struct context *ctx = w->draft->ctx;
    enum status status = write_section(w->writer, STORE_KIND_TABLE, w->table,
                                       (size_t)w->draft->slab_count * STORE_SLAB_ENTRY_SIZE);
    if (status == STATUS_OK)
        status = write_attributes(ctx, &info->attributes, w->writer);
    if (status == STATUS_OK) {
        info->mean_edge = measures_mean_edge(&w->measures);
        info->noise = measures_noise(&w->measures);
        info->area = w->measures.area;
        info->cleaning.zero_area_faces = w->measures.zero_area_faces;
        unsigned char bytes[STORE_INFO_SIZE];
        store_info_encode(info, bytes);
        status = write_section(w->writer, STORE_KIND_INFO, bytes, sizeof bytes);
    }
    return status;
}

enum status store_write(struct draft *draft, const struct frame *frame,
                        struct section_writer *writer, struct store_info *info,
                        struct survey *survey, struct store_hold *hold)
{
    struct context *ctx = draft->ctx;
    struct writing w = {.draft = draft,
                        .frame = frame,
                        .writer = writer,
                        .in_flight = draft->room.in_flight,
                        .hold = hold};
    enum status status = memory_take_zeroed(ctx, w.in_flight, sizeof *w.blocks, &w.blocks);
    if (status == STATUS_OK)
        status = memory_take(ctx, draft->slab_count, STORE_SLAB_ENTRY_SIZE, &w.table);
    if (status == STATUS_OK && hold)
        status = store_hold_begin(hold, draft);
    if (status == STATUS_OK && survey)
        status = survey_begin(draft, w.in_flight, survey, &w.surveying);
    if (status == STATUS_OK)
        status = write_slabs(&w);
    if (status == STATUS_OK && survey)
        status = survey_end(w.surveying);
    if (status == STATUS_OK && survey)
        info->topology = survey->topology;
    survey_close(&w.surveying);
    const bool is_whole = status == STATUS_OK && (!survey || survey_is_clean(survey));
    if (is_whole)
        status = write_rest(&w, info);
    release(&w);
    if (is_whole && status == STATUS_OK && hold)
        status = store_hold_take(hold, frame, draft);
    return status;
}
