/*
 * Connectivity of the mesh whose edges are collapsed: adjacency by corners, the link condition, and
 * the collapse itself.
 *
 * Adjacency needs edges to be matched. A hash map of edges is slow; here the corners are listed by
 * their vertex, in links that lie where the swings will be, and those of one vertex matched with
 * each other: a few by looking at all, those of a hub through a table indexed by the other end of
 * their edges, so that it costs linear time.
 */
#include <string.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "base/ranked_bits.h"
#include "collapse_internal.h"

/* Lists the corners at each vertex, lowest first: from vertices[v].corner through the swings. */
static void list_corners(struct collapse *c)
{
    for (uint64_t v = 0; v < c->vertex_count; v++)
        c->vertices[v].corner = NO_INDEX;
    for (size_t f = (size_t)c->face_count; f-- > 0;) {
        struct collapse_corner *corner = c->corners + 3 * f;
        for (unsigned k = 3; k-- > 0;) {
            struct collapse_vertex *vertex = &c->vertices[corner[(k + 2) % 3].end];
            corner[k].swing = vertex->corner;
            vertex->corner = (uint32_t)(3 * f) + k;
        }
    }
}

/* Vertices of more corners than FEW are hubs. */
enum { FEW = 32, RECENT = 256, NOWHERE = FEW };

/* The corner at `vertex` whose edge leads to `end`: its place in the list of the vertex. All zero
 * is none, as no edge leads from a vertex to itself. */
struct met {
    uint32_t vertex, end, place;
};

/* The corners of one vertex, and the other vertices of each one's face. */
struct corner_list {
    uint32_t count;
    uint32_t corners[FEW], ends[FEW], thirds[FEW];
};

/* The place of the corner that follows the one at place j; NOWHERE: the border does. */
static inline uint32_t next_place(const struct corner_list *list, uint32_t v, uint32_t j,
                                  const struct met recent[RECENT])
{
    const uint32_t end = list->thirds[j];
    const struct met *met = &recent[end % RECENT];
    if (met->end == end && met->vertex == v)
        return met->place;
    uint32_t place = 0;
    while (place < list->count && list->ends[place] != end)
        place++;
    return place < list->count ? place : NOWHERE;
}

/* Sets the swings of a closed fan; false when it is none. */
static bool match_closed(struct collapse *c, const struct corner_list *list, uint32_t v,
                         const struct met recent[RECENT])
{
    uint32_t at = 0, met = 0;
    do {
        const uint32_t next = next_place(list, v, at, recent);
        if (next == NOWHERE)
            return false;
        c->corners[list->corners[at]].swing = list->corners[next];
        at = next;
        met++;
    } while (at != 0 && met < list->count);
    return at == 0 && met == list->count && met >= 3; /* of two faces one is the other's back */
}

/* Sets the swings of an open fan and finds where it begins: all corners but one are another's
 * swing, and that one is left over by exclusive or. False when it is none. (Where edges of two
 * corners lead to the same vertex, one of the two may be nobody's swing, and open the fan; at their
 * other end two corners have the same swing then, and from nowhere there all are met.) */
static bool match_open(struct collapse *c, const struct corner_list *list, uint32_t v,
                       const struct met recent[RECENT])
{
    uint32_t nexts[FEW], odd = 0, unmatched = 0, met = 0;
    for (uint32_t j = 0; j < list->count; j++) {
        const uint32_t next = nexts[j] = next_place(list, v, j, recent);
        c->corners[list->corners[j]].swing = next == NOWHERE ? NO_INDEX : list->corners[next];
        odd ^= next == NOWHERE ? j : j ^ next;
        unmatched += next == NOWHERE;
    }
    if (unmatched != 1 || odd >= list->count) /* where two swings are the same, it is anything */
        return false;
    c->vertices[v].flags |= VERTEX_BORDER;
    c->vertices[v].corner = list->corners[odd];
    for (uint32_t at = odd; at != NOWHERE && met <= list->count; at = nexts[at])
        met++;
    return met == list->count;
}

/* Turns the list of v's corners into swings and finds where to begin, unless v is a hub; false when
 * its faces are no single fan. recent[u % RECENT] is mostly the corner whose edge leads to u, and
 * tells itself when it is not. */
