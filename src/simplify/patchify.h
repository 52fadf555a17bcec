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

#include "simplify/patch.h"
#include "simplify/slab_local.h"

/*
 * What one worker needs for one slab at a time; all zero before its first use, kept from slab to
 * slab. After patch_grow, `local` describes the slab, for chain_trace.
 */
struct patch_workspace {
    struct slab_local local;
    float *normals; /* face_normals.h */
    float *spare;
    uint32_t *queue;      /* the patch being grown, in order of adding */
    uint64_t *marked;     /* a bit a local vertex: belongs to the patch being grown */
    uint64_t *candidates; /* a bit a face: free, beside a finished patch; a tree of bitmaps */
    size_t face_capacity;
    size_t vertex_capacity;
};

void patch_workspace_clear(struct context *ctx, struct patch_workspace *space);

/*
 * Labels every face of `slab` with its patch: labels[0, face_count), patches numbered from 0 in the
 * order of growing. STATUS_BAD_INPUT when the slab's tables contradict themselves.
 */
enum status patch_grow(struct context *ctx, const struct slab *slab,
                       const struct patch_options *options, struct patch_workspace *space,
                       uint32_t *labels, uint32_t *patch_count) MUST_CHECK;

/* The same with a workspace of its own: the labels that a chain file's patches of that slab had,
 * given the chain file's options. */
enum status patch_labels(struct context *ctx, const struct slab *slab,
                         const struct patch_options *options, uint32_t *labels,
                         uint32_t *patch_count) MUST_CHECK;

#endif
