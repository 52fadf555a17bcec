/*
 * The folder of a resumable run: whole files of finished stages, under a name made from what the
 * run depends on, held by a lock. doc/resuming.md describes it.
 */
#ifndef SPBM_API_RESUME_H
#define SPBM_API_RESUME_H

#include "api_internal.h"

struct run_folder {
    struct context *ctx;
    int fd;          /* of the folder, which holds the lock; -1: not open */
    bool is_resumed; /* a dead run of the same job was here */
    char path[PATH_MAX];
};

/*
 * Opens or makes the job's folder in `dir` and locks it, and removes folders of dead runs there
 * that cannot be resumed any more, for their inputs have changed or their state is damaged. Fails
 * with STATUS_MISUSE where an input can't be recognised again (standard input), and STATUS_IO where
 * another process works in the folder, or it is somebody else's.
 */
enum status run_folder_open(struct context *ctx, const char *dir, const char *const *inputs,
                            size_t input_count, const char *output,
                            const spbm_simplify_options *options,
                            struct run_folder *folder) MUST_CHECK;
/* STATUS_BAD_INPUT if an input is not what it was when the folder was opened. */
enum status run_folder_verify(struct run_folder *folder) MUST_CHECK;
/* Path of a file in it (PATH_MAX bytes), and whether it is there: such a file is whole. */
bool run_folder_file(const struct run_folder *folder, const char *name, char *path);
/* Removes a stage's file, so that the stage is done again. */
void run_folder_drop(struct run_folder *folder, const char *name);
/* Lets go of it: removes it, or keeps it for the next run. Safe when not open. */
void run_folder_close(struct run_folder *folder, bool keep);

#endif
