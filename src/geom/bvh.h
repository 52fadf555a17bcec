/*
 * A bounding volume hierarchy over triangles: "which one is nearest to this point", "which ones may
 * touch this box".
 *
 * Full 8-ary, without pointers: node i of a level has the nodes 8i to 8i+7 of the level below, and
 * node i of the lowest level the triangles order[8i] to order[8i+7]. Boxes are float32, relative to
 * an origin amid the triangles and a power of two, rounded outward. 32 bytes a triangle.
 */
#ifndef SPBM_GEOM_BVH_H
#define SPBM_GEOM_BVH_H

#include <stdint.h>

#include "base/cpu.h"
#include "base/report.h"
#include "geom/distance.h"

enum { BVH_WIDTH = 8, BVH_LEVELS_MAX = 12 };

/* Eight boxes, by coordinate, so that all are tested at once. An empty place has low > high. */
struct bvh_node {
    float low[3][BVH_WIDTH];
    float high[3][BVH_WIDTH];
};

struct bvh {
    enum cpu_level level;
    uint32_t count;  /* of triangles */
    uint32_t *order; /* their numbers, in tree order: neighbours in space are close; NULL: they
                        are numbered so */
    struct bvh_node *nodes; /* level 0 (over triangles) first, the root last */
    uint32_t node_count;
    uint32_t level_count;
    uint32_t level_first[BVH_LEVELS_MAX]; /* index of the level's first node */
    struct vec3 origin;
    double scale;            /* box coordinate = (coordinate - origin) * scale, within [-1, 1] */
    double slack;            /* by so much, in box coordinates, boxes are widened */
    const double *positions; /* borrowed */
    const uint32_t *faces;   /* borrowed; NULL: triangle f has positions[9f] to positions[9f+8] */
};

/* Builds it over `count` triangles; `positions` and `faces` as in struct mesh (every index valid,
 * every coordinate finite), and must live as long. The same input gives the same tree. The memory
 * of the build, beyond the tree, is 16 bytes a triangle. `together`: all threads of the context may
 * work on it. */
enum status bvh_build(struct context *ctx, const double *positions, const uint32_t *faces,
                      uint32_t count, bool together, struct bvh *bvh) MUST_CHECK;
/* The same for triangles whose numbers are the order already, along a space-filling curve: any
 * order is right, but a search takes the longer the farther apart are those that come one behind
 * the other. It takes no memory beyond the tree. */
enum status bvh_build_sorted(struct context *ctx, const double *positions, const uint32_t *faces,
                             uint32_t count, bool together, struct bvh *bvh) MUST_CHECK;
/* The same tree over a copy of the triangles. */
enum status bvh_copy(struct context *ctx, const struct bvh *from, const double *positions,
                     const uint32_t *faces, struct bvh *bvh) MUST_CHECK;
void bvh_clear(struct context *ctx, struct bvh *bvh);

struct nearest {
    double distance_squared;
    uint32_t triangle; /* UINT32_MAX: none within the bound */
    struct vec3 point; /* of that triangle */
};

/*
 * Looks for a triangle whose squared distance from `p` is smaller than nearest->distance_squared,
 * or equal with a lower number than nearest->triangle; what is found replaces *nearest. So the
 * caller starts with {INFINITY, UINT32_MAX} or with any upper bound, and can ask several trees in a
 * row.
 */
void bvh_nearest(const struct bvh *bvh, struct vec3 p, struct nearest *nearest);

/* Whether a triangle's squared distance from `p` is at most `square`. *leaf says where to look
 * first, and then where one was found: a point beside the last one is told in less time. UINT32_MAX
 * at first; it never matters to the answer. */
bool bvh_is_near(const struct bvh *bvh, struct vec3 p, double square, uint32_t *leaf);

/* Calls visit(user, triangle) for every triangle whose box touches [low, high], and perhaps for a
 * few more. Visiting ends early when it returns false. */
void bvh_touching(const struct bvh *bvh, struct vec3 low, struct vec3 high,
                  bool (*visit)(void *user, uint32_t triangle), void *user);

/* The triangle's corners. */
static inline struct triangle bvh_triangle(const struct bvh *bvh, uint32_t triangle)
{
    if (!bvh->faces) {
        const double *p = bvh->positions + 9 * (size_t)triangle;
        return (struct triangle){vec3_load(p), vec3_load(p + 3), vec3_load(p + 6)};
    }
    const uint32_t *corner = bvh->faces + 3 * (size_t)triangle;
    return (struct triangle){vec3_load(bvh->positions + 3 * (size_t)corner[0]),
                             vec3_load(bvh->positions + 3 * (size_t)corner[1]),
                             vec3_load(bvh->positions + 3 * (size_t)corner[2])};
}

#endif
