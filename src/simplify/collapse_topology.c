/*
 * Connectivity of the mesh whose edges are collapsed: adjacency by corners, the link condition, and
 * the collapse itself.
 *
 * Adjacency needs edges to be matched. A hash map of edges is slow; here the corners are bucketed
 * by the lower vertex of their edge, and within a bucket matched through a table indexed by the
 * higher vertex, so that even a hub costs linear time. The buckets are lists whose links lie where
 * the opposites will be.
 */
#include <string.h>

#include "base/memory.h"
#include "collapse_internal.h"

static uint32_t edge_end(const struct collapse *c, uint32_t corner)
{
    return c->corners[corner_next(corner)].vertex;
}

/* Chains up the corners by the lower vertex of their edge: `heads` by vertex, links in `opposite`.
 */
static void bucket_corners(struct collapse *c, uint32_t *heads)
{
    for (uint64_t v = 0; v < c->vertex_slots; v++)
        heads[v] = NO_INDEX;
    for (uint32_t i = (uint32_t)(3 * c->face_slots); i-- > 0;) {
        const uint32_t a = c->corners[i].vertex, b = edge_end(c, i), low = a < b ? a : b;
        c->corners[i].opposite = heads[low];
        heads[low] = i;
    }
}

/* Matches the corners of the bucket of `low`. seen[h] is the corner met last with the higher vertex
 * h; one of another bucket tells itself by its lower vertex, so that nothing needs to be reset. */
static bool match_bucket(struct collapse *c, uint32_t low, uint32_t first, uint32_t *seen)
{
    for (uint32_t i = first, next; i != NO_INDEX; i = next) {
        const uint32_t a = c->corners[i].vertex, b = edge_end(c, i), high = a > b ? a : b;
        const uint32_t mate = seen[high];
        next = c->corners[i].opposite;
        c->corners[i].opposite = NO_INDEX;
        seen[high] = i;
        if (mate == NO_INDEX || (c->corners[mate].vertex != low && edge_end(c, mate) != low))
            continue;
        if (c->corners[mate].opposite != NO_INDEX || c->corners[mate].vertex != b)
            return false;
        c->corners[i].opposite = mate;
        c->corners[mate].opposite = i;
    }
    return true;
}

static bool match_corners(struct collapse *c, const uint32_t *heads, uint32_t *seen)
{
    for (uint64_t v = 0; v < c->vertex_slots; v++)
        seen[v] = NO_INDEX;
    for (uint32_t v = 0; v < c->vertex_slots; v++)
        if (!match_bucket(c, v, heads[v], seen))
            return false;
    return true;
}

/* Fills vertex_corner by C2 and the border flags; false when faces round a vertex are not one fan
 * (their number, counted into `seen`, is not what turning meets). */
static bool find_vertex_corners(struct collapse *c, uint32_t *seen)
{
    const uint32_t corners = (uint32_t)(3 * c->face_count);
    for (uint64_t v = 0; v < c->vertex_count; v++) {
        c->vertices[v].corner = NO_INDEX;
        seen[v] = 0;
    }
    for (uint32_t i = 0; i < corners; i++) {
        const uint32_t v = c->corners[i].vertex;
        seen[v]++;
        if (c->corners[i].opposite == NO_INDEX) {
            c->vertices[v].corner = i;
            c->flags[v] |= VERTEX_BORDER;
        } else if (c->vertices[v].corner == NO_INDEX) {
            c->vertices[v].corner = i;
        }
    }
    for (uint64_t v = 0; v < c->vertex_count; v++) {
        const uint32_t first = c->vertices[v].corner;
        uint32_t met = 0;
        for (uint32_t i = first; i != NO_INDEX;) {
            met++;
            i = c->corners[corner_previous(i)].opposite;
            if (i == first || met > seen[v])
                break;
        }
        if (met != seen[v])
            return false;
    }
    return true;
}

enum status topology_build(struct collapse *c)
{
    struct context *ctx = c->ctx;
    const size_t vertices = (size_t)c->vertex_count;
    uint32_t *heads = NULL, *seen = NULL;
    enum status status = memory_take(ctx, vertices, sizeof *heads, &heads);
    if (status == STATUS_OK)
        status = memory_take(ctx, vertices, sizeof *seen, &seen);
    if (status == STATUS_OK) {
        bucket_corners(c, heads);
        if (!match_corners(c, heads, seen) || !find_vertex_corners(c, seen))
            status = c->options.source
                         ? fail(ctx, STATUS_BAD_INPUT,
                                "%s: is damaged: its patches do not join to a manifold mesh",
                                c->options.source)
                         : fail(ctx, STATUS_INTERNAL,
                                "edge collapse was given a mesh that is not manifold");
    }
    memory_release(ctx, &seen, vertices, sizeof *seen);
    memory_release(ctx, &heads, vertices, sizeof *heads);
    return status;
}

