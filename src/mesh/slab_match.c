/*
 * Matching the edges of a slab, vertex by vertex.
 *
 * The naive way is a hash map over all edges; it then dominates everything. Filing each edge under
 * its lower vertex, in a list that the second face to come searches, keeps to the cache; but how
 * long that list is and whether it has the edge can't be guessed, and a step guessed wrong costs
 * more than all the rest of an edge.
 *
 * Here all corners are filed under their vertices, by counting. Round a vertex each face has an
 * edge that leaves it and one that comes in; the edge leaving one face is the one that comes in of
 * the next. A small table of where which edge comes in, written anew for each vertex, tells that
 * without a question; what is found is compared, so that what the table says of other vertices, or
 * lacks as two edges wanted one place, does no harm. If each face finds one other, which for a scan
 * is nearly always so, that settles every edge that leaves there, and following the faces from one
 * to the next tells at hardly any cost whether they are one fan, which the survey would have to
 * walk round for. What remains, borders, rims of the slab, edges of any number of faces, is looked
 * at more closely; and at vertices of very many faces the edges are sorted.
 *
 * Where the machine has vectors of eight lanes, up to seven faces at a vertex need no table: each
 * edge that leaves is compared with all that come in.
 *
 * An edge's entry in a face is written where the edge begins, once. Both ends see the same faces at
 * the edge, so that they agree.
 */
#include "mesh/slab_match.h"

#include <string.h>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "base/cpu.h"
#include "base/lanes.h"
#include "base/memory.h"
#include "base/radix_sort.h"

enum {
    FEW = SLAB_MATCH_FEW, /* faces at a vertex, found by the table */
    SOME = 64,            /* compared one with one */
    NOWHERE = 0xff
};

struct slab_edges { /* the slab in work, for the inner loops */
    const uint32_t *faces;
    uint32_t *neighbours;
    uint8_t *mates;
    uint32_t face_first;
};

/*
 * A filed corner has all that is asked of it, so that nobody goes back to the faces: its place
 * (face of the slab << 2 | corner), and the numbers within the slab of the vertices at the other
 * ends of the edges that leave and come in.
 */
enum {
    FIELD = SLAB_MATCH_FIELD,
    FIELD_MASK = (1 << FIELD) - 1,
    PLACE_AT = FIELD,
    PREVIOUS_AT = 2 * FIELD
};
_Static_assert(SLAB_SHIFT_MAX + 2 <= FIELD, "a place, or a vertex of three a face, fits a field");

static inline uint32_t corner_next(filed_corner corner)
{
    return (uint32_t)corner & FIELD_MASK;
}

static inline uint32_t corner_previous(filed_corner corner)
{
    return (uint32_t)(corner >> PREVIOUS_AT);
}

static inline uint32_t corner_face(filed_corner corner)
{
    return (uint32_t)(corner >> (PLACE_AT + 2)) & (FIELD_MASK >> 2);
}

static inline unsigned corner_place(filed_corner corner)
{
    return (unsigned)(corner >> PLACE_AT) & 3;
}

/* Its place among those of all faces, three each. */
static inline size_t corner_index(filed_corner corner)
{
    return 3 * (size_t)corner_face(corner) + corner_place(corner);
}

/* The edge that comes in. */
static inline unsigned edge_into(filed_corner corner)
{
    return previous3(corner_place(corner));
}

/* Files the corners of all faces under their vertices: those of local vertex v are
 * [end[v - 1], end[v]). */
