/*
 * Welding: vertices with the same coordinates become one.
 */
#ifndef SPBM_MESH_WELD_H
#define SPBM_MESH_WELD_H

#include "mesh/ingest.h"

/*
 * Finds the vertices of the soup inputs (of all inputs if `all`) that coincide: the same
 * coordinates bit for bit, where -0 counts as 0. The lowest of a group stays. *merged (in `spool`,
 * all zero before) tells for each vertex which one stands for it; *welded counts those that do not
 * stand for themselves. When nothing has to be welded, *merged is NULL.
 */
enum status weld_find(struct ingest *ingest, bool all, struct spool *spool, uint32_t **merged,
                      uint64_t *welded) MUST_CHECK;

#endif
