/*
 * Catching a stream of vertices and faces.
 *
 * Nothing is known beforehand: how many there are, whether all coordinates are float32, whether
 * faces come before their vertices. So everything is appended to spools as it comes, in the
 * narrowest form, and what needs the whole is done at the end: indices that were ahead of their
 * vertices are judged, polygons triangulated, attribute schemas of several inputs compared.
 *
 * A polygon needs all its corners to be triangulated, which may not be there yet, while the order
 * of faces shall not depend on that. A polygon of n corners always gives n - 2 triangles, so it is
 * put down as a fan, in place, and noted; its triangles are made over at the end.
 */
#include "mesh/ingest.h"

#include <string.h>

#include "base/memory.h"
#include "geom/triangulate.h"

enum { BATCH = 4096, POLYGON_STEP = 1 << 16 };

enum { GROWING_SPOOLS = 4, SOUP_CORNERS = 5 /* that a vertex has at least, most often */ };

static void begin_spool(const struct ingest *ingest, struct spool *spool)
{
    spool_init(ingest->ctx, spool, ingest->room->beside,
               room_spool_limit(ingest->room, GROWING_SPOOLS));
}

void ingest_init(struct context *ctx, struct ingest *ingest, const struct room *room)
{
    memset(ingest, 0, sizeof *ingest);
    ingest->ctx = ctx;
    ingest->room = room;
    ingest->index_limit = mesh_limit;
    ingest->double_first = UINT64_MAX;
    begin_spool(ingest, &ingest->float_spool);
    begin_spool(ingest, &ingest->double_spool);
    begin_spool(ingest, &ingest->face_spool);
    begin_spool(ingest, &ingest->polygon_spool);
}

void ingest_clear(struct ingest *ingest)
{
    if (!ingest->ctx)
        return;
    prefault_end(&ingest->prefault);
    for (size_t i = 0; i < ingest->input_count; i++)
        spool_clear(&ingest->inputs[i].record_spool);
    memory_release(ingest->ctx, &ingest->inputs, ingest->input_capacity, sizeof *ingest->inputs);
    spool_clear(&ingest->float_spool);
    spool_clear(&ingest->double_spool);
    spool_clear(&ingest->face_spool);
    spool_clear(&ingest->polygon_spool);
    spool_clear(&ingest->position_spool);
    spool_clear(&ingest->record_spool);
    sieve_close(&ingest->sieve);
    memset(ingest, 0, sizeof *ingest);
}

static struct ingest_input *current(struct ingest *ingest)
{
    return &ingest->inputs[ingest->input_count - 1];
}

/* ---- the sink ---- */

static enum status sink_begin(void *user, const struct attributes *attributes, bool is_soup,
                              uint64_t expected_vertices, uint64_t expected_faces)
{
    struct ingest *ingest = user;
    struct ingest_input *input = current(ingest);
    enum status status = STATUS_OK;
    if (attributes)
        input->attributes = *attributes;
    input->is_soup = is_soup;
    if (expected_faces <= ingest->credible / 12) {
        input->expected_faces = expected_faces;
        status = spool_reserve(&ingest->face_spool, ingest->face_spool.size + 12 * expected_faces);
    }
    if (is_soup && ingest->sieve.ctx)
        expected_vertices /= SOUP_CORNERS;
    if (expected_vertices <= ingest->credible / 12)
        input->expected_vertices = expected_vertices;
    return status;
}

static enum status append_as_doubles(struct ingest *ingest, size_t count, const float *floats)
{
    double buffer[3 * 512];
    for (size_t done = 0; done < 3 * count;) {
        size_t size = 3 * count - done;
        if (size > sizeof buffer / sizeof *buffer)
            size = sizeof buffer / sizeof *buffer;
        for (size_t i = 0; i < size; i++)
            buffer[i] = (double)floats[done + i];
        enum status status = spool_append(&ingest->double_spool, buffer, size * sizeof *buffer);
        if (status != STATUS_OK)
            return status;
        done += size;
    }
    return STATUS_OK;
}

static bool is_sifted(struct ingest *ingest)
{
    return ingest->sieve.ctx && current(ingest)->is_soup && !current(ingest)->attributes.stride;
}

/* What is reserved for the current input will be filled to the end, or the input is refused. */
static void add_reserved(struct prefault *prefault, const struct spool *spool, uint64_t expected)
{
    if (spool->fd < 0 && expected > 0 && spool->capacity >= spool->used + 12 * expected)
        prefault_add(prefault, spool->memory + spool->used, (size_t)(12 * expected));
}

static void begin_prefault(struct ingest *ingest)
{
    const struct ingest_input *input = current(ingest);
    if (!is_sifted(ingest)) /* of which nobody knows what the sieve leaves */
        add_reserved(&ingest->prefault, &ingest->float_spool, input->expected_vertices);
    add_reserved(&ingest->prefault, &ingest->face_spool, input->expected_faces);
    prefault_begin(ingest->ctx, &ingest->prefault);
}

