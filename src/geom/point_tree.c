/*
 * Which reflex corner lies in this ear?
 *
 * Looking at all reflex corners for every ear makes ear cutting quadratic. A uniform grid of
 * buckets answers quickly only while the corners are spread evenly. Here the points are sorted once
 * along a Z-order curve (bits of x and y interleaved) and cut into groups of eight, whose bounding
 * boxes are grouped by eight again, and so on: a tree without pointers. Boxes hold only the points
 * that are on; when a point is switched, the boxes above it are made anew from their eight parts,
 * and only as far up as they change.
 */
#include "geom/point_tree.h"

enum { FANOUT = POINT_TREE_FANOUT };

static uint32_t groups_of(uint32_t count)
{
    return count / FANOUT + (count % FANOUT != 0);
}

static size_t box_count(uint32_t count)
{
    size_t boxes = 0;
    do {
        count = groups_of(count);
        boxes += count;
    } while (count > 1);
    return boxes;
}

static size_t keys_size(uint32_t count)
{
    return 2 * (size_t)count * sizeof(struct grid_key);
}

static size_t arrays_size(uint32_t count)
{
    return 2 * (size_t)count * sizeof(uint32_t) + box_count(count) * sizeof(struct point_box);
}

/* The sort keys lie where the boxes come afterwards, behind order and rank. */
size_t point_tree_size(uint32_t count)
{
    size_t keys = 2 * (size_t)count * sizeof(uint32_t) + keys_size(count),
           arrays = arrays_size(count);
    return keys > arrays ? keys : arrays;
}

/* The bits of a 31-bit number, moved apart to every second place. */
static uint64_t spread_bits(uint32_t value)
{
    uint64_t bits = value;
    bits = (bits | bits << 16) & 0x0000ffff0000ffffu;
    bits = (bits | bits << 8) & 0x00ff00ff00ff00ffu;
    bits = (bits | bits << 4) & 0x0f0f0f0f0f0f0f0fu;
    bits = (bits | bits << 2) & 0x3333333333333333u;
    bits = (bits | bits << 1) & 0x5555555555555555u;
    return bits;
}

static const struct point_box empty_box = {INT32_MAX, INT32_MAX, INT32_MIN, INT32_MIN};

static void include(struct point_box *box, const struct point_box *part)
{
    box->x_low = part->x_low < box->x_low ? part->x_low : box->x_low;
    box->y_low = part->y_low < box->y_low ? part->y_low : box->y_low;
    box->x_high = part->x_high > box->x_high ? part->x_high : box->x_high;
    box->y_high = part->y_high > box->y_high ? part->y_high : box->y_high;
}

static struct point_box box_of_group(const struct point_tree *tree, unsigned level, uint32_t group)
{
    struct point_box box = empty_box;
    uint32_t parts = level == 0 ? tree->count : tree->level_count[level - 1];
    uint32_t first = group * FANOUT, end = parts - first < FANOUT ? parts : first + FANOUT;
    for (uint32_t i = first; i < end; i++) {
        if (level > 0) {
            include(&box, &tree->level[level - 1][i]);
        } else if (tree->is_on[tree->order[i]]) {
            struct grid_point p = tree->points[tree->order[i]];
            include(&box, &(struct point_box){p.x, p.y, p.x, p.y});
        }
    }
    return box;
}

void point_tree_build(struct point_tree *tree, const struct grid_point *points, uint32_t count,
                      uint8_t *is_on, void *memory)
{
    tree->points = points;
    tree->count = count;
    tree->is_on = is_on;
    tree->order = memory;
    tree->rank = tree->order + count;
    void *behind = tree->rank + count;

    struct grid_key *keys = behind;
    for (uint32_t i = 0; i < count; i++) {
        uint64_t key = spread_bits((uint32_t)points[i].x) | spread_bits((uint32_t)points[i].y) << 1;
        keys[i] = (struct grid_key){key, i};
    }
    sort_grid_keys(keys, keys + count, count);
    for (uint32_t i = 0; i < count; i++) {
        tree->order[i] = keys[i].index;
        tree->rank[keys[i].index] = i;
    }

    struct point_box *boxes = behind;
    uint32_t groups = count;
    tree->levels = 0;
    do {
        groups = groups_of(groups);
        unsigned level = tree->levels++;
        tree->level_count[level] = groups;
        tree->level[level] = boxes;
        for (uint32_t i = 0; i < groups; i++)
            boxes[i] = box_of_group(tree, level, i);
        boxes += groups;
    } while (groups > 1);
}

static bool boxes_equal(const struct point_box *a, const struct point_box *b)
{
    return a->x_low == b->x_low && a->y_low == b->y_low && a->x_high == b->x_high &&
           a->y_high == b->y_high;
}

void point_tree_switch(struct point_tree *tree, uint32_t point, bool on)
{
    tree->is_on[point] = on;
    uint32_t group = tree->rank[point];
    for (unsigned level = 0; level < tree->levels; level++) {
        group /= FANOUT;
        struct point_box box = box_of_group(tree, level, group);
        if (boxes_equal(&box, &tree->level[level][group]))
            return;
        tree->level[level][group] = box;
    }
}

/* True when the whole box lies to the right of the edge from p to q. */
static bool is_right_of(const struct point_box *box, struct grid_point p, struct grid_point q)
{
    struct grid_point corner = {q.y < p.y ? box->x_high : box->x_low,
                                q.x > p.x ? box->y_high : box->y_low};
    return orientation(p, q, corner) < 0;
}

uint32_t point_tree_find(const struct point_tree *tree, struct grid_point a, struct grid_point b,
                         struct grid_point c, bool (*accept)(const void *user, uint32_t point),
                         const void *user)
{
    struct point_box around = {a.x, a.y, a.x, a.y};
    include(&around, &(struct point_box){b.x, b.y, b.x, b.y});
    include(&around, &(struct point_box){c.x, c.y, c.x, c.y});

    struct {
        uint32_t group, level;
    } stack[FANOUT * POINT_TREE_LEVELS];
    unsigned depth = 0;
    stack[depth].group = 0;
    stack[depth++].level = tree->levels - 1;
    while (depth > 0) {
        uint32_t group = stack[--depth].group, level = stack[depth].level;
        const struct point_box *box = &tree->level[level][group];
        if (box->x_low > around.x_high || box->x_high < around.x_low ||
            box->y_low > around.y_high || box->y_high < around.y_low || is_right_of(box, a, b) ||
            is_right_of(box, b, c) || is_right_of(box, c, a))
            continue;
        uint32_t parts = level == 0 ? tree->count : tree->level_count[level - 1];
        uint32_t first = group * FANOUT, end = parts - first < FANOUT ? parts : first + FANOUT;
        for (uint32_t i = end; level > 0 && i-- > first;) { /* the first part is looked at first */
            stack[depth].group = i;
            stack[depth++].level = level - 1;
        }
        for (uint32_t i = first; level == 0 && i < end; i++) {
            uint32_t point = tree->order[i];
            if (tree->is_on[point] && triangle_holds(a, b, c, tree->points[point]) &&
                accept(user, point))
                return point;
        }
    }
    return UINT32_MAX;
}
