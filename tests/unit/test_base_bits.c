/* Ranked sets of bits against counting, on random sets of sizes round the words' edges. */
#include "test_kit.h"

#include <stdlib.h>
#include <string.h>

#include "base/ranked_bits.h"
#include "test_shapes.h"

static void check_set(struct context *ctx, uint64_t count, unsigned one_in, uint64_t *seed)
{
    struct ranked_bits set = {0};
    bool *member = calloc(count + 1, sizeof *member);
    uint32_t *list = malloc((count + 1) * sizeof *list);
    assert_int_equal(ranked_bits_take(ctx, count, &set), STATUS_OK);
    for (uint64_t i = 0; i < count; i++) {
        member[i] = random_next(seed) % one_in == 0;
        if (member[i])
            bit_set(set.bits, i);
    }
    const uint32_t members = ranked_bits_sum(&set);
    assert_int_equal(bits_list(set.bits, set.words, list), members);
    uint32_t before = 0;
    for (uint64_t i = 0; i < count; i++) {
        assert_int_equal(bit_is_set(set.bits, i), member[i]);
        assert_int_equal(rank_of(&set, i), before);
        if (member[i])
            assert_int_equal(list[before++], i);
    }
    assert_int_equal(members, before);
    assert_int_equal(rank_of(&set, count), members); /* the word that is never used */
    ranked_bits_clear(ctx, &set);
    free(list);
    free(member);
}

static void ranks_are_counts(void **state)
{
    (void)state;
    struct context ctx;
    context_init(&ctx);
    uint64_t seed = 1;
    const uint64_t counts[] = {0, 1, 63, 64, 65, 127, 128, 129, 5000};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++)
        for (unsigned one_in = 1; one_in <= 100; one_in *= 10)
            check_set(&ctx, counts[i], one_in, &seed);
    context_clear(&ctx);
}

static void bits_are_counted(void **state)
{
    (void)state;
    uint64_t seed = 2;
    for (unsigned i = 0; i <= 64; i++) {
        const uint64_t full = i == 64 ? UINT64_MAX : ((uint64_t)1 << i) - 1;
        assert_int_equal(bit_count(full), i);
        const uint64_t word = random_next(&seed) & random_next(&seed);
        assert_int_equal(bit_count(word), (uint32_t)__builtin_popcountll(word));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ranks_are_counts),
        cmocka_unit_test(bits_are_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
