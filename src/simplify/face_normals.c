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

#include "simplify/float4.h"

/* A face is of zero area when the square of the sine of its first corner's angle is below this:
 * some 100 times the rounding error of the cross product in double precision. */
static const double zero_sine_squared = 1e-28;

/* The power of two by which areas are scaled: 2^40 4^-e for a slab of largest extent 2^e. Exponents
 * are read from the bits, so that the scale is exact whatever the unit of length. */
static double area_scale(const struct slab_local *local)
{
    float low[3], high[3];
    if (local->vertex_count == 0)
        return 1;
    memcpy(low, local->positions, sizeof low);
    memcpy(high, local->positions, sizeof high);
    for (size_t v = 1; v < local->vertex_count; v++) {
        for (unsigned c = 0; c < 3; c++) {
            float x = local->positions[3 * v + c];
            low[c] = x < low[c] ? x : low[c];
            high[c] = x > high[c] ? x : high[c];
        }
    }
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

/* One normal a face; a face of zero area gets all zeros. True when there are any. */
static bool raw_normals(const struct slab_local *local, double scale, float *normals)
{
    const float *positions = local->positions;
    double half_scale = 0.5 * scale;
    bool any_zero = false;
    for (uint32_t f = 0; f < local->face_count; f++) {
        const uint32_t *apex = local->faces + FACE_STRIDE * (size_t)f;
        const float *a = positions + 3 * (size_t)apex[1];
        const float *b = positions + 3 * (size_t)apex[2];
        const float *c = positions + 3 * (size_t)apex[0];
        double ux = (double)b[0] - a[0], uy = (double)b[1] - a[1], uz = (double)b[2] - a[2];
        double vx = (double)c[0] - a[0], vy = (double)c[1] - a[1], vz = (double)c[2] - a[2];
        double x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
        double length2 = x * x + y * y + z * z;
        double u2 = ux * ux + uy * uy + uz * uz, v2 = vx * vx + vy * vy + vz * vz;
        float *normal = normals + NORMAL_STRIDE * (size_t)f;
        if (length2 <= zero_sine_squared * (u2 * v2)) {
            memset(normal, 0, NORMAL_STRIDE * sizeof *normal);
            any_zero = true;
            continue;
        }
        double length = sqrt(length2);
        double inverse = 1 / length;
        normal[0] = (float)(x * inverse);
        normal[1] = (float)(y * inverse);
        normal[2] = (float)(z * inverse);
        normal[3] = (float)(length * half_scale);
    }
    return any_zero;
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
        uint32_t link = local->links[FACE_STRIDE * (size_t)f + k];
        const float *normal = normals + (link & ~3u);
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
            uint32_t link = local->links[FACE_STRIDE * (size_t)f + k];
            if (link >> 2 < local->face_count && is_undefined(normals + (link & ~3u)))
                order[tail++] = link >> 2;
        }
    }
    for (uint32_t f = 0; f < local->face_count; f++) {
        float *normal = normals + NORMAL_STRIDE * (size_t)f;
        if (is_undefined(normal))
            normal[2] = 1;
    }
}

static void smooth_once(const struct slab_local *local, const float *from, float *to)
{
    for (uint32_t f = 0; f < local->face_count; f++) {
        const size_t at = NORMAL_STRIDE * (size_t)f;
        const uint32_t *links = local->links + at;
        const float4 own = float4_load(from + at);
        const float4 sum = own + float4_load(from + (links[0] & ~3u)) +
                           float4_load(from + (links[1] & ~3u)) +
                           float4_load(from + (links[2] & ~3u));
        const float length2 = float4_sum3(sum * sum);
        const float inverse = 1 / sqrtf(length2);
        float4 result = sum * inverse;
        result[3] = own[3];
        float4_store(to + at, length2 < 1e-6f ? own : result); /* they cancel out: its own */
    }
}

double face_normals_fill(const struct slab_local *local, uint32_t smoothings, float **normals,
                         float **spare)
{
    size_t beyond = NORMAL_STRIDE * (size_t)local->face_count;
    double scale = area_scale(local);
    memset(*normals + beyond, 0, BEYOND_COUNT * NORMAL_STRIDE * sizeof **normals);
    if (raw_normals(local, scale, *normals))
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
