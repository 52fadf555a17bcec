/*
 * OBJ: `v x y z`, with ` r g b` from 0 to 1 behind it when there are colours (understood by many
 * programs), and `f a b c`, counted from 1.
 */
#include "mesh/export_format.h"

static enum status begin(struct exporter *exporter)
{
    (void)exporter; /* no header */
    return STATUS_OK;
}

enum { COLOUR_TEXT_MAX = 3 * (NUMBER_TEXT_MAX + 1) };

/* The fewest digits of the float32 nearest to a 255th, which is more than enough for a byte. */
static unsigned char *put_colour(const struct exporter *exporter, unsigned char *to,
                                 const unsigned char *record)
{
    for (unsigned i = 0; i < 3; i++) {
        *to++ = ' ';
        to += format_float32((char *)to, (float)record[exporter->colour[i]] / 255.0f);
    }
    return to;
}

static enum status vertices(struct exporter *exporter, size_t count, const double *positions,
                            const unsigned char *records)
{
    size_t stride = exporter->attributes.stride;
    for (size_t i = 0; i < count; i++) {
        unsigned char *to;
        enum status status = export_room(exporter, EXPORT_POSITION_MAX + COLOUR_TEXT_MAX + 3, &to);
        if (status != STATUS_OK)
            return status;
        unsigned char *at = to;
        *at++ = 'v';
        *at++ = ' ';
        at = export_put_position(exporter, at, positions + 3 * i, true);
        if (exporter->has_colours)
            at = put_colour(exporter, at, records + i * stride);
        *at++ = '\n';
        exporter->used += (size_t)(at - to);
    }
    return STATUS_OK;
}

static enum status faces(struct exporter *exporter, size_t count, const uint32_t *indices)
{
    for (size_t i = 0; i < count; i++, indices += 3) {
        unsigned char *to;
        enum status status = export_room(exporter, 64, &to);
        if (status != STATUS_OK)
            return status;
        char *at = (char *)to;
        *at++ = 'f';
        for (unsigned k = 0; k < 3; k++) {
            *at++ = ' ';
            at += format_unsigned(at, (uint64_t)indices[k] + 1);
        }
        *at++ = '\n';
        exporter->used += (size_t)(at - (char *)to);
    }
    return STATUS_OK;
}

const struct export_writer export_obj = {
    .name = "OBJ", .keeps_colours = true, .begin = begin, .vertices = vertices, .faces = faces};
