/* Memory: contents survive every resize, the account is exact, the budget holds, and an injected
 * failure leaves everything as it was. Also the small modules: report, bytes, checksum, cpu. */
#include "test_kit.h"

#include <errno.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/checksum.h"
#include "base/cpu.h"
#include "base/memory.h"
#include "base/prefault.h"

static int set_up(void **state)
{
    struct context *ctx = malloc(sizeof *ctx);
    context_init(ctx);
    *state = ctx;
    return 0;
}

/* Every test must end with nothing allocated. */
static int tear_down(void **state)
{
    struct context *ctx = *state;
    uint64_t left = ctx->memory_now;
    context_clear(ctx);
    free(ctx);
    return left == 0 ? 0 : -1;
}

static void empty_blocks_are_valid(void **state)
{
    struct context *ctx = *state;
    void *block = NULL;
    assert_int_equal(memory_take(ctx, 0, 8, &block), STATUS_OK);
    assert_non_null(block);
    assert_int_equal(ctx->memory_now, 0);
    memory_release(ctx, &block, 0, 8);
    assert_null(block);
    memory_release(ctx, &block, 0, 8);
}

static void fronts_are_released(void **state)
{
    struct context *ctx = *state;
    static const size_t fronts[] = {0, 1, 4096, 300000, 1 << 19, (1 << 20) - 1, 1 << 20};
    for (size_t i = 0; i < 2 * sizeof fronts / sizeof *fronts; i++) {
        const size_t front = fronts[i / 2], all = 1 << 20;
        size_t left = all;
        unsigned char *block, *rest;
        memory_keep_spares(ctx, i % 2);
        assert_int_equal(memory_take(ctx, all, 1, &block), STATUS_OK);
        for (size_t k = 0; k < all; k++)
            block[k] = (unsigned char)(k * 7 + k / 256);
        rest = block;
        memory_release_front(ctx, &rest, &left, front);
        assert_int_equal(ctx->memory_now, left);
        if (front == all) {
            assert_null(rest);
            continue;
        }
        assert_ptr_equal(rest + left, block + all);
        assert_true(all - left <= front);
        if (front > 100000 && front < 800000)
            assert_true(front - (all - left) < 65536);
        for (size_t k = all - left; k < all; k++)
            assert_int_equal(block[k], (unsigned char)(k * 7 + k / 256));
        memory_release(ctx, &rest, left, 1);
        assert_int_equal(ctx->memory_now, 0);
    }
    unsigned char *small;
    size_t bytes = 1000;
    assert_int_equal(memory_take(ctx, bytes, 1, &small), STATUS_OK);
    memory_release_front(ctx, &small, &bytes, 999);
    assert_int_equal(bytes, 1000);
    memory_release_front(ctx, &small, &bytes, 1000);
    assert_null(small);
    memory_keep_spares(ctx, false);
}

/* Sizes on both sides of the step from malloc to maps, in every order of two. */
static void contents_survive_resizing(void **state)
{
    struct context *ctx = *state;
    static const size_t sizes[] = {1,       100,           (1 << 20) - 1, 1 << 20, (1 << 20) + 1,
                                   3 << 20, (3 << 20) + 5, 9000000};
    enum { SIZES = sizeof sizes / sizeof sizes[0] };
    for (size_t i = 0; i < SIZES; i++) {
        for (size_t j = 0; j < SIZES; j++) {
            unsigned char *block;
            assert_int_equal(memory_take(ctx, sizes[i], 1, &block), STATUS_OK);
            for (size_t k = 0; k < sizes[i]; k++)
                block[k] = (unsigned char)(k * 7 + k / 256);
            assert_int_equal(memory_resize(ctx, &block, sizes[i], sizes[j], 1), STATUS_OK);
            size_t both = sizes[i] < sizes[j] ? sizes[i] : sizes[j];
            for (size_t k = 0; k < both; k++)
                if (block[k] != (unsigned char)(k * 7 + k / 256))
                    fail_msg("byte %zu changed from %zu to %zu", k, sizes[i], sizes[j]);
            memset(block, 1, sizes[j]);
            memory_release(ctx, &block, sizes[j], 1);
            assert_int_equal(ctx->memory_now, 0);
        }
    }
    assert_true(ctx->memory_peak >= 9000000);
}

