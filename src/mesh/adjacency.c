/*
 * Finding the two faces of each edge.
 *
 * A slab at a time is matched in arrays that stay in the cache (slab_match.h).
 *
 * An edge can have faces in several slabs only if both its ends are shared between slabs. All sides
 * of such edges, some per cent of all, are sorted by their ends, and what stands together is
 * matched. What was matched is sorted once more, by face, and becomes the draft's seams. Edges of
 * more than two faces are opened on all sides, for separate.c.
 */
#include "mesh/adjacency.h"

#include <string.h>

#include "base/external_sort.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "mesh/slab_match.h"

struct found { /* what a slab hands on */
    struct edge_record *joint;
    size_t joint_count, joint_capacity;
    struct edge_record *cut;
    size_t cut_count, cut_capacity;
    uint32_t *twins; /* faces with the vertices of their only neighbour, an earlier one */
    size_t twin_count, twin_capacity;
    uint64_t crossing;
};

struct build {
    struct draft *draft;
    struct adjacency *result;
    uint64_t crossing_limit;
    struct slab_matcher *matchers; /* one a worker */
    struct found *found;
    unsigned in_flight;
    struct sorter *joint;
    struct sorter *seams; /* struct seam */
    struct sorter *twins; /* faces to be looked at once all is joined, as 8-byte keys */
    struct seam last;     /* before the one at hand; */
    unsigned alike;       /* so many with it are of one face and one neighbour */
};

/* ---- a slab ---- */

static enum status append_edge(struct context *ctx, struct edge_record **list, size_t *count,
                               size_t *capacity, struct edge_record record)
{
    if (*count == *capacity) {
        enum status status = memory_reserve(ctx, list, capacity, *count + 1024, sizeof **list);
        if (status != STATUS_OK)
            return status;
    }
    (*list)[(*count)++] = record;
    return STATUS_OK;
}

static struct edge_record make_record(uint32_t a, uint32_t b, uint32_t face, unsigned edge)
{
    uint64_t key = a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
    return (struct edge_record){key, face, edge};
}

/* Sorts out what the slab alone can't settle of a face: edges for the join, edges to be opened,
 * twins. */
static enum status collect_face(const struct draft *draft, uint32_t f, struct found *found)
{
    const uint32_t *face = draft->faces + 3 * (size_t)f;
    uint32_t *over = draft->neighbours + 3 * (size_t)f;
    enum status status = STATUS_OK;
    unsigned shared = 0;
    for (unsigned k = 0; k < 3; k++)
        shared |= (unsigned)is_shared(draft, face[k]) << k;
    if (over[0] == over[1] && over[1] == over[2] && over[0] < f) {
        status = memory_reserve(draft->ctx, &found->twins, &found->twin_capacity,
                                found->twin_count + 1, sizeof *found->twins);
        if (status != STATUS_OK)
            return status;
        found->twins[found->twin_count++] = f;
    }
    const bool is_usual = (shared & (shared - 1)) == 0;
    for (unsigned k = 0; k < 3; k++) {
        if (is_usual && over[k] != CROWDED)
            continue;
        struct edge_record record = make_record(face[k], face[next3(k)], f, k);
        if (shared >> k & shared >> next3(k) & 1) {
            if (over[k] == NO_INDEX)
                found->crossing++;
            status = append_edge(draft->ctx, &found->joint, &found->joint_count,
                                 &found->joint_capacity, record);
        } else if (over[k] == CROWDED) {
            status = append_edge(draft->ctx, &found->cut, &found->cut_count, &found->cut_capacity,
                                 record);
        }
        if (status != STATUS_OK)
            return status;
        if (over[k] == CROWDED)
            over[k] = NO_INDEX; /* its mate is 0 */
    }
    return STATUS_OK;
}

