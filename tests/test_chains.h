/*
 * Patches and chains of slabs in memory, and what must hold of them, checked the slow and plain
 * way: by counting, sorting and searching, with nothing of src/simplify but what is under test.
 */
#ifndef SPBM_TEST_CHAINS_H
#define SPBM_TEST_CHAINS_H

#include "simplify/chain_file.h"
#include "test_slabs.h"

struct chain_set {
    struct context *ctx;
    const struct slab_set *slabs;
    struct patch_options options;
    uint32_t **labels;      /* a slab */
    uint32_t *patch_counts; /* a slab */
    struct chain_block *blocks;
    struct chain_info info; /* counts and options; topology only as far as the file needs it */
};

/* Cosines from degrees; 4,096 faces, no tolerance. Two edges: 90 degrees. */
struct patch_options test_patch_options(double patch_angle, double face_angle, uint32_t smoothings);

/* Grows, traces and joins all slabs; any failure fails the test. */
void chain_set_build(struct context *ctx, const struct slab_set *slabs,
                     const struct patch_options *options, struct chain_set *set);
void chain_set_free(struct chain_set *set);

/* Writes the blocks as a chain file. */
void chain_set_write(const struct chain_set *set, const char *path, int level);

/* Fails the test unless every face has a label, labels are 0 .. count - 1, and every patch is
 * connected, has Euler characteristic 1, at most most_faces faces, and one boundary loop that
 * passes no vertex twice. */
void patches_must_be_disks(const struct slab *slab, const uint32_t *labels, uint32_t count,
                           uint32_t most_faces);

/* P1 to P4 of all blocks against labels and slabs; areas, counts, interior vertices, diagonals. */
void chains_must_hold(const struct chain_set *set);

/* Two blocks with the same contents, seams included. */
void blocks_must_agree(const struct chain_block *one, const struct chain_block *two,
                       uint32_t stride);

#endif
