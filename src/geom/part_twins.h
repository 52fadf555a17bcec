/*
 * Loops that pass a point several times: polygons with holes, joined to the outside by bridges that
 * are walked there and back.
 */
#ifndef SPBM_GEOM_PART_TWINS_H
#define SPBM_GEOM_PART_TWINS_H

#include "geom/simple_loop.h"

/*
 * Copies the loop to `parted`, with corners that lie in one place moved apart, each a little into
 * the inside as its own two edges see it. If only bridges made the loop touch itself, the copy is a
 * simple loop; *any is false if no two corners lie in one place.
 */
enum status part_twins(struct context *ctx, struct scratch *scratch,
                       const struct grid_point *points, uint32_t n, struct grid_point *parted,
                       bool *any) MUST_CHECK;

#endif
