/*
 * Hilbert order by one sort of small keys.
 *
 * Sorting the faces themselves moves 12 bytes each several times. Here a face is one word: the cell
 * of its centre on the Hilbert curve above, its number below, so that ties keep their order; the
 * faces are moved once, when all words are sorted. What bits the number leaves go to the cell: 14
 * an axis for a million faces, 10 for the most that there can be. Where the faces are not in memory
 * that one move would be to any place of a file, and they are sorted with their words.
 *
 * The centre is made from the corners' cells in a grid of 2^19 a side, as integers: faces with the
 * same corners in any order have the very same centre, so that of duplicates the first stays first.
 * A vertex's three cell coordinates share a word with room for sums of three. The words of all
 * vertices are a table; where it does not fit, all of this is done otherwise (order_far.h).
 */
#include "mesh/order.h"

#include <string.h>

#include "base/external_sort.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "base/radix_sort.h"
#include "mesh/order_far.h"

enum { BATCH = 1024, MOVED_PIECE = 1 << 13, MOVES_IN_FLIGHT = 8 };

/* What is sorted when faces are not in memory: its first 8 bytes are the key. */
struct keyed_face {
    uint32_t key_low, key_high;
    uint32_t corners[3];
};

struct ordering {
    struct draft *draft;
    struct face_curve curve;
    struct spool cell_spool;
    uint64_t *cells;  /* a vertex */
    bool moves_faces; /* they are sorted with their keys */
    struct sorter *sorter;
    uint64_t **keys; /* a slab in flight */
    unsigned in_flight;
};

/* ---- vertices ---- */

void face_curve_init(struct face_curve *curve, const struct frame *frame, uint64_t face_count)
{
    double extent = 0;
    *curve = (struct face_curve){.scale = 0};
    space_curve_init(&curve->curve);
    for (int i = 0; i < 3; i++) {
        curve->low[i] = frame->low[i];
        if (frame->high[i] - frame->low[i] > extent)
            extent = frame->high[i] - frame->low[i];
    }
    curve->scale = extent > 0 ? ((1 << GRID_BITS) - 1) / extent : 0;
    while ((face_count - 1) >> curve->index_bits)
        curve->index_bits++;
    const unsigned bits = (64 - curve->index_bits) / 3;
    curve->cell_bits = bits < CELL_BITS_MAX ? bits : CELL_BITS_MAX;
}

static enum status fill_cells(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct ordering *o = user;
    uint64_t first = o->draft->vertex_first[job], end = o->draft->vertex_first[job + 1];
    const uint64_t size = draft_position_size(o->draft);
    spool_expect(&o->draft->position_spool, first * size, (end - first) * size);
    for (uint64_t v = first; v < end; v++) {
        double p[3];
        draft_position(o->draft, v, p);
        o->cells[v] = curve_cell(&o->curve, p);
    }
    return STATUS_OK;
}

static enum status forget_vertices(void *user, uint64_t job)
{
    struct ordering *o = user;
    spool_forget_all(&o->draft->position_spool);
    spool_forget_all(&o->cell_spool);
    return step(o->draft->ctx, "import: order", job, 2 * (uint64_t)o->draft->slab_count);
}

/* ---- faces ---- */

static uint64_t slab_end(const struct draft *draft, uint64_t slab)
{
    uint64_t end = (slab + 1) << draft->slab_shift;
    return end < draft->face_count ? end : draft->face_count;
}

static inline uint64_t cell_sum(const struct ordering *o, uint64_t f)
{
    const uint32_t *face = o->draft->faces + 3 * f;
    return o->cells[face[0]] + o->cells[face[1]] + o->cells[face[2]];
}

/* All faces of a slab. */
static enum status make_keys(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct ordering *o = user;
    const struct draft *draft = o->draft;
    uint64_t first = job << draft->slab_shift, end = slab_end(draft, job);
    uint64_t *keys = o->keys[job % o->in_flight];
    spool_expect(&draft->face_spool, first * 12, (end - first) * 12);
    uint64_t f = first;
    for (; f + SPACE_CURVE_SIDE_BY_SIDE <= end; f += SPACE_CURVE_SIDE_BY_SIDE) {
        uint64_t sums[SPACE_CURVE_SIDE_BY_SIDE];
        for (unsigned i = 0; i < SPACE_CURVE_SIDE_BY_SIDE; i++)
            sums[i] = cell_sum(o, f + i);
        face_keys(&o->curve, f, sums, SPACE_CURVE_SIDE_BY_SIDE, keys + (f - first));
    }
    for (; f < end; f++)
        keys[f - first] = face_key(&o->curve, f, cell_sum(o, f));
    return STATUS_OK;
}

