/*
 * Levels asked for. All levels are cut from one sequence of operations that only goes towards
 * coarser, so they are made finest first, whatever order they were given in.
 */
#include "simplify/lod_target.h"

#include <inttypes.h>
#include <math.h>

/* True when level a is to be made before level b. */
static bool is_finer(const struct level *a, const struct level *b)
{
    return a->wanted_faces != b->wanted_faces ? a->wanted_faces > b->wanted_faces
                                              : a->wanted_error < b->wanted_error;
}

static double box_diagonal(const struct chain_info *info)
{
    double sum = 0;
    for (int k = 0; k < 3; k++)
        sum += (info->box_high[k] - info->box_low[k]) * (info->box_high[k] - info->box_low[k]);
    return sqrt(sum);
}

static uint64_t ratio_faces(const struct chain_info *info, double ratio)
{
    const uint64_t faces =
        ratio < 1 ? (uint64_t)(ratio * (double)info->topology.faces) : info->topology.faces;
    return faces > 0 ? faces : 1;
}

/* What a value of that kind, faces or a ratio, comes to; it must be in range. */
static uint64_t count_of(enum target_kind kind, const struct chain_info *info, double value)
{
    return kind == TARGET_RATIO ? ratio_faces(info, value) : (uint64_t)value;
}

/* What one value of the target wants. */
static enum status read_value(struct context *ctx, const struct target *target,
                              const struct chain_info *info, double value, struct level *level)
{
    *level = (struct level){.reason = STOP_REACHED};
    if (target->kind != TARGET_ERROR && target->error_bound > 0)
        level->wanted_error =
            target->error_bound * (target->bound_is_relative ? box_diagonal(info) : 1);
    switch (target->kind) {
    case TARGET_FACES:
        if (!(value >= 1 && value < 0x1p63))
            return fail(ctx, STATUS_MISUSE, "%g faces cannot be made", value);
        level->wanted_faces = (uint64_t)value;
        return STATUS_OK;
    case TARGET_RATIO:
        if (!(value > 0 && value <= 1))
            return fail(ctx, STATUS_MISUSE, "a ratio of %g is not in (0, 1]", value);
        level->wanted_faces = ratio_faces(info, value);
        return STATUS_OK;
    case TARGET_ERROR:
        if (!(value >= 0 && value < INFINITY))
            return fail(ctx, STATUS_MISUSE, "an error of %g makes no sense", value);
        level->wanted_error = target->error_is_relative ? value * box_diagonal(info) : value;
        return STATUS_OK;
    }
    return fail(ctx, STATUS_MISUSE, "unknown kind of target");
}

enum status lod_target_levels(struct context *ctx, const struct target *target,
                              const struct chain_info *info, struct lod_report *report)
{
    if (target->count < 1 || target->count > TARGETS_MAX)
        return fail(ctx, STATUS_MISUSE, "%u levels asked for; 1 to %d can be made", target->count,
                    TARGETS_MAX);
    report->level_count = 0;
    for (uint32_t i = 0; i < target->count; i++) {
        struct level level;
        enum status status = read_value(ctx, target, info, target->values[i], &level);
        if (status != STATUS_OK)
            return status;
        uint32_t place = report->level_count++;
        for (; place > 0 && is_finer(&level, &report->levels[place - 1]); place--)
            report->levels[place] = report->levels[place - 1];
        report->levels[place] = level;
    }
    return STATUS_OK;
}

/* ---- milestones ---- */

/* Of a file that was made for an error, so many patches are enough for one face of a level. */
static const uint64_t PATCHES_A_FACE = 10;

/* Keeps the counts descending, each once. */
static void add_milestone(struct milestones *milestones, uint64_t faces)
{
    uint32_t place = 0;
    while (place < milestones->count && milestones->faces[place] > faces)
        place++;
    if (place < milestones->count && milestones->faces[place] == faces)
        return;
    for (uint32_t i = milestones->count++; i > place; i--)
        milestones->faces[i] = milestones->faces[i - 1];
    milestones->faces[place] = faces;
}

/* What a file's target wants, as far as it makes sense: it may be anything that is finite. */
static uint64_t made_for(const struct chain_info *info, double value)
{
    const double faces = (double)info->topology.faces;
    const double wanted = info->target_kind == TARGET_RATIO ? value * faces : value;
    if (!(wanted >= 1))
        return 1;
    if (!(wanted < faces))
        return info->topology.faces;
    return count_of(info->target_kind, info, value);
}

