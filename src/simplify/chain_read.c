/*
 * Reading a chain file: a check list. The frame is checked by section_file_open, the index must
 * cover the sections without a gap, and each block carries its own checksums, which are verified
 * whenever it is read; then its contents are checked as if someone had forged them.
 */
#include <stdio.h>
#include <string.h>

#include "base/block_stream.h"
#include "base/bytes.h"
#include "base/memory.h"
#include "simplify/chain_code.h"
#include "simplify/chain_frame.h"
#include "simplify/chain_loops.h"

/* Places of one slab's parts in the file. */
struct chain_place {
    uint64_t block, seams; /* offsets */
    struct chain_sizes sizes;
};

struct chain_file {
    struct context *ctx;
    struct section_reader reader;
    struct chain_info info;
    struct chain_place *places;
    bool is_own; /* chain_file_trust */
    const struct chain_hold *hold;
};

/* ---- opening ---- */

static enum status find_section(struct chain_file *file, uint32_t kind,
                                const struct section **section)
{
    *section = section_find(&file->reader, kind);
    if (*section)
        return STATUS_OK;
    return fail(file->ctx, STATUS_BAD_INPUT, "%s: the section %c%c%c%c is missing",
                file->reader.file.path, (int)(kind & 255), (int)(kind >> 8 & 255),
                (int)(kind >> 16 & 255), (int)(kind >> 24));
}

static enum status read_info(struct chain_file *file)
{
    const struct section *section;
    unsigned char *bytes;
    enum status status = find_section(file, CHAIN_SECTION_INFO, &section);
    if (!status)
        status = section_load(&file->reader, section, CHAIN_INFO_MAX, &bytes);
    if (status)
        return status;
    const char *wrong = chain_info_decode(bytes, section->length, &file->info);
    if (wrong)
        status = fail(file->ctx, STATUS_BAD_INPUT, "%s: section INFO: %s", file->reader.file.path,
                      wrong);
    memory_release(file->ctx, &bytes, section->length, 1);
    return status;
}

static enum status read_index(struct chain_file *file)
{
    const char *path = file->reader.file.path;
    uint32_t count = file->info.slab_count;
    const struct section *blocks, *seams, *index;
    unsigned char *bytes;
    enum status status = find_section(file, CHAIN_SECTION_BLOCKS, &blocks);
    if (!status)
        status = find_section(file, CHAIN_SECTION_SEAMS, &seams);
    if (!status)
        status = find_section(file, CHAIN_SECTION_INDEX, &index);
    if (status)
        return status;
    if (index->length != (uint64_t)count * CHAIN_INDEX_ENTRY)
        return fail(file->ctx, STATUS_BAD_INPUT, "%s: section INDX has %llu bytes for %u slabs",
                    path, (unsigned long long)index->length, count);
    status = section_load(&file->reader, index, UINT64_MAX, &bytes);
    if (status)
        return status;
    status = memory_take(file->ctx, count, sizeof *file->places, &file->places);
    uint64_t block = blocks->offset, seam = seams->offset;
    for (uint32_t i = 0; i < count && !status; i++) {
        struct chain_place *place = file->places + i;
        place->sizes.block = load_u32(bytes + (size_t)i * CHAIN_INDEX_ENTRY);
        place->sizes.seams = load_u32(bytes + (size_t)i * CHAIN_INDEX_ENTRY + 4);
        place->block = block;
        place->seams = seam;
        block += place->sizes.block; /* no overflow: at most 2^32 entries of 32 bits */
        seam += place->sizes.seams;
    }
    if (!status &&
        (block != blocks->offset + blocks->length || seam != seams->offset + seams->length))
        status = fail(file->ctx, STATUS_BAD_INPUT,
                      "%s: section INDX does not cover blocks and seams", path);
    memory_release(file->ctx, &bytes, index->length, 1);
    return status;
}

enum status chain_file_open(struct context *ctx, const char *path, struct chain_file **out)
{
    struct chain_file *file;
    *out = NULL;
    enum status status = memory_take_zeroed(ctx, 1, sizeof *file, &file);
    if (status)
        return status;
    file->ctx = ctx;
    status =
        section_file_open(ctx, path, CHAIN_MAGIC, CHAIN_VERSION, "a chain file", &file->reader);
    if (status) {
        memory_release(ctx, &file, 1, sizeof *file);
        return status;
    }
    const unsigned wanted = 4 + (section_find(&file->reader, CHAIN_SECTION_TRUNK) != NULL) +
                            (section_find(&file->reader, CHAIN_SECTION_LOWER) != NULL);
    if (file->reader.count != wanted)
        status = fail(ctx, STATUS_BAD_INPUT, "%s: %u sections instead of %u", path,
                      file->reader.count, wanted);
    if (!status)
        status = read_info(file);
    if (!status)
        status = read_index(file);
    if (status)
        chain_file_close(&file);
    *out = file;
    return status;
}

