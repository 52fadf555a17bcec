/*
 * Does a loop cross or touch itself?
 *
 * Testing all pairs of edges is quadratic; a hash of grid cells is quick for short edges, but a
 * comb of 30,000 long slanting teeth fills it up. So: convex loops, and those that go
 * round their middle as a star does, are recognised in one pass; of others small ones do test all
 * pairs, and large ones go through the sweep of Shamos and Hoey (1976). A vertical
 * line moves over the plane and meets the loop's points in order of x, then y. The edges that it
 * crosses are kept in a search tree from below to above, and whenever two become neighbours there,
 * they are tested. The first pair that touches ends the sweep, so the order in the tree is always
 * the true one. Vertical edges need no case of their own: ordering by x, then y, is the same as
 * turning the plane by an infinitely small angle.
 *
 * The tree is a treap whose priorities are a hash of the edge's number; its nodes also form a list
 * from below to above, which gives neighbours at once.
 */
#include "geom/simple_loop.h"

#include <string.h>

#include "base/memory.h"

enum { PAIRWISE_MAX = 24 }; /* corners up to which all pairs are tested */
#define NONE UINT32_MAX

/* ---- scratch and sorting ---- */

enum status scratch_reserve(struct context *ctx, struct scratch *scratch, size_t size)
{
    if (size <= scratch->size)
        return STATUS_OK;
    size_t wanted = size < 4096 ? 4096 : size + size / 2;
    scratch_clear(ctx, scratch);
    enum status status = memory_take(ctx, wanted, 1, &scratch->block);
    if (status == STATUS_OK)
        scratch->size = wanted;
    return status;
}

void scratch_clear(struct context *ctx, struct scratch *scratch)
{
    memory_release(ctx, &scratch->block, scratch->size, 1);
    scratch->size = 0;
}

static bool key_before(struct grid_key a, struct grid_key b)
{
    return a.key != b.key ? a.key < b.key : a.index < b.index;
}

static void merge_runs(const struct grid_key *from, struct grid_key *to, uint32_t middle,
                       uint32_t end)
{
    uint32_t left = 0, right = middle;
    for (uint32_t out = 0; out < end; out++) {
        bool takes_left = right == end || (left < middle && !key_before(from[right], from[left]));
        to[out] = takes_left ? from[left++] : from[right++];
    }
}

void sort_grid_keys(struct grid_key *keys, struct grid_key *other, uint32_t count)
{
    struct grid_key *from = keys, *to = other;
    for (uint64_t run = 1; run < count; run *= 2) {
        for (uint64_t at = 0; at < count; at += 2 * run) {
            uint64_t left = count - at;
            uint64_t end = left < 2 * run ? left : 2 * run;
            merge_runs(from + at, to + at, (uint32_t)(end < run ? end : run), (uint32_t)end);
        }
        struct grid_key *swap = from;
        from = to;
        to = swap;
    }
    if (from != keys && count)
        memcpy(keys, from, count * sizeof *keys);
}

void sort_grid_points(const struct grid_point *points, uint32_t count, struct grid_key *order)
{
    for (uint32_t i = 0; i < count; i++)
        order[i] = (struct grid_key){(uint64_t)points[i].x << 31 | (uint32_t)points[i].y, i};
    sort_grid_keys(order, order + count, count);
}

/* ---- convex and small loops ---- */

static uint32_t after(uint32_t i, uint32_t n)
{
    return i + 1 == n ? 0 : i + 1;
}

/* Directions below this are in the first half turn. */
static bool points_down(struct grid_point a, struct grid_point b)
{
    return b.y < a.y || (b.y == a.y && b.x < a.x);
}

