/*
 * Written as they lie in memory, a chain takes 24 bytes and a vertex 12, and deflate finds nothing
 * in them. Here numbers become differences to what is expected, and what is alike stands together:
 *   - junctions are numbered in the order in which the chains meet them, so that a chain's end is
 *     mostly "a new one" or one met a moment ago;
 *   - coordinates are taken as integers in the order of the floats and predicted from the vertex
 *     before on the chain; what is left goes, zigzag coded, into four planes of bytes: the upper
 *     ones are nearly all zero, the lower ones are noise that costs what it must.
 */
#include "simplify/chain_code.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "simplify/small_numbers.h"
#include "simplify/unit_code.h"

enum { NO_BASE = -1 };

/* ---- positions and attributes: vertices in the order of the chains ---- */

/* Vertices whose codes are cut into bytes, or put together, at a time: in vectors, where a vertex
 * by itself would take twelve bytes from as many places. */
enum { BATCH = 256 };

/* The vertex values of a block and their planes, written or read. */
struct planes {
    float *positions;
    unsigned char *records; /* NULL without attributes */
    uint32_t stride;
    uint32_t count;       /* vertices */
    uint32_t place;       /* of the next vertex in each plane */
    unsigned char *bytes; /* (12 + stride) planes of `count` bytes */
    bool decodes;
    uint32_t codes[3][BATCH]; /* of the coordinates, places from a multiple of BATCH on */
};

/* The planes' bytes of the batch that begins at `first`. */
static void cut_batch(const struct planes *planes, uint32_t first, uint32_t length)
{
    for (unsigned plane = 0; plane < 12; plane++) {
        const uint32_t *codes = planes->codes[plane / 4];
        unsigned char *bytes = planes->bytes + plane * (size_t)planes->count + first;
        const unsigned shift = 8 * (plane % 4);
        for (uint32_t i = 0; i < length; i++)
            bytes[i] = (unsigned char)(codes[i] >> shift);
    }
}

static void join_batch(struct planes *planes, uint32_t first, uint32_t length)
{
    for (unsigned axis = 0; axis < 3; axis++) {
        const size_t count = planes->count;
        const unsigned char *bytes = planes->bytes + 4 * axis * count + first;
        uint32_t *codes = planes->codes[axis];
        for (uint32_t i = 0; i < length; i++)
            codes[i] = bytes[i] | (uint32_t)bytes[count + i] << 8 |
                       (uint32_t)bytes[2 * count + i] << 16 | (uint32_t)bytes[3 * count + i] << 24;
    }
}

/* What a coordinate is expected to be: that of the vertex `base`. (Extrapolating along the chain is
 * worse on scans: boundaries zigzag.) */
static inline uint32_t predict(const struct planes *planes, int64_t base, unsigned axis)
{
    return base == NO_BASE ? 0x80000000 /* 0.0 */
                           : float_to_ordered(planes->positions[3 * base + axis]);
}

static inline void code_record(struct planes *planes, uint32_t place, uint32_t vertex, int64_t base)
{
    const size_t count = planes->count;
    unsigned char *plane = planes->bytes + 12 * count + place;
    unsigned char *record = planes->records + (size_t)vertex * planes->stride;
    const unsigned char *like =
        base == NO_BASE ? NULL : planes->records + (size_t)base * planes->stride;
    for (uint32_t i = 0; i < planes->stride; i++) {
        unsigned expected = like ? like[i] : 0;
        if (planes->decodes)
            record[i] = (unsigned char)(plane[i * count] + expected);
        else
            plane[i * count] = (unsigned char)(record[i] - expected);
    }
}

static inline void code_vertex(struct planes *planes, uint32_t vertex, int64_t base)
{
    const uint32_t place = planes->place++, at = place % BATCH, first = place - at;
    const uint32_t left = planes->count - first, length = left < BATCH ? left : BATCH;
    float *position = planes->positions + 3 * (size_t)vertex;
    if (planes->decodes && at == 0)
        join_batch(planes, first, length);
    for (unsigned axis = 0; axis < 3; axis++) {
        uint32_t expected = predict(planes, base, axis), *code = &planes->codes[axis][at];
        if (planes->decodes)
            position[axis] = ordered_to_float(expected + unzigzag(*code));
        else
            *code = zigzag(float_to_ordered(position[axis]) - expected);
    }
    if (!planes->decodes && at + 1 == length)
        cut_batch(planes, first, length);
    if (planes->stride)
        code_record(planes, place, vertex, base);
}

