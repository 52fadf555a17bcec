/*
 * The mesh as it was at a few times the faces, to measure by.
 *
 * What a collapse adds to the error can be told from the faces round it; what all have added
 * cannot: a vertex that keeps a ridge's volume drifts off it step by step, an edge comes to bridge
 * a hollow whose witnesses lie near other faces, and offsets that are added up say too much here
 * and too little there. Each is a single place that nobody sees, and it alone decides the largest
 * distance. The original is not here, and a copy of the whole small mesh would take half as much
 * memory again. But most of the error comes from the last collapses, and by then the arrays have
 * room that is not used any more.
 *
 * So a copy is taken on the way, at twice the faces that are wanted (four times at effort 3), with
 * a tree of boxes over its faces. A collapse that the estimate cannot call harmless is measured by
 * it: the new vertex and the middles of its edges are to lie near the copy, and the copy's vertices
 * near the new faces. Each vertex of the copy belongs to a live vertex, the one that it was merged
 * into; they hang together in rings (`next`), and two rings become one by exchanging two entries.
 * At the end what the estimate finds suspicious is measured once more, and that is the error
 * reported.
 */
#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "collapse_internal.h"
#include "geom/distance.h"

/* Of a vertex's points of the reference so many are looked at. */
enum { POINTS_MAX = 16 };
/* Faces turn by so little that it does not matter when the new vertex is not this part of the bound
 * from their planes. */
static const float TURNED_LEAST = 0.25f;
/* A vertex whose noted offset is below this part of the largest error is not measured at the end.
 */
static const double NOTED_LEAST = 0.3;
/* So many points are looked for among all faces where no face nearby is near. */
enum { SEARCHES_MAX = 64 };

/* ---- taking the copy ---- */

void reference_clear(struct collapse *c)
{
    struct reference *r = &c->reference;
    bvh_clear(c->ctx, &r->tree);
    memory_release(c->ctx, &r->next, r->vertex_count, sizeof *r->next);
    memory_release(c->ctx, &r->faces, r->face_count, 3 * sizeof *r->faces);
    memory_release(c->ctx, &r->positions, r->vertex_count, 3 * sizeof *r->positions);
    memset(r, 0, sizeof *r);
}

uint64_t reference_most_faces(const struct collapse *c)
{
    /* a face of the reference takes 74 bytes while the tree is built, one of the mesh 58 */
    return (c->face_count > c->face_room ? c->face_room : c->face_count) * 2 / 5;
}

/* Gives back what the arrays have no use for any more. */
static enum status shrink(struct collapse *c)
{
    enum status status = memory_resize(c->ctx, &c->corners, (size_t)c->face_room,
                                       (size_t)c->face_slots, 3 * sizeof *c->corners);
    if (status != STATUS_OK)
        return status;
    c->face_room = c->face_slots;
    status = memory_resize(c->ctx, &c->vertices, (size_t)c->vertex_room, (size_t)c->vertex_slots,
                           sizeof *c->vertices);
    if (status == STATUS_OK)
        c->vertex_room = c->vertex_slots;
    return status;
}

static enum status take_arrays(struct collapse *c)
{
    struct reference *r = &c->reference;
    r->vertex_count = c->vertex_slots;
    r->face_count = c->face_slots;
    enum status status =
        memory_take(c->ctx, (size_t)r->vertex_count, 3 * sizeof *r->positions, &r->positions);
    if (status == STATUS_OK)
        status = memory_take(c->ctx, (size_t)r->face_count, 3 * sizeof *r->faces, &r->faces);
    if (status == STATUS_OK)
        status = memory_take(c->ctx, (size_t)r->vertex_count, sizeof *r->next, &r->next);
    return status;
}

enum status reference_take(struct collapse *c)
{
    struct reference *r = &c->reference;
    enum status status = topology_compact(c);
    if (status == STATUS_OK)
        status = shrink(c);
    if (status == STATUS_OK)
        status = take_arrays(c);
    if (status == STATUS_OK) {
        for (uint32_t v = 0; v < r->vertex_count; v++) {
            r->next[v] = v;
            for (size_t k = 0; k < 3; k++)
                r->positions[3 * (size_t)v + k] = (double)c->vertices[v].position[k];
        }
        for (uint32_t i = 0; i < 3 * r->face_count; i++)
            r->faces[i] = corner_vertex(c, i);
        status = bvh_build(c->ctx, r->positions, r->faces, (uint32_t)r->face_count, &r->tree);
    }
    if (status != STATUS_OK)
        reference_clear(c);
    return status;
}

