/*
 * Handles.
 *
 * A loop on the surface goes round a handle or through a tunnel if cutting along it leaves all in
 * one piece; topology_words.h tells that by the edges that it crosses.
 *
 * Shortest paths from a patch, up to a bounded length, and one more edge then give the shortest
 * such loop near it (Erickson & Har-Peled 2004); patches in a net of a part of the size are enough.
 * Loops whose words are independent and that share no patch can be cut together. Then all is done
 * again with what is left, until nothing is found.
 */
#include "simplify/topology_handles.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "simplify/topology_words.h"

/* A loop of diameter 1 that is no longer than its own convex hull's outline. */
static const double longest_loop = 3.1415926535897931;
/* Distance of the patches from which loops are looked for, by the size. */
static const double net_share = 0.25;

enum {
    RANK_MAX = 48,     /* independent words of one round; words have 64 bits */
    ISLAND_MAX = 1024, /* patches inside of a ring that go with it */
    ROUNDS_MAX = 64
};

struct heap_entry {
    double distance;
    uint32_t patch;
};

/* What the search from one patch knows of another. */
struct reached {
    double distance;
    uint64_t word;
    uint32_t search; /* the number of the search that this is of */
    uint32_t from;   /* half-edge by which it was entered, on the side it came from; NO_INDEX */
    bool is_settled;
};

struct finder {
    struct chain_graph *graph;
    double size;
    struct edge_words words;
    struct vec3 *middles;
    uint8_t *is_near;  /* a patch: near one that was searched from */
    uint8_t *is_clear; /* a patch: there, and so are all its neighbours */
    struct reached *reached;
    uint32_t searches;
    struct heap_entry *heap;
    size_t heap_count, heap_capacity;
    uint32_t *ring; /* patches of a loop, and what it encloses */
    size_t ring_count, ring_capacity;
    size_t loop_count; /* of these, the loop's own */
    double *points;
    size_t point_capacity;
    struct loop_points scratch;
    uint64_t basis[64]; /* of the words of the round, by highest bit */
    unsigned rank;
};

static uint32_t patch_at(const struct finder *finder, uint32_t h)
{
    return finder->graph->half_edges[h].patch;
}

/* ---- short loops ---- */

static enum status heap_push(struct finder *finder, double distance, uint32_t patch)
{
    enum status status = memory_reserve(finder->graph->ctx, &finder->heap, &finder->heap_capacity,
                                        finder->heap_count + 1, sizeof *finder->heap);
    if (status != STATUS_OK)
        return status;
    size_t at = finder->heap_count++;
    for (; at > 0 && finder->heap[(at - 1) / 2].distance > distance; at = (at - 1) / 2)
        finder->heap[at] = finder->heap[(at - 1) / 2];
    finder->heap[at] = (struct heap_entry){distance, patch};
    return STATUS_OK;
}

static struct heap_entry heap_pop(struct finder *finder)
{
    struct heap_entry top = finder->heap[0], last = finder->heap[--finder->heap_count];
    size_t at = 0, child;
    while ((child = 2 * at + 1) < finder->heap_count) {
        child += child + 1 < finder->heap_count &&
                 finder->heap[child + 1].distance < finder->heap[child].distance;
        if (finder->heap[child].distance >= last.distance)
            break;
        finder->heap[at] = finder->heap[child];
        at = child;
    }
    finder->heap[at] = last;
    return top;
}

static struct reached *reach(struct finder *finder, uint32_t patch)
{
    struct reached *reached = &finder->reached[patch];
    if (reached->search != finder->searches)
        *reached =
            (struct reached){.distance = INFINITY, .search = finder->searches, .from = NO_INDEX};
    return reached;
}

/* The loop that a search has found: the half-edge that closes it. */
struct found {
    double length; /* INFINITY: none */
    uint32_t closing;
    uint64_t word;
};

