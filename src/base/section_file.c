/*
 * The frame of our formats: header, sections, table, end marker (section_file_format.md).
 *
 * A header that holds the table must be written twice, which a pipe can't do, and says nothing
 * about whether the file is whole. So the table stands last and a marker of fixed size ends the
 * file: a file that was cut anywhere has no marker. One CRC covers header, table and marker; each
 * section has its own; what is left, the padding, must be zero. So every bit of a file is covered.
 */
#include "base/section_file.h"

#include <string.h>

#include "base/bytes.h"
#include "base/checksum.h"
#include "base/memory.h"

enum {
    HEADER_SIZE = 32,
    ENTRY_SIZE = 24,
    MARKER_SIZE = 32,
    /* in the header */
    VERSION_AT = 8,
    FLAGS_AT = 12,
    RESERVED_AT = 16,
    /* in the marker */
    TABLE_AT = 0,
    COUNT_AT = 8,
    CRC_AT = 12,
    SIZE_AT = 16,
    END_MAGIC_AT = 24
};

static const unsigned char end_magic[8] = {'s', 'p', 'b', 'm', ' ', 'e', 'n', 'd'};

/* The one CRC over header, table and marker, whose own CRC field counts as zero. */
static uint32_t frame_crc(const unsigned char header[HEADER_SIZE], const unsigned char *table,
                          unsigned count, const unsigned char marker[MARKER_SIZE])
{
    unsigned char copy[MARKER_SIZE];
    memcpy(copy, marker, MARKER_SIZE);
    store_u32(copy + CRC_AT, 0);
    uint32_t crc = checksum(0, header, HEADER_SIZE);
    crc = checksum(crc, table, (size_t)count * ENTRY_SIZE);
    return checksum(crc, copy, MARKER_SIZE);
}

static void make_header(unsigned char header[HEADER_SIZE], const unsigned char magic[8],
                        uint32_t version)
{
    memset(header, 0, HEADER_SIZE);
    memcpy(header, magic, 8);
    store_u32(header + VERSION_AT, version);
}

/* A kind as text for messages: what is no printable character becomes a dot. */
static void kind_text(char text[5], uint32_t kind)
{
    for (int i = 0; i < 4; i++) {
        unsigned char byte = (unsigned char)(kind >> 8 * i);
        text[i] = byte > ' ' && byte < 127 ? (char)byte : '.';
    }
    text[4] = '\0';
}

static uint64_t aligned(uint64_t offset)
{
    return (offset + (SECTION_ALIGN - 1)) & ~(uint64_t)(SECTION_ALIGN - 1);
}

/* ---- writing ---- */

static enum status pad(struct output *out)
{
    static const unsigned char zeros[SECTION_ALIGN];
    return output_append(out, zeros, (size_t)(aligned(out->position) - out->position));
}

static enum status append_header(struct section_writer *writer)
{
    unsigned char header[HEADER_SIZE];
    make_header(header, writer->magic, writer->version);
    return output_append(&writer->out, header, sizeof header);
}

enum status section_file_create(struct context *ctx, const char *path, const char magic[8],
                                uint32_t version, struct section_writer *writer)
{
    memset(writer, 0, sizeof *writer);
    enum status status = output_open(ctx, path, &writer->out);
    if (status != STATUS_OK)
        return status;
    memcpy(writer->magic, magic, sizeof writer->magic);
    writer->version = version;
    status = append_header(writer);
    if (status != STATUS_OK)
        output_discard(&writer->out);
    return status;
}

enum status section_file_restart(struct section_writer *writer)
{
    enum status status = output_restart(&writer->out);
    writer->count = 0;
    writer->in_section = false;
    return status == STATUS_OK ? append_header(writer) : status;
}

enum status section_begin(struct section_writer *writer, uint32_t kind)
{
    struct output *out = &writer->out;
    if (writer->in_section || writer->count == SECTION_MAX || kind == 0)
        return fail(out->ctx, STATUS_INTERNAL, "%s: a section was begun out of turn", out->path);
    for (unsigned i = 0; i < writer->count; i++)
        if (writer->table[i].kind == kind)
            return fail(out->ctx, STATUS_INTERNAL, "%s: a section was begun twice", out->path);
    enum status status = pad(out);
    if (status != STATUS_OK)
        return status;