void reference_merge(struct collapse *c, uint32_t kept, uint32_t gone)
{
    uint32_t *next = c->reference.next;
    if (!next)
        return;
    const uint32_t after = next[kept];
    next[kept] = next[gone];
    next[gone] = after;
}

/* ---- from the surface to the reference ---- */

static struct vec3 widened(const float at[3])
{
    return (struct vec3){(double)at[0], (double)at[1], (double)at[2]};
}

static bool is_near(const struct collapse *c, const float at[3], double bound)
{
    return bvh_is_near(&c->reference.tree, widened(at), bound * bound);
}

/* The new vertex, and the middles of its edges: but for those beside which the faces hardly turn,
 * as these are about as far from the reference as before. */
static bool new_edges_are_near(const struct collapse *c, const struct edge_change *change,
                               double bound)
{
    const float turned = (float)(bound * bound) * TURNED_LEAST * TURNED_LEAST;
    float to[3];
    for (int k = 0; k < 3; k++)
        to[k] = c->vertices[change->v].position[k] + change->to[0][k];
    if (!is_near(c, to, bound))
        return false;
    for (int end = 0; end < 2; end++) {
        const struct ring *ring = &change->looks[end]->ring;
        const float *heights = change->heights[end];
        for (uint32_t j = 0; j < ring->count; j++) {
            const uint32_t w = ring->vertices[j], before = j > 0 ? j - 1 : ring->faces - 1;
            float middle[3];
            if (w == change->v || w == change->w ||
                (heights[j] <= turned && heights[before] <= turned &&
                 !edge_is_rim(c, change, end, j)))
                continue;
            for (int k = 0; k < 3; k++)
                middle[k] = (to[k] + c->vertices[w].position[k]) / 2;
            if (!is_near(c, middle, bound))
                return false;
        }
    }
    return true;
}

/* ---- from the reference to the surface ---- */

/* Whether the points that belong to vertex `owner` are near the faces after the collapse; where
 * `stays`, points that are as far already do not count. */
static bool points_are_near(const struct collapse *c, const struct edge_change *change, int end,
                            uint32_t owner, bool stays, double bound)
{
    const struct reference *r = &c->reference;
    const float *from = c->vertices[end ? change->w : change->v].position;
    const float most = (float)(bound * bound);
    uint32_t u = owner, count = 0;
    do {
        float p[3];
        for (int k = 0; k < 3; k++)
            p[k] = (float)(r->positions[3 * (size_t)u + k] - (double)from[k]);
        const float square = edge_square_after(c, change, end, p, most);
        if (square > most && !(stays && edge_square_before(c, change, end, p) >= square))
            return false;
        u = r->next[u];
    } while (u != owner && ++count < POINTS_MAX);
    return true;
}

bool reference_allows(const struct collapse *c, const struct edge_change *change, double bound)
{
    if (!new_edges_are_near(c, change, bound))
        return false;
    for (int end = 0; end < 2; end++) {
        const struct ring *ring = &change->looks[end]->ring;
        if (!points_are_near(c, change, end, end ? change->w : change->v, false, bound))
            return false;
        for (uint32_t j = 0; j < ring->count; j++)
            if (ring->vertices[j] != change->v && ring->vertices[j] != change->w &&
                !points_are_near(c, change, end, ring->vertices[j], true, bound))
                return false;
    }
    return true;
}

/* ---- all of it ---- */

/* The point's distance from the reference if it is more than `largest`, else `largest`. */
static double larger_distance(const struct collapse *c, const float at[3], double largest)
{
    struct nearest nearest = {INFINITY, UINT32_MAX, {0, 0, 0}};
    if (is_near(c, at, largest))
        return largest;
    bvh_nearest(&c->reference.tree, widened(at), &nearest);
    return sqrt(nearest.distance_squared);
}

/* Whether the faces at an edge are apart by more than `height` at one of its ends' sides: an edge
 * in a plane is as near as the faces' other edges. */
