/*
 * Sorting more records than fit: records of a fixed size, ordered by the unsigned integer in their
 * first `key_size` bytes (little-endian words of 8 bytes, the most significant word first), ties
 * in the order of insertion. In memory while they fit into `memory_limit` (radix sort); beyond,
 * sorted runs go to temporary files and are merged.
 */
#ifndef SPBM_BASE_EXTERNAL_SORT_H
#define SPBM_BASE_EXTERNAL_SORT_H

#include "report.h"

struct sorter;

/* record_size at most 64, key_size 8 or 16 (at most record_size). `beside` as in temp_open. */
enum status sorter_open(struct context *ctx, size_t record_size, size_t key_size,
                        uint64_t memory_limit, const char *beside, struct sorter **out) MUST_CHECK;
/* About so many will be added: room for them at once, as far as the limit goes. */
enum status sorter_expect(struct sorter *sorter, uint64_t count) MUST_CHECK;
/* The records come in the order of the lowest `bits` bits (below 64) of their keys: spares the
 * looking at them. */
void sorter_comes_ordered(struct sorter *sorter, unsigned bits);
/* Adds `count` records. */
enum status sorter_add(struct sorter *sorter, const void *records, size_t count) MUST_CHECK;
/* Ends the adding. */
enum status sorter_finish(struct sorter *sorter) MUST_CHECK;
/* The next records in order: *records is valid until the next call; *count 0 at the end. */
enum status sorter_next(struct sorter *sorter, const void **records, size_t *count) MUST_CHECK;
/* Number of records added so far. */
uint64_t sorter_count(const struct sorter *sorter);
void sorter_close(struct sorter **sorter);

#endif
