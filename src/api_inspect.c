/*
 * The public interface to looking at files: info, check, measure, render. Which of our formats a
 * file has is told by its first bytes; whatever is neither is taken for a mesh file, whose reader
 * says what is wrong with it.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "api_internal.h"
#include "base/memory.h"
#include "inspect/measure.h"
#include "inspect/render.h"
#include "mesh/import.h"
#include "mesh/store_layout.h"
#include "simplify/chain_frame.h"
#include "simplify/patchify.h"

static enum status recognise(struct context *ctx, const char *path, spbm_file_kind *kind,
                             uint64_t *size)
{
    *kind = SPBM_FILE_MESH;
    *size = 0;
    if (is_standard_stream(path))
        return STATUS_OK;
    struct stat info;
    char magic[8] = {0};
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0)
        return fail_errno(ctx, errno, "%s: cannot open", path);
    enum status status = STATUS_OK;
    if (fstat(fd, &info) != 0) {
        status = fail_errno(ctx, errno, "%s: cannot be examined", path);
    } else if (S_ISREG(info.st_mode)) {
        *size = (uint64_t)info.st_size;
        if (read(fd, magic, sizeof magic) < 0)
            status = fail_errno(ctx, errno, "%s: cannot read", path);
        else if (memcmp(magic, STORE_MAGIC, sizeof magic) == 0)
            *kind = SPBM_FILE_STORE;
        else if (memcmp(magic, CHAIN_MAGIC, sizeof magic) == 0)
            *kind = SPBM_FILE_CHAINS;
    }
    close(fd);
    return status;
}

/* ---- info ---- */

static enum status describe_mesh(struct context *ctx, const char *path, spbm_quality *figures)
{
    struct mesh mesh = {0};
    struct quality quality;
    enum status status = mesh_load(ctx, path, &mesh);
    if (status == STATUS_OK)
        status = quality_of_mesh(ctx, &mesh, &quality);
    if (status == STATUS_OK)
        copy_quality(figures, &quality, mesh.attributes.count);
    mesh_clear(ctx, &mesh);
    return status;
}

static enum status describe_store(struct context *ctx, const char *path,
                                  spbm_store_figures *figures)
{
    struct store *store;
    enum status status = store_open(ctx, path, true, &store);
    if (status != STATUS_OK)
        return status;
    copy_store(figures, store_info(store));
    store_close(&store);
    return STATUS_OK;
}

static enum status describe_chains(struct context *ctx, const char *path,
                                   spbm_chain_figures *figures)
{
    struct chain_file *file;
    enum status status = chain_file_open(ctx, path, &file);
    if (status != STATUS_OK)
        return status;
    copy_chains(figures, chain_file_info(file));
    chain_file_close(&file);
    return STATUS_OK;
}

spbm_status spbm_info(spbm_job *job, const char *path, spbm_file_figures *figures)
{
    struct context *ctx = call_begin(job);
    memset(figures, 0, sizeof *figures);
    enum status status = recognise(ctx, path, &figures->kind, &figures->file_size);
    if (status != STATUS_OK)
        return call_end(job, status);
    switch (figures->kind) {
    case SPBM_FILE_MESH:
        return call_end(job, describe_mesh(ctx, path, &figures->mesh));
    case SPBM_FILE_STORE:
        return call_end(job, describe_store(ctx, path, &figures->store));
    case SPBM_FILE_CHAINS:
        break;
    }
    return call_end(job, describe_chains(ctx, path, &figures->chains));
}

/* ---- check ---- */

