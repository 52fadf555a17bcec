/*
 * What an edge's collapse costs, where its vertex goes, and whether the faces stay sound.
 *
 * The plain memoryless method sums over the ten triangles round an edge for each of the fifteen
 * edges near a collapse, and so looks at every triangle again and again. Here each vertex keeps the
 * sums over its own triangles (struct fan); an edge's are those of its two ends less the two
 * triangles that both count, and looking at all edges of a vertex needs one turn round it and one
 * call of the lanes in geom/quadric.
 */
#include <math.h>
#include <string.h>

#include "collapse_internal.h"

static inline void position_from(const struct collapse *c, uint32_t v, const float from[3],
                                 double out[3])
{
    const float *p = c->vertices[v].position;
    for (int k = 0; k < 3; k++)
        out[k] = (double)p[k] - (double)from[k];
}

/* Turns round v. */
LANES_INLINE void gather(const struct collapse *c, const struct territory *t, uint32_t v,
                         struct vertex_look *look)
{
    const struct collapse_vertex *vertices = c->vertices;
    const struct collapse_corner *corners = c->corners;
    const uint32_t begin = t->first, size = t->end - begin, first = vertices[v].corner;
    struct ring *ring = &look->ring;
    uint32_t corner = first, count = 0, last, flags = vertices[v].flags;
    look->reaches_out = true;
    ring->count = ring->faces = 0;
    do {
        if (count == RING_MAX) {
            look->reaches_out = false;
            return;
        }
        const uint32_t end = corners[corner].end;
        if (end - begin >= size)
            return;
        ring->corners[count] = corner;
        ring->vertices[count++] = end;
        flags |= vertices[end].flags;
        last = corner;
        corner = corners[corner].swing;
    } while (corner != first && corner != NO_INDEX);
    const uint32_t faces = count;
    if (corner == NO_INDEX) {
        const uint32_t end = corners[corner_next(last)].end;
        if (end - begin >= size)
            return;
        ring->vertices[count++] = end;
        flags |= vertices[end].flags;
    }
    look->reaches_out = false;
    look->flags = flags;
    ring->faces = faces;
    ring->count = count;
    /* what stands behind the last is the first again, or v itself, which is at 0 */
    for (uint32_t i = 0; i < LANES + 1; i++)
        ring->vertices[count + i] = v;
    if (faces == count)
        ring->vertices[count] = ring->vertices[0];
}

/* Where two vertices are, side by side, each with a fourth number that says nothing. */
LANES_INLINE float8 load_places(const struct collapse_vertex *vertices, uint32_t v, uint32_t w)
{
    float4 low, high;
    memcpy(&low, &vertices[v], sizeof low);
    memcpy(&high, &vertices[w], sizeof high);
    return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7);
}

/* Eight neighbours, relative to v. */
LANES_INLINE struct vec3x8 eight_places(const struct collapse *c, uint32_t v, const uint32_t *ring)
{
    const struct collapse_vertex *p = c->vertices;
    const float *from = p[v].position;
    const float8 a = load_places(p, ring[0], ring[4]), b = load_places(p, ring[1], ring[5]);
    const float8 d = load_places(p, ring[2], ring[6]), e = load_places(p, ring[3], ring[7]);
    const float8 ab = __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13);
    const float8 de = __builtin_shufflevector(d, e, 0, 8, 1, 9, 4, 12, 5, 13);
    const float8 ab_z = __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15);
    const float8 de_z = __builtin_shufflevector(d, e, 2, 10, 3, 11, 6, 14, 7, 15);
    return (struct vec3x8){
        __builtin_shufflevector(ab, de, 0, 1, 8, 9, 4, 5, 12, 13) - from[0],
        __builtin_shufflevector(ab, de, 2, 3, 10, 11, 6, 7, 14, 15) - from[1],
        __builtin_shufflevector(ab_z, de_z, 0, 1, 8, 9, 4, 5, 12, 13) - from[2],
    };
}

/* What stands one lane further, `next` behind `v`. */
LANES_INLINE float8 one_further(float8 v, float8 next)
{
    return __builtin_shufflevector(v, next, 1, 2, 3, 4, 5, 6, 7, 8);
}

LANES_INLINE void store3(float to[3][RING_LANES], uint32_t i, struct vec3x8 v)
{
    lanes_store(to[0] + i, v.x);
    lanes_store(to[1] + i, v.y);
    lanes_store(to[2] + i, v.z);
}

/* The places of a ring that gather() has found, and the faces between them. Vectors are stored as
 * wholes, as they are going to be loaded: what is put together from smaller stores has to wait
 * until these are done. */
