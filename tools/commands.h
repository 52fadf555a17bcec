/*
 * The work of each command, one file a command: cmd_NAME.c. Each calls the library once or twice
 * and hands its figures to the report.
 */
#ifndef SPBM_TOOLS_COMMANDS_H
#define SPBM_TOOLS_COMMANDS_H

#include "run.h"

spbm_status cmd_simplify(struct run *run);
spbm_status cmd_topology(struct run *run);
spbm_status cmd_import(struct run *run);
spbm_status cmd_patchify(struct run *run);
spbm_status cmd_lod(struct run *run);
spbm_status cmd_export(struct run *run);
spbm_status cmd_info(struct run *run);
spbm_status cmd_check(struct run *run);
spbm_status cmd_measure(struct run *run);
spbm_status cmd_render(struct run *run);

/* Whether words may go to standard output: not when the JSON does. */
bool words_to_stdout(const struct run *run);

#endif
