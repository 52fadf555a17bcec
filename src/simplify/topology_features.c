/*
 * From rims to features.
 *
 * The dissertation looks for the partner of each loop through the wall patches, loop by loop.
 * Cutting the surface along all rims at once says the same of any number of loops: the connected
 * pieces that are left are what lies between rims. A piece that has all its rims on its wall side
 * is a feature (one rim: a bump or cavity, two or more: a hole); one that has the flat side of a
 * rim carries other features and goes only when all those are gone, so that a pocket in the top of
 * a bump goes with the bump, and a small bore in a large one goes without it.
 *
 * A piece that has one end small only, or is no wall at all, is not cut off and stays: the surface
 * is never opened.
 */
#include "simplify/topology_features.h"

#include <string.h>

#include "base/forest.h"
#include "base/memory.h"
#include "simplify/topology_pieces.h"

/* Normals that differ from a loop's by less than 45 degrees are not steep. */
static const double steep_cosine = 0.70710678118654757;
/* Of the area that walls of a feature's depth would have, the least that must be steep. */
static const double steep_share = 0.1;
/* Depth of a bump or cavity by the size of its loop, below which it is noise. */
static const double least_depth = 1e-3;

struct finder {
    struct piece_set set;
    const struct rim_options *options;
    bool keep_pipes;
    uint32_t *gone;   /* a patch: 0 it stays, 1 it goes */
    uint8_t *visited; /* a half-edge */
    uint32_t *queue;
    uint32_t queue_begin, queue_end;
    struct loop_points points;
    double *extent_points;
    size_t extent_capacity;
};

void feature_list_clear(struct context *ctx, struct feature_list *list)
{
    memory_release(ctx, &list->features, list->capacity, sizeof *list->features);
    memset(list, 0, sizeof *list);
}

enum status feature_list_add(struct context *ctx, struct feature_list *list,
                             const struct feature *feature)
{
    enum status status = memory_reserve(ctx, &list->features, &list->capacity, list->count + 1,
                                        sizeof *list->features);
    if (status == STATUS_OK)
        list->features[list->count++] = *feature;
    return status;
}

/* ---- is it a feature? ---- */

/* What its loops tell of a piece. */
struct outline {
    uint32_t loops, concave_loops;
    double size;                /* of the largest loop */
    struct vec3 centre, normal; /* of the largest loop, the normal away from the wall's flat side */
};

static void set_gone(struct finder *finder, const struct piece *piece, uint32_t gone)
{
    for (uint32_t i = 0; i < piece->patch_count; i++)
        finder->gone[finder->set.patches[piece->first_patch + i]] = gone;
}

/* The same with its followers. */
static void set_all_gone(struct finder *finder, const struct piece *piece, uint32_t gone)
{
    set_gone(finder, piece, gone);
    for (uint32_t i = piece->follower; i != NO_INDEX; i = finder->set.pieces[i].next_follower)
        set_gone(finder, &finder->set.pieces[i], gone);
}

/* True when h runs between what stays (left) and what goes (right). */
static bool is_outline(const struct finder *finder, uint32_t h)
{
    uint32_t left = patch_of(&finder->set, h), right = patch_of(&finder->set, h ^ 1);
    return left != NO_PATCH && right != NO_PATCH && !finder->gone[left] && finder->gone[right];
}

/* The loops between what stays and what goes along the cut edges of one piece. */
static enum status trace_outline(struct finder *finder, const struct piece *piece,
                                 struct outline *outline)
{
    struct context *ctx = finder->set.graph->ctx;
    enum status status = STATUS_OK;
    for (uint32_t i = 0; i < piece->edge_count && status == STATUS_OK; i++) {
        uint32_t first = finder->set.edges[piece->first_edge + i] ^ 1;
        struct surface_loop loop;
        double size = 0;
        if (finder->visited[first] || !is_outline(finder, first))
            continue;
        status = loop_trace(finder->set.graph, finder->gone, first, &finder->points, &loop);
        if (status == STATUS_OK)
            status = loop_size(ctx, &finder->points, finder->options->measure, loop.normal, &size);
        for (uint32_t k = 0; k < finder->points.count; k++)
            finder->visited[finder->points.half_edges[k]] = 1;
        outline->loops++;
        outline->concave_loops += loop.convexity < 0;
        if (outline->loops == 1 || size > outline->size) {
            outline->size = size;
            outline->centre = loop.centre;
            outline->normal = loop.normal;
        }
    }
    return status;
}

