/*
 * From the simplified mesh to the original, which may not fit into memory.
 *
 * The naive way holds a tree over the whole original. Here the original passes piece by piece, each
 * with a tree of its own for a moment, and every sample asks the pieces that may hold its nearest
 * point. Which may, is told by the anchors of the way forward: a sample is not farther from the
 * original than from its face's anchor, which bounds the search so well that most samples ask one
 * or two pieces. Pieces that no sample can need are not even read.
 *
 * Samples go by batches of faces in tree order, so that a batch is a compact region, and memory is
 * constant: 16 bytes a sample of a batch. A sample's answer is the least (distance, face number)
 * over all pieces, whatever their order, so threads change nothing.
 */
#include "inspect/comparison.h"

#include <string.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "inspect/sample.h"

enum { BATCH_SAMPLES = 1 << 20, GROUP_FACES = 64 };

static const float no_cosine = 2; /* one of both triangles has no normal */

/* What a sample knows so far. */
struct answer {
    double distance_squared;
    float cosine;  /* between the normals of its face and of the nearest one of the original */
    uint32_t face; /* number of that face */
};

struct finding {
    struct answer answer;
    uint32_t sample;
};

struct backward_slot {
    struct original_piece piece;
    struct bvh tree;
    struct finding *findings;
    size_t finding_count, finding_capacity;
};

struct backward {
    struct comparison *comparison;
    uint8_t *own_corners; /* of each face: bit k: vertex k is asked about with this face */

    /* The batch: faces tree.order[first, first + count). */
    uint32_t first, count;
    size_t offset_capacity, answer_capacity, group_capacity;
    uint32_t *offsets;      /* of each face: its first sample in the batch; one more for the end */
    struct answer *answers; /* of each sample: first those by area, then its own corners */
    struct bounds *groups;  /* of GROUP_FACES faces: how far its samples may have to look */
    uint64_t batches_done_faces;

    unsigned slot_count;
    struct backward_slot *slots;

    struct precise_sum weight, sum, squares, normal_weight, angles;
    double least_cosine;
    uint64_t area_samples;
};

static uint32_t face_at(const struct backward *backward, uint32_t place)
{
    return backward->comparison->tree.order[backward->first + place];
}

static double area_of(const struct triangle *t)
{
    return vec3_length(triangle_normal(t->a, t->b, t->c)) * 0.5;
}

static struct vec3 corner_of(const struct triangle *t, unsigned k)
{
    return k == 0 ? t->a : k == 1 ? t->b : t->c;
}

/* ---- the batch ---- */

/* Each vertex is asked about with the first face, in tree order, that uses it. */
static enum status assign_corners(struct backward *backward)
{
    const struct comparison *comparison = backward->comparison;
    struct context *ctx = comparison->ctx;
    const struct mesh *mesh = comparison->mesh;
    size_t bytes = (size_t)(mesh->vertex_count + 7) / 8;
    uint8_t *seen = NULL;
    enum status status =
        memory_take_zeroed(ctx, (size_t)mesh->face_count, 1, &backward->own_corners);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, bytes, 1, &seen);
    if (status != STATUS_OK)
        return status;
    for (uint32_t i = 0; i < comparison->tree.count; i++) {
        uint32_t face = comparison->tree.order[i];
        for (unsigned k = 0; k < 3; k++) {
            uint32_t vertex = mesh->faces[3 * (size_t)face + k];
            if (seen[vertex / 8] >> vertex % 8 & 1)
                continue;
            seen[vertex / 8] |= (uint8_t)(1u << vertex % 8);
            backward->own_corners[face] |= (uint8_t)(1u << k);
        }
    }
    memory_release(ctx, &seen, bytes, 1);
    return STATUS_OK;
}

/* Faces without an anchor take that of the last face in tree order that has one. */
static void complete_anchors(struct comparison *comparison)
{
    const struct anchor *last = NULL;
    for (uint32_t i = 0; i < comparison->tree.count && !last; i++)
        if (comparison->anchors[comparison->tree.order[i]].distance < INFINITY)
            last = &comparison->anchors[comparison->tree.order[i]];
    for (uint32_t i = 0; i < comparison->tree.count && last; i++) {
        struct anchor *anchor = &comparison->anchors[comparison->tree.order[i]];
        if (anchor->distance < INFINITY)
            last = anchor;
        else
            *anchor = *last;
    }
}

