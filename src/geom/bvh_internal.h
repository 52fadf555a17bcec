/*
 * What building a hierarchy (bvh.c) and searching it (bvh_search.c) share.
 */
#ifndef SPBM_GEOM_BVH_INTERNAL_H
#define SPBM_GEOM_BVH_INTERNAL_H

#include "geom/bvh.h"

/* Of a value's own size, for rounding to float32. */
static const double value_slack = 0x1p-22;

/* Float32 box coordinates that the value lies between for certain. */
static inline float below(double value, double slack)
{
    return (float)(value - fabs(value) * value_slack - slack);
}

static inline float above(double value, double slack)
{
    return (float)(value + fabs(value) * value_slack + slack);
}

/* The number of the triangle in that place. */
static inline uint32_t triangle_at(const struct bvh *bvh, uint32_t place)
{
    return bvh->order ? bvh->order[place] : place;
}

#endif
