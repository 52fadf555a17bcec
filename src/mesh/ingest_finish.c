/*
 * What has been caught becomes one mesh: that of one input is nearly always so already, and is left
 * where it lies.
 *
 * Polygons lie among the faces as fans. Now that all their corners are there they are triangulated,
 * and the triangles take the fans' places. Attributes are what all inputs with vertices have; where
 * inputs differ, or some coordinates are floats and some doubles, a copy has all in one form.
 */
#include "mesh/ingest.h"

#include <string.h>

#include "base/memory.h"
#include "geom/triangulate.h"

enum { POLYGON_STEP = 1 << 16 };

/* ---- polygons ---- */

struct polygon_scratch {
    struct visits visits; /* of positions */
    double *points;       /* 3 a corner */
    size_t points_capacity;
    uint32_t *corners;
    size_t corner_capacity;
    uint32_t *triangles; /* 3 a triangle, corners of the polygon */
    size_t triangle_capacity;
    struct triangulation_workspace workspace;
};

static enum status triangulate_polygon(struct ingest *ingest, const struct ingest_polygon *polygon,
                                       struct polygon_scratch *scratch)
{
    struct context *ctx = ingest->ctx;
    const uint32_t n = polygon->size;
    uint32_t *fan = ingest->faces + 3 * (size_t)polygon->first;
    enum status status = memory_reserve(ctx, &scratch->points, &scratch->points_capacity,
                                        3 * (size_t)n, sizeof(double));
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &scratch->corners, &scratch->corner_capacity, n, 4);
    if (status == STATUS_OK)
        status =
            memory_reserve(ctx, &scratch->triangles, &scratch->triangle_capacity, 3 * (size_t)n, 4);
    if (status != STATUS_OK)
        return status;
    scratch->corners[0] = fan[0];
    scratch->corners[1] = fan[1];
    for (uint32_t i = 2; i < n; i++)
        scratch->corners[i] = fan[3 * (size_t)(i - 2) + 2];
    for (uint32_t i = 0; i < n; i++) {
        visit(&scratch->visits, scratch->corners[i] * (ingest->is_float32 ? 12u : 24ull));
        ingest_position(ingest, scratch->corners[i], scratch->points + 3 * (size_t)i);
    }
    enum triangulation_quality quality;
    status = triangulate(ctx, &scratch->workspace, scratch->points, n, NULL, NULL, NULL,
                         scratch->triangles, &quality);
    if (status != STATUS_OK || quality == TRIANGULATION_BLOCKED)
        return status;
    for (size_t i = 0; i < 3 * (size_t)(n - 2); i++)
        fan[i] = scratch->corners[scratch->triangles[i]];
    return STATUS_OK;
}

static enum status triangulate_all(struct ingest *ingest)
{
    void *data;
    const uint64_t count = ingest->polygon_spool.size / sizeof(struct ingest_polygon);
    enum status status = spool_seal(&ingest->polygon_spool, &data);
    const struct ingest_polygon *polygons = data;
    struct polygon_scratch scratch = {0};
    if (status == STATUS_OK && count)
        status = visits_begin(ingest->room, &scratch.visits, &ingest->position_spool,
                              room_left(ingest->room) / 4 * 3);
    for (uint64_t i = 0; i < count && status == STATUS_OK; i++) {
        if (i % POLYGON_STEP == 0) {
            status = step(ingest->ctx, "import: triangulate", i, count);
            spool_forget_all(&ingest->face_spool);
            spool_forget_all(&ingest->polygon_spool);
        }
        if (status == STATUS_OK)
            status = triangulate_polygon(ingest, &polygons[i], &scratch);
    }
    visits_end(&scratch.visits);
    spool_forget_all(&ingest->face_spool);
    memory_release(ingest->ctx, &scratch.points, scratch.points_capacity, sizeof(double));
    memory_release(ingest->ctx, &scratch.corners, scratch.corner_capacity, 4);
    memory_release(ingest->ctx, &scratch.triangles, scratch.triangle_capacity, 4);
    triangulation_workspace_clear(ingest->ctx, &scratch.workspace);
    spool_clear(&ingest->polygon_spool);
    return status;
}

/* ---- attributes ---- */

static const struct attribute *find_attribute(const struct attributes *in,
                                              const struct attribute *wanted)
{
    for (uint32_t i = 0; i < in->count; i++) {
        if (in->list[i].type == wanted->type && strcmp(in->list[i].name, wanted->name) == 0)
            return &in->list[i];
    }
    return NULL;
}

static void tell_dropped(struct ingest *ingest)
{
    for (size_t i = 0; i < ingest->input_count; i++) {
        const struct ingest_input *input = &ingest->inputs[i];
        for (uint32_t a = 0; a < input->attributes.count; a++) {
            if (!find_attribute(&ingest->attributes, &input->attributes.list[a]))
                tell(ingest->ctx, MESSAGE_NOTE,
                     "%s: vertex property '%s' is dropped: not all inputs have it", input->name,
                     input->attributes.list[a].name);
        }
    }
}

