/*
 * Matching the edges of a slab, vertex by vertex.
 *
 * The naive way is a hash map over all edges; it then dominates everything. Filing each edge under
 * its lower vertex, in a list that the second face to come searches, keeps to the cache; but how
 * long that list is and whether it has the edge can't be guessed, and a step guessed wrong costs
 * more than all the rest of an edge.
 *
 * Here corners are filed under their vertices, by counting, those of half of the vertices at a
 * time. Round a vertex each face has an
 * edge that leaves it and one that comes in; the edge leaving one face is the one that comes in of
 * the next. A small table of where which edge comes in, written anew for each vertex, tells that
 * without a question; what is found is compared, so that what the table says of other vertices, or
 * lacks as two edges wanted one place, does no harm. If each face finds one other, which for a scan
 * is nearly always so, that settles every edge that leaves there, and following the faces from one
 * to the next tells at hardly any cost whether they are one fan, which the survey would have to
 * walk round for. What remains, borders, rims of the slab, edges of any number of faces, is looked
 * at more closely; and at vertices of very many faces the edges are sorted.
 *
 * An edge's entry in a face is written where the edge begins, once. Both ends see the same faces at
 * the edge, so that they agree.
 */
#include "mesh/slab_match.h"

#include <string.h>

#include "base/memory.h"
#include "base/radix_sort.h"

enum {
    FEW = 16,  /* faces at a vertex, found by the table */
    SOME = 64, /* compared one with one */
    NOWHERE = 0xff
};

/* A filed corner: from the lowest bits on the local numbers of the vertices behind and before it in
 * its face, which corner it is, and the face of the slab. */
enum { FIELD_BITS = SLAB_SHIFT + 2, FIELD_MASK = (1 << FIELD_BITS) - 1 };
_Static_assert(2 * FIELD_BITS + 2 + SLAB_SHIFT <= 64 && 3 << SLAB_SHIFT <= 1 << FIELD_BITS,
               "what is filed of a corner fits in a word");

struct slab_edges { /* the slab in work, for the inner loops */
    const uint32_t *faces;
    uint32_t *neighbours;
    uint8_t *mates;
    uint32_t face_first;
};

static inline uint64_t corner_pack(uint32_t f, unsigned k, uint32_t next, uint32_t previous)
{
    return (uint64_t)(f << 2 | k) << 2 * FIELD_BITS | (uint64_t)previous << FIELD_BITS | next;
}

static inline uint32_t corner_face(uint64_t corner)
{
    return (uint32_t)(corner >> (2 * FIELD_BITS + 2));
}

static inline unsigned corner_place(uint64_t corner)
{
    return (unsigned)(corner >> 2 * FIELD_BITS) & 3;
}

/* The vertices at the other ends of the edges that leave and come in. */
static inline uint32_t corner_next(uint64_t corner)
{
    return (uint32_t)corner & FIELD_MASK;
}

static inline uint32_t corner_previous(uint64_t corner)
{
    return (uint32_t)(corner >> FIELD_BITS) & FIELD_MASK;
}

/* The edge that comes in. */
static inline unsigned edge_into(uint64_t corner)
{
    return previous3(corner_place(corner));
}

/* Where the corners of each local vertex would end, were all filed. */
static void count_corners(const struct slab_edges *s, struct slab_matcher *m)
{
    const struct slab_scope *scope = &m->scope;
    const uint32_t locals = scope_local_count(scope);
    uint32_t *end = m->end;
    memset(end, 0, (size_t)locals * sizeof *end);
    for (size_t c = 0; c < 3 * (size_t)scope->face_count; c++)
        end[scope_local(scope, s->faces[c])]++;
    for (uint32_t v = 1; v < locals; v++)
        end[v] += end[v - 1];
}

/* Corners that are filed at a time: a vertex has one of each face at most. */
static size_t filed_at_once(uint32_t face_count)
{
    return (size_t)face_count + face_count / 2 + FEW;
}

