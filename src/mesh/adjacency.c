/*
 * Finding the two faces of each edge.
 *
 * The naive way is a hash map over all edges; it then dominates everything. Here a slab at a time
 * is matched in arrays that stay in the cache: each edge is filed under its lower vertex in a list
 * of the edges met so far, which holds about three entries, and the second face to come finds the
 * first. Lists can be long (the apex of a large fan, or more faces than vertices), so the steps
 * along them are counted, and a slab that takes too many is matched anew by sorting each vertex's
 * edges.
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
#include "base/radix_sort.h"

#define CROWDED (UINT32_MAX - 1) /* in neighbours[] of a slab in work: more than two faces */

/* List steps an edge before a slab is matched by sorting; scans take 1 or 2. */
enum { STEP_LIMIT = 12 };

struct filed_edge {
    uint32_t other;  /* the end it is not filed under */
    uint32_t corner; /* face of the slab << 2 | edge */
    uint32_t next;   /* in the list; NO_INDEX ends it */
};

struct matcher { /* one a worker */
    struct slab_scope scope;
    uint32_t *head; /* a list for each local vertex */
    size_t head_capacity;
    uint64_t *sides; /* sorted: the end that is not filed under, above its corner */
    size_t side_capacity;
    uint64_t *scratch;
    size_t scratch_capacity;
    struct filed_edge *filed;
    size_t filed_capacity;
};

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
    struct matcher *matchers;
    struct found *found;
    unsigned in_flight;
    struct sorter *joint;
    struct sorter *seams; /* struct seam */
    struct sorter *twins; /* faces to be looked at once all is joined, as 8-byte keys */
    struct seam last;     /* before the one at hand; */
    unsigned alike;       /* so many with it are of one face and one neighbour */
};

/* ---- a slab ---- */

struct slab_edges { /* the slab in work, for the inner loops */
    const uint32_t *faces;
    uint32_t *neighbours;
    uint8_t *mates;
    uint32_t face_first;
};

/* A third face at the edge that `there` is of: all its faces are refused. */
static void refuse(const struct slab_edges *s, uint32_t f, unsigned k, uint32_t *there)
{
    if (*there == CROWDED)
        return;
    uint32_t partner = *there - s->face_first;
    s->neighbours[3 * (size_t)partner + mate_of(s->mates, f, k)] = CROWDED;
    *there = CROWDED;
}

/* Edges that are linked to nothing have mate 0. */
static inline void link_or_refuse(const struct slab_edges *s, uint32_t earlier, uint32_t corner)
{
    uint32_t f = earlier >> 2, g = corner >> 2;
    unsigned k = earlier & 3, m = corner & 3;
    uint32_t *there = &s->neighbours[3 * (size_t)f + k];
    uint32_t *here = &s->neighbours[3 * (size_t)g + m];
    if (*there != NO_INDEX) {
        *here = CROWDED;
        refuse(s, f, k, there);
        return;
    }
    *there = s->face_first + g;
    *here = s->face_first + f;
    s->mates[f] = (uint8_t)(s->mates[f] | m << 2 * k);
    s->mates[g] = (uint8_t)(s->mates[g] | k << 2 * m);
}

/* Files the edges of all faces under their lower vertex and matches each with the one filed before;
 * given up, and !*is_done, after too many steps. */
static enum status match_edges(const struct slab_edges *s, struct matcher *m, bool *is_done)
{
    const struct slab_scope *scope = &m->scope;
    const uint64_t limit = (uint64_t)STEP_LIMIT * 3 * scope->face_count;
    struct filed_edge *filed = m->filed;
    *is_done = false;
    uint32_t *head = m->head;
    uint32_t filed_count = 0;
    uint64_t steps = 0;
    memset(head, 0xff, (size_t)scope_local_count(scope) * sizeof *head);
    memset(s->neighbours, 0xff, 3 * (size_t)scope->face_count * sizeof *s->neighbours);
    memset(s->mates, 0, scope->face_count);
    for (uint32_t f = 0; f < scope->face_count; f++) {
        const uint32_t *face = s->faces + 3 * (size_t)f;
        uint32_t local[3];
        if (filed_count + 3 > m->filed_capacity) {
            enum status status = memory_reserve(scope->ctx, &m->filed, &m->filed_capacity,
                                                (size_t)filed_count + 3, sizeof *m->filed);
            if (status != STATUS_OK)
                return status;
            filed = m->filed;
        }
        for (unsigned k = 0; k < 3; k++)
            local[k] = scope_local(scope, face[k]);
        for (unsigned k = 0; k < 3; k++) {
            unsigned n = next3(k);
            bool under_first = local[k] < local[n];
            uint32_t under = under_first ? local[k] : local[n];
            uint32_t other = under_first ? face[n] : face[k];
            uint32_t e = head[under];
            while (e != NO_INDEX && filed[e].other != other) {
                e = filed[e].next;
                steps++;
            }
            if (e != NO_INDEX) {
                link_or_refuse(s, filed[e].corner, f << 2 | k);
            } else {
                filed[filed_count] = (struct filed_edge){other, f << 2 | k, head[under]};
                head[under] = filed_count++;
            }
        }
        if (steps > limit)
            return STATUS_OK;
    }
    *is_done = true;
    return STATUS_OK;
}