/* Never turns right, never back, and goes round once. */
static bool is_convex(const struct grid_point *points, uint32_t n)
{
    unsigned rounds = 0;
    struct grid_point a = points[n - 2], b = points[n - 1];
    for (uint32_t i = 0; i < n; i++) {
        struct grid_point c = points[i];
        int64_t turn = orientation(a, b, c);
        if (turn < 0 || (turn == 0 && grid_dot(b, a, c) >= 0))
            return false;
        rounds += points_down(a, b) && !points_down(b, c);
        a = b;
        b = c;
    }
    return rounds == 1;
}

/* Seen from the mean of its points it goes round once and never back: so most loops of patches do.
 */
static bool is_star(const struct grid_point *points, uint32_t n)
{
    int64_t x = 0, y = 0;
    for (uint32_t i = 0; i < n; i++) {
        x += points[i].x;
        y += points[i].y;
    }
    const struct grid_point mean = {(int32_t)(x / n), (int32_t)(y / n)};
    unsigned rounds = 0;
    struct grid_point a = points[n - 1];
    bool was_down = points_down(mean, a);
    for (uint32_t i = 0; i < n; i++) {
        const struct grid_point b = points[i];
        const bool is_down = points_down(mean, b);
        if (orientation(mean, a, b) <= 0)
            return false;
        rounds += was_down && !is_down;
        was_down = is_down;
        a = b;
    }
    return rounds == 1;
}

/* Edge i runs from point i to the next. */
static bool edges_clash(const struct grid_point *points, uint32_t n, uint32_t i, uint32_t j)
{
    uint32_t i_end = after(i, n), j_end = after(j, n);
    if (i_end == j)
        return edges_overlap(points[j], points[i], points[j_end]);
    if (j_end == i)
        return edges_overlap(points[i], points[j], points[i_end]);
    return segments_touch(points[i], points[i_end], points[j], points[j_end]);
}

/* Edges i and i + 1 turn back into each other? */
static bool folds_after(const struct grid_point *points, uint32_t n, uint32_t i)
{
    const uint32_t at = after(i, n);
    return edges_overlap(points[at], points[i], points[after(at, n)]);
}

/* Most pairs are told apart by the line of one of them, and on which side of a line a point lies is
 * the same question for both edges that it ends. */
static bool all_pairs_are_clear(const struct grid_point *points, uint32_t n)
{
    for (uint32_t i = 0; i < n; i++)
        if (folds_after(points, n, i))
            return false;
    for (uint32_t i = 0; i + 2 < n; i++) {
        const struct grid_point a = points[i], b = points[i + 1];
        const uint32_t end = i == 0 ? n - 1 : n; /* the last edge ends where the first begins */
        int64_t side = orientation(a, b, points[i + 2]);
        for (uint32_t j = i + 2; j < end; j++) {
            const struct grid_point c = points[j], d = points[after(j, n)];
            const int64_t next_side = orientation(a, b, d);
            const bool is_apart = (side > 0 && next_side > 0) || (side < 0 && next_side < 0);
            if (!is_apart && segments_touch(a, b, c, d))
                return false;
            side = next_side;
        }
    }
    /* A triangle's edges are all neighbours of each other, twice: it must only not be flat. */
    return n > 3 || orientation(points[0], points[1], points[2]) != 0;
}

/* ---- the sweep ---- */

struct sweep {
    const struct grid_point *points;
    uint32_t n;
    uint32_t root;
    /* By node: */
    uint32_t *left, *right, *parent; /* the treap */
    uint32_t *below, *above;         /* the list */
    uint32_t *edge;                  /* the edge that the node stands for now */
    /* By edge: */
    uint32_t *node;
};

static uint32_t priority(uint32_t node)
{
    uint32_t x = node * 0x9e3779b1u;
    x ^= x >> 15;
    x *= 0x85ebca77u;
    return x ^ x >> 13;
}

/* The node takes the place of its child in the eyes of the child's grandparent. */
static void replace_child(struct sweep *sweep, uint32_t parent, uint32_t old, uint32_t new)
{
    if (parent == NONE)
        sweep->root = new;
    else if (sweep->left[parent] == old)
        sweep->left[parent] = new;
    else
        sweep->right[parent] = new;
    if (new != NONE)
        sweep->parent[new] = parent;
}

