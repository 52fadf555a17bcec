/*
 * A stable radix sort that knows the memory hierarchy.
 *
 * Comparing costs log n mispredicted branches a record. A radix sort from the least significant
 * digit costs one pass a digit, but each pass scatters over all of the memory. Here one pass by the
 * most significant digit that varies cuts the records into 256 buckets, and each bucket, now small
 * enough for a cache, is sorted from its least significant digit on: the same number of passes, all
 * but the first in the cache, and buckets are jobs for threads. (The idea of one digit first and
 * the rest in cache is that of Knuth, The Art of Computer Programming 3, section 5.2.5, "hybrid".)
 *
 * Which bits vary at all is found first; digits of equal bits cost nothing.
 *
 * Invariant: after the pass over a digit, records are in stable order by that digit and all less
 * significant ones of their bucket.
 */
#include "base/radix_sort.h"

#include <string.h>

#include "base/bytes.h"
#include "base/parallel.h"

enum {
    DIGIT_BITS = 8,
    DIGIT_VALUES = 1 << DIGIT_BITS,
    MOST_DIGITS = 16, /* of a key of 128 bits */
    SMALL = 24,       /* records that are sorted by insertion */
    ALONE = 1 << 14   /* records that are not worth a cut into buckets */
};

struct digit {
    unsigned at; /* byte of the record where its word begins */
    unsigned shift;
};

struct sort {
    unsigned char *from, *to; /* before and after an odd number of passes */
    size_t record_size;
    unsigned key_words;
    struct digit digits[MOST_DIGITS]; /* least significant first */
    unsigned digit_count;
    size_t bucket_begin[DIGIT_VALUES + 1]; /* records */
    unsigned char *result;
};

static inline unsigned digit_of(const unsigned char *record, struct digit digit)
{
    return (unsigned)(load_u64(record + digit.at) >> digit.shift) & (DIGIT_VALUES - 1);
}

/* Which bits of the key differ between any two records. */
static void find_varying(const unsigned char *records, size_t count, size_t record_size,
                         unsigned key_words, uint64_t varying[2])
{
    for (unsigned word = 0; word < key_words; word++) {
        uint64_t first = load_u64(records + 8 * (size_t)word);
        uint64_t differ = 0;
        for (size_t i = 1; i < count; i++)
            differ |= load_u64(records + i * record_size + 8 * (size_t)word) ^ first;
        varying[word] = differ;
    }
}

/* Digits that cover the varying bits, laid from the highest such bit of each word downwards, so
 * that the most significant digit has as many values as it can. */
static void choose_digits(struct sort *sort, const uint64_t varying[2])
{
    struct digit found[MOST_DIGITS];
    unsigned count = 0;
    for (unsigned word = 0; word < sort->key_words; word++) {
        uint64_t left = varying[word];
        while (left) {
            int top = 63 - __builtin_clzll(left);
            unsigned shift = top < DIGIT_BITS ? 0 : (unsigned)top - (DIGIT_BITS - 1);
            found[count++] = (struct digit){.at = 8 * word, .shift = shift};
            left &= ((uint64_t)1 << shift) - 1;
        }
    }
    for (unsigned i = 0; i < count; i++)
        sort->digits[i] = found[count - 1 - i];
    sort->digit_count = count;
}

/* Begins of the 256 values from their counts; true when one value has all records. */
static bool counts_to_begins(size_t counts[DIGIT_VALUES], size_t records)
{
    size_t begin = 0;
    for (unsigned value = 0; value < DIGIT_VALUES; value++) {
        size_t here = counts[value];
        if (here == records)
            return true;
        counts[value] = begin;
        begin += here;
    }
    return false;
}

/* One stable pass. Inlined with constant sizes, so that a record is moved by a few instructions. */
static inline __attribute__((always_inline)) void
scatter_sized(const unsigned char *from, unsigned char *to, size_t count, size_t record_size,
              struct digit digit, size_t begins[DIGIT_VALUES])
{
    for (size_t i = 0; i < count; i++) {
        const unsigned char *record = from + i * record_size;
        memcpy(to + begins[digit_of(record, digit)]++ * record_size, record, record_size);
    }
}

static void scatter(const unsigned char *from, unsigned char *to, size_t count, size_t record_size,
                    struct digit digit, size_t begins[DIGIT_VALUES])
{
    switch (record_size) {
    case 8:
        scatter_sized(from, to, count, 8, digit, begins);
        break;
    case 12:
        scatter_sized(from, to, count, 12, digit, begins);
        break;
    case 16:
        scatter_sized(from, to, count, 16, digit, begins);
        break;
    case 20:
        scatter_sized(from, to, count, 20, digit, begins);
        break;
    case 24:
        scatter_sized(from, to, count, 24, digit, begins);
        break;
    case 32:
        scatter_sized(from, to, count, 32, digit, begins);
        break;
    default:
        scatter_sized(from, to, count, record_size, digit, begins);
        break;
    }
}

