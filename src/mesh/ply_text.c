/*
 * Rows of an ASCII PLY that stand one on a line, parsed by several threads.
 *
 * The format lets a row run over lines and a line hold rows, so the plain way asks for one token
 * after the other, with a look at the window's end and at the property's type each time. Nearly all
 * files have a row a line. So whole lines are cut into pieces of at most a fixed size, while the
 * window is filled, by read or inflating; each piece is a job, which parses until a line is not one
 * row of numbers; and pieces are handed on in their order. A thread fills and cuts, then parses
 * what it cut while the next one fills: whichever of the two takes longer, no thread waits for the
 * other. What ends a piece early, be it an unusual layout or an error, is left to the reader of
 * single rows (ply_rows.c), which says what is wrong where, and the pieces begin anew behind what
 * it read: ever later, if that was in vain.
 *
 * Lines are counted by rows, since in what is taken here each is one.
 */
#include "mesh/ply_body.h"

#include <string.h>

#include "base/memory.h"
#include "base/parallel.h"

enum {
    PIECE = 64 << 10,       /* bytes of text */
    EXTENT = 128 << 10,     /* by which the window is filled at once */
    WINDOW = 32,            /* pieces in a window that threads share, if memory allows it */
    WINDOW_SHARE = 64,      /* of the memory that is left */
    LEAST_SHARED = 1 << 12, /* rows that are worth a second thread */
    IN_FLIGHT_MAX = 8,
    LEAST_TAKEN = 1024, /* rows; when it was fewer, more rows are read singly the next time */
    MOST_SINGLE = 1 << 20,
    TRIANGLE_BYTES = 2 + 3 * 9 + 1
};

struct field { /* of a vertex */
    int role;
    bool is_float32_axis;
    enum scalar_type type;
    uint32_t offset; /* in the record */
};

struct piece {                          /* in flight */
    const unsigned char *begin, *limit; /* its lines */
    const unsigned char *end;           /* of those that are rows */
    size_t rows;
    /* vertices */
    bool is_float32;
    double *positions;
    unsigned char *records;
    /* faces */
    bool has_polygons;
    size_t corner_count;
    uint32_t *corners;
    uint32_t *sizes;
};

struct reading {
    struct ply *ply;
    bool has_faces;
    bool has_only_list;   /* faces without other properties */
    struct field *fields; /* of a vertex */
    uint32_t field_count;
    size_t most_rows, most_corners; /* of a piece */
    unsigned in_flight;
    size_t window; /* bytes, of what threads share */
    struct piece pieces[IN_FLIGHT_MAX];
    const unsigned char *limit; /* in the window: the end of the last piece's lines */
    bool is_stopped;
};

bool ply_rows_are_lines(const struct ply *ply)
{
    if (ply->header.format != PLY_ASCII || ply->element->property_count == 0)
        return false;
    for (uint32_t i = 0; i < ply->element->property_count; i++)
        if (ply_property(ply, i)->is_list && (int32_t)i != ply->index_list)
            return false;
    return true;
}

/* ---- a line, which ends with \n before `end`; NULL: it is not one row ---- */

/* Mostly there is one space. */
static inline const unsigned char *skip_blanks(const unsigned char *at)
{
    at += *at == ' ';
    if (*at > ' ')
        return at;
    while (is_blank(*at) && *at != '\n')
        at++;
    return at;
}

static inline const unsigned char *end_line(const unsigned char *at)
{
    at = skip_blanks(at);
    return *at == '\n' ? at + 1 : NULL;
}

static const unsigned char *parse_vertex(const struct reading *r, struct piece *piece,
                                         const unsigned char *at, const unsigned char *end)
{
    double *const position = piece->positions + 3 * piece->rows;
    const struct field *const fields = r->fields, *const fields_end = fields + r->field_count;
    for (const struct field *field = fields; field < fields_end; field++) {
        struct parsed_number number;
        at = skip_blanks(at);
        const unsigned char *stop = parse_real(at, end, &number);
        if (!stop || !is_blank(*stop))
            return NULL;
        at = stop;
        if (field->is_float32_axis && number.fits_float32) { /* is finite, and rounded is one */
            position[field->role] = (double)(float)number.value;
        } else if (field->role >= PLY_FIRST_ATTRIBUTE) {
            unsigned char *record = piece->records + piece->rows * r->ply->batch.stride;
            unsigned char bytes[8];
            if (!ply_store_scalar(field->type, number.value, bytes))
                return NULL;
            memcpy(record + field->offset, bytes, scalar_size(field->type));
        } else if (field->role >= 0) {
            const double value = number.value;
            if (value - value != 0)
                return NULL;
            piece->is_float32 &= (double)(float)value == value;
            position[field->role] = value;
        }
    }
    return end_line(at);
}

