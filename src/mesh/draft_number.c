/*
 * Numbering by first use.
 *
 * First use in face order makes the numbers of a slab's own vertices one range, so that positions
 * can be cut with the faces, a vertex is local by one subtraction, and only the few vertices that
 * the slab shares with earlier ones need a list. The numbering is one sweep over the faces with an
 * array from old to new numbers. That array is all that is needed where it fits, and a window of it
 * where faces come in an order local in space and vertices too.
 *
 * Where neither holds, the sweep would page at random, and five sequential ones over buckets do
 * the same (number_buckets.c).
 *
 * Numbers in an order that won't be kept are not worth that. Where faces themselves come in random
 * order, which the first slab lets suspect, one sweep with a bit a vertex counts what tells of it
 * (draft_is_scattered), and ids stay ids until the faces have their order (order_far.h).
 *
 * The one sweep needs each face once, in order: so the first numbering is made of faces as the
 * reader gives them, wherever it can be, and they are never looked at without their numbers.
 */
#include "mesh/draft.h"

#include <string.h>

#include "base/memory.h"
#include "mesh/number_internal.h"

enum { RUN = 256, SWEEPS = 3 };

static inline bool has_jumped(const struct numbering *n)
{
    return n->is_futile || n->visits.total > n->most_visits;
}

/* ---- at once ---- */

static enum status begin_visits(struct numbering *n)
{
    const struct room *room = &n->draft->room;
    enum status status = visits_begin(room, &n->visits, &n->number_spool, room_left(room) / 4 * 3);
    n->most_visits = n->visits.most < n->visits.block_count
                         ? SWEEPS * n->visits.block_count + n->visits.most
                         : UINT64_MAX;
    return status;
}

static inline enum status number_vertex(struct numbering *n, uint32_t id, uint32_t *number)
{
    visit(&n->visits, (uint64_t)id * 4);
    uint32_t known = n->number_of[id];
    if (known) {
        *number = known - 1;
        number_note_use(n, known - 1);
        return STATUS_OK;
    }
    *number = n->next;
    n->number_of[id] = n->next + 1;
    return number_note_id(n, id);
}

/* Renumbers the faces in place and cuts the slabs; faces that repeat a vertex close up. Stops, and
 * !*is_done, when it has jumped about too much. */
static enum status number_at_once(struct numbering *n, bool *is_done)
{
    struct draft *draft = n->draft;
    uint32_t *faces = draft->faces;
    const uint64_t slab_mask = ((uint64_t)1 << draft->slab_shift) - 1;
    enum status status = begin_visits(n);
    uint64_t kept = 0, f = 0;
    for (; f < draft->face_count && status == STATUS_OK && !has_jumped(n); f++) {
        const uint32_t a = faces[3 * f], b = faces[3 * f + 1], c = faces[3 * f + 2];
        if (a == b || b == c || a == c)
            continue;
        if ((kept & slab_mask) == 0)
            status = number_begin_slab(n, kept, f);
        uint32_t *face = faces + 3 * kept;
        if (status == STATUS_OK)
            status = number_vertex(n, a, face);
        if (status == STATUS_OK)
            status = number_vertex(n, b, face + 1);
        if (status == STATUS_OK)
            status = number_vertex(n, c, face + 2);
        kept += status == STATUS_OK;
    }
    visits_end(&n->visits);
    n->kept = kept;
    n->read = f;
    *is_done = f == draft->face_count;
    return status;
}

/* Turns the numbers of the first faces into ids again. */
static enum status take_back(struct numbering *n)
{
    struct draft *draft = n->draft;
    void *data;
    enum status status = spool_append(&n->id_spool, n->ids, n->id_used * sizeof *n->ids);
    if (status == STATUS_OK)
        status = spool_seal(&n->id_spool, &data);
    if (status != STATUS_OK)
        return status;
    const uint32_t *id_of = data;
    struct visits visits;
    status = visits_begin(&draft->room, &visits, &n->id_spool, room_left(&draft->room) / 2);
    for (uint64_t c = 0; c < 3 * n->kept && status == STATUS_OK; c++) {
        visit(&visits, (uint64_t)draft->faces[c] * 4);
        draft->faces[c] = id_of[draft->faces[c]];
        if (c % FORGET_EVERY == 0)
            spool_pass(&draft->face_spool, c * 4);
    }
    visits_end(&visits);
    spool_clear(&n->id_spool);
    spool_init(draft->ctx, &n->id_spool, draft->room.beside, room_spool_limit(&draft->room, 4));
    n->id_used = 0;
    n->next = n->slab_first = 0;
    n->foreign_corners = 0;
    n->is_identity = true;
    memset(draft->shared, 0, draft->shared_size);
    return status;
}

