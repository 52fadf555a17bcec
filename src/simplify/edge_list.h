/*
 * The vertices that an edge of the chain graph replaces (struct edge_record).
 */
#ifndef SPBM_SIMPLIFY_EDGE_LIST_H
#define SPBM_SIMPLIFY_EDGE_LIST_H

#include "simplify/chain_graph.h"

void list_append(struct chain_graph *graph, struct edge_record *to, uint32_t v);

/* Moves all that `from` has behind what `to` has. */
void list_join(struct chain_graph *graph, struct edge_record *to, struct edge_record *from);

/* To be called for an edge whose list has grown from `count_before`: thins it out when the count
 * has passed a power of two, so that what it costs is paid by what was added. */
void list_limit(struct chain_graph *graph, uint32_t edge, uint32_t count_before);

#endif