/* Upper bound of p's distance from the original. */
static double reach_of(const struct comparison *comparison, uint32_t face, struct vec3 p)
{
    const struct anchor *anchor = &comparison->anchors[face];
    if (!(anchor->distance < INFINITY))
        return INFINITY;
    struct vec3 at = vec3_add(comparison->tree.origin, vec3_load_float(anchor->at));
    return vec3_distance(p, at) + comparison->anchor_slack;
}

static struct bounds look_box(const struct comparison *comparison, uint32_t face)
{
    struct triangle t = bvh_triangle(&comparison->tree, face);
    struct bounds box = bounds_empty();
    double reach = 0; /* largest at a corner: distance from a point is convex */
    for (unsigned k = 0; k < 3; k++) {
        bounds_add(&box, corner_of(&t, k));
        reach = fmax(reach, reach_of(comparison, face, corner_of(&t, k)));
    }
    struct vec3 out = {reach, reach, reach};
    return (struct bounds){vec3_sub(box.low, out), vec3_add(box.high, out)};
}

static uint32_t samples_of(const struct comparison *comparison, uint32_t face)
{
    struct triangle t = bvh_triangle(&comparison->tree, face);
    return sample_share(area_of(&t), comparison->result->simplified.area,
                        comparison->wanted_samples, comparison->least_samples);
}

/* Takes as many faces as the batch has room for, and sets everything up for them. */
static enum status begin_batch(struct backward *backward, uint32_t first)
{
    const struct comparison *comparison = backward->comparison;
    struct context *ctx = comparison->ctx;
    uint32_t samples = 0;
    backward->first = first;
    backward->count = 0;
    while (first + backward->count < comparison->tree.count) {
        uint32_t face = face_at(backward, backward->count);
        uint32_t more = samples_of(comparison, face) +
                        (uint32_t)__builtin_popcount(backward->own_corners[face]);
        if (backward->count > 0 && samples + more > BATCH_SAMPLES)
            break;
        enum status status = memory_reserve(ctx, &backward->offsets, &backward->offset_capacity,
                                            (size_t)backward->count + 2, sizeof *backward->offsets);
        if (status != STATUS_OK)
            return status;
        backward->offsets[backward->count++] = samples;
        samples += more;
    }
    backward->offsets[backward->count] = samples;

    size_t groups = (backward->count + (GROUP_FACES - 1)) / GROUP_FACES;
    enum status status = memory_reserve(ctx, &backward->answers, &backward->answer_capacity,
                                        samples, sizeof *backward->answers);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &backward->groups, &backward->group_capacity, groups,
                                sizeof *backward->groups);
    if (status != STATUS_OK)
        return status;
    for (uint32_t i = 0; i < samples; i++)
        backward->answers[i] = (struct answer){INFINITY, no_cosine, UINT32_MAX};
    for (uint32_t i = 0; i < backward->count; i++) {
        struct bounds box = look_box(comparison, face_at(backward, i));
        struct bounds *group = &backward->groups[i / GROUP_FACES];
        if (i % GROUP_FACES == 0)
            *group = bounds_empty();
        bounds_add(group, box.low);
        bounds_add(group, box.high);
    }
    return STATUS_OK;
}

/* ---- one piece of the original against the batch ---- */

static float cosine_of(struct vec3 normal, const double *corners)
{
    struct vec3 other =
        triangle_normal(vec3_load(corners), vec3_load(corners + 3), vec3_load(corners + 6));
    double lengths = vec3_length(normal) * vec3_length(other);
    if (!(lengths > 0))
        return no_cosine;
    double cosine = vec3_dot(normal, other) / lengths;
    return (float)(cosine > 1 ? 1 : cosine < -1 ? -1 : cosine);
}

/* Asks the slot's tree about one sample; *last is the triangle of it that was found last. */
static enum status ask_piece(const struct comparison *comparison, struct backward_slot *slot,
                             uint32_t face, struct vec3 normal, struct vec3 p, uint32_t sample,
                             uint32_t *last)
{
    double reach = reach_of(comparison, face, p);
    struct nearest nearest = {reach * reach * (1 + 0x1p-40), UINT32_MAX, {0, 0, 0}};
    if (*last != UINT32_MAX) {
        struct triangle t = bvh_triangle(&slot->tree, *last);
        double distance = triangle_distance_squared(p, &t, NULL);
        if (distance <= nearest.distance_squared)
            nearest = (struct nearest){distance, *last, p};
    }
    bvh_nearest(&slot->tree, p, &nearest);
    if (nearest.triangle == UINT32_MAX)
        return STATUS_OK;
    *last = nearest.triangle;
    if (slot->finding_count == slot->finding_capacity) {
        enum status status =
            memory_reserve(comparison->ctx, &slot->findings, &slot->finding_capacity,
                           slot->finding_count + 1, sizeof *slot->findings);
        if (status != STATUS_OK)
            return status;
    }
    slot->findings[slot->finding_count++] =
        (struct finding){{nearest.distance_squared,
                          cosine_of(normal, slot->piece.corners + 9 * (size_t)nearest.triangle),
                          (uint32_t)(slot->piece.first_face + nearest.triangle)},
                         sample};
    return STATUS_OK;
}

