/*
 * Writing levels: their names and their bytes.
 */
#ifndef SPBM_SIMPLIFY_LOD_OUTPUT_H
#define SPBM_SIMPLIFY_LOD_OUTPUT_H

#include "simplify/simplify.h"

/*
 * The name of a level: in `pattern`, %d stands for its number (0 is the finest) and %% for a
 * percent sign. *name is released by lod_output_name_release.
 */
enum status lod_output_name(struct context *ctx, const char *pattern, uint32_t index,
                            char **name) MUST_CHECK;
void lod_output_name_release(struct context *ctx, char **name);

/* To be asked before any work: STATUS_MISUSE when the pattern has any other %, when several levels
 * have no %d, or when a level would overwrite `input`. */
enum status lod_output_check(struct context *ctx, const struct lod_options *options,
                             uint32_t level_count, const char *input) MUST_CHECK;

/* A level whose vertices are fetched as they are written. */
struct level_source {
    uint64_t vertex_count, face_count;
    const uint32_t *faces; /* 3 a face: numbers of the level's own vertices */
    const struct attributes *attributes;
    bool is_float32;
    /* Fills positions (3 doubles each) and records (attributes->stride bytes each) of vertices
     * [first, first + count). */
    void (*fetch)(void *user, uint64_t first, size_t count, double *positions,
                  unsigned char *records);
    void *user;
};

/* The file appears whole or not at all. */
enum status lod_output_write(struct context *ctx, const struct lod_options *options, uint32_t index,
                             const struct level_source *source) MUST_CHECK;

/* The same for a mesh in memory. */
enum status lod_output_mesh(struct context *ctx, const struct lod_options *options, uint32_t index,
                            const struct mesh *mesh) MUST_CHECK;

#endif
