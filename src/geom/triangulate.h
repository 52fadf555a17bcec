/*
 * Triangulating one polygon in space: faces of more than three corners at import, patches at LOD
 * (dissertation, chapter 4.2.8: ears are cut by increasing angle, in the patch's plane).
 *
 * The loop is projected once onto a plane, rounded to the grid of predicates.h, and all decisions
 * are exact from there on. Whatever the loop looks like, the result is combinatorially a
 * triangulation of it: n - 2 triangles, oriented like the loop, every edge of the loop in one of
 * them and every diagonal in two. How good it is geometrically is said in `quality`.
 */
#ifndef SPBM_GEOM_TRIANGULATE_H
#define SPBM_GEOM_TRIANGULATE_H

#include "geom/simple_loop.h"

/*
 * From good to bad:
 * PLANAR: the projected loop is simple and the triangles tile its inside: all have positive area on
 * the grid and none overlap.
 * OVERLAPPING: the projected loop touches or crosses itself (a ramp, a polygon with its holes
 * bridged), but every triangle has positive area on the grid: none is turned over.
 * FORCED: some triangle has no area on the grid or is turned over: the loop lies in a line, crosses
 * itself badly, or runs clockwise seen from the tip of `normal`.
 * BLOCKED: no triangulation was found without a forbidden diagonal; `triangles` is undefined. For
 * loops of up to TRIANGULATION_EXHAUSTIVE_MAX corners there is none.
 */
enum triangulation_quality {
    TRIANGULATION_PLANAR,
    TRIANGULATION_OVERLAPPING,
    TRIANGULATION_FORCED,
    TRIANGULATION_BLOCKED
};

/* Up to so many corners, a loop for which cutting ears does not give PLANAR is solved by dynamic
 * programming: fewest triangles turned over, then fewest without area, then least area in space
 * (Barequet & Sharir 1995). */
enum { TRIANGULATION_EXHAUSTIVE_MAX = 40 };

/* Scratch that is reused from call to call; all zero at first. One thread uses it at a time. */
struct triangulation_workspace {
    struct scratch loop;
    struct scratch clipping;
    struct scratch sweep;
    struct scratch table;
};

void triangulation_workspace_clear(struct context *ctx, struct triangulation_workspace *ws);

/*
 * `points`: 3 doubles a corner, any units; n at least 3. `normal`: the plane is orthogonal to it,
 * and the loop should run counter-clockwise seen from its tip; any length; NULL: the polygon's own
 * (Newell's area-weighted sum). If the loop runs clockwise or in a line as seen from `normal`, the
 * polygon's own plane is used instead, and the quality is FORCED.
 *
 * diagonal_allowed (NULL: all are) is asked with two corners before a diagonal between them is
 * used, possibly several times; it must always answer the same. Edges of the loop are not asked
 * for.
 *
 * `triangles` gets 3*(n-2) corner numbers. Ears are cut in order of increasing angle, ties by
 * corner number; no ear of zero area is cut as long as another is there. The result depends on the
 * arguments only. O(n log n) for loops met in practice. The status is STATUS_OK unless memory
 * fails; nothing is allocated when the workspace has seen a loop as large.
 */
enum status triangulate(struct context *ctx, struct triangulation_workspace *ws,
                        const double *points, uint32_t n, const double normal[3],
                        bool (*diagonal_allowed)(void *user, uint32_t i, uint32_t j), void *user,
                        uint32_t *triangles, enum triangulation_quality *quality) MUST_CHECK;

#endif
