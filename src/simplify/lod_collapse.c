/*
 * Mode collapse.
 *
 * The plain way is to collapse the edges of the whole surface. Here the patches have flattened most
 * of it already: each block gives a small mesh (small_mesh.h) of its chains and patches alone.
 * Blocks are independent jobs; whoever builds the last of LEAF_WIDTH neighbouring ones makes a leaf
 * of them. Leaves, their seam vertices locked, go down to SLACK times the density that the finest
 * level needs; then they are joined, JOIN_WIDTH at a time along the curve, what has become interior
 * is unlocked and goes down with the rest, up to the root, which makes the levels (lod_levels.c).
 * The finest level is the one that the chain file was made for, if none that is asked for is finer,
 * so that the root is the same for all. Down to SLACK times the density no collapse comes near the
 * errors that the levels will have, so that they are measured only where an error is asked for or
 * the root is at work: the mean errors stay within half a percent, the largest go up and down alike
 * (noisy scan, dragon; a quarter of the time of nodes below the root). What is done depends on the
 * chain file and the targets only.
 */
#include "simplify/lod_collapse.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "simplify/lod_levels.h"
#include "simplify/small_mesh.h"

/* A leaf's blocks are joined before it is thinned, as what seams hold back is left to the root:
 * with a block a leaf, lod takes a sixth longer on a scan of a million faces. */
enum { LEAF_WIDTH = 4, JOIN_WIDTH = 8 };

/* A leaf is left with so many times the faces that the finest level would give it, by effort:
 * enough for the root to choose where they are needed, and for the locked seams not to show. What
 * is done below the root is done roughly. The means do not hang on that from 3 times on (22 levels
 * of dragon, cranium, brain and two generated scans: within 1 %, but with 2.5 the brain's at 30,600
 * faces is a quarter larger), the largest distances do: at effort 2, 4 for 5 makes them 5 % larger
 * on the whole and lod a fifteenth cheaper; at effort 1, 3 for 4 makes it 11 % and an eighth. */
static const double SLACK[4] = {10, 3, 4, 10};
/* A joined node that has not more than so many times what it is to be left with stays as it is, by
 * effort: taking it up would cost more than what the next node has to do less. The root's memory is
 * counted with ten times the finest level. */
static const double NEARLY[4] = {1, 2, 2, 1};
/* A leaf is collapsed up to this part of the finest level's error. */
static const double ERROR_PART = 0.5;
/* Chain tolerance as a part of the mean edge of the finest level, and of the finest error. */
static const double EDGE_PART = 0.03;
static const double TOLERANCE_PART = 0.25;
/* Of the patches' bulge, small_bulge.h. */
static const double GIVEN_BACK = 0.4;

/* A node that is to be made, and about how much there is to do for it. */
struct node_job {
    uint64_t work;
    uint32_t node;
};

/* A block's mesh as it was at first (small_mesh.h). */
struct built {
    uint64_t faces;
    double lost;
    bool is_cut;
};

struct lod {
    struct context *ctx;
    struct chain_file *file;
    const struct chain_info *info;
    const struct lod_options *options;
    struct lod_report *report;
    struct collapse_options collapse;
    struct milestones milestones;
    uint32_t stride;
    double tolerance;
    uint64_t finest_faces; /* of the file or asked for; 0: an error is asked for */
    double finest_error;
    struct small_workspace *spaces; /* one a worker */
    struct small_mesh *nodes;       /* of one stage of the tree */
    struct node_job *jobs;          /* of one stage, the largest first */
    _Atomic uint32_t *unbuilt;      /* blocks of each leaf */
    uint64_t *weights;              /* patches below each node */
    struct built *built;            /* of each block */
    double lost;                    /* of the blocks' meshes, the largest */
    bool is_cut;                    /* any of them */
    uint32_t node_count;
    uint32_t span; /* slabs below a node */
};

/* ---- how fine ---- */

