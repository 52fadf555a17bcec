/*
 * Patches that fit target and scan: how fine they must be for the finest level, found by growing
 * them on a sample of the store.
 */
#ifndef SPBM_SIMPLIFY_PATCH_FIT_H
#define SPBM_SIMPLIFY_PATCH_FIT_H

#include "simplify/simplify.h"

/*
 * Fills in *options: what patch_choose says, with the angles that the user left open made as fine
 * as the finest level of `target` needs. Depends on the store, the target and the request alone.
 */
enum status patch_fit(struct context *ctx, struct store *store, const struct target *target,
                      const struct patch_request *request,
                      struct patch_options *options) MUST_CHECK;

#endif
