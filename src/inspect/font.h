/*
 * A small typeface of strokes for captions: ASCII, proportional, sharp at any size.
 */
#ifndef SPBM_INSPECT_FONT_H
#define SPBM_INSPECT_FONT_H

#include <stddef.h>

#include "inspect/picture.h"

/* Width in pixels of a line of text whose capitals are `size` pixels high. */
double text_width(const char *text, double size);

/* Draws a line of text with its baseline at y and its left end at x (pixels, y down). Bytes outside
 * printable ASCII become question marks; what is outside the picture is cut off. */
void text_draw(struct picture *picture, const char *text, double x, double y, double size,
               uint32_t colour);

#endif
