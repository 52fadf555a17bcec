/*
 * Polylines in space. Halving a polyline gives other vertices from one end than from the other when
 * the number of its segments is odd, so that two copies of one polyline that are kept in opposite
 * directions would not simplify alike. Storing a direction would need an agreement between the
 * copies; here both find the same one by looking at their coordinates only.
 */
#include "geom/polyline.h"

/* -1, 0, 1: order of two points by x, then y, then z. */
static int compare_points(const float *a, const float *b)
{
    for (int k = 0; k < 3; k++)
        if (a[k] != b[k])
            return a[k] < b[k] ? -1 : 1;
    return 0;
}

int polyline_runs_backwards(const float *positions, size_t count)
{
    for (size_t i = 0; i < count / 2; i++) {
        int order = compare_points(positions + 3 * i, positions + 3 * (count - 1 - i));
        if (order != 0)
            return order > 0;
    }
    return 0; /* the same from both ends */
}
