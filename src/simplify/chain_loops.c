/*
 * A patch names no chains; chains name patches. So the uses of chains by patches are first sorted
 * by patch (by counting), each use being a chain walked with the patch on its left. Then one patch
 * at a time is followed from use to use, with marks on the vertices that hold for that patch only:
 * linear in the block, without a map.
 */
#include "simplify/chain_loops.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* A diagonal as places on its patch's loop, low < high. */
struct chord {
    uint32_t low, high;
};

struct loops {
    struct context *ctx;
    const char *what;
    const struct chain_block *block;
    uint32_t ends;       /* vertices at which chains can end: junctions and seam vertices */
    uint32_t *use_first; /* a patch, and one more */
    size_t use_count;
    uint32_t *uses;   /* chain << 1 | walked from its end; seam chains count on from the chains */
    uint32_t *marks;  /* a vertex: the patch that has it on its loop */
    uint32_t *places; /* a vertex: its place on that loop */
    uint32_t *leaves; /* a vertex < ends: the use that starts there */
    uint32_t *around; /* 2 a chain (not seam chain), its start and its end: the chain end that comes
                         next round the vertex, over the patch on the left of the walk towards it */
    struct chord *chords;
    size_t chord_capacity;
};

static enum status wrong(const struct loops *loops, uint32_t patch, const char *what)
{
    return fail(loops->ctx, STATUS_BAD_INPUT, "%s: patch %u: %s", loops->what, patch, what);
}

static bool is_seam(const struct loops *loops, uint32_t use)
{
    return use >> 1 >= loops->block->chain_count;
}

static const struct seam_chain *seam_of(const struct loops *loops, uint32_t use)
{
    return loops->block->seam_chains + ((use >> 1) - loops->block->chain_count);
}

static uint32_t use_start(const struct loops *loops, uint32_t use)
{
    if (is_seam(loops, use))
        return loops->block->seam_lists[seam_of(loops, use)->vertex_first];
    const struct chain *chain = loops->block->chains + (use >> 1);
    return use & 1 ? chain->end : chain->start;
}

static uint32_t use_end(const struct loops *loops, uint32_t use)
{
    if (is_seam(loops, use)) {
        const struct seam_chain *seam = seam_of(loops, use);
        return loops->block->seam_lists[seam->vertex_first + seam->vertex_count - 1];
    }
    const struct chain *chain = loops->block->chains + (use >> 1);
    return use & 1 ? chain->start : chain->end;
}

static uint32_t use_interior_count(const struct loops *loops, uint32_t use)
{
    return is_seam(loops, use) ? seam_of(loops, use)->vertex_count - 2
                               : loops->block->chains[use >> 1].interior_count;
}

static uint32_t use_interior(const struct loops *loops, uint32_t use, uint32_t place)
{
    if (is_seam(loops, use))
        return loops->block->seam_lists[seam_of(loops, use)->vertex_first + 1 + place];
    const struct chain *chain = loops->block->chains + (use >> 1);
    return chain->interior_first + (use & 1 ? chain->interior_count - 1 - place : place);
}

/* ---- uses by patch ---- */

uint32_t chain_uses_count(const struct chain_block *block, uint32_t *first)
{
    for (uint32_t i = 0; i < block->chain_count; i++) {
        first[block->chains[i].left]++;
        if (block->chains[i].right != NO_PATCH)
            first[block->chains[i].right]++;
    }
    for (uint32_t i = 0; i < block->seam_chain_count; i++)
        first[block->seam_chains[i].left]++;
    uint32_t sum = 0;
    for (uint32_t p = 0; p <= block->patch_count; p++) {
        const uint32_t count = first[p];
        first[p] = sum;
        sum += count;
    }
    return sum;
}

void chain_uses_sort(const struct chain_block *block, uint32_t *first, uint32_t *uses)
{
    for (uint32_t i = 0; i < block->chain_count; i++) {
        uses[first[block->chains[i].left]++] = i << 1;
        if (block->chains[i].right != NO_PATCH)
            uses[first[block->chains[i].right]++] = i << 1 | 1;
    }
    for (uint32_t i = 0; i < block->seam_chain_count; i++)
        uses[first[block->seam_chains[i].left]++] = (block->chain_count + i) << 1;
    for (uint32_t p = block->patch_count; p > 0; p--)
        first[p] = first[p - 1];
    first[0] = 0;
}

/* ---- one patch ---- */

