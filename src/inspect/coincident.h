/*
 * Vertices that have the same position as an earlier one.
 */
#ifndef SPBM_INSPECT_COINCIDENT_H
#define SPBM_INSPECT_COINCIDENT_H

#include "inspect/quality.h"

/* Counts them, used or not. `sort_memory`: bytes for sorting. */
enum status coincident_count(struct context *ctx, const struct quality_input *input,
                             uint64_t sort_memory, uint64_t *coincident) MUST_CHECK;

#endif
