/*
 * Whether the chains of a block bound disks: P1 and P2 of patch.h, seam chains counted in.
 */
#ifndef SPBM_SIMPLIFY_CHAIN_LOOPS_H
#define SPBM_SIMPLIFY_CHAIN_LOOPS_H

#include "simplify/patch.h"

/*
 * Checks a block whose indices are all in range: each patch's chains form one simple closed loop of
 * at least three edges; the chains that meet at a junction inside the block form one fan of
 * patches; every seam vertex lies on a loop; a patch without interior vertices has the diagonals of
 * one triangulation of its loop, any other none. Adds the loops' vertices - 2 to *most_faces.
 * `what` names the block in the words of STATUS_BAD_INPUT.
 */
enum status chain_loops_check(struct context *ctx, const char *what,
                              const struct chain_block *block, uint64_t *most_faces) MUST_CHECK;

/*
 * The uses of a block's chains by patch: a use is the number of a chain (those on seams counted on
 * behind the others) times two, odd where the patch is on its right. chain_uses_count turns
 * first[0] to first[patch_count], all zero before, into where each patch's uses begin, and returns
 * their number; chain_uses_sort then fills `uses`, patch p's at first[p] to first[p + 1].
 */
uint32_t chain_uses_count(const struct chain_block *block, uint32_t *first);
void chain_uses_sort(const struct chain_block *block, uint32_t *first, uint32_t *uses);

#endif
