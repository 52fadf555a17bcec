/*
 * Corners: corner 3f+k is the k-th corner of face f; edge k of a face runs from corner k to the
 * next corner (k+1 mod 3), so an edge is named by the corner that it starts at.
 */
#ifndef SPBM_MESH_CORNER_H
#define SPBM_MESH_CORNER_H

#include <stdint.h>

#define NO_INDEX UINT32_MAX /* no vertex, no face; the largest valid index is UINT32_MAX - 2 */

static inline unsigned next3(unsigned k)
{
    return k == 2 ? 0 : k + 1;
}

static inline unsigned previous3(unsigned k)
{
    return k == 0 ? 2 : k - 1;
}

#endif
