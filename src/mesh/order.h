/*
 * Putting faces in an order local in space.
 */
#ifndef SPBM_MESH_ORDER_H
#define SPBM_MESH_ORDER_H

#include "mesh/slab_geometry.h"

/* How many edges a slab of 2^SLAB_SHIFT_MAX faces may have, on average, that cross to another slab,
 * for the input's order to be kept. (A slab compact in space has about 2,000.) */
enum { CROSSING_PER_SLAB = 4096 };

/* The same for all slabs, as a limit for adjacency_build. Slabs smaller by 4^n may have 2^n times
 * fewer; those of less than 64 faces are nothing but seams and keep any order. A single
 * slab keeps its order. */
uint64_t order_crossing_limit(const struct draft *draft);

/* Whether more edges cross than order_crossing_limit allows: what adjacency_build would find, at a
 * tenth of its price. Looked at only where it may be so: by the corners that are vertices of
 * earlier slabs, of which there are one or two for each such edge. */
enum status order_crosses_too_much(struct draft *draft, bool *too_much) MUST_CHECK;

/* Sorts the faces along the Hilbert curve by their centres, ties in their order so far, and numbers
 * the draft anew. The draft has no adjacency before or after. */
enum status order_along_curve(struct draft *draft, const struct frame *frame) MUST_CHECK;

#endif
