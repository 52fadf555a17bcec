/*
 * Planes by the fewest triangles.
 *
 * Faces are joined into planes from the largest face on, so that a plane's normal is that of a face
 * that has one. The outlines of the planes are chains between corners; of a chain only those
 * vertices stay that it bends at. What is left of each outline, one outer loop and the holes, is
 * bridged into one polygon and triangulated. All of this is done first and judged last: a plane
 * whose polygon can't be triangulated without repeating an edge is marked to stay as it is, its
 * outline is put back, and everything is done again, until all are content.
 */
#include "simplify/topology_planes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "geom/triangulate.h"
#include "geom/vec.h"
#include "simplify/topology_bridges.h"
#include "simplify/topology_coplanar.h"

struct merger {
    struct context *ctx;
    struct mesh *mesh;
    double tolerance;
    size_t face_count, vertex_count;
    struct coplanar set;
    uint8_t *degrees; /* a vertex: outline edges that meet there, up to 3 */
    uint8_t *kept;    /* a vertex: it stays on outlines */
    uint8_t *visited; /* a half-edge */
    uint32_t *chain;  /* vertices of the chain in hand */
    uint8_t *chain_kept;
    size_t chain_capacity, chain_kept_capacity;
    struct pair_set taken;
    struct outline_corner *corners; /* of the plane in hand, the outer loop first */
    size_t corner_count, corner_capacity;
    uint32_t *starts; /* of its loops in corners */
    size_t start_capacity;
    struct bridge_workspace bridges;
    uint32_t *polygon; /* vertices, holes bridged */
    size_t polygon_count, polygon_capacity;
    double *points;
    size_t point_capacity;
    uint32_t *triangles;
    size_t triangle_capacity;
    struct triangulation_workspace workspace;
    uint32_t *faces; /* the result */
    size_t out_count, out_capacity;
};

/* ---- outlines ---- */

static void count_degrees(struct merger *merger)
{
    memset(merger->degrees, 0, merger->vertex_count);
    for (uint32_t h = 0; h < 3 * merger->face_count; h++) {
        if (!is_outline(&merger->set, h))
            continue;
        uint8_t *start = &merger->degrees[start_of(merger->mesh, h)];
        uint8_t *end = &merger->degrees[start_of(merger->mesh, next_in_face(h))];
        *start = (uint8_t)(*start + (*start < 3));
        if (merger->set.twins[h] == NO_INDEX)
            *end = (uint8_t)(*end + (*end < 3));
    }
}

/* Distance from a line that is a point when a and b are equal. */
static double line_distance(struct vec3 p, struct vec3 a, struct vec3 b)
{
    struct vec3 along = vec3_sub(b, a), to = vec3_sub(p, a);
    double length = vec3_length_squared(along);
    double t = length > 0 ? vec3_dot(to, along) / length : 0;
    t = t < 0 ? 0 : t > 1 ? 1 : t;
    return vec3_distance(p, vec3_add_scaled(a, t, along));
}

/* Farthest of the chain's vertices between two places from the line; its distance in *distance. */
static size_t farthest(const struct merger *merger, size_t from, size_t to, double *distance)
{
    struct vec3 a = point_of(merger->mesh, merger->chain[from]),
                b = point_of(merger->mesh, merger->chain[to]);
    size_t best = from;
    *distance = -1;
    for (size_t i = from + 1; i < to; i++) {
        double d = line_distance(point_of(merger->mesh, merger->chain[i]), a, b);
        if (d > *distance) {
            *distance = d;
            best = i;
        }
    }
    return best;
}

/* Keeps what the chain bends at, between two kept places. Deepest where chains are curved; there
 * the halves are about equal. */
static void keep_bends(struct merger *merger, size_t from, size_t to)
{
    while (to - from > 1) {
        double distance;
        size_t far = farthest(merger, from, to, &distance);
        if (distance <= merger->tolerance)
            return;
        merger->chain_kept[far] = 1;
        if (far - from < to - far) {
            keep_bends(merger, from, far);
            from = far;
        } else {
            keep_bends(merger, far, to);
            to = far;
        }
    }
}

