/*
 * What patches lose when they become flat, given back to their vertices.
 */
#ifndef SPBM_SIMPLIFY_SMALL_BULGE_H
#define SPBM_SIMPLIFY_SMALL_BULGE_H

#include <stdint.h>

/* Of one vertex; all zero at first, and on a multiple of 16 bytes. */
struct bulge {
    _Alignas(16) float sum[3]; /* of the heights of the patches round it, along their normals */
    float count;               /* of these patches; INFINITY: the vertex stays */
};

void bulge_hold(struct bulge *bulges, uint32_t vertex);

/* Adds a patch to the vertices of its loop: its unit normal, its area, and the height of its
 * farthest inner vertex above its faces (0: it has none). */
void bulge_note(struct bulge *bulges, const uint32_t *loop, uint32_t count, const float normal[3],
                float area, double height);

/* Moves a vertex by `part` of the mean of its patches' heights. */
void bulge_move(const struct bulge *bulge, double part, float position[3]);

#endif