/* ---- not at all ---- */

/* Faces [*read, ...) close up behind `kept` until a slab is full; its corners that earlier slabs
 * have seen are counted, and then all of them are seen. */
static void look_at_slab(struct numbering *n, uint64_t *read, uint64_t *kept)
{
    struct draft *draft = n->draft;
    uint32_t *faces = draft->faces;
    const uint64_t first = *kept, end = first + ((uint64_t)1 << draft->slab_shift);
    spool_expect(&draft->face_spool, *read * 12, (end - first) * 12);
    for (; *read < draft->face_count && *kept < end; ++*read) {
        if (*read == n->kept && n->read > n->kept) {
            *read = n->read - 1; /* what is between has been dropped already */
            continue;
        }
        const uint32_t *face = faces + 3 * *read;
        const uint32_t a = face[0], b = face[1], c = face[2];
        if (a == b || b == c || a == c)
            continue;
        n->foreign_corners +=
            (uint64_t)is_shared(draft, a) + is_shared(draft, b) + is_shared(draft, c);
        if (*kept != *read)
            memcpy(faces + 3 * *kept, (uint32_t[3]){a, b, c}, 12);
        ++*kept;
    }
    for (uint64_t corner = 3 * first; corner < 3 * *kept; corner++)
        draft->shared[faces[corner] >> 3] |= (unsigned char)(1u << (faces[corner] & 7));
    spool_forget(&draft->face_spool, first * 12, (*read - first) * 12);
}

/* What the numbering would find of the faces' order, by ids alone. If they stay, draft->shared
 * tells which are used. */
static enum status look_at_ids(struct numbering *n, bool *is_scattered)
{
    struct draft *draft = n->draft;
    uint64_t read = 0, kept = 0;
    enum status status = STATUS_OK;
    while (read < draft->face_count && status == STATUS_OK) {
        look_at_slab(n, &read, &kept);
        status = step(draft->ctx, "import: number", read, draft->face_count);
    }
    n->kept = kept;
    n->read = draft->face_count;
    draft->foreign_corners = n->foreign_corners;
    *is_scattered = draft_is_scattered(draft);
    if (status != STATUS_OK)
        return status;
    if (!*is_scattered) {
        memset(draft->shared, 0, draft->shared_size);
        n->foreign_corners = 0;
        return STATUS_OK;
    }
    draft->face_count = kept;
    draft->id_count = n->id_count;
    draft->vertex_count = 0;
    for (size_t i = 0; i < draft->shared_size; i++)
        draft->vertex_count += (uint64_t)__builtin_popcount(draft->shared[i]);
    return STATUS_OK;
}

/* ---- the whole ---- */

/* Room for the slab table of all faces, some of which may yet be dropped, and for a bit a vertex.
 */
static enum status begin_slabs(struct draft *draft, uint64_t id_count)
{
    draft_release_slabs(draft);
    uint64_t slabs =
        (draft->face_count + ((uint64_t)1 << draft->slab_shift) - 1) >> draft->slab_shift;
    enum status status = memory_take(draft->ctx, (size_t)slabs + 1, 4, &draft->vertex_first);
    if (status != STATUS_OK)
        return status;
    draft->slab_count = (uint32_t)slabs;
    status = memory_take_zeroed(draft->ctx, (size_t)(id_count / 8 + 1), 1, &draft->shared);
    if (status == STATUS_OK)
        draft->shared_size = (size_t)(id_count / 8 + 1);
    return status;
}