LANES_INLINE void make_normals(const struct collapse *c, uint32_t v, struct vertex_look *look)
{
    const struct ring *ring = &look->ring;
    struct vec3x8 a = eight_places(c, v, ring->vertices);
    for (uint32_t i = 0; i < ring->count; i += LANES) {
        struct vec3x8 next = {lanes_all(0), lanes_all(0), lanes_all(0)};
        if (i + LANES <= ring->count)
            next = eight_places(c, v, ring->vertices + i + LANES);
        const struct vec3x8 b = {one_further(a.x, next.x), one_further(a.y, next.y),
                                 one_further(a.z, next.z)};
        store3(look->at, i, a);
        store3(look->normals, i, lanes_cross(a, b));
        store3(look->at, i + LANES, next);
        a = next;
    }
}

LANES_INLINE void look_round(const struct collapse *c, const struct territory *t, uint32_t v,
                             struct vertex_look *look)
{
    gather(c, t, v, look);
    if (look->ring.count > 0)
        make_normals(c, v, look);
}

static void look_round_scalar(const struct collapse *c, const struct territory *t, uint32_t v,
                              struct vertex_look *look)
{
    look_round(c, t, v, look);
}

LANES_AVX2 static void look_round_avx2(const struct collapse *c, const struct territory *t,
                                       uint32_t v, struct vertex_look *look)
{
    look_round(c, t, v, look);
}

void vertex_look_round(const struct collapse *c, const struct territory *t, uint32_t v,
                       struct vertex_look *look)
{
    if (c->level >= CPU_AVX2)
        look_round_avx2(c, t, v, look);
    else
        look_round_scalar(c, t, v, look);
}

/* Adds v's border edges, positions relative to `origin`, but for the one to `except`. */
static void add_border_edges(const struct collapse *c, uint32_t v, uint32_t except,
                             const float origin[3], struct border_sum *sum)
{
    if (!(c->vertices[v].flags & VERTEX_BORDER))
        return;
    double at[3], end[3];
    const uint32_t first = c->vertices[v].corner;
    const uint32_t out = c->corners[first].end;
    uint32_t last = first;
    while (c->corners[last].swing != NO_INDEX)
        last = c->corners[last].swing;
    const uint32_t in = c->corners[corner_next(last)].end;
    position_from(c, v, origin, at);
    if (out != except) {
        position_from(c, out, origin, end);
        border_sum_add(sum, at, end);
    }
    if (in != except) {
        position_from(c, in, origin, end);
        border_sum_add(sum, end, at);
    }
}

void border_edges_sum(const struct collapse *c, uint32_t v, uint32_t w, struct border_sum *sum)
{
    const float *origin = c->vertices[v].position;
    memset(sum, 0, sizeof *sum);
    add_border_edges(c, v, NO_INDEX, origin, sum);
    add_border_edges(c, w, v, origin, sum);
}

/* Puts edges first.. of v into the lanes. */
LANES_INLINE void fill_lanes(const struct collapse *c, const struct vertex_edges *e, uint32_t first,
                             struct edge_lanes *lanes)
{
    const struct vertex_look *look = &e->look;
    const uint32_t *ring = look->ring.vertices + first;
    const bool closed = look->ring.faces == look->ring.count;
    float8 fans[LANES], last = lanes_all(0);
    for (uint32_t i = 0; i < LANES; i++) {
        const struct fan *fan = &c->vertices[ring[i]].fan;
        fans[i] = lanes_load((const float *)fan); /* eight of its nine numbers */
        last[i] = fan->normal[2];
    }
    lanes_transpose(fans);
    for (int k = 0; k < 6; k++)
        lanes_store(lanes->square[k], fans[k]);
    for (int k = 0; k < 2; k++)
        lanes_store(lanes->normal[k], fans[6 + k]);
    lanes_store(lanes->normal[2], last);
    /* the last ring vertex's right neighbour in an open ring has the last normal, and its left one
     * is 0 as there is no face beyond */
    for (int k = 0; k < 3; k++) {
        const float *normals = look->normals[k];
        const float8 left = lanes_load(normals + first);
        const float before = first > 0 ? normals[first - 1]
                             : closed  ? normals[look->ring.count - 1]
                                       : 0;
        float8 right = __builtin_shufflevector(left, left, 7, 0, 1, 2, 3, 4, 5, 6);
        right[0] = before;
        lanes_store(lanes->edge[k], lanes_load(look->at[k] + first));
        lanes_store(lanes->left[k], left);
        lanes_store(lanes->right[k], right);
    }
}

