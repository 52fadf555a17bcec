/*
 * Hilbert order of what lies in no memory.
 *
 * A face's key needs its corners' cells, and its corners need numbers of vertices by which what is
 * near in space is near in number: or else whatever looks at vertices afterwards, the numbering by
 * first use above all, jumps about in files. If faces name vertices in random order, both are a
 * join of all corners with all vertices, and the one to be spared is the second.
 *
 * So vertices are put in a rough order along the curve first, by counting: a coarse grid of cells,
 * how many vertices lie in each, and the place of a vertex is the next one of its cell's. That
 * order is known, vertex by vertex, without a sort. Then (1) each corner's vertex is asked for, in
 * the bucket of the part of the vertices that it lies in (lookup.h tells of that join without a
 * sort); (2) part by part, cells and places are made of the positions and answered, and the
 * vertices go to the bucket of the range that their place lies in; (3) range by range, vertices
 * are put in their places; (4) faces take their answers and are sorted, with places for ids; (5)
 * they come out of the sort in Hilbert order and are numbered at once, in a window.
 *
 * Where faces have an order, only not a good one, the vertices that they name are near each other
 * as they are: then keys are made in a window, and only (4) and (5) are due.
 *
 * The rough order shapes no output: it only says what is near. Where it says nothing (all vertices
 * but one in one coarse cell) the last step notices, and numbers by buckets.
 *
 * Parts and ranges are as large as a cache, so that what is looked at in any order is near; as long
 * as there is room for buffers of a useful size for so many of them.
 */
#include "mesh/order_far.h"

#include <string.h>

#include "base/bucket_file.h"
#include "base/external_sort.h"
#include "base/memory.h"
#include "mesh/lookup.h"

enum {
    COARSE_BITS = 6, /* of a cell of the rough order, an axis */
    COARSE_CELLS = 1 << (3 * COARSE_BITS),
    CACHED = 1 << 20,      /* bytes that are looked at in any order */
    GOOD_BLOCK = 32 << 10, /* bytes of a bucket worth a call */
    SHORT_SHIFT = 16,      /* places within parts of 2^16 have 2 bytes */
    SWEEPS = 3, /* times that positions may come in before faces are said to jump about */
    LARGEST_VERTEX = 1024, /* bytes: place, position and attributes */
    BATCH = 1024
};

struct answer {
    uint32_t place;
    uint32_t cell_low, cell_high;
};

/* Its first 8 bytes are the key. */
struct keyed_face {
    uint32_t key_low, key_high;
    uint32_t corners[3];
};

struct far_order {
    struct draft *draft;
    const struct face_curve *curve;
    uint64_t id_count;    /* faces name vertices below it */
    uint32_t *next_place; /* a coarse cell */
    unsigned part_shift;
    size_t parts;
    struct answer *table; /* of a part */
    struct bucket_file questions;
    struct bucket_file answers;
    unsigned range_shift;
    size_t ranges;
    struct bucket_file moved; /* vertices: place within the range, position, attributes */
    struct sorter *sorter;
    struct visits visits; /* of positions, in a window */
    uint64_t most_visits;
};

/* ---- vertices along the curve, roughly ---- */

static inline bool is_used(const struct far_order *o, uint64_t id)
{
    return !o->draft->id_count || is_shared(o->draft, (uint32_t)id);
}

static inline uint64_t cell_at(const struct far_order *o, uint64_t id)
{
    double p[3];
    draft_position(o->draft, id, p);
    return curve_cell(o->curve, p);
}

static enum status count_cells(struct far_order *o)
{
    struct draft *draft = o->draft;
    enum status status = STATUS_OK;
    for (uint64_t id = 0; id < o->id_count && status == STATUS_OK; id++) {
        if (id % FORGET_EVERY == 0) {
            spool_pass(&draft->position_spool, id * draft_position_size(draft));
            status = step(draft->ctx, "import: order", id, 8 * o->id_count);
        }
        if (is_used(o, id))
            o->next_place[curve_place(o->curve, cell_at(o, id), COARSE_BITS)]++;
    }
    spool_forget_all(&draft->position_spool);
    uint32_t begin = 0;
    for (size_t cell = 0; cell < COARSE_CELLS; cell++) {
        uint32_t count = o->next_place[cell];
        o->next_place[cell] = begin;
        begin += count;
    }
    return status;
}

