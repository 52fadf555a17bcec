/*
 * What a collapse does to the faces round its edge: whether they stay sound, how far the new vertex
 * is from them, and the fans of the vertices on them afterwards.
 *
 * The plain way turns round every vertex whose faces change and adds them up anew, eight turns for
 * one collapse, each a walk through memory. Here the faces at both ends are known already from
 * pricing the edge; each keeps its outer edge and only changes its third corner. So one pass over
 * them, several in the lanes of a vector, gives old and new normals; guards compare these, and what
 * a neighbour's fan changes by is the difference of the two faces' parts. Sums of differences
 * drift by rounding, but a vertex that is made anew gets a fan that is made anew, and faces grow as
 * a mesh gets coarser, so that what is left of earlier ones is small.
 */
#include <math.h>
#include <string.h>

#include "base/lanes.h"
#include "collapse_internal.h"
#include "geom/distance.h"

/* A face may turn by less than the angle with this cosine (about 78 degrees). */
static const float FLIP_COSINE = 0.2f;
/* Below this |n| / (sum of squared edges) a face is a sliver; an equilateral one has 0.289. A
 * stricter guard holds needles of range scans in place, and what they keep others must give: with
 * 0.01 the dragon's mean error at 1 % was a quarter larger. */
static const float SLIVER_SHAPE = 0.001f;
/* Below this |n| / (sum of squared edges) a face has no direction. */
static const float NO_SHAPE = 1e-5f;
static const float TINY = 1e-30f; /* keeps quotients finite */

/* ---- guards ---- */

/* The two faces at an edge, by their index in the ring of one of its ends; UINT32_MAX: none. */
static void faces_gone(const struct ring *ring, uint32_t place, uint32_t gone[2])
{
    gone[0] = place < ring->faces ? place : UINT32_MAX;
    gone[1] = place > 0 ? place - 1 : ring->faces == ring->count ? ring->count - 1 : UINT32_MAX;
}

/* Sums over the planes of the faces that were there: how far the new vertex is from them, weighted
 * with their squared areas. */
struct plane_sums {
    float distance[EDGE_LANES]; /* (n . step)^2 */
    float weight[EDGE_LANES];   /* n . n */
};

/* The faces at one end, 8 at a time: their normals with the vertex at `to`, and whether all that
 * stay are sound. Those that go are counted in the sums of the first end only. */
LANES_INLINE bool turn_faces(enum guard guard, struct edge_change *change, int end,
                             const float fan_normal[3], struct plane_sums *sums)
{
    const struct vertex_look *look = change->looks[end];
    const float tx = change->to[end][0], ty = change->to[end][1], tz = change->to[end][2];
    const float ux = fan_normal[0], uy = fan_normal[1], uz = fan_normal[2];
    float(*turned)[RING_LANES] = change->turned[end];
    uint32_t gone[2];
    faces_gone(&look->ring, change->place[end], gone);
    const int no_guard = guard == GUARD_NONE, slivers = guard == GUARD_FULL;
    int bad[EDGE_LANES] = {0};
    for (uint32_t first = 0; first < look->ring.count; first += EDGE_LANES)
        for (uint32_t i = 0; i < EDGE_LANES; i++) {
            const uint32_t j = first + i;
            const int stays = (j < look->ring.faces) & (j != gone[0]) & (j != gone[1]);
            const float rx = look->at[0][j], ry = look->at[1][j], rz = look->at[2][j];
            const float sx = look->at[0][j + 1], sy = look->at[1][j + 1], sz = look->at[2][j + 1];
            const float ox = look->normals[0][j], oy = look->normals[1][j];
            const float oz = look->normals[2][j];
            const float ax = rx - tx, ay = ry - ty, az = rz - tz;
            const float bx = sx - tx, by = sy - ty, bz = sz - tz;
            const float ex = sx - rx, ey = sy - ry, ez = sz - rz;
            const float nx = ay * bz - az * by, ny = az * bx - ax * bz, nz = ax * by - ay * bx;
            const float base = ex * ex + ey * ey + ez * ez;
            const float sizes = ax * ax + ay * ay + az * az + (bx * bx + by * by + bz * bz) + base;
            const float old_sizes =
                rx * rx + ry * ry + rz * rz + (sx * sx + sy * sy + sz * sz) + base;
            const float old_square = ox * ox + oy * oy + oz * oz;
            const float old_length = sqrtf(old_square);
            const float length = sqrtf(nx * nx + ny * ny + nz * nz);
            const float shape = length / (sizes + TINY);
            const float old_shape = old_length / (old_sizes + TINY);
            const float dot = ox * nx + oy * ny + oz * nz;
            const float agrees = nx * ux + ny * uy + nz * uz;
            const float height = ox * tx + oy * ty + oz * tz;

            const int sliver = slivers & (shape < SLIVER_SHAPE) & (shape < old_shape);
            /* without a direction before: agree with the surroundings */
            const int undirected = old_shape <= NO_SHAPE;
            const int flips = (dot <= 0) | (slivers & (dot < FLIP_COSINE * old_length * length));
            bad[i] |= stays & (sliver | (undirected ? agrees < 0 : flips));
            turned[0][j] = stays ? nx : 0;
            turned[1][j] = stays ? ny : 0;
            turned[2][j] = stays ? nz : 0;
            const float counts = end == 0 || stays ? 1 : 0;
            sums->distance[i] += counts * height * height;
            sums->weight[i] += counts * old_square;
        }
    int any = 0;
    for (uint32_t i = 0; i < EDGE_LANES; i++)
        any |= bad[i];
    return !any || no_guard;
}

