/*
 * Mode collapse from the root on: one small mesh in, levels out.
 */
#ifndef SPBM_SIMPLIFY_LOD_LEVELS_H
#define SPBM_SIMPLIFY_LOD_LEVELS_H

#include "simplify/chain_trunk.h"
#include "simplify/lod_target.h"

/* What the levels are made of, and by what. */
struct lod_root {
    struct collapse_mesh *mesh; /* is given away; not looked at where the trunk has a state */
    struct trunk *trunk;        /* `lost` and `small_faces` are known; its state is given away */
    const char *chains;         /* where the trunk is to be kept; NULL: nowhere */
    struct collapse_options collapse; /* effort is at most 3 */
    const struct milestones *milestones;
};

/* Whether levels, the finest of so many faces, begin where the file's coarsest milestone is, with a
 * state of its own that is kept, too: those of at most half as many faces. */
bool lod_begins_lower(const struct milestones *milestones, uint64_t faces);

/* Makes and writes all levels of the report, and fills in what each has become. */
enum status lod_levels_make(struct context *ctx, const struct chain_info *info,
                            const struct lod_options *options, const struct lod_root *root,
                            struct lod_report *report) MUST_CHECK;

#endif
