/*
 * Planes. The frame is made from the coordinate axis that is farthest from the normal, so that it
 * never degenerates and depends on nothing but the normal.
 */
#include "geom/plane.h"

struct plane_frame plane_frame_make(struct vec3 normal)
{
    double x = fabs(normal.x), y = fabs(normal.y), z = fabs(normal.z);
    if (!(x + y + z > 0)) {
        normal = vec3_make(0, 0, 1);
        x = y = 0;
        z = 1;
    }
    struct vec3 axis = x <= y && x <= z ? vec3_make(1, 0, 0)
                       : y <= z         ? vec3_make(0, 1, 0)
                                        : vec3_make(0, 0, 1);
    struct plane_frame frame;
    frame.across = vec3_normalized(vec3_cross(axis, normal));
    frame.up = vec3_normalized(vec3_cross(normal, frame.across));
    return frame;
}

double plane_polygon_area(const struct plane_point *points, uint32_t count)
{
    double sum = 0;
    for (uint32_t i = 2; i < count; i++)
        sum += plane_turn(points[0], points[i - 1], points[i]);
    return sum;
}
