/*
 * Numbering by first use, where neither all numbers fit in memory nor faces come in an order local
 * in space and vertices.
 *
 * One sweep over the faces with an array from old to new numbers would page at random, about once
 * a corner. Instead there are five sequential ones, over buckets that each hold a range of the old
 * numbers: (1) each corner's id goes to its bucket; (2) each bucket by itself ranks its ids by
 * first use; (3) the corners take their ranks, and a rank that is new to its bucket is the first
 * use of its vertex, which now gets its number; (4) each bucket turns ranks into numbers; (5) the
 * corners take them. Each bucket is read from its start to its end, and what is looked up at
 * random is the table of one bucket, which fits.
 */
#include <string.h>

#include "base/memory.h"
#include "mesh/lookup.h"
#include "mesh/number_internal.h"

static inline size_t part_of(const struct numbering *n, uint32_t id)
{
    return id >> n->part_shift;
}

/* (1), for one corner. */
static enum status ask(struct numbering *n, uint32_t *corner)
{
    uint32_t within = *corner & (uint32_t)(((uint64_t)1 << n->part_shift) - 1);
    return bucket_put(&n->within, part_of(n, *corner), &within);
}

/* Closes up the faces and asks for the corners of those that stay. */
static enum status ask_all(struct numbering *n)
{
    struct draft *draft = n->draft;
    uint32_t *faces = draft->faces;
    uint64_t kept = 0;
    enum status status = STATUS_OK;
    for (uint64_t f = 0; f < draft->face_count && status == STATUS_OK; f++) {
        if (f == n->kept)
            f = n->read; /* what has been read and is closed up already */
        if (f == draft->face_count)
            break;
        uint32_t face[3] = {faces[3 * f], faces[3 * f + 1], faces[3 * f + 2]};
        if (face[0] == face[1] || face[1] == face[2] || face[0] == face[2])
            continue;
        for (int k = 0; k < 3 && status == STATUS_OK; k++)
            status = ask(n, &face[k]);
        if (kept != f)
            memcpy(faces + 3 * kept, face, sizeof face);
        kept++;
        if (f % FORGET_EVERY == 0)
            spool_pass(&draft->face_spool, f * 12);
    }
    n->read = draft->face_count;
    n->kept = kept;
    spool_forget_all(&draft->face_spool);
    return status;
}

/* (2), for one part. */
static enum status rank_part(struct numbering *n, size_t part, uint32_t *rank_of)
{
    uint32_t ranks = 0;
    enum status status = STATUS_OK;
    memset(rank_of, 0, sizeof *rank_of << n->part_shift);
    for (uint64_t i = bucket_records(&n->within, part); i > 0 && status == STATUS_OK; i--) {
        uint32_t within, rank;
        status = bucket_take(&n->within, part, &within);
        if (status != STATUS_OK)
            break;
        rank = rank_of[within];
        if (rank == 0) {
            rank = rank_of[within] = ++ranks;
            status = bucket_put(&n->owners, part, &within);
        }
        rank--;
        if (status == STATUS_OK)
            status = bucket_put(&n->ranks, part, &rank);
    }
    return status;
}

/* (3), for one corner. */
static enum status number_rank(struct numbering *n, uint32_t *corner)
{
    const size_t part = part_of(n, *corner);
    uint32_t rank, within;
    enum status status = bucket_take(&n->ranks, part, &rank);
    if (status != STATUS_OK || rank < n->known[part])
        return status;
    n->known[part]++;
    status = bucket_put(&n->starts, part, &n->next);
    if (status == STATUS_OK)
        status = bucket_take(&n->owners, part, &within);
    return status == STATUS_OK ? number_note_id(n, (uint32_t)(part << n->part_shift) + within)
                               : status;
}

/* (4), for one part. */
static enum status number_part(struct numbering *n, size_t part, uint32_t *number_of)
{
    enum status status = STATUS_OK;
    const uint64_t ranks = bucket_records(&n->starts, part);
    for (uint64_t i = 0; i < ranks && status == STATUS_OK; i++)
        status = bucket_take(&n->starts, part, &number_of[i]);
    for (uint64_t i = bucket_records(&n->ranks, part); i > 0 && status == STATUS_OK; i--) {
        uint32_t rank;
        status = bucket_take(&n->ranks, part, &rank);
        if (status == STATUS_OK)
            status = bucket_put(&n->results, part, &number_of[rank]);
    }
    return status;
}