static void zeroed_is_zero(void **state)
{
    struct context *ctx = *state;
    static const size_t sizes[] = {1000, 2 << 20};
    for (int i = 0; i < 2; i++) {
        unsigned char *block;
        assert_int_equal(memory_take_zeroed(ctx, sizes[i], 1, &block), STATUS_OK);
        for (size_t k = 0; k < sizes[i]; k++)
            assert_int_equal(block[k], 0);
        memory_release(ctx, &block, sizes[i], 1);
    }
}

/* Released maps serve the blocks to come, whole, in parts or lengthened: zeroed ones are zero, the
 * others keep what is written, and with the spares no more is held than was allowed before. */
static void spares_are_used_again(void **state)
{
    struct context *ctx = *state;
    enum { ROUNDS = 300, BLOCKS = 12 };
    static const size_t sizes[] = {200 << 10, 3 << 20, 1 << 20, 300000, 5 << 20, 131072, 700001};
    unsigned char *blocks[BLOCKS] = {NULL};
    size_t held[BLOCKS] = {0};
    uint64_t again = 0;
    ctx->memory_budget = 24 << 20;
    memory_keep_spares(ctx, true);
    for (size_t round = 0; round < ROUNDS; round++) {
        const size_t i = round * 7 % BLOCKS, size = sizes[round % (sizeof sizes / sizeof *sizes)];
        for (size_t k = 0; k < held[i]; k += 509)
            if (blocks[i][k] != (unsigned char)i + 1)
                fail_msg("byte %zu of block %zu is lost", k, i);
        if (round % 3 == 1 && blocks[i]) {
            assert_int_equal(memory_resize(ctx, &blocks[i], held[i], size, 1), STATUS_OK);
        } else {
            memory_release(ctx, &blocks[i], held[i], 1);
            const uint64_t spare = ctx->spares.bytes;
            assert_int_equal(round % 2 ? memory_take_zeroed(ctx, size, 1, &blocks[i])
                                       : memory_take(ctx, size, 1, &blocks[i]),
                             STATUS_OK);
            again += ctx->spares.bytes < spare;
            for (size_t k = 0; round % 2 && k < size; k++)
                if (blocks[i][k] != 0)
                    fail_msg("byte %zu of %zu is not zero", k, size);
        }
        held[i] = size;
        memset(blocks[i], (int)i + 1, size);
        assert_true(ctx->memory_now + ctx->spares.bytes <= ctx->memory_budget);
        assert_true(ctx->spares.bytes <= ctx->memory_peak);
    }
    assert_true(again > ROUNDS / 4);
    for (size_t i = 0; i < BLOCKS; i++)
        memory_release(ctx, &blocks[i], held[i], 1);
    assert_true(ctx->spares.bytes > 0);
    const uint64_t kept = ctx->spares.bytes;
    assert_int_equal(memory_limit_spares(ctx, kept), kept);
    assert_true(memory_limit_spares(ctx, kept / 2) <= kept / 2 && ctx->spares.bytes <= kept / 2);
    memory_keep_spares(ctx, false);
    assert_true(ctx->spares.bytes == 0);
}

static void overflow_is_refused(void **state)
{
    struct context *ctx = *state;
    void *block = ctx;
    assert_int_equal(memory_take(ctx, SIZE_MAX / 4, 8, &block), STATUS_NO_MEMORY);
    assert_null(block);
    assert_int_equal(memory_take(ctx, SIZE_MAX, 1, &block), STATUS_NO_MEMORY);
    assert_int_equal(memory_take(ctx, (size_t)PTRDIFF_MAX, 1, &block), STATUS_NO_MEMORY);
    assert_int_equal(memory_resize(ctx, &block, 0, SIZE_MAX / 2, 4), STATUS_NO_MEMORY);
    size_t capacity = 0;
    assert_int_equal(memory_reserve(ctx, &block, &capacity, SIZE_MAX / 2, 4), STATUS_NO_MEMORY);
    assert_int_equal(capacity, 0);
    assert_null(block);
    assert_int_equal(ctx->failed, STATUS_NO_MEMORY);
}

