/*
 * Cutting ears by increasing angle.
 *
 * An ear of a simple loop is a convex corner whose triangle, with the diagonal that closes it,
 * holds no other corner; testing only the corners that are not convex is enough, for of the corners
 * inside, the one farthest from the diagonal is not convex. Naively all corners are tested against
 * all, after every cut. Here a corner's state is kept until something changes it:
 *
 * - All corners of the rest stand in one heap, ordered by kind (proper ear, blocked ear, reflex, no
 *   area, forbidden), then by angle, then by number. Cutting one moves its two neighbours.
 * - Only these two are looked at again. A blocked ear stays blocked as long as its own triangle
 *   stays: of the corners in it, the one farthest from the diagonal is not convex, so that it is
 * not cut. So the heap's top is the best ear there is at any time.
 * - The blocking corners are found in a point_tree (or by a plain loop while n is small).
 * - Simple loops of few corners need none of this: ear_few.c.
 *
 * In a simple loop a proper ear is always left (two-ears theorem; an ear without area is never
 * proper, and a rest with area always has another). In other loops, corners far above or below the
 * ear do not block it: they are on another turn of a ramp. When no proper ear is left there, the
 * next kind is cut, as FIST does: so it always ends.
 *
 * Angles are compared by their cosines, made of grid differences with products, one sqrt and one
 * division: the same on every machine.
 */
#include "geom/ear_clip.h"

#include <math.h>
#include <string.h>

#include "geom/ear_few.h"
#include "geom/point_tree.h"

enum { LOOP_SEARCH_MAX = 48 }; /* corners up to which blocking ones are searched by a plain loop */

enum kind { KIND_EAR, KIND_BLOCKED, KIND_REFLEX, KIND_FLAT, KIND_FORBIDDEN };

struct clipper {
    const struct ear_input *input;
    const struct grid_point *points;
    bool is_simple, has_tree;
    struct point_tree tree;
    uint32_t count; /* corners of the rest */
    uint32_t *previous, *next;
    /* The heap: corners by key; the smallest key is on top. */
    uint32_t *heap, *place;
    double *key;          /* 4 * kind + 1 - cosine */
    uint8_t *is_blocking; /* not convex and not cut */
    uint32_t blocking_count;
    uint8_t *is_forbidden;
};

/* ---- heap ---- */

static bool key_less(const struct clipper *clipper, uint32_t a, uint32_t b)
{
    return clipper->key[a] != clipper->key[b] ? clipper->key[a] < clipper->key[b] : a < b;
}

static void heap_put(struct clipper *clipper, uint32_t place, uint32_t corner)
{
    clipper->heap[place] = corner;
    clipper->place[corner] = place;
}

/* Both begin at a place whose corner may be wrong there; the rest is in order. */
static void sift_up(struct clipper *clipper, uint32_t place)
{
    uint32_t corner = clipper->heap[place];
    while (place > 0 && key_less(clipper, corner, clipper->heap[(place - 1) / 2])) {
        heap_put(clipper, place, clipper->heap[(place - 1) / 2]);
        place = (place - 1) / 2;
    }
    heap_put(clipper, place, corner);
}

static void sift_down(struct clipper *clipper, uint32_t place)
{
    uint32_t corner = clipper->heap[place];
    for (;;) {
        uint64_t child = 2 * (uint64_t)place + 1;
        if (child >= clipper->count)
            break;
        if (child + 1 < clipper->count &&
            key_less(clipper, clipper->heap[child + 1], clipper->heap[child]))
            child++;
        if (!key_less(clipper, clipper->heap[child], corner))
            break;
        heap_put(clipper, place, clipper->heap[child]);
        place = (uint32_t)child;
    }
    heap_put(clipper, place, corner);
}

static void heap_move(struct clipper *clipper, uint32_t corner)
{
    sift_up(clipper, clipper->place[corner]);
    sift_down(clipper, clipper->place[corner]);
}

static void heap_remove(struct clipper *clipper, uint32_t corner)
{
    uint32_t place = clipper->place[corner], last = clipper->heap[--clipper->count];
    clipper->key[corner] = INFINITY;
    if (last != corner) {
        heap_put(clipper, place, last);
        heap_move(clipper, last);
    }
}

/* ---- tests ---- */

struct ear {
    const struct clipper *clipper;
    uint32_t a, b, c; /* b is its tip */
};

/* The corner lies over or under the ear, on another sheet of the surface: farther from its plane
 * than the ear is wide, as a surface that is sloped less than 45 degrees can't be. */
