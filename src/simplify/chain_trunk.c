/*
 * The trunk's sections, written and read.
 *
 * It is known only when levels are made, and then the chain file is there already, whole and under
 * its name. So it is written again with two sections more, beside itself, and takes its own place
 * in one step. Faces are differences of indices, which lie close together as vertices are numbered
 * along the curve; coordinates go as in the blocks (chain_code.c), predicted from the vertex
 * before.
 */
#include "simplify/chain_trunk.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/block_stream.h"
#include "base/bytes.h"
#include "base/memory.h"
#include "simplify/chain_frame.h"
#include "simplify/small_numbers.h"

enum { HEADER = 120, COORDINATE_PLANES = 12, NOTE_PLANES = 8, COPIED = 1 << 20 };
/* Far beyond what a scaled mesh has. */
static const double MOST_ASTRAY = 1e6;
static const double MOST_COUNT = 0x1p40;

/* ---- the bytes ---- */

static void put_header(const struct trunk *trunk, unsigned char *to)
{
    const struct collapse_state *state = &trunk->state;
    store_u32(to, trunk->subset);
    store_u32(to + 4, trunk->effort);
    store_u64(to + 8, trunk->finest);
    store_u64(to + 16, trunk->small_faces);
    store_f64(to + 24, trunk->lost);
    store_u64(to + 32, state->vertex_count);
    store_u64(to + 40, state->face_count);
    store_u64(to + 48, state->room);
    store_f64(to + 56, state->scale);
    store_f64(to + 64, state->unit);
    store_f64(to + 72, state->typical_error);
    store_f64(to + 80, state->astray);
    store_f64(to + 88, state->error_sum);
    store_u64(to + 96, state->error_count);
    store_u64(to + 104, state->refused_count);
    store_u32(to + 112, state->guard);
    store_u32(to + 116, state->flat_is_left);
}

static void get_header(const unsigned char *from, struct trunk *trunk)
{
    struct collapse_state *state = &trunk->state;
    trunk->subset = load_u32(from) == 1;
    trunk->effort = load_u32(from + 4);
    trunk->finest = load_u64(from + 8);
    trunk->small_faces = load_u64(from + 16);
    trunk->lost = load_f64(from + 24);
    state->vertex_count = load_u64(from + 32);
    state->face_count = load_u64(from + 40);
    state->room = load_u64(from + 48);
    state->scale = load_f64(from + 56);
    state->unit = load_f64(from + 64);
    state->typical_error = load_f64(from + 72);
    state->astray = load_f64(from + 80);
    state->error_sum = load_f64(from + 88);
    state->error_count = load_u64(from + 96);
    state->refused_count = load_u64(from + 104);
    state->guard = load_u32(from + 112);
    state->flat_is_left = load_u32(from + 116) == 1;
}

static bool is_power_of_two(double value)
{
    int exponent;
    return value > 0 && value < INFINITY && frexp(value, &exponent) == 0.5;
}

static bool is_length(double value)
{
    return value >= 0 && value < INFINITY;
}

/* Also asked of what is to be written: a mesh whose numbers are so odd is made again instead. */
static const char *find_wrong(const struct trunk *trunk)
{
    const struct collapse_state *state = &trunk->state;
    if (trunk->effort < 1 || trunk->effort > 3 || trunk->finest < 1 ||
        state->guard >= COLLAPSE_GUARDS)
        return "it is not made for anything";
    if (state->vertex_count >= 1 << 30 || state->face_count > (UINT32_MAX - 2) / 3 ||
        state->face_count > state->room || state->room > UINT32_MAX ||
        trunk->small_faces > UINT32_MAX || !((double)state->error_count <= MOST_COUNT) ||
        !((double)state->refused_count <= MOST_COUNT))
        return "a count is out of range";
    if (!is_power_of_two(state->scale) || !is_power_of_two(state->unit) || state->unit < 0x1p-126 ||
        state->unit > 0x1p100)
        return "its scale is not sound";
    if (!is_length(trunk->lost) || !is_length(state->typical_error) ||
        !is_length(state->error_sum) || !is_length(state->astray) || state->astray > MOST_ASTRAY)
        return "an error is not sound";
    return NULL;
}

