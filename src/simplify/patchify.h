/*
 * Patch growth on one slab (dissertation, sections 4.2.2 and 4.2.3): cuts its faces into patches,
 * each a topological disk whose boundary passes no vertex twice, nearly flat by the four cosines of
 * patch_options.
 *
 * The result depends on the slab and the options alone, so that a chain file's labels can be made
 * again from its store.
 */
#ifndef SPBM_SIMPLIFY_PATCHIFY_H
#define SPBM_SIMPLIFY_PATCHIFY_H

#include "simplify/bit_tree.h"
#include "simplify/face_normals.h"
#include "simplify/patch.h"
#include "simplify/slab_local.h"

/* Labels of what is beyond the slab. */
#define OVER_BORDER (INT32_MAX - 1u)
#define OVER_SEAM (INT32_MAX - 2u)

/* A patch that has just been grown; valid until the next one is. */
struct grown_patch {
    uint32_t number;
    uint32_t face_count;
    uint32_t edge_count;   /* of its boundary; 0: the adjacency contradicts itself */
    uint32_t inside_count; /* vertices off its boundary */
    /* Its boundary, walked with the patch on the left, from the first edge of the first face that
     * has one there; all twice over, so that no piece of it wraps round. */
    const uint32_t *vertices; /* local: where each edge starts */
    const uint32_t *others;   /* what lies over it: an earlier patch, NO_PATCH for a face that is
                                 free as yet, OVER_BORDER or OVER_SEAM */
    const uint32_t *inside;   /* local vertices */
    double area;              /* of its faces, model units */
};

/* What a face must reach to fit: its normal's cosine with the neighbour's, and with the sum of the
 * patch's. */
struct growth_bounds {
    float face, patch;
};

/* The state of growth between two patches; private to patchify.c. */
struct growth {
    struct growth_bounds bounds[2]; /* sharing one edge, sharing two */
    uint32_t *faces;                /* those of slab_local; the user's number of a face is its
                                       label's complement: 0 is NO_PATCH, a free face */
    const float *normals;
    uint64_t *marks;
    struct queued *queue;
    struct ring *ring;
    uint32_t *inside;
    struct bit_tree candidates; /* free faces beside a finished patch, and some no longer free */
    uint32_t face_count;
    uint32_t left;   /* free faces */
    uint32_t lowest; /* no face below is free */
    uint32_t most_faces;
    double area_factor;
    uint32_t patch;      /* the next one */
    struct queued *tail; /* of the last one's queue */
};

/* What one worker needs for one slab at a time; all zero before its first use, kept from slab to
 * slab. */
struct patch_workspace {
    struct slab_local local;
    float *normals;        /* face_normals.h */
    uint32_t *vertex_room; /* a number a local vertex, for whoever traces the patches */
    /* What room holds: first a slab's bytes as read, then in their place the normals' spare and the
     * normals, then in the spare's marks, vertex_room and the rest, which is the user's; and when
     * all is grown, what the user likes. */
    unsigned char *room;
    size_t room_capacity;
    void *rest;
    size_t rest_size; /* bytes */
    /* private to patchify.c */
    float *spare;
    uint32_t *faces; /* of local; a block of its own, so that a slab that is held in memory can be
                        given back before there is room for all else */
    size_t face_capacity; /* numbers */
    struct queued *queue;
    struct ring *ring;
    uint32_t *lists; /* of the patch last grown: boundary, vertices inside, faces */
    uint64_t *candidates;
    size_t candidate_capacity;
    struct growth growth;
};

void patch_workspace_clear(struct context *ctx, struct patch_workspace *space);

/*
 * Begins growing on `slab`, which may be closed afterwards: fills space->local, the normals, and
 * labels all NO_PATCH. STATUS_BAD_INPUT when the slab's tables contradict themselves.
 */
enum status patch_growth_begin(struct context *ctx, const struct slab *slab,
                               const struct patch_options *options,
                               struct patch_workspace *space) MUST_CHECK;

/* The same for a slab of a store, which is not opened again; *slab is to be closed by the caller,
 * and has of its arrays the records only. */
enum status patch_growth_open(struct context *ctx, struct store *store, uint32_t index,
                              const struct patch_options *options, struct patch_workspace *space,
                              struct slab *slab) MUST_CHECK;

/* Begins again on the slab that patch_growth_begin was called for last, with other cosines;
 * smoothings must be the same. */
void patch_growth_again(struct patch_workspace *space, const struct patch_options *options);

/* Grows the next patch; patches are numbered from 0. False when no face is free any more. */
bool patch_growth_next(struct patch_workspace *space, struct grown_patch *patch);

/* The faces of the patch last grown: local, in the order of growing; the first is the seed. */
const uint32_t *patch_growth_faces(struct patch_workspace *space);

/* The patch of a local face, NO_PATCH if it is free. */
static inline uint32_t patch_growth_label(const struct patch_workspace *space, uint32_t face)
{
    return ~space->local.faces[FACE_STRIDE * (size_t)face + FACE_USER];
}

/* Both for a whole slab: labels[0, face_count) are its faces' patches. */
enum status patch_grow(struct context *ctx, const struct slab *slab,
                       const struct patch_options *options, struct patch_workspace *space,
                       uint32_t *labels, uint32_t *patch_count) MUST_CHECK;

/* The same with a workspace of its own: the labels that a chain file's patches of that slab had,
 * given the chain file's options. */
enum status patch_labels(struct context *ctx, const struct slab *slab,
                         const struct patch_options *options, uint32_t *labels,
                         uint32_t *patch_count) MUST_CHECK;

#endif