/* Counts of all digits below `digit_count`, in one walk over the records. */
static void count_digits(const struct sort *sort, const unsigned char *records, size_t count,
                         unsigned digit_count, size_t counts[][DIGIT_VALUES])
{
    memset(counts, 0, digit_count * sizeof counts[0]);
    for (size_t i = 0; i < count; i++) {
        const unsigned char *record = records + i * sort->record_size;
        for (unsigned d = 0; d < digit_count; d++)
            counts[d][digit_of(record, sort->digits[d])]++;
    }
}

static bool key_is_less(const struct sort *sort, const unsigned char *a, const unsigned char *b)
{
    for (unsigned word = 0; word < sort->key_words; word++) {
        uint64_t key_a = load_u64(a + 8 * (size_t)word);
        uint64_t key_b = load_u64(b + 8 * (size_t)word);
        if (key_a != key_b)
            return key_a < key_b;
    }
    return false;
}

static void sort_by_insertion(const struct sort *sort, unsigned char *records, size_t count)
{
    unsigned char moving[64];
    size_t size = sort->record_size;
    for (size_t i = 1; i < count; i++) {
        size_t place = i;
        memcpy(moving, records + i * size, size);
        while (place > 0 && key_is_less(sort, moving, records + (place - 1) * size)) {
            memcpy(records + place * size, records + (place - 1) * size, size);
            place--;
        }
        memcpy(records + place * size, moving, size);
    }
}

/*
 * Sorts by the digits below `digit_count`, from `records` to `other` and back; the result ends in
 * `wanted`, which is one of the two.
 */
static void sort_digits(const struct sort *sort, unsigned char *records, unsigned char *other,
                        size_t count, unsigned digit_count, unsigned char *wanted)
{
    size_t counts[MOST_DIGITS][DIGIT_VALUES];
    unsigned char *now = records;
    if (count <= SMALL) {
        sort_by_insertion(sort, records, count);
    } else {
        count_digits(sort, records, count, digit_count, counts);
        for (unsigned d = 0; d < digit_count; d++) {
            if (counts_to_begins(counts[d], count))
                continue;
            unsigned char *next = now == records ? other : records;
            scatter(now, next, count, sort->record_size, sort->digits[d], counts[d]);
            now = next;
        }
    }
    if (now != wanted)
        memcpy(wanted, now, count * sort->record_size);
}

static enum status sort_bucket(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct sort *sort = user;
    size_t begin = sort->bucket_begin[job] * sort->record_size;
    size_t count = sort->bucket_begin[job + 1] - sort->bucket_begin[job];
    if (count > 0)
        sort_digits(sort, sort->to + begin, sort->from + begin, count, sort->digit_count - 1,
                    sort->result + begin);
    return STATUS_OK;
}

/* The first pass: by the most significant digit, from `from` to `to`. */
static void cut_into_buckets(struct sort *sort, size_t count)
{
    struct digit digit = sort->digits[sort->digit_count - 1];
    size_t begins[DIGIT_VALUES] = {0};
    for (size_t i = 0; i < count; i++)
        begins[digit_of(sort->from + i * sort->record_size, digit)]++;
    /* The digit varies, so no value has all records. */
    (void)counts_to_begins(begins, count);
    memcpy(sort->bucket_begin, begins, sizeof begins);
    sort->bucket_begin[DIGIT_VALUES] = count;
    scatter(sort->from, sort->to, count, sort->record_size, digit, begins);
}

enum status radix_sort_above(struct context *ctx, unsigned char *records, unsigned char *scratch,
                             size_t count, size_t record_size, unsigned key_words,
                             unsigned ordered_bits, unsigned char **sorted)
{
    *sorted = records;
    if (count < 2)
        return STATUS_OK;
    struct sort sort = {
        .from = records, .to = scratch, .record_size = record_size, .key_words = key_words};
    uint64_t varying[2] = {0, 0};
    find_varying(records, count, record_size, key_words, varying);
    /* A key has a word. NOLINTNEXTLINE(clang-analyzer-core.uninitialized.Assign) */
    varying[key_words - 1] &= ~(((uint64_t)1 << ordered_bits) - 1);
    choose_digits(&sort, varying);
    if (sort.digit_count == 0)
        return STATUS_OK;
    if (count < ALONE) {
        sort_digits(&sort, records, scratch, count, sort.digit_count, records);
        return STATUS_OK;
    }
    cut_into_buckets(&sort, count);
    /* Where an even number of passes leaves it, so that most buckets need no copy. */
    sort.result = sort.digit_count % 2 == 0 ? records : scratch;
    *sorted = sort.result;
    return parallel_for(ctx, DIGIT_VALUES, sort_bucket, &sort);
}

enum status radix_sort(struct context *ctx, unsigned char *records, unsigned char *scratch,
                       size_t count, size_t record_size, unsigned key_words, unsigned char **sorted)
{
    return radix_sort_above(ctx, records, scratch, count, record_size, key_words, 0, sorted);
}