static bool match_vertex(struct collapse *c, uint32_t v, struct met recent[RECENT], bool *is_hub)
{
    struct corner_list list;
    uint32_t count = 0;
    for (uint32_t i = c->vertices[v].corner; i != NO_INDEX; i = c->corners[i].swing) {
        if (count == FEW) {
            *is_hub = true;
            return true;
        }
        const uint32_t end = c->corners[i].end;
        if (end == v)
            return false;
        recent[end % RECENT] = (struct met){v, end, count};
        list.corners[count] = i;
        list.ends[count] = end;
        list.thirds[count++] = c->corners[corner_next(i)].end;
    }
    list.count = count;
    return match_closed(c, &list, v, recent) || match_open(c, &list, v, recent);
}

/* Makes the border and the corner to begin with known of a vertex whose swings are, of `count`
 * corners from `first` on; false when they are no single fan. `odd` is what is left of all corners
 * and swings, by exclusive or. */
static bool finish_vertex(struct collapse *c, uint32_t v, uint32_t first, uint32_t count,
                          uint32_t unmatched, uint32_t odd)
{
    uint32_t start = first, met = 0;
    if (unmatched > 1)
        return false;
    if (unmatched == 0 && count < 3)
        return false; /* one face is the back of the other */
    /* in an open fan all corners but one are another's swing: that one is left over */
    if (unmatched > 0) {
        start = odd;
        c->vertices[v].flags |= VERTEX_BORDER;
    }
    /* where two swings are the same, what is left over may be anything */
    if (start >= 3 * c->face_count || corner_vertex(c, start) != v)
        return false;
    c->vertices[v].corner = start;
    for (uint32_t i = start; i != NO_INDEX && met <= count;) {
        met++;
        i = c->corners[i].swing;
        if (i == start)
            break;
    }
    return met == count;
}

/* The same for a hub. seen[u] is the corner met last whose edge leads to u; one of another vertex
 * tells itself, so that nothing needs to be reset. */
static bool match_hub(struct collapse *c, uint32_t v, uint32_t *seen)
{
    const uint32_t first = c->vertices[v].corner;
    uint32_t count = 0, unmatched = 0, odd = 0;
    for (uint32_t i = first; i != NO_INDEX; i = c->corners[i].swing) {
        const uint32_t end = c->corners[i].end, other = seen[end];
        if (end == v || (other != NO_INDEX && corner_vertex(c, other) == v))
            return false;
        seen[end] = i;
        odd ^= i;
        count++;
    }
    for (uint32_t i = first, next; i != NO_INDEX; i = next) {
        const uint32_t other = seen[c->corners[corner_next(i)].end];
        next = c->corners[i].swing;
        const bool found = other != NO_INDEX && corner_vertex(c, other) == v;
        c->corners[i].swing = found ? other : NO_INDEX;
        odd ^= found ? other : 0;
        unmatched += !found;
    }
    return finish_vertex(c, v, first, count, unmatched, odd);
}

/* Whether v was left by match_vertex: what it has is a list still, or a fan of as many. */
static bool has_many(const struct collapse *c, uint32_t v)
{
    const uint32_t first = c->vertices[v].corner;
    uint32_t count = 0;
    for (uint32_t i = first; i != NO_INDEX && count <= FEW; count++) {
        i = c->corners[i].swing;
        if (i == first)
            return false;
    }
    return count > FEW;
}

/* All vertices; what a thread reads of others' corners nobody changes. */
struct matching {
    struct collapse *collapse;
    _Atomic bool is_manifold, has_hubs;
};

enum { MATCH_STRETCH = 4096 };

static void match_stretch(struct matching *matching, uint64_t index)
{
    struct collapse *c = matching->collapse;
    const uint64_t first = index * MATCH_STRETCH, left = c->vertex_count - first;
    const uint32_t end = (uint32_t)(first + (left < MATCH_STRETCH ? left : MATCH_STRETCH));
    struct met recent[RECENT] = {{0}};
    bool has_hub = false;
    for (uint32_t v = (uint32_t)first; v < end; v++)
        if (c->vertices[v].corner != NO_INDEX && !match_vertex(c, v, recent, &has_hub)) {
            matching->is_manifold = false;
            break;
        }
    if (has_hub)
        matching->has_hubs = true;
}

/* Job 0 makes the fans: it reads ends and positions, which stay as they are. */
static enum status match_job(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct matching *matching = user;
    if (job == 0)
        fans_build(matching->collapse);
    else if (matching->is_manifold)
        match_stretch(matching, job - 1);
    return STATUS_OK;
}

