/*
 * What kind of surface a draft is: the fans round each vertex, components, orientation, border
 * loops. It finds what separate.c and orient.c mend, and counts the topology once nothing is left
 * to mend.
 */
#ifndef SPBM_MESH_SURVEY_H
#define SPBM_MESH_SURVEY_H

#include "mesh/components.h"

/* A fan that is not the first at its vertex, by one of its corners. */
struct fan_record {
    uint32_t vertex;
    uint32_t face;
    uint32_t corner;
};

/* A component of one slab that goes on in others; united with them by `up`. */
struct open_component {
    uint32_t up;        /* itself: a root, the first of its set */
    uint32_t up_turned; /* parity relative to `up` */
    uint32_t lowest_face;
    bool is_twisted;
    /* sums over the whole set once survey_draft is done, in roots */
    uint64_t faces;
    uint64_t turned; /* faces of parity 1, relative to the root's lowest face */
    uint64_t vertices;
    uint64_t borders;
    uint64_t loops;
};

struct survey {
    struct context *ctx;
    struct spool fan_spool;   /* struct fan_record, any order */
    uint64_t fan_count;       /* of further fans: 0 for a manifold */
    bool is_turned;           /* some component has faces that don't agree, or is twisted */
    struct topology topology; /* holds only if fan_count is 0 and !is_turned */

    uint32_t *open_first; /* slab_count + 1: ids of each slab's open components */
    uint32_t slab_count;
    struct spool open_spool;
    struct open_component *open;
    uint64_t open_count;
};

/* Needs D1 to D4. */
enum status survey_draft(struct draft *draft, struct survey *survey) MUST_CHECK;

/*
 * The same within another loop over the slabs, that of parallel_ordered: survey_take in its work,
 * for a slab that has been entered (draft_enter_slab) and whose vertices `scope` has; survey_add in
 * its finish; survey_end when all have been added. `in_flight` slabs at a time. survey_close in any
 * case; what survey_begin and survey_end leave in *survey, survey_clear gives back.
 */
struct surveying;
enum status survey_begin(struct draft *draft, unsigned in_flight, struct survey *survey,
                         struct surveying **out) MUST_CHECK;
enum status survey_take(struct surveying *surveying, const struct slab_scope *scope, uint64_t slab,
                        unsigned worker) MUST_CHECK;
enum status survey_add(struct surveying *surveying, uint64_t slab) MUST_CHECK;
enum status survey_end(struct surveying *surveying) MUST_CHECK;
void survey_close(struct surveying **surveying);

/* Whether nothing is left to mend. */
static inline bool survey_is_clean(const struct survey *survey)
{
    return survey->fan_count == 0 && !survey->is_turned;
}

void survey_clear(struct survey *survey);

/* Root of an open component and, in *turned, its parity relative to it. */
uint32_t open_root(struct open_component *open, uint32_t id, uint32_t *turned);

/* Fewest faces of a surface with that topology (DESIGN.md "floor"). */
uint64_t component_floor(uint64_t vertices, uint64_t faces, uint64_t borders, uint64_t loops);

/*
 * Steps round vertex v from face *f (corner *corner) over its edge *leave, one of the two at that
 * corner, to the next face and corner; *leave is then the other edge there. False, and nothing
 * changed, if that edge has no face within [first, first + count).
 */
static inline bool fan_step(const struct draft *draft, uint32_t first, uint32_t count, uint32_t v,
                            uint32_t *f, unsigned *corner, unsigned *leave)
{
    uint32_t over = draft->neighbours[3 * (size_t)*f + *leave];
    if (over - first >= count)
        return false;
    unsigned mate = mate_of(draft->mates, *f, *leave);
    *f = over;
    if (draft->faces[3 * (size_t)over + mate] == v) {
        *corner = mate;
        *leave = previous3(mate);
    } else {
        *corner = next3(mate);
        *leave = *corner;
    }
    return true;
}

#endif
