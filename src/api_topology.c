/*
 * The public interface to topology simplification: import to a temporary store unless the input is
 * one, a temporary chain file, the run, and the report.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "api_internal.h"
#include "mesh/store_layout.h"

_Static_assert((int)SPBM_FEATURE_KINDS == (int)FEATURE_KINDS, "kinds of features differ");
_Static_assert((int)SPBM_HANDLE == (int)FEATURE_HANDLE, "kinds of features differ");
_Static_assert((int)SPBM_SIZE_EXTENT == (int)LOOP_EXTENT, "measures of loops differ");

const char *spbm_feature_text(spbm_feature_kind kind)
{
    static const char *const words[] = {"hole",      "cavity", "bump",  "pipe",
                                        "component", "crack",  "handle"};
    return (unsigned)kind < SPBM_FEATURE_KINDS ? words[kind] : "feature";
}

void spbm_topology_defaults(spbm_topology_options *options)
{
    struct topology_options defaults;
    topology_defaults(&defaults);
    memset(options, 0, sizeof *options);
    spbm_import_defaults(&options->import);
    memcpy(options->sharp_angle, defaults.sharp_angle, sizeof options->sharp_angle);
    options->zip_tolerance.value = defaults.zip_tolerance.value;
    options->sync = 1;
}

/* ---- options ---- */

static bool length_is_good(const spbm_length *length)
{
    return isfinite(length->value) && length->value >= 0;
}

enum status check_topology(struct context *ctx, const spbm_topology_options *options)
{
    const spbm_length *lengths[] = {&options->max_feature, &options->drop_components,
                                    &options->close_cracks};
    bool is_asked = options->merge_coplanar != 0;
    for (unsigned i = 0; i < 3; i++) {
        if (!length_is_good(lengths[i]))
            return fail(ctx, STATUS_MISUSE, "a size must be a length, not below 0");
        is_asked |= lengths[i]->value > 0;
    }
    if (!isfinite(options->zip_tolerance.value))
        return fail(ctx, STATUS_MISUSE, "the zip tolerance must be a length");
    if (!is_asked)
        return fail(ctx, STATUS_MISUSE, "nothing is asked for: no size is given");
    if (options->smooth_features && !(options->max_feature.value > 0))
        return fail(ctx, STATUS_MISUSE, "smooth features go below a size, which is not given");
    if ((unsigned)options->size > SPBM_SIZE_EXTENT)
        return fail(ctx, STATUS_MISUSE, "there is no way %d to measure a loop", (int)options->size);
    if (!(options->sharp_angle[0] > 0 && options->sharp_angle[0] < options->sharp_angle[1] &&
          options->sharp_angle[1] <= 180))
        return fail(ctx, STATUS_MISUSE, "sharp angles must be above 0, ascending, at most 180");
    return STATUS_OK;
}

static struct length_option make_length(const spbm_length *from)
{
    return (struct length_option){.value = from->value, .is_relative = from->is_relative != 0};
}

struct topology_options make_topology(const spbm_topology_options *from)
{
    struct topology_options options;
    topology_defaults(&options);
    options.max_feature = make_length(&from->max_feature);
    options.measure = (enum loop_measure)from->size;
    memcpy(options.sharp_angle, from->sharp_angle, sizeof options.sharp_angle);
    options.remove_pipes = from->remove_pipes != 0;
    options.smooth_features = from->smooth_features != 0;
    options.drop_components = make_length(&from->drop_components);
    options.close_cracks = make_length(&from->close_cracks);
    options.zip_tolerance = make_length(&from->zip_tolerance);
    options.crack_inscribed = from->crack_inscribed != 0;
    options.merge_coplanar = from->merge_coplanar != 0;
    options.export.format = (enum export_format)from->format;
    options.export.sync = from->sync != 0;
    return options;
}

/* ---- the run ---- */

