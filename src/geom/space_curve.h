/*
 * The Hilbert curve in three dimensions: numbers the cells of a cube of 2^bits cells a side so that
 * cells next to each other in number share a side, and cells near in number are near in space.
 */
#ifndef SPBM_GEOM_SPACE_CURVE_H
#define SPBM_GEOM_SPACE_CURVE_H

#include <stdint.h>

enum { SPACE_CURVE_BITS_MAX = 21, SPACE_CURVE_SIDE_BY_SIDE = 4 };

/* What the curve does in each of its 24 orientations: for each octant its place on the curve and
 * the orientation inside it (orientation << 3 | place), and the same for each octant of an octant
 * (orientation << 6 | places). Made by space_curve_init. */
struct space_curve {
    uint8_t step[24][8];
    uint16_t two_steps[24][64];
};

void space_curve_init(struct space_curve *curve);

/* The 21 lower bits, each two zeros above the one before. */
static inline uint64_t space_curve_spread(uint64_t bits)
{
    bits &= 0x1fffff;
    bits = (bits | bits << 32) & 0x001f00000000ffffu;
    bits = (bits | bits << 16) & 0x001f0000ff0000ffu;
    bits = (bits | bits << 8) & 0x100f00f00f00f00fu;
    bits = (bits | bits << 4) & 0x10c30c30c30c30c3u;
    return (bits | bits << 2) & 0x1249249249249249u;
}

/* The octants of cell (x, y, z) in a row, 3 bits each, the coarsest first. */
static inline uint64_t space_curve_octants(uint32_t x, uint32_t y, uint32_t z)
{
    return space_curve_spread(x) | space_curve_spread(y) << 1 | space_curve_spread(z) << 2;
}

/* Numbers of `count` cells, each given by its octants, of coordinates below 2^bits; bits at most
 * SPACE_CURVE_BITS_MAX. Each step waits for the one before, so that two are taken as one, and some
 * cells side by side; with a constant count all stays in registers. */
static inline void space_curve_numbers(const struct space_curve *curve, const uint64_t *octants,
                                       unsigned count, unsigned bits, uint64_t *numbers)
{
    unsigned orientation[SPACE_CURVE_SIDE_BY_SIDE] = {0};
    for (unsigned i = 0; i < count; i++)
        numbers[i] = 0;
    if (bits & 1) {
        bits--;
        for (unsigned i = 0; i < count; i++) {
            const unsigned step = curve->step[0][octants[i] >> 3 * bits & 7];
            numbers[i] = step & 7;
            orientation[i] = step >> 3;
        }
    }
    for (; bits >= 2; bits -= 2) {
        for (unsigned i = 0; i < count; i++) {
            const unsigned step =
                curve->two_steps[orientation[i]][octants[i] >> 3 * (bits - 2) & 63];
            numbers[i] = numbers[i] << 6 | (step & 63);
            orientation[i] = step >> 6;
        }
    }
}

/* Number of the cell (x, y, z). */
static inline uint64_t space_curve_key(const struct space_curve *curve, uint32_t x, uint32_t y,
                                       uint32_t z, unsigned bits)
{
    const uint64_t octants = space_curve_octants(x, y, z);
    uint64_t key;
    space_curve_numbers(curve, &octants, 1, bits, &key);
    return key;
}

#endif