static enum status add_chain_vertex(struct merger *merger, size_t *count, uint32_t vertex)
{
    enum status status = memory_reserve(merger->ctx, &merger->chain, &merger->chain_capacity,
                                        *count + 1, sizeof *merger->chain);
    if (status == STATUS_OK)
        status = memory_reserve(merger->ctx, &merger->chain_kept, &merger->chain_kept_capacity,
                                *count + 1, 1);
    if (status == STATUS_OK) {
        merger->chain_kept[*count] = 0;
        merger->chain[(*count)++] = vertex;
    }
    return status;
}

/* Takes over what was decided for a chain, unless an edge would be there twice: then all stay. */
static enum status settle_chain(struct merger *merger, size_t count, bool keep_all)
{
    uint32_t last = merger->chain[0];
    for (size_t i = 1; i < count && !keep_all; i++)
        if (merger->chain_kept[i]) {
            keep_all = pair_set_has(&merger->taken, last, merger->chain[i]);
            last = merger->chain[i];
        }
    last = merger->chain[0];
    merger->kept[last] = 1;
    for (size_t i = 1; i < count; i++) {
        if (!keep_all && !merger->chain_kept[i])
            continue;
        enum status status = pair_set_add(merger->ctx, &merger->taken, last, merger->chain[i]);
        if (status != STATUS_OK)
            return status;
        last = merger->chain[i];
        merger->kept[last] = 1;
    }
    return STATUS_OK;
}

static bool is_frozen(const struct merger *merger, uint32_t h)
{
    uint32_t twin = merger->set.twins[h];
    return merger->set.planes[merger->set.plane_of[h / 3]].frozen ||
           (twin != NO_INDEX && merger->set.planes[merger->set.plane_of[twin / 3]].frozen);
}

/* A chain is seen from both of its planes; the one with the lower number takes it. */
static bool is_taken_here(const struct merger *merger, uint32_t h)
{
    uint32_t twin = merger->set.twins[h];
    return twin == NO_INDEX || merger->set.plane_of[h / 3] < merger->set.plane_of[twin / 3];
}

static enum status simplify_chain(struct merger *merger, uint32_t first, bool is_closed)
{
    size_t count = 0;
    uint32_t h = first;
    enum status status = add_chain_vertex(merger, &count, start_of(merger->mesh, h));
    for (bool more = true; more && status == STATUS_OK;) {
        uint32_t end = start_of(merger->mesh, next_in_face(h));
        merger->visited[h] = 1;
        if (merger->set.twins[h] != NO_INDEX)
            merger->visited[merger->set.twins[h]] = 1;
        status = add_chain_vertex(merger, &count, end);
        h = next_outline(&merger->set, h);
        more = is_closed ? h != first : merger->degrees[end] == 2;
    }
    if (status != STATUS_OK)
        return status;
    merger->chain_kept[0] = merger->chain_kept[count - 1] = 1;
    if (is_closed) {
        double distance;
        size_t far = farthest(merger, 0, count - 1, &distance);
        merger->chain_kept[far] = 1;
        keep_bends(merger, 0, far);
        keep_bends(merger, far, count - 1);
    } else
        keep_bends(merger, 0, count - 1);
    /* Two planes that have nothing but one loop must not become the same triangle. */
    size_t kept = 0, least = !is_closed ? 0 : merger->set.twins[first] == NO_INDEX ? 4 : 5;
    for (size_t i = 0; i < count; i++)
        kept += merger->chain_kept[i];
    return settle_chain(merger, count, is_frozen(merger, first) || kept < least);
}