    struct section *section = &writer->table[writer->count];
    section->kind = kind;
    section->offset = out->position;
    section->length = 0;
    section->crc = 0;
    writer->in_section = true;
    return STATUS_OK;
}

enum status section_append_summed(struct section_writer *writer, const void *data, size_t size,
                                  uint32_t crc)
{
    struct section *section = &writer->table[writer->count];
    if (!writer->in_section)
        return fail(writer->out.ctx, STATUS_INTERNAL, "%s: bytes for no section", writer->out.path);
    section->crc = checksum_join(section->crc, crc, size);
    section->length += size;
    return output_append(&writer->out, data, size);
}

enum status section_append(struct section_writer *writer, const void *data, size_t size)
{
    return section_append_summed(writer, data, size, checksum(0, data, size));
}

enum status section_end(struct section_writer *writer)
{
    if (!writer->in_section)
        return fail(writer->out.ctx, STATUS_INTERNAL, "%s: no section to end", writer->out.path);
    writer->in_section = false;
    writer->count++;
    return STATUS_OK;
}

enum status section_file_finish(struct section_writer *writer, bool sync)
{
    struct output *out = &writer->out;
    unsigned char header[HEADER_SIZE], table[SECTION_MAX * ENTRY_SIZE], marker[MARKER_SIZE];
    enum status status;
    if (writer->in_section)
        status = fail(out->ctx, STATUS_INTERNAL, "%s: a section was not ended", out->path);
    else
        status = pad(out);
    if (status != STATUS_OK)
        goto failed;

    size_t table_size = (size_t)writer->count * ENTRY_SIZE;
    for (unsigned i = 0; i < writer->count; i++) {
        const struct section *section = &writer->table[i];
        unsigned char *entry = table + (size_t)i * ENTRY_SIZE;
        store_u32(entry, section->kind);
        store_u32(entry + 4, section->crc);
        store_u64(entry + 8, section->offset);
        store_u64(entry + 16, section->length);
    }
    make_header(header, writer->magic, writer->version);
    store_u64(marker + TABLE_AT, out->position);
    store_u32(marker + COUNT_AT, writer->count);
    store_u32(marker + CRC_AT, 0);
    store_u64(marker + SIZE_AT, out->position + table_size + MARKER_SIZE);
    memcpy(marker + END_MAGIC_AT, end_magic, sizeof end_magic);
    store_u32(marker + CRC_AT, frame_crc(header, table, writer->count, marker));

    status = output_append(out, table, table_size);
    if (status == STATUS_OK)
        status = output_append(out, marker, sizeof marker);
    if (status == STATUS_OK)
        return output_commit(out, sync);
failed:
    output_discard(out);
    return status;
}

void section_file_discard(struct section_writer *writer)
{
    output_discard(&writer->out);
}

/* ---- reading ---- */

/* Everything that is read before the sections are known. */
struct frame {
    unsigned char header[HEADER_SIZE];
    unsigned char table[SECTION_MAX * ENTRY_SIZE];
    unsigned char marker[MARKER_SIZE];
    uint64_t table_offset;
    uint64_t count;
};

static enum status read_header(struct input_file *file, const char magic[8], uint32_t version,
                               const char *what, struct frame *frame)
{
    if (file->size < HEADER_SIZE)
        return fail(file->ctx, STATUS_BAD_INPUT, "%s: is not %s: it has only %llu bytes",
                    file->path, what, (unsigned long long)file->size);
    enum status status = input_read(file, 0, frame->header, HEADER_SIZE);
    if (status != STATUS_OK)
        return status;
    if (memcmp(frame->header, magic, 8) != 0)
        return fail(file->ctx, STATUS_BAD_INPUT, "%s: is not %s", file->path, what);
    if (load_u32(frame->header + VERSION_AT) != version)
        return fail(file->ctx, STATUS_BAD_INPUT,
                    "%s: is %s of version %u, but only version %u can be read", file->path, what,
                    load_u32(frame->header + VERSION_AT), version);
    for (int i = FLAGS_AT; i < HEADER_SIZE; i++)
        if (frame->header[i] != 0)
            return fail(file->ctx, STATUS_BAD_INPUT,
                        "%s: byte %d of the header should be 0 and is %d", file->path, i,
                        frame->header[i]);
    return STATUS_OK;
}

