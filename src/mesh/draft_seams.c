/*
 * Edges between slabs, entered when a slab is looked at.
 *
 * The map of the neighbours is made a private one: what is written to it becomes a page of the
 * process's own, which goes when the slab is forgotten. Slabs of whole pages only, or forgetting
 * one would take from the next: the small ones of tests are entered for good.
 */
#include "mesh/draft.h"

#include <unistd.h>

#include "base/memory.h"

enum { FORGET_SEAMS = 4096 }; /* looked at pages of the neighbours, each one of its own at worst */

static bool are_kept(const struct draft *draft)
{
    const uint64_t page = (uint64_t)sysconf(_SC_PAGESIZE);
    return draft->neighbour_spool.map && ((uint64_t)1 << draft->slab_shift) % page == 0;
}

void draft_drop_seams(struct draft *draft)
{
    spool_clear(&draft->seam_spool);
    draft->seams = NULL;
    memory_release(draft->ctx, &draft->seam_first, (size_t)draft->slab_count + 1,
                   sizeof *draft->seam_first);
}

static void enter(const struct draft *draft, const struct seam *seams, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const uint64_t face = seams[i].key >> 2;
        const unsigned edge = seams[i].key & 3;
        draft->neighbours[3 * face + edge] = seams[i].over;
        mate_set(draft->mates, face, edge, seams[i].mate);
    }
}

enum status draft_add_seams(struct draft *draft, const struct seam *seams, size_t count)
{
    if (!are_kept(draft)) {
        for (size_t i = 0; i < count; i += FORGET_SEAMS) {
            enter(draft, seams + i, count - i < FORGET_SEAMS ? count - i : FORGET_SEAMS);
            draft_forget_all(draft);
        }
        return STATUS_OK;
    }
    enum status status = STATUS_OK;
    if (!draft->seam_first) {
        spool_init(draft->ctx, &draft->seam_spool, draft->room.beside,
                   room_spool_limit(&draft->room, 4));
        status = memory_take_zeroed(draft->ctx, (size_t)draft->slab_count + 1,
                                    sizeof *draft->seam_first, &draft->seam_first);
    }
    for (size_t i = 0; i < count && status == STATUS_OK; i++)
        draft->seam_first[(seams[i].key >> (2 + draft->slab_shift)) + 1]++;
    return status == STATUS_OK ? spool_append(&draft->seam_spool, seams, count * sizeof *seams)
                               : status;
}

enum status draft_end_seams(struct draft *draft)
{
    if (!draft->seam_first)
        return STATUS_OK;
    void *data;
    enum status status = spool_seal(&draft->seam_spool, &data);
    for (uint32_t i = 0; i < draft->slab_count; i++)
        draft->seam_first[i + 1] += draft->seam_first[i];
    if (status == STATUS_OK)
        status = spool_set_private(&draft->neighbour_spool, true);
    if (status == STATUS_OK)
        status = spool_set_private(&draft->mate_spool, true);
    if (status != STATUS_OK)
        return status;
    spool_jumps(&draft->neighbour_spool);
    spool_jumps(&draft->mate_spool);
    draft->seams = data;
    return STATUS_OK;
}

void draft_enter_slab(const struct draft *draft, uint64_t slab)
{
    draft_expect_slab(draft, slab);
    if (!draft->seams)
        return;
    const uint64_t first = draft->seam_first[slab], end = draft->seam_first[slab + 1];
    enter(draft, draft->seams + first, (size_t)(end - first));
    spool_forget(&draft->seam_spool, first * sizeof *draft->seams,
                 (end - first) * sizeof *draft->seams);
}

enum status draft_settle_seams(struct draft *draft)
{
    if (!draft->seams)
        return STATUS_OK;
    enum status status = spool_set_private(&draft->neighbour_spool, false);
    if (status == STATUS_OK)
        status = spool_set_private(&draft->mate_spool, false);
    if (status != STATUS_OK)
        return status;
    spool_jumps(&draft->neighbour_spool);
    spool_jumps(&draft->mate_spool);
    for (uint32_t slab = 0; slab < draft->slab_count; slab++) {
        draft_enter_slab(draft, slab);
        draft_forget_slab(draft, slab);
    }
    draft_drop_seams(draft);
    return STATUS_OK;
}

uint32_t draft_neighbour(const struct draft *draft, uint64_t face, unsigned edge)
{
    if (draft->seams) {
        const uint64_t slab = face >> draft->slab_shift, key = code_of((uint32_t)face, edge);
        uint64_t low = draft->seam_first[slab], high = draft->seam_first[slab + 1];
        const uint64_t end = high;
        while (low < high) {
            const uint64_t middle = low + (high - low) / 2;
            if (draft->seams[middle].key < key)
                low = middle + 1;
            else
                high = middle;
        }
        if (low < end && draft->seams[low].key == key)
            return draft->seams[low].over;
    }
    return draft->neighbours[3 * face + edge];
}
