/*
 * What an operation on the chain graph costs: how far it takes the chains from the original ones,
 * and by which of all possible operations at a vertex or a patch is cheapest.
 */
#ifndef SPBM_SIMPLIFY_OPERATION_COST_H
#define SPBM_SIMPLIFY_OPERATION_COST_H

#include "simplify/patch_merge.h"

enum operation_kind { OPERATION_NONE, OPERATION_REMOVE, OPERATION_COLLAPSE, OPERATION_MERGE };

struct operation {
    enum operation_kind kind;
    uint32_t vertex;             /* REMOVE: which */
    uint32_t half_edge;          /* COLLAPSE, MERGE */
    uint32_t vertex_to, list_to; /* COLLAPSE: see edge_collapse */
    double error; /* largest distance of an original chain vertex, in the metric of its chain */
    double key;   /* place in the order: the error, made larger by what speaks against it */
};

struct cost_options {
    double patch_cosine; /* alpha1 of section 4.2.6: normals agree when their cosine is above it */
};

/* The cheapest way to take a live vertex away, kind OPERATION_NONE (key INFINITY) when there is
 * none. */
void vertex_cost(const struct chain_graph *graph, const struct cost_options *options,
                 uint32_t vertex, struct operation *best);

/* Where else on its chain a live vertex would make the largest distance smaller. Considered are the
 * vertices that its two edges replace, or its two sharp ones if all others are smooth. False: it
 * is best where it is. */
struct slide {
    uint32_t in, out; /* half-edges of the chain, both from the vertex */
    uint32_t to;
};
bool vertex_slide_find(const struct chain_graph *graph, uint32_t vertex, struct slide *slide);

/* The cheapest merge of a live patch with a neighbour. */
void patch_cost(const struct chain_graph *graph, const struct cost_options *options, uint32_t patch,
                struct operation *best);

#endif
