/*
 * Batches: the readers put vertices and corners down one after the other, the sink gets some
 * thousands at once. A vertex batch is handed over as floats when all of it is float32.
 */
#include "mesh/import_batch.h"

#include <string.h>

#include "base/memory.h"

enum { FIRST_INDICES = 4 * IMPORT_BATCH };

enum status batch_open(struct import_batch *batch, struct context *ctx,
                       const struct import_sink *sink, const char *name,
                       const struct attributes *attributes, bool is_soup,
                       uint64_t expected_vertices, uint64_t expected_faces)
{
    *batch = (struct import_batch){
        .ctx = ctx, .sink = sink, .name = name, .stride = attributes->stride, .is_float32 = true};
    enum status status = memory_take(ctx, 3 * IMPORT_BATCH, sizeof(float), &batch->floats);
    if (status == STATUS_OK)
        status = memory_take(ctx, 3 * IMPORT_BATCH, sizeof(double), &batch->doubles);
    if (status == STATUS_OK && batch->stride)
        status = memory_take_zeroed(ctx, IMPORT_BATCH, batch->stride, &batch->records);
    if (status == STATUS_OK)
        status = memory_take(ctx, IMPORT_BATCH, sizeof(uint32_t), &batch->sizes);
    if (status == STATUS_OK)
        status = memory_take(ctx, FIRST_INDICES, sizeof(uint32_t), &batch->indices);
    if (status != STATUS_OK)
        return status;
    batch->index_capacity = FIRST_INDICES;
    for (size_t i = 0; i < IMPORT_BATCH; i++)
        batch->sizes[i] = 3;
    return sink->begin(sink->user, attributes, is_soup, expected_vertices, expected_faces);
}

void batch_close(struct import_batch *batch)
{
    struct context *ctx = batch->ctx;
    if (!ctx)
        return;
    memory_release(ctx, &batch->floats, 3 * IMPORT_BATCH, sizeof(float));
    memory_release(ctx, &batch->doubles, 3 * IMPORT_BATCH, sizeof(double));
    memory_release(ctx, &batch->records, IMPORT_BATCH, batch->stride);
    memory_release(ctx, &batch->sizes, IMPORT_BATCH, sizeof(uint32_t));
    memory_release(ctx, &batch->indices, batch->index_capacity, sizeof(uint32_t));
    batch->ctx = NULL;
}

enum status batch_finish(struct import_batch *batch)
{
    enum status status = batch_deliver_vertices(batch);
    if (status == STATUS_OK)
        status = batch_deliver_faces(batch);
    if (status == STATUS_OK && batch->short_faces)
        tell(batch->ctx, MESSAGE_WARNING, "%s: %llu face%s of fewer than 3 corners left out",
             batch->name, (unsigned long long)batch->short_faces,
             batch->short_faces == 1 ? "" : "s");
    return status;
}

/* ---- vertices ---- */

static enum status deliver(struct import_batch *batch, const float *floats, const double *doubles)
{
    size_t count = batch->vertex_count;
    if (count == 0)
        return STATUS_OK;
    batch->vertex_count = 0;
    batch->is_float32 = true;
    enum status status = batch->sink->vertices(batch->sink->user, count, floats, doubles,
                                               batch->stride ? batch->records : NULL);
    batch->vertices_before += count;
    return status;
}

enum status batch_deliver_floats(struct import_batch *batch)
{
    return deliver(batch, batch->floats, NULL);
}

enum status batch_deliver_vertices(struct import_batch *batch)
{
    if (!batch->is_float32)
        return deliver(batch, NULL, batch->doubles);
    for (size_t i = 0; i < 3 * batch->vertex_count; i++)
        batch->floats[i] = (float)batch->doubles[i];
    return deliver(batch, batch->floats, NULL);
}

enum status batch_refuse_coordinate(struct import_batch *batch, unsigned axis)
{
    return fail(batch->ctx, STATUS_BAD_INPUT, "%s: vertex %llu: %c is not finite", batch->name,
                (unsigned long long)batch_vertices(batch), "xyz"[axis]);
}

/* ---- faces ---- */

enum status batch_deliver_faces(struct import_batch *batch)
{
    size_t count = batch->face_count;
    enum status status = batch_deliver_vertices(batch);
    if (count == 0 || status != STATUS_OK)
        return status;
    status = batch->sink->faces(batch->sink->user, batch->first_face, count,
                                batch->has_polygons ? batch->sizes : NULL, batch->indices);
    for (size_t i = 0; i < count && batch->has_polygons; i++)
        batch->sizes[i] = 3;
    batch->has_polygons = false;
    batch->first_face += count;
    batch->face_count = 0;
    batch->index_count = 0;
    return status;
}

enum status batch_grow_indices(struct import_batch *batch)
{
    return memory_reserve(batch->ctx, &batch->indices, &batch->index_capacity,
                          batch->index_capacity + 1, sizeof(uint32_t));
}

enum status batch_end_polygon(struct import_batch *batch, uint32_t corners)
{
    if (corners < 3) {
        /* Numbers of faces in a batch run without gaps: those before it go out first. */
        batch->index_count -= corners;
        batch->short_faces++;
        enum status status = batch_deliver_faces(batch);
        batch->first_face++;
        return status;
    }
    batch->sizes[batch->face_count++] = corners;
    batch->has_polygons |= corners != 3;
    if (batch->face_count < IMPORT_BATCH && batch->index_count < FIRST_INDICES)
        return STATUS_OK;
    return batch_deliver_faces(batch);
}

/* ---- colours ---- */

void colour_attributes(struct attributes *attributes, bool with_alpha)
{
    static const char *const names[] = {"red", "green", "blue", "alpha"};
    for (unsigned i = 0; i < (with_alpha ? 4u : 3u); i++) {
        struct attribute *attribute = &attributes->list[attributes->count++];
        *attribute = (struct attribute){.type = SCALAR_UINT8, .offset = attributes->stride};
        strcpy(attribute->name, names[i]);
        attributes->stride++;
    }
}

bool colour_byte(enum colour_scale *scale, const struct parsed_number *number, unsigned char *byte)
{
    double value = number->value;
    if (!(value >= 0 && value <= 255))
        return false;
    if (value > 1)
        *scale = COLOUR_BYTE;
    else if (*scale == COLOUR_UNKNOWN && !number->is_integer)
        *scale = COLOUR_UNIT;
    *byte = (unsigned char)(*scale == COLOUR_BYTE ? value + 0.5 : value * 255 + 0.5);
    return true;
}