static enum status add_keys(struct ordering *o, uint64_t first, const uint64_t *keys, size_t count)
{
    if (!o->moves_faces)
        return sorter_add(o->sorter, keys, count);
    struct keyed_face batch[BATCH];
    enum status status = STATUS_OK;
    for (size_t done = 0; done < count && status == STATUS_OK;) {
        size_t size = count - done < BATCH ? count - done : BATCH;
        const uint32_t *face = o->draft->faces + 3 * (first + done);
        for (size_t i = 0; i < size; i++, face += 3) {
            uint64_t key = keys[done + i];
            batch[i] = (struct keyed_face){
                (uint32_t)key, (uint32_t)(key >> 32), {face[0], face[1], face[2]}};
        }
        status = sorter_add(o->sorter, batch, size);
        done += size;
    }
    return status;
}

static enum status finish_keys(void *user, uint64_t job)
{
    struct ordering *o = user;
    const struct draft *draft = o->draft;
    uint64_t first = job << draft->slab_shift;
    enum status status =
        add_keys(o, first, o->keys[job % o->in_flight], (size_t)(slab_end(draft, job) - first));
    draft_forget_slab(draft, job);
    if (status == STATUS_OK)
        status = step(draft->ctx, "import: order", draft->slab_count + job,
                      2 * (uint64_t)draft->slab_count);
    return status;
}

/* ---- moving ---- */

