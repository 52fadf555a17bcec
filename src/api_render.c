/*
 * The public interface to pictures: which meshes are shown, and what colours they get. A mesh
 * file's own colours are the renderer's business; here are those that mean something: the patches
 * of a store, and the vertex property `quality` through a colour map.
 *
 * The largest quality would be the natural end of the colour map, but one bad vertex then leaves
 * all others in the first colour. So the map ends where the worst hundredth of the vertices begins,
 * over all meshes of the picture together, so that one legend is true for all.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "api_internal.h"
#include "base/bytes.h"
#include "base/file.h"
#include "base/memory.h"
#include "inspect/render.h"
#include "mesh/import.h"
#include "simplify/patchify.h"

/* A mesh of the picture, with what it takes to draw it. */
struct shown {
    struct mesh mesh;
    uint32_t *colours; /* one a face, or NULL */
    char caption[256];
    struct store *store; /* opened, while its chain file may follow */
    const char *path;
};

void spbm_render_defaults(spbm_render_options *options)
{
    struct render_options inner;
    render_defaults(&inner);
    *options = (spbm_render_options){
        .width = inner.width,
        .height = inner.height,
        .view = {inner.view[0], inner.view[1], inner.view[2]},
        .up = {inner.up[0], inner.up[1], inner.up[2]},
        .wireframe = inner.wireframe,
        .flat = inner.flat,
        .captions = 1,
        .background = inner.background,
    };
}

/* "name: 1,087,716 faces" */
static void write_caption(struct shown *shown, const char *path, uint64_t count, const char *one,
                          const char *many)
{
    char digits[24], grouped[32];
    int length = snprintf(digits, sizeof digits, "%llu", (unsigned long long)count);
    size_t used = 0;
    for (int i = 0; i < length; i++) {
        if (i > 0 && (length - i) % 3 == 0)
            grouped[used++] = ',';
        grouped[used++] = digits[i];
    }
    grouped[used] = '\0';
    const char *slash = strrchr(path, '/');
    snprintf(shown->caption, sizeof shown->caption, "%.200s: %s %s", slash ? slash + 1 : path,
             grouped, count == 1 ? one : many);
}

/* ---- patches ---- */

/* The patches that are grown again are those of the chain file only if the store is the one that it
 * was made from. */
static enum status check_pair(struct context *ctx, const struct shown *shown, const char *path,
                              const struct chain_info *info)
{
    uint32_t crc = 0;
    enum status status = store_crc(shown->store, &crc);
    if (status != STATUS_OK)
        return status;
    if (info->store_crc != crc || info->topology.faces != shown->mesh.face_count ||
        info->topology.vertices != shown->mesh.vertex_count ||
        info->slab_count != store_info(shown->store)->slab_count)
        return fail(ctx, STATUS_BAD_INPUT,
                    "%s: was not made from %s, but from another mesh store (of %llu faces)", path,
                    shown->path, (unsigned long long)info->topology.faces);
    return STATUS_OK;
}

/* Gives every face the colour of its patch: the patches of a chain file can be grown again from its
 * store and options. */
static enum status colour_patches(struct context *ctx, struct shown *shown, const char *path)
{
    struct chain_file *file;
    enum status status = chain_file_open(ctx, path, &file);
    if (status != STATUS_OK)
        return status;
    const struct chain_info *info = chain_file_info(file);
    uint32_t first_patch = 0;
    status = check_pair(ctx, shown, path, info);
    if (status == STATUS_OK)
        status = memory_take(ctx, (size_t)shown->mesh.face_count, sizeof *shown->colours,
                             &shown->colours);
    for (uint32_t i = 0; i < info->slab_count && status == STATUS_OK; i++) {
        struct slab slab = {0};
        uint32_t patches = 0;
        status = slab_open(shown->store, i, &slab);
        if (status == STATUS_OK) {
            uint32_t *labels = shown->colours + slab.face_first;
            status = patch_labels(ctx, &slab, &info->options, labels, &patches);
            for (uint32_t f = 0; f < slab.face_count && status == STATUS_OK; f++)
                labels[f] = colour_distinct(first_patch + labels[f]);
        }
        slab_close(&slab);
        first_patch += patches;
    }
    write_caption(shown, path, info->patches, "patch", "patches");
    chain_file_close(&file);
    return status;
}

/* ---- quality ---- */

