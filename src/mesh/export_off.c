/*
 * OFF: counts, vertices, faces; with colours it is COFF, which has r, g, b and alpha from 0 to 255
 * behind the positions. Where there is no alpha it is 255.
 */
#include "mesh/export_format.h"

#include <string.h>

static enum status begin(struct exporter *exporter)
{
    unsigned char *to;
    enum status status = export_room(exporter, 64, &to);
    if (status != STATUS_OK)
        return status;
    char *at = (char *)to;
    const char *keyword = exporter->has_colours ? "COFF\n" : "OFF\n";
    memcpy(at, keyword, strlen(keyword));
    at += strlen(keyword);
    at += format_unsigned(at, exporter->vertex_count);
    *at++ = ' ';
    at += format_unsigned(at, exporter->face_count);
    memcpy(at, " 0\n", 3);
    exporter->used += (size_t)(at + 3 - (char *)to);
    return STATUS_OK;
}

enum { COLOUR_TEXT_MAX = 4 * 4 };

static unsigned char *put_colour(const struct exporter *exporter, unsigned char *to,
                                 const unsigned char *record)
{
    for (unsigned i = 0; i < 4; i++) {
        *to++ = ' ';
        to += format_unsigned((char *)to,
                              i < 3 || exporter->has_alpha ? record[exporter->colour[i]] : 255u);
    }
    return to;
}

static enum status vertices(struct exporter *exporter, size_t count, const double *positions,
                            const unsigned char *records)
{
    size_t stride = exporter->attributes.stride;
    for (size_t i = 0; i < count; i++) {
        unsigned char *to;
        enum status status = export_room(exporter, EXPORT_POSITION_MAX + COLOUR_TEXT_MAX + 1, &to);
        if (status != STATUS_OK)
            return status;
        unsigned char *at = export_put_position(exporter, to, positions + 3 * i, true);
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
        *at++ = '3';
        for (unsigned k = 0; k < 3; k++) {
            *at++ = ' ';
            at += format_unsigned(at, indices[k]);
        }
        *at++ = '\n';
        exporter->used += (size_t)(at - (char *)to);
    }
    return STATUS_OK;
}

const struct export_writer export_off = {.name = "OFF",
                                         .keeps_colours = true,
                                         .keeps_alpha = true,
                                         .begin = begin,
                                         .vertices = vertices,
                                         .faces = faces};
