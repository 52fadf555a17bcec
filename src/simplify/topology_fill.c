/*
 * Filling the loops that are left open.
 *
 * A fill leaves a manifold as long as no diagonal repeats an edge and no triangle a face. For that,
 * the edges of what stays between vertices on loops are gathered in a second sweep. Where every
 * triangulation would repeat one (a triangle by itself has but one, and that is the triangle seen
 * from behind), the loop is filled round a new vertex in its middle, which no edge can have had.
 */
#include "simplify/topology_surgery.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "geom/triangulate.h"

/* ---- second sweep: what stays near the loops ---- */

static size_t rim_place(const struct surgery *surgery, uint32_t vertex)
{
    return find_number(surgery->rim_vertices, sizeof *surgery->rim_vertices, surgery->rim_count,
                       vertex);
}

const float *surgery_position(const struct surgery *surgery, uint32_t vertex)
{
    return surgery->rim_positions + 3 * rim_place(surgery, vertex);
}

/* Marks the vertices on loops and lists them in order: a bit map sorts them. */
static enum status list_rim_vertices(struct surgery *surgery)
{
    struct context *ctx = surgery->ctx;
    size_t words = bit_words(store_info(surgery->store)->topology.vertices);
    memset(surgery->used, 0, words * sizeof *surgery->used);
    for (size_t i = 0; i < surgery->corner_count; i++)
        bit_set(surgery->used, surgery->corners[i]);
    enum status status = memory_reserve(ctx, &surgery->rim_vertices, &surgery->rim_capacity,
                                        surgery->corner_count, sizeof *surgery->rim_vertices);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &surgery->rim_positions, &surgery->rim_position_capacity,
                                3 * surgery->corner_count, sizeof *surgery->rim_positions);
    if (status != STATUS_OK)
        return status;
    surgery->rim_count = bits_list(surgery->used, words, surgery->rim_vertices);
    return STATUS_OK;
}

/* Corners in ascending order, so that faces can be looked up. */
static void sort_corners(uint32_t corners[3], const uint32_t *face)
{
    uint32_t a = face[0], b = face[1], c = face[2], low = a < b ? a : b, high = a < b ? b : a;
    corners[0] = low < c ? low : c;
    corners[2] = high > c ? high : c;
    corners[1] = c < low ? low : c > high ? high : c;
}

static enum status add_small_face(struct surgery *surgery, const uint32_t *face)
{
    enum status status =
        memory_reserve(surgery->ctx, &surgery->small_faces, &surgery->small_face_capacity,
                       3 * (surgery->small_face_count + 1), sizeof *surgery->small_faces);
    if (status == STATUS_OK)
        sort_corners(surgery->small_faces + 3 * surgery->small_face_count++, face);
    return status;
}

static enum status survey_face(struct surgery *surgery, const uint32_t *face)
{
    enum status status = STATUS_OK;
    unsigned on = 0;
    for (unsigned k = 0; k < 3; k++)
        on |= (unsigned)bit_is_set(surgery->used, face[k]) << k;
    for (unsigned k = 0; k < 3 && status == STATUS_OK; k++)
        if ((on >> k & 1) && (on >> next3(k) & 1))
            status = pair_set_add(surgery->ctx, &surgery->taken, face[k], face[next3(k)]);
    return on == 7 && status == STATUS_OK ? add_small_face(surgery, face) : status;
}

static enum status survey_slab(struct surgery *surgery, const struct slab *slab)
{
    enum status status = STATUS_OK;
    for (size_t i = rim_place(surgery, slab->vertex_first);
         i < surgery->rim_count && surgery->rim_vertices[i] < slab->vertex_end; i++)
        if (surgery->rim_vertices[i] >= slab->vertex_first)
            memcpy(surgery->rim_positions + 3 * i,
                   slab->positions + 3 * (size_t)(surgery->rim_vertices[i] - slab->vertex_first),
                   3 * sizeof(float));
    for (uint32_t f = 0; f < slab->face_count && status == STATUS_OK; f++)
        if (!bit_is_set(surgery->dropped, slab->face_first + f))
            status = survey_face(surgery, slab->faces + 3 * (size_t)f);
    return status;
}

static int compare_corners(const void *a, const void *b)
{
    const uint32_t *x = a, *y = b;
    for (unsigned k = 0; k < 3; k++)
        if (x[k] != y[k])
            return x[k] < y[k] ? -1 : 1;
    return 0;
}

