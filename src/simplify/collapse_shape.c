/*
 * What a collapse does to the faces round its edge: whether they stay sound, how far the new vertex
 * is from them, and the fans of the vertices on them afterwards.
 *
 * The plain way turns round every vertex whose faces change and adds them up anew, eight turns for
 * one collapse, each a walk through memory. Here the faces at both ends are known already from
 * pricing the edge; each keeps its outer edge and only changes its third corner. So one pass over
 * them, several in the lanes of a vector, gives old and new normals; guards compare these, and what
 * a neighbour's fan changes by is the difference of the two faces' parts. Sums of differences
 * drift by rounding, but a vertex that is made anew gets a fan that is made anew, and faces grow as
 * a mesh gets coarser, so that what is left of earlier ones is small.
 */
#include <math.h>
#include <string.h>

#include "base/float4.h"
#include "base/lanes.h"
#include "collapse_internal.h"

/* A face may turn by less than the angle with this cosine (about 78 degrees). */
static const float FLIP_COSINE = 0.2f;
/* Below this |n| / (sum of squared edges) a face is a sliver; an equilateral one has 0.289. A
 * stricter guard holds needles of range scans in place, and what they keep others must give: with
 * 0.01 the dragon's mean error at 1 % was a quarter larger. */
static const float SLIVER_SHAPE = 0.0001f;
/* Below this |n| / (sum of squared edges) a face has no direction. */
static const float NO_SHAPE = 1e-5f;
static const float TINY = 1e-30f; /* keeps quotients finite */

/* ---- guards ---- */

LANES_INLINE struct vec3x8 lanes_all3(const float p[3])
{
    return (struct vec3x8){lanes_all(p[0]), lanes_all(p[1]), lanes_all(p[2])};
}

LANES_INLINE struct vec3x8 load_from(const float from[3][RING_LANES], uint32_t i)
{
    return lanes_load3(from[0] + i, from[1] + i, from[2] + i);
}

/* The faces at one end, 8 at a time: their normals with the vertex at `to`, and whether all that
 * stay are sound. */
LANES_INLINE bool turn_faces(enum guard guard, struct edge_change *change, int end,
                             const float fan_normal[3])
{
    const struct vertex_look *look = change->looks[end];
    const struct vec3x8 to = lanes_all3(change->to[end]), up = lanes_all3(fan_normal);
    uint32_t gone[2];
    edge_faces_gone(change, end, gone);
    const int32_t full = guard == GUARD_FULL ? -1 : 0;
    int8x32 bad = {0};
    for (uint32_t first = 0; first < look->ring.count; first += LANES) {
        const int8x32 j = lanes_count_from(first);
        const int8x32 stays =
            (j < (int32_t)look->ring.faces) & (j != (int32_t)gone[0]) & (j != (int32_t)gone[1]);
        const struct vec3x8 r = load_from(look->at, first), s = load_from(look->at, first + 1);
        const struct vec3x8 old = load_from(look->normals, first);
        const struct vec3x8 a = lanes_sub(r, to), b = lanes_sub(s, to), e = lanes_sub(s, r);
        const struct vec3x8 n = lanes_cross(a, b);
        const float8 base = lanes_dot(e, e);
        const float8 sizes = lanes_dot(a, a) + lanes_dot(b, b) + base;
        const float8 old_sizes = lanes_dot(r, r) + lanes_dot(s, s) + base;
        const float8 old_square = lanes_dot(old, old), dot = lanes_dot(old, n);
        /* squares of 2 area / (sum of squared edges), and the cosine of the turn in the same
         * measure */
        const float8 shape = lanes_dot(n, n) / (sizes * sizes + TINY);
        const float8 old_shape = old_square / (old_sizes * old_sizes + TINY);
        const float8 turn = dot / (sizes * old_sizes + TINY);
        const float8 height = lanes_dot(old, to);

        const int8x32 sliver = full & (shape < SLIVER_SHAPE * SLIVER_SHAPE) & (shape < old_shape);
        const int8x32 flips =
            (dot <= 0) | (full & (turn * turn < FLIP_COSINE * FLIP_COSINE * shape * old_shape));
        /* without a direction before: agree with the surroundings */
        const int8x32 undirected = old_shape <= NO_SHAPE * NO_SHAPE, against = lanes_dot(n, up) < 0;
        bad |= stays & (sliver | (undirected & against) | (~undirected & flips));
        lanes_store(change->turned[end][0] + first, lanes_where(stays, n.x));
        lanes_store(change->turned[end][1] + first, lanes_where(stays, n.y));
        lanes_store(change->turned[end][2] + first, lanes_where(stays, n.z));
        lanes_store(change->heights[end] + first, height * height / (old_square + TINY));
    }
    return guard == GUARD_NONE || !lanes_any(bad);
}