/* The local vertices from `first` on whose corners have room. */
static uint32_t end_of_round(const struct slab_matcher *m, uint32_t first)
{
    const uint32_t locals = scope_local_count(&m->scope), begin = first ? m->end[first - 1] : 0;
    const size_t room = filed_at_once(m->scope.face_count);
    uint32_t low = first + 1, high = locals;
    while (low < high) {
        uint32_t middle = low + (high - low + 1) / 2;
        if (m->end[middle - 1] - begin <= room)
            low = middle;
        else
            high = middle - 1;
    }
    return low;
}

/* Files the corners of the local vertices [first, last), from their ends downwards: end[v] becomes
 * where they begin, counted from the first of all. */
static void file_corners(const struct slab_edges *s, struct slab_matcher *m, uint32_t first,
                         uint32_t last)
{
    const struct slab_scope *scope = &m->scope;
    const uint32_t range = last - first, begin = first ? m->end[first - 1] : 0;
    const uint32_t filed = m->end[last - 1] - begin;
    uint32_t *end = m->end;
    uint64_t *corners = m->corners;
    for (uint32_t f = scope->face_count; f-- > 0;) {
        const uint32_t *face = s->faces + 3 * (size_t)f;
        const uint32_t a = scope_local(scope, face[0]), b = scope_local(scope, face[1]),
                       c = scope_local(scope, face[2]);
        if (a - first < range)
            corners[--end[a] - begin] = corner_pack(f, 0, b, c);
        if (b - first < range)
            corners[--end[b] - begin] = corner_pack(f, 1, c, a);
        if (c - first < range)
            corners[--end[c] - begin] = corner_pack(f, 2, a, b);
    }
    memset(corners + filed, 0, FEW * sizeof *corners); /* looked at for nothing */
}

/* ---- few faces, each with the next ---- */

static inline uint32_t table_place(uint32_t vertex)
{
    return vertex * 0x9e3779b1u >> (32 - SLAB_MATCH_TABLE_BITS);
}

/* Whether going from 0 on, 4 bits for each, passes all and comes back. */
static inline bool is_circle(uint64_t next, uint32_t count)
{
    uint64_t at = next & 15;
    bool closes = false;
    for (uint32_t step = 1; step < count; step++) {
        closes |= at == 0;
        at = next >> 4 * at & 15;
    }
    return !closes && at == 0;
}

/* False, and neighbours and mates are to be entered otherwise, unless all faces, 3 to FEW, follow
 * one another in a circle. */
static inline bool match_few(const struct slab_edges *s, uint8_t *table, const uint64_t *corners,
                             uint32_t count)
{
    /* of an edge that leaves at 4 * place what comes in at a place */
    static const uint8_t mates[12] = {2, 0, 1, 0, 8, 0, 4, 0, 32, 0, 16, 0};
    uint64_t differs = 0, circle = 0;
    uint32_t beyond = 0; /* negative if what was found is of another vertex */
    for (uint32_t i = 0; i < count; i++)
        table[table_place(corner_previous(corners[i]))] = (uint8_t)i;
    for (uint32_t i = count; i-- > 0;) {
        const uint64_t here = corners[i];
        const uint8_t j = table[table_place(corner_next(here))];
        const uint64_t there = corners[j];
        const uint32_t f = corner_face(here);
        const unsigned k = corner_place(here);
        differs |= here ^ there >> FIELD_BITS;
        circle = circle << 4 | j;
        beyond |= count - 1 - j;
        s->neighbours[3 * (size_t)f + k] = s->face_first + corner_face(there);
        s->mates[f] |= mates[4 * k + corner_place(there)];
    }
    return (differs & FIELD_MASK) == 0 && beyond < FEW && is_circle(circle, count);
}

/* ---- any number ---- */

