/* spbm lod: stage 3; with topology, all that removing features takes. */
#include "commands.h"

#include <stdlib.h>

static spbm_status keep_topology(struct run *run)
{
    const struct options *options = run->options;
    spbm_levels levels;
    spbm_status status = spbm_lod(run->job, options->inputs[0], options->output, &options->target,
                                  &options->lod, &levels);
    progress_clear(&run->progress);
    if (status == SPBM_OK || status == SPBM_TARGET_MISSED) {
        report_levels(&run->report, &levels, options->output);
        report_whole_stage(&run->report, "lod", spbm_job_memory_peak(run->job));
        report_level_counts(&run->report, levels.original_faces, &levels);
    }
    return status;
}

static spbm_status change_topology(struct run *run)
{
    const struct options *options = run->options;
    spbm_topology_options topology = options->topology;
    spbm_simplify_report *report = calloc(1, sizeof *report);
    if (!report)
        return SPBM_NO_MEMORY;
    report_removed(&run->report, &topology);
    spbm_status status = spbm_lod_topology(run->job, options->inputs[0], options->output,
                                           &options->target, &options->lod, &topology, report);
    progress_clear(&run->progress);
    if (report->has_topology)
        report_removal(&run->report, &report->removal);
    if (status == SPBM_OK || status == SPBM_TARGET_MISSED) {
        report_levels(&run->report, &report->levels, options->output);
        report_level_counts(&run->report, report->levels.original_faces, &report->levels);
    }
    for (uint32_t i = 0; i < report->stage_count; i++)
        report_stage(&run->report, &report->stages[i]);
    free(report);
    return status;
}

spbm_status cmd_lod(struct run *run)
{
    return run->options->has_topology ? change_topology(run) : keep_topology(run);
}
