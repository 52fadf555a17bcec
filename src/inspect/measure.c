/*
 * `spbm measure`: loads the simplified mesh and its tree, opens the original as a stream of pieces,
 * and lets both surfaces ask each other (measure_forward.c, measure_backward.c). The largest
 * distances are taken over samples, so they are lower bounds of the true Hausdorff distance, closer
 * the more samples there are; means weigh by area.
 */
#include "inspect/measure.h"

#include <string.h>

#include "base/memory.h"
#include "inspect/comparison.h"

enum { DEFAULT_SAMPLES = 10, DEFAULT_LEAST_TOTAL = 100000, SAMPLES_MAX = 1 << 16 };

static enum status set_up(struct comparison *comparison)
{
    struct context *ctx = comparison->ctx;
    const struct mesh *mesh = comparison->mesh;
    struct measurement *result = comparison->result;
    uint64_t pieces = original_piece_count(comparison->original);
    enum status status = bvh_build(ctx, mesh->positions, mesh->faces, (uint32_t)mesh->face_count,
                                   true, &comparison->tree);
    if (status == STATUS_OK)
        status = memory_take(ctx, (size_t)mesh->face_count, sizeof *comparison->anchors,
                             &comparison->anchors);
    if (status == STATUS_OK)
        status = memory_take(ctx, (size_t)pieces, sizeof *comparison->boxes, &comparison->boxes);
    if (status == STATUS_OK) {
        result->vertex_error_count = mesh->vertex_count;
        status = memory_take_zeroed(ctx, (size_t)mesh->vertex_count, sizeof(float),
                                    &result->vertex_error);
    }
    if (status == STATUS_OK) {
        result->face_error_count = mesh->face_count;
        status =
            memory_take_zeroed(ctx, (size_t)mesh->face_count, sizeof(float), &result->face_error);
    }
    if (status != STATUS_OK)
        return status;

    for (uint64_t f = 0; f < mesh->face_count; f++)
        comparison->anchors[f].distance = INFINITY;
    /* An anchor's coordinates are within the original's box, relative to the tree's origin. */
    double farthest = 0;
    const double *low = result->original.box_low, *high = result->original.box_high;
    const double origin[3] = {comparison->tree.origin.x, comparison->tree.origin.y,
                              comparison->tree.origin.z};
    for (unsigned k = 0; k < 3; k++)
        farthest = fmax(farthest, fmax(fabs(low[k] - origin[k]), fabs(high[k] - origin[k])));
    comparison->anchor_slack = farthest * 0x1p-22;
    return STATUS_OK;
}

static enum status compare(struct comparison *comparison, const struct measure_options *options)
{
    struct measurement *result = comparison->result;
    enum status status = set_up(comparison);
    if (status == STATUS_OK)
        status = measure_forward(comparison);
    if (status == STATUS_OK)
        status = measure_backward(comparison);
    if (status == STATUS_OK && options->self_intersections)
        status = measure_crossings(comparison, &result->self_intersecting_faces);
    result->hausdorff = fmax(result->forward.largest, result->backward.largest);
    return status;
}

enum status measure(struct context *ctx, const char *original, const char *simplified,
                    const struct measure_options *options, struct measurement *result,
                    struct mesh *mesh)
{
    struct comparison comparison = {.ctx = ctx, .mesh = mesh, .result = result};
    memset(result, 0, sizeof *result);
    memset(mesh, 0, sizeof *mesh);
    if (options->samples_per_face > SAMPLES_MAX)
        return fail(ctx, STATUS_MISUSE, "more than %d samples a face are not possible",
                    SAMPLES_MAX);

    enum status status =
        original_open(ctx, original, simplified, &comparison.original, &result->original);
    if (status == STATUS_OK)
        status = mesh_load_any(ctx, simplified, mesh);
    if (status == STATUS_OK && mesh->face_count == 0)
        status = fail(ctx, STATUS_BAD_INPUT, "%s: there are no faces to measure", simplified);
    if (status == STATUS_OK)
        status = quality_of_mesh(ctx, mesh, &result->simplified);
    if (status == STATUS_OK) {
        const double *low = result->original.box_low, *high = result->original.box_high;
        result->diagonal = vec3_distance(vec3_load(low), vec3_load(high));
        uint32_t least = options->samples_per_face ? options->samples_per_face : DEFAULT_SAMPLES;
        comparison.least_samples = least;
        comparison.wanted_samples = least * mesh->face_count;
        if (!options->samples_per_face && comparison.wanted_samples < DEFAULT_LEAST_TOTAL)
            comparison.wanted_samples = DEFAULT_LEAST_TOTAL;
        status = compare(&comparison, options);
    }

    memory_release(ctx, &comparison.boxes,
                   comparison.original ? (size_t)original_piece_count(comparison.original) : 0,
                   sizeof *comparison.boxes);
    memory_release(ctx, &comparison.anchors, (size_t)mesh->face_count, sizeof *comparison.anchors);
    bvh_clear(ctx, &comparison.tree);
    original_close(&comparison.original);
    if (status != STATUS_OK) {
        measurement_clear(ctx, result);
        mesh_clear(ctx, mesh);
    }
    return status;
}

void measurement_clear(struct context *ctx, struct measurement *result)
{
    memory_release(ctx, &result->vertex_error, (size_t)result->vertex_error_count,
                   sizeof *result->vertex_error);
    memory_release(ctx, &result->face_error, (size_t)result->face_error_count,
                   sizeof *result->face_error);
    result->vertex_error_count = result->face_error_count = 0;
}
