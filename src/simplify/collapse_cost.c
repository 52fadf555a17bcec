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
#include "geom/distance.h"

/* A face may turn by less than the angle with this cosine (about 78 degrees). */
static const double FLIP_COSINE = 0.2;
/* Below this |n| / (sum of squared edges) a face is a sliver; an equilateral one has 0.289. A
 * stricter guard holds needles of range scans in place, and what they keep others must give: with
 * 0.01 the dragon's mean error at 1 % was a quarter larger. */
static const double SLIVER_SHAPE = 0.001;

static inline void position_from(const struct collapse *c, uint32_t v, const float from[3],
                                 double out[3])
{
    const float *p = c->vertices[v].position;
    for (int k = 0; k < 3; k++)
        out[k] = (double)p[k] - (double)from[k];
}

/* Ring, neighbours and face normals of v. */
static void look_round(const struct collapse *c, uint32_t v, struct vertex_edges *e)
{
    const float *from = c->vertices[v].position;
    struct ring *ring = &e->ring;
    ring_gather(c, v, ring);
    if (ring->count == 0)
        return;
    for (uint32_t i = 0; i < ring->count; i++) {
        const float *p = c->vertices[ring->vertices[i]].position;
        e->at[0][i] = p[0] - from[0];
        e->at[1][i] = p[1] - from[1];
        e->at[2][i] = p[2] - from[2];
    }
    /* one more for the last face, then zeros: lanes beyond the last face have normal 0 */
    const bool closed = ring->faces == ring->count;
    for (uint32_t i = ring->count; i < RING_LANES && i < ring->count + EDGE_LANES; i++)
        for (int k = 0; k < 3; k++)
            e->at[k][i] = i == ring->count && closed ? e->at[k][0] : 0;
    for (uint32_t first = 0; first < ring->count; first += EDGE_LANES)
        for (uint32_t i = first; i < first + EDGE_LANES; i++) {
            const float ax = e->at[0][i], ay = e->at[1][i], az = e->at[2][i];
            const float bx = e->at[0][i + 1], by = e->at[1][i + 1], bz = e->at[2][i + 1];
            e->normals[0][i] = ay * bz - az * by;
            e->normals[1][i] = az * bx - ax * bz;
            e->normals[2][i] = ax * by - ay * bx;
        }
}

static inline float lanes_sum(const float s[EDGE_LANES])
{
    return ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7]));
}

void fan_compute(struct collapse *c, uint32_t v)
{
    struct vertex_edges e;
    look_round(c, v, &e);
    if (e.ring.count == 0) {
        c->flags[v] |= VERTEX_HUB;
        return;
    }
    c->flags[v] &= (unsigned char)~VERTEX_HUB;
    float sums[9][EDGE_LANES] = {{0}};
    for (uint32_t first = 0; first < e.ring.faces; first += EDGE_LANES)
        for (uint32_t i = 0; i < EDGE_LANES; i++) {
            const float x = e.normals[0][first + i], y = e.normals[1][first + i];
            const float z = e.normals[2][first + i];
            sums[0][i] += x * x;
            sums[1][i] += x * y;
            sums[2][i] += x * z;
            sums[3][i] += y * y;
            sums[4][i] += y * z;
            sums[5][i] += z * z;
            sums[6][i] += x;
            sums[7][i] += y;
            sums[8][i] += z;
        }
    struct fan *fan = &c->vertices[v].fan;
    for (int k = 0; k < 6; k++)
        fan->square[k] = lanes_sum(sums[k]);
    for (int k = 0; k < 3; k++)
        fan->normal[k] = lanes_sum(sums[6 + k]);
}