/* The same of all faces. Where the slab is plain, only its rim has anything. */
static enum status collect(const struct build *build, const struct slab_matcher *m, bool is_plain,
                           struct found *found)
{
    const uint32_t first = m->scope.face_first, count = m->scope.face_count;
    enum status status = STATUS_OK;
    for (uint32_t begin = 0; begin < count && status == STATUS_OK; begin += 64) {
        const uint64_t all = count - begin < 64 ? ((uint64_t)1 << (count - begin)) - 1 : UINT64_MAX;
        for (uint64_t left = is_plain ? m->rim[begin / 64] : all;
             left && status == STATUS_OK && found->crossing <= build->crossing_limit;
             left &= left - 1)
            status =
                collect_face(build->draft, first + begin + (uint32_t)__builtin_ctzll(left), found);
    }
    return status;
}

static enum status match_slab(void *user, uint64_t job, unsigned worker)
{
    struct build *build = user;
    struct draft *draft = build->draft;
    struct slab_matcher *m = &build->matchers[worker];
    struct found *found = &build->found[job % build->in_flight];
    found->joint_count = found->cut_count = found->twin_count = 0;
    found->crossing = 0;
    bool is_plain;
    enum status status = slab_match(draft, (uint32_t)job, m, &is_plain);
    if (status != STATUS_OK)
        return status;
    draft->is_plain[job] = is_plain;
    return collect(build, m, is_plain, found);
}

static enum status add_twin(struct build *build, uint32_t face)
{
    const uint64_t key = face;
    return sorter_add(build->twins, &key, 1);
}

static enum status finish_slab(void *user, uint64_t job)
{
    struct build *build = user;
    struct adjacency *result = build->result;
    struct found *found = &build->found[job % build->in_flight];
    result->crossing += found->crossing;
    if (result->crossing > build->crossing_limit) {
        result->is_over_limit = true;
        return STATUS_CANCELLED; /* ends the loop; no failure is recorded */
    }
    enum status status = sorter_add(build->joint, found->joint, found->joint_count);
    if (status == STATUS_OK)
        status =
            spool_append(&result->cut_spool, found->cut, found->cut_count * sizeof *found->cut);
    for (size_t i = 0; i < found->twin_count && status == STATUS_OK; i++)
        status = add_twin(build, found->twins[i]);
    draft_forget_slab(build->draft, job);
    if (status == STATUS_OK)
        status = step(build->draft->ctx, "import: adjacency", job, build->draft->slab_count);
    return status;
}

/* ---- across slabs ---- */

struct edge_group { /* the sides of one edge, as they come out of the sort */
    struct edge_record first;
    struct edge_record second;
    uint64_t count;
};

/* Edge k of f has edge m of g over it (NO_INDEX: nothing); the other way round is another call. */
static enum status enter(struct build *build, uint32_t f, unsigned k, uint32_t g, unsigned m)
{
    const struct seam seam = {code_of(f, k), g, m};
    return sorter_add(build->seams, &seam, 1);
}

static enum status end_group(struct build *build, const struct edge_group *group)
{
    const struct edge_record *a = &group->first, *b = &group->second;
    const unsigned shift = build->draft->slab_shift;
    if (group->count != 2 || a->face >> shift == b->face >> shift) /* matched in the slab */
        return STATUS_OK;
    enum status status = enter(build, a->face, a->edge, b->face, b->edge);
    return status == STATUS_OK ? enter(build, b->face, b->edge, a->face, a->edge) : status;
}

static enum status open_side(struct build *build, const struct edge_record *side)
{
    enum status status = enter(build, side->face, side->edge, NO_INDEX, 0);
    return status == STATUS_OK ? spool_append(&build->result->cut_spool, side, sizeof *side)
                               : status;
}

static enum status add_to_group(struct build *build, struct edge_group *group,
                                const struct edge_record *side)
{
    enum status status = STATUS_OK;
    if (group->count && side->key != group->first.key) {
        status = end_group(build, group);
        group->count = 0;
    }
    group->count++;
    if (group->count == 1) {
        group->first = *side;
    } else if (group->count == 2) {
        group->second = *side;
    } else {
        if (group->count == 3) {
            status = open_side(build, &group->first);
            if (status == STATUS_OK)
                status = open_side(build, &group->second);
        }
        if (status == STATUS_OK)
            status = open_side(build, side);
    }
    return status;
}

