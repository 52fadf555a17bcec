/*
 * A store's blocks are copies of parts of the draft's arrays. A run of all stages made them in
 * order to write them to a file, which is a second copy in the system's memory, and read them back,
 * which is a third: of 10 million faces that is a tenth to a seventh of the run, most of it the
 * first touch of new pages. Where the draft is in memory its arrays simply stay there. They are
 * given back from the front while the next stage goes over them, since what that takes for itself
 * grows at the same time, and no more of them stay than let both together come to what import took
 * at its peak, or might have; the slabs behind go into the file as ever.
 */
#include "mesh/store_hold.h"

#include <string.h>

#include "base/memory.h"
#include "mesh/draft.h"
#include "mesh/slab_geometry.h"

struct held_slab {
    uint32_t vertex_first, own_count, face_count, foreign_count;
    uint32_t *foreign; /* with a float position each behind it; one block */
    bool is_done;
};

enum { FOREIGN_SIZE = 4 + 12, FACE_SIZE = 12, POSITION_SIZE = 12 };

/* ---- while the store is written ---- */

static bool is_in_memory(const struct spool *spool)
{
    return !spool->ctx || spool->fd < 0;
}

static bool can_hold(const struct draft *draft)
{
    return draft->id_count == 0 && !draft->seams && is_in_memory(&draft->face_spool) &&
           is_in_memory(&draft->neighbour_spool) && is_in_memory(&draft->mate_spool) &&
           is_in_memory(&draft->position_spool) && is_in_memory(&draft->record_spool);
}

static uint64_t slab_faces(const struct draft *draft, uint32_t slab)
{
    const uint64_t first = (uint64_t)slab << draft->slab_shift, left = draft->face_count - first;
    const uint64_t full = (uint64_t)1 << draft->slab_shift;
    return left < full ? left : full;
}

/* How many vertices and faces the first `count` slabs have, one at least. */
static void count_elements(const struct store_hold *hold, uint32_t count, size_t *vertices,
                           size_t *faces)
{
    const struct held_slab *last = &hold->slabs[count - 1];
    *vertices = (size_t)last->vertex_first + last->own_count;
    *faces = ((size_t)(count - 1) << hold->slab_shift) + last->face_count;
}

enum status store_hold_begin(struct store_hold *hold, const struct draft *draft)
{
    struct context *ctx = draft->ctx;
    const uint64_t most_bytes = hold->most_bytes, beside = hold->beside;
    const uint64_t most_in_use = hold_most_in_use(ctx, draft->vertex_count);
    store_hold_clear(hold);
    hold->most_bytes = most_bytes;
    hold->beside = beside;
    uint64_t left = most_in_use > beside ? most_in_use - beside : 0;
    left = left < most_bytes ? left : most_bytes;
    uint32_t count = 0;
    for (; can_hold(draft) && count < draft->slab_count; count++) {
        const uint64_t own = draft->vertex_first[count + 1] - draft->vertex_first[count];
        const uint64_t size = slab_faces(draft, count) * (2 * FACE_SIZE + 1) +
                              own * (POSITION_SIZE + draft->record_size);
        if (size > left)
            break;
        left -= size;
    }
    if (count == 0)
        return STATUS_OK;
    enum status status = memory_take_zeroed(ctx, count, sizeof *hold->slabs, &hold->slabs);
    if (status != STATUS_OK)
        return status;
    pthread_mutex_init(&hold->lock, NULL);
    hold->ctx = ctx;
    hold->slab_count = count;
    hold->slab_shift = draft->slab_shift;
    hold->stride = draft->record_size;
    return STATUS_OK;
}

enum status store_hold_add(struct store_hold *hold, const struct slab_scope *scope, uint32_t slab,
                           const float *foreign_positions)
{
    struct held_slab *held = &hold->slabs[slab];
    const size_t count = scope->foreign_count;
    enum status status = memory_take(hold->ctx, count, FOREIGN_SIZE, &held->foreign);
    if (status != STATUS_OK)
        return status;
    held->vertex_first = scope->vertex_first;
    held->own_count = scope->own_count;
    held->face_count = scope->face_count;
    held->foreign_count = scope->foreign_count;
    if (count) {
        memcpy(held->foreign, scope->foreign, count * sizeof *held->foreign);
        memcpy(held->foreign + count, foreign_positions, count * POSITION_SIZE);
    }
    return STATUS_OK;
}

/* The first `size` bytes of the spool; the others are released. */
static enum status take_array(struct context *ctx, struct spool *spool, size_t size,
                              struct held_array *array)
{
    if (size == 0)
        return STATUS_OK;
    enum status status = memory_resize(ctx, &spool->memory, spool->capacity, size, 1);
    if (status != STATUS_OK)
        return status;
    *array = (struct held_array){spool->memory, spool->memory, size};
    memset(spool, 0, sizeof *spool);
    return STATUS_OK;
}

