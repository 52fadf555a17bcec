/*
 * The store numbers vertices and faces over the whole mesh, so a per-vertex array of a slab would
 * have to be as long as the mesh, or a hash map. A slab's own vertices are one range of numbers and
 * its few foreign ones a sorted table, so that local numbers cost a subtraction for the first and
 * a binary search for the others; everything after this works on arrays of the slab's size.
 */
#include "simplify/slab_local.h"

#include <string.h>

#include "base/memory.h"

static enum status reserve(struct context *ctx, struct slab_local *local, size_t faces,
                           size_t vertices)
{
    enum status status = STATUS_OK;
    if (faces > local->face_capacity) {
        size_t old = local->face_capacity;
        local->face_capacity = 0;
        memory_release(ctx, &local->corners, old, 3 * sizeof *local->corners);
        memory_release(ctx, &local->links, old, 3 * sizeof *local->links);
        status = memory_take(ctx, faces, 3 * sizeof *local->corners, &local->corners);
        if (status)
            return status;
        status = memory_take(ctx, faces, 3 * sizeof *local->links, &local->links);
        if (status) {
            memory_release(ctx, &local->corners, faces, 3 * sizeof *local->corners);
            return status;
        }
        local->face_capacity = faces;
    }
    if (vertices > local->vertex_capacity) {
        memory_release(ctx, &local->positions, local->vertex_capacity,
                       3 * sizeof *local->positions);
        local->vertex_capacity = 0;
        status = memory_take(ctx, vertices, 3 * sizeof *local->positions, &local->positions);
        if (!status)
            local->vertex_capacity = vertices;
    }
    return status;
}

/* Index of `vertex` in the ascending table, or `count` when it is not there. */
static uint32_t foreign_index(const uint32_t *foreign, uint32_t count, uint32_t vertex)
{
    uint32_t low = 0, high = count;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2;
        if (foreign[middle] < vertex)
            low = middle + 1;
        else
            high = middle;
    }
    return low < count && foreign[low] == vertex ? low : count;
}

static enum status fill_corners(struct context *ctx, const struct slab *slab,
                                struct slab_local *local)
{
    for (size_t i = 0; i < 3 * (size_t)slab->face_count; i++) {
        uint32_t vertex = slab->faces[i] - slab->vertex_first;
        if (vertex >= local->own_count) {
            uint32_t index = foreign_index(slab->foreign, slab->foreign_count, slab->faces[i]);
            if (index == slab->foreign_count)
                return fail(ctx, STATUS_BAD_INPUT,
                            "mesh store: slab %u, face %zu: vertex %u is not in the slab's table",
                            slab->index, i / 3, slab->faces[i]);
            vertex = local->own_count + index;
        }
        local->corners[i] = vertex;
    }
    return STATUS_OK;
}

static enum status fill_links(struct context *ctx, const struct slab *slab,
                              struct slab_local *local)
{
    local->seam_links = 0;
    for (size_t f = 0; f < slab->face_count; f++) {
        unsigned mates = slab->mates[f];
        for (unsigned k = 0; k < 3; k++) {
            uint32_t neighbour = slab->neighbours[3 * f + k];
            uint32_t face = neighbour - slab->face_first;
            unsigned mate = mates >> 2 * k & 3;
            uint32_t link = face << 2 | mate;
            if (face >= slab->face_count) {
                bool is_seam = neighbour != NO_INDEX;
                local->seam_links += is_seam;
                link = link_beyond(local, is_seam ? BEYOND_SEAM : BEYOND_BORDER);
            } else if (mate == 3) {
                return fail(ctx, STATUS_BAD_INPUT,
                            "mesh store: slab %u, face %zu: edge %u has no mate", slab->index, f,
                            k);
            }
            local->links[3 * f + k] = link;
        }
    }
    return STATUS_OK;
}

enum status slab_local_fill(struct context *ctx, const struct slab *slab, struct slab_local *local)
{
    uint32_t own = slab->vertex_end - slab->vertex_first;
    uint64_t vertices = (uint64_t)own + slab->foreign_count;
    if (slab->face_count >= 1u << 29 || vertices >= 1u << 29)
        return fail(ctx, STATUS_BAD_INPUT, "mesh store: slab %u is too large", slab->index);
    enum status status = reserve(ctx, local, slab->face_count, vertices);
    if (status)
        return status;

    local->face_count = slab->face_count;
    local->own_count = own;
    local->vertex_count = (uint32_t)vertices;
    local->vertex_first = slab->vertex_first;
    local->foreign = slab->foreign;
    if (own)
        memcpy(local->positions, slab->positions, own * (3 * sizeof(float)));
    if (slab->foreign_count)
        memcpy(local->positions + 3 * (size_t)own, slab->foreign_positions,
               slab->foreign_count * (3 * sizeof(float)));
    status = fill_corners(ctx, slab, local);
    if (status)
        return status;
    return fill_links(ctx, slab, local);
}

void slab_local_clear(struct context *ctx, struct slab_local *local)
{
    memory_release(ctx, &local->corners, local->face_capacity, 3 * sizeof *local->corners);
    memory_release(ctx, &local->links, local->face_capacity, 3 * sizeof *local->links);
    memory_release(ctx, &local->positions, local->vertex_capacity, 3 * sizeof *local->positions);
    memset(local, 0, sizeof *local);
}