void chain_file_close(struct chain_file **file)
{
    if (!*file)
        return;
    struct context *ctx = (*file)->ctx;
    memory_release(ctx, &(*file)->places, (*file)->info.slab_count, sizeof *(*file)->places);
    section_file_close(&(*file)->reader);
    memory_release(ctx, file, 1, sizeof **file);
}

void chain_file_trust(struct chain_file *file, const struct chain_hold *hold)
{
    file->is_own = true;
    file->hold = hold;
}

const struct chain_info *chain_file_info(const struct chain_file *file)
{
    return &file->info;
}

const char *chain_file_name(const struct chain_file *file)
{
    return file->reader.file.path;
}

/* ---- blocks ---- */

/* One packed part of the file; *raw is released with memory_release(ctx, &raw, size, 1). */
static enum status read_part(struct chain_file *file, const char *what, uint64_t offset,
                             uint32_t stored, unsigned char **raw, size_t *size)
{
    struct window window = {0};
    size_t taken;
    *raw = NULL;
    *size = 0;
    enum status status = window_open(&file->reader.file, offset, stored, &window);
    if (!status)
        status = block_unpack(file->ctx, what, window.data, stored, raw, size, &taken);
    window_close(&window);
    if (!status && taken != stored) {
        memory_release(file->ctx, raw, *size, 1);
        status = fail(file->ctx, STATUS_BAD_INPUT, "%s: it has %zu bytes where the index says %u",
                      what, taken, stored);
    }
    return status;
}

bool chain_file_has(struct chain_file *file, uint32_t kind)
{
    return section_find(&file->reader, kind) != NULL;
}

enum status chain_file_trunk_bytes(struct chain_file *file, uint32_t kind, const char *what,
                                   struct context **ctx, unsigned char **raw, size_t *size)
{
    const struct section *section = section_find(&file->reader, kind);
    *ctx = file->ctx;
    *raw = NULL;
    *size = 0;
    if (!section)
        return STATUS_OK;
    if (section->length > BLOCK_MAX + BLOCK_HEADER_SIZE)
        return fail(file->ctx, STATUS_BAD_INPUT, "%s: it is too long", what);
    return read_part(file, what, section->offset, (uint32_t)section->length, raw, size);
}

enum status chain_block_read_counting(struct chain_file *file, uint32_t slab,
                                      struct chain_block *block, uint64_t *most_faces)
{
    struct context *ctx = file->ctx;
    uint32_t stride = file->info.attributes.stride;
    memset(block, 0, sizeof *block);
    if (slab >= file->info.slab_count)
        return fail(ctx, STATUS_INTERNAL, "block %u of %u asked for", slab, file->info.slab_count);
    const struct chain_place *place = file->places + slab;
    char what[512];
    snprintf(what, sizeof what, "%.470s: block %u", file->reader.file.path, slab);

    unsigned char *raw;
    size_t size;
    enum status status = STATUS_OK;
    if (!file->hold || !chain_hold_give(file->hold, slab, block)) {
        status = read_part(file, what, place->block, place->sizes.block, &raw, &size);
        if (status)
            return status;
        status = chain_block_decode(ctx, what, raw, size, slab, stride, block);
        memory_release(ctx, &raw, size, 1);
        if (status)
            return status;
    }

    snprintf(what, sizeof what, "%.470s: seams of block %u", file->reader.file.path, slab);
    status = read_part(file, what, place->seams, place->sizes.seams, &raw, &size);
    if (!status) {
        status = seam_chains_decode(ctx, what, raw, size, file->info.slab_count, block);
        memory_release(ctx, &raw, size, 1);
    }
    *most_faces = 0;
    if (!status && !file->is_own) {
        snprintf(what, sizeof what, "%.470s: block %u", file->reader.file.path, slab);
        status = chain_loops_check(ctx, what, block, most_faces);
    }
    if (status)
        chain_block_release(file, block);
    return status;
}

void chain_block_release(struct chain_file *file, struct chain_block *block)
{
    struct chain_block held;
    if (file->hold && chain_hold_give(file->hold, block->slab, &held)) {
        block->positions = NULL;
        block->records = NULL;
        block->seam_vertices = NULL;
        block->chains = NULL;
        block->patches = NULL;
        block->diagonals = NULL;
    }
    chain_block_clear(file->ctx, file->info.attributes.stride, block);
}

enum status chain_block_read(struct chain_file *file, uint32_t slab, struct chain_block *block)
{
    uint64_t most_faces;
    return chain_block_read_counting(file, slab, block, &most_faces);
}

/* (Held blocks take twice the room.) */
uint64_t chain_block_work(const struct chain_file *file, uint32_t slab)
{
    const struct chain_place *place = file->places + slab;
    return place->sizes.seams +
           (place->sizes.block > 0 ? place->sizes.block : chain_hold_size(file->hold, slab) / 2);
}
