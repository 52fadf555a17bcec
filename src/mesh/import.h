/*
 * Reading meshes: one reader a format, chosen by content, each a function that streams an input
 * once and hands batches of vertices and faces to a sink. Readers keep no more than a batch.
 *
 * PLY, OBJ, STL, OFF, each plain, gzip-compressed or from standard input, come through
 * base/instream.h. What a reader cannot represent (texture coordinates, materials, face
 * properties) it drops and names once with tell().
 */
#ifndef SPBM_MESH_IMPORT_H
#define SPBM_MESH_IMPORT_H

#include "base/instream.h"
#include "mesh/mesh.h"

enum mesh_format { FORMAT_UNKNOWN, FORMAT_PLY, FORMAT_OBJ, FORMAT_STL, FORMAT_OFF, FORMAT_STORE };

/*
 * Where a reader's output goes. Every callback may fail, which ends the reading with its status.
 * Order of calls: begin once; then vertices and faces in any order and number; end once.
 */
struct import_sink {
    void *user;
    /* What is known at the start; expected counts are claims of the file, 0 when unknown, and must
     * not be trusted for allocations. is_soup: faces do not share vertices, welding is needed. */
    enum status (*begin)(void *user, const struct attributes *attributes, bool is_soup,
                         uint64_t expected_vertices, uint64_t expected_faces);
    /* `count` vertices, in the file's order. Exactly one of `floats` and `doubles` is not NULL (3 a
     * vertex, all finite): floats when every coordinate of the batch is a float32 (declared so, or
     * text whose decimal digits a float32 gives back). `records`: attributes.stride bytes a
     * vertex, NULL if stride is 0. */
    enum status (*vertices)(void *user, size_t count, const float *floats, const double *doubles,
                            const unsigned char *records);
    /* `count` faces; sizes[i] corners each (at least 3), or 3 each when sizes is NULL; indices
     * are zero-based in this input and not yet checked against the number of vertices. A face may
     * come before its vertices. `first_face` is the file's number of the first face, for words. */
    enum status (*faces)(void *user, uint64_t first_face, size_t count, const uint32_t *sizes,
                         const uint32_t *indices);
    /* The same of triangles, by a reader that knows the largest of their indices; NULL: faces is
     * called instead. */
    enum status (*triangles)(void *user, uint64_t first_face, size_t count, const uint32_t *indices,
                             uint32_t largest);
};

/* Looks at the first bytes of a stream. FORMAT_UNKNOWN when none fits. */
enum status import_probe(struct context *ctx, struct instream *stream,
                         enum mesh_format *format) MUST_CHECK;

/* Reads the whole stream into the sink. Messages name the stream, the position and the reason. */
enum status import_read(struct context *ctx, struct instream *stream,
                        const struct import_sink *sink) MUST_CHECK;

/* The readers, for import_read's table and the tests. */
enum status import_ply(struct context *ctx, struct instream *stream,
                       const struct import_sink *sink) MUST_CHECK;
enum status import_obj(struct context *ctx, struct instream *stream,
                       const struct import_sink *sink) MUST_CHECK;
enum status import_stl(struct context *ctx, struct instream *stream,
                       const struct import_sink *sink) MUST_CHECK;
enum status import_off(struct context *ctx, struct instream *stream,
                       const struct import_sink *sink) MUST_CHECK;

/*
 * Reads one mesh file as it is into memory: nothing is cleaned, polygons are triangulated, an STL
 * is welded. For looking at other programs' outputs and for small inputs; the product's road is
 * store_build. Index errors and non-finite coordinates are STATUS_BAD_INPUT.
 */
enum status mesh_load(struct context *ctx, const char *path, struct mesh *mesh) MUST_CHECK;

#endif
