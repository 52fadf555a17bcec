/*
 * Searching a hierarchy of boxes.
 *
 * By depth, the nearest child first: Roussopoulos et al., "Nearest neighbor queries" (1995). Where
 * it is only asked whether a triangle is near, any that is ends the search, and points that come
 * one behind the other are mostly near the same: so it begins where the last one was found, and
 * goes up from there. A node's eight boxes are looked at at once.
 */
#include "geom/bvh_internal.h"

#include "base/lanes.h"

/* A box of box coordinates that holds the point, or the box, that asks. */
struct query {
    float low[3], high[3];
};

/* Far away, where squares would overflow, a nearer point gives a valid bound just as well. */
static double clamp(double value)
{
    return value > 0x1p50 ? 0x1p50 : value < -0x1p50 ? -0x1p50 : value;
}

static struct query query_of(const struct bvh *bvh, struct vec3 low, struct vec3 high)
{
    struct vec3 from = vec3_scale(vec3_sub(low, bvh->origin), bvh->scale);
    struct vec3 to = vec3_scale(vec3_sub(high, bvh->origin), bvh->scale);
    double slack = bvh->slack;
    return (struct query){
        {below(clamp(from.x), slack), below(clamp(from.y), slack), below(clamp(from.z), slack)},
        {above(clamp(to.x), slack), above(clamp(to.y), slack), above(clamp(to.z), slack)}};
}

/* Squared distances between the query's box and the node's eight. */
LANES_INLINE float8 box_squares(const struct bvh_node *node, const struct query *query)
{
    float8 sum = lanes_all(0);
    for (unsigned k = 0; k < 3; k++) {
        const float8 left = lanes_load(node->low[k]) - lanes_all(query->high[k]);
        const float8 right = lanes_all(query->low[k]) - lanes_load(node->high[k]);
        const float8 either = lanes_choose(left > right, left, right);
        const float8 apart = lanes_where(either > 0, either);
        sum += apart * apart;
    }
    return sum;
}

LANES_INLINE void box_distances(const struct bvh_node *node, const struct query *query,
                                float distances[BVH_WIDTH])
{
    lanes_store(distances, box_squares(node, query));
}

struct pending {
    float distance;
    uint32_t node; /* within its level */
    uint32_t level;
};

enum { PENDING_MAX = BVH_LEVELS_MAX * (BVH_WIDTH - 1) + 1 };

/* Nodes that are still to be looked at, the root at first; returns how many. */
static unsigned begin_at_root(const struct bvh *bvh, struct pending stack[PENDING_MAX])
{
    stack[0] = (struct pending){0, 0, bvh->level_count - 1};
    return bvh->count > 0;
}

static inline const struct bvh_node *node_of(const struct bvh *bvh, struct pending pending)
{
    return &bvh->nodes[bvh->level_first[pending.level] + pending.node];
}

/* The boxes not farther than `bound`, nearest first. */
static unsigned sort_near(const float *distances, float bound, unsigned *places)
{
    unsigned count = 0;
    for (unsigned i = 0; i < BVH_WIDTH; i++) {
        if (!(distances[i] <= bound) || distances[i] == INFINITY)
            continue;
        unsigned at = count++;
        for (; at > 0 && distances[places[at - 1]] > distances[i]; at--)
            places[at] = places[at - 1];
        places[at] = i;
    }
    return count;
}

/* In box units, rounded up. */
static float bound_of(const struct bvh *bvh, double distance_squared)
{
    double bound = distance_squared * bvh->scale * bvh->scale * (1 + 0x1p-20) + 1e-30;
    return bound < 1e38 ? (float)bound : 3.0e38f;
}

LANES_INLINE void search_in_lanes(const struct bvh *bvh, struct vec3 p, struct nearest *nearest)
{
    struct query query = query_of(bvh, p, p);
    float bound = bound_of(bvh, nearest->distance_squared);
    struct pending stack[PENDING_MAX];
    unsigned used = begin_at_root(bvh, stack);
    while (used > 0) {
        struct pending top = stack[--used];
        if (top.distance > bound)
            continue;
        const struct bvh_node *node = node_of(bvh, top);
        float distances[BVH_WIDTH];
        unsigned places[BVH_WIDTH];
        box_distances(node, &query, distances);
        unsigned count = sort_near(distances, bound, places);
        if (top.level > 0) {
            while (count-- > 0)
                stack[used++] = (struct pending){
                    distances[places[count]], top.node * BVH_WIDTH + places[count], top.level - 1};
            continue;
        }
        for (unsigned i = 0; i < count && distances[places[i]] <= bound; i++) {
            uint32_t number = triangle_at(bvh, top.node * BVH_WIDTH + places[i]);
            struct triangle t = bvh_triangle(bvh, number);
            struct vec3 point;
            double distance = triangle_distance_squared(p, &t, &point);
            if (distance < nearest->distance_squared ||
                (distance == nearest->distance_squared && number < nearest->triangle)) {
                *nearest = (struct nearest){distance, number, point};
                bound = bound_of(bvh, distance);
            }
        }
    }
}

static void search_scalar(const struct bvh *bvh, struct vec3 p, struct nearest *nearest)
{
    search_in_lanes(bvh, p, nearest);
}

LANES_AVX2 static void search_avx2(const struct bvh *bvh, struct vec3 p, struct nearest *nearest)
{
    search_in_lanes(bvh, p, nearest);
}

