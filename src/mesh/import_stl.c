/*
 * STL: triangles one by one, each with the coordinates of its three corners; binary or text.
 *
 * The first five bytes do not tell which: many programs write "solid" into the header of binary
 * files. The content decides (stl_is_text). The normal of a facet follows from its corners, and the
 * two bytes behind a binary facet have no agreed meaning (some programs keep a colour there): both
 * are dropped. Corners are not shared, so the sink is told to weld.
 */
#include "mesh/import.h"

#include <math.h>
#include <string.h>

#include "base/bytes.h"
#include "mesh/import_batch.h"
#include "mesh/stl_kind.h"

struct stl {
    struct context *ctx;
    struct text text;
    struct import_batch batch;
    const char *name;
};

static const uint64_t facet_limit = (UINT32_MAX - 1) / 3;

/* ---- which of the two ---- */

/* Behind [at, end), blanks skipped, does the word (in any case) follow? */
static bool word_follows(const unsigned char *at, const unsigned char *end, const char *word)
{
    while (at < end && is_blank(*at))
        at++;
    for (; *word; word++, at++)
        if (at >= end || (*at | 0x20) != *word)
            return false;
    return true;
}

bool stl_is_text(const unsigned char *data, size_t size)
{
    const unsigned char *at = data, *end = data + size;
    if (size >= 3 && memcmp(at, "\xef\xbb\xbf", 3) == 0)
        at += 3;
    if (!word_follows(at, end, "solid"))
        return false;
    while (at < end && is_blank(*at)) /* blank lines before it */
        at++;
    while (at < end) {
        const unsigned char *line_end = memchr(at, '\n', (size_t)(end - at));
        if (memchr(at, 0, (size_t)((line_end ? line_end : end) - at)))
            return false;
        if (!line_end)
            break;
        at = line_end + 1;
        if (word_follows(at, end, "facet") || word_follows(at, end, "endsolid"))
            return true;
    }
    /* Nothing but text so far: a cut-off text, or one with long lines. */
    return size < STL_HEADER_SIZE || !stl_is_binary(data, size, size < STL_LOOK);
}

bool stl_is_binary(const unsigned char *data, size_t size, bool is_all)
{
    if (size < STL_HEADER_SIZE)
        return false;
    uint64_t facets = load_u32(data + 80);
    size_t visible = (size - STL_HEADER_SIZE) / STL_FACET_SIZE;
    if (is_all && size == STL_HEADER_SIZE + facets * STL_FACET_SIZE)
        return true;
    /* A small file may be cut off, but not from one of gigabytes. */
    if (is_all && facets > 1000 + 100 * (uint64_t)size)
        return false;
    if (facets > 0 && facets < visible)
        visible = (size_t)facets;
    size_t tiny = 0, zeros = 0; /* a few may be the noise of some program's arithmetic */
    for (size_t i = 0; i < visible; i++) {
        const unsigned char *facet = data + STL_HEADER_SIZE + i * STL_FACET_SIZE;
        for (unsigned k = 3; k < 12; k++) {
            double value = fabs((double)load_f32(facet + 4 * k));
            if (!(value <= 1e18))
                return false;
            tiny += value != 0 && value < 1e-30;
            zeros += value == 0;
        }
    }
    return tiny <= visible && zeros < 9 * visible;
}

/* ---- binary ---- */

static enum status put_corner(struct stl *stl, const unsigned char *from, uint64_t facet)
{
    struct import_batch *batch = &stl->batch;
    float *floats = batch->floats + 3 * batch->vertex_count;
    for (unsigned k = 0; k < 3; k++) {
        floats[k] = load_f32(from + 4 * k);
        if (!isfinite(floats[k]))
            return fail(stl->ctx, STATUS_BAD_INPUT, "%s: facet %llu: %c of a corner is not finite",
                        stl->name, (unsigned long long)facet, "xyz"[k]);
    }
    return ++batch->vertex_count == IMPORT_BATCH ? batch_deliver_floats(batch) : STATUS_OK;
}

