/*
 * What the steps of joining seams share: seam_join.c has the four sorts, seam_link.c makes chains
 * of the edges between two patches.
 */
#ifndef SPBM_SIMPLIFY_SEAM_INTERNAL_H
#define SPBM_SIMPLIFY_SEAM_INTERNAL_H

#include "base/external_sort.h"
#include "base/file.h"
#include "simplify/seam_join.h"

/* Step 3: an edge between two patches of different slabs. */
struct pair_edge {
    uint64_t left;          /* slab << 32 | patch; the lower slab */
    uint64_t right;         /* likewise */
    uint32_t from, to;      /* store vertices, the left patch on the left */
    uint32_t from_junction; /* 0 or 1 */
    uint32_t unused;
};

/* Step 4: a vertex of a seam chain, as one slab sees it. */
struct chain_vertex {
    uint64_t side;  /* slab << 32 | its own patch */
    uint64_t place; /* number of the chain << PLACE_SHIFT | place on it */
    uint32_t vertex;
    uint32_t other_slab, other_patch;
    uint32_t count; /* vertices of the chain */
};

enum { PLACE_SHIFT = 20 }; /* a boundary has far fewer than 2^20 edges */

/* What is remembered of each slab. */
struct slab_part {
    uint64_t vertex_offset; /* into the spools, in vertices */
    uint32_t vertex_count;
    uint32_t junction_count; /* of the block: the number of its first seam vertex */
};

struct seam_join {
    struct context *ctx;
    const char *beside;
    uint64_t sorter_limit;
    uint32_t slab_count;
    uint32_t slabs_added;
    uint32_t slabs_given;
    struct slab_part *parts;
    struct spool vertex_spool, position_spool; /* of all slabs' seam vertices, slab after slab */
    const uint32_t *vertices;
    const float *positions;
    struct sorter *edges, *ends, *pairs, *chains;
    /* the edges of one pair of patches, and one chain: reused */
    struct pair_edge *group;
    size_t group_capacity;
    uint32_t *next; /* of each edge of the group */
    size_t next_capacity;
    uint32_t *list;
    size_t list_capacity;
    uint64_t chain_count;
    /* the record of step 4 that belongs to the next slab */
    const struct chain_vertex *pending;
    size_t pending_count;
    size_t pending_place;
};

/* Place of a store vertex among the slab's seam vertices; STATUS_BAD_INPUT when it is not there. */
enum status seam_find_vertex(struct seam_join *join, uint32_t slab, uint32_t vertex,
                             uint32_t *place) MUST_CHECK;

/* The edges between two patches, join->group[0, count), ascending by `from`: follows them from
 * junction to junction and adds the chains to join->chains, for both slabs. */
enum status seam_link_group(struct seam_join *join, size_t count,
                            struct seam_counts *counts) MUST_CHECK;

#endif
