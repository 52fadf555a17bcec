/*
 * The way back from chains to a surface: the finest mesh that a chain file gives, as a mesh store.
 */
#ifndef SPBM_SIMPLIFY_CHAIN_UNFOLD_H
#define SPBM_SIMPLIFY_CHAIN_UNFOLD_H

#include "simplify/chain_file.h"

/*
 * Builds the store `store_path` of what the chains of `chain_path` bound: every chain vertex stays
 * where it is, and patches are triangulated as mode collapse does. Topology and attributes are
 * those of the file; `import` says how to build the store, and *info (may be NULL) what is in it.
 */
enum status chain_unfold(struct context *ctx, const char *chain_path, const char *store_path,
                         const struct import_options *import, struct store_info *info) MUST_CHECK;

#endif
