/*
 * OFF: a keyword, three counts, vertices, faces; all text.
 *
 * The keyword says what a vertex has besides its position: [ST][C][N]OFF, then, behind x y z, the
 * normal, the colour, the texture coordinates. Counts may stand behind the keyword or on the next
 * line; the third, of edges, may be missing. Vertices and corners of faces are read as words,
 * wherever lines end; what follows them to the end of a line is colours or is dropped. Colours of
 * vertices become the attributes red, green, blue and alpha; how many there are, the first vertex
 * shows.
 */
#include "mesh/import.h"

#include <string.h>

#include "mesh/import_batch.h"

enum { EXTRA_MAX = 16 }; /* numbers behind a position that are looked at */

struct off {
    struct context *ctx;
    struct text text;
    struct import_batch batch;
    const char *name;
    bool has_normals, has_colours, has_texture;
    uint64_t vertex_count, face_count;
    unsigned colours; /* 0, 3 or 4: in the records */
    enum colour_scale scale;
    bool dropped_extras, dropped_face_extras;
};

/* What stands behind a position, up to the end of the line. */
struct extras {
    unsigned count;
    struct parsed_number numbers[EXTRA_MAX];
};

static enum status ends_early(struct off *off, const char *element, uint64_t done, uint64_t count)
{
    return fail(off->ctx, STATUS_BAD_INPUT,
                "%s: the file ends within the %s: %llu of %llu are there", off->name, element,
                (unsigned long long)done, (unsigned long long)count);
}

/* ---- header ---- */

static enum status read_keyword(struct off *off)
{
    const unsigned char *word;
    size_t length;
    bool more;
    enum status status = text_skip(&off->text, &more);
    if (status == STATUS_OK)
        status = text_word(&off->text, &word, &length);
    if (status != STATUS_OK)
        return status;
    const unsigned char *at = word, *end = word + length;
    if (end - at > 2 && at[0] == 'S' && at[1] == 'T') {
        off->has_texture = true;
        at += 2;
    }
    if (end - at > 3 && at[0] == 'C') {
        off->has_colours = true;
        at++;
    }
    if (end - at > 3 && at[0] == 'N') {
        off->has_normals = true;
        at++;
    }
    if (end - at > 3 && (at[0] == '4' || at[0] == 'n'))
        return text_fail(&off->text, "OFF with points of other than three dimensions");
    if (!word_is(at, (size_t)(end - at), "OFF"))
        return text_fail(&off->text, "not an OFF file: it does not begin with \"OFF\"");
    status = text_skip_in_line(&off->text, &more);
    if (status == STATUS_OK && more && *off->text.at == 'B')
        return text_fail(&off->text, "binary OFF can't be read, only its text form");
    return status;
}

static enum status read_count(struct off *off, const char *what, uint64_t *count)
{
    bool more;
    int64_t value = 0;
    enum status status = text_skip(&off->text, &more);
    if (status == STATUS_OK && !more)
        return text_fail(&off->text, "the file ends before the number of %s", what);
    if (status == STATUS_OK)
        status = text_integer(&off->text, &value);
    if (status == STATUS_OK && value < 0)
        return text_fail(&off->text, "the number of %s is negative", what);
    *count = (uint64_t)value;
    return status;
}

static enum status read_counts(struct off *off)
{
    bool more;
    enum status status = read_count(off, "vertices", &off->vertex_count);
    if (status == STATUS_OK)
        status = read_count(off, "faces", &off->face_count);
    if (status == STATUS_OK && off->vertex_count > UINT32_MAX - 1)
        return text_fail(&off->text, "%llu vertices; the most that a mesh can have is 4294967294",
                         (unsigned long long)off->vertex_count);
    if (status == STATUS_OK)
        status = text_skip_in_line(&off->text, &more);
    return status == STATUS_OK ? text_skip_line(&off->text) : status; /* with the edges */
}

/* ---- vertices ---- */

static enum status read_position(struct off *off, uint64_t vertex)
{
    off->text.item = "vertex";
    off->text.item_number = vertex;
    for (unsigned axis = 0; axis < 3; axis++) {
        struct parsed_number number;
        enum status status = STATUS_OK;
        bool more = text_skip_quickly(&off->text);
        if (!more)
            status = text_skip(&off->text, &more);
        if (status == STATUS_OK && !more)
            return ends_early(off, "vertices", vertex, off->vertex_count);
        if (status == STATUS_OK)
            status = text_real(&off->text, &number);
        if (status != STATUS_OK)
            return status;
        if (!batch_set_coordinate(&off->batch, axis, &number))
            return text_fail(&off->text, "%c is not finite", "xyz"[axis]);
    }
    return STATUS_OK;
}

static enum status read_extras(struct off *off, struct extras *extras)
{
    extras->count = 0;
    for (;;) {
        struct parsed_number number;
        enum status status = STATUS_OK;
        bool more = text_skip_in_line_quickly(&off->text);
        if (!more)
            status = text_skip_in_line(&off->text, &more);
        if (status != STATUS_OK || !more)
            return status;
        status = text_real(&off->text, &number);
        if (status != STATUS_OK)
            return status;
        if (extras->count == EXTRA_MAX)
            return text_fail(&off->text, "more than 16 numbers behind the position");
        extras->numbers[extras->count++] = number;
    }
}

/* Where the colours are among the extras, and how many of them. */
static unsigned colours_of(const struct off *off, const struct extras *extras, unsigned *first)
{
    *first = off->has_normals ? 3 : 0;
    unsigned behind = off->has_texture ? 2 : 0;
    if (!off->has_colours || extras->count < *first + behind + 3)
        return 0;
    return extras->count - *first - behind == 3 ? 3 : 4;
}

