/*
 * Colours: a map from numbers to colours, and colours that are told apart. All are 0xRRGGBB.
 */
#ifndef SPBM_INSPECT_COLOUR_H
#define SPBM_INSPECT_COLOUR_H

#include <stdint.h>

/* The colour map viridis at t in [0, 1] (t outside is clamped): dark violet, blue, green, yellow;
 * as light as t is large, for everybody's eyes. */
uint32_t colour_map(double t);

/* A distinct, stable colour for the i-th of many patches: neighbours in number differ in hue. */
uint32_t colour_distinct(uint32_t i);

#endif
