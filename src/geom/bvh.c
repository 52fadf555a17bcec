/*
 * The tree is packed: a range of triangles is halved at a multiple of the subtree size (a power of
 * eight) nearest its middle, along the axis in which the triangles' centres spread most, until
 * eight are left. All places but the last of a level are full, so children need no pointers, and a
 * node is 24 bytes a child. Surface-area heuristics give trees that are a little better to search
 * and much slower to build; here most trees are over pieces of the original that few samples ask
 * about.
 *
 * White & Jain, "Similarity indexing: algorithms and performance" (1996) split R-trees this way
 * (VAMSplit). Triangles that lie along a space-filling curve may be taken as they come (Kamel &
 * Faloutsos, "On packing R-trees", 1993): a search then looks at a sixth more boxes, and building
 * takes a quarter of the time.
 *
 * Boxes are float32, relative to the median of the triangles and not to the middle of their box:
 * floats are densest at zero, and one stray vertex far away must not press all others into a few
 * steps. What rounding could do is made harmless in two places: boxes are widened by four steps of
 * float32 and by what distances of such coordinates are off in double, and the point that asks
 * stands for a small box of its own, so that a box is never found farther than its triangles are.
 */
#include "geom/bvh_internal.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/parallel.h"

/* A triangle while the tree is built: the centre of its box, in box coordinates. */
struct centre {
    float at[3];
    uint32_t triangle;
};

/* Of the largest coordinate, for what distances are off. */
static const double distance_slack = 0x1p-44;

enum { MEDIAN_SAMPLES = 255 };

/* Of two numbers that are numbers; the library's are calls. */
static inline double smaller(double a, double b)
{
    return a < b ? a : b;
}

static inline double larger(double a, double b)
{
    return a > b ? a : b;
}

