/*
 * How far the surface is from the original, vertex by vertex.
 *
 * Adding up what each collapse may have done bounds the distance, but the sums grow with the number
 * of collapses while true errors cancel: they end two to nine times too large, and say little of
 * where the surface is astray. Measuring against the original would tell, but it is not here. So
 * each vertex carries a witness, one point of the original near it: at first the vertex itself or
 * the inner vertex of a patch beside it, and after each collapse that of both ends' witnesses that
 * is further from the faces that are there now, or one of the ends itself. Its distance is exact
 * and never adds up; as the witnesses that are farthest are those that stay, the farthest of them
 * all is nearly the farthest point of the original. (Without the ends themselves, a corner that had
 * an inner vertex as its witness was cut off unseen: 20 times the estimate on fandisk.)
 *
 * A witness tells how far the original is from the surface, not how far the surface is from the
 * original. For that each vertex has an offset with a sign: what the surface had at the foot of the
 * new vertex, and the way from there. Signs let cancel what cancels. The middles of new edges,
 * where the faces beside them turn, are measured against the faces that were there: a thin face
 * that bridges a crease has hardly a volume, and all witnesses lie near it.
 *
 * The largest of all these was 0.89 to 1.71 times the measured maximum (bunny, koala, elephant,
 * skull and fandisk at 10, 2 and 1 % of their faces, all efforts).
 *
 * Distances from faces are taken for eight of them at a time, in the lanes of a vector.
 */
#include <math.h>
#include <string.h>

#include "base/half.h"
#include "base/lanes.h"
#include "collapse_internal.h"
#include "geom/distance.h"

/* Below this square of the sine at the corner a face is as good as its edges. */
static const float NEEDLE = 1e-10f;
static const float TINY = 1e-37f; /* keeps quotients finite */
/* Edges whose faces have normals with less than this cosine (60 degrees) are rims. */
static const float RIM_COSINE = 0.5f;
static const float FAR = 3e38f;

/* ---- a point and the faces at a vertex ---- */

/* Squared distances of the points p from the segments from a along d. */
LANES_INLINE float8 segment_square(struct vec3x8 p, struct vec3x8 a, struct vec3x8 d)
{
    const struct vec3x8 q = lanes_sub(p, a);
    const float8 along = lanes_dot(q, d) / (lanes_dot(d, d) + TINY);
    const float8 low = lanes_where(along > 0, along);
    const float8 t = lanes_choose(low < 1, low, lanes_all(1));
    const struct vec3x8 rest = {q.x - t * d.x, q.y - t * d.y, q.z - t * d.z};
    return lanes_dot(rest, rest);
}

/* Eight faces of a fan, relative to its middle: between neighbours b and c, and the next lane's b
 * is this one's c. */
struct fan_faces {
    struct vec3x8 b, c;
    bool is_last; /* the last lane is beyond the last face */
};

/* What lane i + 1 has; the last lane gets what the first has. */
LANES_INLINE float8 lanes_next(float8 v)
{
    return __builtin_shufflevector(v, v, 1, 2, 3, 4, 5, 6, 7, 0);
}

/* Squared distances of the point p from the faces that it is above or below of; FAR from the
 * others. */
LANES_INLINE float8 heights_square(struct vec3x8 p, const struct fan_faces *faces)
{
    const struct vec3x8 b = faces->b, c = faces->c, n = lanes_cross(b, c);
    /* barycentric weights, times the squared normal, of the foot of p */
    const float8 second = lanes_dot(lanes_cross(p, c), n);
    const float8 third = lanes_dot(lanes_cross(b, p), n);
    const float8 square = lanes_dot(n, n);
    const int8x32 above = (second >= 0) & (third >= 0) & (second + third <= square) &
                          (square > NEEDLE * (lanes_dot(b, b) * lanes_dot(c, c)));
    const float8 height = lanes_dot(p, n);
    return lanes_choose(above, height * height / (square + TINY), lanes_all(FAR));
}

