/*
 * From the root to the levels, so that a level is the same whatever company it is made in.
 *
 * The plain way is to stop at each level in turn, and to go on from there. But the way to a count
 * is not the way that passes it: the last sweeps before are smaller, and errors are measured
 * against a copy of the mesh at a few times the count. So a level would depend on the finer ones
 * that were asked for with it, and one that is made next week would be another.
 *
 * Instead there is one sequence, the *trunk*, that depends on the chain file: it stops at the
 * counts that the file was made for, its milestones, finest first, and below them at every
 * BELOW-th part, whether they are asked for or not. A level that is one of the first is the trunk
 * as it stands there (and so the bytes are those that `spbm simplify` gave when it made the file);
 * any other leaves the trunk at a place that its count alone decides, as a copy, a few times above
 * it. The coarsest level takes the trunk itself. Five levels cost hardly more than the coarsest of
 * them this way, where the way from root to root would be the same.
 *
 * Two states of the trunk are kept in the chain file, so that a further level need not go all the
 * way: one before the finest milestone, where collapses begin to be measured, and one at the
 * coarsest. From the lower one those go on that have at most half its faces: they are measured by a
 * copy of the mesh that is taken further down. So that it does not matter whether it was kept, the
 * trunk always goes on from there as if it had been.
 *
 * Where errors are asked for, the milestones are the levels themselves.
 */
#include "simplify/lod_levels.h"

#include <math.h>

#include "simplify/lod_output.h"

/* A level of at most so many faces is made so many times, by effort, from so many times its faces
 * on. */
static const uint64_t TRIED_FACES[4] = {0, 0, 2500, 5000};
static const uint32_t TRIES[4] = {1, 1, 3, 5};
enum { TRIED_FROM = 8, TRIED_FROM_LEAST = 6000 };
/* Other levels leave the trunk at so many times their faces, before their reference is taken. */
enum { LEFT_FROM = 3 };
/* From the coarsest milestone to the next that is not the file's, and so on. */
enum { BELOW = 8 };
/* Levels of at most this part of the coarsest milestone go on from the lower state. */
enum { LOWER_PART = 2 };

/* The largest distance of a level is about so many times the mean. */
static const double MEAN_WEIGHT = 8;

struct levels {
    struct context *ctx;
    const struct chain_info *info;
    const struct lod_options *options;
    const struct lod_root *root;
    const struct milestones *milestones;
    struct lod_report *report;
    uint32_t effort; /* where the tables by effort are looked into */
    struct collapse *trunk;
    struct packed_trunk packed; /* the states that are to be kept */
    uint32_t next;              /* of the milestones */
    uint64_t goal;              /* its faces */
    bool is_lower;              /* the trunk has gone on from the lower state */
};

/* ---- one level ---- */

static bool is_small(const struct levels *levels, uint64_t faces)
{
    return faces <= TRIED_FACES[levels->effort];
}

/* Where the tries of a small level begin. */
static uint64_t tried_from(uint64_t faces)
{
    return TRIED_FROM * faces > TRIED_FROM_LEAST ? TRIED_FROM * faces : TRIED_FROM_LEAST;
}

/* What one try of a level came to. */
struct outcome {
    uint64_t faces;
    double largest, mean; /* distances */
};

/*
 * Which of two is the better level: one that keeps the bound, then fewer faces where only an error
 * is asked for, else the smaller distances: the largest, and the mean with a weight that makes both
 * count alike. (Edges that wait for their errors may double the mean of a part where the largest
 * distance is the same.)
 */
static bool is_better(const struct level *level, const struct outcome *a, const struct outcome *b)
{
    const double bound = lod_error_bound(level);
    if (a->largest > bound || b->largest > bound)
        return a->largest < b->largest;
    const uint64_t wanted = level->wanted_faces;
    const uint64_t faces = a->faces > wanted ? a->faces : wanted;
    const uint64_t others = b->faces > wanted ? b->faces : wanted;
    return faces != others
               ? faces < others
               : a->largest + MEAN_WEIGHT * a->mean < b->largest + MEAN_WEIGHT * b->mean;
}

static enum status find_outcome(const struct collapse *collapse, bool is_compared,
                                struct outcome *outcome)
{
    outcome->faces = collapse_faces(collapse);
    outcome->mean = is_compared ? collapse_mean_error(collapse) : 0;
    return collapse_error(collapse, &outcome->largest);
}

