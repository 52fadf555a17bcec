/*
 * Reading a PLY header, line by line. Lines end with \n or \r\n; files whose header lines end with
 * \r alone (old Macintosh programs) are understood too. Words may be apart by any blanks.
 */
#include "mesh/ply_header.h"

#include <stdio.h>
#include <string.h>

#include "base/memory.h"

enum { LINE_MAX_LENGTH = 64 << 10, HEADER_LINES_MAX = 100000, WORDS_MAX = 5 };

struct words {
    unsigned count; /* WORDS_MAX + 1 when there are more */
    const unsigned char *word[WORDS_MAX];
    size_t length[WORDS_MAX];
};

static void split(const unsigned char *line, size_t length, struct words *words)
{
    words->count = 0;
    for (size_t i = 0; i < length;) {
        while (i < length && is_blank(line[i]))
            i++;
        size_t start = i;
        while (i < length && !is_blank(line[i]))
            i++;
        if (i == start)
            break;
        if (words->count == WORDS_MAX) {
            words->count++;
            break;
        }
        words->word[words->count] = line + start;
        words->length[words->count++] = i - start;
    }
}

static bool is_word(const struct words *words, unsigned i, const char *text)
{
    return i < words->count && word_is(words->word[i], words->length[i], text);
}

/* The message names the line before the one the scanner is at. */
static enum status refuse_line(struct text *text, const char *reason)
{
    if (text->line > 1)
        text->line--;
    return text_fail(text, "%s", reason);
}

static enum status copy_name(struct text *text, const struct words *words, unsigned i, char *name)
{
    if (words->length[i] > PLY_NAME_MAX)
        return refuse_line(text, "a name of more than 255 characters");
    for (unsigned k = 0; k < words->length[i]; k++)
        if ((unsigned char)words->word[i][k] <= ' ' || words->word[i][k] == 127)
            return refuse_line(text, "a name with characters that are no text");
    memcpy(name, words->word[i], words->length[i]);
    name[words->length[i]] = 0;
    return STATUS_OK;
}

static bool find_type(const struct words *words, unsigned i, enum scalar_type *type)
{
    static const char *const names[][2] = {
        {"char", "int8"}, {"uchar", "uint8"}, {"short", "int16"},   {"ushort", "uint16"},
        {"int", "int32"}, {"uint", "uint32"}, {"float", "float32"}, {"double", "float64"}};
    for (unsigned t = 0; t < sizeof names / sizeof *names; t++)
        if (is_word(words, i, names[t][0]) || is_word(words, i, names[t][1])) {
            *type = (enum scalar_type)t;
            return true;
        }
    return false;
}

static enum status read_format(struct text *text, const struct words *words,
                               struct ply_header *header)
{
    static const char *const names[] = {"ascii", "binary_little_endian", "binary_big_endian"};
    unsigned format = 0;
    while (format < 3 && !is_word(words, 1, names[format]))
        format++;
    if (format == 3 || words->count != 3)
        return refuse_line(text, "the format is not ascii, binary_little_endian or "
                                 "binary_big_endian with a version");
    if (!is_word(words, 2, "1.0"))
        return refuse_line(text, "a version of PLY other than 1.0");
    header->format = (enum ply_format)format;
    return STATUS_OK;
}

static enum status read_element(struct text *text, const struct words *words,
                                struct ply_header *header)
{
    int64_t count;
    if (words->count != 3 ||
        parse_integer(words->word[2], words->word[2] + words->length[2], &count) !=
            words->word[2] + words->length[2] ||
        count < 0)
        return refuse_line(text, "an element without a name and a count");
    if (header->element_count == PLY_ELEMENT_MAX)
        return refuse_line(text, "more than 64 elements");
    struct ply_element *element = &header->elements[header->element_count];
    *element =
        (struct ply_element){.count = (uint64_t)count, .first_property = header->property_count};
    enum status status = copy_name(text, words, 1, element->name);
    if (status != STATUS_OK)
        return status;
    if (ply_find_element(header, element->name))
        return refuse_line(text, "an element of this name is there already");
    header->element_count++;
    return STATUS_OK;
}

