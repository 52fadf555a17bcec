/*
 * Simplifying a mesh by collapsing its edges, the cheap ones first.
 *
 * The plain method keeps a heap of all edges and, after each collapse, brings every cost up to date
 * that could have changed, thirty or forty of them. Two things make it slow: most of those costs
 * change again before anyone asks, and the heap's order jumps all over the mesh, so that each look
 * is a cache miss. Here the vertices are swept in the order of their numbers (which is local in
 * space), again and again, with a threshold that lets the cheaper ones through; whatever
 * is below it is evaluated afresh before it is believed. Measured against the exact order of a
 * heap, the errors differ by less than the heap's own change when the costs are multiplied by
 * noise.
 */
#include "collapse.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "collapse_internal.h"

/* The part of an error bound that one collapse may use: where everything is driven up to a bound,
 * the witnesses see about half of the largest distance; the estimate says the whole then. */
static const double BOUND_PART = 0.5;
/* Where the whole can be measured, the part grows until it has come so near to the bound. */
static const double BOUND_NEAR = 0.8;
static const double BOUND_GROWTH = 1.25;
/* Errors below this part of the mean edge are rounding. */
static const double FLAT_ERROR = 1e-5;
/* Faces round a vertex leave a direction free where the least eigenvalue of their squared normals
 * is below this part of the sum (floats tell it from 0 to 1e-7). Smooth scans have 1e-5 and more.
 */
static const double FLAT_PART = 1e-6;

/* ---- the end, and copies ---- */

void collapse_end(struct collapse **collapse)
{
    struct collapse *c = *collapse;
    if (!c)
        return;
    struct context *ctx = c->ctx;
    const size_t vertices = (size_t)c->vertex_count;
    reference_clear(c);
    memory_release(ctx, &c->records, vertices, c->attributes.stride);
    memory_release(ctx, &c->keys, vertices, sizeof *c->keys);
    memory_release(ctx, &c->vertices, (size_t)c->vertex_room, sizeof *c->vertices);
    memory_release(ctx, &c->corners, (size_t)c->face_room, 3 * sizeof *c->corners);
    memory_release(ctx, collapse, 1, sizeof *c);
}

void collapse_mesh_clear(struct context *ctx, uint32_t stride, struct collapse_mesh *mesh)
{
    const size_t vertices = (size_t)mesh->vertex_count;
    memory_release(ctx, &mesh->positions, vertices, 3 * sizeof *mesh->positions);
    memory_release(ctx, &mesh->faces, (size_t)mesh->face_count, 3 * sizeof *mesh->faces);
    memory_release(ctx, &mesh->witnesses, vertices, 3 * sizeof *mesh->witnesses);
    memory_release(ctx, &mesh->locked, vertices, 1);
    memory_release(ctx, &mesh->records, vertices, stride);
    memset(mesh, 0, sizeof *mesh);
}

static enum status copy_array(struct context *ctx, const void *from, size_t count, size_t size,
                              void *to)
{
    enum status status = memory_take(ctx, count, size, to);
    if (status == STATUS_OK && count > 0)
        memcpy(*(void **)to, from, count * size);
    return status;
}

enum status collapse_copy(const struct collapse *from, struct collapse **out)
{
    struct context *ctx = from->ctx;
    const size_t vertices = (size_t)from->vertex_slots;
    enum status status = memory_take(ctx, 1, sizeof **out, out);
    if (status != STATUS_OK)
        return status;
    struct collapse *c = *out;
    *c = *from;
    c->pause_faces = 0;
    /* what is dead at the end has no room in the copy */
    c->vertex_count = c->vertex_room = from->vertex_slots;
    c->face_room = from->face_slots;
    c->corners = NULL;
    c->vertices = NULL;
    c->keys = NULL;
    c->records = NULL;
    memset(&c->reference, 0, sizeof c->reference);
    status =
        copy_array(ctx, from->vertices, (size_t)c->vertex_room, sizeof *c->vertices, &c->vertices);
    if (status == STATUS_OK)
        status = copy_array(ctx, from->corners, (size_t)c->face_room, 3 * sizeof *c->corners,
                            &c->corners);
    if (status == STATUS_OK)
        status = copy_array(ctx, from->keys, vertices, sizeof *c->keys, &c->keys);
    if (status == STATUS_OK && from->records)
        status = copy_array(ctx, from->records, vertices, c->attributes.stride, &c->records);
    if (status == STATUS_OK && from->reference.face_count > 0)
        status = reference_copy(from, c);
    if (status != STATUS_OK)
        collapse_end(out);
    return status;
}

void collapse_set_variant(struct collapse *c, uint32_t variant)
{
    c->options.variant = variant;
}