/*
 * Runs down to a level. The largest distance hangs on chance, on which edge came before which other
 * at a few places: runs of other orders have the same means and largest distances that differ by
 * tens of percent. So small meshes, where it costs next to nothing, are run several times and the
 * best is taken.
 */
static enum status run_to_level(const struct levels *levels, struct collapse **collapse,
                                struct level *level)
{
    const uint64_t faces = level->wanted_faces, begin = tried_from(faces);
    const uint64_t least =
        faces > 0 ? faces : (collapse_faces(*collapse) + TRIED_FROM - 1) / TRIED_FROM;
    const bool small = is_small(levels, least);
    const uint32_t tries = small ? TRIES[levels->effort] : 1;
    struct collapse *start = *collapse, *best = NULL;
    struct outcome best_outcome = {0};
    enum status status = STATUS_OK;
    if (tries > 1 && collapse_faces(start) > begin && faces > 0)
        status = collapse_approach(start, begin, lod_error_bound(level));
    for (uint32_t i = 0; i < tries && status == STATUS_OK; i++) {
        struct collapse *next = NULL;
        struct outcome outcome = {0};
        if (i + 1 < tries) {
            status = collapse_copy(start, &next); /* the last goes on as it did */
            if (status == STATUS_OK)
                collapse_set_variant(next, i + 1);
        } else {
            next = start;
            start = NULL;
        }
        if (status == STATUS_OK)
            status = collapse_run(next, level->wanted_faces, lod_error_bound(level));
        if (status == STATUS_OK)
            status = find_outcome(next, tries > 1, &outcome);
        if (status == STATUS_OK && (!best || is_better(level, &outcome, &best_outcome))) {
            struct collapse *worse = best;
            best = next;
            next = worse;
            best_outcome = outcome;
        }
        collapse_end(&next);
    }
    collapse_end(&start);
    level->error = best_outcome.largest;
    *collapse = best;
    return status;
}

static enum status write_level(const struct levels *levels, struct collapse *collapse,
                               uint32_t index)
{
    struct level *level = &levels->report->levels[index];
    struct mesh mesh;
    level->error = fmax(level->error, levels->root->trunk->lost);
    enum status status = collapse_extract(collapse, &mesh, NULL);
    if (status != STATUS_OK)
        return status;
    for (size_t i = 0; i < (size_t)mesh.vertex_count * 3; i++)
        mesh.positions[i] += levels->info->origin[i % 3];
    mesh.is_float32 = levels->info->is_float32;
    mesh.attributes = levels->info->attributes;
    level->vertices = mesh.vertex_count;
    level->faces = mesh.face_count;
    level->reason = lod_stop_reason(level, collapse_exhausted(collapse));
    status = lod_output_mesh(levels->ctx, levels->options, index, &mesh);
    mesh_clear(levels->ctx, &mesh);
    return status;
}

/* ---- the trunk ---- */

static bool is_of_file(const struct levels *levels)
{
    return levels->next < levels->milestones->count;
}

static void set_next_goal(struct levels *levels)
{
    if (is_of_file(levels))
        levels->next++;
    const uint64_t below = levels->goal / BELOW;
    levels->goal = is_of_file(levels) ? levels->milestones->faces[levels->next]
                   : below > 0        ? below
                                      : 1;
}

bool lod_begins_lower(const struct milestones *milestones, uint64_t faces)
{
    const uint32_t count = milestones->count;
    return count > 0 && faces <= milestones->faces[count - 1] / LOWER_PART;
}

static bool begins_lower(const struct levels *levels, const struct level *level)
{
    return lod_begins_lower(levels->milestones, level->wanted_faces);
}

static struct collapse_options trunk_options(const struct levels *levels)
{
    struct collapse_options options = levels->root->collapse;
    options.together = true;
    options.measured = true;
    return options;
}

/* Whether the trunk's states are to be kept: a lower one that the file has stays. */
static bool is_to_be_kept(const struct levels *levels, bool is_lower)
{
    return levels->root->chains && levels->milestones->count > 0 &&
           !(is_lower && levels->root->trunk->has_lower);
}