/* log2 of how many of `count` elements make a part. */
static unsigned cut(uint64_t count, uint64_t element_size, uint64_t left, size_t *parts)
{
    const unsigned most = part_shift_for(count, (size_t)element_size, left / 4, parts);
    unsigned shift = 0;
    while (shift < most && element_size << (shift + 1) <= CACHED)
        shift++;
    while (shift < most && (count >> shift) * GOOD_BLOCK > left / 8)
        shift++;
    *parts = (size_t)(count >> shift) + 1;
    return shift;
}

/* ---- questions and answers ---- */

static inline enum status ask(struct far_order *o, uint32_t id)
{
    const size_t part = id >> o->part_shift;
    const uint32_t within = id & (uint32_t)(((uint64_t)1 << o->part_shift) - 1);
    if (o->part_shift > SHORT_SHIFT)
        return bucket_put_sized(&o->questions, part, &within, sizeof within);
    const uint16_t brief = (uint16_t)within;
    return bucket_put_sized(&o->questions, part, &brief, sizeof brief);
}

static inline enum status take_question(struct far_order *o, size_t part, uint32_t *within)
{
    if (o->part_shift > SHORT_SHIFT)
        return bucket_take_sized(&o->questions, part, within, sizeof *within);
    uint16_t brief = 0;
    enum status status = bucket_take_sized(&o->questions, part, &brief, sizeof brief);
    *within = brief;
    return status;
}

static enum status ask_all(struct far_order *o)
{
    struct draft *draft = o->draft;
    const struct room *room = &draft->room;
    const uint64_t corners = 3 * draft->face_count;
    enum status status =
        bucket_file_open(draft->ctx, &o->questions, o->parts, o->part_shift > SHORT_SHIFT ? 4 : 2,
                         room_left(room) / 4, room->beside);
    for (uint64_t c = 0; c < corners && status == STATUS_OK; c++) {
        if (c % FORGET_EVERY == 0) {
            spool_pass(&draft->face_spool, c * 4);
            status = step(draft->ctx, "import: order", corners + c, 8 * corners);
        }
        if (status == STATUS_OK)
            status = ask(o, draft->faces[c]);
    }
    spool_forget_all(&draft->face_spool);
    return status == STATUS_OK ? bucket_file_rewind(&o->questions) : status;
}

/* A vertex on its way to its place. */
static enum status send(struct far_order *o, uint64_t id, uint32_t place)
{
    const struct draft *draft = o->draft;
    const size_t position_size = (size_t)draft_position_size(draft);
    const uint32_t within = place & (uint32_t)(((uint64_t)1 << o->range_shift) - 1);
    unsigned char vertex[LARGEST_VERTEX];
    memcpy(vertex, &within, 4);
    memcpy(vertex + 4, (const unsigned char *)draft->positions + id * position_size, position_size);
    if (draft->records)
        memcpy(vertex + 4 + position_size, draft->records + id * draft->record_size,
               draft->record_size);
    return bucket_put(&o->moved, place >> o->range_shift, vertex);
}

static enum status answer_part(struct far_order *o, size_t part)
{
    struct draft *draft = o->draft;
    const uint64_t first = (uint64_t)part << o->part_shift;
    const uint64_t size = (uint64_t)1 << o->part_shift;
    const uint64_t end = o->id_count - first < size ? o->id_count : first + size;
    const uint64_t position_size = draft_position_size(draft);
    enum status status = STATUS_OK;
    spool_expect(&draft->position_spool, first * position_size, size * position_size);
    spool_expect(&draft->record_spool, first * draft->record_size, size * draft->record_size);
    for (uint64_t id = first; id < end && status == STATUS_OK; id++) {
        if (!is_used(o, id))
            continue;
        const uint64_t cell = cell_at(o, id);
        const uint32_t place = o->next_place[curve_place(o->curve, cell, COARSE_BITS)]++;
        o->table[id - first] = (struct answer){place, (uint32_t)cell, (uint32_t)(cell >> 32)};
        status = send(o, id, place);
    }
    spool_forget(&draft->position_spool, first * position_size, size * position_size);
    spool_forget(&draft->record_spool, first * draft->record_size, size * draft->record_size);
    for (uint64_t i = bucket_records(&o->questions, part); i > 0 && status == STATUS_OK; i--) {
        uint32_t within;
        status = take_question(o, part, &within);
        if (status == STATUS_OK)
            status = bucket_put_sized(&o->answers, part, &o->table[within], sizeof(struct answer));
    }
    return status;
}