/* Looks at all neighbours of a patch that has been settled. */
static enum status settle(struct finder *finder, uint32_t patch, double most, struct found *best)
{
    const struct chain_graph *graph = finder->graph;
    struct reached *own = reach(finder, patch);
    uint32_t first = graph->patches[patch].half_edge, h = first;
    enum status status = STATUS_OK;
    do {
        uint32_t other = patch_at(finder, h ^ 1);
        if (finder->is_clear[other] && other != patch) {
            struct reached *there = reach(finder, other);
            double length = vec3_distance(finder->middles[patch], finder->middles[other]);
            uint64_t word = own->word ^ finder->words.word[h / 2];
            if (there->is_settled) {
                double whole = own->distance + length + there->distance;
                if ((word ^ there->word) != 0 && whole < best->length)
                    *best = (struct found){whole, h, word ^ there->word};
            } else if (own->distance + length < there->distance && own->distance + length < most) {
                there->distance = own->distance + length;
                there->word = word;
                there->from = h;
                status = heap_push(finder, there->distance, other);
            }
        }
        h = graph->half_edges[h].next;
    } while (h != first && status == STATUS_OK);
    return status;
}

/* The shortest loop through `root` that goes round something, of a length below `most`. `near`:
 * patches nearer than it need not be searched from. */
static enum status search_from(struct finder *finder, uint32_t root, double most, double near,
                               struct found *best)
{
    *best = (struct found){.length = most};
    best->closing = NO_INDEX;
    finder->searches++;
    finder->heap_count = 0;
    reach(finder, root)->distance = 0;
    enum status status = heap_push(finder, 0, root);
    while (finder->heap_count > 0 && status == STATUS_OK) {
        struct heap_entry entry = heap_pop(finder);
        struct reached *own = reach(finder, entry.patch);
        if (own->is_settled)
            continue;
        if (entry.distance > best->length / 2)
            break;
        own->is_settled = true;
        if (entry.distance <= near)
            finder->is_near[entry.patch] = 1;
        status = settle(finder, entry.patch, most / 2 + near, best);
    }
    return status;
}

/* ---- rings ---- */

static enum status add_to_ring(struct finder *finder, uint32_t patch)
{
    enum status status = memory_reserve(finder->graph->ctx, &finder->ring, &finder->ring_capacity,
                                        finder->ring_count + 1, sizeof *finder->ring);
    if (status == STATUS_OK)
        finder->ring[finder->ring_count++] = patch;
    return status;
}

/* The patch before one on the way from the root, or NO_INDEX. */
static uint32_t before(struct finder *finder, uint32_t patch)
{
    uint32_t from = reach(finder, patch)->from;
    return from == NO_INDEX ? NO_INDEX : patch_at(finder, from);
}

/* The patches of the loop, without the way from the root that it runs twice. */
static enum status take_ring(struct finder *finder, const struct found *found)
{
    uint32_t ends[2] = {patch_at(finder, found->closing), patch_at(finder, found->closing ^ 1)};
    uint32_t meeting = NO_INDEX;
    enum status status = STATUS_OK;
    finder->ring_count = 0;
    for (uint32_t p = ends[0]; p != NO_INDEX; p = before(finder, p))
        finder->words.gone[p] = 1;
    for (uint32_t p = ends[1]; p != NO_INDEX && meeting == NO_INDEX; p = before(finder, p))
        if (finder->words.gone[p])
            meeting = p;
    for (uint32_t p = ends[0]; p != NO_INDEX; p = before(finder, p))
        finder->words.gone[p] = 0;
    for (unsigned side = 0; side < 2; side++) {
        size_t first = finder->ring_count;
        for (uint32_t p = ends[side]; p != meeting && status == STATUS_OK; p = before(finder, p))
            status = add_to_ring(finder, p);
        /* One way there, the other back. */
        for (size_t i = first, j = finder->ring_count; side == 1 && i + 1 < j; i++) {
            uint32_t swap = finder->ring[i];
            finder->ring[i] = finder->ring[--j];
            finder->ring[j] = swap;
        }
        if (side == 0 && status == STATUS_OK)
            status = add_to_ring(finder, meeting);
    }
    finder->loop_count = finder->ring_count;
    return status;
}

