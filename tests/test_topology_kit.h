/* Running topology simplification on a shape, for tests. */
#ifndef SPBM_TEST_TOPOLOGY_KIT_H
#define SPBM_TEST_TOPOLOGY_KIT_H

#include "simplify/topology.h"
#include "test_facts.h"
#include "test_shapes.h"

struct operated {
    struct context ctx;
    struct mesh mesh;
    struct facts facts;
    struct topology_report report;
};

/* Imports the shape (slabs of 2^slab_shift faces; 0: the usual), operates, loads what came out. Any
 * failure fails the test. */
void operate(const struct shape *shape, const struct topology_options *options, unsigned slab_shift,
             struct operated *out);
void operated_clear(struct operated *out);

#endif
