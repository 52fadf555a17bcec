/*
 * The maps are shared maps of files without names, so that MADV_DONTNEED only takes pages out of
 * the process's page tables: what was written stays in the file's pages, which the system may write
 * out and drop as it likes.
 */
#include "mesh/forget.h"

#include <sys/mman.h>
#include <unistd.h>

void spool_forget(const struct spool *spool, uint64_t offset, uint64_t size)
{
    if (!spool->map || offset >= spool->size)
        return;
    const uint64_t page = (uint64_t)sysconf(_SC_PAGESIZE);
    uint64_t end = size < spool->size - offset ? offset + size : spool->size;
    offset = offset / page * page; /* a page that is still in use comes back */
    if (end > offset)
        (void)madvise((char *)spool->map + offset, (size_t)(end - offset), MADV_DONTNEED);
}