/* Squared distances of the point p from the edges of the faces. (The edge that two have in common
 * is looked at once.) */
LANES_INLINE float8 edges_square(struct vec3x8 p, const struct fan_faces *faces)
{
    const struct vec3x8 zero = {lanes_all(0), lanes_all(0), lanes_all(0)};
    const float8 left = segment_square(p, zero, faces->b);
    const float8 right = faces->is_last ? lanes_next(left) : segment_square(p, zero, faces->c);
    const float8 rim = segment_square(p, faces->b, lanes_sub(faces->c, faces->b));
    return lanes_least(lanes_least(left, right), rim);
}

/* The least of the lanes, and in the first of those that have it, of `places`. */
LANES_INLINE float least_lane(float8 v, int8x32 places, uint32_t *place)
{
    const float8 least = lanes_all_least(v);
    if (place) {
        int lane = 0;
        while (v[lane] > least[0])
            lane++;
        *place = (uint32_t)places[lane];
    }
    return least[0];
}

/*
 * Least squared distance of p from the triangles that `apex` makes with the edges of the ring, but
 * for those at places `gone`; *place (may be NULL) is that triangle's. What is not more than
 * `enough` need not be exact: mostly the point is above a face, and edges, which are more work,
 * need not be looked at.
 */
LANES_INLINE float nearest_in_lanes(const struct vertex_look *look, const float apex[3],
                                    const uint32_t gone[2], const float p[3], float enough,
                                    uint32_t *place)
{
    const struct vec3x8 top = {lanes_all(apex[0]), lanes_all(apex[1]), lanes_all(apex[2])};
    const struct vec3x8 whole = {lanes_all(p[0]), lanes_all(p[1]), lanes_all(p[2])};
    const struct vec3x8 point = lanes_sub(whole, top);
    float8 least = lanes_all(FAR);
    int8x32 places = {0};
    for (uint32_t first = 0; first < look->ring.faces; first += LANES) {
        const int8x32 j = lanes_count_from(first);
        const int8x32 counts =
            (j < (int32_t)look->ring.faces) & (j != (int32_t)gone[0]) & (j != (int32_t)gone[1]);
        const struct vec3x8 b =
            lanes_load3(look->at[0] + first, look->at[1] + first, look->at[2] + first);
        const struct vec3x8 c =
            lanes_load3(look->at[0] + first + 1, look->at[1] + first + 1, look->at[2] + first + 1);
        const struct fan_faces faces = {lanes_sub(b, top), lanes_sub(c, top),
                                        look->ring.faces < first + LANES};
        const float8 heights = heights_square(point, &faces);
        if (enough >= 0 && lanes_any(counts & (heights <= enough)))
            return enough;
        const float8 square = lanes_choose(heights < FAR, heights, edges_square(point, &faces));
        const int8x32 nearer = counts & (square < least);
        least = lanes_choose(nearer, square, least);
        places = (nearer & j) | (~nearer & places);
    }
    return least_lane(least, places, place);
}

static float nearest_scalar(const struct vertex_look *look, const float apex[3],
                            const uint32_t gone[2], const float p[3], float enough, uint32_t *place)
{
    return nearest_in_lanes(look, apex, gone, p, enough, place);
}

LANES_AVX2 static float nearest_avx2(const struct vertex_look *look, const float apex[3],
                                     const uint32_t gone[2], const float p[3], float enough,
                                     uint32_t *place)
{
    return nearest_in_lanes(look, apex, gone, p, enough, place);
}

static float nearest_square(const struct collapse *c, const struct vertex_look *look,
                            const float apex[3], const uint32_t gone[2], const float p[3],
                            float enough, uint32_t *place)
{
    return c->level >= CPU_AVX2 ? nearest_avx2(look, apex, gone, p, enough, place)
                                : nearest_scalar(look, apex, gone, p, enough, place);
}

