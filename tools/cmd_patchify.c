/* spbm patchify: stage 2. */
#include "commands.h"

#include "values.h"

spbm_status cmd_patchify(struct run *run)
{
    const struct options *options = run->options;
    spbm_chain_figures figures;
    spbm_status status = spbm_patchify(run->job, options->inputs[0], options->output,
                                       &options->target, &options->patch, &figures);
    progress_clear(&run->progress);
    if (status == SPBM_OK) {
        report_chains(&run->report, &figures);
        report_whole_stage(&run->report, "patchify", spbm_job_memory_peak(run->job));
        report_counts(&run->report, "%s in, %s out",
                      counted_text(figures.topology.faces, "face", "faces").s,
                      counted_text(figures.patches, "patch", "patches").s);
    }
    return status;
}
