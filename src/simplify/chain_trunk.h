/*
 * The optional section of a chain file from which levels begin: the small mesh of all blocks,
 * thinned, joined and collapsed to a few times the finest level that the file was made for, so that
 * a further level need not make it again. chain_format.md describes the bytes.
 */
#ifndef SPBM_SIMPLIFY_CHAIN_TRUNK_H
#define SPBM_SIMPLIFY_CHAIN_TRUNK_H

#include "simplify/chain_file.h"
#include "simplify/collapse.h"

struct trunk {
    bool subset; /* for `--place subset` */
    uint32_t effort;
    uint64_t finest;      /* faces of the first milestone (lod_target.h) */
    uint64_t small_faces; /* that the blocks' meshes had together */
    double lost;          /* how far what they lack lies from them, at most */
    struct collapse_state state;
};

/* Writes the chain file again, with the section in place of one that it may have. (Meshes with
 * numbers at the end of what floats can hold get none.) */
enum status chain_trunk_add(struct context *ctx, const char *path, const struct trunk *trunk,
                            uint32_t stride, bool sync) MUST_CHECK;

/* Reads the section, if there is one; all zero if there is none. Every number is in range; whether
 * the faces are a manifold is collapse_resume's matter. */
enum status chain_trunk_read(struct chain_file *file, struct trunk *trunk) MUST_CHECK;
/* Goes on from the trunk of a file with that information; its state is given away, on failure too.
 * STATUS_BAD_INPUT, named as options->source, when it is no manifold or has another topology. */
enum status chain_trunk_resume(struct context *ctx, const struct chain_info *info,
                               const struct collapse_options *options, struct trunk *trunk,
                               struct collapse **out) MUST_CHECK;
/* Reads the section, if there is one, and tries whether it can be gone on from. */
enum status chain_trunk_check(struct context *ctx, struct chain_file *file) MUST_CHECK;
void chain_trunk_clear(struct context *ctx, uint32_t stride, struct trunk *trunk);

#endif
