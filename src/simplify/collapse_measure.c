/*
 * The largest distance between the surface and the reference, which is the error that is reported.
 *
 * Looking up every point in a tree of boxes would take as long as the collapses. Nearly all points
 * are nearer than the largest distance, though, and the sooner that is known the less there is to
 * look for: so a few suspects are measured before all else, then pieces of the mesh, side by side,
 * each beginning with the suspects' largest. A vertex whose noted offset is small, and an edge in a
 * plane, are not looked at; a point of the reference belongs to a vertex, and mostly the faces
 * there are near enough. (Long edges of the reference are looked at in between, too: what lies
 * between the ends of needles no vertex tells.) Only where they are not, nor those that are found
 * by going from vertex to vertex (the way may end on one side of a thin wall, or on another
 * component), all faces are looked through, by the boxes of runs of them. A tree like the
 * reference's would not have the room.
 */
#include <math.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "collapse_internal.h"
#include "geom/distance.h"

/* A vertex whose noted offset is below this part of the largest error is not measured. */
static const double NOTED_LEAST = 0.3;

enum {
    PIECES = 32,
    EDGE_PARTS_MAX = 8, /* of long edges, a power of two */
    RUN = 32,           /* faces of a box, and boxes of a larger one */
    MEAN_FACES = 1024   /* that the mean distance is of */
};

/* ---- all faces ---- */

struct box {
    float low[3], high[3];
};

/* Boxes of RUN faces each, in the order of their numbers, and of RUN of these. */
struct boxes {
    struct box *of_faces, *of_boxes;
    size_t face_runs, box_runs;
};

static const struct box EMPTY_BOX = {{INFINITY, INFINITY, INFINITY},
                                     {-INFINITY, -INFINITY, -INFINITY}};

static void widen(struct box *box, const float low[3], const float high[3])
{
    for (int k = 0; k < 3; k++) {
        box->low[k] = low[k] < box->low[k] ? low[k] : box->low[k];
        box->high[k] = high[k] > box->high[k] ? high[k] : box->high[k];
    }
}

static void boxes_release(struct context *ctx, struct boxes *boxes)
{
    memory_release(ctx, &boxes->of_boxes, boxes->box_runs, sizeof *boxes->of_boxes);
    memory_release(ctx, &boxes->of_faces, boxes->face_runs, sizeof *boxes->of_faces);
}

static enum status boxes_take(const struct collapse *c, struct boxes *boxes)
{
    boxes->face_runs = (size_t)(c->face_slots + RUN - 1) / RUN;
    boxes->box_runs = (boxes->face_runs + RUN - 1) / RUN;
    enum status status =
        memory_take(c->ctx, boxes->face_runs, sizeof *boxes->of_faces, &boxes->of_faces);
    if (status == STATUS_OK)
        status = memory_take(c->ctx, boxes->box_runs, sizeof *boxes->of_boxes, &boxes->of_boxes);
    return status;
}

/* Fills in the larger boxes from `first` to `end`, and theirs. */
static void boxes_fill(const struct collapse *c, struct boxes *boxes, size_t first, size_t end)
{
    const size_t slots = (size_t)c->face_slots;
    for (size_t i = first; i < end; i++) {
        struct box *whole = &boxes->of_boxes[i];
        *whole = EMPTY_BOX;
        for (size_t run = i * RUN; run < (i + 1) * RUN && run < boxes->face_runs; run++) {
            struct box *box = &boxes->of_faces[run];
            const size_t last = (run + 1) * RUN < slots ? (run + 1) * RUN : slots;
            *box = EMPTY_BOX;
            for (size_t k = 3 * RUN * run; k < 3 * last; k++)
                if (c->corners[k].end != NO_INDEX) {
                    const float *at = c->vertices[c->corners[k].end].position;
                    widen(box, at, at);
                }
            widen(whole, box->low, box->high);
        }
    }
}

static double box_square(const struct box *box, const double p[3])
{
    double sum = 0;
    for (int k = 0; k < 3; k++) {
        const double left = (double)box->low[k] - p[k], right = p[k] - (double)box->high[k];
        const double apart = left > right ? left : right;
        sum += apart > 0 ? apart * apart : 0;
    }
    return sum;
}