static enum status end_slabs(struct draft *draft, const struct numbering *n)
{
    uint64_t slabs = (n->kept + ((uint64_t)1 << draft->slab_shift) - 1) >> draft->slab_shift;
    enum status status = memory_resize(draft->ctx, &draft->vertex_first,
                                       (size_t)draft->slab_count + 1, (size_t)slabs + 1, 4);
    if (status != STATUS_OK)
        return status;
    draft->slab_count = (uint32_t)slabs;
    size_t size = (size_t)(n->next / 8 + 1);
    status = memory_resize(draft->ctx, &draft->shared, draft->shared_size, size, 1);
    if (status != STATUS_OK)
        return status;
    draft->shared_size = size;
    draft->vertex_first[slabs] = n->next;
    draft->face_count = n->kept;
    draft->vertex_count = n->next;
    draft->foreign_corners = n->foreign_corners;
    if (slabs == 1) { /* which was several while it was not known how few faces there are */
        memset(draft->shared, 0, size);
        draft->foreign_corners = 0;
    }
    return STATUS_OK;
}

/* *is_done: false if it jumps about too much. */
static enum status try_at_once(struct numbering *n, bool *is_done)
{
    struct draft *draft = n->draft;
    enum status status =
        room_scratch(&draft->room, &n->number_spool, n->id_count * 4, &n->number_of);
    if (status == STATUS_OK)
        status = number_at_once(n, is_done);
    spool_clear(&n->number_spool);
    return status == STATUS_OK && !*is_done ? take_back(n) : status;
}

static enum status open_numbering(struct draft *draft, uint64_t id_count, bool expects_order,
                                  struct numbering **out)
{
    struct numbering *n;
    *out = NULL;
    if (id_count > draft->index_limit)
        return fail(draft->ctx, STATUS_BAD_INPUT,
                    "the mesh has %llu vertices; a store holds at most %llu",
                    (unsigned long long)id_count, (unsigned long long)draft->index_limit);
    enum status status = memory_take_zeroed(draft->ctx, 1, sizeof *n, &n);
    if (status != STATUS_OK)
        return status;
    n->draft = draft;
    n->id_count = id_count;
    n->is_identity = true;
    n->expects_order = expects_order;
    spool_init(draft->ctx, &n->id_spool, draft->room.beside, room_spool_limit(&draft->room, 4));
    *out = n;
    return begin_slabs(draft, id_count);
}

void number_drop(struct numbering **numbering)
{
    struct numbering *n = *numbering;
    *numbering = NULL;
    if (!n)
        return;
    prefault_end(&n->prefault);
    visits_end(&n->visits);
    spool_clear(&n->number_spool);
    spool_clear(&n->id_spool);
    memory_release(n->draft->ctx, &n, 1, sizeof *n);
}

/* All corners have their numbers: cuts the slabs, and vertex data take the new order. */
static enum status finish(struct numbering *n, uint64_t base_count, const struct spool *copy_spool,
                          const uint32_t *copy_of)
{
    void *ids = NULL;
    enum status status = end_slabs(n->draft, n);
    n->is_identity = n->is_identity && n->next <= base_count; /* copies never are */
    if (status != STATUS_OK || n->is_identity)
        return status;
    status = spool_append(&n->id_spool, n->ids, n->id_used * sizeof *n->ids);
    if (status == STATUS_OK)
        status = spool_seal(&n->id_spool, &ids);
    if (status != STATUS_OK)
        return status;
    spool_jumps(&n->id_spool);
    return draft_gather(n->draft, &n->id_spool, ids, n->next, base_count, copy_spool, copy_of);
}

enum status draft_number(struct draft *draft, uint64_t base_count, const struct spool *copy_spool,
                         const uint32_t *copy_of, uint64_t copy_count, uint64_t *degenerate)
{
    const uint64_t face_count = draft->face_count;
    struct numbering *n;
    bool is_done = false;
    enum status status = open_numbering(draft, base_count + copy_count, false, &n);
    if (status == STATUS_OK)
        status = try_at_once(n, &is_done);
    if (status == STATUS_OK && !is_done)
        status = number_by_buckets(n);
    if (status == STATUS_OK)
        status = finish(n, base_count, copy_spool, copy_of);
    *degenerate = face_count - draft->face_count;
    number_drop(&n);
    return status;
}