static const struct attribute *find_quality(const struct shown *shown)
{
    const struct attributes *attributes = &shown->mesh.attributes;
    for (uint32_t i = 0; shown->mesh.records && !shown->colours && i < attributes->count; i++) {
        const struct attribute *attribute = &attributes->list[i];
        if (strcmp(attribute->name, "quality") == 0 &&
            (attribute->type == SCALAR_FLOAT32 || attribute->type == SCALAR_FLOAT64))
            return attribute;
    }
    return NULL;
}

static double quality_at(const struct mesh *mesh, const struct attribute *quality, uint64_t vertex)
{
    const unsigned char *at =
        mesh->records + (size_t)vertex * mesh->attributes.stride + quality->offset;
    return quality->type == SCALAR_FLOAT32 ? (double)load_f32(at) : load_f64(at);
}

/* What the ends of the colour map stand for. */
struct range {
    double low, high;
};

enum { BUCKETS = 4096 };

/* The value below which lies that part of the counted values. */
static double quantile(const uint64_t *counts, uint64_t total, const struct range *all, double part)
{
    uint64_t below = 0;
    unsigned bucket = 0;
    while (bucket < BUCKETS && (double)(below + counts[bucket]) < part * (double)total)
        below += counts[bucket++];
    double step = (all->high - all->low) / BUCKETS;
    return part < 0.5 ? all->low + step * bucket : fmin(all->low + step * (bucket + 1), all->high);
}

/* The range of all meshes' qualities without the outermost hundredth; it begins at 0 where it
 * could. False when there is none. */
static bool find_range(const struct shown *shown, size_t count, struct range *range)
{
    struct range all = {INFINITY, -INFINITY};
    uint64_t counts[BUCKETS + 1] = {0}, total = 0;
    bool is_found = false;
    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < count; i++) {
            const struct attribute *quality = find_quality(&shown[i]);
            for (uint64_t v = 0; quality && v < shown[i].mesh.vertex_count; v++) {
                double value = quality_at(&shown[i].mesh, quality, v);
                if (!isfinite(value))
                    continue;
                if (pass == 0) {
                    all.low = fmin(all.low, value);
                    all.high = fmax(all.high, value);
                } else {
                    double place = (value - all.low) / (all.high - all.low);
                    counts[place > 0 ? (size_t)(place * BUCKETS) : 0]++;
                    total++;
                }
            }
            is_found = is_found || quality;
        }
    *range = (struct range){0, 0};
    if (total > 0) {
        range->low = quantile(counts, total, &all, 0.01);
        range->high = quantile(counts, total, &all, 0.99);
        if (all.low >= 0 && range->low < range->high / 2)
            range->low = 0;
    }
    return is_found;
}

/* The mesh's records become the three colours of its quality. */
static enum status colour_quality(struct context *ctx, struct shown *shown,
                                  const struct range *range)
{
    struct mesh *mesh = &shown->mesh;
    const struct attribute *quality = find_quality(shown);
    size_t vertices = (size_t)mesh->vertex_count;
    unsigned char *colours = NULL;
    if (!quality)
        return STATUS_OK;
    enum status status = memory_take(ctx, vertices, 3, &colours);
    if (status != STATUS_OK)
        return status;
    double width = range->high - range->low;
    for (size_t v = 0; v < vertices; v++) {
        double value = quality_at(mesh, quality, v);
        uint32_t colour = colour_map(width > 0 ? (value - range->low) / width : 0);
        for (unsigned k = 0; k < 3; k++)
            colours[3 * v + k] = (unsigned char)(colour >> (16 - 8 * k));
    }
    memory_release(ctx, &mesh->records, vertices, mesh->attributes.stride);
    mesh->attributes = (struct attributes){
        .count = 3,
        .stride = 3,
        .list = {{"red", SCALAR_UINT8, 0}, {"green", SCALAR_UINT8, 1}, {"blue", SCALAR_UINT8, 2}}};
    mesh->records = colours;
    return STATUS_OK;
}

/* ---- the picture ---- */

static enum status show_mesh(struct context *ctx, struct shown *shown, const char *path,
                             spbm_file_kind kind)
{
    enum status status;
    shown->path = path;
    if (kind == SPBM_FILE_STORE) {
        status = store_open(ctx, path, true, &shown->store);
        if (status == STATUS_OK)
            status = store_load(shown->store, &shown->mesh);
    } else {
        status = mesh_load(ctx, path, &shown->mesh);
    }
    write_caption(shown, path, shown->mesh.face_count, "face", "faces");
    if (status == STATUS_OK && shown->mesh.face_count == 0)
        tell(ctx, MESSAGE_WARNING, "%s: has no faces to draw", path);
    return status;
}