static void choose_fineness(struct lod *lod)
{
    const struct level *finest = &lod->report->levels[0];
    double diagonal = 0;
    for (int k = 0; k < 3; k++) {
        const double side = lod->info->box_high[k] - lod->info->box_low[k];
        diagonal += side * side;
    }
    diagonal = sqrt(diagonal);
    lod_target_milestones(&lod->options->target, lod->info, &lod->milestones);
    lod->finest_faces = lod->milestones.count > 0 ? lod->milestones.faces[0] : finest->wanted_faces;
    lod->finest_error = lod_error_bound(finest);
    lod->tolerance = INFINITY;
    if (lod->finest_faces) {
        /* edge of an equilateral triangle: area = sqrt(3) / 4 edge^2 */
        const double face = lod->info->area / (double)lod->finest_faces;
        lod->tolerance = EDGE_PART * sqrt(2.31 * face);
    }
    lod->tolerance = fmin(lod->tolerance, TOLERANCE_PART * lod->finest_error);
    lod->tolerance = lod->tolerance < 1e-3 * diagonal ? lod->tolerance : 1e-3 * diagonal;
    if (lod->info->tolerance > 0) /* asked for */
        lod->tolerance = lod->info->tolerance;
}

/* ---- one node of the tree ---- */

/* `width` neighbours, or what is left of them, become one. */
struct group {
    uint32_t first, count;
};

static uint32_t count_groups(uint32_t count, uint32_t width)
{
    return (uint32_t)(((uint64_t)count + width - 1) / width);
}

static struct group group_of(uint32_t count, uint64_t index, uint32_t width)
{
    const uint32_t first = (uint32_t)index * width, left = count - first;
    return (struct group){first, left < width ? left : width};
}

/* The first of each group moves to where the group counts. */
static void close_up(struct lod *lod, uint32_t groups, uint32_t width)
{
    for (uint32_t i = 1; i < groups; i++) {
        lod->nodes[i] = lod->nodes[i * width];
        lod->weights[i] = lod->weights[i * width];
        memset(&lod->nodes[i * width], 0, sizeof *lod->nodes);
    }
    lod->node_count = groups;
    lod->span *= width;
}

/* The largest come first, as the last decide how long all threads but one have nothing to do. */
static int compare_jobs(const void *a, const void *b)
{
    const struct node_job *first = a, *second = b;
    if (first->work != second->work)
        return first->work > second->work ? -1 : 1;
    return first->node < second->node ? -1 : 1;
}

/* Collapses a node that is not the root to what the finest level may need of it. */
static enum status thin_node(struct lod *lod, uint32_t node)
{
    struct context *ctx = lod->ctx;
    struct small_mesh *mesh = &lod->nodes[node];
    struct collapse_options options = lod->collapse;
    struct collapse *collapse = NULL;
    uint32_t *sources = NULL, *places = NULL;
    const size_t vertices = (size_t)mesh->triangles.vertex_count;
    const double part = (double)lod->weights[node] / (double)(lod->info->patches + 1);
    const uint32_t effort = lod->collapse.effort;
    double wanted = lod->finest_faces ? SLACK[effort] * part * (double)lod->finest_faces : 0;
    const double enough = lod->span > LEAF_WIDTH ? NEARLY[effort] * wanted : wanted;
    if ((double)mesh->triangles.face_count <= enough || lod->node_count == 1)
        return STATUS_OK;
    options.keep_guards = true; /* the root has more to choose from */
    options.roughly = !(lod->finest_error < INFINITY);
    enum status status = memory_take_zeroed(ctx, vertices, 1, &mesh->triangles.locked);
    if (status != STATUS_OK)
        return status;
    small_mesh_lock(mesh, mesh->triangles.locked);
    /* what the seams hold back is not to be missing inside: with slabs of 2^13 faces the mean error
     * of skull at 2,000 faces was twice what it is with one slab */
    for (size_t v = 0; v < vertices && wanted > 0; v++)
        wanted += mesh->triangles.locked[v] ? 2 : 0;
    status =
        collapse_begin_giving(ctx, &options, &mesh->triangles, &lod->info->attributes, &collapse);
    if (status == STATUS_OK)
        status = collapse_run(collapse, (uint64_t)wanted, lod->finest_error * ERROR_PART);
    if (status == STATUS_OK)
        status = collapse_extract_compact(collapse, &mesh->triangles, &sources);
    collapse_end(&collapse);
    const size_t left = (size_t)mesh->triangles.vertex_count;
    if (status == STATUS_OK)
        status = memory_take(ctx, vertices, sizeof *places, &places);
    if (status == STATUS_OK) {
        /* locked vertices are there still: find them again */
        for (uint32_t v = 0; v < left; v++)
            places[sources[v]] = v;
        for (uint32_t i = 0; i < mesh->seam_count; i++)
            mesh->seams[i].vertex = places[mesh->seams[i].vertex];
    }
    memory_release(ctx, &places, vertices, sizeof *places);
    memory_release(ctx, &sources, left, sizeof *sources);
    return status;
}