/* (5), for one corner. */
static enum status place_number(struct numbering *n, uint32_t *corner)
{
    uint32_t number;
    enum status status = bucket_take(&n->results, part_of(n, *corner), &number);
    if (status != STATUS_OK)
        return status;
    if (number == n->next)
        n->next++;
    else
        number_note_use(n, number);
    *corner = number;
    return STATUS_OK;
}

static enum status for_all_corners(struct numbering *n, bool cuts_slabs,
                                   enum status (*visit_corner)(struct numbering *n,
                                                               uint32_t *corner))
{
    struct draft *draft = n->draft;
    const uint64_t mask = ((uint64_t)1 << draft->slab_shift) - 1;
    enum status status = STATUS_OK;
    for (uint64_t f = 0; f < n->kept && status == STATUS_OK; f++) {
        if ((f & mask) == 0 && cuts_slabs)
            status = number_begin_slab(n, f, f);
        else if (f % FORGET_EVERY == 0)
            spool_pass(&draft->face_spool, f * 12);
        for (int k = 0; k < 3 && status == STATUS_OK; k++)
            status = visit_corner(n, &draft->faces[3 * f + (uint64_t)k]);
    }
    spool_forget_all(&draft->face_spool);
    return status;
}

static enum status open_buckets(struct numbering *n, struct bucket_file *file)
{
    const struct room *room = &n->draft->room;
    return bucket_file_open(room->ctx, file, n->parts, sizeof(uint32_t), room_left(room) / 8,
                            room->beside);
}

static enum status for_all_parts(struct numbering *n, uint32_t *table,
                                 enum status (*work)(struct numbering *n, size_t part,
                                                     uint32_t *table))
{
    enum status status = STATUS_OK;
    for (size_t part = 0; part < n->parts && status == STATUS_OK; part++) {
        status = work(n, part, table);
        if (status == STATUS_OK)
            status = step(n->draft->ctx, "import: number", part, n->parts);
    }
    return status;
}

static enum status number_by_sweeps(struct numbering *n, uint32_t *table)
{
    enum status status = open_buckets(n, &n->within);
    if (status == STATUS_OK)
        status = ask_all(n);
    if (status == STATUS_OK)
        status = bucket_file_rewind(&n->within);
    if (status == STATUS_OK)
        status = open_buckets(n, &n->ranks);
    if (status == STATUS_OK)
        status = open_buckets(n, &n->owners);
    if (status == STATUS_OK)
        status = for_all_parts(n, table, rank_part);
    bucket_file_close(&n->within);
    if (status == STATUS_OK)
        status = bucket_file_rewind(&n->ranks);
    if (status == STATUS_OK)
        status = bucket_file_rewind(&n->owners);
    if (status == STATUS_OK)
        status = open_buckets(n, &n->starts);
    if (status == STATUS_OK)
        status = for_all_corners(n, false, number_rank);
    bucket_file_close(&n->owners);
    if (status == STATUS_OK)
        status = bucket_file_rewind(&n->ranks);
    if (status == STATUS_OK)
        status = bucket_file_rewind(&n->starts);
    if (status == STATUS_OK)
        status = open_buckets(n, &n->results);
    if (status == STATUS_OK)
        status = for_all_parts(n, table, number_part);
    bucket_file_close(&n->ranks);
    bucket_file_close(&n->starts);
    if (status == STATUS_OK)
        status = bucket_file_rewind(&n->results);
    n->next = n->slab_first = 0;
    if (status == STATUS_OK)
        status = for_all_corners(n, true, place_number);
    return status;
}

enum status number_by_buckets(struct numbering *n)
{
    struct context *ctx = n->draft->ctx;
    n->part_shift =
        part_shift_for(n->id_count, sizeof(uint32_t), room_left(&n->draft->room) / 2, &n->parts);
    uint32_t *table = NULL;
    enum status status = memory_take(ctx, (size_t)1 << n->part_shift, sizeof *table, &table);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, n->parts, sizeof *n->known, &n->known);
    if (status == STATUS_OK)
        status = number_by_sweeps(n, table);
    memory_release(ctx, &table, (size_t)1 << n->part_shift, sizeof *table);
    memory_release(ctx, &n->known, n->parts, sizeof *n->known);
    bucket_file_close(&n->within);
    bucket_file_close(&n->ranks);
    bucket_file_close(&n->owners);
    bucket_file_close(&n->starts);
    bucket_file_close(&n->results);
    return status;
}
