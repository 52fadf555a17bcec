/*
 * Telling the result of the surgery: three sweeps over the slabs, for the vertices that are left,
 * the vertices themselves, and the faces. A bit a vertex and a count a word of bits give the new
 * numbers.
 */
#include "simplify/topology_surgery.h"

#include <string.h>

#include "base/memory.h"

enum { BATCH = 4096 };

/* ---- the result ---- */

static void mark_corners(struct surgery *surgery, const uint32_t *faces, size_t count)
{
    const uint64_t vertices = store_info(surgery->store)->topology.vertices;
    for (size_t i = 0; i < 3 * count; i++)
        if (faces[i] < vertices)
            bit_set(surgery->used, faces[i]);
}

static void mark_used(struct surgery *surgery, const struct slab *slab)
{
    for (uint32_t f = 0; f < slab->face_count; f++)
        if (!bit_is_set(surgery->dropped, slab->face_first + f))
            for (unsigned k = 0; k < 3; k++)
                bit_set(surgery->used, slab->faces[3 * (size_t)f + k]);
}

struct writing {
    struct surgery *surgery;
    const struct surgery_sink *sink;
    struct ranked_bits used;              /* the surgery's, ranked */
    uint32_t centre_first, centre_number; /* the first centre's number before and now */
    double positions[3 * BATCH];
    unsigned char *records; /* BATCH */
    uint32_t faces[3 * BATCH];
};

static uint32_t new_number(const struct writing *writing, uint32_t vertex)
{
    if (vertex >= writing->centre_first)
        return writing->centre_number + (vertex - writing->centre_first);
    return rank_of(&writing->used, vertex);
}

static enum status write_slab_vertices(struct writing *writing, const struct slab *slab)
{
    const struct store_info *info = store_info(writing->surgery->store);
    size_t stride = info->attributes.stride, count = 0;
    enum status status = STATUS_OK;
    for (uint32_t v = slab->vertex_first; v < slab->vertex_end && status == STATUS_OK; v++) {
        if (!bit_is_set(writing->surgery->used, v))
            continue;
        size_t own = v - slab->vertex_first;
        for (unsigned c = 0; c < 3; c++)
            writing->positions[3 * count + c] =
                info->origin[c] + (double)slab->positions[3 * own + c];
        if (stride)
            memcpy(writing->records + count * stride, slab->records + own * stride, stride);
        if (++count == BATCH) {
            status = writing->sink->add_vertices(writing->sink->user, count, writing->positions,
                                                 writing->records);
            count = 0;
        }
    }
    if (status == STATUS_OK && count > 0)
        status = writing->sink->add_vertices(writing->sink->user, count, writing->positions,
                                             writing->records);
    return status;
}

static enum status write_centres(struct writing *writing)
{
    struct surgery *surgery = writing->surgery;
    const struct store_info *info = store_info(surgery->store);
    enum status status = STATUS_OK;
    for (size_t i = 0; i < surgery->centre_count && status == STATUS_OK; i++) {
        const struct fill_centre *centre = &surgery->centres[i];
        for (unsigned c = 0; c < 3; c++)
            writing->positions[c] = info->origin[c] + (double)centre->position[c];
        if (info->attributes.stride)
            status = store_record(surgery->store, centre->model, writing->records);
        if (status == STATUS_OK)
            status = writing->sink->add_vertices(writing->sink->user, 1, writing->positions,
                                                 writing->records);
    }
    return status;
}

/* Faces [0, count) of the list but those dropped; `dropped_from`: the number of the first one, or
 * NO_INDEX when none can be. */