void lod_target_milestones(const struct target *target, const struct chain_info *info,
                           struct milestones *milestones)
{
    milestones->count = 0;
    if (target->kind == TARGET_ERROR || target->error_bound > 0)
        return;
    if (info->target_kind == TARGET_ERROR || info->target_count == 0)
        add_milestone(milestones, info->patches / PATCHES_A_FACE + 1);
    else
        for (uint32_t i = 0; i < info->target_count; i++)
            add_milestone(milestones, made_for(info, info->targets[i]));
    uint64_t finest = 0;
    for (uint32_t i = 0; i < target->count && i < TARGETS_MAX; i++) {
        const double value = target->values[i];
        if (!(value > 0 && value < 0x1p63))
            continue; /* is refused elsewhere */
        const uint64_t faces = count_of(target->kind, info, value);
        finest = faces > finest ? faces : finest;
    }
    if (finest > milestones->faces[0])
        add_milestone(milestones, finest);
}

struct target lod_whole_target(const struct target *target, const struct chain_info *info)
{
    struct target whole = *target;
    struct milestones milestones;
    lod_target_milestones(target, info, &milestones);
    if (milestones.count > 0 && target->mode == MODE_COLLAPSE) {
        whole.kind = TARGET_FACES;
        whole.count = 1;
        whole.values[0] = (double)milestones.faces[0];
    }
    return whole;
}

/* An error is an estimate, good within a factor of 2, and so is an error that was asked for. */
static bool is_above(double error, double bound)
{
    return error > 2 * bound;
}

double lod_error_bound(const struct level *level)
{
    return level->wanted_faces == 0 || level->wanted_error > 0 ? level->wanted_error : INFINITY;
}

enum stop_reason lod_stop_reason(const struct level *level, bool exhausted)
{
    if (is_above(level->error, lod_error_bound(level)))
        return STOP_TOO_FINE;
    if (level->wanted_faces == 0)
        return STOP_REACHED;
    if (level->faces > level->wanted_faces)
        return exhausted ? STOP_TOPOLOGY : STOP_ERROR;
    return level->faces + 1 >= level->wanted_faces ? STOP_REACHED : STOP_TOO_FINE;
}

/* Whether the chain file was made for as many faces. */
static bool is_made_for(const struct chain_info *info, uint64_t faces)
{
    double most = 0;
    for (uint32_t i = 0; i < info->target_count && info->target_kind != TARGET_ERROR; i++)
        most = info->targets[i] > most ? info->targets[i] : most;
    if (info->target_kind == TARGET_RATIO)
        most *= (double)info->topology.faces;
    return most >= (double)faces;
}

static enum status explain_too_fine(struct context *ctx, const struct chain_info *info,
                                    uint32_t index, const struct level *level)
{
    if (is_above(level->error, lod_error_bound(level)))
        return fail(ctx, STATUS_TARGET_MISSED,
                    "level %u has an error of %.4g, not %.4g: the chain file's patches are no "
                    "better; patchify with smaller --patch-angle and --face-angle",
                    index, level->error, level->wanted_error);
    if (level->wanted_faces > info->topology.faces)
        return fail(ctx, STATUS_TARGET_MISSED,
                    "level %u has %" PRIu64 " faces, not %" PRIu64
                    ": more faces are asked for than the original's %" PRIu64,
                    index, level->faces, level->wanted_faces, info->topology.faces);
    return fail(ctx, STATUS_TARGET_MISSED,
                "level %u has %" PRIu64 " faces, not %" PRIu64
                ": the chain file has no more to give; patchify %s",
                index, level->faces, level->wanted_faces,
                is_made_for(info, level->wanted_faces)
                    ? "with smaller --patch-angle and --face-angle"
                    : "for this target");
}

enum status lod_target_verdict(struct context *ctx, const struct chain_info *info,
                               const struct lod_report *report)
{
    for (uint32_t i = 0; i < report->level_count; i++) {
        const struct level *level = &report->levels[i];
        if (level->reason == STOP_TOPOLOGY)
            return fail(ctx, STATUS_TARGET_MISSED,
                        "level %u has %" PRIu64 " faces, not %" PRIu64
                        ": no more can be taken away without changing the topology (floor: %" PRIu64
                        " faces)",
                        i, level->faces, level->wanted_faces, info->topology.floor);
        if (level->reason == STOP_TOO_FINE)
            return explain_too_fine(ctx, info, i, level);
    }
    return STATUS_OK;
}
