/*
 * Which levels a run is asked for, in the order in which they are made.
 */
#ifndef SPBM_SIMPLIFY_LOD_TARGET_H
#define SPBM_SIMPLIFY_LOD_TARGET_H

#include "simplify/simplify.h"

/*
 * Fills report->level_count and of each level what is wanted of it (faces, with a bound of the
 * error if one is given, or the error, in model units), finest first. A ratio is of the store's
 * faces and rounded down; every count is at least 1. STATUS_MISUSE when a value is out of range.
 */
enum status lod_target_levels(struct context *ctx, const struct target *target,
                              const struct chain_info *info, struct lod_report *report) MUST_CHECK;

/*
 * The counts, descending, that the collapses of a chain file stop at in any case, so that what is
 * done depends on the file and not on the levels that are asked for: those that it was made for (of
 * a file made for errors: a count that its patches are enough for), and the finest level that is
 * asked for where that is finer. None, when an error or a bound is asked for.
 */
struct milestones {
    uint32_t count;
    uint64_t faces[TARGETS_MAX + 1];
};

void lod_target_milestones(const struct target *target, const struct chain_info *info,
                           struct milestones *milestones);

/* The error that the level must not pass: the one asked for, or the bound that was given with a
 * count or ratio; INFINITY when there is none. */
double lod_error_bound(const struct level *level);

/* Why a level has the faces it has, from what it wanted and got. `exhausted`: nothing more could be
 * taken away. */
enum stop_reason lod_stop_reason(const struct level *level, bool exhausted);

/* STATUS_OK when every level has what it wanted, be it the count or the bound that came first; else
 * STATUS_TARGET_MISSED, with words for the first one that has not: why, and what would help. */
enum status lod_target_verdict(struct context *ctx, const struct chain_info *info,
                               const struct lod_report *report) MUST_CHECK;

#endif
