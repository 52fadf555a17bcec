/*
 * A mesh file in memory, as it is.
 *
 * Vertices and faces are appended as they come; faces stay polygons until all vertices are there,
 * for a face may come before its corners. Then indices are checked, polygons triangulated, and
 * the corners of an STL welded: vertices with the same coordinates become one, the first of them
 * in the file. Looking every vertex up in all others would be quadratic; they are sorted by
 * coordinates instead, and runs of equals share a number.
 */
#include "mesh/import.h"

#include <string.h>

#include "base/memory.h"
#include "geom/triangulate.h"

struct loader {
    struct context *ctx;
    const char *path;
    struct attributes attributes;
    bool is_soup;
    bool has_doubles;
    uint64_t vertex_count, polygon_count, index_count;
    size_t position_capacity; /* vertices */
    size_t record_capacity;   /* vertices */
    size_t size_capacity, index_capacity;
    double *positions;
    unsigned char *records;
    uint32_t *sizes;
    uint32_t *indices;
};

static enum status begin(void *user, const struct attributes *attributes, bool is_soup,
                         uint64_t expected_vertices, uint64_t expected_faces)
{
    (void)expected_vertices;
    (void)expected_faces;
    struct loader *loader = user;
    loader->attributes = *attributes;
    loader->is_soup = is_soup;
    return STATUS_OK;
}

static enum status add_vertices(void *user, size_t count, const float *floats,
                                const double *doubles, const unsigned char *records)
{
    struct loader *loader = user;
    size_t total = loader->vertex_count + count, stride = loader->attributes.stride;
    if (total > UINT32_MAX - 1)
        return fail(loader->ctx, STATUS_BAD_INPUT, "%s: more than 4294967294 vertices",
                    loader->path);
    enum status status = memory_reserve(loader->ctx, &loader->positions, &loader->position_capacity,
                                        total, 3 * sizeof(double));
    if (status == STATUS_OK && stride)
        status =
            memory_reserve(loader->ctx, &loader->records, &loader->record_capacity, total, stride);
    if (status != STATUS_OK)
        return status;
    double *to = loader->positions + 3 * loader->vertex_count;
    for (size_t i = 0; i < 3 * count; i++)
        to[i] = floats ? (double)floats[i] : doubles[i];
    if (stride)
        memcpy(loader->records + loader->vertex_count * stride, records, count * stride);
    loader->has_doubles |= doubles != NULL;
    loader->vertex_count = total;
    return STATUS_OK;
}

static enum status add_faces(void *user, uint64_t first_face, size_t count, const uint32_t *sizes,
                             const uint32_t *indices)
{
    (void)first_face;
    struct loader *loader = user;
    size_t corners = 3 * count;
    if (sizes) {
        corners = 0;
        for (size_t i = 0; i < count; i++)
            corners += sizes[i];
    }
    enum status status = memory_reserve(loader->ctx, &loader->sizes, &loader->size_capacity,
                                        loader->polygon_count + count, sizeof(uint32_t));
    if (status == STATUS_OK)
        status = memory_reserve(loader->ctx, &loader->indices, &loader->index_capacity,
                                loader->index_count + corners, sizeof(uint32_t));
    if (status != STATUS_OK)
        return status;
    for (size_t i = 0; i < count; i++)
        loader->sizes[loader->polygon_count + i] = sizes ? sizes[i] : 3;
    memcpy(loader->indices + loader->index_count, indices, corners * sizeof *indices);
    loader->polygon_count += count;
    loader->index_count += corners;
    return STATUS_OK;
}

static enum status check_indices(const struct loader *loader)
{
    uint64_t face = 0, end = loader->polygon_count ? loader->sizes[0] : 0;
    for (uint64_t i = 0; i < loader->index_count; i++) {
        for (; i == end; end += loader->sizes[face])
            face++;
        if (loader->indices[i] >= loader->vertex_count)
            return fail(loader->ctx, STATUS_BAD_INPUT,
                        "%s: face %llu names vertex %lu, but there are only %llu", loader->path,
                        (unsigned long long)face, (unsigned long)loader->indices[i],
                        (unsigned long long)loader->vertex_count);
    }
    return STATUS_OK;
}

