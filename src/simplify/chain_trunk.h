/*
 * The optional sections of a chain file from which levels begin, so that what was done before need
 * not be done again for a further level: the small mesh of all blocks, thinned, joined and
 * collapsed to a few times the finest level that the file was made for (the upper one), and the
 * same collapsed to the coarsest (the lower one). chain_format.md describes the bytes.
 */
#ifndef SPBM_SIMPLIFY_CHAIN_TRUNK_H
#define SPBM_SIMPLIFY_CHAIN_TRUNK_H

#include "simplify/chain_file.h"
#include "simplify/collapse.h"

struct trunk {
    bool is_lower;  /* which of the two its state is */
    bool has_lower; /* read from a file that has the lower one */
    bool subset;    /* for `--place subset` */
    uint32_t effort;
    uint64_t finest;      /* faces of the first milestone (lod_target.h) */
    uint64_t small_faces; /* that the blocks' meshes had together */
    double lost;          /* how far what they lack lies from them, at most */
    struct collapse_state state;
};

/* The sections' bytes, the upper one's first; NULL where there is none. */
struct packed_trunk {
    unsigned char *bytes[2];
    size_t sizes[2];
};

/* Makes the section of the trunk's state. (Meshes with numbers at the end of what floats can hold
 * get none.) */
enum status chain_trunk_pack(struct context *ctx, const struct trunk *trunk, uint32_t stride,
                             struct packed_trunk *packed) MUST_CHECK;
void packed_trunk_clear(struct context *ctx, struct packed_trunk *packed);
/* Writes the chain file again, with the sections in place of those that it may have; a lower one
 * does not stay where there is another upper one. */
enum status chain_trunk_add(struct context *ctx, const char *path,
                            const struct packed_trunk *packed, bool sync) MUST_CHECK;

/* Reads the upper or the lower one, if it is there; all zero if not. Every number is in range;
 * whether the faces are a manifold is collapse_resume's matter. */
enum status chain_trunk_read(struct chain_file *file, bool is_lower,
                             struct trunk *trunk) MUST_CHECK;
/* Goes on from the trunk of a file with that information; its state is given away, on failure too.
 * STATUS_BAD_INPUT, named as options->source, when it is no manifold or has another topology. */
enum status chain_trunk_resume(struct context *ctx, const struct chain_info *info,
                               const struct collapse_options *options, struct trunk *trunk,
                               struct collapse **out) MUST_CHECK;
/* Reads the sections that are there, and tries whether they can be gone on from. */
enum status chain_trunk_check(struct context *ctx, struct chain_file *file) MUST_CHECK;
void chain_trunk_clear(struct context *ctx, uint32_t stride, struct trunk *trunk);

#endif
