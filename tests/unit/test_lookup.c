/*
 * Buckets give back what was put in, in order, however small the buffers; look-ups find the same
 * at once and by buckets, and see themselves that a walk jumps about; visits never let more stay
 * than they were given.
 */
#include "test_kit.h"

#include <string.h>

#include "base/memory.h"
#include "mesh/lookup.h"

static uint64_t mix(uint64_t x)
{
    x = (x ^ x >> 31) * UINT64_C(0x9e3779b97f4a7c15);
    return x ^ x >> 29;
}

static void buckets_keep_their_order(void **state)
{
    (void)state;
    enum { BUCKETS = 7, RECORDS = 3000 };
    static const uint64_t memories[] = {1, 7 * 60, 7 * 1000, 1 << 20};
    for (int m = 0; m < 4; m++) {
        struct context ctx;
        struct bucket_file file;
        context_init(&ctx);
        assert_int_equal(bucket_file_open(&ctx, &file, BUCKETS, 12, memories[m], NULL), STATUS_OK);
        uint64_t counts[BUCKETS] = {0};
        for (uint32_t i = 0; i < RECORDS; i++) {
            uint32_t record[3] = {i, ~i, i * i};
            size_t bucket = mix(i) % (BUCKETS - 1); /* one stays empty */
            assert_int_equal(bucket_put(&file, bucket, record), STATUS_OK);
            counts[bucket]++;
        }
        for (int round = 0; round < 3; round++) {
            assert_int_equal(bucket_file_rewind(&file), STATUS_OK);
            for (uint32_t i = 0; i < RECORDS / (round == 0 ? 2 : 1); i++) {
                uint32_t record[3];
                assert_int_equal(bucket_take(&file, mix(i) % (BUCKETS - 1), record), STATUS_OK);
                assert_int_equal(record[0], i);
                assert_int_equal(record[1], ~i);
                assert_int_equal(record[2], i * i);
            }
        }
        for (size_t b = 0; b < BUCKETS; b++) {
            uint32_t record[3];
            assert_int_equal(bucket_records(&file, b), counts[b]);
            assert_int_equal(bucket_take(&file, b, record), STATUS_INTERNAL);
        }
        bucket_file_close(&file);
        bucket_file_close(&file);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
}

/* The element of each index is a function of it. `jumps`: the walk is all over the table. */
static void look_up(uint64_t working_memory, bool jumps, bool *was_scattered)
{
    enum { COUNT = 20000 };
    struct context ctx;
    struct room room;
    struct spool spool;
    struct lookup lookup;
    uint64_t *table;
    context_init(&ctx);
    room_divide(&ctx, &room, NULL, 9, working_memory);
    assert_int_equal(room_scratch(&room, &spool, COUNT * 8, &table), STATUS_OK);
    for (uint64_t i = 0; i < COUNT; i++)
        table[i] = mix(i);
    assert_int_equal(lookup_open(&room, &lookup, &spool, table, 8, COUNT), STATUS_OK);
    uint64_t i = 0;
    for (; i < COUNT && !lookup_is_scattered(&lookup); i++) {
        uint64_t index = jumps ? mix(i) % COUNT : i ^ 5, found;
        memcpy(&found, lookup_now(&lookup, index), 8);
        assert_int_equal(found, mix(index));
        assert_true(lookup.visits.resident <= lookup.visits.most);
    }
    *was_scattered = i < COUNT;
    if (*was_scattered) {
        assert_int_equal(lookup_ask_begin(&lookup), STATUS_OK);
        for (uint64_t j = i; j < COUNT; j++)
            assert_int_equal(lookup_ask(&lookup, mix(j) % COUNT), STATUS_OK);
        assert_int_equal(lookup_answer(&lookup), STATUS_OK);
        for (uint64_t j = i; j < COUNT; j++) {
            uint64_t found;
            assert_int_equal(lookup_next(&lookup, mix(j) % COUNT, &found), STATUS_OK);
            assert_int_equal(found, mix(mix(j) % COUNT));
        }
    }
    lookup_close(&lookup);
    spool_clear(&spool);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void walks_that_jump_about_are_known(void **state)
{
    (void)state;
    bool scattered;
    look_up(0, true, &scattered);
    assert_false(scattered); /* all is in memory */
    look_up(1 << 20, true, &scattered);
    assert_false(scattered);
    look_up(40000, false, &scattered);
    assert_false(scattered); /* a window is enough */
    look_up(40000, true, &scattered);
    assert_true(scattered);
    look_up(1, true, &scattered);
    assert_true(scattered);
}

static void parts_fit_their_share(void **state)
{
    (void)state;
    size_t parts;
    assert_int_equal(part_shift_for(1000000, 8, 1 << 20, &parts), 17);
    assert_int_equal(parts, 1000000 / (1 << 17) + 1);
    assert_int_equal(part_shift_for(10, 4, 0, &parts), 4);
    assert_int_equal(parts, 1);
    /* However little there is, there are not too many parts. */
    unsigned shift = part_shift_for(UINT32_MAX - 1, 4, 0, &parts);
    assert_true(parts <= 65537 && parts == ((UINT32_MAX - 1ull) >> shift) + 1);
    part_shift_for(UINT32_MAX - 1, 4, UINT64_MAX, &parts);
    assert_int_equal(parts, 1);
}

static void the_budget_is_divided_sensibly(void **state)
{
    (void)state;
    struct context ctx;
    struct room room;
    context_init(&ctx);
    ctx.threads = 8;
    for (uint64_t budget = room_least(18, 0, 0); budget < (uint64_t)1 << 40; budget += budget / 3) {
        ctx.memory_budget = budget;
        room_divide(&ctx, &room, NULL, 18, 0);
        uint64_t work = room.in_flight * ((uint64_t)ROOM_A_FACE << 18);
        assert_true(room.in_flight >= 1 && room.in_flight <= 9);
        assert_true(work + room.spools + 2 * room.sorter <= budget - ROOM_FIXED);
        assert_true(room_fits(&room, room.spools) && !room_fits(&room, room.spools + 1));
    }
    assert_int_equal(room.in_flight, 9);
    context_clear(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(buckets_keep_their_order),
        cmocka_unit_test(walks_that_jump_about_are_known),
        cmocka_unit_test(parts_fit_their_share),
        cmocka_unit_test(the_budget_is_divided_sensibly),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