static enum status ring_size(struct finder *finder, struct feature *feature)
{
    struct context *ctx = finder->graph->ctx;
    struct vec3 sum = {0, 0, 0};
    enum status status = memory_reserve(ctx, &finder->points, &finder->point_capacity,
                                        3 * finder->loop_count, sizeof *finder->points);
    if (status != STATUS_OK)
        return status;
    for (size_t i = 0; i < finder->loop_count; i++) {
        struct vec3 middle = finder->middles[finder->ring[i]];
        vec3_store(finder->points + 3 * i, middle);
        sum = vec3_add(sum, middle);
    }
    *feature = (struct feature){.kind = FEATURE_HANDLE, .loops = 2};
    vec3_store(feature->place, vec3_scale(sum, 1 / (double)finder->loop_count));
    return points_diameter(ctx, &finder->scratch, finder->points, finder->loop_count, INFINITY,
                           &feature->size);
}

static void mark_ring(struct finder *finder, uint32_t gone)
{
    for (size_t i = 0; i < finder->ring_count; i++)
        finder->words.gone[finder->ring[i]] = gone;
}

/* The loops between the ring and the rest; the longest one's patch outside. */
struct outline {
    uint32_t count;
    double longest;
    uint32_t outside;
    bool has_border;
};

/* What is done at each loop. */
typedef enum status loop_action(struct finder *finder, uint32_t first, void *user);

static enum status each_loop(struct finder *finder, size_t ring_count, loop_action *action,
                             void *user)
{
    const struct chain_graph *graph = finder->graph;
    enum status status = STATUS_OK;
    for (unsigned pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < ring_count && status == STATUS_OK; i++) {
            uint32_t first = graph->patches[finder->ring[i]].half_edge, h = first;
            do {
                uint32_t outer = h ^ 1, at = outer;
                if (pass == 0)
                    finder->words.visited[outer] = 0;
                else if (!finder->words.visited[outer] && patch_is_there(&finder->words, outer)) {
                    do {
                        finder->words.visited[at] = 1;
                        at = loop_next(graph, finder->words.gone, at);
                    } while (at != outer);
                    status = action(finder, outer, user);
                }
                h = graph->half_edges[h].next;
            } while (h != first && status == STATUS_OK);
        }
    return status;
}

static enum status note_loop(struct finder *finder, uint32_t first, void *user)
{
    struct outline *outline = user;
    struct surface_loop loop;
    enum status status = loop_trace(finder->graph, finder->words.gone, first, NULL, &loop);
    outline->count++;
    if (status == STATUS_OK && loop.length > outline->longest) {
        outline->longest = loop.length;
        outline->outside = patch_at(finder, first);
    }
    return status;
}

/* Adds what lies behind a loop to the ring, if it is little and not what lies behind the longest
 * one. It is marked as gone on the way. */
static enum status add_island(struct finder *finder, uint32_t first, void *user)
{
    const struct chain_graph *graph = finder->graph;
    const struct outline *outline = user;
    size_t begin = finder->ring_count, next = begin;
    bool is_island = !finder->words.gone[patch_at(finder, first)];
    enum status status = STATUS_OK;
    if (is_island) {
        finder->words.gone[patch_at(finder, first)] = 1;
        status = add_to_ring(finder, patch_at(finder, first));
    }
    while (status == STATUS_OK && is_island && next < finder->ring_count) {
        uint32_t patch = finder->ring[next++], start = graph->patches[patch].half_edge, h = start;
        is_island = patch != outline->outside && next - begin < ISLAND_MAX;
        do {
            if (patch_is_there(&finder->words, h ^ 1) && is_island && status == STATUS_OK) {
                finder->words.gone[patch_at(finder, h ^ 1)] = 1;
                status = add_to_ring(finder, patch_at(finder, h ^ 1));
            }
            h = graph->half_edges[h].next;
        } while (h != start);
    }
    if (!is_island)
        while (finder->ring_count > begin)
            finder->words.gone[finder->ring[--finder->ring_count]] = 0;
    return status;
}

