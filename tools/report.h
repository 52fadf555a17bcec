/*
 * What a run tells: lines for people on standard error (the last one names counts, seconds and peak
 * memory) and one JSON object for programs (doc/json.md lists its keys).
 */
#ifndef SPBM_TOOLS_REPORT_H
#define SPBM_TOOLS_REPORT_H

#include <jansson.h>
#include <stdio.h>

#include "limits.h"
#include "options.h"

struct report {
    json_t *root;     /* owned */
    json_t *messages; /* borrowed from root */
    json_t *stages;   /* borrowed from root */
    FILE *words;      /* where lines for people go: standard error; NULL: quiet */
    bool verbose;
    uint64_t budget;         /* bytes, and where the figure comes from */
    const char *budget_from; /* borrowed */
    double wall_began, cpu_began;
    char counts[256]; /* "1,087,716 faces in, 12,700 faces out" for the closing line */
};

void report_begin(struct report *report, const struct command *command,
                  const struct options *options, const struct limits *limits);

/* A message of the library. False when the same one has come before. */
bool report_message(struct report *report, const char *kind, const char *text);

/* The words about counts in the closing line. */
void report_counts(struct report *report, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* The same for levels made of `faces_in` faces. */
void report_level_counts(struct report *report, uint64_t faces_in, const spbm_levels *levels);

/* What a stage took. */
void report_stage(struct report *report, const spbm_stage *stage);
/* The same for a command that is one stage and has just ended it; `peak`: bytes allocated. */
void report_whole_stage(struct report *report, const char *name, uint64_t peak);

void report_store(struct report *report, const spbm_store_figures *store);
void report_chains(struct report *report, const spbm_chain_figures *chains);
/* `output` is the name with %d in it. */
void report_levels(struct report *report, const spbm_levels *levels, const char *output);

/* What topology simplification removed: in all; and one by one, with the options' callback. */
void report_removal(struct report *report, const spbm_removal *removal);
void report_removed(struct report *report, spbm_topology_options *topology);

/* The closing line and the JSON. Returns the exit code, which is `exit_code` unless the JSON could
 * not be written. */
int report_finish(struct report *report, const struct options *options, const char *command,
                  const char *status, int exit_code, const char *error);

#endif
