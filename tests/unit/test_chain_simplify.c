/*
 * Halving: the thresholds against the recursion of section 4.2.5 run for each tolerance, what the
 * hierarchy promises, and that no copy of a chain can disagree.
 */
#include "simplify/chain_simplify.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "geom/plane.h"
#include "test_kit.h"
#include "test_shapes.h"

enum { LONGEST = 200 };

/* A random walk with bends; some have three vertices in a line, or the same one twice. */
static size_t random_chain(uint64_t *random, float *positions)
{
    size_t count = 2 + (size_t)random_below(random, LONGEST - 2);
    double at[3] = {0, 0, 0}, step[3] = {1, 0, 0};
    for (size_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) {
            step[k] += (random_unit(random) - 0.5) * (random_below(random, 8) == 0 ? 4 : 0.2);
            at[k] += random_below(random, 30) == 0 ? 0 : step[k];
            positions[3 * i + k] = (float)at[k];
        }
    return count;
}

static double distance_at(const float *positions, size_t k, size_t i, size_t j)
{
    return vec3_length(segment_offset(vec3_load_float(positions + 3 * k),
                                      vec3_load_float(positions + 3 * i),
                                      vec3_load_float(positions + 3 * j)));
}

static double farthest(const float *positions, size_t i, size_t j)
{
    double largest = 0;
    for (size_t k = i + 1; k < j; k++)
        if (distance_at(positions, k, i, j) > largest)
            largest = distance_at(positions, k, i, j);
    return largest;
}

/* Section 4.2.5, word for word. */
static void refine(const float *positions, size_t i, size_t j, double tolerance, bool *kept)
{
    if (j - i < 2 || farthest(positions, i, j) <= tolerance)
        return;
    size_t middle = i + (j - i) / 2;
    kept[middle] = true;
    refine(positions, i, middle, tolerance, kept);
    refine(positions, middle, j, tolerance, kept);
}

/* From the bottom: true when all inside went. */
static bool straighten(const float *positions, size_t i, size_t j, double tolerance, bool *kept)
{
    if (j - i < 2)
        return true;
    size_t middle = i + (j - i) / 2;
    bool first = straighten(positions, i, middle, tolerance, kept);
    bool second = straighten(positions, middle, j, tolerance, kept);
    bool gone = first && second && farthest(positions, i, j) <= tolerance;
    kept[middle] = !gone;
    return gone;
}

/* Halving is defined from one end: the canonical one. */
static void put_in_order(float *positions, size_t count)
{
    if (!polyline_runs_backwards(positions, count))
        return;
    for (size_t i = 0; i < count / 2; i++)
        for (int k = 0; k < 3; k++) {
            float other = positions[3 * i + k];
            positions[3 * i + k] = positions[3 * (count - 1 - i) + k];
            positions[3 * (count - 1 - i) + k] = other;
        }
}

static void thresholds_are_the_recursion(void **state)
{
    (void)state;
    uint64_t random = 1;
    struct chain_metric plain = chain_metric_plain();
    for (int round = 0; round < 400; round++) {
        float positions[3 * LONGEST], errors[LONGEST];
        size_t count = random_chain(&random, positions);
        put_in_order(positions, count);
        for (int form = HALVING_TOP_DOWN; form <= HALVING_BOTTOM_UP; form++) {
            chain_errors(positions, count, (enum halving)form, &plain, errors);
            double tolerance = random_unit(&random) * random_unit(&random) * 20;
            bool kept[LONGEST] = {false};
            if (form == HALVING_TOP_DOWN)
                refine(positions, 0, count - 1, tolerance, kept);
            else
                straighten(positions, 0, count - 1, tolerance, kept);
            assert_true(errors[0] == INFINITY && errors[count - 1] == INFINITY);
            for (size_t k = 1; k + 1 < count; k++)
                if (fabs((double)errors[k] - tolerance) > 1e-5 * tolerance)
                    assert_int_equal(kept[k], (double)errors[k] > tolerance);
        }
    }
}

