/*
 * The faces near cracks, in memory: what zipping looks at and changes.
 */
#ifndef SPBM_SIMPLIFY_TOPOLOGY_NEAR_H
#define SPBM_SIMPLIFY_TOPOLOGY_NEAR_H

#include "geom/vec.h"
#include "simplify/topology_surgery.h"

/* A face near a crack. A corner is named by 3 face + place. */
struct near_face {
    uint32_t source; /* its number in the store; NO_INDEX: it comes from splitting one */
    uint32_t corners[3];
    float points[3][3];
    bool is_changed;
};

/* All zero before but for the surgery; to be cleared whatever came of it. */
struct near_faces {
    struct surgery *surgery;
    uint32_t *vertices; /* on cracks, ascending; a place is an index into them */
    float *positions;
    uint32_t *first_corner, *last_corner; /* of each, a list through next_corner */
    uint32_t *moved_to;                   /* the place of what a vertex has become, or NO_INDEX */
    uint32_t *parents; /* a forest over the places: what is surely one component; the last node is
                          all that reaches beyond the faces near cracks */
    size_t vertex_count;
    struct near_face *faces;
    size_t face_count, face_capacity;
    uint32_t *next_corner; /* three a face */
    size_t corner_capacity;
};

/* Gathers all faces that stay and touch a crack of the surgery. */
enum status near_gather(struct near_faces *near) MUST_CHECK;
void near_clear(struct near_faces *near);

/* Place of a vertex, or NO_INDEX if it lies on no crack. */
uint32_t near_place(const struct near_faces *near, uint32_t vertex);

static inline struct vec3 near_position(const struct near_faces *near, uint32_t place)
{
    return vec3_load_float(near->positions + 3 * (size_t)place);
}

static inline uint32_t near_vertex(const struct near_faces *near, uint32_t corner)
{
    return near->faces[corner / 3].corners[corner % 3];
}

/* The corner that follows in the same face. */
static inline uint32_t near_next(uint32_t corner)
{
    return corner % 3 == 2 ? corner - 2 : corner + 1;
}

/* ---- asking: `place` is on a crack, a, b and `vertex` are vertices of the store ---- */

bool near_are_joined(const struct near_faces *near, uint32_t place, uint32_t vertex);
bool near_has_face(const struct near_faces *near, uint32_t place, uint32_t a, uint32_t b);
/* More faces than is worth the time to look at. */
bool near_has_many_faces(const struct near_faces *near, uint32_t place);
/* Do two places that are to become one have neighbours in common but for the two given ones? */
bool near_share_others(const struct near_faces *near, uint32_t a, uint32_t b, uint32_t allowed,
                       uint32_t also_allowed);
/* Normal, not of length 1, with corner k at `at`. */
struct vec3 near_face_normal(const struct near_face *face, unsigned k, struct vec3 at);
/* Would a face at a vertex be turned over if the vertex went to `at`? */
bool near_turns_face(const struct near_faces *near, uint32_t place, struct vec3 at);

/* ---- changing ---- */

/* The vertex at place `gone` becomes the one at place `stays`. */
void near_move_vertex(struct near_faces *near, uint32_t gone, uint32_t stays);
/* Its corners are to be listed. */
enum status near_add_face(struct near_faces *near, const struct near_face *face) MUST_CHECK;
/* Both do nothing with place NO_INDEX. */
void near_list_corner(struct near_faces *near, uint32_t place, uint32_t corner);
void near_unlist_corner(struct near_faces *near, uint32_t place, uint32_t corner);

#endif
