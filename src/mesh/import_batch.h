/*
 * What all readers share: gathering vertices and faces into batches for the sink, checking
 * coordinates, and colours as OBJ and OFF have them.
 */
#ifndef SPBM_MESH_IMPORT_BATCH_H
#define SPBM_MESH_IMPORT_BATCH_H

#include "mesh/import.h"
#include "mesh/text_scan.h"

/* Vertices always go to the sink in batches of exactly so many (but for the last before faces),
 * whatever pieces the stream comes in: a batch is float32 or not as a whole. */
enum { IMPORT_BATCH = 8192 };

struct import_batch {
    struct context *ctx;
    const struct import_sink *sink;
    const char *name; /* of the stream */
    uint32_t stride;

    uint64_t vertices_before; /* delivered */
    size_t vertex_count;      /* in the batch */
    bool is_float32;          /* every vertex put with batch_vertex so far */
    float *floats;            /* used by readers that fill it directly, and for delivery */
    double *doubles;
    unsigned char *records;

    uint64_t first_face; /* number of the batch's first face */
    size_t face_count;   /* in the batch */
    size_t index_count;
    size_t index_capacity;
    uint32_t *sizes; /* all 3 unless has_polygons */
    uint32_t *indices;
    bool has_polygons;
    uint64_t short_faces; /* of fewer than 3 corners, left out */
};

/* Calls the sink's begin. On failure too, batch_close is due. */
enum status batch_open(struct import_batch *batch, struct context *ctx,
                       const struct import_sink *sink, const char *name,
                       const struct attributes *attributes, bool is_soup,
                       uint64_t expected_vertices, uint64_t expected_faces) MUST_CHECK;
/* Delivers what is left and says how many faces were left out. */
enum status batch_finish(struct import_batch *batch) MUST_CHECK;
void batch_close(struct import_batch *batch); /* safe when all zero */

/* Delivers the vertices in the batch: `floats` as filled, or chosen by is_float32. */
enum status batch_deliver_floats(struct import_batch *batch) MUST_CHECK;
enum status batch_deliver_vertices(struct import_batch *batch) MUST_CHECK;
/* The vertices first: who takes faces may want to know theirs. */
enum status batch_deliver_faces(struct import_batch *batch) MUST_CHECK;

/* One coordinate of the next vertex from text: what a float32 is enough for becomes the float32,
 * so that the same text is the same value in every batch. False when it is not finite. */
static inline bool batch_set_coordinate(struct import_batch *batch, unsigned axis,
                                        const struct parsed_number *number)
{
    double value = number->fits_float32 ? (double)(float)number->value : number->value;
    batch->doubles[3 * batch->vertex_count + axis] = value;
    batch->is_float32 &= number->fits_float32;
    return value - value == 0;
}

/* The same for a declared double or integer: float32 only when it is exactly one. */
static inline bool batch_set_exact(struct import_batch *batch, unsigned axis, double value)
{
    batch->doubles[3 * batch->vertex_count + axis] = value;
    batch->is_float32 &= (double)(float)value == value;
    return value - value == 0;
}

/* The record of the next vertex, `stride` bytes to be filled. */
static inline unsigned char *batch_record(struct import_batch *batch)
{
    return batch->records + batch->vertex_count * batch->stride;
}

/* The next vertex, whose coordinates are set, is whole. */
static inline enum status batch_end_vertex(struct import_batch *batch)
{
    if (++batch->vertex_count < IMPORT_BATCH)
        return STATUS_OK;
    return batch_deliver_vertices(batch);
}

/* Number of vertices so far. */
static inline uint64_t batch_vertices(const struct import_batch *batch)
{
    return batch->vertices_before + batch->vertex_count;
}

/* Number of faces so far, those left out counted. */
static inline uint64_t batch_faces(const struct import_batch *batch)
{
    return batch->first_face + batch->face_count;
}

/* "<name>: vertex <n>: <y> is not finite", n the next vertex. */
enum status batch_refuse_coordinate(struct import_batch *batch, unsigned axis);

/* ---- faces, corner by corner ---- */

enum status batch_grow_indices(struct import_batch *batch) MUST_CHECK;

static inline enum status batch_corner(struct import_batch *batch, uint32_t index)
{
    if (batch->index_count == batch->index_capacity) {
        enum status status = batch_grow_indices(batch);
        if (status != STATUS_OK)
            return status;
    }
    batch->indices[batch->index_count++] = index;
    return STATUS_OK;
}

enum status batch_end_polygon(struct import_batch *batch, uint32_t corners) MUST_CHECK;

/* The last `corners` indices are a face. */
static inline enum status batch_end_face(struct import_batch *batch, uint32_t corners)
{
    if (corners != 3)
        return batch_end_polygon(batch, corners);
    if (++batch->face_count < IMPORT_BATCH)
        return STATUS_OK;
    return batch_deliver_faces(batch);
}

/* ---- colours in OBJ and OFF ---- */

/*
 * Both formats have colours as numbers from 0 to 1 and from 0 to 255, and do not say which. A
 * number with a point or above 1 decides for the file from there on; until then, a 1 is full
 * intensity.
 */
enum colour_scale { COLOUR_UNKNOWN, COLOUR_UNIT, COLOUR_BYTE };

/* Adds red, green, blue and, if asked for, alpha: bytes. */
void colour_attributes(struct attributes *attributes, bool with_alpha);
/* False when a value is out of range. */
bool colour_byte(enum colour_scale *scale, const struct parsed_number *number, unsigned char *byte);

#endif
