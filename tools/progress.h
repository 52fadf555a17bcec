/*
 * What a run shows while it works, on standard error: one line with a bar, if that is a terminal,
 * and messages.
 */
#ifndef SPBM_TOOLS_PROGRESS_H
#define SPBM_TOOLS_PROGRESS_H

#include <stdbool.h>
#include <stdint.h>

struct progress {
    bool shows_bar;   /* standard error is a terminal that can rewrite a line, and not quiet */
    bool has_colours; /* and NO_COLOR is not set */
    bool is_drawn;    /* a bar stands in the line */
    char stage[32];
    double stage_began, last_drawn; /* seconds, monotonic */
};

void progress_begin(struct progress *progress, bool quiet);
/* `total` 0: not known. Draws at most ten times a second. */
void progress_show(struct progress *progress, const char *stage, uint64_t done, uint64_t total);
/* Takes the bar away, so that a line can be written. */
void progress_clear(struct progress *progress);
/* "spbm: warning: text": `kind` in colour where there are colours ("" leaves it out). */
void progress_message(struct progress *progress, const char *kind, const char *text);

#endif
