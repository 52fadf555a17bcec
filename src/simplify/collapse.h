/*
 * Edge collapse on a mesh in memory by least error: Lindstrom and Turk's memoryless volume- and
 * boundary-preserving placement ("Fast and Memory Efficient Polygonal Simplification", IEEE
 * Visualization 1998), or input vertices only. Every collapse passes the link condition, keeps
 * faces from flipping and from becoming slivers, so that invariants M1 to M4 of mesh.h, border
 * loops, components and the Euler characteristic hold after each.
 *
 * The result depends on the input's order and the options alone.
 */
#ifndef SPBM_SIMPLIFY_COLLAPSE_H
#define SPBM_SIMPLIFY_COLLAPSE_H

#include "mesh/mesh.h"

struct collapse_options {
    bool subset;     /* keep input vertices where they are */
    uint32_t effort; /* 1: fastest, batches of edges of about the same cost; 2: default, smaller
                        batches; 3: smaller still */
    double border_weight; /* of the boundary term; 0: the default */
    bool together;        /* use all threads of the context for this one mesh */
    bool measured;        /* look at suspicious places, and at the end at all, with a copy of the
                             mesh as it was at a few times the faces; takes no more memory than the
                             mesh took at first */
    bool keep_guards;     /* rather stop than make slivers and turn faces over, where only these
                             stand in the way of fewer faces */
    bool roughly;       /* errors are not measured on the way: witnesses are carried along, no edge
                           waits for its error; not with a bound of the error */
    uint32_t variant;   /* collapse_set_variant */
    const char *source; /* the file that the mesh was made from: damage to it is then the reason
                           when the mesh is not manifold (STATUS_BAD_INPUT). NULL: the caller's
                           defect (STATUS_INTERNAL) */
};

struct collapse; /* the mesh being simplified */

/*
 * Takes a mesh that holds M1 to M4. Positions (3 doubles), faces and records are copied in compact
 * form (positions that are not all float32 are rounded to float32 relative to the middle of their
 * box); the caller may release them at once. `locked`: one byte a vertex, not 0 where a vertex must
 * neither move nor vanish (NULL: none).
 */
enum status collapse_begin(struct context *ctx, const struct collapse_options *options,
                           uint64_t vertex_count, uint64_t face_count, const double *positions,
                           const uint32_t *faces, const struct attributes *attributes,
                           const unsigned char *records, const unsigned char *locked,
                           struct collapse **out) MUST_CHECK;

/* The same for a mesh in compact form that is given away, so that it need not be held twice: the
 * arrays are released, on failure too. Positions are kept as they are. Any of witnesses, locked
 * and records may be NULL. */
struct collapse_mesh {
    uint64_t vertex_count, face_count;
    float *positions;
    uint32_t *faces;
    float *witnesses; /* 3 a vertex: a point of the original nearby that the mesh has lost, by which
                         errors are estimated; NULL: the vertices themselves */
    unsigned char *locked;
    unsigned char *records;
};

enum status collapse_begin_giving(struct context *ctx, const struct collapse_options *options,
                                  struct collapse_mesh *mesh, const struct attributes *attributes,
                                  struct collapse **out) MUST_CHECK;
void collapse_mesh_clear(struct context *ctx, uint32_t stride, struct collapse_mesh *mesh);

/* Collapses until at most `most_faces` faces are left or the next one would pass `most_error`
 * (estimated distance, INFINITY: none) or nothing can be collapsed. May be called again with lower
 * targets: all levels come from one sequence. */
enum status collapse_run(struct collapse *collapse, uint64_t most_faces,
                         double most_error) MUST_CHECK;

/* Part of the way to such a target: collapse_run() goes on from there. */
enum status collapse_approach(struct collapse *collapse, uint64_t faces,
                              double most_error) MUST_CHECK;
/* From now on, where no error is given, collapse_run() and collapse_approach() return early, as
 * soon as between two sweeps no more than so many faces are left (0: never). Called again with the
 * same target and a lower pause they go on as if they had never paused. */
void collapse_pause_at(struct collapse *collapse, uint64_t faces);
/* A second one in the same state, that never pauses. */
enum status collapse_copy(const struct collapse *collapse, struct collapse **out) MUST_CHECK;
/* From now on collapses come in another order: each variant has its own; 0 at first. */
void collapse_set_variant(struct collapse *collapse, uint32_t variant);

/* How many faces there are when, on the way to such a target without a bound, collapses begin to be
 * measured; 0: they do not. */
uint64_t collapse_measured_from(struct collapse *collapse, uint64_t most_faces);

/*
 * A mesh on its way, in few bytes, without what collapses were measured by: what goes on from it
 * does the same whenever that is. Positions are relative to where they were given, times `scale`.
 */
struct collapse_state {
    uint64_t vertex_count, face_count;
    uint64_t room;      /* faces that there was room for at first, or lately */
    double scale, unit; /* powers of two */
    double typical_error, astray, error_sum;
    uint64_t error_count, refused_count;
    uint32_t guard;
    bool flat_is_left;
    float *positions;
    uint32_t *faces;
    uint16_t *notes; /* 4 a vertex: witness and offset */
    unsigned char *records;
};

enum { COLLAPSE_GUARDS = 3 };

/* Ends the collapse and keeps its state, which is the caller's to clear; nothing may be locked. */
enum status collapse_save(struct collapse **collapse, struct collapse_state *state) MUST_CHECK;
/* The state is given away, on failure too. It must be sound: every index in range, every number
 * finite; that it is a manifold is found out (STATUS_BAD_INPUT as options->source says). */
enum status collapse_resume(struct context *ctx, const struct collapse_options *options,
                            struct collapse_state *state, const struct attributes *attributes,
                            struct collapse **out) MUST_CHECK;
/* Takes memory for the arrays of as many vertices and faces as the state says. */
enum status collapse_state_take(struct context *ctx, uint32_t stride,
                                struct collapse_state *state) MUST_CHECK;
void collapse_state_clear(struct context *ctx, uint32_t stride, struct collapse_state *state);

uint64_t collapse_faces(const struct collapse *collapse);
/* The Euler characteristic of the present mesh. */
int64_t collapse_euler(const struct collapse *collapse);
/* Estimated largest distance so far. */
enum status collapse_error(const struct collapse *collapse, double *error) MUST_CHECK;
/* Mean distance of the present mesh to the reference, estimated at a thousand of its faces; 0 while
 * there is no reference. */
double collapse_mean_error(const struct collapse *collapse);
bool collapse_exhausted(const struct collapse *collapse);

/* The present mesh, vertices numbered by first use in face order, faces in their input's order.
 * `sources` (may be NULL): for each vertex the input vertex it came from. The caller owns *mesh. */
enum status collapse_extract(struct collapse *collapse, struct mesh *mesh,
                             uint32_t **sources) MUST_CHECK;

/* The same in compact form, with witnesses, for a mesh that goes on to another collapse;
 * `locked` stays NULL. Positions must have been float32 (or given away). */
enum status collapse_extract_compact(struct collapse *collapse, struct collapse_mesh *mesh,
                                     uint32_t **sources) MUST_CHECK;
void collapse_end(struct collapse **collapse);

#endif