static enum status set_colours(struct off *off, const struct extras *extras)
{
    unsigned first, count = colours_of(off, extras, &first);
    unsigned char *record = batch_record(&off->batch);
    off->dropped_extras |= extras->count > count;
    if (off->colours == 0)
        return STATUS_OK;
    if (count < 3)
        return text_fail(&off->text, "the colour is missing");
    for (unsigned i = 0; i < off->colours; i++) {
        record[i] = UINT8_MAX; /* opaque, where only others have an alpha */
        if (i < count && !colour_byte(&off->scale, &extras->numbers[first + i], &record[i]))
            return text_fail(&off->text, "a colour of %.9g, not in 0 to 255",
                             extras->numbers[first + i].value);
    }
    return STATUS_OK;
}

/* The first vertex decides what the records hold: it is read before the batch has any. */
static enum status begin(struct off *off, const struct import_sink *sink)
{
    struct attributes attributes = {0};
    struct extras extras = {0};
    struct parsed_number position[3] = {{0}};
    for (unsigned axis = 0; axis < 3 && off->vertex_count > 0; axis++) {
        bool more;
        enum status status = text_skip(&off->text, &more);
        if (status == STATUS_OK && !more)
            return ends_early(off, "vertices", 0, off->vertex_count);
        off->text.item = "vertex";
        if (status == STATUS_OK)
            status = text_real(&off->text, &position[axis]);
        if (status != STATUS_OK)
            return status;
    }
    enum status status = off->vertex_count > 0 ? read_extras(off, &extras) : STATUS_OK;
    if (status != STATUS_OK)
        return status;
    unsigned first;
    off->colours = colours_of(off, &extras, &first);
    if (off->colours)
        colour_attributes(&attributes, off->colours == 4);
    status = batch_open(&off->batch, off->ctx, sink, off->name, &attributes, false,
                        off->vertex_count, off->face_count);
    if (status != STATUS_OK || off->vertex_count == 0)
        return status;
    for (unsigned axis = 0; axis < 3; axis++)
        if (!batch_set_coordinate(&off->batch, axis, &position[axis]))
            return text_fail(&off->text, "%c is not finite", "xyz"[axis]);
    status = set_colours(off, &extras);
    return status == STATUS_OK ? batch_end_vertex(&off->batch) : status;
}

static enum status read_vertices(struct off *off)
{
    for (uint64_t vertex = 1; vertex < off->vertex_count; vertex++) {
        struct extras extras;
        enum status status = read_position(off, vertex);
        if (status == STATUS_OK)
            status = read_extras(off, &extras);
        if (status == STATUS_OK)
            status = set_colours(off, &extras);
        if (status == STATUS_OK)
            status = batch_end_vertex(&off->batch);
        if (status != STATUS_OK)
            return status;
    }
    return STATUS_OK;
}

/* ---- faces ---- */

static enum status read_index(struct off *off, uint64_t face, uint32_t *index)
{
    enum status status = STATUS_OK;
    bool more = text_skip_quickly(&off->text);
    if (!more)
        status = text_skip(&off->text, &more);
    if (status == STATUS_OK && !more)
        return ends_early(off, "faces", face, off->face_count);
    return status == STATUS_OK ? text_index(&off->text, index) : status;
}

static enum status read_face(struct off *off, uint64_t face)
{
    uint32_t corners = 0;
    off->text.item = "face";
    off->text.item_number = face;
    enum status status = read_index(off, face, &corners);
    for (uint32_t i = 0; status == STATUS_OK && i < corners; i++) {
        uint32_t index = 0;
        status = read_index(off, face, &index);
        if (status == STATUS_OK)
            status = batch_corner(&off->batch, index);
    }
    if (status == STATUS_OK)
        status = batch_end_face(&off->batch, corners);
    if (status != STATUS_OK)
        return status;
    if (text_available(&off->text) > 0 && *off->text.at == '\n')
        return STATUS_OK;
    bool more;
    status = text_skip_in_line(&off->text, &more);
    if (status == STATUS_OK && more) {
        off->dropped_face_extras = true;
        status = text_skip_line(&off->text);
    }
    return status;
}

static enum status read_all(struct off *off, const struct import_sink *sink)
{
    enum status status = read_keyword(off);
    if (status == STATUS_OK)
        status = read_counts(off);
    if (status == STATUS_OK)
        status = begin(off, sink);
    if (status == STATUS_OK)
        status = read_vertices(off);
    for (uint64_t face = 0; status == STATUS_OK && face < off->face_count; face++)
        status = read_face(off, face);
    off->text.item = NULL;
    if (status == STATUS_OK)
        status = batch_finish(&off->batch);
    bool more = false;
    if (status == STATUS_OK)
        status = text_skip(&off->text, &more);
    if (status == STATUS_OK && more)
        tell(off->ctx, MESSAGE_WARNING, "%s: what follows the last face is ignored", off->name);
    if (status == STATUS_OK && off->dropped_extras)
        tell(off->ctx, MESSAGE_NOTE, "%s: dropped: %s", off->name,
             off->has_normals   ? "normals of the vertices"
             : off->has_texture ? "texture coordinates of the vertices"
                                : "numbers behind the positions of the vertices");
    if (status == STATUS_OK && off->dropped_face_extras)
        tell(off->ctx, MESSAGE_NOTE, "%s: dropped: colours of the faces", off->name);
    return status;
}

enum status import_off(struct context *ctx, struct instream *stream, const struct import_sink *sink)
{
    struct off off = {.ctx = ctx, .name = instream_name(stream)};
    enum status status = text_open(&off.text, ctx, stream, '#');
    if (status == STATUS_OK)
        status = read_all(&off, sink);
    text_close(&off.text);
    batch_close(&off.batch);
    return status;
}
