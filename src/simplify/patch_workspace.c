/*
 * The memory in which patches grow.
 *
 * A worker's share decides how many of them fit, and none of what a slab goes through is needed all
 * the time. So one block holds the slab's bytes as they are read; then, in its halves, the normals
 * and what they are smoothed from; and when they are smooth, in place of the latter, the marks of
 * vertices and what tracing wants. Only the local faces have a block of their own, as they are made
 * from the slab's bytes.
 */
#include <string.h>

#include "base/memory.h"
#include "simplify/patch_internal.h"

static void set_options(struct growth *growth, const struct patch_options *options)
{
    for (unsigned i = 0; i < 2; i++) {
        growth->bounds[i].face = (float)options->face_cosine[i];
        growth->bounds[i].patch = (float)options->patch_cosine[i];
    }
    growth->most_faces = options->most_faces;
    if (growth->most_faces == 0 || growth->most_faces > PATCH_FACES_MAX)
        growth->most_faces = PATCH_FACES_MAX;
}

/* A block that is to be large enough for what it does not keep. */
static enum status make_block(struct context *ctx, void *block, size_t *capacity, size_t needed,
                              size_t size)
{
    if (needed <= *capacity)
        return STATUS_OK;
    memory_release(ctx, block, *capacity, size);
    *capacity = 0;
    enum status status = memory_take(ctx, needed, size, block);
    if (status)
        return status;
    *capacity = needed;
    void *taken;
    memcpy(&taken, block, sizeof taken);
    memory_use_whole(taken, needed, size);
    return STATUS_OK;
}

/* Makes room for the local faces of a slab that has so many. */
static enum status reserve_faces(struct context *ctx, struct patch_workspace *space, size_t faces)
{
    return make_block(ctx, &space->faces, &space->face_capacity, slab_local_numbers(faces),
                      sizeof *space->faces);
}

/* Makes room for all else, and for the slab's bytes before that. */
static enum status reserve_room(struct context *ctx, struct patch_workspace *space, size_t faces,
                                size_t vertices, size_t slab_bytes)
{
    /* both parts on multiples of 16 */
    size_t half = NORMAL_STRIDE * sizeof(float) * (faces + BEYOND_COUNT);
    const size_t later = (sizeof(vertex_mark) + sizeof(uint32_t)) * vertices;
    if (half < later)
        half = (later + 15) / 16 * 16;
    const size_t bytes = 2 * half < slab_bytes ? slab_bytes : 2 * half;
    enum status status = make_block(ctx, &space->room, &space->room_capacity, bytes, 1);
    if (!status)
        status = memory_reserve(ctx, &space->candidates, &space->candidate_capacity,
                                bit_tree_words(faces + BEYOND_COUNT), sizeof *space->candidates);
    if (!status && !space->queue)
        status = memory_take(ctx, QUEUE_SIZE, sizeof *space->queue, &space->queue);
    if (!status && !space->ring)
        status = memory_take(ctx, 1, sizeof *space->ring, &space->ring);
    if (!status && !space->lists)
        status = memory_take(ctx, LISTS_SIZE, sizeof *space->lists, &space->lists);
    if (!status) {
        space->spare = (float *)(void *)space->room;
        space->normals = (float *)(void *)(space->room + half);
    }
    return status;
}

void patch_workspace_clear(struct context *ctx, struct patch_workspace *space)
{
    memory_release(ctx, &space->room, space->room_capacity, 1);
    memory_release(ctx, &space->faces, space->face_capacity, sizeof *space->faces);
    memory_release(ctx, &space->candidates, space->candidate_capacity, sizeof *space->candidates);
    memory_release(ctx, &space->queue, QUEUE_SIZE, sizeof *space->queue);
    memory_release(ctx, &space->ring, 1, sizeof *space->ring);
    memory_release(ctx, &space->lists, LISTS_SIZE, sizeof *space->lists);
    slab_local_clear(ctx, &space->local);
    memset(space, 0, sizeof *space);
}