static enum status write_faces(struct writing *writing, const uint32_t *faces, size_t count,
                               uint32_t dropped_from)
{
    size_t held = 0;
    enum status status = STATUS_OK;
    for (size_t f = 0; f < count && status == STATUS_OK; f++) {
        if (dropped_from != NO_INDEX && bit_is_set(writing->surgery->dropped, dropped_from + f))
            continue;
        for (unsigned k = 0; k < 3; k++)
            writing->faces[3 * held + k] = new_number(writing, faces[3 * f + k]);
        if (++held == BATCH) {
            status = writing->sink->add_faces(writing->sink->user, held, writing->faces);
            held = 0;
        }
    }
    if (status == STATUS_OK && held > 0)
        status = writing->sink->add_faces(writing->sink->user, held, writing->faces);
    return status;
}

enum sweep { SWEEP_MARK, SWEEP_VERTICES, SWEEP_FACES };

static enum status sweep_slabs(struct writing *writing, enum sweep sweep)
{
    struct surgery *surgery = writing->surgery;
    uint32_t slab_count = store_info(surgery->store)->slab_count;
    enum status status = STATUS_OK;
    for (uint32_t i = 0; i < slab_count && status == STATUS_OK; i++) {
        struct slab slab;
        status =
            step(surgery->ctx, "write", i + (uint64_t)sweep * slab_count, 3 * (uint64_t)slab_count);
        if (status == STATUS_OK)
            status = slab_open(surgery->store, i, &slab);
        if (status != STATUS_OK)
            break;
        if (sweep == SWEEP_MARK)
            mark_used(surgery, &slab);
        else if (sweep == SWEEP_VERTICES)
            status = write_slab_vertices(writing, &slab);
        else
            status = write_faces(writing, slab.faces, slab.face_count, slab.face_first);
        slab_close(&slab);
    }
    return status;
}

uint64_t surgery_faces(const struct surgery *surgery)
{
    return store_info(surgery->store)->topology.faces - surgery->dropped_count +
           surgery->mended_count + surgery->fill_count;
}

enum status surgery_write(struct surgery *surgery, const struct surgery_sink *sink)
{
    struct context *ctx = surgery->ctx;
    const struct store_info *info = store_info(surgery->store);
    size_t words = bit_words(info->topology.vertices), stride = info->attributes.stride;
    struct writing *writing;
    enum status status = memory_take(ctx, 1, sizeof *writing, &writing);
    if (status != STATUS_OK)
        return status;
    *writing = (struct writing){
        .surgery = surgery, .sink = sink, .used = {.bits = surgery->used, .words = words}};
    memset(surgery->used, 0, words * sizeof *surgery->used);
    status = sweep_slabs(writing, SWEEP_MARK);
    mark_corners(surgery, surgery->mended, surgery->mended_count);
    mark_corners(surgery, surgery->fills, surgery->fill_count);
    if (status == STATUS_OK)
        status = memory_take(ctx, words, sizeof *writing->used.below, &writing->used.below);
    if (status == STATUS_OK && stride)
        status = memory_take(ctx, BATCH, stride, &writing->records);
    if (status != STATUS_OK)
        goto done;
    const uint32_t total = ranked_bits_sum(&writing->used);
    writing->centre_first = (uint32_t)info->topology.vertices;
    writing->centre_number = total;
    status =
        sink->begin(sink->user, total + (uint64_t)surgery->centre_count, surgery_faces(surgery));
    if (status == STATUS_OK)
        status = sweep_slabs(writing, SWEEP_VERTICES);
    if (status == STATUS_OK)
        status = write_centres(writing);
    if (status == STATUS_OK)
        status = sweep_slabs(writing, SWEEP_FACES);
    if (status == STATUS_OK)
        status = write_faces(writing, surgery->mended, surgery->mended_count, NO_INDEX);
    if (status == STATUS_OK)
        status = write_faces(writing, surgery->fills, surgery->fill_count, NO_INDEX);
done:
    memory_release(ctx, &writing->used.below, words, sizeof *writing->used.below);
    memory_release(ctx, &writing->records, stride ? BATCH : 0, stride);
    memory_release(ctx, &writing, 1, sizeof *writing);
    return status;
}
