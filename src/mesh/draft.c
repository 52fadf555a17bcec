/*
 * The draft's arrays, and what a slab's worker needs to know about its vertices.
 */
#include "mesh/draft.h"

#include <string.h>

#include "base/external_sort.h"
#include "base/memory.h"

void draft_init(struct context *ctx, struct draft *draft, const char *beside, unsigned slab_shift,
                uint64_t working_memory)
{
    memset(draft, 0, sizeof *draft);
    draft->ctx = ctx;
    draft->slab_shift = slab_shift ? slab_shift : SLAB_SHIFT;
    draft->index_limit = mesh_limit;
    room_divide(ctx, &draft->room, beside, slab_shift ? slab_shift : SLAB_SHIFT_MAX,
                working_memory);
}

void draft_release_slabs(struct draft *draft)
{
    draft_drop_seams(draft);
    memory_release(draft->ctx, &draft->vertex_first, (size_t)draft->slab_count + 1, 4);
    memory_release(draft->ctx, &draft->is_plain, draft->plain_size, 1);
    memory_release(draft->ctx, &draft->shared, draft->shared_size, 1);
    draft->plain_size = 0;
    draft->slab_count = 0;
    draft->shared_size = 0;
}

enum status draft_judge_slabs(struct draft *draft)
{
    memory_release(draft->ctx, &draft->is_plain, draft->plain_size, 1);
    draft->plain_size = 0;
    enum status status = memory_take_zeroed(draft->ctx, draft->slab_count, 1, &draft->is_plain);
    if (status == STATUS_OK)
        draft->plain_size = draft->slab_count;
    return status;
}

void draft_forget_adjacency(struct draft *draft)
{
    spool_clear(&draft->neighbour_spool);
    spool_clear(&draft->mate_spool);
    draft_drop_seams(draft);
    draft->neighbours = NULL;
    draft->mates = NULL;
}

void draft_clear(struct draft *draft)
{
    if (!draft->ctx)
        return;
    draft_release_slabs(draft);
    draft_forget_adjacency(draft);
    spool_clear(&draft->face_spool);
    spool_clear(&draft->position_spool);
    spool_clear(&draft->record_spool);
    memset(draft, 0, sizeof *draft);
}

enum status draft_adopt_faces(struct draft *draft, struct spool *faces)
{
    void *data;
    enum status status = spool_seal(faces, &data);
    if (status != STATUS_OK)
        return status;
    spool_jumps(faces);
    draft->face_spool = *faces;
    memset(faces, 0, sizeof *faces);
    draft->faces = data;
    draft->face_count = draft->face_spool.size / (3 * sizeof(uint32_t));
    return STATUS_OK;
}

/* ---- residency ---- */

void draft_forget_slab(const struct draft *draft, uint64_t slab)
{
    const uint64_t faces = (uint64_t)1 << draft->slab_shift;
    spool_forget(&draft->face_spool, slab * faces * 12, faces * 12);
    spool_forget(&draft->neighbour_spool, slab * faces * 12, faces * 12);
    spool_forget(&draft->mate_spool, slab * faces, faces);
}

void draft_expect_slab(const struct draft *draft, uint64_t slab)
{
    const uint64_t faces = (uint64_t)1 << draft->slab_shift;
    spool_expect(&draft->face_spool, slab * faces * 12, faces * 12);
    spool_expect(&draft->neighbour_spool, slab * faces * 12, faces * 12);
    spool_expect(&draft->mate_spool, slab * faces, faces);
}

void draft_forget_all(const struct draft *draft)
{
    spool_forget_all(&draft->face_spool);
    spool_forget_all(&draft->neighbour_spool);
    spool_forget_all(&draft->mate_spool);
}

/* ---- dropping ---- */

/* Moves faces [from, end) down to `to`; *moved counts them, for the forgetting. */
static void move_faces(struct draft *draft, uint64_t to, uint64_t from, uint64_t end,
                       uint64_t *moved)
{
    while (from < end) {
        uint64_t count = end - from < FORGET_EVERY ? end - from : FORGET_EVERY;
        memmove(draft->faces + 3 * to, draft->faces + 3 * from, (size_t)count * 12);
        to += count;
        from += count;
        *moved += count;
        if (*moved >= FORGET_EVERY) {
            spool_forget_all(&draft->face_spool);
            spool_expect(&draft->face_spool, from * 12, SWEEP_AHEAD);
            *moved = 0;
        }
    }
}

enum status draft_drop_faces(struct draft *draft, struct sorter *sorter, uint64_t *dropped)
{
    uint64_t kept = 0, moved = 0;
    uint64_t from = 0; /* faces before `from` have been looked at */
    *dropped = 0;
    draft_forget_adjacency(draft);
    for (;;) {
        const void *data;
        size_t count;
        enum status status = sorter_next(sorter, &data, &count);
        if (status != STATUS_OK)
            return status;
        if (count == 0)
            break;
        const uint64_t *keys = data;
        for (size_t i = 0; i < count; i++) {
            if (keys[i] < from)
                continue; /* the same one again */
            move_faces(draft, kept, from, keys[i], &moved);
            kept += keys[i] - from;
            from = keys[i] + 1;
            ++*dropped;
        }
    }
    move_faces(draft, kept, from, draft->face_count, &moved);
    spool_forget_all(&draft->face_spool);
    draft->face_count -= *dropped;
    return STATUS_OK;
}