/* While the block is written, when it is let go of at once, and when it is not there any more. */
static void pages_got_ahead_change_no_byte(void **state)
{
    struct context *ctx = *state;
    const size_t count = 3 << 20;
    for (unsigned round = 0; round < 6; round++) {
        struct prefault prefault = {0};
        uint64_t *numbers;
        assert_int_equal(memory_take(ctx, count, sizeof *numbers, &numbers), STATUS_OK);
        ctx->threads = 1 + round % 2;
        prefault_add(&prefault, numbers + count / 2, count / 2 * sizeof *numbers);
        prefault_add(&prefault, (unsigned char *)numbers + 1, count / 2 * sizeof *numbers - 1);
        if (round >= 4)
            memory_release(ctx, &numbers, count, sizeof *numbers);
        prefault_begin(ctx, &prefault);
        assert_int_equal(prefault.is_running, ctx->threads > 1);
        for (size_t i = 0; i < count && round < 2; i++)
            numbers[i] = i * i;
        prefault_end(&prefault);
        prefault_end(&prefault);
        for (size_t i = 0; i < count && round < 2; i++)
            assert_int_equal(numbers[i], i * i);
        memory_release(ctx, &numbers, count, sizeof *numbers);
    }
    ctx->threads = 1;
}

static void budget_holds(void **state)
{
    struct context *ctx = *state;
    ctx->memory_budget = 100000;
    unsigned char *first, *second;
    assert_int_equal(memory_take(ctx, 60000, 1, &first), STATUS_OK);
    assert_int_equal(memory_take(ctx, 40001, 1, &second), STATUS_NO_MEMORY);
    assert_null(second);
    assert_non_null(strstr(ctx->error, "budget 100000"));
    assert_int_equal(ctx->memory_now, 60000);
    assert_int_equal(memory_resize(ctx, &first, 60000, 100001, 1), STATUS_NO_MEMORY);
    assert_int_equal(memory_take(ctx, 40000, 1, &second), STATUS_OK);
    assert_int_equal(ctx->memory_now, 100000);
    memory_release(ctx, &first, 60000, 1);
    memory_release(ctx, &second, 40000, 1);
    assert_int_equal(ctx->memory_peak, 100000);
}

/* Growing by half would pass the budget, exactly what is needed does not: that must do. */
static void reserve_is_content_with_less(void **state)
{
    struct context *ctx = *state;
    ctx->memory_budget = 1100;
    unsigned char *vector = NULL;
    size_t capacity = 0;
    assert_int_equal(memory_reserve(ctx, &vector, &capacity, 1000, 1), STATUS_OK);
    assert_int_equal(memory_reserve(ctx, &vector, &capacity, 1050, 1), STATUS_OK);
    assert_int_equal(capacity, 1050);
    assert_int_equal(memory_reserve(ctx, &vector, &capacity, 1101, 1), STATUS_NO_MEMORY);
    assert_int_equal(capacity, 1050);
    memory_release(ctx, &vector, capacity, 1);
}

static void reserve_grows_by_a_share(void **state)
{
    struct context *ctx = *state;
    uint32_t *vector = NULL;
    size_t capacity = 0, moves = 0;
    for (size_t i = 0; i < 1000000; i++) {
        size_t before = capacity;
        assert_int_equal(memory_reserve(ctx, &vector, &capacity, i + 1, sizeof *vector), STATUS_OK);
        moves += capacity != before;
        vector[i] = (uint32_t)i;
    }
    assert_true(moves < 60);
    for (size_t i = 0; i < 1000000; i++)
        if (vector[i] != i)
            fail_msg("element %zu is lost", i);
    memory_release(ctx, &vector, capacity, sizeof *vector);
}