/* What lies over the edge that leaves at `here`: of `sides` faces in all, the one that is not its
 * own has it as an edge that comes in at `there`, or, if `turned`, leaves there, too. */
static inline void enter_side(const struct slab_edges *s, uint64_t here, size_t sides,
                              uint64_t there, bool turned)
{
    const uint32_t f = corner_face(here);
    uint32_t over = sides == 1 ? NO_INDEX : CROWDED;
    unsigned mate = 0;
    if (sides == 2) {
        over = s->face_first + corner_face(there);
        mate = turned ? corner_place(there) : edge_into(there);
    }
    s->neighbours[3 * (size_t)f + corner_place(here)] = over;
    mate_set(s->mates, f, corner_place(here), mate);
}

/* Whether following `next` (NOWHERE: it ends) passes all. */
static bool is_one_way(const uint8_t *next, uint32_t count)
{
    uint64_t entered = 0;
    uint32_t ends = 0, length = 1;
    for (uint32_t i = 0; i < count; i++) {
        if (next[i] == NOWHERE)
            ends++;
        else
            entered |= (uint64_t)1 << next[i];
    }
    if (ends > 1)
        return false;
    const unsigned first = ends ? (unsigned)__builtin_ctzll(~entered) : 0;
    for (unsigned at = next[first]; at != NOWHERE && at != first && length < count; at = next[at])
        length++;
    return length == count;
}

/* The faces at a rim or border are one fan in the slab or not; only for vertices of its own does
 * that say that they are one. But twins, over two edges at a vertex, make a circle anywhere. */
static bool is_harmless(const uint8_t *next, uint32_t count, bool is_shared)
{
    for (uint32_t i = 0; i < count; i++)
        if (next[i] != NOWHERE && next[next[i]] == i)
            return false;
    return is_shared || is_one_way(next, count);
}

static void match_some(const struct slab_edges *s, const uint64_t *corners, uint32_t count,
                       bool is_shared, bool *is_plain)
{
    uint32_t leaves[SOME], comes[SOME];
    uint8_t next[SOME];
    for (uint32_t i = 0; i < count; i++) {
        leaves[i] = corner_next(corners[i]);
        comes[i] = corner_previous(corners[i]);
    }
    for (uint32_t i = 0; i < count; i++) {
        unsigned out = 0, in = 0, other_out = 0, other_in = 0;
        for (uint32_t j = 0; j < count; j++) {
            const bool goes = leaves[j] == leaves[i], arrives = comes[j] == leaves[i];
            out += goes;
            in += arrives;
            other_out = goes && j != i ? j : other_out;
            other_in = arrives ? j : other_in;
        }
        enter_side(s, corners[i], out + in, corners[in ? other_in : other_out], !in);
        next[i] = out + in == 2 && in == 1 ? (uint8_t)other_in : NOWHERE;
        *is_plain &= out == 1 && in <= 1;
    }
    *is_plain &= is_harmless(next, count, is_shared);
}

/* Sides by their other ends: vertex << 32 | place << 1 | whether it leaves. */
static enum status match_many(const struct slab_edges *s, struct slab_matcher *m,
                              const uint64_t *corners, uint32_t count)
{
    struct context *ctx = m->scope.ctx;
    const size_t side_count = 2 * (size_t)count;
    unsigned char *bytes;
    enum status status =
        memory_reserve(ctx, &m->sides, &m->side_capacity, side_count, sizeof *m->sides);
    if (status == STATUS_OK)
        status =
            memory_reserve(ctx, &m->scratch, &m->scratch_capacity, side_count, sizeof *m->scratch);
    if (status != STATUS_OK)
        return status;
    for (uint32_t i = 0; i < count; i++) {
        m->sides[2 * (size_t)i] = (uint64_t)corner_next(corners[i]) << 32 | i << 1 | 1;
        m->sides[2 * (size_t)i + 1] = (uint64_t)corner_previous(corners[i]) << 32 | i << 1;
    }
    status = radix_sort(ctx, (unsigned char *)m->sides, (unsigned char *)m->scratch, side_count,
                        sizeof *m->sides, 1, &bytes);
    if (status != STATUS_OK)
        return status;
    const uint64_t *sides = bytes == (unsigned char *)m->sides ? m->sides : m->scratch;
    for (size_t i = 0, group = 0; i < side_count; i++) {
        if (i + 1 < side_count && sides[i + 1] >> 32 == sides[i] >> 32)
            continue;
        for (size_t j = group; j <= i; j++) {
            const uint64_t other = sides[j == group ? i : group]; /* of two */
            if (sides[j] & 1)
                enter_side(s, corners[(uint32_t)sides[j] >> 1], i + 1 - group,
                           corners[(uint32_t)other >> 1], other & 1);
        }
        group = i + 1;
    }
    return STATUS_OK;
}

