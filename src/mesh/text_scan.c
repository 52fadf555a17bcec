/*
 * Tokens from a stream.
 *
 * Copying each line to a buffer of its own and splitting it there costs two more passes over the
 * bytes and stumbles over lines of any length. Here tokens are parsed where they lie in the
 * stream's buffer. A token that touches the end of the window may go on behind it: then, and only
 * then, the window is refilled from the token's beginning and the token parsed once more.
 *
 * Invariant: begin <= at <= end, and the stream's next byte is *begin.
 */
#include "mesh/text_scan.h"

#include <stdio.h>
#include <string.h>

enum status text_refill(struct text *text, size_t wanted)
{
    instream_take(text->stream, (size_t)(text->at - text->begin));
    text->begin = text->at;
    size_t available;
    enum status status = instream_peek(text->stream, wanted, &text->begin, &available);
    text->at = text->begin;
    text->end = text->begin + available;
    text->is_last = available < wanted;
    return status;
}

enum status text_reserve(struct text *text, size_t room)
{
    instream_take(text->stream, (size_t)(text->at - text->begin));
    text->begin = text->at;
    size_t available;
    enum status status = instream_reserve(text->stream, room, &text->begin, &available);
    text->at = text->begin;
    text->end = text->begin + available;
    return status;
}

enum status text_extend(struct text *text, size_t most, size_t *got)
{
    enum status status = instream_extend(text->stream, most, got);
    text->end += *got;
    return status;
}

enum status text_open(struct text *text, struct context *ctx, struct instream *stream,
                      unsigned char comment)
{
    *text = (struct text){.ctx = ctx, .stream = stream, .comment = comment, .line = 1};
    enum status status = text_refill(text, TEXT_WINDOW);
    if (status == STATUS_OK && text_available(text) >= 3 &&
        memcmp(text->at, "\xef\xbb\xbf", 3) == 0)
        text->at += 3;
    return status;
}

void text_leave(struct text *text)
{
    text_close(text);
    text->begin = text->end = text->at;
    text->is_last = false;
}

void text_close(struct text *text)
{
    if (text->begin)
        instream_take(text->stream, (size_t)(text->at - text->begin));
    text->begin = text->at;
}