/* Turns the edge between a node and its parent. */
static void lift(struct sweep *sweep, uint32_t node)
{
    uint32_t parent = sweep->parent[node], grandparent = sweep->parent[parent];
    bool is_left = sweep->left[parent] == node;
    uint32_t *towards = is_left ? sweep->left : sweep->right;
    uint32_t *away = is_left ? sweep->right : sweep->left;
    uint32_t moved = away[node];
    towards[parent] = moved;
    if (moved != NONE)
        sweep->parent[moved] = parent;
    replace_child(sweep, grandparent, parent, node);
    away[node] = parent;
    sweep->parent[parent] = node;
}

/* Inserts a node for `edge` directly above the node `below` (NONE: lowest of all). */
static void insert_above(struct sweep *sweep, uint32_t edge, uint32_t below)
{
    uint32_t node = edge, above;
    sweep->left[node] = sweep->right[node] = NONE;
    sweep->edge[node] = edge;
    sweep->node[edge] = node;
    if (below != NONE) {
        above = sweep->above[below];
    } else {
        above = sweep->root;
        while (above != NONE && sweep->left[above] != NONE)
            above = sweep->left[above];
    }
    sweep->below[node] = below;
    sweep->above[node] = above;
    if (below != NONE)
        sweep->above[below] = node;
    if (above != NONE)
        sweep->below[above] = node;

    /* Of two neighbours in order, one has no child on the side of the other. */
    if (below != NONE && sweep->right[below] == NONE) {
        sweep->right[below] = node;
        sweep->parent[node] = below;
    } else if (above != NONE) {
        sweep->left[above] = node;
        sweep->parent[node] = above;
    } else {
        sweep->root = node;
        sweep->parent[node] = NONE;
    }
    while (sweep->parent[node] != NONE && priority(sweep->parent[node]) < priority(node))
        lift(sweep, node);
}

static void remove_node(struct sweep *sweep, uint32_t node)
{
    while (sweep->left[node] != NONE && sweep->right[node] != NONE) {
        uint32_t left = sweep->left[node], right = sweep->right[node];
        lift(sweep, priority(left) > priority(right) ? left : right);
    }
    uint32_t child = sweep->left[node] != NONE ? sweep->left[node] : sweep->right[node];
    replace_child(sweep, sweep->parent[node], node, child);
    if (sweep->below[node] != NONE)
        sweep->above[sweep->below[node]] = sweep->above[node];
    if (sweep->above[node] != NONE)
        sweep->below[sweep->above[node]] = sweep->below[node];
}

/* Finds the highest node below the point p. False when p lies on an edge. */
static bool locate(const struct sweep *sweep, struct grid_point p, uint32_t *below)
{
    *below = NONE;
    for (uint32_t node = sweep->root; node != NONE;) {
        uint32_t edge = sweep->edge[node];
        struct grid_point a = sweep->points[edge], b = sweep->points[after(edge, sweep->n)];
        int64_t side = grid_before(a, b) ? orientation(a, b, p) : orientation(b, a, p);
        if (side == 0)
            return false;
        if (side > 0) {
            *below = node;
            node = sweep->right[node];
        } else {
            node = sweep->left[node];
        }
    }
    return true;
}

/* True when either node is missing or their edges keep clear of each other. */
static bool are_clear(const struct sweep *sweep, uint32_t a, uint32_t b)
{
    return a == NONE || b == NONE ||
           !edges_clash(sweep->points, sweep->n, sweep->edge[a], sweep->edge[b]);
}

