/*
 * A heap and a tree are for large loops: of a patch's five to ten corners the best ear is found by
 * looking at all keys, the blocking corners are the bits of a number, and all of it lies on the
 * stack. The decisions are those of ear_clip.c (which has the reasons), in the same order.
 *
 * In a simple loop any corner that is not convex and lies in an ear's triangle blocks it, and ears
 * that are found proper stay proper. What is no ear is never compared: as soon as no proper ear is
 * left, the rest is given back. So keys other than those of ears only say the kind.
 */
#include "geom/ear_few.h"

struct few {
    const struct grid_point *points;
    double key[EAR_FEW_MAX]; /* of an ear 1 - cosine; of others NOT_AN_EAR; of cut ones infinite */
    double squares[EAR_FEW_MAX]; /* of the lengths of the edges from each corner to the next */
    uint8_t previous[EAR_FEW_MAX], next[EAR_FEW_MAX];
    uint64_t blockers;  /* corners that are not convex, not cut */
    uint64_t forbidden; /* corners whose diagonal is */
};

static const double NOT_AN_EAR = 4;

static inline int64_t turn_at(const struct few *few, uint32_t corner)
{
    return orientation(few->points[few->previous[corner]], few->points[corner],
                       few->points[few->next[corner]]);
}

/* Any corner that is not convex in the closed triangle at `corner`, besides its own? */
static inline bool is_blocked(const struct few *few, uint32_t corner)
{
    const uint32_t before = few->previous[corner], after = few->next[corner];
    const struct grid_point a = few->points[before], b = few->points[corner],
                            c = few->points[after];
    const uint64_t own = UINT64_C(1) << before | UINT64_C(1) << corner | UINT64_C(1) << after;
    for (uint64_t left = few->blockers & ~own; left; left &= left - 1)
        if (triangle_holds(a, b, c, few->points[__builtin_ctzll(left)]))
            return true;
    return false;
}

/* The key of a corner that is convex and not blocked. */
static inline double openness_at(const struct few *few, uint32_t corner)
{
    const struct grid_point a = few->points[few->previous[corner]], b = few->points[corner],
                            c = few->points[few->next[corner]];
    return ear_openness(a, b, c, few->squares[few->previous[corner]] * few->squares[corner]);
}

/* Sets a corner's key; `turn` is turn_at. */
static inline void judge(struct few *few, uint32_t corner, int64_t turn)
{
    const bool is_ear =
        turn > 0 && !(few->forbidden >> corner & 1) && !(few->blockers && is_blocked(few, corner));
    few->key[corner] = is_ear ? openness_at(few, corner) : NOT_AN_EAR;
}

/* A neighbour of the corner has been cut: its triangle is another one. (What is left of a convex
 * loop is convex.) */
static inline void update(struct few *few, uint32_t corner)
{
    const uint64_t bit = UINT64_C(1) << corner;
    few->forbidden &= ~bit;
    if (few->blockers == 0) {
        few->key[corner] = openness_at(few, corner);
        return;
    }
    const int64_t turn = turn_at(few, corner);
    few->blockers = turn <= 0 ? few->blockers | bit : few->blockers & ~bit;
    judge(few, corner, turn);
}

static void set_up(struct few *few, const struct ear_input *input)
{
    const uint32_t n = input->n;
    int64_t turns[EAR_FEW_MAX];
    few->points = input->points;
    few->blockers = few->forbidden = 0;
    for (uint32_t i = 0; i < n; i++) {
        few->previous[i] = (uint8_t)(i == 0 ? n - 1 : i - 1);
        few->next[i] = (uint8_t)(i + 1 == n ? 0 : i + 1);
        few->squares[i] = grid_square(few->points[i], few->points[few->next[i]]);
        turns[i] = turn_at(few, i);
        few->blockers |= (uint64_t)(turns[i] <= 0) << i;
    }
    for (uint32_t i = 0; i < n; i++)
        judge(few, i, turns[i]);
}

static uint32_t best_corner(const struct few *few, uint32_t n)
{
    uint32_t best = 0;
    for (uint32_t i = 1; i < n; i++)
        best = few->key[i] < few->key[best] ? i : best;
    return best;
}

static enum status hand_back(struct context *ctx, struct scratch *scratch, const struct few *few,
                             uint32_t corner, uint32_t count, struct ear_result *result)
{
    enum status status = scratch_reserve(ctx, scratch, count * sizeof *result->rest);
    if (status != STATUS_OK)
        return status;
    result->rest = (uint32_t *)(void *)scratch->block;
    result->rest_count = count;
    for (uint32_t i = 0; i < count; i++) {
        result->rest[i] = corner;
        corner = few->next[corner];
    }
    return STATUS_OK;
}

enum status cut_few_ears(struct context *ctx, struct scratch *scratch,
                         const struct ear_input *input, uint32_t *triangles,
                         struct ear_result *result)
{
    struct few few;
    *result = (struct ear_result){0};
    set_up(&few, input);
    for (uint32_t count = input->n;;) {
        const uint32_t b = best_corner(&few, input->n);
        /* No loop is empty. NOLINTNEXTLINE(clang-analyzer-core.uninitialized.Assign) */
        const uint32_t a = few.previous[b], c = few.next[b];
        if (count > 3) {
            if (few.key[b] >= NOT_AN_EAR) {
                uint32_t first = 0;
                while (few.key[first] == INFINITY)
                    first++;
                return hand_back(ctx, scratch, &few, first, count, result);
            }
            if (input->diagonal_allowed && !input->diagonal_allowed(input->user, a, c)) {
                few.forbidden |= UINT64_C(1) << b;
                few.key[b] = NOT_AN_EAR;
                continue;
            }
        }
        uint32_t *triangle = triangles + 3 * (size_t)result->cut++;
        triangle[0] = a;
        triangle[1] = b;
        triangle[2] = c;
        if (count == 3)
            return STATUS_OK;
        few.key[b] = INFINITY;
        few.next[a] = (uint8_t)c;
        few.previous[c] = (uint8_t)a;
        if (--count == 3) /* they are the last triangle, whatever they are */
            continue;
        few.squares[a] = grid_square(few.points[a], few.points[c]);
        update(&few, a);
        update(&few, c);
    }
}