static bool is_on_other_sheet(const struct ear *ear, uint32_t corner)
{
    const double *heights = ear->clipper->input->heights;
    const struct grid_point *points = ear->clipper->points;
    struct grid_point a = points[ear->a], b = points[ear->b], c = points[ear->c];
    struct grid_point p = points[corner];
    double at_a = (double)orientation(b, c, p), at_b = (double)orientation(c, a, p),
           at_c = (double)orientation(a, b, p);
    double height = (at_a * heights[ear->a] + at_b * heights[ear->b] + at_c * heights[ear->c]) /
                    (at_a + at_b + at_c);
    double off = heights[corner] - height;
    double ab = grid_square(a, b), bc = grid_square(b, c), ca = grid_square(c, a);
    double widest = ab > bc ? ab : bc;
    return off * off > (widest > ca ? widest : ca);
}

/* Does a corner that is not convex and lies in the closed triangle make it improper? */
static bool blocks(const void *user, uint32_t corner)
{
    const struct ear *ear = user;
    if (corner == ear->a || corner == ear->b || corner == ear->c)
        return false;
    return ear->clipper->is_simple || !is_on_other_sheet(ear, corner);
}

static bool has_blocker(const struct clipper *clipper, const struct ear *ear)
{
    if (clipper->blocking_count == 0)
        return false;
    const struct grid_point *points = clipper->points;
    struct grid_point a = points[ear->a], b = points[ear->b], c = points[ear->c];
    if (clipper->has_tree)
        return point_tree_find(&clipper->tree, a, b, c, blocks, ear) != UINT32_MAX;
    for (uint32_t i = 0; i < clipper->input->n; i++)
        if (clipper->is_blocking[i] && triangle_holds(a, b, c, points[i]) && blocks(ear, i))
            return true;
    return false;
}

/* ---- states ---- */

/* To something else than it was. */
static void set_blocking(struct clipper *clipper, uint32_t corner, bool is_blocking)
{
    clipper->blocking_count += is_blocking ? 1 : UINT32_MAX;
    if (clipper->has_tree)
        point_tree_switch(&clipper->tree, corner, is_blocking);
    else
        clipper->is_blocking[corner] = is_blocking;
}

static int64_t turn_at(const struct clipper *clipper, uint32_t corner)
{
    const struct grid_point *points = clipper->points;
    return orientation(points[clipper->previous[corner]], points[corner],
                       points[clipper->next[corner]]);
}

static enum kind kind_of(const struct clipper *clipper, const struct ear *ear, int64_t turn)
{
    if (clipper->is_forbidden[ear->b])
        return KIND_FORBIDDEN;
    if (turn <= 0)
        return turn == 0 ? KIND_FLAT : KIND_REFLEX;
    return has_blocker(clipper, ear) ? KIND_BLOCKED : KIND_EAR;
}

/* Sets a corner's key anew; `turn` is turn_at. */
static void judge(struct clipper *clipper, uint32_t corner, int64_t turn)
{
    struct ear ear = {clipper, clipper->previous[corner], corner, clipper->next[corner]};
    enum kind kind = kind_of(clipper, &ear, turn);
    const struct grid_point *points = clipper->points;
    const struct grid_point a = points[ear.a], b = points[ear.b], c = points[ear.c];
    const double lengths = grid_square(a, b) * grid_square(c, b);
    clipper->key[corner] = 4.0 * (int)kind + ear_openness(a, b, c, lengths);
}

static void rejudge(struct clipper *clipper, uint32_t corner)
{
    judge(clipper, corner, turn_at(clipper, corner));
    heap_move(clipper, corner);
}

/* A neighbour of the corner has been cut: its triangle is another one. */
static void update(struct clipper *clipper, uint32_t corner)
{
    const int64_t turn = turn_at(clipper, corner);
    const bool is_blocking = turn <= 0;
    clipper->is_forbidden[corner] = false;
    if (is_blocking != clipper->is_blocking[corner])
        set_blocking(clipper, corner, is_blocking);
    judge(clipper, corner, turn);
    heap_move(clipper, corner);
}

static void cut(struct clipper *clipper, uint32_t corner)
{
    uint32_t a = clipper->previous[corner], c = clipper->next[corner];
    heap_remove(clipper, corner);
    clipper->next[a] = c;
    clipper->previous[c] = a;
    if (clipper->count == 3) /* they are the last triangle, whatever they are */
        return;
    if (clipper->is_blocking[corner])
        set_blocking(clipper, corner, false);
    update(clipper, a);
    update(clipper, c);
}

