/*
 * Lengths, areas, noise.
 *
 * Everything is summed slab by slab in face order, in doubles and with no operation that a compiler
 * may reorder, so that the sums are the same for any number of threads and on any machine.
 */
#include "mesh/slab_geometry.h"

#include <math.h>

#include "geom/vec.h"
#include "mesh/survey.h"

/* ---- frame ---- */

static void widen(struct frame *frame, const double p[3])
{
    for (int i = 0; i < 3; i++) {
        frame->low[i] = p[i] < frame->low[i] ? p[i] : frame->low[i];
        frame->high[i] = p[i] > frame->high[i] ? p[i] : frame->high[i];
    }
}

/* Where vertices never were gathered: those that are used. */
static void look_at_all(const struct draft *draft, struct frame *frame)
{
    const uint64_t count = draft->id_count ? draft->id_count : draft->vertex_count;
    for (uint64_t v = 0; v < count; v++) {
        double p[3];
        draft_position(draft, v, p);
        if (!draft->id_count || is_shared(draft, (uint32_t)v))
            widen(frame, p);
        if (v % FORGET_EVERY == 0)
            spool_pass(&draft->position_spool, v * draft_position_size(draft));
    }
    spool_forget_all(&draft->position_spool);
}

enum status frame_find(const struct draft *draft, struct frame *frame)
{
    for (int i = 0; i < 3; i++) {
        frame->low[i] = draft->has_box ? draft->box_low[i] : INFINITY;
        frame->high[i] = draft->has_box ? draft->box_high[i] : -INFINITY;
        frame->origin[i] = 0;
    }
    if (!draft->has_box)
        look_at_all(draft, frame);
    double extent = 0;
    for (int i = 0; i < 3; i++) {
        frame->low[i] += 0.0; /* -0 or 0 would be whichever came first */
        frame->high[i] += 0.0;
        double side = frame->high[i] - frame->low[i];
        if (!(side >= 0 && side < INFINITY))
            return fail(draft->ctx, STATUS_BAD_INPUT, "coordinates are not finite or too large");
        extent = side > extent ? side : extent;
    }
    if (draft->is_float32)
        return STATUS_OK;
    /* Half the extent is the largest stored value: its float32 is off by 2^-25 of it at most, as
     * long as that is no subnormal number. */
    if (extent > 1e38 || (extent > 0 && extent < 1e-30))
        return fail(draft->ctx, STATUS_BAD_INPUT,
                    "the model is %g across; a store holds models from 1e-30 to 1e38", extent);
    for (int i = 0; i < 3; i++)
        frame->origin[i] = frame->low[i] / 2 + frame->high[i] / 2;
    return STATUS_OK;
}

/* ---- measures ---- */

static inline struct vec3 position_of(const struct slab_scope *scope, const float *own,
                                      const float *foreign, uint32_t vertex)
{
    uint32_t local = vertex - scope->vertex_first;
    if (local < scope->own_count)
        return vec3_load_float(own + 3 * (size_t)local);
    uint32_t rank = foreign_rank(scope->foreign, scope->foreign_count, vertex);
    return vec3_load_float(foreign + 3 * (size_t)rank);
}

/* Adds the square of how far vertex v, at corner 0 of face f, lies off its neighbours. */
static void add_noise(const struct draft *draft, const struct slab_scope *scope, const float *own,
                      const float *foreign, uint32_t f, struct slab_measures *measures)
{
    const uint32_t v = draft->faces[3 * (size_t)f];
    const struct vec3 p = position_of(scope, own, foreign, v);
    struct vec3 sum = {0, 0, 0}, normal = {0, 0, 0};
    uint32_t at = f, count = 0;
    unsigned corner = 0, leave = 0;
    do {
        const uint32_t *face = draft->faces + 3 * (size_t)at;
        struct vec3 a = vec3_sub(position_of(scope, own, foreign, face[next3(corner)]), p);
        struct vec3 b = vec3_sub(position_of(scope, own, foreign, face[previous3(corner)]), p);
        normal = vec3_add(normal, vec3_cross(a, b));
        sum = vec3_add(sum, a); /* each neighbour begins one face of a closed fan */
        count++;
        if (!fan_step(draft, scope->face_first, scope->face_count, v, &at, &corner, &leave))
            return;
    } while (at != f && count <= NOISE_FAN_MAX);
    if (at != f)
        return;
    double square = vec3_dot(normal, normal);
    if (!(square > 0))
        return;
    double distance = vec3_dot(normal, sum) / count;
    measures->noise_squares += distance * distance / square;
    measures->noise_count++;
}