/* Whatever is dropped lies within the tolerance of the segment between the kept ones round it. */
static void chains_stay_within_tolerance(void **state)
{
    (void)state;
    uint64_t random = 7;
    struct chain_metric plain = chain_metric_plain();
    for (int round = 0; round < 400; round++) {
        float positions[3 * LONGEST], errors[LONGEST];
        size_t count = random_chain(&random, positions), kept_count[2];
        double tolerance = random_unit(&random) * 5;
        for (int form = HALVING_TOP_DOWN; form <= HALVING_BOTTOM_UP; form++) {
            chain_errors(positions, count, (enum halving)form, &plain, errors);
            kept_count[form] = 0;
            for (size_t i = 0, j; i + 1 < count; i = j) {
                for (j = i + 1; (double)errors[j] <= tolerance; j++)
                    ;
                assert_true(farthest(positions, i, j) <= tolerance * (1 + 1e-6));
                kept_count[form]++;
            }
        }
        assert_true(kept_count[HALVING_TOP_DOWN] <= kept_count[HALVING_BOTTOM_UP]);
    }
}

/* Both copies of a seam chain, and twins, which may be kept in opposite directions. */
static void direction_does_not_matter(void **state)
{
    (void)state;
    uint64_t random = 3;
    struct chain_metric metrics[2] = {
        chain_metric_plain(),
        chain_metric_between(vec3_make(0, 0, 1), vec3_normalized(vec3_make(0.3, 0, 1)))};
    for (int round = 0; round < 600; round++) {
        float positions[3 * LONGEST], turned[3 * LONGEST], errors[LONGEST], others[LONGEST];
        size_t count = random_chain(&random, positions);
        if (round % 5 == 0) /* a chain whose ends coincide */
            memcpy(positions + 3 * (count - 1), positions, 3 * sizeof *positions);
        for (size_t i = 0; i < count; i++)
            memcpy(turned + 3 * i, positions + 3 * (count - 1 - i), 3 * sizeof *turned);
        enum halving form = round % 2 ? HALVING_TOP_DOWN : HALVING_BOTTOM_UP;
        chain_errors(positions, count, form, &metrics[round % 2], errors);
        chain_errors(turned, count, form, &metrics[round % 2], others);
        for (size_t i = 0; i < count; i++)
            assert_true(errors[i] == others[count - 1 - i]);
    }
}

/* Asked for one tolerance only: the same vertices are above it, and the largest error of what is
 * not is the same. */
static void one_tolerance_keeps_the_same_vertices(void **state)
{
    (void)state;
    uint64_t random = 5;
    struct chain_metric plain = chain_metric_plain();
    size_t pruned = 0;
    for (int round = 0; round < 600; round++) {
        float positions[3 * LONGEST], errors[LONGEST], above[LONGEST];
        const size_t count = random_chain(&random, positions);
        chain_errors(positions, count, HALVING_TOP_DOWN, &plain, errors);
        /* one of the errors now and then, which is the border between the two */
        const double tolerance =
            round % 3 == 0 && count > 2 ? (double)errors[count / 2] : random_unit(&random) * 5;
        chain_errors_above(positions, count, tolerance, &plain, above);
        float dropped[2] = {0, 0};
        for (size_t i = 0; i < count; i++) {
            assert_int_equal((double)errors[i] > tolerance, (double)above[i] > tolerance);
            if ((double)errors[i] > tolerance) {
                assert_true(errors[i] == above[i]);
                continue;
            }
            dropped[0] = fmaxf(dropped[0], errors[i]);
            dropped[1] = fmaxf(dropped[1], above[i]);
            pruned += above[i] < errors[i];
        }
        assert_true(dropped[0] == dropped[1]);
    }
    assert_true(pruned > 100);
}

static void straight_chains_cost_nothing(void **state)
{
    (void)state;
    float positions[3 * 17], errors[17];
    struct chain_metric plain = chain_metric_plain();
    for (int i = 0; i < 17; i++)
        for (int k = 0; k < 3; k++)
            positions[3 * i + k] = (float)(i * (k + 1));
    chain_errors(positions, 17, HALVING_BOTTOM_UP, &plain, errors);
    for (int i = 1; i < 16; i++)
        assert_true(errors[i] < 1e-5f);
    chain_errors(positions, 2, HALVING_BOTTOM_UP, &plain, errors);
    assert_true(errors[0] == INFINITY && errors[1] == INFINITY);
}

