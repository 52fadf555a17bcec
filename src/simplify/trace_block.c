/*
 * Making the block of a traced slab: what patches keep of their inside, then all vertices in their
 * block numbers. Those are known only at the end, when the junctions have been counted; until then
 * everything names local vertices, and two arrays over the slab's vertices translate.
 */
#include "simplify/trace_internal.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "simplify/unit_code.h"

/* ---- what patches keep of their inside ---- */

/* Keeps the PATCH_INTERIORS farthest; of equal ones the first, which is the lowest. */
static void keep_farthest(struct patch_sum *sum, uint32_t vertex, double distance)
{
    unsigned place = sum->interior_count;
    while (place > 0 && sum->distance[place - 1] < distance)
        place--;
    if (place == PATCH_INTERIORS)
        return;
    unsigned last =
        sum->interior_count < PATCH_INTERIORS ? sum->interior_count++ : PATCH_INTERIORS - 1;
    for (unsigned i = last; i > place; i--) {
        sum->distance[i] = sum->distance[i - 1];
        sum->interior[i] = sum->interior[i - 1];
    }
    sum->distance[place] = distance;
    sum->interior[place] = vertex;
}

/* A vertex at which no boundary edge ends lies inside the patch of any of its faces. Own vertices
 * are numbered by first use, so faces in order meet them ascending. */
void trace_choose_interiors(struct trace *trace)
{
    const struct slab_local *local = trace->local;
    uint8_t *kinds = trace->scratch->kinds;
    for (size_t f = 0; f < local->face_count; f++) {
        for (unsigned k = 0; k < 3; k++) {
            uint32_t vertex = local->corners[3 * f + k];
            if (kinds[vertex] != 0)
                continue;
            kinds[vertex] = KIND_INTERIOR;
            struct patch_sum *sum = trace->scratch->sums + trace->labels[f];
            const float *x = local->positions + 3 * (size_t)vertex;
            double distance = sum->normal[0] * (x[0] - sum->centre[0]) +
                              sum->normal[1] * (x[1] - sum->centre[1]) +
                              sum->normal[2] * (x[2] - sum->centre[2]);
            keep_farthest(sum, vertex, fabs(distance));
        }
    }
}

/* The nearest float that is not below. */
static float round_up(double value)
{
    float rounded = (float)value;
    return rounded < value ? nextafterf(rounded, INFINITY) : rounded;
}

static float clamp_float(double value)
{
    return value > 3.4e38 ? 3.4e38f : (float)value;
}

static void fill_patches(struct trace *trace, struct chain_block *block)
{
    uint32_t interior = block->vertex_count - (uint32_t)trace->patch_interior_count;
    uint32_t diagonal = 0;
    for (uint32_t p = 0; p < trace->patch_count; p++) {
        const struct patch_sum *sum = trace->scratch->sums + p;
        struct patch *patch = block->patches + p;
        (void)unit_decode(unit_encode(sum->normal), patch->normal); /* as the file will give it */
        patch->area = clamp_float(0.5 * sum->area);
        patch->deviation = sum->interior_count ? round_up(sum->distance[0]) : 0;
        patch->interior_first = interior;
        patch->interior_count = sum->interior_count;
        patch->diagonal_first = diagonal;
        patch->diagonal_count = sum->interior_count ? 0 : sum->loop_count - 3;
        interior += patch->interior_count;
        diagonal += patch->diagonal_count;
    }
}

/* ---- the block ---- */

static uint32_t block_vertex(const struct trace *trace, uint32_t vertex)
{
    uint32_t number = trace->scratch->numbers[vertex];
    return trace->scratch->kinds[vertex] & KIND_SEAM ? trace->junction_count + number : number;
}

static enum status take_block(struct trace *trace, uint32_t stride, struct chain_block *block)
{
    for (uint32_t p = 0; p < trace->patch_count; p++) {
        const struct patch_sum *sum = trace->scratch->sums + p;
        trace->patch_interior_count += sum->interior_count;
        trace->diagonal_count += sum->interior_count ? 0 : sum->loop_count - 3;
    }
    size_t vertices = (size_t)trace->junction_count + trace->seam_vertex_count +
                      trace->interior_count + trace->patch_interior_count;
    block->slab = trace->slab->index;
    block->vertex_count = (uint32_t)vertices;
    block->junction_count = trace->junction_count;
    block->seam_vertex_count = trace->seam_vertex_count;
    block->chain_count = (uint32_t)trace->chain_count;
    block->patch_count = trace->patch_count;
    block->diagonal_count = (uint32_t)trace->diagonal_count;
    struct context *ctx = trace->ctx;
    enum status status = memory_take(ctx, vertices, 3 * sizeof(float), &block->positions);
    if (!status && stride)
        status = memory_take(ctx, vertices, stride, &block->records);
    if (!status)
        status =
            memory_take(ctx, trace->seam_vertex_count, sizeof(uint32_t), &block->seam_vertices);
    if (!status)
        status = memory_take(ctx, trace->chain_count, sizeof *block->chains, &block->chains);
    if (!status)
        status = memory_take(ctx, trace->patch_count, sizeof *block->patches, &block->patches);
    if (!status)
        status = memory_take(ctx, trace->diagonal_count, 2 * sizeof(uint32_t), &block->diagonals);
    return status;
}

/* Where the values of local vertices go: position and attributes. */
struct vertex_copy {
    struct store *store;
    uint32_t stride;
};