static enum status move_faces(struct ordering *o)
{
    struct draft *draft = o->draft;
    struct spool moved;
    uint32_t batch[3 * BATCH];
    const uint64_t mask = ((uint64_t)1 << o->curve.index_bits) - 1;
    spool_init(draft->ctx, &moved, draft->room.beside, room_spool_limit(&draft->room, 2));
    enum status status = sorter_finish(o->sorter);
    if (status == STATUS_OK)
        status = spool_reserve(&moved, 12 * draft->face_count);
    if (o->moves_faces)
        spool_clear(&draft->face_spool);
    while (status == STATUS_OK) {
        const void *data;
        size_t count;
        status = sorter_next(o->sorter, &data, &count);
        if (status != STATUS_OK || count == 0)
            break;
        const uint64_t *keys = data;
        const struct keyed_face *keyed = data;
        for (size_t i = 0; i < count && status == STATUS_OK;) {
            size_t used = 0;
            for (; used < sizeof batch / sizeof *batch && i < count; i++) {
                const uint32_t *face =
                    o->moves_faces ? keyed[i].corners : draft->faces + 3 * (keys[i] & mask);
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

/* ---- moving and numbering ---- */

/*
 * Where all is in memory, faces are moved in pieces by all threads, and numbered piece by piece
 * meanwhile: numbering by first use can't be divided, but need not wait either.
 */
struct moving {
    const struct ordering *o;
    struct numbering *numbering;
    struct spool moved;
    const uint64_t *keys;
    size_t count;
    uint32_t *pieces[MOVES_IN_FLIGHT];
};

static size_t piece_size(const struct moving *m, uint64_t job)
{
    const size_t left = m->count - (size_t)job * MOVED_PIECE;
    return left < MOVED_PIECE ? left : MOVED_PIECE;
}

static enum status move_piece(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct moving *m = user;
    const uint32_t *faces = m->o->draft->faces;
    const uint64_t mask = ((uint64_t)1 << m->o->curve.index_bits) - 1;
    const uint64_t *keys = m->keys + job * MOVED_PIECE;
    uint32_t *to = m->pieces[job % MOVES_IN_FLIGHT];
    for (size_t i = piece_size(m, job); i > 0; i--, to += 3)
        memcpy(to, faces + 3 * (*keys++ & mask), 3 * sizeof *to);
    return STATUS_OK;
}

static enum status number_piece(void *user, uint64_t job)
{
    struct moving *m = user;
    size_t dropped;
    bool taken;
    enum status status = number_take(m->numbering, m->pieces[job % MOVES_IN_FLIGHT],
                                     piece_size(m, job), &m->moved, &dropped, &taken);
    if (status == STATUS_OK && (!taken || dropped))
        return fail(m->o->draft->ctx, STATUS_INTERNAL, "faces in order can't be numbered");
    return status;
}

static bool can_number_moving(const struct ordering *o)
{
    const struct draft *draft = o->draft;
    return !o->moves_faces &&
           room_fits(&draft->room, 12 * draft->face_count + 8 * draft->vertex_count +
                                       MOVES_IN_FLIGHT * MOVED_PIECE * 12);
}

/* All keys are sorted and there at once. */
static enum status move_pieces(struct ordering *o, struct moving *m)
{
    struct context *ctx = o->draft->ctx;
    const void *data = NULL;
    enum status status = spool_reserve(&m->moved, 12 * o->draft->face_count);
    for (unsigned i = 0; i < MOVES_IN_FLIGHT && status == STATUS_OK; i++)
        status = memory_take(ctx, MOVED_PIECE, 12, &m->pieces[i]);
    do {
        if (status == STATUS_OK)
            status = sorter_next(o->sorter, &data, &m->count);
        m->keys = data;
        if (status == STATUS_OK)
            status = parallel_ordered(ctx, (m->count + MOVED_PIECE - 1) / MOVED_PIECE,
                                      MOVES_IN_FLIGHT, move_piece, number_piece, m);
    } while (status == STATUS_OK && m->count);
    for (unsigned i = 0; i < MOVES_IN_FLIGHT; i++)
        memory_release(ctx, &m->pieces[i], MOVED_PIECE, 12);
    return status;
}

static enum status move_and_number(struct ordering *o)
{
    struct draft *draft = o->draft;
    const uint64_t vertices = draft->vertex_count;
    struct moving m = {.o = o};
    spool_init(draft->ctx, &m.moved, draft->room.beside, room_spool_limit(&draft->room, 2));
    enum status status = sorter_finish(o->sorter);
    if (status == STATUS_OK)
        status = number_begin(draft, vertices, false, 0, &m.numbering);
    if (status == STATUS_OK)
        status = move_pieces(o, &m);
    sorter_close(&o->sorter);
    if (status == STATUS_OK) {
        spool_clear(&draft->face_spool);
        status = draft_adopt_faces(draft, &m.moved);
    }
    if (status == STATUS_OK)
        status = number_finish(&m.numbering, vertices);
    number_drop(&m.numbering);
    spool_clear(&m.moved);
    return status;
}

/* ---- the whole ---- */

uint64_t order_crossing_limit(const struct draft *draft)
{
    if (draft->slab_count <= 1 || draft->slab_shift < JUDGED_SHIFT_MIN)
        return UINT64_MAX;
    uint64_t sides = (uint64_t)CROSSING_PER_SLAB * draft->slab_count;
    return sides >> ((SLAB_SHIFT_MAX - draft->slab_shift) / 2);
}

struct crossing_count { /* one a worker */
    uint64_t *keys, *scratch;
    size_t capacity, scratch_capacity;
};

struct counting {
    struct draft *draft;
    struct crossing_count *workers;
    uint64_t *found; /* a slab in flight */
    uint64_t sum, limit;
};

/* Sides between shared vertices: the edges' ends, the lower first. */
static enum status collect_sides(struct counting *c, uint64_t slab, struct crossing_count *worker,
                                 size_t *count)
{
    const struct draft *draft = c->draft;
    const uint64_t first = slab << draft->slab_shift, end = slab_end(draft, slab);
    spool_expect(&draft->face_spool, first * 12, (end - first) * 12);
    *count = 0;
    for (uint64_t f = first; f < end; f++) {
        const uint32_t *face = draft->faces + 3 * f;
        bool shared[3];
        for (int k = 0; k < 3; k++)
            shared[k] = is_shared(draft, face[k]);
        if (shared[0] + shared[1] + shared[2] < 2)
            continue;
        enum status status = memory_reserve(draft->ctx, &worker->keys, &worker->capacity,
                                            *count + 3, sizeof *worker->keys);
        if (status != STATUS_OK)
            return status;
        for (unsigned k = 0; k < 3; k++) {
            const uint32_t a = face[k], b = face[next3(k)];
            if (shared[k] && shared[next3(k)])
                worker->keys[(*count)++] = a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
        }
    }
    return STATUS_OK;
}

/* Those that come once in the slab have their other side, if any, in another one. */
static enum status count_crossing(void *user, uint64_t job, unsigned number)
{
    struct counting *c = user;
    struct context *ctx = c->draft->ctx;
    struct crossing_count *worker = &c->workers[number];
    unsigned char *bytes;
    size_t count;
    enum status status = collect_sides(c, job, worker, &count);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &worker->scratch, &worker->scratch_capacity, count,
                                sizeof *worker->scratch);
    if (status == STATUS_OK)
        status = radix_sort(ctx, (unsigned char *)worker->keys, (unsigned char *)worker->scratch,
                            count, sizeof *worker->keys, 1, &bytes);
    if (status != STATUS_OK)
        return status;
    const uint64_t *keys = bytes == (unsigned char *)worker->keys ? worker->keys : worker->scratch;
    uint64_t found = 0;
    for (size_t i = 0, group = 0; i < count; i++) {
        if (i + 1 < count && keys[i + 1] == keys[i])
            continue;
        found += i == group;
        group = i + 1;
    }
    c->found[job % c->draft->room.in_flight] = found;
    return STATUS_OK;
}

static enum status add_crossing(void *user, uint64_t job)
{
    struct counting *c = user;
    c->sum += c->found[job % c->draft->room.in_flight];
    draft_forget_slab(c->draft, job);
    return c->sum > c->limit ? STATUS_CANCELLED : STATUS_OK; /* no failure: it ends the loop */
}

enum status order_crosses_too_much(struct draft *draft, bool *too_much)
{
    struct context *ctx = draft->ctx;
    struct counting c = {.draft = draft, .limit = order_crossing_limit(draft)};
    *too_much = false;
    if (draft->foreign_corners <= c.limit)
        return STATUS_OK;
    enum status status = memory_take_zeroed(ctx, ctx->threads, sizeof *c.workers, &c.workers);
    if (status == STATUS_OK)
        status = memory_take(ctx, draft->room.in_flight, sizeof *c.found, &c.found);
    if (status == STATUS_OK)
        status = parallel_ordered(ctx, draft->slab_count, draft->room.in_flight, count_crossing,
                                  add_crossing, &c);
    *too_much = c.sum > c.limit;
    if (status == STATUS_CANCELLED && *too_much)
        status = STATUS_OK;
    for (unsigned i = 0; c.workers && i < ctx->threads; i++) {
        struct crossing_count *worker = &c.workers[i];
        memory_release(ctx, &worker->keys, worker->capacity, sizeof *worker->keys);
        memory_release(ctx, &worker->scratch, worker->scratch_capacity, sizeof *worker->scratch);
    }
    memory_release(ctx, &c.workers, ctx->threads, sizeof *c.workers);
    memory_release(ctx, &c.found, draft->room.in_flight, sizeof *c.found);
    return status;
}

static enum status prepare(struct ordering *o)
{
    struct draft *draft = o->draft;
    o->moves_faces = draft->face_spool.map != NULL;
    enum status status =
        room_scratch(&draft->room, &o->cell_spool, draft->vertex_count * 8, &o->cells);
    if (status == STATUS_OK)
        status = memory_take_zeroed(draft->ctx, o->in_flight, sizeof *o->keys, &o->keys);
    return status;
}

/* Keys of all faces, sorted. */
static enum status sort_keys(struct ordering *o)
{
    struct draft *draft = o->draft;
    const size_t size = o->moves_faces ? sizeof(struct keyed_face) : sizeof(uint64_t);
    enum status status = STATUS_OK;
    for (unsigned i = 0; i < o->in_flight && status == STATUS_OK; i++)
        status = memory_take(draft->ctx, (size_t)1 << draft->slab_shift, 8, &o->keys[i]);
    if (status == STATUS_OK)
        status = sorter_open(draft->ctx, size, 8, room_left(&draft->room) / 2, draft->room.beside,
                             &o->sorter);
    if (status == STATUS_OK) {
        sorter_comes_ordered(o->sorter, o->curve.index_bits);
        status = sorter_expect(o->sorter, draft->face_count);
    }
    if (status == STATUS_OK)
        status = parallel_ordered(draft->ctx, draft->slab_count, o->in_flight, make_keys,
                                  finish_keys, o);
    return status;
}

static void release_keys(struct ordering *o)
{
    struct context *ctx = o->draft->ctx;
    for (unsigned i = 0; o->keys && i < o->in_flight; i++)
        memory_release(ctx, &o->keys[i], (size_t)1 << o->draft->slab_shift, 8);
    memory_release(ctx, &o->keys, o->in_flight, sizeof *o->keys);
    spool_clear(&o->cell_spool);
}

enum status order_along_curve(struct draft *draft, const struct frame *frame)
{
    struct ordering o = {.draft = draft, .in_flight = draft->room.in_flight};
    face_curve_init(&o.curve, frame, draft->face_count);
    if (draft->id_count || !draft_orders_near(draft, draft->vertex_count))
        return order_far(draft, &o.curve);
    enum status status = prepare(&o);
    if (status == STATUS_OK)
        status = parallel_ordered(draft->ctx, draft->slab_count, o.in_flight, fill_cells,
                                  forget_vertices, &o);
    if (status == STATUS_OK)
        status = sort_keys(&o);
    release_keys(&o);
    if (status == STATUS_OK && can_number_moving(&o))
        return move_and_number(&o);
    if (status == STATUS_OK)
        status = move_faces(&o);
    sorter_close(&o.sorter);
    uint64_t degenerate;
    if (status == STATUS_OK)
        status = draft_number(draft, draft->vertex_count, NULL, NULL, 0, &degenerate);
    return status;
}