static bool is_bent(const struct collapse *c, uint32_t corner, double height)
{
    const uint32_t across = corner_opposite(c, corner);
    if (across == NO_INDEX || (c->vertices[c->corners[corner].end].flags &
                               c->vertices[corner_vertex(c, corner)].flags & VERTEX_BORDER))
        return true;
    const struct vec3 a = vec3_load_float(c->vertices[corner_vertex(c, corner)].position);
    const struct vec3 edge =
        vec3_sub(vec3_load_float(c->vertices[c->corners[corner].end].position), a);
    const struct vec3 left =
        vec3_sub(vec3_load_float(c->vertices[c->corners[corner_next(corner)].end].position), a);
    const struct vec3 right =
        vec3_sub(vec3_load_float(c->vertices[c->corners[corner_next(across)].end].position), a);
    const struct vec3 n = vec3_cross(edge, left), m = vec3_cross(right, edge);
    if (vec3_dot(n, m) <= 0)
        return true;
    const double least = height * height;
    const double of_right = vec3_dot(n, right), of_left = vec3_dot(m, left);
    return of_right * of_right > least * vec3_length_squared(n) ||
           of_left * of_left > least * vec3_length_squared(m);
}

static double surface_error(const struct collapse *c, double largest)
{
    for (uint32_t v = 0; v < c->vertex_slots; v++)
        if (c->vertices[v].corner != NO_INDEX &&
            fabs((double)offset_get(c, v)) > NOTED_LEAST * largest)
            largest = larger_distance(c, c->vertices[v].position, largest);
    for (uint32_t i = 0; i < 3 * (uint32_t)c->face_slots; i++) {
        const uint32_t to = c->corners[i].end;
        if (to == NO_INDEX || (corner_opposite(c, i) < i && corner_opposite(c, i) != NO_INDEX) ||
            !is_bent(c, i, largest))
            continue;
        const float *a = c->vertices[to].position, *b = c->vertices[corner_vertex(c, i)].position;
        const float middle[3] = {(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2};
        largest = larger_distance(c, middle, largest);
    }
    return largest;
}

/* The distance of `p` from all faces, `least` if that is not more: the way from vertex to vertex
 * may have ended on one side of a thin wall, or on another component. */
static double distance_from_all(const struct collapse *c, struct vec3 p, double least)
{
    double square = INFINITY;
    for (uint32_t f = 0; f < c->face_slots && square > least * least; f++) {
        const struct collapse_corner *corner = c->corners + 3 * (size_t)f;
        if (corner[0].end == NO_INDEX)
            continue;
        const struct triangle triangle = {vec3_load_float(c->vertices[corner[0].end].position),
                                          vec3_load_float(c->vertices[corner[1].end].position),
                                          vec3_load_float(c->vertices[corner[2].end].position)};
        square = fmin(square, triangle_distance_squared(p, &triangle, NULL));
    }
    return fmax(least, sqrt(square));
}

/* `searches`: how many points may still be looked for among all faces. */
static double point_error(const struct collapse *c, uint32_t v, struct vec3 p, double largest,
                          uint32_t *searches)
{
    const float place[3] = {(float)p.x, (float)p.y, (float)p.z};
    const float square = vertex_square(c, v, place, (float)(largest * largest));
    if (!(square < INFINITY) || (double)square <= largest * largest)
        return largest;
    if (*searches == 0)
        return sqrt((double)square);
    --*searches;
    return fmin(sqrt((double)square), distance_from_all(c, p, largest));
}

double reference_error(const struct collapse *c)
{
    const struct reference *r = &c->reference;
    double largest = surface_error(c, c->typical_error);
    uint32_t searches = SEARCHES_MAX;
    for (uint32_t v = 0; v < c->vertex_slots; v++) {
        if (c->vertices[v].corner == NO_INDEX)
            continue;
        const struct vec3 at = vec3_load_float(c->vertices[v].position);
        float offset[3];
        witness_get(c, v, offset);
        largest = point_error(c, v, vec3_add(at, vec3_load_float(offset)), largest, &searches);
        uint32_t u = v, count = 0;
        do {
            largest =
                point_error(c, v, vec3_load(r->positions + 3 * (size_t)u), largest, &searches);
            u = r->next[u];
        } while (u != v && ++count < POINTS_MAX);
    }
    return largest;
}
