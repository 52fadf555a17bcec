/*
 * Reading and writing numbers as people do. strtod alone would take "0x10", "inf", "nan" and a
 * number with letters behind it; here what is not wholly a number of the expected kind is refused.
 */
#include "values.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

/* A decimal number at the front of `text`; NULL if there is none. */
static const char *read_decimal(const char *text, double *value)
{
    const char *digits = *text == '.' ? text + 1 : text;
    if (!isdigit((unsigned char)*digits) || (text[0] == '0' && (text[1] | 32) == 'x'))
        return NULL;
    char *end;
    errno = 0;
    double number = strtod(text, &end);
    if (!isfinite(number))
        return NULL;
    *value = number;
    return end;
}

bool read_number(const char *text, double *value)
{
    double number;
    const char *end = read_decimal(text, &number);
    if (!end || *end)
        return false;
    *value = number;
    return true;
}

/* A whole number of units; fractions of a unit must come out whole within rounding. */
static bool whole(double number, double unit, uint64_t *value)
{
    double product = number * unit;
    double rounded = floor(product + 0.5);
    if (!(rounded <= 9007199254740992.0) || fabs(product - rounded) > 1e-6 * unit)
        return false;
    *value = (uint64_t)rounded;
    return true;
}

bool read_size(const char *text, uint64_t *value)
{
    static const char letters[] = "kmgt";
    double number, unit = 1;
    const char *end = read_decimal(text, &number);
    if (!end)
        return false;
    const char *letter = *end ? strchr(letters, tolower((unsigned char)*end)) : NULL;
    if (letter) {
        unit = ldexp(1.0, 10 * (int)(letter - letters + 1));
        end++;
        if (*end == 'i')
            end++;
    }
    if (*end == 'b' || *end == 'B')
        end++;
    double bytes = floor(number * unit);
    if (*end || !(bytes >= 1 && bytes <= 9007199254740992.0))
        return false;
    *value = (uint64_t)bytes;
    return true;
}

bool read_count(const char *text, uint64_t *value)
{
    double number, unit = 1;
    const char *end = read_decimal(text, &number);
    if (!end)
        return false;
    switch (*end) {
    case 'k':
    case 'K':
        unit = 1e3;
        break;
    case 'm':
    case 'M':
        unit = 1e6;
        break;
    case 'g':
    case 'G':
        unit = 1e9;
        break;
    default:
        break;
    }
    if (unit > 1)
        end++;
    return *end == '\0' && whole(number, unit, value);
}

bool read_ratio(const char *text, double *value)
{
    double number;
    const char *end = read_decimal(text, &number);
    if (!end)
        return false;
    if (*end == '%') {
        number /= 100;
        end++;
    }
    if (*end || !(number > 0 && number <= 1))
        return false;
    *value = number;
    return true;
}

bool read_length(const char *text, double *value, bool *is_relative)
{
    double number;
    const char *end = read_decimal(text, &number);
    if (!end)
        return false;
    bool percent = *end == '%';
    if (end[percent])
        return false;
    *value = percent ? number / 100 : number;
    *is_relative = percent;
    return true;
}

bool read_colour(const char *text, uint32_t *value)
{
    if (*text == '#')
        text++;
    if (strlen(text) != 6 || strspn(text, "0123456789abcdefABCDEF") != 6)
        return false;
    *value = (uint32_t)strtoul(text, NULL, 16);
    return true;
}

size_t list_length(const char *list)
{
    size_t count = 1;
    for (; *list; list++)
        count += *list == ',';
    return count;
}

bool list_item(const char *list, size_t index, char *item, size_t size)
{
    for (; index > 0; index--) {
        list = strchr(list, ',');
        if (!list)
            return false;
        list++;
    }
    size_t length = strcspn(list, ",");
    if (length == 0 || length >= size)
        return false;
    memcpy(item, list, length);
    item[length] = '\0';
    return true;
}

unsigned word_distance(const char *from, const char *to)
{
    enum { LONGEST = 40 };
    unsigned rows[3][LONGEST + 1];
    size_t from_length = strlen(from), to_length = strlen(to);
    if (from_length > LONGEST || to_length > LONGEST)
        return LONGEST;
    for (size_t j = 0; j <= to_length; j++)
        rows[0][j] = (unsigned)j;
    for (size_t i = 1; i <= from_length; i++) {
        unsigned *row = rows[i % 3], *above = rows[(i + 2) % 3], *two_above = rows[(i + 1) % 3];
        row[0] = (unsigned)i;
        for (size_t j = 1; j <= to_length; j++) {
            unsigned best = above[j - 1] + (from[i - 1] != to[j - 1]);
            if (above[j] + 1 < best)
                best = above[j] + 1;
            if (row[j - 1] + 1 < best)
                best = row[j - 1] + 1;
            if (i > 1 && j > 1 && from[i - 1] == to[j - 2] && from[i - 2] == to[j - 1] &&
                two_above[j - 2] + 1 < best)
                best = two_above[j - 2] + 1;
            row[j] = best;
        }
    }
    return rows[from_length % 3][to_length];
}

bool is_near(const char *word, unsigned distance)
{
    return distance <= 1 + strlen(word) / 4;
}

struct text count_text(uint64_t count)
{
    char digits[24];
    struct text text = {""};
    int length = snprintf(digits, sizeof digits, "%llu", (unsigned long long)count);
    size_t used = 0;
    for (int i = 0; i < length; i++) {
        if (i > 0 && (length - i) % 3 == 0)
            text.s[used++] = ',';
        text.s[used++] = digits[i];
    }
    text.s[used] = '\0';
    return text;
}

struct text size_text(uint64_t bytes)
{
    static const char *const units[] = {"bytes", "KiB", "MiB", "GiB", "TiB"};
    struct text text;
    double value = (double)bytes;
    unsigned unit = 0;
    while (value >= 1024 && unit < 4) {
        value /= 1024;
        unit++;
    }
    snprintf(text.s, sizeof text.s, unit == 0 || value >= 100 ? "%.0f %s" : "%.1f %s", value,
             units[unit]);
    return text;
}

struct text seconds_text(double seconds)
{
    struct text text;
    if (seconds < 10)
        snprintf(text.s, sizeof text.s, "%.2f s", seconds);
    else if (seconds < 120)
        snprintf(text.s, sizeof text.s, "%.1f s", seconds);
    else if (seconds < 7200)
        snprintf(text.s, sizeof text.s, "%d min %d s", (int)(seconds / 60), (int)seconds % 60);
    else
        snprintf(text.s, sizeof text.s, "%.0f h %d min", floor(seconds / 3600),
                 (int)fmod(seconds / 60, 60));
    return text;
}

struct text length_text(double length)
{
    struct text text;
    snprintf(text.s, sizeof text.s, "%.4g", length);
    return text;
}

struct text percent_text(double fraction)
{
    struct text text;
    snprintf(text.s, sizeof text.s, "%.3g %%", 100 * fraction);
    return text;
}

struct text counted_text(uint64_t count, const char *one, const char *many)
{
    struct text text;
    snprintf(text.s, sizeof text.s, "%.30s %.15s", count_text(count).s, count == 1 ? one : many);
    return text;
}
