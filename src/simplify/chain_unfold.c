/*
 * Unfolding a chain file.
 *
 * Holding the small meshes of all blocks until they are joined would take memory by the size of the
 * file. Here the blocks stream by: each gives its small mesh, the import of the store takes it at
 * once and sorts on disk what does not fit. Only a seam vertex is met more than once; the first
 * block that has it gives it, and the others say its number. To find that, a bit a vertex of the
 * first store marks those on seams, and a table holds a number for each bit that is set.
 */
#include "simplify/chain_unfold.h"

#include <string.h>

#include "base/memory.h"
#include "base/ranked_bits.h"
#include "mesh/import.h"
#include "simplify/small_mesh.h"

struct unfolding {
    struct context *ctx;
    struct chain_file *file;
    const struct chain_info *info;
    const struct import_sink *sink;
    struct small_workspace space;
    struct ranked_bits on_seam; /* of the vertices of the store that the chains came from */
    uint32_t *seam_places; /* a seam vertex: its number in the new mesh; NO_INDEX: not given yet */
    size_t seam_count;
    uint64_t vertices_given, faces_given;
    uint32_t *numbers; /* a vertex of the small mesh in hand: its number in the new mesh */
    size_t number_capacity;
    float *floats; /* what of it is new: positions, as the new store wants them, and records */
    double *doubles;
    unsigned char *records;
    size_t float_capacity, double_capacity, record_capacity;
};

/* ---- seam vertices ---- */

static enum status mark_seams(struct unfolding *unfolding)
{
    for (uint32_t slab = 0; slab < unfolding->info->slab_count; slab++) {
        struct chain_block block;
        enum status status = chain_block_read(unfolding->file, slab, &block);
        if (status != STATUS_OK)
            return status;
        for (uint32_t i = 0; i < block.seam_vertex_count && status == STATUS_OK; i++) {
            uint32_t number = block.seam_vertices[i];
            if (number >= unfolding->info->topology.vertices)
                status = fail(unfolding->ctx, STATUS_BAD_INPUT,
                              "%s: block %u names a vertex that the store has not",
                              chain_file_name(unfolding->file), slab);
            else
                bit_set(unfolding->on_seam.bits, number);
        }
        chain_block_release(unfolding->file, &block);
        if (status != STATUS_OK)
            return status;
    }
    return STATUS_OK;
}

static enum status list_seams(struct unfolding *unfolding)
{
    struct context *ctx = unfolding->ctx;
    enum status status =
        ranked_bits_take(ctx, unfolding->info->topology.vertices, &unfolding->on_seam);
    if (status == STATUS_OK)
        status = mark_seams(unfolding);
    if (status != STATUS_OK)
        return status;
    const size_t count = unfolding->seam_count = ranked_bits_sum(&unfolding->on_seam);
    status = memory_take(ctx, count, sizeof *unfolding->seam_places, &unfolding->seam_places);
    if (status == STATUS_OK)
        memset(unfolding->seam_places, 0xff, count * sizeof *unfolding->seam_places);
    return status;
}

/* ---- one block ---- */

/* Numbers for all vertices of the small mesh: seam vertices that were given keep theirs, copies of
 * one share it, all others are new. *fresh: how many are. */
static enum status number_vertices(struct unfolding *unfolding, const struct small_mesh *mesh,
                                   size_t *fresh)
{
    const size_t count = (size_t)mesh->triangles.vertex_count;
    uint64_t next = unfolding->vertices_given;
    enum status status =
        memory_reserve(unfolding->ctx, &unfolding->numbers, &unfolding->number_capacity, count,
                       sizeof *unfolding->numbers);
    if (status != STATUS_OK)
        return status;
    uint32_t *numbers = unfolding->numbers;
    memset(numbers, 0xff, count * sizeof *numbers);
    for (uint32_t i = 0; i < mesh->seam_count; i++) {
        uint32_t *place =
            &unfolding->seam_places[rank_of(&unfolding->on_seam, mesh->seams[i].number)];
        if (*place == NO_INDEX)
            *place = (uint32_t)next++;
        numbers[mesh->seams[i].vertex] = *place;
    }
    for (size_t v = 0; v < count; v++)
        if (numbers[v] == NO_INDEX)
            numbers[v] = (uint32_t)next++;
    *fresh = (size_t)(next - unfolding->vertices_given);
    return next < NO_INDEX ? STATUS_OK
                           : fail(unfolding->ctx, STATUS_BAD_INPUT, "%s: too many vertices",
                                  chain_file_name(unfolding->file));
}

