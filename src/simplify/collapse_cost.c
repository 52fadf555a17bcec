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

static inline void look_at(const struct collapse *c, uint32_t w, const float from[3], uint32_t i,
                           struct vertex_look *look)
{
    const struct collapse_vertex *vertex = &c->vertices[w];
    look->ring.vertices[i] = w;
    look->flags |= vertex->flags;
    for (int k = 0; k < 3; k++)
        look->at[k][i] = vertex->position[k] - from[k];
}

/* Turns round v. */
static inline void gather(const struct collapse *c, uint32_t v, struct vertex_look *look)
{
    const float *from = c->vertices[v].position;
    const uint32_t first = c->vertices[v].corner;
    struct ring *ring = &look->ring;
    uint32_t corner = first, count = 0, last;
    look->flags = c->vertices[v].flags;
    do {
        if (count == RING_MAX) {
            ring->count = ring->faces = 0;
            return;
        }
        ring->corners[count] = corner;
        look_at(c, c->corners[corner].end, from, count++, look);
        last = corner;
        corner = c->corners[corner].swing;
    } while (corner != first && corner != NO_INDEX);
    ring->faces = count;
    if (corner == NO_INDEX)
        look_at(c, c->corners[corner_next(last)].end, from, count++, look);
    ring->count = count;
}

void vertex_look_round(const struct collapse *c, uint32_t v, struct vertex_look *look)
{
    const struct ring *ring = &look->ring;
    gather(c, v, look);
    if (ring->count == 0)
        return;
    /* one more for the last face, then zeros: lanes beyond the last face have normal 0 */
    const bool closed = ring->faces == ring->count;
    for (uint32_t i = ring->count; i < ring->count + EDGE_LANES; i++)
        for (int k = 0; k < 3; k++)
            look->at[k][i] = i == ring->count && closed ? look->at[k][0] : 0;
    for (uint32_t first = 0; first < ring->count; first += EDGE_LANES)
        for (uint32_t i = first; i < first + EDGE_LANES; i++) {
            const float ax = look->at[0][i], ay = look->at[1][i], az = look->at[2][i];
            const float bx = look->at[0][i + 1], by = look->at[1][i + 1], bz = look->at[2][i + 1];
            look->normals[0][i] = ay * bz - az * by;
            look->normals[1][i] = az * bx - ax * bz;
            look->normals[2][i] = ax * by - ay * bx;
        }
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
static void fill_lanes(const struct collapse *c, const struct vertex_edges *e, uint32_t first,
                       struct edge_lanes *lanes)
{
    const struct ring *ring = &e->look.ring;
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
            lanes->edge[k][i] = e->look.at[k][first + i];
            lanes->left[k][i] = e->look.normals[k][first + i];
        }
        /* the last ring vertex's right neighbour in an open ring has the last normal, and its left
         * one is 0 as there is no face beyond */
        const bool closed = ring->faces == ring->count;
        lanes->right[k][0] = first > 0 ? e->look.normals[k][first - 1]
                             : closed  ? e->look.normals[k][ring->count - 1]
                                       : 0;
        for (uint32_t i = 1; i < EDGE_LANES; i++)
            lanes->right[k][i] = e->look.normals[k][first + i - 1];
    }
}

/* Whether edges of v need a look of their own: border or locked vertices. */
static void mend_special_lanes(const struct collapse *c, uint32_t v, struct vertex_edges *e,
                               uint32_t first, struct edge_lanes *lanes)
{
    const struct ring *ring = &e->look.ring;
    const uint32_t end = first + EDGE_LANES < ring->count ? first + EDGE_LANES : ring->count;
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
            const bool stay = (c->vertices[v].flags & VERTEX_LOCKED) ||
                              (!(c->vertices[w].flags & VERTEX_LOCKED) &&
                               (here < there || (here <= there && v < w)));
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
    vertex_look_round(c, v, &e->look);
    e->reach_square = 0;
    for (uint32_t i = 0; i < e->look.ring.count; i++) {
        const float square = e->look.at[0][i] * e->look.at[0][i] +
                             e->look.at[1][i] * e->look.at[1][i] +
                             e->look.at[2][i] * e->look.at[2][i];
        e->reach_square = square > e->reach_square ? square : e->reach_square;
    }
    for (uint32_t first = 0; first < e->look.ring.count; first += EDGE_LANES) {
        fill_lanes(c, e, first, &lanes);
        if (c->options.subset)
            edge_lanes_ends(&c->vertices[v].fan, &lanes);
        else
            edge_lanes_place(c->level, &c->vertices[v].fan, e->reach_square, &lanes);
        if (e->look.flags || c->options.subset)
            mend_special_lanes(c, v, e, first, &lanes);
        for (int k = 0; k < 3; k++)
            memcpy(&e->places[k][first], lanes.at[k], sizeof lanes.at[k]);
        for (uint32_t i = 0; i < EDGE_LANES; i++) {
            const float cost = lanes.cost[i] / area_part(&c->vertices[v].fan, &lanes, i);
            e->costs[first + i] = cost < 3e38f ? cost : INFINITY;
        }
    }
}