void bvh_nearest(const struct bvh *bvh, struct vec3 p, struct nearest *nearest)
{
    if (bvh->level >= CPU_AVX2)
        search_avx2(bvh, p, nearest);
    else
        search_scalar(bvh, p, nearest);
}

/* ---- is any triangle near? ---- */

/* The boxes of a node that are not farther than `bound`, but for the place `except`: a bit each,
 * and the place of one of the nearest. */
struct near_boxes {
    unsigned all, nearest;
};

LANES_INLINE struct near_boxes boxes_within(const struct bvh_node *node, const struct query *query,
                                            float bound, unsigned except)
{
    const float8 squares = box_squares(node, query);
    const int8x32 within =
        (squares <= bound) & (squares < (float)INFINITY) & (lanes_count_from(0) != (int32_t)except);
    const unsigned all = lanes_bits(within);
    if ((all & (all - 1)) == 0)
        return (struct near_boxes){all, all ? lowest_bit(all) : 0};
    const float8 near = lanes_choose(within, squares, lanes_all(INFINITY));
    return (struct near_boxes){all, lowest_bit(lanes_bits(near == lanes_all_least(near)))};
}

/* Whether one of a lowest node's triangles is near enough: the nearest box comes first. */
LANES_INLINE bool leaf_is_near(const struct bvh *bvh, uint32_t leaf, struct near_boxes near,
                               struct vec3 p, double square)
{
    const uint32_t first = leaf * BVH_WIDTH;
    unsigned others = near.all & ~(1u << near.nearest);
    for (unsigned next = near.nearest;; others &= others - 1) {
        const struct triangle t = bvh_triangle(bvh, triangle_at(bvh, first + next));
        if (triangle_distance_squared(p, &t, NULL) <= square)
            return true;
        if (others == 0)
            return false;
        next = lowest_bit(others);
    }
}

/* Whether a triangle is near enough below a node, but for its child `except` (BVH_WIDTH: none is
 * left out). Any that is near enough will do, so that the order matters to the time alone: at each
 * node the nearest box comes first, the others as they are. */
LANES_INLINE bool below_is_near(const struct bvh *bvh, struct pending start, unsigned except,
                                const struct query *query, float bound, struct vec3 p,
                                double square, uint32_t *leaf)
{
    struct pending stack[PENDING_MAX];
    unsigned used = 0;
    for (struct pending top = start;; top = stack[--used]) {
        const struct bvh_node *node = node_of(bvh, top);
        const struct near_boxes near = boxes_within(node, query, bound, except);
        except = BVH_WIDTH;
        if (near.all != 0 && top.level == 0) {
            if (leaf_is_near(bvh, top.node, near, p, square)) {
                *leaf = top.node;
                return true;
            }
        } else if (near.all != 0) {
            const uint32_t first = top.node * BVH_WIDTH;
            unsigned others = near.all & ~(1u << near.nearest);
            for (; others != 0; others &= others - 1)
                stack[used++] = (struct pending){0, first + lowest_bit(others), top.level - 1};
            stack[used++] = (struct pending){0, first + near.nearest, top.level - 1};
        }
        if (used == 0)
            return false;
    }
}

/* From the root down, or from the leaf where the point before was near: up from there, and at each
 * step down to the other children. */
LANES_INLINE bool near_in_lanes(const struct bvh *bvh, struct vec3 p, double square, uint32_t *leaf)
{
    const struct query query = query_of(bvh, p, p);
    const float bound = bound_of(bvh, square);
    if (bvh->count == 0)
        return false;
    struct pending at = {0, 0, bvh->level_count - 1};
    unsigned except = BVH_WIDTH;
    if (*leaf != UINT32_MAX)
        at = (struct pending){0, *leaf, 0};
    for (;;) {
        if (below_is_near(bvh, at, except, &query, bound, p, square, leaf))
            return true;
        if (at.level + 1 == bvh->level_count)
            return false;
        except = at.node % BVH_WIDTH;
        at = (struct pending){0, at.node / BVH_WIDTH, at.level + 1};
    }
}

static bool near_scalar(const struct bvh *bvh, struct vec3 p, double square, uint32_t *leaf)
{
    return near_in_lanes(bvh, p, square, leaf);
}

LANES_AVX2 static bool near_avx2(const struct bvh *bvh, struct vec3 p, double square,
                                 uint32_t *leaf)
{
    return near_in_lanes(bvh, p, square, leaf);
}

bool bvh_is_near(const struct bvh *bvh, struct vec3 p, double square, uint32_t *leaf)
{
    return bvh->level >= CPU_AVX2 ? near_avx2(bvh, p, square, leaf)
                                  : near_scalar(bvh, p, square, leaf);
}

void bvh_touching(const struct bvh *bvh, struct vec3 low, struct vec3 high,
                  bool (*visit)(void *user, uint32_t triangle), void *user)
{
    struct query query = query_of(bvh, low, high);
    struct pending stack[PENDING_MAX];
    unsigned used = begin_at_root(bvh, stack);
    while (used > 0) {
        struct pending top = stack[--used];
        const struct bvh_node *node = node_of(bvh, top);
        float distances[BVH_WIDTH];
        box_distances(node, &query, distances);
        for (unsigned i = 0; i < BVH_WIDTH; i++) {
            if (distances[i] > 0)
                continue;
            if (top.level > 0)
                stack[used++] = (struct pending){0, top.node * BVH_WIDTH + i, top.level - 1};
            else if (!visit(user, triangle_at(bvh, top.node * BVH_WIDTH + i)))
                return;
        }
    }
}