static enum status read_marker(struct input_file *file, struct frame *frame)
{
    struct context *ctx = file->ctx;
    uint64_t size = file->size;
    if (size < SECTION_ALIGN + MARKER_SIZE)
        return fail(ctx, STATUS_BAD_INPUT, "%s: is cut off: it has only %llu bytes", file->path,
                    (unsigned long long)size);
    enum status status = input_read(file, size - MARKER_SIZE, frame->marker, MARKER_SIZE);
    if (status != STATUS_OK)
        return status;
    if (memcmp(frame->marker + END_MAGIC_AT, end_magic, sizeof end_magic) != 0)
        return fail(ctx, STATUS_BAD_INPUT,
                    "%s: is cut off or was never finished: it does not end with the end marker",
                    file->path);
    if (load_u64(frame->marker + SIZE_AT) != size)
        return fail(ctx, STATUS_BAD_INPUT, "%s: has %llu bytes, but its end marker says %llu",
                    file->path, (unsigned long long)size,
                    (unsigned long long)load_u64(frame->marker + SIZE_AT));
    frame->table_offset = load_u64(frame->marker + TABLE_AT);
    frame->count = load_u32(frame->marker + COUNT_AT);
    uint64_t behind = frame->count * ENTRY_SIZE + MARKER_SIZE;
    if (frame->count > SECTION_MAX || behind > size || frame->table_offset != size - behind ||
        frame->table_offset < SECTION_ALIGN)
        return fail(ctx, STATUS_BAD_INPUT,
                    "%s: the end marker is damaged: a table of %llu sections at byte %llu",
                    file->path, (unsigned long long)frame->count,
                    (unsigned long long)frame->table_offset);
    status = input_read(file, frame->table_offset, frame->table, (size_t)frame->count * ENTRY_SIZE);
    if (status != STATUS_OK)
        return status;
    if (!checksum_agrees(
            frame_crc(frame->header, frame->table, (unsigned)frame->count, frame->marker),
            load_u32(frame->marker + CRC_AT)))
        return fail(ctx, STATUS_BAD_INPUT, "%s: the header or the section table is damaged",
                    file->path);
    return STATUS_OK;
}

/*
 * Sections follow each other in the order of the table with less than SECTION_ALIGN bytes between
 * them: so none overlaps, none lies outside, and no bytes hide between them. `expected` is the only
 * place where a section may begin.
 */
static enum status read_table(struct section_reader *reader, const struct frame *frame)
{
    struct input_file *file = &reader->file;
    uint64_t expected = SECTION_ALIGN;
    for (unsigned i = 0; i < (unsigned)frame->count; i++) {
        const unsigned char *entry = frame->table + (size_t)i * ENTRY_SIZE;
        struct section *section = &reader->table[i];
        section->kind = load_u32(entry);
        section->crc = load_u32(entry + 4);
        section->offset = load_u64(entry + 8);
        section->length = load_u64(entry + 16);
        char name[5];
        kind_text(name, section->kind);

        if (section->kind == 0 || section_find(reader, section->kind))
            return fail(file->ctx, STATUS_BAD_INPUT,
                        "%s: section %u has the kind '%s', which is %s", file->path, i, name,
                        section->kind == 0 ? "none" : "there already");
        if (section->offset != expected)
            return fail(file->ctx, STATUS_BAD_INPUT,
                        "%s: section '%s' begins at byte %llu, not at %llu", file->path, name,
                        (unsigned long long)section->offset, (unsigned long long)expected);
        if (section->offset > frame->table_offset ||
            section->length > frame->table_offset - section->offset)
            return fail(file->ctx, STATUS_BAD_INPUT,
                        "%s: section '%s' of %llu bytes at %llu reaches beyond the sections' end "
                        "at %llu",
                        file->path, name, (unsigned long long)section->length,
                        (unsigned long long)section->offset,
                        (unsigned long long)frame->table_offset);
        expected = aligned(section->offset + section->length);
        reader->count = i + 1;
    }
    if (frame->table_offset != expected)
        return fail(file->ctx, STATUS_BAD_INPUT,
                    "%s: the section table is at byte %llu, not at %llu", file->path,
                    (unsigned long long)frame->table_offset, (unsigned long long)expected);
    return STATUS_OK;
}

