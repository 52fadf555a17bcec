/*
 * Cutting features out of a store.
 *
 * The walk round a vertex that a loop needs would touch the store at random. But it only passes
 * through faces that go, and these few are gathered while the slabs stream by. So a loop turns, at
 * each of its vertices, through what goes from one of its edges to the next; the fill takes the
 * place of just that sector. The turn of faces round a vertex stays one turn, whatever loops meet
 * there: the result is a manifold as long as no diagonal repeats an edge (topology_fill.c).
 */
#include "simplify/topology_surgery.h"

#include <string.h>

#include "base/memory.h"
#include "simplify/patchify.h"

/* ---- beginning and end ---- */

enum status surgery_begin(struct surgery *surgery)
{
    const struct topology *topology = &store_info(surgery->store)->topology;
    enum status status = memory_take_zeroed(surgery->ctx, bit_words(topology->faces),
                                            sizeof *surgery->dropped, &surgery->dropped);
    if (status == STATUS_OK)
        status = memory_take_zeroed(surgery->ctx, bit_words(topology->vertices),
                                    sizeof *surgery->used, &surgery->used);
    return status;
}

void surgery_clear(struct surgery *surgery)
{
    struct context *ctx = surgery->ctx;
    if (!surgery->store)
        return;
    const struct topology *topology = &store_info(surgery->store)->topology;
    memory_release(ctx, &surgery->dropped, bit_words(topology->faces), sizeof *surgery->dropped);
    memory_release(ctx, &surgery->used, bit_words(topology->vertices), sizeof *surgery->used);
    memory_release(ctx, &surgery->walls, surgery->wall_capacity, sizeof *surgery->walls);
    memory_release(ctx, &surgery->borders, surgery->border_capacity, sizeof *surgery->borders);
    memory_release(ctx, &surgery->corners, surgery->corner_capacity, sizeof *surgery->corners);
    memory_release(ctx, &surgery->loops, surgery->loop_capacity, sizeof *surgery->loops);
    memory_release(ctx, &surgery->rim_vertices, surgery->rim_capacity,
                   sizeof *surgery->rim_vertices);
    memory_release(ctx, &surgery->rim_positions, surgery->rim_position_capacity,
                   sizeof *surgery->rim_positions);
    memory_release(ctx, &surgery->small_faces, surgery->small_face_capacity,
                   sizeof *surgery->small_faces);
    memory_release(ctx, &surgery->mended, surgery->mended_capacity, sizeof *surgery->mended);
    memory_release(ctx, &surgery->fills, surgery->fill_capacity, sizeof *surgery->fills);
    memory_release(ctx, &surgery->centres, surgery->centre_capacity, sizeof *surgery->centres);
    pair_set_clear(ctx, &surgery->taken);
    memset(surgery, 0, sizeof *surgery);
}

/* ---- first sweep: what goes ---- */

static enum status add_wall(struct surgery *surgery, const struct slab *slab, uint32_t face,
                            uint32_t feature)
{
    enum status status = memory_reserve(surgery->ctx, &surgery->walls, &surgery->wall_capacity,
                                        surgery->wall_count + 1, sizeof *surgery->walls);
    if (status != STATUS_OK)
        return status;
    struct wall_face *wall = &surgery->walls[surgery->wall_count++];
    wall->face = slab->face_first + face;
    wall->feature = feature;
    wall->mates = slab->mates[face];
    memcpy(wall->vertices, slab->faces + 3 * (size_t)face, sizeof wall->vertices);
    memcpy(wall->neighbours, slab->neighbours + 3 * (size_t)face, sizeof wall->neighbours);
    return STATUS_OK;
}

static enum status cut_slab(struct surgery *surgery, const struct slab *slab,
                            const uint32_t *labels, const uint32_t *of_patch,
                            const struct feature_list *list)
{
    enum status status = STATUS_OK;
    for (uint32_t f = 0; f < slab->face_count && status == STATUS_OK; f++) {
        uint32_t feature = of_patch[labels[f]];
        if (feature == NO_INDEX)
            continue;
        bit_set(surgery->dropped, slab->face_first + f);
        surgery->dropped_count++;
        if (list->features[feature].kind != FEATURE_COMPONENT)
            status = add_wall(surgery, slab, f, feature);
    }
    return status;
}

/* Border edges of what stays. */
static enum status gather_borders(struct surgery *surgery, const struct slab *slab)
{
    for (uint32_t f = 0; f < slab->face_count; f++) {
        if (bit_is_set(surgery->dropped, slab->face_first + f))
            continue;
        for (unsigned k = 0; k < 3; k++) {
            if (slab->neighbours[3 * (size_t)f + k] != NO_INDEX)
                continue;
            enum status status =
                memory_reserve(surgery->ctx, &surgery->borders, &surgery->border_capacity,
                               surgery->border_count + 1, sizeof *surgery->borders);
            if (status != STATUS_OK)
                return status;
            struct border_edge *edge = &surgery->borders[surgery->border_count++];
            edge->from = slab->faces[3 * (size_t)f + k];
            edge->to = slab->faces[3 * (size_t)f + next3(k)];
            memcpy(edge->position, slab_position(slab, edge->from), sizeof edge->position);
        }
    }
    return STATUS_OK;
}

