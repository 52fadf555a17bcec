/*
 * The lowest of a changing set of small numbers: a bitmap, and over it bitmaps of the words that
 * are not zero, 64-fold at each level. Adding and taking out mostly touch one word, and finding the
 * lowest costs one word a level, where a heap would move entries for each.
 */
#ifndef SPBM_SIMPLIFY_BIT_TREE_H
#define SPBM_SIMPLIFY_BIT_TREE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

enum { BIT_LEVELS_MAX = 6 };

struct bit_tree {
    uint64_t *levels[BIT_LEVELS_MAX]; /* bit i of level n + 1: word i of level n is not zero */
    unsigned depth;
};

static inline size_t bit_tree_level_words(size_t bits)
{
    return bits / 64 + 1;
}

/* Words of the whole tree. */
static inline size_t bit_tree_words(size_t bits)
{
    size_t words = bit_tree_level_words(bits), sum = words;
    while (words > 1) {
        words = bit_tree_level_words(words - 1);
        sum += words;
    }
    return sum;
}

/* An empty set of numbers below `bits`, at most 2^32, in bit_tree_words(bits) words of memory. */
static inline void bit_tree_init(struct bit_tree *tree, uint64_t *memory, size_t bits)
{
    memset(memory, 0, bit_tree_words(bits) * sizeof *memory);
    size_t words = bit_tree_level_words(bits);
    tree->levels[0] = memory;
    tree->depth = 1;
    while (words > 1) {
        memory += words;
        tree->levels[tree->depth++] = memory;
        words = bit_tree_level_words(words - 1);
    }
}

/* Adds `bit` if `is_wanted`: without a branch on that, which would be guessed wrong half the time.
 */
static inline void bit_tree_set_if(struct bit_tree *tree, uint32_t bit, bool is_wanted)
{
    uint64_t *word = tree->levels[0] + bit / 64;
    uint64_t before = *word, after = before | (uint64_t)is_wanted << bit % 64;
    *word = after;
    for (unsigned level = 1; before == 0 && after != 0 && level < tree->depth; level++) {
        bit /= 64;
        word = tree->levels[level] + bit / 64;
        before = *word;
        *word = after = before | (uint64_t)1 << bit % 64;
    }
}

static inline void bit_tree_clear(struct bit_tree *tree, uint32_t bit)
{
    for (unsigned level = 0; level < tree->depth; level++) {
        uint64_t *word = tree->levels[level] + bit / 64;
        *word &= ~((uint64_t)1 << bit % 64);
        if (*word)
            return;
        bit /= 64;
    }
}

/* False when the set is empty. */
static inline bool bit_tree_lowest(const struct bit_tree *tree, uint32_t *bit)
{
    uint32_t index = 0;
    if (!tree->levels[tree->depth - 1][0])
        return false;
    for (unsigned level = tree->depth; level-- > 0;)
        index = 64 * index + (uint32_t)__builtin_ctzll(tree->levels[level][index]);
    *bit = index;
    return true;
}

#endif
