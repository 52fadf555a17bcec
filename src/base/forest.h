/*
 * Union-find: trees of joined numbers in one array, parents[i] == i at the roots. The lowest number
 * of a tree is its root, so that what comes out does not depend on the order of joining.
 */
#ifndef SPBM_BASE_FOREST_H
#define SPBM_BASE_FOREST_H

#include <stdint.h>

/* The root of i's tree; the path to it is halved on the way. */
static inline uint32_t forest_root(uint32_t *parents, uint32_t i)
{
    while (parents[i] != i) {
        parents[i] = parents[parents[i]];
        i = parents[i];
    }
    return i;
}

static inline void forest_join(uint32_t *parents, uint32_t a, uint32_t b)
{
    a = forest_root(parents, a);
    b = forest_root(parents, b);
    if (a < b)
        parents[b] = a;
    else
        parents[a] = b;
}

#endif
