/*
 * What the readers of import.h give, caught in spools: positions, attribute records, triangles. All
 * inputs of a job go into one ingest, one after the other, and are one mesh.
 */
#ifndef SPBM_MESH_INGEST_H
#define SPBM_MESH_INGEST_H

#include "base/file.h"
#include "mesh/import.h"
#include "mesh/mesh.h"

struct ingest_input {
    const char *name; /* borrowed, for messages */
    uint64_t vertex_first;
    uint64_t vertex_count;
    bool is_soup;
    struct attributes attributes;
    struct spool record_spool;
    const unsigned char *records;
    uint32_t common[ATTRIBUTE_MAX]; /* place in `attributes` of each common attribute */
};

struct ingest {
    struct context *ctx;
    const char *beside;
    uint64_t spool_limit;

    struct ingest_input *inputs;
    size_t input_count;
    size_t input_capacity;
    uint64_t needed_vertices; /* 1 + the largest index of the current input's faces that was ahead
                                 of the vertices when it came, 0: none was */
    uint64_t largest_face;    /* the file's number of the face that has it */

    uint64_t vertex_count;
    uint64_t input_faces;   /* as the files have them */
    uint64_t polygon_faces; /* triangles that polygons gave */
    uint64_t face_count;    /* triangles */
    uint64_t double_first;  /* vertices before this one are floats; UINT64_MAX: all */
    struct spool float_spool;
    struct spool double_spool;
    struct spool face_spool;    /* 3 indices a triangle, offset by the inputs before */
    struct spool polygon_spool; /* struct ingest_polygon */
    const float *floats;        /* after ingest_finish */
    const double *doubles;
    uint32_t *faces;

    struct attributes attributes; /* what all inputs have, after ingest_finish */
};

/* A polygon of `size` corners lies in the faces as a fan of size - 2 triangles from `first` on. */
struct ingest_polygon {
    uint32_t first;
    uint32_t size;
};

void ingest_init(struct context *ctx, struct ingest *ingest, const char *beside,
                 uint64_t spool_limit);
void ingest_clear(struct ingest *ingest);

/* Announces the next input and gives the sink to read it into. `name` is borrowed until
 * ingest_clear. */
enum status ingest_begin(struct ingest *ingest, const char *name,
                         struct import_sink *sink) MUST_CHECK;
/* Checks the input's indices, once it is read. */
enum status ingest_end(struct ingest *ingest) MUST_CHECK;
/* After the last input: seals the spools, triangulates polygons, settles the attributes. */
enum status ingest_finish(struct ingest *ingest) MUST_CHECK;

/* Position of an input vertex, after ingest_finish. */
static inline void ingest_position(const struct ingest *ingest, uint64_t vertex, double out[3])
{
    if (vertex < ingest->double_first) {
        for (int i = 0; i < 3; i++)
            out[i] = (double)ingest->floats[3 * vertex + i];
    } else {
        const double *from = ingest->doubles + 3 * (vertex - ingest->double_first);
        for (int i = 0; i < 3; i++)
            out[i] = from[i];
    }
}

static inline bool ingest_is_float32(const struct ingest *ingest)
{
    return ingest->double_first == UINT64_MAX;
}

/* Positions and records leave the process, where they lie in files, until they are looked at. */
void ingest_forget(const struct ingest *ingest);

/* The common attributes of an input vertex, attributes.stride bytes. */
void ingest_record(const struct ingest *ingest, uint64_t vertex, unsigned char *record);

#endif