static float centre_of(double a, double b, double c, double origin, double scale)
{
    double low = smaller(smaller(a, b), c), high = larger(larger(a, b), c);
    return (float)(((low - origin) + (high - origin)) * 0.5 * scale);
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The median of first corners, by coordinate, of a few triangles evenly spread over the input. */
static struct vec3 median_corner(const struct bvh *bvh)
{
    double values[3][MEDIAN_SAMPLES];
    uint32_t samples = bvh->count < MEDIAN_SAMPLES ? bvh->count : MEDIAN_SAMPLES;
    if (samples == 0)
        return (struct vec3){0, 0, 0};
    for (uint32_t i = 0; i < samples; i++) {
        struct triangle t = bvh_triangle(bvh, (uint32_t)((uint64_t)i * bvh->count / samples));
        values[0][i] = t.a.x;
        values[1][i] = t.a.y;
        values[2][i] = t.a.z;
    }
    for (unsigned k = 0; k < 3; k++)
        qsort(values[k], samples, sizeof **values, by_value);
    return (struct vec3){values[0][samples / 2], values[1][samples / 2], values[2][samples / 2]};
}

static double farthest(double low, double high, double origin)
{
    /* Halves first: the difference of two large coordinates must not overflow. */
    return larger(fabs(low * 0.5 - origin * 0.5), fabs(high * 0.5 - origin * 0.5));
}

static void take_in(struct vec3 *low, struct vec3 *high, const struct vec3 *p)
{
    *low = (struct vec3){smaller(low->x, p->x), smaller(low->y, p->y), smaller(low->z, p->z)};
    *high = (struct vec3){larger(high->x, p->x), larger(high->y, p->y), larger(high->z, p->z)};
}

static void choose_frame(struct bvh *bvh)
{
    struct vec3 low = {INFINITY, INFINITY, INFINITY}, high = {-INFINITY, -INFINITY, -INFINITY};
    double extent = 0, largest = 0;
    const struct vec3 o = bvh->origin = median_corner(bvh);
    for (uint32_t i = 0; i < bvh->count; i++) {
        const struct triangle t = bvh_triangle(bvh, i);
        take_in(&low, &high, &t.a);
        take_in(&low, &high, &t.b);
        take_in(&low, &high, &t.c);
    }
    if (bvh->count > 0) {
        extent = larger(larger(farthest(low.x, high.x, o.x), farthest(low.y, high.y, o.y)),
                        farthest(low.z, high.z, o.z));
        largest = larger(larger(farthest(low.x, high.x, 0), farthest(low.y, high.y, 0)),
                         farthest(low.z, high.z, 0));
    }
    int exponent = 0;
    if (extent > 0)
        frexp(extent, &exponent);
    /* Extents below 2^-500 are as good as a point. */
    bvh->scale = ldexp(1, exponent < -500 ? 500 : -exponent - 1);
    bvh->slack = largest * bvh->scale * 2 * distance_slack;
}

static void swap_centres(struct centre *a, struct centre *b)
{
    struct centre c = *a;
    *a = *b;
    *b = c;
}

/* Orders centres[0, count) so that the `first` smallest along the axis come first (Hoare's
 * selection; the pivot is the median of three at scattered places, so that no order of input that
 * occurs makes it slow). */
static void select_centres(struct centre *centres, size_t count, size_t first, unsigned axis)
{
    uint64_t state = count;
    while (count > 1 && first > 0 && first < count) {
        float pick[3];
        for (unsigned k = 0; k < 3; k++) {
            state = state * 6364136223846793005u + 1442695040888963407u;
            pick[k] = centres[(state >> 33) % count].at[axis];
        }
        float small = pick[0] < pick[1] ? pick[0] : pick[1];
        float large = pick[0] < pick[1] ? pick[1] : pick[0];
        float pivot = pick[2] < small ? small : pick[2] > large ? large : pick[2];

        size_t left = 0, right = count - 1;
        for (;;) {
            while (centres[left].at[axis] < pivot)
                left++;
            while (centres[right].at[axis] > pivot)
                right--;
            if (left >= right)
                break;
            swap_centres(&centres[left++], &centres[right--]);
        }
        /* [0, left) is not above the pivot, [left, count) not below it. */
        if (left == 0)
            left = 1; /* the pivot itself, which is the smallest, stands at 0 */
        if (first == left)
            return;
        if (first < left) {
            count = left;
        } else {
            centres += left;
            count -= left;
            first -= left;
        }
    }
}

static unsigned widest_axis(const struct centre *centres, size_t count)
{
    float low[3], high[3];
    memcpy(low, centres[0].at, sizeof low);
    memcpy(high, centres[0].at, sizeof high);
    for (size_t i = 1; i < count; i++) {
        for (unsigned k = 0; k < 3; k++) {
            float at = centres[i].at[k];
            low[k] = at < low[k] ? at : low[k];
            high[k] = at > high[k] ? at : high[k];
        }
    }
    unsigned axis = high[1] - low[1] > high[0] - low[0] ? 1 : 0;
    return high[2] - low[2] > high[axis] - low[axis] ? 2 : axis;
}

/* Halves a range of more than BVH_WIDTH centres; returns how many come first. */
static size_t halve(struct centre *centres, size_t count)
{
    size_t unit = BVH_WIDTH;
    while (unit * BVH_WIDTH < count)
        unit *= BVH_WIDTH;
    const size_t children = (count + unit - 1) / unit, first = children / 2 * unit;
    select_centres(centres, count, first, widest_axis(centres, count));
    return first;
}

/* Puts the triangles of a subtree in order. The depth is at most 3 calls a level. */
static void split(struct centre *centres, size_t count)
{
    if (count <= BVH_WIDTH)
        return;
    const size_t first = halve(centres, count);
    split(centres, first);
    split(centres + first, count - first);
}

/* The box coordinates that three corners lie between for certain. (Rounding keeps their order.) */
static void bound(double a, double b, double c, const struct bvh *bvh, double origin, float *low,
                  float *high)
{
    const double least = smaller(smaller(a, b), c), most = larger(larger(a, b), c);
    *low = below((least - origin) * bvh->scale, bvh->slack);
    *high = above((most - origin) * bvh->scale, bvh->slack);
}

static void empty_node(struct bvh_node *node)
{
    for (unsigned k = 0; k < 3; k++) {
        for (unsigned i = 0; i < BVH_WIDTH; i++) {
            node->low[k][i] = INFINITY;
            node->high[k][i] = -INFINITY;
        }
    }
}

static void bound_triangles(struct bvh *bvh, uint32_t first, uint32_t end)
{
    for (uint32_t i = first; i < end; i++) {
        struct bvh_node *node = &bvh->nodes[i / BVH_WIDTH];
        unsigned place = i % BVH_WIDTH;
        const struct triangle t = bvh_triangle(bvh, triangle_at(bvh, i));
        const struct vec3 *o = &bvh->origin;
        bound(t.a.x, t.b.x, t.c.x, bvh, o->x, &node->low[0][place], &node->high[0][place]);
        bound(t.a.y, t.b.y, t.c.y, bvh, o->y, &node->low[1][place], &node->high[1][place]);
        bound(t.a.z, t.b.z, t.c.z, bvh, o->z, &node->low[2][place], &node->high[2][place]);
    }
}

static void bound_level(struct bvh *bvh, uint32_t level)
{
    uint32_t first = bvh->level_first[level], below = bvh->level_first[level - 1];
    for (uint32_t child = below; child < first; child++) {
        struct bvh_node *node = &bvh->nodes[first + (child - below) / BVH_WIDTH];
        unsigned place = (child - below) % BVH_WIDTH;
        const struct bvh_node *from = &bvh->nodes[child];
        for (unsigned k = 0; k < 3; k++) {
            float low = INFINITY, high = -INFINITY;
            for (unsigned i = 0; i < BVH_WIDTH; i++) {
                low = from->low[k][i] < low ? from->low[k][i] : low;
                high = from->high[k][i] > high ? from->high[k][i] : high;
            }
            node->low[k][place] = low;
            node->high[k][place] = high;
        }
    }
}

/* Sets the levels' places; the tree has at least its root. */
static void lay_out(struct bvh *bvh)
{
    uint32_t nodes = (bvh->count + (BVH_WIDTH - 1)) / BVH_WIDTH;
    bvh->node_count = 0;
    bvh->level_count = 0;
    for (;;) {
        bvh->level_first[bvh->level_count++] = bvh->node_count;
        bvh->node_count += nodes ? nodes : 1;
        if (nodes <= 1)
            return;
        nodes = (nodes + (BVH_WIDTH - 1)) / BVH_WIDTH;
    }
}

/* ---- in several threads ---- */

/* What is halved by one thread before several go on, and from how many triangles on. */
enum { SHARED_DEPTH = 3, SHARED_MAX = 1 << SHARED_DEPTH, SHARED_LEAST = 1 << 12 };
enum { STRETCH = 1 << 10 }; /* triangles, whole nodes */

struct building {
    struct bvh *bvh;
    struct centre *centres; /* NULL: the triangles lie in order already */
    size_t firsts[SHARED_MAX], counts[SHARED_MAX];
    uint32_t ranges;
};

static void split_top(struct building *building, size_t first, size_t count, unsigned depth)
{
    if (depth == 0 || count < SHARED_LEAST / SHARED_MAX) {
        building->firsts[building->ranges] = first;
        building->counts[building->ranges++] = count;
        return;
    }
    const size_t left = halve(building->centres + first, count);
    split_top(building, first, left, depth - 1);
    split_top(building, first + left, count - left, depth - 1);
}

static enum status split_range(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct building *building = user;
    split(building->centres + building->firsts[job], building->counts[job]);
    return STATUS_OK;
}

static uint32_t end_of_stretch(const struct bvh *bvh, uint64_t job)
{
    const uint64_t end = (job + 1) * STRETCH;
    return end < bvh->count ? (uint32_t)end : bvh->count;
}

static enum status find_centres(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct building *building = user;
    const struct bvh *bvh = building->bvh;
    const struct vec3 *o = &bvh->origin;
    for (uint32_t i = (uint32_t)(job * STRETCH); i < end_of_stretch(bvh, job); i++) {
        struct triangle t = bvh_triangle(bvh, i);
        building->centres[i] = (struct centre){{centre_of(t.a.x, t.b.x, t.c.x, o->x, bvh->scale),
                                                centre_of(t.a.y, t.b.y, t.c.y, o->y, bvh->scale),
                                                centre_of(t.a.z, t.b.z, t.c.z, o->z, bvh->scale)},
                                               i};
    }
    return STATUS_OK;
}

static enum status fill_stretch(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct building *building = user;
    struct bvh *bvh = building->bvh;
    const uint32_t first = (uint32_t)(job * STRETCH), end = end_of_stretch(bvh, job);
    for (uint32_t i = first; i < end && building->centres; i++)
        bvh->order[i] = building->centres[i].triangle;
    bound_triangles(bvh, first, end);
    return STATUS_OK;
}

/* All jobs, on threads of their own where there are enough triangles. */
static enum status run_jobs(struct context *ctx, bool together, uint64_t jobs,
                            enum status (*work)(void *user, uint64_t job, unsigned worker),
                            struct building *building)
{
    if (together && building->bvh->count >= SHARED_LEAST)
        return parallel_for(ctx, jobs, work, building);
    for (uint64_t job = 0; job < jobs; job++)
        (void)work(building, job, 0);
    return STATUS_OK;
}

/* Puts the triangles in order. */
static enum status sort(struct context *ctx, bool together, uint64_t stretches,
                        struct building *building)
{
    struct bvh *bvh = building->bvh;
    enum status status = memory_take(ctx, bvh->count, sizeof *bvh->order, &bvh->order);
    if (status == STATUS_OK)
        status = memory_take(ctx, bvh->count, sizeof *building->centres, &building->centres);
    if (status == STATUS_OK)
        status = run_jobs(ctx, together, stretches, find_centres, building);
    if (status != STATUS_OK)
        return status;
    split_top(building, 0, bvh->count, together ? SHARED_DEPTH : 0);
    return run_jobs(ctx, together, building->ranges, split_range, building);
}

static enum status build(struct context *ctx, const double *positions, const uint32_t *faces,
                         bool is_sorted, uint32_t count, bool together, struct bvh *bvh)
{
    memset(bvh, 0, sizeof *bvh);
    bvh->count = count;
    bvh->level = cpu_level(ctx);
    bvh->positions = positions;
    bvh->faces = faces;
    lay_out(bvh);

    const uint64_t stretches = ((uint64_t)count + STRETCH - 1) / STRETCH;
    struct building building = {.bvh = bvh};
    choose_frame(bvh);
    enum status status = memory_take(ctx, bvh->node_count, sizeof *bvh->nodes, &bvh->nodes);
    for (uint32_t i = 0; i < bvh->node_count && status == STATUS_OK; i++)
        empty_node(&bvh->nodes[i]);
    if (status == STATUS_OK && !is_sorted)
        status = sort(ctx, together, stretches, &building);
    if (status == STATUS_OK)
        status = run_jobs(ctx, together, stretches, fill_stretch, &building);
    for (uint32_t level = 1; level < bvh->level_count && status == STATUS_OK; level++)
        bound_level(bvh, level);
    memory_release(ctx, &building.centres, count, sizeof *building.centres);
    if (status != STATUS_OK)
        bvh_clear(ctx, bvh);
    return status;
}

enum status bvh_build(struct context *ctx, const double *positions, const uint32_t *faces,
                      uint32_t count, bool together, struct bvh *bvh)
{
    return build(ctx, positions, faces, false, count, together, bvh);
}

enum status bvh_build_sorted(struct context *ctx, const double *positions, const uint32_t *faces,
                             uint32_t count, bool together, struct bvh *bvh)
{
    return build(ctx, positions, faces, true, count, together, bvh);
}

enum status bvh_copy(struct context *ctx, const struct bvh *from, const double *positions,
                     const uint32_t *faces, struct bvh *bvh)
{
    *bvh = *from;
    bvh->positions = positions;
    bvh->faces = faces;
    bvh->order = NULL;
    bvh->nodes = NULL;
    enum status status = memory_take(ctx, bvh->node_count, sizeof *bvh->nodes, &bvh->nodes);
    if (status == STATUS_OK && from->order)
        status = memory_take(ctx, bvh->count, sizeof *bvh->order, &bvh->order);
    if (status != STATUS_OK) {
        bvh_clear(ctx, bvh);
        return status;
    }
    if (from->order)
        memcpy(bvh->order, from->order, bvh->count * sizeof *bvh->order);
    memcpy(bvh->nodes, from->nodes, bvh->node_count * sizeof *bvh->nodes);
    return STATUS_OK;
}

void bvh_clear(struct context *ctx, struct bvh *bvh)
{
    memory_release(ctx, &bvh->order, bvh->count, sizeof *bvh->order);
    memory_release(ctx, &bvh->nodes, bvh->node_count, sizeof *bvh->nodes);
    memset(bvh, 0, sizeof *bvh);
}
