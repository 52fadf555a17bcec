/*
 * Which format is it? Names lie and standard input has none, so the content decides: each format
 * has something that must stand at its beginning. PLY and our own files begin with fixed bytes, OFF
 * with a keyword, text STL with "solid" and then a facet; OBJ has only its statements. Binary STL
 * has nothing at all, so it is asked last, and must look plausible.
 */
#include "mesh/import.h"

#include <string.h>

#include "mesh/stl_kind.h"
#include "mesh/text_scan.h"

enum { LOOK_FIRST = STL_LOOK, LOOK_MOST = 1 << 20 };

static const char store_magic[] = "spbmMSH1", chain_magic[] = "spbmCHN1";

static bool begins_with(const unsigned char *data, size_t size, const char *word)
{
    return size >= strlen(word) && memcmp(data, word, strlen(word)) == 0;
}

/* [ST][C][N][4][n]OFF, then a blank or the end. */
static bool is_off_keyword(const unsigned char *at, const unsigned char *end)
{
    static const char *const parts[] = {"ST", "C", "N", "4", "n"};
    for (unsigned i = 0; i < sizeof parts / sizeof *parts; i++)
        if (begins_with(at, (size_t)(end - at), parts[i]))
            at += strlen(parts[i]);
    return begins_with(at, (size_t)(end - at), "OFF") && (end - at == 3 || is_blank(at[3]));
}

static bool is_obj_statement(const unsigned char *at, const unsigned char *end)
{
    static const char *const words[] = {"v", "vt", "vn", "vp", "f",      "g",
                                        "o", "s",  "l",  "p",  "usemtl", "mtllib"};
    const unsigned char *stop = at;
    while (stop < end && !is_blank(*stop))
        stop++;
    for (unsigned i = 0; i < sizeof words / sizeof *words; i++)
        if (word_is(at, (size_t)(stop - at), words[i]))
            return true;
    return false;
}

/* To the first byte that is neither blank nor in a comment. */
static const unsigned char *skip_comments(const unsigned char *at, const unsigned char *end)
{
    while (at < end) {
        if (is_blank(*at)) {
            at++;
        } else if (*at == '#') {
            const unsigned char *line_end = memchr(at, '\n', (size_t)(end - at));
            at = line_end ? line_end : end;
        } else {
            break;
        }
    }
    return at;
}

static enum mesh_format guess(const unsigned char *data, size_t size, bool is_all)
{
    const unsigned char *at = data, *end = data + size;
    if (begins_with(at, size, store_magic))
        return FORMAT_STORE;
    if (size >= 3 && memcmp(at, "\xef\xbb\xbf", 3) == 0)
        at += 3;
    at = skip_comments(at, end);
    size_t left = (size_t)(end - at);
    if (begins_with(at, left, "ply") && (left == 3 || is_blank(at[3])))
        return FORMAT_PLY;
    if (is_off_keyword(at, end))
        return FORMAT_OFF;
    if (is_obj_statement(at, end))
        return FORMAT_OBJ;
    size_t look = size < STL_LOOK ? size : STL_LOOK;
    if (stl_is_text(data, look) || stl_is_binary(data, look, is_all && look == size))
        return FORMAT_STL;
    return FORMAT_UNKNOWN;
}

enum status import_probe(struct context *ctx, struct instream *stream, enum mesh_format *format)
{
    (void)ctx; /* the stream has it */
    *format = FORMAT_UNKNOWN;
    for (size_t wanted = LOOK_FIRST; wanted <= LOOK_MOST; wanted *= 16) {
        const unsigned char *data;
        size_t size;
        enum status status = instream_peek(stream, wanted, &data, &size);
        if (status != STATUS_OK)
            return status;
        bool is_all = size < wanted;
        *format = guess(data, size, is_all);
        /* More is looked at only if all of this is comments. */
        if (*format != FORMAT_UNKNOWN || is_all || skip_comments(data, data + size) < data + size)
            break;
    }
    return STATUS_OK;
}

/* Takes all that the reader left, so that digest and size are those of the whole input and damage
 * at the end of a gzip file is found. */
static enum status drain(struct instream *stream)
{
    for (;;) {
        const unsigned char *data;
        size_t size;
        enum status status = instream_peek(stream, 1, &data, &size);
        if (status != STATUS_OK || size == 0)
            return status;
        instream_take(stream, size);
    }
}

static enum status refuse_unknown(struct context *ctx, struct instream *stream)
{
    const char *name = instream_name(stream);
    const unsigned char *data;
    size_t size;
    enum status status = instream_peek(stream, 8, &data, &size);
    if (status != STATUS_OK)
        return status;
    if (size == 0)
        return fail(ctx, STATUS_BAD_INPUT, "%s: the file is empty", name);
    if (begins_with(data, size, chain_magic))
        return fail(ctx, STATUS_BAD_INPUT, "%s: is a chain file, not a mesh; spbm lod reads it",
                    name);
    return fail(ctx, STATUS_BAD_INPUT,
                "%s: not a mesh in PLY, OBJ, STL or OFF: its beginning is of "
                "none of these formats",
                name);
}

enum status import_read(struct context *ctx, struct instream *stream,
                        const struct import_sink *sink)
{
    enum mesh_format format;
    enum status status = import_probe(ctx, stream, &format);
    if (status != STATUS_OK)
        return status;
    switch (format) {
    case FORMAT_PLY:
        status = import_ply(ctx, stream, sink);
        break;
    case FORMAT_OBJ:
        status = import_obj(ctx, stream, sink);
        break;
    case FORMAT_STL:
        status = import_stl(ctx, stream, sink);
        break;
    case FORMAT_OFF:
        status = import_off(ctx, stream, sink);
        break;
    case FORMAT_STORE:
        return fail(ctx, STATUS_BAD_INPUT, "%s: is a mesh store already, not a mesh file",
                    instream_name(stream));
    case FORMAT_UNKNOWN:
        return refuse_unknown(ctx, stream);
    }
    return status == STATUS_OK ? drain(stream) : status;
}
