/*
 * One run of one command: opens the job with limits and callbacks, gathers the report, and turns
 * the status into words and an exit code.
 */
#ifndef SPBM_TOOLS_RUN_H
#define SPBM_TOOLS_RUN_H

#include <jansson.h>

#include "limits.h"
#include "options.h"
#include "progress.h"
#include "report.h"

struct run {
    const struct command *command;
    const struct options *options;
    struct limits limits;
    struct progress progress;
    struct report report;
    spbm_job *job;
};

/* Runs the command from its options to its exit code. */
int run_command(const struct command *command, const struct options *options);

#endif
