/*
 * PLY: a header, then vertices with all their attributes, then faces; binary in either byte order,
 * or text.
 */
#include "mesh/export_format.h"

#include <stdio.h>
#include <string.h>

#include "base/bytes.h"

static const char *const type_names[] = {"char", "uchar", "short", "ushort",
                                         "int",  "uint",  "float", "double"};

/* One line of the header. */
__attribute__((format(printf, 2, 3))) static enum status put_line(struct exporter *exporter,
                                                                  const char *format, ...)
{
    unsigned char *to;
    enum { LINE_MAX_LENGTH = 128 };
    enum status status = export_room(exporter, LINE_MAX_LENGTH, &to);
    if (status != STATUS_OK)
        return status;
    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf((char *)to, LINE_MAX_LENGTH, format, arguments);
    va_end(arguments);
    if (length < 0 || length >= LINE_MAX_LENGTH)
        return fail(exporter->ctx, STATUS_INTERNAL, "%s: a header line is too long",
                    exporter->path);
    exporter->used += (size_t)length;
    return STATUS_OK;
}

static enum status begin(struct exporter *exporter)
{
    const char *real = exporter->as_float32 ? "float" : "double";
    const char *format = exporter->format == EXPORT_PLY_ASCII ? "ascii"
                         : exporter->format == EXPORT_PLY_BIG ? "binary_big_endian"
                                                              : "binary_little_endian";
    enum status status = put_line(exporter, "ply\nformat %s 1.0\n", format);
    if (status == STATUS_OK)
        status =
            put_line(exporter, "element vertex %llu\n", (unsigned long long)exporter->vertex_count);
    for (unsigned axis = 0; status == STATUS_OK && axis < 3; axis++)
        status = put_line(exporter, "property %s %c\n", real, "xyz"[axis]);
    for (uint32_t i = 0; status == STATUS_OK && i < exporter->attributes.count; i++)
        status =
            put_line(exporter, "property %s %s\n", type_names[exporter->attributes.list[i].type],
                     exporter->attributes.list[i].name);
    if (status == STATUS_OK)
        status = put_line(exporter, "element face %llu\nproperty list uchar %s vertex_indices\n",
                          (unsigned long long)exporter->face_count,
                          exporter->vertex_count > (uint64_t)INT32_MAX + 1 ? "uint" : "int");
    return status == STATUS_OK ? put_line(exporter, "end_header\n") : status;
}

/* ---- vertices ---- */

/* Of little-endian bytes. */
static unsigned char *put_ordered(unsigned char *to, const unsigned char *from, uint32_t size,
                                  bool is_big)
{
    for (uint32_t b = 0; b < size; b++)
        to[b] = from[is_big ? size - 1 - b : b];
    return to + size;
}

static unsigned char *put_binary(const struct exporter *exporter, unsigned char *to,
                                 const double *position, const unsigned char *record)
{
    bool is_big = exporter->format == EXPORT_PLY_BIG;
    uint32_t size = exporter->as_float32 ? 4 : 8;
    for (unsigned k = 0; k < 3; k++, to += size) {
        unsigned char value[8];
        if (exporter->as_float32)
            store_f32(value, (float)position[k]);
        else
            store_f64(value, position[k]);
        put_ordered(to, value, size, is_big);
    }
    const struct attributes *attributes = &exporter->attributes;
    if (!is_big && exporter->is_packed) {
        if (attributes->stride > 0) /* `record` is NULL without attributes */
            memcpy(to, record, attributes->stride);
        return to + attributes->stride;
    }
    for (uint32_t i = 0; i < attributes->count; i++)
        to = put_ordered(to, record + attributes->list[i].offset,
                         scalar_size(attributes->list[i].type), is_big);
    return to;
}

static size_t put_scalar(char *to, enum scalar_type type, const unsigned char *from)
{
    switch (type) {
    case SCALAR_INT8:
        return format_signed(to, (int8_t)from[0]);
    case SCALAR_UINT8:
        return format_unsigned(to, from[0]);
    case SCALAR_INT16:
        return format_signed(to, (int16_t)load_u16(from));
    case SCALAR_UINT16:
        return format_unsigned(to, load_u16(from));
    case SCALAR_INT32:
        return format_signed(to, (int32_t)load_u32(from));
    case SCALAR_UINT32:
        return format_unsigned(to, load_u32(from));
    case SCALAR_FLOAT32:
        return format_float32(to, load_f32(from));
    case SCALAR_FLOAT64:
        break;
    }
    return format_double(to, load_f64(from), false);
}

static unsigned char *put_text(const struct exporter *exporter, unsigned char *to,
                               const double *position, const unsigned char *record)
{
    to = export_put_position(exporter, to, position, false);
    for (uint32_t i = 0; i < exporter->attributes.count; i++) {
        const struct attribute *attribute = &exporter->attributes.list[i];
        *to++ = ' ';
        to += put_scalar((char *)to, attribute->type, record + attribute->offset);
    }
    *to++ = '\n';
    return to;
}

static enum status vertices(struct exporter *exporter, size_t count, const double *positions,
                            const unsigned char *records)
{
    const size_t stride = exporter->attributes.stride;
    const unsigned char *record = records; /* NULL without attributes: never read then */
    size_t most = exporter->format == EXPORT_PLY_ASCII
                      ? EXPORT_POSITION_MAX + exporter->attributes.count * (NUMBER_TEXT_MAX + 1) + 1
                      : (3 + exporter->attributes.count) * sizeof(double);
    for (size_t i = 0; i < count; i++, positions += 3) {
        unsigned char *to;
        enum status status = export_room(exporter, most, &to);
        if (status != STATUS_OK)
            return status;
        unsigned char *stop = exporter->format == EXPORT_PLY_ASCII
                                  ? put_text(exporter, to, positions, record)
                                  : put_binary(exporter, to, positions, record);
        exporter->used += (size_t)(stop - to);
        if (stride > 0)
            record += stride;
    }
    return STATUS_OK;
}

/* ---- faces ---- */

static size_t put_face(const struct exporter *exporter, unsigned char *to, const uint32_t *face)
{
    if (exporter->format == EXPORT_PLY_ASCII) {
        char *at = (char *)to;
        *at++ = '3';
        for (unsigned k = 0; k < 3; k++) {
            *at++ = ' ';
            at += format_unsigned(at, face[k]);
        }
        *at++ = '\n';
        return (size_t)(at - (char *)to);
    }
    *to = 3;
    for (unsigned k = 0; k < 3; k++)
        store_u32(to + 1 + 4 * k,
                  exporter->format == EXPORT_PLY_BIG ? __builtin_bswap32(face[k]) : face[k]);
    return 13;
}

static enum status faces(struct exporter *exporter, size_t count, const uint32_t *indices)
{
    for (size_t i = 0; i < count; i++) {
        unsigned char *to;
        enum status status = export_room(exporter, 64, &to);
        if (status != STATUS_OK)
            return status;
        exporter->used += put_face(exporter, to, indices + 3 * i);
    }
    return STATUS_OK;
}

const struct export_writer export_ply = {.name = "PLY",
                                         .keeps_colours = true,
                                         .keeps_alpha = true,
                                         .keeps_attributes = true,
                                         .begin = begin,
                                         .vertices = vertices,
                                         .faces = faces};
