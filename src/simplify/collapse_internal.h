/*
 * The mesh while its edges are collapsed, shared by the collapse_*.c files and nobody else.
 *
 * What is used together lies together, because a look at memory costs more here than a hundred
 * operations: a face's corners take 24 bytes, a vertex 64, a line of cache; with a key a closed
 * mesh takes 58 bytes a face.
 *
 * Edge k of face f is named by corner 3f+k, where it starts. Turning round a vertex is what is done
 * most, so a corner says where its edge leads and which corner comes next at its vertex, and
 * nothing has to be worked out between two steps. Invariants between two collapses: C1  the corner
 * across edge c is the swing of corner_next(c), NO_INDEX at the border; it is a corner of another
 * face, its edge runs against c, and the corner across it is c; C2  vertices[v].corner is a corner
 * of a live face at v; at a border vertex the one whose edge is on the border, so that turning
 * counter-clockwise from it meets all of v's faces; C3  the fan of v is that of its present faces,
 * but for rounding; C4  a dead face's corners have end NO_INDEX, a dead vertex has corner NO_INDEX.
 */
#ifndef SPBM_SIMPLIFY_COLLAPSE_INTERNAL_H
#define SPBM_SIMPLIFY_COLLAPSE_INTERNAL_H

#include "base/cpu.h"
#include "geom/bvh.h"
#include "geom/quadric.h"
#include "simplify/collapse.h"

/* A vertex with more neighbours is left alone until they are fewer, so that a hub of a hundred
 * thousand faces does not make the work quadratic. */
enum { RING_MAX = 96, RING_LANES = RING_MAX + 2 * LANES };

enum vertex_flag { VERTEX_LOCKED = 1, VERTEX_BORDER = 2 };

enum { VERTICES_MAX = (1 << 30) - 1 };

struct collapse_corner {
    uint32_t end;   /* where its edge leads */
    uint32_t swing; /* the next corner at its vertex, counter-clockwise; NO_INDEX: the border */
};

struct collapse_vertex {
    float position[3]; /* relative to origin, times scale */
    uint32_t corner;
    struct fan fan;
    uint16_t witness[3];  /* collapse_error.c: relative to the vertex, half floats, times unit */
    uint16_t offset;      /* of the surface from the original here, likewise */
    uint32_t source : 30; /* number in the input */
    uint32_t flags : 2;   /* enum vertex_flag */
};

/* What a collapse may do to the shape of faces; a later one comes when nothing more is to be had
 * with an earlier one. */
enum guard { GUARD_FULL, GUARD_TURNED, GUARD_NONE };

/* collapse_reference.c: the mesh as it was. Vertices have the places in the arrays that they had
 * then, so those of the collapse must not move as long as it is there. */
struct reference {
    uint64_t vertex_count, face_count; /* 0: there is none */
    double *positions;
    uint32_t *faces;
    uint32_t *next; /* vertices that have become one hang together in a ring */
    struct bvh tree;
};

struct collapse {
    struct context *ctx;
    enum cpu_level level;
    enum guard guard;
    struct collapse_options options;
    uint64_t vertex_slots, face_slots; /* of the arrays in use, dead ones counted */
    uint64_t vertex_count, face_count; /* at first */
    uint64_t vertex_room, face_room;   /* allocated of vertices and corners */
    uint64_t live_faces;
    uint64_t pause_faces;    /* collapse_pause_at */
    uint64_t reference_room; /* faces that there was room for at first, or at the last reference */
    double origin[3];
    double scale; /* power of two that makes edges about 1 long, so that floats neither over- nor
                     underflow */
    float unit;   /* power of two that makes the mean edge about 1, scaled or not */
    bool is_float32;
    bool flat_is_left;    /* there may be edges still whose collapse costs nothing */
    bool flat_has_begun;  /* they are being collapsed */
    bool held_back;       /* edges wait for a larger error bound */
    double error_bound;   /* of the present run */
    double typical_error; /* mean error of the last sweep's collapses; 0 before */
    double astray;        /* edges wait whose error is so many times the typical one */
    double error_sum;     /* of the present sweep's */
    uint64_t error_count, refused_count;

