/*
 * How the collapsing of a mesh begins.
 *
 * Lengths come in any unit, and costs are products of several, which floats do not hold in all
 * units; doubles would make vertices half as large again. So positions are floats times a power of
 * two, which rounds nothing, by which the mean edge is about 1 long. A mesh that is the only one at
 * work is taken by all threads, a stretch of vertices each.
 */
#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "collapse_internal.h"

static const double BORDER_WEIGHT = 1;
/* Scale of edges that are 2^20 long. */
static const double LONG_EDGES = 0x1p-20;
/* The power of two that makes the mean edge of a surface of that size about 1: half the box over
 * the root of the faces. */
static double choose_scale(uint64_t face_count, const double low[3], const double high[3])
{
    double extent = 0;
    for (int k = 0; k < 3; k++)
        extent += high[k] - low[k] > 0 ? high[k] - low[k] : 0;
    int exponent = 0;
    const double edge = extent / (2 * sqrt((double)face_count + 1));
    if (edge > 0 && edge < INFINITY)
        (void)frexp(edge, &exponent);
    return ldexp(1, -exponent);
}

/* The box of the positions; returns whether all are float32. */
static bool find_box(size_t vertices, const double *doubles, double low[3], double high[3])
{
    bool is_float32 = true;
    for (size_t v = 0; v < vertices; v++)
        for (size_t k = 0; k < 3; k++) {
            const double x = doubles[3 * v + k];
            if ((double)(float)x != x)
                is_float32 = false;
            low[k] = x < low[k] ? x : low[k];
            high[k] = x > high[k] ? x : high[k];
        }
    return is_float32;
}