/* A twin in another slab is over all three edges, which come one after the other. */
static enum status watch_twins(struct build *build, const struct seam *seam)
{
    const bool goes_on =
        build->alike && seam->key >> 2 == build->last.key >> 2 && seam->over == build->last.over;
    build->alike = goes_on ? build->alike + 1 : 1;
    build->last = *seam;
    return build->alike == 3 && seam->over < seam->key >> 2
               ? add_twin(build, (uint32_t)(seam->key >> 2))
               : STATUS_OK;
}

/* What was found, face by face. */
static enum status take_seams(struct build *build)
{
    enum status status = sorter_finish(build->seams);
    while (status == STATUS_OK) {
        const void *data;
        size_t count;
        status = sorter_next(build->seams, &data, &count);
        if (status != STATUS_OK || count == 0)
            break;
        const struct seam *seams = data;
        for (size_t i = 0; i < count && status == STATUS_OK; i++)
            status = watch_twins(build, &seams[i]);
        if (status == STATUS_OK)
            status = draft_add_seams(build->draft, seams, count);
    }
    sorter_close(&build->seams);
    return status == STATUS_OK ? draft_end_seams(build->draft) : status;
}

static enum status join_slabs(struct build *build)
{
    struct draft *draft = build->draft;
    enum status status = sorter_finish(build->joint);
    if (status == STATUS_OK)
        status = sorter_open(draft->ctx, sizeof(struct seam), 8, room_left(&draft->room) / 2,
                             draft->room.beside, &build->seams);
    struct edge_group group = {.count = 0};
    while (status == STATUS_OK) {
        const void *data;
        size_t count;
        status = sorter_next(build->joint, &data, &count);
        if (status != STATUS_OK || count == 0)
            break;
        const struct edge_record *sides = data;
        for (size_t i = 0; i < count && status == STATUS_OK; i++)
            status = add_to_group(build, &group, &sides[i]);
    }
    if (status == STATUS_OK)
        status = end_group(build, &group);
    sorter_close(&build->joint);
    return status == STATUS_OK ? take_seams(build) : status;
}

/* ---- duplicate faces ---- */

static enum status mark_duplicate(struct build *build, uint32_t face)
{
    struct draft *draft = build->draft;
    struct adjacency *result = build->result;
    const uint64_t key = face;
    enum status status = STATUS_OK;
    if (!result->duplicates)
        status = sorter_open(draft->ctx, 8, 8, room_left(&draft->room) / 8, draft->room.beside,
                             &result->duplicates);
    result->has_duplicates = true;
    return status == STATUS_OK ? sorter_add(result->duplicates, &key, 1) : status;
}

/* Twins: two faces whose three edges have no other faces. */
static enum status mark_twins(struct build *build)
{
    struct draft *draft = build->draft;
    uint64_t last_slab = 0;
    enum status status = sorter_finish(build->twins);
    while (status == STATUS_OK) {
        const void *data;
        size_t count;
        status = sorter_next(build->twins, &data, &count);
        if (status != STATUS_OK || count == 0)
            break;
        const uint64_t *twins = data;
        for (size_t i = 0; i < count && status == STATUS_OK; i++) {
            uint32_t over[3];
            for (unsigned k = 0; k < 3; k++)
                over[k] = draft_neighbour(draft, twins[i], k);
            if (over[0] == over[1] && over[1] == over[2] && over[0] != NO_INDEX)
                status = mark_duplicate(build, (uint32_t)twins[i]);
            if (twins[i] >> draft->slab_shift != last_slab)
                draft_forget_slab(draft, last_slab);
            last_slab = twins[i] >> draft->slab_shift;
        }
    }
    draft_forget_slab(draft, last_slab);
    return status;
}

