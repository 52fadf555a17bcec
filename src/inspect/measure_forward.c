/*
 * From the original to the simplified mesh: every vertex of the original and samples spread over
 * its area ask the simplified mesh's tree. Neighbours in the original are mostly nearest to the
 * same triangle, so each query starts with the last one's answer as its bound and looks at few
 * boxes.
 *
 * Pieces are independent jobs; their sums are added in the order of the pieces, so threads change
 * nothing. On the way each face of the simplified mesh gets its anchor: the nearest of the vertices
 * that found it. The way back starts from there.
 */
#include "inspect/comparison.h"

#include <string.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "inspect/sample.h"

struct forward_slot {
    struct original_piece piece;
    struct nearest *found; /* by each vertex of the piece; PIECE_FACES of them */
    struct precise_sum sum, squares;
    double largest;
    uint64_t samples;
    struct bounds box;
};

struct forward {
    struct comparison *comparison;
    double spacing; /* area of the original for a sample */
    unsigned slot_count;
    struct forward_slot *slots;
    struct precise_sum sum, squares;
    uint64_t area_samples;
};

/* *nearest is the last answer, and becomes that for p. */
static double ask(const struct bvh *tree, struct vec3 p, struct nearest *nearest)
{
    if (nearest->triangle == UINT32_MAX) {
        nearest->distance_squared = INFINITY;
    } else {
        struct triangle last = bvh_triangle(tree, nearest->triangle);
        nearest->distance_squared = triangle_distance_squared(p, &last, &nearest->point);
    }
    bvh_nearest(tree, p, nearest);
    return sqrt(nearest->distance_squared);
}

/* A query far outside all boxes looks at every one of them, so a piece can take minutes: whether to
 * stop is asked between queries too. */
static enum status poll_sometimes(struct context *ctx, uint64_t number)
{
    return number % 256 == 255 ? poll_cancel(ctx) : STATUS_OK;
}

static enum status ask_vertices(struct context *ctx, const struct bvh *tree,
                                struct forward_slot *slot)
{
    enum status status = STATUS_OK;
    struct nearest nearest = {INFINITY, UINT32_MAX, {0, 0, 0}};
    for (uint32_t i = 0; i < slot->piece.vertex_count && status == STATUS_OK; i++) {
        struct vec3 p = vec3_load(slot->piece.vertices + 3 * (size_t)i);
        double distance = ask(tree, p, &nearest);
        slot->largest = fmax(slot->largest, distance);
        slot->found[i] = nearest;
        status = poll_sometimes(ctx, i);
    }
    return status;
}

static enum status ask_samples(struct context *ctx, const struct bvh *tree, struct sample_walk walk,
                               struct forward_slot *slot)
{
    enum status status = STATUS_OK;
    struct nearest nearest = {INFINITY, UINT32_MAX, {0, 0, 0}};
    for (uint32_t f = 0; f < slot->piece.face_count && status == STATUS_OK; f++) {
        const double *corner = slot->piece.corners + 9 * (size_t)f;
        struct triangle t = {vec3_load(corner), vec3_load(corner + 3), vec3_load(corner + 6)};
        bounds_add(&slot->box, t.a);
        bounds_add(&slot->box, t.b);
        bounds_add(&slot->box, t.c);
        double area = vec3_length(triangle_normal(t.a, t.b, t.c)) * 0.5;
        uint32_t samples = sample_walk_face(&walk, area);
        for (uint32_t k = 0; k < samples && status == STATUS_OK; k++) {
            struct vec3 p = sample_point(&t, slot->piece.first_face + f, k);
            double distance = ask(tree, p, &nearest);
            slot->largest = fmax(slot->largest, distance);
            precise_add(&slot->sum, distance);
            precise_add(&slot->squares, distance * distance);
            status = poll_sometimes(ctx, slot->samples + k);
        }
        slot->samples += samples;
    }
    return status;
}

static enum status forward_work(void *user, uint64_t job, unsigned worker)
{
    struct forward *forward = user;
    struct comparison *comparison = forward->comparison;
    struct forward_slot *slot = &forward->slots[job % forward->slot_count];
    (void)worker;
    enum status status = original_load(comparison->original, job, true, &slot->piece);
    if (status != STATUS_OK)
        return status;
    slot->sum = slot->squares = (struct precise_sum){0, 0};
    slot->largest = 0;
    slot->samples = 0;
    slot->box = bounds_empty();
    status = ask_vertices(comparison->ctx, &comparison->tree, slot);
    if (status == STATUS_OK)
        status = ask_samples(comparison->ctx, &comparison->tree,
                             sample_walk_begin(forward->spacing, job), slot);
    return status;
}

static void set_anchors(struct comparison *comparison, const struct forward_slot *slot)
{
    for (uint32_t i = 0; i < slot->piece.vertex_count; i++) {
        const struct nearest *found = &slot->found[i];
        struct anchor *anchor = &comparison->anchors[found->triangle];
        float distance = (float)sqrt(found->distance_squared);
        if (distance >= anchor->distance)
            continue;
        struct vec3 p = vec3_load(slot->piece.vertices + 3 * (size_t)i);
        p = vec3_sub(p, comparison->tree.origin);
        *anchor = (struct anchor){{(float)p.x, (float)p.y, (float)p.z}, distance};
    }
}

static enum status forward_finish(void *user, uint64_t job)
{
    struct forward *forward = user;
    struct comparison *comparison = forward->comparison;
    const struct forward_slot *slot = &forward->slots[job % forward->slot_count];
    struct deviation *deviation = &comparison->result->forward;
    precise_add(&forward->sum, precise_value(&slot->sum));
    precise_add(&forward->squares, precise_value(&slot->squares));
    forward->area_samples += slot->samples;
    deviation->largest = fmax(deviation->largest, slot->largest);
    deviation->samples += slot->samples + slot->piece.vertex_count;
    comparison->boxes[job] = slot->box;
    set_anchors(comparison, slot);
    return step(comparison->ctx, "original to simplified", job + 1,
                original_piece_count(comparison->original));
}

enum status measure_forward(struct comparison *comparison)
{
    struct context *ctx = comparison->ctx;
    struct measurement *result = comparison->result;
    uint64_t wanted = comparison->wanted_samples;
    if (wanted < result->original.topology.faces)
        wanted = result->original.topology.faces;
    struct forward forward = {.comparison = comparison,
                              .spacing = result->original.area / (double)wanted,
                              .slot_count = ctx->threads + 1};
    enum status status =
        memory_take_zeroed(ctx, forward.slot_count, sizeof *forward.slots, &forward.slots);
    for (unsigned i = 0; i < forward.slot_count && status == STATUS_OK; i++)
        status = memory_take(ctx, PIECE_FACES, sizeof(struct nearest), &forward.slots[i].found);
    if (status == STATUS_OK)
        status = parallel_ordered(ctx, original_piece_count(comparison->original),
                                  forward.slot_count, forward_work, forward_finish, &forward);
    if (status == STATUS_OK && forward.area_samples > 0) {
        double count = (double)forward.area_samples;
        result->forward.mean = precise_value(&forward.sum) / count;
        result->forward.rms = sqrt(precise_value(&forward.squares) / count);
    }
    for (unsigned i = 0; forward.slots && i < forward.slot_count; i++) {
        original_piece_clear(&forward.slots[i].piece);
        memory_release(ctx, &forward.slots[i].found, PIECE_FACES, sizeof(struct nearest));
    }
    memory_release(ctx, &forward.slots, forward.slot_count, sizeof *forward.slots);
    return status;
}