/* ---- the whole ---- */

static enum status set_up(struct context *ctx, struct scratch *scratch,
                          const struct ear_input *input, struct clipper *clipper)
{
    size_t n = input->n;
    bool has_tree = n > LOOP_SEARCH_MAX;
    size_t tree_bytes = has_tree ? point_tree_size(input->n) : 0;
    enum status status = scratch_reserve(ctx, scratch, tree_bytes + n * (8 + 4 * 4 + 2));
    if (status != STATUS_OK)
        return status;
    unsigned char *block = scratch->block + (tree_bytes + 7) / 8 * 8;
    *clipper = (struct clipper){.input = input,
                                .points = input->points,
                                .is_simple = input->is_simple,
                                .has_tree = has_tree,
                                .count = input->n};
    clipper->key = (double *)(void *)block;
    clipper->previous = (uint32_t *)(void *)(block + 8 * n);
    clipper->next = clipper->previous + n;
    clipper->heap = clipper->next + n;
    clipper->place = clipper->heap + n;
    clipper->is_blocking = (uint8_t *)(clipper->place + n);
    clipper->is_forbidden = clipper->is_blocking + n;

    memset(clipper->is_forbidden, 0, n);
    for (uint32_t i = 0; i < input->n; i++) {
        clipper->previous[i] = i == 0 ? input->n - 1 : i - 1;
        clipper->next[i] = i + 1 == input->n ? 0 : i + 1;
        clipper->is_blocking[i] = turn_at(clipper, i) <= 0;
        clipper->blocking_count += clipper->is_blocking[i];
    }
    if (has_tree)
        point_tree_build(&clipper->tree, input->points, input->n, clipper->is_blocking,
                         scratch->block);
    for (uint32_t i = 0; i < input->n; i++)
        judge(clipper, i, turn_at(clipper, i));
    for (uint32_t i = 0; i < input->n; i++)
        heap_put(clipper, i, i);
    for (uint32_t i = input->n / 2; i-- > 0;)
        sift_down(clipper, i);
    return STATUS_OK;
}

static void hand_back(struct clipper *clipper, struct ear_result *result)
{
    uint32_t corner = 0, count = clipper->count;
    while (clipper->key[corner] == INFINITY)
        corner++;
    result->rest = clipper->place; /* the heap is not needed any more */
    result->rest_count = count;
    for (uint32_t i = 0; i < count; i++) {
        result->rest[i] = corner;
        corner = clipper->next[corner];
    }
}

/* In loops that are not simple, a corner can become reflex after an ear was found proper. */
static bool is_outdated(struct clipper *clipper, uint32_t corner)
{
    double key = clipper->key[corner];
    rejudge(clipper, corner);
    return clipper->key[corner] != key;
}

enum status cut_ears(struct context *ctx, struct scratch *scratch, const struct ear_input *input,
                     uint32_t *triangles, struct ear_result *result)
{
    if (input->is_simple && input->n <= EAR_FEW_MAX && input->n <= input->give_back_max)
        return cut_few_ears(ctx, scratch, input, triangles, result);
    struct clipper clipper;
    enum status status = set_up(ctx, scratch, input, &clipper);
    *result = (struct ear_result){0};
    if (status != STATUS_OK)
        return status;
    for (;;) {
        uint32_t b = clipper.heap[0];
        uint32_t a = clipper.previous[b], c = clipper.next[b];
        if (!input->is_simple && clipper.count > 3 && is_outdated(&clipper, b))
            continue;
        if (clipper.count > 3) {
            if (clipper.key[b] >= 4.0 * KIND_BLOCKED && clipper.count <= input->give_back_max) {
                hand_back(&clipper, result);
                return STATUS_OK;
            }
            if (clipper.key[b] >= 4.0 * KIND_FORBIDDEN) {
                result->is_stuck = true;
                return STATUS_OK;
            }
            if (input->diagonal_allowed && !input->diagonal_allowed(input->user, a, c)) {
                clipper.is_forbidden[b] = true;
                rejudge(&clipper, b);
                continue;
            }
        }
        uint32_t *triangle = triangles + 3 * (size_t)result->cut++;
        triangle[0] = a;
        triangle[1] = b;
        triangle[2] = c;
        if (clipper.count == 3)
            return STATUS_OK;
        cut(&clipper, b);
    }
}
