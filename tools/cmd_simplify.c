/* spbm simplify: all three stages in one run. */
#include "commands.h"

#include <stdlib.h>

spbm_status cmd_simplify(struct run *run)
{
    const struct options *options = run->options;
    spbm_simplify_options simplify;
    spbm_simplify_report *report = calloc(1, sizeof *report);
    if (!report)
        return SPBM_NO_MEMORY;
    spbm_simplify_defaults(&simplify);
    simplify.import.weld = options->weld;
    simplify.target = options->target;
    simplify.patch = options->patch;
    simplify.lod = options->lod;
    simplify.keep_dir = options->keep_dir;
    simplify.resume_dir = options->resume ? options->tmp_dir : NULL;
    spbm_topology_options topology = options->topology;
    if (options->has_topology) {
        report_removed(&run->report, &topology);
        simplify.topology = &topology;
    }

    spbm_status status = spbm_simplify(run->job, options->inputs, options->input_count,
                                       options->output, &simplify, report);
    progress_clear(&run->progress);
    if (report->stage_count > 0)
        report_store(&run->report, &report->store);
    const uint32_t before = report->has_topology ? 2 : 1;
    if (report->has_topology)
        report_removal(&run->report, &report->removal);
    if (report->stage_count > before)
        report_chains(&run->report, &report->chains);
    if (report->stage_count > before + 1) {
        report_levels(&run->report, &report->levels, options->output);
        report_level_counts(&run->report, report->store.cleaning.input_faces, &report->levels);
    }
    for (uint32_t i = 0; i < report->stage_count; i++)
        report_stage(&run->report, &report->stages[i]);
    free(report);
    return status;
}