static enum status match_hubs(struct matching *matching)
{
    struct collapse *c = matching->collapse;
    const size_t vertices = (size_t)c->vertex_count;
    uint32_t *seen = NULL;
    enum status status = memory_take(c->ctx, vertices, sizeof *seen, &seen);
    if (status != STATUS_OK)
        return status;
    memset(seen, 0xff, vertices * sizeof *seen);
    for (uint32_t v = 0; v < vertices && matching->is_manifold; v++)
        if (has_many(c, v) && !match_hub(c, v, seen))
            matching->is_manifold = false;
    memory_release(c->ctx, &seen, vertices, sizeof *seen);
    return STATUS_OK;
}

enum status topology_build(struct collapse *c)
{
    struct context *ctx = c->ctx;
    struct matching matching = {.collapse = c, .is_manifold = true};
    const uint64_t stretches = (c->vertex_count + MATCH_STRETCH - 1) / MATCH_STRETCH;
    enum status status = STATUS_OK;
    list_corners(c);
    if (c->options.together)
        status = parallel_for(ctx, stretches + 1, match_job, &matching);
    else
        for (uint64_t job = 0; job <= stretches; job++)
            (void)match_job(&matching, job, 0);
    if (status == STATUS_OK && matching.is_manifold && matching.has_hubs)
        status = match_hubs(&matching);
    if (status != STATUS_OK || matching.is_manifold)
        return status;
    return c->options.source
               ? fail(ctx, STATUS_BAD_INPUT,
                      "%s: is damaged: its patches do not join to a manifold mesh",
                      c->options.source)
               : fail(ctx, STATUS_INTERNAL, "edge collapse was given a mesh that is not manifold");
}

/* The half-edge along edge i of a ring, the one that has a face at its left seen from the ring's
 * vertex, or at the end of an open ring the only one. */
static uint32_t ring_edge(const struct ring *ring, uint32_t i)
{
    return i < ring->faces ? ring->corners[i] : corner_previous(ring->corners[i - 1]);
}

static uint32_t third_vertex(const struct collapse *c, uint32_t corner)
{
    return corner_vertex(c, corner_previous(corner));
}

/* Whether the face of half-edge h may go: its two other edges must not both be on the border (it is
 * an ear on a single edge or alone) nor lead to faces with the same third vertex (they would become
 * one face twice). */
static bool face_may_go(const struct collapse *c, uint32_t h)
{
    const uint32_t one = corner_opposite(c, corner_next(h)), two = c->corners[h].swing;
    if (one == NO_INDEX || two == NO_INDEX)
        return one != two;
    return third_vertex(c, one) != third_vertex(c, two);
}

static bool locks_allow(const struct collapse *c, uint32_t kept, const struct ring *ring,
                        const uint32_t apexes[2])
{
    const uint32_t edges = ring->faces;
    for (uint32_t i = 0; i < ring->count; i++) {
        const uint32_t r = ring->vertices[i];
        if (!(c->vertices[r].flags & VERTEX_LOCKED) || r == kept)
            continue;
        if (r != apexes[0] && r != apexes[1])
            return false; /* a new edge between locked vertices */
        if (i < edges) {
            const uint32_t s = ring->vertices[i + 1 == ring->count ? 0 : i + 1];
            if (s != kept && (c->vertices[s].flags & VERTEX_LOCKED))
                return false; /* a new face of three of them */
        }
    }
    return true;
}

/* Whether the rings of an edge's ends have a vertex in common that is no apex of its faces. (Behind
 * b's ring stands b itself, which is the i-th of a's.) */
static bool have_others_in_common(const struct ring *ring_a, uint32_t i, const struct ring *ring_b,
                                  const uint32_t apexes[2])
{
    int4 same = {0}, vertices;
    for (uint32_t j = 0; j < ring_a->count; j++) {
        const uint32_t r = ring_a->vertices[j];
        const int32_t v = (int32_t)r;
        if (j == i || r == apexes[0] || r == apexes[1])
            continue;
        for (uint32_t k = 0; k < ring_b->count; k += 4) {
            memcpy(&vertices, ring_b->vertices + k, sizeof vertices);
            same |= vertices == (int4){v, v, v, v};
        }
    }
    return float4_bits((float4)same) != 0;
}