/* The same of floats; false where one is no number. */
static bool find_box_of_floats(size_t vertices, const float *floats, double low[3], double high[3])
{
    bool are_numbers = true;
    float least[3] = {INFINITY, INFINITY, INFINITY}, most[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (size_t v = 0; v < vertices; v++)
        for (size_t k = 0; k < 3; k++) {
            const float x = floats[3 * v + k];
            are_numbers &= x == x;
            least[k] = x < least[k] ? x : least[k];
            most[k] = x > most[k] ? x : most[k];
        }
    for (int k = 0; k < 3; k++) {
        low[k] = (double)least[k];
        high[k] = (double)most[k];
    }
    return are_numbers;
}

/* Origin and scale. Positions are kept as float32: as they are when all are float32, else relative
 * to the middle of the bounding box. Exactly one of `doubles` and `floats` is given. */
static void choose_frame(struct collapse *c, const double *doubles, const float *floats)
{
    const size_t count = (size_t)c->vertex_count;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    c->is_float32 = doubles ? find_box(count, doubles, low, high)
                            : find_box_of_floats(count, floats, low, high);
    for (int k = 0; k < 3; k++)
        c->origin[k] = c->is_float32 ? 0 : low[k] + (high[k] - low[k]) / 2;
    c->scale = choose_scale(c->face_count, low, high);
}

enum status collapse_start(struct context *ctx, const struct collapse_options *options,
                           uint64_t vertex_count, uint64_t face_count,
                           const struct attributes *attributes, struct collapse **out)
{
    *out = NULL;
    if (face_count > (UINT32_MAX - 2) / 3 || vertex_count > VERTICES_MAX)
        return fail(ctx, STATUS_INTERNAL, "edge collapse of %llu faces is beyond 32-bit corners",
                    (unsigned long long)face_count);
    enum status status = memory_take_zeroed(ctx, 1, sizeof **out, out);
    if (status != STATUS_OK)
        return status;
    struct collapse *c = *out;
    c->ctx = ctx;
    c->level = cpu_level(ctx);
    c->options = *options;
    c->flat_is_left = !options->roughly;
    if (!(c->options.border_weight > 0))
        c->options.border_weight = BORDER_WEIGHT;
    c->vertex_count = c->vertex_room = c->vertex_slots = vertex_count;
    c->face_count = c->face_room = c->face_slots = c->live_faces = face_count;
    c->reference_room = face_count;
    if (attributes)
        c->attributes = *attributes;
    return STATUS_OK;
}

enum status collapse_take_faces(struct collapse *c, const uint32_t *faces)
{
    enum status status =
        memory_take(c->ctx, (size_t)c->face_count, 3 * sizeof *c->corners, &c->corners);
    for (size_t i = 0; status == STATUS_OK && i < (size_t)c->face_count * 3; i += 3)
        for (unsigned k = 0; k < 3; k++)
            c->corners[i + k].end = faces[i + (k + 1) % 3];
    return status;
}

/* The vertices of a mesh, as they are given: exactly one of `doubles` and `floats`. */
struct vertex_source {
    struct collapse *collapse;
    const double *doubles;
    const float *floats, *witnesses;
    const unsigned char *locked;
    _Atomic bool is_rounded; /* some position is not what it was */
};

enum { VERTEX_STRETCH = 4096 };

static enum status take_stretch(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct vertex_source *from = user;
    struct collapse *c = from->collapse;
    const size_t first = (size_t)job * VERTEX_STRETCH, left = (size_t)c->vertex_count - first;
    bool is_exact = true;
    for (size_t v = first; v < first + (left < VERTEX_STRETCH ? left : VERTEX_STRETCH); v++) {
        struct collapse_vertex *vertex = &c->vertices[v];
        float offset[3] = {0, 0, 0};
        for (size_t k = 0; k < 3; k++) {
            const double x =
                from->doubles ? from->doubles[3 * v + k] : (double)from->floats[3 * v + k];
            const double scaled = (x - c->origin[k]) * c->scale;
            vertex->position[k] = (float)scaled;
            is_exact &= (double)(float)scaled == scaled;
            if (from->witnesses)
                offset[k] = (float)(((double)from->witnesses[3 * v + k] - x) * c->scale);
        }
        witness_set(c, (uint32_t)v, offset);
        vertex->offset = 0;
        vertex->source = v & VERTICES_MAX;
        vertex->flags = from->locked && from->locked[v] ? VERTEX_LOCKED : 0;
    }
    if (!is_exact)
        from->is_rounded = true;
    return STATUS_OK;
}

static enum status take_all(struct vertex_source *from)
{
    const struct collapse *c = from->collapse;
    const uint64_t stretches = (c->vertex_count + VERTEX_STRETCH - 1) / VERTEX_STRETCH;
    enum status status = STATUS_OK;
    if (c->options.together)
        return parallel_for(c->ctx, stretches, take_stretch, from);
    for (uint64_t i = 0; i < stretches && status == STATUS_OK; i++)
        status = take_stretch(from, i, 0);
    return status;
}

static enum status take_vertices(struct vertex_source *from)
{
    struct collapse *c = from->collapse;
    enum status status =
        memory_take(c->ctx, (size_t)c->vertex_count, sizeof *c->vertices, &c->vertices);
    if (status != STATUS_OK)
        return status;
    choose_frame(c, from->doubles, from->floats);
    const double unit = c->scale;
    c->unit = 1;
    status = take_all(from);
    /* Where scaling would lose bits of a tiny number, rather be exact; but edges so long that
     * powers of them overflow make a number so tiny nothing, unless input vertices are to be kept.
     */
    const bool may_be_long = c->options.subset || unit > LONG_EDGES;
    if (status == STATUS_OK && from->is_rounded && c->is_float32 && may_be_long) {
        c->scale = 1;
        c->unit = (float)fmin(unit, 0x1p100);
        status = take_all(from);
    }
    return status;
}

enum status collapse_make_ready(struct collapse *c)
{
    enum status status = topology_build(c);
    if (status == STATUS_OK)
        status = memory_take(c->ctx, (size_t)c->vertex_count, sizeof *c->keys, &c->keys);
    return status == STATUS_OK ? keys_sample(c) : status;
}

enum status collapse_begin(struct context *ctx, const struct collapse_options *options,
                           uint64_t vertex_count, uint64_t face_count, const double *positions,
                           const uint32_t *faces, const struct attributes *attributes,
                           const unsigned char *records, const unsigned char *locked,
                           struct collapse **out)
{
    const struct attributes *kept = attributes && records ? attributes : NULL;
    enum status status = collapse_start(ctx, options, vertex_count, face_count, kept, out);
    if (status == STATUS_OK)
        status = collapse_take_faces(*out, faces);
    if (status == STATUS_OK) {
        struct vertex_source from = {*out, positions, NULL, NULL, locked, false};
        status = take_vertices(&from);
    }
    if (status == STATUS_OK && kept) {
        const size_t stride = kept->stride;
        status = memory_take(ctx, (size_t)vertex_count, stride, &(*out)->records);
        if (status == STATUS_OK)
            memcpy((*out)->records, records, (size_t)vertex_count * stride);
    }
    if (status == STATUS_OK)
        status = collapse_make_ready(*out);
    if (status != STATUS_OK)
        collapse_end(out);
    return status;
}

enum status collapse_begin_giving(struct context *ctx, const struct collapse_options *options,
                                  struct collapse_mesh *mesh, const struct attributes *attributes,
                                  struct collapse **out)
{
    const struct attributes *kept = attributes && mesh->records ? attributes : NULL;
    const uint32_t stride = attributes ? attributes->stride : 0;
    const size_t vertices = (size_t)mesh->vertex_count;
    enum status status =
        collapse_start(ctx, options, mesh->vertex_count, mesh->face_count, kept, out);
    if (status == STATUS_OK)
        status = collapse_take_faces(*out, mesh->faces);
    memory_release(ctx, &mesh->faces, (size_t)mesh->face_count, 3 * sizeof *mesh->faces);
    if (status == STATUS_OK) {
        struct vertex_source from = {*out,         NULL, mesh->positions, mesh->witnesses,
                                     mesh->locked, false};
        status = take_vertices(&from);
    }
    if (status == STATUS_OK) {
        (*out)->records = mesh->records;
        mesh->records = NULL;
    }
    memory_release(ctx, &mesh->positions, vertices, 3 * sizeof *mesh->positions);
    memory_release(ctx, &mesh->witnesses, vertices, 3 * sizeof *mesh->witnesses);
    if (status == STATUS_OK)
        status = collapse_make_ready(*out);
    collapse_mesh_clear(ctx, stride, mesh);
    if (status != STATUS_OK)
        collapse_end(out);
    return status;
}