/* ---- collapsing ---- */

/* How many faces there are to be when the next reference is taken; 0: none is to be taken. A finer
 * one is more exact and costs more: more collapses are measured by it. Where an error is asked for
 * alone nobody knows the faces, and the first reference that there is room for is the one. */
static uint64_t next_reference(struct collapse *c, uint64_t most_faces, bool bounded)
{
    if (!c->options.measured)
        return 0;
    if (c->reference.face_count > 0) {
        /* an old one is more exact, and slower, than a new one */
        if (c->live_faces < 2 * most_faces || c->reference.face_count / 8 < most_faces || bounded)
            return 0;
        reference_clear(c);
    }
    const uint64_t times = c->options.effort >= 3 ? 4 : 2;
    uint64_t faces = reference_most_faces(c);
    if (most_faces > 0 && faces / times > most_faces)
        faces = times * most_faces;
    return faces > most_faces + most_faces / 4 ? faces : 0;
}

uint64_t collapse_measured_from(struct collapse *c, uint64_t most_faces)
{
    return next_reference(c, most_faces, false);
}

static enum status set_bound(struct collapse *c, double bound)
{
    const bool renews = c->held_back && bound > c->error_bound;
    c->error_bound = bound;
    if (!renews)
        return STATUS_OK;
    c->held_back = false;
    return keys_sample(c);
}

static bool is_paused(const struct collapse *c)
{
    return c->live_faces <= c->pause_faces;
}

/* Collapses down to `most_faces`, with the bound that is set; *done: nothing more is to be had. */
static enum status run_down(struct collapse *c, uint64_t most_faces, bool *done)
{
    const double part = sweep_part(c);
    *done = false;
    while (c->live_faces > most_faces && !is_paused(c)) {
        const uint64_t left = c->live_faces - most_faces;
        uint64_t wanted = (uint64_t)((double)c->live_faces / 2 * part);
        wanted = wanted < left / 2 ? wanted : left / 2;
        float threshold = keys_threshold(c, wanted);
        if (!(threshold < INFINITY) && c->key_step > 1)
            threshold = FLT_MIN; /* those that were not looked at may have one */
        if (!(threshold < INFINITY)) {
            *done = c->held_back || c->options.keep_guards || c->guard == GUARD_NONE;
            if (*done)
                break;
            c->guard++;
            enum status status = keys_sample(c);
            if (status != STATUS_OK)
                return status;
            continue;
        }
        enum status status = sweep(c, threshold, most_faces);
        if (status == STATUS_OK && c->live_faces < c->face_slots / 2 &&
            c->reference.face_count == 0)
            status = topology_compact(c);
        if (status == STATUS_OK)
            status =
                step(c->ctx, "collapse", c->face_count - c->live_faces, c->face_count - most_faces);
        if (status != STATUS_OK)
            return status;
    }
    return STATUS_OK;
}

/* Collapses up to the error `bound`, scaled. What one collapse may do is less than the largest
 * distance in the end, by how much nobody knows: so it is let do a little, the whole is measured,
 * and then it is let do more. */
static enum status run_up_to(struct collapse *c, uint64_t most_faces, double bound, bool *done)
{
    enum { ROUNDS = 8 };
    double part = BOUND_PART;
    for (int round = 0; round < ROUNDS; round++) {
        enum status status = set_bound(c, fmax(part * bound, c->error_bound));
        if (status == STATUS_OK)
            status = run_down(c, most_faces, done);
        if (status != STATUS_OK || c->live_faces <= most_faces || !c->held_back)
            return status;
        double error;
        status = collapse_error(c, &error);
        error *= c->scale;
        if (status != STATUS_OK || error > BOUND_NEAR * bound)
            return status;
        part *= fmin(BOUND_GROWTH, bound / (error + 1e-30 * bound));
    }
    return STATUS_OK;
}

/* Whether the faces round v lie in one plane, or in several along one direction. */
static bool vertex_is_flat(const struct collapse *c, uint32_t v)
{
    const float *s = c->vertices[v].fan.square;
    const double xx = (double)s[0], xy = (double)s[1], xz = (double)s[2], yy = (double)s[3];
    const double yz = (double)s[4], zz = (double)s[5], trace = xx + yy + zz;
    const double minors = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz;
    const double determinant =
        xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    return minors <= FLAT_PART * trace * trace || determinant <= FLAT_PART * trace * minors;
}

/*
 * What costs nothing but rounding goes first, all of it. A sweep lets a part of the vertices
 * through, and on parts with planes and cylinders that part may hold edges that cost something
 * while there are still others that cost nothing: at 2 to 10 % of the faces of parts meshed for
 * computation the mean error is half to a tenth this way. Of scans 2 % of the vertices are so at
 * most, of a CT scan with its terraces 12 %, of parts 5 to 99 %.
 */