static enum status show_all(struct context *ctx, const char *const *paths, size_t path_count,
                            struct shown *shown, size_t *count)
{
    for (size_t i = 0; i < path_count; i++) {
        spbm_file_kind kind;
        uint64_t size;
        enum status status = recognise_file(ctx, paths[i], &kind, &size);
        if (status != STATUS_OK)
            return status;
        if (kind == SPBM_FILE_CHAINS) {
            struct shown *last = *count > 0 ? &shown[*count - 1] : NULL;
            if (!last || !last->store || last->colours)
                return fail(ctx, STATUS_MISUSE,
                            "%s: a chain file has no surface to draw; put the mesh store that it "
                            "was made from before it",
                            paths[i]);
            status = colour_patches(ctx, last, paths[i]);
        } else if (*count == SPBM_RENDER_MAX) {
            return fail(ctx, STATUS_MISUSE, "at most %d meshes fit into one picture",
                        (int)SPBM_RENDER_MAX);
        } else {
            status = show_mesh(ctx, &shown[(*count)++], paths[i], kind);
        }
        if (status != STATUS_OK)
            return status;
    }
    return STATUS_OK;
}

static enum status draw(struct context *ctx, struct shown *shown, size_t count, const char *picture,
                        const spbm_render_options *options)
{
    struct render_item items[SPBM_RENDER_MAX];
    struct render_options inner;
    struct range range;
    enum status status = STATUS_OK;
    render_defaults(&inner);
    inner.width = options->width;
    inner.height = options->height;
    memcpy(inner.view, options->view, sizeof inner.view);
    memcpy(inner.up, options->up, sizeof inner.up);
    inner.wireframe = options->wireframe != 0;
    inner.flat = options->flat != 0;
    inner.background = options->background;
    if (find_range(shown, count, &range)) {
        inner.legend_name = options->legend ? options->legend : "quality";
        inner.legend_low = range.low;
        inner.legend_high = range.high;
    }
    for (size_t i = 0; i < count && status == STATUS_OK; i++) {
        status = colour_quality(ctx, &shown[i], &range);
        items[i] = (struct render_item){.mesh = &shown[i].mesh,
                                        .face_colours = shown[i].colours,
                                        .caption = options->captions ? shown[i].caption : NULL};
    }
    return status == STATUS_OK ? render_png(ctx, picture, items, count, &inner) : status;
}

/* Only PNG is written, and another ending would say another thing. */
static enum status check_picture(struct context *ctx, const char *path)
{
    struct stat info;
    const size_t length = strlen(path);
    if (is_standard_stream(path) || (length >= 4 && strcasecmp(path + length - 4, ".png") == 0) ||
        (stat(path, &info) == 0 && !S_ISREG(info.st_mode)))
        return STATUS_OK;
    return fail(ctx, STATUS_MISUSE, "%s: pictures are written as PNG: the name must end in .png",
                path);
}

spbm_status spbm_render(spbm_job *job, const char *const *paths, size_t path_count,
                        const char *picture, const spbm_render_options *options)
{
    struct context *ctx = call_begin(job);
    struct shown *shown = NULL;
    size_t count = 0;
    spbm_render_options defaults;
    if (!options) {
        spbm_render_defaults(&defaults);
        options = &defaults;
    }
    enum status status = check_writable(ctx, picture);
    if (status == STATUS_OK)
        status = check_picture(ctx, picture);
    if (status == STATUS_OK)
        status = check_inputs(ctx, paths, path_count, picture);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, SPBM_RENDER_MAX, sizeof *shown, &shown);
    if (status == STATUS_OK)
        status = show_all(ctx, paths, path_count, shown, &count);
    if (status == STATUS_OK)
        status = draw(ctx, shown, count, picture, options);
    for (size_t i = 0; i < count; i++) {
        memory_release(ctx, &shown[i].colours, (size_t)shown[i].mesh.face_count,
                       sizeof *shown[i].colours);
        if (shown[i].store)
            store_close(&shown[i].store);
        mesh_clear(ctx, &shown[i].mesh);
    }
    memory_release(ctx, &shown, SPBM_RENDER_MAX, sizeof *shown);
    return call_end(job, status);
}
