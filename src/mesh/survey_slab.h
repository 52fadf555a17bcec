/*
 * One slab's share of the survey: what is whole within the slab is settled, what goes on in others
 * is handed on.
 */
#ifndef SPBM_MESH_SURVEY_SLAB_H
#define SPBM_MESH_SURVEY_SLAB_H

#include "mesh/survey.h"

/* One end of an edge between two slabs, as one of the two faces sees it. */
struct half_link {
    /* The edge, by its lower face: (face << 2 | edge) << 2; 2 at the higher vertex; 1 if a face of
     * parity 0 would run from the lower to the higher vertex, as each of the two says. */
    uint64_t key;
    uint32_t fan; /* at that end */
    uint32_t component;
};
enum { LINK_AT_HIGHER = 2, LINK_RUNS = 1 };

struct rim_fan { /* a fan of a slab at a shared vertex */
    uint32_t vertex;
    uint32_t face;
    uint32_t corner;
    uint32_t up; /* united with */
};

struct border_path { /* a piece of a border loop from one shared vertex to another */
    uint64_t start;
    uint32_t end;
    uint32_t component;
};

struct border_edge { /* in local vertex numbers */
    uint32_t from, to;
    uint32_t component;
    bool is_used;
};

/* marks[] of a face: its component << CORNER_BITS | a bit for each corner that a walk has passed.
 */
enum { CORNER_BITS = 3 };
#define NO_COMPONENT (UINT32_MAX >> CORNER_BITS)

struct surveyor {                   /* one a worker */
    const struct slab_scope *scope; /* of the slab in work */
    struct components components;   /* its labels only where is_labelled */
    bool is_labelled;               /* the components were found before the fans, with parities; */
    bool finds_components;          /* or are found by the walks */
    bool is_turned;                 /* a fan has passed faces that run along an edge alike */
    uint32_t *marks;                /* a face */
    size_t mark_capacity;
    uint32_t *joined; /* a component: the earlier one that it is part of, or itself; in the end its
                         place in the list */
    size_t joined_capacity;
    uint32_t *said; /* survey_plain.c: an own vertex */
    size_t said_capacity;
    uint32_t *rim_faces; /* of a plain slab, ascending: those with a shared vertex */
    size_t rim_face_capacity;
    uint32_t rim_face_count;
    uint32_t shared_own; /* own vertices of a plain slab that are shared */
    uint8_t *seen;       /* the own vertices that have had a fan */
    size_t seen_capacity;
    struct border_edge *borders;
    size_t border_capacity;
    uint32_t *leaving; /* local vertex -> border edge that starts there */
    size_t leaving_capacity;
    uint8_t *is_entered; /* local vertex: a border edge ends there */
    size_t entered_capacity;
};

struct part { /* what a slab hands on */
    struct fan_record *fans;
    size_t fan_count, fan_capacity;
    struct rim_fan *rims;
    size_t rim_count, rim_capacity;
    struct half_link *links;
    size_t link_count, link_capacity;
    struct open_component *open;
    size_t open_count, open_capacity;
    struct border_path *paths;
    size_t path_count, path_capacity;
    uint64_t shared_vertices; /* own ones */
    uint64_t borders, loops, components, floor;
    bool is_turned;
};

/* Fills `part` anew for the slab that `scope` has entered; its numbers are those within the slab.
 */
enum status survey_slab(const struct draft *draft, const struct slab_scope *scope,
                        struct surveyor *surveyor, struct part *part) MUST_CHECK;

void surveyor_clear(struct context *ctx, struct surveyor *surveyor);
void part_clear(struct context *ctx, struct part *part);

#endif