enum status count_distinct(struct sorter *sorter, uint64_t *count)
{
    enum status status = sorter_finish(sorter);
    uint64_t last = 0;
    *count = 0;
    while (status == STATUS_OK) {
        const void *data;
        size_t got;
        status = sorter_next(sorter, &data, &got);
        if (status != STATUS_OK || got == 0)
            break;
        const uint64_t *keys = data;
        for (size_t i = 0; i < got; i++) {
            *count += *count == 0 || keys[i] != last;
            last = keys[i];
        }
    }
    return status;
}

/* ---- a slab ---- */

enum { RUN = 64 }; /* corners looked at together */

/* Least significant digit first, 11 bits a digit; the digits that are all alike are skipped. */
void sort_u32(uint32_t *values, uint32_t *temp, size_t count)
{
    enum { BITS = 11, SIZE = 1 << BITS };
    if (count < 2)
        return;
    uint32_t *from = values, *to = temp;
    for (unsigned shift = 0; shift < 32; shift += BITS) {
        size_t start[SIZE] = {0};
        for (size_t i = 0; i < count; i++)
            start[from[i] >> shift & (SIZE - 1)]++;
        if (start[from[0] >> shift & (SIZE - 1)] == count)
            continue;
        size_t sum = 0;
        for (size_t d = 0; d < SIZE; d++) {
            size_t size = start[d];
            start[d] = sum;
            sum += size;
        }
        for (size_t i = 0; i < count; i++)
            to[start[from[i] >> shift & (SIZE - 1)]++] = from[i];
        uint32_t *swap = from;
        from = to;
        to = swap;
    }
    if (from != values)
        memcpy(values, from, count * sizeof *values);
}

uint32_t foreign_rank(const uint32_t *foreign, uint32_t count, uint32_t vertex)
{
    const uint32_t *base = foreign;
    while (count > 1) {
        /* A mask, as compilers make a branch of a choice, which is guessed wrong every other time.
         */
        uint32_t half = count / 2, goes_up = -(uint32_t)(base[half - 1] < vertex);
        base += half & goes_up;
        count -= half;
    }
    return (uint32_t)(base - foreign);
}

/* Appends the vertices below `first` among `count` corners. */
static enum status collect_foreign(struct slab_scope *scope, const uint32_t *corners, size_t count,
                                   size_t *found)
{
    enum status status = memory_reserve(scope->ctx, &scope->foreign, &scope->foreign_capacity,
                                        *found + count, sizeof(uint32_t));
    if (status != STATUS_OK)
        return status;
    for (size_t i = 0; i < count; i++) {
        if (corners[i] < scope->vertex_first)
            scope->foreign[(*found)++] = corners[i];
    }
    return STATUS_OK;
}

static bool any_below(const uint32_t *corners, size_t count, uint32_t first)
{
    uint32_t any = 0;
    for (size_t i = 0; i < count; i++)
        any |= corners[i] < first;
    return any;
}

enum status scope_enter(struct draft *draft, uint32_t slab, struct slab_scope *scope)
{
    scope->ctx = draft->ctx;
    uint64_t first = (uint64_t)slab << draft->slab_shift;
    uint64_t left = draft->face_count - first;
    uint64_t full = (uint64_t)1 << draft->slab_shift;
    scope->face_first = (uint32_t)first;
    scope->face_count = (uint32_t)(left < full ? left : full);
    scope->vertex_first = draft->vertex_first[slab];
    scope->own_count = draft->vertex_first[slab + 1] - scope->vertex_first;

    spool_expect(&draft->face_spool, first * 12, (uint64_t)scope->face_count * 12);

    /* Nearly all runs of corners have none, which vector instructions tell at once. */
    const uint32_t *corners = draft->faces + 3 * first;
    const size_t count = 3 * (size_t)scope->face_count;
    enum status status = STATUS_OK;
    size_t found = 0;
    for (size_t i = 0; i < count && status == STATUS_OK; i += RUN) {
        size_t run = count - i < RUN ? count - i : RUN;
        if (any_below(corners + i, run, scope->vertex_first))
            status = collect_foreign(scope, corners + i, run, &found);
    }
    if (status == STATUS_OK)
        status = memory_reserve(scope->ctx, &scope->temp, &scope->temp_capacity, found,
                                sizeof(uint32_t));
    if (status != STATUS_OK)
        return status;
    sort_u32(scope->foreign, scope->temp, found);
    uint32_t unique = 0;
    for (size_t i = 0; i < found; i++) {
        if (i == 0 || scope->foreign[i] != scope->foreign[unique - 1])
            scope->foreign[unique++] = scope->foreign[i];
    }
    scope->foreign_count = unique;
    return STATUS_OK;
}

void scope_clear(struct slab_scope *scope)
{
    if (!scope->ctx)
        return;
    memory_release(scope->ctx, &scope->foreign, scope->foreign_capacity, sizeof(uint32_t));
    memory_release(scope->ctx, &scope->temp, scope->temp_capacity, sizeof(uint32_t));
    memset(scope, 0, sizeof *scope);
}