static void injected_failures_come_once(void **state)
{
    struct context *ctx = *state;
    ctx->fault_after = 2;
    unsigned char *blocks[4];
    for (int i = 0; i < 4; i++)
        assert_int_equal(memory_take(ctx, 10, 1, &blocks[i]),
                         i == 2 ? STATUS_NO_MEMORY : STATUS_OK);
    for (int i = 0; i < 4; i++)
        memory_release(ctx, &blocks[i], 10, 1);

    unsigned char *vector = NULL;
    size_t capacity = 0;
    ctx->fault_after = 0;
    assert_int_equal(memory_reserve(ctx, &vector, &capacity, 5, 1), STATUS_NO_MEMORY);
    assert_null(vector);
    assert_int_equal(ctx->fault_after, UINT64_MAX);
}

/* ---- report ---- */

static void first_failure_stays(void **state)
{
    struct context *ctx = *state;
    assert_int_equal(fail(ctx, STATUS_BAD_INPUT, "a%s: line %d", "\nb\x7f", 3), STATUS_BAD_INPUT);
    assert_int_equal(fail_errno(ctx, EIO, "later"), STATUS_IO);
    assert_int_equal(ctx->failed, STATUS_BAD_INPUT);
    assert_string_equal(ctx->error, "a?b?: line 3");
}

static void errno_becomes_status(void **state)
{
    struct context *ctx = *state;
    assert_int_equal(fail_errno(ctx, ENOSPC, "%s: cannot write", "x"), STATUS_NO_SPACE);
    assert_string_equal(ctx->error, "x: cannot write: No space left on device");
    assert_int_equal(fail_errno(ctx, EDQUOT, "x"), STATUS_NO_SPACE);
    assert_int_equal(fail_errno(ctx, ENOMEM, "x"), STATUS_NO_MEMORY);
    assert_int_equal(fail_errno(ctx, EACCES, "x"), STATUS_IO);
}

static void long_texts_are_cut(void **state)
{
    struct context *ctx = *state;
    char text[5000];
    memset(text, 'x', sizeof text);
    text[sizeof text - 1] = '\0';
    assert_int_equal(fail_errno(ctx, EIO, "%s", text), STATUS_IO);
    assert_int_equal(strlen(ctx->error), sizeof ctx->error - 1);
}

struct heard {
    int messages, steps;
    bool stop;
    char last[100];
};

static void hear(void *user, enum message_level level, const char *text)
{
    struct heard *heard = user;
    heard->messages += level == MESSAGE_WARNING ? 1 : 100;
    strncpy(heard->last, text, sizeof heard->last - 1);
}

static void see(void *user, const char *stage, uint64_t done, uint64_t total)
{
    struct heard *heard = user;
    heard->steps += strcmp(stage, "import") == 0 && done == 3 && total == 7;
}

static bool want_stop(void *user)
{
    return ((struct heard *)user)->stop;
}

static void callbacks_are_called(void **state)
{
    struct context *ctx = *state;
    tell(ctx, MESSAGE_NOTE, "to nobody");
    assert_int_equal(step(ctx, "import", 3, 7), STATUS_OK);

    struct heard heard = {0};
    ctx->message = hear;
    ctx->progress = see;
    ctx->cancelled = want_stop;
    ctx->user = &heard;
    tell(ctx, MESSAGE_WARNING, "%d faces\n", 12);
    assert_int_equal(heard.messages, 1);
    assert_string_equal(heard.last, "12 faces?");
    assert_int_equal(step(ctx, "import", 3, 7), STATUS_OK);
    heard.stop = true;
    assert_int_equal(step(ctx, "import", 3, 7), STATUS_CANCELLED);
    assert_int_equal(heard.steps, 2);
    assert_int_equal(ctx->failed, STATUS_CANCELLED);
}

/* ---- bytes, checksum, cpu ---- */

