/*
 * Whether a seam vertex is a junction depends on all slabs that touch it, and a seam chain's edges
 * are known to two slabs each. With everything in memory this is a graph to walk; its size is a few
 * per cent of the mesh, which is still in proportion to it. So it is done by four sorts:
 *
 *   1. by edge: the two slabs' views of an edge come together, and it gets its two patches;
 *   2. by vertex: the edge ends and the chain ends of all slabs come together; a vertex is a
 *      junction unless exactly two seam edges and no other chain end there;
 *   3. by pair of patches: the edges that two patches share over a seam come together (no more than
 *      a patch's boundary has) and are followed from junction to junction;
 *   4. by slab: what each block gets.
 *
 * A vertex where just two seam edges meet and nothing else has the same two patches on both, so
 * step 3 never loses a chain. All orders are by number, so the result depends on the blocks alone.
 */
#include "simplify/seam_internal.h"

#include <string.h>

#include "base/memory.h"
#include "mesh/draft.h"

/* Step 2: something that ends at a vertex. */
struct vertex_end {
    uint64_t vertex;
    uint32_t other; /* the edge's other end */
    uint32_t kind;
    uint32_t left_slab, left_patch; /* walking from `vertex` to `other`; the lower slab */
    uint32_t right_slab, right_patch;
};

enum {
    END_LEAVES = 0,  /* a seam edge that starts here, the lower slab on its left */
    END_ARRIVES = 1, /* one that ends here; its other fields are not used */
    END_CHAIN = 2    /* a chain inside some slab */
};

/* ---- a sorter read one record at a time ---- */

struct cursor {
    struct sorter *sorter;
    size_t record_size;
    const char *records;
    size_t count, place;
};

static enum status cursor_open(struct sorter *sorter, size_t record_size, struct cursor *cursor)
{
    *cursor = (struct cursor){.sorter = sorter, .record_size = record_size};
    return sorter_finish(sorter);
}

/* *record is NULL at the end; it is valid until the next call. */
static enum status cursor_next(struct cursor *cursor, const void **record)
{
    *record = NULL;
    if (cursor->place == cursor->count) {
        const void *records;
        enum status status = sorter_next(cursor->sorter, &records, &cursor->count);
        if (status)
            return status;
        cursor->records = records;
        cursor->place = 0;
        if (cursor->count == 0)
            return STATUS_OK;
    }
    *record = cursor->records + cursor->place++ * cursor->record_size;
    return STATUS_OK;
}

/* ---- opening, adding, closing ---- */

enum status seam_join_open(struct context *ctx, const char *beside, uint64_t memory_limit,
                           uint32_t slab_count, struct seam_join **out)
{
    struct seam_join *join;
    *out = NULL;
    enum status status = memory_take_zeroed(ctx, 1, sizeof *join, &join);
    if (status)
        return status;
    join->ctx = ctx;
    join->beside = beside;
    join->sorter_limit = memory_limit / 4; /* two sorts and two spools are alive at a time */
    join->slab_count = slab_count;
    spool_init(ctx, &join->vertex_spool, beside, memory_limit / 16);
    spool_init(ctx, &join->position_spool, beside, memory_limit / 8);
    status = memory_take_zeroed(ctx, slab_count, sizeof *join->parts, &join->parts);
    if (!status)
        status = sorter_open(ctx, sizeof(struct seam_edge), sizeof(uint64_t), join->sorter_limit,
                             beside, &join->edges);
    if (!status)
        status = sorter_open(ctx, sizeof(struct vertex_end), sizeof(uint64_t), join->sorter_limit,
                             beside, &join->ends);
    if (status)
        seam_join_close(&join);
    *out = join;
    return status;
}

