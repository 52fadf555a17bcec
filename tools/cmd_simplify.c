/* spbm simplify: all three stages in one run, or what they would take. */
#include "commands.h"

#include <stdlib.h>

#include "figures.h"
#include "values.h"

/* ---- --dry-run ---- */

static json_t *json_of_plan(const spbm_plan *plan)
{
    json_t *object = json_object(), *stages = json_array();
    set_count(object, "faces", plan->faces);
    set_count(object, "vertices", plan->vertices);
    set_truth(object, "is_counted", plan->is_counted);
    set_real(object, "seconds", plan->seconds);
    for (unsigned i = 0; i < 3; i++) {
        json_t *stage = json_object();
        set_text(stage, "name", plan->stages[i].name);
        set_real(stage, "seconds", plan->stages[i].wall_seconds);
        set_count(stage, "threads", plan->stages[i].threads);
        (void)json_array_append_new(stages, stage);
    }
    set_json(object, "stages", stages);
    set_count(object, "temporary_bytes", plan->temporary_bytes);
    set_count(object, "output_bytes", plan->output_bytes);
    set_count(object, "free_bytes", plan->free_bytes);
    set_count(object, "memory_peak", plan->memory_peak);
    set_count(object, "memory_least", plan->memory_least);
    return object;
}

static void write_plan(const spbm_plan *plan, const struct limits *limits)
{
    printf("%-10s %s, %s%s\n", "input", counted_text(plan->faces, "face", "faces").s,
           counted_text(plan->vertices, "vertex", "vertices").s,
           plan->is_counted ? "" : " (guessed from the beginning)");
    printf("%-10s about %s (", "time", seconds_text(plan->seconds).s);
    for (unsigned i = 0; i < 3; i++)
        printf("%s%s %s", i ? ", " : "", plan->stages[i].name,
               seconds_text(plan->stages[i].wall_seconds).s);
    printf(")\n%-10s about %s of temporary files", "disk", size_text(plan->temporary_bytes).s);
    if (plan->free_bytes > 0)
        printf(" (%s are free)", size_text(plan->free_bytes).s);
    printf(", %s of output\n", size_text(plan->output_bytes).s);
    printf("%-10s about %s of %s (%s); at least %s are needed\n", "memory",
           size_text(plan->memory_peak).s, size_text(limits->memory).s, limits->memory_from,
           size_text(plan->memory_least).s);
    if (plan->free_bytes > 0 && plan->free_bytes < plan->temporary_bytes)
        printf("%-10s the disk is too small\n", "warning");
}

static spbm_status foretell(struct run *run, const spbm_simplify_options *simplify)
{
    const struct options *options = run->options;
    spbm_plan plan;
    spbm_status status = spbm_simplify_plan(run->job, options->inputs, options->input_count,
                                            options->output, simplify, &plan);
    if (status == SPBM_OK) {
        set_json(run->report.root, "plan", json_of_plan(&plan));
        if (words_to_stdout(run))
            write_plan(&plan, &run->limits);
    }
    return status;
}

/* ---- the run ---- */

spbm_status cmd_simplify(struct run *run)
{
    const struct options *options = run->options;
    spbm_simplify_options simplify;
    spbm_simplify_report *report = calloc(1, sizeof *report);
    if (!report)
        return SPBM_NO_MEMORY;
    spbm_simplify_defaults(&simplify);
    simplify.import.weld = options->weld;
    simplify.target = options->target;
    simplify.patch = options->patch;
    simplify.lod = options->lod;
    simplify.keep_dir = options->keep_dir;
    simplify.resume_dir = options->resume ? options->tmp_dir : NULL;
    spbm_topology_options topology = options->topology;
    if (options->has_topology) {
        report_removed(&run->report, &topology);
        simplify.topology = &topology;
    }
    if (options->dry_run) {
        free(report);
        return foretell(run, &simplify);
    }

    spbm_status status = spbm_simplify(run->job, options->inputs, options->input_count,
                                       options->output, &simplify, report);
    progress_clear(&run->progress);
    if (report->stage_count > 0)
        report_store(&run->report, &report->store);
    const uint32_t before = report->has_topology ? 2 : 1;
    if (report->has_topology)
        report_removal(&run->report, &report->removal);
    if (report->stage_count > before)
        report_chains(&run->report, &report->chains);
    if (report->stage_count > before + 1) {
        report_levels(&run->report, &report->levels, options->output);
        report_level_counts(&run->report, report->store.cleaning.input_faces, &report->levels);
    }
    for (uint32_t i = 0; i < report->stage_count; i++)
        report_stage(&run->report, &report->stages[i]);
    free(report);
    return status;
}