static enum status ask_face(struct backward *backward, struct backward_slot *slot, uint32_t place,
                            uint32_t *last)
{
    const struct comparison *comparison = backward->comparison;
    uint32_t face = face_at(backward, place), sample = backward->offsets[place];
    uint32_t end = backward->offsets[place + 1];
    uint8_t own = backward->own_corners[face];
    uint32_t by_area = end - sample - (uint32_t)__builtin_popcount(own);
    struct triangle t = bvh_triangle(&comparison->tree, face);
    struct vec3 normal = triangle_normal(t.a, t.b, t.c);
    enum status status = STATUS_OK;
    for (uint32_t k = 0; k < by_area && status == STATUS_OK; k++)
        status =
            ask_piece(comparison, slot, face, normal, sample_point(&t, face, k), sample++, last);
    for (unsigned k = 0; k < 3 && status == STATUS_OK; k++)
        if (own >> k & 1)
            status = ask_piece(comparison, slot, face, normal, corner_of(&t, k), sample++, last);
    return status;
}

static enum status backward_work(void *user, uint64_t job, unsigned worker)
{
    struct backward *backward = user;
    const struct comparison *comparison = backward->comparison;
    struct backward_slot *slot = &backward->slots[job % backward->slot_count];
    const struct bounds *box = &comparison->boxes[job];
    enum status status = STATUS_OK;
    uint32_t last = UINT32_MAX;
    bool is_loaded = false;
    (void)worker;
    slot->finding_count = 0;
    if (box->low.x > box->high.x)
        return STATUS_OK;
    for (uint32_t i = 0; i < backward->count && status == STATUS_OK; i++) {
        if (i % GROUP_FACES == 0 && !bounds_touch(&backward->groups[i / GROUP_FACES], box)) {
            i += GROUP_FACES - 1;
            continue;
        }
        struct bounds look = look_box(comparison, face_at(backward, i));
        if (!bounds_touch(&look, box))
            continue;
        if (!is_loaded) {
            status = original_load(comparison->original, job, false, &slot->piece);
            if (status == STATUS_OK)
                status = bvh_build(comparison->ctx, slot->piece.corners, NULL,
                                   slot->piece.face_count, false, &slot->tree);
            is_loaded = true;
        }
        if (status == STATUS_OK)
            status = ask_face(backward, slot, i, &last);
    }
    bvh_clear(comparison->ctx, &slot->tree);
    return status;
}

static enum status backward_finish(void *user, uint64_t job)
{
    struct backward *backward = user;
    const struct comparison *comparison = backward->comparison;
    const struct backward_slot *slot = &backward->slots[job % backward->slot_count];
    for (size_t i = 0; i < slot->finding_count; i++) {
        const struct answer *found = &slot->findings[i].answer;
        struct answer *answer = &backward->answers[slot->findings[i].sample];
        if (found->distance_squared < answer->distance_squared ||
            (found->distance_squared == answer->distance_squared && found->face < answer->face))
            *answer = *found;
    }
    uint64_t pieces = original_piece_count(comparison->original);
    double part = (double)(job + 1) / (double)pieces * (double)backward->count;
    return step(comparison->ctx, "simplified to original", backward->first + (uint64_t)part,
                comparison->tree.count);
}

/* ---- what the answers say ---- */

static void count_normal(struct backward *backward, const struct answer *answer, double weight,
                         double *cosines)
{
    static const double degrees = 57.295779513082320877;
    if (answer->cosine > 1)
        return;
    *cosines += (double)answer->cosine;
    backward->least_cosine = fmin(backward->least_cosine, (double)answer->cosine);
    precise_add(&backward->normal_weight, weight);
    precise_add(&backward->angles, weight * degrees * acos((double)answer->cosine));
}

