/* The sink checks the order of calls and the invariants that import.h promises. */
#include "test_collect.h"

#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "test_files.h"
#include "test_gzip.h"
#include "test_kit.h"

static void *longer(void *block, size_t size)
{
    block = realloc(block, size ? size : 1);
    assert_non_null(block);
    return block;
}

static enum status begin(void *user, const struct attributes *attributes, bool is_soup,
                         uint64_t expected_vertices, uint64_t expected_faces)
{
    struct collected *all = user;
    all->begins++;
    all->attributes = *attributes;
    all->is_soup = is_soup;
    all->expected_vertices = expected_vertices;
    all->expected_faces = expected_faces;
    return STATUS_OK;
}

static enum status vertices(void *user, size_t count, const float *floats, const double *doubles,
                            const unsigned char *records)
{
    struct collected *all = user;
    size_t stride = all->attributes.stride;
    assert_int_equal(all->begins, 1);
    assert_true(count > 0);
    assert_true((floats == NULL) != (doubles == NULL));
    assert_true((records == NULL) == (stride == 0));
    all->positions = longer(all->positions, 3 * (all->vertex_count + count) * sizeof(double));
    for (size_t i = 0; i < 3 * count; i++) {
        double value = floats ? (double)floats[i] : doubles[i];
        assert_true(value - value == 0);
        all->positions[3 * all->vertex_count + i] = value;
    }
    all->records = longer(all->records, (all->vertex_count + count) * stride);
    if (stride)
        memcpy(all->records + all->vertex_count * stride, records, count * stride);
    all->vertex_count += count;
    all->is_float32 &= floats != NULL;
    return STATUS_OK;
}

static enum status faces(void *user, uint64_t first_face, size_t count, const uint32_t *sizes,
                         const uint32_t *indices)
{
    struct collected *all = user;
    assert_int_equal(all->begins, 1);
    assert_true(count > 0 && first_face >= all->face_count);
    size_t corners = 0;
    all->sizes = longer(all->sizes, (all->face_count + count) * sizeof(uint32_t));
    for (size_t i = 0; i < count; i++) {
        uint32_t size = sizes ? sizes[i] : 3;
        assert_true(size >= 3);
        all->sizes[all->face_count + i] = size;
        corners += size;
    }
    all->indices = longer(all->indices, (all->index_count + corners) * sizeof(uint32_t));
    memcpy(all->indices + all->index_count, indices, corners * sizeof *indices);
    all->face_count += count;
    all->first_face = first_face;
    all->index_count += corners;
    return STATUS_OK;
}

/* What is said to be the largest index is. */
static enum status triangles(void *user, uint64_t first_face, size_t count, const uint32_t *indices,
                             uint32_t largest)
{
    uint32_t found = 0;
    for (size_t i = 0; i < 3 * count; i++)
        found = indices[i] > found ? indices[i] : found;
    assert_int_equal(found, largest);
    return faces(user, first_face, count, NULL, indices);
}

static void listen(void *user, enum message_level level, const char *text)
{
    struct collected *all = user;
    (void)level;
    size_t used = strlen(all->messages);
    snprintf(all->messages + used, sizeof all->messages - used, "%s\n", text);
}

struct feeder {
    int fd;
    const unsigned char *data;
    size_t size;
    enum feed feed;
};

static void *feed_pipe(void *user)
{
    struct feeder *feeder = user;
    uint64_t seed = 7;
    for (size_t at = 0; at < feeder->size;) {
        size_t left = feeder->size - at;
        size_t piece = feeder->feed == FEED_BYTES ? 1 : 1 + random_below(&seed, 9973);
        ssize_t put = write(feeder->fd, feeder->data + at, piece < left ? piece : left);
        if (put <= 0)
            break;
        at += (size_t)put;
    }
    close(feeder->fd);
    return NULL;
}