/* Visits must be undone where the piece stays, and are done anew for the final features. */
static void forget_visits(struct finder *finder, const struct piece *piece)
{
    for (uint32_t i = 0; i < piece->edge_count; i++) {
        uint32_t first = finder->set.edges[piece->first_edge + i] ^ 1, h = first;
        if (!finder->visited[first])
            continue;
        do {
            finder->visited[h] = 0;
            h = loop_next(finder->set.graph, finder->gone, h);
        } while (finder->visited[h]);
    }
}

/* Steep area and depth: a ring of a gentle swell is no wall. */
static bool has_walls(const struct finder *finder, const struct piece *piece,
                      const struct outline *outline)
{
    const struct chain_graph *graph = finder->set.graph;
    double steep = 0, low = 0, high = 0;
    for (uint32_t i = 0; i < piece->patch_count; i++) {
        uint32_t patch = finder->set.patches[piece->first_patch + i];
        const struct graph_patch *record = &graph->patches[patch];
        uint32_t h = record->half_edge;
        if (fabs(vec3_dot(patch_normal(graph, patch), outline->normal)) < steep_cosine)
            steep += (double)record->area;
        do {
            struct vec3 at = vertex_point(graph, graph->half_edges[h].origin);
            double height = vec3_dot(vec3_sub(at, outline->centre), outline->normal);
            low = height < low ? height : low;
            high = height > high ? height : high;
            h = graph->half_edges[h].next;
        } while (h != record->half_edge);
    }
    if (outline->loops == 1 && high - low < least_depth * outline->size)
        return false;
    return steep >= steep_share * (high - low) * outline->size;
}

/* A loop inside, parallel to the opening and not small: the head of a mushroom, the chamber behind
 * a neck. */
static bool widens_inside(const struct finder *finder, const struct piece *piece,
                          const struct outline *outline)
{
    for (uint32_t i = piece->large; i != NO_INDEX; i = finder->set.large_next[i]) {
        const struct large_loop *large = &finder->set.rims.large[i];
        uint32_t right = patch_of(&finder->set, large->first ^ 1);
        if (right != NO_PATCH && finder->gone[right] &&
            fabs(vec3_dot(large->normal, outline->normal)) > steep_cosine)
            return true;
    }
    return false;
}

static enum status extent_of(struct finder *finder, const struct piece *piece, double *extent)
{
    const struct chain_graph *graph = finder->set.graph;
    struct context *ctx = graph->ctx;
    size_t count = 0;
    for (uint32_t i = 0; i < piece->patch_count; i++) {
        const struct graph_patch *record =
            &graph->patches[finder->set.patches[piece->first_patch + i]];
        uint32_t h = record->half_edge;
        do {
            enum status status =
                memory_reserve(ctx, &finder->extent_points, &finder->extent_capacity,
                               3 * (count + 1), sizeof *finder->extent_points);
            if (status != STATUS_OK)
                return status;
            vec3_store(finder->extent_points + 3 * count++,
                       vertex_point(graph, graph->half_edges[h].origin));
            h = graph->half_edges[h].next;
        } while (h != record->half_edge);
    }
    return points_diameter(ctx, &finder->points, finder->extent_points, count,
                           finder->options->size, extent);
}

/* Other pieces to which a piece has uncut ties only through `piece`, and that are small as a whole:
 * the head of a mushroom. They go with it. Counts the neighbours that stay. */
static bool is_small_end(const struct finder *finder, uint32_t index, uint32_t stem)
{
    const struct piece *piece = &finder->set.pieces[index];
    struct vec3 sides = vec3_sub(piece->high, piece->low);
    double size = finder->options->size;
    if (piece->state == PIECE_FOLLOWS)
        return false;
    if (sides.x >= size || sides.y >= size || sides.z >= size || piece->large != NO_INDEX)
        return false;
    for (uint32_t i = 0; i < piece->edge_count; i++) {
        uint32_t other = patch_of(&finder->set, finder->set.edges[piece->first_edge + i] ^ 1);
        if (other == NO_PATCH || (finder->set.piece_of[other] != stem && !finder->gone[other]))
            return false;
    }
    return true;
}

