/*
 * Counted, checked and breakable allocation.
 *
 * The naive wrapper keeps a header in front of each block for its size; then no block starts on a
 * page, and what free() gets stays in the allocator's pools and in the process's resident size.
 * Here the callers give the size back, and blocks of 128 KiB and more are anonymous maps of their
 * own: grown, they move by page tables (mremap), not by copying; released, they are kept for the
 * next blocks (spare_maps.h) as far as no more is resident than has been before, or leave the
 * process at once. Maps are accounted by whole pages, small blocks by their bytes.
 *
 * Under AddressSanitizer, which does not watch maps, each map gets a poisoned page behind it and
 * its last page's rest is poisoned, so that a step over the end is found as with malloc.
 */
#include "base/memory.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "base/bytes.h"

#if defined(__SANITIZE_ADDRESS__)
#define WITH_ASAN 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define WITH_ASAN 1
#endif
#endif

#ifdef WITH_ASAN
#include <sanitizer/asan_interface.h>
enum { GUARD_PAGES = 1 };
#else
#define ASAN_POISON_MEMORY_REGION(from, size) ((void)(from), (void)(size))
#define ASAN_UNPOISON_MEMORY_REGION(from, size) ((void)(from), (void)(size))
enum { GUARD_PAGES = 0 };
#endif

enum { MAP_FROM = 128 << 10 }; /* bytes from which a block is a map of its own */

bool fault_due(struct context *ctx)
{
    uint64_t left = atomic_load_explicit(&ctx->fault_after, memory_order_relaxed);
    while (left != UINT64_MAX) {
        uint64_t next = left == 0 ? UINT64_MAX : left - 1;
        if (!atomic_compare_exchange_weak(&ctx->fault_after, &left, next))
            continue;
        if (left == 0 && ctx->fault_kills)
            (void)kill(getpid(), SIGKILL);
        return left == 0;
    }
    return false;
}

bool allocation_fault_due(struct context *ctx)
{
    return !ctx->fault_kills && fault_due(ctx);
}

static size_t page_size(void)
{
    return (size_t)sysconf(_SC_PAGESIZE);
}

static bool is_map(size_t bytes)
{
    return bytes >= MAP_FROM;
}

/* Bytes of the map that holds a block, without the guard. */
static size_t map_bytes(size_t bytes)
{
    size_t page = page_size();
    return (bytes + page - 1) & ~(page - 1);
}

static size_t guard_bytes(void)
{
    return GUARD_PAGES ? page_size() : 0;
}

/* What a block of `bytes` counts in the account. */
static uint64_t accounted(size_t bytes)
{
    return is_map(bytes) ? map_bytes(bytes) : bytes;
}

/* False, and nothing counted, when the budget would be passed. */
static bool account_add(struct context *ctx, uint64_t bytes)
{
    uint64_t now = atomic_load_explicit(&ctx->memory_now, memory_order_relaxed);
    uint64_t sum;
    do {
        if (add_overflows(now, bytes, &sum) || sum > ctx->memory_budget)
            return false;
    } while (!atomic_compare_exchange_weak(&ctx->memory_now, &now, sum));

    uint64_t peak = atomic_load_explicit(&ctx->memory_peak, memory_order_relaxed);
    while (peak < sum && !atomic_compare_exchange_weak(&ctx->memory_peak, &peak, sum))
        ;
    return true;
}

static void account_remove(struct context *ctx, uint64_t bytes)
{
    atomic_fetch_sub(&ctx->memory_now, bytes);
}

/* Blocks and spare maps together stay below the budget, and below seven eighths of what blocks
 * alone have taken: not all of a block is used, but all of a spare map may have been. */
static void fit_spares(struct context *ctx)
{
    const uint64_t spare = atomic_load_explicit(&ctx->spares.bytes, memory_order_relaxed);
    if (spare == 0)
        return;
    const uint64_t now = atomic_load(&ctx->memory_now);
    const uint64_t peak = atomic_load(&ctx->memory_peak), part = peak - peak / 8;
    const uint64_t most = part < ctx->memory_budget ? part : ctx->memory_budget;
    if (now + spare > most)
        spare_maps_trim(&ctx->spares, most > now ? most - now : 0);
}

/* ---- blocks, not accounted; NULL on failure ---- */

static void *block_take(struct context *ctx, size_t bytes, bool zeroed)
{
    if (!is_map(bytes))
        return zeroed ? calloc(1, bytes ? bytes : 1) : malloc(bytes ? bytes : 1);
    size_t whole = map_bytes(bytes) + guard_bytes(), used;
    if (whole < bytes)
        return NULL;
    void *block = spare_maps_take(&ctx->spares, whole, &used);
    if (!block)
        return NULL;
    ASAN_POISON_MEMORY_REGION((char *)block + bytes, whole - bytes);
    if (zeroed)
        memset(block, 0, used < bytes ? used : bytes);
    return block;
}