static void put_vertices(const struct collapse_state *state, uint32_t stride, unsigned char *to)
{
    const size_t count = (size_t)state->vertex_count;
    uint32_t last[3] = {0x80000000, 0x80000000, 0x80000000}; /* 0.0 */
    for (size_t v = 0; v < count; v++) {
        for (size_t k = 0; k < 3; k++) {
            const uint32_t ordered = float_to_ordered(state->positions[3 * v + k]);
            const uint32_t code = zigzag(ordered - last[k]);
            last[k] = ordered;
            for (size_t b = 0; b < 4; b++)
                to[(4 * k + b) * count + v] = (unsigned char)(code >> 8 * b);
        }
        for (size_t k = 0; k < NOTE_PLANES; k++)
            to[(COORDINATE_PLANES + k) * count + v] =
                (unsigned char)(state->notes[4 * v + k / 2] >> 8 * (k % 2));
        for (size_t k = 0; k < stride; k++)
            to[(COORDINATE_PLANES + NOTE_PLANES + k) * count + v] =
                (unsigned char)(state->records[v * stride + k] -
                                (v > 0 ? state->records[(v - 1) * stride + k] : 0));
    }
}

static bool are_finite(const struct collapse_state *state)
{
    for (size_t i = 0; i < 3 * (size_t)state->vertex_count; i++)
        if (!isfinite((float)((double)state->positions[i] / state->scale)))
            return false;
    return true;
}

static const char *get_vertices(const unsigned char *from, uint32_t stride,
                                struct collapse_state *state)
{
    const size_t count = (size_t)state->vertex_count;
    uint32_t last[3] = {0x80000000, 0x80000000, 0x80000000};
    for (size_t v = 0; v < count; v++) {
        for (size_t k = 0; k < 3; k++) {
            uint32_t code = 0;
            for (size_t b = 0; b < 4; b++)
                code |= (uint32_t)from[(4 * k + b) * count + v] << 8 * b;
            last[k] += unzigzag(code);
            state->positions[3 * v + k] = ordered_to_float(last[k]);
        }
        for (size_t k = 0; k < NOTE_PLANES; k += 2) {
            const unsigned char *low = from + (COORDINATE_PLANES + k) * count + v;
            state->notes[4 * v + k / 2] = (uint16_t)(low[0] | low[count] << 8);
        }
        for (size_t k = 0; k < stride; k++)
            state->records[v * stride + k] =
                (unsigned char)(from[(COORDINATE_PLANES + NOTE_PLANES + k) * count + v] +
                                (v > 0 ? state->records[(v - 1) * stride + k] : 0));
    }
    return are_finite(state) ? NULL : "a coordinate is not finite";
}

static void put_faces(const struct collapse_state *state, struct sink *sink)
{
    uint32_t first = 0;
    for (size_t f = 0; f < (size_t)state->face_count; f++) {
        const uint32_t *face = state->faces + 3 * f;
        put(sink, zigzag(face[0] - first));
        put(sink, zigzag(face[1] - face[0]));
        put(sink, zigzag(face[2] - face[1]));
        first = face[0];
    }
}

static const char *get_faces(struct source *source, struct collapse_state *state)
{
    uint32_t first = 0;
    for (size_t f = 0; f < (size_t)state->face_count; f++) {
        uint32_t *face = state->faces + 3 * f;
        face[0] = first + unzigzag(get(source));
        face[1] = face[0] + unzigzag(get(source));
        face[2] = face[1] + unzigzag(get(source));
        first = face[0];
        for (int k = 0; k < 3; k++)
            if (face[k] >= state->vertex_count)
                return "a face has a vertex that is not there";
    }
    return source->is_bad ? "its faces end too soon" : NULL;
}

/* ---- writing ---- */

static size_t vertex_bytes(uint32_t stride)
{
    return COORDINATE_PLANES + NOTE_PLANES + (size_t)stride;
}