static void file_corners(const struct slab_edges *s, struct slab_matcher *m)
{
    const struct slab_scope *scope = &m->scope;
    const uint32_t locals = scope_local_count(scope), faces = scope->face_count;
    uint32_t *end = m->end;
    filed_corner *corners = m->corners;
    memset(end, 0, (size_t)locals * sizeof *end);
    for (size_t c = 0; c < 3 * (size_t)faces; c++)
        end[scope_local(scope, s->faces[c])]++;
    uint32_t begin = 0; /* counts become begins, which filing turns into ends */
    for (uint32_t v = 0; v < locals; v++) {
        const uint32_t count = end[v];
        end[v] = begin;
        begin += count;
    }
    for (size_t f = 0; f < faces; f++) {
        const uint32_t *face = s->faces + 3 * f;
        const filed_corner a = scope_local(scope, face[0]), b = scope_local(scope, face[1]);
        const filed_corner c = scope_local(scope, face[2]), one = 1;
        const filed_corner place = (filed_corner)f << (PLACE_AT + 2);
        corners[end[a]++] = place | b | c << PREVIOUS_AT;
        corners[end[b]++] = (place + (one << PLACE_AT)) | c | a << PREVIOUS_AT;
        corners[end[c]++] = (place + (one << (PLACE_AT + 1))) | a | b << PREVIOUS_AT;
    }
    memset(corners + begin, 0, FEW * sizeof *corners); /* looked at for nothing */
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
static inline bool match_few(const struct slab_edges *s, struct slab_matcher *m,
                             const filed_corner *corners, uint32_t count)
{
    /* of an edge that leaves at 4 * place what comes in at a place */
    static const uint8_t mates[12] = {2, 0, 1, 0, 8, 0, 4, 0, 32, 0, 16, 0};
    uint64_t circle = 0;
    uint32_t differs = 0, beyond = 0; /* negative if what was found is of another vertex */
    for (uint32_t i = 0; i < count; i++) {
        const uint32_t previous = corner_previous(corners[i]);
        m->previous[i] = previous;
        m->table[table_place(previous)] = (uint8_t)i;
    }
    for (uint32_t i = count; i-- > 0;) {
        const filed_corner here = corners[i];
        const uint32_t next = corner_next(here);
        const uint8_t j = m->table[table_place(next)];
        const filed_corner there = corners[j];
        differs |= next ^ m->previous[j];
        circle = circle << 4 | j;
        beyond |= count - 1 - j;
        s->neighbours[corner_index(here)] = s->face_first + corner_face(there);
        s->mates[corner_face(here)] |= mates[4 * corner_place(here) + corner_place(there)];
    }
    return differs == 0 && beyond < FEW && is_circle(circle, count);
}

/* ---- the same for up to seven, by vectors of eight lanes ---- */

enum { SEVEN = 7 };

#if defined(__x86_64__) && SPBM_SLAB_SHIFT_MAX <= 18
enum { HAS_SEVEN = 1 };

/* Whether going from lane 0 on passes `count` lanes, up to seven, and comes back: where 0 to 7
 * steps lead is found by doubling. */
LANES_AVX2 static inline bool is_circle_of_lanes(__m256i next, uint32_t count)
{
    const __m256i zero = _mm256_setzero_si256();
    const __m256i twice = _mm256_permutevar8x32_epi32(next, next);
    const __m256i four_times = _mm256_permutevar8x32_epi32(twice, twice);
    __m256i at = _mm256_blend_epi32(zero, _mm256_permutevar8x32_epi32(next, zero), 0xaa);
    at = _mm256_blend_epi32(at, _mm256_permutevar8x32_epi32(twice, at), 0xcc);
    at = _mm256_blend_epi32(at, _mm256_permutevar8x32_epi32(four_times, at), 0xf0);
    const __m256i is_begin = _mm256_cmpeq_epi32(at, zero);
    const unsigned begins = (unsigned)_mm256_movemask_ps(_mm256_castsi256_ps(is_begin));
    return (begins & ((2u << count) - 1)) == (1u | 1u << count);
}

/* The lane that has each lane's `next` as its `previous`; if none or several do, any. */
LANES_AVX2 static inline __m256i find_lanes(__m256i next, __m256i previous)
{
    const __m256i lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
    __m256i which = _mm256_setzero_si256();
    for (int turn = 1; turn < LANES; turn++) { /* no face follows itself */
        const __m256i from = _mm256_and_si256(_mm256_add_epi32(lanes, _mm256_set1_epi32(turn)),
                                              _mm256_set1_epi32(LANES - 1));
        const __m256i is_it = _mm256_cmpeq_epi32(next, _mm256_permutevar8x32_epi32(previous, from));
        which = _mm256_or_si256(which, _mm256_and_si256(is_it, from));
    }
    return which;
}

/*
 * False, and nothing is entered, unless all faces, 3 to SEVEN, follow one another in a circle. The
 * lanes beyond are corners of the next vertices, of which there are so many at least: what is
 * entered for them is wrong, and will be made right when these are matched.
 *
 * If each lane leads to one that is right, and going from one to the next passes all, then no two
 * have the same previous vertex: all that look for it would go to one lane, nobody to the other.
 */
LANES_AVX2 static inline bool match_seven(const struct slab_edges *s, const filed_corner *corners,
                                          uint32_t count)
{
    const __m256i zero = _mm256_setzero_si256(), one = _mm256_set1_epi32(1);
    const __m256i three = _mm256_set1_epi32(3), lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
    const __m256i beyond = _mm256_cmpgt_epi32(lanes, _mm256_set1_epi32((int)count - 1));
    const __m256 four = _mm256_loadu_ps((const float *)(const void *)corners);
    const __m256 rest = _mm256_loadu_ps((const float *)(const void *)(corners + LANES / 2));
    const __m256i low =
        _mm256_permute4x64_epi64(_mm256_castps_si256(_mm256_shuffle_ps(four, rest, 0x88)), 0xd8);
    const __m256i high =
        _mm256_permute4x64_epi64(_mm256_castps_si256(_mm256_shuffle_ps(four, rest, 0xdd)), 0xd8);
    const __m256i next = _mm256_and_si256(low, _mm256_set1_epi32(FIELD_MASK));
    const __m256i previous = _mm256_or_si256(_mm256_srli_epi32(high, PREVIOUS_AT - 32), beyond);
    const __m256i here = _mm256_or_si256(
        _mm256_srli_epi32(low, PLACE_AT),
        _mm256_and_si256(_mm256_slli_epi32(high, 32 - PLACE_AT), _mm256_set1_epi32(FIELD_MASK)));

    const __m256i which = find_lanes(next, previous);
    const __m256i is_right = _mm256_or_si256(
        _mm256_cmpeq_epi32(_mm256_permutevar8x32_epi32(previous, which), next), beyond);
    if (_mm256_movemask_epi8(is_right) != -1 || !is_circle_of_lanes(which, count))
        return false;

    const __m256i face = _mm256_srli_epi32(here, 2), place = _mm256_and_si256(here, three);
    const __m256i there = _mm256_permutevar8x32_epi32(here, which);
    const __m256i there_place = _mm256_and_si256(there, three);
    const __m256i mate =
        _mm256_add_epi32(_mm256_sub_epi32(there_place, one),
                         _mm256_and_si256(_mm256_cmpeq_epi32(there_place, zero), three));
    const __m256i mates =
        _mm256_andnot_si256(beyond, _mm256_sllv_epi32(mate, _mm256_add_epi32(place, place)));
    const __m256i over =
        _mm256_add_epi32(_mm256_srli_epi32(there, 2), _mm256_set1_epi32((int)s->face_first));
    uint32_t at[LANES], faces[LANES], overs[LANES], mates_of[LANES];
    _mm256_storeu_si256((__m256i *)(void *)at, _mm256_sub_epi32(here, face));
    _mm256_storeu_si256((__m256i *)(void *)faces, face);
    _mm256_storeu_si256((__m256i *)(void *)overs, over);
    _mm256_storeu_si256((__m256i *)(void *)mates_of, mates);
    uint32_t *neighbours = s->neighbours;
    uint8_t *all_mates = s->mates;
    for (unsigned i = 0; i < LANES; i++) {
        neighbours[at[i]] = overs[i];
        all_mates[faces[i]] |= (uint8_t)mates_of[i];
    }
    return true;
}

#else
enum { HAS_SEVEN = 0 };

static inline bool match_seven(const struct slab_edges *s, const filed_corner *corners,
                               uint32_t count)
{
    (void)s, (void)corners, (void)count;
    return false; /* never called */
}

#endif

/* ---- any number ---- */

/* What lies over the edge that leaves at `here`: of `sides` faces in all, the one that is not its
 * own has it as an edge that comes in at `there`, or, if `turned`, leaves there, too. */
static inline void enter_side(const struct slab_edges *s, filed_corner here, size_t sides,
                              filed_corner there, bool turned)
{
    const uint32_t f = corner_face(here);
    uint32_t over = sides == 1 ? NO_INDEX : CROWDED;
    unsigned mate = 0;
    if (sides == 2) {
        over = s->face_first + corner_face(there);
        mate = turned ? corner_place(there) : edge_into(there);
    }
    s->neighbours[corner_index(here)] = over;
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
    /* A vertex has a corner. NOLINTNEXTLINE(clang-analyzer-core.uninitialized.Assign) */
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

static void match_some(const struct slab_edges *s, const filed_corner *corners, uint32_t count,
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
                              const filed_corner *corners, uint32_t count)
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

static void note_rim(struct slab_matcher *m, const filed_corner *corners, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++)
        m->rim[corner_face(corners[i]) / 64] |= (uint64_t)1 << corner_face(corners[i]) % 64;
}

LANES_INLINE enum status match_all(const struct draft *draft, const struct slab_edges *s,
                                   struct slab_matcher *m, bool is_wide, bool *is_plain)
{
    const uint32_t locals = scope_local_count(&m->scope), own = m->scope.own_count;
    const uint32_t wide_end = 3 * m->scope.face_count - LANES; /* unless there are fewer */
    is_wide = is_wide && HAS_SEVEN && 3 * m->scope.face_count >= LANES;
    enum status status = STATUS_OK;
    memset(s->mates, 0, m->scope.face_count);
    memset(m->rim, 0, slab_rim_words(&m->scope) * sizeof *m->rim);
    for (uint32_t v = 0, begin = 0; v < locals && status == STATUS_OK; v++) {
        const filed_corner *corners = m->corners + begin;
        const uint32_t count = m->end[v] - begin;
        const bool is_rim = v >= own || is_shared(draft, m->scope.vertex_first + v);
        const bool is_seven = is_wide && begin <= wide_end && count - 3 <= SEVEN - 3;
        begin = m->end[v];
        if (is_rim)
            note_rim(m, corners, count);
        if (is_seven ? match_seven(s, corners, count)
                     : count - 3 <= FEW - 3 && match_few(s, m, corners, count))
            continue;
        if (count <= SOME) {
            match_some(s, corners, count, is_rim, is_plain);
        } else {
            *is_plain = false;
            status = match_many(s, m, corners, count);
        }
    }
    return status;
}

static enum status match_all_scalar(const struct draft *draft, const struct slab_edges *s,
                                    struct slab_matcher *m, bool *is_plain)
{
    return match_all(draft, s, m, false, is_plain);
}

LANES_AVX2 static enum status match_all_avx2(const struct draft *draft, const struct slab_edges *s,
                                             struct slab_matcher *m, bool *is_plain)
{
    return match_all(draft, s, m, true, is_plain);
}

enum status slab_match(struct draft *draft, uint32_t slab, struct slab_matcher *m, bool *is_plain)
{
    struct context *ctx = draft->ctx;
    const size_t capacity_before = m->corner_capacity;
    enum status status = scope_enter(draft, slab, &m->scope);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &m->end, &m->end_capacity, scope_local_count(&m->scope),
                                sizeof *m->end);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &m->corners, &m->corner_capacity,
                                3 * (size_t)m->scope.face_count + FEW, sizeof *m->corners);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &m->rim, &m->rim_capacity, slab_rim_words(&m->scope),
                                sizeof *m->rim);
    if (status != STATUS_OK)
        return status;
    if (m->corner_capacity > capacity_before)
        memory_use_whole(m->corners, m->corner_capacity, sizeof *m->corners);
    const uint32_t first = m->scope.face_first;
    const struct slab_edges s = {draft->faces + 3 * (size_t)first,
                                 draft->neighbours + 3 * (size_t)first, draft->mates + first,
                                 first};
    *is_plain = true;
    file_corners(&s, m);
    return cpu_level(ctx) >= CPU_AVX2 ? match_all_avx2(draft, &s, m, is_plain)
                                      : match_all_scalar(draft, &s, m, is_plain);
}

void slab_matcher_clear(struct slab_matcher *m)
{
    struct context *ctx = m->scope.ctx;
    if (!ctx)
        return;
    memory_release(ctx, &m->end, m->end_capacity, sizeof *m->end);
    memory_release(ctx, &m->corners, m->corner_capacity, sizeof *m->corners);
    memory_release(ctx, &m->rim, m->rim_capacity, sizeof *m->rim);
    memory_release(ctx, &m->sides, m->side_capacity, sizeof *m->sides);
    memory_release(ctx, &m->scratch, m->scratch_capacity, sizeof *m->scratch);
    scope_clear(&m->scope);
}
