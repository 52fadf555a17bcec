/*
 * Simplifying one chain by halving (dissertation, section 4.2.5): one number a vertex, computed
 * once, from which the chain at any tolerance is read off.
 */
#ifndef SPBM_SIMPLIFY_CHAIN_SIMPLIFY_H
#define SPBM_SIMPLIFY_CHAIN_SIMPLIFY_H

#include "geom/polyline.h"

/*
 * What the distance of a point from the segment that replaces it counts. At a border, and where the
 * patches on both sides meet at a sharp angle, every displacement is seen: `lateral` is 1. Where
 * they are nearly coplanar, moving the chain within the surface changes the surface little: the
 * displacement along `normal` counts fully and the rest by `lateral`, down to CHAIN_LATERAL_LEAST.
 */
struct chain_metric {
    struct vec3 normal;
    double lateral;
    double price; /* what a length of error counts in the order of operations: more where the chain
                     is sharp, because edges are what one sees; 1 where it is smooth */
};

#define CHAIN_LATERAL_LEAST 0.005
#define CHAIN_SHARP_PRICE 3.0
#define CHAIN_SHARP_LATERAL 0.5 /* chains whose lateral weight is larger count as sharp */

/* The plain distance, for borders. */
static inline struct chain_metric chain_metric_plain(void)
{
    return (struct chain_metric){{0, 0, 0}, 1, CHAIN_SHARP_PRICE};
}

/* For a chain between patches with these unit normals. */
struct chain_metric chain_metric_between(struct vec3 left, struct vec3 right);

/* What an offset counts: the larger of its part along the normal and its weighted length. */
static inline double chain_metric_length(const struct chain_metric *metric, struct vec3 offset)
{
    double along = fabs(vec3_dot(metric->normal, offset));
    double whole = metric->lateral * vec3_length(offset);
    return along > whole ? along : whole;
}

/*
 * HALVING_TOP_DOWN, the refinement: a subchain that lies within the tolerance of its segment is
 * replaced by it, otherwise its middle vertex is kept and both halves are looked at. What lies
 * below a replaced subchain is not looked at.
 *
 * HALVING_BOTTOM_UP, the hierarchy: a middle vertex goes only when all of both halves is gone and
 * the whole subchain is within the tolerance. It keeps at least the vertices that the other keeps,
 * and removing vertices in the order of their errors passes through all its chains, finest first.
 */
enum halving { HALVING_TOP_DOWN, HALVING_BOTTOM_UP };

/*
 * Fills errors[0, count): the chain at tolerance e consists of the vertices whose error is above e.
 * The ends have INFINITY. Positions: 3 floats a vertex, count at least 2. The errors do not depend
 * on the direction in which the chain is given. O(n log n).
 *
 * Every vertex of the chain lies within e of the polyline of the kept ones (in the metric; with
 * HALVING_BOTTOM_UP also every vertex dropped before).
 */
void chain_errors(const float *positions, size_t count, enum halving form,
                  const struct chain_metric *metric, float *errors);

/*
 * The same with HALVING_TOP_DOWN for one tolerance, `enough`: of a subchain that is replaced at it,
 * the middle vertex has the error, which is the largest there, and the others have 0.
 */
void chain_errors_above(const float *positions, size_t count, double enough,
                        const struct chain_metric *metric, float *errors);

#endif