static void bytes_are_little_endian(void **state)
{
    (void)state;
    unsigned char place[9] = {0};
    store_u64(place + 1, UINT64_C(0x8877665544332211));
    for (unsigned i = 1; i < 9; i++)
        assert_int_equal(place[i], i * 0x11);
    assert_true(load_u64(place + 1) == UINT64_C(0x8877665544332211));
    assert_int_equal(load_u32(place + 1), 0x44332211);
    assert_int_equal(load_u16(place + 1), 0x2211);
    store_f64(place + 1, -1.5);
    assert_true(load_f64(place + 1) == -1.5);
    assert_int_equal(place[8], 0xbf);
    store_f32(place + 1, 0.25f);
    assert_true(load_f32(place + 1) == 0.25f);
    uint64_t sum;
    assert_true(add_overflows(UINT64_MAX, 1, &sum));
    assert_false(mul_overflows(1u << 31, 1u << 31, &sum));
    assert_true(sum == UINT64_C(1) << 62);
}

/* The CRC by its definition, one bit at a time. */
static uint32_t slow_crc(const unsigned char *data, size_t size)
{
    uint32_t crc = UINT32_MAX;
    for (size_t i = 0; i < size; i++) {
        crc ^= data[i];
        for (int bit = 0; bit < 8; bit++)
            crc = crc >> 1 ^ (crc & 1 ? 0xEDB88320u : 0);
    }
    return ~crc;
}

static void checksum_is_that_of_gzip(void **state)
{
    (void)state;
    assert_int_equal(checksum(0, "123456789", 9), 0xCBF43926u);
    unsigned char data[5000];
    for (size_t i = 0; i < sizeof data; i++)
        data[i] = (unsigned char)(i * i + 3);
    for (size_t size = 0; size < 300; size++) /* at any place */
        assert_int_equal(checksum(0, data + size % 67, size), slow_crc(data + size % 67, size));
    for (size_t size = 0; size < sizeof data; size += 37) {
        uint32_t whole = slow_crc(data, size);
        assert_int_equal(checksum(0, data, size), whole);
        uint32_t parts = checksum(0, data, size / 3);
        parts = checksum(parts, NULL, 0);
        assert_int_equal(checksum(parts, data + size / 3, size - size / 3), whole);
        uint32_t behind = checksum(0, data + size / 3, size - size / 3);
        assert_int_equal(checksum_join(parts, behind, size - size / 3), whole);
    }
}

/* Also over more bytes than can be summed here: zeros behind, in one step and in two. */
static void checksums_are_joined_over_any_size(void **state)
{
    (void)state;
    const uint32_t nothing = 0, some = checksum(0, "123456789", 9);
    assert_int_equal(checksum_join(some, nothing, 0), some);
    assert_int_equal(checksum_join(nothing, some, 9), some);
    for (unsigned bits = 0; bits < 63; bits += 7) {
        const uint64_t size = (uint64_t)1 << bits;
        const uint32_t half = checksum_join(some, nothing, size);
        assert_int_equal(checksum_join(half, nothing, size),
                         checksum_join(some, nothing, 2 * size));
    }
}

static void cpu_level_keeps_to_the_cap(void **state)
{
    struct context *ctx = *state;
    enum cpu_level best = cpu_level(ctx);
    for (unsigned cap = CPU_SCALAR; cap <= CPU_AVX512; cap++) {
        ctx->cpu_level_cap = cap;
        enum cpu_level level = cpu_level(ctx);
        assert_true(level <= cap && level <= best);
        assert_true(strlen(cpu_level_name(level)) > 0);
        if (cap == CPU_SCALAR)
            assert_int_equal(level, CPU_SCALAR);
    }
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(empty_blocks_are_valid),         TEST(fronts_are_released),
        TEST(contents_survive_resizing),      TEST(zeroed_is_zero),
        TEST(spares_are_used_again),          TEST(overflow_is_refused),
        TEST(pages_got_ahead_change_no_byte), TEST(budget_holds),
        TEST(reserve_is_content_with_less),   TEST(reserve_grows_by_a_share),
        TEST(injected_failures_come_once),    TEST(first_failure_stays),
        TEST(errno_becomes_status),           TEST(long_texts_are_cut),
        TEST(callbacks_are_called),           TEST(bytes_are_little_endian),
        TEST(checksum_is_that_of_gzip),       TEST(checksums_are_joined_over_any_size),
        TEST(cpu_level_keeps_to_the_cap),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
