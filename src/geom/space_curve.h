/*
 * The Hilbert curve in three dimensions: numbers the cells of a cube of 2^bits cells a side so that
 * cells next to each other in number share a side, and cells near in number are near in space.
 */
#ifndef SPBM_GEOM_SPACE_CURVE_H
#define SPBM_GEOM_SPACE_CURVE_H

#include <stdint.h>

enum { SPACE_CURVE_BITS_MAX = 21 };

/* What the curve does in each of its 24 orientations: for each octant its place on the curve and
 * the orientation inside it (orientation << 3 | place). Made by space_curve_init. */
struct space_curve {
    uint8_t step[24][8];
};

void space_curve_init(struct space_curve *curve);

/* Number of the cell (x, y, z), each below 2^bits; bits at most SPACE_CURVE_BITS_MAX. */
static inline uint64_t space_curve_key(const struct space_curve *curve, uint32_t x, uint32_t y,
                                       uint32_t z, unsigned bits)
{
    uint64_t key = 0;
    unsigned orientation = 0;
    for (unsigned bit = bits; bit-- > 0;) {
        unsigned octant = (x >> bit & 1) | (y >> bit & 1) << 1 | (z >> bit & 1) << 2;
        unsigned step = curve->step[orientation][octant];
        key = key << 3 | (step & 7);
        orientation = step >> 3;
    }
    return key;
}

#endif