/* Makes *collapse, which is ended, the trunk's kept state; its section, where it is to be kept. */
static enum status take_state(struct levels *levels, struct collapse **collapse, bool is_lower)
{
    struct trunk *kept = levels->root->trunk;
    enum status status = collapse_save(collapse, &kept->state);
    if (status != STATUS_OK || !is_to_be_kept(levels, is_lower))
        return status;
    kept->is_lower = is_lower;
    kept->subset = levels->root->collapse.subset;
    kept->effort = levels->effort;
    kept->finest = levels->milestones->faces[0];
    return chain_trunk_pack(levels->ctx, kept, levels->info->attributes.stride, &levels->packed);
}

/* The trunk goes on from the kept state. */
static enum status go_on_from_state(struct levels *levels)
{
    const struct collapse_options options = trunk_options(levels);
    return collapse_resume(levels->ctx, &options, &levels->root->trunk->state,
                           &levels->info->attributes, &levels->trunk);
}

/*
 * Takes the trunk to the place where what goes to the finest count begins to be measured, or tried
 * several times. From there on it is little work, so that its state is one to be kept. (Where it is
 * held back by a bound before, there is no such place.)
 */
static enum status go_to_state(struct levels *levels)
{
    const struct level *finest = &levels->report->levels[0];
    const uint64_t goal = levels->milestones->count > 0 ? levels->goal : finest->wanted_faces;
    const double bound = lod_error_bound(finest);
    const uint64_t faces =
        is_small(levels, goal) ? tried_from(goal) : collapse_measured_from(levels->trunk, goal);
    if (faces == 0)
        return STATUS_OK;
    enum status status = collapse_approach(levels->trunk, faces, bound);
    if (status == STATUS_OK && bound < INFINITY && collapse_faces(levels->trunk) > faces)
        return STATUS_OK;
    if (status == STATUS_OK)
        status = take_state(levels, &levels->trunk, false);
    return status == STATUS_OK ? go_on_from_state(levels) : status;
}

/* The trunk, where the first milestone is the next goal, or behind the last one. */
static enum status begin_trunk(struct levels *levels)
{
    const struct attributes *attributes = &levels->info->attributes;
    const struct collapse_options options = trunk_options(levels);
    struct trunk *kept = levels->root->trunk;
    if (kept->finest > 0 && kept->is_lower) {
        levels->next = levels->milestones->count - 1;
        levels->goal = levels->milestones->faces[levels->next];
        levels->is_lower = true;
        set_next_goal(levels);
    }
    if (kept->finest > 0)
        return chain_trunk_resume(levels->ctx, levels->info, &options, kept, &levels->trunk);
    enum status status = collapse_begin_giving(levels->ctx, &options, levels->root->mesh,
                                               attributes, &levels->trunk);
    if (status == STATUS_OK && levels->report->levels[0].wanted_faces > 0)
        status = go_to_state(levels);
    return status;
}

/*
 * Where the trunk stands at the coarsest milestone: takes the lower state if it is to be kept or if
 * levels, of which `index` is the next, go on from there. Those before them still need the trunk as
 * it is.
 */
static enum status take_lower_state(struct levels *levels, uint32_t index)
{
    const struct lod_report *report = levels->report;
    const uint32_t count = report->level_count;
    const struct level *last = &report->levels[count - 1];
    const bool is_wanted = index < count && begins_lower(levels, last);
    const bool is_needed = index < count && !begins_lower(levels, &report->levels[index]);
    struct collapse *copy = NULL;
    enum status status = STATUS_OK;
    if (!is_wanted && !is_to_be_kept(levels, true))
        return STATUS_OK;
    if (is_needed)
        status = collapse_copy(levels->trunk, &copy);
    if (status == STATUS_OK)
        status = take_state(levels, is_needed ? &copy : &levels->trunk, true);
    return status;
}

/* Takes the trunk to its goal, on the way to a level, and chooses the next. */
static enum status pass_goal(struct levels *levels, uint32_t index)
{
    struct level level = {.wanted_faces = levels->goal};
    const bool was_of_file = is_of_file(levels);
    collapse_pause_at(levels->trunk, 0);
    enum status status;
    if (was_of_file && is_small(levels, levels->goal))
        status = run_to_level(levels, &levels->trunk, &level);
    else
        status = collapse_run(levels->trunk, levels->goal, INFINITY);
    set_next_goal(levels);
    if (status == STATUS_OK && was_of_file && !is_of_file(levels))
        status = take_lower_state(levels, index);
    return status;
}

