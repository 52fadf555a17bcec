/*
 * STAGE 2 and STAGE 3: options in, one loop over blocks, report out.
 */
#ifndef SPBM_SIMPLIFY_SIMPLIFY_H
#define SPBM_SIMPLIFY_SIMPLIFY_H

#include "mesh/export.h"
#include "simplify/chain_file.h"

enum lod_mode { MODE_COLLAPSE = 0, MODE_CLASSIC = 1 };
enum placement { PLACE_DEFAULT = 0, PLACE_SUBSET = 1, PLACE_OPTIMAL = 2 };
enum target_kind { TARGET_FACES = 0, TARGET_RATIO = 1, TARGET_ERROR = 2 };

enum { TARGETS_MAX = 16 };

/* What levels are asked for: the same for patchify (which grows patches fine enough for the finest)
 * and lod. From fine to coarse in any order; sorted by the stages. */
struct target {
    enum target_kind kind;
    uint32_t count;             /* of values; at least 1 */
    double values[TARGETS_MAX]; /* faces, ratio of the store's faces in (0,1], or error */
    bool error_is_relative;     /* errors are fractions of the bounding box's diagonal */
    enum lod_mode mode;
    uint32_t effort;        /* 1 to 3 */
    double error_bound;     /* with a count or ratio: levels stop before this error is passed
                               (STOP_ERROR); 0: none */
    bool bound_is_relative; /* the bound is a fraction of the diagonal */
};

/* Options of patchify as the user gives them; what is not set is chosen from the store's noise, the
 * target, the mode and the effort. Angles in degrees. */
struct patch_request {
    double patch_angle[2];            /* negative: choose */
    double face_angle[2];             /* negative: choose */
    int32_t smoothings;               /* negative: choose */
    double chain_tolerance;           /* negative: choose */
    bool chain_tolerance_is_relative; /* fraction of the diagonal */
    int level;                        /* compression; 0 for a file that lives for one run */
    bool sync;
    bool is_own_store;        /* store_open_own */
    struct store_hold *slabs; /* of the own store, or NULL; they are used up */
    struct chain_hold *hold;  /* for what blocks its limits allow; NULL: all go into the file */
};

/* Fills in what the user left open: deterministic, from the store's info alone. */
void patch_choose(const struct store_info *info, const struct target *target,
                  const struct patch_request *request, struct patch_options *options);

/* The least context.memory_budget with which chain_build succeeds with `threads` threads, however
 * the patches come out, as long as a slab has at most half as many vertices as faces (and what its
 * borders have); `faces`: about as many as the store has, 0: not known; `stride`: bytes of a
 * vertex's attribute record. With less, chain_build uses fewer threads. The formula is in
 * chain_build.c. */
uint64_t chain_build_least_memory(unsigned threads, uint64_t faces, uint32_t stride);

/* What `threads` threads of chain_build usually take beside slabs that import held in memory
 * (store_hold.h), less what they give back of these. */
uint64_t chain_build_memory_beside(unsigned threads, uint64_t faces);

/* Makes the chain file of a store. *info (may be NULL) tells what came out. */
enum status chain_build(struct context *ctx, const char *store_path, const char *chain_path,
                        const struct target *target, const struct patch_request *request,
                        struct chain_info *info) MUST_CHECK;

/* Why a level has the faces it has. */
enum stop_reason {
    STOP_REACHED = 0,  /* N or N - 1 faces, or the error asked for */
    STOP_TOPOLOGY = 1, /* nothing more can be taken away without changing the topology */
    STOP_TOO_FINE = 2, /* more faces were asked for than the chain file or the store has */
    STOP_ERROR = 3     /* an error bound given together with a count came first */
};

struct level {
    uint64_t wanted_faces; /* 0 when an error was asked for */
    double wanted_error;
    uint64_t vertices, faces;
    double error; /* estimated largest distance to the original, model units */
    enum stop_reason reason;
};

struct lod_options {
    struct target target;
    enum placement place;
    const char *output; /* a name; with several levels it holds %d (0 is the finest) */
    struct export_options export;
    bool is_own_file;        /* chain_file_trust */
    struct chain_hold *hold; /* of the blocks that are not in the file, or NULL; it is used up */
    bool keeps_trunk; /* the chain file is written again, with what makes a further level cheap
                         (chain_trunk.h), if it can */
    bool syncs_trunk;
};

/* One stage of joining the blocks' small meshes, mode collapse. */
struct join_stage {
    uint32_t joins;                /* small meshes that came out */
    uint64_t faces_in, largest_in; /* that were joined: of all, and of the largest join */
    uint64_t faces_out;            /* left of all when they were thinned (the root is not) */
};

enum { JOIN_STAGES_MAX = 8 };

struct lod_report {
    uint32_t level_count;
    struct level levels[TARGETS_MAX]; /* finest first */
    uint64_t small_faces;             /* faces of the mesh that the chains gave, mode collapse */
    uint32_t join_count;              /* of joins; 0 with one block */
    struct join_stage joins[JOIN_STAGES_MAX];
};

/*
 * The least context.memory_budget with which lod_build makes the levels of `target` of a mesh of
 * `faces` faces (0: not known; a ratio then counts as one of few faces) with `threads` threads.
 * Mode collapse: by slab, threads and the faces of the finest level; mode classic: a number of
 * bytes for each vertex that chains of so large a mesh have at most.
 */
uint64_t lod_least_memory(const struct target *target, uint64_t faces, unsigned threads,
                          uint32_t stride);

/* What lod_least_memory is to be asked about when levels are made from that chain file: it may have
 * been made for finer ones, which are then passed on the way. */
struct target lod_whole_target(const struct target *target, const struct chain_info *info);

/* Makes the levels. In mode collapse, with counts and no bound of the error, each is the same
 * whatever others are made with it, if none is finer than those that the file was made for.
 * STATUS_TARGET_MISSED when all are written but one missed its target. */
enum status lod_build(struct context *ctx, const char *chain_path,
                      const struct lod_options *options, struct lod_report *report) MUST_CHECK;

#endif
