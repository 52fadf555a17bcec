/*
 * Better diagonals for a triangulated patch: ears are cut in the plane, but patches are bent.
 */
#ifndef SPBM_SIMPLIFY_PATCH_FLIP_H
#define SPBM_SIMPLIFY_PATCH_FLIP_H

#include "base/report.h"

/* Scratch, all zero before its first use. */
struct flip_room {
    uint32_t *mates; /* a corner: the corner whose edge runs the other way; NO_INDEX on the loop */
    uint32_t *order; /* corners, sorted by the edge that they start */
    size_t mate_capacity, order_capacity;
};

/*
 * Replaces diagonals of a triangulation (`triangles`: 3*(n-2) corner numbers of the loop, oriented
 * like it) by the other diagonal of their two triangles when that makes the surface's area smaller
 * (a fold is more area than a smooth bend), or leaves it and makes the angles better (Delaunay).
 * Only where both new triangles have positive area seen along `normal`, and only to diagonals that
 * are allowed (see triangulate.h). Points: 3 doubles a corner.
 */
enum status patch_flip(struct context *ctx, struct flip_room *room, const double *points,
                       uint32_t n, const double normal[3],
                       bool (*diagonal_allowed)(void *user, uint32_t i, uint32_t j), void *user,
                       uint32_t *triangles) MUST_CHECK;

void flip_room_clear(struct context *ctx, struct flip_room *room);

#endif