void ring_gather(const struct collapse *c, uint32_t v, struct ring *ring)
{
    const uint32_t first = c->vertices[v].corner;
    uint32_t corner = first, count = 0, last;
    do {
        if (count == RING_MAX) {
            ring->count = ring->faces = 0;
            return;
        }
        ring->corners[count] = corner;
        ring->vertices[count++] = c->corners[corner_next(corner)].vertex;
        last = corner_previous(corner);
        corner = c->corners[last].opposite;
    } while (corner != first && corner != NO_INDEX);
    ring->faces = count;
    if (corner == NO_INDEX)
        ring->vertices[count++] = c->corners[last].vertex;
    ring->count = count;
}

/* The half-edge along edge i of a ring, the one that has a face at its left seen from the ring's
 * vertex, or at the end of an open ring the only one. */
static uint32_t ring_edge(const struct ring *ring, uint32_t i)
{
    return i < ring->faces ? ring->corners[i] : corner_previous(ring->corners[i - 1]);
}

static uint32_t third_vertex(const struct collapse *c, uint32_t corner)
{
    return c->corners[corner_previous(corner)].vertex;
}

/* Whether the face of half-edge h may go: its two other edges must not both be on the border (it is
 * an ear on a single edge or alone) nor lead to faces with the same third vertex (they would become
 * one face twice). */
static bool face_may_go(const struct collapse *c, uint32_t h)
{
    const uint32_t one = c->corners[corner_next(h)].opposite,
                   two = c->corners[corner_previous(h)].opposite;
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
        if (!(c->flags[r] & VERTEX_LOCKED) || r == kept)
            continue;
        if (r != apexes[0] && r != apexes[1])
            return false; /* a new edge between locked vertices */
        if (i < edges) {
            const uint32_t s = ring->vertices[i + 1 == ring->count ? 0 : i + 1];
            if (s != kept && (c->flags[s] & VERTEX_LOCKED))
                return false; /* a new face of three of them */
        }
    }
    return true;
}

bool topology_allows(const struct collapse *c, uint32_t a, const struct ring *ring_a, uint32_t i,
                     const struct ring *ring_b)
{
    const uint32_t b = ring_a->vertices[i];
    const uint32_t half = ring_edge(ring_a, i), other = c->corners[half].opposite;
    if (ring_b->count == 0 || ring_a->count + ring_b->count > RING_MAX)
        return false;
    const bool both_border = (c->flags[a] & c->flags[b] & VERTEX_BORDER) != 0;
    if (both_border && other != NO_INDEX)
        return false;
    if (!face_may_go(c, half) || (other != NO_INDEX && !face_may_go(c, other)))
        return false;
    const uint32_t apexes[2] = {third_vertex(c, half),
                                other == NO_INDEX ? NO_INDEX : third_vertex(c, other)};
    for (uint32_t j = 0; j < ring_a->count; j++) {
        const uint32_t r = ring_a->vertices[j];
        if (r == apexes[0] || r == apexes[1])
            continue;
        for (uint32_t k = 0; k < ring_b->count; k++)
            if (ring_b->vertices[k] == r)
                return false;
    }
    if (c->flags[a] & VERTEX_LOCKED)
        return !(c->flags[b] & VERTEX_LOCKED) && locks_allow(c, a, ring_b, apexes);
    if (c->flags[b] & VERTEX_LOCKED)
        return locks_allow(c, b, ring_a, apexes);
    return true;
}

/* Removes the face of half-edge h, gluing the faces over its two other edges together. */
static void remove_face(struct collapse *c, uint32_t h)
{
    const uint32_t next = corner_next(h), previous = corner_previous(h);
    const uint32_t one = c->corners[next].opposite, two = c->corners[previous].opposite;
    const uint32_t apex = c->corners[previous].vertex;
    if (one != NO_INDEX)
        c->corners[one].opposite = two;
    if (two != NO_INDEX)
        c->corners[two].opposite = one;
    if (c->vertices[apex].corner == previous)
        c->vertices[apex].corner = one != NO_INDEX ? one : corner_next(two);
    for (int k = 0; k < 3; k++)
        c->corners[h - h % 3 + (uint32_t)k].vertex = NO_INDEX;
}

unsigned topology_collapse(struct collapse *c, uint32_t a, const struct ring *ring_a, uint32_t i,
                           const struct ring *ring_b, uint32_t gone)
{
    const uint32_t b = ring_a->vertices[i], kept = gone == a ? b : a;
    const struct ring *ring = gone == a ? ring_a : ring_b;
    const uint32_t half = ring_edge(ring_a, i), other = c->corners[half].opposite;
    const uint32_t outer[2] = {c->corners[corner_next(half)].opposite,
                               c->corners[corner_previous(half)].opposite};
    for (uint32_t k = 0; k < ring->faces; k++)
        c->corners[ring->corners[k]].vertex = kept;
    remove_face(c, half);
    if (other != NO_INDEX)
        remove_face(c, other);
    c->vertices[gone].corner = NO_INDEX;
    c->flags[kept] |= c->flags[gone] & VERTEX_BORDER;

    /* any corner at the kept vertex, then clockwise to the border if there is one */
    uint32_t corner = outer[1] != NO_INDEX ? outer[1] : corner_next(outer[0]);
    const uint32_t start = corner;
    if (c->flags[kept] & VERTEX_BORDER)
        while (c->corners[corner].opposite != NO_INDEX) {
            corner = corner_next(c->corners[corner].opposite);
            if (corner == start)
                break;
        }
    c->vertices[kept].corner = corner;
    return other == NO_INDEX ? 1 : 2;
}