/*
 * Goes through all vertices of a block whose chains and patches are known: seam vertices, then
 * along each chain its start if no chain before met it, its interior, its end if no chain before
 * met it, then the patches' interiors.
 */
static void code_vertices(struct planes *planes, const struct chain_block *block)
{
    uint32_t junctions = block->junction_count, met = 0;
    int64_t last = NO_BASE; /* the vertex coded last, or where the last chain ended */
    for (uint32_t i = 0; i < block->seam_vertex_count; i++) {
        code_vertex(planes, junctions + i, last);
        last = junctions + i;
    }
    for (uint32_t i = 0; i < block->chain_count; i++) {
        const struct chain *chain = block->chains + i;
        if (chain->start == met && met < junctions)
            code_vertex(planes, met++, last);
        last = chain->start;
        for (uint32_t j = 0; j < chain->interior_count; j++) {
            code_vertex(planes, chain->interior_first + j, last);
            last = chain->interior_first + j;
        }
        if (chain->end == met && met < junctions)
            code_vertex(planes, met++, last);
        last = chain->end;
    }
    uint32_t next = 0; /* the first chain that has the patch, or a later one, on its left */
    for (uint32_t p = 0; p < block->patch_count; p++) {
        const struct patch *patch = block->patches + p;
        while (next + 1 < block->chain_count && block->chains[next].left < p)
            next++;
        int64_t base = next < block->chain_count ? block->chains[next].start : last;
        for (uint32_t i = 0; i < patch->interior_count; i++) {
            code_vertex(planes, patch->interior_first + i, base);
            base = patch->interior_first + i;
        }
    }
}

/* ---- chains ---- */

/*
 * A chain's end: 0 is the junction that follows those met so far; else its lowest bit tells a
 * junction, counted back from the last one met, from a seam vertex, as a difference to the seam
 * vertex named last.
 */
struct ends {
    uint32_t junctions; /* of the block */
    uint32_t met;
    uint32_t seam; /* place among the seam vertices */
};

static inline void put_end(struct sink *sink, struct ends *ends, uint32_t vertex)
{
    if (vertex >= ends->junctions) {
        uint32_t seam = vertex - ends->junctions;
        put(sink, 2 + (zigzag(seam - ends->seam) << 1));
        ends->seam = seam;
    } else if (vertex == ends->met) {
        ends->met++;
        put(sink, 0);
    } else {
        put(sink, 1 + ((ends->met - 1 - vertex) << 1));
    }
}

/* Sets source->is_bad when the vertex is out of range. */
static inline uint32_t get_end(struct source *source, struct ends *ends, uint32_t seam_count)
{
    uint32_t code = get(source);
    if (code == 0) {
        source->is_bad |= ends->met == ends->junctions;
        return ends->met++;
    }
    if (code & 1) {
        source->is_bad |= code >> 1 >= ends->met;
        return ends->met - 1 - (code >> 1);
    }
    ends->seam += unzigzag((code - 2) >> 1);
    source->is_bad |= ends->seam >= seam_count;
    return ends->junctions + ends->seam;
}