/* One line of all that keeps a mesh from being a clean manifold. */
static enum status judge_mesh(struct context *ctx, const char *path, const spbm_quality *quality)
{
    const struct {
        uint64_t count;
        const char *one, *many;
    } defects[] = {
        {quality->nonmanifold_edges, "edge of more than two faces", "edges of more than two faces"},
        {quality->nonmanifold_vertices, "vertex where surfaces touch",
         "vertices where surfaces touch"},
        {quality->misoriented_edges, "edge between faces of opposite orientation",
         "edges between faces of opposite orientation"},
        {quality->degenerate_faces, "face that repeats a vertex", "faces that repeat a vertex"},
        {quality->duplicate_faces, "duplicate face", "duplicate faces"},
    };
    if (quality->is_manifold)
        return STATUS_OK;
    char words[512] = "";
    size_t used = 0;
    for (size_t i = 0; i < sizeof defects / sizeof defects[0]; i++) {
        if (defects[i].count == 0 || used >= sizeof words)
            continue;
        int length = snprintf(words + used, sizeof words - used, "%s%llu %s", used ? ", " : "",
                              (unsigned long long)defects[i].count,
                              defects[i].count == 1 ? defects[i].one : defects[i].many);
        used += length > 0 ? (size_t)length : 0;
    }
    return fail(ctx, STATUS_BAD_INPUT, "%s: %s", path, used ? words : "not a manifold");
}

spbm_status spbm_check(spbm_job *job, const char *path, spbm_file_kind *kind)
{
    struct context *ctx = call_begin(job);
    spbm_file_kind found = SPBM_FILE_MESH;
    spbm_quality quality;
    uint64_t size;
    enum status status = recognise(ctx, path, &found, &size);
    if (kind)
        *kind = found;
    if (status != STATUS_OK)
        return call_end(job, status);
    switch (found) {
    case SPBM_FILE_STORE:
        status = store_check(ctx, path);
        break;
    case SPBM_FILE_CHAINS:
        status = chain_file_check(ctx, path);
        break;
    case SPBM_FILE_MESH:
        status = describe_mesh(ctx, path, &quality);
        if (status == STATUS_OK)
            status = judge_mesh(ctx, path, &quality);
        break;
    }
    return call_end(job, status);
}

/* ---- measure ---- */

void spbm_measure_defaults(spbm_measure_options *options)
{
    *options = (spbm_measure_options){.samples_per_face = 0};
}

static spbm_deviation copy_deviation(const struct deviation *from)
{
    return (spbm_deviation){
        .largest = from->largest, .mean = from->mean, .rms = from->rms, .samples = from->samples};
}

spbm_status spbm_measure(spbm_job *job, const char *original, const char *simplified,
                         const spbm_measure_options *options, spbm_measurement *measurement)
{
    struct context *ctx = call_begin(job);
    struct measure_options wanted = {0};
    struct measurement result = {0};
    struct mesh mesh = {0};
    if (options) {
        wanted.samples_per_face = options->samples_per_face;
        wanted.self_intersections = options->self_intersections != 0;
    }
    enum status status = STATUS_OK;
    if (is_standard_stream(original) && is_standard_stream(simplified))
        status = fail(ctx, STATUS_MISUSE, "standard input can be read once only");
    if (status == STATUS_OK)
        status = measure(ctx, original, simplified, &wanted, &result, &mesh);
    if (status == STATUS_OK) {
        *measurement = (spbm_measurement){
            .forward = copy_deviation(&result.forward),
            .backward = copy_deviation(&result.backward),
            .hausdorff = result.hausdorff,
            .diagonal = result.diagonal,
            .normal_mean = result.normal_mean,
            .normal_largest = result.normal_largest,
            .samples_per_face = result.samples_per_face,
            .flipped_faces = result.flipped_faces,
            .self_intersecting_faces = result.self_intersecting_faces,
        };
        copy_quality(&measurement->original, &result.original, 0);
        copy_quality(&measurement->simplified, &result.simplified, mesh.attributes.count);
    }
    measurement_clear(ctx, &result);
    mesh_clear(ctx, &mesh);
    return call_end(job, status);
}

/* ---- render ---- */

