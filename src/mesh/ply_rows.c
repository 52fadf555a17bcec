/*
 * PLY rows of any kind: value by value, text or binary, with lists of any types anywhere. ASCII
 * files are read here, and binary ones of a layout that ply_fast.c does not know.
 */
#include "mesh/ply_body.h"

#include <math.h>
#include <string.h>

#include "base/bytes.h"

/* One scalar, of the type that the header says. */
struct value {
    struct parsed_number number;
    unsigned char bytes[8]; /* little-endian, as in a record */
};

static bool is_ascii(const struct ply *ply)
{
    return ply->header.format == PLY_ASCII;
}

enum status ply_ends_early(struct ply *ply)
{
    return fail(ply->ctx, STATUS_BAD_INPUT,
                "%s: the file ends within element \"%s\": %llu of %llu are there", ply->batch.name,
                ply->element->name, (unsigned long long)ply->row,
                (unsigned long long)ply->element->count);
}

/* To the next token of a text. */
static enum status next_token(struct ply *ply)
{
    if (text_skip_quickly(&ply->text))
        return STATUS_OK;
    bool more;
    enum status status = text_skip(&ply->text, &more);
    if (status == STATUS_OK && !more)
        return ply_ends_early(ply);
    return status;
}

static void begin_row(struct ply *ply, const char *item)
{
    ply->text.item = item;
    ply->text.item_number = ply->row;
}

/* ---- values ---- */

bool ply_store_scalar(enum scalar_type type, double real, unsigned char bytes[8])
{
    static const double limits[][2] = {{INT8_MIN, INT8_MAX},   {0, UINT8_MAX},
                                       {INT16_MIN, INT16_MAX}, {0, UINT16_MAX},
                                       {INT32_MIN, INT32_MAX}, {0, UINT32_MAX}};
    if (type == SCALAR_FLOAT64) {
        store_f64(bytes, real);
    } else if (type == SCALAR_FLOAT32) {
        store_f32(bytes, (float)real);
    } else {
        if (!(real >= limits[type][0] && real <= limits[type][1]) || floor(real) != real)
            return false;
        store_u32(bytes, real < 0 ? (uint32_t)(int32_t)real : (uint32_t)real);
    }
    return true;
}

static enum status read_value(struct ply *ply, const struct ply_property *property,
                              struct value *value)
{
    if (is_ascii(ply)) {
        enum status status = next_token(ply);
        if (status == STATUS_OK)
            status = text_real(&ply->text, &value->number);
        if (status == STATUS_OK &&
            !ply_store_scalar(property->type, value->number.value, value->bytes))
            return text_fail(&ply->text, "%.9g is not a value of the type of property %s",
                             value->number.value, property->name);
        return status;
    }
    uint32_t size = scalar_size(property->type);
    enum status status = ply_want(ply, size);
    if (status != STATUS_OK)
        return status;
    bool is_big = ply->header.format == PLY_BIG;
    for (uint32_t i = 0; i < size && i < sizeof value->bytes; i++)
        value->bytes[i] = ply->text.at[is_big ? size - 1 - i : i];
    value->number.value = ply_load(property->type, ply->text.at, is_big);
    ply->text.at += size;
    return STATUS_OK;
}

/* A list's size. */
static enum status read_count(struct ply *ply, const struct ply_property *property, uint32_t *count)
{
    if (is_ascii(ply)) {
        enum status status = next_token(ply);
        return status == STATUS_OK ? text_index(&ply->text, count) : status;
    }
    uint32_t size = scalar_size(property->count_type);
    enum status status = ply_want(ply, size);
    if (status != STATUS_OK)
        return status;
    double value = ply_load(property->count_type, ply->text.at, ply->header.format == PLY_BIG);
    if (value < 0)
        return fail(ply->ctx, STATUS_BAD_INPUT, "%s: %s %llu: the size of list %s is negative",
                    ply->batch.name, ply->element->name, (unsigned long long)ply->row,
                    property->name);
    ply->text.at += size;
    *count = (uint32_t)value;
    return STATUS_OK;
}

