/*
 * Vertex data in a new order, and corners by a table: two walks that look up much. Where all of it
 * is in memory, the first is done by all threads, each some vertices at a time.
 */
#include "mesh/draft.h"

#include <math.h>
#include <string.h>

#include "base/float4.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "mesh/lookup.h"

enum { BATCH_BYTES = 16 << 10, JOB_SIZE = 1 << 16, IN_FLIGHT_MAX = 16 };

/* ---- vertex data ---- */

struct box {
    double low[3], high[3];
};

struct gathering { /* of one array */
    struct draft *draft;
    const struct spool *id_spool;
    const uint32_t *ids;
    uint64_t next_count;
    uint64_t base_count;
    const uint32_t *copy_of;
    struct visits copy_visits;
    struct lookup lookup;
    struct spool to;
    size_t size; /* of an element */
    bool finds_box;
    struct box box;
    _Alignas(8) unsigned char batch[BATCH_BYTES];
    size_t used;

    /* in memory */
    const unsigned char *from;
    unsigned char *place;
    unsigned in_flight;
    struct box boxes[IN_FLIGHT_MAX];
};

static inline uint32_t old_vertex(struct gathering *g, uint64_t v)
{
    uint32_t id = g->ids[v];
    if (id < g->base_count)
        return id;
    visit(&g->copy_visits, (id - g->base_count) * sizeof *g->copy_of);
    return g->copy_of[id - g->base_count];
}