    struct collapse_corner *corners;
    struct collapse_vertex *vertices;
    float *keys;       /* cost of the vertex's cheapest edge when last looked at; INFINITY: none */
    uint32_t key_step; /* only every so many keys are known, the others are 0 */
    struct attributes attributes;
    unsigned char *records;
    struct reference reference;
};

/* The neighbours of a vertex, counter-clockwise. corners[i] is the corner at the vertex whose edge
 * goes to vertices[i]; an open ring has one vertex more than corners. */
struct ring {
    uint32_t count;                /* of vertices; 0: more than RING_MAX */
    uint32_t faces;                /* of faces: count, or count - 1 when open */
    uint32_t vertices[RING_LANES]; /* what stands behind the last, vectors need */
    uint32_t corners[RING_MAX + 1];
};

static inline uint32_t corner_next(uint32_t c)
{
    return c % 3 == 2 ? c - 2 : c + 1;
}

static inline uint32_t corner_previous(uint32_t c)
{
    return c % 3 == 0 ? c + 2 : c - 1;
}

static inline uint32_t corner_vertex(const struct collapse *collapse, uint32_t c)
{
    return collapse->corners[corner_previous(c)].end;
}

static inline uint32_t corner_opposite(const struct collapse *collapse, uint32_t c)
{
    return collapse->corners[corner_next(c)].swing;
}

/* ---- collapse_begin.c ---- */

/* A new one without vertices and corners. */
enum status collapse_start(struct context *ctx, const struct collapse_options *options,
                           uint64_t vertex_count, uint64_t face_count,
                           const struct attributes *attributes, struct collapse **out) MUST_CHECK;
enum status collapse_take_faces(struct collapse *collapse, const uint32_t *faces) MUST_CHECK;
/* Makes adjacency, fans and keys. */
enum status collapse_make_ready(struct collapse *collapse) MUST_CHECK;

/* ---- collapse_topology.c ---- */

/* Finds swings, vertex corners and borders from the ends, and makes the fans. STATUS_INTERNAL when
 * the faces are no manifold. */
enum status topology_build(struct collapse *collapse) MUST_CHECK;
/* The link condition, with the border and with locked vertices, for the edge from `a` to its i-th
 * neighbour b; both rings are known. */
bool topology_allows(const struct collapse *collapse, uint32_t a, const struct ring *ring_a,
                     uint32_t i, const struct ring *ring_b);
/* Takes the edge away; `gone` (a or b) vanishes into the other. Returns the faces taken, 1 or 2. */
unsigned topology_collapse(struct collapse *collapse, uint32_t a, const struct ring *ring_a,
                           uint32_t i, const struct ring *ring_b, uint32_t gone);
/* Closes the gaps that dead faces and vertices leave; order is kept. */
enum status topology_compact(struct collapse *collapse) MUST_CHECK;

/* Vertices [first, end), the only ones that a thread may look at, and what it did there. */
struct territory {
    uint32_t first, end;
    uint64_t most_taken, taken; /* faces that may be taken away, and were (one more is possible) */
    double error_sum;
    uint64_t error_count;   /* collapses that were measured, and */
    uint64_t refused_count; /* edges that wait because of their error */
    bool held_back;
    uint32_t leaf; /* of the reference's tree, where to look first: bvh_is_near() */
};

/* ---- collapse_cost.c ---- */

/* A vertex, its neighbours relative to it, and the faces between them. */
struct vertex_look {
    struct ring ring;
    uint32_t flags;          /* v's and its neighbours', any */
    bool reaches_out;        /* a neighbour is not of the territory: nothing else is filled in */
    float at[3][RING_LANES]; /* neighbours; behind the last the first again, or 0, then 0 */
    float normals[3][RING_LANES]; /* of face i, between neighbours i and i + 1; 0 beyond the last */
};

