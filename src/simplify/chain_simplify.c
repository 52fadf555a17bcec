/*
 * Simplifying one chain.
 *
 * The plain method runs the recursion of section 4.2.5 for a given tolerance, and again for every
 * other tolerance that a level of detail asks for; a search for a number of faces runs it dozens of
 * times. But the recursion tree of halving does not depend on the tolerance at all: the subchain
 * from i to j is always cut at (i + j) / 2. So the tree is walked once, the distance of each
 * subchain from its segment is measured once, and each middle vertex gets the tolerance at which it
 * goes: from there on the chain at any tolerance is a comparison a vertex.
 *
 * Both copies of a chain (two slabs, or the two sides of an edge that was separated) must agree
 * without talking. Neighbours are cut along the same simplified chain: that is why there are no
 * cracks. So the walk starts at an end that the coordinates alone decide.
 */
#include "simplify/chain_simplify.h"

#include <stdbool.h>
#include <string.h>

/* Sines between which the lateral weight grows to 1: 20 and 40 degrees. */
#define SMOOTH_SINE 0.3420201433256687
#define SHARP_SINE 0.6427876096865394
#define LATERAL_SMOOTH 0.35 /* lateral weight per sine where the surface is smooth */

struct walk {
    const float *positions;
    size_t last; /* number of the last vertex, seen in the direction of walking */
    bool backwards;
    const struct chain_metric *metric;
    double enough; /* what replaces a subchain with no more error is not looked into */
    float *errors;
};

struct chain_metric chain_metric_between(struct vec3 left, struct vec3 right)
{
    struct chain_metric metric;
    double cosine = vec3_dot(left, right);
    double sine = vec3_length(vec3_cross(left, right));
    metric.normal = vec3_normalized(vec3_add(left, right));
    /* 0 where the surface is smooth, 1 where it is sharp, and all between. */
    double sharpness = (sine - SMOOTH_SINE) / (SHARP_SINE - SMOOTH_SINE);
    if (cosine <= 0 || sharpness > 1)
        sharpness = 1;
    if (sharpness < 0)
        sharpness = 0;
    double smooth = LATERAL_SMOOTH * (sine < SMOOTH_SINE ? sine : SMOOTH_SINE);
    metric.lateral = smooth + sharpness * (1 - smooth);
    metric.price = 1 + sharpness * (CHAIN_SHARP_PRICE - 1);
    if (metric.lateral < CHAIN_LATERAL_LEAST)
        metric.lateral = CHAIN_LATERAL_LEAST;
    return metric;
}

static size_t place_of(const struct walk *walk, size_t k)
{
    return walk->backwards ? walk->last - k : k;
}

static struct vec3 point_of(const struct walk *walk, size_t k)
{
    return vec3_load_float(walk->positions + 3 * place_of(walk, k));
}

/* Largest distance of the vertices between i and j from the segment, rounded up to float. */
static float subchain_error(const struct walk *walk, size_t i, size_t j)
{
    struct vec3 a = point_of(walk, i), b = point_of(walk, j);
    double largest = 0;
    for (size_t k = i + 1; k < j; k++) {
        double d = chain_metric_length(walk->metric, segment_offset(point_of(walk, k), a, b));
        if (d > largest)
            largest = d;
    }
    return (float)(largest * (1 + 0x1p-22));
}

/* The recursion is as deep as the chain can be halved. */
static float keep_hierarchy(const struct walk *walk, size_t i, size_t j)
{
    if (j - i < 2)
        return 0;
    size_t middle = i + (j - i) / 2;
    float error = subchain_error(walk, i, j);
    float first = keep_hierarchy(walk, i, middle), second = keep_hierarchy(walk, middle, j);
    if (first > error)
        error = first;
    if (second > error)
        error = second;
    walk->errors[place_of(walk, middle)] = error;
    return error;
}

static void refine(const struct walk *walk, size_t i, size_t j, float above)
{
    if (j - i < 2)
        return;
    size_t middle = i + (j - i) / 2;
    float error = subchain_error(walk, i, j);
    if (error > above)
        error = above;
    walk->errors[place_of(walk, middle)] = error;
    if (!((double)error > walk->enough))
        return;
    refine(walk, i, middle, error);
    refine(walk, middle, j, error);
}

void chain_errors(const float *positions, size_t count, enum halving form,
                  const struct chain_metric *metric, float *errors)
{
    struct walk walk = {positions, count - 1, polyline_runs_backwards(positions, count) != 0,
                        metric,    -1,        errors};
    errors[0] = errors[count - 1] = INFINITY;
    if (form == HALVING_BOTTOM_UP)
        keep_hierarchy(&walk, 0, count - 1);
    else
        refine(&walk, 0, count - 1, INFINITY);
}

void chain_errors_above(const float *positions, size_t count, double enough,
                        const struct chain_metric *metric, float *errors)
{
    struct walk walk = {positions, count - 1, polyline_runs_backwards(positions, count) != 0,
                        metric,    enough,    errors};
    memset(errors, 0, count * sizeof *errors);
    errors[0] = errors[count - 1] = INFINITY;
    refine(&walk, 0, count - 1, INFINITY);
}
