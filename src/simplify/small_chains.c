/*
 * Which vertices of a chain stay in the small mesh: those that its halving error (section 4.2.5)
 * puts above the tolerance, measured as what lies between the planes of both sides loses by it.
 */
#include <string.h>

#include "simplify/chain_simplify.h"
#include "simplify/small_internal.h"

/* Of the tolerance, for borders: they are few, and what they lose no collapse can give back. */
static const double BORDER_PART = 0.0625;

static struct chain_metric metric_of(const struct small_builder *b, uint32_t chain)
{
    if (small_is_seam(b, chain) || b->block->chains[chain].right == NO_PATCH)
        return chain_metric_plain();
    const struct chain *c = &b->block->chains[chain];
    return chain_metric_between(vec3_load_float(b->block->patches[c->left].normal),
                                vec3_load_float(b->block->patches[c->right].normal));
}

void small_chain_cut(struct small_builder *b, uint32_t chain)
{
    const uint32_t length = small_chain_length(b, chain);
    const uint32_t start = small_chain_vertex(b, chain, 0),
                   end = small_chain_vertex(b, chain, length - 1);
    b->keep[start] = b->keep[end] = 1;
    if (length == 2)
        return;
    for (uint32_t i = 0; i < length; i++)
        memcpy(b->line + 3 * (size_t)i,
               b->block->positions + 3 * (size_t)small_chain_vertex(b, chain, i),
               3 * sizeof(float));
    const struct chain_metric metric = metric_of(b, chain);
    const bool is_border = !small_is_seam(b, chain) && b->block->chains[chain].right == NO_PATCH;
    const double tolerance = b->tolerance * (is_border ? BORDER_PART : 1);
    chain_errors(b->line, length, HALVING_TOP_DOWN, &metric, b->line_errors);
    uint32_t kept = 0, worst = length / 2;
    for (uint32_t i = 1; i + 1 < length; i++) {
        if ((double)b->line_errors[i] > tolerance) {
            b->keep[small_chain_vertex(b, chain, i)] = 1;
            kept++;
        } else {
            b->dropped[chain] = fmaxf(b->dropped[chain], b->line_errors[i]);
        }
        if (b->line_errors[i] > b->line_errors[worst])
            worst = i;
    }
    if (kept == 0 &&
        (small_is_seam(b, chain) || (small_on_seam(b, start) && small_on_seam(b, end)))) {
        /* rule 1; the vertex must not depend on the direction: the lower store number wins ties */
        for (uint32_t i = 1; small_is_seam(b, chain) && i + 1 < length; i++)
            if (b->line_errors[i] >= b->line_errors[worst] &&
                small_chain_vertex(b, chain, i) < small_chain_vertex(b, chain, worst))
                worst = i;
        b->keep[small_chain_vertex(b, chain, worst)] = 1;
    }
}

void small_chain_give_back(struct small_builder *b, uint32_t chain)
{
    for (uint32_t i = 0; i < small_chain_length(b, chain); i++)
        b->keep[small_chain_vertex(b, chain, i)] = 1;
    b->full[chain] = 1;
    b->dropped[chain] = 0;
}