enum status section_file_open(struct context *ctx, const char *path, const char magic[8],
                              uint32_t version, const char *what, struct section_reader *reader)
{
    memset(reader, 0, sizeof *reader);
    enum status status = input_open(ctx, path, &reader->file);
    if (status != STATUS_OK)
        return status;
    struct frame frame;
    status = read_header(&reader->file, magic, version, what, &frame);
    if (status == STATUS_OK)
        status = read_marker(&reader->file, &frame);
    if (status == STATUS_OK)
        status = read_table(reader, &frame);
    if (status == STATUS_OK)
        status = section_check_padding(reader);
    if (status != STATUS_OK) {
        section_file_close(reader);
        return status;
    }
    reader->version = version;
    return STATUS_OK;
}

void section_file_close(struct section_reader *reader)
{
    input_close(&reader->file);
    reader->count = 0;
}

const struct section *section_find(const struct section_reader *reader, uint32_t kind)
{
    for (unsigned i = 0; i < reader->count; i++)
        if (reader->table[i].kind == kind)
            return &reader->table[i];
    return NULL;
}

static enum status damaged(struct section_reader *reader, const struct section *section)
{
    char name[5];
    kind_text(name, section->kind);
    return fail(reader->file.ctx, STATUS_BAD_INPUT,
                "%s: section '%s' (%llu bytes at %llu) is damaged: its checksum is wrong",
                reader->file.path, name, (unsigned long long)section->length,
                (unsigned long long)section->offset);
}

enum status section_verify(struct section_reader *reader, const struct section *section)
{
    enum { PIECE = 1 << 20 };
    struct context *ctx = reader->file.ctx;
    size_t capacity = section->length < PIECE ? (size_t)section->length : PIECE;
    unsigned char *piece;
    enum status status = memory_take(ctx, capacity, 1, &piece);
    if (status != STATUS_OK)
        return status;

    uint32_t crc = 0;
    for (uint64_t done = 0; done < section->length && status == STATUS_OK; done += capacity) {
        uint64_t left = section->length - done;
        size_t size = left < capacity ? (size_t)left : capacity;
        if (ctx->cancelled && ctx->cancelled(ctx->user))
            status = fail(ctx, STATUS_CANCELLED, "cancelled");
        else
            status = input_read(&reader->file, section->offset + done, piece, size);
        if (status == STATUS_OK)
            crc = checksum(crc, piece, size);
    }
    if (status == STATUS_OK && !checksum_agrees(crc, section->crc))
        status = damaged(reader, section);
    memory_release(ctx, &piece, capacity, 1);
    return status;
}

enum status section_load(struct section_reader *reader, const struct section *section,
                         uint64_t limit, unsigned char **data)
{
    struct context *ctx = reader->file.ctx;
    *data = NULL;
    if (section->length > limit || section->length > SIZE_MAX) {
        char name[5];
        kind_text(name, section->kind);
        return fail(ctx, STATUS_BAD_INPUT, "%s: section '%s' has %llu bytes, more than %llu",
                    reader->file.path, name, (unsigned long long)section->length,
                    (unsigned long long)limit);
    }
    size_t size = (size_t)section->length;
    unsigned char *loaded;
    enum status status = memory_take(ctx, size, 1, &loaded);
    if (status != STATUS_OK)
        return status;
    status = input_read(&reader->file, section->offset, loaded, size);
    if (status == STATUS_OK && !checksum_agrees(checksum(0, loaded, size), section->crc))
        status = damaged(reader, section);
    if (status != STATUS_OK) {
        memory_release(ctx, &loaded, size, 1);
        return status;
    }
    *data = loaded;
    return STATUS_OK;
}

/* The bytes [from, aligned(from)) are zero. */
static enum status check_gap(struct section_reader *reader, uint64_t from)
{
    unsigned char gap[SECTION_ALIGN];
    size_t size = (size_t)(aligned(from) - from);
    enum status status = input_read(&reader->file, from, gap, size);
    if (status != STATUS_OK)
        return status;
    for (size_t i = 0; i < size; i++)
        if (gap[i] != 0)
            return fail(reader->file.ctx, STATUS_BAD_INPUT,
                        "%s: byte %llu is padding and should be 0", reader->file.path,
                        (unsigned long long)(from + i));
    return STATUS_OK;
}

enum status section_check_padding(struct section_reader *reader)
{
    enum status status = check_gap(reader, HEADER_SIZE);
    for (unsigned i = 0; i < reader->count && status == STATUS_OK; i++)
        status = check_gap(reader, reader->table[i].offset + reader->table[i].length);
    return status;
}
