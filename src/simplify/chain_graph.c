/*
 * Joining blocks into one graph.
 *
 * The natural way would be a map from store vertices to graph vertices and one from vertex pairs to
 * edges. Neither is needed: inside a block vertices are numbered already; only those on seams exist
 * twice, and their store numbers, sorted once, give them their numbers. Edges come out of the
 * chains, each chain once (a seam chain by the slab with the lower number). What is left is to say
 * which chain follows which round a patch: at a junction a patch has exactly one half-edge that
 * comes in and one that goes out, so an array indexed by vertex, filled and read patch by patch,
 * finds them in linear time.
 *
 * The blocks may come from a damaged file whose checksums are right, so nothing is believed: the
 * finished graph is checked whole.
 */
#include "simplify/chain_graph.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
enum { RECORD_MEMORY = 64 << 20 }; /* attribute records beyond it go to a temporary file */

/* ---- first reading: how much there is ---- */

struct block_base {
    uint32_t vertex; /* graph number of the block's first vertex that is on no seam */
    uint32_t patch;
    uint32_t diagonal;
};

struct joining {
    struct chain_graph *graph;
    const struct block_source *source;
    struct block_base *bases; /* one a block and one behind the last */
    uint32_t *seam_numbers;   /* store numbers, ascending: graph vertex i is seam_numbers[i] */
    size_t seam_capacity;
    uint32_t seam_count;
    uint64_t edge_count;
    /* Half-edges that begin and end a chain, as lists by patch: heads here, links in the
     * half-edges' own fields; the border has the place behind the last patch. */
    uint32_t *starts;
    uint32_t *ends;
};

static int compare_numbers(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return x < y ? -1 : x > y;
}

/* Smallest heap sort there is: in place, no allocation, never quadratic. */
static void sift(uint32_t *numbers, size_t at, size_t count)
{
    for (size_t child; (child = 2 * at + 1) < count; at = child) {
        if (child + 1 < count && numbers[child + 1] > numbers[child])
            child++;
        if (numbers[at] >= numbers[child])
            return;
        uint32_t other = numbers[at];
        numbers[at] = numbers[child];
        numbers[child] = other;
    }
}

static void sort_numbers(uint32_t *numbers, size_t count)
{
    for (size_t i = count / 2; i-- > 0;)
        sift(numbers, i, count);
    for (size_t n = count; n-- > 1;) {
        uint32_t largest = numbers[0];
        numbers[0] = numbers[n];
        numbers[n] = largest;
        sift(numbers, 0, n);
    }
}

static enum status too_large(struct context *ctx)
{
    return fail(ctx, STATUS_BAD_INPUT, "the chains have more than %u edges: too many for one graph",
                UINT32_MAX / 2 - 1);
}

static enum status count_block(struct joining *joining, const struct chain_block *block,
                               uint64_t *vertices, uint64_t *patches, uint64_t *diagonals)
{
    struct context *ctx = joining->graph->ctx;
    size_t seams = joining->seam_count;
    enum status status =
        memory_reserve(ctx, &joining->seam_numbers, &joining->seam_capacity,
                       seams + block->seam_vertex_count, sizeof *joining->seam_numbers);
    if (status != STATUS_OK)
        return status;
    if (block->seam_vertex_count > 0)
        memcpy(joining->seam_numbers + seams, block->seam_vertices,
               block->seam_vertex_count * sizeof *joining->seam_numbers);
    joining->seam_count += block->seam_vertex_count;
    *vertices += block->vertex_count - block->seam_vertex_count;
    *patches += block->patch_count;
    *diagonals += block->diagonal_count;
    for (uint32_t i = 0; i < block->chain_count; i++)
        joining->edge_count += (uint64_t)block->chains[i].interior_count + 1;
    for (uint32_t i = 0; i < block->seam_chain_count; i++)
        if (block->seam_chains[i].other_slab > block->slab)
            joining->edge_count += block->seam_chains[i].vertex_count - 1;
    if (*vertices + joining->seam_count >= UINT32_MAX - 2 || *patches >= UINT32_MAX - 2 ||
        *diagonals >= UINT32_MAX - 2 || joining->edge_count >= UINT32_MAX / 2 - 1)
        return too_large(ctx);
    return STATUS_OK;
}

