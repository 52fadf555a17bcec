/*
 * A face's normal is asked for about four times while patches grow. Computed on the spot, each time
 * costs three vertices, a root and a division; so they are made once, in face order, and kept with
 * the area in one record of 16 bytes.
 *
 * All sums are taken in a fixed order (the face itself, then its edges 0, 1, 2) and from the last
 * round's values only, so that the result depends on the slab alone.
 */
#include "simplify/face_normals.h"

#include <math.h>
#include <string.h>

#include "base/lanes.h"

/* A face is of zero area when the square of the sine of its first corner's angle is below this:
 * some 100 times the rounding error of the cross product in double precision. */
static const double zero_sine_squared = 1e-28;

/* Extremes of `count` values, three coordinates in turn: of four vertices at a time, which are
 * three vectors. */
static void find_box(const float *values, size_t count, float low[3], float high[3])
{
    float lows[12], highs[12];
    for (unsigned i = 0; i < 12; i++)
        lows[i] = highs[i] = values[i % 3];
    size_t at = 0;
    if (count >= 12) {
        float4 least[3], most[3];
        memcpy(least, values, sizeof least);
        memcpy(most, values, sizeof most);
        for (; at + 12 <= count; at += 12)
            for (unsigned i = 0; i < 3; i++) {
                float4 x;
                memcpy(&x, values + at + 4 * (size_t)i, sizeof x);
                least[i] = float4_choose(x < least[i], x, least[i]);
                most[i] = float4_choose(x > most[i], x, most[i]);
            }
        for (unsigned i = 0; i < 3; i++) {
            float4_store(lows + 4 * (size_t)i, least[i]);
            float4_store(highs + 4 * (size_t)i, most[i]);
        }
    }
    for (; at < count; at++) {
        lows[at % 3] = fminf(values[at], lows[at % 3]);
        highs[at % 3] = fmaxf(values[at], highs[at % 3]);
    }
    for (unsigned i = 0; i < 12; i++) {
        low[i % 3] = i < 3 ? lows[i] : fminf(low[i % 3], lows[i]);
        high[i % 3] = i < 3 ? highs[i] : fmaxf(high[i % 3], highs[i]);
    }
}

/* The power of two by which areas are scaled: 2^40 4^-e for a slab of largest extent 2^e. Exponents
 * are read from the bits, so that the scale is exact whatever the unit of length. */
static double area_scale(const struct slab_local *local)
{
    float low[3], high[3];
    if (local->vertex_count == 0)
        return 1;
    find_box(local->positions, 3 * (size_t)local->vertex_count, low, high);
    double extent = 0;
    for (unsigned c = 0; c < 3; c++) {
        double side = (double)high[c] - (double)low[c];
        extent = side > extent ? side : extent;
    }
    if (extent == 0)
        return 1;
    uint64_t bits;
    memcpy(&bits, &extent, sizeof bits);
    uint64_t exponent = bits >> 52; /* biased by 1023; float differences are never subnormal here */
    bits = (2 * 1023 - exponent) << 52;
    double inverse;
    memcpy(&inverse, &bits, sizeof inverse);
    return 0x1p40 * inverse * inverse;
}

/* ---- faces' own normals ---- */

/* Faces whose roots and divisions are made together; a multiple of four. */
enum { BATCH = 64 };

struct batch {
    double cross[3][BATCH]; /* of two edges of a face; then the normal */
    double square[BATCH];   /* of its length; then the area */
    double edges[BATCH];    /* the product of the two edges' squares */
};

/* Corner k of four faces, in doubles. */
LANES_INLINE void load_corners(const struct slab_local *local, const uint32_t faces[4], unsigned k,
                               double4 to[3])
{
    float4 rows[4];
    for (unsigned i = 0; i < 4; i++) {
        const uint32_t vertex = face_vertex(local, faces[i], k);
        memcpy(&rows[i], local->positions + 3 * (size_t)vertex, sizeof rows[i]);
    }
    float4_transpose(rows);
    for (unsigned c = 0; c < 3; c++)
        to[c] = __builtin_convertvector(rows[c], double4);
}

