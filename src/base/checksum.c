/*
 * CRC-32, by libdeflate: a table lookup a byte takes seconds a gigabyte; carry-less multiplication
 * checks data about as fast as memory gives it.
 */
#include "base/checksum.h"

#include <libdeflate.h>
#include <zlib.h>

uint32_t checksum(uint32_t crc, const void *data, size_t size)
{
    if (size == 0) /* libdeflate takes a NULL buffer for "start again" */
        return crc;
    return libdeflate_crc32(crc, data, size);
}

uint32_t checksum_join(uint32_t a, uint32_t b, uint64_t b_size)
{
    return (uint32_t)crc32_combine(a, b, (z_off_t)b_size);
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