bool topology_allows(const struct collapse *c, uint32_t a, const struct ring *ring_a, uint32_t i,
                     const struct ring *ring_b)
{
    const uint32_t b = ring_a->vertices[i];
    const uint32_t half = ring_edge(ring_a, i), other = corner_opposite(c, half);
    if (ring_b->count == 0 || ring_a->count + ring_b->count > RING_MAX)
        return false;
    const bool both_border = (c->vertices[a].flags & c->vertices[b].flags & VERTEX_BORDER) != 0;
    if (both_border && other != NO_INDEX)
        return false;
    if (!face_may_go(c, half) || (other != NO_INDEX && !face_may_go(c, other)))
        return false;
    const uint32_t apexes[2] = {third_vertex(c, half),
                                other == NO_INDEX ? NO_INDEX : third_vertex(c, other)};
    if (have_others_in_common(ring_a, i, ring_b, apexes))
        return false;
    if (c->vertices[a].flags & VERTEX_LOCKED)
        return !(c->vertices[b].flags & VERTEX_LOCKED) && locks_allow(c, a, ring_b, apexes);
    if (c->vertices[b].flags & VERTEX_LOCKED)
        return locks_allow(c, b, ring_a, apexes);
    return true;
}

/* Removes the face of half-edge h, gluing the faces over its two other edges together. */
static void remove_face(struct collapse *c, uint32_t h)
{
    const uint32_t next = corner_next(h), previous = corner_previous(h);
    const uint32_t one = corner_opposite(c, next), two = corner_opposite(c, previous);
    const uint32_t apex = corner_vertex(c, previous);
    if (one != NO_INDEX)
        c->corners[corner_next(one)].swing = two;
    if (two != NO_INDEX)
        c->corners[corner_next(two)].swing = one;
    if (c->vertices[apex].corner == previous)
        c->vertices[apex].corner = one != NO_INDEX ? one : corner_next(two);
    for (int k = 0; k < 3; k++)
        c->corners[h - h % 3 + (uint32_t)k].end = NO_INDEX;
}

unsigned topology_collapse(struct collapse *c, uint32_t a, const struct ring *ring_a, uint32_t i,
                           const struct ring *ring_b, uint32_t gone)
{
    const uint32_t b = ring_a->vertices[i], kept = gone == a ? b : a;
    const struct ring *ring = gone == a ? ring_a : ring_b;
    const uint32_t half = ring_edge(ring_a, i), other = corner_opposite(c, half);
    const uint32_t outer[2] = {corner_opposite(c, corner_next(half)), c->corners[half].swing};
    for (uint32_t k = 0; k < ring->faces; k++)
        c->corners[corner_previous(ring->corners[k])].end = kept;
    remove_face(c, half);
    if (other != NO_INDEX)
        remove_face(c, other);
    c->vertices[gone].corner = NO_INDEX;
    c->vertices[kept].flags |= c->vertices[gone].flags & VERTEX_BORDER;

    /* any corner at the kept vertex, then clockwise to the border if there is one */
    uint32_t corner = outer[1] != NO_INDEX ? outer[1] : corner_next(outer[0]);
    const uint32_t start = corner;
    if (c->vertices[kept].flags & VERTEX_BORDER)
        for (uint32_t across; (across = corner_opposite(c, corner)) != NO_INDEX;) {
            corner = corner_next(across);
            if (corner == start)
                break;
        }
    c->vertices[kept].corner = corner;
    return other == NO_INDEX ? 1 : 2;
}

/* ---- closing gaps ---- */

LANES_INLINE uint32_t renumber_corner(const struct ranked_bits *faces, uint32_t corner)
{
    return corner == NO_INDEX ? NO_INDEX : 3 * rank_of(faces, corner / 3) + corner % 3;
}

LANES_INLINE void move_vertices(struct collapse *c, const struct ranked_bits *vertices,
                                const struct ranked_bits *faces)
{
    const size_t stride = c->attributes.stride;
    for (uint32_t v = 0; v < c->vertex_slots; v++) {
        if (!bit_is_set(vertices->bits, v))
            continue;
        const uint32_t to = rank_of(vertices, v);
        c->vertices[to] = c->vertices[v];
        c->vertices[to].corner = renumber_corner(faces, c->vertices[v].corner);
        c->keys[to] = c->keys[v];
        if (c->records && to != v)
            memcpy(c->records + to * stride, c->records + v * stride, stride);
    }
}

