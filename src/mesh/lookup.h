/*
 * Looking up many numbers in a table that may be larger than the memory.
 *
 * A walk asks for element after element. As long as what it asks for lies close together, or all of
 * the table fits, the elements are looked at where they are. If the walk turns out to jump about in
 * a table that does not fit, it is done again in three steps: the same walk puts all its questions
 * into buckets, each for a part of the table that fits; the answers are found part by part; and the
 * same walk takes them in its own order.
 */
#ifndef SPBM_MESH_LOOKUP_H
#define SPBM_MESH_LOOKUP_H

#include "base/bucket_file.h"
#include "mesh/room.h"

struct lookup {
    const struct room *room;
    const struct spool *spool;
    const unsigned char *table;
    size_t element_size;
    uint64_t count;
    struct visits visits;
    uint64_t most_visits; /* more are not worth it */
    unsigned part_shift;  /* log2 of the elements that are looked up at a time */
    struct bucket_file questions, answers;
};

/* `table` is what the sealed `spool` holds: `count` elements. lookup_close is due on failure too.
 */
enum status lookup_open(const struct room *room, struct lookup *lookup, const struct spool *spool,
                        const void *table, size_t element_size, uint64_t count) MUST_CHECK;
void lookup_close(struct lookup *lookup); /* safe when all zero */

/* The element, at once; valid until the next call. */
static inline const void *lookup_now(struct lookup *lookup, uint64_t index)
{
    visit(&lookup->visits, index * lookup->element_size);
    return lookup->table + index * lookup->element_size;
}

/* Whether the walk so far jumped about too much: it should be given up, and begun again with
 * lookup_ask. */
static inline bool lookup_is_scattered(const struct lookup *lookup)
{
    return lookup->visits.total > lookup->most_visits;
}

enum status lookup_ask_begin(struct lookup *lookup) MUST_CHECK;

static inline enum status lookup_ask(struct lookup *lookup, uint64_t index)
{
    uint32_t within = (uint32_t)(index & (((uint64_t)1 << lookup->part_shift) - 1));
    return bucket_put(&lookup->questions, (size_t)(index >> lookup->part_shift), &within);
}

/* All questions have been asked. */
enum status lookup_answer(struct lookup *lookup) MUST_CHECK;

/* The answer to the next question, which was for `index`. */
static inline enum status lookup_next(struct lookup *lookup, uint64_t index, void *element)
{
    return bucket_take(&lookup->answers, (size_t)(index >> lookup->part_shift), element);
}

/* log2 of how many elements of a table are worked on at a time, so that `share` bytes are enough,
 * and how many such parts there are. */
unsigned part_shift_for(uint64_t count, size_t element_size, uint64_t share, size_t *parts);

#endif