static void block_release(struct context *ctx, void *block, size_t bytes)
{
    if (!is_map(bytes)) {
        free(block);
        return;
    }
    const size_t whole = map_bytes(bytes) + guard_bytes();
    ASAN_UNPOISON_MEMORY_REGION(block, whole);
    spare_maps_put(&ctx->spares, block, whole);
}

/* Both sizes are those of maps. */
static void *block_resize_map(void *block, size_t old_bytes, size_t new_bytes)
{
    size_t old_whole = map_bytes(old_bytes) + guard_bytes();
    size_t new_whole = map_bytes(new_bytes) + guard_bytes();
    if (new_whole < new_bytes)
        return NULL;
    ASAN_UNPOISON_MEMORY_REGION(block, old_whole);
    void *moved = map_resize(block, old_whole, new_whole);
    if (!moved) {
        ASAN_POISON_MEMORY_REGION((char *)block + old_bytes, old_whole - old_bytes);
        return NULL;
    }
    ASAN_POISON_MEMORY_REGION((char *)moved + new_bytes, new_whole - new_bytes);
    return moved;
}

static void *block_resize(struct context *ctx, void *block, size_t old_bytes, size_t new_bytes)
{
    if (!is_map(old_bytes) && !is_map(new_bytes))
        return realloc(block, new_bytes ? new_bytes : 1);
    if (is_map(old_bytes) && is_map(new_bytes))
        return block_resize_map(block, old_bytes, new_bytes);
    void *moved = block_take(ctx, new_bytes, false);
    if (!moved)
        return NULL;
    memcpy(moved, block, old_bytes < new_bytes ? old_bytes : new_bytes);
    block_release(ctx, block, old_bytes);
    return moved;
}

/* ---- the interface ---- */

/* Pointers of any type are handed over as `void *` to them; memcpy keeps that within the rules. */
static void *get_pointer(const void *from)
{
    void *block;
    memcpy(&block, from, sizeof block);
    return block;
}

static void set_pointer(void *to, void *block)
{
    memcpy(to, &block, sizeof block);
}

static enum status refuse(struct context *ctx, uint64_t bytes)
{
    uint64_t now = atomic_load(&ctx->memory_now);
    if (ctx->memory_budget != UINT64_MAX)
        return fail(ctx, STATUS_NO_MEMORY,
                    "not enough memory: %llu bytes more asked for, %llu in use, budget %llu",
                    (unsigned long long)bytes, (unsigned long long)(now + ctx->memory_aside),
                    (unsigned long long)(ctx->memory_budget + ctx->memory_aside));
    return fail(ctx, STATUS_NO_MEMORY, "not enough memory: %llu bytes more asked for, %llu in use",
                (unsigned long long)bytes, (unsigned long long)now);
}

static enum status take(struct context *ctx, size_t count, size_t size, bool zeroed, void *out)
{
    set_pointer(out, NULL);
    size_t bytes;
    /* Above PTRDIFF_MAX no object can be; leaving room keeps the rounding to pages exact. */
    if (__builtin_mul_overflow(count, size, &bytes) || bytes > PTRDIFF_MAX - (1u << 20))
        return fail(ctx, STATUS_NO_MEMORY, "not enough memory: %zu elements of %zu bytes asked for",
                    count, size);
    if (allocation_fault_due(ctx) || !account_add(ctx, accounted(bytes)))
        return refuse(ctx, bytes);
    void *block = block_take(ctx, bytes, zeroed);
    if (!block) {
        account_remove(ctx, accounted(bytes));
        return refuse(ctx, bytes);
    }
    fit_spares(ctx);
    set_pointer(out, block);
    return STATUS_OK;
}

enum status memory_take(struct context *ctx, size_t count, size_t size, void *out)
{
    return take(ctx, count, size, false, out);
}

enum status memory_take_zeroed(struct context *ctx, size_t count, size_t size, void *out)
{
    return take(ctx, count, size, true, out);
}

/*
 * memory_resize without words, so that memory_reserve can try twice. A move between malloc and a
 * map has both blocks for a moment; the account has the larger growth only, as with realloc.
 */