static enum status read_property(struct text *text, const struct words *words,
                                 struct ply_header *header)
{
    if (header->element_count == 0)
        return refuse_line(text, "a property before the first element");
    if (header->property_count == PLY_PROPERTY_MAX)
        return refuse_line(text, "more than 1024 properties");
    struct ply_element *element = &header->elements[header->element_count - 1];
    struct ply_property property = {.is_list = is_word(words, 1, "list")};
    unsigned name = property.is_list ? 4 : 2;
    if (words->count != name + 1)
        return refuse_line(text, "a property without a type and a name");
    if (!find_type(words, name - 1, &property.type) ||
        (property.is_list && !find_type(words, 2, &property.count_type)))
        return refuse_line(text, "a property of an unknown type");
    if (property.is_list && property.count_type >= SCALAR_FLOAT32)
        return refuse_line(text, "a list whose size is not an integer");
    enum status status = copy_name(text, words, name, property.name);
    if (status != STATUS_OK)
        return status;
    if (ply_find_property(header, element, property.name))
        return refuse_line(text, "a property of this name is there already");
    status = memory_reserve(text->ctx, &header->properties, &header->property_capacity,
                            header->property_count + 1, sizeof *header->properties);
    if (status != STATUS_OK)
        return status;
    header->properties[header->property_count++] = property;
    element->property_count++;
    element->has_lists |= property.is_list;
    element->row_size += scalar_size(property.is_list ? property.count_type : property.type);
    return STATUS_OK;
}

/* A line of the header, whose lines end with \r alone if `is_mac`. */
static enum status header_line(struct text *text, bool is_mac, const unsigned char **line,
                               size_t *length)
{
    bool more = true;
    enum status status = STATUS_OK;
    if (is_mac) {
        const unsigned char *found = memchr(text->at, '\r', text_available(text));
        if (!found && !text->is_last) {
            status = text_refill(text, LINE_MAX_LENGTH);
            if (status != STATUS_OK)
                return status;
            found = memchr(text->at, '\r', text_available(text));
        }
        more = found != NULL;
        *line = text->at;
        *length = found ? (size_t)(found - text->at) : 0;
        text->at += found ? *length + 1 : 0;
        text->line += more;
    } else {
        status = text_line(text, LINE_MAX_LENGTH, line, length, &more);
    }
    if (status == STATUS_OK && !more)
        return text_fail(text, "the file ends within the header");
    return status;
}

/* The first line, "ply", behind any blank ones; tells how lines end. */
static enum status read_magic(struct text *text, bool *is_mac)
{
    bool more;
    enum status status = text_skip(text, &more);
    if (status != STATUS_OK)
        return status;
    if (text_available(text) < 5 && !text->is_last)
        status = text_refill(text, TEXT_WINDOW);
    if (status != STATUS_OK)
        return status;
    size_t available = text_available(text);
    if (available < 4 || memcmp(text->at, "ply", 3) != 0 || !is_blank(text->at[3]))
        return text_fail(text, "not a PLY file: it does not begin with \"ply\"");
    *is_mac = text->at[3] == '\r' && (available < 5 || text->at[4] != '\n');
    const unsigned char *line;
    size_t length;
    return header_line(text, *is_mac, &line, &length);
}

enum status ply_header_read(struct text *text, struct ply_header *header)
{
    memset(header, 0, sizeof *header);
    bool is_mac = false, has_format = false;
    enum status status = read_magic(text, &is_mac);
    for (unsigned lines = 0; status == STATUS_OK; lines++) {
        const unsigned char *line;
        size_t length;
        struct words words;
        status = header_line(text, is_mac, &line, &length);
        if (status != STATUS_OK)
            break;
        split(line, length, &words);
        if (lines > HEADER_LINES_MAX) {
            status = refuse_line(text, "the header does not end");
        } else if (is_word(&words, 0, "format")) {
            has_format = true;
            status = read_format(text, &words, header);
        } else if (is_word(&words, 0, "element")) {
            status = read_element(text, &words, header);
        } else if (is_word(&words, 0, "property")) {
            status = read_property(text, &words, header);
        } else if (is_word(&words, 0, "end_header")) {
            if (!has_format)
                status = refuse_line(text, "the header ends without a format line");
            break;
        } else if (words.count && !is_word(&words, 0, "comment") &&
                   !is_word(&words, 0, "obj_info")) {
            status = refuse_line(text, "not a line of a PLY header (element, property, comment, "
                                       "obj_info, end_header)");
        }
    }
    return status;
}

void ply_header_clear(struct context *ctx, struct ply_header *header)
{
    memory_release(ctx, &header->properties, header->property_capacity, sizeof *header->properties);
    memset(header, 0, sizeof *header);
}

const struct ply_element *ply_find_element(const struct ply_header *header, const char *name)
{
    for (uint32_t i = 0; i < header->element_count; i++)
        if (strcmp(header->elements[i].name, name) == 0)
            return &header->elements[i];
    return NULL;
}

const struct ply_property *ply_find_property(const struct ply_header *header,
                                             const struct ply_element *element, const char *name)
{
    for (uint32_t i = 0; i < element->property_count; i++) {
        const struct ply_property *property = &header->properties[element->first_property + i];
        if (strcmp(property->name, name) == 0)
            return property;
    }
    return NULL;
}