/* Sorts the seams' store numbers and keeps each once. */
static void number_seams(struct joining *joining)
{
    uint32_t kept = 0;
    sort_numbers(joining->seam_numbers, joining->seam_count);
    for (uint32_t i = 0; i < joining->seam_count; i++)
        if (i == 0 || joining->seam_numbers[i] != joining->seam_numbers[kept - 1])
            joining->seam_numbers[kept++] = joining->seam_numbers[i];
    joining->seam_count = kept;
}

static enum status count_all(struct joining *joining)
{
    const struct block_source *source = joining->source;
    struct chain_graph *graph = joining->graph;
    uint64_t vertices = 0, patches = 0, diagonals = 0;
    for (uint32_t i = 0; i < source->count; i++) {
        struct chain_block block;
        enum status status = source->read(source->user, i, &block);
        if (status != STATUS_OK)
            return status;
        joining->bases[i] =
            (struct block_base){(uint32_t)vertices, (uint32_t)patches, (uint32_t)diagonals};
        status = block.slab == i
                     ? count_block(joining, &block, &vertices, &patches, &diagonals)
                     : fail(graph->ctx, STATUS_BAD_INPUT, "block %u says it is %u", i, block.slab);
        source->release(source->user, &block);
        if (status != STATUS_OK)
            return status;
    }
    number_seams(joining);
    for (uint32_t i = 0; i <= source->count; i++)
        if (i < source->count)
            joining->bases[i].vertex += joining->seam_count;
        else
            joining->bases[i] = (struct block_base){(uint32_t)vertices + joining->seam_count,
                                                    (uint32_t)patches, (uint32_t)diagonals};
    graph->vertex_count = joining->bases[source->count].vertex;
    graph->patch_count = (uint32_t)patches;
    graph->diagonal_count = (uint32_t)diagonals;
    graph->edge_count = (uint32_t)joining->edge_count;
    return STATUS_OK;
}

/* ---- second reading: vertices, patches, edges ---- */

static enum status take_arrays(struct chain_graph *graph, const char *beside)
{
    struct context *ctx = graph->ctx;
    size_t vertices = graph->vertex_count, edges = graph->edge_count;
    enum status status =
        memory_take(ctx, 3 * vertices, sizeof *graph->positions, &graph->positions);
    if (status == STATUS_OK)
        status = memory_take(ctx, vertices, sizeof *graph->outgoing, &graph->outgoing);
    if (status == STATUS_OK)
        status = memory_take(ctx, vertices, sizeof *graph->list, &graph->list);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, vertices, sizeof *graph->flags, &graph->flags);
    if (status == STATUS_OK)
        status = memory_take(ctx, 2 * edges, sizeof *graph->half_edges, &graph->half_edges);
    if (status == STATUS_OK)
        status = memory_take(ctx, edges, sizeof *graph->edges, &graph->edges);
    if (status == STATUS_OK)
        status = memory_take(ctx, graph->patch_count, sizeof *graph->patches, &graph->patches);
    if (status == STATUS_OK)
        status = memory_take(ctx, 2 * (size_t)graph->diagonal_count, sizeof *graph->diagonals,
                             &graph->diagonals);
    if (status == STATUS_OK && graph->stride > 0) {
        void *data;
        status = spool_scratch(ctx, &graph->records, beside, RECORD_MEMORY,
                               (uint64_t)vertices * graph->stride, &data);
        graph->record_data = data;
    }
    if (status != STATUS_OK)
        return status;
    memset(graph->outgoing, 0xff, vertices * sizeof *graph->outgoing);
    memset(graph->list, 0xff, vertices * sizeof *graph->list);
    return STATUS_OK;
}

/* Graph number of a vertex of the block. */
static uint32_t vertex_number(const struct joining *joining, const struct chain_block *block,
                              uint32_t local)
{
    uint32_t base = joining->bases[block->slab].vertex;
    if (local < block->junction_count)
        return base + local;
    if (local >= block->junction_count + block->seam_vertex_count)
        return base + local - block->seam_vertex_count;
    uint32_t number = block->seam_vertices[local - block->junction_count];
    uint32_t *found = bsearch(&number, joining->seam_numbers, joining->seam_count, sizeof number,
                              compare_numbers);
    return (uint32_t)(found - joining->seam_numbers);
}

