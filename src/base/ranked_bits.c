/*
 * A rank is one look at a table and one word's bits: a count for each single number would take
 * twenty times the memory, and one for every few words a loop at every look.
 */
#include "base/ranked_bits.h"

#include "base/memory.h"

size_t bits_list(const uint64_t *bits, size_t words, uint32_t *list)
{
    size_t count = 0;
    for (size_t w = 0; w < words; w++)
        for (uint64_t left = bits[w]; left; left &= left - 1)
            list[count++] = (uint32_t)(64 * w + (size_t)__builtin_ctzll(left));
    return count;
}

enum status ranked_bits_take(struct context *ctx, uint64_t count, struct ranked_bits *set)
{
    set->words = bit_words(count);
    enum status status = memory_take_zeroed(ctx, set->words, sizeof *set->bits, &set->bits);
    if (status == STATUS_OK)
        status = memory_take(ctx, set->words, sizeof *set->below, &set->below);
    return status;
}

void ranked_bits_clear(struct context *ctx, struct ranked_bits *set)
{
    memory_release(ctx, &set->below, set->words, sizeof *set->below);
    memory_release(ctx, &set->bits, set->words, sizeof *set->bits);
}

uint32_t ranked_bits_sum(struct ranked_bits *set)
{
    uint32_t sum = 0;
    for (size_t w = 0; w < set->words; w++) {
        set->below[w] = sum;
        sum += bit_count(set->bits[w]);
    }
    return sum;
}
