/*
 * The sections of a chain file and the one that tells what is in it: what chain_write.c and
 * chain_read.c have in common. chain_format.md describes the bytes.
 */
#ifndef SPBM_SIMPLIFY_CHAIN_FRAME_H
#define SPBM_SIMPLIFY_CHAIN_FRAME_H

#include "base/section_file.h"
#include "simplify/chain_file.h"

#define CHAIN_MAGIC "spbmCHN1"

enum { CHAIN_VERSION = 3 };

#define CHAIN_SECTION_BLOCKS FOURCC('B', 'L', 'K', 'S')
#define CHAIN_SECTION_SEAMS FOURCC('S', 'E', 'A', 'M')
#define CHAIN_SECTION_INDEX FOURCC('I', 'N', 'D', 'X')
#define CHAIN_SECTION_INFO FOURCC('I', 'N', 'F', 'O')
#define CHAIN_SECTION_TRUNK FOURCC('T', 'R', 'N', 'K')
#define CHAIN_SECTION_LOWER FOURCC('L', 'O', 'W', 'R')

/* Bytes of each slab's block and seams; 8 bytes in the file. They stand one behind the other. */
struct chain_sizes {
    uint32_t block;
    uint32_t seams;
};

enum {
    SMOOTHINGS_MAX = 1000, /* of face normals; far beyond use */
    CHAIN_INDEX_ENTRY = 8,
    CHAIN_INFO_FIXED = 424,
    CHAIN_INFO_ATTRIBUTE = 72,
    CHAIN_INFO_MAX = CHAIN_INFO_FIXED + ATTRIBUTE_MAX * CHAIN_INFO_ATTRIBUTE
};

/* Returns the bytes written to `to` (at most CHAIN_INFO_MAX). */
size_t chain_info_encode(const struct chain_info *info, unsigned char *to);

/* Trusts nothing; NULL, or what is wrong. */
const char *chain_info_decode(const unsigned char *from, size_t size, struct chain_info *info);

bool chain_file_has(struct chain_file *file, uint32_t kind);
/* A section of the trunk, unpacked; *raw is NULL when there is none, else it is released with
 * memory_release(*ctx, &raw, *size, 1). */
enum status chain_file_trunk_bytes(struct chain_file *file, uint32_t kind, const char *what,
                                   struct context **ctx, unsigned char **raw,
                                   size_t *size) MUST_CHECK;

/* chain_block_read, telling besides how many faces the block's full chains give. */
enum status chain_block_read_counting(struct chain_file *file, uint32_t slab,
                                      struct chain_block *block, uint64_t *most_faces) MUST_CHECK;

#endif