LANES_INLINE bool turn_both(enum guard guard, struct edge_change *change, const float fan_normal[3],
                            double *square)
{
    struct plane_sums sums = {{0}, {0}};
    if (!turn_faces(guard, change, 0, fan_normal, &sums) ||
        !turn_faces(guard, change, 1, fan_normal, &sums))
        return false;
    const float weight = lanes_sum(sums.weight), distance = lanes_sum(sums.distance);
    *square = weight > 0 ? (double)(distance / weight) : 0;
    return true;
}

static bool turn_both_scalar(enum guard guard, struct edge_change *change,
                             const float fan_normal[3], double *square)
{
    return turn_both(guard, change, fan_normal, square);
}

LANES_AVX2 static bool turn_both_avx2(enum guard guard, struct edge_change *change,
                                      const float fan_normal[3], double *square)
{
    return turn_both(guard, change, fan_normal, square);
}

bool edge_shape_allows(const struct collapse *c, struct edge_change *change, double *deviation)
{
    const uint32_t v = change->v, w = change->w;
    float normal[3];
    double square;
    for (int k = 0; k < 3; k++)
        normal[k] = c->vertices[v].fan.normal[k] + c->vertices[w].fan.normal[k];
    if (c->level >= CPU_AVX2 ? !turn_both_avx2(c->guard, change, normal, &square)
                             : !turn_both_scalar(c->guard, change, normal, &square))
        return false;
    if (c->vertices[v].flags & c->vertices[w].flags & VERTEX_BORDER) {
        struct border_sum border;
        const double to[3] = {(double)change->to[0][0], (double)change->to[0][1],
                              (double)change->to[0][2]};
        border_edges_sum(c, v, w, &border);
        const double aside = border_sum_distance(&border, to);
        square = aside > square ? aside : square;
    }
    *deviation = sqrt(square);
    return true;
}

/* ---- how far the new vertex sticks out ---- */

static struct vec3 neighbour_at(const struct vertex_look *look, uint32_t i)
{
    return (struct vec3){(double)look->at[0][i], (double)look->at[1][i], (double)look->at[2][i]};
}

/* Least squared distance of the new vertex from faces [first, end) at one end. */
static double nearest_of(const struct edge_change *change, int end, uint32_t first, uint32_t last,
                         double enough, double nearest)
{
    const float *to = change->to[end];
    const struct vec3 point = {(double)to[0], (double)to[1], (double)to[2]};
    const struct vertex_look *look = change->looks[end];
    for (uint32_t j = first; j < last && nearest > enough; j++) {
        const struct triangle face = {{0, 0, 0}, neighbour_at(look, j), neighbour_at(look, j + 1)};
        const double square = triangle_distance_squared(point, &face, NULL);
        nearest = square < nearest ? square : nearest;
    }
    return nearest;
}

double edge_overshoot(const struct edge_change *change, double enough)
{
    double nearest = INFINITY;
    uint32_t gone[2];
    enough *= enough;
    /* the two that go first: it is they that the new vertex is commonly near to */
    faces_gone(&change->looks[0]->ring, change->place[0], gone);
    for (int k = 0; k < 2; k++)
        if (gone[k] != UINT32_MAX)
            nearest = nearest_of(change, 0, gone[k], gone[k] + 1, enough, nearest);
    for (int end = 0; end < 2; end++)
        nearest = nearest_of(change, end, 0, change->looks[end]->ring.faces, enough, nearest);
    return nearest < INFINITY ? sqrt(nearest) : 0;
}

/* ---- fans ---- */

/* Sums of nine products over faces, a lane each, one place to the right: face j stands in j + 1,
 * and what stands before the first is the last face of a closed ring. */
