/*
 * Gathering the report. JSON is built as the run goes, so that a run that fails tells in it how far
 * it came; it is written at the end, under its final name only when it is whole.
 */
#include "report.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "figures.h"
#include "values.h"

static double wall_seconds(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

static double cpu_seconds(void)
{
    struct timespec time;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

/* Peak of the process's memory, pages of mapped files counted. */
static uint64_t resident_peak(void)
{
    unsigned long long kilobytes = 0;
    char line[256];
    FILE *file = fopen("/proc/self/status", "re");
    while (file && kilobytes == 0 && fgets(line, sizeof line, file))
        (void)!sscanf(line, "VmHWM: %llu kB", &kilobytes);
    if (file)
        fclose(file);
    if (kilobytes == 0) {
        struct rusage usage;
        if (getrusage(RUSAGE_SELF, &usage) == 0)
            kilobytes = (unsigned long long)usage.ru_maxrss;
    }
    return (uint64_t)kilobytes << 10;
}

void report_begin(struct report *report, const struct command *command,
                  const struct options *options, const struct limits *limits)
{
    memset(report, 0, sizeof *report);
    report->wall_began = wall_seconds();
    report->cpu_began = cpu_seconds();
    report->words = options->quiet ? NULL : stderr;
    report->verbose = options->verbose;
    report->budget = limits->memory;
    report->budget_from = limits->memory_from;
    report->root = json_object();
    report->messages = json_array();
    report->stages = json_array();

    json_t *inputs = json_array(), *given = json_object();
    for (size_t i = 0; i < options->input_count; i++) {
        json_t *name = json_string(options->inputs[i]);
        (void)json_array_append_new(inputs, name ? name : json_string("(not UTF-8)"));
    }
    set_count(given, "memory", limits->memory);
    set_text(given, "memory_from", limits->memory_from);
    set_count(given, "threads", limits->threads);
    set_text(given, "threads_from", limits->threads_from);
    set_text(report->root, "program", "spbm");
    set_text(report->root, "version", spbm_version());
    set_text(report->root, "command", command->name);
    set_json(report->root, "inputs", inputs);
    set_text(report->root, "output", options->output);
    set_json(report->root, "limits", given);
    set_json(report->root, "stages", report->stages);
    set_json(report->root, "messages", report->messages);
    if (report->words && report->verbose)
        fprintf(report->words, "memory: %s (%s); threads: %u (%s)\n", size_text(limits->memory).s,
                limits->memory_from, limits->threads, limits->threads_from);
}

bool report_message(struct report *report, const char *kind, const char *text)
{
    enum { REMEMBERED = 1000 };
    size_t count = json_array_size(report->messages);
    for (size_t i = 0; i < count; i++) {
        const json_t *message = json_array_get(report->messages, i);
        const char *said = json_string_value(json_object_get(message, "text"));
        if (said && strcmp(said, text) == 0)
            return false;
    }
    if (count < REMEMBERED) {
        json_t *message = json_object();
        set_text(message, "kind", kind);
        set_text(message, "text", text);
        (void)json_array_append_new(report->messages, message);
    }
    return true;
}

void report_counts(struct report *report, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(report->counts, sizeof report->counts, format, arguments);
    va_end(arguments);
}

void report_level_counts(struct report *report, uint64_t faces_in, const spbm_levels *levels)
{
    report_counts(report, "%s in, ", counted_text(faces_in, "face", "faces").s);
    for (uint32_t i = 0; i < levels->count && i < SPBM_TARGETS_MAX; i++) {
        size_t used = strlen(report->counts);
        bool is_last = i + 1 == levels->count;
        snprintf(report->counts + used, sizeof report->counts - used, "%s%s",
                 count_text(levels->levels[i].faces).s, is_last ? " faces out" : " / ");
    }
}

void report_stage(struct report *report, const spbm_stage *stage)
{
    json_t *object = json_object();
    set_text(object, "name", stage->name);
    set_real(object, "wall_seconds", stage->wall_seconds);
    set_real(object, "cpu_seconds", stage->cpu_seconds);
    set_count(object, "allocated_peak", stage->memory_peak);
    if (stage->threads > 0)
        set_count(object, "threads", stage->threads);
    else
        set_json(object, "threads", NULL);
    set_truth(object, "resumed", stage->resumed);
    (void)json_array_append_new(report->stages, object);
    if (!report->words)
        return;
    if (stage->resumed)
        fprintf(report->words, "%s: was finished by an earlier run\n", stage->name);
    else if (report->verbose)
        fprintf(report->words, "%s: %s wall, %s CPU, at most %s allocated\n", stage->name,
                seconds_text(stage->wall_seconds).s, seconds_text(stage->cpu_seconds).s,
                size_text(stage->memory_peak).s);
}

void report_whole_stage(struct report *report, const char *name, uint64_t peak)
{
    report_stage(report, &(spbm_stage){.name = name,
                                       .wall_seconds = wall_seconds() - report->wall_began,
                                       .cpu_seconds = cpu_seconds() - report->cpu_began,
                                       .memory_peak = peak});
}

void report_store(struct report *report, const spbm_store_figures *store)
{
    set_json(report->root, "store", json_of_store(store));
    if (!report->words)
        return;
    fputs("import: ", report->words);
    write_summary(report->words, &store->topology);
    fprintf(report->words, "; floor %s\n", counted_text(store->topology.floor, "face", "faces").s);
    write_cleaning(report->words, "  ", &store->cleaning);
    if (store->cleaning.hilbert_ordered && report->verbose)
        fputs("  faces put in an order local in space\n", report->words);
    if (report->verbose)
        fprintf(report->words, "  mean edge %s, noise %s of it, diagonal %s\n",
                length_text(store->mean_edge).s, percent_text(store->noise).s,
                length_text(store->diagonal).s);
}

void report_chains(struct report *report, const spbm_chain_figures *chains)
{
    set_json(report->root, "chains", json_of_chains(chains));
    if (!report->words)
        return;
    fprintf(report->words, "patchify: %s, %s\n",
            counted_text(chains->patches, "patch", "patches").s,
            counted_text(chains->chains, "chain", "chains").s);
    if (report->verbose)
        fprintf(report->words,
                "  patch angle %g,%g, face angle %g,%g degrees, normals smoothed %u times, chain "
                "tolerance %s; a level can have %s faces at most\n",
                chains->patch_angle[0], chains->patch_angle[1], chains->face_angle[0],
                chains->face_angle[1], chains->smoothings, length_text(chains->tolerance).s,
                count_text(chains->most_faces).s);
}

static const char *stop_key(spbm_stop stop)
{
    static const char *const keys[] = {"reached", "topology", "too_fine", "error_bound"};
    return keys[stop <= SPBM_STOP_ERROR ? stop : 0];
}

static void write_level(FILE *file, const spbm_levels *levels, uint32_t index, const char *name)
{
    const spbm_level *level = &levels->levels[index];
    fprintf(file, "level %u: %s, %s", index, strcmp(name, "-") == 0 ? "standard output" : name,
            counted_text(level->faces, "face", "faces").s);
    if (level->wanted_faces > 0)
        fprintf(file, " of %s asked for", count_text(level->wanted_faces).s);
    fprintf(file, "; estimated error %s (%s of the diagonal)", length_text(level->error).s,
            percent_text(levels->diagonal > 0 ? level->error / levels->diagonal : 0).s);
    if (level->wanted_error > 0)
        fprintf(file, " of %s asked for", length_text(level->wanted_error).s);
    fprintf(file, "; %s", spbm_stop_text(level->stop));
    if (level->stop == SPBM_STOP_TOPOLOGY)
        fprintf(file, " (floor: %s)", counted_text(levels->floor, "face", "faces").s);
    fputc('\n', file);
}

void report_levels(struct report *report, const spbm_levels *levels, const char *output)
{
    json_t *list = json_array();
    for (uint32_t i = 0; i < levels->count && i < SPBM_TARGETS_MAX; i++) {
        const spbm_level *level = &levels->levels[i];
        char name[4096];
        json_t *object = json_object();
        if (spbm_level_name(output, i, levels->count, name, sizeof name) != SPBM_OK)
            snprintf(name, sizeof name, "%s", output);
        set_text(object, "file", name);
        set_count(object, "faces", level->faces);
        set_count(object, "vertices", level->vertices);
        if (level->wanted_faces > 0)
            set_count(object, "wanted_faces", level->wanted_faces);
        else
            set_json(object, "wanted_faces", NULL);
        set_real(object, "wanted_error",
                 level->wanted_faces > 0 && level->wanted_error <= 0 ? NAN : level->wanted_error);
        set_real(object, "error", level->error);
        set_real(object, "error_of_diagonal", level->error / levels->diagonal);
        set_text(object, "stop", stop_key(level->stop));
        (void)json_array_append_new(list, object);
        if (report->words)
            write_level(report->words, levels, i, name);
    }
    set_json(report->root, "levels", list);
    set_count(report->root, "floor", levels->floor);
    set_real(report->root, "diagonal", levels->diagonal);
    set_count(report->root, "small_faces", levels->small_faces);
    json_t *joins = json_array();
    for (uint32_t i = 0; i < levels->join_count && i < SPBM_JOINS_MAX; i++) {
        json_t *join = json_object();
        set_count(join, "joins", levels->joins[i].joins);
        set_count(join, "faces_in", levels->joins[i].faces_in);
        set_count(join, "largest_in", levels->joins[i].largest_in);
        set_count(join, "faces_out", levels->joins[i].faces_out);
        (void)json_array_append_new(joins, join);
    }
    set_json(report->root, "joins", joins);
}

/* ---- topology ---- */

static json_t *json_of_feature(const spbm_feature *feature)
{
    json_t *object = json_object(), *place = json_array();
    set_text(object, "kind", spbm_feature_text(feature->kind));
    set_count(object, "loops", feature->loops);
    set_real(object, "size", feature->size);
    for (unsigned c = 0; c < 3; c++)
        json_array_append_new(place, json_real(feature->place[c]));
    set_json(object, "place", place);
    return object;
}

/* Into the JSON, and with --verbose a line for people. */
static void note_feature(void *user, const spbm_feature *feature)
{
    struct report *report = user;
    json_array_append_new(json_object_get(report->root, "removed"), json_of_feature(feature));
    if (report->words && report->verbose)
        fprintf(report->words, "removed %s of size %s at %g, %g, %g\n",
                spbm_feature_text(feature->kind), length_text(feature->size).s, feature->place[0],
                feature->place[1], feature->place[2]);
}

void report_removal(struct report *report, const spbm_removal *removal)
{
    json_t *counts = json_object();
    for (int kind = 0; kind < SPBM_FEATURE_KINDS; kind++) {
        const char *word = spbm_feature_text((spbm_feature_kind)kind);
        set_count(counts, word, removal->counts[kind]);
        if (removal->counts[kind] && report->words)
            fprintf(report->words, "%s%s removed: %s\n", word,
                    kind == SPBM_CAVITY ? " (or pocket)" : "", count_text(removal->counts[kind]).s);
    }
    set_json(report->root, "removed_counts", counts);
    set_count(report->root, "blocked", removal->blocked);
    set_count(report->root, "zipped", removal->zipped);
    if (removal->zipped && report->words)
        fprintf(report->words, "vertices zipped along cracks: %s\n",
                count_text(removal->zipped).s);
    set_count(report->root, "dropped_faces", removal->dropped_faces);
    set_count(report->root, "added_faces", removal->added_faces);
    if (removal->blocked && report->words)
        fprintf(report->words, "kept, for no fill would leave a manifold: %s\n",
                count_text(removal->blocked).s);
}

void report_removed(struct report *report, spbm_topology_options *topology)
{
    topology->removed = note_feature;
    topology->user = report;
    set_json(report->root, "removed", json_array());
}

/* ---- the end ---- */

static bool write_json(FILE *file, const json_t *root)
{
    return json_dumpf(root, file, JSON_INDENT(2) | JSON_PRESERVE_ORDER) == 0 &&
           fputc('\n', file) != EOF && fflush(file) == 0;
}

/* Under a temporary name first, unless the name is of something other than a regular file. */
static bool save_json(const char *path, const json_t *root)
{
    char temporary[4096];
    struct stat info;
    if (strcmp(path, "-") == 0)
        return write_json(stdout, root);
    bool is_direct = stat(path, &info) == 0 && !S_ISREG(info.st_mode);
    int length = snprintf(temporary, sizeof temporary, "%s.%ld", path, (long)getpid());
    if (length < 0 || (size_t)length >= sizeof temporary) {
        errno = ENAMETOOLONG;
        return false;
    }
    FILE *file = fopen(is_direct ? path : temporary, is_direct ? "we" : "wxe");
    if (!file)
        return false;
    bool is_good = write_json(file, root);
    is_good = fclose(file) == 0 && is_good;
    if (is_direct)
        return is_good;
    is_good = is_good && rename(temporary, path) == 0;
    if (!is_good) {
        int error = errno;
        unlink(temporary);
        errno = error;
    }
    return is_good;
}

int report_finish(struct report *report, const struct options *options, const char *command,
                  const char *status, int exit_code, const char *error)
{
    double wall = wall_seconds() - report->wall_began, cpu = cpu_seconds() - report->cpu_began;
    uint64_t peak = resident_peak();
    set_text(report->root, "status", status);
    set_json(report->root, "exit_code", json_integer(exit_code));
    set_text(report->root, "error", error);
    set_real(report->root, "wall_seconds", wall);
    set_real(report->root, "cpu_seconds", cpu);
    set_count(report->root, "memory_peak", peak);
    if (report->words && report->counts[0])
        fprintf(report->words, "spbm %s %s: %s; %s wall, %s CPU, peak memory %s of %s (%s)\n",
                spbm_version(), command, report->counts, seconds_text(wall).s, seconds_text(cpu).s,
                size_text(peak).s, size_text(report->budget).s, report->budget_from);
    if (options->json && !save_json(options->json, report->root)) {
        bool is_full = errno == ENOSPC || errno == EDQUOT;
        fprintf(stderr, "spbm: error: %s: the report cannot be written: %s\n", options->json,
                strerror(errno));
        if (exit_code == EXIT_DONE || exit_code == EXIT_MISSED)
            exit_code = is_full ? EXIT_FULL : EXIT_FAILED;
    }
    json_decref(report->root);
    report->root = NULL;
    return exit_code;
}
