/*
 * Patches and chains: the records that patchify makes of a slab and that the chain file keeps.
 *
 * A patch is a set of faces of one slab, a topological disk whose boundary passes no vertex twice
 * (dissertation, section 4.2.2). A chain is a maximal piece of boundary between the same two
 * patches (or a patch and the mesh border) that meets no junction inside.
 *
 * Invariants of a block (numbers are used in tests):
 *   P1  every patch is bounded by one simple closed loop of at least three chain edges;
 *   P2  walking a patch's chains with the patch on their left, end to start, gives that loop;
 *   P3  a vertex is a junction where other than two boundary edges meet; a loop that meets none has
 *       three junctions put on it that span a triangle of positive area (if there is one);
 *   P4  both copies of a seam chain (one in each of two blocks) have the same vertices, bit by bit.
 */
#ifndef SPBM_SIMPLIFY_PATCH_H
#define SPBM_SIMPLIFY_PATCH_H

#include "mesh/mesh.h"

#define NO_PATCH UINT32_MAX /* on the other side of a border chain */

/* How patches are grown (section 4.2.3): cosines, so that no libm call shapes a result. */
struct patch_options {
    double patch_cosine[2]; /* face normal against patch normal: sharing one edge, sharing two */
    double face_cosine[2];  /* face normal against the neighbour's normal, likewise */
    uint32_t smoothings;    /* times each face normal is averaged with its edge neighbours' */
    uint32_t most_faces;    /* of a patch; PATCH_FACES_MAX at most */
    double chain_tolerance; /* model units: mode collapse simplifies chains by this much; 0: chosen
                               there from the finest level. The file keeps all chain vertices. */
};

enum { PATCH_FACES_MAX = 4096 };

struct patch {
    float normal[3]; /* unit, area-weighted mean of the faces' own (unsmoothed) normals */
    float area;      /* sum of the faces' areas */
    float deviation; /* largest distance of its interior vertices from its boundary's plane */
    uint32_t interior_first; /* its interior vertices that are kept: block vertex numbers */
    uint32_t interior_count;
    uint32_t diagonal_first; /* its own diagonals, kept only when it has no interior vertex */
    uint32_t diagonal_count;
};

struct chain {
    uint32_t start, end;     /* junctions: block vertex numbers; different */
    uint32_t left, right;    /* patches, seen walking from start to end with the outside up; right
                                is NO_PATCH or an earlier one */
    uint32_t interior_first; /* interior_count block vertex numbers in a row, in order */
    uint32_t interior_count;
};

/* A chain between two slabs, as one of the two blocks sees it: left is that block's own patch. */
struct seam_chain {
    uint32_t left;         /* patch of this block */
    uint32_t other_slab;   /* NO_INDEX never: borders are not seams */
    uint32_t right;        /* patch of the other slab's block */
    uint32_t vertex_first; /* into seam_lists: block vertex numbers from start to end, in order */
    uint32_t vertex_count; /* at least 2: both junctions counted */
};

/*
 * All that level of detail knows of one slab. Vertex numbers of a block: the junctions inside it,
 * then the vertices on seams, then the chains' interior vertices in the chains' order, then the
 * patches' interior vertices in the patches' order.
 */
struct chain_block {
    uint32_t slab;
    uint32_t vertex_count;
    uint32_t junction_count;    /* vertices [0, junction_count) */
    uint32_t seam_vertex_count; /* the next ones; their store numbers in seam_vertices, ascending */
    uint32_t chain_count;
    uint32_t patch_count;
    uint32_t diagonal_count;
    uint32_t seam_chain_count;
    uint32_t seam_list_count;
    float *positions;        /* 3 a vertex, relative to the store's origin */
    unsigned char *records;  /* attributes, stride bytes a vertex; NULL when there are none */
    uint32_t *seam_vertices; /* store vertex numbers */
    struct chain *chains;
    struct patch *patches;
    uint32_t *diagonals; /* 2 a diagonal: block vertex numbers */
    struct seam_chain *seam_chains;
    uint32_t *seam_lists;
};

#endif
