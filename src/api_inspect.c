/*
 * The public interface to looking at files: info, check, measure. Which of our formats a file has
 * is told by its first bytes; whatever is neither is taken for a mesh file, whose reader says what
 * is wrong with it.
 */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "api_internal.h"
#include "base/file.h"
#include "inspect/measure.h"
#include "mesh/import.h"
#include "mesh/store_layout.h"
#include "simplify/chain_frame.h"

enum status recognise_file(struct context *ctx, const char *path, spbm_file_kind *kind,
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
    enum status status = recognise_file(ctx, path, &figures->kind, &figures->file_size);
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
    enum status status = recognise_file(ctx, path, &found, &size);
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

/* Only a PLY can say how far off a vertex is. */
static enum status check_error_ply(struct context *ctx, const char *original,
                                   const char *simplified, const char *path)
{
    const size_t length = strlen(path);
    if (length < 4 || strcasecmp(path + length - 4, ".ply") != 0)
        return fail(ctx, STATUS_MISUSE,
                    "%s: the mesh with its errors is written as PLY: a name "
                    "that ends in .ply is needed",
                    path);
    enum status status = check_writable(ctx, path);
    const char *inputs[2] = {original, simplified};
    return status == STATUS_OK ? check_inputs(ctx, inputs, 2, path) : status;
}

spbm_status spbm_measure(spbm_job *job, const char *original, const char *simplified,
                         const spbm_measure_options *options, spbm_measurement *measurement)
{
    struct context *ctx = call_begin(job);
    struct measure_options wanted = {0};
    struct measurement result = {0};
    struct mesh mesh = {0};
    const char *error_ply = options ? options->error_ply : NULL;
    if (options) {
        wanted.samples_per_face = options->samples_per_face;
        wanted.self_intersections = options->self_intersections != 0;
    }
    enum status status = STATUS_OK;
    if (is_standard_stream(original) && is_standard_stream(simplified))
        status = fail(ctx, STATUS_MISUSE, "standard input can be read once only");
    if (status == STATUS_OK && error_ply)
        status = check_error_ply(ctx, original, simplified, error_ply);
    if (status == STATUS_OK)
        status = measure(ctx, original, simplified, &wanted, &result, &mesh);
    if (status == STATUS_OK && error_ply) {
        struct export_options export = {
            .format = EXPORT_PLY, .as_float32 = mesh.is_float32, .sync = true};
        status = measure_save(ctx, error_ply, &export, &result, &mesh);
    }
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
        copy_quality(&measurement->simplified, &result.simplified, 0);
    }
    measurement_clear(ctx, &result);
    mesh_clear(ctx, &mesh);
    return call_end(job, status);
}