struct fan_lanes {
    float sum[9][RING_LANES + EDGE_LANES];
};

/* What the faces at one end add to a fan now, less what they added before; `fresh` gets what they
 * add now. Faces that go are taken away at the first end only. */
LANES_INLINE void compare_fans(const struct edge_change *change, int end,
                               struct fan_lanes *change_by, float fresh[9][EDGE_LANES])
{
    const struct vertex_look *look = change->looks[end];
    uint32_t gone[2];
    faces_gone(&look->ring, change->place[end], gone);
    for (uint32_t first = 0; first < look->ring.count; first += EDGE_LANES)
        for (uint32_t i = 0; i < EDGE_LANES; i++) {
            const uint32_t j = first + i;
            const float counts = end == 0 || ((j != gone[0]) & (j != gone[1])) ? 1 : 0;
            const float x = change->turned[end][0][j], y = change->turned[end][1][j];
            const float z = change->turned[end][2][j];
            const float ox = counts * look->normals[0][j], oy = counts * look->normals[1][j];
            const float oz = counts * look->normals[2][j];
            const float new[9] = {x * x, x * y, x * z, y * y, y * z, z * z, x, y, z};
            const float old[9] = {ox * ox, ox * oy, ox * oz, oy * oy, oy * oz, oz * oz, ox, oy, oz};
            for (int k = 0; k < 9; k++) {
                fresh[k][i] += new[k];
                change_by->sum[k][j + 1] = new[k] - old[k];
            }
        }
    for (int k = 0; k < 9; k++) {
        float *sum = change_by->sum[k];
        sum[0] = sum[look->ring.count]; /* 0 in an open ring */
        for (uint32_t first = 0; first < look->ring.count; first += EDGE_LANES)
            for (uint32_t i = 0; i < EDGE_LANES; i++)
                sum[first + i] += sum[first + i + 1];
    }
}

LANES_INLINE void update_fans(struct collapse *c, const struct edge_change *change, uint32_t kept)
{
    float fresh[9][EDGE_LANES] = {{0}};
    struct fan_lanes change_by;
    for (int end = 0; end < 2; end++) {
        const struct ring *ring = &change->looks[end]->ring;
        compare_fans(change, end, &change_by, fresh);
        for (uint32_t i = 0; i < ring->count; i++) {
            struct fan *fan = &c->vertices[ring->vertices[i]].fan;
            for (int k = 0; k < 6; k++)
                fan->square[k] += change_by.sum[k][i];
            for (int k = 0; k < 3; k++)
                fan->normal[k] += change_by.sum[6 + k][i];
        }
    }
    struct fan *fan = &c->vertices[kept].fan;
    for (int k = 0; k < 6; k++)
        fan->square[k] = lanes_sum(fresh[k]);
    for (int k = 0; k < 3; k++)
        fan->normal[k] = lanes_sum(fresh[6 + k]);
}

static void update_fans_scalar(struct collapse *c, const struct edge_change *change, uint32_t kept)
{
    update_fans(c, change, kept);
}

LANES_AVX2 static void update_fans_avx2(struct collapse *c, const struct edge_change *change,
                                        uint32_t kept)
{
    update_fans(c, change, kept);
}

void edge_update_fans(struct collapse *c, const struct edge_change *change, uint32_t kept)
{
    if (c->level >= CPU_AVX2)
        update_fans_avx2(c, change, kept);
    else
        update_fans_scalar(c, change, kept);
}

void fans_build(struct collapse *c)
{
    for (size_t v = 0; v < (size_t)c->vertex_slots; v++)
        memset(&c->vertices[v].fan, 0, sizeof c->vertices[v].fan);
    for (size_t f = 0; f < (size_t)c->face_slots; f++) {
        const struct collapse_corner *corner = c->corners + 3 * f;
        const float *p = c->vertices[corner[0].end].position;
        const float *q = c->vertices[corner[1].end].position;
        const float *r = c->vertices[corner[2].end].position;
        const float ax = q[0] - p[0], ay = q[1] - p[1], az = q[2] - p[2];
        const float bx = r[0] - p[0], by = r[1] - p[1], bz = r[2] - p[2];
        const float x = ay * bz - az * by, y = az * bx - ax * bz, z = ax * by - ay * bx;
        const float part[6] = {x * x, x * y, x * z, y * y, y * z, z * z};
        const float normal[3] = {x, y, z};
        for (int i = 0; i < 3; i++) {
            struct fan *fan = &c->vertices[corner[i].end].fan;
            for (int k = 0; k < 6; k++)
                fan->square[k] += part[k];
            for (int k = 0; k < 3; k++)
                fan->normal[k] += normal[k];
        }
    }
}
