/*
 * Writing mesh files: what is the same for all formats.
 *
 * A mesh may be larger than the memory, so it is not turned into text or bytes as a whole: batches
 * come in, and a format's writer, a small table of functions (export_format.h), fills one buffer,
 * which goes to the output whenever it is full. What comes in is checked here once, so that the
 * writers' loops need not: the counts announced stand in headers already written, and wrong ones
 * would make a file that no reader takes.
 */
#include "mesh/export.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "base/memory.h"
#include "mesh/export_format.h"

enum { SPOOL_MEMORY = 64 << 20, SAVE_BATCH = 8192 };

/* ---- which format ---- */

static enum export_format format_by_name(const char *path)
{
    static const struct {
        const char *ending;
        enum export_format format;
    } endings[] = {
        {".ply", EXPORT_PLY}, {".obj", EXPORT_OBJ}, {".stl", EXPORT_STL}, {".off", EXPORT_OFF}};
    size_t length = strlen(path);
    for (unsigned i = 0; i < sizeof endings / sizeof *endings; i++)
        if (length >= 4 && strcasecmp(path + length - 4, endings[i].ending) == 0)
            return endings[i].format;
    return EXPORT_BY_NAME;
}

static const struct export_writer *writer_of(enum export_format format)
{
    switch (format) {
    case EXPORT_PLY:
    case EXPORT_PLY_ASCII:
    case EXPORT_PLY_BIG:
        return &export_ply;
    case EXPORT_OBJ:
        return &export_obj;
    case EXPORT_STL:
        return &export_stl;
    case EXPORT_OFF:
        return &export_off;
    case EXPORT_BY_NAME:
        break;
    }
    return NULL;
}

static enum status choose_writer(struct context *ctx, const char *path, enum export_format *format,
                                 const struct export_writer **writer)
{
    if (*format == EXPORT_BY_NAME)
        *format = format_by_name(path);
    *writer = writer_of(*format);
    if (*writer)
        return STATUS_OK;
    if (*format != EXPORT_BY_NAME)
        return fail(ctx, STATUS_MISUSE, "%s: there is no output format number %d", path,
                    (int)*format);
    if (strcmp(path, "-") == 0)
        return fail(ctx, STATUS_MISUSE,
                    "standard output has no ending that names a format: the format must be given");
    return fail(ctx, STATUS_MISUSE,
                "%s: the ending names no format for meshes: end the name with .ply, .obj, .stl or "
                ".off, or give the format",
                path);
}

/* ---- attributes ---- */

static bool find_colour(const struct attributes *attributes, const char *name, uint32_t *offset)
{
    for (uint32_t i = 0; i < attributes->count; i++)
        if (attributes->list[i].type == SCALAR_UINT8 &&
            strcmp(attributes->list[i].name, name) == 0) {
            *offset = attributes->list[i].offset;
            return true;
        }
    return false;
}

static void find_colours(struct exporter *exporter)
{
    const struct attributes *attributes = &exporter->attributes;
    exporter->has_colours = find_colour(attributes, "red", &exporter->colour[0]) &&
                            find_colour(attributes, "green", &exporter->colour[1]) &&
                            find_colour(attributes, "blue", &exporter->colour[2]);
    exporter->has_alpha =
        exporter->has_colours && find_colour(attributes, "alpha", &exporter->colour[3]);
}

/* A name becomes a word of a header. */
static bool is_word(const char *name)
{
    size_t length = strnlen(name, ATTRIBUTE_NAME_MAX + 1);
    for (size_t i = 0; i < length; i++)
        if ((unsigned char)name[i] <= ' ' || name[i] == 127)
            return false;
    return length > 0 && length <= ATTRIBUTE_NAME_MAX;
}