static void copy_vertices(struct joining *joining, const struct chain_block *block)
{
    struct chain_graph *graph = joining->graph;
    for (uint32_t i = 0; i < block->vertex_count; i++) {
        size_t v = vertex_number(joining, block, i);
        memcpy(graph->positions + 3 * v, block->positions + 3 * (size_t)i, 3 * sizeof(float));
        if (graph->stride > 0 && block->records)
            memcpy(graph->record_data + v * graph->stride,
                   block->records + (size_t)i * graph->stride, graph->stride);
        if (i < block->junction_count)
            graph->flags[v] |= VERTEX_JUNCTION;
    }
}

static void copy_patches(struct joining *joining, const struct chain_block *block)
{
    struct chain_graph *graph = joining->graph;
    const struct block_base *base = &joining->bases[block->slab];
    for (uint32_t i = 0; i < block->patch_count; i++) {
        const struct patch *from = &block->patches[i];
        struct graph_patch *to = &graph->patches[base->patch + i];
        *to = (struct graph_patch){.area = from->area,
                                   .deviation = from->deviation,
                                   .half_edge = NO_INDEX,
                                   .member = base->patch + i,
                                   .interior_count = from->interior_count,
                                   .diagonal_first = base->diagonal + from->diagonal_first,
                                   .diagonal_count = from->diagonal_count,
                                   .dissolved = NO_INDEX};
        memcpy(to->normal, from->normal, sizeof to->normal);
        if (from->interior_count > 0)
            to->interior_first = vertex_number(joining, block, from->interior_first);
    }
    for (uint32_t i = 0; i < 2 * block->diagonal_count; i++)
        graph->diagonals[2 * (size_t)base->diagonal + i] =
            vertex_number(joining, block, block->diagonals[i]);
}

static void put_edge(struct chain_graph *graph, uint32_t edge, uint32_t from, uint32_t to,
                     uint32_t left, uint32_t right)
{
    graph->half_edges[2 * (size_t)edge] = (struct half_edge){NO_INDEX, NO_INDEX, from, left};
    graph->half_edges[2 * (size_t)edge + 1] = (struct half_edge){NO_INDEX, NO_INDEX, to, right};
    graph->edges[edge] = (struct edge_record){NO_INDEX, NO_INDEX, 0, 0};
}

/* Links half-edges inside the chain whose edges are [first, end), and lists its ends. */
static void link_chain(struct joining *joining, uint32_t first, uint32_t end)
{
    struct half_edge *half_edges = joining->graph->half_edges;
    uint32_t patches = joining->graph->patch_count;
    for (uint32_t e = first; e + 1 < end; e++) {
        half_edges[2 * e].next = 2 * e + 2;
        half_edges[2 * e + 2].previous = 2 * e;
        half_edges[2 * e + 3].next = 2 * e + 1;
        half_edges[2 * e + 1].previous = 2 * e + 3;
    }
    uint32_t starts[2] = {2 * first, 2 * end - 1}, ends[2] = {2 * end - 2, 2 * first + 1};
    for (int side = 0; side < 2; side++) {
        uint32_t patch = half_edges[starts[side]].patch;
        if (patch == NO_PATCH)
            patch = patches;
        half_edges[starts[side]].previous = joining->starts[patch];
        joining->starts[patch] = starts[side];
        half_edges[ends[side]].next = joining->ends[patch];
        joining->ends[patch] = ends[side];
    }
}

