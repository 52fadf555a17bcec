/* spbm import: stage 1. */
#include "commands.h"

#include <stdlib.h>

#include "values.h"

spbm_status cmd_import(struct run *run)
{
    const struct options *options = run->options;
    spbm_import_options import;
    spbm_store_figures *figures = calloc(1, sizeof *figures);
    if (!figures)
        return SPBM_NO_MEMORY;
    spbm_import_defaults(&import);
    import.weld = options->weld;
    spbm_status status = spbm_import(run->job, options->inputs, options->input_count,
                                     options->output, &import, figures);
    progress_clear(&run->progress);
    if (status == SPBM_OK) {
        report_store(&run->report, figures);
        report_whole_stage(&run->report, "import", spbm_job_memory_peak(run->job));
        report_counts(&run->report, "%s in, %s out",
                      counted_text(figures->cleaning.input_faces, "face", "faces").s,
                      counted_text(figures->topology.faces, "face", "faces").s);
    }
    free(figures);
    return status;
}