/* The normals are there. */
static void begin(struct patch_workspace *space, const struct patch_options *options,
                  double area_factor)
{
    const struct slab_local *local = &space->local;
    vertex_mark *marks = (vertex_mark *)(void *)space->spare;
    memset(marks, 0xff, local->vertex_count * sizeof *marks);
    space->vertex_room = (uint32_t *)(void *)(marks + local->vertex_count);
    space->rest = space->vertex_room + local->vertex_count;
    space->rest_size = (size_t)((unsigned char *)space->normals - (unsigned char *)space->rest);
    local->faces[link_user(link_beyond(local, BEYOND_BORDER))] = ~OVER_BORDER;
    local->faces[link_user(link_beyond(local, BEYOND_SEAM))] = ~OVER_SEAM;
    space->growth = (struct growth){.faces = local->faces,
                                    .normals = space->normals,
                                    .marks = marks,
                                    .queue = space->queue,
                                    .ring = space->ring,
                                    .inside = space->lists + 4 * BOUNDARY_MAX,
                                    .face_count = local->face_count,
                                    .left = local->face_count,
                                    .area_factor = area_factor};
    set_options(&space->growth, options);
    bit_tree_init(&space->growth.candidates, space->candidates,
                  (size_t)local->face_count + BEYOND_COUNT);
}

/* All that comes after filling the local slab. */
static void begin_growth(struct context *ctx, const struct patch_options *options,
                         struct patch_workspace *space)
{
    if (options->smoothings % 2) { /* each swaps them; the normals are to be behind the spare */
        float *swap = space->normals;
        space->normals = space->spare;
        space->spare = swap;
    }
    begin(space, options,
          face_normals_fill(cpu_level(ctx), &space->local, options->smoothings, &space->normals,
                            &space->spare));
}

enum status patch_growth_begin(struct context *ctx, const struct slab *slab,
                               const struct patch_options *options, struct patch_workspace *space)
{
    const size_t own = slab->vertex_end - slab->vertex_first;
    enum status status = reserve_faces(ctx, space, slab->face_count);
    if (!status)
        status = reserve_room(ctx, space, slab->face_count, own + slab->foreign_count, 0);
    if (!status)
        status = slab_local_fill(ctx, slab, space->faces, &space->local);
    if (!status)
        begin_growth(ctx, options, space);
    return status;
}

enum status patch_growth_open(struct context *ctx, struct store *store, uint32_t index,
                              const struct patch_options *options, struct patch_workspace *space,
                              struct slab *slab)
{
    /* records are asked for to the end */
    const bool is_read = !store_info(store)->attributes.stride && !slab_is_held(store, index);
    uint32_t faces, vertices;
    const uint64_t size = slab_size(store, index, &faces, &vertices);
    memset(slab, 0, sizeof *slab);
    enum status status = reserve_faces(ctx, space, faces);
    if (!status && is_read)
        status = reserve_room(ctx, space, faces, vertices, (size_t)size);
    if (!status)
        status =
            is_read ? slab_read(store, index, space->room, slab) : slab_open(store, index, slab);
    if (!status)
        status = slab_local_fill(ctx, slab, space->faces, &space->local);
    slab_forget(store, index);
    if (!status && !is_read)
        status = reserve_room(ctx, space, faces, vertices, 0);
    if (!status)
        begin_growth(ctx, options, space);
    slab->faces = slab->neighbours = slab->foreign = NULL;
    slab->positions = slab->foreign_positions = NULL;
    slab->mates = NULL;
    return status;
}

void patch_growth_again(struct patch_workspace *space, const struct patch_options *options)
{
    for (size_t f = 0; f < space->local.face_count; f++)
        space->local.faces[FACE_STRIDE * f + FACE_USER] = 0;
    begin(space, options, space->growth.area_factor);
}