static enum status build_block(struct lod *lod, uint32_t slab, unsigned worker)
{
    struct small_mesh *mesh = &lod->nodes[slab];
    struct chain_block block;
    enum status status = chain_block_read(lod->file, slab, &block);
    if (status != STATUS_OK)
        return status;
    status = small_mesh_build(lod->ctx, &lod->spaces[worker], lod->stride, &block, lod->tolerance,
                              lod->collapse.subset ? 0 : GIVEN_BACK, mesh);
    lod->weights[slab] = block.patch_count;
    lod->built[slab] = (struct built){mesh->triangles.face_count, mesh->lost, mesh->is_cut};
    chain_block_release(lod->file, &block);
    return status;
}

/* Joins the nodes [first, first + count), which stand for `span` slabs each, all but the last; the
 * whole takes the place of the first. */
static enum status join_nodes(struct lod *lod, uint32_t first, uint32_t count, uint32_t span)
{
    const uint64_t slab_first = (uint64_t)first * span,
                   slab_end = slab_first + (uint64_t)count * span;
    const uint32_t slabs = lod->info->slab_count;
    struct small_mesh whole;
    enum status status = small_mesh_join(lod->ctx, lod->stride, (uint32_t)slab_first,
                                         slab_end < slabs ? (uint32_t)slab_end : slabs,
                                         lod->nodes + first, count, &whole);
    if (status != STATUS_OK)
        return status;
    lod->nodes[first] = whole;
    for (uint32_t i = 1; i < count; i++)
        lod->weights[first] += lod->weights[first + i];
    return STATUS_OK;
}

/* Builds a block; whoever builds the last one of a leaf goes on with the leaf. */
static enum status make_block(void *user, uint64_t job, unsigned worker)
{
    struct lod *lod = user;
    const uint32_t slab = lod->jobs[job].node, index = slab / LEAF_WIDTH;
    enum status status = build_block(lod, slab, worker);
    if (status != STATUS_OK || atomic_fetch_sub(&lod->unbuilt[index], 1) > 1)
        return status;
    const struct group leaf = group_of(lod->info->slab_count, index, LEAF_WIDTH);
    status = leaf.count > 1 ? join_nodes(lod, leaf.first, leaf.count, 1)
                            : small_mesh_split(lod->ctx, lod->stride, &lod->nodes[leaf.first]);
    return status == STATUS_OK ? thin_node(lod, leaf.first) : status;
}

static enum status join_children(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct lod *lod = user;
    const struct group children = group_of(lod->node_count, job, JOIN_WIDTH);
    return join_nodes(lod, children.first, children.count, lod->span);
}

static enum status thin_parent(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct lod *lod = user;
    return thin_node(lod, lod->jobs[job].node);
}

/* ---- the tree ---- */

static void clear_nodes(struct lod *lod)
{
    for (uint32_t i = 0; i < lod->info->slab_count; i++)
        small_mesh_clear(lod->ctx, lod->stride, &lod->nodes[i]);
}

/* Orders the blocks: leaf by leaf, that with the most work first. Of the blocks of each leaf that
 * is not whole yet one is being built, so that no more wait than workers have leaves in hand. */
