/*
 * The face normals that patches grow by: cached, smoothed within the slab, weighted by area
 * (dissertation, section 4.2.3; averaging neighbours' normals as in section 4.2.1).
 */
#ifndef SPBM_SIMPLIFY_FACE_NORMALS_H
#define SPBM_SIMPLIFY_FACE_NORMALS_H

#include "base/cpu.h"
#include "base/float4.h"
#include "simplify/slab_local.h"

/* Four floats a face, on a multiple of 16 bytes: the
 * unit normal, then the face's area in units of a power of two, some 2^-40 of the slab's squared
 * extent, so that squares of the smallest areas and of the sum of all are floats. */
enum { NORMAL_STRIDE = 4 };

/* Of the face that a link leads to: with one operation on the link, which is why it counts bytes.
 */
static inline float4 link_normal(const float *normals, uint32_t link)
{
    const unsigned char *bytes = (const unsigned char *)normals + 2 * (size_t)(link & ~7u);
    return float4_load((const float *)(const void *)bytes);
}

/*
 * Fills *normals (NORMAL_STRIDE floats a face, and zeros for the BEYOND_COUNT entries behind them).
 * A face of zero area takes the mean of its edge neighbours' normals, as near as there are any in
 * the slab, else (0, 0, 1). Then `smoothings` times each normal becomes the normalised sum of
 * itself and those of its edge neighbours in the slab. Returns the factor by which the areas in
 * there are to be multiplied. *spare is as large as *normals, and the two may have changed places
 * afterwards.
 */
double face_normals_fill(enum cpu_level level, const struct slab_local *local, uint32_t smoothings,
                         float **normals, float **spare);

#endif
