/*
 * Positions of a draft as the store will hold them, and what is measured on them.
 */
#ifndef SPBM_MESH_SLAB_GEOMETRY_H
#define SPBM_MESH_SLAB_GEOMETRY_H

#include "mesh/draft.h"

/* Where the mesh lies, and how positions are stored: origin + float32. */
struct frame {
    double low[3]; /* box of all vertices that are used */
    double high[3];
    double origin[3]; /* 0 if all coordinates are float32, else the middle of the box */
};

/* STATUS_BAD_INPUT if float32 around the origin can't hold the mesh to 2^-24 of its extent. */
enum status frame_find(const struct draft *draft, struct frame *frame) MUST_CHECK;

/* Stored position of vertex v of the draft. */
static inline void frame_position(const struct frame *frame, const struct draft *draft, uint64_t v,
                                  float out[3])
{
    double p[3];
    draft_position(draft, v, p);
    for (int i = 0; i < 3; i++)
        out[i] = (float)(p[i] - frame->origin[i]);
}

/* Sums of one slab; sums of slabs are added in their order, so that they are the same always. */
struct slab_measures {
    double area;
    double edge_length; /* each edge once, at its lower face */
    uint64_t edge_count;
    double noise_squares; /* squared distances, see measure_slab */
    uint64_t noise_count;
    uint64_t zero_area_faces;
};

/*
 * Measures a slab whose own and foreign positions are given. For the noise up to NOISE_SAMPLES
 * faces of a single slab, or NOISE_SAMPLES_OF_MANY of one of several, evenly spaced, each give the
 * vertex of their first corner, if its fan is closed, lies in the slab and has at most
 * NOISE_FAN_MAX faces: the distance of the vertex from the mean of its neighbours, along the sum of
 * the fan's face normals (weighted by area).
 */
enum { NOISE_SAMPLES = 4096, NOISE_SAMPLES_OF_MANY = 1024, NOISE_FAN_MAX = 64 };
void measure_slab(const struct draft *draft, const struct slab_scope *scope, const float *own,
                  const float *foreign, struct slab_measures *measures);

void measures_add(struct slab_measures *sum, const struct slab_measures *slab);
double measures_mean_edge(const struct slab_measures *sum);
double measures_noise(const struct slab_measures *sum); /* relative to the mean edge */

#endif
