/*
 * Cutting the ears of a simple loop of few corners, which is what patches give: what ear_clip.h
 * does for them.
 */
#ifndef SPBM_GEOM_EAR_FEW_H
#define SPBM_GEOM_EAR_FEW_H

#include <math.h>

#include "geom/simple_loop.h"

struct ear_input {
    const struct grid_point *points;
    const double *heights; /* over the plane, in steps of the grid */
    uint32_t n;            /* at least 4 */
    bool is_simple;        /* the loop neither crosses nor touches itself */
    bool (*diagonal_allowed)(void *user, uint32_t i, uint32_t j); /* NULL: all are */
    void *user;
    /* Once no proper ear is left and at most so many corners are, stop and hand them back. */
    uint32_t give_back_max;
};

struct ear_result {
    uint32_t cut;        /* triangles written; n - 2 when done */
    bool has_bad;        /* one of them has no area or is turned over */
    bool is_stuck;       /* a rest of more than give_back_max has no allowed ear at all */
    uint32_t rest_count; /* corners handed back, 0 when done */
    uint32_t *rest;      /* in the order of the loop; lies in the scratch */
};

/* 1 - the cosine of the angle at b, 0 to 2; 0 where an edge has no length. `lengths`: the product
 * of both edges' squares. */
static inline double ear_openness(struct grid_point a, struct grid_point b, struct grid_point c,
                                  double lengths)
{
    const double cosine = lengths > 0 ? (double)grid_dot(b, a, c) / sqrt(lengths) : 1;
    const double openness = 1 - cosine;
    return openness < 0 ? 0 : openness > 2 ? 2 : openness; /* rounding may pass the ends */
}

enum { EAR_FEW_MAX = 40 }; /* corners; sets of them are bits */

/* For a simple loop of at most EAR_FEW_MAX corners, and of no more than input->give_back_max;
 * `triangles` has room for 3*(n-2) corner numbers. */
enum status cut_few_ears(struct context *ctx, struct scratch *scratch,
                         const struct ear_input *input, uint32_t *triangles,
                         struct ear_result *result) MUST_CHECK;

#endif
