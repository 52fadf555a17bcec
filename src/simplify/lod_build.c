/*
 * STAGE 3: chain file in, levels of detail out. What both modes have in common: which levels, under
 * which names, and the verdict at the end; how a level is made is the mode's.
 */
#include <string.h>

#include "simplify/lod_classic.h"
#include "simplify/lod_collapse.h"
#include "simplify/lod_output.h"
#include "simplify/lod_target.h"

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
