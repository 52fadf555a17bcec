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

/* Rule 1: the vertex to keep of a chain that would keep none. It must not depend on the direction:
 * of equal errors the middle's counts, on seams that of the lowest store number. */
static uint32_t worst_interior(const struct small_builder *b, uint32_t chain,
                               const struct chain_line *line, const struct chain_metric *metric)
{
    const uint32_t length = line->interior_count + 2;
    uint32_t worst = length / 2;
    chain_errors(b->line, length, HALVING_TOP_DOWN, metric, b->line_errors);
    for (uint32_t i = 1; i + 1 < length; i++)
        if (b->line_errors[i] > b->line_errors[worst])
            worst = i;
    for (uint32_t i = 1; small_is_seam(b, chain) && i + 1 < length; i++)
        if (b->line_errors[i] >= b->line_errors[worst] &&
            small_line_interior(line, i - 1) < small_line_interior(line, worst - 1))
            worst = i;
    return small_line_interior(line, worst - 1);
}

/* A chain that has vertices between its ends. */
static void cut_line(struct small_builder *b, uint32_t chain, struct chain_line line)
{
    const uint32_t length = line.interior_count + 2;
    const float *positions = b->block->positions;
    memcpy(b->line, positions + 3 * (size_t)line.start, 3 * sizeof(float));
    for (uint32_t i = 1; i + 1 < length; i++)
        memcpy(b->line + 3 * (size_t)i, positions + 3 * (size_t)small_line_interior(&line, i - 1),
               3 * sizeof(float));
    memcpy(b->line + 3 * (size_t)(length - 1), positions + 3 * (size_t)line.end, 3 * sizeof(float));
    const struct chain_metric metric = metric_of(b, chain);
    const bool is_border = !small_is_seam(b, chain) && b->block->chains[chain].right == NO_PATCH;
    const double tolerance = b->tolerance * (is_border ? BORDER_PART : 1);
    chain_errors_above(b->line, length, tolerance, &metric, b->line_errors);
    uint32_t kept = 0;
    float dropped = 0;
    for (uint32_t i = 1; i + 1 < length; i++) {
        const bool is_kept = (double)b->line_errors[i] > tolerance;
        b->keep[small_line_interior(&line, i - 1)] |= is_kept;
        kept += is_kept;
        dropped = is_kept || !(b->line_errors[i] > dropped) ? dropped : b->line_errors[i];
    }
    b->dropped[chain] = dropped;
    b->segment_count += kept;
    if (kept == 0 &&
        (small_is_seam(b, chain) || (small_on_seam(b, line.start) && small_on_seam(b, line.end))))
        b->keep[worst_interior(b, chain, &line, &metric)] = 1;
}

void small_chains_cut(struct small_builder *b)
{
    for (uint32_t chain = 0; chain < b->chain_total; chain++) {
        const struct chain_line line = small_chain_line(b, chain);
        b->keep[line.start] = b->keep[line.end] = 1;
        b->segment_count++;
        if (line.interior_count > 0)
            cut_line(b, chain, line);
    }
}

void small_chain_give_back(struct small_builder *b, uint32_t chain)
{
    for (uint32_t i = 0; i < small_chain_length(b, chain); i++)
        b->keep[small_chain_vertex(b, chain, i)] = 1;
    b->states[chain] = CHAIN_GIVEN_BACK;
    b->dropped[chain] = 0;
}
