/* CRC-32 (the polynomial of gzip and zlib), computed by ISA-L with the machine's own
 * carry-less multiplication where it has one. */
#ifndef SPBM_BASE_CHECKSUM_H
#define SPBM_BASE_CHECKSUM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* Continues `crc` (0 to begin with) over `size` bytes. */
uint32_t checksum(uint32_t crc, const void *data, size_t size);

/* Of a's bytes and b's behind them, from both's checksums (each begun with 0) and b's size. */
uint32_t checksum_join(uint32_t a, uint32_t b, uint64_t b_size);

/* Is `found`, computed over what was read, what the file records? The only way in which readers
 * compare checksums: in fuzzing builds (the build option `fuzz`) always true, so that damaged bytes
 * get past this first guard and reach the checks behind it. */
bool checksum_agrees(uint32_t found, uint32_t recorded);

#endif
