/*
 * MADV_POPULATE_WRITE gets the pages of a range as a write to each would, and changes no byte, so
 * that others may write there at the same time. Where the system does not know it (before Linux
 * 5.14), pages come as they always do.
 */
#include "base/prefault.h"

#include <sys/mman.h>
#include <unistd.h>

#include "base/parallel.h"

#ifndef MADV_POPULATE_WRITE
#define MADV_POPULATE_WRITE 23
#endif

enum { STEP = 2 << 20, LEAST = 8 << 20 };

void prefault_add(struct prefault *prefault, void *at, size_t size)
{
    if (prefault->is_running || prefault->count == PREFAULT_BLOCKS)
        return;
    prefault->blocks[prefault->count].at = at;
    prefault->blocks[prefault->count++].size = size;
}

/* False when there is no sense in going on. */
static bool get_pages(struct prefault *prefault, unsigned char *at, size_t size)
{
    const size_t page = (size_t)sysconf(_SC_PAGESIZE), before = (size_t)((uintptr_t)at % page);
    at -= before;
    size += before;
    while (size > 0) {
        const size_t step = size < STEP ? size : STEP;
        if (atomic_load_explicit(&prefault->is_ending, memory_order_relaxed) ||
            madvise(at, step, MADV_POPULATE_WRITE) != 0)
            return false;
        at += step;
        size -= step;
    }
    return true;
}

static void *get_all(void *argument)
{
    struct prefault *prefault = argument;
    for (unsigned i = 0; i < prefault->count; i++)
        if (!get_pages(prefault, prefault->blocks[i].at, prefault->blocks[i].size))
            break;
    return NULL;
}

void prefault_begin(struct context *ctx, struct prefault *prefault)
{
    size_t sum = 0;
    for (unsigned i = 0; i < prefault->count; i++)
        sum += prefault->blocks[i].size;
    if (ctx->threads < 2 || sum < LEAST || prefault->is_running)
        return;
    atomic_store(&prefault->is_ending, false);
    prefault->is_running = thread_begin(&prefault->thread, get_all, prefault);
}

void prefault_end(struct prefault *prefault)
{
    if (prefault->is_running) {
        atomic_store(&prefault->is_ending, true);
        pthread_join(prefault->thread, NULL);
    }
    prefault->is_running = false;
    prefault->count = 0;
}