static enum status add_chains(struct joining *joining, const struct chain_block *block,
                              uint32_t *edge)
{
    struct chain_graph *graph = joining->graph;
    uint32_t patch_base = joining->bases[block->slab].patch;
    for (uint32_t i = 0; i < block->chain_count; i++) {
        const struct chain *chain = &block->chains[i];
        uint32_t right = chain->right == NO_PATCH ? NO_PATCH : patch_base + chain->right;
        uint32_t from = vertex_number(joining, block, chain->start), first = *edge;
        for (uint32_t k = 0; k <= chain->interior_count; k++) {
            uint32_t local = k < chain->interior_count ? chain->interior_first + k : chain->end;
            uint32_t to = vertex_number(joining, block, local);
            put_edge(graph, (*edge)++, from, to, patch_base + chain->left, right);
            from = to;
        }
        graph->flags[graph->half_edges[2 * (size_t)first].origin] |= VERTEX_JUNCTION;
        graph->flags[from] |= VERTEX_JUNCTION;
        link_chain(joining, first, *edge);
    }
    for (uint32_t i = 0; i < block->seam_chain_count; i++) {
        const struct seam_chain *chain = &block->seam_chains[i];
        const uint32_t *list = block->seam_lists + chain->vertex_first;
        uint32_t from = vertex_number(joining, block, list[0]), first = *edge;
        graph->flags[from] |= VERTEX_JUNCTION;
        graph->flags[vertex_number(joining, block, list[chain->vertex_count - 1])] |=
            VERTEX_JUNCTION;
        if (chain->other_slab <= block->slab)
            continue;
        if (chain->other_slab >= joining->source->count ||
            chain->right >= joining->bases[chain->other_slab + 1].patch -
                                joining->bases[chain->other_slab].patch)
            return fail(graph->ctx, STATUS_BAD_INPUT,
                        "block %u: seam chain %u has no patch on the other side", block->slab, i);
        uint32_t right = joining->bases[chain->other_slab].patch + chain->right;
        for (uint32_t k = 1; k < chain->vertex_count; k++) {
            uint32_t to = vertex_number(joining, block, list[k]);
            put_edge(graph, (*edge)++, from, to, patch_base + chain->left, right);
            from = to;
        }
        link_chain(joining, first, *edge);
    }
    return STATUS_OK;
}

static enum status fill_all(struct joining *joining)
{
    const struct block_source *source = joining->source;
    uint32_t edge = 0;
    for (uint32_t i = 0; i < source->count; i++) {
        struct chain_block block;
        enum status status = source->read(source->user, i, &block);
        if (status != STATUS_OK)
            return status;
        copy_vertices(joining, &block);
        copy_patches(joining, &block);
        status = add_chains(joining, &block, &edge);
        source->release(source->user, &block);
        if (status == STATUS_OK)
            status = step(joining->graph->ctx, "joining blocks", i + 1, source->count);
        if (status != STATUS_OK)
            return status;
    }
    return STATUS_OK;
}

/* ---- what follows what ---- */

/* Joins the ends of chains round one patch (or along the border). `outgoing` serves as the array
 * that finds the patch's half-edge which starts at a vertex. */
static enum status link_patch(struct joining *joining, uint32_t place)
{
    struct chain_graph *graph = joining->graph;
    struct half_edge *half_edges = graph->half_edges;
    uint32_t patch = place == graph->patch_count ? NO_PATCH : place;
    for (uint32_t h = joining->starts[place], after; h != NO_INDEX; h = after) {
        after = half_edges[h].previous;
        half_edges[h].previous = NO_INDEX;
        graph->outgoing[half_edges[h].origin] = h;
    }
    for (uint32_t h = joining->ends[place], after; h != NO_INDEX; h = after) {
        after = half_edges[h].next;
        uint32_t vertex = half_edge_end(graph, h), s = graph->outgoing[vertex];
        if (s == NO_INDEX || half_edges[s].patch != patch || half_edges[s].origin != vertex ||
            half_edges[s].previous != NO_INDEX)
            return fail(graph->ctx, STATUS_BAD_INPUT,
                        patch == NO_PATCH ? "a border chain is not continued"
                                          : "the loop of patch %u is not closed",
                        patch);
        half_edges[h].next = s;
        half_edges[s].previous = h;
    }
    return STATUS_OK;
}

/* Sets what follows from the half-edges: outgoing, the patches' sizes and longest chains, totals.
 */