/* Marks the ring as gone and makes it one with two sides; false, and not gone, if that can't be. */
static enum status close_ring(struct finder *finder, bool *is_ring)
{
    struct outline outline = {0};
    mark_ring(finder, 1);
    enum status status = each_loop(finder, finder->ring_count, note_loop, &outline);
    if (status == STATUS_OK && outline.count > 2) {
        status = each_loop(finder, finder->loop_count, add_island, &outline);
        outline = (struct outline){0};
        if (status == STATUS_OK)
            status = each_loop(finder, finder->ring_count, note_loop, &outline);
    }
    *is_ring = status == STATUS_OK && outline.count == 2;
    if (!*is_ring)
        mark_ring(finder, 0);
    return status;
}

/* True when the word is no sum of those before; it is one of them then. */
static bool word_is_new(struct finder *finder, uint64_t word, bool take)
{
    while (word) {
        unsigned high = 63u - (unsigned)__builtin_clzll(word);
        if (!finder->basis[high]) {
            if (take) {
                finder->basis[high] = word;
                finder->rank++;
            }
            return true;
        }
        word ^= finder->basis[high];
    }
    return false;
}

/* ---- all handles ---- */

/* Other rings keep away from this one. */
static void keep_clear(struct finder *finder)
{
    const struct chain_graph *graph = finder->graph;
    for (size_t i = 0; i < finder->ring_count; i++) {
        uint32_t first = graph->patches[finder->ring[i]].half_edge, h = first;
        finder->is_clear[finder->ring[i]] = 0;
        do {
            if (patch_at(finder, h ^ 1) != NO_PATCH)
                finder->is_clear[patch_at(finder, h ^ 1)] = 0;
            h = graph->half_edges[h].next;
        } while (h != first);
    }
}

/* Takes out the shortest loop near a patch if it is small. */
static enum status try_patch(struct finder *finder, uint32_t root, uint32_t *of_patch,
                             struct feature_list *list, bool *taken)
{
    const double near = net_share * finder->size, most = longest_loop * finder->size;
    struct found found, nearer;
    struct feature feature;
    bool is_ring = false;
    enum status status = search_from(finder, root, most + 2 * near, near, &found);
    if (status != STATUS_OK || found.closing == NO_INDEX)
        return status;
    /* Once more from the loop itself, which has the way to it no more. */
    root = patch_at(finder, found.closing);
    status = search_from(finder, root, most, 0, &nearer);
    if (status != STATUS_OK || nearer.closing == NO_INDEX ||
        !word_is_new(finder, nearer.word, false))
        return status;
    status = take_ring(finder, &nearer);
    if (status == STATUS_OK)
        status = ring_size(finder, &feature);
    if (status == STATUS_OK && feature.size < finder->size)
        status = close_ring(finder, &is_ring);
    if (status != STATUS_OK || !is_ring)
        return status;
    (void)word_is_new(finder, nearer.word, true);
    keep_clear(finder);
    for (size_t i = 0; i < finder->ring_count; i++)
        of_patch[finder->ring[i]] = (uint32_t)list->count;
    *taken = true;
    return feature_list_add(finder->graph->ctx, list, &feature);
}

/* A ring must keep away from borders and from what goes already, or its sides would run into them.
 */
