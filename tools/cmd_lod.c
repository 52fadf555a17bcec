/* spbm lod: stage 3. */
#include "commands.h"

spbm_status cmd_lod(struct run *run)
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