enum status text_fail(struct text *text, const char *format, ...)
{
    char words[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(words, sizeof words, format, arguments);
    va_end(arguments);
    char item[64] = "";
    if (text->item)
        snprintf(item, sizeof item, "%s %llu: ", text->item, (unsigned long long)text->item_number);
    return fail(text->ctx, STATUS_BAD_INPUT, "%s: line %llu: %s%s", instream_name(text->stream),
                (unsigned long long)text->line, item, words);
}

bool word_is(const unsigned char *word, size_t length, const char *text)
{
    return strlen(text) == length && memcmp(word, text, length) == 0;
}

/* ---- skipping ---- */

/* From a comment's mark to its line's end, or as far as the window goes. */
static enum status skip_to_line_end(struct text *text)
{
    for (;;) {
        const unsigned char *found = memchr(text->at, '\n', text_available(text));
        text->at = found ? found : text->end;
        if (found || text->is_last)
            return STATUS_OK;
        enum status status = text_refill(text, TEXT_WINDOW);
        if (status != STATUS_OK)
            return status;
    }
}

/* At a backslash: if it ends its line, skips both and sets *joined. */
static enum status skip_joint(struct text *text, bool *joined)
{
    *joined = false;
    if (text_available(text) < 3 && !text->is_last) {
        enum status status = text_refill(text, TEXT_WINDOW);
        if (status != STATUS_OK)
            return status;
    }
    size_t size = text_available(text) > 1 && text->at[1] == '\r' ? 2 : 1;
    if (text_available(text) > size && text->at[size] == '\n') {
        text->at += size + 1;
        text->line++;
        *joined = true;
    } else if (text_available(text) == size && text->is_last) {
        text->at += size;
        *joined = true;
    }
    return STATUS_OK;
}

static enum status skip(struct text *text, bool stays_in_line, bool *more)
{
    *more = false;
    for (;;) {
        enum status status = STATUS_OK;
        while (text->at < text->end && is_blank(*text->at)) {
            if (*text->at == '\n') {
                if (stays_in_line)
                    return STATUS_OK;
                text->line++;
            }
            text->at++;
        }
        if (text->at < text->end) {
            bool goes_on = false;
            if (text->comment && *text->at == text->comment) {
                goes_on = true;
                status = skip_to_line_end(text);
            } else if (text->joins_lines && *text->at == '\\') {
                status = skip_joint(text, &goes_on);
            }
            *more = !goes_on;
            if (status != STATUS_OK || *more)
                return status;
        } else {
            if (text->is_last)
                return STATUS_OK;
            status = text_refill(text, TEXT_WINDOW);
            if (status != STATUS_OK)
                return status;
        }
    }
}

enum status text_skip(struct text *text, bool *more)
{
    return skip(text, false, more);
}

enum status text_skip_in_line(struct text *text, bool *more)
{
    return skip(text, true, more);
}

enum status text_skip_line(struct text *text)
{
    enum status status = skip_to_line_end(text);
    if (status == STATUS_OK && text->at < text->end) {
        text->at++;
        text->line++;
    }
    return status;
}

enum status text_line(struct text *text, size_t limit, const unsigned char **line, size_t *length,
                      bool *more)
{
    const unsigned char *found;
    *more = false;
    while (!(found = memchr(text->at, '\n', text_available(text))) && !text->is_last) {
        if (text_available(text) >= limit)
            return text_fail(text, "a line of more than %zu characters", limit);
        enum status status = text_refill(text, 2 * text_available(text) + TEXT_WINDOW);
        if (status != STATUS_OK)
            return status;
    }
    const unsigned char *stop = found ? found : text->end;
    *line = text->at;
    *length = (size_t)(stop - text->at);
    *more = stop > text->at || found;
    if (*length > 0 && (*line)[*length - 1] == '\r')
        --*length;
    text->at = found ? found + 1 : stop;
    text->line += found != NULL;
    return STATUS_OK;
}

/* ---- tokens ---- */

static bool ends_token(const struct text *text, unsigned char c)
{
    return is_blank(c) || (text->comment && c == text->comment) || (text->joins_lines && c == '\\');
}

/* Makes the whole token at `at` visible and finds its end. */
static enum status whole_token(struct text *text, const unsigned char **stop)
{
    for (;;) {
        const unsigned char *at = text->at;
        while (at < text->end && !ends_token(text, *at))
            at++;
        *stop = at;
        if (at - text->at > TEXT_TOKEN_MAX)
            return text_fail(text, "a word of more than %d characters", TEXT_TOKEN_MAX);
        if (at < text->end || text->is_last)
            return STATUS_OK;
        enum status status = text_refill(text, TEXT_WINDOW);
        if (status != STATUS_OK)
            return status;
    }
}

enum status text_word(struct text *text, const unsigned char **word, size_t *length)
{
    const unsigned char *stop;
    enum status status = whole_token(text, &stop);
    *word = text->at;
    *length = status == STATUS_OK ? (size_t)(stop - text->at) : 0;
    if (status == STATUS_OK)
        text->at = stop;
    return status;
}

/* The beginning of a token that is not what it should be, for a message. */
static enum status refuse_token(struct text *text, const unsigned char *stop, const char *wanted)
{
    char shown[32];
    size_t length = (size_t)(stop - text->at), size = length < 24 ? length : 24;
    if (length == 0)
        return text_fail(text, "%s is missing", wanted);
    for (size_t i = 0; i < size; i++)
        shown[i] = (char)(text->at[i] > ' ' && text->at[i] < 127 ? text->at[i] : '?');
    strcpy(shown + size, size < length ? "..." : "");
    return text_fail(text, "\"%s\" is not %s", shown, wanted);
}

enum status text_real_slowly(struct text *text, struct parsed_number *number)
{
    const unsigned char *stop;
    enum status status = whole_token(text, &stop);
    if (status != STATUS_OK)
        return status;
    if (parse_real(text->at, stop, number) != stop || stop == text->at)
        return refuse_token(text, stop, "a number");
    text->at = stop;
    return STATUS_OK;
}

enum status text_integer(struct text *text, int64_t *value)
{
    const unsigned char *stop;
    enum status status = whole_token(text, &stop);
    if (status != STATUS_OK)
        return status;
    if (parse_integer(text->at, stop, value) != stop || stop == text->at)
        return refuse_token(text, stop, "an integer");
    text->at = stop;
    return STATUS_OK;
}

enum status text_index_slowly(struct text *text, uint32_t *value)
{
    const unsigned char *stop;
    enum status status = whole_token(text, &stop);
    if (status != STATUS_OK)
        return status;
    if (parse_index(text->at, stop, value) != stop || stop == text->at)
        return refuse_token(text, stop, "an index");
    text->at = stop;
    return STATUS_OK;
}
