/*
 * Numbers as text: the fewest digits that give the value back, without regard to the locale.
 *
 * All functions write at `to`, at most NUMBER_TEXT_MAX characters and no NUL, and return how many.
 * The digits are those of the nearest decimal of the smallest precision that is the same value
 * again when parsed. Infinite and NaN are "inf", "-inf", "nan".
 */
#ifndef SPBM_MESH_FORMAT_NUMBER_H
#define SPBM_MESH_FORMAT_NUMBER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { NUMBER_TEXT_MAX = 40 };

/* What gives this float32 back when read as a float, or as a double and then made a float. */
size_t format_float32(char *to, float value);

/* What gives this double back. `stays_double`: the reader makes a number a float32 when a float32
 * is enough for its digits (parse_number.h); zeros are added until that is not so. */
size_t format_double(char *to, double value, bool stays_double);

size_t format_unsigned(char *to, uint64_t value);
size_t format_signed(char *to, int64_t value);

#endif
