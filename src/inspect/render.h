/*
 * Pictures of meshes: a software z-buffer with shading, so that people and tests can look.
 */
#ifndef SPBM_INSPECT_RENDER_H
#define SPBM_INSPECT_RENDER_H

#include "inspect/colour.h"
#include "mesh/mesh.h"

struct render_item {
    const struct mesh *mesh;
    const uint32_t *face_colours; /* 0xRRGGBB a face; NULL: the mesh's own vertex colours if it has
                                     red, green, blue, else one grey */
    const char *caption;          /* drawn below; may be NULL */
};

struct render_options {
    uint32_t width, height;  /* of one picture; side by side they add up */
    double view[3];          /* direction from the model to the eye; 0,0,0: a good default */
    double up[3];            /* 0,0,0: a good default */
    bool wireframe;          /* edges drawn over the faces */
    bool flat;               /* shade faces flat, not by vertex normals */
    uint32_t background;     /* 0xRRGGBB */
    const char *legend_name; /* with a legend of the colour map: what it shows; NULL: none */
    double legend_low, legend_high;
};

void render_defaults(struct render_options *options);

/*
 * All items in one row, with one view and one scale (models that differ more than three times in
 * size get a scale each), 4 x 4 samples a pixel, written as PNG. The first line of a caption is its
 * title. Back faces are tinted. The same items and options give the same bytes. STATUS_MISUSE for
 * no items or sides that are too small or too large.
 */
enum status render_png(struct context *ctx, const char *path, const struct render_item *items,
                       size_t item_count, const struct render_options *options) MUST_CHECK;

#endif
