/*
 * Levels of detail, mode classic: chapter 4 of the dissertation.
 */
#ifndef SPBM_SIMPLIFY_LOD_CLASSIC_H
#define SPBM_SIMPLIFY_LOD_CLASSIC_H

#include "simplify/simplify.h"

/*
 * Makes and writes all levels of `report`, which lod_target_levels has filled in, finest first,
 * from one run of operations over the chain graph; fills in what each level has become. Output
 * vertices are input vertices with their attributes: placement `optimal` is STATUS_MISUSE.
 *
 * Memory: with V chain vertices and kept vertices inside patches, E pieces of chain between them (V
 * and half the junctions) and P patches, 37 V + 48 E + 80 P bytes, about 100 bytes a chain vertex;
 * and up to 40 bytes a face of the level that is being written.
 */
enum status lod_classic(struct context *ctx, struct chain_file *file,
                        const struct lod_options *options, struct lod_report *report) MUST_CHECK;

#endif