static enum status put_facet(struct stl *stl, const unsigned char *data, uint64_t facet)
{
    uint32_t first = (uint32_t)(3 * facet);
    enum status status = STATUS_OK;
    for (uint32_t k = 0; status == STATUS_OK && k < 3; k++) {
        status = batch_corner(&stl->batch, first + k);
        if (status == STATUS_OK)
            status = put_corner(stl, data + 12 + 12 * k, facet);
    }
    return status == STATUS_OK ? batch_end_face(&stl->batch, 3) : status;
}

static enum status read_facets(struct stl *stl, uint64_t count, bool is_counted)
{
    struct text *text = &stl->text;
    uint64_t facet = 0;
    bool has_attributes = false;
    for (; facet < count; facet++) {
        enum status status = STATUS_OK;
        if (text_available(text) < STL_FACET_SIZE && !text->is_last)
            status = text_refill(text, STL_FACET_SIZE);
        if (status != STATUS_OK)
            return status;
        if (text_available(text) < STL_FACET_SIZE) {
            if (!is_counted)
                break;
            return fail(stl->ctx, STATUS_BAD_INPUT,
                        "%s: the file ends within the facets: %llu of %llu are there", stl->name,
                        (unsigned long long)facet, (unsigned long long)count);
        }
        status = put_facet(stl, text->at, facet);
        if (status != STATUS_OK)
            return status;
        has_attributes |= load_u16(text->at + 48) != 0;
        text->at += STL_FACET_SIZE;
    }
    if (has_attributes)
        tell(stl->ctx, MESSAGE_NOTE, "%s: dropped: attributes of the facets", stl->name);
    if (!is_counted && facet > 0)
        tell(stl->ctx, MESSAGE_WARNING, "%s: the header says 0 facets, but %llu follow", stl->name,
             (unsigned long long)facet);
    enum status status = batch_deliver_floats(&stl->batch);
    return status == STATUS_OK ? batch_finish(&stl->batch) : status;
}

static enum status read_binary(struct stl *stl, const struct import_sink *sink)
{
    struct text *text = &stl->text;
    struct attributes none = {0};
    text->at = text->begin; /* what looked like a byte order mark is a part of the header */
    if (text_available(text) < STL_HEADER_SIZE)
        return fail(stl->ctx, STATUS_BAD_INPUT,
                    "%s: the file ends within the header of a binary STL, at byte %zu", stl->name,
                    text_available(text));
    uint64_t count = load_u32(text->at + 80);
    text->at += STL_HEADER_SIZE;
    if (count > facet_limit)
        return fail(stl->ctx, STATUS_BAD_INPUT,
                    "%s: %llu facets, more corners than a mesh can have (4294967294)", stl->name,
                    (unsigned long long)count);
    enum status status =
        batch_open(&stl->batch, stl->ctx, sink, stl->name, &none, true, 3 * count, count);
    if (status != STATUS_OK)
        return status;
    /* Programs that write to a pipe can't fill in the count: then the file's end counts. */
    return read_facets(stl, count ? count : facet_limit, count > 0);
}

/* ---- text ---- */

struct facet {
    uint64_t number;
    uint32_t corners;
    bool is_open; /* between facet and endfacet */
};

static bool is_keyword(const unsigned char *word, size_t length, const char *keyword)
{
    for (size_t i = 0; i < length; i++, keyword++)
        if (!*keyword || (word[i] | 0x20) != *keyword)
            return false;
    return *keyword == 0;
}

/* The next word, wherever it is; an error if the file ends before it. */
static enum status need_word(struct stl *stl, const unsigned char **word, size_t *length)
{
    bool more;
    enum status status = text_skip(&stl->text, &more);
    if (status == STATUS_OK && !more)
        return text_fail(&stl->text, "the file ends here");
    return status == STATUS_OK ? text_word(&stl->text, word, length) : status;
}

static enum status skip_words(struct stl *stl, unsigned count)
{
    const unsigned char *word;
    size_t length;
    enum status status = STATUS_OK;
    while (status == STATUS_OK && count-- > 0)
        status = need_word(stl, &word, &length);
    return status;
}