/* Files all sides under the lower of their ends: those of local vertex v are [end of v - 1, end of
 * v) of m->sides, the ends being m->head. */
static void file_sides(const struct slab_edges *s, struct matcher *m)
{
    const struct slab_scope *scope = &m->scope;
    const uint32_t locals = scope_local_count(scope);
    uint32_t *end = m->head;
    for (int pass = 0; pass < 2; pass++) {
        if (pass == 0)
            memset(end, 0, (size_t)locals * sizeof *end);
        for (uint32_t f = 0; f < scope->face_count; f++) {
            const uint32_t *face = s->faces + 3 * (size_t)f;
            uint32_t local[3];
            for (unsigned k = 0; k < 3; k++)
                local[k] = scope_local(scope, face[k]);
            for (unsigned k = 0; k < 3; k++) {
                unsigned n = next3(k), under = local[k] < local[n] ? k : n;
                uint32_t other = face[under == k ? n : k];
                if (pass == 1)
                    m->sides[end[local[under]]] = (uint64_t)other << 32 | f << 2 | k;
                end[local[under]]++;
            }
        }
        uint32_t begin = 0; /* counts become begins, which filling turns into ends */
        for (uint32_t v = 0; v < locals && pass == 0; v++) {
            uint32_t count = end[v];
            end[v] = begin;
            begin += count;
        }
    }
}

/* Sides with both ends in common: two are joined, of more all are refused. */
static void match_group(const struct slab_edges *s, const uint64_t *sides, size_t count)
{
    for (size_t i = 0; i < count && count > 2; i++) {
        uint32_t corner = (uint32_t)sides[i];
        s->neighbours[3 * (size_t)(corner >> 2) + (corner & 3)] = CROWDED;
    }
    if (count == 2)
        link_or_refuse(s, (uint32_t)sides[0], (uint32_t)sides[1]);
}

static enum status match_by_sorting(const struct slab_edges *s, struct matcher *m)
{
    const struct slab_scope *scope = &m->scope;
    const size_t count = 3 * (size_t)scope->face_count;
    enum status status =
        memory_reserve(scope->ctx, &m->sides, &m->side_capacity, count, sizeof *m->sides);
    if (status == STATUS_OK)
        status = memory_reserve(scope->ctx, &m->scratch, &m->scratch_capacity, count,
                                sizeof *m->scratch);
    if (status != STATUS_OK)
        return status;
    memset(s->neighbours, 0xff, count * sizeof *s->neighbours);
    memset(s->mates, 0, scope->face_count);
    file_sides(s, m);
    for (uint32_t v = 0, begin = 0; v < scope_local_count(scope) && status == STATUS_OK; v++) {
        const uint32_t size = m->head[v] - begin;
        unsigned char *bytes;
        status =
            radix_sort(scope->ctx, (unsigned char *)(m->sides + begin),
                       (unsigned char *)(m->scratch + begin), size, sizeof *m->sides, 1, &bytes);
        const uint64_t *sorted =
            bytes == (unsigned char *)(m->sides + begin) ? m->sides + begin : m->scratch + begin;
        for (uint32_t i = 0, group = 0; i < size && status == STATUS_OK; i++) {
            if (i + 1 < size && sorted[i + 1] >> 32 == sorted[i] >> 32)
                continue;
            match_group(s, sorted + group, i + 1 - group);
            group = i + 1;
        }
        begin = m->head[v];
    }
    return status;
}

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

