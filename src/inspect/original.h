/*
 * The original of a measurement, of any size: a mesh file or a store, looked at piece by piece.
 */
#ifndef SPBM_INSPECT_ORIGINAL_H
#define SPBM_INSPECT_ORIGINAL_H

#include "inspect/quality.h"

enum { PIECE_SHIFT = 16, PIECE_FACES = 1 << PIECE_SHIFT };

struct original;

/* Reads a mesh file into temporary files (beside `beside`), or opens a store. *quality is that of
 * the original. A mesh without faces is STATUS_BAD_INPUT. */
enum status original_open(struct context *ctx, const char *path, const char *beside,
                          struct original **out, struct quality *quality) MUST_CHECK;
void original_close(struct original **original);

/* Pieces hold at most PIECE_FACES faces, in the original's order; the last may have vertices only.
 */
uint64_t original_piece_count(const struct original *original);

struct original_piece {
    struct context *ctx;
    uint64_t first_face; /* a number for the first face, the others follow; unique, ascending */
    uint32_t face_count;
    double *corners; /* 9 a face */
    uint32_t vertex_count;
    double *vertices; /* 3 each; over all pieces, each vertex that a face uses comes once */
    size_t corner_capacity, vertex_capacity; /* doubles */
};

/* Loads a piece; `piece` is all zero or holds another one, whose memory is used again. May be
 * called from several threads with a piece each. `with_vertices` false: vertex_count is 0. */
enum status original_load(struct original *original, uint64_t index, bool with_vertices,
                          struct original_piece *piece) MUST_CHECK;
void original_piece_clear(struct original_piece *piece);

/* Loads any mesh file or store whole, as it is (for the simplified mesh, and for pictures). */
enum status mesh_load_any(struct context *ctx, const char *path, struct mesh *mesh) MUST_CHECK;

#endif