static enum status put_chains(struct context *ctx, struct sink *sink,
                              const struct chain_block *block)
{
    struct ends ends = {.junctions = block->junction_count};
    uint32_t left = 0, interior = block->junction_count + block->seam_vertex_count;
    for (uint32_t i = 0; i < block->chain_count; i++) {
        const struct chain *chain = block->chains + i;
        bool fits = chain->left >= left &&
                    (chain->right < chain->left || chain->right == NO_PATCH) &&
                    chain->interior_first == interior;
        if (!fits)
            return fail(ctx, STATUS_INTERNAL, "chain %u of block %u is out of order", i,
                        block->slab);
        put(sink, chain->left - left);
        left = chain->left;
        interior += chain->interior_count;
    }
    for (uint32_t i = 0; i < block->chain_count; i++) {
        const struct chain *chain = block->chains + i;
        put(sink, chain->right == NO_PATCH ? 0 : chain->left - chain->right);
    }
    for (uint32_t i = 0; i < block->chain_count; i++)
        put(sink, block->chains[i].interior_count);
    for (uint32_t i = 0; i < block->chain_count; i++) {
        const struct chain *chain = block->chains + i;
        for (unsigned end = 0; end < 2; end++) {
            uint32_t vertex = end ? chain->end : chain->start;
            if (vertex < block->junction_count && vertex > ends.met)
                return fail(ctx, STATUS_INTERNAL, "junction %u of block %u is out of order", vertex,
                            block->slab);
            put_end(sink, &ends, vertex);
        }
    }
    if (ends.met != block->junction_count)
        return fail(ctx, STATUS_INTERNAL, "block %u has a junction without a chain", block->slab);
    return STATUS_OK;
}

/* NULL, or what is wrong. */
static const char *get_chains(struct source *source, struct chain_block *block,
                              uint32_t interior_total)
{
    uint32_t left = 0;
    for (uint32_t i = 0; i < block->chain_count; i++) {
        uint32_t difference = get(source);
        if (source->is_bad || difference > block->patch_count ||
            left + difference >= block->patch_count)
            return "a chain's left patch is out of range";
        left += difference;
        block->chains[i].left = left;
    }
    for (uint32_t i = 0; i < block->chain_count; i++) {
        struct chain *chain = block->chains + i;
        uint32_t difference = get(source);
        if (source->is_bad || difference > chain->left)
            return "a chain's right patch is out of range";
        chain->right = difference ? chain->left - difference : NO_PATCH;
    }
    uint32_t first = block->junction_count + block->seam_vertex_count, sum = 0;
    for (uint32_t i = 0; i < block->chain_count; i++) {
        struct chain *chain = block->chains + i;
        chain->interior_count = get(source);
        chain->interior_first = first + sum;
        if (source->is_bad || chain->interior_count > interior_total - sum)
            return "the chains have more vertices than the block says";
        sum += chain->interior_count;
    }
    if (sum != interior_total)
        return "the chains have fewer vertices than the block says";
    struct ends ends = {.junctions = block->junction_count};
    for (uint32_t i = 0; i < block->chain_count; i++) {
        struct chain *chain = block->chains + i;
        chain->start = get_end(source, &ends, block->seam_vertex_count);
        chain->end = get_end(source, &ends, block->seam_vertex_count);
        if (source->is_bad || chain->start == chain->end)
            return "the ends of a chain are out of range or equal";
    }
    return ends.met == block->junction_count ? NULL : "a junction has no chain";
}

/* ---- patches ---- */

static void put_plane_u32(struct sink *sink, uint32_t count, uint32_t place, uint32_t value)
{
    for (unsigned b = 0; b < 4; b++)
        sink->at[b * (size_t)count + place] = (unsigned char)(value >> 8 * b);
}

static uint32_t get_plane_u32(const unsigned char *planes, uint32_t count, uint32_t place)
{
    uint32_t value = 0;
    for (unsigned b = 0; b < 4; b++)
        value |= (uint32_t)planes[b * (size_t)count + place] << 8 * b;
    return value;
}

