/*
 * The faces near cracks, gathered in one sweep over the slabs; every vertex on a crack has the list
 * of its corners in them, so that what is round it can be asked for and changed without the store.
 */
#include "simplify/topology_near.h"

#include <string.h>

#include "base/forest.h"
#include "base/memory.h"

uint32_t near_place(const struct near_faces *near, uint32_t vertex)
{
    size_t at = find_number(near->vertices, sizeof *near->vertices, near->vertex_count, vertex);
    return at < near->vertex_count && near->vertices[at] == vertex ? (uint32_t)at : NO_INDEX;
}

/* Corners of all cracks, listed in order; their bits are set in surgery->used. */
static enum status list_vertices(struct near_faces *near)
{
    struct surgery *surgery = near->surgery;
    struct context *ctx = surgery->ctx;
    size_t words = bit_words(store_info(surgery->store)->topology.vertices), count = 0;
    memset(surgery->used, 0, words * sizeof *surgery->used);
    for (size_t i = 0; i < surgery->loop_count; i++)
        for (uint32_t k = 0; k < surgery->loops[i].count && surgery->loops[i].is_crack; k++)
            bit_set(surgery->used, surgery->corners[surgery->loops[i].first + k]);
    for (size_t w = 0; w < words; w++)
        count += bit_count(surgery->used[w]);
    near->vertex_count = count;
    enum status status = memory_take(ctx, count, sizeof *near->vertices, &near->vertices);
    if (status == STATUS_OK)
        status = memory_take(ctx, 3 * count, sizeof *near->positions, &near->positions);
    if (status == STATUS_OK)
        status = memory_take(ctx, count, sizeof *near->first_corner, &near->first_corner);
    if (status == STATUS_OK)
        status = memory_take(ctx, count, sizeof *near->last_corner, &near->last_corner);
    if (status == STATUS_OK)
        status = memory_take(ctx, count, sizeof *near->moved_to, &near->moved_to);
    if (status == STATUS_OK)
        status = memory_take(ctx, count + 1, sizeof *near->parents, &near->parents);
    if (status != STATUS_OK)
        return status;
    for (uint32_t i = 0; i <= count; i++)
        near->parents[i] = i;
    memset(near->first_corner, 0xff, count * sizeof *near->first_corner);
    memset(near->moved_to, 0xff, count * sizeof *near->moved_to);
    bits_list(surgery->used, words, near->vertices);
    return STATUS_OK;
}

enum status near_add_face(struct near_faces *near, const struct near_face *face)
{
    struct context *ctx = near->surgery->ctx;
    enum status status = memory_reserve(ctx, &near->faces, &near->face_capacity,
                                        near->face_count + 1, sizeof *near->faces);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &near->next_corner, &near->corner_capacity,
                                3 * (near->face_count + 1), sizeof *near->next_corner);
    if (status == STATUS_OK)
        near->faces[near->face_count++] = *face;
    return status;
}

void near_list_corner(struct near_faces *near, uint32_t place, uint32_t corner)
{
    if (place == NO_INDEX)
        return;
    near->next_corner[corner] = NO_INDEX;
    if (near->first_corner[place] == NO_INDEX)
        near->first_corner[place] = corner;
    else
        near->next_corner[near->last_corner[place]] = corner;
    near->last_corner[place] = corner;
}

void near_unlist_corner(struct near_faces *near, uint32_t place, uint32_t corner)
{
    uint32_t before = NO_INDEX, at = place == NO_INDEX ? NO_INDEX : near->first_corner[place];
    while (at != NO_INDEX && at != corner) {
        before = at;
        at = near->next_corner[at];
    }
    if (at == NO_INDEX)
        return;
    if (before == NO_INDEX)
        near->first_corner[place] = near->next_corner[corner];
    else
        near->next_corner[before] = near->next_corner[corner];
    if (near->last_corner[place] == corner)
        near->last_corner[place] = before;
}

static enum status gather_slab(struct near_faces *near, const struct slab *slab)
{
    const struct surgery *surgery = near->surgery;
    enum status status = STATUS_OK;
    for (uint32_t f = 0; f < slab->face_count && status == STATUS_OK; f++) {
        const uint32_t *corners = slab->faces + 3 * (size_t)f;
        if (bit_is_set(surgery->dropped, slab->face_first + f) ||
            !(bit_is_set(surgery->used, corners[0]) || bit_is_set(surgery->used, corners[1]) ||
              bit_is_set(surgery->used, corners[2])))
            continue;
        struct near_face face = {.source = slab->face_first + f};
        uint32_t places[3] = {0, 0, 0};
        memcpy(face.corners, corners, sizeof face.corners);
        for (unsigned k = 0; k < 3; k++)
            memcpy(face.points[k], slab_position(slab, corners[k]), sizeof face.points[k]);
        status = near_add_face(near, &face);
        for (uint32_t k = 0; k < 3 && status == STATUS_OK; k++) {
            uint32_t place = near_place(near, corners[k]);
            near_list_corner(near, place, 3 * (uint32_t)(near->face_count - 1) + k);
            if (place != NO_INDEX)
                memcpy(near->positions + 3 * (size_t)place, face.points[k], sizeof face.points[k]);
            places[k] = place != NO_INDEX ? place : (uint32_t)near->vertex_count;
        }
        forest_join(near->parents, places[0], places[1]);
        forest_join(near->parents, places[0], places[2]);
    }
    return status;
}