void seam_join_close(struct seam_join **join)
{
    struct seam_join *old = *join;
    if (!old)
        return;
    struct context *ctx = old->ctx;
    sorter_close(&old->edges);
    sorter_close(&old->ends);
    sorter_close(&old->pairs);
    sorter_close(&old->chains);
    spool_clear(&old->vertex_spool);
    spool_clear(&old->position_spool);
    memory_release(ctx, &old->parts, old->slab_count, sizeof *old->parts);
    memory_release(ctx, &old->group, old->group_capacity, sizeof *old->group);
    memory_release(ctx, &old->next, old->next_capacity, sizeof *old->next);
    memory_release(ctx, &old->list, old->list_capacity, sizeof *old->list);
    memory_release(ctx, join, 1, sizeof **join);
}

enum status seam_join_add(struct seam_join *join, const struct slab_seams *seams)
{
    if (join->slabs_added == join->slab_count || seams->slab != join->slabs_added)
        return fail(join->ctx, STATUS_INTERNAL, "seams of slab %u come out of order", seams->slab);
    join->parts[join->slabs_added++] =
        (struct slab_part){.vertex_offset = join->vertex_spool.size / sizeof(uint32_t),
                           .vertex_count = (uint32_t)seams->vertex_count,
                           .junction_count = seams->block_junctions};
    enum status status = spool_append(&join->vertex_spool, seams->vertices,
                                      seams->vertex_count * sizeof *seams->vertices);
    if (!status)
        status = spool_append(&join->position_spool, seams->positions,
                              seams->vertex_count * (3 * sizeof *seams->positions));
    if (!status)
        status = sorter_add(join->edges, seams->edges, seams->edge_count);
    for (size_t i = 0; i < seams->junction_count && !status; i++) {
        struct vertex_end end = {.vertex = seams->junctions[i], .kind = END_CHAIN};
        status = sorter_add(join->ends, &end, 1);
    }
    return status;
}

/* ---- step 1: the two views of an edge ---- */

static enum status disagree(struct seam_join *join, uint64_t key)
{
    return fail(join->ctx, STATUS_BAD_INPUT,
                "mesh store: the slabs disagree on the edge between vertices %u and %u",
                (uint32_t)(key >> 32), (uint32_t)key);
}

static enum status add_edge_ends(struct seam_join *join, const struct seam_edge *one,
                                 const struct seam_edge *two)
{
    const struct seam_edge *left = one->slab < two->slab ? one : two;
    const struct seam_edge *right = left == one ? two : one;
    uint32_t low = (uint32_t)(left->key >> 32), high = (uint32_t)left->key;
    bool down = left->side & 1;
    struct vertex_end ends[2];
    ends[0] = (struct vertex_end){.vertex = down ? high : low,
                                  .other = down ? low : high,
                                  .kind = END_LEAVES,
                                  .left_slab = left->slab,
                                  .left_patch = left->side >> 1,
                                  .right_slab = right->slab,
                                  .right_patch = right->side >> 1};
    ends[1] = ends[0];
    ends[1].vertex = ends[0].other;
    ends[1].other = (uint32_t)ends[0].vertex;
    ends[1].kind = END_ARRIVES;
    return sorter_add(join->ends, ends, 2);
}

static enum status match_edges(struct seam_join *join)
{
    struct cursor cursor;
    enum status status =
        sorter_expect(join->ends, sorter_count(join->ends) + sorter_count(join->edges));
    if (!status)
        status = cursor_open(join->edges, sizeof(struct seam_edge), &cursor);
    while (!status) {
        const void *record;
        status = cursor_next(&cursor, &record);
        if (status || !record)
            break;
        struct seam_edge one;
        memcpy(&one, record, sizeof one);
        status = cursor_next(&cursor, &record);
        if (status)
            break;
        struct seam_edge two = {0};
        if (record)
            memcpy(&two, record, sizeof two);
        if (!record || two.key != one.key || two.slab == one.slab ||
            (two.side & 1) == (one.side & 1))
            return disagree(join, one.key);
        status = add_edge_ends(join, &one, &two);
    }
    sorter_close(&join->edges);
    return status;
}

/* ---- step 2: junctions ---- */

/* All ends at one vertex, in join->group's place: few of them leave. */
struct vertex_group {
    uint64_t vertex;
    uint32_t edges;
    bool has_chain;
    size_t leaving; /* in join->group */
};

