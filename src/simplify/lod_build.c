/*
 * STAGE 3: chain file in, levels of detail out. What both modes have in common: which levels, under
 * which names, and the verdict at the end; how a level is made is the mode's.
 */
#include <string.h>

#include "simplify/lod_classic.h"
#include "simplify/lod_collapse.h"
#include "simplify/lod_output.h"
#include "simplify/lod_target.h"

/* Measured: a leaf of the tree for each thread, and the root with what it may choose from. */
uint64_t lod_least_memory(const struct target *target, uint64_t faces, unsigned threads,
                          uint32_t stride)
{
    const uint64_t leaf = 56 << 20, face = 60 + stride, chain_vertex = 300 + stride;
    double finest = 0;
    for (uint32_t i = 0; i < target->count && i < TARGETS_MAX; i++) {
        double wanted = target->kind == TARGET_FACES   ? target->values[i]
                        : target->kind == TARGET_RATIO ? target->values[i] * (double)faces
                                                       : 0;
        finest = wanted > finest ? wanted : finest;
    }
    if (target->mode == MODE_CLASSIC)
        return (16 << 20) + faces / 16 * chain_vertex;
    return (8 << 20) + (uint64_t)threads * leaf + (uint64_t)(10 * finest) * face;
}

enum status lod_build(struct context *ctx, const char *chain_path,
                      const struct lod_options *options, struct lod_report *report)
{
    struct chain_file *file = NULL;
    memset(report, 0, sizeof *report);
    enum status status = chain_file_open(ctx, chain_path, &file);
    if (status != STATUS_OK)
        return status;
    const struct chain_info *info = chain_file_info(file);
    status = lod_target_levels(ctx, &options->target, info, report);
    if (status == STATUS_OK)
        status = lod_output_check(ctx, options, report->level_count, chain_path);
    if (status == STATUS_OK)
        status = options->target.mode == MODE_CLASSIC ? lod_classic(ctx, file, options, report)
                                                      : lod_collapse(ctx, file, options, report);
    if (status == STATUS_OK)
        status = lod_target_verdict(ctx, info, report);
    chain_file_close(&file);
    return status;
}