/* What is known of all edges at one vertex; positions are relative to it. */
struct vertex_edges {
    struct vertex_look look;
    float reach_square;
    uint32_t cheapest;           /* edge, the first of several */
    float least;                 /* its cost; INFINITY: there is none */
    float costs[RING_LANES];     /* INFINITY: not to be collapsed */
    float places[3][RING_LANES]; /* where the edge's vertex goes */
};

/* Gathers v's ring and the faces round it; ring.count is 0 when there are too many. */
void vertex_look_round(const struct collapse *collapse, const struct territory *territory,
                       uint32_t v, struct vertex_look *look);
/* The same, and the cost and place of each edge. */
void vertex_evaluate(const struct collapse *collapse, const struct territory *territory, uint32_t v,
                     struct vertex_edges *edges);
/* The border edges at both ends of an edge, relative to v. */
void border_edges_sum(const struct collapse *collapse, uint32_t v, uint32_t w,
                      struct border_sum *sum);

/* ---- collapse_shape.c ---- */

/* An edge that is about to be collapsed: v and its i-th neighbour w, into one vertex at `to`. */
struct edge_change {
    uint32_t v, w;
    uint32_t place[2];                  /* of w in v's ring, of v in w's */
    const struct vertex_look *looks[2]; /* v's, w's */
    float to[2][3];                     /* relative to v, to w */
    float turned[2][3][RING_LANES]; /* normals of the faces at v, at w, afterwards; 0: face gone */
    float heights[2][RING_LANES];   /* squared distance of the new vertex from the faces' planes */
};

/* The two faces at the edge, by their place in the ring of one of its ends; UINT32_MAX: none. */
static inline void edge_faces_gone(const struct edge_change *change, int end, uint32_t gone[2])
{
    const struct ring *ring = &change->looks[end]->ring;
    const uint32_t place = change->place[end];
    gone[0] = place < ring->faces ? place : UINT32_MAX;
    gone[1] = place > 0 ? place - 1 : ring->faces == ring->count ? ring->count - 1 : UINT32_MAX;
}

/* Guards against faces that turn over or become slivers; fills in `turned` and `heights`. */
bool edge_shape_allows(const struct collapse *collapse, struct edge_change *change);
/* Brings the fans of the new vertex `kept` and of its neighbours up to date. */
void edge_update_fans(struct collapse *collapse, const struct edge_change *change, uint32_t kept);
/* Makes the fans of all vertices. */
void fans_build(struct collapse *collapse);

/* ---- collapse_error.c ---- */

/* What a collapse leaves: distances. */
struct edge_error {
    double forward;   /* of the farther witness from the faces that there will be */
    float offset;     /* of the new vertex from the original, in front of it */
    double between;   /* of the new edges' middles from those that are there */
    float witness[3]; /* relative to the new vertex */
};

/* `enough`: what is smaller of `between` need not be exact. Where `forward` is more than `most` the
 * others are not looked for. */
void edge_find_error(const struct collapse *collapse, const struct edge_change *change,
                     double enough, double most, struct edge_error *error);
/* Without looking at faces: the witness that is farther above or below the new vertex stays, the
 * distances are 0. */
void edge_guess_error(const struct collapse *c, const struct edge_change *change,
                      struct edge_error *error);
/* Whether witnesses of the vertices round the edge that are within `bound` stay so. */
bool edge_keeps_witnesses(const struct collapse *collapse, const struct edge_change *change,
                          double bound);
float offset_get(const struct collapse *collapse, uint32_t v);
void offset_set(struct collapse *collapse, uint32_t v, float offset);
void witness_set(struct collapse *collapse, uint32_t v, const float offset[3]);
void witness_get(const struct collapse *collapse, uint32_t v, float offset[3]);
/* Distance of v's witness from the faces nearby, or the error that was noted there if larger. What
 * is smaller than `enough` need not be exact. */