static const float origin[3] = {0, 0, 0};
static const uint32_t none_gone[2] = {UINT32_MAX, UINT32_MAX};

/* ---- witnesses ---- */

void witness_set(struct collapse *c, uint32_t v, const float offset[3])
{
    for (int k = 0; k < 3; k++)
        c->vertices[v].witness[k] = half_from_float(offset[k] * c->unit);
}

void witness_get(const struct collapse *c, uint32_t v, float offset[3])
{
    for (int k = 0; k < 3; k++)
        offset[k] = float_from_half(c->vertices[v].witness[k]) / c->unit;
}

float offset_get(const struct collapse *c, uint32_t v)
{
    return float_from_half(c->vertices[v].offset) / c->unit;
}

void offset_set(struct collapse *c, uint32_t v, float offset)
{
    c->vertices[v].offset = half_from_float(offset * c->unit);
}

/* Squared distance of the point at `place` from the faces at v, round which *look is; infinite when
 * there are too many to look at. */
static float square_at(const struct collapse *c, uint32_t v, const struct vertex_look *look,
                       const float place[3], float enough)
{
    const float *from = c->vertices[v].position;
    const float p[3] = {place[0] - from[0], place[1] - from[1], place[2] - from[2]};
    return look->ring.count ? nearest_square(c, look, origin, none_gone, p, enough, NULL)
                            : INFINITY;
}

void vertex_look_freely(const struct collapse *c, uint32_t v, struct vertex_look *look)
{
    const struct territory whole = {.end = (uint32_t)c->vertex_slots};
    vertex_look_round(c, &whole, v, look);
}

/* The faces at v need not be the nearest any more, since its neighbours have moved, too: from there
 * it goes to the neighbour whose faces are nearer, as long as there is one. */
float vertex_square(const struct collapse *c, uint32_t v, const struct vertex_look *look,
                    const float place[3], float enough)
{
    struct vertex_look there, other;
    float nearest = square_at(c, v, look, place, enough);
    for (bool nearer = nearest < INFINITY; nearer && nearest > enough;) {
        nearer = false;
        for (uint32_t i = 0; i < look->ring.count && !nearer; i++) {
            const uint32_t w = look->ring.vertices[i];
            vertex_look_freely(c, w, &other);
            const float square = square_at(c, w, &other, place, enough);
            if (square >= nearest)
                continue;
            nearest = square;
            there = other;
            look = &there;
            nearer = true;
        }
    }
    return nearest;
}

double vertex_error(const struct collapse *c, uint32_t v, double enough)
{
    struct vertex_look look;
    float place[3];
    const double noted = fabs((double)offset_get(c, v));
    witness_get(c, v, place);
    for (int k = 0; k < 3; k++)
        place[k] += c->vertices[v].position[k];
    vertex_look_freely(c, v, &look);
    const float least = (float)(enough * enough);
    const float nearest = vertex_square(c, v, &look, place, least);
    return nearest > least && nearest < INFINITY ? fmax(noted, sqrt((double)nearest)) : noted;
}

/* ---- an edge ---- */

/* A point's place relative to the vertex at either end. */
struct point {
    float at[2][3];
};

static struct point point_at(const struct edge_change *change, int end, const float p[3])
{
    struct point point;
    for (int k = 0; k < 3; k++) {
        /* the edge, as the difference of the places that the new vertex has from both ends */
        const float edge = change->to[0][k] - change->to[1][k];
        point.at[0][k] = end == 0 ? p[k] : p[k] + edge;
        point.at[1][k] = end == 0 ? p[k] - edge : p[k];
    }
    return point;
}

/* From the faces that there will be, those at `first` before the others; below `enough` it need not
 * be exact. */
static float square_after(const struct collapse *c, const struct edge_change *change, int first,
                          const struct point *p, float enough)
{
    uint32_t gone[2];
    float nearest = FAR;
    for (int i = 0; i < 2 && nearest > enough; i++) {
        const int end = first ^ i;
        edge_faces_gone(change, end, gone);
        const float square =
            nearest_square(c, change->looks[end], change->to[end], gone, p->at[end], enough, NULL);
        nearest = square < nearest ? square : nearest;
    }
    return nearest;
}

