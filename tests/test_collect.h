/*
 * An import sink that keeps all it gets, and ways to feed bytes to the readers: as a file, or
 * through a pipe in small pieces.
 */
#ifndef SPBM_TEST_COLLECT_H
#define SPBM_TEST_COLLECT_H

#include "mesh/import.h"
#include "test_shapes.h"

struct collected {
    enum status status;
    char error[1024];    /* the context's words */
    char messages[4096]; /* all that was told, a line each */
    unsigned begins;
    struct attributes attributes;
    bool is_soup;
    uint64_t expected_vertices, expected_faces;
    size_t vertex_count, face_count, index_count;
    uint64_t first_face; /* of the last batch */
    double *positions;
    unsigned char *records;
    uint32_t *sizes, *indices;
    bool is_float32; /* no batch came as doubles */
    uint32_t digest; /* of all bytes, where the reading went well */
};

/* How the bytes get to the reader. */
enum feed {
    FEED_FILE, /* with three threads, as is the next */
    FEED_GZIP, /* a file, compressed */
    FEED_BYTES /* a pipe, one byte a write */,
    FEED_PIECES /* a pipe, odd sizes */
};

typedef enum status (*import_function)(struct context *ctx, struct instream *stream,
                                       const struct import_sink *sink);

/* Runs a reader on the bytes. The input's name in messages is <test folder>/input (of files). */
struct collected collect(import_function reader, const void *data, size_t size, enum feed feed);
struct collected collect_text(import_function reader, const char *text);
void collected_free(struct collected *collected);

/* Fails the test unless the read failed as bad input and the words hold all fragments (NULL ends
 * them), in one line. Frees the collected. */
void assert_refused(struct collected collected, ...) __attribute__((sentinel));
/* Fails the test unless reading went well. */
void assert_read(const struct collected *collected);
/* Encodes the shape, reads it as a file and through a pipe in odd pieces, and compares. */
void assert_reads_shape(import_function reader, const struct shape *shape, enum shape_format format,
                        bool is_float32);

#endif