/* Whether edges of v need a look of their own: border or locked vertices. */
static void mend_special_lanes(const struct collapse *c, uint32_t v, struct vertex_edges *e,
                               uint32_t first, struct edge_lanes *lanes)
{
    const struct ring *ring = &e->look.ring;
    const uint32_t end = first + LANES < ring->count ? first + LANES : ring->count;
    bool have_ends = c->options.subset;
    for (uint32_t i = first; i < end; i++) {
        const uint32_t w = ring->vertices[i], lane = i - first;
        const unsigned either = c->vertices[v].flags | c->vertices[w].flags,
                       both = c->vertices[v].flags & c->vertices[w].flags;
        if ((both & VERTEX_LOCKED) || ((both & VERTEX_BORDER) && i > 0 && i < ring->faces)) {
            lanes->cost[lane] = INFINITY;
            continue;
        }
        const bool at_end = c->options.subset || (either & VERTEX_LOCKED);
        if (at_end && !have_ends) {
            edge_lanes_ends(c->level, &c->vertices[v].fan, lanes);
            have_ends = true;
        }
        if (either & VERTEX_BORDER) {
            struct border_sum border;
            border_edges_sum(c, v, w, &border);
            if (at_end)
                edge_border_ends(&border, c->options.border_weight, lanes, lane);
            else
                edge_border_place(&c->vertices[v].fan, e->reach_square, &border,
                                  c->options.border_weight, lanes, lane);
        }
        if (at_end) {
            const float here = lanes->cost_here[lane], there = lanes->cost_there[lane];
            /* ties by number, so that both ends of the edge choose the same */
            const bool stay = (c->vertices[v].flags & VERTEX_LOCKED) ||
                              (!(c->vertices[w].flags & VERTEX_LOCKED) &&
                               (here < there || (here <= there && v < w)));
            lanes->cost[lane] = stay ? here : there;
            for (int k = 0; k < 3; k++)
                lanes->at[k][lane] = stay ? 0 : lanes->edge[k][lane];
        }
    }
}

/* Square of the largest distance of a neighbour. */
LANES_INLINE float longest_square(const struct vertex_look *look)
{
    float8 longest = lanes_all(0);
    for (uint32_t i = 0; i < look->ring.count; i += LANES) {
        const struct vec3x8 at = lanes_load3(look->at[0] + i, look->at[1] + i, look->at[2] + i);
        const float8 square = lanes_dot(at, at);
        longest = lanes_choose(square > longest, square, longest);
    }
    return lanes_largest(longest);
}

/* Edges first.. of v have these costs; keeps the first of the cheapest so far. */
LANES_INLINE void note_costs(struct vertex_edges *e, uint32_t first, float8 costs)
{
    const int8x32 is_edge = lanes_count_from(first) < (int32_t)e->look.ring.count;
    costs = lanes_choose(is_edge, costs, lanes_all(INFINITY));
    lanes_store(&e->costs[first], costs);
    const float8 least = lanes_all_least(costs);
    if (first > 0 && !(least[0] < e->least))
        return;
    e->least = least[0];
    e->cheapest = first + lowest_bit(lanes_bits(costs == least));
}

/*
 * Costs are divided by the fourth root of the sum of squared areas round the edge. Lindstrom and
 * Turk order edges by squared volumes, that is squared distance times squared area, and so give
 * up small sharp features first, which are where the largest distances arise; Garland and Heckbert
 * by squared distance times area. A quarter of the way between them leaves the mean as it was
 * (koala and bunny at 2 %: 0.3 to 0.8 % more) and makes the largest distance a fifth to a quarter
 * smaller.
 */
LANES_INLINE void evaluate(const struct collapse *c, const struct territory *t, uint32_t v,
                           struct vertex_edges *e)
{
    const struct fan *fan = &c->vertices[v].fan;
    struct edge_lanes lanes;
    look_round(c, t, v, &e->look);
    e->least = INFINITY;
    e->cheapest = 0;
    if (e->look.ring.count == 0)
        return;
    e->reach_square = longest_square(&e->look);
    for (uint32_t first = 0; first < e->look.ring.count; first += LANES) {
        fill_lanes(c, e, first, &lanes);
        if (c->options.subset)
            edge_lanes_ends(c->level, fan, &lanes);
        else
            edge_lanes_place(c->level, fan, e->reach_square, &lanes);
        if (e->look.flags || c->options.subset)
            mend_special_lanes(c, v, e, first, &lanes);
        edge_lanes_weigh(c->level, fan, &lanes);
        for (int k = 0; k < 3; k++)
            lanes_store(&e->places[k][first], lanes_load(lanes.at[k]));
        note_costs(e, first, lanes_load(lanes.cost));
    }
}

static void evaluate_scalar(const struct collapse *c, const struct territory *t, uint32_t v,
                            struct vertex_edges *e)
{
    evaluate(c, t, v, e);
}

LANES_AVX2 static void evaluate_avx2(const struct collapse *c, const struct territory *t,
                                     uint32_t v, struct vertex_edges *e)
{
    evaluate(c, t, v, e);
}

void vertex_evaluate(const struct collapse *c, const struct territory *t, uint32_t v,
                     struct vertex_edges *e)
{
    if (c->level >= CPU_AVX2)
        evaluate_avx2(c, t, v, e);
    else
        evaluate_scalar(c, t, v, e);
}
