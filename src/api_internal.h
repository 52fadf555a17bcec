/*
 * What the files of the public interface share: the job, how every call begins and ends, and the
 * turning of internal reports into public ones.
 */
#ifndef SPBM_API_INTERNAL_H
#define SPBM_API_INTERNAL_H

#include <limits.h>

#include "base/report.h"
#include "inspect/quality.h"
#include "mesh/estimate.h"
#include "mesh/store.h"
#include "simplify/simplify.h"
#include "simplify/topology.h"
#include "spbm.h"

struct spbm_job {
    struct context ctx;
    spbm_settings settings;
};

/* Every call begins and ends with these two: the first failure of this call is what counts, and a
 * failure always has words. */
struct context *call_begin(spbm_job *job);
spbm_status call_end(spbm_job *job, enum status status);

/* ---- limits ---- */

enum run_stage { STAGE_IMPORT, STAGE_PATCHIFY, STAGE_LOD, RUN_STAGES };

/* What is known of a job's size; zeros where nothing is. */
struct run_size {
    uint64_t faces;
    uint32_t stride; /* bytes of a vertex's attributes */
    struct target target;
};

/* The user's budget for the process; UINT64_MAX: none. */
static inline uint64_t job_memory(const struct spbm_job *job)
{
    return job->settings.memory ? job->settings.memory : UINT64_MAX;
}

const char *stage_name(enum run_stage stage);
/* Of the process, with all that is set aside. */
uint64_t stage_least_memory(enum run_stage stage, const struct run_size *size, unsigned threads);
/* Sets the context's limits to what `threads` threads leave of `memory`. */
void budget_begin(struct context *ctx, uint64_t memory, unsigned threads);
/* As many of the job's threads as fit, at least one. */
unsigned fitting_threads(const struct spbm_job *job, enum run_stage stage,
                         const struct run_size *size);
/* STATUS_NO_MEMORY, with what is needed, if a stage from `first` to `last` cannot do even with one
 * thread. */
enum status stages_fit(struct spbm_job *job, enum run_stage first, enum run_stage last,
                       const struct run_size *size) MUST_CHECK;
/* The same of one stage that begins now, and limits its threads to what fits. */
enum status stage_begin(struct spbm_job *job, enum run_stage stage,
                        const struct run_size *size) MUST_CHECK;

/* ---- temporary files ---- */

/* What lod_build does not report: the figures that words about a level need. */
enum status read_chain_info(struct context *ctx, const char *chains,
                            struct chain_info *info) MUST_CHECK;
/* Whose chain file it is that levels are made from: */
enum chains_are {
    CHAINS_GIVEN,
    CHAINS_OWN,        /* of this run alone: chain_file_trust */
    CHAINS_KEPT,       /* for further levels, too: lod_options.keeps_trunk */
    CHAINS_KEPT_SYNCED /* and it is to be on the disk */
};

/* `hold`: CHAINS_OWN's, else NULL. */
enum status make_levels(struct context *ctx, const char *chains, const char *output,
                        const spbm_target *target, const spbm_lod_options *options,
                        enum chains_are chains_are, struct chain_hold *hold,
                        struct lod_report *report) MUST_CHECK;

/* Where store and chain file of a whole run lie: kept under names, or in files without one. */
struct workspace {
    struct context *ctx;
    const char *tmp_dir; /* of the context, put back at the end */
    char folder[PATH_MAX];
    char store[PATH_MAX], chains[PATH_MAX];
    int store_fd, chains_fd;               /* -1 when kept */
    char raw[PATH_MAX], scratch[PATH_MAX]; /* store and chain file of before topology_rebuild */
    int raw_fd, scratch_fd;                /* -1 when there is none */
};

/* Nothing is open yet. */
void workspace_init(struct workspace *work, struct context *ctx);

/* mesh.store and mesh.chains in `keep_dir`, which is made if need be. */
enum status workspace_keep(struct workspace *work, const char *keep_dir) MUST_CHECK;
/* Opens both without a name, where `output` lies if nothing else is said; fds are -1 before. */
enum status workspace_hide(struct workspace *work, const char *output) MUST_CHECK;
/* Opens the other two; after the first two or in their place. */
enum status workspace_hide_raw(struct workspace *work, const char *output) MUST_CHECK;
/* Closes one of them, which gives its space back, and sets it to -1. Safe when it is. */
void close_hidden(int *fd);
/* Gives the temporary file's words instead of its path in /proc. */
void workspace_explain(struct workspace *work);
void workspace_close(struct workspace *work);

/* ---- options ---- */

bool is_standard_stream(const char *path);
/* The directory that `path` lies in, in `folder` (PATH_MAX bytes). */
void folder_of(const char *path, char *folder);

/* Each fails with STATUS_MISUSE or STATUS_IO where the work could not end well. */
enum status check_writable(struct context *ctx, const char *output) MUST_CHECK;
enum status check_format(struct context *ctx, const char *output, spbm_format format) MUST_CHECK;
enum status check_inputs(struct context *ctx, const char *const *inputs, size_t input_count,
                         const char *output) MUST_CHECK;
enum status check_target(struct context *ctx, const spbm_target *target) MUST_CHECK;
enum status check_levels(struct context *ctx, const char *const *inputs, size_t input_count,
                         const char *output, const spbm_target *target,
                         const spbm_lod_options *options) MUST_CHECK;
enum status check_patch_options(struct context *ctx, const spbm_patch_options *options) MUST_CHECK;

/* All that can be known of a whole run before it begins: are the options good, does it fit? Fills
 * in what the inputs claim of their size; the estimates are summed. */
enum status check_simplify(struct spbm_job *job, const char *const *inputs, size_t input_count,
                           const char *output, const spbm_simplify_options *options,
                           struct run_size *size, struct mesh_estimate *sum) MUST_CHECK;

/* A stage that is given another stage's file says which one that is, and what makes the right one.
 */
enum status check_kind(struct context *ctx, const char *path, spbm_file_kind wanted) MUST_CHECK;
enum status check_topology(struct context *ctx, const spbm_topology_options *options) MUST_CHECK;

struct target make_target(const spbm_target *from);
struct patch_request make_request(const spbm_patch_options *from, int level, bool sync);
struct topology_options make_topology(const spbm_topology_options *from);

/* Which of our formats a file has, by its first bytes, and its size (0: not a regular file). */
enum status recognise_file(struct context *ctx, const char *path, spbm_file_kind *kind,
                           uint64_t *size) MUST_CHECK;

/* ---- reports ---- */

struct clock {
    double wall, cpu; /* seconds */
};

struct clock clock_now(void);
/* What a stage took that began at *began and ends now, where the next one begins. */
spbm_stage stage_since(struct context *ctx, const char *name, struct clock *began);

void copy_store(spbm_store_figures *to, const struct store_info *from);
void copy_chains(spbm_chain_figures *to, const struct chain_info *from);
/* Tells everything that was removed to options->removed, too. */
void copy_removal(spbm_removal *to, const spbm_topology_options *options,
                  const struct topology_report *from);
void copy_levels(spbm_levels *to, const struct lod_report *from, const struct chain_info *chains);
void copy_quality(spbm_quality *to, const struct quality *from, uint32_t attribute_count);

#endif
