/*
 * Reading a stream as text, token by token, with line numbers for messages. Also the window onto a
 * stream that binary readers use.
 *
 * Pointers into the window are valid until the next call that may refill it; every call that takes
 * a token may. Blanks are space, tab, vertical tab, form feed and carriage return; lines end with
 * \n. A comment runs from its mark to the end of the line and counts as blank. In OBJ a backslash
 * at the end of a line joins the next one to it.
 */
#ifndef SPBM_MESH_TEXT_SCAN_H
#define SPBM_MESH_TEXT_SCAN_H

#include "base/instream.h"
#include "mesh/parse_number.h"

struct text {
    struct context *ctx;
    struct instream *stream;
    const unsigned char *begin; /* the window: taken from the stream when it is refilled */
    const unsigned char *at;    /* the next byte; [at, end) is to be read */
    const unsigned char *end;
    bool is_last;          /* nothing follows in the stream */
    unsigned char comment; /* the mark, or 0 */
    bool joins_lines;      /* backslash, as in OBJ */
    uint64_t line;         /* of `at`, from 1 */
    const char *item;      /* what is being read, for messages: "face"; NULL: nothing to name */
    uint64_t item_number;
};

enum { TEXT_TOKEN_MAX = NUMBER_LENGTH_MAX, TEXT_WINDOW = 4096 };

/* Begins at the stream's next byte; a UTF-8 byte order mark is skipped. */
enum status text_open(struct text *text, struct context *ctx, struct instream *stream,
                      unsigned char comment) MUST_CHECK;
/* Tells the stream how far the reading came. */
void text_close(struct text *text);

/* The stream's next byte is `at`, and nothing is in the window, so that others may read on. */
void text_leave(struct text *text);
/* At least `wanted` bytes from `at` on, or all that are left. */
enum status text_refill(struct text *text, size_t wanted) MUST_CHECK;
/* For threads that share the window (instream_reserve, instream_extend): room for so many bytes,
 * and further bytes behind `end`, while others look at those before it. */
enum status text_reserve(struct text *text, size_t room) MUST_CHECK;
enum status text_extend(struct text *text, size_t most, size_t *got) MUST_CHECK;

static inline size_t text_available(const struct text *text)
{
    return (size_t)(text->end - text->at);
}

/* STATUS_BAD_INPUT "<name>: line <n>: <words>", with item and number before the words if set. */
enum status text_fail(struct text *text, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* Skips blanks, comments and line ends; *more is false at the end of the stream. */
enum status text_skip(struct text *text, bool *more) MUST_CHECK;
/* Skips blanks and comments within the line; *more is false at its end. */
enum status text_skip_in_line(struct text *text, bool *more) MUST_CHECK;
/* To the beginning of the next line. */
enum status text_skip_line(struct text *text) MUST_CHECK;
/* The rest of the line without its end (and a carriage return there); goes to the next line. The
 * line must be shorter than `limit`. *more is false when the stream is at its end. */
enum status text_line(struct text *text, size_t limit, const unsigned char **line, size_t *length,
                      bool *more) MUST_CHECK;

/* At a token, these take it; a token that is not what is asked for is an error that shows it.
 * A token ends at a blank, a line end, a comment, or the end of the stream. */
enum status text_word(struct text *text, const unsigned char **word, size_t *length) MUST_CHECK;
enum status text_real_slowly(struct text *text, struct parsed_number *number) MUST_CHECK;
enum status text_integer(struct text *text, int64_t *value) MUST_CHECK;
enum status text_index_slowly(struct text *text, uint32_t *value) MUST_CHECK;

/* True if the word equals the text. */
bool word_is(const unsigned char *word, size_t length, const char *text);

static inline bool is_blank(unsigned char c)
{
    return c == ' ' || (unsigned char)(c - '\t') < 5;
}

/* ---- the quick ways, for what is whole in the window ---- */

/* Skips blanks and line ends; true at a token that is not a comment. False: use text_skip. */
static inline bool text_skip_quickly(struct text *text)
{
    const unsigned char *at = text->at, *end = text->end;
    while (at < end && is_blank(*at))
        text->line += *at++ == '\n';
    text->at = at;
    return at < end && *at != text->comment && *at != '\\';
}

/* Skips spaces; true at a token on this line that is not a comment. False: use text_skip_in_line.
 */
static inline bool text_skip_in_line_quickly(struct text *text)
{
    const unsigned char *at = text->at, *end = text->end;
    while (at < end && *at == ' ')
        at++;
    text->at = at;
    return at < end && !is_blank(*at) && *at != text->comment && *at != '\\';
}

/* A token that is a real number; skips nothing in front. */
static inline enum status text_real(struct text *text, struct parsed_number *number)
{
    const unsigned char *stop = parse_real(text->at, text->end, number);
    if (stop && stop < text->end && is_blank(*stop)) {
        text->at = stop;
        return STATUS_OK;
    }
    return text_real_slowly(text, number);
}

/* A token of digits only. */
static inline enum status text_index(struct text *text, uint32_t *value)
{
    const unsigned char *stop = parse_index(text->at, text->end, value);
    if (stop && stop < text->end && is_blank(*stop)) {
        text->at = stop;
        return STATUS_OK;
    }
    return text_index_slowly(text, value);
}

#endif