/* A word, which nobody looks at. */
static const unsigned char *skip_word(const unsigned char *at)
{
    at = skip_blanks(at);
    const unsigned char *first = at;
    while (!is_blank(*at))
        at++;
    return at > first && at - first <= TEXT_TOKEN_MAX ? at : NULL;
}

static inline const unsigned char *parse_list(const struct reading *r, struct piece *piece,
                                              const unsigned char *at, const unsigned char *end)
{
    uint32_t count;
    at = skip_blanks(at);
    at = parse_index(at, end, &count);
    if (!at || !is_blank(*at) || count > r->most_corners - piece->corner_count)
        return NULL;
    uint32_t *corners = piece->corners + piece->corner_count;
    for (uint32_t i = 0; i < count; i++) {
        at = skip_blanks(at);
        at = parse_index(at, end, &corners[i]);
        if (!at || !is_blank(*at))
            return NULL;
    }
    piece->sizes[piece->rows] = count;
    return at;
}

/* An index of at most eight digits (of longer ones, the first eight); NULL: there is none. */
static inline const unsigned char *take_index(const unsigned char *at, uint32_t *index)
{
    const uint64_t bytes = load_u64(at);
    const unsigned digits = digits_in_front(bytes);
    if (digits == 0)
        return NULL;
    *index = value_of_digits(bytes, digits);
    return at + digits;
}

/* Lines "3 a b c" with single spaces, which nearly all faces are, as far as there are any. */
static const unsigned char *parse_triangles(const struct reading *r, struct piece *piece,
                                            const unsigned char *at, const unsigned char *end)
{
    const size_t before = piece->corner_count;
    uint32_t *corners = piece->corners + before, *const last = piece->corners + r->most_corners - 2;
    for (; end - at >= TRIANGLE_BYTES && corners < last; corners += 3) {
        if (at[0] != '3' || at[1] != ' ')
            break;
        const unsigned char *stop = take_index(at + 2, &corners[0]);
        if (!stop || *stop != ' ')
            break;
        stop = take_index(stop + 1, &corners[1]);
        if (!stop || *stop != ' ')
            break;
        stop = take_index(stop + 1, &corners[2]);
        if (!stop)
            break;
        stop += *stop == ' ';
        if (*stop != '\n')
            break;
        at = stop + 1;
    }
    piece->corner_count = (size_t)(corners - piece->corners);
    for (size_t rows = (piece->corner_count - before) / 3; rows > 0; rows--)
        piece->sizes[piece->rows++] = 3;
    return at;
}

static const unsigned char *parse_face(const struct reading *r, struct piece *piece,
                                       const unsigned char *at, const unsigned char *end)
{
    const struct ply *ply = r->ply;
    for (uint32_t i = 0; i < ply->element->property_count && at; i++)
        at = (int32_t)i == ply->index_list ? parse_list(r, piece, at, end) : skip_word(at);
    at = at ? end_line(at) : NULL;
    if (at) {
        const uint32_t size = piece->sizes[piece->rows];
        piece->corner_count += size;
        piece->has_polygons |= size != 3;
    }
    return at;
}

/* ---- a piece ---- */

/* The next whole lines; the end where the window has none and gets no more. */
static enum status cut_piece(void *user, uint64_t job, bool *is_end)
{
    struct reading *r = user;
    struct text *text = &r->ply->text;
    struct piece *piece = &r->pieces[job % r->in_flight];
    const unsigned char *newline = NULL;
    size_t got = 1;
    while (!newline && got > 0) {
        const size_t before = (size_t)(text->end - r->limit);
        if (before < PIECE) {
            enum status status = text_extend(text, EXTENT, &got);
            if (status != STATUS_OK)
                return status;
        }
        const size_t size = (size_t)(text->end - r->limit);
        newline = memrchr(r->limit, '\n', size < PIECE ? size : PIECE);
        if (before >= PIECE)
            break;
    }
    *is_end = !newline;
    if (newline) {
        piece->begin = r->limit;
        r->limit = piece->limit = newline + 1;
    }
    return STATUS_OK;
}

