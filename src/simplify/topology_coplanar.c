/*
 * Planes of faces.
 *
 * Faces are joined into planes from the largest face on, so that a plane's normal is that of a face
 * that has one; a face thinner than the tolerance fits any plane that it lies in.
 */
#include "simplify/topology_coplanar.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/radix_sort.h"

struct growth {
    struct context *ctx;
    const struct mesh *mesh;
    double cosine, tolerance;
    uint32_t *queue; /* faces */
    struct coplanar *set;
};

/* ---- adjacency ---- */

struct edge_key {
    uint64_t pair;
    uint32_t half_edge;
    uint32_t unused;
};

static enum status find_twins(struct growth *growth)
{
    struct context *ctx = growth->ctx;
    size_t count = 3 * growth->mesh->face_count;
    struct edge_key *keys = NULL, *other = NULL;
    unsigned char *sorted = NULL;
    enum status status = memory_take(ctx, count, sizeof *keys, &keys);
    if (status == STATUS_OK)
        status = memory_take(ctx, count, sizeof *other, &other);
    for (size_t h = 0; h < count && status == STATUS_OK; h++) {
        uint32_t a = start_of(growth->mesh, (uint32_t)h);
        uint32_t b = start_of(growth->mesh, next_in_face((uint32_t)h));
        keys[h] = (struct edge_key){a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a,
                                    (uint32_t)h, 0};
    }
    if (status == STATUS_OK)
        status = radix_sort(ctx, (unsigned char *)keys, (unsigned char *)other, count, sizeof *keys,
                            1, &sorted);
    if (status == STATUS_OK) {
        const struct edge_key *edges = (const struct edge_key *)(const void *)sorted;
        memset(growth->set->twins, 0xff, count * sizeof *growth->set->twins);
        for (size_t i = 1; i < count; i++)
            if (edges[i].pair == edges[i - 1].pair) {
                growth->set->twins[edges[i].half_edge] = edges[i - 1].half_edge;
                growth->set->twins[edges[i - 1].half_edge] = edges[i].half_edge;
            }
    }
    memory_release(ctx, &keys, count, sizeof *keys);
    memory_release(ctx, &other, count, sizeof *other);
    return status;
}

/* ---- planes ---- */

struct area_key {
    uint64_t key; /* large areas first */
    uint32_t face;
    uint32_t unused;
};

static struct vec3 face_normal(const struct growth *growth, uint32_t face)
{
    const uint32_t *corner = growth->mesh->faces + 3 * (size_t)face;
    return triangle_normal(point_of(growth->mesh, corner[0]), point_of(growth->mesh, corner[1]),
                           point_of(growth->mesh, corner[2]));
}

static bool face_fits(const struct growth *growth, const struct plane *plane, uint32_t face)
{
    const uint32_t *corner = growth->mesh->faces + 3 * (size_t)face;
    double longest = 0;
    for (unsigned k = 0; k < 3; k++) {
        struct vec3 at = point_of(growth->mesh, corner[k]);
        double side = vec3_distance_squared(at, point_of(growth->mesh, corner[(k + 1) % 3]));
        if (fabs(vec3_dot(plane->normal, at) - plane->offset) > growth->tolerance)
            return false;
        longest = side > longest ? side : longest;
    }
    struct vec3 normal = face_normal(growth, face);
    double area = vec3_length(normal);
    /* Where it is thinner than the tolerance its normal says nothing. */
    if (area <= growth->tolerance * sqrt(longest))
        return true;
    return vec3_dot(normal, plane->normal) >= growth->cosine * area;
}

static enum status grow_plane(struct growth *growth, uint32_t seed)
{
    struct vec3 normal = vec3_normalized(face_normal(growth, seed));
    uint32_t number = (uint32_t)growth->set->plane_count;
    size_t begin = 0, end = 0;
    enum status status =
        memory_reserve(growth->ctx, &growth->set->planes, &growth->set->plane_capacity,
                       growth->set->plane_count + 1, sizeof *growth->set->planes);
    if (status != STATUS_OK)
        return status;
    struct plane *plane = &growth->set->planes[growth->set->plane_count++];
    *plane = (struct plane){
        .normal = normal,
        .offset = vec3_dot(normal, point_of(growth->mesh, growth->mesh->faces[3 * (size_t)seed]))};
    growth->set->plane_of[seed] = number;
    growth->queue[end++] = seed;
    while (begin < end) {
        uint32_t face = growth->queue[begin++];
        plane->face_count++;
        for (unsigned k = 0; k < 3; k++) {
            uint32_t twin = growth->set->twins[3 * (size_t)face + k];
            if (twin == NO_INDEX || growth->set->plane_of[twin / 3] != NO_INDEX ||
                !face_fits(growth, plane, twin / 3))
                continue;
            growth->set->plane_of[twin / 3] = number;
            growth->queue[end++] = twin / 3;
        }
    }
    return STATUS_OK;
}