struct triple_record {
    uint64_t low_middle; /* vertices of a face in ascending order */
    uint64_t high_face;
};

static struct triple_record make_triple(const uint32_t *face, uint32_t number)
{
    uint32_t a = face[0], b = face[1], c = face[2], swap;
    if (a > b)
        swap = a, a = b, b = swap;
    if (b > c)
        swap = b, b = c, c = swap;
    if (a > b)
        swap = a, a = b, b = swap;
    return (struct triple_record){(uint64_t)a << 32 | b, (uint64_t)c << 32 | number};
}

/* All other duplicates have an edge of more than two faces. A face comes up to three times. */
static enum status sort_triples(struct build *build, struct sorter *sorter)
{
    struct draft *draft = build->draft;
    void *data;
    struct visits visits = {0};
    enum status status = spool_seal(&build->result->cut_spool, &data);
    const struct edge_record *cut = data;
    build->result->cut_count = build->result->cut_spool.size / sizeof *cut;
    if (status == STATUS_OK)
        status =
            visits_begin(&draft->room, &visits, &draft->face_spool, room_left(&draft->room) / 4);
    for (uint64_t i = 0; i < build->result->cut_count && status == STATUS_OK; i++) {
        visit(&visits, cut[i].face * 12ull);
        struct triple_record triple =
            make_triple(draft->faces + 3 * (size_t)cut[i].face, cut[i].face);
        status = sorter_add(sorter, &triple, 1);
        if (i % FORGET_EVERY == 0)
            spool_forget_all(&build->result->cut_spool);
    }
    spool_forget_all(&build->result->cut_spool);
    visits_end(&visits);
    if (status == STATUS_OK)
        status = sorter_finish(sorter);
    return status;
}

static enum status mark_equal_triples(struct build *build, struct sorter *sorter)
{
    struct triple_record group = {0, 0};
    bool has_group = false;
    for (;;) {
        size_t count;
        const void *data;
        enum status status = sorter_next(sorter, &data, &count);
        if (status != STATUS_OK || count == 0)
            return status;
        const struct triple_record *triples = data;
        for (size_t i = 0; i < count && status == STATUS_OK; i++) {
            if (!has_group || triples[i].low_middle != group.low_middle ||
                triples[i].high_face >> 32 != group.high_face >> 32) {
                group = triples[i];
                has_group = true;
            } else if (triples[i].high_face != group.high_face) {
                status = mark_duplicate(build, (uint32_t)triples[i].high_face);
            }
        }
        if (status != STATUS_OK)
            return status;
    }
}

static enum status count_cut_edges(struct build *build)
{
    struct draft *draft = build->draft;
    struct adjacency *result = build->result;
    void *data;
    enum status status = spool_seal(&result->cut_spool, &data);
    const struct edge_record *cut = data;
    struct sorter *sorter = NULL;
    if (status == STATUS_OK)
        status =
            sorter_open(draft->ctx, 8, 8, room_left(&draft->room) / 4, draft->room.beside, &sorter);
    for (uint64_t i = 0; i < result->cut_count && status == STATUS_OK; i++) {
        status = sorter_add(sorter, &cut[i].key, 1);
        if (i % FORGET_EVERY == 0)
            spool_forget_all(&result->cut_spool);
    }
    spool_forget_all(&result->cut_spool);
    if (status == STATUS_OK)
        status = count_distinct(sorter, &result->cut_edges);
    sorter_close(&sorter);
    return status;
}

static enum status find_duplicates(struct build *build)
{
    struct draft *draft = build->draft;
    struct sorter *sorter = NULL;
    enum status status = sorter_open(draft->ctx, sizeof(struct triple_record), 16,
                                     room_left(&draft->room) / 4, draft->room.beside, &sorter);
    if (status == STATUS_OK)
        status = sort_triples(build, sorter);
    if (status == STATUS_OK)
        status = mark_equal_triples(build, sorter);
    if (status == STATUS_OK)
        status = mark_twins(build);
    sorter_close(&sorter);
    if (status == STATUS_OK && build->result->has_duplicates)
        status = sorter_finish(build->result->duplicates);
    if (status == STATUS_OK)
        status = count_cut_edges(build);
    return status;
}

