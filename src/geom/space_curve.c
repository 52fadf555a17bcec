/*
 * The Hilbert curve as a machine of 24 states.
 *
 * The usual ways to a Hilbert index turn and mirror all coordinates anew at each bit. What they do
 * depends only on the corner of a cell where the curve enters (8) and the axis along which it
 * leaves (3), so all of it fits a table of 24 by 8 steps, made here from the rules of C. Hamilton,
 * "Compact Hilbert Indices" (Dalhousie CS-2006-07, section 2): the octants of a cell are visited in
 * the order of a Gray code, and the entry and direction in each follow from its place. A look at
 * the table waits for the one before, so that it has the steps two at a time, too.
 */
#include "geom/space_curve.h"

enum { OCTANTS = 8, AXES = 3 };

static unsigned rotate_left(unsigned value, unsigned by)
{
    by %= AXES;
    return (value << by | value >> (AXES - by)) & (OCTANTS - 1);
}

static unsigned gray(unsigned place)
{
    return place ^ place >> 1;
}

static unsigned gray_place(unsigned code)
{
    return code ^ code >> 1 ^ code >> 2;
}

static unsigned trailing_ones(unsigned value)
{
    unsigned count = 0;
    while (value >> count & 1)
        count++;
    return count;
}

/* Corner at which the curve enters the octant at this place of an unturned cell. */
static unsigned entry_corner(unsigned place)
{
    return place == 0 ? 0 : gray((place - 1) & ~1u);
}

/* Axis along which it goes through that octant. */
static unsigned through_axis(unsigned place)
{
    if (place == 0)
        return 0;
    return trailing_ones(place & 1 ? place : place - 1) % AXES;
}

void space_curve_init(struct space_curve *curve)
{
    for (unsigned corner = 0; corner < OCTANTS; corner++) {
        for (unsigned axis = 0; axis < AXES; axis++) {
            for (unsigned octant = 0; octant < OCTANTS; octant++) {
                /* Turned so that the curve enters at corner 0 and leaves along the last axis. */
                unsigned turned = rotate_left(octant ^ corner, 2 * (axis + 1));
                unsigned place = gray_place(turned);
                unsigned inner_corner = corner ^ rotate_left(entry_corner(place), axis + 1);
                unsigned inner_axis = (axis + through_axis(place) + 1) % AXES;
                curve->step[corner * AXES + axis][octant] =
                    (uint8_t)((inner_corner * AXES + inner_axis) << 3 | place);
            }
        }
    }
    for (unsigned from = 0; from < OCTANTS * AXES; from++) {
        for (unsigned octants = 0; octants < OCTANTS * OCTANTS; octants++) {
            const unsigned outer = curve->step[from][octants >> 3];
            const unsigned inner = curve->step[outer >> 3][octants & 7];
            curve->two_steps[from][octants] =
                (uint16_t)((inner >> 3) << 6 | (outer & 7) << 3 | (inner & 7));
        }
    }
}