static enum status close_vertex(struct seam_join *join, const struct vertex_group *group,
                                struct seam_counts *counts)
{
    bool is_junction = group->has_chain || group->edges != 2;
    counts->vertices++;
    counts->junctions += is_junction;
    for (size_t i = 0; i < group->leaving; i++)
        join->group[i].from_junction = is_junction;
    return sorter_add(join->pairs, join->group, group->leaving);
}

static enum status add_leaving(struct seam_join *join, const struct vertex_end *end,
                               struct vertex_group *group)
{
    enum status status = memory_reserve(join->ctx, &join->group, &join->group_capacity,
                                        group->leaving + 1, sizeof *join->group);
    if (!status)
        join->group[group->leaving++] =
            (struct pair_edge){.left = (uint64_t)end->left_slab << 32 | end->left_patch,
                               .right = (uint64_t)end->right_slab << 32 | end->right_patch,
                               .from = (uint32_t)end->vertex,
                               .to = end->other};
    return status;
}

static enum status find_junctions(struct seam_join *join, struct seam_counts *counts)
{
    struct cursor cursor;
    struct vertex_group group = {.vertex = UINT64_MAX};
    enum status status = cursor_open(join->ends, sizeof(struct vertex_end), &cursor);
    while (!status) {
        const void *record;
        status = cursor_next(&cursor, &record);
        if (status)
            break;
        struct vertex_end end = {.vertex = UINT64_MAX};
        if (record)
            memcpy(&end, record, sizeof end);
        if (end.vertex != group.vertex) {
            if (group.vertex != UINT64_MAX)
                status = close_vertex(join, &group, counts);
            group = (struct vertex_group){.vertex = end.vertex};
        }
        if (status || !record)
            break;
        if (end.kind == END_CHAIN)
            group.has_chain = true;
        else
            group.edges++;
        if (end.kind == END_LEAVES)
            status = add_leaving(join, &end, &group);
    }
    sorter_close(&join->ends);
    return status;
}

/* ---- step 3: pairs of patches ---- */

static enum status link_pairs(struct seam_join *join, struct seam_counts *counts)
{
    struct cursor cursor;
    size_t count = 0;
    enum status status = cursor_open(join->pairs, sizeof(struct pair_edge), &cursor);
    while (!status) {
        const void *record;
        status = cursor_next(&cursor, &record);
        if (status)
            break;
        struct pair_edge edge = {0};
        if (record)
            memcpy(&edge, record, sizeof edge);
        if (count &&
            (!record || edge.left != join->group[0].left || edge.right != join->group[0].right)) {
            status = seam_link_group(join, count, counts);
            count = 0;
        }
        if (status || !record)
            break;
        status = memory_reserve(join->ctx, &join->group, &join->group_capacity, count + 1,
                                sizeof *join->group);
        if (!status)
            join->group[count++] = edge;
    }
    counts->chains = join->chain_count;
    sorter_close(&join->pairs);
    return status;
}

enum status seam_join_link(struct seam_join *join, struct seam_counts *counts)
{
    memset(counts, 0, sizeof *counts);
    void *vertices, *positions;
    enum status status = spool_seal(&join->vertex_spool, &vertices);
    if (!status)
        status = spool_seal(&join->position_spool, &positions);
    if (status)
        return status;
    join->vertices = vertices;
    join->positions = positions;
    status = match_edges(join);
    if (!status)
        status = sorter_open(join->ctx, sizeof(struct pair_edge), 2 * sizeof(uint64_t),
                             join->sorter_limit, join->beside, &join->pairs);
    if (!status)
        status = sorter_expect(join->pairs, sorter_count(join->ends) / 2);
    if (!status)
        status = find_junctions(join, counts);
    if (!status)
        status = sorter_open(join->ctx, sizeof(struct chain_vertex), 2 * sizeof(uint64_t),
                             join->sorter_limit, join->beside, &join->chains);
    if (!status) /* two views of each vertex; with short chains, of many twice */
        status = sorter_expect(join->chains, 3 * sorter_count(join->pairs));
    if (!status) {
        sorter_comes_ordered(join->chains, 63); /* by place; but for the patches */
        status = link_pairs(join, counts);
    }
    if (!status)
        status = sorter_finish(join->chains);
    return status;
}