/* Is it one mesh store? What cannot be read is left to the import to complain about. */
static bool is_store(const char *const *inputs, size_t input_count)
{
    char magic[8] = "";
    if (input_count != 1 || is_standard_stream(inputs[0]))
        return false;
    FILE *file = fopen(inputs[0], "rb");
    if (!file)
        return false;
    size_t size = fread(magic, 1, sizeof magic, file);
    fclose(file);
    return size == sizeof magic && memcmp(magic, STORE_MAGIC, sizeof magic) == 0;
}

void copy_removal(spbm_removal *to, const spbm_topology_options *options,
                  const struct topology_report *from)
{
    memcpy(to->counts, from->counts, sizeof to->counts);
    to->blocked = from->blocked;
    to->zipped = from->zipped;
    to->dropped_faces = from->dropped_faces;
    to->added_faces = from->added_faces;
    to->vertices = from->vertices;
    to->faces = from->faces;
    for (size_t i = 0; options->removed && i < from->feature_count; i++) {
        const struct feature *feature = &from->features[i];
        spbm_feature one = {.kind = (spbm_feature_kind)feature->kind,
                            .loops = feature->loops,
                            .size = feature->size};
        memcpy(one.place, feature->place, sizeof one.place);
        options->removed(options->user, &one);
    }
}

static enum status read_figures(struct context *ctx, const char *path, spbm_store_figures *figures)
{
    struct store *store;
    enum status status = store_open(ctx, path, false, &store);
    if (status == STATUS_OK) {
        copy_store(figures, store_info(store));
        store_close(&store);
    }
    return status;
}

static enum status run_topology(struct spbm_job *job, struct workspace *work,
                                const char *const *inputs, size_t input_count, const char *output,
                                const spbm_topology_options *options, spbm_topology_report *report)
{
    struct context *ctx = work->ctx;
    bool has_store = is_store(inputs, input_count);
    const char *store = has_store ? inputs[0] : work->store;
    struct topology_options wanted = make_topology(options);
    struct topology_report result = {0};
    struct clock began = clock_now();
    enum status status = STATUS_OK;
    if (!has_store) {
        struct import_options import = {.weld = options->import.weld != 0};
        status = stage_begin(job, STAGE_IMPORT, &(struct run_size){0});
        if (status == STATUS_OK)
            status = store_build(ctx, inputs, input_count, store, &import, NULL);
        report->stages[report->stage_count++] = stage_since(ctx, "import", &began);
        budget_begin(ctx, job_memory(job), job->settings.threads);
    }
    if (status == STATUS_OK)
        status = read_figures(ctx, store, &report->store);
    if (status == STATUS_OK)
        status = topology_run(ctx, store, work->chains, output, &wanted, &result);
    if (status == STATUS_OK) {
        report->stages[report->stage_count++] = stage_since(ctx, "topology", &began);
        copy_removal(&report->removal, options, &result);
    }
    topology_report_clear(ctx, &result);
    return status;
}

spbm_status spbm_simplify_topology(spbm_job *job, const char *const *inputs, size_t input_count,
                                   const char *output, const spbm_topology_options *options,
                                   spbm_topology_report *report)
{
    struct context *ctx = call_begin(job);
    struct workspace work;
    spbm_topology_report unwanted;
    report = report ? report : &unwanted;
    memset(report, 0, sizeof *report);
    workspace_init(&work, ctx);

    enum status status = check_topology(ctx, options);
    if (status == STATUS_OK)
        status = check_writable(ctx, output);
    if (status == STATUS_OK)
        status = check_format(ctx, output, options->format);
    if (status == STATUS_OK)
        status = check_inputs(ctx, inputs, input_count, output);
    if (status == STATUS_OK)
        status = workspace_hide(&work, output);
    if (status == STATUS_OK)
        status = run_topology(job, &work, inputs, input_count, output, options, report);
    workspace_explain(&work);
    workspace_close(&work);
    return call_end(job, status);
}