static enum status answer_all(struct far_order *o)
{
    struct draft *draft = o->draft;
    const struct room *room = &draft->room;
    const size_t vertex_size = 4 + (size_t)draft_position_size(draft) + draft->record_size;
    o->range_shift = cut(draft->vertex_count, vertex_size, room_left(room), &o->ranges);
    enum status status =
        memory_take(draft->ctx, (size_t)1 << o->part_shift, sizeof *o->table, &o->table);
    if (status == STATUS_OK)
        status = bucket_file_open(draft->ctx, &o->moved, o->ranges, vertex_size,
                                  room_left(room) / 4, room->beside);
    if (status == STATUS_OK)
        status = bucket_file_open(draft->ctx, &o->answers, o->parts, sizeof(struct answer),
                                  room_left(room) / 4, room->beside);
    for (size_t part = 0; part < o->parts && status == STATUS_OK; part++) {
        status = step(draft->ctx, "import: order", 2 * o->parts + part, 8 * o->parts);
        if (status == STATUS_OK)
            status = answer_part(o, part);
    }
    memory_release(draft->ctx, &o->table, (size_t)1 << o->part_shift, sizeof *o->table);
    bucket_file_close(&o->questions);
    if (status == STATUS_OK)
        status = bucket_file_rewind(&o->moved);
    return status == STATUS_OK ? bucket_file_rewind(&o->answers) : status;
}

/* ---- vertices in their places ---- */

struct placing {
    unsigned char *positions, *records; /* of a range */
    struct spool position_spool, record_spool;
};

static enum status place_range(struct far_order *o, struct placing *p, size_t range)
{
    const struct draft *draft = o->draft;
    const size_t position_size = (size_t)draft_position_size(draft);
    const size_t record_size = draft->record_size;
    const uint64_t count = bucket_records(&o->moved, range);
    unsigned char vertex[LARGEST_VERTEX];
    enum status status = step(draft->ctx, "import: order", 3 * o->ranges + range, 8 * o->ranges);
    for (uint64_t i = 0; i < count && status == STATUS_OK; i++) {
        uint32_t within;
        status = bucket_take(&o->moved, range, vertex);
        if (status != STATUS_OK)
            break;
        memcpy(&within, vertex, 4);
        memcpy(p->positions + within * position_size, vertex + 4, position_size);
        memcpy(p->records + within * record_size, vertex + 4 + position_size, record_size);
    }
    if (status == STATUS_OK)
        status = spool_append(&p->position_spool, p->positions, (size_t)count * position_size);
    if (status == STATUS_OK)
        status = spool_append(&p->record_spool, p->records, (size_t)count * record_size);
    return status;
}

/* The draft's vertices become those that are placed. */
static enum status take_placed(struct draft *draft, struct placing *p)
{
    void *positions, *records;
    enum status status = spool_seal(&p->position_spool, &positions);
    if (status == STATUS_OK)
        status = spool_seal(&p->record_spool, &records);
    if (status != STATUS_OK)
        return status;
    spool_jumps(&p->position_spool);
    spool_jumps(&p->record_spool);
    spool_clear(&draft->position_spool);
    spool_clear(&draft->record_spool);
    draft->position_spool = p->position_spool;
    draft->record_spool = p->record_spool;
    draft->positions = positions;
    draft->records = draft->record_size ? records : NULL;
    memset(p, 0, sizeof *p);
    return STATUS_OK;
}

static enum status place_all(struct far_order *o)
{
    struct draft *draft = o->draft;
    struct context *ctx = draft->ctx;
    const struct room *room = &draft->room;
    const size_t size = (size_t)1 << o->range_shift;
    const size_t position_size = (size_t)draft_position_size(draft);
    struct placing p = {0};
    unsigned char *positions = NULL, *records = NULL;
    spool_init(ctx, &p.position_spool, room->beside, room_spool_limit(room, 3));
    spool_init(ctx, &p.record_spool, room->beside, room_spool_limit(room, 3));
    enum status status = memory_take(ctx, size, position_size, &positions);
    if (status == STATUS_OK)
        status = memory_take(ctx, size, draft->record_size, &records);
    p.positions = positions;
    p.records = records;
    for (size_t range = 0; range < o->ranges && status == STATUS_OK; range++)
        status = place_range(o, &p, range);
    memory_release(ctx, &positions, size, position_size);
    memory_release(ctx, &records, size, draft->record_size);
    bucket_file_close(&o->moved);
    if (status == STATUS_OK)
        status = take_placed(draft, &p);
    spool_clear(&p.position_spool);
    spool_clear(&p.record_spool);
    return status;
}