/* Marks every vertex of the patch's loop once; a second time means that the loop touches itself. */
static enum status mark_loop(struct loops *loops, uint32_t patch)
{
    for (uint32_t i = loops->use_first[patch]; i < loops->use_first[patch + 1]; i++) {
        uint32_t use = loops->uses[i], start = use_start(loops, use);
        if (loops->marks[start] == patch)
            return wrong(loops, patch, "its boundary passes a vertex twice");
        loops->marks[start] = patch;
        loops->leaves[start] = use;
        for (uint32_t j = 0; is_seam(loops, use) && j < use_interior_count(loops, use); j++) {
            uint32_t vertex = use_interior(loops, use, j);
            if (loops->marks[vertex] == patch)
                return wrong(loops, patch, "its boundary passes a vertex twice");
            loops->marks[vertex] = patch;
            loops->leaves[vertex] = NO_INDEX;
        }
    }
    return STATUS_OK;
}

/* Follows the uses from end to start until they come back; *length is the loop's vertices. */
static enum status follow_loop(struct loops *loops, uint32_t patch, uint64_t *length)
{
    uint32_t count = loops->use_first[patch + 1] - loops->use_first[patch];
    *length = 0;
    if (count == 0)
        return wrong(loops, patch, "it has no chains");
    uint32_t first = loops->uses[loops->use_first[patch]], use = first;
    for (uint32_t done = 0; done < count; done++) {
        loops->places[use_start(loops, use)] = (uint32_t)(*length)++;
        for (uint32_t j = 0; j < use_interior_count(loops, use); j++) {
            uint32_t vertex = use_interior(loops, use, j);
            loops->marks[vertex] = patch;
            loops->places[vertex] = (uint32_t)(*length)++;
        }
        uint32_t end = use_end(loops, use);
        if (loops->marks[end] != patch || end >= loops->ends || loops->leaves[end] == NO_INDEX)
            return wrong(loops, patch, "its chains do not close");
        uint32_t next = loops->leaves[end];
        if ((next == first) != (done + 1 == count))
            return wrong(loops, patch, "its chains form more than one loop");
        /* Round the vertex, over this patch, from the chain end of `use` to that of `next`. */
        if (!is_seam(loops, use))
            loops->around[(use >> 1) << 1 | !(use & 1)] =
                is_seam(loops, next) ? NO_INDEX : (next >> 1) << 1 | (next & 1);
        use = next;
    }
    if (*length < 3)
        return wrong(loops, patch, "its boundary has fewer than three edges");
    return STATUS_OK;
}

static int compare_chords(const void *left, const void *right)
{
    const struct chord *a = left, *b = right;
    if (a->low != b->low)
        return a->low < b->low ? -1 : 1;
    return a->high > b->high ? -1 : a->high < b->high;
}

/* length - 3 different chords that do not cross and are no sides triangulate the loop. Sorted,
 * outer before inner, each chord must lie within the innermost open one that has not ended before
 * it. */
static bool is_triangulation(struct chord *chords, uint32_t count, uint32_t length)
{
    qsort(chords, count, sizeof *chords, compare_chords);
    uint32_t open = 0; /* chords[0, open) are reused as the stack of open chords */
    for (uint32_t i = 0; i < count; i++) {
        struct chord chord = chords[i];
        if (chord.high - chord.low < 2 || chord.high - chord.low == length - 1)
            return false;
        while (open && chords[open - 1].high <= chord.low)
            open--;
        if (open) {
            struct chord outer = chords[open - 1];
            if (chord.high > outer.high || (chord.low == outer.low && chord.high == outer.high))
                return false;
        }
        chords[open++] = chord;
    }
    return true;
}

static enum status check_diagonals(struct loops *loops, uint32_t patch, uint64_t length)
{
    const struct patch *record = loops->block->patches + patch;
    uint32_t count = record->diagonal_count;
    if (count != (record->interior_count ? 0 : length - 3))
        return wrong(loops, patch, "its diagonals are not as many as its loop needs");
    if (count == 0)
        return STATUS_OK;
    enum status status = memory_reserve(loops->ctx, &loops->chords, &loops->chord_capacity, count,
                                        sizeof *loops->chords);
    if (status)
        return status;
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t *diagonal =
            loops->block->diagonals + 2 * ((size_t)record->diagonal_first + i);
        if (loops->marks[diagonal[0]] != patch || loops->marks[diagonal[1]] != patch)
            return wrong(loops, patch, "a diagonal ends outside its loop");
        uint32_t a = loops->places[diagonal[0]], b = loops->places[diagonal[1]];
        loops->chords[i] = (struct chord){a < b ? a : b, a < b ? b : a};
    }
    if (!is_triangulation(loops->chords, count, (uint32_t)length))
        return wrong(loops, patch, "its diagonals do not triangulate its loop");
    return STATUS_OK;
}

/* ---- all patches; junctions ---- */

