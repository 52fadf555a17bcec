/*
 * Smooth handles and tunnels: what has no sharp rim is found by the short loops that it has.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_HANDLES_H
#define SPBM_SIMPLIFY_TOPOLOGY_HANDLES_H

#include "simplify/topology_features.h"

/*
 * Adds to `list`, as FEATURE_HANDLE, rings of patches round handles and through tunnels: taking
 * one out and filling both its sides leaves one handle less and nothing apart. The largest distance
 * of two patches' middles of such a ring is below `size`. Says in of_patch to which each patch
 * belongs; patches that have a number already are taken for filled.
 */
enum status handles_find(struct chain_graph *graph, double size, uint32_t *of_patch,
                         struct feature_list *list) MUST_CHECK;

#endif
