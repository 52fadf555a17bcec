/*
 * Patches too thin for their normals to mean anything, as triangulations of planes with many holes
 * are full of.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_SPLINTERS_H
#define SPBM_SIMPLIFY_TOPOLOGY_SPLINTERS_H

#include "simplify/chain_graph.h"

/*
 * normals[patch], 3 each: its own, unless it is a splinter, narrower than `noise` (a length), that
 * faces elsewhere than the surface that it lies in. groups[patch]: patches that have the same lie
 * in the same surface, whatever their normals are.
 */
enum status splinters_join(struct chain_graph *graph, double noise, float *normals,
                           uint32_t *groups) MUST_CHECK;

#endif