/* The least of `square` and the squared distances of p from the faces of one run. */
static double search_run(const struct collapse *c, size_t run, struct vec3 p, double square)
{
    const size_t end = (run + 1) * RUN < (size_t)c->face_slots ? (run + 1) * RUN : c->face_slots;
    for (size_t f = run * RUN; f < end; f++) {
        const struct collapse_corner *corner = c->corners + 3 * f;
        if (corner[0].end == NO_INDEX)
            continue;
        const struct triangle triangle = {vec3_load_float(c->vertices[corner[0].end].position),
                                          vec3_load_float(c->vertices[corner[1].end].position),
                                          vec3_load_float(c->vertices[corner[2].end].position)};
        const double here = triangle_distance_squared(p, &triangle, NULL);
        square = here < square ? here : square;
    }
    return square;
}

/* The box nearest to p of those from `first` to `end`. */
static size_t nearest_box(const struct box *boxes, size_t first, size_t end, const double p[3])
{
    size_t nearest = first;
    double least = INFINITY;
    for (size_t i = first; i < end; i++) {
        const double square = box_square(&boxes[i], p);
        nearest = square < least ? i : nearest;
        least = square < least ? square : least;
    }
    return nearest;
}

/* The least of `square` and the squared distances of p from all faces; below `enough` it need not
 * be exact. Where nothing is known the nearest box comes first, which leaves few others. */
static double search_all(const struct collapse *c, const struct boxes *boxes, struct vec3 p,
                         double square, double enough)
{
    const double at[3] = {p.x, p.y, p.z};
    if (!(square < INFINITY)) {
        const size_t first = RUN * nearest_box(boxes->of_boxes, 0, boxes->box_runs, at);
        const size_t end = first + RUN < boxes->face_runs ? first + RUN : boxes->face_runs;
        square = search_run(c, nearest_box(boxes->of_faces, first, end, at), p, square);
    }
    for (size_t i = 0; i < boxes->box_runs; i++) {
        if (!(box_square(&boxes->of_boxes[i], at) < square))
            continue;
        const size_t end = (i + 1) * RUN < boxes->face_runs ? (i + 1) * RUN : boxes->face_runs;
        for (size_t run = i * RUN; run < end; run++)
            if (box_square(&boxes->of_faces[run], at) < square) {
                square = search_run(c, run, p, square);
                if (square <= enough)
                    return square;
            }
    }
    return square;
}

/* A piece of the mesh, which one job measures. */
struct piece {
    uint32_t first_vertex, end_vertex;
    uint32_t first_face, end_face;
    uint32_t leaf; /* of the reference's tree, bvh_is_near() */
    double largest;
    double edges;     /* of the reference's faces, summed lengths */
    uint32_t suspect; /* the vertex that has most to tell, by what is noted of it; or NO_INDEX */
};

struct measuring {
    const struct collapse *collapse;
    double mean_edge; /* of the reference */
    struct boxes boxes;
    struct piece pieces[PIECES];
};

/* ---- points on edges ---- */

/* Into how many parts an edge is cut, to be looked at between them. */
static unsigned count_parts(const struct measuring *measuring, struct vec3 a, struct vec3 b)
{
    const double length = vec3_length(vec3_sub(b, a));
    unsigned parts = 2;
    while (parts < EDGE_PARTS_MAX && length > parts * measuring->mean_edge)
        parts *= 2;
    return parts;
}

static struct vec3 edge_point(struct vec3 a, struct vec3 b, unsigned i, unsigned parts)
{
    const double t = (double)i / parts;
    return vec3_add(vec3_scale(a, 1 - t), vec3_scale(b, t));
}

/* The lengths of the edges of the job's part of the reference's faces. */
static double sum_edges(const struct reference *r, uint64_t job)
{
    const uint64_t end = r->face_count * (job + 1) / PIECES;
    double sum = 0;
    for (uint64_t i = 3 * (r->face_count * job / PIECES); i < 3 * end; i++) {
        const uint32_t *to = r->faces + (i % 3 == 2 ? i - 2 : i + 1);
        sum += vec3_length(vec3_sub(vec3_load(r->positions + 3 * (size_t)*to),
                                    vec3_load(r->positions + 3 * (size_t)r->faces[i])));
    }
    return sum;
}

/* ---- from the surface to the reference ---- */