static enum status survey(struct surgery *surgery)
{
    uint32_t slab_count = store_info(surgery->store)->slab_count;
    enum status status = list_rim_vertices(surgery);
    pair_set_clear(surgery->ctx, &surgery->taken);
    surgery->small_face_count = 0;
    for (uint32_t i = 0; i < slab_count && status == STATUS_OK; i++) {
        struct slab slab;
        status = slab_open(surgery->store, i, &slab);
        if (status != STATUS_OK)
            break;
        status = survey_slab(surgery, &slab);
        slab_close(&slab);
    }
    for (size_t f = 0; f < surgery->mended_count && status == STATUS_OK; f++)
        status = survey_face(surgery, surgery->mended + 3 * f);
    if (surgery->small_face_count > 0)
        qsort(surgery->small_faces, surgery->small_face_count, 3 * sizeof *surgery->small_faces,
              compare_corners);
    return status;
}

/* ---- filling ---- */

struct filler {
    struct surgery *surgery;
    const uint32_t *corners; /* of the loop in hand */
    double *points;
    uint32_t *triangles;
    size_t point_capacity, triangle_capacity;
    struct triangulation_workspace workspace;
};

static bool diagonal_is_free(void *user, uint32_t i, uint32_t j)
{
    const struct filler *filler = user;
    uint32_t a = filler->corners[i], b = filler->corners[j];
    return a != b && !pair_set_has(&filler->surgery->taken, a, b);
}

/* A loop of three may be just the outline of a face that stays, seen from behind. */
static bool repeats_face(const struct surgery *surgery, const uint32_t *corners)
{
    uint32_t sorted[3];
    sort_corners(sorted, corners);
    return surgery->small_face_count > 0 &&
           bsearch(sorted, surgery->small_faces, surgery->small_face_count,
                   3 * sizeof *surgery->small_faces, compare_corners);
}

/* A corner that comes twice in a row, or between two equal ones, leaves nothing to fill. */
static bool repeats_corner(const uint32_t *corners, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++)
        if (corners[i] == corners[(i + 1) % count] || corners[i] == corners[(i + 2) % count])
            return true;
    return false;
}

static enum status keep_fill(struct filler *filler, uint32_t count)
{
    struct surgery *surgery = filler->surgery;
    size_t faces = count - 2;
    enum status status = memory_reserve(surgery->ctx, &surgery->fills, &surgery->fill_capacity,
                                        3 * (surgery->fill_count + faces), sizeof *surgery->fills);
    for (size_t i = 0; i < 3 * faces && status == STATUS_OK; i++) {
        uint32_t from = filler->triangles[i];
        uint32_t to = filler->triangles[i % 3 == 2 ? i - 2 : i + 1];
        surgery->fills[3 * surgery->fill_count + i] = filler->corners[from];
        status =
            pair_set_add(surgery->ctx, &surgery->taken, filler->corners[from], filler->corners[to]);
    }
    surgery->fill_count += faces;
    return status;
}

/*
 * Do two corners of the filled polygon that are the same vertex meet in one diagonal? The
 * triangulator knows corners only: two diagonals between the same two vertices must be found here.
 */
static enum status fill_is_simple(struct filler *filler, uint32_t count, bool *simple)
{
    struct pair_set seen = {0};
    enum status status = STATUS_OK;
    uint64_t edges = 0;
    for (size_t i = 0; i < 3 * ((size_t)count - 2) && status == STATUS_OK; i++) {
        uint32_t from = filler->triangles[i];
        uint32_t to = filler->triangles[i % 3 == 2 ? i - 2 : i + 1];
        bool is_diagonal = (from + 1) % count != to && (to + 1) % count != from;
        if (is_diagonal && from < to) {
            edges++;
            status = pair_set_add(filler->surgery->ctx, &seen, filler->corners[from],
                                  filler->corners[to]);
        }
    }
    *simple = seen.count == edges;
    pair_set_clear(filler->surgery->ctx, &seen);
    return status;
}

static enum status triangulate_loop(struct filler *filler, const struct fill_loop *loop,
                                    bool *filled)
{
    struct surgery *surgery = filler->surgery;
    struct context *ctx = surgery->ctx;
    uint32_t n = loop->count;
    enum triangulation_quality quality;
    if (n < 3 || repeats_corner(filler->corners, n) ||
        (n == 3 && repeats_face(surgery, filler->corners)))
        return STATUS_OK;
    enum status status = memory_reserve(ctx, &filler->triangles, &filler->triangle_capacity,
                                        3 * ((size_t)n - 2), sizeof *filler->triangles);
    if (status != STATUS_OK)
        return status;
    status = triangulate(ctx, &filler->workspace, filler->points, n, NULL, diagonal_is_free, filler,
                         filler->triangles, &quality);
    if (status != STATUS_OK || quality == TRIANGULATION_BLOCKED)
        return status;
    status = fill_is_simple(filler, n, filled);
    return status == STATUS_OK && *filled ? keep_fill(filler, n) : status;
}

