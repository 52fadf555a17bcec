/*
 * Zipping cracks: the two sides of a crack that lie on each other become one, before what is left
 * of it is filled.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_ZIP_H
#define SPBM_SIMPLIFY_TOPOLOGY_ZIP_H

#include "simplify/topology_surgery.h"

/* A tenth of the median length of the border edges that the surgery has found, which must be sorted
 * by their first vertex. */
enum status zip_tolerance_choose(struct surgery *surgery, double *tolerance) MUST_CHECK;

/*
 * Zips the surgery's cracks from their ends on: vertices of both sides that are at most `tolerance`
 * apart become one of the two, and a vertex that is as near to an edge of the other side is put
 * into it. Faces that change are dropped and added anew to surgery->mended; loops are left with
 * what stays open, and go when that is nothing. *zipped is the number of vertices joined and put
 * in. The result is a manifold with the same faces turned the same way.
 */
enum status cracks_zip(struct surgery *surgery, double tolerance, uint64_t *zipped) MUST_CHECK;

#endif
