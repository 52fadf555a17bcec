/*
 * What store_check.c and store_export.c need of an open store besides store.h.
 */
#ifndef SPBM_MESH_STORE_INTERNAL_H
#define SPBM_MESH_STORE_INTERNAL_H

#include "mesh/store.h"

struct context *store_context(const struct store *store);
const char *store_path(const struct store *store);
struct section_reader *store_reader(struct store *store);
/* Records and returns STATUS_BAD_INPUT: "<path>: damaged mesh store: slab N: <what>". */
enum status store_slab_damaged(const struct store *store, uint32_t slab, const char *what);
enum status store_damaged(const struct store *store, const char *what);

#endif