static enum status copy_vertex(struct trace *trace, const struct vertex_copy *copy,
                               struct chain_block *block, uint32_t to, uint32_t vertex)
{
    const struct slab_local *local = trace->local;
    memcpy(block->positions + 3 * (size_t)to, local->positions + 3 * (size_t)vertex,
           3 * sizeof(float));
    if (copy->stride == 0)
        return STATUS_OK;
    unsigned char *record = block->records + (size_t)to * copy->stride;
    if (vertex >= local->own_count)
        return store_record(copy->store, local_vertex_number(local, vertex), record);
    memcpy(record, trace->slab->records + (size_t)vertex * copy->stride, copy->stride);
    return STATUS_OK;
}

/* Junctions and seam vertices by their numbers; then interiors in order. */
static enum status fill_vertices(struct trace *trace, const struct vertex_copy *copy,
                                 struct chain_block *block)
{
    const struct slab_local *local = trace->local;
    const struct trace_workspace *scratch = trace->scratch;
    enum status status = STATUS_OK;
    for (uint32_t v = 0; v < local->vertex_count && !status; v++) {
        if (!(scratch->kinds[v] & (KIND_SEAM | KIND_JUNCTION)))
            continue;
        if (scratch->kinds[v] & KIND_SEAM)
            block->seam_vertices[scratch->numbers[v]] = local_vertex_number(local, v);
        status = copy_vertex(trace, copy, block, block_vertex(trace, v), v);
    }
    uint32_t next = trace->junction_count + trace->seam_vertex_count;
    for (size_t i = 0; i < trace->interior_count && !status; i++)
        status = copy_vertex(trace, copy, block, next++, scratch->interiors[i]);
    for (uint32_t p = 0; p < trace->patch_count && !status; p++) {
        const struct patch_sum *sum = scratch->sums + p;
        for (uint32_t i = 0; i < sum->interior_count && !status; i++)
            status = copy_vertex(trace, copy, block, next++, sum->interior[i]);
    }
    return status;
}

static void fill_chains(struct trace *trace, struct chain_block *block)
{
    uint32_t interior = trace->junction_count + trace->seam_vertex_count;
    uint32_t *numbers = trace->scratch->numbers;
    for (size_t i = 0; i < trace->chain_count; i++) {
        struct chain chain = trace->scratch->chains[i];
        chain.start = block_vertex(trace, chain.start);
        chain.end = block_vertex(trace, chain.end);
        for (uint32_t j = 0; j < chain.interior_count; j++)
            numbers[trace->scratch->interiors[chain.interior_first + j]] =
                interior + chain.interior_first + j;
        chain.interior_first += interior;
        block->chains[i] = chain;
    }
}

/* Block number of a boundary vertex once fill_chains has numbered the chains' interiors. */
static uint32_t boundary_vertex(const struct trace *trace, uint32_t vertex)
{
    return trace->scratch->kinds[vertex] & KIND_SEAM ? block_vertex(trace, vertex)
                                                     : trace->scratch->numbers[vertex];
}

/* A patch of F faces without interior vertices has F + 2 boundary vertices and F - 1 edges inside:
 * its diagonals, each taken from the lower of its two faces. */
static enum status fill_diagonals(struct trace *trace, struct chain_block *block)
{
    const struct slab_local *local = trace->local;
    if (trace->diagonal_count == 0)
        return STATUS_OK;
    uint32_t *filled;
    enum status status =
        memory_take_zeroed(trace->ctx, trace->patch_count, sizeof *filled, &filled);
    if (status)
        return status;
    for (uint32_t f = 0; f < local->face_count && !status; f++) {
        uint32_t label = trace->labels[f];
        const struct patch *patch = block->patches + label;
        if (patch->diagonal_count == 0)
            continue;
        for (unsigned k = 0; k < 3; k++) {
            uint32_t link = local->links[3 * (size_t)f + k];
            if (!link_is_face(link) || link >> 2 < f || trace->labels[link >> 2] != label)
                continue;
            if (filled[label] == patch->diagonal_count) {
                status = trace_fail(trace, "a patch is no disk");
                break;
            }
            uint32_t *diagonal =
                block->diagonals + 2 * ((size_t)patch->diagonal_first + filled[label]++);
            diagonal[0] = boundary_vertex(trace, local->corners[3 * (size_t)f + k]);
            diagonal[1] = boundary_vertex(trace, local->corners[3 * (size_t)f + next3(k)]);
        }
    }
    for (uint32_t p = 0; p < trace->patch_count && !status; p++)
        if (filled[p] != block->patches[p].diagonal_count)
            status = trace_fail(trace, "a patch is no disk");
    memory_release(trace->ctx, &filled, trace->patch_count, sizeof *filled);
    return status;
}

enum status trace_make_block(struct trace *trace, struct store *store, uint32_t stride,
                             struct chain_block *block)
{
    struct vertex_copy copy = {.store = store, .stride = stride};
    enum status status = take_block(trace, stride, block);
    if (status)
        return status;
    fill_patches(trace, block);
    status = fill_vertices(trace, &copy, block);
    if (status)
        return status;
    fill_chains(trace, block);
    return fill_diagonals(trace, block);
}

enum status trace_take_seams(struct trace *trace, struct slab_seams *seams)
{
    const struct trace_workspace *scratch = trace->scratch;
    seams->edge_count = trace->seam_edge_count;
    seams->junction_count = trace->touched_count;
    enum status status =
        memory_take(trace->ctx, seams->edge_count, sizeof *seams->edges, &seams->edges);
    if (!status)
        status = memory_take(trace->ctx, seams->junction_count, sizeof *seams->junctions,
                             &seams->junctions);
    if (status)
        return status;
    if (seams->edge_count)
        memcpy(seams->edges, scratch->seam_edges, seams->edge_count * sizeof *seams->edges);
    size_t next = 0;
    for (uint32_t v = 0; v < trace->local->vertex_count; v++)
        if (scratch->kinds[v] & KIND_TOUCHED)
            seams->junctions[next++] = local_vertex_number(trace->local, v);
    return STATUS_OK;
}