LANES_INLINE void move_faces(struct collapse *c, const struct ranked_bits *vertices,
                             const struct ranked_bits *faces)
{
    for (uint32_t f = 0; f < c->face_slots; f++) {
        if (!bit_is_set(faces->bits, f))
            continue;
        const struct collapse_corner *from = c->corners + 3 * (size_t)f;
        struct collapse_corner *to = c->corners + 3 * (size_t)rank_of(faces, f);
        for (int k = 0; k < 3; k++) {
            to[k].end = rank_of(vertices, from[k].end);
            to[k].swing = renumber_corner(faces, from[k].swing);
        }
    }
}

static void move_vertices_scalar(struct collapse *c, const struct ranked_bits *vertices,
                                 const struct ranked_bits *faces)
{
    move_vertices(c, vertices, faces);
}

static void move_faces_scalar(struct collapse *c, const struct ranked_bits *vertices,
                              const struct ranked_bits *faces)
{
    move_faces(c, vertices, faces);
}

/* (Machines with these vectors count bits in one instruction, too.) */
LANES_AVX2 static void move_vertices_avx2(struct collapse *c, const struct ranked_bits *vertices,
                                          const struct ranked_bits *faces)
{
    move_vertices(c, vertices, faces);
}

LANES_AVX2 static void move_faces_avx2(struct collapse *c, const struct ranked_bits *vertices,
                                       const struct ranked_bits *faces)
{
    move_faces(c, vertices, faces);
}

/* Vertices and faces are two jobs: what is live first, and then each moves by itself. */
struct compaction {
    struct collapse *collapse;
    struct ranked_bits vertices, faces;
    uint32_t vertex_slots, face_slots;
};

enum { OF_VERTICES, OF_FACES, COMPACTION_JOBS };

static enum status find_live(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct compaction *compaction = user;
    const struct collapse *c = compaction->collapse;
    if (job == OF_VERTICES) {
        uint64_t *bits = compaction->vertices.bits;
        for (uint32_t v = 0; v < c->vertex_slots; v++)
            bits[v >> 6] |= (uint64_t)(c->vertices[v].corner != NO_INDEX) << (v & 63);
        compaction->vertex_slots = ranked_bits_sum(&compaction->vertices);
    } else {
        uint64_t *bits = compaction->faces.bits;
        for (uint32_t f = 0; f < c->face_slots; f++)
            bits[f >> 6] |= (uint64_t)(c->corners[3 * (size_t)f].end != NO_INDEX) << (f & 63);
        compaction->face_slots = ranked_bits_sum(&compaction->faces);
    }
    return STATUS_OK;
}

static enum status move_live(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct compaction *compaction = user;
    struct collapse *c = compaction->collapse;
    if (job == OF_VERTICES && c->level >= CPU_AVX2)
        move_vertices_avx2(c, &compaction->vertices, &compaction->faces);
    else if (job == OF_VERTICES)
        move_vertices_scalar(c, &compaction->vertices, &compaction->faces);
    else if (c->level >= CPU_AVX2)
        move_faces_avx2(c, &compaction->vertices, &compaction->faces);
    else
        move_faces_scalar(c, &compaction->vertices, &compaction->faces);
    return STATUS_OK;
}

static enum status run_both(struct compaction *compaction,
                            enum status (*work)(void *user, uint64_t job, unsigned worker))
{
    struct collapse *c = compaction->collapse;
    if (c->options.together)
        return parallel_for(c->ctx, COMPACTION_JOBS, work, compaction);
    for (uint64_t job = 0; job < COMPACTION_JOBS; job++)
        (void)work(compaction, job, 0);
    return STATUS_OK;
}

enum status topology_compact(struct collapse *c)
{
    struct compaction compaction = {.collapse = c};
    enum status status = ranked_bits_take(c->ctx, c->vertex_slots, &compaction.vertices);
    if (status == STATUS_OK)
        status = ranked_bits_take(c->ctx, c->face_slots, &compaction.faces);
    if (status == STATUS_OK)
        status = run_both(&compaction, find_live);
    if (status == STATUS_OK &&
        (compaction.vertex_slots < c->vertex_slots || compaction.face_slots < c->face_slots))
        status = run_both(&compaction, move_live);
    if (status == STATUS_OK) {
        c->vertex_slots = compaction.vertex_slots;
        c->face_slots = compaction.face_slots;
    }
    ranked_bits_clear(c->ctx, &compaction.faces);
    ranked_bits_clear(c->ctx, &compaction.vertices);
    return status;
}
