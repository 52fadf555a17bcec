/*
 * What draft_number.c and number_buckets.c share: a numbering while it is made.
 */
#ifndef SPBM_MESH_NUMBER_INTERNAL_H
#define SPBM_MESH_NUMBER_INTERNAL_H

#include "base/bucket_file.h"
#include "base/prefault.h"
#include "mesh/draft.h"

enum { NUMBER_ID_BATCH = 4096 };

struct numbering {
    struct draft *draft;
    struct spool number_spool;
    uint32_t *number_of; /* id -> new number + 1, 0: not used yet */
    uint64_t id_count;
    struct spool id_spool; /* new number -> id */
    uint32_t ids[NUMBER_ID_BATCH];
    size_t id_used;
    bool is_identity;
    uint32_t next;
    uint32_t slab_first; /* the slab's first own vertex */
    uint64_t foreign_corners;
    uint64_t kept, read;  /* faces */
    struct visits visits; /* of number_of */
    uint64_t most_visits;
    bool expects_order;       /* faces are as the input has them, and may get another order */
    bool is_futile;           /* likely so, and it can be made of ids as well */
    struct prefault prefault; /* of what the numbering will fill, and the matching after it */

    /* by buckets */
    unsigned part_shift;
    size_t parts;
    struct bucket_file within; /* a corner: id within its part */
    struct bucket_file ranks;  /* a corner: rank of its id within the part */
    struct bucket_file owners; /* a rank: id within the part */
    struct bucket_file starts; /* a rank: number */
    struct bucket_file results;
    uint32_t *known; /* a part: ranks that have a number */
};

/* The next number is that of `id`. */
static inline enum status number_note_id(struct numbering *n, uint32_t id)
{
    n->is_identity = n->is_identity && id == n->next;
    n->ids[n->id_used++] = id;
    n->next++;
    if (n->id_used < NUMBER_ID_BATCH)
        return STATUS_OK;
    n->id_used = 0;
    return spool_append(&n->id_spool, n->ids, sizeof n->ids);
}

/* A corner with a number: is its vertex one of an earlier slab? */
static inline void number_note_use(struct numbering *n, uint32_t number)
{
    if (number < n->slab_first) {
        n->draft->shared[number >> 3] |= (unsigned char)(1u << (number & 7));
        n->foreign_corners++;
    }
}

/* ---- slabs ---- */

/* A slab compact in space has half as many vertices as faces. If the first has more than it has
 * faces, the order is likely to be scattered. */
static inline void number_judge_first_slab(struct numbering *n)
{
    const struct draft *draft = n->draft;
    n->is_futile = n->next > (uint64_t)1 << draft->slab_shift &&
                   draft->slab_shift >= JUDGED_SHIFT_MIN && !draft_orders_near(draft, n->id_count);
}

static inline void number_note_slab(struct numbering *n, uint64_t kept)
{
    if (kept >> n->draft->slab_shift == 1 && n->expects_order)
        number_judge_first_slab(n);
    n->slab_first = n->next;
    n->draft->vertex_first[kept >> n->draft->slab_shift] = n->next;
}

/* Face `kept` begins a slab. */
static inline enum status number_begin_slab(struct numbering *n, uint64_t kept, uint64_t read)
{
    struct draft *draft = n->draft;
    const uint64_t slab = (uint64_t)1 << draft->slab_shift;
    uint64_t from = kept > slab ? kept - slab : 0;
    spool_forget(&draft->face_spool, from * 12, (read - from) * 12);
    spool_expect(&draft->face_spool, read * 12, slab * 12 + SWEEP_AHEAD);
    number_note_slab(n, kept);
    return step(draft->ctx, "import: number", read, draft->face_count);
}

/* ---- number_buckets.c ---- */

/* Numbers all corners, which are ids, and cuts the slabs; faces that repeat a vertex close up. Of
 * the first n->read faces this has been done already: n->kept are left of them. */
enum status number_by_buckets(struct numbering *n) MUST_CHECK;

#endif