static void gather(struct chain_graph *graph)
{
    memset(graph->outgoing, 0xff, graph->vertex_count * sizeof *graph->outgoing);
    graph->live_edges = graph->edge_count;
    graph->live_patches = graph->patch_count;
    graph->live_border_edges = 0;
    for (uint32_t h = 0; h < 2 * graph->edge_count; h++) {
        const struct half_edge *half_edge = &graph->half_edges[h];
        if (half_edge->patch == NO_PATCH) {
            graph->live_border_edges++;
            graph->outgoing[half_edge->origin] = h;
            continue;
        }
        struct graph_patch *patch = &graph->patches[half_edge->patch];
        uint32_t *outgoing = &graph->outgoing[half_edge->origin];
        if (*outgoing == NO_INDEX || graph->half_edges[*outgoing].patch != NO_PATCH)
            *outgoing = h;
        if (patch->half_edge == NO_INDEX)
            patch->half_edge = h;
        patch->size++;
        if (!(graph->flags[half_edge->origin] & VERTEX_JUNCTION))
            patch->open++;
        double length = vec3_distance(vertex_point(graph, half_edge->origin),
                                      vertex_point(graph, half_edge_end(graph, h)));
        if (length > (double)patch->longest)
            patch->longest = (float)length;
    }
}

enum status chain_graph_build(struct context *ctx, const struct block_source *source,
                              const char *beside, struct chain_graph *graph)
{
    struct joining joining = {.graph = graph, .source = source};
    memset(graph, 0, sizeof *graph);
    graph->ctx = ctx;
    graph->stride = source->stride;
    spool_init(ctx, &graph->records, beside, RECORD_MEMORY);
    size_t blocks = (size_t)source->count + 1, places = 0;
    enum status status = memory_take(ctx, blocks, sizeof *joining.bases, &joining.bases);
    if (status == STATUS_OK)
        status = count_all(&joining);
    if (status != STATUS_OK)
        goto done;
    status = take_arrays(graph, beside);
    places = (size_t)graph->patch_count + 1;
    if (status == STATUS_OK)
        status = memory_take(ctx, places, sizeof *joining.starts, &joining.starts);
    if (status == STATUS_OK)
        status = memory_take(ctx, places, sizeof *joining.ends, &joining.ends);
    if (status != STATUS_OK)
        goto done;
    memset(joining.starts, 0xff, places * sizeof *joining.starts);
    memset(joining.ends, 0xff, places * sizeof *joining.ends);
    status = fill_all(&joining);
    for (uint32_t i = 0; i < places && status == STATUS_OK; i++)
        status = link_patch(&joining, i);
    if (status == STATUS_OK) {
        gather(graph);
        status = chain_graph_check(graph);
    }
done:
    memory_release(ctx, &joining.bases, blocks, sizeof *joining.bases);
    memory_release(ctx, &joining.seam_numbers, joining.seam_capacity, sizeof *joining.seam_numbers);
    memory_release(ctx, &joining.starts, places, sizeof *joining.starts);
    memory_release(ctx, &joining.ends, places, sizeof *joining.ends);
    if (status != STATUS_OK)
        chain_graph_clear(graph);
    return status;
}

static enum status file_read(void *user, uint32_t index, struct chain_block *block)
{
    return chain_block_read(user, index, block);
}

static void file_release(void *user, struct chain_block *block)
{
    chain_block_release(user, block);
}

enum status chain_graph_open(struct context *ctx, struct chain_file *file, const char *beside,
                             struct chain_graph *graph)
{
    const struct chain_info *info = chain_file_info(file);
    struct block_source source = {info->slab_count, info->attributes.stride, file_read,
                                  file_release, file};
    return chain_graph_build(ctx, &source, beside, graph);
}

void chain_graph_clear(struct chain_graph *graph)
{
    struct context *ctx = graph->ctx;
    size_t vertices = graph->vertex_count, edges = graph->edge_count;
    if (!ctx)
        return;
    memory_release(ctx, &graph->positions, 3 * vertices, sizeof *graph->positions);
    memory_release(ctx, &graph->outgoing, vertices, sizeof *graph->outgoing);
    memory_release(ctx, &graph->list, vertices, sizeof *graph->list);
    memory_release(ctx, &graph->flags, vertices, sizeof *graph->flags);
    memory_release(ctx, &graph->half_edges, 2 * edges, sizeof *graph->half_edges);
    memory_release(ctx, &graph->edges, edges, sizeof *graph->edges);
    memory_release(ctx, &graph->patches, graph->patch_count, sizeof *graph->patches);
    memory_release(ctx, &graph->diagonals, 2 * (size_t)graph->diagonal_count,
                   sizeof *graph->diagonals);
    spool_clear(&graph->records);
    memset(graph, 0, sizeof *graph);
}
