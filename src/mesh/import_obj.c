/*
 * OBJ: one statement a line, named by its first word.
 *
 * Taken: `v x y z`, with a weight (ignored) or a colour `r g b` behind it, and `f` with any number
 * of corners `v`, `v/t`, `v//n` or `v/t/n`, where negative numbers count back from the last vertex.
 * Texture coordinates and normals have indices of their own, so that they do not belong to a
 * vertex: they are dropped, as are lines, points, free-form surfaces, groups and materials; what
 * carried data is named once.
 */
#include "mesh/import.h"

#include <string.h>

#include "mesh/import_batch.h"

enum dropped {
    DROPPED_TEXTURE = 1,
    DROPPED_NORMALS = 2,
    DROPPED_LINES = 4,
    DROPPED_POINTS = 8,
    DROPPED_MATERIALS = 16,
    DROPPED_SURFACES = 32,
    DROPPED_UNKNOWN = 64,
    DROPPED_COLOURS = 128
};

struct obj {
    struct context *ctx;
    struct text text;
    struct import_batch batch;
    const struct import_sink *sink;
    const char *name;
    bool has_begun, has_colours;
    enum colour_scale scale;
    unsigned dropped; /* a set of enum dropped */
};

/* ---- vertices ---- */

/* Numbers up to the end of the line; more than 8 are an error. */
static enum status read_numbers(struct obj *obj, struct parsed_number numbers[8], unsigned *count)
{
    *count = 0;
    for (;;) {
        enum status status = STATUS_OK;
        bool more = text_skip_in_line_quickly(&obj->text);
        if (!more)
            status = text_skip_in_line(&obj->text, &more);
        if (status != STATUS_OK || !more)
            return status;
        if (*count == 8)
            return text_fail(&obj->text, "more than 8 numbers");
        status = text_real(&obj->text, &numbers[(*count)++]);
        if (status != STATUS_OK)
            return status;
    }
}

/* At the first vertex or face: whether vertices have colours is known. */
static enum status begin(struct obj *obj, bool has_colours)
{
    if (obj->has_begun)
        return STATUS_OK;
    struct attributes attributes = {0};
    obj->has_begun = true;
    obj->has_colours = has_colours;
    if (has_colours)
        colour_attributes(&attributes, false);
    return batch_open(&obj->batch, obj->ctx, obj->sink, obj->name, &attributes, false, 0, 0);
}

static enum status set_colour(struct obj *obj, const struct parsed_number *colour)
{
    unsigned char *record = batch_record(&obj->batch);
    for (unsigned i = 0; i < 3; i++) {
        record[i] = UINT8_MAX; /* white, where others have a colour */
        if (colour && !colour_byte(&obj->scale, &colour[i], &record[i]))
            return text_fail(&obj->text, "a colour of %.9g, not in 0 to 255", colour[i].value);
    }
    return STATUS_OK;
}

static enum status read_vertex(struct obj *obj)
{
    struct parsed_number numbers[8];
    unsigned count;
    obj->text.item = "vertex";
    obj->text.item_number = batch_vertices(&obj->batch);
    enum status status = read_numbers(obj, numbers, &count);
    if (status != STATUS_OK)
        return status;
    if (count < 3)
        return text_fail(&obj->text, "%u coordinates instead of 3", count);
    status = begin(obj, count >= 6);
    if (status == STATUS_OK && obj->has_colours)
        status = set_colour(obj, count >= 6 ? numbers + 3 : NULL);
    else if (count >= 6)
        obj->dropped |= DROPPED_COLOURS;
    if (status != STATUS_OK)
        return status;
    for (unsigned axis = 0; axis < 3; axis++)
        if (!batch_set_coordinate(&obj->batch, axis, &numbers[axis]))
            return text_fail(&obj->text, "%c is not finite", "xyz"[axis]);
    if (batch_vertices(&obj->batch) == UINT32_MAX - 1)
        return text_fail(&obj->text, "more than 4294967294 vertices");
    return batch_end_vertex(&obj->batch);
}

/* ---- faces ---- */

/* The zero-based vertex that a number in the file means. */
static enum status resolve(struct obj *obj, int64_t number, uint32_t *index)
{
    int64_t vertices = (int64_t)batch_vertices(&obj->batch);
    if (number == 0)
        return text_fail(&obj->text, "a corner is vertex 0; OBJ counts from 1");
    if (number < -vertices)
        return text_fail(&obj->text, "a corner is vertex %lld, but only %lld vertices come before",
                         (long long)number, (long long)vertices);
    if (number > (int64_t)UINT32_MAX - 1)
        return text_fail(&obj->text, "a corner is vertex %lld, beyond the limit of 4294967294",
                         (long long)number);
    *index = (uint32_t)(number < 0 ? vertices + number : number - 1);
    return STATUS_OK;
}

/* A number that is left unused; it may be missing. */
static const unsigned char *skip_number(const unsigned char *at, const unsigned char *end)
{
    if (at < end && *at == '-')
        at++;
    while (at < end && (unsigned char)(*at - '0') < 10)
        at++;
    return at;
}

/* v, v/t, v//n or v/t/n in [at, end). */
static const unsigned char *parse_corner(struct obj *obj, const unsigned char *at,
                                         const unsigned char *end, int64_t *number)
{
    at = parse_integer(at, end, number);
    for (unsigned part = 0; at && part < 2 && at < end && *at == '/'; part++) {
        const unsigned char *first = ++at;
        at = skip_number(first, end);
        if (at > first)
            obj->dropped |= part == 0 ? DROPPED_TEXTURE : DROPPED_NORMALS;
    }
    return at;
}