/* Corners of a soup: *floats, of which *count are new. Doubles pass. */
static enum status sift(struct ingest *ingest, size_t *count, const float **floats,
                        const double *doubles)
{
    const uint64_t next = ingest->vertex_count;
    if (doubles)
        return sieve_pass(&ingest->sieve, *count, next);
    enum status status = sieve_take(&ingest->sieve, *floats, *count, next, count);
    *floats = ingest->sieve.out;
    return status;
}

/* Faces of a soup, whose corners the sieve names. */
static enum status append_soup(struct ingest *ingest, size_t count, const uint32_t *indices)
{
    uint32_t buffer[3 * 1024];
    enum status status = STATUS_OK;
    for (size_t done = 0; done < 3 * count && status == STATUS_OK;) {
        size_t size = 3 * count - done;
        if (size > sizeof buffer / sizeof *buffer)
            size = sizeof buffer / sizeof *buffer;
        memcpy(buffer, indices + done, size * sizeof *buffer);
        status = sieve_name(&ingest->sieve, buffer, size);
        if (status == STATUS_OK)
            status = spool_append(&ingest->face_spool, buffer, size * sizeof *buffer);
        done += size;
    }
    return status;
}

static enum status sink_vertices(void *user, size_t count, const float *floats,
                                 const double *doubles, const unsigned char *records)
{
    struct ingest *ingest = user;
    struct ingest_input *input = current(ingest);
    const uint64_t before = ingest->vertex_count + ingest->sieve.held;
    if (count > ingest->index_limit || before + count > ingest->index_limit)
        return fail(ingest->ctx, STATUS_BAD_INPUT,
                    "%s: more than %llu vertices, which is the limit of a mesh", input->name,
                    (unsigned long long)ingest->index_limit);
    enum status status = STATUS_OK;
    if (is_sifted(ingest))
        status = sift(ingest, &count, &floats, doubles);
    if (status != STATUS_OK || count == 0)
        return status;
    if (doubles) {
        if (ingest->double_first == UINT64_MAX)
            ingest->double_first = ingest->vertex_count;
        status = spool_append(&ingest->double_spool, doubles, 3 * count * sizeof *doubles);
    } else if (ingest->double_first != UINT64_MAX) {
        status = append_as_doubles(ingest, count, floats);
    } else {
        status = spool_reserve(&ingest->float_spool,
                               12 * (input->vertex_first + input->expected_vertices));
        if (status == STATUS_OK && input->vertex_count == 0)
            begin_prefault(ingest);
        if (status == STATUS_OK)
            status = spool_append(&ingest->float_spool, floats, 3 * count * sizeof *floats);
    }
    if (status == STATUS_OK && input->attributes.stride)
        status = spool_append(&input->record_spool, records, count * input->attributes.stride);
    ingest->vertex_count += count;
    input->vertex_count += count;
    return status;
}

static uint32_t largest_of(const uint32_t *indices, size_t count)
{
    uint32_t largest = 0;
    for (size_t i = 0; i < count; i++)
        largest = indices[i] > largest ? indices[i] : largest;
    return largest;
}

/* The largest index of a run, to be judged at once if it can't be right, or when all vertices are
 * known. `face` is the file's number of the first face; all have `corners` corners. */
static enum status watch_largest(struct ingest *ingest, uint64_t face, const uint32_t *indices,
                                 size_t count, uint32_t corners, uint32_t largest)
{
    struct ingest_input *input = current(ingest);
    if (count == 0 || largest < input->vertex_count || largest < ingest->needed_vertices)
        return STATUS_OK;
    const bool is_beyond = input->vertex_first + largest >= ingest->index_limit;
    size_t at = 0; /* the first one beyond, whatever runs the faces come in */
    while (is_beyond ? input->vertex_first + indices[at] < ingest->index_limit
                     : indices[at] != largest)
        at++;
    ingest->needed_vertices = (uint64_t)largest + 1;
    ingest->largest_face = face + at / corners;
    if (is_beyond)
        return fail(ingest->ctx, STATUS_BAD_INPUT,
                    "%s: face %llu names vertex %lu, beyond the limit of %llu vertices",
                    input->name, (unsigned long long)ingest->largest_face,
                    (unsigned long)indices[at], (unsigned long long)ingest->index_limit);
    return STATUS_OK;
}

static enum status count_faces(struct ingest *ingest, uint64_t triangles)
{
    ingest->face_count += triangles;
    if (ingest->face_count > ingest->index_limit)
        return fail(ingest->ctx, STATUS_BAD_INPUT,
                    "%s: more than %llu triangles, which is the limit of a mesh",
                    current(ingest)->name, (unsigned long long)ingest->index_limit);
    return STATUS_OK;
}