static uint32_t swallow_small_ends(struct finder *finder, uint32_t index)
{
    struct piece *piece = &finder->set.pieces[index];
    uint32_t swallowed = 0, largest = NO_INDEX;
    bool all_small = true;
    for (uint32_t i = 0; i < piece->edge_count; i++) {
        uint32_t patch = patch_of(&finder->set, finder->set.edges[piece->first_edge + i] ^ 1);
        if (patch == NO_PATCH || finder->gone[patch])
            continue;
        uint32_t other = finder->set.piece_of[patch];
        if (!is_small_end(finder, other, index))
            all_small = false;
        else if (largest == NO_INDEX ||
                 vec3_distance(finder->set.pieces[other].low, finder->set.pieces[other].high) >
                     vec3_distance(finder->set.pieces[largest].low,
                                   finder->set.pieces[largest].high))
            largest = other;
    }
    for (uint32_t i = 0; i < piece->edge_count; i++) {
        uint32_t patch = patch_of(&finder->set, finder->set.edges[piece->first_edge + i] ^ 1);
        if (patch == NO_PATCH || finder->gone[patch])
            continue;
        uint32_t other = finder->set.piece_of[patch];
        if ((all_small && other == largest) || !is_small_end(finder, other, index))
            continue;
        set_all_gone(finder, &finder->set.pieces[other], 1);
        finder->set.pieces[other].state = PIECE_GOES;
        swallowed++;
    }
    return swallowed;
}

static enum status judge_outline(struct finder *finder, uint32_t index, bool *goes, bool *is_flat)
{
    struct piece *piece = &finder->set.pieces[index];
    struct outline outline = {0};
    double size = 0;
    *goes = *is_flat = false;
    enum status status = trace_outline(finder, piece, &outline);
    if (status != STATUS_OK)
        return status;
    size = outline.size;
    if (status == STATUS_OK && finder->options->measure == LOOP_EXTENT && outline.loops > 0)
        status = extent_of(finder, piece, &size);
    *is_flat = outline.loops == 1 && !has_walls(finder, piece, &outline);
    *goes = outline.loops > 0 && size < finder->options->size &&
            has_walls(finder, piece, &outline) && !widens_inside(finder, piece, &outline) &&
            (!finder->keep_pipes || outline.concave_loops < 2);
    forget_visits(finder, piece);
    return status;
}

/* The one other piece that is left round a piece, or NO_INDEX. */
static uint32_t only_neighbour(const struct finder *finder, const struct piece *piece)
{
    uint32_t only = NO_INDEX;
    for (uint32_t i = 0; i < piece->edge_count; i++) {
        uint32_t patch = patch_of(&finder->set, finder->set.edges[piece->first_edge + i] ^ 1);
        if (patch != NO_PATCH && finder->gone[patch])
            continue;
        if (patch == NO_PATCH || (only != NO_INDEX && only != finder->set.piece_of[patch]))
            return NO_INDEX;
        only = finder->set.piece_of[patch];
    }
    return only;
}

/* What has no walls was parted from its neighbour by noise only: it is a part of it, with all that
 * follows it, and that one need not wait for it. */
static void follow_neighbour(struct finder *finder, uint32_t index)
{
    struct piece *piece = &finder->set.pieces[index];
    uint32_t neighbour = only_neighbour(finder, piece);
    if (neighbour == NO_INDEX)
        return;
    struct piece *leader = &finder->set.pieces[neighbour];
    piece->state = PIECE_FOLLOWS;
    piece->next_follower = piece->follower;
    uint32_t last = piece->follower != NO_INDEX ? piece->last_follower : index;
    if (leader->follower == NO_INDEX)
        leader->last_follower = last;
    finder->set.pieces[last].next_follower = leader->follower;
    leader->follower = index;
}