/* ---- closing gaps ---- */

/* Which of many are alive, with a count in front of every 64, so that a new number is one look. */
struct ranks {
    uint64_t *live;
    uint32_t *before;
    size_t words;
};

static inline uint32_t rank_of(const struct ranks *ranks, uint32_t i)
{
    const uint64_t below = ranks->live[i >> 6] & (((uint64_t)1 << (i & 63)) - 1);
    return ranks->before[i >> 6] + (uint32_t)__builtin_popcountll(below);
}

static inline bool is_live(const struct ranks *ranks, uint32_t i)
{
    return ranks->live[i >> 6] >> (i & 63) & 1;
}

static enum status ranks_take(struct context *ctx, uint64_t count, struct ranks *ranks)
{
    ranks->words = (size_t)(count / 64 + 1);
    enum status status = memory_take_zeroed(ctx, ranks->words, sizeof *ranks->live, &ranks->live);
    if (status == STATUS_OK)
        status = memory_take(ctx, ranks->words, sizeof *ranks->before, &ranks->before);
    return status;
}

static void ranks_release(struct context *ctx, struct ranks *ranks)
{
    memory_release(ctx, &ranks->before, ranks->words, sizeof *ranks->before);
    memory_release(ctx, &ranks->live, ranks->words, sizeof *ranks->live);
}

static uint32_t ranks_sum(struct ranks *ranks)
{
    uint32_t sum = 0;
    for (size_t i = 0; i < ranks->words; i++) {
        ranks->before[i] = sum;
        sum += (uint32_t)__builtin_popcountll(ranks->live[i]);
    }
    return sum;
}

static uint32_t renumber_corner(const struct ranks *faces, uint32_t corner)
{
    return corner == NO_INDEX ? NO_INDEX : 3 * rank_of(faces, corner / 3) + corner % 3;
}

static void move_vertices(struct collapse *c, const struct ranks *vertices,
                          const struct ranks *faces)
{
    const size_t stride = c->attributes.stride;
    for (uint32_t v = 0; v < c->vertex_slots; v++) {
        if (!is_live(vertices, v))
            continue;
        const uint32_t to = rank_of(vertices, v);
        c->vertices[to] = c->vertices[v];
        c->vertices[to].corner = renumber_corner(faces, c->vertices[v].corner);
        c->keys[to] = c->keys[v];
        c->flags[to] = c->flags[v];
        if (c->records && to != v)
            memcpy(c->records + to * stride, c->records + v * stride, stride);
    }
}

static void move_faces(struct collapse *c, const struct ranks *vertices, const struct ranks *faces)
{
    for (uint32_t f = 0; f < c->face_slots; f++) {
        if (!is_live(faces, f))
            continue;
        const struct collapse_corner *from = c->corners + 3 * (size_t)f;
        struct collapse_corner *to = c->corners + 3 * (size_t)rank_of(faces, f);
        for (int k = 0; k < 3; k++) {
            to[k].vertex = rank_of(vertices, from[k].vertex);
            to[k].opposite = renumber_corner(faces, from[k].opposite);
        }
    }
}

enum status topology_compact(struct collapse *c)
{
    struct ranks vertices = {0}, faces = {0};
    enum status status = ranks_take(c->ctx, c->vertex_slots, &vertices);
    if (status == STATUS_OK)
        status = ranks_take(c->ctx, c->face_slots, &faces);
    if (status != STATUS_OK)
        goto done;
    for (uint32_t v = 0; v < c->vertex_slots; v++)
        vertices.live[v >> 6] |= (uint64_t)(c->vertices[v].corner != NO_INDEX) << (v & 63);
    for (uint32_t f = 0; f < c->face_slots; f++)
        faces.live[f >> 6] |= (uint64_t)(c->corners[3 * (size_t)f].vertex != NO_INDEX) << (f & 63);
    const uint32_t vertex_slots = ranks_sum(&vertices), face_slots = ranks_sum(&faces);
    move_vertices(c, &vertices, &faces);
    move_faces(c, &vertices, &faces);
    c->vertex_slots = vertex_slots;
    c->face_slots = face_slots;
done:
    ranks_release(c->ctx, &faces);
    ranks_release(c->ctx, &vertices);
    return status;
}
