/*
 * A z-buffer of a whole picture at 16 samples a pixel takes 128 bytes a pixel. Bands of a few rows
 * are drawn one after the other instead (or several at once, by threads); a counting sort tells
 * each band its faces, so every face is looked at once or twice, not once a band.
 *
 * A sample belongs to a face when it is on the inner side of, or on, all three edges: neighbours
 * leave no holes between them. Of equally near faces the lower number stays.
 */
#include "inspect/raster.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "mesh/corner.h"

enum { BAND_ROWS = RASTER_BAND * RASTER_SAMPLES };

/* The bands [*from, *to) that a face touches, whatever its place. */
static void bands_of(const struct screen_vertex *vertices, const uint32_t *corner,
                     uint32_t band_count, uint32_t *from, uint32_t *to)
{
    float a = vertices[corner[0]].y, b = vertices[corner[1]].y, c = vertices[corner[2]].y;
    float low = fminf(fminf(a, b), c), high = fmaxf(fmaxf(a, b), c);
    float last = (float)band_count;
    float first_band = floorf((low - 1) / BAND_ROWS), end_band = floorf((high + 1) / BAND_ROWS) + 1;
    *from = first_band > 0 ? first_band < last ? (uint32_t)first_band : band_count : 0;
    *to = end_band > 0 ? end_band < last ? (uint32_t)end_band : band_count : 0;
}

enum status raster_bin(struct context *ctx, const struct screen_vertex *vertices,
                       const uint32_t *faces, uint64_t face_count, uint32_t height,
                       struct raster_bins *bins)
{
    memset(bins, 0, sizeof *bins);
    bins->band_count = (height + (RASTER_BAND - 1)) / RASTER_BAND;
    enum status status =
        memory_take_zeroed(ctx, (size_t)bins->band_count + 1, sizeof *bins->first, &bins->first);
    if (status != STATUS_OK)
        return status;
    uint32_t from, to;
    for (uint64_t f = 0; f < face_count; f++) {
        bands_of(vertices, faces + 3 * f, bins->band_count, &from, &to);
        for (uint32_t band = from; band < to; band++)
            bins->first[band + 1]++;
    }
    for (uint32_t band = 0; band < bins->band_count; band++)
        bins->first[band + 1] += bins->first[band];
    bins->face_capacity = bins->first[bins->band_count];
    status = memory_take(ctx, (size_t)bins->face_capacity, sizeof *bins->faces, &bins->faces);
    if (status != STATUS_OK)
        return status;
    for (uint64_t f = 0; f < face_count; f++) {
        bands_of(vertices, faces + 3 * f, bins->band_count, &from, &to);
        for (uint32_t band = from; band < to; band++)
            bins->faces[bins->first[band]++] = (uint32_t)f;
    }
    /* Each start has moved to the next band's: move them back. */
    memmove(bins->first + 1, bins->first, bins->band_count * sizeof *bins->first);
    bins->first[0] = 0;
    return STATUS_OK;
}

void raster_bins_clear(struct context *ctx, struct raster_bins *bins)
{
    memory_release(ctx, &bins->faces, (size_t)bins->face_capacity, sizeof *bins->faces);
    memory_release(ctx, &bins->first, (size_t)bins->band_count + 1, sizeof *bins->first);
    memset(bins, 0, sizeof *bins);
}

enum status raster_band_create(struct context *ctx, uint32_t width, struct raster_band *band)
{
    *band = (struct raster_band){.width = width * RASTER_SAMPLES, .rows = BAND_ROWS};
    size_t samples = (size_t)band->width * BAND_ROWS;
    enum status status = memory_take(ctx, samples, sizeof *band->nearness, &band->nearness);
    if (status == STATUS_OK)
        status = memory_take(ctx, samples, sizeof *band->face, &band->face);
    return status;
}

