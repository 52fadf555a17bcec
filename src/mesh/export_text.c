/*
 * The formats whose every vertex and face is a line of text, OBJ and OFF.
 *
 * OBJ: `v x y z`, with ` r g b` from 0 to 1 behind it when there are colours (understood by many
 * programs), and `f a b c`, counted from 1. OFF: counts, then `x y z` and `3 a b c`, counted from
 * 0; with colours it is COFF, which has r, g, b and alpha from 0 to 255 behind the positions, 255
 * where there is no alpha. What differs is a table; the loops are one.
 */
#include <string.h>

#include "mesh/export_format.h"

enum { COLOUR_TEXT_MAX = 4 * (NUMBER_TEXT_MAX + 1), LINE_MAX_BYTES = 64 };

struct line_form {
    char vertex_mark[3], face_mark[2]; /* what a line begins with */
    uint32_t first;                    /* number of the first vertex */
    unsigned char *(*put_colour)(const struct exporter *exporter, unsigned char *to,
                                 const unsigned char *record);
};

/* The fewest digits of the float32 nearest to a 255th, which is more than enough for a byte. */
static unsigned char *put_fractions(const struct exporter *exporter, unsigned char *to,
                                    const unsigned char *record)
{
    for (unsigned i = 0; i < 3; i++) {
        *to++ = ' ';
        to += format_float32((char *)to, (float)record[exporter->colour[i]] / 255.0f);
    }
    return to;
}

static unsigned char *put_bytes(const struct exporter *exporter, unsigned char *to,
                                const unsigned char *record)
{
    for (unsigned i = 0; i < 4; i++) {
        *to++ = ' ';
        to += format_unsigned((char *)to,
                              i < 3 || exporter->has_alpha ? record[exporter->colour[i]] : 255u);
    }
    return to;
}

static const struct line_form obj_form = {"v ", "f", 1, put_fractions};
static const struct line_form off_form = {"", "3", 0, put_bytes};

static unsigned char *put_mark(unsigned char *to, const char *mark)
{
    size_t length = strlen(mark);
    memcpy(to, mark, length);
    return to + length;
}

static enum status vertices(struct exporter *exporter, const struct line_form *form, size_t count,
                            const double *positions, const unsigned char *records)
{
    size_t stride = exporter->attributes.stride;
    for (size_t i = 0; i < count; i++) {
        unsigned char *to;
        enum status status = export_room(
            exporter, sizeof form->vertex_mark + EXPORT_POSITION_MAX + COLOUR_TEXT_MAX, &to);
        if (status != STATUS_OK)
            return status;
        unsigned char *at = put_mark(to, form->vertex_mark);
        at = export_put_position(exporter, at, positions + 3 * i, true);
        if (exporter->has_colours)
            at = form->put_colour(exporter, at, records + i * stride);
        *at++ = '\n';
        exporter->used += (size_t)(at - to);
    }
    return STATUS_OK;
}

static enum status faces(struct exporter *exporter, const struct line_form *form, size_t count,
                         const uint32_t *indices)
{
    for (size_t i = 0; i < count; i++, indices += 3) {
        unsigned char *to;
        enum status status = export_room(exporter, LINE_MAX_BYTES, &to);
        if (status != STATUS_OK)
            return status;
        unsigned char *at = put_mark(to, form->face_mark);
        for (unsigned k = 0; k < 3; k++) {
            *at++ = ' ';
            at += format_unsigned((char *)at, (uint64_t)indices[k] + form->first);
        }
        *at++ = '\n';
        exporter->used += (size_t)(at - to);
    }
    return STATUS_OK;
}

static enum status obj_begin(struct exporter *exporter)
{
    (void)exporter; /* no header */
    return STATUS_OK;
}

static enum status off_begin(struct exporter *exporter)
{
    unsigned char *to;
    enum status status = export_room(exporter, LINE_MAX_BYTES, &to);
    if (status != STATUS_OK)
        return status;
    unsigned char *at = put_mark(to, exporter->has_colours ? "COFF\n" : "OFF\n");
    at += format_unsigned((char *)at, exporter->vertex_count);
    *at++ = ' ';
    at += format_unsigned((char *)at, exporter->face_count);
    at = put_mark(at, " 0\n");
    exporter->used += (size_t)(at - to);
    return STATUS_OK;
}

static enum status obj_vertices(struct exporter *exporter, size_t count, const double *positions,
                                const unsigned char *records)
{
    return vertices(exporter, &obj_form, count, positions, records);
}

static enum status obj_faces(struct exporter *exporter, size_t count, const uint32_t *indices)
{
    return faces(exporter, &obj_form, count, indices);
}

static enum status off_vertices(struct exporter *exporter, size_t count, const double *positions,
                                const unsigned char *records)
{
    return vertices(exporter, &off_form, count, positions, records);
}

static enum status off_faces(struct exporter *exporter, size_t count, const uint32_t *indices)
{
    return faces(exporter, &off_form, count, indices);
}

const struct export_writer export_obj = {.name = "OBJ",
                                         .keeps_colours = true,
                                         .begin = obj_begin,
                                         .vertices = obj_vertices,
                                         .faces = obj_faces};
const struct export_writer export_off = {.name = "OFF",
                                         .keeps_colours = true,
                                         .keeps_alpha = true,
                                         .begin = off_begin,
                                         .vertices = off_vertices,
                                         .faces = off_faces};