static void find_clear(struct finder *finder)
{
    const struct chain_graph *graph = finder->graph;
    for (uint32_t p = 0; p < graph->patch_count; p++)
        finder->is_clear[p] = !finder->words.gone[p];
    for (uint32_t h = 0; h < 2 * graph->edge_count; h++)
        if (patch_at(finder, h) != NO_PATCH && !patch_is_there(&finder->words, h ^ 1))
            finder->is_clear[patch_at(finder, h)] = 0;
}

static enum status search_round(struct finder *finder, uint32_t *of_patch,
                                struct feature_list *list, bool *taken)
{
    struct chain_graph *graph = finder->graph;
    enum status status = STATUS_OK;
    memset(finder->basis, 0, sizeof finder->basis);
    memset(finder->is_near, 0, graph->patch_count);
    finder->rank = 0;
    *taken = false;
    if (!edge_words_find(&finder->words))
        return STATUS_OK;
    find_clear(finder);
    for (uint32_t p = 0; p < graph->patch_count && status == STATUS_OK && finder->rank < RANK_MAX;
         p++) {
        if (!finder->is_clear[p] || finder->is_near[p])
            continue;
        status = p % 1024 == 0 ? step(graph->ctx, "handles", p, graph->patch_count) : STATUS_OK;
        if (status == STATUS_OK)
            status = try_patch(finder, p, of_patch, list, taken);
    }
    return status;
}

static void find_middles(struct finder *finder, const uint32_t *of_patch)
{
    const struct chain_graph *graph = finder->graph;
    for (uint32_t p = 0; p < graph->patch_count; p++) {
        uint32_t first = graph->patches[p].half_edge, h = first;
        struct vec3 sum = {0, 0, 0};
        do {
            sum = vec3_add(sum, vertex_point(graph, graph->half_edges[h].origin));
            h = graph->half_edges[h].next;
        } while (h != first);
        finder->middles[p] = vec3_scale(sum, 1 / (double)graph->patches[p].size);
        finder->words.gone[p] = of_patch[p] != NO_INDEX;
    }
}

static enum status take_arrays(struct finder *finder)
{
    struct context *ctx = finder->graph->ctx;
    const size_t patches = finder->graph->patch_count;
    enum status status = edge_words_begin(&finder->words);
    if (status == STATUS_OK)
        status = memory_take(ctx, patches, sizeof *finder->middles, &finder->middles);
    if (status == STATUS_OK)
        status = memory_take(ctx, patches, 1, &finder->is_near);
    if (status == STATUS_OK)
        status = memory_take(ctx, patches, 1, &finder->is_clear);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, patches, sizeof *finder->reached, &finder->reached);
    return status;
}

static void release(struct finder *finder)
{
    struct context *ctx = finder->graph->ctx;
    const size_t patches = finder->graph->patch_count;
    memory_release(ctx, &finder->middles, patches, sizeof *finder->middles);
    memory_release(ctx, &finder->is_near, patches, 1);
    memory_release(ctx, &finder->is_clear, patches, 1);
    memory_release(ctx, &finder->reached, patches, sizeof *finder->reached);
    memory_release(ctx, &finder->heap, finder->heap_capacity, sizeof *finder->heap);
    memory_release(ctx, &finder->ring, finder->ring_capacity, sizeof *finder->ring);
    memory_release(ctx, &finder->points, finder->point_capacity, sizeof *finder->points);
    loop_points_clear(ctx, &finder->scratch);
    edge_words_clear(&finder->words);
}

enum status handles_find(struct chain_graph *graph, double size, uint32_t *of_patch,
                         struct feature_list *list)
{
    struct finder finder = {.graph = graph, .size = size, .words = {.graph = graph}};
    bool taken = true;
    enum status status = take_arrays(&finder);
    if (status == STATUS_OK)
        find_middles(&finder, of_patch);
    for (unsigned round = 0; round < ROUNDS_MAX && taken && status == STATUS_OK; round++)
        status = search_round(&finder, of_patch, list, &taken);
    release(&finder);
    return status;
}