/* An index; -1, which ends a strip, only if `allows_end`. */
static enum status read_index(struct ply *ply, const struct ply_property *property, bool allows_end,
                              int64_t *index)
{
    if (is_ascii(ply)) {
        enum status status = next_token(ply);
        if (status == STATUS_OK)
            status = text_integer(&ply->text, index);
        if (status == STATUS_OK && (*index < (allows_end ? -1 : 0) || *index > UINT32_MAX))
            return text_fail(&ply->text, "%lld is not an index", (long long)*index);
        return status;
    }
    struct value value;
    enum status status = read_value(ply, property, &value);
    if (status != STATUS_OK)
        return status;
    *index = (int64_t)value.number.value;
    if (*index < (allows_end ? -1 : 0))
        return fail(ply->ctx, STATUS_BAD_INPUT, "%s: %s %llu: index %lld is negative",
                    ply->batch.name, ply->element->name, (unsigned long long)ply->row,
                    (long long)*index);
    return STATUS_OK;
}

static enum status skip_bytes(struct ply *ply, uint64_t size)
{
    while (size > 0) {
        enum status status = ply_want(ply, 1);
        if (status != STATUS_OK)
            return status;
        size_t some = text_available(&ply->text);
        some = some < size ? some : (size_t)size;
        ply->text.at += some;
        size -= some;
    }
    return STATUS_OK;
}

static enum status skip_property(struct ply *ply, const struct ply_property *property)
{
    uint32_t count = 1;
    if (property->is_list) {
        enum status status = read_count(ply, property, &count);
        if (status != STATUS_OK)
            return status;
    }
    if (!is_ascii(ply))
        return skip_bytes(ply, (uint64_t)count * scalar_size(property->type));
    for (uint32_t i = 0; i < count; i++) {
        const unsigned char *word;
        size_t length;
        enum status status = next_token(ply);
        if (status == STATUS_OK)
            status = text_word(&ply->text, &word, &length);
        if (status != STATUS_OK)
            return status;
    }
    return STATUS_OK;
}

enum status ply_skip_rows(struct ply *ply)
{
    uint64_t size;
    begin_row(ply, NULL);
    if (ply->element->property_count == 0)
        return STATUS_OK;
    if (!is_ascii(ply) && !ply->element->has_lists) {
        if (mul_overflows(ply->element->count, ply->element->row_size, &size))
            return ply_ends_early(ply);
        return skip_bytes(ply, size);
    }
    for (; ply->row < ply->element->count; ply->row++)
        for (uint32_t i = 0; i < ply->element->property_count; i++) {
            enum status status = skip_property(ply, ply_property(ply, i));
            if (status != STATUS_OK)
                return status;
        }
    return STATUS_OK;
}

/* ---- vertices ---- */

static enum status read_vertex_property(struct ply *ply, const struct ply_property *property,
                                        int role)
{
    struct import_batch *batch = &ply->batch;
    struct value value;
    if (role == PLY_DROPPED)
        return skip_property(ply, property);
    enum status status = read_value(ply, property, &value);
    if (status != STATUS_OK)
        return status;
    if (role >= PLY_FIRST_ATTRIBUTE) {
        const struct attribute *attribute = &ply->attributes.list[role - PLY_FIRST_ATTRIBUTE];
        memcpy(batch_record(batch) + attribute->offset, value.bytes, scalar_size(property->type));
        return STATUS_OK;
    }
    bool is_finite = is_ascii(ply) && property->type == SCALAR_FLOAT32
                         ? batch_set_coordinate(batch, (unsigned)role, &value.number)
                         : batch_set_exact(batch, (unsigned)role, value.number.value);
    if (!is_finite && is_ascii(ply))
        return text_fail(&ply->text, "%c is not finite", "xyz"[role]);
    return is_finite ? STATUS_OK : batch_refuse_coordinate(batch, (unsigned)role);
}

