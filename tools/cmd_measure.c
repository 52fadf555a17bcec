/* spbm measure: how far a simplified mesh is from its original, on standard output. */
#include "commands.h"

#include "figures.h"
#include "values.h"

static void write_length(const char *key, double length, double diagonal)
{
    printf("%-42s %-12s %s of the diagonal\n", key, length_text(length).s,
           percent_text(diagonal > 0 ? length / diagonal : 0).s);
}

static void write_deviation(const char *way, const spbm_deviation *deviation, double diagonal)
{
    char key[64];
    snprintf(key, sizeof key, "%s: largest", way);
    write_length(key, deviation->largest, diagonal);
    snprintf(key, sizeof key, "%s: mean", way);
    write_length(key, deviation->mean, diagonal);
    snprintf(key, sizeof key, "%s: root mean square", way);
    write_length(key, deviation->rms, diagonal);
}

static void write_words(const struct options *options, const spbm_measurement *result)
{
    write_deviation("original to simplified", &result->forward, result->diagonal);
    write_deviation("simplified to original", &result->backward, result->diagonal);
    write_length("Hausdorff distance", result->hausdorff, result->diagonal);
    printf("%-42s %.3g mean, %.3g largest (degrees)\n", "normals differ", result->normal_mean,
           result->normal_largest);
    printf("%-42s %s\n", "flipped faces", count_text(result->flipped_faces).s);
    if (options->measure.self_intersections)
        printf("%-42s %s\n", "self-intersecting faces",
               count_text(result->self_intersecting_faces).s);
    printf("%-42s %s + %s (%.1f a face)\n", "samples", count_text(result->forward.samples).s,
           count_text(result->backward.samples).s, result->samples_per_face);
    printf("\noriginal: %s\n", options->inputs[0]);
    write_quality(stdout, &result->original);
    printf("\nsimplified: %s\n", options->inputs[1]);
    write_quality(stdout, &result->simplified);
}

static json_t *json_of_measurement(const struct options *options, const spbm_measurement *result)
{
    json_t *object = json_object();
    set_json(object, "forward", json_of_deviation(&result->forward));
    set_json(object, "backward", json_of_deviation(&result->backward));
    set_real(object, "hausdorff", result->hausdorff);
    set_real(object, "diagonal", result->diagonal);
    set_real(object, "normal_mean", result->normal_mean);
    set_real(object, "normal_largest", result->normal_largest);
    set_real(object, "samples_per_face", result->samples_per_face);
    set_count(object, "flipped_faces", result->flipped_faces);
    if (options->measure.self_intersections)
        set_count(object, "self_intersecting_faces", result->self_intersecting_faces);
    else
        set_json(object, "self_intersecting_faces", NULL);
    set_json(object, "original", json_of_quality(&result->original));
    set_json(object, "simplified", json_of_quality(&result->simplified));
    return object;
}

spbm_status cmd_measure(struct run *run)
{
    const struct options *options = run->options;
    spbm_measurement result;
    spbm_status status =
        spbm_measure(run->job, options->inputs[0], options->inputs[1], &options->measure, &result);
    progress_clear(&run->progress);
    if (status != SPBM_OK)
        return status;
    set_json(run->report.root, "measurement", json_of_measurement(options, &result));
    if (words_to_stdout(run))
        write_words(options, &result);
    if (options->measure.error_ply && run->report.words)
        fprintf(run->report.words, "%s: each vertex with its distance to the original\n",
                options->measure.error_ply);
    report_counts(&run->report, "%s against %s",
                  counted_text(result.original.topology.faces, "face", "faces").s,
                  counted_text(result.simplified.topology.faces, "face", "faces").s);
    return status;
}
