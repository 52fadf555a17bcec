/*
 * One polygon of an outline with holes: each hole is joined to what lies to its right by a bridge
 * that is gone along there and back.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_BRIDGES_H
#define SPBM_SIMPLIFY_TOPOLOGY_BRIDGES_H

#include "simplify/topology_pairs.h"

struct outline_corner {
    double x, y;
    uint32_t vertex;
};

/* Scratch that is reused; all zero at first. */
struct bridge_workspace {
    struct bridge_node *nodes;
    size_t node_count, node_capacity;
    struct hole_start *holes;
    size_t hole_capacity;
    uint32_t *edge_bands, *corner_bands; /* the first entry of each band */
    size_t edge_band_capacity, corner_band_capacity;
    struct band_entry *entries;
    size_t entry_count, entry_capacity;
    double low, scale; /* bands: (y - low) * scale */
    uint32_t band_count;
};

void bridge_workspace_clear(struct context *ctx, struct bridge_workspace *space);

/*
 * `corners`: all loops, one after the other; loop i begins at starts[i], and starts[loop_count] is
 * their number. The first loop is the outer one, counter-clockwise; the others are holes,
 * clockwise. `polygon` gets starts[loop_count] + 2 (loop_count - 1) vertices. *possible is false if
 * a hole sees no corner to its right, or a bridge would be an edge in `taken`.
 */
enum status bridge_holes(struct context *ctx, struct bridge_workspace *space,
                         const struct outline_corner *corners, const uint32_t *starts,
                         uint32_t loop_count, const struct pair_set *taken, uint32_t *polygon,
                         bool *possible) MUST_CHECK;

#endif
