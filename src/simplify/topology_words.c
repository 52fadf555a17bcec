/*
 * The words of edges.
 *
 * To ask of every loop of patches whether it parts the surface by flooding both of its sides would
 * be quadratic. Instead every edge gets a word, once, in linear time: a tree joins all patches (and
 * the disks that close the borders); the edges that it does not cross hold a tree of the vertices;
 * 2 genus edges are left (Eppstein 2003). Each of these closes a cycle with the vertices' tree, and
 * a loop that does not part the surface crosses some of these cycles an odd number of times. Each
 * cycle has a random word, and an edge the sum of the words of the cycles that run along it. (Words
 * that are sums of others by accident: one in 2^64.)
 */
#include "simplify/topology_words.h"

#include <string.h>

#include "base/forest.h"
#include "base/memory.h"
#include "simplify/topology_loops.h"

enum edge_use { EDGE_FREE = 0, EDGE_CROSSED, EDGE_IN_TREE, EDGE_OUTSIDE };

static uint32_t patch_at(const struct chain_graph *graph, uint32_t h)
{
    return graph->half_edges[h].patch;
}

/* splitmix64: the same for every run. */
static uint64_t random_word(uint64_t x)
{
    x = (x + 1) * UINT64_C(0x9e3779b97f4a7c15);
    x = (x ^ x >> 30) * UINT64_C(0xbf58476d1ce4e5b9);
    x = (x ^ x >> 27) * UINT64_C(0x94d049bb133111eb);
    return x ^ x >> 31;
}

/* The tree of patches and of the disks that close the borders: one edge of each border loop, and
 * edges between patches that were apart. */
static void cross_edges(struct edge_words *words)
{
    const struct chain_graph *graph = words->graph;
    for (uint32_t p = 0; p < graph->patch_count; p++)
        words->forest[p] = p;
    memset(words->visited, 0, 2 * (size_t)graph->edge_count);
    for (uint32_t e = 0; e < graph->edge_count; e++) {
        bool left = patch_is_there(words, 2 * e), right = patch_is_there(words, 2 * e + 1);
        words->uses[e] = left || right ? EDGE_FREE : EDGE_OUTSIDE;
        if (!left || !right)
            continue;
        uint32_t a = patch_at(words->graph, 2 * e), b = patch_at(words->graph, 2 * e + 1);
        if (forest_root(words->forest, a) != forest_root(words->forest, b)) {
            forest_join(words->forest, a, b);
            words->uses[e] = EDGE_CROSSED;
        }
    }
    for (uint32_t h = 0; h < 2 * graph->edge_count; h++) {
        uint32_t at = h;
        if (words->visited[h] || !patch_is_there(words, h) || patch_is_there(words, h ^ 1))
            continue;
        words->uses[h / 2] = EDGE_CROSSED;
        do {
            words->visited[at] = 1;
            at = loop_next(graph, words->gone, at);
        } while (at != h);
    }
}

static bool can_be_in_tree(const struct edge_words *words, uint32_t edge)
{
    return words->uses[edge] == EDGE_FREE;
}

/* The tree of the vertices, breadth first. Returns how many it reaches. */
static uint32_t join_vertices(struct edge_words *words)
{
    const struct chain_graph *graph = words->graph;
    uint32_t count = 0, done = 0;
    memset(words->parents, 0xff, graph->vertex_count * sizeof *words->parents);
    memset(words->sums, 0, graph->vertex_count * sizeof *words->sums);
    for (uint32_t v = 0; v < graph->vertex_count; v++) {
        if (words->sums[v] || !vertex_is_live(graph, v))
            continue;
        words->order[count++] = v;
        words->sums[v] = 1; /* seen */
        while (done < count) {
            uint32_t at = words->order[done++], first = graph->outgoing[at], h = first;
            do {
                uint32_t end = half_edge_end(graph, h);
                if (can_be_in_tree(words, h / 2) && !words->sums[end]) {
                    words->uses[h / 2] = EDGE_IN_TREE;
                    words->parents[end] = h;
                    words->order[count++] = end;
                    words->sums[end] = 1;
                }
                h = half_edge_turn(graph, h);
            } while (h != first);
        }
    }
    return count;
}

/* Gives every edge its word. False if all are 0: there is no handle. */
bool edge_words_find(struct edge_words *words)
{
    const struct chain_graph *graph = words->graph;
    bool any = false;
    cross_edges(words);
    uint32_t count = join_vertices(words);
    memset(words->sums, 0, graph->vertex_count * sizeof *words->sums);
    memset(words->word, 0, graph->edge_count * sizeof *words->word);
    for (uint32_t e = 0; e < graph->edge_count; e++) {
        if (words->uses[e] != EDGE_FREE)
            continue;
        uint64_t word = random_word(e);
        words->word[e] = word;
        words->sums[graph->half_edges[2 * e].origin] ^= word;
        words->sums[graph->half_edges[2 * e + 1].origin] ^= word;
        any = true;
    }
    for (uint32_t i = count; i-- > 0;) {
        uint32_t v = words->order[i], h = words->parents[v];
        if (h == NO_INDEX)
            continue;
        words->word[h / 2] = words->sums[v];
        words->sums[graph->half_edges[h].origin] ^= words->sums[v];
    }
    return any;
}

enum status edge_words_begin(struct edge_words *words)
{
    struct context *ctx = words->graph->ctx;
    const size_t patches = words->graph->patch_count, edges = words->graph->edge_count;
    const size_t vertices = words->graph->vertex_count;
    enum status status = memory_take_zeroed(ctx, patches, sizeof *words->gone, &words->gone);
    if (status == STATUS_OK)
        status = memory_take(ctx, edges, 1, &words->uses);
    if (status == STATUS_OK)
        status = memory_take(ctx, edges, sizeof *words->word, &words->word);
    if (status == STATUS_OK)
        status = memory_take(ctx, patches, sizeof *words->forest, &words->forest);
    if (status == STATUS_OK)
        status = memory_take(ctx, vertices, sizeof *words->parents, &words->parents);
    if (status == STATUS_OK)
        status = memory_take(ctx, vertices, sizeof *words->order, &words->order);
    if (status == STATUS_OK)
        status = memory_take(ctx, vertices, sizeof *words->sums, &words->sums);
    if (status == STATUS_OK)
        status = memory_take(ctx, 2 * edges, 1, &words->visited);
    return status;
}

void edge_words_clear(struct edge_words *words)
{
    struct context *ctx = words->graph->ctx;
    const size_t patches = words->graph->patch_count, edges = words->graph->edge_count;
    const size_t vertices = words->graph->vertex_count;
    memory_release(ctx, &words->gone, patches, sizeof *words->gone);
    memory_release(ctx, &words->uses, edges, 1);
    memory_release(ctx, &words->word, edges, sizeof *words->word);
    memory_release(ctx, &words->forest, patches, sizeof *words->forest);
    memory_release(ctx, &words->parents, vertices, sizeof *words->parents);
    memory_release(ctx, &words->order, vertices, sizeof *words->order);
    memory_release(ctx, &words->sums, vertices, sizeof *words->sums);
    memory_release(ctx, &words->visited, 2 * edges, 1);
}