static enum status end_batch(struct backward *backward)
{
    struct comparison *comparison = backward->comparison;
    struct measurement *result = comparison->result;
    for (uint32_t i = 0; i < backward->count; i++) {
        uint32_t face = face_at(backward, i), sample = backward->offsets[i];
        uint8_t own = backward->own_corners[face];
        uint32_t by_area = backward->offsets[i + 1] - sample - (uint32_t)__builtin_popcount(own);
        struct triangle t = bvh_triangle(&comparison->tree, face);
        double weight = by_area ? area_of(&t) / by_area : 0, cosines = 0, distances = 0;
        for (uint32_t k = 0; k < by_area; k++) {
            const struct answer *answer = &backward->answers[sample++];
            double distance = sqrt(answer->distance_squared);
            if (!(distance < INFINITY))
                return fail(comparison->ctx, STATUS_INTERNAL, "a sample found no face");
            result->backward.largest = fmax(result->backward.largest, distance);
            distances += distance;
            precise_add(&backward->weight, weight);
            precise_add(&backward->sum, weight * distance);
            precise_add(&backward->squares, weight * answer->distance_squared);
            count_normal(backward, answer, weight, &cosines);
        }
        result->flipped_faces += cosines < 0;
        result->face_error[face] = by_area ? (float)(distances / by_area) : 0;
        for (unsigned k = 0; k < 3; k++) {
            if (!(own >> k & 1))
                continue;
            double distance = sqrt(backward->answers[sample++].distance_squared);
            if (!(distance < INFINITY))
                return fail(comparison->ctx, STATUS_INTERNAL, "a vertex found no face");
            result->backward.largest = fmax(result->backward.largest, distance);
            result->vertex_error[comparison->mesh->faces[3 * (size_t)face + k]] = (float)distance;
        }
        backward->area_samples += by_area;
    }
    result->backward.samples += backward->offsets[backward->count];
    return STATUS_OK;
}

static void conclude(struct backward *backward)
{
    static const double degrees = 57.295779513082320877;
    struct measurement *result = backward->comparison->result;
    double weight = precise_value(&backward->weight);
    if (weight > 0) {
        result->backward.mean = precise_value(&backward->sum) / weight;
        result->backward.rms = sqrt(precise_value(&backward->squares) / weight);
    }
    weight = precise_value(&backward->normal_weight);
    if (weight > 0) {
        result->normal_mean = precise_value(&backward->angles) / weight;
        result->normal_largest = degrees * acos(backward->least_cosine);
    }
    result->samples_per_face =
        (double)backward->area_samples / (double)backward->comparison->mesh->face_count;
}

enum status measure_backward(struct comparison *comparison)
{
    struct context *ctx = comparison->ctx;
    struct backward backward = {
        .comparison = comparison, .slot_count = ctx->threads + 1, .least_cosine = 1};
    complete_anchors(comparison);
    enum status status =
        memory_take_zeroed(ctx, backward.slot_count, sizeof *backward.slots, &backward.slots);
    if (status == STATUS_OK)
        status = assign_corners(&backward);
    for (uint32_t first = 0; status == STATUS_OK && first < comparison->tree.count;
         first += backward.count) {
        status = begin_batch(&backward, first);
        if (status == STATUS_OK)
            status =
                parallel_ordered(ctx, original_piece_count(comparison->original),
                                 backward.slot_count, backward_work, backward_finish, &backward);
        if (status == STATUS_OK)
            status = end_batch(&backward);
    }
    if (status == STATUS_OK)
        conclude(&backward);

    for (unsigned i = 0; backward.slots && i < backward.slot_count; i++) {
        struct backward_slot *slot = &backward.slots[i];
        original_piece_clear(&slot->piece);
        bvh_clear(ctx, &slot->tree);
        memory_release(ctx, &slot->findings, slot->finding_capacity, sizeof *slot->findings);
    }
    memory_release(ctx, &backward.slots, backward.slot_count, sizeof *backward.slots);
    memory_release(ctx, &backward.groups, backward.group_capacity, sizeof *backward.groups);
    memory_release(ctx, &backward.answers, backward.answer_capacity, sizeof *backward.answers);
    memory_release(ctx, &backward.offsets, backward.offset_capacity, sizeof *backward.offsets);
    memory_release(ctx, &backward.own_corners, (size_t)comparison->mesh->face_count, 1);
    return status;
}
