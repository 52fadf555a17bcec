/* Blocks: round trips at every level, and no flipped bit, cut or impossible size gets through. */
#include "test_kit.h"

#include <stdlib.h>
#include <string.h>

#include "base/block_stream.h"
#include "base/bytes.h"
#include "base/checksum.h"
#include "base/memory.h"

static unsigned char *make_raw(size_t size, bool random)
{
    unsigned char *raw = malloc(size + 1);
    uint32_t seed = 1;
    for (size_t i = 0; i < size; i++) {
        seed = seed * 1664525 + 1013904223;
        raw[i] = random ? (unsigned char)(seed >> 24) : (unsigned char)(i / 50);
    }
    return raw;
}

static void blocks_come_back(void **state)
{
    (void)state;
    struct context ctx;
    context_init(&ctx);
    static const size_t sizes[] = {0, 1, 2, 100, 5000, 1 << 20, 1500000};
    static const int levels[] = {0, 1, 6, 12};
    for (size_t s = 0; s < 7; s++)
        for (size_t l = 0; l < 4; l++)
            for (int random = 0; random < 2; random++) {
                unsigned char *raw = make_raw(sizes[s], random);
                unsigned char *block, *back;
                size_t size, back_size, taken;
                assert_int_equal(block_pack(&ctx, raw, sizes[s], levels[l], &block, &size),
                                 STATUS_OK);
                assert_true(size <= BLOCK_HEADER_SIZE + sizes[s]);
                if (levels[l] == 0)
                    assert_int_equal(size, BLOCK_HEADER_SIZE + sizes[s]);
                if (levels[l] > 0 && !random && sizes[s] >= 5000)
                    assert_true(size < sizes[s] / 4);
                assert_int_equal(
                    block_unpack(&ctx, "block 1", block, size, &back, &back_size, &taken),
                    STATUS_OK);
                assert_int_equal(taken, size);
                assert_int_equal(back_size, sizes[s]);
                assert_memory_equal(back, raw, sizes[s]);
                memory_release(&ctx, &back, back_size, 1);
                memory_release(&ctx, &block, size, 1);
                assert_int_equal(ctx.memory_now, 0);
                free(raw);
            }
    context_clear(&ctx);
}

static enum status unpack_only(const unsigned char *block, size_t size)
{
    struct context ctx;
    context_init(&ctx);
    unsigned char *back;
    size_t back_size, taken;
    enum status status = block_unpack(&ctx, "block 1", block, size, &back, &back_size, &taken);
    if (status == STATUS_OK)
        memory_release(&ctx, &back, back_size, 1);
    else
        assert_non_null(strstr(ctx.error, "block 1"));
    assert_null(back);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return status;
}

static void damage_is_found(void **state)
{
    (void)state;
    for (int level = 0; level <= 6; level += 6) {
        struct context ctx;
        context_init(&ctx);
        unsigned char *raw = make_raw(600, false), *block;
        size_t size;
        assert_int_equal(block_pack(&ctx, raw, 600, level, &block, &size), STATUS_OK);
        /* In memory of its exact size, so that a step too far is seen. */
        for (size_t cut = 0; cut < size; cut++) {
            unsigned char *part = malloc(cut + 1);
            memcpy(part, block, cut);
            part = realloc(part, cut ? cut : 1);
            assert_int_equal(unpack_only(part, cut), STATUS_BAD_INPUT);
            free(part);
        }
        for (size_t bit = 0; bit < 8 * size; bit++) {
            block[bit / 8] ^= (unsigned char)(1 << bit % 8);
            if (unpack_only(block, size) != STATUS_BAD_INPUT)
                fail_msg("bit %zu can flip unseen", bit);
            block[bit / 8] ^= (unsigned char)(1 << bit % 8);
        }
        assert_int_equal(unpack_only(block, size), STATUS_OK);
        memory_release(&ctx, &block, size, 1);
        free(raw);
        context_clear(&ctx);
    }
}

/* Makes the CRCs of header and stored bytes right again. */
static void sign(unsigned char *block)
{
    store_u32(block + 16, checksum(0, block + 24, load_u32(block + 4)));
    store_u32(block + 20, checksum(0, block, 20));
}

static void lies_with_right_crcs_are_found(void **state)
{
    (void)state;
    struct context ctx;
    context_init(&ctx);
    unsigned char *raw = make_raw(600, false), *block;
    size_t size;
    assert_int_equal(block_pack(&ctx, raw, 600, 6, &block, &size), STATUS_OK);
    size_t stored = size - BLOCK_HEADER_SIZE;
    static const uint32_t raw_sizes[] = {0, 1, 599, 601, 1 << 20, (1u << 30) + 1, UINT32_MAX};
    for (size_t i = 0; i < 7; i++) {
        store_u32(block + 8, raw_sizes[i]);
        sign(block);
        assert_int_equal(unpack_only(block, size), STATUS_BAD_INPUT);
    }
    store_u32(block + 8, 600);
    store_u32(block + 4, (uint32_t)stored - 1); /* the stream ends early */
    sign(block);
    assert_int_equal(unpack_only(block, size), STATUS_BAD_INPUT);
    store_u32(block + 4, (uint32_t)stored);
    store_u32(block + 12, 1); /* the raw CRC */
    sign(block);
    assert_int_equal(unpack_only(block, size), STATUS_BAD_INPUT);
    memory_release(&ctx, &block, size, 1);
    free(raw);
    context_clear(&ctx);
}

static void misuse_is_refused(void **state)
{
    (void)state;
    struct context ctx;
    context_init(&ctx);
    unsigned char *block;
    size_t size;
    assert_int_equal(block_pack(&ctx, "x", 1, 13, &block, &size), STATUS_INTERNAL);
    assert_int_equal(block_pack(&ctx, "x", (size_t)BLOCK_MAX + 1, 0, &block, &size),
                     STATUS_INTERNAL);
    assert_null(block);
    context_clear(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(blocks_come_back),
        cmocka_unit_test(damage_is_found),
        cmocka_unit_test(lies_with_right_crcs_are_found),
        cmocka_unit_test(misuse_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