/* Makes the piece's largest distance the point's from the reference, if that is more. */
static void measure_from(const struct collapse *c, struct vec3 p, struct piece *piece)
{
    struct nearest nearest = {INFINITY, UINT32_MAX, {0, 0, 0}};
    if (bvh_is_near(&c->reference.tree, p, piece->largest * piece->largest, &piece->leaf))
        return;
    bvh_nearest(&c->reference.tree, p, &nearest);
    piece->largest = sqrt(nearest.distance_squared);
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

static void measure_surface(const struct measuring *measuring, struct piece *piece)
{
    const struct collapse *c = measuring->collapse;
    for (uint32_t v = piece->first_vertex; v < piece->end_vertex; v++)
        if (c->vertices[v].corner != NO_INDEX &&
            fabs((double)offset_get(c, v)) > NOTED_LEAST * piece->largest)
            measure_from(c, vec3_load_float(c->vertices[v].position), piece);
    for (uint32_t i = 3 * piece->first_face; i < 3 * piece->end_face; i++) {
        const uint32_t to = c->corners[i].end;
        if (to == NO_INDEX || (corner_opposite(c, i) < i && corner_opposite(c, i) != NO_INDEX) ||
            !is_bent(c, i, piece->largest))
            continue;
        const struct vec3 a = vec3_load_float(c->vertices[corner_vertex(c, i)].position);
        const struct vec3 b = vec3_load_float(c->vertices[to].position);
        const unsigned parts = count_parts(measuring, a, b);
        for (unsigned k = 1; k < parts; k++)
            measure_from(c, edge_point(a, b, k, parts), piece);
    }
}

/* ---- from the reference to the surface ---- */

/* Makes the piece's largest distance that of p, a point of the original at v, if that is more. */
static void measure_point(const struct measuring *measuring, uint32_t v,
                          const struct vertex_look *look, struct vec3 p, struct piece *piece)
{
    const struct collapse *c = measuring->collapse;
    const float place[3] = {(float)p.x, (float)p.y, (float)p.z};
    const double enough = piece->largest * piece->largest;
    const float most = (float)enough, less = (double)most > enough ? nextafterf(most, 0) : most;
    double square = (double)vertex_square(c, v, look, place, less);
    if (!(square < INFINITY) || square <= enough)
        return;
    square = search_all(c, &measuring->boxes, p, square, enough);
    piece->largest = fmax(piece->largest, sqrt(square));
}

static struct vec3 witness_place(const struct collapse *c, uint32_t v)
{
    float offset[3];
    witness_get(c, v, offset);
    return vec3_add(vec3_load_float(c->vertices[v].position), vec3_load_float(offset));
}

static void measure_points(const struct measuring *measuring, struct piece *piece)
{
    const struct collapse *c = measuring->collapse;
    const struct reference *r = &c->reference;
    struct vertex_look look;
    for (uint32_t v = piece->first_vertex; v < piece->end_vertex; v++) {
        if (c->vertices[v].corner == NO_INDEX)
            continue;
        vertex_look_freely(c, v, &look);
        measure_point(measuring, v, &look, witness_place(c, v), piece);
        uint32_t u = v, count = 0;
        do {
            measure_point(measuring, v, &look, vec3_load(r->positions + 3 * (size_t)u), piece);
            u = r->next[u];
        } while (u != v && ++count < REFERENCE_POINTS_MAX);
    }
}

/* The reference's longest edges, the job's part of them. */
static void measure_long_edges(const struct measuring *measuring, uint64_t job, struct piece *piece)
{
    const struct collapse *c = measuring->collapse;
    const struct reference *r = &c->reference;
    const uint64_t end = r->face_count * (job + 1) / PIECES;
    for (uint64_t i = 3 * (r->face_count * job / PIECES); i < 3 * end; i++) {
        const size_t next = (size_t)(i % 3 == 2 ? i - 2 : i + 1);
        if (r->faces[i] > r->faces[next]) /* from the other side (at borders: not at all) */
            continue;
        const struct vec3 a = vec3_load(r->positions + 3 * (size_t)r->faces[i]);
        const struct vec3 b = vec3_load(r->positions + 3 * (size_t)r->faces[next]);
        const unsigned parts = count_parts(measuring, a, b);
        for (unsigned k = 1; k < parts && parts == EDGE_PARTS_MAX; k++) {
            const struct vec3 p = edge_point(a, b, k, parts);
            const double enough = piece->largest * piece->largest;
            /* first only the boxes that are near enough, up to the first face that is */
            double square = search_all(c, &measuring->boxes, p, enough * 1.000001, enough);
            if (square <= enough)
                continue;
            square = search_all(c, &measuring->boxes, p, INFINITY, enough);
            piece->largest = fmax(piece->largest, sqrt(square));
        }
    }
}

static enum status measure_piece(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct measuring *measuring = user;
    measure_surface(measuring, &measuring->pieces[job]);
    measure_points(measuring, &measuring->pieces[job]);
    measure_long_edges(measuring, job, &measuring->pieces[job]);
    return STATUS_OK;
}

static uint32_t find_suspect(const struct collapse *c, const struct piece *piece)
{
    uint32_t suspect = NO_INDEX;
    double most = -1;
    for (uint32_t v = piece->first_vertex; v < piece->end_vertex; v++) {
        const double noted = fabs((double)offset_get(c, v));
        if (c->vertices[v].corner == NO_INDEX || noted <= most)
            continue;
        most = noted;
        suspect = v;
    }
    return suspect;
}

static enum status prepare_piece(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct measuring *measuring = user;
    const struct collapse *c = measuring->collapse;
    struct piece *piece = &measuring->pieces[job];
    const size_t boxes = measuring->boxes.box_runs;
    piece->first_vertex = (uint32_t)(c->vertex_slots * job / PIECES);
    piece->end_vertex = (uint32_t)(c->vertex_slots * (job + 1) / PIECES);
    piece->first_face = (uint32_t)(c->face_slots * job / PIECES);
    piece->end_face = (uint32_t)(c->face_slots * (job + 1) / PIECES);
    piece->suspect = find_suspect(c, piece);
    piece->edges = sum_edges(&c->reference, job);
    boxes_fill(c, &measuring->boxes, boxes * job / PIECES, boxes * (job + 1) / PIECES);
    return STATUS_OK;
}

/* ---- both ---- */

/* What all pieces begin with: the largest distance of the suspects. */
static void measure_suspects(struct measuring *measuring)
{
    const struct collapse *c = measuring->collapse;
    struct piece suspects = {.leaf = UINT32_MAX, .largest = c->typical_error};
    double edges = 0;
    for (uint32_t i = 0; i < PIECES; i++) {
        const uint32_t suspect = measuring->pieces[i].suspect;
        edges += measuring->pieces[i].edges;
        if (suspect != NO_INDEX)
            measure_from(c, vec3_load_float(c->vertices[suspect].position), &suspects);
    }
    measuring->mean_edge = edges / (3 * (double)c->reference.face_count);
    for (uint32_t i = 0; i < PIECES; i++) {
        measuring->pieces[i].leaf = UINT32_MAX;
        measuring->pieces[i].largest = suspects.largest;
    }
}

enum status reference_error(const struct collapse *c, double *error)
{
    struct measuring measuring = {.collapse = c};
    double largest = 0;
    enum status status = boxes_take(c, &measuring.boxes);
    if (status == STATUS_OK)
        status = parallel_for(c->ctx, PIECES, prepare_piece, &measuring);
    if (status == STATUS_OK) {
        measure_suspects(&measuring);
        status = parallel_for(c->ctx, PIECES, measure_piece, &measuring);
    }
    for (uint32_t i = 0; i < PIECES; i++)
        largest = fmax(largest, measuring.pieces[i].largest);
    boxes_release(c->ctx, &measuring.boxes);
    *error = largest;
    return status;
}

double reference_mean_error(const struct collapse *c)
{
    const uint64_t step = c->face_slots / MEAN_FACES + 1;
    double sum = 0, areas = 0;
    for (uint64_t i = 0; i < c->face_slots; i += step) {
        const struct collapse_corner *corners = c->corners + 3 * i;
        if (corners[0].end == NO_INDEX)
            continue;
        struct vec3 at[3];
        for (int k = 0; k < 3; k++)
            at[k] = vec3_load_float(c->vertices[corners[k].end].position);
        const double area = vec3_length(vec3_cross(vec3_sub(at[1], at[0]), vec3_sub(at[2], at[0])));
        struct nearest nearest = {INFINITY, UINT32_MAX, {0, 0, 0}};
        const struct vec3 middle = vec3_scale(vec3_add(vec3_add(at[0], at[1]), at[2]), 1. / 3);
        bvh_nearest(&c->reference.tree, middle, &nearest);
        sum += area * sqrt(nearest.distance_squared);
        areas += area;
    }
    return areas > 0 ? sum / areas : 0;
}