/* Sorts out what the slab alone can't settle: edges for the join, edges to be opened, twins. */
static enum status collect(const struct build *build, const struct slab_edges *s,
                           uint32_t face_count, struct found *found)
{
    const struct draft *draft = build->draft;
    enum status status = STATUS_OK;
    for (uint32_t f = 0; f < face_count && found->crossing <= build->crossing_limit; f++) {
        const uint32_t *face = s->faces + 3 * (size_t)f;
        uint32_t *over = s->neighbours + 3 * (size_t)f;
        if (over[0] == over[1] && over[1] == over[2] && over[0] < s->face_first + f) {
            status = memory_reserve(draft->ctx, &found->twins, &found->twin_capacity,
                                    found->twin_count + 1, sizeof *found->twins);
            if (status != STATUS_OK)
                return status;
            found->twins[found->twin_count++] = s->face_first + f;
        }
        unsigned shared = 0;
        for (unsigned k = 0; k < 3; k++)
            shared |= (unsigned)is_shared(draft, face[k]) << k;
        const bool is_usual = (shared & (shared - 1)) == 0;
        for (unsigned k = 0; k < 3; k++) {
            if (is_usual && over[k] != CROWDED)
                continue;
            struct edge_record record = make_record(face[k], face[next3(k)], s->face_first + f, k);
            if (shared >> k & shared >> next3(k) & 1) {
                if (over[k] == NO_INDEX)
                    found->crossing++;
                status = append_edge(draft->ctx, &found->joint, &found->joint_count,
                                     &found->joint_capacity, record);
            } else if (over[k] == CROWDED) {
                status = append_edge(draft->ctx, &found->cut, &found->cut_count,
                                     &found->cut_capacity, record);
            }
            if (status != STATUS_OK)
                return status;
            if (over[k] == CROWDED) {
                over[k] = NO_INDEX;
                mate_set(s->mates, f, k, 0);
            }
        }
    }
    return STATUS_OK;
}

/* Three edges for two faces, and some of borders; more if it takes them. */
static enum status reserve_filed(struct matcher *m)
{
    const size_t faces = m->scope.face_count, count = faces / 2 * 3 + faces / 32 + 64;
    if (m->filed_capacity >= count)
        return STATUS_OK;
    enum status status =
        memory_resize(m->scope.ctx, &m->filed, m->filed_capacity, count, sizeof *m->filed);
    if (status == STATUS_OK) {
        m->filed_capacity = count;
        memory_use_whole(m->filed, count, sizeof *m->filed);
    }
    return status;
}

static enum status match_slab(void *user, uint64_t job, unsigned worker)
{
    struct build *build = user;
    struct draft *draft = build->draft;
    struct matcher *m = &build->matchers[worker];
    struct found *found = &build->found[job % build->in_flight];
    found->joint_count = found->cut_count = found->twin_count = 0;
    found->crossing = 0;
    enum status status = scope_enter(draft, (uint32_t)job, &m->scope);
    if (status == STATUS_OK)
        status = memory_reserve(draft->ctx, &m->head, &m->head_capacity,
                                scope_local_count(&m->scope), sizeof *m->head);
    if (status == STATUS_OK)
        status = reserve_filed(m);
    if (status != STATUS_OK)
        return status;
    const uint32_t first = m->scope.face_first;
    const struct slab_edges s = {draft->faces + 3 * (size_t)first,
                                 draft->neighbours + 3 * (size_t)first, draft->mates + first,
                                 first};
    bool is_done;
    status = match_edges(&s, m, &is_done);
    if (status == STATUS_OK && !is_done)
        status = match_by_sorting(&s, m);
    if (status == STATUS_OK)
        status = collect(build, &s, m->scope.face_count, found);
    return status;
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

static enum status prepare(struct build *build)
{
    struct draft *draft = build->draft;
    struct context *ctx = draft->ctx;
    spool_clear(&draft->neighbour_spool);
    spool_clear(&draft->mate_spool);
    enum status status = room_scratch(&draft->room, &draft->neighbour_spool,
                                      draft->face_count * 3 * sizeof(uint32_t), &draft->neighbours);
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
    for (unsigned i = 0; build->matchers && i < ctx->threads; i++) {
        struct matcher *m = &build->matchers[i];
        scope_clear(&m->scope);
        memory_release(ctx, &m->head, m->head_capacity, sizeof *m->head);
        memory_release(ctx, &m->sides, m->side_capacity, sizeof *m->sides);
        memory_release(ctx, &m->scratch, m->scratch_capacity, sizeof *m->scratch);
        memory_release(ctx, &m->filed, m->filed_capacity, sizeof *m->filed);
    }
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
