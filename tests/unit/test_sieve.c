/*
 * The sieve gives the first of corners that coincide to all of them as long as it has room, forgets
 * where it has not, and never gives a vertex of another place; a store of a soup is the same
 * however little it holds.
 */
#include "test_kit.h"

#include <stdlib.h>
#include <string.h>

#include "mesh/sieve.h"
#include "mesh/store.h"
#include "test_alike.h"
#include "test_files.h"
#include "test_shapes.h"

enum { GRID = 100, CORNERS = 60000, BATCH = 500 };

/* Corners at random places of a grid, in batches; `memory` of the sieve. Returns what it held. */
static uint64_t sift(uint64_t memory)
{
    static float corners[3 * CORNERS], vertices[3 * CORNERS];
    struct context ctx;
    struct sieve sieve;
    uint64_t seed = 4, count = 0;
    context_init(&ctx);
    sieve_open(&ctx, &sieve, memory);
    for (size_t c = 0; c < CORNERS; c++) {
        corners[3 * c] = (float)random_below(&seed, GRID) * 0.1f;
        corners[3 * c + 1] = (float)random_below(&seed, GRID) * -0.1f; /* and -0 */
        corners[3 * c + 2] = random_below(&seed, 2) ? 0.0f : -0.0f;
    }
    for (size_t first = 0; first < CORNERS; first += BATCH) {
        uint32_t named[BATCH];
        size_t kept;
        if (first % (4 * BATCH) == 0) { /* as corners with doubles */
            assert_int_equal(sieve_pass(&sieve, BATCH, count), STATUS_OK);
            memcpy(vertices + 3 * count, corners + 3 * first, BATCH * 12);
            kept = BATCH;
        } else {
            assert_int_equal(sieve_take(&sieve, corners + 3 * first, BATCH, count, &kept),
                             STATUS_OK);
            memcpy(vertices + 3 * count, sieve.out, kept * 12);
        }
        count += kept;
        for (uint32_t i = 0; i < BATCH; i++)
            named[i] = (uint32_t)first + i;
        assert_int_equal(sieve_name(&sieve, named, BATCH), STATUS_OK);
        for (size_t i = 0; i < BATCH; i++) {
            assert_true(named[i] < count);
            for (size_t k = 0; k < 3; k++)
                assert_true(vertices[3 * named[i] + k] == corners[3 * (first + i) + k]);
        }
        named[0] = (uint32_t)first;
        if (first == 0)
            continue;
        uint32_t again = (uint32_t)first - 1, ahead = (uint32_t)first + BATCH;
        assert_int_equal(sieve_name(&sieve, &again, 1), STATUS_INTERNAL);
        assert_int_equal(sieve_name(&sieve, &ahead, 1), STATUS_INTERNAL);
    }
    assert_int_equal(count + sieve.held, CORNERS);
    const uint64_t held = sieve.held;
    sieve_close(&sieve);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return held;
}

static void corners_find_their_first(void **state)
{
    (void)state;
    const uint64_t all = sift(UINT64_MAX), some = sift(1);
    assert_int_equal(all, sift(1 << 20));
    assert_true(all > CORNERS / 4 * 3 - GRID * GRID * 3 / 2);
    assert_true(some < all && some > 0);
}

static void soups_are_the_same_in_any_memory(void **state)
{
    (void)state;
    for (int is_shuffled = 0; is_shuffled < 2; is_shuffled++) {
        struct shape shape = shape_noisy_torus(150, 80, 0.01, 3);
        const char *input = test_path("s.stl"), *output = test_path("s.store");
        struct first_bytes first = {NULL, 0};
        if (is_shuffled)
            shape_shuffle(&shape, 5);
        shape_write(&shape, SHAPE_STL_BINARY, input);
        shape_free(&shape);
        for (int run = 0; run < 5; run++) {
            struct context ctx;
            struct store_info info;
            context_init(&ctx);
            const struct import_options options = {
                .slab_shift = 10, .working_memory = run ? (uint64_t)1 << (24 - 2 * run) : 0};
            if (store_build(&ctx, &input, 1, output, &options, &info) != STATUS_OK)
                fail_msg("run %d: %s", run, ctx.error);
            assert_int_equal(info.topology.vertices, 12000);
            assert_int_equal(info.cleaning.input_vertices, 72000);
            assert_int_equal(info.cleaning.welded_vertices, 60000);
            assert_int_equal(info.cleaning.unreferenced_vertices, 0);
            size_t size;
            unsigned char *bytes = file_read(output, &size);
            first_bytes_compare(&first, bytes, size);
            context_clear(&ctx);
        }
        free(first.bytes);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(corners_find_their_first),
        cmocka_unit_test(soups_are_the_same_in_any_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
