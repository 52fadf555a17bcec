/*
 * The store numbers vertices and faces over the whole mesh, so a per-vertex array of a slab would
 * have to be as long as the mesh, or a hash map. A slab's own vertices are one range of numbers and
 * its few foreign ones a sorted table, so that local numbers cost a subtraction for the first and
 * a binary search for the others; everything after this works on arrays of the slab's size. Of
 * nearly all faces all three are in the range, so three numbers are asked at once.
 */
#include "simplify/slab_local.h"

#include <string.h>

#include "base/float4.h"
#include "base/memory.h"

static enum status reserve(struct context *ctx, struct slab_local *local, size_t vertices,
                           size_t foreign)
{
    enum status status = STATUS_OK;
    if (vertices >= local->vertex_capacity) { /* one more, for whole vectors */
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

/* The local number of a corner's vertex. */
static enum status find_corner(struct context *ctx, const struct slab *slab, size_t corner,
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

/* What lies over an edge. */
static enum status find_link(struct context *ctx, const struct slab *slab, size_t f, unsigned k,
                             struct slab_local *local, uint32_t *link)
{
    const uint32_t neighbour = slab->neighbours[3 * f + k], face = neighbour - slab->face_first;
    const unsigned mate = slab->mates[f] >> 2 * k & 3;
    *link = face << 3 | mate << 1;
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

/* A face's eight numbers, whatever its vertices and neighbours are. */
static enum status fill_face(struct context *ctx, const struct slab *slab, size_t f,
                             struct slab_local *local)
{
    const size_t seam_links = local->seam_links;
    uint32_t *to = local->faces + FACE_STRIDE * f, vertices[3] = {0}, links[3] = {0};
    enum status status = STATUS_OK;
    for (unsigned k = 0; k < 3 && !status; k++) {
        status = find_corner(ctx, slab, 3 * f + k, local, &vertices[k]);
        if (!status)
            status = find_link(ctx, slab, f, k, local, &links[k]);
    }
    for (unsigned k = 0; k < 3; k++) {
        to[2 * k] = vertices[previous3(k)];
        to[2 * k + 1] = links[next3(k)];
    }
    to[FACE_USER] = 0;
    to[FACE_USER + 1] = links[1];
    if (status || local->seam_links == seam_links)
        return status;
    status = memory_reserve(ctx, &local->seam_faces, &local->seam_face_capacity,
                            local->seam_face_count + 1, sizeof *local->seam_faces);
    if (!status)
        local->seam_faces[local->seam_face_count++] = (uint32_t)f;
    return status;
}

/* ---- faces that have nothing beyond the slab ---- */

/* Three numbers of a face, and a fourth, of no matter, that lies behind them. */
static inline uint4 load_four(const uint32_t *from)
{
    uint4 four;
    memcpy(&four, from, sizeof four);
    return four;
}

/* The numbers from `first` on, so many, in each lane. */
struct range {
    uint4 first;
    int4 end; /* from the first on, less 2^31: vectors compare signed numbers */
};

static struct range range_of(uint32_t first, uint32_t count)
{
    const int32_t end = (int32_t)(count ^ 0x80000000);
    return (struct range){{first, first, first, first}, {end, end, end, end}};
}

/* Which lanes, that count from the range's first, are in it. */
static inline int4 are_inside(uint4 numbers, struct range range)
{
    return range.end > (int4)(numbers ^ 0x80000000);
}

/* Writes a face's eight numbers; its vertices come as the store has them. */
static inline void put_face(uint4 vertices, uint4 links, uint32_t *to)
{
    const uint4 three = {UINT32_MAX, UINT32_MAX, UINT32_MAX, 0};
    const uint4 opposite = __builtin_shufflevector(vertices, vertices, 2, 0, 1, 3) & three;
    const uint4 between = __builtin_shufflevector(links, links, 1, 2, 0, 1);
    const uint4 low = __builtin_shufflevector(opposite, between, 0, 4, 1, 5);
    const uint4 high = __builtin_shufflevector(opposite, between, 2, 6, 3, 7);
    memcpy(to, &low, sizeof low);
    memcpy(to + 4, &high, sizeof high);
}

/* Fills faces from f on, up to the first that has a vertex or a neighbour that is not the slab's
 * own, or an edge number above 2, or to the last, behind which there is no fourth number; returns
 * which that is. */
static size_t fill_plain_faces(const struct slab *slab, const struct slab_local *local,
                               const uint4 places[64], size_t f)
{
    const struct range own = range_of(slab->vertex_first, local->own_count);
    const struct range inside = range_of(slab->face_first, slab->face_count);
    const uint32_t *corners = slab->faces, *neighbours = slab->neighbours;
    const uint8_t *mates = slab->mates;
    uint32_t *to = local->faces;
    const size_t last = slab->face_count - 1;
    for (; f < last; f++) {
        const uint4 vertices = load_four(corners + 3 * f) - own.first;
        const uint4 faces = load_four(neighbours + 3 * f) - inside.first;
        const int4 is_plain = are_inside(vertices, own) & are_inside(faces, inside);
        if ((float4_bits((float4)is_plain) & 7) != 7 || (mates[f] & mates[f] >> 1 & 0x15) != 0)
            return f;
        put_face(vertices, faces << 3 | places[mates[f] & 63], to + FACE_STRIDE * f);
    }
    return f;
}

static enum status fill_faces(struct context *ctx, const struct slab *slab,
                              struct slab_local *local)
{
    uint4 places[64]; /* a face's three mates, from their six bits */
    for (uint32_t i = 0; i < 64; i++)
        places[i] = (uint4){(i & 3) << 1, (i >> 2 & 3) << 1, i >> 4 << 1, 0};
    const size_t count = slab->face_count;
    enum status status = STATUS_OK;
    local->seam_links = local->seam_face_count = 0;
    for (size_t f = 0; f < count && !status; f++) {
        f = fill_plain_faces(slab, local, places, f);
        status = fill_face(ctx, slab, f, local);
    }
    memset(local->faces + FACE_STRIDE * count, 0, BEYOND_COUNT * FACE_STRIDE * sizeof(uint32_t));
    return status;
}

enum status slab_local_fill(struct context *ctx, const struct slab *slab, uint32_t *faces,
                            struct slab_local *local)
{
    uint32_t own = slab->vertex_end - slab->vertex_first;
    uint64_t vertices = (uint64_t)own + slab->foreign_count;
    if (slab->face_count >= 1u << 28 || vertices >= 1u << 29)
        return fail(ctx, STATUS_BAD_INPUT, "mesh store: slab %u is too large", slab->index);
    enum status status = reserve(ctx, local, vertices, slab->foreign_count);
    if (status)
        return status;

    local->face_count = slab->face_count;
    local->own_count = own;
    local->vertex_count = (uint32_t)vertices;
    local->vertex_first = slab->vertex_first;
    local->faces = faces;
    if (own)
        memcpy(local->positions, slab->positions, own * (3 * sizeof(float)));
    if (slab->foreign_count) {
        memcpy(local->positions + 3 * (size_t)own, slab->foreign_positions,
               slab->foreign_count * (3 * sizeof(float)));
        memcpy(local->foreign, slab->foreign, slab->foreign_count * sizeof *local->foreign);
    }
    return fill_faces(ctx, slab, local);
}

void slab_local_clear(struct context *ctx, struct slab_local *local)
{
    memory_release(ctx, &local->positions, local->vertex_capacity, 3 * sizeof *local->positions);
    memory_release(ctx, &local->foreign, local->foreign_capacity, sizeof *local->foreign);
    memory_release(ctx, &local->seam_faces, local->seam_face_capacity, sizeof *local->seam_faces);
    memset(local, 0, sizeof *local);
}
