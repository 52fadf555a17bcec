/*
 * Seam chains are the only part of a block that is not known when the slab's patches are grown, so
 * they have bytes of their own. A list's next vertex is mostly a near one in the slab's table of
 * seam vertices, which ascends with the store's numbers: differences are small.
 */
#include "base/memory.h"
#include "simplify/chain_code.h"
#include "simplify/small_numbers.h"

enum status seam_chains_encode(struct context *ctx, const struct chain_block *block,
                               unsigned char **raw, size_t *capacity, size_t *size)
{
    *capacity = (size_t)SMALL_NUMBER_MAX *
                (2 + 4 * (size_t)block->seam_chain_count + (size_t)block->seam_list_count);
    enum status status = memory_take(ctx, *capacity, 1, raw);
    if (status)
        return status;
    struct sink sink = {.at = *raw};
    uint32_t left = 0, slab = block->slab, list = 0;
    put(&sink, block->seam_chain_count);
    put(&sink, block->seam_list_count);
    for (uint32_t i = 0; i < block->seam_chain_count; i++) {
        const struct seam_chain *chain = block->seam_chains + i;
        if (chain->left < left || chain->vertex_first != list || chain->vertex_count < 2) {
            memory_release(ctx, raw, *capacity, 1);
            return fail(ctx, STATUS_INTERNAL, "seam chain %u of block %u is out of order", i,
                        block->slab);
        }
        put(&sink, chain->left - left);
        put(&sink, zigzag(chain->other_slab - slab));
        put(&sink, chain->right);
        put(&sink, chain->vertex_count - 2);
        left = chain->left;
        slab = chain->other_slab;
        list += chain->vertex_count;
    }
    uint32_t last = 0;
    for (uint32_t i = 0; i < block->seam_list_count; i++) {
        put(&sink, zigzag(block->seam_lists[i] - last));
        last = block->seam_lists[i];
    }
    *size = (size_t)(sink.at - *raw);
    return STATUS_OK;
}

static const char *get_seam_chains(struct source *source, uint32_t slab_count,
                                   struct chain_block *block)
{
    uint32_t left = 0, slab = block->slab, list = 0;
    for (uint32_t i = 0; i < block->seam_chain_count; i++) {
        struct seam_chain *chain = block->seam_chains + i;
        uint32_t difference = get(source);
        slab += unzigzag(get(source));
        chain->right = get(source);
        uint32_t more = get(source);
        if (source->is_bad || difference >= block->patch_count ||
            left + difference >= block->patch_count)
            return "a seam chain's left patch is out of range";
        if (slab >= slab_count || slab == block->slab || chain->right == NO_PATCH)
            return "a seam chain's other side is out of range";
        if (block->seam_list_count - list < 2 || more > block->seam_list_count - list - 2)
            return "the seam chains have more vertices than the block says";
        left += difference;
        chain->left = left;
        chain->other_slab = slab;
        chain->vertex_first = list;
        chain->vertex_count = more + 2;
        list += more + 2;
    }
    if (list != block->seam_list_count)
        return "the seam chains have fewer vertices than the block says";
    uint32_t last = 0;
    for (uint32_t i = 0; i < block->seam_list_count; i++) {
        last += unzigzag(get(source));
        if (source->is_bad || last - block->junction_count >= block->seam_vertex_count)
            return "a seam chain's vertex is no seam vertex";
        block->seam_lists[i] = last;
    }
    return left_in(source) ? "there are bytes left over behind the seam chains" : NULL;
}

enum status seam_chains_decode(struct context *ctx, const char *what, const unsigned char *raw,
                               size_t size, uint32_t slab_count, struct chain_block *block)
{
    struct source source = {.at = raw, .end = raw + size};
    uint32_t chains = get(&source), list = get(&source);
    if (source.is_bad || chains > left_in(&source) / 4 || list > left_in(&source))
        return fail(ctx, STATUS_BAD_INPUT, "%s: %s", what, "it is too short for its counts");
    block->seam_chain_count = chains;
    block->seam_list_count = list;
    enum status status = memory_take(ctx, chains, sizeof *block->seam_chains, &block->seam_chains);
    if (!status)
        status = memory_take(ctx, list, sizeof(uint32_t), &block->seam_lists);
    if (status)
        return status;
    const char *wrong = get_seam_chains(&source, slab_count, block);
    return wrong ? fail(ctx, STATUS_BAD_INPUT, "%s: %s", what, wrong) : STATUS_OK;
}
