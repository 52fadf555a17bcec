/* spbm render: a picture of meshes. */
#include "commands.h"

#include "values.h"

spbm_status cmd_render(struct run *run)
{
    const struct options *options = run->options;
    spbm_status status = spbm_render(run->job, options->inputs, options->input_count,
                                     options->output, &options->render);
    progress_clear(&run->progress);
    if (status == SPBM_OK)
        report_counts(&run->report, "%s in, a picture out",
                      counted_text(options->input_count, "file", "files").s);
    return status;
}