static enum status give_vertices(struct unfolding *unfolding, const struct small_mesh *mesh,
                                 size_t fresh)
{
    const struct chain_info *info = unfolding->info;
    const struct import_sink *sink = unfolding->sink;
    struct context *ctx = unfolding->ctx;
    const size_t stride = info->attributes.stride;
    enum status status = STATUS_OK;
    if (info->is_float32)
        status = memory_reserve(ctx, &unfolding->floats, &unfolding->float_capacity, 3 * fresh,
                                sizeof *unfolding->floats);
    else
        status = memory_reserve(ctx, &unfolding->doubles, &unfolding->double_capacity, 3 * fresh,
                                sizeof *unfolding->doubles);
    if (status == STATUS_OK && stride > 0)
        status = memory_reserve(ctx, &unfolding->records, &unfolding->record_capacity,
                                fresh * stride, 1);
    if (status != STATUS_OK)
        return status;
    for (size_t v = 0; v < mesh->triangles.vertex_count; v++) {
        const float *position = mesh->triangles.positions + 3 * v;
        if (unfolding->numbers[v] < unfolding->vertices_given)
            continue;
        size_t at = (size_t)(unfolding->numbers[v] - unfolding->vertices_given);
        if (info->is_float32)
            memcpy(unfolding->floats + 3 * at, position, 3 * sizeof *position);
        for (unsigned c = 0; c < 3 && !info->is_float32; c++)
            unfolding->doubles[3 * at + c] = info->origin[c] + (double)position[c];
        if (stride > 0)
            memcpy(unfolding->records + at * stride, mesh->triangles.records + v * stride, stride);
    }
    unfolding->vertices_given += fresh;
    return fresh == 0
               ? STATUS_OK
               : sink->vertices(sink->user, fresh, info->is_float32 ? unfolding->floats : NULL,
                                info->is_float32 ? NULL : unfolding->doubles,
                                stride > 0 ? unfolding->records : NULL);
}

static enum status give_block(struct unfolding *unfolding, const struct chain_block *block)
{
    const struct chain_info *info = unfolding->info;
    const struct import_sink *sink = unfolding->sink;
    struct small_mesh mesh;
    size_t fresh = 0;
    enum status status =
        small_mesh_build(unfolding->ctx, &unfolding->space, info->attributes.stride, block,
                         info->tolerance, 0, &mesh);
    if (status == STATUS_OK)
        status = number_vertices(unfolding, &mesh, &fresh);
    if (status == STATUS_OK)
        status = give_vertices(unfolding, &mesh, fresh);
    if (status == STATUS_OK) {
        size_t faces = (size_t)mesh.triangles.face_count;
        for (size_t i = 0; i < 3 * faces; i++)
            mesh.triangles.faces[i] = unfolding->numbers[mesh.triangles.faces[i]];
        status = sink->faces(sink->user, unfolding->faces_given, faces, NULL, mesh.triangles.faces);
        unfolding->faces_given += faces;
    }
    small_mesh_clear(unfolding->ctx, info->attributes.stride, &mesh);
    return status;
}

/* ---- all blocks ---- */

static enum status give_all(void *user, const struct import_sink *sink)
{
    struct unfolding *unfolding = user;
    const struct chain_info *info = unfolding->info;
    unfolding->sink = sink;
    enum status status = sink->begin(sink->user, &info->attributes, false, 0, 0);
    for (uint32_t slab = 0; slab < info->slab_count && status == STATUS_OK; slab++) {
        struct chain_block block;
        status = step(unfolding->ctx, "unfold", slab, info->slab_count);
        if (status == STATUS_OK)
            status = chain_block_read(unfolding->file, slab, &block);
        if (status != STATUS_OK)
            break;
        status = give_block(unfolding, &block);
        chain_block_release(unfolding->file, &block);
    }
    return status;
}

static void release(struct unfolding *unfolding)
{
    struct context *ctx = unfolding->ctx;
    ranked_bits_clear(ctx, &unfolding->on_seam);
    memory_release(ctx, &unfolding->seam_places, unfolding->seam_count,
                   sizeof *unfolding->seam_places);
    memory_release(ctx, &unfolding->numbers, unfolding->number_capacity,
                   sizeof *unfolding->numbers);
    memory_release(ctx, &unfolding->floats, unfolding->float_capacity, sizeof *unfolding->floats);
    memory_release(ctx, &unfolding->doubles, unfolding->double_capacity,
                   sizeof *unfolding->doubles);
    memory_release(ctx, &unfolding->records, unfolding->record_capacity, 1);
    small_workspace_clear(ctx, &unfolding->space);
    chain_file_close(&unfolding->file);
}

enum status chain_unfold(struct context *ctx, const char *chain_path, const char *store_path,
                         const struct import_options *import, struct store_info *info)
{
    struct unfolding unfolding = {.ctx = ctx};
    enum status status = chain_file_open(ctx, chain_path, &unfolding.file);
    if (status != STATUS_OK)
        return status;
    const struct chain_info *chains = unfolding.info = chain_file_info(unfolding.file);
    struct store_info source = {.attributes = chains->attributes, .is_float32 = chains->is_float32};
    memcpy(source.origin, chains->origin, sizeof source.origin);
    memcpy(source.box_low, chains->box_low, sizeof source.box_low);
    memcpy(source.box_high, chains->box_high, sizeof source.box_high);
    const struct store_feed feed = {give_all, &unfolding, &source};
    status = list_seams(&unfolding);
    if (status == STATUS_OK)
        status = store_build_from(ctx, &feed, store_path, import, info);
    release(&unfolding);
    return status;
}
