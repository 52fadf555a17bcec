/*
 * Surgery on a store that is only streamed: faces are dropped by their patches' features, the loops
 * that this leaves (and the small border loops that are to be closed) are filled, and what results
 * is told to a sink, vertices first.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_SURGERY_H
#define SPBM_SIMPLIFY_TOPOLOGY_SURGERY_H

#include <string.h>

#include "base/ranked_bits.h"
#include "mesh/store.h"
#include "simplify/patch.h"
#include "simplify/topology_features.h"
#include "simplify/topology_pairs.h"

/* A face that goes with a feature, as the store has it. */
struct wall_face {
    uint32_t face;
    uint32_t vertices[3];
    uint32_t neighbours[3];
    uint32_t feature;
    uint8_t mates;
};

/* A face's edge on the border of what stays. */
struct border_edge {
    uint32_t from, to; /* along the face: the face is on the left */
    float position[3]; /* of `from` */
};

/* A loop to be filled, with the fill on its left. */
struct fill_loop {
    size_t first; /* into corners */
    uint32_t count;
    uint32_t feature;
    bool is_crack;
};

/* A vertex in the middle of a fill that nothing else could close. */
struct fill_centre {
    float position[3]; /* relative to the store's origin */
    uint32_t model;    /* vertex whose record it takes */
};

struct surgery {
    struct context *ctx;
    struct store *store;
    uint64_t *dropped; /* a bit a face of the store */
    uint64_t dropped_count;
    struct wall_face *walls;
    size_t wall_count, wall_capacity;
    struct border_edge *borders;
    size_t border_count, border_capacity;

    uint32_t *corners; /* store vertices */
    size_t corner_count, corner_capacity;
    struct fill_loop *loops;
    size_t loop_count, loop_capacity;

    uint32_t *rim_vertices; /* on loops, ascending */
    float *rim_positions;
    size_t rim_count, rim_capacity, rim_position_capacity;
    uint64_t *used; /* a bit a vertex: first, it lies on a loop; at last, it is in the output */
    struct pair_set taken; /* edges of what stays and of fills between vertices on loops */
    uint32_t *small_faces; /* faces that stay with all three corners on loops */
    size_t small_face_count, small_face_capacity;

    uint32_t *mended; /* 3 a face: faces that stay but were changed (topology_zip.h) */
    size_t mended_count, mended_capacity;

    uint32_t *fills; /* 3 a face: store vertices, and from their number on the centres */
    size_t fill_count, fill_capacity;
    struct fill_centre *centres;
    size_t centre_count, centre_capacity;
};

/* The last of `count` records of `size` bytes whose number is not above the one asked for, or the
 * first. Each begins with its number, and they ascend. */
static inline size_t find_number(const void *records, size_t size, size_t count, uint32_t number)
{
    size_t low = 0, high = count;
    while (high - low > 1) {
        size_t middle = low + (high - low) / 2;
        uint32_t there;
        memcpy(&there, (const unsigned char *)records + middle * size, sizeof there);
        if (there <= number)
            low = middle;
        else
            high = middle;
    }
    return low;
}

/* `surgery` is all zero but for ctx and store. */
enum status surgery_begin(struct surgery *surgery) MUST_CHECK;
void surgery_clear(struct surgery *surgery);

/*
 * Drops all faces of patches with of_patch[patch] != NO_INDEX (patches of all slabs in order, grown
 * with `options`), and finds the border edges of what stays. Starts afresh when called again. With
 * `of_patch` NULL nothing is dropped.
 */
enum status surgery_cut(struct surgery *surgery, const struct patch_options *options,
                        const uint32_t *of_patch, const struct feature_list *list) MUST_CHECK;

/* Adds the loops round what was dropped. blocked[feature] is set where one does not close. */
enum status surgery_loops(struct surgery *surgery, uint8_t *blocked) MUST_CHECK;

/* Adds one loop. */
enum status surgery_add_loop(struct surgery *surgery, const uint32_t *corners, uint32_t count,
                             uint32_t feature, bool is_crack) MUST_CHECK;

/* Triangulates all loops, cracks round a new vertex where nothing else helps; blocked[feature] is
 * set where no fill leaves a manifold. */
enum status surgery_fill(struct surgery *surgery, uint8_t *blocked) MUST_CHECK;

/* Position of a vertex that lies on a loop, relative to the store's origin; after surgery_fill. */
const float *surgery_position(const struct surgery *surgery, uint32_t vertex);

/* Where the result goes. */
struct surgery_sink {
    enum status (*begin)(void *user, uint64_t vertices, uint64_t faces);
    enum status (*add_vertices)(void *user, size_t count, const double *positions,
                                const unsigned char *records);
    enum status (*add_faces)(void *user, size_t count, const uint32_t *faces);
    void *user;
};

/* Faces of the result. */
uint64_t surgery_faces(const struct surgery *surgery);

/* What stays, in the store's order, then what was mended and the fills, with the vertices that are
 * left. */
enum status surgery_write(struct surgery *surgery, const struct surgery_sink *sink) MUST_CHECK;

#endif