enum status ply_read_vertices(struct ply *ply, uint64_t end)
{
    for (; ply->row < end; ply->row++) {
        begin_row(ply, "vertex");
        for (uint32_t i = 0; i < ply->element->property_count; i++) {
            enum status status = read_vertex_property(ply, ply_property(ply, i), ply->role[i]);
            if (status != STATUS_OK)
                return status;
        }
        enum status status = batch_end_vertex(&ply->batch);
        if (status != STATUS_OK)
            return status;
    }
    begin_row(ply, NULL);
    return STATUS_OK;
}

/* ---- faces ---- */

static enum status read_corners(struct ply *ply, const struct ply_property *property,
                                uint32_t *corners)
{
    enum status status = read_count(ply, property, corners);
    for (uint32_t i = 0; status == STATUS_OK && i < *corners; i++) {
        uint32_t index = 0;
        if (is_ascii(ply)) {
            status = next_token(ply);
            if (status == STATUS_OK)
                status = text_index(&ply->text, &index);
        } else {
            int64_t wide = 0;
            status = read_index(ply, property, false, &wide);
            index = (uint32_t)wide;
        }
        if (status == STATUS_OK)
            status = batch_corner(&ply->batch, index);
    }
    return status;
}

enum status ply_read_faces(struct ply *ply, uint64_t end)
{
    for (; ply->row < end; ply->row++) {
        uint32_t corners = 0;
        begin_row(ply, "face");
        for (uint32_t i = 0; i < ply->element->property_count; i++) {
            const struct ply_property *property = ply_property(ply, i);
            enum status status = (int32_t)i == ply->index_list
                                     ? read_corners(ply, property, &corners)
                                     : skip_property(ply, property);
            if (status != STATUS_OK)
                return status;
        }
        enum status status = batch_end_face(&ply->batch, corners);
        if (status != STATUS_OK)
            return status;
    }
    begin_row(ply, NULL);
    return STATUS_OK;
}

/* ---- triangle strips ---- */

struct strip {
    uint32_t length; /* corners since the last end */
    uint32_t last[2];
};

/* The next corner of a strip: from the third on, each makes a triangle with the two before it,
 * every second one turned round. Triangles that repeat a corner only join strips and are left out.
 */
static enum status add_to_strip(struct ply *ply, struct strip *strip, int64_t corner)
{
    if (corner < 0) {
        strip->length = 0;
        return STATUS_OK;
    }
    uint32_t a = strip->last[0], b = strip->last[1], c = (uint32_t)corner;
    bool is_turned = strip->length % 2 == 1;
    strip->last[0] = b;
    strip->last[1] = c;
    if (strip->length++ < 2 || a == b || b == c || a == c)
        return STATUS_OK;
    struct import_batch *batch = &ply->batch;
    enum status status = batch_corner(batch, is_turned ? b : a);
    if (status == STATUS_OK)
        status = batch_corner(batch, is_turned ? a : b);
    if (status == STATUS_OK)
        status = batch_corner(batch, c);
    return status == STATUS_OK ? batch_end_face(batch, 3) : status;
}

static enum status read_strip(struct ply *ply, const struct ply_property *property)
{
    uint32_t count = 0;
    struct strip strip = {0};
    enum status status = read_count(ply, property, &count);
    for (uint32_t i = 0; status == STATUS_OK && i < count; i++) {
        int64_t corner = 0;
        status = read_index(ply, property, true, &corner);
        if (status == STATUS_OK)
            status = add_to_strip(ply, &strip, corner);
    }
    return status;
}

enum status ply_read_strips(struct ply *ply)
{
    for (; ply->row < ply->element->count; ply->row++) {
        begin_row(ply, "strip");
        for (uint32_t i = 0; i < ply->element->property_count; i++) {
            const struct ply_property *property = ply_property(ply, i);
            enum status status = (int32_t)i == ply->index_list ? read_strip(ply, property)
                                                               : skip_property(ply, property);
            if (status != STATUS_OK)
                return status;
        }
    }
    begin_row(ply, NULL);
    return STATUS_OK;
}