/* ---- faces ---- */

static inline enum status take_answer(struct far_order *o, uint32_t id, struct answer *answer)
{
    return bucket_take_sized(&o->answers, id >> o->part_shift, answer, sizeof *answer);
}

static inline void set_key(const struct far_order *o, uint64_t f, uint64_t sum,
                           struct keyed_face *keyed)
{
    const uint64_t key = face_key(o->curve, f, sum);
    keyed->key_low = (uint32_t)key;
    keyed->key_high = (uint32_t)(key >> 32);
}

static enum status key_by_answers(struct far_order *o, uint64_t f, struct keyed_face *keyed)
{
    const uint32_t *ids = o->draft->faces + 3 * f;
    enum status status = STATUS_OK;
    uint64_t sum = 0;
    for (int k = 0; k < 3 && status == STATUS_OK; k++) {
        struct answer answer = {0};
        status = take_answer(o, ids[k], &answer);
        sum += answer.cell_low | (uint64_t)answer.cell_high << 32;
        keyed->corners[k] = answer.place;
    }
    set_key(o, f, sum, keyed);
    return status;
}

static enum status key_in_window(struct far_order *o, uint64_t f, struct keyed_face *keyed)
{
    const uint32_t *ids = o->draft->faces + 3 * f;
    uint64_t sum = 0;
    for (int k = 0; k < 3; k++) {
        visit(&o->visits, ids[k] * draft_position_size(o->draft));
        sum += cell_at(o, ids[k]);
        keyed->corners[k] = ids[k];
    }
    set_key(o, f, sum, keyed);
    return STATUS_OK;
}

/* All faces with their keys go to the sorter; or not all, if a window sees too many visits. */
static enum status add_faces(struct far_order *o,
                             enum status (*key)(struct far_order *o, uint64_t f,
                                                struct keyed_face *keyed),
                             bool *is_done)
{
    struct draft *draft = o->draft;
    struct keyed_face batch[BATCH];
    enum status status = STATUS_OK;
    uint64_t f = 0;
    while (f < draft->face_count && status == STATUS_OK && o->visits.total <= o->most_visits) {
        size_t count = 0;
        if (f % FORGET_EVERY == 0) {
            spool_pass(&draft->face_spool, f * 12);
            status = step(draft->ctx, "import: order", 4 * draft->face_count + 2 * f,
                          8 * draft->face_count);
        }
        for (; count < BATCH && f < draft->face_count && status == STATUS_OK; f++)
            status = key(o, f, &batch[count++]);
        if (status == STATUS_OK)
            status = sorter_add(o->sorter, batch, count);
    }
    spool_forget_all(&draft->face_spool);
    *is_done = f == draft->face_count;
    return status;
}

static enum status open_sorter(struct far_order *o, uint64_t memory)
{
    return sorter_open(o->draft->ctx, sizeof(struct keyed_face), 8, memory, o->draft->room.beside,
                       &o->sorter);
}

static enum status sort_by_answers(struct far_order *o)
{
    struct draft *draft = o->draft;
    bool is_done;
    o->most_visits = UINT64_MAX;
    enum status status = open_sorter(o, room_left(&draft->room) / 2);
    if (status == STATUS_OK)
        status = sorter_expect(o->sorter, draft->face_count);
    if (status == STATUS_OK)
        status = add_faces(o, key_by_answers, &is_done);
    bucket_file_close(&o->answers);
    return status;
}