enum status draft_number_first(struct draft *draft, uint64_t id_count, bool jumps,
                               uint64_t *degenerate)
{
    const uint64_t face_count = draft->face_count;
    struct numbering *n;
    bool is_done = false, is_left = false;
    enum status status = open_numbering(draft, id_count, true, &n);
    if (status == STATUS_OK && !jumps)
        status = try_at_once(n, &is_done);
    if (status == STATUS_OK && !is_done)
        status = look_at_ids(n, &is_left);
    if (status == STATUS_OK && !is_done && !is_left)
        status = number_by_buckets(n);
    if (status == STATUS_OK && !is_left)
        status = finish(n, id_count, NULL, NULL);
    *degenerate = face_count - draft->face_count;
    number_drop(&n);
    return status;
}

/* ---- faces as they come ---- */

/* A thread gets the pages of the tables, and of the neighbours that the matching will find, while
 * the one that numbers is what the others wait for: where memory is no question. */
static enum status get_pages(struct numbering *n, uint64_t expected_faces)
{
    struct draft *draft = n->draft;
    const uint64_t size = expected_faces * 3 * sizeof(uint32_t);
    uint32_t *neighbours;
    if (draft->ctx->threads < 2 || expected_faces == 0 || !room_fits(&draft->room, 4 * size))
        return STATUS_OK;
    enum status status = room_scratch(&draft->room, &draft->neighbour_spool, size, &neighbours);
    if (status != STATUS_OK)
        return status;
    prefault_add(&n->prefault, n->number_of, (size_t)n->id_count * 4);
    if (n->id_spool.memory)
        prefault_add(&n->prefault, n->id_spool.memory, n->id_spool.capacity);
    prefault_add(&n->prefault, neighbours, (size_t)size);
    prefault_begin(draft->ctx, &n->prefault);
    return STATUS_OK;
}

enum status number_begin(struct draft *draft, uint64_t id_count, bool expects_order,
                         uint64_t expected_faces, struct numbering **out)
{
    struct numbering *n;
    enum status status = open_numbering(draft, id_count, expects_order, &n);
    if (status == STATUS_OK)
        status = room_scratch(&draft->room, &n->number_spool, id_count * 4, &n->number_of);
    if (status == STATUS_OK)
        status = spool_reserve(&n->id_spool, id_count * 4);
    if (status == STATUS_OK)
        status = begin_visits(n);
    if (status == STATUS_OK && !n->visits.seen)
        status = get_pages(n, expected_faces);
    *out = n;
    return status;
}

/* As number_begin_slab, where it is not known how many slabs there will be. */
static enum status append_slab(struct numbering *n)
{
    struct draft *draft = n->draft;
    const uint64_t slab = n->kept >> draft->slab_shift;
    if (slab >= draft->slab_count) {
        const size_t count = (size_t)slab + slab / 2 + 16;
        enum status status = memory_resize(draft->ctx, &draft->vertex_first,
                                           (size_t)draft->slab_count + 1, count + 1, 4);
        if (status != STATUS_OK)
            return status;
        draft->slab_count = (uint32_t)count;
    }
    number_note_slab(n, n->kept);
    return STATUS_OK;
}

/* The faces of a run that are kept: up to RUN, so that the ids have room for all that may be new.
 * No slab ends before, and places are not counted. Whether a vertex is new can't be guessed, and is
 * not asked: what is only so for a new one is done for each, and stays or not. */
static size_t number_run(struct numbering *n, const uint32_t *faces, size_t count, uint32_t *to)
{
    uint32_t *number_of = n->number_of;
    const uint32_t slab_first = n->slab_first;
    const uint32_t first = n->next + 1;  /* numbers are plus 1 here, as in number_of */
    uint32_t *ids = n->ids + n->id_used; /* of the numbers from `first` on */
    uint32_t next = first;
    size_t kept = 0;
    for (size_t f = 0; f < count; f++, faces += 3) {
        if (faces[0] == faces[1] || faces[1] == faces[2] || faces[0] == faces[2])
            continue;
        for (unsigned k = 0; k < 3; k++) {
            const uint32_t id = faces[k], known = number_of[id], is_new = known < 1;
            const uint32_t number = known | (next & -is_new);
            number_of[id] = number;
            to[3 * kept + k] = number - 1;
            ids[next - first] = id;
            next += is_new;
            if (number <= slab_first)
                number_note_use(n, number - 1);
        }
        kept++;
    }
    n->next = next - 1;
    n->id_used += next - first;
    uint32_t differs = 0;
    for (uint32_t i = 0; i < next - first; i++)
        differs |= ids[i] ^ (first - 1 + i);
    n->is_identity &= differs == 0;
    return kept;
}