/* Squares of some faces, whose roots are taken together: a root at a time waits for the one before,
 * and what is put together for a vector just then waits for its stores. */
enum { ROOTS = 64 };

struct squares {
    double areas[ROOTS]; /* of the cross products, a face */
    double edges[3 * ROOTS + 3];
    uint32_t face_count;
    uint32_t edge_count;
};

static void take_roots(double *values, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++)
        values[i] = sqrt(values[i]);
}

static void sum_roots(struct squares *squares, struct slab_measures *measures)
{
    take_roots(squares->areas, squares->face_count);
    take_roots(squares->edges, squares->edge_count);
    /* Side by side as far as both go: each addition waits for the one before it in its own sum. */
    double area = measures->area, length = measures->edge_length;
    const uint32_t faces = squares->face_count, edges = squares->edge_count;
    uint32_t i = 0;
    for (; i < faces && i < edges; i++) {
        area += squares->areas[i] / 2;
        length += squares->edges[i];
    }
    for (uint32_t j = i; j < faces; j++)
        area += squares->areas[j] / 2;
    for (; i < edges; i++)
        length += squares->edges[i];
    measures->area = area;
    measures->edge_length = length;
    measures->edge_count += squares->edge_count;
    squares->face_count = squares->edge_count = 0;
}

void measure_slab(const struct draft *draft, const struct slab_scope *scope, const float *own,
                  const float *foreign, struct slab_measures *measures)
{
    const uint32_t first = scope->face_first;
    const uint32_t spacing = scope->face_count / NOISE_SAMPLES + 1;
    uint32_t sample =
        0; /* the next face for the noise, looked at while its neighbours are at hand */
    struct squares squares = {.face_count = 0};
    *measures = (struct slab_measures){0};
    for (uint32_t i = 0; i < scope->face_count; i++) {
        const size_t f = (size_t)first + i;
        const uint32_t *face = draft->faces + 3 * f;
        const uint32_t *over = draft->neighbours + 3 * f;
        struct vec3 p[3], along[3];
        for (int k = 0; k < 3; k++)
            p[k] = position_of(scope, own, foreign, face[k]);
        for (unsigned k = 0; k < 3; k++)
            along[k] = vec3_sub(p[next3(k)], p[k]);
        struct vec3 cross = vec3_cross(along[0], along[1]);
        const double square = vec3_dot(cross, cross);
        squares.areas[squares.face_count++] = square;
        if (square == 0) /* as that of a tiny one may be, too */
            measures->zero_area_faces += cross.x == 0 && cross.y == 0 && cross.z == 0;
        /* Half of the edges are the neighbours', and the next one takes their place. */
        for (unsigned k = 0; k < 3; k++) {
            squares.edges[squares.edge_count] = vec3_dot(along[k], along[k]);
            squares.edge_count += over[k] >= f;
        }
        if (squares.face_count == ROOTS)
            sum_roots(&squares, measures);
        if (i == sample) {
            add_noise(draft, scope, own, foreign, first + i, measures);
            sample += spacing;
        }
    }
    sum_roots(&squares, measures);
}

void measures_add(struct slab_measures *sum, const struct slab_measures *slab)
{
    sum->area += slab->area;
    sum->edge_length += slab->edge_length;
    sum->edge_count += slab->edge_count;
    sum->noise_squares += slab->noise_squares;
    sum->noise_count += slab->noise_count;
    sum->zero_area_faces += slab->zero_area_faces;
}

double measures_mean_edge(const struct slab_measures *sum)
{
    return sum->edge_count ? sum->edge_length / (double)sum->edge_count : 0;
}

double measures_noise(const struct slab_measures *sum)
{
    double mean = measures_mean_edge(sum);
    if (sum->noise_count == 0 || !(mean > 0))
        return 0;
    return sqrt(sum->noise_squares / (double)sum->noise_count) / mean;
}