static enum status take_attributes(struct exporter *exporter, const struct attributes *attributes)
{
    if (attributes->count > ATTRIBUTE_MAX)
        return fail(exporter->ctx, STATUS_INTERNAL,
                    "%s: %lu vertex properties are more than there can be", exporter->path,
                    (unsigned long)attributes->count);
    uint32_t end = 0;
    exporter->is_packed = true;
    for (uint32_t i = 0; i < attributes->count; i++) {
        const struct attribute *one = &attributes->list[i];
        if (!is_word(one->name) || (unsigned)one->type > SCALAR_FLOAT64 ||
            one->offset > attributes->stride ||
            scalar_size(one->type) > attributes->stride - one->offset)
            return fail(exporter->ctx, STATUS_INTERNAL,
                        "%s: vertex property %lu is described wrongly", exporter->path,
                        (unsigned long)i + 1);
        exporter->is_packed &= one->offset == end;
        end += scalar_size(one->type);
    }
    exporter->is_packed &= end == attributes->stride;
    exporter->attributes = *attributes;
    find_colours(exporter);
    return STATUS_OK;
}

static bool is_kept(const struct exporter *exporter, const struct attribute *attribute)
{
    const struct export_writer *writer = exporter->writer;
    if (writer->keeps_attributes)
        return true;
    unsigned kept = !writer->keeps_colours || !exporter->has_colours ? 0
                    : writer->keeps_alpha && exporter->has_alpha     ? 4
                                                                     : 3;
    for (unsigned i = 0; i < kept; i++)
        if (attribute->type == SCALAR_UINT8 && attribute->offset == exporter->colour[i])
            return true;
    return false;
}

static void tell_dropped(const struct exporter *exporter)
{
    static const char more[] = ", ...";
    char names[512] = "";
    size_t used = 0;
    for (uint32_t i = 0; i < exporter->attributes.count; i++) {
        const struct attribute *attribute = &exporter->attributes.list[i];
        if (is_kept(exporter, attribute))
            continue;
        if (used + ATTRIBUTE_NAME_MAX + 2 + sizeof more > sizeof names) {
            memcpy(names + used, more, sizeof more);
            break;
        }
        used += (size_t)snprintf(names + used, sizeof names - used, "%s%s", used ? ", " : "",
                                 attribute->name);
    }
    if (used)
        tell(exporter->ctx, MESSAGE_NOTE,
             "%s: vertex properties dropped, for which %s has no place: %s", exporter->path,
             exporter->writer->name, names);
}

/* ---- the buffer ---- */

static enum status flush(struct exporter *exporter)
{
    size_t used = exporter->used;
    exporter->used = 0;
    return output_append(&exporter->output, exporter->buffer, used);
}

enum status export_room(struct exporter *exporter, size_t size, unsigned char **to)
{
    enum status status = STATUS_OK;
    if (size > EXPORT_BUFFER - exporter->used)
        status = flush(exporter);
    *to = exporter->buffer + exporter->used;
    return status;
}

unsigned char *export_put_position(const struct exporter *exporter, unsigned char *to,
                                   const double *position, bool stays_double)
{
    char *at = (char *)to;
    for (unsigned k = 0; k < 3; k++) {
        if (k > 0)
            *at++ = ' ';
        at += exporter->as_float32 ? format_float32(at, (float)position[k])
                                   : format_double(at, position[k], stays_double);
    }
    return (unsigned char *)at;
}

/* ---- the interface ---- */

static void release(struct exporter **exporter)
{
    struct exporter *closing = *exporter;
    *exporter = NULL;
    spool_clear(&closing->corners);
    memory_release(closing->ctx, &closing->buffer, EXPORT_BUFFER, 1);
    if (closing->path)
        memory_release(closing->ctx, &closing->path, strlen(closing->path) + 1, 1);
    memory_release(closing->ctx, &closing, 1, sizeof *closing);
}

void export_discard(struct exporter **exporter)
{
    if (!*exporter)
        return;
    output_discard(&(*exporter)->output);
    release(exporter);
}