static enum status sort_in_window(struct far_order *o, bool *is_done)
{
    struct draft *draft = o->draft;
    const struct room *room = &draft->room;
    struct visits *visits = &o->visits;
    *is_done = false;
    enum status status = open_sorter(o, room_left(room) / 4);
    if (status == STATUS_OK)
        status = visits_begin(room, visits, &draft->position_spool, room_left(room) / 2);
    o->most_visits = visits->most < visits->block_count
                         ? SWEEPS * visits->block_count + visits->most
                         : UINT64_MAX;
    if (status == STATUS_OK)
        status = add_faces(o, key_in_window, is_done);
    visits_end(visits);
    *visits = (struct visits){0};
    if (!*is_done)
        sorter_close(&o->sorter);
    return status;
}

/* ---- numbers ---- */

/* Sorted faces are numbered on their way into `to`; *taken false: no longer. */
static enum status number_faces(struct numbering *numbering, const struct keyed_face *faces,
                                size_t count, struct spool *to, bool *taken)
{
    uint32_t batch[3 * BATCH];
    enum status status = STATUS_OK;
    for (size_t i = 0; i < count && status == STATUS_OK;) {
        size_t used = 0, dropped;
        for (; used < BATCH && i < count; used++, i++)
            memcpy(batch + 3 * used, faces[i].corners, sizeof faces[i].corners);
        if (*taken)
            status = number_take(numbering, batch, used, to, &dropped, taken);
        if (status == STATUS_OK && !*taken)
            status = spool_append(to, batch, used * sizeof faces->corners);
    }
    return status;
}

static enum status number_sorted(struct far_order *o)
{
    struct draft *draft = o->draft;
    struct numbering *numbering = NULL;
    struct spool to;
    bool taken = true;
    uint64_t done = 0, degenerate;
    const void *faces;
    size_t count = 1;
    spool_init(draft->ctx, &to, draft->room.beside, 0);
    enum status status = number_begin(draft, draft->vertex_count, false, 0, &numbering);
    while (status == STATUS_OK) {
        status = sorter_next(o->sorter, &faces, &count);
        if (status != STATUS_OK || count == 0)
            break;
        status = number_faces(numbering, faces, count, &to, &taken);
        done += count;
        if (status == STATUS_OK)
            status = step(draft->ctx, "import: order", 6 * draft->face_count + 2 * done,
                          8 * draft->face_count);
    }
    sorter_close(&o->sorter);
    if (status == STATUS_OK)
        status = draft_adopt_faces(draft, &to);
    if (status == STATUS_OK && taken)
        status = number_finish(&numbering, draft->vertex_count);
    else if (status == STATUS_OK)
        status = number_take_back(&numbering);
    number_drop(&numbering);
    spool_clear(&to);
    if (status == STATUS_OK && !taken)
        status = draft_number(draft, draft->vertex_count, NULL, NULL, 0, &degenerate);
    return status;
}

/* ---- the whole ---- */

/* Vertices get places, faces those for ids. */
static enum status sort_with_places(struct far_order *o)
{
    struct draft *draft = o->draft;
    enum status status =
        memory_take_zeroed(draft->ctx, COARSE_CELLS, sizeof *o->next_place, &o->next_place);
    if (status == STATUS_OK)
        status = count_cells(o);
    o->part_shift = cut(o->id_count, sizeof(struct answer), room_left(&draft->room), &o->parts);
    if (status == STATUS_OK)
        status = ask_all(o);
    if (status == STATUS_OK)
        status = answer_all(o);
    memory_release(draft->ctx, &o->next_place, COARSE_CELLS, sizeof *o->next_place);
    draft->id_count = 0; /* from here on all that there are are used */
    if (status == STATUS_OK)
        status = place_all(o);
    return status == STATUS_OK ? sort_by_answers(o) : status;
}

enum status order_far(struct draft *draft, const struct face_curve *curve)
{
    struct far_order o = {.draft = draft, .curve = curve};
    bool is_sorted = false;
    enum status status = STATUS_OK;
    o.id_count = draft->id_count ? draft->id_count : draft->vertex_count;
    if (!draft->id_count && !draft_is_scattered(draft))
        status = sort_in_window(&o, &is_sorted);
    if (status == STATUS_OK && !is_sorted)
        status = sort_with_places(&o);
    spool_clear(&draft->face_spool);
    if (status == STATUS_OK)
        status = sorter_finish(o.sorter);
    if (status == STATUS_OK)
        status = number_sorted(&o);
    bucket_file_close(&o.questions);
    bucket_file_close(&o.answers);
    bucket_file_close(&o.moved);
    sorter_close(&o.sorter);
    return status;
}
