/*
 * Slabs in memory, made from a mesh without the store: what patch growth and chain tracing are
 * given, with slabs of any size, so that small meshes have many seams.
 */
#ifndef SPBM_TEST_SLABS_H
#define SPBM_TEST_SLABS_H

#include "mesh/store.h"

struct slab_set {
    uint32_t vertex_count; /* of all slabs: numbered by first use in face order */
    uint32_t face_count;
    uint32_t slab_count;
    uint32_t *faces; /* 3 a face, the mesh's faces in their order */
    uint32_t *neighbours;
    uint8_t *mates;
    float *positions;
    struct slab *slabs;
};

/* The mesh must be manifold and oriented (M1 to M4); unused vertices are left out. */
void slab_set_build(const struct mesh *mesh, uint32_t slab_faces, struct slab_set *set);
void slab_set_free(struct slab_set *set);

#endif