static bool resize(struct context *ctx, void *inout, size_t old_bytes, size_t new_bytes)
{
    if (new_bytes > PTRDIFF_MAX - (1u << 20))
        return false;
    void *block = get_pointer(inout);
    uint64_t old_account = block ? accounted(old_bytes) : 0;
    uint64_t new_account = accounted(new_bytes);
    if (new_account > old_account && !account_add(ctx, new_account - old_account))
        return false;

    void *moved =
        block ? block_resize(ctx, block, old_bytes, new_bytes) : block_take(ctx, new_bytes, false);
    if (!moved) {
        if (new_account > old_account)
            account_remove(ctx, new_account - old_account);
        return false;
    }
    if (new_account < old_account)
        account_remove(ctx, old_account - new_account);
    fit_spares(ctx);
    set_pointer(inout, moved);
    return true;
}

enum status memory_resize(struct context *ctx, void *inout, size_t old_count, size_t new_count,
                          size_t size)
{
    size_t bytes;
    if (__builtin_mul_overflow(new_count, size, &bytes))
        return fail(ctx, STATUS_NO_MEMORY, "not enough memory: %zu elements of %zu bytes asked for",
                    new_count, size);
    if (allocation_fault_due(ctx) || !resize(ctx, inout, old_count * size, bytes))
        return refuse(ctx, bytes);
    return STATUS_OK;
}

void memory_keep_spares(struct context *ctx, bool keep)
{
    ctx->spares.are_kept = keep;
    if (!keep)
        spare_maps_trim(&ctx->spares, 0);
}

uint64_t memory_limit_spares(struct context *ctx, uint64_t most)
{
    if (atomic_load(&ctx->spares.bytes) > most)
        spare_maps_trim(&ctx->spares, most);
    const uint64_t kept = atomic_load(&ctx->spares.bytes);
    return kept < most ? kept : most;
}

void memory_use_whole(void *block, size_t count, size_t size)
{
    /* All of the map, with its guard: one of two kinds could not be moved (mremap). */
    if (is_map(count * size))
        (void)madvise(block, map_bytes(count * size) + guard_bytes(), MADV_HUGEPAGE);
}

void memory_release(struct context *ctx, void *inout, size_t count, size_t size)
{
    void *block = get_pointer(inout);
    if (!block)
        return;
    block_release(ctx, block, count * size);
    account_remove(ctx, accounted(count * size));
    set_pointer(inout, NULL);
}

void memory_release_front(struct context *ctx, void *inout, size_t *bytes, size_t front)
{
    unsigned char *block = get_pointer(inout);
    const bool is_all = front >= *bytes;
    if (!block || (!is_map(*bytes) && !is_all))
        return;
    if (!is_map(*bytes)) {
        memory_release(ctx, inout, *bytes, 1);
        *bytes = 0;
        return;
    }
    const size_t pages = is_all ? map_bytes(*bytes) : front & ~(page_size() - 1);
    if (pages == 0 || (!is_all && !is_map(*bytes - pages)))
        return;
    const size_t whole = pages + (is_all ? guard_bytes() : 0);
    ASAN_UNPOISON_MEMORY_REGION(block, whole);
    spare_maps_put(&ctx->spares, block, whole);
    account_remove(ctx, pages);
    *bytes = is_all ? 0 : *bytes - pages;
    set_pointer(inout, is_all ? NULL : block + pages);
}

enum status memory_hold(struct context *ctx, uint64_t bytes)
{
    if (allocation_fault_due(ctx) || !account_add(ctx, bytes))
        return refuse(ctx, bytes);
    fit_spares(ctx);
    return STATUS_OK;
}

void memory_unhold(struct context *ctx, uint64_t bytes)
{
    account_remove(ctx, bytes);
}

enum status memory_reserve(struct context *ctx, void *inout, size_t *capacity, size_t needed,
                           size_t size)
{
    if (needed <= *capacity)
        return STATUS_OK;
    size_t exact;
    if (__builtin_mul_overflow(needed, size, &exact))
        return fail(ctx, STATUS_NO_MEMORY, "not enough memory: %zu elements of %zu bytes asked for",
                    needed, size);

    if (allocation_fault_due(ctx))
        return refuse(ctx, exact);

    /* By half, so that appending is linear; but rather exactly than not at all. */
    size_t grown = *capacity + *capacity / 2;
    if (grown < 16)
        grown = 16;
    size_t grown_bytes;
    if (grown > needed && !__builtin_mul_overflow(grown, size, &grown_bytes) &&
        resize(ctx, inout, *capacity * size, grown_bytes)) {
        *capacity = grown;
        return STATUS_OK;
    }
    if (!resize(ctx, inout, *capacity * size, exact))
        return refuse(ctx, exact);
    *capacity = needed;
    return STATUS_OK;
}