/* Adds v's border edges, positions relative to `origin`, but for the one to `except`. */
static void add_border_edges(const struct collapse *c, uint32_t v, uint32_t except,
                             const float origin[3], struct border_sum *sum)
{
    if (!(c->flags[v] & VERTEX_BORDER))
        return;
    double at[3], end[3];
    const uint32_t first = c->vertices[v].corner;
    const uint32_t out = c->corners[corner_next(first)].vertex;
    uint32_t last = corner_previous(first);
    while (c->corners[last].opposite != NO_INDEX)
        last = corner_previous(c->corners[last].opposite);
    const uint32_t in = c->corners[last].vertex;
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

/* The border edges at both ends of an edge, relative to v. */
static void border_edges_sum(const struct collapse *c, uint32_t v, uint32_t w,
                             struct border_sum *sum)
{
    const float *origin = c->vertices[v].position;
    memset(sum, 0, sizeof *sum);
    add_border_edges(c, v, NO_INDEX, origin, sum);
    add_border_edges(c, w, v, origin, sum);
}

/* Puts edges first.. of v into the lanes. */
static void fill_lanes(const struct collapse *c, const struct vertex_edges *e, uint32_t first,
                       struct edge_lanes *lanes)
{
    const struct ring *ring = &e->ring;
    const uint32_t left = ring->count - first, used = left < EDGE_LANES ? left : EDGE_LANES;
    for (uint32_t i = 0; i < used; i++) {
        const struct fan *fan = &c->vertices[ring->vertices[first + i]].fan;
        for (int k = 0; k < 6; k++)
            lanes->square[k][i] = fan->square[k];
        for (int k = 0; k < 3; k++)
            lanes->normal[k][i] = fan->normal[k];
    }
    for (uint32_t i = used; i < EDGE_LANES; i++) {
        for (int k = 0; k < 6; k++)
            lanes->square[k][i] = 1;
        for (int k = 0; k < 3; k++)
            lanes->normal[k][i] = 1;
    }
    for (int k = 0; k < 3; k++) {
        for (uint32_t i = 0; i < EDGE_LANES; i++) {
            lanes->edge[k][i] = e->at[k][first + i];
            lanes->left[k][i] = e->normals[k][first + i];
        }
        /* the last ring vertex's right neighbour in an open ring has the last normal, and its left
         * one is 0 as there is no face beyond */
        const bool closed = ring->faces == ring->count;
        lanes->right[k][0] = first > 0 ? e->normals[k][first - 1]
                             : closed  ? e->normals[k][ring->count - 1]
                                       : 0;
        for (uint32_t i = 1; i < EDGE_LANES; i++)
            lanes->right[k][i] = e->normals[k][first + i - 1];
    }
}

/* Whether edges of v need a look of their own: border or locked vertices. */
static void mend_special_lanes(const struct collapse *c, uint32_t v, struct vertex_edges *e,
                               uint32_t first, struct edge_lanes *lanes)
{
    const struct ring *ring = &e->ring;
    const uint32_t end = first + EDGE_LANES < ring->count ? first + EDGE_LANES : ring->count;
    bool have_ends = c->options.subset;
    for (uint32_t i = first; i < end; i++) {
        const uint32_t w = ring->vertices[i], lane = i - first;
        const unsigned either = c->flags[v] | c->flags[w], both = c->flags[v] & c->flags[w];
        if ((both & VERTEX_LOCKED) || (either & VERTEX_HUB) ||
            ((both & VERTEX_BORDER) && i > 0 && i < ring->faces)) {
            lanes->cost[lane] = INFINITY;
            continue;
        }
        const bool at_end = c->options.subset || (either & VERTEX_LOCKED);
        if (at_end && !have_ends) {
            edge_lanes_ends(&c->vertices[v].fan, lanes);
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
            const bool stay =
                (c->flags[v] & VERTEX_LOCKED) ||
                (!(c->flags[w] & VERTEX_LOCKED) && (here < there || (here <= there && v < w)));
            lanes->cost[lane] = stay ? here : there;
            for (int k = 0; k < 3; k++)
                lanes->at[k][lane] = stay ? 0 : lanes->edge[k][lane];
        }
    }
}

/*
 * What a cost is divided by: the fourth root of the sum of squared areas round the edge. Lindstrom
 * and Turk order edges by squared volumes, that is squared distance times squared area, and so give
 * up small sharp features first, which are where the largest distances arise; Garland and Heckbert
 * by squared distance times area. A quarter of the way between them leaves the mean as it was
 * (koala and bunny at 2 %: 0.3 to 0.8 % more) and makes the largest distance a fifth to a quarter
 * smaller.
 */
static inline float area_part(const struct fan *fan, const struct edge_lanes *lanes, uint32_t i)
{
    const float squares = (fan->square[0] + fan->square[3] + fan->square[5]) +
                          (lanes->square[0][i] + lanes->square[3][i] + lanes->square[5][i]);
    return sqrtf(sqrtf(squares)) + 1e-30f;
}

void vertex_evaluate(const struct collapse *c, uint32_t v, struct vertex_edges *e)
{
    struct edge_lanes lanes;
    look_round(c, v, e);
    unsigned char any = c->flags[v];
    e->reach_square = 0;
    for (uint32_t i = 0; i < e->ring.count; i++) {
        const float square =
            e->at[0][i] * e->at[0][i] + e->at[1][i] * e->at[1][i] + e->at[2][i] * e->at[2][i];
        e->reach_square = square > e->reach_square ? square : e->reach_square;
        any |= c->flags[e->ring.vertices[i]];
    }
    for (uint32_t first = 0; first < e->ring.count; first += EDGE_LANES) {
        fill_lanes(c, e, first, &lanes);
        if (c->options.subset)
            edge_lanes_ends(&c->vertices[v].fan, &lanes);
        else
            edge_lanes_place(&c->vertices[v].fan, e->reach_square, &lanes);
        if (any || c->options.subset)
            mend_special_lanes(c, v, e, first, &lanes);
        for (int k = 0; k < 3; k++)
            memcpy(&e->places[k][first], lanes.at[k], sizeof lanes.at[k]);
        for (uint32_t i = 0; i < EDGE_LANES; i++) {
            const float cost = lanes.cost[i] / area_part(&c->vertices[v].fan, &lanes, i);
            e->costs[first + i] = cost < 3e38f ? cost : INFINITY;
        }
    }
}

/* Sums over the planes of the faces that were there: how far the new vertex is from them, weighted
 * with their squared areas. */
struct plane_sum {
    double distance; /* sum of (n . step)^2 */
    double weight;   /* sum of n . n */
    double nearest;  /* squared distance of the new vertex from the nearest of the faces */
};

static void plane_sum_add(struct plane_sum *sum, const double n[3], const double step[3])
{
    const double h = dot_product(n, step);
    sum->distance += h * h;
    sum->weight += dot_product(n, n);
}

/* Notes how near the new vertex at `to` is to the face a, b, c. */
static void nearest_add(struct plane_sum *sum, const double to[3], const double a[3],
                        const double b[3], const double c[3])
{
    const struct triangle face = {vec3_load(a), vec3_load(b), vec3_load(c)};
    const double square = triangle_distance_squared(vec3_load(to), &face, NULL);
    sum->nearest = square < sum->nearest ? square : sum->nearest;
}

/* Whether one face that survives stays sound: its moving corner was at `from` and goes to `to`, the
 * two others are r and s. */
static bool face_allows(enum guard guard, const double from[3], const double to[3],
                        const double r[3], const double s[3], const double fan_normal[3],
                        struct plane_sum *sum)
{
    double a[3], b[3], c[3], d[3], e[3], n[3], old[3], moved[3];
    for (int k = 0; k < 3; k++) {
        a[k] = r[k] - to[k];
        b[k] = s[k] - to[k];
        c[k] = r[k] - from[k];
        d[k] = s[k] - from[k];
        e[k] = s[k] - r[k];
        moved[k] = to[k] - from[k];
    }
    cross_product(a, b, n);
    cross_product(c, d, old);
    const double old_square = dot_product(old, old), new_square = dot_product(n, n);
    const double base = dot_product(e, e);
    const double sizes = dot_product(a, a) + dot_product(b, b) + base;
    const double old_sizes = dot_product(c, c) + dot_product(d, d) + base;
    plane_sum_add(sum, old, moved);
    nearest_add(sum, to, from, r, s);
    if (guard == GUARD_NONE)
        return true;
    if (guard == GUARD_FULL && new_square < SLIVER_SHAPE * SLIVER_SHAPE * sizes * sizes &&
        new_square * old_sizes * old_sizes < old_square * sizes * sizes)
        return false;
    if (old_square <= 1e-10 * old_sizes * old_sizes)
        return dot_product(n, fan_normal) >= 0; /* had no direction: agree with the surroundings */
    const double dot = dot_product(old, n);
    return dot > 0 && (guard == GUARD_TURNED ||
                       dot * dot >= FLIP_COSINE * FLIP_COSINE * old_square * new_square);
}

/* The faces at v but for the two that go. */
static bool own_faces_allow(enum guard guard, const struct vertex_edges *e, uint32_t i,
                            const double to[3], const double normal[3], struct plane_sum *sum)
{
    static const double zero[3] = {0, 0, 0};
    const struct ring *ring = &e->ring;
    double r[3], s[3];
    for (int k = 0; k < 3; k++)
        r[k] = (double)e->at[k][0];
    for (uint32_t j = 0; j < ring->faces; j++) {
        const uint32_t next = j + 1 == ring->count ? 0 : j + 1;
        for (int k = 0; k < 3; k++)
            s[k] = (double)e->at[k][next];
        if (j == i || next == i) {
            double n[3];
            cross_product(r, s, n);
            plane_sum_add(sum, n, to);
            nearest_add(sum, to, zero, r, s);
        } else if (!face_allows(guard, zero, to, r, s, normal, sum)) {
            return false;
        }
        memcpy(r, s, sizeof r);
    }
    return true;
}

/* The faces at v's neighbour, whose ring is `other`, but for the two that go. */
static bool other_faces_allow(const struct collapse *c, uint32_t v, const double edge[3],
                              const struct ring *other, const double to[3], const double normal[3],
                              struct plane_sum *sum)
{
    const float *from = c->vertices[v].position;
    double r[3], s[3];
    position_from(c, other->vertices[0], from, r);
    for (uint32_t j = 0; j < other->faces; j++) {
        const uint32_t next = j + 1 == other->count ? 0 : j + 1;
        position_from(c, other->vertices[next], from, s);
        if (other->vertices[j] != v && other->vertices[next] != v &&
            !face_allows(c->guard, edge, to, r, s, normal, sum))
            return false;
        memcpy(r, s, sizeof r);
    }
    return true;
}

bool edge_shape_allows(const struct collapse *c, uint32_t v, const struct vertex_edges *e,
                       uint32_t i, const struct ring *other, struct edge_outcome *outcome)
{
    const uint32_t w = e->ring.vertices[i];
    double normal[3], edge[3], to[3];
    struct plane_sum sum = {0, 0, INFINITY};
    for (int k = 0; k < 3; k++) {
        normal[k] = (double)c->vertices[v].fan.normal[k] + (double)c->vertices[w].fan.normal[k];
        edge[k] = (double)e->at[k][i];
        to[k] = (double)e->places[k][i];
    }
    if (!own_faces_allow(c->guard, e, i, to, normal, &sum) ||
        !other_faces_allow(c, v, edge, other, to, normal, &sum))
        return false;
    double square = sum.weight > 0 ? sum.distance / sum.weight : 0;
    if (c->flags[v] & c->flags[w] & VERTEX_BORDER) {
        struct border_sum border;
        border_edges_sum(c, v, w, &border);
        const double aside = border_sum_distance(&border, to);
        square = aside > square ? aside : square;
    }
    outcome->deviation = sqrt(square);
    outcome->overshoot = sum.nearest < INFINITY ? sqrt(sum.nearest) : 0;
    return true;
}
