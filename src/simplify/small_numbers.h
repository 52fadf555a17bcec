/*
 * The small numbers of the chain file: 7 bits a byte, lowest first (chain_format.md). Inline, for
 * they are most of what coding and decoding a block does.
 */
#ifndef SPBM_SIMPLIFY_SMALL_NUMBERS_H
#define SPBM_SIMPLIFY_SMALL_NUMBERS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

enum { SMALL_NUMBER_MAX = 5 }; /* bytes */

struct sink {
    unsigned char *at; /* there is room: capacities are worked out before */
};

static inline void put(struct sink *sink, uint32_t value)
{
    while (value >= 128) {
        *sink->at++ = (unsigned char)(value | 128);
        value >>= 7;
    }
    *sink->at++ = (unsigned char)value;
}

struct source {
    const unsigned char *at, *end;
    bool is_bad; /* ran out of bytes, or a number of more than 32 bits */
};

static inline uint32_t get(struct source *source)
{
    uint32_t value = 0;
    for (unsigned shift = 0; shift < 35; shift += 7) {
        if (source->at == source->end)
            break;
        unsigned byte = *source->at++;
        if (shift == 28 && byte > 15)
            break;
        value |= (uint32_t)(byte & 127) << shift;
        if (byte < 128)
            return value;
    }
    source->is_bad = true;
    return 0;
}

/* 0, -1, 1, -2, 2 ... become 0, 1, 2, 3, 4 ... */
static inline uint32_t zigzag(uint32_t difference)
{
    return difference << 1 ^ (0 - (difference >> 31));
}

static inline uint32_t unzigzag(uint32_t code)
{
    return code >> 1 ^ (0 - (code & 1));
}

/* The bits of a float as an integer that ascends with the float: all inverted below zero, else the
 * sign set. */
static inline uint32_t float_to_ordered(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits ^ (0x80000000 | (0 - (bits >> 31)));
}

static inline float ordered_to_float(uint32_t ordered)
{
    uint32_t bits = ordered ^ (0x80000000 | ((ordered >> 31) - 1));
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static inline size_t left_in(const struct source *source)
{
    return (size_t)(source->end - source->at);
}

#endif
