/* spbm check: whether a file is what it should be. */
#include "commands.h"

#include "figures.h"

spbm_status cmd_check(struct run *run)
{
    static const char *const kinds[] = {"mesh", "store", "chains"};
    static const char *const words[] = {"a manifold mesh, consistently oriented",
                                        "a whole mesh store", "a whole chain file"};
    const char *path = run->options->inputs[0];
    spbm_file_kind kind = SPBM_FILE_MESH;
    spbm_status status = spbm_check(run->job, path, &kind);
    progress_clear(&run->progress);
    set_text(run->report.root, "kind", kinds[kind]);
    set_truth(run->report.root, "valid", status == SPBM_OK);
    if (status == SPBM_OK && words_to_stdout(run) && !run->options->quiet)
        printf("%s: %s\n", path, words[kind]);
    return status;
}
