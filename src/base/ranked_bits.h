/*
 * Sets of small numbers, a bit each, and how many of a set lie below a number: by that those chosen
 * of many get numbers of their own, in the same order, without sorting or a search.
 */
#ifndef SPBM_BASE_RANKED_BITS_H
#define SPBM_BASE_RANKED_BITS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "report.h"

/* Words of a set of numbers below `bits`, and one that is never used. */
static inline size_t bit_words(uint64_t bits)
{
    return (size_t)((bits + 63) / 64) + 1;
}

static inline bool bit_is_set(const uint64_t *bits, size_t i)
{
    return bits[i / 64] >> i % 64 & 1;
}

static inline void bit_set(uint64_t *bits, size_t i)
{
    bits[i / 64] |= (uint64_t)1 << i % 64;
}

/* (The compiler's is a call unless the machine is known to have an instruction for it.) */
static inline uint32_t bit_count(uint64_t word)
{
    word -= word >> 1 & 0x5555555555555555;
    word = (word & 0x3333333333333333) + (word >> 2 & 0x3333333333333333);
    word = (word + (word >> 4)) & 0x0f0f0f0f0f0f0f0f;
    return (uint32_t)(word * 0x0101010101010101 >> 56);
}

/* Lists what is set, ascending; returns how much that is. Numbers are below 2^32. */
size_t bits_list(const uint64_t *bits, size_t words, uint32_t *list);

/* A set with a count in front of every 64 numbers, once they are summed: 1.5 bits a number. Of at
 * most 2^32 - 1 members. {0} is empty. */
struct ranked_bits {
    uint64_t *bits;
    uint32_t *below; /* a word of them: members in the words before it */
    size_t words;
};

/* An empty set of numbers below `count`, for ranked_bits_clear to give back, also after an error.
 */
enum status ranked_bits_take(struct context *ctx, uint64_t count, struct ranked_bits *set);
void ranked_bits_clear(struct context *ctx, struct ranked_bits *set);

/* To be called after the last one was set: returns how many are. */
uint32_t ranked_bits_sum(struct ranked_bits *set);

/* How many members lie below i. */
static inline uint32_t rank_of(const struct ranked_bits *set, size_t i)
{
    const uint64_t lower = ((uint64_t)1 << i % 64) - 1;
    return set->below[i / 64] + bit_count(set->bits[i / 64] & lower);
}

#endif