/* Takes the trunk past all goals that are finer than a level. */
static enum status pass_goals(struct levels *levels, uint32_t index)
{
    const struct level *level = &levels->report->levels[index];
    enum status status = STATUS_OK;
    while (status == STATUS_OK) {
        if (!is_of_file(levels) && !levels->is_lower && begins_lower(levels, level)) {
            collapse_end(&levels->trunk);
            levels->is_lower = true;
            status = go_on_from_state(levels);
        } else if (levels->goal > level->wanted_faces) {
            status = pass_goal(levels, index);
        } else {
            break;
        }
    }
    return status;
}

/*
 * Takes the trunk, on its way to its goal, to the place where a level of so many faces leaves it:
 * the first one between two sweeps where no more are left than a number that grows with the
 * level's, so that the places of coarser levels come later. (A milestone may have been passed
 * later than that.)
 */
static enum status go_to_branch(struct levels *levels, uint64_t faces)
{
    const uint64_t most_tried = TRIED_FROM * TRIED_FACES[levels->effort];
    uint64_t place = faces < UINT64_MAX / LEFT_FROM ? LEFT_FROM * faces : UINT64_MAX;
    if (is_small(levels, faces))
        place = tried_from(faces);
    else if (place < most_tried)
        place = most_tried;
    collapse_pause_at(levels->trunk, place);
    if (!is_of_file(levels) || !is_small(levels, levels->goal))
        return collapse_run(levels->trunk, levels->goal, INFINITY);
    const uint64_t begin = tried_from(levels->goal);
    return collapse_faces(levels->trunk) > begin ? collapse_approach(levels->trunk, begin, INFINITY)
                                                 : STATUS_OK;
}

/* The level that is the next milestone. */
static enum status make_milestone(struct levels *levels, uint32_t index)
{
    collapse_pause_at(levels->trunk, 0);
    enum status status = run_to_level(levels, &levels->trunk, &levels->report->levels[index]);
    set_next_goal(levels);
    if (status == STATUS_OK)
        status = write_level(levels, levels->trunk, index);
    if (status == STATUS_OK && !is_of_file(levels))
        status = take_lower_state(levels, index + 1);
    return status;
}

/* A level by count alone. */
static enum status make_counted(struct levels *levels, uint32_t index)
{
    struct level *level = &levels->report->levels[index];
    const uint64_t faces = level->wanted_faces;
    struct collapse *branch = NULL;
    enum status status = pass_goals(levels, index);
    if (status != STATUS_OK)
        return status;
    if (levels->goal == faces && is_of_file(levels))
        return make_milestone(levels, index);
    status = go_to_branch(levels, faces);
    if (status == STATUS_OK && index + 1 == levels->report->level_count) {
        branch = levels->trunk;
        levels->trunk = NULL;
        collapse_pause_at(branch, 0);
    } else if (status == STATUS_OK) {
        status = collapse_copy(levels->trunk, &branch);
    }
    if (status == STATUS_OK)
        status = run_to_level(levels, &branch, level);
    if (status == STATUS_OK)
        status = write_level(levels, branch, index);
    collapse_end(&branch);
    return status;
}

enum status lod_levels_make(struct context *ctx, const struct chain_info *info,
                            const struct lod_options *options, const struct lod_root *root,
                            struct lod_report *report)
{
    struct levels levels = {.ctx = ctx,
                            .info = info,
                            .options = options,
                            .root = root,
                            .milestones = root->milestones,
                            .report = report,
                            .effort = root->collapse.effort,
                            .goal = root->milestones->faces[0]};
    enum status status = begin_trunk(&levels);
    for (uint32_t i = 0; i < report->level_count && status == STATUS_OK; i++) {
        if (root->milestones->count > 0) {
            status = make_counted(&levels, i);
            continue;
        }
        status = run_to_level(&levels, &levels.trunk, &report->levels[i]);
        if (status == STATUS_OK)
            status = write_level(&levels, levels.trunk, i);
    }
    collapse_end(&levels.trunk);
    if (status == STATUS_OK)
        status = chain_trunk_add(ctx, root->chains, &levels.packed, options->syncs_trunk);
    packed_trunk_clear(ctx, &levels.packed);
    return status;
}
