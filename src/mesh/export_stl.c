/*
 * Binary STL: 80 bytes of words, a count, and for every face its normal and three corners as
 * float32. Faces need the positions of their corners, which came before them: these wait in a
 * spool, 12 bytes a vertex, in memory while there are few and on disk beyond that.
 */
#include "mesh/export_format.h"

#include <string.h>

#include "base/bytes.h"
#include "geom/vec.h"

enum { HEADER_SIZE = 84, FACET_SIZE = 50 };

static enum status begin(struct exporter *exporter)
{
    /* Must not begin with "solid", which would look like the text form. */
    static const char words[] = "Binary STL";
    unsigned char *to;
    if (exporter->face_count > UINT32_MAX)
        return fail(exporter->ctx, STATUS_MISUSE, "%s: STL can't hold more than 4294967295 faces",
                    exporter->path);
    enum status status = export_room(exporter, HEADER_SIZE, &to);
    if (status != STATUS_OK)
        return status;
    memset(to, ' ', HEADER_SIZE);
    memcpy(to, words, strlen(words));
    store_u32(to + 80, (uint32_t)exporter->face_count);
    exporter->used += HEADER_SIZE;
    return STATUS_OK;
}

static enum status vertices(struct exporter *exporter, size_t count, const double *positions,
                            const unsigned char *records)
{
    (void)records;
    float floats[3 * 256];
    for (size_t done = 0; done < 3 * count;) {
        size_t size = 3 * count - done;
        size = size < sizeof floats / sizeof *floats ? size : sizeof floats / sizeof *floats;
        for (size_t i = 0; i < size; i++)
            floats[i] = (float)positions[done + i];
        enum status status = spool_append(&exporter->corners, floats, size * sizeof *floats);
        if (status != STATUS_OK)
            return status;
        done += size;
    }
    return STATUS_OK;
}

static void put_facet(unsigned char *to, const float *const corners[3])
{
    struct vec3 normal = vec3_normalized(triangle_normal(
        vec3_load_float(corners[0]), vec3_load_float(corners[1]), vec3_load_float(corners[2])));
    store_f32(to, (float)normal.x);
    store_f32(to + 4, (float)normal.y);
    store_f32(to + 8, (float)normal.z);
    for (unsigned k = 0; k < 3; k++)
        for (unsigned i = 0; i < 3; i++)
            store_f32(to + 12 + 12 * k + 4 * i, corners[k][i]);
    store_u16(to + 48, 0);
}

static enum status faces(struct exporter *exporter, size_t count, const uint32_t *indices)
{
    if (!exporter->positions && count > 0) {
        void *data;
        enum status status = spool_seal(&exporter->corners, &data);
        if (status != STATUS_OK)
            return status;
        exporter->positions = data;
    }
    for (size_t i = 0; i < count; i++, indices += 3) {
        unsigned char *to;
        enum status status = export_room(exporter, FACET_SIZE, &to);
        if (status != STATUS_OK)
            return status;
        const float *corners[3];
        for (unsigned k = 0; k < 3; k++)
            corners[k] = exporter->positions + 3 * (size_t)indices[k];
        put_facet(to, corners);
        exporter->used += FACET_SIZE;
    }
    return STATUS_OK;
}

const struct export_writer export_stl = {
    .name = "STL", .is_float32 = true, .begin = begin, .vertices = vertices, .faces = faces};