/* Both edges of a point begin at it. */
static bool begin_both(struct sweep *sweep, uint32_t point, uint32_t before, uint32_t next)
{
    uint32_t below;
    struct grid_point p = sweep->points[point];
    if (!locate(sweep, p, &below))
        return false;
    int64_t turn = orientation(p, sweep->points[next], sweep->points[before]);
    if (turn == 0)
        return false;                           /* both run to the right of p, in line */
    uint32_t lower = turn > 0 ? point : before; /* edges: `point` runs to next */
    uint32_t upper = turn > 0 ? before : point;
    insert_above(sweep, lower, below);
    insert_above(sweep, upper, sweep->node[lower]);
    return are_clear(sweep, below, sweep->node[lower]) &&
           are_clear(sweep, sweep->node[upper], sweep->above[sweep->node[upper]]);
}

static bool end_both(struct sweep *sweep, uint32_t point, uint32_t before)
{
    uint32_t a = sweep->node[point], b = sweep->node[before];
    if (sweep->above[a] != b && sweep->above[b] != a)
        return false; /* what is between them goes through the point */
    uint32_t below = sweep->above[a] == b ? sweep->below[a] : sweep->below[b];
    uint32_t above = sweep->above[a] == b ? sweep->above[b] : sweep->above[a];
    remove_node(sweep, a);
    remove_node(sweep, b);
    return are_clear(sweep, below, above);
}

/* One edge ends and the other takes its place. */
static bool go_on(struct sweep *sweep, uint32_t ending, uint32_t beginning)
{
    uint32_t node = sweep->node[ending];
    sweep->edge[node] = beginning;
    sweep->node[beginning] = node;
    return are_clear(sweep, sweep->below[node], node) && are_clear(sweep, node, sweep->above[node]);
}

static bool sweep_finds_nothing(struct sweep *sweep, const struct grid_key *order)
{
    for (uint32_t i = 1; i < sweep->n; i++)
        if (order[i].key == order[i - 1].key)
            return false; /* two points in one place; from here on every edge has a length */
    for (uint32_t i = 0; i < sweep->n; i++) {
        uint32_t point = order[i].index, next = after(point, sweep->n);
        uint32_t before = point == 0 ? sweep->n - 1 : point - 1;
        struct grid_point p = sweep->points[point];
        bool ends_at_next = grid_before(p, sweep->points[next]);
        bool ends_at_before = grid_before(p, sweep->points[before]);
        bool clear;
        if (ends_at_next && ends_at_before)
            clear = begin_both(sweep, point, before, next);
        else if (!ends_at_next && !ends_at_before)
            clear = end_both(sweep, point, before);
        else
            clear = ends_at_next ? go_on(sweep, before, point) : go_on(sweep, point, before);
        if (!clear)
            return false;
    }
    return true;
}

enum status loop_is_simple(struct context *ctx, struct scratch *scratch,
                           const struct grid_point *points, uint32_t n, bool *simple)
{
    *simple = is_convex(points, n) || is_star(points, n);
    if (*simple)
        return STATUS_OK;
    if (n <= PAIRWISE_MAX) {
        *simple = all_pairs_are_clear(points, n);
        return STATUS_OK;
    }
    size_t key_bytes = (size_t)n * sizeof(struct grid_key), list_bytes = (size_t)n * 4;
    enum status status = scratch_reserve(ctx, scratch, 2 * key_bytes + 7 * list_bytes);
    if (status != STATUS_OK)
        return status;
    struct grid_key *order = (struct grid_key *)(void *)scratch->block;
    sort_grid_points(points, n, order);

    uint32_t *lists = (uint32_t *)(void *)(scratch->block + 2 * key_bytes);
    struct sweep sweep = {.points = points,
                          .n = n,
                          .root = NONE,
                          .left = lists,
                          .right = lists + n,
                          .parent = lists + 2 * (size_t)n,
                          .below = lists + 3 * (size_t)n,
                          .above = lists + 4 * (size_t)n,
                          .edge = lists + 5 * (size_t)n,
                          .node = lists + 6 * (size_t)n};
    *simple = sweep_finds_nothing(&sweep, order);
    return STATUS_OK;
}