static enum status parse_piece(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct reading *r = user;
    struct piece *piece = &r->pieces[job % r->in_flight];
    const unsigned char *at = piece->begin, *const end = piece->limit;
    piece->rows = piece->corner_count = 0;
    piece->is_float32 = true;
    piece->has_polygons = false;
    while (at < end) {
        if (r->has_only_list)
            at = parse_triangles(r, piece, at, end);
        if (at == end)
            break;
        const unsigned char *next =
            r->has_faces ? parse_face(r, piece, at, end) : parse_vertex(r, piece, at, end);
        if (!next)
            break;
        piece->rows++;
        at = next;
    }
    piece->end = at;
    return STATUS_OK;
}

static enum status take_vertices(struct import_batch *batch, const struct piece *piece, size_t rows)
{
    enum status status = STATUS_OK;
    for (size_t done = 0; done < rows && status == STATUS_OK;) {
        const size_t room = IMPORT_BATCH - batch->vertex_count;
        const size_t count = rows - done < room ? rows - done : room;
        const double *positions = piece->positions + 3 * done;
        memcpy(batch->doubles + 3 * batch->vertex_count, positions, 24 * count);
        if (batch->stride)
            memcpy(batch_record(batch), piece->records + done * batch->stride,
                   count * batch->stride);
        for (size_t i = 0; i < 3 * count && !piece->is_float32 && batch->is_float32; i++)
            batch->is_float32 = (double)(float)positions[i] == positions[i];
        batch->vertex_count += count;
        done += count;
        if (batch->vertex_count == IMPORT_BATCH)
            status = batch_deliver_vertices(batch);
    }
    return status;
}

static enum status take_faces(struct import_batch *batch, const struct piece *piece, size_t rows)
{
    enum status status = STATUS_OK;
    if (!piece->has_polygons) {
        status = batch_deliver_faces(batch);
        if (status == STATUS_OK && rows > 0)
            status = batch->sink->faces(batch->sink->user, batch->first_face, rows, NULL,
                                        piece->corners);
        batch->first_face += rows;
        return status;
    }
    const uint32_t *corner = piece->corners;
    for (size_t i = 0; i < rows && status == STATUS_OK; i++) {
        for (uint32_t k = 0; k < piece->sizes[i] && status == STATUS_OK; k++)
            status = batch_corner(batch, *corner++);
        if (status == STATUS_OK)
            status = batch_end_face(batch, piece->sizes[i]);
    }
    return status;
}

static enum status take_piece(void *user, uint64_t job)
{
    struct reading *r = user;
    struct ply *ply = r->ply;
    const struct piece *piece = &r->pieces[job % r->in_flight];
    const uint64_t left = ply->element->count - ply->row;
    const size_t rows = piece->rows < left ? piece->rows : (size_t)left;
    enum status status = r->has_faces ? take_faces(&ply->batch, piece, rows)
                                      : take_vertices(&ply->batch, piece, rows);
    if (status != STATUS_OK)
        return status;
    ply->text.at = piece->end;
    if (rows < piece->rows) {
        const unsigned char *at = piece->begin;
        for (size_t i = 0; i < rows; i++)
            at = (const unsigned char *)memchr(at, '\n', (size_t)(piece->end - at)) + 1;
        ply->text.at = at;
    }
    ply->text.line += rows;
    ply->row += rows;
    r->is_stopped = piece->end < piece->limit || ply->row == ply->element->count;
    return r->is_stopped ? STATUS_CANCELLED : STATUS_OK; /* ends the loop; no failure is recorded */
}

/* ---- a window ---- */

/* As many rows as stand on whole lines of the window, until one does not stand on one. */
static enum status read_window(struct reading *r)
{
    struct ply *ply = r->ply;
    const bool is_shared = r->in_flight > 1 && ply->element->count - ply->row >= LEAST_SHARED;
    enum status status = text_reserve(&ply->text, is_shared ? r->window : 2 * EXTENT);
    if (status != STATUS_OK)
        return status;
    r->limit = ply->text.at;
    r->is_stopped = false;
    status = parallel_stream(ply->ctx, is_shared ? r->in_flight : 1, cut_piece, parse_piece,
                             take_piece, r);
    return status == STATUS_CANCELLED && r->is_stopped ? STATUS_OK : status;
}

static enum status read_single(struct reading *r, uint64_t rows)
{
    const uint64_t left = r->ply->element->count - r->ply->row;
    const uint64_t end = r->ply->row + (rows < left ? rows : left);
    return r->has_faces ? ply_read_faces(r->ply, end) : ply_read_vertices(r->ply, end);
}