static void order_blocks(struct lod *lod)
{
    const uint32_t slabs = lod->info->slab_count, leaves = count_groups(slabs, LEAF_WIDTH);
    uint32_t end = slabs;
    for (uint32_t i = 0; i < leaves; i++)
        lod->jobs[i] = (struct node_job){0, i};
    for (uint32_t i = 0; i < slabs; i++)
        lod->jobs[i / LEAF_WIDTH].work += chain_block_work(lod->file, i);
    qsort(lod->jobs, leaves, sizeof *lod->jobs, compare_jobs);
    for (uint32_t i = leaves; i-- > 0;) { /* which takes more room than what is still to be read */
        const uint32_t index = lod->jobs[i].node;
        const struct group leaf = group_of(slabs, index, LEAF_WIDTH);
        lod->unbuilt[index] = leaf.count;
        for (uint32_t k = leaf.count; k-- > 0;)
            lod->jobs[--end] = (struct node_job){0, leaf.first + k};
    }
}

/* All blocks, thinned. When the chains at this tolerance do not give what the finest level wants,
 * again with a finer one. */
static enum status make_leaves(struct lod *lod)
{
    for (;;) {
        const uint32_t slabs = lod->info->slab_count, leaves = count_groups(slabs, LEAF_WIDTH);
        lod->node_count = leaves;
        lod->span = 1;
        order_blocks(lod);
        enum status status = parallel_for(lod->ctx, slabs, make_block, lod);
        if (status != STATUS_OK)
            return status;
        lod->report->small_faces = 0;
        lod->lost = 0;
        lod->is_cut = false;
        for (uint32_t i = 0; i < slabs; i++) {
            lod->report->small_faces += lod->built[i].faces;
            lod->lost = fmax(lod->lost, lod->built[i].lost);
            lod->is_cut |= lod->built[i].is_cut;
        }
        close_up(lod, leaves, LEAF_WIDTH);
        const double enough = 1.5 * (double)lod->finest_faces;
        if ((double)lod->report->small_faces >= enough || !(lod->is_cut || lod->lost > 0))
            return STATUS_OK;
        lod->tolerance = lod->tolerance > 1e-12 * sqrt(lod->info->area) ? lod->tolerance / 8 : 0;
        clear_nodes(lod);
    }
}

static uint64_t count_faces(const struct lod *lod, uint64_t *largest)
{
    uint64_t sum = 0;
    for (uint32_t i = 0; i < lod->node_count; i++) {
        const uint64_t faces = lod->nodes[i].triangles.face_count;
        sum += faces;
        *largest = faces > *largest ? faces : *largest;
    }
    return sum;
}

/* The stages of a tree over 2^14 slabs are five. */
static struct join_stage *next_stage(struct lod *lod)
{
    struct lod_report *report = lod->report;
    if (report->join_count < JOIN_STAGES_MAX)
        report->join_count++;
    return &report->joins[report->join_count - 1];
}

/* Joins all leaves into one, stage by stage. */
static enum status join_leaves(struct lod *lod)
{
    while (lod->node_count > 1) {
        const uint32_t parents = count_groups(lod->node_count, JOIN_WIDTH);
        enum status status = parallel_for(lod->ctx, parents, join_children, lod);
        if (status != STATUS_OK)
            return status;
        close_up(lod, parents, JOIN_WIDTH);
        struct join_stage *stage = next_stage(lod);
        uint64_t largest_out = 0;
        *stage = (struct join_stage){.joins = parents};
        stage->faces_in = count_faces(lod, &stage->largest_in);
        for (uint32_t i = 0; i < parents; i++)
            lod->jobs[i] = (struct node_job){lod->nodes[i].triangles.face_count, i};
        qsort(lod->jobs, parents, sizeof *lod->jobs, compare_jobs);
        status = parallel_for(lod->ctx, parents, thin_parent, lod);
        if (status != STATUS_OK)
            return status;
        stage->faces_out = count_faces(lod, &largest_out);
    }
    return STATUS_OK;
}

/* ---- the levels ---- */

