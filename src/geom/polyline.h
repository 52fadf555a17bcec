/*
 * Polylines in space: how far points lie from a segment that is to replace them.
 */
#ifndef SPBM_GEOM_POLYLINE_H
#define SPBM_GEOM_POLYLINE_H

#include <stddef.h>

#include "geom/vec.h"

/* The vector from the point of the segment ab that is nearest to p, to p. Its length is p's
 * distance from the segment. */
static inline struct vec3 segment_offset(struct vec3 p, struct vec3 a, struct vec3 b)
{
    struct vec3 along = vec3_sub(b, a), offset = vec3_sub(p, a);
    double length_squared = vec3_length_squared(along), part = vec3_dot(offset, along);
    if (!(part > 0) || !(length_squared > 0))
        return offset;
    if (part >= length_squared)
        return vec3_sub(p, b);
    return vec3_add_scaled(offset, -(part / length_squared), along);
}

/* Which of the two directions of a polyline is the canonical one: the one whose vertices, read from
 * their end on, come first in lexical order of their coordinates. Two copies of a polyline agree on
 * it, whichever way round they are kept. Positions: 3 floats a vertex. True: from the last vertex
 * to the first. */
int polyline_runs_backwards(const float *positions, size_t count);

#endif
