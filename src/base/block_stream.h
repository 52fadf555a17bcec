/*
 * Independent blocks of bytes, each compressed by libdeflate (or kept as it is when that does not
 * help or was not asked for), with sizes and a CRC-32, so that any block can be read alone and
 * truncation or damage shows. See block_stream_format in section_file_format.md.
 */
#ifndef SPBM_BASE_BLOCK_STREAM_H
#define SPBM_BASE_BLOCK_STREAM_H

#include "report.h"

/* A block as stored: 24 bytes of header (magic "blk1", stored size, raw size, CRC-32 of the raw
 * bytes, CRC-32 of the stored bytes, CRC-32 of these 20 bytes), then the stored bytes. */
enum { BLOCK_HEADER_SIZE = 24, BLOCK_MAX = 1 << 30 };

/* Packs `raw` into a new block of *size bytes in *block (released with memory_release(ctx, &block,
 * size, 1)). level 0: not compressed; 1 to 12 as in libdeflate. The bytes are deterministic. */
enum status block_pack(struct context *ctx, const void *raw, size_t raw_size, int level,
                       unsigned char **block, size_t *size) MUST_CHECK;

/* Unpacks the block that starts at `block` with `available` bytes; *raw (raw_size bytes) is
 * released with memory_release(ctx, &raw, raw_size, 1); *taken is the block's whole size. `what`
 * names file and block for messages. A claimed size is believed only within BLOCK_MAX and 1,032
 * times the stored size (deflate's limit). */
enum status block_unpack(struct context *ctx, const char *what, const unsigned char *block,
                         size_t available, unsigned char **raw, size_t *raw_size,
                         size_t *taken) MUST_CHECK;

#endif