/* A face beside the edge, by its place in the ring of one end. */
struct face_place {
    int end;
    uint32_t place;
};

/* From the faces that are there, likewise; *nearest (may be NULL): the nearest of them. */
static float square_before(const struct collapse *c, const struct edge_change *change, int first,
                           const struct point *p, float enough, struct face_place *nearest)
{
    float least = INFINITY;
    for (int i = 0; i < 2 && (i == 0 || least > enough); i++) {
        const int end = first ^ i;
        uint32_t place = 0;
        const float square = nearest_square(c, change->looks[end], origin, none_gone, p->at[end],
                                            nearest ? -1 : enough, nearest ? &place : NULL);
        if (!(square < least))
            continue;
        least = square;
        if (nearest)
            *nearest = (struct face_place){end, place};
    }
    return least;
}

/* How far the surface is in front of the original (behind: negative) at the new vertex: what it is
 * at its foot on the nearest of the faces that are there, and the way from the foot. */
static float offset_after(const struct collapse *c, const struct edge_change *change)
{
    struct face_place face = {0, 0};
    const struct point point = point_at(change, 0, change->to[0]);
    const float step = sqrtf(square_before(c, change, 0, &point, 0, &face));
    const struct vertex_look *look = change->looks[face.end];
    const uint32_t j = face.place, next = j + 1 < look->ring.count ? j + 1 : 0;
    const struct vec3 p = {(double)point.at[face.end][0], (double)point.at[face.end][1],
                           (double)point.at[face.end][2]};
    const struct triangle triangle = {
        {0, 0, 0},
        {(double)look->at[0][j], (double)look->at[1][j], (double)look->at[2][j]},
        {(double)look->at[0][next], (double)look->at[1][next], (double)look->at[2][next]}};
    const struct vec3 normal = vec3_cross(triangle.b, triangle.c);
    const double square = vec3_length_squared(normal);
    struct vec3 foot;
    (void)triangle_distance_squared(p, &triangle, &foot);
    double second = 0, third = 0;
    if (square > 0) {
        second = vec3_dot(vec3_cross(foot, triangle.c), normal) / square;
        third = vec3_dot(vec3_cross(triangle.b, foot), normal) / square;
        second = fmin(fmax(second, 0), 1);
        third = fmin(fmax(third, 0), 1 - second);
    }
    const double here = (double)offset_get(c, face.end ? change->w : change->v);
    const double left = (double)offset_get(c, look->ring.vertices[j]);
    const double right = (double)offset_get(c, look->ring.vertices[next]);
    const double before = here + second * (left - here) + third * (right - here);
    const bool in_front = vec3_dot(vec3_sub(p, foot), normal) >= 0;
    return (float)before + (in_front ? step : -step);
}

bool edge_is_rim(const struct collapse *c, const struct edge_change *change, int end, uint32_t j)
{
    const struct ring *ring = &change->looks[end]->ring;
    const uint32_t before = j > 0 ? j - 1 : ring->faces - 1;
    const float(*turned)[RING_LANES] = change->turned[end];
    float dot = 0, square = 0, square_before = 0;
    if ((c->vertices[change->v].flags | c->vertices[change->w].flags) &
        c->vertices[ring->vertices[j]].flags & VERTEX_BORDER)
        return true;
    for (int k = 0; k < 3; k++) {
        dot += turned[k][j] * turned[k][before];
        square += turned[k][j] * turned[k][j];
        square_before += turned[k][before] * turned[k][before];
    }
    /* one is 0 where a face goes */
    return square * square_before > 0 &&
           (dot <= 0 || dot * dot < RIM_COSINE * RIM_COSINE * square * square_before);
}