double vertex_error(const struct collapse *collapse, uint32_t v, double enough);

/* Whether the new edge to the j-th neighbour at that end is on the border or a rim: it may leave
 * the surface in the plane of its faces. */
bool edge_is_rim(const struct collapse *collapse, const struct edge_change *change, int end,
                 uint32_t j);
/* Squared distance of p, relative to the vertex at that end, from the faces that there will be and
 * from those that are there. What is not more than `enough` need not be exact. */
float edge_square_after(const struct collapse *collapse, const struct edge_change *change, int end,
                        const float p[3], float enough);
float edge_square_before(const struct collapse *collapse, const struct edge_change *change, int end,
                         const float p[3], float enough);
/* The faces round v, wherever they are. */
void vertex_look_freely(const struct collapse *collapse, uint32_t v, struct vertex_look *look);
/* Squared distance of the point at `place` from the faces at v, round which *look is, and, going
 * from there to where they are nearer, the faces nearby. What is smaller than `enough` (squared)
 * need not be exact. Infinite where there are too many to look at. */
float vertex_square(const struct collapse *collapse, uint32_t v, const struct vertex_look *look,
                    const float place[3], float enough);

/* ---- collapse_reference.c ---- */

/* Of a vertex's points of the reference so many are looked at. */
enum { REFERENCE_POINTS_MAX = 16 };

/* Makes the present mesh the reference. Vertices and faces are renumbered. */
enum status reference_take(struct collapse *collapse) MUST_CHECK;
/* `to` has none yet; vertices stand where they stand in `from`. */
enum status reference_copy(const struct collapse *from, struct collapse *to) MUST_CHECK;
void reference_clear(struct collapse *collapse);
/* At most how many faces the reference may have that comes next, so that it takes no more than the
 * room that arrays have gained since the beginning. */
uint64_t reference_most_faces(const struct collapse *collapse);
/* `gone` has been merged into `kept`. */
void reference_merge(struct collapse *collapse, uint32_t kept, uint32_t gone);
/* Whether surface and reference are within `bound` of each other round the edge after its collapse,
 * in both directions and at some points. *leaf as in bvh_is_near(). */
bool reference_allows(const struct collapse *collapse, const struct edge_change *change,
                      double bound, uint32_t *leaf);
/* ---- collapse_measure.c ---- */

/* The largest distance between the surface and the reference, and of the witnesses from the
 * surface: in both directions, at some points. */
enum status reference_error(const struct collapse *collapse, double *error) MUST_CHECK;
/* The mean distance of the surface's faces, weighed by their areas, from the reference: at a
 * thousand of them. */
double reference_mean_error(const struct collapse *collapse);

/* ---- collapse_try.c ---- */

/* The part of the vertices that a sweep is to let through. */
double sweep_part(const struct collapse *collapse);
/* Looks at v and collapses its cheapest edge that may be, if it costs no more than the threshold.
 * A vertex whose ring reaches out of the territory keeps its key. */
void vertex_work_on(struct collapse *collapse, struct territory *territory, uint32_t v,
                    float threshold);

/* ---- collapse_sweep.c ---- */

/* Makes keys anew: of every key_step-th vertex, for choosing a threshold by; the others are 0, so
 * that the next sweep looks at them. */
enum status keys_sample(struct collapse *collapse) MUST_CHECK;
/* The threshold of the next sweep: the cost below which `wanted` of the vertices' keys lie, to
 * three bits of mantissa; INFINITY when no vertex has a key. */
float keys_threshold(const struct collapse *collapse, uint64_t wanted);
/* Collapses what costs no more than the threshold, down to `most_faces`. */
enum status sweep(struct collapse *collapse, float threshold, uint64_t most_faces) MUST_CHECK;

#endif