static enum status prepare(struct exporter *exporter, const char *path,
                           const struct attributes *attributes)
{
    struct context *ctx = exporter->ctx;
    size_t size = strlen(path) + 1;
    enum status status = memory_take(ctx, size, 1, &exporter->path);
    if (status != STATUS_OK)
        return status;
    memcpy(exporter->path, path, size);
    uint64_t share = ctx->memory_budget / 8;
    spool_init(ctx, &exporter->corners, exporter->path,
               share < SPOOL_MEMORY ? share : SPOOL_MEMORY);
    if (attributes)
        status = take_attributes(exporter, attributes);
    if (status == STATUS_OK)
        status = memory_take(ctx, EXPORT_BUFFER, 1, &exporter->buffer);
    if (status == STATUS_OK)
        status = output_open(ctx, path, &exporter->output);
    if (status == STATUS_OK)
        status = exporter->writer->begin(exporter);
    if (status == STATUS_OK)
        tell_dropped(exporter);
    return status;
}

enum status export_open(struct context *ctx, const char *path, const struct export_options *options,
                        uint64_t vertex_count, uint64_t face_count,
                        const struct attributes *attributes, struct exporter **out)
{
    *out = NULL;
    enum export_format format = options->format;
    const struct export_writer *writer;
    enum status status = choose_writer(ctx, path, &format, &writer);
    struct exporter *exporter = NULL;
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, 1, sizeof *exporter, &exporter);
    if (status != STATUS_OK)
        return status;
    exporter->ctx = ctx;
    exporter->writer = writer;
    exporter->format = format;
    exporter->as_float32 = options->as_float32 || writer->is_float32;
    exporter->sync = options->sync;
    exporter->vertex_count = vertex_count;
    exporter->face_count = face_count;
    status = prepare(exporter, path, attributes);
    if (status != STATUS_OK)
        export_discard(&exporter);
    *out = exporter;
    return status;
}

/* Finite, also as float32 if that is written. */
static enum status check_positions(struct exporter *exporter, size_t count, const double *positions)
{
    const double largest_float32 = 0x1.fffffefffffffp127; /* that is not rounded to infinity */
    double limit = exporter->as_float32 ? largest_float32 : 0x1.fffffffffffffp1023;
    double loss = exporter->largest_loss;
    for (size_t i = 0; i < 3 * count; i++) {
        if (!(fabs(positions[i]) <= limit))
            return fail(exporter->ctx, STATUS_BAD_INPUT,
                        "%s: vertex %llu: the coordinate %g can't be written as %s", exporter->path,
                        (unsigned long long)(exporter->vertices_given + i / 3), positions[i],
                        exporter->as_float32 ? "float32" : "a number");
        if (exporter->as_float32) {
            double change = fabs(positions[i] - (double)(float)positions[i]);
            loss = change > loss ? change : loss;
        }
    }
    exporter->largest_loss = loss;
    return STATUS_OK;
}

static enum status take_vertices(struct exporter *exporter, size_t count, const double *positions,
                                 const unsigned char *records)
{
    if (count > exporter->vertex_count - exporter->vertices_given)
        return fail(exporter->ctx, STATUS_INTERNAL,
                    "%s: more than the %llu vertices announced came", exporter->path,
                    (unsigned long long)exporter->vertex_count);
    if (exporter->attributes.stride > 0 && !records)
        return fail(exporter->ctx, STATUS_INTERNAL, "%s: vertices came without their properties",
                    exporter->path);
    enum status status = check_positions(exporter, count, positions);
    if (status == STATUS_OK)
        status = exporter->writer->vertices(exporter, count, positions, records);
    exporter->vertices_given += count;
    return status;
}

enum status export_vertices(struct exporter *exporter, size_t count, const double *positions,
                            const unsigned char *records)
{
    if (exporter->status == STATUS_OK && count > 0)
        exporter->status = take_vertices(exporter, count, positions, records);
    return exporter->status;
}

