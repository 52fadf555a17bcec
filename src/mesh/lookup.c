/*
 * Look-ups in a window, or by distribution.
 *
 * A page fault for each of a billion look-ups takes days, and sorting the questions by place and
 * the answers back costs several passes over each. But the walk can be repeated, and each question
 * alone tells which part of the table it is for; so nothing needs to be sorted: a question is the
 * 4 bytes of the place within its part, an answer is the element, and both stay in the walk's order
 * within their part.
 */
#include "mesh/lookup.h"

#include "base/memory.h"

/* Times that a table may come in piece by piece before the walk is called scattered. */
enum { SWEEPS = 3, LEAST_PART_SHIFT = 4, MOST_PARTS = 1 << 16 };

unsigned part_shift_for(uint64_t count, size_t element_size, uint64_t share, size_t *parts)
{
    unsigned shift = LEAST_PART_SHIFT;
    while (shift < 32 && ((uint64_t)element_size << (shift + 1)) <= share)
        shift++;
    while (shift < 32 && count >> shift >= MOST_PARTS)
        shift++;
    *parts = (size_t)(count >> shift) + 1;
    return shift;
}

enum status lookup_open(const struct room *room, struct lookup *lookup, const struct spool *spool,
                        const void *table, size_t element_size, uint64_t count)
{
    *lookup = (struct lookup){.room = room,
                              .spool = spool,
                              .table = table,
                              .element_size = element_size,
                              .count = count,
                              .most_visits = UINT64_MAX};
    uint64_t left = room_left(room);
    uint64_t window = left / 4 * 3;
    enum status status = visits_begin(room, &lookup->visits, spool, window);
    if (lookup->visits.most < lookup->visits.block_count)
        lookup->most_visits = SWEEPS * lookup->visits.block_count + lookup->visits.most;
    return status;
}

void lookup_close(struct lookup *lookup)
{
    visits_end(&lookup->visits);
    bucket_file_close(&lookup->questions);
    bucket_file_close(&lookup->answers);
}

enum status lookup_ask_begin(struct lookup *lookup)
{
    visits_end(&lookup->visits);
    uint64_t left = room_left(lookup->room);
    size_t parts;
    lookup->part_shift = part_shift_for(lookup->count, lookup->element_size, left / 2, &parts);
    return bucket_file_open(lookup->room->ctx, &lookup->questions, parts, sizeof(uint32_t),
                            left / 8, lookup->room->beside);
}

enum status lookup_answer(struct lookup *lookup)
{
    const size_t parts = lookup->questions.bucket_count;
    enum status status = bucket_file_rewind(&lookup->questions);
    if (status == STATUS_OK)
        status = bucket_file_open(lookup->room->ctx, &lookup->answers, parts, lookup->element_size,
                                  room_left(lookup->room) / 8, lookup->room->beside);
    for (size_t part = 0; part < parts && status == STATUS_OK; part++) {
        const uint64_t size = (uint64_t)lookup->element_size << lookup->part_shift;
        const unsigned char *table = lookup->table + part * size;
        for (uint64_t i = bucket_records(&lookup->questions, part); i > 0; i--) {
            uint32_t within;
            status = bucket_take(&lookup->questions, part, &within);
            if (status == STATUS_OK)
                status = bucket_put(&lookup->answers, part, table + within * lookup->element_size);
            if (status != STATUS_OK)
                return status;
        }
        spool_forget(lookup->spool, part * size, size);
        status = step(lookup->room->ctx, "import: look up", part, parts);
    }
    bucket_file_close(&lookup->questions);
    if (status == STATUS_OK)
        status = bucket_file_rewind(&lookup->answers);
    return status;
}
