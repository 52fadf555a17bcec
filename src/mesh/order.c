/*
 * Hilbert order by one sort of small keys.
 *
 * Sorting the faces themselves moves 12 bytes each several times. Here a face is one word: the cell
 * of its centre on the Hilbert curve above, its number below, so that ties keep their order; the
 * faces are moved once, when all words are sorted. What bits the number leaves go to the cell: 14
 * an axis for a million faces, 10 for the most that there can be.
 *
 * The centre is made from the corners' cells in a grid of 2^19 a side, as integers: faces with the
 * same corners in any order have the very same centre, so that of duplicates the first stays first.
 * A vertex's three cell coordinates share a word with room for sums of three.
 */
#include "mesh/order.h"

#include "base/external_sort.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "geom/space_curve.h"

enum { GRID_BITS = 19, FIELD_BITS = 21, CELL_BITS_MAX = 16, JUDGED_SHIFT_MIN = 6 };

struct ordering {
    struct draft *draft;
    const struct ingest *ingest;
    struct space_curve curve;
    struct spool cell_spool;
    uint64_t *cells; /* a vertex: its cell coordinates, FIELD_BITS apart */
    double low[3];
    double scale;
    unsigned index_bits;
    unsigned cell_bits;
    struct sorter *sorter;
    uint64_t **keys; /* a slab in flight */
    unsigned in_flight;
};

/* ---- vertices ---- */

static void vertex_position(const struct ordering *o, uint64_t v, double out[3])
{
    const uint32_t *source = o->draft->source;
    ingest_position(o->ingest, source ? source[v] : v, out);
}

static void set_grid(struct ordering *o, const struct frame *frame)
{
    double extent = 0;
    for (int i = 0; i < 3; i++) {
        o->low[i] = frame->low[i];
        if (frame->high[i] - frame->low[i] > extent)
            extent = frame->high[i] - frame->low[i];
    }
    o->scale = extent > 0 ? ((1 << GRID_BITS) - 1) / extent : 0;
}

static enum status fill_cells(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct ordering *o = user;
    uint64_t first = o->draft->vertex_first[job], end = o->draft->vertex_first[job + 1];
    for (uint64_t v = first; v < end; v++) {
        double p[3];
        vertex_position(o, v, p);
        uint64_t cell = 0;
        for (int i = 3; i-- > 0;)
            cell = cell << FIELD_BITS | (uint64_t)((p[i] - o->low[i]) * o->scale);
        o->cells[v] = cell;
    }
    return STATUS_OK;
}

/* ---- faces ---- */

static enum status make_keys(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct ordering *o = user;
    const struct draft *draft = o->draft;
    uint64_t first = job << draft->slab_shift, end = first + ((uint64_t)1 << draft->slab_shift);
    if (end > draft->face_count)
        end = draft->face_count;
    uint64_t *keys = o->keys[job % o->in_flight];
    const uint64_t field = ((uint64_t)1 << FIELD_BITS) - 1;
    const unsigned drop = GRID_BITS - o->cell_bits;
    for (uint64_t f = first; f < end; f++) {
        const uint32_t *face = draft->faces + 3 * f;
        uint64_t sum = o->cells[face[0]] + o->cells[face[1]] + o->cells[face[2]];
        uint32_t x = (uint32_t)(sum & field) / 3 >> drop;
        uint32_t y = (uint32_t)(sum >> FIELD_BITS & field) / 3 >> drop;
        uint32_t z = (uint32_t)(sum >> 2 * FIELD_BITS) / 3 >> drop;
        keys[f - first] = space_curve_key(&o->curve, x, y, z, o->cell_bits) << o->index_bits | f;
    }
    return STATUS_OK;
}

static enum status add_keys(void *user, uint64_t job)
{
    struct ordering *o = user;
    uint64_t first = job << o->draft->slab_shift;
    uint64_t left = o->draft->face_count - first, full = (uint64_t)1 << o->draft->slab_shift;
    enum status status =
        sorter_add(o->sorter, o->keys[job % o->in_flight], (size_t)(left < full ? left : full));
    if (status == STATUS_OK)
        status = step(o->draft->ctx, "import: order", job, o->draft->slab_count);
    return status;
}