/* ---- welding ---- */

/* An order of doubles as integers in which equal numbers (0 and -0 too) are equal. */
static uint64_t order_of(double value)
{
    uint64_t bits;
    value += 0.0; /* -0 becomes 0 */
    memcpy(&bits, &value, sizeof bits);
    return bits >> 63 ? ~bits : bits | 1ull << 63;
}

/* One digit of 16 bits of one coordinate: stable, so that sorting by all digits from the lowest up
 * sorts by x, y, z and, among equals, by number. */
static bool sort_by_digit(const struct loader *loader, const uint32_t *from, uint32_t *to,
                          size_t *counts, unsigned axis, unsigned shift)
{
    enum { DIGITS = 1 << 16 };
    size_t n = loader->vertex_count;
    memset(counts, 0, DIGITS * sizeof *counts);
    for (size_t i = 0; i < n; i++)
        counts[order_of(loader->positions[3 * i + axis]) >> shift & (DIGITS - 1)]++;
    size_t first = 0;
    for (size_t d = 0; d < DIGITS; d++) {
        if (counts[d] == n)
            return false; /* all alike: nothing to do */
        size_t size = counts[d];
        counts[d] = first;
        first += size;
    }
    for (size_t i = 0; i < n; i++)
        to[counts[order_of(loader->positions[3 * (size_t)from[i] + axis]) >> shift &
                  (DIGITS - 1)]++] = from[i];
    return true;
}

static bool same_place(const double *a, const double *b)
{
    return a[0] == b[0] && a[1] == b[1] && a[2] == b[2];
}

/* order: vertices sorted by place; number: room for as many. Both are overwritten. */
static void merge_equals(struct loader *loader, const uint32_t *order, uint32_t *number)
{
    size_t n = loader->vertex_count, kept = 0, stride = loader->attributes.stride;
    for (size_t i = 0, first = 0; i < n; i++) {
        if (i > 0 && !same_place(loader->positions + 3 * (size_t)order[i],
                                 loader->positions + 3 * (size_t)order[first]))
            first = i;
        number[order[i]] = order[first]; /* the lowest number of its place */
    }
    for (size_t v = 0; v < n; v++) {
        if (number[v] != v) {
            number[v] = number[number[v]]; /* which is lower, and has its new number */
            continue;
        }
        memmove(loader->positions + 3 * kept, loader->positions + 3 * v, 3 * sizeof(double));
        if (stride)
            memmove(loader->records + kept * stride, loader->records + v * stride, stride);
        number[v] = (uint32_t)kept++;
    }
    loader->vertex_count = kept;
    for (size_t i = 0; i < loader->index_count; i++)
        loader->indices[i] = number[loader->indices[i]];
}

static enum status weld(struct loader *loader)
{
    struct context *ctx = loader->ctx;
    size_t n = loader->vertex_count;
    uint32_t *order = NULL, *other = NULL;
    size_t *counts = NULL;
    enum status status = memory_take(ctx, n, sizeof *order, &order);
    if (status == STATUS_OK)
        status = memory_take(ctx, n, sizeof *other, &other);
    if (status == STATUS_OK)
        status = memory_take(ctx, 1 << 16, sizeof *counts, &counts);
    if (status == STATUS_OK) {
        for (size_t i = 0; i < n; i++)
            order[i] = (uint32_t)i;
        for (unsigned axis = 3; axis-- > 0;)
            for (unsigned shift = 0; shift < 64; shift += 16)
                if (sort_by_digit(loader, order, other, counts, axis, shift)) {
                    uint32_t *swap = order;
                    order = other;
                    other = swap;
                }
        merge_equals(loader, order, other);
    }
    memory_release(ctx, &counts, 1 << 16, sizeof *counts);
    memory_release(ctx, &other, n, sizeof *other);
    memory_release(ctx, &order, n, sizeof *order);
    return status;
}

/* ---- polygons ---- */

