/*
 * A weak perspective from a little above and to the side: parallel projection makes solids look
 * flat, a strong one makes them look small. The directions are constants, so that no sine decides
 * about a pixel.
 *
 * Files do not say which way is up. Most models that people look at (scans, graphics) have y up;
 * reliefs and plans lie in the xy-plane, and what is much taller in z than wide stands on it.
 */
#include "inspect/camera.h"

static const double eye_distance = 3.4; /* in radii of the model */

static bool is_zero(const double v[3])
{
    return v[0] == 0 && v[1] == 0 && v[2] == 0;
}

void camera_choose(const double low[3], const double high[3], double view[3], double up[3])
{
    double x = high[0] - low[0], y = high[1] - low[1], z = high[2] - low[2];
    bool z_up = (z < 0.45 * x && z < 0.45 * y) || (z > 1.3 * x && z > 1.3 * y);
    if (is_zero(up)) {
        up[z_up ? 2 : 1] = 1;
    }
    if (!is_zero(view))
        return;
    if (fabs(up[2]) > fabs(up[1])) { /* z up: the front looks along -y */
        bool deep = y > 1.6 * x;
        view[0] = deep ? 1 : 0.5;
        view[1] = deep ? -0.5 : -1;
        view[2] = z < 0.2 * fmax(x, y) ? 0.95 : 0.42;
        if (up[2] < 0)
            view[2] = -view[2];
    } else { /* y up: the front looks along z */
        bool deep = z > 1.6 * x;
        view[0] = deep ? 1 : 0.5;
        view[1] = y < 0.2 * fmax(x, z) ? 0.95 : 0.38;
        view[2] = deep ? 0.5 : 1;
    }
}

void camera_aim(struct camera *camera, const double view[3], const double up[3], double radius)
{
    struct vec3 back = vec3_normalized(vec3_load(view)), upward = vec3_load(up);
    struct vec3 right = vec3_cross(upward, back);
    /* Looking along `up`: any direction will do. */
    if (!(vec3_length(right) > 1e-6 * vec3_length(upward)))
        right = vec3_cross(fabs(back.y) < 0.9 ? vec3_make(0, 1, 0) : vec3_make(0, 0, -1), back);
    camera->back = back;
    camera->right = vec3_normalized(right);
    camera->up = vec3_cross(back, camera->right);
    camera->distance = eye_distance * (radius > 0 ? radius : 1);
    camera->scale = 1;
    camera->shift_x = camera->shift_y = 0;
}

/* x, y divided by the depth, y up; and the depth. */
static struct vec3 onto_screen(const struct camera *camera, struct vec3 centre, struct vec3 p)
{
    struct vec3 at = vec3_sub(p, centre);
    double depth = camera->distance - vec3_dot(at, camera->back);
    /* The model's ball is in front of the eye; a vertex that no face uses may be anywhere. */
    depth = depth > 1e-3 * camera->distance ? depth : 1e-3 * camera->distance;
    return vec3_make(vec3_dot(at, camera->right) / depth, vec3_dot(at, camera->up) / depth, depth);
}

void camera_measure(const struct camera *camera, const struct mesh *mesh, struct vec3 centre,
                    struct frame *frame)
{
    for (uint64_t i = 0; i < 3 * mesh->face_count; i++) {
        struct vec3 p =
            onto_screen(camera, centre, vec3_load(mesh->positions + 3 * (size_t)mesh->faces[i]));
        frame->low_x = fmin(frame->low_x, p.x);
        frame->low_y = fmin(frame->low_y, p.y);
        frame->high_x = fmax(frame->high_x, p.x);
        frame->high_y = fmax(frame->high_y, p.y);
    }
}

void camera_fit(struct camera *camera, const struct frame *frame, double x, double y, double width,
                double height)
{
    double wide = frame->high_x - frame->low_x, high = frame->high_y - frame->low_y;
    double scale = fmin(wide > 0 ? width / wide : INFINITY, high > 0 ? height / high : INFINITY);
    if (!(scale < INFINITY))
        scale = 1;
    camera->scale = scale;
    camera->shift_x = x + width / 2 - scale * (frame->low_x + frame->high_x) / 2;
    camera->shift_y = y + height / 2 + scale * (frame->low_y + frame->high_y) / 2;
}

struct screen_vertex camera_project(const struct camera *camera, struct vec3 centre, struct vec3 p)
{
    struct vec3 at = onto_screen(camera, centre, p);
    double x = camera->shift_x + camera->scale * at.x, y = camera->shift_y - camera->scale * at.y;
    /* Beyond any picture; keeps floats exact enough near it. */
    x = x < -1e6 ? -1e6 : x > 1e6 ? 1e6 : x;
    y = y < -1e6 ? -1e6 : y > 1e6 ? 1e6 : y;
    return (struct screen_vertex){(float)(x * RASTER_SAMPLES), (float)(y * RASTER_SAMPLES),
                                  (float)(camera->distance / at.z)};
}
