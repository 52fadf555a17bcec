/*
 * The two faces of each edge, as far as one slab tells.
 */
#ifndef SPBM_MESH_SLAB_MATCH_H
#define SPBM_MESH_SLAB_MATCH_H

#include "mesh/draft.h"

#define CROWDED (UINT32_MAX - 1) /* in neighbours[] of a slab in work: more than two faces */

enum { SLAB_MATCH_TABLE_BITS = 11, SLAB_MATCH_FEW = 16 };

/* A corner with all that is asked of it (slab_match.c); in builds with larger slabs than any store
 * has, for experiments, it needs more room. */
#if SPBM_SLAB_SHIFT_MAX <= 18
typedef uint64_t filed_corner;
enum { SLAB_MATCH_FIELD = 20 };
#else
__extension__ typedef unsigned __int128 filed_corner;
enum { SLAB_MATCH_FIELD = SLAB_SHIFT_MAX + 2 };
#endif

struct slab_matcher { /* one a worker; all zero before its first use */
    struct slab_scope scope;
    uint32_t *end; /* a local vertex: where its corners end, and those of the next begin */
    size_t end_capacity;
    filed_corner *corners; /* by vertex */
    size_t corner_capacity;
    uint64_t *rim; /* a bit a face of the slab: it has a vertex that other slabs use, too */
    size_t rim_capacity;
    uint64_t *sides; /* of a vertex with many faces */
    size_t side_capacity;
    uint64_t *scratch;
    size_t scratch_capacity;
    /* of the vertex in work, and what is left of others */
    uint8_t table[1 << SLAB_MATCH_TABLE_BITS]; /* by a hash of where an edge that comes in begins */
    uint32_t previous[SLAB_MATCH_FEW];         /* where it begins, by face */
};

static inline size_t slab_rim_words(const struct slab_scope *scope)
{
    return (size_t)scope->face_count / 64 + 1;
}

/*
 * Enters the slab and fills its neighbours and mates with what lies in it: NO_INDEX (mate 0) where
 * no other face does, CROWDED on all sides of edges of more than two. *is_plain: faces run along
 * edges in opposite directions, no two have the same vertices, and the faces at each vertex that no
 * other slab uses are one fan; where it is false, that may be so all the same. The matcher has the
 * slab's scope and rim.
 */
enum status slab_match(struct draft *draft, uint32_t slab, struct slab_matcher *matcher,
                       bool *is_plain) MUST_CHECK;

void slab_matcher_clear(struct slab_matcher *matcher);

#endif
