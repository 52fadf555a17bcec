/*
 * Full verification of a chain file: what opening and reading check, and beyond that all checksums,
 * the counts, and that both copies of every seam chain are alike (P4). The copies lie in two blocks
 * anywhere in the file; comparing them directly would need both blocks or all seams in memory. So
 * each copy is reduced to a checksum of its vertices, in the direction that the lower slab sees,
 * and the checksums are sorted: equal ones come together.
 */
#include <string.h>

#include "base/checksum.h"
#include "base/external_sort.h"
#include "base/memory.h"
#include "simplify/chain_frame.h"
#include "simplify/chain_trunk.h"

enum { CHECK_SORT_LIMIT = 8 << 20 };

/* A copy of a seam chain. All but `side` is the same in both. */
struct seam_copy {
    uint64_t left;    /* lower slab << 32 | its patch */
    uint64_t content; /* first store vertex << 32 | checksum of the rest */
    uint32_t side;    /* 0: the lower slab's copy */
    uint32_t unused;
};

/* A seam vertex of one slab: store number << 1 | it is a junction. */
typedef uint64_t seam_vertex_use;

struct check {
    struct context *ctx;
    const char *path;
    struct chain_file *file;
    const struct chain_info *info;
    struct sorter *copies;
    struct sorter *uses;
    struct chain_info sums; /* the counts, found again */
    uint64_t edges;         /* between neighbouring vertices of chains */
};

static enum status wrong(const struct check *check, const char *what)
{
    return fail(check->ctx, STATUS_BAD_INPUT, "%s: %s", check->path, what);
}

/* Checksums of whole sections, padding: what reading block by block does not look at. */
static enum status check_frame(struct context *ctx, const char *path)
{
    struct section_reader reader;
    enum status status =
        section_file_open(ctx, path, CHAIN_MAGIC, CHAIN_VERSION, "a chain file", &reader);
    if (status)
        return status;
    for (unsigned i = 0; i < reader.count && !status; i++)
        status = section_verify(&reader, reader.table + i);
    if (!status)
        status = section_check_padding(&reader);
    section_file_close(&reader);
    return status;
}

static enum status add_copy(struct check *check, const struct chain_block *block,
                            const struct seam_chain *chain)
{
    uint32_t stride = check->info->attributes.stride;
    bool is_lower = block->slab < chain->other_slab;
    uint32_t right[2] = {is_lower ? chain->other_slab : block->slab,
                         is_lower ? chain->right : chain->left};
    uint32_t first = 0, sum = checksum(0, right, sizeof right);
    for (uint32_t i = 0; i < chain->vertex_count; i++) {
        uint32_t place = is_lower ? i : chain->vertex_count - 1 - i;
        uint32_t vertex = block->seam_lists[chain->vertex_first + place];
        uint32_t number = block->seam_vertices[vertex - block->junction_count];
        sum = checksum(sum, &number, sizeof number);
        sum = checksum(sum, block->positions + 3 * (size_t)vertex, 3 * sizeof(float));
        if (stride)
            sum = checksum(sum, block->records + (size_t)vertex * stride, stride);
        if (i == 0)
            first = number;
    }
    struct seam_copy copy = {.left = is_lower ? (uint64_t)block->slab << 32 | chain->left
                                              : (uint64_t)chain->other_slab << 32 | chain->right,
                             .content = (uint64_t)first << 32 | sum,
                             .side = !is_lower};
    return sorter_add(check->copies, &copy, 1);
}

/* Notes each seam vertex of the block, as a junction where a chain ends. */
static enum status add_uses(struct check *check, const struct chain_block *block)
{
    struct context *ctx = check->ctx;
    seam_vertex_use *uses;
    enum status status = memory_take(ctx, block->seam_vertex_count, sizeof *uses, &uses);
    if (status)
        return status;
    for (uint32_t i = 0; i < block->seam_vertex_count; i++)
        uses[i] = (uint64_t)block->seam_vertices[i] << 1;
    for (uint32_t i = 0; i < block->seam_chain_count; i++) {
        const struct seam_chain *chain = block->seam_chains + i;
        const uint32_t *list = block->seam_lists + chain->vertex_first;
        uses[list[0] - block->junction_count] |= 1;
        uses[list[chain->vertex_count - 1] - block->junction_count] |= 1;
    }
    bool ends_elsewhere = false;
    for (uint32_t i = 0; i < block->chain_count; i++) {
        const struct chain *chain = block->chains + i;
        uint32_t ends[2] = {chain->start, chain->end};
        for (unsigned j = 0; j < 2; j++)
            if (ends[j] >= block->junction_count && !(uses[ends[j] - block->junction_count] & 1))
                ends_elsewhere = true;
    }
    status = ends_elsewhere ? wrong(check, "a chain ends inside a seam chain")
                            : sorter_add(check->uses, uses, block->seam_vertex_count);
    memory_release(ctx, &uses, block->seam_vertex_count, sizeof *uses);
    return status;
}