static enum status judge_piece(struct finder *finder, uint32_t index)
{
    struct piece *piece = &finder->set.pieces[index];
    bool goes, is_flat;
    set_all_gone(finder, piece, 1);
    enum status status = judge_outline(finder, index, &goes, &is_flat);
    if (status == STATUS_OK && !goes && finder->keep_pipes && swallow_small_ends(finder, index)) {
        status = judge_outline(finder, index, &goes, &is_flat);
        for (uint32_t i = 0; i < piece->edge_count && !goes; i++) {
            uint32_t patch = patch_of(&finder->set, finder->set.edges[piece->first_edge + i] ^ 1);
            struct piece *other =
                patch == NO_PATCH ? NULL : &finder->set.pieces[finder->set.piece_of[patch]];
            if (other && other->state == PIECE_GOES && other->flat_edges > 0) {
                other->state = PIECE_STAYS;
                set_all_gone(finder, other, 0);
            }
        }
    }
    if (!goes)
        set_all_gone(finder, piece, 0);
    piece->state = goes ? PIECE_GOES : PIECE_STAYS;
    for (uint32_t i = piece->follower; i != NO_INDEX && goes;
         i = finder->set.pieces[i].next_follower)
        finder->set.pieces[i].state = PIECE_GOES;
    if (is_flat && !goes)
        follow_neighbour(finder, index);
    return status;
}

/* ---- one after the other ---- */

static void enqueue(struct finder *finder, uint32_t index)
{
    struct piece *piece = &finder->set.pieces[index];
    if (piece->state == PIECE_STAYS && piece->flat_edges == 0 && piece->wall_edges > 0) {
        piece->state = PIECE_WAITS;
        finder->queue[finder->queue_end++] = index;
    }
}

/* Frees the flat sides of what has gone. Every piece waits at most once, for it waits only when its
 * last flat side is freed. */
static void release_neighbours(struct finder *finder, const struct piece *piece)
{
    for (uint32_t i = 0; i < piece->edge_count; i++) {
        uint32_t h = finder->set.edges[piece->first_edge + i],
                 patch = patch_of(&finder->set, h ^ 1);
        if (patch == NO_PATCH || rim_flat_side(&finder->set.rims, h / 2) == h)
            continue;
        uint32_t other = finder->set.piece_of[patch];
        if (--finder->set.pieces[other].flat_edges == 0)
            enqueue(finder, other);
    }
}

static enum status peel(struct finder *finder)
{
    enum status status = STATUS_OK;
    for (uint32_t i = 0; i < finder->set.piece_count; i++)
        enqueue(finder, i);
    while (finder->queue_begin < finder->queue_end && status == STATUS_OK) {
        uint32_t index = finder->queue[finder->queue_begin++];
        status = judge_piece(finder, index);
        if (status == STATUS_OK && (finder->set.pieces[index].state == PIECE_GOES ||
                                    finder->set.pieces[index].state == PIECE_FOLLOWS))
            release_neighbours(finder, &finder->set.pieces[index]);
    }
    return status;
}

/* ---- what is reported ---- */

/* Pieces that touch and go are one feature. `parents` is a forest over pieces. */
static void join_gone(struct finder *finder, uint32_t *parents)
{
    for (uint32_t i = 0; i < finder->set.piece_count; i++)
        parents[i] = i;
    for (size_t i = 0; i < finder->set.edge_total; i++) {
        uint32_t a = patch_of(&finder->set, finder->set.edges[i]),
                 b = patch_of(&finder->set, finder->set.edges[i] ^ 1);
        if (b != NO_PATCH && finder->gone[a] && finder->gone[b])
            forest_join(parents, finder->set.piece_of[a], finder->set.piece_of[b]);
    }
    for (uint32_t i = 0; i < finder->set.piece_count; i++)
        parents[i] = forest_root(parents, i);
}

static enum feature_kind kind_of(const struct feature *feature, uint32_t concave)
{
    if (feature->loops == 1)
        return concave ? FEATURE_BUMP : FEATURE_CAVITY;
    return concave > 1 ? FEATURE_PIPE : FEATURE_HOLE;
}

static enum status report_features(struct finder *finder, uint32_t *of_patch,
                                   struct feature_list *list)
{
    struct context *ctx = finder->set.graph->ctx;
    uint32_t *parents, *concave = NULL;
    enum status status = memory_take(ctx, finder->set.piece_count, sizeof *parents, &parents);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, finder->set.piece_count, sizeof *concave, &concave);
    if (status != STATUS_OK)
        goto done;
    join_gone(finder, parents);
    /* The queue has served: it holds the features' numbers now, by root. */
    for (uint32_t i = 0; i < finder->set.piece_count && status == STATUS_OK; i++) {
        if (finder->set.pieces[i].state != PIECE_GOES)
            continue;
        uint32_t root = parents[i];
        if (root == i) {
            finder->queue[i] = (uint32_t)list->count;
            status = feature_list_add(ctx, list, &(struct feature){0});
        }
        if (status != STATUS_OK)
            break;
        struct feature *feature = &list->features[finder->queue[root]];
        struct outline outline = {.loops = feature->loops,
                                  .concave_loops = concave[root],
                                  .size = feature->size,
                                  .centre = vec3_load(feature->place)};
        status = trace_outline(finder, &finder->set.pieces[i], &outline);
        feature->loops = outline.loops;
        feature->size = outline.size;
        vec3_store(feature->place, outline.centre);
        concave[root] = outline.concave_loops;
        feature->kind = kind_of(feature, concave[root]);
    }
    for (uint32_t p = 0; p < finder->set.graph->patch_count && status == STATUS_OK; p++)
        if (finder->gone[p])
            of_patch[p] = finder->queue[parents[finder->set.piece_of[p]]];