static void find_flat(struct collapse *c)
{
    enum { SAMPLE_STEP = 16, FLAT_SHARE = 16 };
    uint64_t flat = 0, seen = 0;
    for (uint64_t v = 0; v < c->vertex_slots; v += SAMPLE_STEP) {
        if (c->vertices[v].corner == NO_INDEX)
            continue;
        seen++;
        flat += vertex_is_flat(c, (uint32_t)v);
    }
    c->flat_is_left = c->flat_has_begun = flat * FLAT_SHARE >= seen;
}

static enum status run_flat(struct collapse *c, uint64_t most_faces, double bound, bool *done)
{
    if (!c->flat_has_begun)
        find_flat(c);
    if (!c->flat_is_left)
        return STATUS_OK;
    enum status status = set_bound(c, fmin(bound, FLAT_ERROR / (double)c->unit));
    if (status == STATUS_OK)
        status = run_down(c, most_faces, done);
    if (status != STATUS_OK || (c->live_faces > most_faces && is_paused(c)))
        return status;
    c->flat_is_left = c->live_faces <= most_faces;
    c->flat_has_begun = false;
    c->typical_error = c->error_sum = 0;
    c->error_count = 0;
    return status;
}

void collapse_pause_at(struct collapse *c, uint64_t faces)
{
    c->pause_faces = faces;
}

enum status collapse_approach(struct collapse *c, uint64_t faces, double most_error)
{
    const bool measured = c->options.measured;
    c->options.measured = false;
    const enum status status = collapse_run(c, faces, most_error);
    c->options.measured = measured;
    return status;
}

enum status collapse_run(struct collapse *c, uint64_t most_faces, double most_error)
{
    enum status status = STATUS_OK;
    bool done = false;
    const double bound = most_error * c->scale;
    const bool bounded = bound < INFINITY;
    if (is_paused(c))
        return STATUS_OK;
    if (c->flat_is_left)
        status = run_flat(c, most_faces, bounded ? bound * BOUND_PART : INFINITY, &done);
    if (status != STATUS_OK || is_paused(c))
        return status;
    const uint64_t faces = next_reference(c, most_faces, bounded);
    if (faces > 0) {
        status = set_bound(c, bounded ? bound * BOUND_PART : INFINITY);
        if (status == STATUS_OK)
            status = run_down(c, faces, &done);
        if (status == STATUS_OK && is_paused(c))
            return STATUS_OK;
        if (status == STATUS_OK && c->live_faces > most_faces &&
            (!done || (c->held_back && c->live_faces <= reference_most_faces(c))))
            status = reference_take(c);
        if (status != STATUS_OK)
            return status;
    }
    if (bounded && c->reference.face_count > 0)
        return run_up_to(c, most_faces, bound, &done);
    status = set_bound(c, bounded ? bound * BOUND_PART : INFINITY);
    return status == STATUS_OK ? run_down(c, most_faces, &done) : status;
}

uint64_t collapse_faces(const struct collapse *c)
{
    return c->live_faces;
}

enum status collapse_error(const struct collapse *c, double *error)
{
    double largest = 0;
    enum status status = STATUS_OK;
    if (c->reference.face_count > 0) {
        /* the reference is off the original, too: errors are about as the reciprocal of the faces,
         * and where the two are largest has nothing to do with each other */
        const double part = (double)c->live_faces / (double)c->reference.face_count;
        status = reference_error(c, &largest);
        largest *= sqrt(1 + part * part);
    } else
        for (uint32_t v = 0; v < c->vertex_slots; v++)
            if (c->vertices[v].corner != NO_INDEX)
                largest = fmax(largest, vertex_error(c, v, largest));
    if (c->held_back && c->reference.face_count == 0)
        largest = fmax(largest, fmin(largest, c->error_bound) / BOUND_PART);
    *error = largest / c->scale;
    return status;
}

double collapse_mean_error(const struct collapse *c)
{
    return c->reference.face_count > 0 ? reference_mean_error(c) / c->scale : 0;
}

bool collapse_exhausted(const struct collapse *c)
{
    for (uint32_t v = 0; v < c->vertex_slots; v++)
        if (c->keys[v] < INFINITY)
            return false;
    return !c->held_back && (c->guard == GUARD_NONE || c->options.keep_guards);
}

/* ---- the result ---- */

