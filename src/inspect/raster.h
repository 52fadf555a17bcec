/*
 * Which face is seen where: a z-buffer over a band of a picture's rows, with SAMPLES x SAMPLES
 * samples a pixel.
 */
#ifndef SPBM_INSPECT_RASTER_H
#define SPBM_INSPECT_RASTER_H

#include "base/report.h"

enum { RASTER_SAMPLES = 4, RASTER_BAND = 32 /* rows of pixels */ };

/* A vertex on the screen: x, y in samples (y down), and 1 / its distance from the eye's plane,
 * which is linear on the screen. */
struct screen_vertex {
    float x, y, nearness;
};

/* Faces seen by bands: those of band b are faces[first[b]] to faces[first[b + 1] - 1], ascending.
 */
struct raster_bins {
    uint32_t band_count;
    uint64_t *first;
    uint32_t *faces;
    uint64_t face_capacity;
};

enum status raster_bin(struct context *ctx, const struct screen_vertex *vertices,
                       const uint32_t *faces, uint64_t face_count, uint32_t height,
                       struct raster_bins *bins) MUST_CHECK;
void raster_bins_clear(struct context *ctx, struct raster_bins *bins);

struct raster_band {
    uint32_t width; /* samples a row */
    uint32_t rows;  /* of samples */
    uint32_t top;   /* first row of samples */
    float *nearness;
    uint32_t *face; /* NO_INDEX: nothing */
};

enum status raster_band_create(struct context *ctx, uint32_t width,
                               struct raster_band *band) MUST_CHECK;
void raster_band_clear(struct context *ctx, struct raster_band *band);

/* Clears the band and draws the faces of bin `index` into it. */
void raster_draw(const struct screen_vertex *vertices, const uint32_t *faces,
                 const struct raster_bins *bins, uint32_t index, struct raster_band *band);

#endif
