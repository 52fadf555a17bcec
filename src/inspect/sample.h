/*
 * Points on triangles at which distances are taken: spread evenly (not by chance alone), and the
 * same in every run, on any number of threads, because they depend on numbers of faces only.
 */
#ifndef SPBM_INSPECT_SAMPLE_H
#define SPBM_INSPECT_SAMPLE_H

#include <stdint.h>

#include "geom/distance.h"

/* A number that looks like chance and depends on `counter` alone (Steele, Lea & Flood, "Fast
 * splittable pseudorandom number generators", 2014). */
static inline uint64_t sample_hash(uint64_t counter)
{
    uint64_t z = (counter + 1) * 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

/*
 * The k-th of the points on the face number `face`. Additive recurrence in the plane (M. Roberts,
 * "The unreasonable effectiveness of quasirandom sequences", 2018) from a start of the face's own,
 * folded into the triangle: any first n of the points are spread evenly over it.
 */
static inline struct vec3 sample_point(const struct triangle *triangle, uint64_t face, uint64_t k)
{
    /* 2^64 / g and 2^64 / g^2, where g^3 = g + 1 */
    uint64_t u_bits = sample_hash(2 * face) + k * 0xc13fa9a902a6328fu;
    uint64_t v_bits = sample_hash(2 * face + 1) + k * 0x91e10da5c79e7b1cu;
    double u = (double)(u_bits >> 11) * 0x1p-53, v = (double)(v_bits >> 11) * 0x1p-53;
    if (u + v > 1) {
        u = 1 - u;
        v = 1 - v;
    }
    struct vec3 ab = vec3_sub(triangle->b, triangle->a), ac = vec3_sub(triangle->c, triangle->a);
    return vec3_add_scaled(vec3_add_scaled(triangle->a, u, ab), v, ac);
}

/* Samples of a face, when each has at least `least` and `wanted` shall be spread by area. */
static inline uint32_t sample_share(double area, double total_area, uint64_t wanted, uint32_t least)
{
    enum { MOST = 1 << 16 }; /* on one face: it then weighs more per sample */
    double share = total_area > 0 ? ceil(area / total_area * (double)wanted - 1e-6) : 0;
    uint32_t most = least > MOST ? least : MOST;
    return share > most ? most : share > least ? (uint32_t)share : least;
}

/* Walks over faces and gives each its samples so that there is one for every `spacing` of area. */
struct sample_walk {
    double spacing, next, passed;
};

static inline struct sample_walk sample_walk_begin(double spacing, uint64_t piece)
{
    double start = (double)(sample_hash(~piece) >> 11) * 0x1p-53;
    return (struct sample_walk){spacing, start * spacing, 0};
}

static inline uint32_t sample_walk_face(struct sample_walk *walk, double area)
{
    walk->passed += area;
    if (!(walk->spacing > 0) || walk->passed < walk->next)
        return 0;
    double count = floor((walk->passed - walk->next) / walk->spacing) + 1;
    count = count < 1e9 ? count : 1e9;
    walk->next += count * walk->spacing;
    return (uint32_t)count;
}

#endif
