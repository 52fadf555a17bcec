/*
 * Components of a slab whose fans are known.
 */
#ifndef SPBM_MESH_SURVEY_PLAIN_H
#define SPBM_MESH_SURVEY_PLAIN_H

#include "mesh/survey_slab.h"

/*
 * Finds the components of a plain slab (slab_match.h), to be settled: list, joined, and a mark for
 * each face, none of whose corners has been passed. Fills rim_faces and shared_own, too.
 */
enum status plain_components(const struct draft *draft, struct surveyor *surveyor) MUST_CHECK;

/* A component that has face i, which is in none, begins. */
enum status surveyor_begin_component(struct surveyor *surveyor, uint32_t i) MUST_CHECK;

#endif
