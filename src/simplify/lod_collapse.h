/*
 * Levels of detail, mode collapse: fine patches triangulated, then edges collapsed by least error.
 */
#ifndef SPBM_SIMPLIFY_LOD_COLLAPSE_H
#define SPBM_SIMPLIFY_LOD_COLLAPSE_H

#include "simplify/simplify.h"

/*
 * Makes and writes all levels of `report`, which lod_target_levels has filled in, finest first,
 * as lod_levels.h says; fills in what each level has become, and small_faces.
 *
 * Memory: 60 bytes a face of the mesh that is being collapsed (a slab's in each thread, then
 * the joined one), 38 a face of those that wait for being joined; attribute records add half their
 * bytes a face.
 */
enum status lod_collapse(struct context *ctx, struct chain_file *file,
                         const struct lod_options *options, struct lod_report *report) MUST_CHECK;

#endif