/* Chains of one edge first: they can't give way when another comes to lie on them. */
static enum status simplify_chains(struct merger *merger)
{
    enum status status = STATUS_OK;
    size_t half_edges = 3 * merger->face_count;
    memset(merger->visited, 0, half_edges);
    memset(merger->kept, 0, merger->vertex_count);
    for (unsigned turn = 0; turn < 3; turn++)
        for (uint32_t h = 0; h < half_edges && status == STATUS_OK; h++) {
            if (!is_outline(&merger->set, h) || merger->visited[h] || !is_taken_here(merger, h))
                continue;
            bool starts = merger->degrees[start_of(merger->mesh, h)] != 2;
            bool ends = merger->degrees[start_of(merger->mesh, next_in_face(h))] != 2;
            if ((turn == 0 && starts && ends) || (turn == 1 && starts) || turn == 2)
                status = simplify_chain(merger, h, turn == 2);
        }
    return status;
}

/* ---- polygons ---- */

/* Adds the kept vertices of a loop to the corners. *area: twice its signed area about the normal.
 */
static enum status take_loop(struct merger *merger, uint32_t loop, double *area)
{
    uint32_t first = merger->set.loops[loop].first, h = first;
    struct vec3 sum = {0, 0, 0}, origin = point_of(merger->mesh, start_of(merger->mesh, first));
    do {
        uint32_t v = start_of(merger->mesh, h);
        if (merger->kept[v]) {
            enum status status =
                memory_reserve(merger->ctx, &merger->corners, &merger->corner_capacity,
                               merger->corner_count + 1, sizeof *merger->corners);
            if (status != STATUS_OK)
                return status;
            merger->corners[merger->corner_count++].vertex = v;
        }
        sum = vec3_add(
            sum, triangle_normal(origin, point_of(merger->mesh, v),
                                 point_of(merger->mesh, start_of(merger->mesh, next_in_face(h)))));
        h = next_outline(&merger->set, h);
    } while (h != first);
    *area = vec3_dot(sum, merger->set.planes[merger->set.loops[loop].plane].normal);
    return STATUS_OK;
}

/* Takes the plane's loops that are outer ones, or those that are holes; *count: how many so far. */
static enum status take_loops(struct merger *merger, const struct plane *plane, bool outer,
                              uint32_t *count, bool *possible)
{
    enum status status = STATUS_OK;
    for (uint32_t i = 0; i < plane->loop_count && status == STATUS_OK; i++) {
        size_t first = merger->corner_count;
        double area;
        status = take_loop(merger, plane->first_loop + i, &area);
        if (status != STATUS_OK)
            return status;
        if (merger->corner_count < first + 3)
            *possible = false;
        if ((area > 0) != outer)
            merger->corner_count = first;
        else
            merger->starts[++*count] = (uint32_t)merger->corner_count;
    }
    return status;
}

/* All corners of the plane's outline, if it has one outer loop. */
static enum status take_outline(struct merger *merger, const struct plane *plane, bool *possible)
{
    uint32_t count = 0;
    enum status status = memory_reserve(merger->ctx, &merger->starts, &merger->start_capacity,
                                        plane->loop_count + (size_t)1, sizeof *merger->starts);
    if (status != STATUS_OK)
        return status;
    *possible = plane->loop_count > 0;
    merger->corner_count = merger->starts[0] = 0;
    status = take_loops(merger, plane, true, &count, possible);
    *possible = *possible && count == 1;
    if (status == STATUS_OK)
        status = take_loops(merger, plane, false, &count, possible);
    if (status != STATUS_OK || !*possible)
        return status;
    merger->polygon_count = merger->corner_count + 2 * ((size_t)plane->loop_count - 1);
    return memory_reserve(merger->ctx, &merger->polygon, &merger->polygon_capacity,
                          merger->polygon_count, sizeof *merger->polygon);
}

struct axes {
    struct vec3 u, v;
};

static struct axes axes_of(struct vec3 normal)
{
    struct vec3 helper = fabs(normal.x) < 0.6 ? vec3_make(1, 0, 0) : vec3_make(0, 1, 0);
    struct axes axes = {.u = vec3_normalized(vec3_cross(normal, helper))};
    axes.v = vec3_cross(normal, axes.u);
    return axes;
}