/* Of eight new edges, which the one to neighbour `first` begins: a bit for each. */
struct edge_bits {
    unsigned rims;   /* as edge_is_rim says, where nothing is on a border */
    unsigned turned; /* beside which a face's plane is farther than the bound */
};

/* What stands in front of eight of a ring's faces. */
LANES_INLINE float8 lanes_before(const float *of_faces, uint32_t first, uint32_t faces)
{
    if (first > 0)
        return lanes_load(of_faces + first - 1);
    const float8 v = lanes_load(of_faces);
    float8 before = __builtin_shufflevector(v, v, 7, 0, 1, 2, 3, 4, 5, 6);
    before[0] = of_faces[faces - 1];
    return before;
}

LANES_INLINE struct edge_bits look_at_edges(const struct edge_change *change, int end,
                                            uint32_t first, float bound)
{
    const struct ring *ring = &change->looks[end]->ring;
    const float(*turned)[RING_LANES] = change->turned[end];
    const float8 height = lanes_load(change->heights[end] + first);
    const float8 height_before = lanes_before(change->heights[end], first, ring->faces);
    struct vec3x8 n, before;
    n = lanes_load3(turned[0] + first, turned[1] + first, turned[2] + first);
    before.x = lanes_before(turned[0], first, ring->faces);
    before.y = lanes_before(turned[1], first, ring->faces);
    before.z = lanes_before(turned[2], first, ring->faces);
    const float8 dot = lanes_dot(n, before), square = lanes_dot(n, n);
    const float8 square_before = lanes_dot(before, before);
    const int8x32 is_edge = lanes_count_from(first) < (int32_t)ring->count;
    const int8x32 is_rim =
        (square * square_before > 0) &
        ((dot <= 0) | (dot * dot < RIM_COSINE * RIM_COSINE * square * square_before));
    return (struct edge_bits){lanes_bits(is_edge & is_rim),
                              lanes_bits(is_edge & ((height > bound) | (height_before > bound)))};
}

static struct edge_bits look_scalar(const struct edge_change *change, int end, uint32_t first,
                                    float bound)
{
    return look_at_edges(change, end, first, bound);
}

LANES_AVX2 static struct edge_bits look_avx2(const struct edge_change *change, int end,
                                             uint32_t first, float bound)
{
    return look_at_edges(change, end, first, bound);
}

/* The middle of a new edge: its squared distance from the faces that are there, if that is more
 * than `largest`, else that. */
static float middle_square(const struct collapse *c, const struct edge_change *change, int end,
                           uint32_t j, float largest)
{
    float middle[3];
    for (int k = 0; k < 3; k++)
        middle[k] = (change->looks[end]->at[k][j] + change->to[end][k]) / 2;
    const struct point point = point_at(change, end, middle);
    const float square = square_before(c, change, end, &point, largest, NULL);
    return square > largest ? square : largest;
}

/* The largest squared distance of the new edges' middles, where the faces beside turn, of those
 * eight; at least `largest`. */
static float square_between_eight(const struct collapse *c, const struct edge_change *change,
                                  int end, uint32_t first, float largest)
{
    const struct vertex_look *look = change->looks[end];
    const float *heights = change->heights[end];
    struct edge_bits bits = c->level >= CPU_AVX2 ? look_avx2(change, end, first, 4 * largest)
                                                 : look_scalar(change, end, first, 4 * largest);
    if ((change->looks[0]->flags | change->looks[1]->flags) & VERTEX_BORDER) {
        bits.rims = 0;
        for (uint32_t j = first; j < look->ring.count && j < first + LANES; j++)
            bits.rims |= (unsigned)edge_is_rim(c, change, end, j) << (j - first);
    }
    for (unsigned left = bits.rims | bits.turned; left != 0; left &= left - 1) {
        const uint32_t j = first + lowest_bit(left);
        const uint32_t before = j > 0 ? j - 1 : look->ring.faces - 1;
        if ((bits.rims >> (j - first) & 1) || heights[j] > 4 * largest ||
            heights[before] > 4 * largest)
            largest = middle_square(c, change, end, j, largest);
    }
    return largest;
}

