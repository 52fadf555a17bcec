/*
 * Parting the two banks of a bridge.
 *
 * Where a loop comes by the same point twice, a test of the point alone can't tell on which side of
 * the bridge an ear lies, and ears are cut across it. Every such corner moves by a step of 2^-21 of
 * the loop's size along the bisector of its inner angle: the banks move apart, the bridge becomes a
 * ditch, and the loop is simple. Triangles that tile the one tile the other.
 */
#include "geom/part_twins.h"

#include <math.h>
#include <string.h>

enum { STEP = GRID_SIZE >> 21 };

static int32_t within_grid(double value)
{
    return value < 0 ? 0 : value > GRID_SIZE ? GRID_SIZE : (int32_t)value;
}

/* The sum of the unit normals of both edges, which point to the left, into the inside. */
static struct grid_point moved(struct grid_point before, struct grid_point at,
                               struct grid_point after)
{
    double in_x = at.x - before.x, in_y = at.y - before.y;
    double out_x = after.x - at.x, out_y = after.y - at.y;
    double in_length = sqrt(in_x * in_x + in_y * in_y);
    double out_length = sqrt(out_x * out_x + out_y * out_y);
    if (!(in_length > 0) || !(out_length > 0))
        return at;
    double x = -in_y / in_length - out_y / out_length;
    double y = in_x / in_length + out_x / out_length;
    double length = sqrt(x * x + y * y);
    if (!(length > 1e-9))
        return at; /* there and back: no side is the inside */
    return (struct grid_point){within_grid(floor(at.x + STEP * x / length + 0.5)),
                               within_grid(floor(at.y + STEP * y / length + 0.5))};
}

enum status part_twins(struct context *ctx, struct scratch *scratch,
                       const struct grid_point *points, uint32_t n, struct grid_point *parted,
                       bool *any)
{
    *any = false;
    enum status status = scratch_reserve(ctx, scratch, 2 * (size_t)n * sizeof(struct grid_key));
    if (status != STATUS_OK)
        return status;
    struct grid_key *order = (struct grid_key *)(void *)scratch->block;
    sort_grid_points(points, n, order);

    memcpy(parted, points, n * sizeof *points);
    for (uint32_t i = 0; i < n; i++) {
        bool is_twin = (i > 0 && order[i].key == order[i - 1].key) ||
                       (i + 1 < n && order[i].key == order[i + 1].key);
        if (!is_twin)
            continue;
        uint32_t at = order[i].index;
        *any = true;
        parted[at] =
            moved(points[at == 0 ? n - 1 : at - 1], points[at], points[at + 1 == n ? 0 : at + 1]);
    }
    return STATUS_OK;
}