/* Faces i to i + 3 of a batch. */
LANES_INLINE void cross_four(const struct slab_local *local, const uint32_t faces[4], uint32_t i,
                             struct batch *batch)
{
    double4 a[3], u[3], v[3];
    load_corners(local, faces, 1, a);
    load_corners(local, faces, 2, u);
    load_corners(local, faces, 0, v);
    for (unsigned c = 0; c < 3; c++) {
        u[c] -= a[c];
        v[c] -= a[c];
    }
    const double4 x = u[1] * v[2] - u[2] * v[1], y = u[2] * v[0] - u[0] * v[2],
                  z = u[0] * v[1] - u[1] * v[0];
    const double4 square = x * x + y * y + z * z;
    const double4 edges =
        (u[0] * u[0] + u[1] * u[1] + u[2] * u[2]) * (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    memcpy(batch->cross[0] + i, &x, sizeof x);
    memcpy(batch->cross[1] + i, &y, sizeof y);
    memcpy(batch->cross[2] + i, &z, sizeof z);
    memcpy(batch->square + i, &square, sizeof square);
    memcpy(batch->edges + i, &edges, sizeof edges);
}

/* From cross products to unit normals and areas; true when there is a face of zero area. */
LANES_INLINE bool normalise_batch(struct batch *batch, double half_scale)
{
    double zeros = 0;
    for (uint32_t i = 0; i < BATCH; i++) {
        const bool is_zero = batch->square[i] <= zero_sine_squared * batch->edges[i];
        const double length = sqrt(batch->square[i]), inverse = 1 / length;
        batch->cross[0][i] = is_zero ? 0 : batch->cross[0][i] * inverse;
        batch->cross[1][i] = is_zero ? 0 : batch->cross[1][i] * inverse;
        batch->cross[2][i] = is_zero ? 0 : batch->cross[2][i] * inverse;
        batch->square[i] = is_zero ? 0 : length * half_scale;
        zeros = is_zero ? 1 : zeros;
    }
    return zeros > 0;
}

LANES_INLINE void store_four(const struct batch *batch, uint32_t i, uint32_t count, float *normals)
{
    float4 rows[4];
    for (unsigned c = 0; c < 4; c++) {
        double4 values;
        memcpy(&values, (c < 3 ? batch->cross[c] : batch->square) + i, sizeof values);
        rows[c] = __builtin_convertvector(values, float4);
    }
    float4_transpose(rows);
    for (unsigned k = 0; k < 4 && i + k < count; k++)
        float4_store(normals + NORMAL_STRIDE * (size_t)k, rows[k]);
}

/* One normal a face; a face of zero area gets all zeros. True when there are any. */
LANES_INLINE bool raw_normals(const struct slab_local *local, double scale, float *normals)
{
    bool any_zero = false;
    struct batch batch;
    for (uint32_t first = 0; first < local->face_count; first += BATCH) {
        const uint32_t left = local->face_count - first;
        const uint32_t count = left < BATCH ? left : BATCH;
        for (uint32_t i = 0; i < BATCH; i += 4) {
            uint32_t faces[4];
            for (uint32_t k = 0; k < 4; k++) /* at the end, the last one again and again */
                faces[k] = first + (i + k < count ? i + k : count - 1);
            cross_four(local, faces, i, &batch);
        }
        any_zero |= normalise_batch(&batch, 0.5 * scale);
        for (uint32_t i = 0; i < count; i += 4)
            store_four(&batch, i, count, normals + NORMAL_STRIDE * (size_t)(first + i));
    }
    return any_zero;
}

static bool raw_normals_scalar(const struct slab_local *local, double scale, float *normals)
{
    return raw_normals(local, scale, normals);
}

LANES_AVX2 static bool raw_normals_avx2(const struct slab_local *local, double scale,
                                        float *normals)
{
    return raw_normals(local, scale, normals);
}

static bool is_undefined(const float *normal)
{
    return normal[0] == 0 && normal[1] == 0 && normal[2] == 0;
}

/* Writes the normalised vector, or leaves `normal` as it is when the vector has no direction. */
static bool normalise_into(double x, double y, double z, float *normal)
{
    double length2 = x * x + y * y + z * z;
    if (length2 < 1e-12)
        return false;
    double inverse = 1 / sqrt(length2);
    normal[0] = (float)(x * inverse);
    normal[1] = (float)(y * inverse);
    normal[2] = (float)(z * inverse);
    return true;
}

/* Sum of the defined normals over face f's edges; false when there are none. */
static bool neighbour_sum(const struct slab_local *local, const float *normals, uint32_t f,
                          double sum[3])
{
    bool any = false;
    sum[0] = sum[1] = sum[2] = 0;
    for (unsigned k = 0; k < 3; k++) {
        const float *normal = normals + NORMAL_STRIDE * (size_t)link_face(face_link(local, f, k));
        if (is_undefined(normal)) /* as are those beyond the slab */
            continue;
        any = true;
        for (unsigned c = 0; c < 3; c++)
            sum[c] += normal[c];
    }
    return any;
}

/*
 * Gives the zero-area faces their neighbours' normals, spreading breadth-first from the faces that
 * have one: linear, however long a strip of them is.
 */
static void spread_normals(const struct slab_local *local, float *normals, float *spare)
{
    /* `spare` serves as the search's queue. At most three neighbours put a face there besides the
     * start, so its NORMAL_STRIDE slots a face are enough. */
    uint32_t *order = (uint32_t *)(void *)spare;
    uint32_t head = 0, tail = 0;
    double sum[3];
    for (uint32_t f = 0; f < local->face_count; f++)
        if (is_undefined(normals + NORMAL_STRIDE * (size_t)f) &&
            neighbour_sum(local, normals, f, sum))
            order[tail++] = f;
    while (head < tail) {
        uint32_t f = order[head++];
        float *normal = normals + NORMAL_STRIDE * (size_t)f;
        if (!is_undefined(normal) || !neighbour_sum(local, normals, f, sum))
            continue;
        if (!normalise_into(sum[0], sum[1], sum[2], normal))
            normal[2] = 1; /* its neighbours cancel out: any will do */
        for (unsigned k = 0; k < 3; k++) {
            const uint32_t other = link_face(face_link(local, f, k));
            if (other < local->face_count && is_undefined(normals + NORMAL_STRIDE * (size_t)other))
                order[tail++] = other;
        }
    }
    for (uint32_t f = 0; f < local->face_count; f++) {
        float *normal = normals + NORMAL_STRIDE * (size_t)f;
        if (is_undefined(normal))
            normal[2] = 1;
    }
}

/* The sum of a face's normal and its edge neighbours'. */
static inline float4 sum_round(const struct slab_local *local, const float *from, size_t f)
{
    const uint32_t *face = local->faces + FACE_STRIDE * f;
    return float4_load(from + NORMAL_STRIDE * f) + link_normal(from, face[5]) +
           link_normal(from, face[1]) + link_normal(from, face[3]);
}

/* A normal, and the area of another. (A shuffle of both is eight instructions with gcc 12.) */
static inline float4 with_area(float4 normal, float4 other)
{
    const int4 is_normal = {-1, -1, -1, 0};
    return float4_choose(is_normal, normal, other);
}

/* Four faces from f on, whose roots and divisions are made together; where normals cancel out, the
 * face keeps its own. */
static inline void smooth_four(const struct slab_local *local, const float *from, size_t f,
                               float *to)
{
    float4 sums[4], squares[4];
    for (unsigned i = 0; i < 4; i++) {
        sums[i] = sum_round(local, from, f + i);
        squares[i] = sums[i] * sums[i];
    }
    float4_transpose(squares);
    const float4 length2 = squares[0] + squares[1] + squares[2];
    float4 inverse = length2;
    for (unsigned i = 0; i < 4; i++)
        inverse[i] = sqrtf(inverse[i]);
    inverse = 1 / inverse;
    const unsigned cancel_out = float4_bits((float4)(length2 < 1e-6f));
    for (unsigned i = 0; i < 4; i++) {
        const float4 own = float4_load(from + NORMAL_STRIDE * (f + i));
        const float4 result = with_area(sums[i] * inverse[i], own);
        float4_store(to + NORMAL_STRIDE * (f + i), cancel_out >> i & 1 ? own : result);
    }
}

static void smooth_once(const struct slab_local *local, const float *from, float *to)
{
    size_t f = 0;
    for (; f + 4 <= local->face_count; f += 4)
        smooth_four(local, from, f, to);
    for (; f < local->face_count; f++) {
        const float4 own = float4_load(from + NORMAL_STRIDE * f), sum = sum_round(local, from, f);
        const float length2 = float4_sum3(sum * sum);
        const float4 result = with_area(sum * (1 / sqrtf(length2)), own);
        float4_store(to + NORMAL_STRIDE * f, length2 < 1e-6f ? own : result);
    }
}
double face_normals_fill(enum cpu_level level, const struct slab_local *local, uint32_t smoothings,
                         float **normals, float **spare)
{
    size_t beyond = NORMAL_STRIDE * (size_t)local->face_count;
    double scale = area_scale(local);
    memset(*normals + beyond, 0, BEYOND_COUNT * NORMAL_STRIDE * sizeof **normals);
    if (level >= CPU_AVX2 ? raw_normals_avx2(local, scale, *normals)
                          : raw_normals_scalar(local, scale, *normals))
        spread_normals(local, *normals, *spare);
    memset(*spare + beyond, 0, BEYOND_COUNT * NORMAL_STRIDE * sizeof **spare);
    for (uint32_t i = 0; i < smoothings; i++) {
        smooth_once(local, *normals, *spare);
        float *swap = *normals;
        *normals = *spare;
        *spare = swap;
    }
    return 1 / scale;
}
