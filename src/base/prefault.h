/*
 * Pages for a large block ahead of who fills it: the first touch of memory costs as much as
 * what is written there, or several times that where the system must get it from a host. A thread
 * of its own takes this from the one that fills the block in order, which nobody else can help.
 */
#ifndef SPBM_BASE_PREFAULT_H
#define SPBM_BASE_PREFAULT_H

#include "report.h"

enum { PREFAULT_BLOCKS = 4 };

struct prefault { /* all zero: at rest */
    pthread_t thread;
    bool is_running;
    atomic_bool is_ending;
    unsigned count;
    struct {
        unsigned char *at;
        size_t size;
    } blocks[PREFAULT_BLOCKS];
};

/* Before prefault_begin: `size` bytes at `at`, which will all be written, are to get their pages.
 * The block may move or go away before they have: then some are got in vain. */
void prefault_add(struct prefault *prefault, void *at, size_t size);
/* Begins with the blocks in their order, if the job has several threads and they are large. */
void prefault_begin(struct context *ctx, struct prefault *prefault);
/* Stops, and forgets the blocks; safe at rest. */
void prefault_end(struct prefault *prefault);

#endif