/* ---- the whole ---- */

/* What is filed at local vertices [first, last). */
static enum status match_vertices(const struct draft *draft, const struct slab_edges *s,
                                  struct slab_matcher *m, uint32_t first, uint32_t last,
                                  uint32_t end, bool *is_plain)
{
    const uint32_t own = m->scope.own_count, begin = m->end[first];
    enum status status = STATUS_OK;
    for (uint32_t v = first; v < last && status == STATUS_OK; v++) {
        const uint64_t *corners = m->corners + (m->end[v] - begin);
        const uint32_t count = (v + 1 < last ? m->end[v + 1] : end) - m->end[v];
        if (count - 3 <= FEW - 3 && match_few(s, m->table, corners, count))
            continue;
        if (count <= SOME) {
            match_some(s, corners, count, v >= own || is_shared(draft, m->scope.vertex_first + v),
                       is_plain);
        } else {
            *is_plain = false;
            status = match_many(s, m, corners, count);
        }
    }
    m->end[last - 1] = end; /* for the next round */
    return status;
}

static enum status match_all(const struct draft *draft, const struct slab_edges *s,
                             struct slab_matcher *m, bool *is_plain)
{
    const uint32_t locals = scope_local_count(&m->scope);
    enum status status = STATUS_OK;
    memset(s->mates, 0, m->scope.face_count);
    count_corners(s, m);
    for (uint32_t first = 0; first < locals && status == STATUS_OK;) {
        const uint32_t last = end_of_round(m, first), end = m->end[last - 1];
        file_corners(s, m, first, last);
        status = match_vertices(draft, s, m, first, last, end, is_plain);
        first = last;
    }
    return status;
}

enum status slab_match(struct draft *draft, uint32_t slab, struct slab_matcher *m, bool *is_plain)
{
    struct context *ctx = draft->ctx;
    enum status status = scope_enter(draft, slab, &m->scope);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &m->end, &m->end_capacity, scope_local_count(&m->scope),
                                sizeof *m->end);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &m->corners, &m->corner_capacity,
                                filed_at_once(m->scope.face_count) + FEW, sizeof *m->corners);
    if (status != STATUS_OK)
        return status;
    const uint32_t first = m->scope.face_first;
    const struct slab_edges s = {draft->faces + 3 * (size_t)first,
                                 draft->neighbours + 3 * (size_t)first, draft->mates + first,
                                 first};
    *is_plain = true;
    return match_all(draft, &s, m, is_plain);
}

void slab_matcher_clear(struct slab_matcher *m)
{
    struct context *ctx = m->scope.ctx;
    if (!ctx)
        return;
    memory_release(ctx, &m->end, m->end_capacity, sizeof *m->end);
    memory_release(ctx, &m->corners, m->corner_capacity, sizeof *m->corners);
    memory_release(ctx, &m->sides, m->side_capacity, sizeof *m->sides);
    memory_release(ctx, &m->scratch, m->scratch_capacity, sizeof *m->scratch);
    scope_clear(&m->scope);
}
