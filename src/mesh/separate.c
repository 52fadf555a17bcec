/*
 * Separating what is not manifold.
 *
 * adjacency.c has opened all sides of each edge of more than two faces. What lies round a vertex is
 * then one fan or several, and each fan but the first gets a copy of the vertex (Gueziec et al.
 * 2001, "Cutting and stitching": the local form of cutting). To leave it at that would slit what
 * only touches: two cubes with a common edge would each have an open seam along it. So sides of
 * an opened edge are joined again where both their ends have come out as the same vertices. That
 * is safe: a fan that ends in an opened edge has two ends, so at most two sides of that edge can
 * have both ends in common; three can't, and two that do close the fan into a ring, at both ends.
 */
#include "mesh/separate.h"

#include "base/external_sort.h"
#include "base/memory.h"

/* Fans and pairs may lie anywhere: after so many, what they brought in is forgotten. */
enum { FORGET_PAIRS = 64 };

/* ---- copies ---- */

static void rename_fan(struct draft *draft, const struct fan_record *fan, uint32_t copy)
{
    const uint32_t v = fan->vertex;
    bool is_closed = false;
    for (int side = 0; side < 2 && !is_closed; side++) {
        uint32_t at = fan->face;
        unsigned corner = fan->corner;
        unsigned leave = side == 0 ? corner : previous3(corner);
        /* The steps look for v, so the first face keeps it until the end. */
        while (fan_step(draft, 0, (uint32_t)draft->face_count, v, &at, &corner, &leave)) {
            if (at == fan->face) {
                is_closed = true;
                break;
            }
            draft->faces[3 * (size_t)at + corner] = copy;
        }
    }
    draft->faces[3 * (size_t)fan->face + fan->corner] = copy;
}

static enum status count_vertices(struct draft *draft, const struct fan_record *fans,
                                  uint64_t count, uint64_t *split)
{
    struct sorter *sorter = NULL;
    enum status status =
        sorter_open(draft->ctx, 8, 8, room_left(&draft->room) / 4, draft->room.beside, &sorter);
    for (uint64_t i = 0; i < count && status == STATUS_OK; i++) {
        uint64_t key = fans[i].vertex;
        status = sorter_add(sorter, &key, 1);
    }
    if (status == STATUS_OK)
        status = count_distinct(sorter, split);
    sorter_close(&sorter);
    return status;
}

/* ---- joining again ---- */

struct pair_group { /* sides of an opened edge that have both ends in common */
    struct edge_record first;
    struct edge_record second;
    unsigned count;
};

static void end_pair(struct draft *draft, const struct pair_group *group)
{
    if (group->count == 2)
        faces_link(draft, group->first.face, group->first.edge, group->second.face,
                   group->second.edge);
}

static enum status add_sides(struct draft *draft, struct adjacency *cut, struct sorter *sorter)
{
    void *data;
    struct visits visits = {0};
    enum status status = spool_seal(&cut->cut_spool, &data);
    if (status == STATUS_OK)
        status =
            visits_begin(&draft->room, &visits, &draft->face_spool, room_left(&draft->room) / 4);
    const struct edge_record *sides = data;
    for (uint64_t i = 0; i < cut->cut_count && status == STATUS_OK; i++) {
        visit(&visits, sides[i].face * 12ull);
        const uint32_t *face = draft->faces + 3 * (size_t)sides[i].face;
        uint32_t a = face[sides[i].edge], b = face[next3((unsigned)sides[i].edge)];
        struct edge_record side = sides[i];
        side.key = a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
        status = sorter_add(sorter, &side, 1);
        if (i % FORGET_EVERY == 0)
            spool_forget_all(&cut->cut_spool);
    }
    spool_forget_all(&cut->cut_spool);
    visits_end(&visits);
    return status;
}

static enum status link_again(struct draft *draft, struct adjacency *cut)
{
    struct sorter *sorter = NULL;
    enum status status = sorter_open(draft->ctx, sizeof(struct edge_record), 8,
                                     room_left(&draft->room) / 4, draft->room.beside, &sorter);
    if (status == STATUS_OK)
        status = add_sides(draft, cut, sorter);
    if (status == STATUS_OK)
        status = sorter_finish(sorter);
    struct pair_group group = {.count = 0};
    uint64_t pairs = 0;
    while (status == STATUS_OK) {
        const void *data;
        size_t got;
        status = sorter_next(sorter, &data, &got);
        if (status != STATUS_OK || got == 0)
            break;
        const struct edge_record *sides = data;
        for (size_t i = 0; i < got; i++) {
            if (group.count && sides[i].key != group.first.key) {
                end_pair(draft, &group);
                group.count = 0;
                if (++pairs % FORGET_PAIRS == 0)
                    draft_forget_all(draft);
            }
            if (group.count == 2) {
                status = fail(draft->ctx, STATUS_INTERNAL,
                              "three faces of a separated edge have both ends in common");
                break;
            }
            *(group.count++ ? &group.second : &group.first) = sides[i];
        }
    }
    if (status == STATUS_OK)
        end_pair(draft, &group);
    sorter_close(&sorter);
    return status;
}

/* ---- the whole ---- */

enum status separate_fans(struct draft *draft, struct survey *survey, struct adjacency *cut,
                          uint64_t *split, uint64_t *added)
{
    const uint64_t count = survey->fan_count, base = draft->vertex_count;
    if (base + count > draft->index_limit)
        return fail(draft->ctx, STATUS_BAD_INPUT,
                    "separating non-manifold vertices gives %llu of them; a store holds at most "
                    "%llu",
                    (unsigned long long)(base + count), (unsigned long long)draft->index_limit);
    void *data;
    struct spool copy_spool = {0};
    uint32_t *copy_of = NULL;
    uint64_t degenerate;
    enum status status = spool_seal(&survey->fan_spool, &data);
    const struct fan_record *fans = data;
    if (status == STATUS_OK)
        status = room_scratch(&draft->room, &copy_spool, count * sizeof *copy_of, &copy_of);
    if (status == STATUS_OK)
        status = count_vertices(draft, fans, count, split);
    if (status == STATUS_OK) {
        for (uint64_t i = 0; i < count; i++) {
            copy_of[i] = fans[i].vertex;
            rename_fan(draft, &fans[i], (uint32_t)(base + i));
            if (i % FORGET_PAIRS == 0)
                draft_forget_all(draft);
        }
        draft_forget_all(draft);
        *added += count;
        if (cut && cut->cut_count)
            status = link_again(draft, cut);
    }
    if (status == STATUS_OK)
        status = draft_number(draft, base, &copy_spool, copy_of, count, &degenerate);
    spool_clear(&copy_spool);
    return status;
}
