/*
 * What export.c and the writers of the formats share.
 */
#ifndef SPBM_MESH_EXPORT_FORMAT_H
#define SPBM_MESH_EXPORT_FORMAT_H

#include "base/file.h"
#include "mesh/export.h"
#include "mesh/format_number.h"

struct exporter {
    struct context *ctx;
    const struct export_writer *writer;
    enum export_format format;
    bool as_float32; /* as asked for, or because the format has nothing else */
    bool sync;
    char *path; /* owned */
    struct output output;
    uint64_t vertex_count, face_count; /* promised */
    uint64_t vertices_given, faces_given;
    enum status status;  /* of the first call that failed; then all others do */
    double largest_loss; /* largest change of a coordinate by rounding to float32 */
    struct attributes attributes;
    bool is_packed;              /* the attributes lie in a record in their order without gaps */
    bool has_colours, has_alpha; /* uchar attributes red, green, blue (alpha), for OBJ and OFF */
    uint32_t colour[4];          /* their offsets in a record */
    unsigned char *buffer;       /* EXPORT_BUFFER bytes, `used` of them not yet in the output */
    size_t used;
    struct spool corners;   /* STL: positions as 3 floats a vertex */
    const float *positions; /* of the sealed spool */
};

enum { EXPORT_BUFFER = 1 << 18 };

/*
 * One format. What it is given is checked: coordinates that the type written can hold, all vertices
 * before the first face, no more than was announced, and no vertex that is not there.
 */
struct export_writer {
    const char *name; /* in messages */
    bool keeps_colours, keeps_alpha, keeps_attributes;
    bool is_float32; /* has no double */
    enum status (*begin)(struct exporter *exporter);
    enum status (*vertices)(struct exporter *exporter, size_t count, const double *positions,
                            const unsigned char *records);
    enum status (*faces)(struct exporter *exporter, size_t count, const uint32_t *faces);
};

extern const struct export_writer export_ply, export_obj, export_stl, export_off;

/* Room for `size` bytes (at most EXPORT_BUFFER) at *to; `exporter->used` grows by what is put
 * there. */
enum status export_room(struct exporter *exporter, size_t size, unsigned char **to) MUST_CHECK;

/* The words of a line: "1.5 2 -3", with a blank between; returns the byte behind. `stays_double`:
 * the format does not declare the type, and the reader guesses it from the digits. */
unsigned char *export_put_position(const struct exporter *exporter, unsigned char *to,
                                   const double *position, bool stays_double);
enum { EXPORT_POSITION_MAX = 3 * (NUMBER_TEXT_MAX + 1) };

#endif