enum status near_gather(struct near_faces *near)
{
    struct store *store = near->surgery->store;
    enum status status = list_vertices(near);
    const uint32_t slab_count = near->vertex_count > 0 ? store_info(store)->slab_count : 0;
    for (uint32_t i = 0; i < slab_count && status == STATUS_OK; i++) {
        struct slab slab;
        status = slab_open(store, i, &slab);
        if (status != STATUS_OK)
            break;
        status = gather_slab(near, &slab);
        slab_close(&slab);
    }
    return status;
}

/* ---- looking round a vertex ---- */

bool near_are_joined(const struct near_faces *near, uint32_t place, uint32_t vertex)
{
    for (uint32_t c = near->first_corner[place]; c != NO_INDEX; c = near->next_corner[c])
        if (near_vertex(near, near_next(c)) == vertex ||
            near_vertex(near, near_next(near_next(c))) == vertex)
            return true;
    return false;
}

bool near_has_face(const struct near_faces *near, uint32_t place, uint32_t a, uint32_t b)
{
    for (uint32_t c = near->first_corner[place]; c != NO_INDEX; c = near->next_corner[c]) {
        uint32_t side = near_vertex(near, near_next(c));
        uint32_t other = near_vertex(near, near_next(near_next(c)));
        if ((side == a && other == b) || (side == b && other == a))
            return true;
    }
    return false;
}

/* A vertex of more faces is no end of a crack that is worth the time. */
enum { DEGREE_MAX = 1000 };

bool near_has_many_faces(const struct near_faces *near, uint32_t place)
{
    unsigned count = 0;
    for (uint32_t c = near->first_corner[place]; c != NO_INDEX && count <= DEGREE_MAX;
         c = near->next_corner[c])
        count++;
    return count > DEGREE_MAX;
}

bool near_share_others(const struct near_faces *near, uint32_t a, uint32_t b, uint32_t allowed,
                       uint32_t also_allowed)
{
    for (uint32_t c = near->first_corner[a]; c != NO_INDEX; c = near->next_corner[c]) {
        uint32_t side = near_next(c);
        for (unsigned k = 0; k < 2; k++, side = near_next(side)) {
            uint32_t vertex = near_vertex(near, side);
            if (vertex != allowed && vertex != also_allowed && near_are_joined(near, b, vertex))
                return true;
        }
    }
    return false;
}

struct vec3 near_face_normal(const struct near_face *face, unsigned k, struct vec3 at)
{
    struct vec3 p[3];
    for (unsigned i = 0; i < 3; i++)
        p[i] = vec3_load_float(face->points[i]);
    p[k] = at;
    return triangle_normal(p[0], p[1], p[2]);
}

bool near_turns_face(const struct near_faces *near, uint32_t place, struct vec3 at)
{
    struct vec3 old = near_position(near, place);
    if (vec3_distance_squared(old, at) == 0)
        return false;
    for (uint32_t c = near->first_corner[place]; c != NO_INDEX; c = near->next_corner[c]) {
        const struct near_face *face = &near->faces[c / 3];
        struct vec3 before = near_face_normal(face, c % 3, old),
                    after = near_face_normal(face, c % 3, at);
        if (vec3_length_squared(before) > 0 && !(vec3_dot(before, after) > 0))
            return true;
    }
    return false;
}

void near_move_vertex(struct near_faces *near, uint32_t gone, uint32_t stays)
{
    for (uint32_t c = near->first_corner[gone]; c != NO_INDEX; c = near->next_corner[c]) {
        struct near_face *face = &near->faces[c / 3];
        face->corners[c % 3] = near->vertices[stays];
        memcpy(face->points[c % 3], near->positions + 3 * (size_t)stays,
               sizeof face->points[c % 3]);
        face->is_changed = true;
    }
    near->next_corner[near->last_corner[stays]] = near->first_corner[gone];
    near->last_corner[stays] = near->last_corner[gone];
    near->first_corner[gone] = NO_INDEX;
    near->moved_to[gone] = stays;
}

void near_clear(struct near_faces *near)
{
    struct context *ctx = near->surgery->ctx;
    const size_t vertices = near->vertex_count;
    memory_release(ctx, &near->vertices, vertices, sizeof *near->vertices);
    memory_release(ctx, &near->positions, 3 * vertices, sizeof *near->positions);
    memory_release(ctx, &near->first_corner, vertices, sizeof *near->first_corner);
    memory_release(ctx, &near->last_corner, vertices, sizeof *near->last_corner);
    memory_release(ctx, &near->parents, vertices + 1, sizeof *near->parents);
    memory_release(ctx, &near->moved_to, vertices, sizeof *near->moved_to);
    memory_release(ctx, &near->faces, near->face_capacity, sizeof *near->faces);
    memory_release(ctx, &near->next_corner, near->corner_capacity, sizeof *near->next_corner);
}
