/*
 * Catching a stream of vertices and faces.
 *
 * Nothing is known beforehand: how many there are, whether all coordinates are float32, whether
 * faces come before their vertices. So everything is appended to spools as it comes, in the
 * narrowest form, and what needs the whole is done at the end (ingest_finish.c); indices that were
 * ahead of their vertices are judged at the end of their input.
 *
 * A polygon needs all its corners to be triangulated, which may not be there yet, while the order
 * of faces shall not depend on that. A polygon of n corners always gives n - 2 triangles, so it is
 * put down as a fan, in place, and noted.
 */
#include "mesh/ingest.h"

#include <string.h>

#include "base/memory.h"

enum { GROWING_SPOOLS = 4, SOUP_CORNERS = 5 /* that a vertex has at least, most often */ };

void ingest_begin_spool(const struct ingest *ingest, struct spool *spool)
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
    ingest_begin_spool(ingest, &ingest->float_spool);
    ingest_begin_spool(ingest, &ingest->double_spool);
    ingest_begin_spool(ingest, &ingest->face_spool);
    ingest_begin_spool(ingest, &ingest->polygon_spool);
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
    ingest_begin_spool(ingest, &input->record_spool);
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
