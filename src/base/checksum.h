/* CRC-32 (the polynomial of gzip and zlib), computed by libdeflate with the machine's own
 * carry-less multiplication where it has one. */
#ifndef SPBM_BASE_CHECKSUM_H
#define SPBM_BASE_CHECKSUM_H

#include <stddef.h>
#include <stdint.h>

/* Continues `crc` (0 to begin with) over `size` bytes. */
uint32_t checksum(uint32_t crc, const void *data, size_t size);

#endif