static enum status take_faces(struct exporter *exporter, size_t count, const uint32_t *faces)
{
    if (exporter->vertices_given < exporter->vertex_count)
        return fail(exporter->ctx, STATUS_INTERNAL, "%s: faces came before all vertices",
                    exporter->path);
    if (count > exporter->face_count - exporter->faces_given)
        return fail(exporter->ctx, STATUS_INTERNAL, "%s: more than the %llu faces announced came",
                    exporter->path, (unsigned long long)exporter->face_count);
    for (size_t i = 0; i < 3 * count; i++)
        if (faces[i] >= exporter->vertex_count)
            return fail(exporter->ctx, STATUS_INTERNAL, "%s: face %llu names vertex %lu of %llu",
                        exporter->path, (unsigned long long)(exporter->faces_given + i / 3),
                        (unsigned long)faces[i], (unsigned long long)exporter->vertex_count);
    exporter->faces_given += count;
    return exporter->writer->faces(exporter, count, faces);
}

enum status export_faces(struct exporter *exporter, size_t count, const uint32_t *faces)
{
    if (exporter->status == STATUS_OK && count > 0)
        exporter->status = take_faces(exporter, count, faces);
    return exporter->status;
}

static enum status finish(struct exporter *exporter)
{
    if (exporter->status != STATUS_OK)
        return exporter->status;
    if (exporter->vertices_given != exporter->vertex_count ||
        exporter->faces_given != exporter->face_count)
        return fail(
            exporter->ctx, STATUS_INTERNAL,
            "%s: %llu vertices and %llu faces came of the %llu and %llu announced", exporter->path,
            (unsigned long long)exporter->vertices_given, (unsigned long long)exporter->faces_given,
            (unsigned long long)exporter->vertex_count, (unsigned long long)exporter->face_count);
    enum status status = flush(exporter);
    if (status == STATUS_OK)
        status = output_commit(&exporter->output, exporter->sync);
    if (status == STATUS_OK && exporter->largest_loss > 0)
        tell(exporter->ctx, MESSAGE_WARNING,
             "%s: coordinates were rounded to float32, by up to %.2g", exporter->path,
             exporter->largest_loss);
    return status;
}

enum status export_commit(struct exporter **exporter)
{
    enum status status = finish(*exporter);
    export_discard(exporter);
    return status;
}

/* ---- a whole mesh ---- */

static enum status give_mesh(struct exporter *exporter, const struct mesh *mesh)
{
    static const char stage[] = "export";
    uint64_t total = mesh->vertex_count + mesh->face_count;
    uint32_t stride = mesh->attributes.stride;
    enum status status = STATUS_OK;
    for (uint64_t v = 0; status == STATUS_OK && v < mesh->vertex_count; v += SAVE_BATCH) {
        uint64_t left = mesh->vertex_count - v;
        const unsigned char *records = mesh->records ? mesh->records + v * stride : NULL;
        status = step(exporter->ctx, stage, v, total);
        if (status == STATUS_OK)
            status = export_vertices(exporter, left < SAVE_BATCH ? left : SAVE_BATCH,
                                     mesh->positions + 3 * v, records);
    }
    for (uint64_t f = 0; status == STATUS_OK && f < mesh->face_count; f += SAVE_BATCH) {
        uint64_t left = mesh->face_count - f;
        status = step(exporter->ctx, stage, mesh->vertex_count + f, total);
        if (status == STATUS_OK)
            status =
                export_faces(exporter, left < SAVE_BATCH ? left : SAVE_BATCH, mesh->faces + 3 * f);
    }
    return status == STATUS_OK ? step(exporter->ctx, stage, total, total) : status;
}

enum status mesh_save(struct context *ctx, const char *path, const struct export_options *options,
                      const struct mesh *mesh)
{
    struct exporter *exporter;
    enum status status = export_open(ctx, path, options, mesh->vertex_count, mesh->face_count,
                                     &mesh->attributes, &exporter);
    if (status != STATUS_OK)
        return status;
    status = give_mesh(exporter, mesh);
    if (status == STATUS_OK)
        return export_commit(&exporter);
    export_discard(&exporter);
    return status;
}
