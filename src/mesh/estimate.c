/*
 * Foretelling a mesh's size.
 *
 * PLY, OFF and binary STL tell their counts, but each in its own way, and OBJ and text STL tell
 * nothing. A second set of little parsers would have to follow the readers for ever; so the readers
 * themselves are run, with a sink that stops them: at once where they know the counts, else when
 * enough of the beginning has been seen to scale it up by the file's size.
 */
#include "mesh/estimate.h"

#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "base/bytes.h"

enum {
    SAMPLE_BYTES = 8 << 20, /* smaller files are read whole */
    LEAST_FACE_BYTES = 6,   /* of a face in any format, about: "f 1 2 3" shares its vertices */
    INFLATION_LIMIT = 1032, /* bytes that deflate makes of one, at most */
    INFLATION_GUESS = 4
};

struct look {
    struct mesh_estimate *estimate;
    struct instream *stream;
    uint64_t vertices, faces; /* seen so far */
    uint64_t position;        /* in the stream, when the last batch came */
};

static enum status look_begin(void *user, const struct attributes *attributes, bool is_soup,
                              uint64_t expected_vertices, uint64_t expected_faces)
{
    struct look *look = user;
    struct mesh_estimate *estimate = look->estimate;
    estimate->stride = attributes->stride;
    estimate->is_soup = is_soup;
    estimate->vertices = expected_vertices;
    estimate->faces = expected_faces;
    estimate->is_counted = expected_faces > 0;
    if (is_soup && estimate->vertices == 0)
        estimate->vertices = 3 * expected_faces;
    return estimate->is_counted ? STATUS_CANCELLED : STATUS_OK;
}

static enum status look_vertices(void *user, size_t count, const float *floats,
                                 const double *doubles, const unsigned char *records)
{
    struct look *look = user;
    (void)floats, (void)doubles, (void)records;
    look->vertices += count;
    look->position = instream_position(look->stream);
    return look->position < SAMPLE_BYTES ? STATUS_OK : STATUS_CANCELLED;
}

static enum status look_faces(void *user, uint64_t first_face, size_t count, const uint32_t *sizes,
                              const uint32_t *indices)
{
    struct look *look = user;
    (void)first_face, (void)sizes, (void)indices;
    look->faces += count;
    look->position = instream_position(look->stream);
    return look->position < SAMPLE_BYTES ? STATUS_OK : STATUS_CANCELLED;
}

/* Bytes of the inflated file: from the last four of a gzip file where they can tell. */
static uint64_t inflated_size(const char *path, uint64_t size)
{
    unsigned char bytes[4];
    FILE *file = fopen(path, "rbe");
    uint64_t inflated = 0;
    if (file && fseek(file, -4, SEEK_END) == 0 && fread(bytes, 1, 4, file) == 4)
        inflated = load_u32(bytes);
    if (file)
        fclose(file);
    /* They hold the size modulo 2^32, of the last member. */
    bool is_likely = inflated > size && size < (UINT64_C(1) << 32) / 16;
    return is_likely ? inflated : size * INFLATION_GUESS;
}

/* Vertices come before faces in most OBJ files, so only vertices may have been seen: a closed
 * surface has two faces for each, and a line of either has about the same length. */
static void scale_up(struct look *look, uint64_t size)
{
    struct mesh_estimate *estimate = look->estimate;
    if (look->position == 0)
        return;
    double scale = (double)size / (double)look->position;
    if (look->faces == 0) {
        estimate->vertices = (uint64_t)((double)look->vertices * scale / 3);
        estimate->faces = 2 * estimate->vertices;
    } else {
        estimate->vertices = (uint64_t)((double)look->vertices * scale);
        estimate->faces = (uint64_t)((double)look->faces * scale);
    }
}

static bool looks_like_text(struct context *ctx, struct instream *stream, bool *is_text)
{
    const unsigned char *data;
    size_t size;
    (void)ctx;
    if (instream_peek(stream, 512, &data, &size) != STATUS_OK)
        return false;
    size = size < 512 ? size : 512;
    *is_text = !memchr(data, 0, size) && !memmem(data, size, "format binary", 13);
    return true;
}

static void look_at(struct context *ctx, const char *path, struct instream *stream,
                    struct mesh_estimate *estimate)
{
    struct look look = {.estimate = estimate, .stream = stream};
    struct import_sink sink = {
        .user = &look, .begin = look_begin, .vertices = look_vertices, .faces = look_faces};
    if (!looks_like_text(ctx, stream, &estimate->is_text))
        return;
    enum status status = import_read(ctx, stream, &sink);
    estimate->is_gzip = instream_is_gzip(stream);
    uint64_t size = estimate->file_size;
    if (status == STATUS_OK) {
        estimate->vertices = look.vertices;
        estimate->faces = look.faces;
    } else if (!estimate->is_counted) {
        scale_up(&look, estimate->is_gzip ? inflated_size(path, size) : size);
    }
    uint64_t most = size / LEAST_FACE_BYTES * (estimate->is_gzip ? INFLATION_LIMIT : 1);
    if (estimate->faces > most)
        estimate->faces = most;
    if (estimate->vertices > 3 * most)
        estimate->vertices = 3 * most;
}

enum status mesh_estimate(struct context *ctx, const char *path, struct mesh_estimate *estimate)
{
    struct stat info;
    struct context quiet; /* the readers' words are the import's to say */
    struct instream *stream = NULL;
    memset(estimate, 0, sizeof *estimate);
    if (strcmp(path, "-") == 0 || stat(path, &info) != 0 || !S_ISREG(info.st_mode))
        return STATUS_OK;
    estimate->file_size = (uint64_t)info.st_size;
    context_init(&quiet);
    quiet.memory_budget = ctx->memory_budget;
    quiet.cpu_level_cap = ctx->cpu_level_cap;
    enum status status = instream_open(&quiet, path, &stream);
    if (status == STATUS_OK)
        look_at(&quiet, path, stream, estimate);
    instream_close(&stream);
    context_clear(&quiet);
    return status == STATUS_NO_MEMORY ? fail(ctx, status, "not enough memory to look at %s", path)
                                      : STATUS_OK;
}
