/*
 * The state of a mesh between two collapses, kept and taken up again.
 *
 * Sums that have gone along with the collapses (fans), keys, and the corner at which each vertex
 * begins depend on all that was done before. They are not kept, as they would take more room than
 * all the rest; they are made anew. So that going on at once and going on from a file are the same,
 * going on at once is done in this way, too. Nor is kept what collapses were measured by: it is the
 * larger part, and what goes on to half the faces takes a copy of its own.
 */
#include <string.h>

#include "base/memory.h"
#include "collapse_internal.h"

enum { NOTES = 4 };

void collapse_state_clear(struct context *ctx, uint32_t stride, struct collapse_state *state)
{
    const size_t vertices = (size_t)state->vertex_count;
    memory_release(ctx, &state->positions, vertices, 3 * sizeof *state->positions);
    memory_release(ctx, &state->faces, (size_t)state->face_count, 3 * sizeof *state->faces);
    memory_release(ctx, &state->notes, vertices, NOTES * sizeof *state->notes);
    memory_release(ctx, &state->records, vertices, stride);
    memset(state, 0, sizeof *state);
}

enum status collapse_state_take(struct context *ctx, uint32_t stride, struct collapse_state *state)
{
    const size_t vertices = (size_t)state->vertex_count;
    enum status status =
        memory_take(ctx, vertices, 3 * sizeof *state->positions, &state->positions);
    if (status == STATUS_OK)
        status =
            memory_take(ctx, (size_t)state->face_count, 3 * sizeof *state->faces, &state->faces);
    if (status == STATUS_OK)
        status = memory_take(ctx, vertices, NOTES * sizeof *state->notes, &state->notes);
    if (status == STATUS_OK && stride > 0)
        status = memory_take(ctx, vertices, stride, &state->records);
    return status;
}

enum status collapse_save(struct collapse **collapse, struct collapse_state *state)
{
    struct collapse *c = *collapse;
    const uint32_t stride = c->records ? c->attributes.stride : 0;
    memset(state, 0, sizeof *state);
    c->reference_room += c->reference.face_count;
    reference_clear(c);
    enum status status = topology_compact(c);
    if (status == STATUS_OK) {
        *state = (struct collapse_state){.vertex_count = c->vertex_slots,
                                         .face_count = c->face_slots,
                                         .room = c->reference_room,
                                         .scale = c->scale,
                                         .unit = (double)c->unit,
                                         .typical_error = c->typical_error,
                                         .astray = c->astray,
                                         .error_sum = c->error_sum,
                                         .error_count = c->error_count,
                                         .refused_count = c->refused_count,
                                         .guard = (uint32_t)c->guard,
                                         .flat_is_left = c->flat_is_left};
        status = collapse_state_take(c->ctx, stride, state);
    }
    if (status == STATUS_OK) {
        for (size_t v = 0; v < state->vertex_count; v++) {
            const struct collapse_vertex *vertex = &c->vertices[v];
            memcpy(state->positions + 3 * v, vertex->position, sizeof vertex->position);
            memcpy(state->notes + NOTES * v, vertex->witness, sizeof vertex->witness);
            state->notes[NOTES * v + 3] = vertex->offset;
        }
        for (uint32_t i = 0; i < 3 * state->face_count; i++)
            state->faces[i] = corner_vertex(c, i);
        if (stride > 0)
            memcpy(state->records, c->records, (size_t)state->vertex_count * stride);
    } else {
        collapse_state_clear(c->ctx, stride, state);
    }
    collapse_end(collapse);
    return status;
}

static enum status take_vertices(struct collapse *c, const struct collapse_state *state)
{
    const size_t count = (size_t)state->vertex_count;
    enum status status = memory_take_zeroed(c->ctx, count, sizeof *c->vertices, &c->vertices);
    for (uint32_t v = 0; status == STATUS_OK && v < count; v++) {
        struct collapse_vertex *vertex = &c->vertices[v];
        memcpy(vertex->position, state->positions + 3 * (size_t)v, sizeof vertex->position);
        memcpy(vertex->witness, state->notes + NOTES * (size_t)v, sizeof vertex->witness);
        vertex->offset = state->notes[NOTES * (size_t)v + 3];
        vertex->source = v & VERTICES_MAX;
    }
    return status;
}

enum status collapse_resume(struct context *ctx, const struct collapse_options *options,
                            struct collapse_state *state, const struct attributes *attributes,
                            struct collapse **out)
{
    const struct attributes *kept = attributes && state->records ? attributes : NULL;
    enum status status =
        collapse_start(ctx, options, state->vertex_count, state->face_count, kept, out);
    struct collapse *c = *out;
    if (status == STATUS_OK) {
        c->is_float32 = true;
        c->reference_room = state->room;
        c->scale = state->scale;
        c->unit = (float)state->unit;
        c->typical_error = state->typical_error;
        c->astray = state->astray;
        c->error_sum = state->error_sum;
        c->error_count = state->error_count;
        c->refused_count = state->refused_count;
        c->guard = (enum guard)state->guard;
        c->flat_is_left = state->flat_is_left;
        status = collapse_take_faces(c, state->faces);
    }
    if (status == STATUS_OK)
        status = take_vertices(c, state);
    if (status == STATUS_OK) {
        c->records = state->records;
        state->records = NULL;
    }
    const uint32_t stride = attributes ? attributes->stride : 0;
    collapse_state_clear(ctx, stride, state);
    if (status == STATUS_OK)
        status = collapse_make_ready(c);
    if (status != STATUS_OK)
        collapse_end(out);
    return status;
}

int64_t collapse_euler(const struct collapse *c)
{
    /* a border vertex has one border edge that leads away from it */
    int64_t vertices = 0, borders = 0;
    for (size_t v = 0; v < (size_t)c->vertex_slots; v++) {
        const bool is_live = c->vertices[v].corner != NO_INDEX;
        vertices += is_live;
        borders += is_live && (c->vertices[v].flags & VERTEX_BORDER);
    }
    const int64_t faces = (int64_t)c->live_faces;
    return vertices - (3 * faces + borders) / 2 + faces;
}
