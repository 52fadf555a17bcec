/*
 * What the readers of import.h give, caught in spools: positions, attribute records, triangles. All
 * inputs of a job go into one ingest, one after the other, and are one mesh.
 */
#ifndef SPBM_MESH_INGEST_H
#define SPBM_MESH_INGEST_H

#include "base/file.h"
#include "base/prefault.h"
#include "mesh/import.h"
#include "mesh/mesh.h"
#include "mesh/room.h"
#include "mesh/sieve.h"

struct ingest_input {
    const char *name; /* borrowed, for messages */
    uint64_t vertex_first;
    uint64_t vertex_count;
    uint64_t expected_vertices; /* as it claims; 0: unknown, or more than is credible */
    uint64_t expected_faces;
    bool is_soup;
    struct attributes attributes;
    struct spool record_spool;
    uint32_t common[ATTRIBUTE_MAX]; /* place in `attributes` of each common attribute */
};

struct ingest;
/*
 * Somebody who takes triangles in place of the face spool, into which he puts what he makes of
 * them: as long as they come from one input, are no polygons, and name no vertex that is yet to
 * come.
 * `*taken` false: not these, and he is not asked again. Those that he drops are no faces of the
 * ingest any more.
 */
struct ingest_taker {
    void *user; /* NULL: nobody */
    enum status (*take)(void *user, struct ingest *ingest, size_t count, const uint32_t *indices,
                        bool *taken);
};

struct ingest {
    struct context *ctx;
    const struct room *room; /* borrowed */
    struct ingest_taker taker;
    struct sieve sieve; /* of soups; all zero: none */

    struct ingest_input *inputs;
    size_t input_count;
    size_t input_capacity;
    uint64_t needed_vertices; /* 1 + the largest index of the current input's faces that was ahead
                                 of the vertices when it came, 0: none was */
    uint64_t largest_face;    /* the file's number of the face that has it */

    uint64_t index_limit;   /* most vertices, and most triangles */
    uint64_t credible;      /* bytes of memory that the current input's claims are believed for */
    uint64_t vertex_count;  /* without those that the sieve holds */
    uint64_t input_faces;   /* as the files have them */
    uint64_t polygon_faces; /* triangles that polygons gave */
    uint64_t face_count;    /* triangles */
    uint64_t double_first;  /* vertices before this one came as floats; UINT64_MAX: all */
    struct spool float_spool;
    struct spool double_spool;
    struct spool face_spool;    /* 3 indices a triangle, offset by the inputs before */
    struct spool polygon_spool; /* struct ingest_polygon */
    struct prefault prefault;   /* of what the current input's vertices and faces will fill */

    /* after ingest_finish */
    bool is_float32;
    struct spool position_spool; /* 3 floats or doubles a vertex */
    void *positions;
    struct spool record_spool; /* attributes.stride bytes a vertex, of the common attributes */
    unsigned char *records;    /* NULL if there are none */
    uint32_t *faces;
    struct attributes attributes; /* what all inputs have, after ingest_finish */
};

/* A polygon of `size` corners lies in the faces as a fan of size - 2 triangles from `first` on. */
struct ingest_polygon {
    uint32_t first;
    uint32_t size;
};

void ingest_init(struct context *ctx, struct ingest *ingest, const struct room *room);
void ingest_clear(struct ingest *ingest);

/* Announces the next input and gives the sink to read it into. `name` is borrowed until
 * ingest_clear. */
enum status ingest_begin(struct ingest *ingest, const char *name,
                         struct import_sink *sink) MUST_CHECK;
/* Checks the input's indices, once it is read. */
enum status ingest_end(struct ingest *ingest) MUST_CHECK;
/* After the last input: triangulates polygons, settles the attributes, and brings positions and
 * records of all inputs into one form. */
enum status ingest_finish(struct ingest *ingest) MUST_CHECK;

/* A spool that grows beside others (between the two files). */
void ingest_begin_spool(const struct ingest *ingest, struct spool *spool);

/* Position of an input vertex, after ingest_finish. */
static inline void ingest_position(const struct ingest *ingest, uint64_t vertex, double out[3])
{
    const float *floats = ingest->positions;
    const double *doubles = ingest->positions;
    for (unsigned i = 0; i < 3; i++)
        out[i] = ingest->is_float32 ? (double)floats[3 * vertex + i] : doubles[3 * vertex + i];
}

#endif
