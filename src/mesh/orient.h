/*
 * Making the faces of each component show the same side.
 */
#ifndef SPBM_MESH_ORIENT_H
#define SPBM_MESH_ORIENT_H

#include "mesh/survey.h"

struct orient_counts {
    uint64_t flipped; /* faces turned round */
    uint64_t twisted; /* components that are not orientable */
    uint64_t cut;     /* edges opened because of that */
};

/*
 * In each component that the survey found at odds the minority of faces is turned round (of two
 * equal halves the one without the lowest face). A component that is not orientable takes the
 * orientation that spreads from its lowest face, and is cut open where that meets itself; its
 * vertices there are then to be separated. The draft is numbered anew.
 */
enum status orient_draft(struct draft *draft, struct survey *survey,
                         struct orient_counts *counts) MUST_CHECK;

#endif
