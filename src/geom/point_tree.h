/*
 * Points of the grid in a tree of boxes, some of them switched on: which of those lies in a given
 * triangle? Built once; points are switched on and off as ears are cut.
 */
#ifndef SPBM_GEOM_POINT_TREE_H
#define SPBM_GEOM_POINT_TREE_H

#include "geom/simple_loop.h"

enum { POINT_TREE_FANOUT = 8, POINT_TREE_LEVELS = 11 /* 8^11 > 2^32 */ };

struct point_box {
    int32_t x_low, y_low, x_high, y_high; /* empty when x_low > x_high */
};

struct point_tree {
    const struct grid_point *points; /* borrowed */
    uint32_t count;
    uint32_t *order; /* points along a curve that keeps near ones together */
    uint32_t *rank;  /* its inverse */
    uint8_t *is_on;  /* by point */
    unsigned levels; /* level 0 has a box for every 8 points in order, and so on up to one box */
    uint32_t level_count[POINT_TREE_LEVELS];
    struct point_box *level[POINT_TREE_LEVELS];
};

/* Bytes of memory that a tree of `count` points needs, and while it is built. */
size_t point_tree_size(uint32_t count);
/* Lays the tree out in `memory` (point_tree_size bytes, aligned for uint64_t). `is_on` (one byte a
 * point, borrowed) says which points are on at first; the tree changes it later. */
void point_tree_build(struct point_tree *tree, const struct grid_point *points, uint32_t count,
                      uint8_t *is_on, void *memory);
void point_tree_switch(struct point_tree *tree, uint32_t point, bool on);

/* The first point, in the tree's order, that is on, lies in the closed counter-clockwise triangle
 * and for which accept(user, point) is true; UINT32_MAX if there is none. */
uint32_t point_tree_find(const struct point_tree *tree, struct grid_point a, struct grid_point b,
                         struct grid_point c, bool (*accept)(const void *user, uint32_t point),
                         const void *user);

#endif
