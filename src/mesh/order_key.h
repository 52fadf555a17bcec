/*
 * The place of a face along the Hilbert curve, as an integer key: made from the cells that its
 * corners lie in, so that it is the same however the faces are looked at.
 */
#ifndef SPBM_MESH_ORDER_KEY_H
#define SPBM_MESH_ORDER_KEY_H

#include "geom/space_curve.h"
#include "mesh/slab_geometry.h"

enum { GRID_BITS = 19, FIELD_BITS = 21, CELL_BITS_MAX = 16 };

struct face_curve {
    struct space_curve curve;
    double low[3];
    double scale;
    unsigned index_bits; /* of a key, for the face's number */
    unsigned cell_bits;  /* of a key, for each axis */
};

/* For `face_count` faces. */
void face_curve_init(struct face_curve *curve, const struct frame *frame, uint64_t face_count);

/* Cell of a position within the frame: its coordinates, FIELD_BITS apart, GRID_BITS each. There is
 * room for the sum of three. */
static inline uint64_t curve_cell(const struct face_curve *curve, const double p[3])
{
    uint64_t cell = 0;
    for (int i = 3; i-- > 0;)
        cell = cell << FIELD_BITS | (uint64_t)((p[i] - curve->low[i]) * curve->scale);
    return cell;
}

/* Place on the curve of a cell, with `bits` an axis. */
static inline uint64_t curve_place(const struct face_curve *curve, uint64_t cell, unsigned bits)
{
    const uint64_t field = ((uint64_t)1 << GRID_BITS) - 1;
    const unsigned drop = GRID_BITS - bits;
    return space_curve_key(&curve->curve, (uint32_t)((cell & field) >> drop),
                           (uint32_t)((cell >> FIELD_BITS & field) >> drop),
                           (uint32_t)((cell >> 2 * FIELD_BITS) >> drop), bits);
}

/* The octants of the cell of a face whose corners' cells sum up to `sum`. */
static inline uint64_t face_octants(const struct face_curve *curve, uint64_t sum)
{
    const uint64_t field = ((uint64_t)1 << FIELD_BITS) - 1;
    const unsigned drop = GRID_BITS - curve->cell_bits;
    uint32_t x = (uint32_t)(sum & field) / 3 >> drop;
    uint32_t y = (uint32_t)(sum >> FIELD_BITS & field) / 3 >> drop;
    uint32_t z = (uint32_t)(sum >> 2 * FIELD_BITS) / 3 >> drop;
    return space_curve_octants(x, y, z);
}

/* The keys of the faces f to f + count - 1, with these sums. */
static inline void face_keys(const struct face_curve *curve, uint64_t f, const uint64_t *sums,
                             unsigned count, uint64_t *keys)
{
    uint64_t octants[SPACE_CURVE_SIDE_BY_SIDE];
    for (unsigned i = 0; i < count; i++)
        octants[i] = face_octants(curve, sums[i]);
    space_curve_numbers(&curve->curve, octants, count, curve->cell_bits, keys);
    for (unsigned i = 0; i < count; i++)
        keys[i] = keys[i] << curve->index_bits | (f + i);
}

static inline uint64_t face_key(const struct face_curve *curve, uint64_t f, uint64_t sum)
{
    uint64_t key;
    face_keys(curve, f, &sum, 1, &key);
    return key;
}

#endif
