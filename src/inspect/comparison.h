/*
 * What the parts of a measurement share (private to measure*.c).
 */
#ifndef SPBM_INSPECT_COMPARISON_H
#define SPBM_INSPECT_COMPARISON_H

#include "geom/bvh.h"
#include "inspect/measure.h"
#include "inspect/original.h"
#include "inspect/precise_sum.h"

/* A point of the original close to a face of the simplified mesh: no sample of the face is farther
 * from the original than from here. Relative to the tree's origin, in float32. */
struct anchor {
    float at[3];
    float distance; /* from the face when it was found; INFINITY: none yet */
};

struct bounds {
    struct vec3 low, high; /* low > high when empty */
};

struct comparison {
    struct context *ctx;
    uint32_t least_samples;  /* a face of the simplified mesh */
    uint64_t wanted_samples; /* in all, by area */
    struct original *original;
    const struct mesh *mesh; /* the simplified one, at least one face */
    struct bvh tree;         /* over it */
    struct anchor *anchors;  /* one a face */
    double anchor_slack;     /* rounding of an anchor moves it by less */
    struct bounds *boxes;    /* of the original's pieces */
    struct measurement *result;
};

static inline struct bounds bounds_empty(void)
{
    return (struct bounds){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
}

static inline void bounds_add(struct bounds *bounds, struct vec3 p)
{
    bounds->low =
        (struct vec3){fmin(bounds->low.x, p.x), fmin(bounds->low.y, p.y), fmin(bounds->low.z, p.z)};
    bounds->high = (struct vec3){fmax(bounds->high.x, p.x), fmax(bounds->high.y, p.y),
                                 fmax(bounds->high.z, p.z)};
}

static inline bool bounds_touch(const struct bounds *a, const struct bounds *b)
{
    return a->low.x <= b->high.x && b->low.x <= a->high.x && a->low.y <= b->high.y &&
           b->low.y <= a->high.y && a->low.z <= b->high.z && b->low.z <= a->high.z;
}

/* Fills result->forward, the anchors and the boxes. */
enum status measure_forward(struct comparison *comparison) MUST_CHECK;
/* Fills result->backward, the normals, flipped faces and vertex errors. Comes after forward. */
enum status measure_backward(struct comparison *comparison) MUST_CHECK;
/* Counts the simplified mesh's faces that cross another. */
enum status measure_crossings(struct comparison *comparison, uint64_t *faces) MUST_CHECK;

#endif
