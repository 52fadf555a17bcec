/*
 * A mesh on its way into the store: arrays in proportion to the mesh lie in spools (memory up to a
 * limit, then nameless temporary files), faces are in their final order, vertices are numbered by
 * first use, and slabs are cut.
 *
 * Invariants between the steps of store_build:
 *   D1  faces[] holds indices below vertex_count, and no face repeats one;
 *   D2  vertices are numbered by first use, so that those that slab s uses first are the range
 *       [vertex_first[s], vertex_first[s+1]);
 *   D3  is_shared(v) holds for exactly the vertices that more than one slab uses;
 *   D4  if neighbours[] is there, it is symmetric: the face over edge k of f names f as the face
 *       over its edge mate(f, k). As long as `seams` is not NULL that holds for a slab from
 *       draft_enter_slab to draft_forget_slab.
 * An edge is named by its face and the corner that it starts at (corner.h). A *code* is
 * face << 2 | corner in 64 bits.
 */
#ifndef SPBM_MESH_DRAFT_H
#define SPBM_MESH_DRAFT_H

#include "base/file.h"
#include "mesh/corner.h"
#include "mesh/room.h"
#include "mesh/store.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__,
               "arrays of the store are written as they lie in memory");

/* Edge key & 3 of face key >> 2 has the edge `mate` of the face `over` over it, in another slab. */
struct seam {
    uint64_t key;
    uint32_t over;
    uint32_t mate;
};

struct draft {
    struct context *ctx;
    struct room room;
    unsigned slab_shift;
    uint64_t index_limit; /* most vertices */

    uint64_t vertex_count; /* that are used */
    uint64_t face_count;
    uint64_t id_count; /* 0: D2 and D3 hold; else faces hold ids below it, as the input has them,
                          positions and records are by ids, and `shared` tells which are used */
    struct spool face_spool;
    struct spool neighbour_spool;
    struct spool mate_spool;
    struct spool position_spool;
    struct spool record_spool;
    uint32_t *faces;      /* 3 a face */
    uint32_t *neighbours; /* 3 a face, NO_INDEX at a border; NULL before adjacency_build, which may
                             find the spool as it wants it */
    uint8_t *mates;       /* bits 2k, 2k+1: the neighbour's edge; NULL before adjacency_build */
    struct spool seam_spool;
    const struct seam *seams; /* by key: what neighbours and mates lack; NULL: nothing */
    uint64_t *seam_first;     /* slab_count + 1 */
    bool is_float32;          /* positions are floats, else doubles */
    void *positions;          /* 3 a vertex, as the input has them */
    unsigned char *records;   /* record_size bytes a vertex; NULL: no attributes */
    uint32_t record_size;
    unsigned char *shared; /* a bit a vertex, always in memory */
    size_t shared_size;

    uint32_t slab_count;
    uint32_t *vertex_first; /* slab_count + 1 */
    bool *is_plain; /* a slab: see slab_match.h; none (NULL) when slabs have been cut anew */
    size_t plain_size;
    bool has_box; /* of all vertices, found when they were gathered */
    double box_low[3], box_high[3];
    uint64_t foreign_corners; /* corners whose vertex an earlier slab used first */
};

/* slab_shift 0: SLAB_SHIFT, until it is known better; working_memory: as for room_divide. */
void draft_init(struct context *ctx, struct draft *draft, const char *beside, unsigned slab_shift,
                uint64_t working_memory);
void draft_clear(struct draft *draft);

/* Takes over a spool of faces whose indices are below id_count, not numbered yet. */
enum status draft_adopt_faces(struct draft *draft, struct spool *faces) MUST_CHECK;

/*
 * Numbers vertices by first use, cuts the slabs (D1 to D3), and puts positions and records in the
 * order of the numbers. Before, faces hold ids: below `base_count` those of the last numbering (or
 * of the input, the first time), from there on copies, made from the id copy_of[id - base_count].
 * Faces that repeat an id are dropped and counted in *degenerate (only the first time can there be
 * any: the face order of neighbours[] must not change).
 */
enum status draft_number(struct draft *draft, uint64_t base_count, const struct spool *copy_spool,
                         const uint32_t *copy_of, uint64_t copy_count,
                         uint64_t *degenerate) MUST_CHECK;