/* A mesh of the picture, with what it takes to draw it. */
struct shown {
    struct mesh mesh;
    uint32_t *colours; /* one a face, or NULL */
    char caption[256];
    struct store *store; /* opened, while its chain file may follow */
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

/* Gives every face the colour of its patch: the patches of a chain file can be grown again from its
 * store and options. */
static enum status colour_patches(struct context *ctx, struct shown *shown, const char *path)
{
    struct chain_file *file;
    enum status status = chain_file_open(ctx, path, &file);
    if (status != STATUS_OK)
        return status;
    const struct chain_info *info = chain_file_info(file);
    uint64_t faces = shown->mesh.face_count;
    uint32_t first_patch = 0;
    if (info->topology.faces != faces || info->topology.vertices != shown->mesh.vertex_count ||
        info->slab_count != store_info(shown->store)->slab_count)
        status =
            fail(ctx, STATUS_BAD_INPUT, "%s: is not a chain file of the store before it", path);
    else
        status = memory_take(ctx, (size_t)faces, sizeof *shown->colours, &shown->colours);
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
    chain_file_close(&file);
    return status;
}

static enum status show_mesh(struct context *ctx, struct shown *shown, const char *path,
                             spbm_file_kind kind)
{
    enum status status;
    if (kind == SPBM_FILE_STORE) {
        status = store_open(ctx, path, true, &shown->store);
        if (status == STATUS_OK)
            status = store_load(shown->store, &shown->mesh);
    } else {
        status = mesh_load(ctx, path, &shown->mesh);
    }
    /* "name: 1,087,716 faces" */
    const char *slash = strrchr(path, '/');
    unsigned long long faces = shown->mesh.face_count, parts[7];
    unsigned part_count = 0;
    do
        parts[part_count++] = faces % 1000;
    while (faces /= 1000);
    int used = snprintf(shown->caption, sizeof shown->caption, "%.200s: %llu",
                        slash ? slash + 1 : path, parts[part_count - 1]);
    for (unsigned i = part_count - 1; i-- > 0 && used > 0;)
        used += snprintf(shown->caption + used, sizeof shown->caption - (size_t)used, ",%03llu",
                         parts[i]);
    if (used > 0)
        snprintf(shown->caption + used, sizeof shown->caption - (size_t)used, " faces");
    return status;
}

static enum status show_all(struct context *ctx, const char *const *paths, size_t path_count,
                            struct shown *shown, size_t *count)
{
    for (size_t i = 0; i < path_count; i++) {
        spbm_file_kind kind;
        uint64_t size;
        enum status status = recognise(ctx, paths[i], &kind, &size);
        if (status != STATUS_OK)
            return status;
        if (kind == SPBM_FILE_CHAINS) {
            struct shown *last = *count > 0 ? &shown[*count - 1] : NULL;
            if (!last || !last->store || last->colours)
                return fail(ctx, STATUS_MISUSE,
                            "%s: a chain file is shown by the mesh store before it", paths[i]);
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

spbm_status spbm_render(spbm_job *job, const char *const *paths, size_t path_count,
                        const char *picture, const spbm_render_options *options)
{
    struct context *ctx = call_begin(job);
    struct shown *shown = NULL;
    struct render_item items[SPBM_RENDER_MAX];
    size_t count = 0;
    spbm_render_options defaults;
    if (!options) {
        spbm_render_defaults(&defaults);
        options = &defaults;
    }
    enum status status = check_writable(ctx, picture);
    if (status == STATUS_OK)
        status = check_inputs(ctx, paths, path_count, picture);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, SPBM_RENDER_MAX, sizeof *shown, &shown);
    if (status == STATUS_OK)
        status = show_all(ctx, paths, path_count, shown, &count);
    if (status == STATUS_OK) {
        struct render_options inner;
        render_defaults(&inner);
        inner.width = options->width;
        inner.height = options->height;
        memcpy(inner.view, options->view, sizeof inner.view);
        memcpy(inner.up, options->up, sizeof inner.up);
        inner.wireframe = options->wireframe != 0;
        inner.flat = options->flat != 0;
        inner.background = options->background;
        for (size_t i = 0; i < count; i++)
            items[i] = (struct render_item){.mesh = &shown[i].mesh,
                                            .face_colours = shown[i].colours,
                                            .caption = options->captions ? shown[i].caption : NULL};
        status = render_png(ctx, picture, items, count, &inner);
    }
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
