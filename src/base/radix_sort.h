/* Stable sort of records in memory by an unsigned integer key; the inner half of external_sort.h.
 */
#ifndef SPBM_BASE_RADIX_SORT_H
#define SPBM_BASE_RADIX_SORT_H

#include "report.h"

/*
 * Sorts `count` records of `record_size` bytes by the key in their first 8 * key_words bytes (1 or
 * 2 little-endian words, the more significant first), ties in the order given. `records` and
 * `scratch` have room for all; *sorted is the one of the two that holds the result. With
 * ctx->threads threads; the result does not depend on their number.
 */
enum status radix_sort(struct context *ctx, unsigned char *records, unsigned char *scratch,
                       size_t count, size_t record_size, unsigned key_words,
                       unsigned char **sorted) MUST_CHECK;

/* The same for records that come in the order of the lowest `ordered_bits` bits (below 64) of their
 * keys, which then need not be looked at. */
enum status radix_sort_above(struct context *ctx, unsigned char *records, unsigned char *scratch,
                             size_t count, size_t record_size, unsigned key_words,
                             unsigned ordered_bits, unsigned char **sorted) MUST_CHECK;

#endif
