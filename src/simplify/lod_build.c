/*
 * STAGE 3: chain file in, levels of detail out. What both modes have in common: which levels, under
 * which names, and the verdict at the end; how a level is made is the mode's.
 */
#include <string.h>

#include "simplify/lod_classic.h"
#include "simplify/lod_collapse.h"
#include "simplify/lod_output.h"
#include "simplify/lod_target.h"

/* Faces of the finest level that are asked for; 0: by error, or not known. */
static double finest_faces(const struct target *target, uint64_t faces)
{
    double finest = 0;
    for (uint32_t i = 0; i < target->count && i < TARGETS_MAX; i++) {
        double wanted = target->kind == TARGET_FACES   ? target->values[i]
                        : target->kind == TARGET_RATIO ? target->values[i] * (double)faces
                                                       : 0;
        finest = wanted > finest ? wanted : finest;
    }
    return faces > 0 && finest > (double)faces ? (double)faces : finest;
}

/*
 * Measured on scans of 4 million faces, clean and noisy. What is left of all blocks before the last
 * collapse, up to ten times the finest level, takes 62 bytes a face; before, each thread makes the
 * small mesh of one block, at 256 bytes a face, of which a slab has as many more as the level is
 * finer.
 */
uint64_t lod_least_memory(const struct target *target, uint64_t faces, unsigned threads,
                          uint32_t stride)
{
    static const double small_of_level[] = {0, 20, 40, 80};
    const double fixed = 3 << 20, unknown_leaf = 24 << 20, leaf_face = 256 + stride;
    const double root_face = 10 * (64 + stride / 2.0), chain_vertex = 300 + stride;
    double finest = finest_faces(target, faces), leaf = unknown_leaf;
    if (target->mode == MODE_CLASSIC)
        return (uint64_t)(16 * fixed / 3 + (double)faces / 16 * chain_vertex);
    if (faces > 0 && target->effort <= 3) {
        double part = 0.08 + small_of_level[target->effort] * finest / (double)faces;
        leaf = leaf_face * SLAB_FACES_MAX * (part < 1 ? part : 1);
    }
    return (uint64_t)(fixed + threads * leaf + finest * root_face);
}

enum status lod_build(struct context *ctx, const char *chain_path,
                      const struct lod_options *options, struct lod_report *report)
{
    struct chain_file *file = NULL;
    memset(report, 0, sizeof *report);
    enum status status = chain_file_open(ctx, chain_path, &file);
    if (status != STATUS_OK)
        return status;
    if (options->is_own_file)
        chain_file_trust(file, options->hold);
    const struct chain_info *info = chain_file_info(file);
    status = lod_target_levels(ctx, &options->target, info, report);
    if (status == STATUS_OK)
        status = lod_output_check(ctx, options, report->level_count, chain_path);
    if (status == STATUS_OK)
        status = options->target.mode == MODE_CLASSIC ? lod_classic(ctx, file, options, report)
                                                      : lod_collapse(ctx, file, options, report);
    if (status == STATUS_OK)
        status = lod_target_verdict(ctx, info, report);
    chain_file_close(&file);
    return status;
}