void raster_band_clear(struct context *ctx, struct raster_band *band)
{
    size_t samples = (size_t)band->width * BAND_ROWS;
    memory_release(ctx, &band->nearness, samples, sizeof *band->nearness);
    memory_release(ctx, &band->face, samples, sizeof *band->face);
    memset(band, 0, sizeof *band);
}

static double twice_area(const struct screen_vertex *a, const struct screen_vertex *b, double x,
                         double y)
{
    return ((double)b->x - (double)a->x) * (y - (double)a->y) -
           ((double)b->y - (double)a->y) * (x - (double)a->x);
}

static uint32_t clamp_sample(float value, uint32_t limit)
{
    return value > 0 ? value < (float)limit ? (uint32_t)value : limit : 0;
}

static void draw_face(const struct screen_vertex *vertices, const uint32_t *corner, uint32_t face,
                      struct raster_band *band)
{
    const struct screen_vertex *a = &vertices[corner[0]], *b = &vertices[corner[1]],
                               *c = &vertices[corner[2]];
    float top = (float)band->top;
    /* Samples are at whole numbers and a half. */
    uint32_t x0 = clamp_sample(floorf(fminf(fminf(a->x, b->x), c->x)), band->width);
    uint32_t x1 = clamp_sample(floorf(fmaxf(fmaxf(a->x, b->x), c->x)) + 1, band->width);
    uint32_t y0 = clamp_sample(floorf(fminf(fminf(a->y, b->y), c->y)) - top, band->rows);
    uint32_t y1 = clamp_sample(floorf(fmaxf(fmaxf(a->y, b->y), c->y)) + 1 - top, band->rows);
    double area = twice_area(a, b, (double)c->x, (double)c->y);
    if (area == 0 || x0 >= x1 || y0 >= y1)
        return;
    double sign = area > 0 ? 1 : -1, size = area * sign;
    double start_x = x0 + 0.5, start_y = (double)band->top + y0 + 0.5;
    /* Weights (times the area) of the three corners, and their steps to the right and down. */
    double weight_a = sign * twice_area(b, c, start_x, start_y);
    double weight_b = sign * twice_area(c, a, start_x, start_y);
    double weight_c = sign * twice_area(a, b, start_x, start_y);
    double right_a = sign * ((double)b->y - (double)c->y),
           down_a = sign * ((double)c->x - (double)b->x);
    double right_b = sign * ((double)c->y - (double)a->y),
           down_b = sign * ((double)a->x - (double)c->x);
    double right_c = sign * ((double)a->y - (double)b->y),
           down_c = sign * ((double)b->x - (double)a->x);
    double near_a = (double)a->nearness / size, near_b = (double)b->nearness / size;
    double near_c = (double)c->nearness / size;

    for (uint32_t y = y0; y < y1; y++) {
        double wa = weight_a, wb = weight_b, wc = weight_c;
        size_t row = (size_t)y * band->width;
        for (uint32_t x = x0; x < x1; x++) {
            if (wa >= 0 && wb >= 0 && wc >= 0) {
                float nearness = (float)(wa * near_a + wb * near_b + wc * near_c);
                if (nearness > band->nearness[row + x]) {
                    band->nearness[row + x] = nearness;
                    band->face[row + x] = face;
                }
            }
            wa += right_a;
            wb += right_b;
            wc += right_c;
        }
        weight_a += down_a;
        weight_b += down_b;
        weight_c += down_c;
    }
}

void raster_draw(const struct screen_vertex *vertices, const uint32_t *faces,
                 const struct raster_bins *bins, uint32_t index, struct raster_band *band)
{
    size_t samples = (size_t)band->width * band->rows;
    band->top = index * BAND_ROWS;
    memset(band->nearness, 0, samples * sizeof *band->nearness);
    memset(band->face, 0xff, samples * sizeof *band->face);
    for (uint64_t i = bins->first[index]; i < bins->first[index + 1]; i++) {
        uint32_t face = bins->faces[i];
        draw_face(vertices, faces + 3 * (size_t)face, face, band);
    }
}