/* One polygon's triangles as vertex numbers. */
static enum status cut_polygon(struct loader *loader, struct triangulation_workspace *ws,
                               struct scratch *corners, const uint32_t *indices, uint32_t size,
                               uint32_t *triangles)
{
    enum triangulation_quality quality;
    enum status status = scratch_reserve(loader->ctx, corners, (size_t)size * 3 * sizeof(double));
    if (status != STATUS_OK)
        return status;
    double *points = (double *)(void *)corners->block;
    for (uint32_t i = 0; i < size; i++)
        memcpy(points + 3 * (size_t)i, loader->positions + 3 * (size_t)indices[i],
               3 * sizeof(double));
    status = triangulate(loader->ctx, ws, points, size, NULL, NULL, NULL, triangles, &quality);
    for (size_t i = 0; status == STATUS_OK && i < 3 * ((size_t)size - 2); i++)
        triangles[i] = indices[triangles[i]];
    return status;
}

static enum status make_triangles(struct loader *loader, struct mesh *mesh)
{
    uint64_t triangles = loader->index_count - 2 * loader->polygon_count;
    enum status status = memory_take(loader->ctx, triangles, 3 * sizeof(uint32_t), &mesh->faces);
    if (status != STATUS_OK)
        return status;
    mesh->face_count = triangles;
    struct triangulation_workspace ws = {0};
    struct scratch corners = {0};
    const uint32_t *from = loader->indices;
    uint32_t *to = mesh->faces;
    for (uint64_t i = 0; status == STATUS_OK && i < loader->polygon_count; i++) {
        uint32_t size = loader->sizes[i];
        if (size == 3)
            memcpy(to, from, 3 * sizeof *to);
        else
            status = cut_polygon(loader, &ws, &corners, from, size, to);
        from += size;
        to += 3 * ((size_t)size - 2);
    }
    triangulation_workspace_clear(loader->ctx, &ws);
    scratch_clear(loader->ctx, &corners);
    return status;
}

/* Moves the vertices over, in blocks of exactly their size. */
static enum status hand_over(struct loader *loader, struct mesh *mesh)
{
    uint32_t stride = loader->attributes.stride;
    enum status status = memory_resize(loader->ctx, &loader->positions, loader->position_capacity,
                                       loader->vertex_count, 3 * sizeof(double));
    if (status != STATUS_OK)
        return status;
    loader->position_capacity = loader->vertex_count;
    if (stride)
        status = memory_resize(loader->ctx, &loader->records, loader->record_capacity,
                               loader->vertex_count, stride);
    if (status != STATUS_OK)
        return status;
    mesh->vertex_count = loader->vertex_count;
    mesh->positions = loader->positions;
    mesh->records = loader->records;
    mesh->attributes = loader->attributes;
    mesh->is_float32 = !loader->has_doubles;
    loader->positions = NULL;
    loader->records = NULL;
    return STATUS_OK;
}

static void clear(struct loader *loader)
{
    memory_release(loader->ctx, &loader->positions, loader->position_capacity, 3 * sizeof(double));
    memory_release(loader->ctx, &loader->records, loader->record_capacity,
                   loader->attributes.stride);
    memory_release(loader->ctx, &loader->sizes, loader->size_capacity, sizeof(uint32_t));
    memory_release(loader->ctx, &loader->indices, loader->index_capacity, sizeof(uint32_t));
}

enum status mesh_load(struct context *ctx, const char *path, struct mesh *mesh)
{
    struct loader loader = {.ctx = ctx, .path = path};
    struct import_sink sink = {&loader, begin, add_vertices, add_faces, NULL};
    struct instream *stream;
    memset(mesh, 0, sizeof *mesh);
    enum status status = instream_open(ctx, path, &stream);
    if (status != STATUS_OK)
        return status;
    status = import_read(ctx, stream, &sink);
    instream_close(&stream);
    if (status == STATUS_OK)
        status = check_indices(&loader);
    if (status == STATUS_OK && loader.is_soup)
        status = weld(&loader);
    if (status == STATUS_OK)
        status = make_triangles(&loader, mesh);
    if (status == STATUS_OK)
        status = hand_over(&loader, mesh);
    clear(&loader);
    if (status != STATUS_OK)
        mesh_clear(ctx, mesh);
    return status;
}