static enum status check_patches(struct loops *loops, uint64_t *most_faces)
{
    for (uint32_t patch = 0; patch < loops->block->patch_count; patch++) {
        uint64_t length;
        enum status status = mark_loop(loops, patch);
        if (!status)
            status = follow_loop(loops, patch, &length);
        if (!status)
            status = check_diagonals(loops, patch, length);
        if (status)
            return status;
        *most_faces += length - 2;
    }
    for (uint32_t v = 0; v < loops->ends; v++)
        if (loops->marks[v] == NO_INDEX)
            return fail(loops->ctx, STATUS_BAD_INPUT, "%s: vertex %u lies on no patch's boundary",
                        loops->what, v);
    return STATUS_OK;
}

/*
 * Round a junction inside the block, `around` leads from chain end to chain end, once over each
 * patch: in a circle, or from one border chain to another. More circles or paths than one would be
 * fans that touch in the vertex. `leaves` and `places` are reused: for each junction, the number of
 * its chain ends, and one of them (where a path begins, if there is one).
 */
static enum status check_fans(struct loops *loops)
{
    const struct chain_block *block = loops->block;
    uint32_t *counts = loops->leaves, *firsts = loops->places;
    for (uint32_t v = 0; v < loops->ends; v++)
        counts[v] = 0;
    for (uint32_t i = 0; i < 2 * block->chain_count; i++) {
        const struct chain *chain = block->chains + (i >> 1);
        uint32_t vertex = i & 1 ? chain->end : chain->start;
        /* The patch on the left of the walk away from the vertex leads here; where there is none,
         * the fan begins: at a border chain's end. */
        bool begins = chain->right == NO_PATCH && (i & 1);
        if (counts[vertex]++ == 0 || begins)
            firsts[vertex] = i;
    }
    for (uint32_t v = 0; v < block->junction_count; v++) {
        uint32_t met = 0, end = firsts[v];
        do {
            met++;
            end = loops->around[end];
        } while (end != NO_INDEX && end != firsts[v] && met <= counts[v]);
        if (met != counts[v])
            return fail(loops->ctx, STATUS_BAD_INPUT,
                        "%s: the patches round junction %u form no single fan", loops->what, v);
    }
    return STATUS_OK;
}

static enum status take_arrays(struct loops *loops)
{
    struct context *ctx = loops->ctx;
    const struct chain_block *block = loops->block;
    enum status status = memory_take_zeroed(ctx, (size_t)block->patch_count + 1, sizeof(uint32_t),
                                            &loops->use_first);
    if (status)
        return status;
    loops->use_count = chain_uses_count(loops->block, loops->use_first);
    status = memory_take(ctx, loops->use_count, sizeof(uint32_t), &loops->uses);
    if (!status)
        status = memory_take(ctx, block->vertex_count, sizeof(uint32_t), &loops->marks);
    if (!status)
        status = memory_take(ctx, block->vertex_count, sizeof(uint32_t), &loops->places);
    if (!status)
        status = memory_take(ctx, loops->ends, sizeof(uint32_t), &loops->leaves);
    if (!status)
        status = memory_take(ctx, block->chain_count, 2 * sizeof(uint32_t), &loops->around);
    if (status)
        return status;
    memset(loops->marks, 0xff, block->vertex_count * sizeof(uint32_t));
    memset(loops->around, 0xff, block->chain_count * (2 * sizeof(uint32_t)));
    return STATUS_OK;
}

enum status chain_loops_check(struct context *ctx, const char *what,
                              const struct chain_block *block, uint64_t *most_faces)
{
    struct loops loops = {.ctx = ctx,
                          .what = what,
                          .block = block,
                          .ends = block->junction_count + block->seam_vertex_count};
    enum status status = STATUS_OK;
    if (block->chain_count > UINT32_MAX / 4 ||
        block->seam_chain_count > UINT32_MAX / 4) /* uses have a bit less */
        return fail(ctx, STATUS_BAD_INPUT, "%s: it has too many chains", what);
    status = take_arrays(&loops);
    if (!status) {
        chain_uses_sort(block, loops.use_first, loops.uses);
        status = check_patches(&loops, most_faces);
    }
    if (!status)
        status = check_fans(&loops);
    memory_release(ctx, &loops.use_first, (size_t)block->patch_count + 1, sizeof(uint32_t));
    memory_release(ctx, &loops.uses, loops.use_count, sizeof(uint32_t));
    memory_release(ctx, &loops.marks, block->vertex_count, sizeof(uint32_t));
    memory_release(ctx, &loops.places, block->vertex_count, sizeof(uint32_t));
    memory_release(ctx, &loops.leaves, loops.ends, sizeof(uint32_t));
    memory_release(ctx, &loops.around, block->chain_count, 2 * sizeof(uint32_t));
    memory_release(ctx, &loops.chords, loops.chord_capacity, sizeof *loops.chords);
    return status;
}