static bool diagonal_is_free(void *user, uint32_t i, uint32_t j)
{
    const struct merger *merger = user;
    uint32_t a = merger->polygon[i], b = merger->polygon[j];
    return a != b && !pair_set_has(&merger->taken, a, b);
}

/* Enters the diagonals of the polygon's triangles; false if two are the same. */
static enum status take_diagonals(struct merger *merger, bool *possible)
{
    uint32_t n = (uint32_t)merger->polygon_count;
    for (size_t i = 0; i < 3 * ((size_t)n - 2) && *possible; i++) {
        uint32_t from = merger->triangles[i];
        uint32_t to = merger->triangles[i % 3 == 2 ? i - 2 : i + 1];
        if (from > to || from + 1 == to || (from == 0 && to == n - 1))
            continue;
        uint32_t a = merger->polygon[from], b = merger->polygon[to];
        *possible = a != b && !pair_set_has(&merger->taken, a, b);
        enum status status = pair_set_add(merger->ctx, &merger->taken, a, b);
        if (status != STATUS_OK)
            return status;
    }
    return STATUS_OK;
}

static enum status add_face(struct merger *merger, uint32_t a, uint32_t b, uint32_t c)
{
    enum status status = memory_reserve(merger->ctx, &merger->faces, &merger->out_capacity,
                                        3 * (merger->out_count + 1), sizeof *merger->faces);
    if (status == STATUS_OK) {
        uint32_t *face = merger->faces + 3 * merger->out_count++;
        face[0] = a;
        face[1] = b;
        face[2] = c;
    }
    return status;
}

/* Enters the polygon's edges: those of bridges are new. */
static enum status take_bridges(struct merger *merger)
{
    enum status status = STATUS_OK;
    size_t n = merger->polygon_count;
    for (size_t i = 0; i < n && status == STATUS_OK; i++)
        status = pair_set_add(merger->ctx, &merger->taken, merger->polygon[i],
                              merger->polygon[i + 1 == n ? 0 : i + 1]);
    return status;
}

/* Bridges the plane's holes along `axes` and triangulates; *possible says whether that worked. */
static enum status try_polygon(struct merger *merger, const struct plane *plane,
                               const struct axes *axes, bool *possible)
{
    const double normal[3] = {plane->normal.x, plane->normal.y, plane->normal.z};
    enum triangulation_quality quality;
    for (size_t i = 0; i < merger->corner_count; i++) {
        struct vec3 at = point_of(merger->mesh, merger->corners[i].vertex);
        merger->corners[i].x = vec3_dot(at, axes->u);
        merger->corners[i].y = vec3_dot(at, axes->v);
    }
    enum status status =
        bridge_holes(merger->ctx, &merger->bridges, merger->corners, merger->starts,
                     plane->loop_count, &merger->taken, merger->polygon, possible);
    if (status != STATUS_OK || !*possible)
        return status;
    size_t n = merger->polygon_count;
    status = memory_reserve(merger->ctx, &merger->points, &merger->point_capacity, 3 * n,
                            sizeof *merger->points);
    if (status == STATUS_OK)
        status = memory_reserve(merger->ctx, &merger->triangles, &merger->triangle_capacity,
                                3 * (n - 2), sizeof *merger->triangles);
    if (status != STATUS_OK)
        return status;
    for (size_t i = 0; i < n; i++)
        vec3_store(merger->points + 3 * i, point_of(merger->mesh, merger->polygon[i]));
    status = triangulate(merger->ctx, &merger->workspace, merger->points, (uint32_t)n, normal,
                         diagonal_is_free, merger, merger->triangles, &quality);
    *possible = status == STATUS_OK && quality <= TRIANGULATION_OVERLAPPING;
    return status;
}

/* A plane of several faces within three edges, behind all of which lies one other plane with no
 * other loop: that may be, or become, the same triangle. */
