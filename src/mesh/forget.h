/*
 * Residency of what lies in temporary files. A spool that has moved to a file is mapped, and counts
 * as memory of the process as far as it is resident. Whoever is done with a part of it says so.
 */
#ifndef SPBM_MESH_FORGET_H
#define SPBM_MESH_FORGET_H

#include "base/file.h"

/* The pages of [offset, offset + size) leave the process, and stay in the file: looking at them
 * brings them back. Without effect on a spool in memory. */
void spool_forget(const struct spool *spool, uint64_t offset, uint64_t size);

/* All of it. */
static inline void spool_forget_all(const struct spool *spool)
{
    spool_forget(spool, 0, spool->size);
}

/* Elements of a long sweep between two calls. */
enum { FORGET_EVERY = 1 << 18 };

#endif
