/*
 * Hilbert order where vertices, or faces, don't fit in memory.
 */
#ifndef SPBM_MESH_ORDER_FAR_H
#define SPBM_MESH_ORDER_FAR_H

#include "mesh/order_key.h"

/* What order_along_curve promises, also of a draft whose faces hold ids (draft.id_count). */
enum status order_far(struct draft *draft, const struct face_curve *curve) MUST_CHECK;

#endif
