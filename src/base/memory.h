/*
 * Memory: every allocation of the library goes through here, so that it is counted against the
 * budget, checked for overflow, and can be made to fail by a test.
 *
 * Blocks are not zeroed unless said. `size` of every block is given back at release, so no header
 * is kept in front of it: a block of many pages starts on a page of its own and can be handed to
 * madvise. (Blocks of 128 KiB and more are anonymous maps, given back to the system at once, or
 * kept for the next ones where memory_keep_spares says so.)
 */
#ifndef SPBM_BASE_MEMORY_H
#define SPBM_BASE_MEMORY_H

#include "report.h"

/* `count` * `size` bytes in *out. count or size 0 gives a valid non-NULL pointer that must be
 * released with the same count and size. STATUS_NO_MEMORY when the product overflows, the budget
 * would be passed, or the system refuses; *out is NULL then. */
enum status memory_take(struct context *ctx, size_t count, size_t size, void *out) MUST_CHECK;
enum status memory_take_zeroed(struct context *ctx, size_t count, size_t size,
                               void *out) MUST_CHECK;

/* Grows (or shrinks) the block *inout from old_count to new_count elements; on failure the block
 * is untouched. *inout may be NULL with old_count 0. */
enum status memory_resize(struct context *ctx, void *inout, size_t old_count, size_t new_count,
                          size_t size) MUST_CHECK;

/* Whether released blocks are kept for later ones of the same context, so that their pages need not
 * come from the system again: never so much that blocks and what is kept pass the budget or the
 * account's peak. Off at first; off again, all is given back. No worker may be at work. */
void memory_keep_spares(struct context *ctx, bool keep);
/* Returns spare maps of more than `most` bytes to the system; how many bytes are kept. */
uint64_t memory_limit_spares(struct context *ctx, uint64_t most);

/* Tells the system that all of a large block will be used soon: it may give it in large pieces,
 * which saves most of the page faults. Not for vectors that have room to spare. */
void memory_use_whole(void *block, size_t count, size_t size);

/* Releases *inout (which may be NULL) and sets it to NULL. */
void memory_release(struct context *ctx, void *inout, size_t count, size_t size);

/* Releases whole pages of the first `front` bytes of a large block of *bytes bytes: *inout and
 * *bytes are then what is left, a block like any other. Nothing is released where what is left
 * would be no large block; all of it where `front` is all. */
void memory_release_front(struct context *ctx, void *inout, size_t *bytes, size_t front);

/*
 * Counts `bytes` that become resident by other ways than a block of ours: a window onto a file,
 * what a library takes for itself. window_open does it for its windows; whoever maps by hand says
 * so here. STATUS_NO_MEMORY, and nothing counted, when the budget would be passed.
 */
enum status memory_hold(struct context *ctx, uint64_t bytes) MUST_CHECK;
/* Gives held bytes back to the budget. */
void memory_unhold(struct context *ctx, uint64_t bytes);

/* For vectors: makes room for `needed` elements, growing by half at least, capacity in *capacity.
 */
enum status memory_reserve(struct context *ctx, void *inout, size_t *capacity, size_t needed,
                           size_t size) MUST_CHECK;

/* True once in a job when fault injection has reached its count: guarded system calls (write,
 * fsync, mmap, rename, ...) ask this first and behave as if the system had refused. */
bool fault_due(struct context *ctx);
/* The same for allocations, which do not count where faults kill. */
bool allocation_fault_due(struct context *ctx);

#endif