/* The corner nearest to a place. */
static uint32_t nearest_corner(const struct filler *filler, uint32_t count, struct vec3 at)
{
    uint32_t best = 0;
    double least = INFINITY;
    for (uint32_t i = 0; i < count; i++) {
        double distance = vec3_distance_squared(at, vec3_load(filler->points + 3 * (size_t)i));
        if (distance < least) {
            least = distance;
            best = i;
        }
    }
    return filler->corners[best];
}

/* A fan round a new vertex. A corner that the loop passes twice would get two edges to it. */
static enum status fill_round_centre(struct filler *filler, const struct fill_loop *loop,
                                     bool *filled)
{
    struct surgery *surgery = filler->surgery;
    struct context *ctx = surgery->ctx;
    const uint64_t number = store_info(surgery->store)->topology.vertices + surgery->centre_count;
    const uint32_t n = loop->count;
    struct vec3 sum = {0, 0, 0};
    if (number >= NO_INDEX - 1)
        return STATUS_OK;
    for (uint32_t i = 0; i < n; i++) {
        if (pair_set_has(&surgery->taken, filler->corners[i], (uint32_t)number))
            return STATUS_OK;
        enum status status =
            pair_set_add(ctx, &surgery->taken, filler->corners[i], (uint32_t)number);
        if (status != STATUS_OK)
            return status;
        sum = vec3_add(sum, vec3_load(filler->points + 3 * (size_t)i));
    }
    enum status status = memory_reserve(ctx, &surgery->centres, &surgery->centre_capacity,
                                        surgery->centre_count + 1, sizeof *surgery->centres);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &surgery->fills, &surgery->fill_capacity,
                                3 * (surgery->fill_count + n), sizeof *surgery->fills);
    if (status != STATUS_OK)
        return status;
    struct vec3 middle = vec3_scale(sum, 1 / (double)n);
    surgery->centres[surgery->centre_count++] = (struct fill_centre){
        {(float)middle.x, (float)middle.y, (float)middle.z}, nearest_corner(filler, n, middle)};
    for (uint32_t i = 0; i < n; i++) {
        uint32_t *face = surgery->fills + 3 * surgery->fill_count++;
        face[0] = filler->corners[i];
        face[1] = filler->corners[i + 1 == n ? 0 : i + 1];
        face[2] = (uint32_t)number;
    }
    *filled = true;
    return STATUS_OK;
}

static enum status fill_loop(struct filler *filler, const struct fill_loop *loop, bool *filled)
{
    struct surgery *surgery = filler->surgery;
    filler->corners = surgery->corners + loop->first;
    *filled = false;
    enum status status = memory_reserve(surgery->ctx, &filler->points, &filler->point_capacity,
                                        3 * (size_t)loop->count, sizeof *filler->points);
    if (status != STATUS_OK)
        return status;
    for (uint32_t i = 0; i < loop->count; i++) {
        const float *at = surgery_position(surgery, filler->corners[i]);
        for (unsigned c = 0; c < 3; c++)
            filler->points[3 * (size_t)i + c] = (double)at[c];
    }
    status = triangulate_loop(filler, loop, filled);
    if (status == STATUS_OK && !*filled && loop->is_crack)
        status = fill_round_centre(filler, loop, filled);
    return status;
}

enum status surgery_fill(struct surgery *surgery, uint8_t *blocked)
{
    struct context *ctx = surgery->ctx;
    struct filler filler = {.surgery = surgery};
    surgery->fill_count = surgery->centre_count = 0;
    enum status status = survey(surgery);
    for (size_t i = 0; i < surgery->loop_count && status == STATUS_OK; i++) {
        bool filled = false;
        status = fill_loop(&filler, &surgery->loops[i], &filled);
        if (status == STATUS_OK && !filled)
            blocked[surgery->loops[i].feature] = 1;
    }
    triangulation_workspace_clear(ctx, &filler.workspace);
    memory_release(ctx, &filler.points, filler.point_capacity, sizeof *filler.points);
    memory_release(ctx, &filler.triangles, filler.triangle_capacity, sizeof *filler.triangles);
    return status;
}