done:
    memory_release(ctx, &parents, finder->set.piece_count, sizeof *parents);
    memory_release(ctx, &concave, finder->set.piece_count, sizeof *concave);
    return status;
}

static void finder_clear(struct finder *finder)
{
    struct context *ctx = finder->set.graph->ctx;
    const size_t patches = finder->set.graph->patch_count;
    const size_t half_edges = 2 * (size_t)finder->set.graph->edge_count;
    loop_points_clear(ctx, &finder->points);
    memory_release(ctx, &finder->gone, patches, sizeof *finder->gone);
    memory_release(ctx, &finder->visited, half_edges, 1);
    memory_release(ctx, &finder->queue, finder->set.piece_count, sizeof *finder->queue);
    memory_release(ctx, &finder->extent_points, finder->extent_capacity,
                   sizeof *finder->extent_points);
    piece_set_clear(&finder->set);
}

enum status features_find(struct chain_graph *graph, const struct rim_options *options,
                          bool keep_pipes, uint32_t *of_patch, struct feature_list *list)
{
    struct context *ctx = graph->ctx;
    struct finder finder = {.set = {.graph = graph}, .options = options, .keep_pipes = keep_pipes};
    enum status status = rims_find(graph, options, of_patch, &finder.set.rims);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, graph->patch_count, sizeof *finder.gone, &finder.gone);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, 2 * (size_t)graph->edge_count, 1, &finder.visited);
    if (status == STATUS_OK)
        status = pieces_cut(&finder.set);
    if (status == STATUS_OK)
        status = memory_take(ctx, finder.set.piece_count, sizeof *finder.queue, &finder.queue);
    if (status == STATUS_OK)
        status = peel(&finder);
    if (status == STATUS_OK)
        status = report_features(&finder, of_patch, list);
    finder_clear(&finder);
    return status;
}

/* ---- components ---- */

/* Without any rim the pieces are the components. */
static enum status cut_nowhere(struct piece_set *set)
{
    set->rims.half_edge_count = 2 * (size_t)set->graph->edge_count;
    enum status status =
        memory_take_zeroed(set->graph->ctx, set->rims.half_edge_count, 1, &set->rims.strength);
    return status == STATUS_OK ? pieces_cut(set) : status;
}

enum status specks_find(struct chain_graph *graph, double size, uint32_t *of_patch,
                        struct feature_list *list)
{
    struct context *ctx = graph->ctx;
    struct piece_set set = {.graph = graph};
    uint32_t *numbers = NULL;
    enum status status = cut_nowhere(&set);
    if (status == STATUS_OK)
        status = memory_take(ctx, set.piece_count, sizeof *numbers, &numbers);
    for (uint32_t i = 0; i < set.piece_count && status == STATUS_OK; i++) {
        const struct piece *piece = &set.pieces[i];
        struct feature feature = {.kind = FEATURE_COMPONENT,
                                  .size = vec3_distance(piece->low, piece->high)};
        numbers[i] = NO_INDEX;
        if (feature.size >= size)
            continue;
        vec3_store(feature.place, vec3_scale(vec3_add(piece->low, piece->high), 0.5));
        numbers[i] = (uint32_t)list->count;
        status = feature_list_add(ctx, list, &feature);
    }
    for (uint32_t p = 0; p < graph->patch_count && status == STATUS_OK; p++)
        if (numbers[set.piece_of[p]] != NO_INDEX)
            of_patch[p] = numbers[set.piece_of[p]];
    memory_release(ctx, &numbers, set.piece_count, sizeof *numbers);
    piece_set_clear(&set);
    return status;
}
