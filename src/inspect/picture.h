/*
 * A picture of bytes in memory, and its PNG.
 *
 * Colours are mixed in light, not in bytes: a byte's light is taken as the square of it, which is
 * close to sRGB and needs nothing but a square root back.
 */
#ifndef SPBM_INSPECT_PICTURE_H
#define SPBM_INSPECT_PICTURE_H

#include "base/report.h"

enum { PICTURE_SIDE_MAX = 32768, PICTURE_GLYPH_SIZE = 160 };

struct picture {
    uint32_t width, height;
    unsigned char *rgb; /* 3 a pixel, rows from the top */
};

/* Filled with the colour 0xRRGGBB. STATUS_MISUSE for a side of 0 or above PICTURE_SIDE_MAX. */
enum status picture_create(struct context *ctx, uint64_t width, uint64_t height, uint32_t colour,
                           struct picture *picture) MUST_CHECK;
void picture_clear(struct context *ctx, struct picture *picture);

/* Light of a byte, and back. */
static inline float light_of(uint32_t byte)
{
    float value = (float)(byte & 255) * (1.0f / 255);
    return value * value;
}
unsigned char byte_of(float light);

/* Mixes `colour` into a pixel with `share` in [0, 1]; places outside are left alone. */
void picture_blend(struct picture *picture, int64_t x, int64_t y, uint32_t colour, double share);
void picture_rectangle(struct picture *picture, int64_t x, int64_t y, int64_t width, int64_t height,
                       uint32_t colour);

/* Writes it as PNG; the same picture gives the same bytes. The file appears whole or not at all. */
enum status picture_write_png(struct context *ctx, const char *path,
                              const struct picture *picture) MUST_CHECK;

#endif
