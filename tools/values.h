/*
 * Values on the command line and in reports: reading sizes, counts, fractions and lists of them,
 * finding the nearest known word, writing numbers for people.
 */
#ifndef SPBM_TOOLS_VALUES_H
#define SPBM_TOOLS_VALUES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* All readers take the whole text or return false; *value is then untouched. */

/* A size in bytes: K, M, G, T are binary ("512M", "1.5G", "64KiB"). Not 0. */
bool read_size(const char *text, uint64_t *value);
/* A count: k, M, G are decimal, either case ("12700", "12.7k", "1M"). */
bool read_count(const char *text, uint64_t *value);
/* A plain number, finite, not negative. */
bool read_number(const char *text, double *value);
/* A ratio in (0,1], or a percentage in (0,100] ("0.05", "5%"). */
bool read_ratio(const char *text, double *value);
/* A length, or with % a fraction of the diagonal ("0.02", "0.1%"). */
bool read_length(const char *text, double *value, bool *is_relative);
/* A colour as RRGGBB, with or without #. */
bool read_colour(const char *text, uint32_t *value);

/* Cuts a list at its commas: copies item `index` into `item` (`size` bytes). False when there is
 * none, it is empty, or too long. */
bool list_item(const char *list, size_t index, char *item, size_t size);
size_t list_length(const char *list);

/* How many letters must be changed, added, dropped or swapped to get from one word to the other. */
unsigned word_distance(const char *from, const char *to);
/* Whether a word at that distance is near enough to be what was meant. */
bool is_near(const char *word, unsigned distance);

/* Numbers for people. The text lives as long as the expression it is written in. */
struct text {
    char s[48];
};

struct text count_text(uint64_t count);    /* 1,087,716 */
struct text size_text(uint64_t bytes);     /* 61.2 MiB */
struct text seconds_text(double seconds);  /* 0.34 s, 12.1 s, 3 min 20 s */
struct text length_text(double length);    /* four digits */
struct text percent_text(double fraction); /* 0.15 % */
/* "1 face", "12 faces"; the words have at most 15 letters. */
struct text counted_text(uint64_t count, const char *one, const char *many);

#endif
