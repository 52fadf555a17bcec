/*
 * Binary PLY rows of the usual layouts.
 *
 * Asking for the type of every property of every row costs more than reading the bytes. Here
 * vertex rows of fixed size, and face rows of one list of 32-bit indices with a one-byte size and
 * fixed-size properties around it, are taken from the window by loops that know where everything
 * lies: a run of triangles is copied until a size byte is not 3. Both byte orders.
 */
#include "mesh/ply_body.h"

#include <string.h>

#include "base/bytes.h"
#include "base/lanes.h"

static uint32_t load_u32_of(const unsigned char *from, bool is_big)
{
    uint32_t value = load_u32(from);
    return is_big ? __builtin_bswap32(value) : value;
}

double ply_load(enum scalar_type type, const unsigned char *from, bool is_big)
{
    switch (type) {
    case SCALAR_INT8:
        return (int8_t)from[0];
    case SCALAR_UINT8:
        return from[0];
    case SCALAR_INT16:
    case SCALAR_UINT16: {
        uint16_t value = load_u16(from);
        value = is_big ? __builtin_bswap16(value) : value;
        return type == SCALAR_INT16 ? (double)(int16_t)value : (double)value;
    }
    case SCALAR_INT32:
        return (int32_t)load_u32_of(from, is_big);
    case SCALAR_UINT32:
        return load_u32_of(from, is_big);
    case SCALAR_FLOAT32: {
        uint32_t bits = load_u32_of(from, is_big);
        float value;
        memcpy(&value, &bits, sizeof value);
        return (double)value;
    }
    case SCALAR_FLOAT64:
        break;
    }
    uint64_t bits = load_u64(from);
    bits = is_big ? __builtin_bswap64(bits) : bits;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* ---- vertices ---- */

struct move {
    uint32_t from; /* in the row */
    uint32_t to;   /* in the record */
    uint32_t size;
};

struct vertex_plan {
    bool is_big;
    bool all_float32;
    size_t row_size;
    size_t stride; /* of a record */
    uint32_t offset[3];
    enum scalar_type type[3];
    unsigned move_count;
    struct move moves[ATTRIBUTE_MAX];
};

bool ply_vertices_are_plain(const struct ply *ply)
{
    return ply->header.format != PLY_ASCII && !ply->element->has_lists;
}

static void add_move(struct vertex_plan *plan, uint32_t from, uint32_t to, uint32_t size)
{
    struct move *last = plan->move_count ? &plan->moves[plan->move_count - 1] : NULL;
    if (!plan->is_big && last && last->from + last->size == from && last->to + last->size == to)
        last->size += size;
    else
        plan->moves[plan->move_count++] = (struct move){from, to, size};
}

static void make_plan(const struct ply *ply, struct vertex_plan *plan)
{
    *plan = (struct vertex_plan){.is_big = ply->header.format == PLY_BIG,
                                 .all_float32 = true,
                                 .row_size = (size_t)ply->element->row_size,
                                 .stride = ply->batch.stride};
    uint32_t offset = 0;
    for (uint32_t i = 0; i < ply->element->property_count; i++) {
        const struct ply_property *property = ply_property(ply, i);
        int role = ply->role[i];
        if (role >= PLY_FIRST_ATTRIBUTE) {
            const struct attribute *attribute = &ply->attributes.list[role - PLY_FIRST_ATTRIBUTE];
            add_move(plan, offset, attribute->offset, scalar_size(property->type));
        } else if (role >= 0) {
            plan->offset[role] = offset;
            plan->type[role] = property->type;
            plan->all_float32 &= property->type == SCALAR_FLOAT32;
        }
        offset += scalar_size(property->type);
    }
}

static void copy_records(const struct vertex_plan *plan, const unsigned char *rows, size_t count,
                         unsigned char *records, size_t stride)
{
    for (unsigned m = 0; m < plan->move_count; m++) {
        struct move move = plan->moves[m];
        const unsigned char *from = rows + move.from;
        unsigned char *to = records + move.to;
        for (size_t i = 0; i < count; i++, from += plan->row_size, to += stride) {
            if (plan->is_big)
                for (uint32_t b = 0; b < move.size; b++)
                    to[b] = from[move.size - 1 - b];
            else
                memcpy(to, from, move.size);
        }
    }
}

/* Where some exponent is all ones, this sets the highest bit. */
static inline uint32_t exponent_carry(uint32_t bits)
{
    return (bits & 0x7fffffff) + 0x00800000;
}

/* Copies `count` float32 coordinates that lie as they are wanted; false if any is not finite. */
static bool copy_as_is(const unsigned char *restrict from, size_t count, float *restrict floats)
{
    uint32_t carry = 0;
    for (size_t i = 0; i < count; i++) {
        const uint32_t bits = load_u32(from + 4 * i);
        memcpy(floats + i, &bits, sizeof bits);
        carry |= exponent_carry(bits);
    }
    return carry < 0x80000000u;
}

/* Copies float32 coordinates; false if any is not finite. */
static bool copy_floats(const struct vertex_plan *plan, const unsigned char *rows, size_t count,
                        float *floats)
{
    if (!plan->is_big && plan->row_size == 12 && plan->offset[1] == 4 && plan->offset[2] == 8)
        return copy_as_is(rows, 3 * count, floats);
    uint32_t carry = 0;
    for (size_t i = 0; i < count; i++, rows += plan->row_size, floats += 3) {
        uint32_t bits[3];
        for (unsigned k = 0; k < 3; k++) {
            bits[k] = load_u32_of(rows + plan->offset[k], plan->is_big);
            carry |= exponent_carry(bits[k]);
        }
        memcpy(floats, bits, sizeof bits);
    }
    return carry < 0x80000000u;
}

/* The message for the first coordinate that is not finite among rows that have one. */
static enum status refuse_rows(struct ply *ply, const struct vertex_plan *plan,
                               const unsigned char *rows, size_t count)
{
    for (size_t i = 0; i < count; i++, rows += plan->row_size, ply->batch.vertex_count++)
        for (unsigned k = 0; k < 3; k++) {
            double value = ply_load(plan->type[k], rows + plan->offset[k], plan->is_big);
            if (value - value != 0)
                return batch_refuse_coordinate(&ply->batch, k);
        }
    return fail(ply->ctx, STATUS_INTERNAL, "%s: a coordinate lost its fault", ply->batch.name);
}

static enum status put_rows(struct ply *ply, const struct vertex_plan *plan,
                            const unsigned char *rows, size_t count)
{
    struct import_batch *batch = &ply->batch;
    if (plan->move_count)
        copy_records(plan, rows, count, batch_record(batch), batch->stride);
    if (plan->all_float32) {
        if (!copy_floats(plan, rows, count, batch->floats + 3 * batch->vertex_count))
            return refuse_rows(ply, plan, rows, count);
        batch->vertex_count += count;
        return batch->vertex_count == IMPORT_BATCH ? batch_deliver_floats(batch) : STATUS_OK;
    }
    for (size_t i = 0; i < count; i++, rows += plan->row_size) {
        for (unsigned k = 0; k < 3; k++)
            if (!batch_set_exact(batch, k,
                                 ply_load(plan->type[k], rows + plan->offset[k], plan->is_big)))
                return batch_refuse_coordinate(batch, k);
        enum status status = batch_end_vertex(batch);
        if (status != STATUS_OK)
            return status;
    }
    return STATUS_OK;
}

/* Positions, and behind them the records. */
static bool convert_vertices(const void *user, const unsigned char *rows, size_t count, void *made)
{
    const struct vertex_plan *plan = user;
    float *floats = made;
    copy_records(plan, rows, count, (unsigned char *)(floats + 3 * count), plan->stride);
    return copy_floats(plan, rows, count, floats);
}

static enum status take_vertices(struct ply *ply, const void *user, size_t count, void *made)
{
    (void)user;
    struct import_batch *batch = &ply->batch;
    const float *floats = made;
    enum status status =
        batch->sink->vertices(batch->sink->user, count, floats, NULL,
                              batch->stride ? (const unsigned char *)(floats + 3 * count) : NULL);
    batch->vertices_before += count;
    return status;
}

/* What can be, by several threads. */
static enum status split_vertices(struct ply *ply, const struct vertex_plan *plan)
{
    if (!plan->all_float32 || ply->batch.vertex_count > 0)
        return STATUS_OK;
    return ply_read_split(&(struct ply_split){.ply = ply,
                                              .plan = plan,
                                              .row_size = plan->row_size,
                                              .made_size = (12 + plan->stride) * IMPORT_BATCH,
                                              .convert = convert_vertices,
                                              .take = take_vertices});
}

enum status ply_read_plain_vertices(struct ply *ply)
{
    struct vertex_plan plan;
    make_plan(ply, &plan);
    enum status split_status = split_vertices(ply, &plan);
    if (split_status != STATUS_OK)
        return split_status;
    while (ply->row < ply->element->count) {
        enum status status = ply_want(ply, plan.row_size);
        if (status != STATUS_OK)
            return status;
        size_t count = text_available(&ply->text) / plan.row_size;
        size_t room = IMPORT_BATCH - ply->batch.vertex_count;
        uint64_t left = ply->element->count - ply->row;
        count = count < room ? count : room;
        count = count < left ? count : (size_t)left;
        status = put_rows(ply, &plan, ply->text.at, count);
        if (status != STATUS_OK)
            return status;
        ply->text.at += count * plan.row_size;
        ply->row += count;
    }
    /* Floats that were put down as such must go out before others are. */
    return plan.all_float32 ? batch_deliver_floats(&ply->batch) : STATUS_OK;
}

/* ---- faces ---- */

bool ply_faces_are_plain(const struct ply *ply)
{
    if (ply->header.format == PLY_ASCII || ply->index_list < 0)
        return false;
    for (uint32_t i = 0; i < ply->element->property_count; i++) {
        const struct ply_property *property = ply_property(ply, i);
        if (property->is_list &&
            ((int32_t)i != ply->index_list || scalar_size(property->count_type) != 1 ||
             (property->type != SCALAR_INT32 && property->type != SCALAR_UINT32)))
            return false;
    }
    return true;
}

struct face_plan {
    bool is_big;
    bool is_signed;
    uint8_t largest_size; /* larger ones are negative */
    size_t before, after; /* bytes of the properties before the list and behind it */
};

static void plan_faces(const struct ply *ply, struct face_plan *plan)
{
    const struct ply_property *list = ply_property(ply, (uint32_t)ply->index_list);
    *plan =
        (struct face_plan){.is_big = ply->header.format == PLY_BIG,
                           .is_signed = list->type == SCALAR_INT32,
                           .largest_size = list->count_type == SCALAR_INT8 ? INT8_MAX : UINT8_MAX};
    for (uint32_t i = 0; i < ply->element->property_count; i++) {
        size_t size = scalar_size(ply_property(ply, i)->type);
        if ((int32_t)i < ply->index_list)
            plan->before += size;
        else if ((int32_t)i > ply->index_list)
            plan->after += size;
    }
}

static enum status check_signs(struct ply *ply, const uint32_t *indices, size_t faces)
{
    uint32_t all = 0;
    for (size_t i = 0; i < 3 * faces; i++)
        all |= indices[i];
    if (all <= INT32_MAX)
        return STATUS_OK;
    size_t at = 0;
    while (indices[at] <= INT32_MAX)
        at++;
    return fail(ply->ctx, STATUS_BAD_INPUT, "%s: face %llu: index %d is negative", ply->batch.name,
                (unsigned long long)(ply->row + at / 3), (int)(int32_t)indices[at]);
}

/* As many triangles in a row as are whole in the window and fit into the batch. */
static enum status take_triangles(struct ply *ply, const struct face_plan *plan)
{
    struct import_batch *batch = &ply->batch;
    const size_t row_size = plan->before + 13 + plan->after;
    const unsigned char *row = ply->text.at + plan->before;
    size_t most = text_available(&ply->text) / row_size, faces = 0;
    size_t room = IMPORT_BATCH - batch->face_count;
    room = room < (batch->index_capacity - batch->index_count) / 3
               ? room
               : (batch->index_capacity - batch->index_count) / 3;
    most = most < room ? most : room;
    most = most < ply->element->count - ply->row ? most : (size_t)(ply->element->count - ply->row);
    uint32_t *indices = batch->indices + batch->index_count;
    for (; faces < most && row[0] == 3; faces++, row += row_size) {
        uint32_t corners[3] = {load_u32(row + 1), load_u32(row + 5), load_u32(row + 9)};
        for (unsigned k = 0; plan->is_big && k < 3; k++)
            corners[k] = __builtin_bswap32(corners[k]);
        memcpy(indices + 3 * faces, corners, sizeof corners);
    }
    enum status status = plan->is_signed ? check_signs(ply, indices, faces) : STATUS_OK;
    batch->index_count += 3 * faces;
    batch->face_count += faces;
    ply->text.at += faces * row_size;
    ply->row += faces;
    if (status == STATUS_OK && (batch->face_count == IMPORT_BATCH || (most == 0 && room == 0)))
        status = batch_deliver_faces(batch);
    return status;
}

static enum status take_polygon(struct ply *ply, const struct face_plan *plan)
{
    enum status status = ply_want(ply, plan->before + 1);
    if (status != STATUS_OK)
        return status;
    uint8_t size = ply->text.at[plan->before];
    if (size > plan->largest_size)
        return fail(ply->ctx, STATUS_BAD_INPUT, "%s: face %llu: its size is negative",
                    ply->batch.name, (unsigned long long)ply->row);
    size_t row_size = plan->before + 1 + 4 * (size_t)size + plan->after;
    status = ply_want(ply, row_size);
    const unsigned char *item = ply->text.at + plan->before + 1;
    for (uint8_t i = 0; status == STATUS_OK && i < size; i++, item += 4) {
        uint32_t index = load_u32_of(item, plan->is_big);
        if (plan->is_signed && index > INT32_MAX)
            return fail(ply->ctx, STATUS_BAD_INPUT, "%s: face %llu: index %d is negative",
                        ply->batch.name, (unsigned long long)ply->row, (int)(int32_t)index);
        status = batch_corner(&ply->batch, index);
    }
    if (status != STATUS_OK)
        return status;
    ply->text.at += row_size;
    ply->row++;
    return batch_end_face(&ply->batch, size);
}

/* Corners of triangles in a row, and the largest; false if a face is none, or if a corner has its
 * highest bit, which those that are signed must not have. Four words at a time as long as a face
 * follows, which takes the place of the fourth. */
LANES_INLINE bool copy_triangles(const struct face_plan *plan, const unsigned char *row,
                                 size_t count, uint32_t *indices, bool is_big, uint32_t *largest)
{
    const size_t row_size = plan->before + 13 + plan->after;
    int4 words = {0}, most = {0};
    uint32_t all = 0;
    unsigned differs = 0;
    *largest = 0;
    for (; count > 1 && !is_big; count--, row += row_size, indices += 3) {
        int4 corners;
        memcpy(&corners, row + 1, sizeof corners);
        memcpy(indices, &corners, sizeof corners);
        const int4 is_more = corners > most;
        most = (corners & is_more) | (most & ~is_more);
        words |= corners;
        differs |= row[0] ^ 3u;
    }
    for (; count > 0; count--, row += row_size, indices += 3)
        for (unsigned k = 0; k < 3; k++) {
            indices[k] = load_u32_of(row + 1 + 4 * k, is_big);
            all |= indices[k];
            *largest = indices[k] > *largest ? indices[k] : *largest;
            differs |= row[0] ^ 3u;
        }
    for (unsigned k = 0; k < 3; k++) {
        all |= (uint32_t)words[k];
        *largest = (uint32_t)most[k] > *largest ? (uint32_t)most[k] : *largest;
    }
    return differs == 0 && all <= INT32_MAX;
}

/* Triangles only, without the highest indices, which the reader of the stream judges: behind the
 * corners is the largest. */
static bool convert_triangles(const void *user, const unsigned char *rows, size_t count, void *made)
{
    const struct face_plan *plan = user;
    uint32_t *indices = made, *largest = indices + 3 * count;
    return plan->is_big ? copy_triangles(plan, rows + plan->before, count, indices, true, largest)
                        : copy_triangles(plan, rows + plan->before, count, indices, false, largest);
}

static enum status take_converted(struct ply *ply, const void *user, size_t count, void *made)
{
    (void)user;
    struct import_batch *batch = &ply->batch;
    const struct import_sink *sink = batch->sink;
    const uint32_t *indices = made, largest = indices[3 * count];
    enum status status =
        sink->triangles ? sink->triangles(sink->user, batch->first_face, count, indices, largest)
                        : sink->faces(sink->user, batch->first_face, count, NULL, indices);
    batch->first_face += count;
    return status;
}

/* What can be, by several threads. */
static enum status split_faces(struct ply *ply, const struct face_plan *plan)
{
    enum status status = batch_deliver_faces(&ply->batch);
    if (status != STATUS_OK)
        return status;
    return ply_read_split(&(struct ply_split){.ply = ply,
                                              .plan = plan,
                                              .row_size = plan->before + 13 + plan->after,
                                              .made_size = 12 * IMPORT_BATCH + 4,
                                              .convert = convert_triangles,
                                              .take = take_converted});
}

enum status ply_read_plain_faces(struct ply *ply)
{
    struct face_plan plan;
    plan_faces(ply, &plan);
    const size_t triangle_size = plan.before + 13 + plan.after;
    enum status split_status = split_faces(ply, &plan);
    if (split_status != STATUS_OK)
        return split_status;
    while (ply->row < ply->element->count) {
        enum status status = STATUS_OK;
        /* A short last row is no triangle; take_polygon says what is missing. */
        if (text_available(&ply->text) < triangle_size && !ply->text.is_last)
            status = text_refill(&ply->text, triangle_size);
        if (status == STATUS_OK && text_available(&ply->text) >= triangle_size)
            status = take_triangles(ply, &plan);
        if (status != STATUS_OK)
            return status;
        if (ply->row < ply->element->count &&
            (text_available(&ply->text) < triangle_size || ply->text.at[plan.before] != 3)) {
            status = take_polygon(ply, &plan);
            if (status != STATUS_OK)
                return status;
        }
    }
    return STATUS_OK;
}