static bool may_mirror_another(const struct merger *merger, const struct plane *plane)
{
    uint32_t first = merger->set.loops[plane->first_loop].first, h = first, behind = NO_INDEX,
             count = 0;
    if (plane->loop_count != 1 || plane->face_count == 1)
        return false;
    do {
        uint32_t twin = merger->set.twins[h];
        uint32_t other = twin == NO_INDEX ? NO_INDEX : merger->set.plane_of[twin / 3];
        if (other == NO_INDEX || (count > 0 && other != behind) || count == 3)
            return false;
        behind = other;
        count++;
        h = next_outline(&merger->set, h);
    } while (h != first);
    return merger->set.planes[behind].loop_count == 1;
}

/* Tries the holes' bridges in four directions, for a bridge may leave a corner that no ear fits. */
static enum status triangulate_plane(struct merger *merger, const struct plane *plane,
                                     bool *possible)
{
    struct axes axes = axes_of(plane->normal);
    enum status status = take_outline(merger, plane, possible);
    if (status != STATUS_OK || !*possible)
        return status;
    *possible = false;
    if (may_mirror_another(merger, plane))
        return STATUS_OK;
    for (unsigned turn = 0; turn < (plane->loop_count > 1 ? 4 : 1) && !*possible; turn++) {
        status = try_polygon(merger, plane, &axes, possible);
        if (status != STATUS_OK)
            return status;
        axes = (struct axes){axes.v, vec3_scale(axes.u, -1)};
    }
    if (*possible)
        status = take_bridges(merger);
    if (*possible && status == STATUS_OK)
        status = take_diagonals(merger, possible);
    for (size_t i = 0; *possible && i < merger->polygon_count - 2 && status == STATUS_OK; i++)
        status = add_face(merger, merger->polygon[merger->triangles[3 * i]],
                          merger->polygon[merger->triangles[3 * i + 1]],
                          merger->polygon[merger->triangles[3 * i + 2]]);
    return status;
}

/* Edges inside frozen planes are there before any other. */
static enum status copy_frozen(struct merger *merger)
{
    enum status status = STATUS_OK;
    pair_set_clear(merger->ctx, &merger->taken);
    for (uint32_t h = 0; h < 3 * merger->face_count && status == STATUS_OK; h++)
        if (merger->set.planes[merger->set.plane_of[h / 3]].frozen) {
            uint32_t a = start_of(merger->mesh, h), b = start_of(merger->mesh, next_in_face(h));
            if (!is_outline(&merger->set, h))
                status = pair_set_add(merger->ctx, &merger->taken, a, b);
            if (status == STATUS_OK && h % 3 == 0)
                status = add_face(merger, a, b, start_of(merger->mesh, h + 2));
        }
    return status;
}

/* One attempt with the planes that are frozen now; counts those that must be frozen, too. */
static enum status attempt(struct merger *merger, size_t *refused)
{
    *refused = merger->out_count = 0;
    enum status status = copy_frozen(merger);
    if (status == STATUS_OK)
        status = simplify_chains(merger);
    for (size_t i = 0; i < merger->set.plane_count && status == STATUS_OK; i++) {
        struct plane *plane = &merger->set.planes[i];
        bool possible = true;
        if (plane->frozen)
            continue;
        status = triangulate_plane(merger, plane, &possible);
        plane->frozen = !possible;
        *refused += !possible;
    }
    return status;
}

/* ---- the result ---- */

