/*
 * What growing patches (patchify.c) and the memory for it (patch_workspace.c) share.
 */
#ifndef SPBM_SIMPLIFY_PATCH_INTERNAL_H
#define SPBM_SIMPLIFY_PATCH_INTERNAL_H

#include "base/float4.h"
#include "simplify/patchify.h"

/* Every face of a patch adds at most two others, the seed three, and each is added by one that
 * stays. */
enum { QUEUE_SIZE = 3 * PATCH_FACES_MAX + 4 };

/* Nodes: the seed's three vertices, and the apex of each face that is added. */
enum { NODES = QUEUE_SIZE + 3 };

/* A disk of F faces has F + 2 edges on its boundary less two for each vertex inside. Boundaries are
 * listed twice over, in two lists. */
enum { BOUNDARY_MAX = PATCH_FACES_MAX + 2, INSIDE_MAX = PATCH_FACES_MAX / 2 + 1 };
enum { LISTS_SIZE = 4 * BOUNDARY_MAX + INSIDE_MAX + PATCH_FACES_MAX };

/* Nodes: vertices of the patch at hand, and the edges of its boundary that start there; stale once
 * they lie inside. */
struct ring {
    uint32_t vertex[NODES];
    uint32_t next[NODES]; /* node that the edge ends at */
    uint32_t link[NODES]; /* over the edge */
};

/* Of a vertex: the patch that it came into last << 32 | its node there. */
typedef uint64_t vertex_mark;
#define NO_MARK UINT64_MAX

/* A face of the patch that waits for its neighbours to be looked at: those over the two edges that
 * it brought to the boundary. (Of one that shares two edges, the second is none.) */
struct queued {
    uint32_t link; /* it was added over; NO_INDEX: taken away again */
    uint32_t over[2];
    uint32_t from[2]; /* nodes that the edges start at; the second is the apex */
};

#endif
