/*
 * one_run: the three stages on one mesh, through the public interface, for instruction counts.
 *
 * The program `spbm` takes the vector level of the machine it runs on and reports on itself; a
 * count that is to be compared between commits wants neither. Here the level is pinned, one thread
 * runs, and nothing is synced or printed.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "spbm.h"

static int die(const spbm_job *job, const char *what)
{
    fprintf(stderr, "one_run: %s: %s\n", what, job ? spbm_job_error(job) : "cannot be opened");
    return 1;
}

int main(int argc, char **argv)
{
    if (argc != 6) {
        fprintf(stderr, "usage: one_run IN FOLDER FACES EFFORT VECTOR-LEVEL\n"
                        "VECTOR-LEVEL: 0 scalar, 1 NEON, 2 AVX2, 3 AVX-512\n");
        return 2;
    }
    const char *input = argv[1];
    char store[4096], chains[4096], output[4096];
    snprintf(store, sizeof store, "%s/run.store", argv[2]);
    snprintf(chains, sizeof chains, "%s/run.chains", argv[2]);
    snprintf(output, sizeof output, "%s/run.ply", argv[2]);

    spbm_settings settings;
    spbm_import_options import;
    spbm_patch_options patch;
    spbm_lod_options lod;
    spbm_target target;
    spbm_settings_defaults(&settings);
    spbm_import_defaults(&import);
    spbm_patch_defaults(&patch);
    spbm_lod_defaults(&lod);
    spbm_target_defaults(&target);
    settings.cpu_cap = (uint32_t)strtoul(argv[5], NULL, 10);
    import.sync = patch.sync = lod.sync = 0;
    target.count = 1;
    target.values[0] = strtod(argv[3], NULL);
    target.effort = (uint32_t)strtoul(argv[4], NULL, 10);

    spbm_job *job;
    if (spbm_job_open(&settings, &job) != SPBM_OK)
        return die(NULL, "job");
    int result = 0;
    if (spbm_import(job, &input, 1, store, &import, NULL) != SPBM_OK)
        result = die(job, "import");
    else if (spbm_patchify(job, store, chains, &target, &patch, NULL) != SPBM_OK)
        result = die(job, "patchify");
    else if (spbm_lod(job, chains, output, &target, &lod, NULL) != SPBM_OK)
        result = die(job, "lod");
    spbm_job_close(&job);
    return result;
}
