/*
 * Numbers in text, parsed fast, correctly rounded and without regard to the locale.
 *
 * All functions look at [at, end) only, do not skip blanks, and return the byte behind the number,
 * or NULL when no number begins at `at` (or it is too large, or too long, to be one). They do not
 * look at what follows: callers check that it is a separator.
 */
#ifndef SPBM_MESH_PARSE_NUMBER_H
#define SPBM_MESH_PARSE_NUMBER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/bytes.h"

enum { NUMBER_LENGTH_MAX = 1024 }; /* longer ones are refused */

struct parsed_number {
    double value; /* the double nearest to the text; infinite or NaN when the text says so */
    /* A float32 is enough for what the text says: converted to it and printed with as many decimals
     * as were given, it is the text again. That is, |(float)value - value| is at most half a unit
     * of the last decimal. */
    bool fits_float32;
    bool is_integer; /* no point, no exponent */
};

/* [+-] digits [. digits] [e [+-] digits], or inf, infinity, nan in any case. */
const unsigned char *parse_real(const unsigned char *at, const unsigned char *end,
                                struct parsed_number *number);

/* The rule above for a value whose text ends with the digit of 10^exponent. */
bool float32_is_enough(double value, int64_t exponent);

/* [+-] digits, within int64. */
const unsigned char *parse_integer(const unsigned char *at, const unsigned char *end,
                                   int64_t *value);

/* ---- digits eight at a time: eight bytes in a row, the first in the lowest byte ---- */

/* How many digits they begin with. */
static inline unsigned digits_in_front(uint64_t bytes)
{
    const uint64_t digits = bytes ^ 0x3030303030303030u; /* 0 to 9 where there are any */
    /* What is larger carries upwards, away from the first one that is. */
    const uint64_t others = ((digits + 0x7676767676767676u) | digits) & 0x8080808080808080u;
    return others ? (unsigned)__builtin_ctzll(others) / 8 : 8;
}

/* Value of the first `count` of them, 1 to 8, which are digits: pairs, then fours, then all eight
 * are joined in one multiplication each. */
static inline uint32_t value_of_digits(uint64_t bytes, unsigned count)
{
    bytes = (bytes & 0x0f0f0f0f0f0f0f0fu) << (64 - 8 * count);
    bytes = bytes * 10 + (bytes >> 8);
    bytes = ((bytes & 0x000000ff000000ffu) * (100 + (1000000ull << 32)) +
             (bytes >> 16 & 0x000000ff000000ffu) * (1 + (10000ull << 32))) >>
            32;
    return (uint32_t)bytes;
}

/* Digits only, at most UINT32_MAX. */
static inline const unsigned char *parse_index(const unsigned char *at, const unsigned char *end,
                                               uint32_t *value)
{
    uint64_t sum = 0;
    const unsigned char *first = at;
    for (; at < end && (unsigned char)(*at - '0') < 10 && at - first < 11; at++)
        sum = 10 * sum + (unsigned char)(*at - '0');
    *value = (uint32_t)sum;
    return at == first || sum > UINT32_MAX ? NULL : at;
}

#endif