/* Drops vertices that no face uses. */
static enum status compact(struct merger *merger)
{
    struct mesh *mesh = merger->mesh;
    size_t stride = mesh->attributes.stride;
    uint32_t *numbers, next = 0;
    enum status status = memory_take(merger->ctx, merger->vertex_count, sizeof *numbers, &numbers);
    if (status != STATUS_OK)
        return status;
    memset(numbers, 0xff, merger->vertex_count * sizeof *numbers);
    for (size_t i = 0; i < 3 * merger->out_count; i++)
        numbers[merger->faces[i]] = 0;
    for (size_t v = 0; v < merger->vertex_count; v++)
        if (numbers[v] == 0) {
            memmove(mesh->positions + 3 * (size_t)next, mesh->positions + 3 * v,
                    3 * sizeof *mesh->positions);
            if (stride)
                memmove(mesh->records + next * stride, mesh->records + v * stride, stride);
            numbers[v] = next++;
        }
    for (size_t i = 0; i < 3 * merger->out_count; i++)
        merger->faces[i] = numbers[merger->faces[i]];
    memory_release(merger->ctx, &numbers, merger->vertex_count, sizeof *numbers);
    /* Shrinking can't fail for want of room; if it does, that is a failure like any other. */
    status = memory_resize(merger->ctx, &mesh->positions, 3 * mesh->vertex_count, 3 * (size_t)next,
                           sizeof *mesh->positions);
    if (status == STATUS_OK && stride)
        status = memory_resize(merger->ctx, &mesh->records, mesh->vertex_count, next, stride);
    if (status == STATUS_OK)
        mesh->vertex_count = next;
    if (status == STATUS_OK)
        status = memory_resize(merger->ctx, &mesh->faces, 3 * mesh->face_count,
                               3 * merger->out_count, sizeof *mesh->faces);
    if (status == STATUS_OK) {
        mesh->face_count = merger->out_count;
        memcpy(mesh->faces, merger->faces, 3 * merger->out_count * sizeof *mesh->faces);
    }
    return status;
}

static enum status take_arrays(struct merger *merger)
{
    struct context *ctx = merger->ctx;
    size_t half_edges = 3 * merger->face_count;
    enum status status = memory_take(ctx, merger->vertex_count, 1, &merger->degrees);
    if (status == STATUS_OK)
        status = memory_take(ctx, merger->vertex_count, 1, &merger->kept);
    if (status == STATUS_OK)
        status = memory_take(ctx, half_edges, 1, &merger->visited);
    return status;
}

static void release(struct merger *merger)
{
    struct context *ctx = merger->ctx;
    size_t half_edges = 3 * merger->face_count;
    coplanar_clear(ctx, &merger->set);
    memory_release(ctx, &merger->degrees, merger->vertex_count, 1);
    memory_release(ctx, &merger->kept, merger->vertex_count, 1);
    memory_release(ctx, &merger->visited, half_edges, 1);
    memory_release(ctx, &merger->chain, merger->chain_capacity, sizeof *merger->chain);
    memory_release(ctx, &merger->chain_kept, merger->chain_kept_capacity, 1);
    memory_release(ctx, &merger->polygon, merger->polygon_capacity, sizeof *merger->polygon);
    memory_release(ctx, &merger->corners, merger->corner_capacity, sizeof *merger->corners);
    memory_release(ctx, &merger->starts, merger->start_capacity, sizeof *merger->starts);
    bridge_workspace_clear(ctx, &merger->bridges);
    memory_release(ctx, &merger->points, merger->point_capacity, sizeof *merger->points);
    memory_release(ctx, &merger->triangles, merger->triangle_capacity, sizeof *merger->triangles);
    memory_release(ctx, &merger->faces, merger->out_capacity, sizeof *merger->faces);
    pair_set_clear(ctx, &merger->taken);
    triangulation_workspace_clear(ctx, &merger->workspace);
}

enum status planes_merge(struct context *ctx, struct mesh *mesh, double cosine, double tolerance)
{
    struct merger merger = {.ctx = ctx,
                            .mesh = mesh,
                            .tolerance = tolerance,
                            .face_count = mesh->face_count,
                            .vertex_count = mesh->vertex_count};
    size_t refused = 1;
    if (mesh->face_count == 0)
        return STATUS_OK;
    enum status status = take_arrays(&merger);
    if (status == STATUS_OK)
        status = coplanar_find(ctx, mesh, cosine, tolerance, &merger.set);
    if (status == STATUS_OK)
        count_degrees(&merger);
    while (status == STATUS_OK && refused > 0)
        status = attempt(&merger, &refused);
    if (status == STATUS_OK)
        status = compact(&merger);
    release(&merger);
    return status;
}