/* All faces, in runs. */
static enum status number_runs(struct numbering *n, const uint32_t *faces, size_t count,
                               struct spool *to)
{
    const uint64_t slab = (uint64_t)1 << n->draft->slab_shift;
    uint32_t batch[3 * RUN];
    enum status status = STATUS_OK;
    while (count > 0 && status == STATUS_OK) {
        const uint64_t left = slab - (n->kept & (slab - 1));
        size_t run = count < RUN ? count : RUN;
        run = left < run ? (size_t)left : run;
        if (left == slab)
            status = append_slab(n);
        if (status == STATUS_OK && n->id_used + 3 * RUN > NUMBER_ID_BATCH) {
            status = spool_append(&n->id_spool, n->ids, n->id_used * sizeof *n->ids);
            n->id_used = 0;
        }
        if (status != STATUS_OK)
            return status;
        uint32_t *place = spool_room(to, 3 * run * sizeof *batch);
        const size_t kept = number_run(n, faces, run, place ? place : batch);
        const size_t size = 3 * kept * sizeof *batch;
        if (place)
            spool_fill(to, size);
        else
            status = spool_append(to, batch, size);
        n->kept += kept;
        faces += 3 * run;
        count -= run;
    }
    return status;
}

/* The same, where places that are looked at are counted. */
static enum status number_singly(struct numbering *n, const uint32_t *faces, size_t count,
                                 struct spool *to)
{
    const uint64_t slab_mask = ((uint64_t)1 << n->draft->slab_shift) - 1;
    uint32_t batch[3 * RUN];
    enum status status = STATUS_OK;
    for (size_t f = 0; f < count && status == STATUS_OK;) {
        size_t used = 0;
        for (; f < count && used < 3 * RUN && status == STATUS_OK; f++) {
            const uint32_t *ids = faces + 3 * f;
            if (ids[0] == ids[1] || ids[1] == ids[2] || ids[0] == ids[2])
                continue;
            if ((n->kept & slab_mask) == 0)
                status = append_slab(n);
            for (int k = 0; k < 3 && status == STATUS_OK; k++)
                status = number_vertex(n, ids[k], &batch[used++]);
            n->kept++;
        }
        if (status == STATUS_OK)
            status = spool_append(to, batch, used * sizeof *batch);
    }
    return status;
}

enum status number_take(struct numbering *n, const uint32_t *faces, size_t count, struct spool *to,
                        size_t *dropped, bool *taken)
{
    const uint64_t kept_before = n->kept;
    *dropped = 0;
    *taken = !has_jumped(n);
    if (!*taken)
        return STATUS_OK;
    enum status status =
        n->visits.seen ? number_singly(n, faces, count, to) : number_runs(n, faces, count, to);
    *dropped = count - (size_t)(n->kept - kept_before);
    return status;
}

enum status number_finish(struct numbering **numbering, uint64_t base_count)
{
    struct numbering *n = *numbering;
    prefault_end(&n->prefault);
    visits_end(&n->visits);
    spool_clear(&n->number_spool);
    enum status status = finish(n, base_count, NULL, NULL);
    number_drop(numbering);
    return status;
}

uint64_t number_count(const struct numbering *numbering)
{
    return numbering->kept;
}

bool number_has_jumped(const struct numbering *numbering)
{
    return has_jumped(numbering);
}

enum status number_take_back(struct numbering **numbering)
{
    struct numbering *n = *numbering;
    prefault_end(&n->prefault);
    visits_end(&n->visits);
    spool_clear(&n->number_spool);
    enum status status = take_back(n);
    number_drop(numbering);
    return status;
}
