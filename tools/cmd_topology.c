/* spbm topology: small features go, all else stays. */
#include "commands.h"

#include <stdlib.h>

#include "figures.h"

#include "values.h"

spbm_status cmd_topology(struct run *run)
{
    const struct options *options = run->options;
    spbm_topology_options topology = options->topology;
    spbm_topology_report *report = calloc(1, sizeof *report);
    if (!report)
        return SPBM_NO_MEMORY;
    topology.import.weld = options->weld;
    topology.format = options->lod.format;
    report_removed(&run->report, &topology);
    spbm_status status = spbm_simplify_topology(run->job, options->inputs, options->input_count,
                                                options->output, &topology, report);
    progress_clear(&run->progress);
    if (status == SPBM_OK) {
        report_store(&run->report, &report->store);
        report_removal(&run->report, &report->removal);
        set_count(run->report.root, "vertices", report->removal.vertices);
        set_count(run->report.root, "faces", report->removal.faces);
        report_counts(&run->report, "%s in, %s out",
                      counted_text(report->store.topology.faces, "face", "faces").s,
                      counted_text(report->removal.faces, "face", "faces").s);
    }
    for (uint32_t i = 0; i < report->stage_count; i++)
        report_stage(&run->report, &report->stages[i]);
    free(report);
    return status;
}
