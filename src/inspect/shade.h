/*
 * From samples to pixels: light, colours, edges, and the darkening of hollows.
 */
#ifndef SPBM_INSPECT_SHADE_H
#define SPBM_INSPECT_SHADE_H

#include "inspect/camera.h"
#include "inspect/picture.h"
#include "inspect/raster.h"

/* What a face is made of. */
struct surface {
    const struct mesh *mesh;
    const struct screen_vertex *vertices; /* on the screen */
    const uint32_t *face_colours;         /* or NULL, and then ... */
    const unsigned char *red;             /* ... colours of the vertices: the first red, ... */
    const unsigned char *green, *blue;    /* ... stride bytes from one to the next; or NULL: grey */
    size_t colour_stride;
    const float *normals; /* of the vertices, 3 each, unit; NULL: faces are flat */
    bool wireframe;
};

/* A mesh's picture before it comes onto the background. */
struct layer {
    uint32_t width, height;
    float *colour;   /* light, 3 a pixel, times coverage */
    float *coverage; /* share of the pixel that the mesh covers */
    float *distance; /* from the eye's plane, in eye distances; 0 where nothing is */
};

enum status layer_create(struct context *ctx, uint32_t width, uint32_t height,
                         struct layer *layer) MUST_CHECK;
void layer_clear(struct context *ctx, struct layer *layer);

/* Fills the layer's rows of the band. */
void shade_band(const struct surface *surface, const struct camera *camera,
                const struct raster_band *band, struct layer *layer);

/* Darkens what lies in hollows, for one row. `out` gets the row's light, 3 a pixel. */
void shade_hollows(const struct layer *layer, const struct camera *camera, uint32_t row,
                   float *out);

#endif