/* The first time. Where the numbering would jump about in a file for nothing, as the faces'
 * order won't be kept (draft_is_scattered), they are left with their ids: draft->id_count. `jumps`:
 * it is known to jump about. */
enum status draft_number_first(struct draft *draft, uint64_t id_count, bool jumps,
                               uint64_t *degenerate) MUST_CHECK;

/*
 * The first numbering, of faces as they come, which saves two looks at all of them: number_begin
 * when all vertices that faces will name are known (`expects_order`: the faces may get another
 * order afterwards; `expected_faces` of them, 0: not known); number_take for faces, whose numbers
 * are appended to `to`, *dropped of them left out; number_finish when what was appended are the
 * draft's faces. *taken is false, and nothing done, when the walk jumps about too much, or seems to
 * be in vain (draft_number_first). If other faces have joined the number_count(...) that were
 * taken, number_take_back makes ids of their numbers again, and draft_number is due. Both end the
 * numbering, as number_drop does, which is safe at any time.
 */
struct numbering;
enum status number_begin(struct draft *draft, uint64_t id_count, bool expects_order,
                         uint64_t expected_faces, struct numbering **out) MUST_CHECK;
enum status number_take(struct numbering *numbering, const uint32_t *faces, size_t count,
                        struct spool *to, size_t *dropped, bool *taken) MUST_CHECK;
enum status number_finish(struct numbering **numbering, uint64_t base_count) MUST_CHECK;
enum status number_take_back(struct numbering **numbering) MUST_CHECK;
uint64_t number_count(const struct numbering *numbering);
bool number_has_jumped(const struct numbering *numbering); /* about too much */
void number_drop(struct numbering **numbering);

/* Puts positions and records in another order, that of `ids` (in `id_spool`): the new vertex v is
 * what ids[v] was, or copy_of[ids[v] - base_count]. `next_count` of them. */
enum status draft_gather(struct draft *draft, const struct spool *id_spool, const uint32_t *ids,
                         uint64_t next_count, uint64_t base_count, const struct spool *copy_spool,
                         const uint32_t *copy_of) MUST_CHECK;

/* Replaces each corner by what `table` (in `spool`, `count` elements) has for it. */
enum status draft_map_corners(struct draft *draft, const struct spool *spool, const uint32_t *table,
                              uint64_t count) MUST_CHECK;

/* Position v of an array of floats or doubles. */
static inline void position_at(const void *positions, bool is_float32, uint64_t v, double out[3])
{
    const float *floats = positions;
    const double *doubles = positions;
    for (unsigned i = 0; i < 3; i++)
        out[i] = is_float32 ? (double)floats[3 * v + i] : doubles[3 * v + i];
}

/* Position of a vertex. */
static inline void draft_position(const struct draft *draft, uint64_t v, double out[3])
{
    position_at(draft->positions, draft->is_float32, v, out);
}

static inline uint64_t draft_position_size(const struct draft *draft)
{
    return draft->is_float32 ? 12 : 24;
}

/* Whether the order of the faces is so far from local in space that it need not be matched to be
 * judged: more than 3/8 of all corners are vertices of earlier slabs. (A fan of any size has 1/3.)
 * Slabs of less than 2^JUDGED_SHIFT_MIN faces are nothing but seams. */
enum { JUDGED_SHIFT_MIN = 6 };
static inline bool draft_is_scattered(const struct draft *draft)
{
    return draft->slab_shift >= JUDGED_SHIFT_MIN &&
           draft->foreign_corners > draft->face_count / 8 * 9;
}

/* Whether a table of all vertices' cells fits in memory, by which faces are put in order. */
static inline bool draft_orders_near(const struct draft *draft, uint64_t vertices)
{
    return room_fits(&draft->room, vertices * 8);
}

struct sorter;
/* Drops the faces whose numbers come out of `sorter` (8-byte keys, ascending, each at least once)
 * and forgets neighbours; draft_number must follow. *dropped counts them. */
enum status draft_drop_faces(struct draft *draft, struct sorter *sorter,
                             uint64_t *dropped) MUST_CHECK;

/* Makes is_plain, all false. */
enum status draft_judge_slabs(struct draft *draft) MUST_CHECK;
void draft_forget_adjacency(struct draft *draft);
void draft_release_slabs(struct draft *draft);