/* Bytes of the window. */
static size_t window_size(const struct context *ctx)
{
    const uint64_t now = atomic_load(&ctx->memory_now);
    const uint64_t left = ctx->memory_budget > now ? ctx->memory_budget - now : 0;
    const size_t most = (size_t)WINDOW * PIECE;
    return left / WINDOW_SHARE > most         ? most
           : left / WINDOW_SHARE > 2 * EXTENT ? (size_t)(left / WINDOW_SHARE)
                                              : 2 * EXTENT;
}

static enum status read_rows(struct reading *r)
{
    struct ply *ply = r->ply;
    uint64_t single = 1;
    while (ply->row < ply->element->count) {
        const uint64_t before = ply->row;
        enum status status = read_window(r);
        if (status != STATUS_OK)
            return status;
        if (!r->is_stopped && ply->row > before)
            continue;
        single = ply->row - before >= LEAST_TAKEN ? 1 : single < MOST_SINGLE ? 2 * single : single;
        status = read_single(r, single);
        if (status != STATUS_OK)
            return status;
    }
    return STATUS_OK;
}

/* ---- the whole ---- */

static enum status take_memory(struct reading *r)
{
    struct ply *ply = r->ply;
    struct context *ctx = ply->ctx;
    enum status status = STATUS_OK;
    for (unsigned i = 0; i < r->in_flight && status == STATUS_OK; i++) {
        struct piece *piece = &r->pieces[i];
        if (r->has_faces) {
            status = memory_take(ctx, r->most_corners, sizeof(uint32_t), &piece->corners);
            if (status == STATUS_OK)
                status = memory_take(ctx, r->most_rows, sizeof(uint32_t), &piece->sizes);
        } else {
            status = memory_take(ctx, r->most_rows, 3 * sizeof(double), &piece->positions);
            if (status == STATUS_OK && ply->batch.stride)
                status = memory_take(ctx, r->most_rows, ply->batch.stride, &piece->records);
        }
    }
    if (status == STATUS_OK && !r->has_faces)
        status = memory_take(ctx, r->field_count, sizeof *r->fields, &r->fields);
    return status;
}

static void release_memory(struct reading *r)
{
    struct context *ctx = r->ply->ctx;
    for (unsigned i = 0; i < r->in_flight; i++) {
        struct piece *piece = &r->pieces[i];
        memory_release(ctx, &piece->corners, r->most_corners, sizeof(uint32_t));
        memory_release(ctx, &piece->sizes, r->most_rows, sizeof(uint32_t));
        memory_release(ctx, &piece->positions, r->most_rows, 3 * sizeof(double));
        memory_release(ctx, &piece->records, r->most_rows, r->ply->batch.stride);
    }
    memory_release(ctx, &r->fields, r->field_count, sizeof *r->fields);
}

static void plan_fields(struct reading *r)
{
    const struct ply *ply = r->ply;
    for (uint32_t i = 0; i < r->field_count; i++) {
        struct field *field = &r->fields[i];
        *field = (struct field){.role = ply->role[i], .type = ply_property(ply, i)->type};
        field->is_float32_axis =
            field->role >= 0 && field->role < PLY_FIRST_ATTRIBUTE && field->type == SCALAR_FLOAT32;
        if (field->role >= PLY_FIRST_ATTRIBUTE)
            field->offset = ply->attributes.list[field->role - PLY_FIRST_ATTRIBUTE].offset;
    }
}

enum status ply_read_lines(struct ply *ply)
{
    struct reading r = {.ply = ply, .has_faces = ply->index_list >= 0};
    const unsigned threads = ply->ctx->threads;
    r.in_flight = threads < 2 ? 1 : threads + 2 < IN_FLIGHT_MAX ? threads + 2 : IN_FLIGHT_MAX;
    r.window = window_size(ply->ctx);
    r.field_count = ply->element->property_count;
    r.has_only_list = r.has_faces && r.field_count == 1;
    /* A token takes two bytes, and all rows but the last end in the piece. */
    r.most_corners = PIECE / 2;
    r.most_rows = PIECE / 2 / r.field_count + 1;
    enum status status = take_memory(&r);
    if (status == STATUS_OK && !r.has_faces)
        plan_fields(&r);
    if (status == STATUS_OK)
        status = read_rows(&r);
    release_memory(&r);
    return status;
}
