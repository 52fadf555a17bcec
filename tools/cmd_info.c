/* spbm info: what a file holds, on standard output. */
#include "commands.h"

#include <stdlib.h>
#include <string.h>

#include "figures.h"
#include "values.h"

bool words_to_stdout(const struct run *run)
{
    return !run->options->json || strcmp(run->options->json, "-") != 0;
}

static void write_words(const char *path, const spbm_file_figures *figures)
{
    static const char *const kinds[] = {"mesh file", "mesh store", "chain file"};
    printf("%-22s %s\n", "file", strcmp(path, "-") == 0 ? "standard input" : path);
    printf("%-22s %s", "kind", kinds[figures->kind]);
    if (figures->file_size > 0)
        printf(", %s", size_text(figures->file_size).s);
    putchar('\n');
    switch (figures->kind) {
    case SPBM_FILE_MESH:
        write_quality(stdout, &figures->mesh);
        printf("%-22s %s\n", "attributes", count_text(figures->mesh.attribute_count).s);
        break;
    case SPBM_FILE_STORE:
        write_store(stdout, &figures->store);
        break;
    case SPBM_FILE_CHAINS:
        write_chains(stdout, &figures->chains);
        break;
    }
}

spbm_status cmd_info(struct run *run)
{
    static const char *const kinds[] = {"mesh", "store", "chains"};
    const char *path = run->options->inputs[0];
    json_t *root = run->report.root;
    spbm_file_figures *figures = calloc(1, sizeof *figures);
    if (!figures)
        return SPBM_NO_MEMORY;
    spbm_status status = spbm_info(run->job, path, figures);
    progress_clear(&run->progress);
    if (status == SPBM_OK) {
        set_text(root, "kind", kinds[figures->kind]);
        set_count(root, "file_size", figures->file_size);
        if (figures->kind == SPBM_FILE_MESH) {
            json_t *mesh = json_of_quality(&figures->mesh);
            set_count(mesh, "attribute_count", figures->mesh.attribute_count);
            set_json(root, "mesh", mesh);
        } else if (figures->kind == SPBM_FILE_STORE) {
            set_json(root, "store", json_of_store(&figures->store));
        } else {
            set_json(root, "chains", json_of_chains(&figures->chains));
        }
        if (words_to_stdout(run))
            write_words(path, figures);
    }
    free(figures);
    return status;
}
