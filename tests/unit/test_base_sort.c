/* The external sort against a plain stable sort of the same records, on random inputs of several
 * shapes, with limits from a few records to all of them. */
#include "test_kit.h"

#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/external_sort.h"

struct reference {
    uint64_t high, low;
    size_t place;
};

static int compare(const void *a, const void *b)
{
    const struct reference *one = a, *other = b;
    if (one->high != other->high)
        return one->high < other->high ? -1 : 1;
    if (one->low != other->low)
        return one->low < other->low ? -1 : 1;
    return one->place < other->place ? -1 : one->place > other->place;
}

static uint64_t next_random(uint64_t *seed)
{
    *seed += UINT64_C(0x9E3779B97F4A7C15);
    uint64_t mixed = *seed;
    mixed = (mixed ^ mixed >> 30) * UINT64_C(0xBF58476D1CE4E5B9);
    mixed = (mixed ^ mixed >> 27) * UINT64_C(0x94D049BB133111EB);
    return mixed ^ mixed >> 31;
}

/* Key words of several shapes: random, few values, small, one bit in the middle, constant, sorted,
 * reversed, a pair of 24-bit numbers. */
static uint64_t make_key(int shape, size_t i, uint64_t *seed)
{
    uint64_t random = next_random(seed);
    switch (shape) {
    case 0:
        return random;
    case 1:
        return random % 5 * UINT64_C(0x0101010101010101);
    case 2:
        return random % 1000;
    case 3:
        return UINT64_C(0xABCDEF0000000011) | (random & 1) << 33;
    case 4:
        return 42;
    case 5:
        return i / 3;
    case 6:
        return UINT64_MAX - i / 3;
    default:
        return (random >> 40) << 32 | (random & 0xFFFFFF);
    }
}

static unsigned char *make_records(size_t count, size_t record_size, size_t key_size, int shape)
{
    unsigned char *records = malloc(count * record_size + 1);
    uint64_t seed = count * 31 + record_size * 7 + (size_t)shape;
    for (size_t i = 0; i < count; i++) {
        unsigned char *record = records + i * record_size;
        for (size_t k = key_size; k < record_size; k++)
            record[k] = (unsigned char)(i >> (k - key_size) % 4 * 8);
        store_u64(record, make_key(shape, i, &seed));
        if (key_size == 16)
            store_u64(record + 8, make_key((shape + 3) % 8, i, &seed));
    }
    return records;
}

static void sort_and_compare(size_t count, size_t record_size, size_t key_size, int shape,
                             uint64_t limit, unsigned threads)
{
    struct context ctx;
    context_init(&ctx);
    ctx.threads = threads;
    unsigned char *records = make_records(count, record_size, key_size, shape);
    struct reference *order = malloc((count + 1) * sizeof *order);
    for (size_t i = 0; i < count; i++) {
        order[i].high = load_u64(records + i * record_size);
        order[i].low = key_size == 16 ? load_u64(records + i * record_size + 8) : 0;
        order[i].place = i;
    }
    qsort(order, count, sizeof *order, compare);

    struct sorter *sorter;
    assert_int_equal(sorter_open(&ctx, record_size, key_size, limit, NULL, &sorter), STATUS_OK);
    uint64_t seed = 5;
    for (size_t added = 0; added < count;) {
        size_t some = (size_t)(next_random(&seed) % 200);
        some = some < count - added ? some : count - added;
        assert_int_equal(sorter_add(sorter, records + added * record_size, some), STATUS_OK);
        added += some;
    }
    assert_int_equal(sorter_count(sorter), count);
    assert_int_equal(sorter_finish(sorter), STATUS_OK);
    size_t seen = 0;
    for (;;) {
        const void *out;
        size_t some;
        assert_int_equal(sorter_next(sorter, &out, &some), STATUS_OK);
        if (some == 0)
            break;
        assert_true(some <= count - seen);
        for (size_t i = 0; i < some; i++, seen++)
            if (memcmp((const unsigned char *)out + i * record_size,
                       records + order[seen].place * record_size, record_size) != 0)
                fail_msg("record %zu of %zu is wrong: size %zu, key %zu, shape %d, limit %llu",
                         seen, count, record_size, key_size, shape, (unsigned long long)limit);
    }
    assert_int_equal(seen, count);
    /* Twice at the end is still the end. */
    const void *out;
    size_t some;
    assert_int_equal(sorter_next(sorter, &out, &some), STATUS_OK);
    assert_int_equal(some, 0);
    /* The books of runs and pieces aside, the limit is kept. */
    assert_true(ctx.memory_peak <= limit + 64 * 1024);
    sorter_close(&sorter);
    assert_null(sorter);
    assert_int_equal(ctx.memory_now, 0);
    free(order);
    free(records);
    context_clear(&ctx);
}

static void agrees_in_memory(void **state)
{
    (void)state;
    static const size_t counts[] = {0, 1, 2, 23, 24, 25, 1000, 20000};
    static const size_t sizes[] = {8, 12, 16, 20, 24, 31, 64};
    for (size_t c = 0; c < sizeof counts / sizeof counts[0]; c++)
        for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++)
            for (int shape = 0; shape < 8; shape++)
                sort_and_compare(counts[c], sizes[s], sizes[s] >= 16 && shape % 2 ? 16 : 8, shape,
                                 64 << 20, 1);
}

static void agrees_on_disk(void **state)
{
    (void)state;
    static const uint64_t limits[] = {0, 1000, 5000, 100000};
    for (size_t l = 0; l < sizeof limits / sizeof limits[0]; l++)
        for (int shape = 0; shape < 8; shape++) {
            sort_and_compare(3000, 16, 16, shape, limits[l], 1);
            sort_and_compare(3000, 20, 8, shape, limits[l], 1);
        }
    sort_and_compare(100, 64, 8, 0, 0, 1);
}

static void threads_change_nothing(void **state)
{
    (void)state;
    for (int shape = 0; shape < 8; shape++) {
        sort_and_compare(50000, 16, 8, shape, 64 << 20, 3);
        sort_and_compare(50000, 24, 16, shape, 900000, 3);
    }
}

static void misuse_is_refused(void **state)
{
    (void)state;
    struct context ctx;
    context_init(&ctx);
    struct sorter *sorter;
    assert_int_equal(sorter_open(&ctx, 65, 8, 0, NULL, &sorter), STATUS_INTERNAL);
    assert_int_equal(sorter_open(&ctx, 8, 16, 0, NULL, &sorter), STATUS_INTERNAL);
    assert_int_equal(sorter_open(&ctx, 8, 4, 0, NULL, &sorter), STATUS_INTERNAL);
    assert_null(sorter);
    sorter_close(&sorter);
    assert_int_equal(sorter_open(&ctx, 8, 8, 0, NULL, &sorter), STATUS_OK);
    const void *records;
    size_t count;
    assert_int_equal(sorter_next(sorter, &records, &count), STATUS_INTERNAL);
    assert_int_equal(sorter_finish(sorter), STATUS_OK);
    assert_int_equal(sorter_add(sorter, "12345678", 1), STATUS_INTERNAL);
    assert_int_equal(sorter_finish(sorter), STATUS_INTERNAL);
    sorter_close(&sorter);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(agrees_in_memory),
        cmocka_unit_test(agrees_on_disk),
        cmocka_unit_test(threads_change_nothing),
        cmocka_unit_test(misuse_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