static enum status find_planes(struct growth *growth)
{
    struct context *ctx = growth->ctx;
    size_t count = growth->mesh->face_count;
    struct area_key *keys = NULL, *other = NULL;
    unsigned char *sorted = NULL;
    enum status status = memory_take(ctx, count, sizeof *keys, &keys);
    if (status == STATUS_OK)
        status = memory_take(ctx, count, sizeof *other, &other);
    for (size_t f = 0; f < count && status == STATUS_OK; f++) {
        double area = vec3_length_squared(face_normal(growth, (uint32_t)f));
        uint64_t bits;
        memcpy(&bits, &area, sizeof bits); /* positive doubles are ordered as their bits are */
        keys[f] = (struct area_key){~bits, (uint32_t)f, 0};
    }
    if (status == STATUS_OK)
        status = radix_sort(ctx, (unsigned char *)keys, (unsigned char *)other, count, sizeof *keys,
                            1, &sorted);
    memset(growth->set->plane_of, 0xff, count * sizeof *growth->set->plane_of);
    for (size_t i = 0; i < count && status == STATUS_OK; i++) {
        uint32_t face = ((const struct area_key *)(const void *)sorted)[i].face;
        if (growth->set->plane_of[face] == NO_INDEX)
            status = grow_plane(growth, face);
    }
    memory_release(ctx, &keys, count, sizeof *keys);
    memory_release(ctx, &other, count, sizeof *other);
    return status;
}

/* ---- outlines ---- */

static enum status add_loop(struct growth *growth, uint32_t first)
{
    struct coplanar *set = growth->set;
    enum status status = memory_reserve(growth->ctx, &set->loops, &set->loop_capacity,
                                        set->loop_count + 1, sizeof *set->loops);
    if (status == STATUS_OK) {
        set->loops[set->loop_count++] = (struct outline_loop){set->plane_of[first / 3], first};
        set->planes[set->plane_of[first / 3]].loop_count++;
    }
    return status;
}

static int compare_loops(const void *a, const void *b)
{
    const struct outline_loop *x = a, *y = b;
    if (x->plane != y->plane)
        return x->plane < y->plane ? -1 : 1;
    return x->first < y->first ? -1 : x->first > y->first;
}

static enum status find_loops(struct growth *growth)
{
    struct coplanar *set = growth->set;
    const size_t half_edges = 3 * set->face_count;
    uint8_t *visited;
    enum status status = memory_take_zeroed(growth->ctx, half_edges, 1, &visited);
    for (uint32_t first = 0; first < half_edges && status == STATUS_OK; first++) {
        uint32_t h = first;
        if (visited[h] || !is_outline(set, h))
            continue;
        do {
            visited[h] = 1;
            h = next_outline(set, h);
        } while (h != first);
        status = add_loop(growth, first);
    }
    memory_release(growth->ctx, &visited, half_edges, 1);
    if (status != STATUS_OK)
        return status;
    if (set->loop_count > 0) /* a closed mesh in one plane has none */
        qsort(set->loops, set->loop_count, sizeof *set->loops, compare_loops);
    for (size_t i = 1; i < set->plane_count; i++)
        set->planes[i].first_loop = set->planes[i - 1].first_loop + set->planes[i - 1].loop_count;
    return STATUS_OK;
}

enum status coplanar_find(struct context *ctx, const struct mesh *mesh, double cosine,
                          double tolerance, struct coplanar *set)
{
    const size_t faces = set->face_count = mesh->face_count;
    struct growth growth = {
        .ctx = ctx, .mesh = mesh, .cosine = cosine, .tolerance = tolerance, .set = set};
    enum status status = memory_take(ctx, 3 * faces, sizeof *set->twins, &set->twins);
    if (status == STATUS_OK)
        status = memory_take(ctx, faces, sizeof *set->plane_of, &set->plane_of);
    if (status == STATUS_OK)
        status = memory_take(ctx, faces, sizeof *growth.queue, &growth.queue);
    if (status == STATUS_OK)
        status = find_twins(&growth);
    if (status == STATUS_OK)
        status = find_planes(&growth);
    if (status == STATUS_OK)
        status = find_loops(&growth);
    memory_release(ctx, &growth.queue, faces, sizeof *growth.queue);
    return status;
}

void coplanar_clear(struct context *ctx, struct coplanar *set)
{
    memory_release(ctx, &set->twins, 3 * set->face_count, sizeof *set->twins);
    memory_release(ctx, &set->plane_of, set->face_count, sizeof *set->plane_of);
    memory_release(ctx, &set->planes, set->plane_capacity, sizeof *set->planes);
    memory_release(ctx, &set->loops, set->loop_capacity, sizeof *set->loops);
}
