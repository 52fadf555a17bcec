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
 * At the end all is measured once more (collapse_measure.c).
 */
#include <math.h>
#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "base/radix_sort.h"
#include "collapse_internal.h"
#include "geom/distance.h"
#include "geom/space_curve.h"

/* Faces turn by so little that it does not matter when the new vertex is not this part of the bound
 * from their planes. */
static const float TURNED_LEAST = 0.25f;
/* What is less than a number by more than rounding is not as much. */
static const float BELOW = 0x1.fffffep-1f;

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

enum status reference_copy(const struct collapse *from, struct collapse *to)
{
    const struct reference *f = &from->reference;
    struct reference *r = &to->reference;
    const size_t vertices = (size_t)f->vertex_count, faces = (size_t)f->face_count;
    r->vertex_count = f->vertex_count;
    r->face_count = f->face_count;
    enum status status = memory_take(to->ctx, vertices, 3 * sizeof *r->positions, &r->positions);
    if (status == STATUS_OK)
        status = memory_take(to->ctx, faces, 3 * sizeof *r->faces, &r->faces);
    if (status == STATUS_OK)
        status = memory_take(to->ctx, vertices, sizeof *r->next, &r->next);
    if (status != STATUS_OK)
        return status;
    memcpy(r->positions, f->positions, vertices * 3 * sizeof *r->positions);
    memcpy(r->faces, f->faces, faces * 3 * sizeof *r->faces);
    memcpy(r->next, f->next, vertices * sizeof *r->next);
    return bvh_copy(to->ctx, &f->tree, r->positions, r->faces, &r->tree);
}

uint64_t reference_most_faces(const struct collapse *c)
{
    /* a face of the reference takes 74 bytes while the tree is built, one of the mesh 58 */
    return c->reference_room * 2 / 5;
}

/* Gives back what the arrays have no use for any more. */
static enum status shrink(struct collapse *c)
{
    enum status status = memory_resize(c->ctx, &c->corners, (size_t)c->face_room,
                                       (size_t)c->face_slots, 3 * sizeof *c->corners);
    if (status != STATUS_OK)
        return status;
    c->face_room = c->reference_room = c->face_slots;
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

/* Faces by the cells of a cube round all, with CELL_BITS an axis, that their middles lie in. */
enum { CELL_BITS = 10, KEY = 8, KEY_STRETCH = 1 << 12 };

struct sorting {
    const struct collapse *collapse;
    struct space_curve curve;
    double low[3], cells; /* a length */
    unsigned char *keys;  /* KEY bytes each: a face's place on the curve, then its number */
};

static void choose_cells(struct sorting *sorting, const struct collapse *c)
{
    double extent = 0;
    for (int k = 0; k < 3; k++) {
        float low = INFINITY, high = -INFINITY;
        for (uint32_t v = 0; v < c->vertex_slots; v++) {
            const float at = c->vertices[v].position[k];
            low = at < low ? at : low;
            high = at > high ? at : high;
        }
        sorting->low[k] = 3 * (double)low;
        extent = fmax(extent, 3 * (double)high - sorting->low[k]);
    }
    sorting->cells = extent > 0 ? ((1 << CELL_BITS) - 1) / extent : 0;
}

/* (A middle's three times.) */
static uint64_t find_octants(const struct sorting *sorting, uint32_t face)
{
    const struct collapse *c = sorting->collapse;
    const struct collapse_corner *corner = c->corners + 3 * (size_t)face;
    uint32_t cell[3];
    for (int k = 0; k < 3; k++) {
        const double sum = (double)c->vertices[corner[0].end].position[k] +
                           (double)c->vertices[corner[1].end].position[k] +
                           (double)c->vertices[corner[2].end].position[k];
        cell[k] = (uint32_t)((sum - sorting->low[k]) * sorting->cells);
    }
    return space_curve_octants(cell[0], cell[1], cell[2]);
}

static enum status find_keys(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    enum { SIDE = SPACE_CURVE_SIDE_BY_SIDE };
    struct sorting *sorting = user;
    const uint64_t left = sorting->collapse->face_slots - job * KEY_STRETCH;
    const uint32_t first = (uint32_t)(job * KEY_STRETCH);
    const uint32_t end = first + (uint32_t)(left < KEY_STRETCH ? left : KEY_STRETCH);
    for (uint32_t f = first; f < end; f += SIDE) {
        uint64_t octants[SIDE] = {0}, places[SIDE];
        for (uint32_t i = 0; i < SIDE && f + i < end; i++)
            octants[i] = find_octants(sorting, f + i);
        space_curve_numbers(&sorting->curve, octants, SIDE, CELL_BITS, places);
        for (uint32_t i = 0; i < SIDE && f + i < end; i++)
            store_u64(sorting->keys + KEY * (size_t)(f + i), places[i] << 32 | (f + i));
    }
    return STATUS_OK;
}

/* Copies the faces, in the order of the tree. */
static enum status take_sorted_faces(struct collapse *c)
{
    struct reference *r = &c->reference;
    struct sorting sorting = {.collapse = c};
    const size_t count = (size_t)r->face_count;
    unsigned char *sorted = NULL;
    enum status status = memory_take(c->ctx, 2 * count, KEY, &sorting.keys);
    if (status != STATUS_OK)
        return status;
    space_curve_init(&sorting.curve);
    choose_cells(&sorting, c);
    status = parallel_for(c->ctx, (count + KEY_STRETCH - 1) / KEY_STRETCH, find_keys, &sorting);
    if (status == STATUS_OK)
        status = radix_sort_above(c->ctx, sorting.keys, sorting.keys + KEY * count, count, KEY, 1,
                                  32, &sorted);
    for (size_t i = 0; i < count && status == STATUS_OK; i++) {
        const uint32_t first = 3 * (uint32_t)load_u64(sorted + KEY * i);
        for (uint32_t k = 0; k < 3; k++)
            r->faces[3 * i + k] = corner_vertex(c, first + k);
    }
    memory_release(c->ctx, &sorting.keys, 2 * count, KEY);
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
        status = take_sorted_faces(c);
    }
    if (status == STATUS_OK)
        status = bvh_build_sorted(c->ctx, r->positions, r->faces, (uint32_t)r->face_count, true,
                                  &r->tree);
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

static bool is_near(const struct collapse *c, const float at[3], double bound, uint32_t *leaf)
{
    return bvh_is_near(&c->reference.tree, widened(at), bound * bound, leaf);
}

/* The new vertex, and the middles of its edges: but for those beside which the faces hardly turn,
 * as these are about as far from the reference as before. */
static bool new_edges_are_near(const struct collapse *c, const struct edge_change *change,
                               double bound, uint32_t *leaf)
{
    const float turned = (float)(bound * bound) * TURNED_LEAST * TURNED_LEAST;
    float to[3];
    for (int k = 0; k < 3; k++)
        to[k] = c->vertices[change->v].position[k] + change->to[0][k];
    if (!is_near(c, to, bound, leaf))
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
            if (!is_near(c, middle, bound, leaf))
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
        if (square > most &&
            !(stays && edge_square_before(c, change, end, p, square * BELOW) >= square))
            return false;
        u = r->next[u];
    } while (u != owner && ++count < REFERENCE_POINTS_MAX);
    return true;
}

bool reference_allows(const struct collapse *c, const struct edge_change *change, double bound,
                      uint32_t *leaf)
{
    if (!new_edges_are_near(c, change, bound, leaf))
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
