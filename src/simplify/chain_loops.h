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

#endif
