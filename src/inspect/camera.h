/*
 * Where a picture is taken from, and how the model comes onto the screen.
 */
#ifndef SPBM_INSPECT_CAMERA_H
#define SPBM_INSPECT_CAMERA_H

#include "geom/vec.h"
#include "inspect/raster.h"
#include "mesh/mesh.h"

/* The eye looks along -back at the model's centre; right, up, back are unit vectors square to each
 * other. Screen coordinates are in pixels, y down. */
struct camera {
    struct vec3 right, up, back;
    double distance;         /* of the eye from the centre, in model units */
    double scale;            /* pixels for a model unit, times the distance from the eye */
    double shift_x, shift_y; /* pixels */
};

struct frame { /* what must fit: extents of all meshes on the screen of scale 1 */
    double low_x, low_y, high_x, high_y;
};

/* A good direction for a model of this box: `view` and `up` are filled in where they are zero. */
void camera_choose(const double low[3], const double high[3], double view[3], double up[3]);

/* Sets directions and distance; `radius` is that of a ball round the model. */
void camera_aim(struct camera *camera, const double view[3], const double up[3], double radius);

/* Widens the frame by the used vertices of a mesh whose centre is given. */
void camera_measure(const struct camera *camera, const struct mesh *mesh, struct vec3 centre,
                    struct frame *frame);

/* Sets scale and shift so that the frame fills the rectangle of pixels. */
void camera_fit(struct camera *camera, const struct frame *frame, double x, double y, double width,
                double height);

/* Where a point is on the screen, in samples. */
struct screen_vertex camera_project(const struct camera *camera, struct vec3 centre, struct vec3 p);

#endif
