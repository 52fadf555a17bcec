/* spbm topology: small features go, all else stays. */
#include "commands.h"

#include <stdlib.h>

#include "figures.h"
#include "values.h"

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

static void report_topology(struct report *report, const spbm_topology_report *topology)
{
    json_t *counts = json_object();
    for (int kind = 0; kind < SPBM_FEATURE_KINDS; kind++) {
        const char *word = spbm_feature_text((spbm_feature_kind)kind);
        set_count(counts, word, topology->counts[kind]);
        if (topology->counts[kind] && report->words)
            fprintf(report->words, "%s%s removed: %s\n", word,
                    kind == SPBM_CAVITY ? " (or pocket)" : "",
                    count_text(topology->counts[kind]).s);
    }
    set_json(report->root, "removed_counts", counts);
    set_count(report->root, "blocked", topology->blocked);
    set_count(report->root, "dropped_faces", topology->dropped_faces);
    set_count(report->root, "added_faces", topology->added_faces);
    set_count(report->root, "vertices", topology->vertices);
    set_count(report->root, "faces", topology->faces);
    if (topology->blocked && report->words)
        fprintf(report->words, "kept, for no fill would leave a manifold: %s\n",
                count_text(topology->blocked).s);
}

spbm_status cmd_topology(struct run *run)
{
    const struct options *options = run->options;
    spbm_topology_options topology = options->topology;
    spbm_topology_report *report = calloc(1, sizeof *report);
    if (!report)
        return SPBM_NO_MEMORY;
    topology.import.weld = options->weld;
    topology.format = options->lod.format;
    topology.removed = note_feature;
    topology.user = &run->report;
    json_object_set_new(run->report.root, "removed", json_array());
    spbm_status status = spbm_simplify_topology(run->job, options->inputs, options->input_count,
                                                options->output, &topology, report);
    progress_clear(&run->progress);
    if (status == SPBM_OK) {
        report_store(&run->report, &report->store);
        report_topology(&run->report, report);
        report_counts(&run->report, "%s in, %s out",
                      counted_text(report->store.topology.faces, "face", "faces").s,
                      counted_text(report->faces, "face", "faces").s);
    }
    for (uint32_t i = 0; i < report->stage_count; i++)
        report_stage(&run->report, &report->stages[i]);
    free(report);
    return status;
}