/* What all inputs that have vertices have in common, in the order of the first. */
static void settle_attributes(struct ingest *ingest)
{
    const struct ingest_input *first = NULL;
    for (size_t i = 0; i < ingest->input_count && !first; i++) {
        if (ingest->inputs[i].vertex_count)
            first = &ingest->inputs[i];
    }
    struct attributes *common = &ingest->attributes;
    for (uint32_t a = 0; first && a < first->attributes.count; a++) {
        const struct attribute *wanted = &first->attributes.list[a];
        bool everywhere = true;
        for (size_t i = 0; i < ingest->input_count; i++) {
            struct ingest_input *input = &ingest->inputs[i];
            const struct attribute *found = find_attribute(&input->attributes, wanted);
            everywhere = everywhere && (found || input->vertex_count == 0);
            if (found)
                input->common[common->count] = (uint32_t)(found - input->attributes.list);
        }
        if (!everywhere)
            continue;
        struct attribute *kept = &common->list[common->count++];
        memset(kept, 0, sizeof *kept);
        strncpy(kept->name, wanted->name, ATTRIBUTE_NAME_MAX);
        kept->type = wanted->type;
        kept->offset = common->stride;
        common->stride += scalar_size(wanted->type);
    }
    tell_dropped(ingest);
}

/* ---- one form for all ---- */

/* Appends what the spool `from` holds, as doubles if it holds floats, and clears it. */
static enum status append_floats_of(struct spool *from, struct spool *to)
{
    void *data;
    double buffer[3 * 512];
    enum status status = spool_seal(from, &data);
    const float *floats = data;
    const uint64_t count = from->size / sizeof *floats;
    for (uint64_t done = 0; done < count && status == STATUS_OK;) {
        size_t size = sizeof buffer / sizeof *buffer;
        size = count - done < size ? (size_t)(count - done) : size;
        for (size_t i = 0; i < size; i++)
            buffer[i] = (double)floats[done + i];
        status = spool_append(to, buffer, size * sizeof *buffer);
        done += size;
        if (done % FORGET_EVERY < size)
            spool_forget_all(from);
    }
    spool_clear(from);
    return status;
}

static enum status append_all_of(struct spool *from, struct spool *to)
{
    enum { PIECE = 1 << 20 };
    void *data;
    enum status status = spool_seal(from, &data);
    const unsigned char *bytes = data;
    for (uint64_t done = 0; done < from->size && status == STATUS_OK;) {
        size_t size = from->size - done < PIECE ? (size_t)(from->size - done) : PIECE;
        status = spool_append(to, bytes + done, size);
        done += size;
        spool_forget(from, 0, done);
    }
    spool_clear(from);
    return status;
}

/* Floats, if all are; else doubles. Batches of both kinds need a copy of all. */
static enum status unite_positions(struct ingest *ingest)
{
    enum status status = STATUS_OK;
    struct spool *all = &ingest->position_spool;
    ingest->is_float32 = ingest->double_first == UINT64_MAX;
    if (ingest->is_float32 || ingest->double_first == 0) {
        struct spool *only = ingest->is_float32 ? &ingest->float_spool : &ingest->double_spool;
        *all = *only;
        memset(only, 0, sizeof *only);
    } else {
        ingest_begin_spool(ingest, all);
        status = append_floats_of(&ingest->float_spool, all);
        if (status == STATUS_OK)
            status = append_all_of(&ingest->double_spool, all);
    }
    return status == STATUS_OK ? spool_seal(all, &ingest->positions) : status;
}

/* Whether an input's records are what the common ones shall be. */
static bool has_common_form(const struct ingest *ingest, const struct ingest_input *input)
{
    for (uint32_t a = 0; a < ingest->attributes.count; a++) {
        if (input->attributes.list[input->common[a]].offset != ingest->attributes.list[a].offset)
            return false;
    }
    return input->attributes.stride == ingest->attributes.stride;
}

static enum status append_records(struct ingest *ingest, struct ingest_input *input)
{
    unsigned char record[ATTRIBUTE_MAX * 8];
    void *data;
    enum status status = spool_seal(&input->record_spool, &data);
    const unsigned char *from = data;
    for (uint64_t v = 0; v < input->vertex_count && status == STATUS_OK; v++) {
        for (uint32_t a = 0; a < ingest->attributes.count; a++) {
            const struct attribute *to = &ingest->attributes.list[a];
            memcpy(record + to->offset, from + input->attributes.list[input->common[a]].offset,
                   scalar_size(to->type));
        }
        status = spool_append(&ingest->record_spool, record, ingest->attributes.stride);
        from += input->attributes.stride;
        if (v % FORGET_EVERY == 0)
            spool_forget_all(&input->record_spool);
    }
    spool_clear(&input->record_spool);
    return status;
}

static enum status unite_records(struct ingest *ingest)
{
    if (ingest->attributes.stride == 0)
        return STATUS_OK;
    enum status status = STATUS_OK;
    if (ingest->input_count == 1 && has_common_form(ingest, &ingest->inputs[0])) {
        ingest->record_spool = ingest->inputs[0].record_spool;
        memset(&ingest->inputs[0].record_spool, 0, sizeof ingest->inputs[0].record_spool);
    } else {
        ingest_begin_spool(ingest, &ingest->record_spool);
        for (size_t i = 0; i < ingest->input_count && status == STATUS_OK; i++)
            status = append_records(ingest, &ingest->inputs[i]);
    }
    void *data = NULL;
    if (status == STATUS_OK)
        status = spool_seal(&ingest->record_spool, &data);
    ingest->records = data;
    return status;
}

/* ---- the end ---- */

enum status ingest_finish(struct ingest *ingest)
{
    void *data;
    enum status status = unite_positions(ingest);
    if (status == STATUS_OK) {
        settle_attributes(ingest);
        status = unite_records(ingest);
    }
    if (status == STATUS_OK)
        status = spool_seal(&ingest->face_spool, &data);
    if (status == STATUS_OK) {
        ingest->faces = data;
        status = triangulate_all(ingest);
    }
    return status;
}
