/*
 * The frame of both our formats: magic, version, and a table of sections, each with a kind, an
 * offset, a length and a CRC-32. Described for other readers in section_file_format.md.
 *
 * Writing appends sections front to back and puts the table last, so that a file can be streamed
 * into a pipe: the last 32 bytes (the end marker) say where the table is, and truncation shows.
 *
 * Reading is a check list that trusts no offset: sections must lie inside the file in the order of
 * the table, be aligned to 64 bytes, not overlap, not repeat, and the bytes between them must be
 * zero. Every bit of a file is covered by a CRC or by a value that it must have.
 */
#ifndef SPBM_BASE_SECTION_FILE_H
#define SPBM_BASE_SECTION_FILE_H

#include "file.h"

enum { SECTION_ALIGN = 64, SECTION_MAX = 64 };

struct section {
    uint32_t kind;   /* four characters, as FOURCC() makes them */
    uint32_t crc;    /* of the section's bytes, without padding */
    uint64_t offset; /* from the file's first byte, a multiple of SECTION_ALIGN */
    uint64_t length; /* bytes */
};

#define FOURCC(a, b, c, d) \
    ((uint32_t)(a) | (uint32_t)(b) << 8 | (uint32_t)(c) << 16 | (uint32_t)(d) << 24)

struct section_writer {
    struct output out;
    unsigned char magic[8];
    uint32_t version;
    struct section table[SECTION_MAX];
    unsigned count;
    bool in_section;
};

/* `magic` is 8 bytes. A path that is no regular file is written straight through. After a failure
 * of section_begin, section_append or section_end, only section_file_discard makes sense;
 * section_file_finish closes the file either way. A kind is used once. */
enum status section_file_create(struct context *ctx, const char *path, const char magic[8],
                                uint32_t version, struct section_writer *writer) MUST_CHECK;
enum status section_begin(struct section_writer *writer, uint32_t kind) MUST_CHECK;
enum status section_append(struct section_writer *writer, const void *data, size_t size) MUST_CHECK;
/* The same for bytes whose checksum (begun with 0) is known. */
enum status section_append_summed(struct section_writer *writer, const void *data, size_t size,
                                  uint32_t crc) MUST_CHECK;
/* Begins the whole file again, as after section_file_create; where
 * output_can_restart(&writer->out). */
enum status section_file_restart(struct section_writer *writer) MUST_CHECK;
enum status section_end(struct section_writer *writer) MUST_CHECK;
enum status section_file_finish(struct section_writer *writer, bool sync) MUST_CHECK;
void section_file_discard(struct section_writer *writer);

struct section_reader {
    struct input_file file;
    uint32_t version;
    struct section table[SECTION_MAX];
    unsigned count;
};

/* Opens and checks everything but the sections' contents (the padding too). A wrong magic is
 * STATUS_BAD_INPUT with `what` ("a mesh store") in its words. */
enum status section_file_open(struct context *ctx, const char *path, const char magic[8],
                              uint32_t version, const char *what,
                              struct section_reader *reader) MUST_CHECK;
void section_file_close(struct section_reader *reader);
/* NULL when there is none of that kind. */
const struct section *section_find(const struct section_reader *reader, uint32_t kind);
/* Verifies a whole section's CRC, in pieces. */
enum status section_verify(struct section_reader *reader, const struct section *section) MUST_CHECK;
/* Reads a whole small section (at most `limit` bytes) and verifies it. The block is released with
 * memory_release(ctx, &data, section->length, 1). */
enum status section_load(struct section_reader *reader, const struct section *section,
                         uint64_t limit, unsigned char **data) MUST_CHECK;
/* Checks that all bytes outside sections, header and table are zero (opening does it already). */
enum status section_check_padding(struct section_reader *reader) MUST_CHECK;

#endif
