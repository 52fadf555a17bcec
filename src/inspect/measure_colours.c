/*
 * The error as colours, for pictures and for other viewers.
 *
 * The largest error would be the natural end of the scale, but one bad face then leaves all others
 * in the first colour. So the scale ends where the worst hundredth of the faces begins.
 */
#include "inspect/measure.h"

#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "inspect/colour.h"

enum { BUCKETS = 4096, RECORD_SIZE = 7 /* float, 3 bytes */ };

/* The error that all but a hundredth of the faces stay below, to 1/4096 of the largest. */
static double usual_error(const struct measurement *result)
{
    uint32_t buckets[BUCKETS + 1] = {0};
    double largest = 0;
    for (uint64_t f = 0; f < result->face_error_count; f++)
        largest = (double)result->face_error[f] > largest ? (double)result->face_error[f] : largest;
    if (!(largest > 0))
        return 0;
    for (uint64_t f = 0; f < result->face_error_count; f++)
        buckets[(size_t)((double)result->face_error[f] / largest * BUCKETS)]++;
    uint64_t above = 0;
    int bucket = BUCKETS;
    while (bucket > 0 && above + buckets[bucket] <= result->face_error_count / 100)
        above += buckets[bucket--];
    return largest * (bucket + 1 < BUCKETS ? bucket + 1 : BUCKETS) / BUCKETS;
}

/* Mean error of the faces round each vertex, weighed alike, or its own if that is larger. */
static enum status spread_errors(struct context *ctx, const struct measurement *result,
                                 const struct mesh *mesh, float *errors)
{
    uint32_t *faces = NULL;
    enum status status = memory_take_zeroed(ctx, (size_t)mesh->vertex_count, sizeof *faces, &faces);
    if (status != STATUS_OK)
        return status;
    memset(errors, 0, (size_t)mesh->vertex_count * sizeof *errors);
    for (uint64_t i = 0; i < 3 * mesh->face_count; i++) {
        errors[mesh->faces[i]] += result->face_error[i / 3];
        faces[mesh->faces[i]]++;
    }
    for (uint64_t v = 0; v < mesh->vertex_count; v++) {
        errors[v] /= faces[v] ? (float)faces[v] : 1.0f;
        errors[v] = errors[v] > result->vertex_error[v] ? errors[v] : result->vertex_error[v];
    }
    memory_release(ctx, &faces, (size_t)mesh->vertex_count, sizeof *faces);
    return STATUS_OK;
}

enum status measure_save(struct context *ctx, const char *path,
                         const struct export_options *options, const struct measurement *result,
                         const struct mesh *mesh)
{
    if (result->face_error_count != mesh->face_count ||
        result->vertex_error_count != mesh->vertex_count)
        return fail(ctx, STATUS_INTERNAL, "the errors are those of another mesh");
    struct mesh coloured = *mesh; /* borrows everything but the records */
    coloured.attributes = (struct attributes){.count = 4,
                                              .stride = RECORD_SIZE,
                                              .list = {{"quality", SCALAR_FLOAT32, 0},
                                                       {"red", SCALAR_UINT8, 4},
                                                       {"green", SCALAR_UINT8, 5},
                                                       {"blue", SCALAR_UINT8, 6}}};
    coloured.records = NULL;
    float *errors = NULL;
    size_t count = (size_t)mesh->vertex_count;
    enum status status = memory_take(ctx, count, RECORD_SIZE, &coloured.records);
    if (status == STATUS_OK)
        status = memory_take(ctx, count, sizeof *errors, &errors);
    if (status == STATUS_OK)
        status = spread_errors(ctx, result, mesh, errors);
    if (status == STATUS_OK) {
        double range = usual_error(result);
        for (size_t v = 0; v < count; v++) {
            unsigned char *record = coloured.records + RECORD_SIZE * v;
            uint32_t colour = colour_map(range > 0 ? (double)errors[v] / range : 0);
            store_f32(record, errors[v]);
            record[4] = (unsigned char)(colour >> 16);
            record[5] = (unsigned char)(colour >> 8);
            record[6] = (unsigned char)colour;
        }
        status = mesh_save(ctx, path, options, &coloured);
    }
    memory_release(ctx, &errors, count, sizeof *errors);
    memory_release(ctx, &coloured.records, count, RECORD_SIZE);
    return status;
}