/* largest NULL: it is not known. */
static enum status append_triangles(struct ingest *ingest, uint64_t first_face, size_t count,
                                    const uint32_t *indices, const uint32_t *largest)
{
    enum status status = count_faces(ingest, count);
    if (status == STATUS_OK && is_sifted(ingest))
        return append_soup(ingest, count, indices);
    if (status == STATUS_OK)
        status = watch_largest(ingest, first_face, indices, 3 * count, 3,
                               largest ? *largest : largest_of(indices, 3 * count));
    if (status != STATUS_OK)
        return status;
    if (ingest->taker.user && ingest->needed_vertices == 0 && !current(ingest)->is_soup) {
        bool taken;
        status = ingest->taker.take(ingest->taker.user, ingest, count, indices, &taken);
        if (status != STATUS_OK || taken)
            return status;
    }
    ingest->taker.user = NULL;
    uint32_t offset = (uint32_t)current(ingest)->vertex_first;
    if (offset == 0)
        return spool_append(&ingest->face_spool, indices, 3 * count * sizeof *indices);
    uint32_t buffer[3 * 1024];
    for (size_t done = 0; done < 3 * count && status == STATUS_OK;) {
        size_t size = 3 * count - done;
        if (size > sizeof buffer / sizeof *buffer)
            size = sizeof buffer / sizeof *buffer;
        for (size_t i = 0; i < size; i++)
            buffer[i] = indices[done + i] + offset;
        status = spool_append(&ingest->face_spool, buffer, size * sizeof *buffer);
        done += size;
    }
    return status;
}

/* As a fan, noted for later. */
static enum status append_polygon(struct ingest *ingest, uint64_t face, uint32_t size,
                                  const uint32_t *indices)
{
    ingest->taker.user = NULL;
    struct ingest_polygon polygon = {(uint32_t)ingest->face_count, size};
    enum status status = count_faces(ingest, size - 2);
    if (status == STATUS_OK)
        status = watch_largest(ingest, face, indices, size, size, largest_of(indices, size));
    if (status == STATUS_OK)
        status = spool_append(&ingest->polygon_spool, &polygon, sizeof polygon);
    uint32_t offset = (uint32_t)current(ingest)->vertex_first;
    uint32_t buffer[3 * 256];
    size_t used = 0;
    for (uint32_t i = 2; i < size && status == STATUS_OK; i++) {
        buffer[used++] = indices[0] + offset;
        buffer[used++] = indices[i - 1] + offset;
        buffer[used++] = indices[i] + offset;
        if (used == sizeof buffer / sizeof *buffer || i + 1 == size) {
            status = spool_append(&ingest->face_spool, buffer, used * sizeof *buffer);
            used = 0;
        }
    }
    ingest->polygon_faces += size - 2;
    return status;
}

static enum status sink_faces(void *user, uint64_t first_face, size_t count, const uint32_t *sizes,
                              const uint32_t *indices)
{
    struct ingest *ingest = user;
    ingest->input_faces += count;
    if (!sizes)
        return append_triangles(ingest, first_face, count, indices, NULL);
    enum status status = STATUS_OK;
    for (size_t i = 0; i < count && status == STATUS_OK;) {
        size_t run = 0;
        while (i + run < count && sizes[i + run] == 3)
            run++;
        if (run) {
            status = append_triangles(ingest, first_face + i, run, indices, NULL);
            indices += 3 * run;
            i += run;
        } else if (sizes[i] < 3) {
            status = fail(ingest->ctx, STATUS_BAD_INPUT, "%s: face %llu has %lu corners",
                          current(ingest)->name, (unsigned long long)(first_face + i),
                          (unsigned long)sizes[i]);
        } else {
            status = append_polygon(ingest, first_face + i, sizes[i], indices);
            indices += sizes[i];
            i++;
        }
    }
    return status;
}

static enum status sink_triangles(void *user, uint64_t first_face, size_t count,
                                  const uint32_t *indices, uint32_t largest)
{
    struct ingest *ingest = user;
    ingest->input_faces += count;
    return append_triangles(ingest, first_face, count, indices, &largest);
}

/* ---- an input from begin to end ---- */

enum status ingest_begin(struct ingest *ingest, const char *name, struct import_sink *sink)
{
    enum status status = memory_reserve(ingest->ctx, &ingest->inputs, &ingest->input_capacity,
                                        ingest->input_count + 1, sizeof *ingest->inputs);
    if (status != STATUS_OK)
        return status;
    if (ingest->input_count)
        ingest->taker.user = NULL;
    struct ingest_input *input = &ingest->inputs[ingest->input_count++];
    memset(input, 0, sizeof *input);
    input->name = name;
    input->vertex_first = ingest->vertex_count;
    begin_spool(ingest, &input->record_spool);
    ingest->needed_vertices = 0;
    ingest->largest_face = 0;
    sieve_restart(&ingest->sieve);
    *sink = (struct import_sink){ingest, sink_begin, sink_vertices, sink_faces, sink_triangles};
    return STATUS_OK;
}

enum status ingest_end(struct ingest *ingest)
{
    const struct ingest_input *input = current(ingest);
    prefault_end(&ingest->prefault);
    if (ingest->needed_vertices > input->vertex_count)
        return fail(ingest->ctx, STATUS_BAD_INPUT,
                    "%s: face %llu names vertex %llu, but there are %llu vertices", input->name,
                    (unsigned long long)ingest->largest_face,
                    (unsigned long long)(ingest->needed_vertices - 1),
                    (unsigned long long)input->vertex_count);
    return STATUS_OK;
}

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
        begin_spool(ingest, all);
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
        begin_spool(ingest, &ingest->record_spool);
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
