/*
 * A store as a mesh file: two sweeps over the slabs, one for the vertices and one for the faces, a
 * slab at a time. Whether positions are float or double is the store's own matter: what came as
 * float32 goes out as float32, bit for bit.
 */
#include "mesh/export.h"
#include "mesh/slab_judge.h"
#include "mesh/store_internal.h"

enum { BATCH = 4096 };

static enum status export_slab_vertices(struct exporter *exporter, const struct store_info *info,
                                        const struct slab *slab)
{
    double positions[3 * BATCH];
    const size_t own = slab->vertex_end - slab->vertex_first;
    const size_t stride = info->attributes.stride;
    enum status status = STATUS_OK;
    for (size_t done = 0; done < own && status == STATUS_OK;) {
        size_t count = own - done < BATCH ? own - done : BATCH;
        for (size_t i = 0; i < 3 * count; i++)
            positions[i] = info->origin[i % 3] + (double)slab->positions[3 * done + i];
        status = export_vertices(exporter, count, positions,
                                 slab->records ? slab->records + done * stride : NULL);
        done += count;
    }
    return status;
}

/* What is written here is not looked at by a later stage, as chains are. */
static enum status export_slab_faces(struct exporter *exporter, struct store *store,
                                     const struct slab *slab)
{
    const char *wrong;
    enum status status = slab_judge_stars(store_context(store), slab, &wrong);
    if (status == STATUS_OK && wrong)
        status = store_slab_damaged(store, slab->index, wrong);
    return status == STATUS_OK ? export_faces(exporter, slab->face_count, slab->faces) : status;
}

static enum status export_slabs(struct context *ctx, struct store *store, struct exporter *exporter,
                                bool faces)
{
    const struct store_info *info = store_info(store);
    enum status status = STATUS_OK;
    for (uint32_t i = 0; i < info->slab_count && status == STATUS_OK; i++) {
        struct slab slab;
        status = step(ctx, "export", (uint64_t)i + (faces ? info->slab_count : 0),
                      2 * (uint64_t)info->slab_count);
        if (status == STATUS_OK)
            status = slab_open(store, i, &slab);
        if (status != STATUS_OK)
            break;
        if (faces)
            status = export_slab_faces(exporter, store, &slab);
        else
            status = export_slab_vertices(exporter, info, &slab);
        slab_close(&slab);
    }
    return status;
}

enum status store_export(struct store *store, const char *path,
                         const struct export_options *options)
{
    struct context *ctx = store_context(store);
    const struct store_info *info = store_info(store);
    struct export_options own = *options;
    own.as_float32 = info->is_float32;
    struct exporter *exporter;
    enum status status = paths_must_differ(ctx, store_path(store), path);
    if (status == STATUS_OK)
        status = export_open(ctx, path, &own, info->topology.vertices, info->topology.faces,
                             &info->attributes, &exporter);
    if (status != STATUS_OK)
        return status;
    status = export_slabs(ctx, store, exporter, false);
    if (status == STATUS_OK)
        status = export_slabs(ctx, store, exporter, true);
    if (status == STATUS_OK)
        return export_commit(&exporter);
    export_discard(&exporter);
    return status;
}
