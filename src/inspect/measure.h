/*
 * Distances between two surfaces, both ways, and how their normals differ (issue: `spbm measure`).
 *
 * The original is streamed (mesh file or store, any size), the simplified mesh is held with a
 * bounding volume hierarchy; back, samples of the simplified mesh look for the original.
 */
#ifndef SPBM_INSPECT_MEASURE_H
#define SPBM_INSPECT_MEASURE_H

#include "inspect/quality.h"
#include "mesh/export.h"

struct deviation {
    double largest, mean, rms; /* lengths */
    uint64_t samples;
};

struct measurement {
    struct deviation forward;  /* from the original to the simplified mesh, area-weighted */
    struct deviation backward; /* from the simplified mesh to the original */
    double hausdorff;          /* the larger of both maxima */
    double diagonal;           /* of the original's bounding box */
    double normal_mean, normal_largest; /* degrees, at the backward samples */
    double samples_per_face;            /* of the simplified mesh */
    uint64_t flipped_faces; /* their normal is more than 90 degrees from those of the original's
                               nearest faces, on average over the face's samples */
    uint64_t self_intersecting_faces; /* they cross another face, or lie folded on a neighbour */
    struct quality original, simplified;
    float *vertex_error; /* distance of each vertex of the simplified mesh from the original (0
                            where no face uses it); owned */
    float *face_error;   /* mean distance of the samples on each of its faces; owned */
    uint64_t vertex_error_count, face_error_count;
};

struct measure_options {
    uint32_t samples_per_face; /* at least; 0: the default 10, and 100,000 in all */
    bool self_intersections;   /* look for them */
};

/*
 * Samples: backward, every vertex and at least samples_per_face points a face, more on large
 * faces; forward, every vertex of the original and as many points by area as backward, at least one
 * a face of the original on average. Vertices count for the maxima only, means weigh by area.
 * Degenerate faces count as what they are, segments and points.
 *
 * `original`: mesh file or store, read once; `simplified`: the same, held. *mesh becomes the
 * simplified mesh, for pictures and measure_save; the caller clears both. On failure there is
 * nothing to clear.
 */
enum status measure(struct context *ctx, const char *original, const char *simplified,
                    const struct measure_options *options, struct measurement *result,
                    struct mesh *mesh) MUST_CHECK;
void measurement_clear(struct context *ctx, struct measurement *result);

/* Writes the simplified mesh with its error as vertex property `quality` (float): the larger of the
 * vertex's own distance and the mean distance of the faces round it (a vertex may lie on the
 * original where its faces do not); and as colours red, green, blue, from 0 to
 * what all but the worst hundredth of the faces stay below. The mesh's own attributes are left out.
 */
enum status measure_save(struct context *ctx, const char *path,
                         const struct export_options *options, const struct measurement *result,
                         const struct mesh *mesh) MUST_CHECK;

#endif