/* Of all; 0 where that is not more than `enough`. */
static float square_between(const struct collapse *c, const struct edge_change *change,
                            float enough)
{
    float largest = enough;
    for (int end = 0; end < 2; end++)
        for (uint32_t first = 0; first < change->looks[end]->ring.count; first += LANES)
            largest = square_between_eight(c, change, end, first, largest);
    return largest > enough ? largest : 0;
}

/* Whether the witnesses of the vertices round the edge that are within `bound` stay so. */
bool edge_keeps_witnesses(const struct collapse *c, const struct edge_change *change, double bound)
{
    const float most = (float)(bound * bound);
    for (int end = 0; end < 2; end++) {
        const struct vertex_look *look = change->looks[end];
        for (uint32_t j = 0; j < look->ring.count; j++) {
            const uint32_t r = look->ring.vertices[j];
            float offset[3];
            if (r == change->v || r == change->w)
                continue;
            witness_get(c, r, offset);
            for (int k = 0; k < 3; k++)
                offset[k] += look->at[k][j];
            const struct point point = point_at(change, end, offset);
            if (square_after(c, change, end, &point, most) > most &&
                square_before(c, change, end, &point, most, NULL) <= most)
                return false;
        }
    }
    return true;
}

void edge_guess_error(const struct collapse *c, const struct edge_change *change,
                      struct edge_error *error)
{
    const struct fan *fans[2] = {&c->vertices[change->v].fan, &c->vertices[change->w].fan};
    float largest = -1;
    for (int end = 0; end < 2; end++) {
        float offset[3], height = 0;
        witness_get(c, end ? change->w : change->v, offset);
        for (int k = 0; k < 3; k++) {
            offset[k] -= change->to[end][k];
            height += offset[k] * (fans[0]->normal[k] + fans[1]->normal[k]);
        }
        if (fabsf(height) <= largest)
            continue;
        largest = fabsf(height);
        memcpy(error->witness, offset, sizeof offset);
    }
    error->forward = error->between = 0;
    error->offset = (offset_get(c, change->v) + offset_get(c, change->w)) / 2;
}

float edge_square_after(const struct collapse *c, const struct edge_change *change, int end,
                        const float p[3], float enough)
{
    const struct point point = point_at(change, end, p);
    return square_after(c, change, end, &point, enough);
}

float edge_square_before(const struct collapse *c, const struct edge_change *change, int end,
                         const float p[3], float enough)
{
    const struct point point = point_at(change, end, p);
    return square_before(c, change, end, &point, enough, NULL);
}

void edge_find_error(const struct collapse *c, const struct edge_change *change, double enough,
                     double most, struct edge_error *error)
{
    float largest = -1;
    for (int i = 0; i < 4; i++) {
        const int end = i & 1;
        const uint32_t u = end ? change->w : change->v;
        float offset[3];
        witness_get(c, u, offset);
        if (i >= 2) {
            /* The vertex itself, where something else is its witness. On a border always: that
             * moves back without a face that tells. */
            if (!(c->vertices[u].flags & VERTEX_BORDER) && offset[0] == 0 && offset[1] == 0 &&
                offset[2] == 0)
                continue;
            offset[0] = offset[1] = offset[2] = 0;
        }
        const struct point point = point_at(change, end, offset);
        const float square = square_after(c, change, end, &point, largest);
        if (square <= largest)
            continue;
        largest = square;
        for (int k = 0; k < 3; k++)
            error->witness[k] = point.at[0][k] - change->to[0][k];
    }
    error->forward = sqrt((double)largest);
    error->offset = 0;
    error->between = 0;
    if (error->forward > most)
        return;
    const float bound = (float)(enough * enough);
    error->offset = offset_after(c, change);
    error->between = sqrt((double)square_between(c, change, bound));
}