struct collected collect(import_function reader, const void *data, size_t size, enum feed feed)
{
    struct collected all = {.is_float32 = true};
    struct import_sink sink = {&all, begin, vertices, faces, triangles};
    struct context ctx;
    struct instream *stream;
    char path[64];
    int ends[2] = {-1, -1};
    pthread_t thread;
    struct feeder feeder;
    context_init(&ctx);
    ctx.message = listen;
    ctx.user = &all;
    if (feed == FEED_FILE || feed == FEED_GZIP) {
        ctx.threads = 3;
        if (feed == FEED_GZIP)
            gzip_write(test_path("input"), data, size);
        else
            file_write(test_path("input"), data, size);
        all.status = instream_open(&ctx, test_path("input"), &stream);
    } else {
        assert_int_equal(pipe(ends), 0);
        feeder = (struct feeder){ends[1], data, size, feed};
        assert_int_equal(pthread_create(&thread, NULL, feed_pipe, &feeder), 0);
        snprintf(path, sizeof path, "/dev/fd/%d", ends[0]);
        all.status = instream_open(&ctx, path, &stream);
    }
    if (all.status == STATUS_OK)
        all.status = reader(&ctx, stream, &sink);
    size_t got = 1;
    for (const unsigned char *bytes; all.status == STATUS_OK && got > 0;) {
        assert_int_equal(instream_peek(stream, 1, &bytes, &got), STATUS_OK);
        instream_take(stream, got);
    }
    if (all.status == STATUS_OK)
        all.digest = instream_digest(stream);
    if (feed == FEED_BYTES || feed == FEED_PIECES) {
        close(ends[0]);
        /* What a refused input leaves in the pipe must not stop the feeder. */
        for (got = 1; all.status != STATUS_OK && got > 0 && stream;) {
            const unsigned char *bytes;
            if (instream_peek(stream, 1, &bytes, &got) != STATUS_OK)
                break;
            instream_take(stream, got);
        }
        pthread_join(thread, NULL);
    }
    instream_close(&stream);
    assert_int_equal(ctx.memory_now, 0);
    assert_int_equal(all.status, ctx.failed);
    snprintf(all.error, sizeof all.error, "%s", ctx.error);
    context_clear(&ctx);
    return all;
}

struct collected collect_text(import_function reader, const char *text)
{
    return collect(reader, text, strlen(text), FEED_FILE);
}

void collected_free(struct collected *collected)
{
    free(collected->positions);
    free(collected->records);
    free(collected->sizes);
    free(collected->indices);
    memset(collected, 0, sizeof *collected);
}

void assert_read(const struct collected *collected)
{
    if (collected->status != STATUS_OK)
        fail_msg("status %d: %s", (int)collected->status, collected->error);
    assert_int_equal(collected->begins, 1);
}

void assert_refused(struct collected collected, ...)
{
    va_list fragments;
    if (collected.status != STATUS_BAD_INPUT)
        fail_msg("status %d instead of bad input: %s", (int)collected.status, collected.error);
    va_start(fragments, collected);
    for (const char *fragment; (fragment = va_arg(fragments, const char *));)
        if (!strstr(collected.error, fragment))
            fail_msg("\"%s\" is not in \"%s\"", fragment, collected.error);
    va_end(fragments);
    assert_null(strchr(collected.error, '\n'));
    assert_non_null(strstr(collected.error, "/input: "));
    collected_free(&collected);
}

void assert_reads_shape(import_function reader, const struct shape *shape, enum shape_format format,
                        bool is_float32)
{
    size_t size;
    unsigned char *data = shape_encode(shape, format, &size);
    for (int feed = FEED_FILE; feed <= FEED_PIECES; feed += FEED_PIECES) {
        struct collected collected = collect(reader, data, size, (enum feed)feed);
        assert_read(&collected);
        assert_int_equal(collected.is_float32, is_float32);
        assert_int_equal(collected.vertex_count, shape->vertex_count);
        assert_memory_equal(collected.positions, shape->positions,
                            3 * shape->vertex_count * sizeof *shape->positions);
        assert_int_equal(collected.index_count, shape->index_count);
        assert_memory_equal(collected.indices, shape->indices,
                            shape->index_count * sizeof *shape->indices);
        collected_free(&collected);
    }
    free(data);
}
