/*
 * CRC-32, by ISA-L: a table lookup a byte takes seconds a gigabyte; carry-less multiplication, four
 * to sixteen words at a time, checks data faster than memory gives it (55 GB/s where
 * libdeflate 1.14 has 14).
 */
#include "base/checksum.h"

#include <isa-l/crc.h>

/* ISA-L leaves the upper parts of vector registers in use: from then on every instruction that is
 * older than those has to wait for what it does not touch, and scalar arithmetic takes two to three
 * times as long, until somebody clears them. */
#if defined(__x86_64__)
__attribute__((target("avx"))) static void clear_upper_parts(void)
{
    __builtin_ia32_vzeroupper();
}
#endif

uint32_t checksum(uint32_t crc, const void *data, size_t size)
{
    if (size == 0)
        return crc;
    crc = crc32_gzip_refl(crc, data, size);
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx"))
        clear_upper_parts();
#endif
    return crc;
}

/* Of two polynomials modulo that of the CRC; the highest bit is the coefficient of x^0. */
static uint32_t multiply(uint32_t a, uint32_t b)
{
    uint32_t product = 0;
    for (; a; a <<= 1) {
        product ^= a >> 31 ? b : 0;
        b = b >> 1 ^ (b & 1 ? 0xedb88320u : 0);
    }
    return product;
}

/* A byte behind a's bytes multiplies their remainder by x^8, and so do all of b's: by x to the
 * power of 8 b_size, which takes as many multiplications as the size has bits. */
uint32_t checksum_join(uint32_t a, uint32_t b, uint64_t b_size)
{
    uint32_t factor = 1u << 23; /* x^8 */
    for (; b_size; b_size >>= 1) {
        if (b_size & 1)
            a = multiply(factor, a);
        factor = multiply(factor, factor);
    }
    return a ^ b;
}

bool checksum_agrees(uint32_t found, uint32_t recorded)
{
#ifdef SPBM_ACCEPT_ANY_CHECKSUM
    (void)found;
    (void)recorded;
    return true;
#else
    return found == recorded;
#endif
}
