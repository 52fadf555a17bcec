/*
 * Patches without patchify: cuts a mesh into random disks, traces their chains the slow and plain
 * way, and gives them as the blocks of a chain file would be. The patches need not be flat, so
 * level of detail meets combinations that real chain files have only rarely.
 */
#ifndef SPBM_TEST_PATCHES_H
#define SPBM_TEST_PATCHES_H

#include "simplify/chain_graph.h"

struct patch_set {
    uint32_t block_count;
    struct chain_block *blocks;
    uint64_t loop_faces; /* loop vertices - 2 over all patches */
};

/* The mesh must hold M1 to M4. Patches have up to `most_faces` faces; `block_count` slabs. The same
 * arguments give the same blocks. */
void patch_set_build(const struct mesh *mesh, uint32_t most_faces, uint32_t block_count,
                     uint64_t seed, struct patch_set *set);
void patch_set_free(struct patch_set *set);

/* For chain_graph_build; the set must live as long. */
struct block_source patch_set_source(struct patch_set *set);
/* Their chain graph; stops the test program if it cannot be built. */
void patch_set_graph(struct context *ctx, struct patch_set *set, struct chain_graph *graph);

#endif
