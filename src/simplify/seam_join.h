/*
 * Seams: joins what the slabs know of the edges between them into seam chains (P3, P4), each given
 * to both its blocks. Works by sorting; its memory is bounded by a limit, whatever the mesh's size.
 */
#ifndef SPBM_SIMPLIFY_SEAM_JOIN_H
#define SPBM_SIMPLIFY_SEAM_JOIN_H

#include "simplify/chain_trace.h"

struct seam_join;

struct seam_counts {
    uint64_t vertices;  /* seam vertices, each counted once */
    uint64_t junctions; /* those of them that are junctions */
    uint64_t chains;    /* seam chains, each counted once */
};

/* About `memory_limit` bytes are held in memory; the rest goes to temporary files (`beside` as in
 * temp_open, borrowed). */
enum status seam_join_open(struct context *ctx, const char *beside, uint64_t memory_limit,
                           uint32_t slab_count, struct seam_join **out) MUST_CHECK;
/* Takes the seams of the next slab, in the order of the slabs; nothing of them is kept by
 * reference. */
enum status seam_join_add(struct seam_join *join, const struct slab_seams *seams) MUST_CHECK;
/* After the last slab: makes the chains. STATUS_BAD_INPUT when the slabs contradict each other. */
enum status seam_join_link(struct seam_join *join, struct seam_counts *counts) MUST_CHECK;
/* The seam chains of the next slab, in the order of the slabs, into the seam fields of *block (all
 * else is zero): ascending by the block's own patch. The caller owns them (chain_block_clear). */
enum status seam_join_next(struct seam_join *join, struct chain_block *block) MUST_CHECK;
void seam_join_close(struct seam_join **join);

#endif