static uint32_t float_bits(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

static float bits_float(uint32_t bits)
{
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* Interior counts; diagonal counts where there is no interior vertex; then the planes of normals,
 * areas and deviations. */
static enum status put_patches(struct context *ctx, struct sink *sink,
                               const struct chain_block *block, uint32_t interior_total)
{
    uint32_t interior = block->vertex_count - interior_total, diagonal = 0;
    uint32_t count = block->patch_count;
    for (uint32_t p = 0; p < count; p++) {
        const struct patch *patch = block->patches + p;
        if (patch->interior_first != interior || patch->diagonal_first != diagonal ||
            (patch->interior_count && patch->diagonal_count))
            return fail(ctx, STATUS_INTERNAL, "patch %u of block %u is out of order", p,
                        block->slab);
        put(sink, patch->interior_count);
        interior += patch->interior_count;
        diagonal += patch->diagonal_count;
    }
    for (uint32_t p = 0; p < count; p++)
        if (block->patches[p].interior_count == 0)
            put(sink, block->patches[p].diagonal_count);
    for (uint32_t p = 0; p < count; p++) {
        const float *normal = block->patches[p].normal;
        double vector[3] = {normal[0], normal[1], normal[2]};
        put_plane_u32(sink, count, p, unit_encode(vector));
    }
    sink->at += 4 * (size_t)count;
    for (uint32_t p = 0; p < count; p++)
        put_plane_u32(sink, count, p, float_bits(block->patches[p].area));
    sink->at += 4 * (size_t)count;
    for (uint32_t p = 0; p < count; p++)
        put_plane_u32(sink, count, p, float_bits(block->patches[p].deviation));
    sink->at += 4 * (size_t)count;
    return STATUS_OK;
}

static const char *get_patch_values(struct source *source, struct chain_block *block)
{
    uint32_t count = block->patch_count;
    if (left_in(source) / 12 < count)
        return "the patches are cut off";
    const unsigned char *normals = source->at, *areas = normals + 4 * (size_t)count,
                        *deviations = areas + 4 * (size_t)count;
    for (uint32_t p = 0; p < count; p++) {
        struct patch *patch = block->patches + p;
        patch->area = bits_float(get_plane_u32(areas, count, p));
        patch->deviation = bits_float(get_plane_u32(deviations, count, p));
        if (!unit_decode(get_plane_u32(normals, count, p), patch->normal))
            return "a patch's normal is no code of a unit vector";
        if (!(patch->area >= 0 && patch->deviation >= 0) || isinf(patch->area) ||
            isinf(patch->deviation))
            return "a patch's area or deviation is negative or not finite";
    }
    source->at += 12 * (size_t)count;
    return NULL;
}

static const char *get_patches(struct source *source, struct chain_block *block,
                               uint32_t interior_total)
{
    uint32_t interior = 0, diagonal = 0;
    for (uint32_t p = 0; p < block->patch_count; p++) {
        struct patch *patch = block->patches + p;
        patch->interior_count = get(source);
        patch->interior_first = block->vertex_count - interior_total + interior;
        if (source->is_bad || patch->interior_count > interior_total - interior)
            return "the patches have more interior vertices than the block says";
        interior += patch->interior_count;
    }
    if (interior != interior_total)
        return "the patches have fewer interior vertices than the block says";
    for (uint32_t p = 0; p < block->patch_count; p++) {
        struct patch *patch = block->patches + p;
        patch->diagonal_first = diagonal;
        patch->diagonal_count = patch->interior_count ? 0 : get(source);
        if (source->is_bad || patch->diagonal_count > block->diagonal_count - diagonal)
            return "the patches have more diagonals than the block says";
        diagonal += patch->diagonal_count;
    }
    if (diagonal != block->diagonal_count)
        return "the patches have fewer diagonals than the block says";
    return get_patch_values(source, block);
}

static void put_diagonals(struct sink *sink, const struct chain_block *block)
{
    uint32_t last = 0;
    for (size_t i = 0; i < 2 * (size_t)block->diagonal_count; i++) {
        put(sink, zigzag(block->diagonals[i] - last));
        last = block->diagonals[i];
    }
}

static const char *get_diagonals(struct source *source, struct chain_block *block)
{
    uint32_t last = 0;
    for (size_t i = 0; i < 2 * (size_t)block->diagonal_count; i++) {
        last += unzigzag(get(source));
        if (source->is_bad || last >= block->vertex_count)
            return "a diagonal's vertex is out of range";
        block->diagonals[i] = last;
    }
    return NULL;
}

/* ---- a block ---- */

static void put_seam_vertices(struct sink *sink, const struct chain_block *block)
{
    uint32_t next = 0; /* the least that the number can be */
    for (uint32_t i = 0; i < block->seam_vertex_count; i++) {
        put(sink, block->seam_vertices[i] - next);
        next = block->seam_vertices[i] + 1;
    }
}

static const char *get_seam_vertices(struct source *source, struct chain_block *block)
{
    uint64_t next = 0;
    for (uint32_t i = 0; i < block->seam_vertex_count; i++) {
        next += get(source);
        if (source->is_bad || next >= NO_INDEX)
            return "a seam vertex is out of range";
        block->seam_vertices[i] = (uint32_t)next++;
    }
    return NULL;
}

/* Bytes of a number that counts something below `limit`, zigzag coded, shifted and raised by 2. */
static size_t number_bytes(uint64_t limit)
{
    return limit <= 1u << 18 ? 3 : SMALL_NUMBER_MAX;
}

/* The most bytes that the block can take. */
static size_t most_bytes(const struct chain_block *block, uint32_t stride)
{
    uint64_t limit = block->vertex_count;
    limit = limit < block->patch_count ? block->patch_count : limit;
    return SMALL_NUMBER_MAX * (8 + (size_t)block->seam_vertex_count) +
           number_bytes(limit) * (5 * (size_t)block->chain_count + 2 * (size_t)block->patch_count +
                                  2 * (size_t)block->diagonal_count) +
           12 * (size_t)block->patch_count + (12 + (size_t)stride) * block->vertex_count;
}

static enum status put_block(struct context *ctx, const struct chain_block *block, uint32_t stride,
                             struct sink *sink)
{
    uint32_t chain_interiors = 0, patch_interiors = 0;
    for (uint32_t i = 0; i < block->chain_count; i++)
        chain_interiors += block->chains[i].interior_count;
    for (uint32_t p = 0; p < block->patch_count; p++)
        patch_interiors += block->patches[p].interior_count;
    put(sink, block->junction_count);
    put(sink, block->seam_vertex_count);
    put(sink, chain_interiors);
    put(sink, patch_interiors);
    put(sink, block->chain_count);
    put(sink, block->patch_count);
    put(sink, block->diagonal_count);
    put_seam_vertices(sink, block);
    enum status status = put_chains(ctx, sink, block);
    if (!status)
        status = put_patches(ctx, sink, block, patch_interiors);
    if (status)
        return status;
    put_diagonals(sink, block);
    struct planes planes = {.positions = block->positions,
                            .records = block->records,
                            .stride = stride,
                            .count = block->vertex_count,
                            .bytes = sink->at};
    code_vertices(&planes, block);
    sink->at += (12 + (size_t)stride) * block->vertex_count;
    return STATUS_OK;
}

enum status chain_block_encode(struct context *ctx, const struct chain_block *block,
                               uint32_t stride, void *room, size_t room_size, unsigned char **raw,
                               size_t *capacity, size_t *size)
{
    const size_t most = most_bytes(block, stride);
    enum status status = STATUS_OK;
    *capacity = 0;
    *raw = room;
    if (!room || most > room_size) {
        status = memory_take(ctx, most, 1, raw);
        if (status)
            return status;
        *capacity = most;
    }
    struct sink sink = {.at = *raw};
    status = put_block(ctx, block, stride, &sink);
    *size = (size_t)(sink.at - *raw);
    if (status && *capacity)
        memory_release(ctx, raw, *capacity, 1);
    return status;
}

/* Reads the counts and checks them against what is there: each vertex, chain, patch and diagonal
 * takes at least so many bytes. Both totals are part of vertex_count afterwards. */
static const char *get_counts(struct source *source, uint32_t stride, struct chain_block *block,
                              uint32_t *chain_interiors, uint32_t *patch_interiors)
{
    block->junction_count = get(source);
    block->seam_vertex_count = get(source);
    *chain_interiors = get(source);
    *patch_interiors = get(source);
    block->chain_count = get(source);
    block->patch_count = get(source);
    block->diagonal_count = get(source);
    uint64_t vertices = (uint64_t)block->junction_count + block->seam_vertex_count +
                        *chain_interiors + *patch_interiors;
    size_t left = left_in(source);
    if (source->is_bad || vertices > left / (12 + (size_t)stride) ||
        block->chain_count > left / 5 || block->patch_count > left / 13 ||
        block->diagonal_count > left / 2)
        return "it is too short for its counts";
    block->vertex_count = (uint32_t)vertices;
    return NULL;
}

static enum status take_arrays(struct context *ctx, uint32_t stride, struct chain_block *block)
{
    enum status status =
        memory_take(ctx, block->vertex_count, 3 * sizeof(float), &block->positions);
    if (!status && stride)
        status = memory_take(ctx, block->vertex_count, stride, &block->records);
    if (!status)
        status =
            memory_take(ctx, block->seam_vertex_count, sizeof(uint32_t), &block->seam_vertices);
    if (!status)
        status = memory_take(ctx, block->chain_count, sizeof *block->chains, &block->chains);
    if (!status)
        status = memory_take(ctx, block->patch_count, sizeof *block->patches, &block->patches);
    if (!status)
        status = memory_take(ctx, block->diagonal_count, 2 * sizeof(uint32_t), &block->diagonals);
    return status;
}

static const char *get_vertices(struct source *source, uint32_t stride, struct chain_block *block)
{
    if (left_in(source) != (12 + (size_t)stride) * block->vertex_count)
        return "its size does not fit its counts";
    struct planes planes = {.positions = block->positions,
                            .records = block->records,
                            .stride = stride,
                            .count = block->vertex_count,
                            .bytes = (unsigned char *)(uintptr_t)source->at,
                            .decodes = true};
    code_vertices(&planes, block);
    for (size_t i = 0; i < 3 * (size_t)block->vertex_count; i++)
        if (!isfinite(block->positions[i]))
            return "a coordinate is not finite";
    return NULL;
}

enum status chain_block_decode(struct context *ctx, const char *what, const unsigned char *raw,
                               size_t size, uint32_t slab, uint32_t stride,
                               struct chain_block *block)
{
    struct source source = {.at = raw, .end = raw + size};
    uint32_t chain_interiors, patch_interiors;
    memset(block, 0, sizeof *block);
    const char *wrong = get_counts(&source, stride, block, &chain_interiors, &patch_interiors);
    if (wrong)
        return fail(ctx, STATUS_BAD_INPUT, "%s: %s", what, wrong);
    block->slab = slab;
    enum status status = take_arrays(ctx, stride, block);
    if (status) {
        chain_block_clear(ctx, stride, block);
        return status;
    }
    wrong = get_seam_vertices(&source, block);
    if (!wrong)
        wrong = get_chains(&source, block, chain_interiors);
    if (!wrong)
        wrong = get_patches(&source, block, patch_interiors);
    if (!wrong)
        wrong = get_diagonals(&source, block);
    if (!wrong)
        wrong = get_vertices(&source, stride, block);
    if (wrong) {
        chain_block_clear(ctx, stride, block);
        return fail(ctx, STATUS_BAD_INPUT, "%s: %s", what, wrong);
    }
    return STATUS_OK;
}

void chain_block_clear(struct context *ctx, uint32_t stride, struct chain_block *block)
{
    memory_release(ctx, &block->positions, block->vertex_count, 3 * sizeof(float));
    memory_release(ctx, &block->records, block->vertex_count, stride);
    memory_release(ctx, &block->seam_vertices, block->seam_vertex_count, sizeof(uint32_t));
    memory_release(ctx, &block->chains, block->chain_count, sizeof *block->chains);
    memory_release(ctx, &block->patches, block->patch_count, sizeof *block->patches);
    memory_release(ctx, &block->diagonals, block->diagonal_count, 2 * sizeof(uint32_t));
    memory_release(ctx, &block->seam_chains, block->seam_chain_count, sizeof *block->seam_chains);
    memory_release(ctx, &block->seam_lists, block->seam_list_count, sizeof(uint32_t));
    memset(block, 0, sizeof *block);
}
