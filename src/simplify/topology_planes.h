/*
 * Planes by the fewest triangles: the clean-up merge of nearly coplanar neighbours
 * (dissertation, 5.3) with holes allowed.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_PLANES_H
#define SPBM_SIMPLIFY_TOPOLOGY_PLANES_H

#include "mesh/mesh.h"

/*
 * Triangulates every plane of the manifold `mesh` anew: faces whose normals differ from a plane's
 * by an angle of cosine at least `cosine` and whose corners lie within `tolerance` of it form a
 * plane; of its outline, vertices between only two planes (or on the border) go that lie within
 * `tolerance` of the line between their neighbours. Topology is kept; planes for which this finds
 * no triangulation that keeps it stay as they are. Vertices that are used no more are dropped, all
 * others keep their places and records. M1 to M4 hold before and after.
 */
enum status planes_merge(struct context *ctx, struct mesh *mesh, double cosine,
                         double tolerance) MUST_CHECK;

#endif
