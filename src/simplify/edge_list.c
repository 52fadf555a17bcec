/*
 * Lists of replaced vertices.
 *
 * To know how far an edge is from the original chains one could keep, with each edge, a bound that
 * grows with every change: after many changes it says nothing. The vertices themselves say it
 * exactly. They are linked through one array, so a list is joined to another in constant time; and
 * since distance from a segment is convex, the vertices between two others that are nearly in line
 * with them can be left out at a known loss, which keeps lists short however coarse a level is.
 */
#include "simplify/edge_list.h"

#include "geom/polyline.h"

/* More replaced vertices than this are thinned out. */
enum { LIST_MAX = 64, LIST_FORCED = 1024 };
#define LIST_FINENESS 0.02 /* of the edge's length: what thinning may lose */

void list_append(struct chain_graph *graph, struct edge_record *to, uint32_t v)
{
    graph->list[v] = NO_INDEX;
    if (to->first == NO_INDEX)
        to->first = v;
    else
        graph->list[to->last] = v;
    to->last = v;
    to->count++;
}

void list_join(struct chain_graph *graph, struct edge_record *to, struct edge_record *from)
{
    if (from->slack > to->slack)
        to->slack = from->slack;
    if (from->first == NO_INDEX)
        return;
    if (to->first == NO_INDEX)
        to->first = from->first;
    else
        graph->list[to->last] = from->first;
    to->last = from->last;
    to->count += from->count;
    from->first = from->last = NO_INDEX;
    from->count = 0;
}

/* Takes out every second vertex that lies nearly on the line of its neighbours in the list; the
 * slack grows by what that loses. */
static void list_thin(struct chain_graph *graph, uint32_t edge)
{
    struct edge_record *record = &graph->edges[edge];
    double length = vec3_distance(vertex_point(graph, graph->half_edges[2 * edge].origin),
                                  vertex_point(graph, half_edge_end(graph, 2 * edge)));
    double lost = 0;
    uint32_t before = record->first;
    while (before != NO_INDEX && graph->list[before] != NO_INDEX) {
        uint32_t v = graph->list[before], after = graph->list[v];
        if (after == NO_INDEX)
            break;
        double distance = vec3_length(segment_offset(
            vertex_point(graph, v), vertex_point(graph, before), vertex_point(graph, after)));
        if (distance <= LIST_FINENESS * length || record->count > LIST_FORCED) {
            graph->list[before] = after;
            record->count--;
            if (distance > lost)
                lost = distance;
            before = after;
        } else {
            before = v;
        }
    }
    record->slack += (float)lost;
}

void list_limit(struct chain_graph *graph, uint32_t edge, uint32_t count_before)
{
    uint32_t count = graph->edges[edge].count;
    if (count > LIST_MAX && (count ^ count_before) > count_before)
        list_thin(graph, edge);
}