LANES_INLINE bool turn_both(enum guard guard, struct edge_change *change, const float fan_normal[3])
{
    return turn_faces(guard, change, 0, fan_normal) && turn_faces(guard, change, 1, fan_normal);
}

static bool turn_both_scalar(enum guard guard, struct edge_change *change,
                             const float fan_normal[3])
{
    return turn_both(guard, change, fan_normal);
}

LANES_AVX2 static bool turn_both_avx2(enum guard guard, struct edge_change *change,
                                      const float fan_normal[3])
{
    return turn_both(guard, change, fan_normal);
}

bool edge_shape_allows(const struct collapse *c, struct edge_change *change)
{
    float normal[3];
    for (int k = 0; k < 3; k++)
        normal[k] = c->vertices[change->v].fan.normal[k] + c->vertices[change->w].fan.normal[k];
    return c->level >= CPU_AVX2 ? turn_both_avx2(c->guard, change, normal)
                                : turn_both_scalar(c->guard, change, normal);
}

/* ---- fans ---- */

/* The nine numbers that a face of normal n adds to a fan. */
LANES_INLINE void fan_parts(struct vec3x8 n, float8 parts[9])
{
    parts[0] = n.x * n.x;
    parts[1] = n.x * n.y;
    parts[2] = n.x * n.z;
    parts[3] = n.y * n.y;
    parts[4] = n.y * n.z;
    parts[5] = n.z * n.z;
    parts[6] = n.x;
    parts[7] = n.y;
    parts[8] = n.z;
}

/* What eight faces from `first` at one end add to a fan now (`now`), and that less what they added
 * before. Faces that go are taken away at the first end only. */
LANES_INLINE void compare_fans(const struct edge_change *change, int end, uint32_t first,
                               float8 now[9], float8 changes[9])
{
    const struct vertex_look *look = change->looks[end];
    const int32_t both = end == 0 ? -1 : 0;
    uint32_t gone[2];
    edge_faces_gone(change, end, gone);
    const int8x32 j = lanes_count_from(first);
    const int8x32 counts = both | ((j != (int32_t)gone[0]) & (j != (int32_t)gone[1]));
    const struct vec3x8 n = load_from(look->normals, first);
    const struct vec3x8 old = {lanes_where(counts, n.x), lanes_where(counts, n.y),
                               lanes_where(counts, n.z)};
    float8 before[9];
    fan_parts(load_from((const float(*)[RING_LANES])change->turned[end], first), now);
    fan_parts(old, before);
    for (int k = 0; k < 9; k++)
        changes[k] = now[k] - before[k];
}

/* The sums of eight vectors' lanes, each in lanes_sum's order. */
LANES_INLINE float8 eight_sums(const float8 v[LANES])
{
    float8 r[LANES];
    memcpy(r, v, sizeof r);
    lanes_transpose(r);
    return ((r[0] + r[4]) + (r[2] + r[6])) + ((r[1] + r[5]) + (r[3] + r[7]));
}

/* What faces change, a row each: eight of the nine numbers, and the ninth. */
struct face_rows {
    float8 rows[LANES];
    float ninths[LANES];
};

LANES_INLINE void make_rows(const float8 changes[9], struct face_rows *faces)
{
    float8 rows[LANES];
    memcpy(rows, changes, sizeof rows);
    lanes_transpose(rows);
    memcpy(faces->rows, rows, sizeof rows);
    lanes_store(faces->ninths, changes[8]);
}

