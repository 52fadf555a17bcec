/*
 * Unit vectors in four bytes: a point on the octahedron |x| + |y| + |z| = 1, unfolded into a
 * square, each of its two coordinates a multiple of 1/32767. The angle is kept to about 0.003
 * degrees.
 */
#ifndef SPBM_SIMPLIFY_UNIT_CODE_H
#define SPBM_SIMPLIFY_UNIT_CODE_H

#include <stdint.h>

/* The code of a vector of any length but zero (which gets that of (0, 0, 1)). unit_encode of what
 * unit_decode gave is the same code. */
uint32_t unit_encode(const double vector[3]);
/* False when no unit_encode gives that code. The same bits on every machine. */
int unit_decode(uint32_t code, float unit[3]);

#endif