static enum status make_levels(struct lod *lod, struct trunk *trunk)
{
    const bool keeps = lod->options->keeps_trunk;
    struct small_mesh empty = {0};
    struct small_mesh *whole = lod->info->slab_count > 0 ? &lod->nodes[0] : &empty;
    const struct lod_root root = {&whole->triangles, trunk,
                                  keeps ? chain_file_name(lod->file) : NULL, lod->collapse,
                                  &lod->milestones};
    return lod_levels_make(lod->ctx, lod->info, lod->options, &root, lod->report);
}

/* The trunk that the file has, if it is of the same sequence; else all zero. */
static enum status find_trunk(struct lod *lod, struct trunk *trunk)
{
    const bool is_lower = lod_begins_lower(&lod->milestones, lod->report->levels[0].wanted_faces);
    enum status status = STATUS_OK;
    memset(trunk, 0, sizeof *trunk);
    if (lod->milestones.count == 0)
        return STATUS_OK;
    if (is_lower)
        status = chain_trunk_read(lod->file, true, trunk);
    if (status == STATUS_OK && trunk->finest == 0)
        status = chain_trunk_read(lod->file, false, trunk);
    if (trunk->subset != lod->collapse.subset || trunk->effort != lod->collapse.effort ||
        trunk->finest != lod->milestones.faces[0])
        chain_trunk_clear(lod->ctx, lod->stride, trunk);
    lod->report->small_faces = trunk->small_faces;
    return status;
}

/* The trunk's beginning from the blocks. */
static enum status make_root(struct lod *lod, struct trunk *trunk)
{
    enum status status = make_leaves(lod);
    chain_hold_clear(lod->options->hold);
    if (status == STATUS_OK)
        status = join_leaves(lod);
    trunk->lost = lod->lost;
    trunk->small_faces = lod->report->small_faces;
    return status;
}

enum status lod_collapse(struct context *ctx, struct chain_file *file,
                         const struct lod_options *options, struct lod_report *report)
{
    const struct chain_info *info = chain_file_info(file);
    const uint32_t effort = options->target.effort;
    struct lod lod = {.ctx = ctx,
                      .file = file,
                      .info = info,
                      .options = options,
                      .report = report,
                      .collapse = {.subset = options->place == PLACE_SUBSET,
                                   .effort = effort < 3 ? effort : 3,
                                   .source = chain_file_name(file)},
                      .stride = info->attributes.stride};
    const size_t slabs = info->slab_count;
    struct trunk trunk;
    choose_fineness(&lod);
    enum status status = find_trunk(&lod, &trunk);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, slabs, sizeof *lod.nodes, &lod.nodes);
    if (status == STATUS_OK)
        status = memory_take(ctx, slabs, sizeof *lod.jobs, &lod.jobs);
    if (status == STATUS_OK)
        status = memory_take(ctx, count_groups(info->slab_count, LEAF_WIDTH), sizeof *lod.unbuilt,
                             &lod.unbuilt);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, slabs, sizeof *lod.weights, &lod.weights);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, slabs, sizeof *lod.built, &lod.built);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, ctx->threads, sizeof *lod.spaces, &lod.spaces);
    if (status == STATUS_OK && trunk.finest == 0)
        status = make_root(&lod, &trunk);
    if (status == STATUS_OK)
        status = make_levels(&lod, &trunk);
    chain_trunk_clear(ctx, lod.stride, &trunk);
    if (lod.nodes)
        clear_nodes(&lod);
    for (unsigned i = 0; lod.spaces && i < ctx->threads; i++)
        small_workspace_clear(ctx, &lod.spaces[i]);
    memory_release(ctx, &lod.spaces, ctx->threads, sizeof *lod.spaces);
    memory_release(ctx, &lod.built, slabs, sizeof *lod.built);
    memory_release(ctx, &lod.weights, slabs, sizeof *lod.weights);
    memory_release(ctx, &lod.unbuilt, count_groups(info->slab_count, LEAF_WIDTH),
                   sizeof *lod.unbuilt);
    memory_release(ctx, &lod.jobs, slabs, sizeof *lod.jobs);
    memory_release(ctx, &lod.nodes, slabs, sizeof *lod.nodes);
    return status;
}
