/*
 * Writing meshes: PLY (binary little- or big-endian, ASCII), OBJ, STL (binary), OFF, streamed in
 * batches through base/file.h, so that no more than a batch is held. The same mesh gives the same
 * bytes: no names or times are written. Text has the fewest digits that give the value back.
 */
#ifndef SPBM_MESH_EXPORT_H
#define SPBM_MESH_EXPORT_H

#include "mesh/mesh.h"

enum export_format {
    EXPORT_BY_NAME, /* by the ending: .ply (binary), .obj, .stl, .off */
    EXPORT_PLY,
    EXPORT_PLY_ASCII,
    EXPORT_PLY_BIG,
    EXPORT_OBJ,
    EXPORT_STL,
    EXPORT_OFF
};

struct export_options {
    enum export_format format;
    bool as_float32; /* positions are written as float (all are float32), else as double */
    bool sync;       /* fsync before the file gets its name */
};

struct exporter;

/* Counts must be what is then given. Attributes are written by PLY only (OFF and OBJ: colours);
 * what a format drops is told once. STATUS_MISUSE for an unknown ending. */
enum status export_open(struct context *ctx, const char *path, const struct export_options *options,
                        uint64_t vertex_count, uint64_t face_count,
                        const struct attributes *attributes, struct exporter **out) MUST_CHECK;
/* All vertices first, then all faces, in any batches. Positions: 3 doubles a vertex. */
enum status export_vertices(struct exporter *exporter, size_t count, const double *positions,
                            const unsigned char *records) MUST_CHECK;
/* Faces as 3 indices each. (STL needs the positions again: the exporter spools them.) */
enum status export_faces(struct exporter *exporter, size_t count, const uint32_t *faces) MUST_CHECK;
/* The file appears, or nothing does. The exporter is gone either way. */
enum status export_commit(struct exporter **exporter) MUST_CHECK;
void export_discard(struct exporter **exporter);

/* A whole mesh in one call. */
enum status mesh_save(struct context *ctx, const char *path, const struct export_options *options,
                      const struct mesh *mesh) MUST_CHECK;

#endif
