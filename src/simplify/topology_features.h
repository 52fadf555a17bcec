/*
 * Features (dissertation, 5.3.2 and 5.3.3): which patches are the walls, bottoms and tops of small
 * holes, bumps and cavities.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_FEATURES_H
#define SPBM_SIMPLIFY_TOPOLOGY_FEATURES_H

#include "simplify/topology_rims.h"

struct feature_list {
    struct feature *features; /* places are relative to the store's origin */
    size_t count, capacity;
};

void feature_list_clear(struct context *ctx, struct feature_list *list);
enum status feature_list_add(struct context *ctx, struct feature_list *list,
                             const struct feature *feature) MUST_CHECK;

/*
 * Adds the small features to `list` and says in of_patch (one a patch, NO_INDEX where the patch
 * stays) to which each patch belongs. Patches that have a number already are left alone.
 */
enum status features_find(struct chain_graph *graph, const struct rim_options *options,
                          bool keep_pipes, uint32_t *of_patch,
                          struct feature_list *list) MUST_CHECK;

/* Adds the components whose box has a diagonal below `size`. */
enum status specks_find(struct chain_graph *graph, double size, uint32_t *of_patch,
                        struct feature_list *list) MUST_CHECK;

#endif
