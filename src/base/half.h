/*
 * Numbers of 16 bits: IEEE 754 binary16 without its infinities and subnormals. They keep 11 bits
 * of what needs no more, from 2^-14 to 65504; larger ones become the largest, smaller ones 0.
 */
#ifndef SPBM_BASE_HALF_H
#define SPBM_BASE_HALF_H

#include <stdint.h>
#include <string.h>

static inline uint16_t half_from_float(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    const uint32_t sign = bits >> 16 & 0x8000;
    bits &= 0x7fffffff;
    if (bits < 0x38800000)
        return (uint16_t)sign;
    if (bits > 0x477fe000)
        bits = 0x477fe000;
    return (uint16_t)(sign | (bits - 0x38000000 + 0xfff + (bits >> 13 & 1)) >> 13);
}

static inline float float_from_half(uint16_t half)
{
    const uint32_t size = half & 0x7fff, sign = (uint32_t)(half & 0x8000) << 16;
    const uint32_t bits = sign | (size ? (size << 13) + 0x38000000 : 0);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

#endif