static enum status read_corner(struct obj *obj)
{
    int64_t number;
    uint32_t index = 0;
    struct text *text = &obj->text;
    const unsigned char *stop = parse_corner(obj, text->at, text->end, &number);
    if (stop && stop < text->end && is_blank(*stop)) {
        text->at = stop;
    } else { /* at the end of the window, or wrong */
        const unsigned char *word;
        size_t length;
        enum status status = text_word(text, &word, &length);
        if (status != STATUS_OK)
            return status;
        if (parse_corner(obj, word, word + length, &number) != word + length)
            return text_fail(text, "a corner is not v, v/t, v//n or v/t/n with integers");
    }
    enum status status = resolve(obj, number, &index);
    return status == STATUS_OK ? batch_corner(&obj->batch, index) : status;
}

static enum status read_face(struct obj *obj)
{
    obj->text.item = "face";
    obj->text.item_number = batch_faces(&obj->batch);
    enum status status = begin(obj, false);
    uint32_t corners = 0;
    for (; status == STATUS_OK; corners++) {
        bool more = text_skip_in_line_quickly(&obj->text);
        if (!more)
            status = text_skip_in_line(&obj->text, &more);
        if (!more)
            break;
        if (status == STATUS_OK)
            status = read_corner(obj);
    }
    return status == STATUS_OK ? batch_end_face(&obj->batch, corners) : status;
}

/* ---- statements ---- */

static enum status skip_statement(struct obj *obj, const unsigned char *word, size_t length)
{
    static const struct {
        const char *word;
        unsigned dropped;
    } known[] = {{"vt", DROPPED_TEXTURE},
                 {"vn", DROPPED_NORMALS},
                 {"vp", DROPPED_SURFACES},
                 {"l", DROPPED_LINES},
                 {"p", DROPPED_POINTS},
                 {"g", 0},
                 {"o", 0},
                 {"s", 0},
                 {"usemtl", DROPPED_MATERIALS},
                 {"mtllib", 0},
                 {"usemap", 0},
                 {"maplib", 0},
                 {"curv", DROPPED_SURFACES},
                 {"curv2", DROPPED_SURFACES},
                 {"surf", DROPPED_SURFACES}};
    unsigned dropped = DROPPED_UNKNOWN;
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (word_is(word, length, known[i].word))
            dropped = known[i].dropped;
    if (length == 0)
        return text_fail(&obj->text, "not a statement of an OBJ file");
    if (dropped == DROPPED_UNKNOWN)
        for (size_t i = 0; i < length; i++)
            if (word[i] <= ' ' || word[i] >= 127)
                return text_fail(&obj->text, "not a statement of an OBJ file");
    obj->dropped |= dropped;
    /* To the end of the statement, which is that of the line unless a backslash joins the next. */
    for (;;) {
        bool more;
        enum status status = text_skip_in_line(&obj->text, &more);
        if (status != STATUS_OK || !more)
            return status;
        const unsigned char *at = obj->text.at + 1;
        while (at < obj->text.end && *at != '\n' && *at != '\\' && *at != '#')
            at++;
        obj->text.at = at;
    }
}

static enum status read_statement(struct obj *obj)
{
    const unsigned char *word;
    size_t length;
    obj->text.item = NULL;
    /* The usual two need no look at the table. */
    if (text_available(&obj->text) >= 2 && is_blank(obj->text.at[1])) {
        unsigned char first = obj->text.at[0];
        if (first == 'v' || first == 'f') {
            obj->text.at++;
            return first == 'v' ? read_vertex(obj) : read_face(obj);
        }
    }
    enum status status = text_word(&obj->text, &word, &length);
    if (status != STATUS_OK)
        return status;
    if (word_is(word, length, "v"))
        return read_vertex(obj);
    if (word_is(word, length, "f") || word_is(word, length, "fo"))
        return read_face(obj);
    return skip_statement(obj, word, length);
}

static void tell_dropped(const struct obj *obj)
{
    static const char *const names[] = {"texture coordinates",
                                        "normals",
                                        "lines",
                                        "points",
                                        "materials",
                                        "free-form curves and surfaces",
                                        "unknown statements",
                                        "colours that only some vertices have"};
    char list[256] = "";
    for (unsigned i = 0; i < sizeof names / sizeof *names; i++)
        if (obj->dropped >> i & 1) {
            strcat(list, list[0] ? ", " : "");
            strcat(list, names[i]);
        }
    if (list[0])
        tell(obj->ctx, MESSAGE_NOTE, "%s: dropped: %s", obj->name, list);
}

static enum status read_all(struct obj *obj)
{
    for (;;) {
        bool more = text_skip_quickly(&obj->text);
        enum status status = STATUS_OK;
        if (!more)
            status = text_skip(&obj->text, &more);
        if (status == STATUS_OK && more)
            status = read_statement(obj);
        if (status != STATUS_OK)
            return status;
        if (!more)
            break;
    }
    obj->text.item = NULL;
    enum status status = begin(obj, false);
    if (status == STATUS_OK)
        status = batch_finish(&obj->batch);
    if (status == STATUS_OK)
        tell_dropped(obj);
    return status;
}

enum status import_obj(struct context *ctx, struct instream *stream, const struct import_sink *sink)
{
    struct obj obj = {.ctx = ctx, .sink = sink, .name = instream_name(stream)};
    enum status status = text_open(&obj.text, ctx, stream, '#');
    obj.text.joins_lines = true;
    if (status == STATUS_OK)
        status = read_all(&obj);
    text_close(&obj.text);
    batch_close(&obj.batch);
    return status;
}
