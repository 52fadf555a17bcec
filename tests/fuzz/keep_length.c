/*
 * libFuzzer's changes for formats whose frame knows every length: mostly within a few bytes, so
 * that all offsets stay right and the changes get behind the frame.
 */
#include "target.h"

#include <stdlib.h>
#include <string.h>

size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t most);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t most, unsigned seed);

size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t most, unsigned seed)
{
    enum { PIECE = 32 };
    uint64_t random = seed;
    random = (random + 1) * 0x9e3779b97f4a7c15u;
    random ^= random >> 29;
    if (size < PIECE || random % 16 == 0)
        return LLVMFuzzerMutate(data, size, most);
    size_t length = 1 + (size_t)(random >> 8) % PIECE;
    size_t at = (size_t)(random >> 20) % (size - length + 1);
    uint8_t piece[PIECE];
    memcpy(piece, data + at, length);
    size_t changed = LLVMFuzzerMutate(piece, length, length);
    memcpy(data + at, piece, changed);
    return size;
}