/* Live vertices in the order of their first use; *order is theirs, `faces` get the numbers. */
static enum status number_vertices(const struct collapse *c, uint32_t *faces, uint32_t **order,
                                   size_t *live)
{
    const size_t slots = (size_t)c->vertex_slots;
    uint32_t *numbers = NULL, count = 0;
    size_t to = 0;
    *live = 0;
    for (size_t v = 0; v < slots; v++)
        *live += c->vertices[v].corner != NO_INDEX;
    enum status status = memory_take(c->ctx, *live, sizeof **order, order);
    if (status == STATUS_OK)
        status = memory_take(c->ctx, slots, sizeof *numbers, &numbers);
    if (status != STATUS_OK)
        return status;
    memset(numbers, 0xff, slots * sizeof *numbers);
    for (size_t i = 0; i < (size_t)c->face_slots * 3; i++) {
        const uint32_t v = corner_vertex(c, (uint32_t)i);
        if (v == NO_INDEX)
            continue;
        if (numbers[v] == NO_INDEX) {
            numbers[v] = count;
            (*order)[count++] = v;
        }
        faces[to++] = numbers[v];
    }
    memory_release(c->ctx, &numbers, slots, sizeof *numbers);
    return STATUS_OK;
}

/* Copies records, and turns slots into input numbers. */
static void finish_vertices(const struct collapse *c, uint32_t *order, size_t live,
                            unsigned char *records)
{
    const size_t stride = c->attributes.stride;
    for (size_t i = 0; i < live; i++) {
        if (records && c->records)
            memcpy(records + i * stride, c->records + order[i] * stride, stride);
        order[i] = c->vertices[order[i]].source;
    }
}

enum status collapse_extract(struct collapse *c, struct mesh *mesh, uint32_t **sources)
{
    struct context *ctx = c->ctx;
    size_t live = 0;
    uint32_t *order = NULL;
    memset(mesh, 0, sizeof *mesh);
    mesh->attributes = c->attributes;
    mesh->is_float32 = c->is_float32;
    mesh->face_count = c->live_faces;
    enum status status =
        memory_take(ctx, (size_t)c->live_faces, 3 * sizeof *mesh->faces, &mesh->faces);
    if (status == STATUS_OK)
        status = number_vertices(c, mesh->faces, &order, &live);
    mesh->vertex_count = live;
    if (status == STATUS_OK)
        status = memory_take(ctx, live, 3 * sizeof *mesh->positions, &mesh->positions);
    if (status == STATUS_OK && c->records)
        status = memory_take(ctx, live, c->attributes.stride, &mesh->records);
    if (status != STATUS_OK) {
        memory_release(ctx, &order, live, sizeof *order);
        mesh_clear(ctx, mesh);
        return status;
    }
    for (size_t i = 0; i < live; i++)
        for (int k = 0; k < 3; k++)
            mesh->positions[3 * i + k] =
                c->origin[k] + (double)c->vertices[order[i]].position[k] / c->scale;
    finish_vertices(c, order, live, mesh->records);
    if (sources)
        *sources = order;
    else
        memory_release(ctx, &order, live, sizeof *order);
    return STATUS_OK;
}

enum status collapse_extract_compact(struct collapse *c, struct collapse_mesh *mesh,
                                     uint32_t **sources)
{
    struct context *ctx = c->ctx;
    size_t live = 0;
    *sources = NULL;
    memset(mesh, 0, sizeof *mesh);
    mesh->face_count = c->live_faces;
    enum status status =
        memory_take(ctx, (size_t)c->live_faces, 3 * sizeof *mesh->faces, &mesh->faces);
    if (status == STATUS_OK)
        status = number_vertices(c, mesh->faces, sources, &live);
    mesh->vertex_count = live;
    if (status == STATUS_OK)
        status = memory_take(ctx, live, 3 * sizeof *mesh->positions, &mesh->positions);
    if (status == STATUS_OK)
        status = memory_take(ctx, live, 3 * sizeof *mesh->witnesses, &mesh->witnesses);
    if (status == STATUS_OK && c->records)
        status = memory_take(ctx, live, c->attributes.stride, &mesh->records);
    if (status != STATUS_OK) {
        memory_release(ctx, sources, live, sizeof **sources);
        collapse_mesh_clear(ctx, c->attributes.stride, mesh);
        return status;
    }
    for (size_t i = 0; i < live; i++) {
        const struct collapse_vertex *vertex = &c->vertices[(*sources)[i]];
        float offset[3];
        witness_get(c, (*sources)[i], offset);
        for (int k = 0; k < 3; k++) {
            mesh->positions[3 * i + k] = (float)((double)vertex->position[k] / c->scale);
            mesh->witnesses[3 * i + k] =
                (float)(((double)vertex->position[k] + (double)offset[k]) / c->scale);
        }
    }
    finish_vertices(c, *sources, live, mesh->records);
    return STATUS_OK;
}
