/*
 * Writing levels. A level's vertices lie scattered among those of the graph; gathering them all
 * first would take as much memory again, so they go out in batches.
 */
#include "simplify/lod_output.h"

#include <stdio.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"

enum { BATCH_VERTICES = 4096, BATCH_FACES = 16384 };

/* ---- names ---- */

/* Copies the pattern with its places filled; `to` NULL: only counts. Returns the length; *numbered
 * tells whether there was a %d. SIZE_MAX: another % was met. */
static size_t fill_pattern(const char *pattern, uint32_t index, char *to, bool *numbered)
{
    size_t length = 0;
    char number[16];
    *numbered = false;
    for (const char *p = pattern; *p; p++) {
        const char *piece = p;
        size_t size = 1;
        if (*p == '%' && p[1] == 'd') {
            size = (size_t)snprintf(number, sizeof number, "%u", index);
            piece = number;
            *numbered = true;
            p++;
        } else if (*p == '%' && p[1] == '%') {
            p++;
        } else if (*p == '%') {
            return SIZE_MAX;
        }
        if (to)
            memcpy(to + length, piece, size);
        length += size;
    }
    if (to)
        to[length] = '\0';
    return length;
}

enum status lod_output_name(struct context *ctx, const char *pattern, uint32_t index, char **name)
{
    bool numbered;
    size_t length = fill_pattern(pattern, index, NULL, &numbered);
    *name = NULL;
    if (length == SIZE_MAX)
        return fail(ctx, STATUS_MISUSE,
                    "output name %s: after %% comes d (the level's number) or %%", pattern);
    enum status status = memory_take(ctx, length + 1, 1, name);
    if (status == STATUS_OK)
        fill_pattern(pattern, index, *name, &numbered);
    return status;
}

void lod_output_name_release(struct context *ctx, char **name)
{
    if (*name)
        memory_release(ctx, name, strlen(*name) + 1, 1);
}

enum status lod_output_check(struct context *ctx, const struct lod_options *options,
                             uint32_t level_count, const char *input)
{
    bool numbered;
    if (fill_pattern(options->output, 0, NULL, &numbered) != SIZE_MAX && level_count > 1 &&
        !numbered)
        return fail(ctx, STATUS_MISUSE,
                    "output name %s: %u levels need a %%d in it for the level's number",
                    options->output, level_count);
    for (uint32_t i = 0; i < level_count; i++) {
        char *name;
        enum status status = lod_output_name(ctx, options->output, i, &name);
        if (status == STATUS_OK && strcmp(name, "-") != 0)
            status = paths_must_differ(ctx, input, name);
        lod_output_name_release(ctx, &name);
        if (status != STATUS_OK)
            return status;
    }
    return STATUS_OK;
}

/* ---- bytes ---- */

static enum status write_vertices(struct context *ctx, const struct level_source *source,
                                  struct exporter *exporter)
{
    size_t stride = source->attributes->stride;
    double *positions = NULL;
    unsigned char *records = NULL;
    enum status status =
        memory_take(ctx, 3 * (size_t)BATCH_VERTICES, sizeof *positions, &positions);
    if (status == STATUS_OK && stride > 0)
        status = memory_take(ctx, BATCH_VERTICES, stride, &records);
    for (uint64_t first = 0; first < source->vertex_count && status == STATUS_OK;
         first += BATCH_VERTICES) {
        uint64_t left = source->vertex_count - first;
        size_t count = left < BATCH_VERTICES ? (size_t)left : BATCH_VERTICES;
        source->fetch(source->user, first, count, positions, records);
        status = export_vertices(exporter, count, positions, records);
    }
    memory_release(ctx, &positions, 3 * (size_t)BATCH_VERTICES, sizeof *positions);
    memory_release(ctx, &records, BATCH_VERTICES, stride);
    return status;
}

static enum status write_faces(struct context *ctx, const struct level_source *source,
                               struct exporter *exporter)
{
    enum status status = STATUS_OK;
    for (uint64_t first = 0; first < source->face_count && status == STATUS_OK;
         first += BATCH_FACES) {
        uint64_t left = source->face_count - first;
        size_t count = left < BATCH_FACES ? (size_t)left : BATCH_FACES;
        status = export_faces(exporter, count, source->faces + 3 * first);
        if (status == STATUS_OK)
            status = step(ctx, "writing", first + count, source->face_count);
    }
    return status;
}

enum status lod_output_write(struct context *ctx, const struct lod_options *options, uint32_t index,
                             const struct level_source *source)
{
    struct export_options format = options->export;
    struct exporter *exporter = NULL;
    char *name;
    enum status status = lod_output_name(ctx, options->output, index, &name);
    if (status != STATUS_OK)
        return status;
    format.as_float32 = source->is_float32;
    status = export_open(ctx, name, &format, source->vertex_count, source->face_count,
                         source->attributes, &exporter);
    if (status == STATUS_OK)
        status = write_vertices(ctx, source, exporter);
    if (status == STATUS_OK)
        status = write_faces(ctx, source, exporter);
    if (status == STATUS_OK)
        status = export_commit(&exporter);
    export_discard(&exporter);
    lod_output_name_release(ctx, &name);
    return status;
}

enum status lod_output_mesh(struct context *ctx, const struct lod_options *options, uint32_t index,
                            const struct mesh *mesh)
{
    struct export_options format = options->export;
    char *name;
    enum status status = lod_output_name(ctx, options->output, index, &name);
    if (status != STATUS_OK)
        return status;
    format.as_float32 = mesh->is_float32;
    status = mesh_save(ctx, name, &format, mesh);
    lod_output_name_release(ctx, &name);
    return status;
}