static enum status check_block(struct check *check, uint32_t slab)
{
    struct chain_block block;
    uint64_t interiors = 0, most_faces;
    enum status status = chain_block_read_counting(check->file, slab, &block, &most_faces);
    if (status)
        return status;
    for (uint32_t i = 0; i < block.chain_count; i++)
        interiors += block.chains[i].interior_count;
    for (uint32_t i = 0; i < block.seam_chain_count; i++)
        if (block.slab < block.seam_chains[i].other_slab)
            check->edges += block.seam_chains[i].vertex_count - 1;
    check->edges += interiors + block.chain_count;
    for (uint32_t p = 0; p < block.patch_count;
         p++) /* a reader of the block takes these on trust */
        if (block.patches[p].interior_count == 0 && block.patches[p].deviation != 0)
            status = wrong(check, "a patch without interior vertices has a deviation");
    check->sums.patches += block.patch_count;
    check->sums.chains += block.chain_count;
    check->sums.junctions += block.junction_count;
    check->sums.chain_vertices += block.junction_count + interiors;
    check->sums.most_faces += most_faces;
    for (uint32_t i = 0; i < block.seam_chain_count && !status; i++)
        status = add_copy(check, &block, block.seam_chains + i);
    if (!status)
        status = add_uses(check, &block);
    chain_block_release(check->file, &block);
    return status;
}

/* Copies come in pairs, one of each side. */
static enum status match_copies(struct check *check)
{
    struct seam_copy last = {0};
    bool waits = false;
    enum status status = sorter_finish(check->copies);
    while (!status) {
        const void *records;
        size_t count;
        status = sorter_next(check->copies, &records, &count);
        if (status || count == 0)
            break;
        const struct seam_copy *copies = records;
        for (size_t i = 0; i < count; i++) {
            if (waits && (copies[i].left != last.left || copies[i].content != last.content ||
                          copies[i].side == last.side))
                return wrong(check, "the two copies of a seam chain differ");
            last = copies[i];
            waits = !waits;
            check->sums.seam_chains += waits;
        }
    }
    if (!status && waits)
        status = wrong(check, "a seam chain has no second copy");
    return status;
}

static enum status count_seam_vertices(struct check *check)
{
    seam_vertex_use last = UINT64_MAX;
    enum status status = sorter_finish(check->uses);
    while (!status) {
        const void *records;
        size_t count;
        status = sorter_next(check->uses, &records, &count);
        if (status || count == 0)
            break;
        const seam_vertex_use *uses = records;
        for (size_t i = 0; i < count; i++) {
            if (uses[i] == last)
                continue;
            if (uses[i] >> 1 == last >> 1)
                return wrong(check, "the blocks disagree on a junction");
            last = uses[i];
            check->sums.chain_vertices++;
            check->sums.junctions += uses[i] & 1;
        }
    }
    return status;
}

static enum status compare_counts(const struct check *check)
{
    const struct chain_info *info = check->info, *sums = &check->sums;
    if (info->patches != sums->patches || info->chains != sums->chains + sums->seam_chains ||
        info->seam_chains != sums->seam_chains || info->junctions != sums->junctions ||
        info->chain_vertices != sums->chain_vertices || info->most_faces != sums->most_faces)
        return wrong(check, "the counts in its info are not those of its blocks");
    /* Patches are disks: cut along the chains, the surface has its Euler characteristic still. */
    if ((int64_t)(sums->chain_vertices - check->edges + sums->patches) != info->topology.euler)
        return wrong(check, "its chains and patches make another surface than its info says");
    return STATUS_OK;
}

enum status chain_file_check(struct context *ctx, const char *path)
{
    struct check check = {.ctx = ctx, .path = path};
    enum status status = check_frame(ctx, path);
    if (!status)
        status = chain_file_open(ctx, path, &check.file);
    if (!status) {
        check.info = chain_file_info(check.file);
        status = sorter_open(ctx, sizeof(struct seam_copy), 2 * sizeof(uint64_t), CHECK_SORT_LIMIT,
                             NULL, &check.copies);
    }
    if (!status)
        status = sorter_open(ctx, sizeof(seam_vertex_use), sizeof(seam_vertex_use),
                             CHECK_SORT_LIMIT, NULL, &check.uses);
    for (uint32_t slab = 0; !status && slab < check.info->slab_count; slab++) {
        status = step(ctx, "check", slab, check.info->slab_count);
        if (!status)
            status = check_block(&check, slab);
    }
    if (!status)
        status = match_copies(&check);
    if (!status)
        status = count_seam_vertices(&check);
    if (!status)
        status = compare_counts(&check);
    if (!status)
        status = chain_trunk_check(ctx, check.file);
    sorter_close(&check.copies);
    sorter_close(&check.uses);
    chain_file_close(&check.file);
    return status;
}