/* Adds to each neighbour's fan the changes of the two faces at its edge: what stands in front of
 * the first is the last face of a closed ring; of an open one that is 0. `fresh` gets what all
 * faces add now. */
LANES_INLINE void change_fans(struct collapse *c, const struct edge_change *change, int end,
                              float8 fresh[9])
{
    const struct ring *ring = &change->looks[end]->ring;
    const uint32_t last = ring->count - 1;
    float8 now[9], changes[9];
    struct face_rows faces;
    compare_fans(change, end, last / LANES * LANES, now, changes);
    make_rows(changes, &faces);
    float8 before = faces.rows[last % LANES];
    float ninth = faces.ninths[last % LANES];
    for (uint32_t first = 0; first < ring->count; first += LANES) {
        if (ring->count > LANES) {
            compare_fans(change, end, first, now, changes);
            make_rows(changes, &faces);
        }
        for (int k = 0; k < 9; k++)
            fresh[k] += now[k];
        for (uint32_t i = 0; i < LANES && first + i < ring->count; i++) {
            float *fan = (float *)&c->vertices[ring->vertices[first + i]].fan; /* nine of them */
            lanes_store(fan, lanes_load(fan) + (before + faces.rows[i]));
            fan[8] += ninth + faces.ninths[i];
            before = faces.rows[i];
            ninth = faces.ninths[i];
        }
    }
}

LANES_INLINE void update_fans(struct collapse *c, const struct edge_change *change, uint32_t kept)
{
    float8 fresh[9] = {{0}};
    for (int end = 0; end < 2; end++)
        change_fans(c, change, end, fresh);
    float *fan = (float *)&c->vertices[kept].fan;
    lanes_store(fan, eight_sums(fresh));
    fan[8] = lanes_sum(fresh[8]);
}

static void update_fans_scalar(struct collapse *c, const struct edge_change *change, uint32_t kept)
{
    update_fans(c, change, kept);
}

LANES_AVX2 static void update_fans_avx2(struct collapse *c, const struct edge_change *change,
                                        uint32_t kept)
{
    update_fans(c, change, kept);
}

void edge_update_fans(struct collapse *c, const struct edge_change *change, uint32_t kept)
{
    if (c->level >= CPU_AVX2)
        update_fans_avx2(c, change, kept);
    else
        update_fans_scalar(c, change, kept);
}

/* (Put together from single floats, a vector goes through memory, which is waited for.) */
void fans_build(struct collapse *c)
{
    static const int4 first_three = {-1, -1, -1, 0};
    static const float4 ones = {1, 1, 1, 1};
    for (size_t v = 0; v < (size_t)c->vertex_slots; v++)
        memset(&c->vertices[v].fan, 0, sizeof c->vertices[v].fan);
    for (size_t f = 0; f < (size_t)c->face_slots; f++) {
        const struct collapse_corner *corner = c->corners + 3 * f;
        const float4 p = float4_load(c->vertices[corner[0].end].position);
        const float4 q = float4_load(c->vertices[corner[1].end].position);
        const float4 r = float4_load(c->vertices[corner[2].end].position);
        const float4 a = (float4)((int4)(q - p) & first_three);
        const float4 b = (float4)((int4)(r - p) & first_three);
        const float4 n =
            __builtin_shufflevector(a, a, 1, 2, 0, 3) * __builtin_shufflevector(b, b, 2, 0, 1, 3) -
            __builtin_shufflevector(a, a, 2, 0, 1, 3) * __builtin_shufflevector(b, b, 1, 2, 0, 3);
        const float4 first = /* xx, xy, xz, yy */
            __builtin_shufflevector(n, n, 0, 0, 0, 1) * __builtin_shufflevector(n, n, 0, 1, 2, 1);
        const float4 second = /* yz, zz, x, y */
            __builtin_shufflevector(n, n, 1, 2, 0, 1) *
            __builtin_shufflevector(n, ones, 2, 2, 4, 5);
        for (int i = 0; i < 3; i++) {
            float *fan = (float *)&c->vertices[corner[i].end].fan; /* nine of them */
            float4_store(fan, float4_load(fan) + first);
            float4_store(fan + 4, float4_load(fan + 4) + second);
            fan[8] += n[2];
        }
    }
}