/* Positions as they are stored, in place of the draft's: from the front, as they take half the
 * room. */
static void round_positions(const struct frame *frame, struct draft *draft, size_t vertices)
{
    unsigned char *to = draft->position_spool.memory;
    for (size_t v = 0; v < vertices; v++) {
        float position[3];
        frame_position(frame, draft, v, position);
        memcpy(to + POSITION_SIZE * v, position, sizeof position);
    }
}

enum status store_hold_take(struct store_hold *hold, const struct frame *frame, struct draft *draft)
{
    if (hold->slab_count == 0)
        return STATUS_OK;
    size_t vertices, faces;
    count_elements(hold, hold->slab_count, &vertices, &faces);
    struct context *ctx = hold->ctx;
    if (!draft->is_float32)
        round_positions(frame, draft, vertices);
    enum status status = take_array(ctx, &draft->face_spool, FACE_SIZE * faces, &hold->faces);
    if (status == STATUS_OK)
        status = take_array(ctx, &draft->neighbour_spool, FACE_SIZE * faces, &hold->neighbours);
    if (status == STATUS_OK)
        status = take_array(ctx, &draft->mate_spool, faces, &hold->mates);
    if (status == STATUS_OK)
        status =
            take_array(ctx, &draft->position_spool, POSITION_SIZE * vertices, &hold->positions);
    if (status == STATUS_OK)
        status = take_array(ctx, &draft->record_spool, hold->stride * vertices, &hold->records);
    return status;
}

/* ---- while it is read ---- */

void store_hold_give(const struct store_hold *hold, uint32_t index, struct slab *slab)
{
    const struct held_slab *held = &hold->slabs[index];
    const size_t face_first = (size_t)index << hold->slab_shift;
    const size_t vertex_first = held->vertex_first;
    const unsigned char *faces = hold->faces.base + FACE_SIZE * face_first;
    const unsigned char *neighbours = hold->neighbours.base + FACE_SIZE * face_first;
    const unsigned char *positions = hold->positions.base + POSITION_SIZE * vertex_first;
    *slab = (struct slab){
        .index = index,
        .face_first = (uint32_t)face_first,
        .face_count = held->face_count,
        .vertex_first = held->vertex_first,
        .vertex_end = held->vertex_first + held->own_count,
        .foreign_count = held->foreign_count,
        .faces = (const uint32_t *)(const void *)faces,
        .neighbours = (const uint32_t *)(const void *)neighbours,
        .mates = hold->mates.base + face_first,
        .positions = (const float *)(const void *)positions,
        .foreign = held->foreign,
        .foreign_positions = (const float *)(const void *)(held->foreign + held->foreign_count),
        .records = hold->stride ? hold->records.base + hold->stride * vertex_first : NULL,
    };
}

/* Gives back what of an array lies before `offset`. */
static void release_before(struct store_hold *hold, struct held_array *array, size_t offset)
{
    const size_t gone = array->rest ? (size_t)(array->rest - array->base) : offset;
    if (offset > gone)
        memory_release_front(hold->ctx, &array->rest, &array->rest_size, offset - gone);
}

void store_hold_forget(struct store_hold *hold, uint32_t slab)
{
    pthread_mutex_lock(&hold->lock);
    hold->slabs[slab].is_done = true;
    const uint32_t before = hold->done_before;
    while (hold->done_before < hold->slab_count && hold->slabs[hold->done_before].is_done)
        hold->done_before++;
    if (hold->done_before > before) {
        size_t vertices, faces;
        count_elements(hold, hold->done_before, &vertices, &faces);
        release_before(hold, &hold->faces, FACE_SIZE * faces);
        release_before(hold, &hold->neighbours, FACE_SIZE * faces);
        release_before(hold, &hold->mates, faces);
        release_before(hold, &hold->positions, POSITION_SIZE * vertices);
    }
    pthread_mutex_unlock(&hold->lock);
}

void store_hold_clear(struct store_hold *hold)
{
    struct context *ctx = hold->ctx;
    if (ctx) {
        struct held_array *arrays[] = {&hold->faces, &hold->neighbours, &hold->mates,
                                       &hold->positions, &hold->records};
        for (size_t i = 0; i < sizeof arrays / sizeof arrays[0]; i++)
            memory_release(ctx, &arrays[i]->rest, arrays[i]->rest_size, 1);
        for (uint32_t i = 0; i < hold->slab_count; i++)
            memory_release(ctx, &hold->slabs[i].foreign, hold->slabs[i].foreign_count,
                           FOREIGN_SIZE);
        memory_release(ctx, &hold->slabs, hold->slab_count, sizeof *hold->slabs);
        pthread_mutex_destroy(&hold->lock);
    }
    memset(hold, 0, sizeof *hold);
}