enum status chain_trunk_pack(struct context *ctx, const struct trunk *trunk, uint32_t stride,
                             struct packed_trunk *packed)
{
    const struct collapse_state *state = &trunk->state;
    const size_t vertices = (size_t)state->vertex_count * vertex_bytes(stride);
    const size_t capacity = HEADER + vertices + (size_t)state->face_count * 3 * SMALL_NUMBER_MAX;
    unsigned char *raw = NULL;
    if (find_wrong(trunk) || !are_finite(state) || capacity > BLOCK_MAX)
        return STATUS_OK;
    enum status status = memory_take(ctx, capacity, 1, &raw);
    if (status != STATUS_OK)
        return status;
    struct sink sink = {raw + HEADER + vertices};
    put_header(trunk, raw);
    put_vertices(state, stride, raw + HEADER);
    put_faces(state, &sink);
    status = block_pack(ctx, raw, (size_t)(sink.at - raw), CHAIN_KEPT_LEVEL,
                        &packed->bytes[trunk->is_lower], &packed->sizes[trunk->is_lower]);
    memory_release(ctx, &raw, capacity, 1);
    return status;
}

void packed_trunk_clear(struct context *ctx, struct packed_trunk *packed)
{
    for (int i = 0; i < 2; i++)
        memory_release(ctx, &packed->bytes[i], packed->sizes[i], 1);
}

static enum status copy_section(struct section_reader *reader, const struct section *section,
                                struct section_writer *writer)
{
    enum status status = section_begin(writer, section->kind);
    for (uint64_t at = 0; at < section->length && status == STATUS_OK; at += COPIED) {
        const uint64_t left = section->length - at;
        struct window window = {0};
        status = window_open(&reader->file, section->offset + at, left < COPIED ? left : COPIED,
                             &window);
        if (status == STATUS_OK)
            status = section_append(writer, window.data, left < COPIED ? (size_t)left : COPIED);
        window_close(&window);
    }
    return status == STATUS_OK ? section_end(writer) : status;
}

/* The sections of `reader` and those packed, under the same name. */
static enum status write_again(struct context *ctx, struct section_reader *reader,
                               const struct packed_trunk *packed, bool sync)
{
    static const uint32_t kinds[2] = {CHAIN_SECTION_TRUNK, CHAIN_SECTION_LOWER};
    struct section_writer writer;
    enum status status =
        section_file_create(ctx, reader->file.path, CHAIN_MAGIC, CHAIN_VERSION, &writer);
    if (status != STATUS_OK)
        return status;
    for (unsigned i = 0; i < reader->count && status == STATUS_OK; i++)
        if (reader->table[i].kind != CHAIN_SECTION_LOWER &&
            !(reader->table[i].kind == CHAIN_SECTION_TRUNK && packed->bytes[0]))
            status = copy_section(reader, &reader->table[i], &writer);
    for (int i = 0; i < 2 && status == STATUS_OK; i++) {
        if (!packed->bytes[i])
            continue;
        status = section_begin(&writer, kinds[i]);
        if (status == STATUS_OK)
            status = section_append(&writer, packed->bytes[i], packed->sizes[i]);
        if (status == STATUS_OK)
            status = section_end(&writer);
    }
    if (status == STATUS_OK)
        return section_file_finish(&writer, sync);
    section_file_discard(&writer);
    return status;
}

enum status chain_trunk_add(struct context *ctx, const char *path,
                            const struct packed_trunk *packed, bool sync)
{
    struct section_reader reader;
    if (!packed->bytes[0] && !packed->bytes[1])
        return STATUS_OK;
    enum status status =
        section_file_open(ctx, path, CHAIN_MAGIC, CHAIN_VERSION, "a chain file", &reader);
    if (status == STATUS_OK) {
        status = write_again(ctx, &reader, packed, sync);
        section_file_close(&reader);
    }
    return status;
}

/* ---- reading ---- */