/* Between coplanar patches a chain may wander in their plane; between walls it may not. */
static void metric_tells_sharp_from_smooth(void **state)
{
    (void)state;
    struct vec3 up = vec3_make(0, 0, 1), side = vec3_make(1, 0, 0);
    struct chain_metric flat = chain_metric_between(up, up), sharp = chain_metric_between(up, side);
    struct vec3 within = vec3_make(0, 2, 0), above = vec3_make(0, 0, 2);
    assert_true(chain_metric_length(&flat, within) < 0.05);
    assert_true(fabs(chain_metric_length(&flat, above) - 2) < 1e-12);
    assert_true(fabs(chain_metric_length(&sharp, within) - 2) < 1e-12);
    assert_true(sharp.price > flat.price && flat.price == 1);
    double before = 0;
    for (int degrees = 0; degrees <= 180; degrees++) {
        double angle = degrees * 3.14159265358979 / 180;
        struct chain_metric metric = chain_metric_between(up, vec3_make(sin(angle), 0, cos(angle)));
        assert_true(metric.lateral >= before && metric.lateral <= 1);
        before = metric.lateral;
    }
    assert_true(before == 1);
}

static double seconds_for(size_t count, float *positions, float *errors)
{
    struct chain_metric plain = chain_metric_plain();
    clock_t start = clock();
    chain_errors(positions, count, HALVING_BOTTOM_UP, &plain, errors);
    return (double)(clock() - start) / CLOCKS_PER_SEC;
}

/* 64 times as long takes about 90 times as long; quadratic would be 4,096. */
static void long_chains_are_not_slow(void **state)
{
    (void)state;
    enum { SHORT = 1 << 14, LONG = 1 << 20 };
    float *positions = malloc(3 * LONG * sizeof *positions),
          *errors = malloc(LONG * sizeof *errors);
    uint64_t random = 5;
    assert_true(positions && errors);
    for (size_t i = 0; i < 3 * LONG; i++)
        positions[i] = (float)random_unit(&random);
    double few = seconds_for(SHORT, positions, errors), many = seconds_for(LONG, positions, errors);
    assert_true(many < 1000 * (few + 1e-4));
    free(positions);
    free(errors);
}

static void frames_are_right_handed(void **state)
{
    (void)state;
    uint64_t random = 9;
    for (int round = 0; round < 200; round++) {
        struct vec3 normal = vec3_make(random_unit(&random) - 0.5, random_unit(&random) - 0.5,
                                       round % 7 == 0 ? 0 : random_unit(&random) - 0.5);
        struct plane_frame frame = plane_frame_make(normal);
        struct vec3 third = vec3_cross(frame.across, frame.up);
        assert_true(vec3_distance(third, vec3_normalized(normal)) < 1e-9);
    }
    struct plane_frame none = plane_frame_make(vec3_make(0, 0, 0));
    assert_true(vec3_cross(none.across, none.up).z > 0.99);
    struct plane_point square[4] = {{0, 0}, {2, 0}, {2, 2}, {0, 2}};
    assert_true(plane_polygon_area(square, 4) == 8);
    assert_true(plane_segments_cross(square[0], square[2], square[1], square[3]));
    assert_false(plane_segments_cross(square[0], square[1], square[2], square[3]));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(thresholds_are_the_recursion),
        cmocka_unit_test(chains_stay_within_tolerance),
        cmocka_unit_test(direction_does_not_matter),
        cmocka_unit_test(one_tolerance_keeps_the_same_vertices),
        cmocka_unit_test(straight_chains_cost_nothing),
        cmocka_unit_test(metric_tells_sharp_from_smooth),
        cmocka_unit_test(long_chains_are_not_slow),
        cmocka_unit_test(frames_are_right_handed),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
