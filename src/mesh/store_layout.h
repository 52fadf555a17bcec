/*
 * Where everything in a store lies; store_format.md in C. Used by the writer and the readers.
 */
#ifndef SPBM_MESH_STORE_LAYOUT_H
#define SPBM_MESH_STORE_LAYOUT_H

#include "mesh/store.h"

#define STORE_MAGIC "spbmMSH1"

enum {
    STORE_VERSION = 1,
    STORE_INFO_SIZE = 560,
    STORE_ATTRIBUTE_SIZE = 72,
    STORE_SLAB_ENTRY_SIZE = 32,
    STORE_PIECE_ALIGN = 64,
    STORE_SHIFT_MIN = 2
};

#define STORE_KIND_SLABS FOURCC('S', 'L', 'A', 'B')
#define STORE_KIND_TABLE FOURCC('S', 'T', 'A', 'B')
#define STORE_KIND_INFO FOURCC('I', 'N', 'F', 'O')
#define STORE_KIND_ATTRIBUTES FOURCC('A', 'T', 'T', 'R')

/* An entry of the slab table. */
struct slab_entry {
    uint64_t offset; /* of the slab's block in section SLAB */
    uint32_t vertex_first;
    uint32_t vertex_count; /* its own */
    uint32_t foreign_count;
    uint32_t face_count;
    uint32_t crc; /* of the block */
};

/* Offsets of the pieces of a slab's block, and its size, a multiple of STORE_PIECE_ALIGN. */
struct slab_layout {
    uint64_t faces;
    uint64_t neighbours;
    uint64_t mates;
    uint64_t positions;
    uint64_t foreign;
    uint64_t foreign_positions;
    uint64_t records;
    uint64_t size;
};

void slab_layout_find(const struct slab_entry *entry, uint32_t stride, struct slab_layout *layout);

void slab_entry_encode(const struct slab_entry *entry, unsigned char bytes[STORE_SLAB_ENTRY_SIZE]);
/* False if bytes that must be zero are not. */
bool slab_entry_decode(const unsigned char bytes[STORE_SLAB_ENTRY_SIZE], struct slab_entry *entry);

void store_info_encode(const struct store_info *info, unsigned char bytes[STORE_INFO_SIZE]);
/* Decodes and judges everything that can be judged from the section alone; NULL if it is sound,
 * else what is wrong. The attributes are not touched. */
const char *store_info_decode(const unsigned char bytes[STORE_INFO_SIZE], struct store_info *info);

/* Size of the section ATTR, and its bytes. */
size_t store_attributes_size(const struct attributes *attributes);
void store_attributes_encode(const struct attributes *attributes, unsigned char *bytes);
const char *store_attributes_decode(const unsigned char *bytes, size_t size,
                                    struct attributes *attributes);

/* Slabs of that many faces. */
static inline uint64_t slabs_of(uint64_t face_count, unsigned slab_shift)
{
    return (face_count + ((uint64_t)1 << slab_shift) - 1) >> slab_shift;
}

#endif
