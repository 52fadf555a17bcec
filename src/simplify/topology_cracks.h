/*
 * Cracks (dissertation, 5.3.4): border loops that are small enough are closed.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_CRACKS_H
#define SPBM_SIMPLIFY_TOPOLOGY_CRACKS_H

#include "simplify/topology_surgery.h"

struct crack_options {
    double size;    /* loops below it are closed; a length */
    bool inscribed; /* by the diameter of the largest circle inside instead of the loop's */
};

/* Adds the small border loops of what stays to the surgery's loops and, as FEATURE_CRACK, to the
 * list. */
enum status cracks_find(struct surgery *surgery, const struct crack_options *options,
                        struct feature_list *list) MUST_CHECK;

#endif