static enum status read_text_corner(struct stl *stl, struct facet *facet)
{
    for (unsigned axis = 0; axis < 3; axis++) {
        struct parsed_number number;
        bool more = text_skip_quickly(&stl->text);
        enum status status = STATUS_OK;
        if (!more)
            status = text_skip(&stl->text, &more);
        if (status == STATUS_OK && !more)
            return text_fail(&stl->text, "the file ends here");
        if (status == STATUS_OK)
            status = text_real(&stl->text, &number);
        if (status != STATUS_OK)
            return status;
        if (!batch_set_coordinate(&stl->batch, axis, &number))
            return text_fail(&stl->text, "%c is not finite", "xyz"[axis]);
    }
    uint64_t vertex = batch_vertices(&stl->batch);
    if (vertex > UINT32_MAX - 2)
        return text_fail(&stl->text, "more corners than a mesh can have (4294967294)");
    enum status status = batch_corner(&stl->batch, (uint32_t)vertex);
    facet->corners++;
    return status == STATUS_OK ? batch_end_vertex(&stl->batch) : status;
}

static enum status read_statement(struct stl *stl, struct facet *facet, bool *is_in_solid)
{
    const unsigned char *word;
    size_t length;
    enum status status = text_word(&stl->text, &word, &length);
    if (status != STATUS_OK)
        return status;
    if (facet->is_open) {
        if (is_keyword(word, length, "vertex"))
            return read_text_corner(stl, facet);
        if (is_keyword(word, length, "outer"))
            return skip_words(stl, 1);
        if (is_keyword(word, length, "endloop"))
            return STATUS_OK;
        if (is_keyword(word, length, "endfacet")) {
            facet->is_open = false;
            facet->number++;
            stl->text.item_number = facet->number;
            return batch_end_face(&stl->batch, facet->corners);
        }
    } else if (is_keyword(word, length, "facet") && *is_in_solid) {
        facet->is_open = true;
        facet->corners = 0;
        return skip_words(stl, 4); /* "normal" and its three numbers */
    } else if (is_keyword(word, length, "solid") || is_keyword(word, length, "endsolid")) {
        *is_in_solid = length == 5;
        return text_skip_line(&stl->text); /* with the name */
    }
    char shown[24] = "";
    for (size_t i = 0; i < length && i + 1 < sizeof shown; i++)
        shown[i] = (char)(word[i] > ' ' && word[i] < 127 ? word[i] : '?');
    return text_fail(&stl->text, "\"%s\" is not expected here", shown);
}

static enum status read_text(struct stl *stl, const struct import_sink *sink)
{
    struct attributes none = {0};
    struct facet facet = {0};
    bool is_in_solid = false, more = true;
    enum status status = batch_open(&stl->batch, stl->ctx, sink, stl->name, &none, true, 0, 0);
    stl->text.item = "facet";
    while (status == STATUS_OK) {
        status = text_skip(&stl->text, &more);
        if (status != STATUS_OK || !more)
            break;
        status = read_statement(stl, &facet, &is_in_solid);
    }
    if (status == STATUS_OK && (facet.is_open || is_in_solid))
        return text_fail(&stl->text, "the file ends without endsolid");
    return status == STATUS_OK ? batch_finish(&stl->batch) : status;
}

enum status import_stl(struct context *ctx, struct instream *stream, const struct import_sink *sink)
{
    struct stl stl = {.ctx = ctx, .name = instream_name(stream)};
    const unsigned char *data;
    size_t size;
    enum status status = instream_peek(stream, STL_LOOK, &data, &size);
    bool is_text = status == STATUS_OK && stl_is_text(data, size < STL_LOOK ? size : STL_LOOK);
    if (status == STATUS_OK)
        status = text_open(&stl.text, ctx, stream, 0);
    if (status == STATUS_OK)
        status = is_text ? read_text(&stl, sink) : read_binary(&stl, sink);
    text_close(&stl.text);
    batch_close(&stl.batch);
    return status;
}
