/*
 * The command line: one table of options and one parser for all commands, so that an option means
 * the same everywhere and help cannot differ from what is read.
 */
#ifndef SPBM_TOOLS_OPTIONS_H
#define SPBM_TOOLS_OPTIONS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include "spbm.h"

enum { EXIT_DONE = 0, EXIT_FAILED = 1, EXIT_MISUSE = 2, EXIT_MISSED = 3, EXIT_FULL = 4 };

/* Groups of options; a command takes some of them. */
enum {
    GROUP_SHARED = 1,
    GROUP_OUTPUT = 2,
    GROUP_WELD = 4,
    GROUP_TARGET = 8,
    GROUP_PATCH = 16,
    GROUP_PLACE = 32,
    GROUP_FORMAT = 64,
    GROUP_KEEP = 128,
    GROUP_MEASURE = 256,
    GROUP_RENDER = 512,
    GROUP_TOPOLOGY = 1024,
    GROUP_CACHE = 2048
};

struct run;

struct command {
    const char *name;
    const char *section; /* of the program's help */
    const char *arguments;
    const char *summary; /* one line */
    const char *details; /* paragraphs of its help */
    unsigned groups;
    unsigned inputs_min, inputs_max;
    spbm_status (*work)(struct run *run);
};

/* All that the command line says; defaults where it says nothing. */
struct options {
    const char **inputs; /* borrowed from argv; the array is owned */
    size_t input_count;
    const char *output, *keep_dir, *tmp_dir, *json;
    bool weld, quiet, verbose, resume, dry_run;
    spbm_target target;
    spbm_patch_options patch;
    spbm_lod_options lod;
    spbm_measure_options measure;
    spbm_render_options render;
    spbm_topology_options topology;
    bool has_topology; /* some option of it was given */
    uint64_t memory;   /* 0: not given */
    unsigned threads;  /* 0: not given */
};

enum parsed { PARSED_RUN, PARSED_HELP, PARSED_VERSION, PARSED_MISUSE };

/* Reads the words behind the command's name. On misuse it has written one line to standard error.
 * Release with options_clear whatever came back. */
enum parsed options_parse(const struct command *command, const struct command *commands, int argc,
                          char **argv, struct options *options);
void options_clear(struct options *options);

/* Writes a command's help. */
void options_help(const struct command *command, FILE *file);

#endif
