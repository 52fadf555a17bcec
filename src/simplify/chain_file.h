/*
 * The chain file: chains, patches and junctions, one compressed block a slab, so that a level of
 * detail can be made without looking at the surface again. chain_format.md describes the bytes.
 */
#ifndef SPBM_SIMPLIFY_CHAIN_FILE_H
#define SPBM_SIMPLIFY_CHAIN_FILE_H

#include "mesh/store.h"
#include "simplify/chain_hold.h"

/* Compression of chain files that are kept: level 6 takes three times as long and makes them 4 %
 * smaller. Those of one run are not compressed. */
enum { CHAIN_KEPT_LEVEL = 1 };

struct chain_info {
    struct topology topology; /* of the store */
    struct attributes attributes;
    double origin[3];
    double box_low[3], box_high[3];
    double mean_edge, noise, area; /* of the store */
    bool is_float32;
    uint32_t slab_count;
    uint32_t store_crc;           /* of the store's end marker: says which store it came from */
    struct patch_options options; /* as used, so that growth can be repeated to get the labels */
    uint32_t mode;                /* enum lod_mode it was made for */
    uint32_t effort;
    uint32_t target_kind; /* enum target_kind */
    uint32_t target_count;
    double targets[16]; /* as given */
    uint64_t patches;
    uint64_t chains; /* seam chains counted once */
    uint64_t seam_chains;
    uint64_t junctions;      /* seam ones counted once */
    uint64_t chain_vertices; /* junctions and chain interiors; seam ones counted once */
    uint64_t most_faces;     /* the finest level that this file can give */
    double tolerance;        /* chain tolerance that was used when writing */
};

struct chain_file; /* opened for reading; blocks may be read from several threads */

enum status chain_file_open(struct context *ctx, const char *path,
                            struct chain_file **out) MUST_CHECK;
void chain_file_close(struct chain_file **file);
/* Says that this very process wrote the file where nobody else can reach it: what has the right
 * checksum is then as it was written, and loops are not followed again. Blocks that `hold` (may be
 * NULL) has are taken from there; it outlives the file. */
void chain_file_trust(struct chain_file *file, const struct chain_hold *hold);
const struct chain_info *chain_file_info(const struct chain_file *file);
/* Its path as given, for words. */
const char *chain_file_name(const struct chain_file *file);

/* Reads, verifies and checks one block with its seam chains; every number in it is in range and P1,
 * P2 hold as far as one block shows. Its arrays are not to be changed; released with
 * chain_block_release. */
enum status chain_block_read(struct chain_file *file, uint32_t slab,
                             struct chain_block *block) MUST_CHECK;
void chain_block_release(struct chain_file *file, struct chain_block *block);
/* About how much there is in a block, in no unit: to compare it with the file's others. */
uint64_t chain_block_work(const struct chain_file *file, uint32_t slab);
/* Of a block whose arrays are all its own. */
void chain_block_clear(struct context *ctx, uint32_t stride, struct chain_block *block);

/* Full verification; STATUS_BAD_INPUT with the first thing that is wrong. */
enum status chain_file_check(struct context *ctx, const char *path) MUST_CHECK;

/* ---- writing, for chain_build ---- */

struct chain_writer;

/* Blocks are given in the order of the slabs, then the seams of every slab in that order, then the
 * info, as it is known only then. Compression level 0: for files that live for one run. */
enum status chain_writer_open(struct context *ctx, const char *path, int level, uint32_t slab_count,
                              uint32_t stride, struct chain_writer **out) MUST_CHECK;
/* Packing can be done by any worker; writing is in order. `room` (may be NULL) is memory that it
 * may use. */
enum status chain_block_pack(struct context *ctx, const struct chain_block *block, uint32_t stride,
                             int level, void *room, size_t room_size, unsigned char **packed,
                             size_t *size) MUST_CHECK;
/* NULL and 0 for a block that is held in memory. */
enum status chain_writer_block(struct chain_writer *writer, const unsigned char *packed,
                               size_t size) MUST_CHECK;
/* The seam fields of `block` only. */
enum status chain_writer_seams(struct chain_writer *writer,
                               const struct chain_block *block) MUST_CHECK;
enum status chain_writer_commit(struct chain_writer **writer, const struct chain_info *info,
                                bool sync) MUST_CHECK;
void chain_writer_discard(struct chain_writer **writer);

#endif
