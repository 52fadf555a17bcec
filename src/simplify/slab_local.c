/*
 * The store numbers vertices and faces over the whole mesh, so a per-vertex array of a slab would
 * have to be as long as the mesh, or a hash map. A slab's own vertices are one range of numbers and
 * its few foreign ones a sorted table, so that local numbers cost a subtraction for the first and
 * a binary search for the others; everything after this works on arrays of the slab's size.
 */
#include "simplify/slab_local.h"

#include <string.h>

#include "base/memory.h"

static void release_faces(struct context *ctx, struct slab_local *local)
{
    memory_release(ctx, &local->faces, local->face_capacity, FACE_STRIDE * sizeof *local->faces);
    local->face_capacity = 0;
}

static enum status reserve(struct context *ctx, struct slab_local *local, size_t faces,
                           size_t vertices, size_t foreign)
{
    enum status status = STATUS_OK;
    if (faces > local->face_capacity) {
        release_faces(ctx, local);
        status = memory_take(ctx, faces, FACE_STRIDE * sizeof *local->faces, &local->faces);
        local->face_capacity = status ? 0 : faces;
        if (!status)
            memory_use_whole(local->faces, faces, FACE_STRIDE * sizeof *local->faces);
    }
    if (!status && vertices >= local->vertex_capacity) { /* one more, for whole vectors */
        vertices++;
        memory_release(ctx, &local->positions, local->vertex_capacity,
                       3 * sizeof *local->positions);
        local->vertex_capacity = 0;
        status = memory_take(ctx, vertices, 3 * sizeof *local->positions, &local->positions);
        if (!status)
            local->vertex_capacity = vertices;
    }
    if (!status)
        status = memory_reserve(ctx, &local->foreign, &local->foreign_capacity, foreign,
                                sizeof *local->foreign);
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

/* A corner that is not the slab's own vertex. */
static enum status foreign_corner(struct context *ctx, const struct slab *slab, size_t corner,
                                  struct slab_local *local, uint32_t *vertex)
{
    *vertex = slab->faces[corner] - slab->vertex_first;
    if (*vertex < local->own_count)
        return STATUS_OK;
    uint32_t index = foreign_index(slab->foreign, slab->foreign_count, slab->faces[corner]);
    if (index == slab->foreign_count)
        return fail(ctx, STATUS_BAD_INPUT,
                    "mesh store: slab %u, face %zu: vertex %u is not in the slab's table",
                    slab->index, corner / 3, slab->faces[corner]);
    *vertex = local->own_count + index;
    return STATUS_OK;
}

static enum status fill_faces(struct context *ctx, const struct slab *slab,
                              struct slab_local *local)
{
    const uint32_t first = slab->vertex_first, own = local->own_count;
    for (size_t f = 0; f < slab->face_count; f++) {
        const uint32_t *face = slab->faces + 3 * f;
        uint32_t *to = local->faces + FACE_STRIDE * f;
        uint32_t v[3] = {face[0] - first, face[1] - first, face[2] - first};
        for (unsigned k = 0; k < 3 && (v[0] >= own || v[1] >= own || v[2] >= own); k++) {
            enum status status = foreign_corner(ctx, slab, 3 * f + k, local, &v[k]);
            if (status)
                return status;
        }
        to[0] = v[2];
        to[1] = v[0];
        to[2] = v[1];
        to[LABEL] = UINT32_MAX;
    }
    return STATUS_OK;
}

/* A link out of the slab, or one that no slab has. */
static enum status beyond_link(struct context *ctx, const struct slab *slab, size_t f, unsigned k,
                               struct slab_local *local, uint32_t *link)
{
    const uint32_t neighbour = slab->neighbours[3 * f + k], face = neighbour - slab->face_first;
    const unsigned mate = slab->mates[f] >> 2 * k & 3;
    *link = face << 2 | mate;
    if (face >= slab->face_count) {
        bool is_seam = neighbour != NO_INDEX;
        local->seam_links += is_seam;
        *link = link_beyond(local, is_seam ? BEYOND_SEAM : BEYOND_BORDER);
    } else if (mate == 3) {
        return fail(ctx, STATUS_BAD_INPUT, "mesh store: slab %u, face %zu: edge %u has no mate",
                    slab->index, f, k);
    }
    return STATUS_OK;
}

static enum status fill_links(struct context *ctx, const struct slab *slab,
                              struct slab_local *local)
{
    const uint32_t first = slab->face_first, count = slab->face_count;
    local->seam_links = 0;
    for (size_t f = 0; f < count; f++) {
        const uint32_t *over = slab->neighbours + 3 * f;
        const uint32_t n[3] = {over[0] - first, over[1] - first, over[2] - first};
        const uint32_t mates = slab->mates[f];
        uint32_t *to = local->links + FACE_STRIDE * f;
        to[0] = n[0] << 2 | (mates & 3);
        to[1] = n[1] << 2 | (mates >> 2 & 3);
        to[2] = n[2] << 2 | (mates >> 4 & 3);
        to[3] = 0;
        bool is_inside = (n[0] < count) & (n[1] < count) & (n[2] < count);
        for (unsigned k = 0; k < 3 && (!is_inside || mates & mates >> 1 & 0x15); k++) {
            enum status status = beyond_link(ctx, slab, f, k, local, &to[k]);
            if (status)
                return status;
        }
    }
    return STATUS_OK;
}

enum status slab_local_fill(struct context *ctx, const struct slab *slab, uint32_t *links,
                            struct slab_local *local)
{
    uint32_t own = slab->vertex_end - slab->vertex_first;
    uint64_t vertices = (uint64_t)own + slab->foreign_count;
    if (slab->face_count >= 1u << 29 || vertices >= 1u << 29)
        return fail(ctx, STATUS_BAD_INPUT, "mesh store: slab %u is too large", slab->index);
    enum status status =
        reserve(ctx, local, (size_t)slab->face_count + BEYOND_COUNT, vertices, slab->foreign_count);
    if (status)
        return status;

    local->face_count = slab->face_count;
    local->own_count = own;
    local->vertex_count = (uint32_t)vertices;
    local->vertex_first = slab->vertex_first;
    local->links = links;
    if (own)
        memcpy(local->positions, slab->positions, own * (3 * sizeof(float)));
    if (slab->foreign_count) {
        memcpy(local->positions + 3 * (size_t)own, slab->foreign_positions,
               slab->foreign_count * (3 * sizeof(float)));
        memcpy(local->foreign, slab->foreign, slab->foreign_count * sizeof *local->foreign);
    }
    status = fill_faces(ctx, slab, local);
    if (status)
        return status;
    return fill_links(ctx, slab, local);
}

void slab_local_clear(struct context *ctx, struct slab_local *local)
{
    release_faces(ctx, local);
    memory_release(ctx, &local->positions, local->vertex_capacity, 3 * sizeof *local->positions);
    memory_release(ctx, &local->foreign, local->foreign_capacity, sizeof *local->foreign);
    memset(local, 0, sizeof *local);
}
