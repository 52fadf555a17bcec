/*
 * Cutting the ears of a loop on the grid, best first: the greedy part of triangulate.c.
 */
#ifndef SPBM_GEOM_EAR_CLIP_H
#define SPBM_GEOM_EAR_CLIP_H

#include "geom/ear_few.h"

/* `triangles` has room for 3*(n-2) corner numbers. */
enum status cut_ears(struct context *ctx, struct scratch *scratch, const struct ear_input *input,
                     uint32_t *triangles, struct ear_result *result) MUST_CHECK;

#endif