/* ---- the whole ---- */

/* Room for the neighbours, which may have been made ready (draft_number.c). */
static enum status take_neighbours(struct draft *draft)
{
    struct spool *spool = &draft->neighbour_spool;
    const uint64_t size = draft->face_count * 3 * sizeof(uint32_t);
    if (!draft->neighbours && spool->memory && spool->size == size) {
        draft->neighbours = (uint32_t *)(void *)spool->memory;
        return STATUS_OK;
    }
    spool_clear(spool);
    return room_scratch(&draft->room, spool, size, &draft->neighbours);
}

static enum status prepare(struct build *build)
{
    struct draft *draft = build->draft;
    struct context *ctx = draft->ctx;
    spool_clear(&draft->mate_spool);
    enum status status = draft_judge_slabs(draft);
    if (status == STATUS_OK)
        status = take_neighbours(draft);
    if (status == STATUS_OK)
        status = room_scratch(&draft->room, &draft->mate_spool, draft->face_count, &draft->mates);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, ctx->threads, sizeof *build->matchers, &build->matchers);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, build->in_flight, sizeof *build->found, &build->found);
    if (status == STATUS_OK)
        status = sorter_open(ctx, sizeof(struct edge_record), 8, draft->room.sorter,
                             draft->room.beside, &build->joint);
    if (status == STATUS_OK)
        status = sorter_open(ctx, 8, 8, draft->room.sorter / 2, draft->room.beside, &build->twins);
    return status;
}

static void release(struct build *build)
{
    struct context *ctx = build->draft->ctx;
    for (unsigned i = 0; build->matchers && i < ctx->threads; i++)
        slab_matcher_clear(&build->matchers[i]);
    memory_release(ctx, &build->matchers, ctx->threads, sizeof *build->matchers);
    for (unsigned i = 0; build->found && i < build->in_flight; i++) {
        struct found *found = &build->found[i];
        memory_release(ctx, &found->joint, found->joint_capacity, sizeof *found->joint);
        memory_release(ctx, &found->cut, found->cut_capacity, sizeof *found->cut);
        memory_release(ctx, &found->twins, found->twin_capacity, sizeof *found->twins);
    }
    memory_release(ctx, &build->found, build->in_flight, sizeof *build->found);
    sorter_close(&build->joint);
    sorter_close(&build->seams);
    sorter_close(&build->twins);
}

enum status adjacency_build(struct draft *draft, uint64_t crossing_limit,
                            struct adjacency *adjacency)
{
    memset(adjacency, 0, sizeof *adjacency);
    adjacency->ctx = draft->ctx;
    struct build build = {.draft = draft,
                          .result = adjacency,
                          .crossing_limit = crossing_limit,
                          .in_flight = draft->room.in_flight};
    spool_init(draft->ctx, &adjacency->cut_spool, draft->room.beside,
               room_spool_limit(&draft->room, 4));
    enum status status = prepare(&build);
    if (status == STATUS_OK)
        status = parallel_ordered(draft->ctx, draft->slab_count, build.in_flight, match_slab,
                                  finish_slab, &build);
    if (status == STATUS_CANCELLED && adjacency->is_over_limit) {
        status = STATUS_OK;
    } else {
        if (status == STATUS_OK)
            status = join_slabs(&build);
        if (status == STATUS_OK)
            status = find_duplicates(&build);
    }
    release(&build);
    if (status != STATUS_OK)
        adjacency_clear(adjacency);
    return status;
}

void adjacency_clear(struct adjacency *adjacency)
{
    if (!adjacency->ctx)
        return;
    spool_clear(&adjacency->cut_spool);
    sorter_close(&adjacency->duplicates);
    memset(adjacency, 0, sizeof *adjacency);
}
