/* spbm export: a store's mesh as a mesh file. */
#include "commands.h"

#include <stdlib.h>

#include "figures.h"
#include "values.h"

spbm_status cmd_export(struct run *run)
{
    const struct options *options = run->options;
    spbm_file_figures *figures = calloc(1, sizeof *figures);
    if (!figures)
        return SPBM_NO_MEMORY;
    spbm_status status =
        spbm_export(run->job, options->inputs[0], options->output, options->lod.format);
    if (status == SPBM_OK)
        status = spbm_info(run->job, options->inputs[0], figures);
    progress_clear(&run->progress);
    if (status == SPBM_OK) {
        const spbm_topology *topology = &figures->store.topology;
        set_json(run->report.root, "store", json_of_store(&figures->store));
        report_whole_stage(&run->report, "export", spbm_job_memory_peak(run->job));
        report_counts(&run->report, "%s, %s out", counted_text(topology->faces, "face", "faces").s,
                      counted_text(topology->vertices, "vertex", "vertices").s);
    }
    free(figures);
    return status;
}
