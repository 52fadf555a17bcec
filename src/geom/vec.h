/*
 * Vectors of three doubles: the few operations that geometry code needs, inline. All are plain sums
 * and products evaluated in the order written (no contraction), so results are the same everywhere;
 * sqrt is correctly rounded.
 */
#ifndef SPBM_GEOM_VEC_H
#define SPBM_GEOM_VEC_H

#include <math.h>

struct vec3 {
    double x, y, z;
};

static inline struct vec3 vec3_make(double x, double y, double z)
{
    return (struct vec3){x, y, z};
}

/* From three doubles, or three floats, in a row. */
static inline struct vec3 vec3_load(const double *from)
{
    return (struct vec3){from[0], from[1], from[2]};
}

static inline struct vec3 vec3_load_float(const float *from)
{
    return (struct vec3){(double)from[0], (double)from[1], (double)from[2]};
}

static inline void vec3_store(double *to, struct vec3 a)
{
    to[0] = a.x;
    to[1] = a.y;
    to[2] = a.z;
}

static inline struct vec3 vec3_add(struct vec3 a, struct vec3 b)
{
    return (struct vec3){a.x + b.x, a.y + b.y, a.z + b.z};
}

static inline struct vec3 vec3_sub(struct vec3 a, struct vec3 b)
{
    return (struct vec3){a.x - b.x, a.y - b.y, a.z - b.z};
}

static inline struct vec3 vec3_scale(struct vec3 a, double factor)
{
    return (struct vec3){a.x * factor, a.y * factor, a.z * factor};
}

/* a + factor * b */
static inline struct vec3 vec3_add_scaled(struct vec3 a, double factor, struct vec3 b)
{
    return (struct vec3){a.x + factor * b.x, a.y + factor * b.y, a.z + factor * b.z};
}

static inline double vec3_dot(struct vec3 a, struct vec3 b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline struct vec3 vec3_cross(struct vec3 a, struct vec3 b)
{
    return (struct vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

static inline double vec3_length_squared(struct vec3 a)
{
    return vec3_dot(a, a);
}

static inline double vec3_length(struct vec3 a)
{
    return sqrt(vec3_dot(a, a));
}

static inline double vec3_distance_squared(struct vec3 a, struct vec3 b)
{
    return vec3_length_squared(vec3_sub(a, b));
}

static inline double vec3_distance(struct vec3 a, struct vec3 b)
{
    return sqrt(vec3_distance_squared(a, b));
}

/* The zero vector stays zero. */
static inline struct vec3 vec3_normalized(struct vec3 a)
{
    double length = vec3_length(a);
    return length > 0 ? (struct vec3){a.x / length, a.y / length, a.z / length} : a;
}

/* Twice the triangle's area times its normal, counter-clockwise seen from its tip. */
static inline struct vec3 triangle_normal(struct vec3 a, struct vec3 b, struct vec3 c)
{
    return vec3_cross(vec3_sub(b, a), vec3_sub(c, a));
}

#endif