enum status surgery_cut(struct surgery *surgery, const struct patch_options *options,
                        const uint32_t *of_patch, const struct feature_list *list)
{
    struct context *ctx = surgery->ctx;
    const struct store_info *info = store_info(surgery->store);
    struct patch_workspace space = {0};
    uint32_t *labels = NULL;
    size_t label_capacity = 0;
    uint64_t base = 0;
    enum status status = STATUS_OK;
    memset(surgery->dropped, 0, bit_words(info->topology.faces) * sizeof *surgery->dropped);
    surgery->dropped_count = surgery->wall_count = surgery->border_count = 0;
    surgery->corner_count = surgery->loop_count = surgery->mended_count = 0;
    for (uint32_t i = 0; i < info->slab_count && status == STATUS_OK; i++) {
        struct slab slab;
        uint32_t patch_count = 0;
        status = step(ctx, "cut", i, info->slab_count);
        if (status == STATUS_OK)
            status = slab_open(surgery->store, i, &slab);
        if (status != STATUS_OK)
            break;
        if (of_patch) {
            status = memory_reserve(ctx, &labels, &label_capacity, slab.face_count, sizeof *labels);
            if (status == STATUS_OK)
                status = patch_grow(ctx, &slab, options, &space, labels, &patch_count);
            if (status == STATUS_OK)
                status = cut_slab(surgery, &slab, labels, of_patch + base, list);
            base += patch_count;
        }
        if (status == STATUS_OK)
            status = gather_borders(surgery, &slab);
        slab_close(&slab);
    }
    patch_workspace_clear(ctx, &space);
    memory_release(ctx, &labels, label_capacity, sizeof *labels);
    return status;
}

/* ---- loops round what goes ---- */

static bool is_dropped(const struct surgery *surgery, uint32_t face)
{
    return face != NO_INDEX && bit_is_set(surgery->dropped, face);
}

enum status surgery_add_loop(struct surgery *surgery, const uint32_t *corners, uint32_t count,
                             uint32_t feature, bool is_crack)
{
    struct context *ctx = surgery->ctx;
    enum status status = memory_reserve(ctx, &surgery->corners, &surgery->corner_capacity,
                                        surgery->corner_count + count, sizeof *surgery->corners);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &surgery->loops, &surgery->loop_capacity,
                                surgery->loop_count + 1, sizeof *surgery->loops);
    if (status != STATUS_OK)
        return status;
    surgery->loops[surgery->loop_count++] =
        (struct fill_loop){surgery->corner_count, count, feature, is_crack};
    memcpy(surgery->corners + surgery->corner_count, corners, count * sizeof *corners);
    surgery->corner_count += count;
    return STATUS_OK;
}

struct wall_edge {
    size_t wall;
    unsigned edge;
};

/* The edge of the loop that follows: round the end of `at` through walls. False at a border. */
static bool next_wall_edge(const struct surgery *surgery, struct wall_edge *at)
{
    for (;;) {
        const struct wall_face *wall = &surgery->walls[at->wall];
        at->edge = next3(at->edge);
        uint32_t neighbour = wall->neighbours[at->edge];
        if (neighbour == NO_INDEX)
            return false;
        if (!is_dropped(surgery, neighbour))
            return true;
        unsigned mate = wall->mates >> (2 * at->edge) & 3;
        /* Walls come in the order of the faces. */
        at->wall =
            find_number(surgery->walls, sizeof *surgery->walls, surgery->wall_count, neighbour);
        at->edge = mate;
    }
}

static enum status walk_wall_loop(struct surgery *surgery, struct wall_edge first, uint8_t *visited,
                                  uint32_t **corners, size_t *capacity, uint8_t *blocked)
{
    struct wall_edge at = first;
    uint32_t count = 0, feature = surgery->walls[first.wall].feature;
    do {
        enum status status =
            memory_reserve(surgery->ctx, corners, capacity, (size_t)count + 1, sizeof **corners);
        if (status != STATUS_OK)
            return status;
        (*corners)[count++] = surgery->walls[at.wall].vertices[at.edge];
        visited[at.wall] |= (uint8_t)(1 << at.edge);
        if (!next_wall_edge(surgery, &at)) {
            blocked[feature] = 1; /* the feature meets the border of the mesh */
            return STATUS_OK;
        }
    } while (at.wall != first.wall || at.edge != first.edge);
    if (count < 3) {
        blocked[feature] = 1;
        return STATUS_OK;
    }
    return surgery_add_loop(surgery, *corners, count, feature, false);
}

enum status surgery_loops(struct surgery *surgery, uint8_t *blocked)
{
    struct context *ctx = surgery->ctx;
    uint8_t *visited;
    uint32_t *corners = NULL;
    size_t capacity = 0;
    enum status status = memory_take_zeroed(ctx, surgery->wall_count, 1, &visited);
    for (size_t w = 0; w < surgery->wall_count && status == STATUS_OK; w++)
        for (unsigned k = 0; k < 3 && status == STATUS_OK; k++) {
            uint32_t neighbour = surgery->walls[w].neighbours[k];
            if (neighbour == NO_INDEX || is_dropped(surgery, neighbour) || visited[w] >> k & 1)
                continue;
            status = walk_wall_loop(surgery, (struct wall_edge){w, k}, visited, &corners, &capacity,
                                    blocked);
        }
    memory_release(ctx, &visited, surgery->wall_count, 1);
    memory_release(ctx, &corners, capacity, sizeof *corners);
    return status;
}