static enum status move_faces(struct ordering *o)
{
    struct draft *draft = o->draft;
    struct spool moved;
    uint32_t batch[3 * 1024];
    const uint64_t mask = ((uint64_t)1 << o->index_bits) - 1;
    spool_init(draft->ctx, &moved, draft->beside, draft->spool_limit);
    enum status status = sorter_finish(o->sorter);
    while (status == STATUS_OK) {
        const void *data;
        size_t count;
        status = sorter_next(o->sorter, &data, &count);
        if (status != STATUS_OK || count == 0)
            break;
        const uint64_t *keys = data;
        for (size_t i = 0; i < count && status == STATUS_OK;) {
            size_t used = 0;
            for (; used < sizeof batch / sizeof *batch && i < count; i++) {
                const uint32_t *face = draft->faces + 3 * (keys[i] & mask);
                for (int k = 0; k < 3; k++)
                    batch[used++] = face[k];
            }
            status = spool_append(&moved, batch, used * sizeof *batch);
        }
    }
    if (status == STATUS_OK) {
        spool_clear(&draft->face_spool);
        status = draft_adopt_faces(draft, &moved);
    }
    spool_clear(&moved);
    return status;
}

/* ---- the whole ---- */

uint64_t order_crossing_limit(const struct draft *draft)
{
    if (draft->slab_count <= 1 || draft->slab_shift < JUDGED_SHIFT_MIN)
        return UINT64_MAX;
    uint64_t sides = (uint64_t)CROSSING_PER_SLAB * draft->slab_count;
    return sides >> ((SLAB_SHIFT - draft->slab_shift) / 2);
}

bool order_is_scattered(const struct draft *draft)
{
    return draft->slab_shift >= JUDGED_SHIFT_MIN &&
           draft->foreign_corners > draft->face_count / 8 * 9;
}

static enum status prepare(struct ordering *o)
{
    struct draft *draft = o->draft;
    while ((draft->face_count - 1) >> o->index_bits)
        o->index_bits++;
    unsigned bits = (64 - o->index_bits) / 3;
    o->cell_bits = bits < CELL_BITS_MAX ? bits : CELL_BITS_MAX;
    space_curve_init(&o->curve);
    enum status status = draft_scratch(draft, &o->cell_spool, draft->vertex_count * 8, &o->cells);
    if (status == STATUS_OK)
        status = sorter_open(draft->ctx, 8, 8, draft->sorter_limit, draft->beside, &o->sorter);
    if (status == STATUS_OK)
        status = memory_take_zeroed(draft->ctx, o->in_flight, sizeof *o->keys, &o->keys);
    for (unsigned i = 0; i < o->in_flight && status == STATUS_OK; i++)
        status = memory_take(draft->ctx, (size_t)1 << draft->slab_shift, 8, &o->keys[i]);
    return status;
}

static void release(struct ordering *o)
{
    struct context *ctx = o->draft->ctx;
    for (unsigned i = 0; o->keys && i < o->in_flight; i++)
        memory_release(ctx, &o->keys[i], (size_t)1 << o->draft->slab_shift, 8);
    memory_release(ctx, &o->keys, o->in_flight, sizeof *o->keys);
    spool_clear(&o->cell_spool);
    sorter_close(&o->sorter);
}

enum status order_along_curve(struct draft *draft, const struct ingest *ingest,
                              const struct frame *frame)
{
    struct ordering o = {.draft = draft, .ingest = ingest, .in_flight = draft->ctx->threads + 1};
    enum status status = prepare(&o);
    if (status == STATUS_OK) {
        set_grid(&o, frame);
        status = parallel_for(draft->ctx, draft->slab_count, fill_cells, &o);
    }
    if (status == STATUS_OK)
        status =
            parallel_ordered(draft->ctx, draft->slab_count, o.in_flight, make_keys, add_keys, &o);
    spool_clear(&o.cell_spool);
    if (status == STATUS_OK)
        status = move_faces(&o);
    release(&o);
    uint64_t degenerate;
    if (status == STATUS_OK)
        status = draft_number(draft, draft->vertex_count, NULL, NULL, 0, &degenerate);
    return status;
}