static inline bool is_shared(const struct draft *draft, uint32_t vertex)
{
    return draft->shared[vertex >> 3] >> (vertex & 7) & 1;
}

static inline unsigned mate_of(const uint8_t *mates, uint64_t face, unsigned edge)
{
    return (unsigned)mates[face] >> (2 * edge) & 3;
}

static inline void mate_set(uint8_t *mates, uint64_t face, unsigned edge, unsigned mate)
{
    unsigned cleared = (unsigned)mates[face] & ~(3u << (2 * edge));
    mates[face] = (uint8_t)(cleared | mate << (2 * edge));
}

/* Joins edge k of f and edge m of g. */
static inline void faces_link(struct draft *draft, uint32_t f, unsigned k, uint32_t g, unsigned m)
{
    draft->neighbours[3 * (uint64_t)f + k] = g;
    draft->neighbours[3 * (uint64_t)g + m] = f;
    mate_set(draft->mates, f, k, m);
    mate_set(draft->mates, g, m, k);
}

static inline uint64_t code_of(uint32_t face, unsigned corner)
{
    return (uint64_t)face << 2 | corner;
}

/* Faces, neighbours and mates of a slab leave the process (room.h). */
void draft_forget_slab(const struct draft *draft, uint64_t slab);
/* They will be looked at soon. */
void draft_expect_slab(const struct draft *draft, uint64_t slab);

/*
 * Seams: what is known of edges between slabs is known last. Where neighbours are in memory it is
 * entered at once. Where they are in a file, that would be one more pass of reading and writing all
 * of them; so it is kept beside them, and entered, for the process alone, in each slab that is
 * looked at.
 */

/* Takes the next seams, in ascending order of keys; draft_end_seams ends the taking. */
enum status draft_add_seams(struct draft *draft, const struct seam *seams, size_t count) MUST_CHECK;
enum status draft_end_seams(struct draft *draft) MUST_CHECK;
/* Neighbours and mates of the slab are expected and whole until draft_forget_slab. */
void draft_enter_slab(const struct draft *draft, uint64_t slab);
/* Forgets them. */
void draft_drop_seams(struct draft *draft);
/* Those of all slabs, for good. */
enum status draft_settle_seams(struct draft *draft) MUST_CHECK;
/* Neighbour of a face, from any slab: the seams are looked up. */
uint32_t draft_neighbour(const struct draft *draft, uint64_t face, unsigned edge);

/* Those of all slabs leave. */
void draft_forget_all(const struct draft *draft);

/* ---- one slab of a draft, as a worker sees it ---- */

/* Scratch of a worker, grown as needed and kept from slab to slab. */
struct slab_scope {
    struct context *ctx;
    uint32_t face_first;
    uint32_t face_count;
    uint32_t vertex_first;
    uint32_t own_count;
    uint32_t foreign_count;
    uint32_t *foreign; /* vertices that an earlier slab used first, ascending */
    size_t foreign_capacity;
    uint32_t *temp;
    size_t temp_capacity;
};

/* Finds the slab's vertices. `scope` is all zero before its first use. */
enum status scope_enter(struct draft *draft, uint32_t slab, struct slab_scope *scope) MUST_CHECK;
void scope_clear(struct slab_scope *scope);

/* Place of `vertex` in the ascending list, which must hold it. */
uint32_t foreign_rank(const uint32_t *foreign, uint32_t count, uint32_t vertex);

/* Number of a vertex within the slab: its own come first, then the foreign ones. */
static inline uint32_t scope_local(const struct slab_scope *scope, uint32_t vertex)
{
    uint32_t own = vertex - scope->vertex_first;
    if (own < scope->own_count)
        return own;
    return scope->own_count + foreign_rank(scope->foreign, scope->foreign_count, vertex);
}

static inline uint32_t scope_local_count(const struct slab_scope *scope)
{
    return scope->own_count + scope->foreign_count;
}

/* Ends the adding to a sorter of 8-byte records and counts the different ones. */
enum status count_distinct(struct sorter *sorter, uint64_t *count) MUST_CHECK;

/* Sorts ascending; `temp` has as much room. */
void sort_u32(uint32_t *values, uint32_t *temp, size_t count);

#endif