/* ---- step 4: what each block gets ---- */

enum status seam_find_vertex(struct seam_join *join, uint32_t slab, uint32_t vertex,
                             uint32_t *place)
{
    const struct slab_part *part = join->parts + slab;
    const uint32_t *first = join->vertices + part->vertex_offset;
    *place = foreign_rank(first, part->vertex_count, vertex);
    if (*place == part->vertex_count || first[*place] != vertex)
        return fail(join->ctx, STATUS_BAD_INPUT,
                    "mesh store: vertex %u is not on a seam of slab %u", vertex, slab);
    return STATUS_OK;
}

/* The next record if it belongs to `slab`, else NULL. */
static enum status next_of_slab(struct seam_join *join, uint32_t slab,
                                const struct chain_vertex **record)
{
    *record = NULL;
    if (join->pending_place == join->pending_count) {
        const void *records;
        enum status status = sorter_next(join->chains, &records, &join->pending_count);
        if (status)
            return status;
        join->pending = records;
        join->pending_place = 0;
        if (join->pending_count == 0)
            return STATUS_OK;
    }
    if (join->pending[join->pending_place].side >> 32 == slab)
        *record = join->pending + join->pending_place++;
    return STATUS_OK;
}

struct seam_lists {
    struct seam_chain *chains;
    size_t chain_count, chain_capacity;
    uint32_t *list;
    size_t list_count, list_capacity;
};

static enum status add_list_vertex(struct seam_join *join, uint32_t slab,
                                   const struct chain_vertex *record, struct seam_lists *lists)
{
    struct context *ctx = join->ctx;
    const struct slab_part *part = join->parts + slab;
    uint32_t place = 0;
    enum status status = seam_find_vertex(join, slab, record->vertex, &place);
    if (status)
        return status;
    status = memory_reserve(ctx, &lists->list, &lists->list_capacity, lists->list_count + 1,
                            sizeof *lists->list);
    if (!status && (record->place & ((1 << PLACE_SHIFT) - 1)) == 0) {
        status = memory_reserve(ctx, &lists->chains, &lists->chain_capacity, lists->chain_count + 1,
                                sizeof *lists->chains);
        if (!status)
            lists->chains[lists->chain_count++] =
                (struct seam_chain){.left = (uint32_t)record->side,
                                    .other_slab = record->other_slab,
                                    .right = record->other_patch,
                                    .vertex_first = (uint32_t)lists->list_count,
                                    .vertex_count = record->count};
    }
    if (!status)
        lists->list[lists->list_count++] = part->junction_count + place;
    return status;
}

enum status seam_join_next(struct seam_join *join, struct chain_block *block)
{
    struct context *ctx = join->ctx;
    struct seam_lists lists = {0};
    uint32_t slab = join->slabs_given++;
    memset(block, 0, sizeof *block);
    block->slab = slab;
    enum status status = STATUS_OK;
    while (!status) {
        const struct chain_vertex *record;
        status = next_of_slab(join, slab, &record);
        if (status || !record)
            break;
        status = add_list_vertex(join, slab, record, &lists);
    }
    if (!status)
        status = memory_resize(ctx, &lists.chains, lists.chain_capacity, lists.chain_count,
                               sizeof *lists.chains);
    if (!status) {
        lists.chain_capacity = lists.chain_count;
        status = memory_resize(ctx, &lists.list, lists.list_capacity, lists.list_count,
                               sizeof *lists.list);
    }
    if (status) {
        memory_release(ctx, &lists.chains, lists.chain_capacity, sizeof *lists.chains);
        memory_release(ctx, &lists.list, lists.list_capacity, sizeof *lists.list);
        return status;
    }
    block->seam_chains = lists.chains;
    block->seam_chain_count = (uint32_t)lists.chain_count;
    block->seam_lists = lists.list;
    block->seam_list_count = (uint32_t)lists.list_count;
    return STATUS_OK;
}
