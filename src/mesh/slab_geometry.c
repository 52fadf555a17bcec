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

enum status frame_find(const struct draft *draft, struct frame *frame)
{
    for (int i = 0; i < 3; i++) {
        frame->low[i] = INFINITY;
        frame->high[i] = -INFINITY;
        frame->origin[i] = 0;
    }
    for (uint64_t v = 0; v < draft->vertex_count; v++) {
        double p[3];
        draft_position(draft, v, p);
        widen(frame, p);
        if (v % FORGET_EVERY == 0)
            spool_forget_all(&draft->position_spool);
    }
    spool_forget_all(&draft->position_spool);
    double extent = 0;
    for (int i = 0; i < 3; i++) {
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

void measure_slab(const struct draft *draft, const struct slab_scope *scope, const float *own,
                  const float *foreign, struct slab_measures *measures)
{
    double area = 0, edge_length = 0;
    uint64_t edge_count = 0, zero_area = 0;
    const uint32_t first = scope->face_first;
    const uint32_t spacing = scope->face_count / NOISE_SAMPLES + 1;
    for (uint32_t i = 0; i < scope->face_count; i++) {
        const size_t f = (size_t)first + i;
        const uint32_t *face = draft->faces + 3 * f;
        struct vec3 p[3], along[3];
        for (int k = 0; k < 3; k++)
            p[k] = position_of(scope, own, foreign, face[k]);
        for (unsigned k = 0; k < 3; k++)
            along[k] = vec3_sub(p[next3(k)], p[k]);
        struct vec3 cross = vec3_cross(along[0], along[1]);
        double roots[4] = {vec3_dot(along[0], along[0]), vec3_dot(along[1], along[1]),
                           vec3_dot(along[2], along[2]), vec3_dot(cross, cross)};
        for (int k = 0; k < 4; k++) /* in vectors */
            roots[k] = sqrt(roots[k]);
        area += roots[3] / 2;
        zero_area += (cross.x == 0) & (cross.y == 0) & (cross.z == 0);
        /* Half of the edges are the neighbours': to add 0 is cheaper than to guess which. */
        for (unsigned k = 0; k < 3; k++) {
            bool is_ours = draft->neighbours[3 * f + k] >= f;
            edge_length += is_ours ? roots[k] : 0;
            edge_count += is_ours;
        }
    }
    *measures = (struct slab_measures){.area = area,
                                       .edge_length = edge_length,
                                       .edge_count = edge_count,
                                       .zero_area_faces = zero_area};
    for (uint32_t i = 0; i < scope->face_count; i += spacing)
        add_noise(draft, scope, own, foreign, first + i, measures);
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