static struct box empty_box(void)
{
    return (struct box){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
}

static void widen_by(double value, unsigned axis, struct box *box)
{
    box->low[axis] = value < box->low[axis] ? value : box->low[axis];
    box->high[axis] = value > box->high[axis] ? value : box->high[axis];
}

/* So that it holds `count` positions, too. (Of 0 and -0 either may be the limit.) */
static void widen_box(const void *positions, size_t count, bool is_float32, struct box *box)
{
    const float *floats = positions;
    const double *doubles = positions;
    size_t at = 0;
    if (is_float32 && count >= 4) { /* four positions are three vectors */
        float4 low[3], high[3];
        memcpy(low, floats, sizeof low);
        memcpy(high, floats, sizeof high);
        for (at = 12; at + 12 <= 3 * count; at += 12)
            for (unsigned i = 0; i < 3; i++) {
                float4 values;
                memcpy(&values, floats + at + 4 * (size_t)i, sizeof values);
                low[i] = float4_choose(values < low[i], values, low[i]);
                high[i] = float4_choose(values > high[i], values, high[i]);
            }
        for (unsigned i = 0; i < 12; i++) {
            widen_by((double)low[i / 4][i % 4], i % 3, box);
            widen_by((double)high[i / 4][i % 4], i % 3, box);
        }
    }
    for (; at < 3 * count; at += 3)
        for (unsigned i = 0; i < 3; i++)
            widen_by(is_float32 ? (double)floats[at + i] : doubles[at + i], i, box);
}

static enum status flush(struct gathering *g)
{
    struct draft *draft = g->draft;
    size_t used = g->used;
    if (g->finds_box)
        widen_box(g->batch, used / draft_position_size(draft), draft->is_float32, &g->box);
    g->used = 0;
    return spool_append(&g->to, g->batch, used);
}

/* Room for one more element; an element that is larger than the batch goes straight on. */
static inline enum status put(struct gathering *g, const void *element)
{
    if (g->used + g->size > sizeof g->batch) {
        enum status status = flush(g);
        if (status != STATUS_OK)
            return status;
    }
    memcpy(g->batch + g->used, element, g->size);
    g->used += g->size;
    return STATUS_OK;
}

static enum status gather_now(struct gathering *g, bool *is_done)
{
    enum status status = STATUS_OK;
    uint64_t v = 0;
    for (; v < g->next_count && status == STATUS_OK && !lookup_is_scattered(&g->lookup); v++) {
        status = put(g, lookup_now(&g->lookup, old_vertex(g, v)));
        if (v % FORGET_EVERY == 0)
            spool_pass(g->id_spool, v * 4);
    }
    *is_done = v == g->next_count;
    return status;
}

static enum status gather_by_buckets(struct gathering *g)
{
    unsigned char element[512 + 64];
    enum status status = lookup_ask_begin(&g->lookup);
    for (uint64_t v = 0; v < g->next_count && status == STATUS_OK; v++) {
        status = lookup_ask(&g->lookup, old_vertex(g, v));
        if (v % FORGET_EVERY == 0)
            spool_pass(g->id_spool, v * 4);
    }
    if (status == STATUS_OK)
        status = lookup_answer(&g->lookup);
    for (uint64_t v = 0; v < g->next_count && status == STATUS_OK; v++) {
        status = lookup_next(&g->lookup, old_vertex(g, v), element);
        if (status == STATUS_OK)
            status = put(g, element);
        if (v % FORGET_EVERY == 0)
            spool_pass(g->id_spool, v * 4);
    }
    return status;
}

/* ---- in memory ---- */

static enum status gather_some(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct gathering *g = user;
    const uint64_t first = job * JOB_SIZE, left = g->next_count - first;
    const size_t count = left < JOB_SIZE ? (size_t)left : JOB_SIZE, size = g->size;
    const uint32_t *ids = g->ids + first;
    unsigned char *to = g->place + first * size;
    if (size == 3 * sizeof(float))
        for (size_t v = 0; v < count; v++)
            memcpy(to + 12 * v, g->from + 12 * (size_t)ids[v], 12);
    else
        for (size_t v = 0; v < count; v++)
            memcpy(to + size * v, g->from + size * ids[v], size);
    if (g->finds_box) {
        struct box *box = &g->boxes[job % g->in_flight];
        *box = empty_box();
        widen_box(to, count, g->draft->is_float32, box);
    }
    return STATUS_OK;
}

static enum status add_box(void *user, uint64_t job)
{
    struct gathering *g = user;
    const struct box *box = &g->boxes[job % g->in_flight];
    for (unsigned i = 0; i < 3 && g->finds_box; i++) {
        widen_by(box->low[i], i, &g->box);
        widen_by(box->high[i], i, &g->box);
    }
    return STATUS_OK;
}

/* Everything at once, if all of it is in memory. */
static enum status gather_in_memory(struct gathering *g, const struct spool *spool,
                                    const void *data, bool *is_done)
{
    struct context *ctx = g->draft->ctx;
    void *place;
    *is_done = false;
    if (spool->map || g->id_spool->map || g->copy_of)
        return STATUS_OK;
    enum status status = spool_extend(&g->to, g->next_count * g->size, &place);
    if (status != STATUS_OK || !place)
        return status;
    g->from = data;
    g->place = place;
    g->in_flight = ctx->threads + 1 < IN_FLIGHT_MAX ? ctx->threads + 1 : IN_FLIGHT_MAX;
    *is_done = true;
    return parallel_ordered(ctx, (g->next_count + JOB_SIZE - 1) / JOB_SIZE, g->in_flight,
                            gather_some, add_box, g);
}

/* The array in `spool` takes the new order. */
static enum status gather_array(struct gathering *g, struct spool *spool, void *data, size_t size,
                                void **result)
{
    struct draft *draft = g->draft;
    bool is_done = false;
    g->size = size;
    g->used = 0;
    spool_init(draft->ctx, &g->to, draft->room.beside, room_spool_limit(&draft->room, 3));
    enum status status = gather_in_memory(g, spool, data, &is_done);
    if (status == STATUS_OK && !is_done)
        status = spool_reserve(&g->to, g->next_count * size);
    if (status == STATUS_OK && !is_done)
        status = lookup_open(&draft->room, &g->lookup, spool, data, size, spool->size / size);
    if (status == STATUS_OK && !is_done)
        status = gather_now(g, &is_done);
    if (status == STATUS_OK && !is_done) {
        spool_clear(&g->to);
        g->used = 0;
        spool_init(draft->ctx, &g->to, draft->room.beside, room_spool_limit(&draft->room, 3));
        status = gather_by_buckets(g);
    }
    lookup_close(&g->lookup);
    if (status == STATUS_OK)
        status = flush(g);
    if (status == STATUS_OK)
        status = spool_seal(&g->to, result);
    if (status == STATUS_OK) {
        spool_clear(spool);
        spool_jumps(&g->to);
        *spool = g->to;
        memset(&g->to, 0, sizeof g->to);
    }
    spool_clear(&g->to);
    return status;
}

enum status draft_gather(struct draft *draft, const struct spool *id_spool, const uint32_t *ids,
                         uint64_t next_count, uint64_t base_count, const struct spool *copy_spool,
                         const uint32_t *copy_of)
{
    struct context *ctx = draft->ctx;
    struct gathering *g;
    enum status status = memory_take_zeroed(ctx, 1, sizeof *g, &g);
    if (status != STATUS_OK)
        return status;
    g->draft = draft;
    g->id_spool = id_spool;
    g->ids = ids;
    g->next_count = next_count;
    g->base_count = base_count;
    g->copy_of = copy_of;
    if (copy_of)
        status =
            visits_begin(&draft->room, &g->copy_visits, copy_spool, room_left(&draft->room) / 8);
    void *data;
    g->finds_box = !draft->has_box;
    g->box = empty_box();
    if (status == STATUS_OK)
        status = gather_array(g, &draft->position_spool, draft->positions,
                              draft_position_size(draft), &data);
    if (status == STATUS_OK)
        draft->positions = data;
    if (status == STATUS_OK && g->finds_box) {
        memcpy(draft->box_low, g->box.low, sizeof g->box.low);
        memcpy(draft->box_high, g->box.high, sizeof g->box.high);
    }
    draft->has_box = status == STATUS_OK;
    g->finds_box = false;
    if (status == STATUS_OK && draft->records) {
        status = gather_array(g, &draft->record_spool, draft->records, draft->record_size, &data);
        if (status == STATUS_OK)
            draft->records = data;
    }
    visits_end(&g->copy_visits);
    memory_release(ctx, &g, 1, sizeof *g);
    return status;
}

/* ---- corners ---- */

static enum status map_by_buckets(struct draft *draft, struct lookup *lookup, uint64_t first)
{
    enum status status = lookup_ask_begin(lookup);
    for (uint64_t c = first; c < 3 * draft->face_count && status == STATUS_OK; c++) {
        status = lookup_ask(lookup, draft->faces[c]);
        if (c % FORGET_EVERY == 0)
            spool_pass(&draft->face_spool, c * 4);
    }
    if (status == STATUS_OK)
        status = lookup_answer(lookup);
    for (uint64_t c = first; c < 3 * draft->face_count && status == STATUS_OK; c++) {
        status = lookup_next(lookup, draft->faces[c], &draft->faces[c]);
        if (c % FORGET_EVERY == 0)
            spool_pass(&draft->face_spool, c * 4);
    }
    return status;
}

enum status draft_map_corners(struct draft *draft, const struct spool *spool, const uint32_t *table,
                              uint64_t count)
{
    struct lookup lookup;
    uint64_t c = 0;
    enum status status = lookup_open(&draft->room, &lookup, spool, table, sizeof *table, count);
    for (; c < 3 * draft->face_count && status == STATUS_OK && !lookup_is_scattered(&lookup); c++) {
        const uint32_t *found = lookup_now(&lookup, draft->faces[c]);
        draft->faces[c] = *found;
        if (c % FORGET_EVERY == 0)
            spool_pass(&draft->face_spool, c * 4);
    }
    if (status == STATUS_OK && c < 3 * draft->face_count)
        status = map_by_buckets(draft, &lookup, c);
    lookup_close(&lookup);
    spool_forget_all(&draft->face_spool);
    return status;
}
