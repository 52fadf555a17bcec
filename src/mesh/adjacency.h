/*
 * Which face lies over each edge, slab by slab, and across slabs by a sorted join.
 */
#ifndef SPBM_MESH_ADJACENCY_H
#define SPBM_MESH_ADJACENCY_H

#include "mesh/draft.h"

/* One side of an edge: the face and which of its edges; 16 bytes. */
struct edge_record {
    uint64_t key; /* lower vertex << 32 | higher vertex */
    uint32_t face;
    uint32_t edge;
};

struct adjacency {
    struct context *ctx;
    uint64_t crossing;      /* sides of edges whose other side, if any, is in another slab */
    bool is_over_limit;     /* crossing passed the limit; nothing else is valid */
    struct spool cut_spool; /* struct edge_record: all sides of edges of more than two faces */
    uint64_t cut_count;     /* sides */
    uint64_t cut_edges;     /* edges */
    bool has_duplicates;
    struct sorter *duplicates; /* faces that repeat the vertices of an earlier one, as 8-byte keys,
                                  ready to be taken (draft_drop_faces); some twice */
};

/*
 * Fills the draft's neighbours and mates (D4). Edges of more than two faces stay open on all sides
 * and are listed. Faces with the vertices of an earlier face are found. The build is given up as
 * soon as `crossing` passes crossing_limit.
 */
enum status adjacency_build(struct draft *draft, uint64_t crossing_limit,
                            struct adjacency *adjacency) MUST_CHECK;
void adjacency_clear(struct adjacency *adjacency);

#endif