void chain_trunk_clear(struct context *ctx, uint32_t stride, struct trunk *trunk)
{
    collapse_state_clear(ctx, stride, &trunk->state);
    memset(trunk, 0, sizeof *trunk);
}

static const char *decode(struct context *ctx, const unsigned char *raw, size_t size,
                          uint32_t stride, struct trunk *trunk, enum status *status)
{
    if (size < HEADER)
        return "it is too short";
    if (load_u32(raw) > 1 || load_u32(raw + 116) > 1)
        return "it is not made for anything";
    get_header(raw, trunk);
    const char *wrong = find_wrong(trunk);
    struct collapse_state *state = &trunk->state;
    const uint64_t vertices = state->vertex_count, faces = state->face_count;
    const uint64_t least = HEADER + vertices * vertex_bytes(stride) + 3 * faces;
    if (!wrong && least > size)
        wrong = "its size does not fit its counts";
    if (wrong) {
        state->vertex_count = state->face_count = 0; /* nothing is there to be cleared */
        return wrong;
    }
    *status = collapse_state_take(ctx, stride, state);
    if (*status != STATUS_OK)
        return NULL;
    struct source source = {raw + HEADER + vertices * vertex_bytes(stride), raw + size, false};
    wrong = get_vertices(raw + HEADER, stride, state);
    if (!wrong)
        wrong = get_faces(&source, state);
    return !wrong && left_in(&source) > 0 ? "something is left over behind its faces" : wrong;
}

static const char *section_name(bool is_lower)
{
    return is_lower ? "LOWR" : "TRNK";
}

enum status chain_trunk_read(struct chain_file *file, bool is_lower, struct trunk *trunk)
{
    struct context *ctx;
    const uint32_t stride = chain_file_info(file)->attributes.stride;
    const uint32_t kind = is_lower ? CHAIN_SECTION_LOWER : CHAIN_SECTION_TRUNK;
    unsigned char *raw;
    size_t size;
    char what[512];
    memset(trunk, 0, sizeof *trunk);
    snprintf(what, sizeof what, "%.470s: section %s", chain_file_name(file),
             section_name(is_lower));
    enum status status = chain_file_trunk_bytes(file, kind, what, &ctx, &raw, &size);
    if (status != STATUS_OK || !raw)
        return status;
    const char *wrong = decode(ctx, raw, size, stride, trunk, &status);
    memory_release(ctx, &raw, size, 1);
    if (wrong)
        status = fail(ctx, STATUS_BAD_INPUT, "%s: %s", what, wrong);
    if (status != STATUS_OK)
        chain_trunk_clear(ctx, stride, trunk);
    trunk->is_lower = is_lower;
    trunk->has_lower = chain_file_has(file, CHAIN_SECTION_LOWER);
    return status;
}

enum status chain_trunk_resume(struct context *ctx, const struct chain_info *info,
                               const struct collapse_options *options, struct trunk *trunk,
                               struct collapse **out)
{
    enum status status = collapse_resume(ctx, options, &trunk->state, &info->attributes, out);
    if (status == STATUS_OK && collapse_euler(*out) != info->topology.euler)
        status =
            fail(ctx, STATUS_BAD_INPUT, "%s: section %s: it has another topology than the file",
                 options->source, section_name(trunk->is_lower));
    if (status != STATUS_OK)
        collapse_end(out);
    return status;
}

enum status chain_trunk_check(struct context *ctx, struct chain_file *file)
{
    const struct chain_info *info = chain_file_info(file);
    const struct collapse_options options = {.effort = 1, .source = chain_file_name(file)};
    enum status status = STATUS_OK;
    for (int i = 0; i < 2 && status == STATUS_OK; i++) {
        struct collapse *collapse = NULL;
        struct trunk trunk;
        status = chain_trunk_read(file, i == 1, &trunk);
        if (status == STATUS_OK && trunk.finest > 0)
            status = chain_trunk_resume(ctx, info, &options, &trunk, &collapse);
        collapse_end(&collapse);
        chain_trunk_clear(ctx, info->attributes.stride, &trunk);
    }
    return status;
}
