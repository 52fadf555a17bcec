/*
 * What is left out of a small mesh, and how far it lies from it.
 *
 * Of a patch its farthest inner vertex is known, of a chain the vertices that were cut out. What is
 * more than the tolerance becomes a witness, which collapses carry along; the largest of the rest
 * is told once for all of the block.
 */
#include "geom/distance.h"
#include "simplify/small_internal.h"

static struct vec3 place_of(const struct small_builder *b, uint32_t v)
{
    const uint32_t count = b->block->vertex_count;
    return vec3_load_float(b->block->positions +
                           3 * (size_t)(v < count ? v : b->copies[v - count]));
}

/* The nearest of a patch's faces to a place; NULL: there are none. *foot is on it. */
static const uint32_t *nearest_face(const struct small_builder *b, uint32_t patch,
                                    struct vec3 place, double *square, struct vec3 *foot)
{
    const uint32_t *nearest = NULL;
    *square = INFINITY;
    for (uint32_t f = b->face_first[patch]; f < b->face_first[patch + 1]; f++) {
        const uint32_t *face = b->faces + 3 * (size_t)f;
        const struct triangle triangle = {place_of(b, face[0]), place_of(b, face[1]),
                                          place_of(b, face[2])};
        struct vec3 there;
        const double there_square = triangle_distance_squared(place, &triangle, &there);
        if (there_square < *square) {
            *square = there_square;
            *foot = there;
            nearest = face;
        }
    }
    return nearest;
}

double small_note_witness(struct small_builder *b, uint32_t patch)
{
    const struct patch *record = &b->block->patches[patch];
    if (record->interior_count == 0 || b->keep[record->interior_first])
        return 0;
    const bool matters = (double)record->deviation > b->tolerance;
    if (!matters && (double)record->deviation <= b->lost && !b->bulges)
        return 0;
    const struct vec3 witness = place_of(b, record->interior_first);
    struct vec3 foot;
    double square;
    const uint32_t *nearest = nearest_face(b, patch, witness, &square, &foot);
    if (!nearest)
        return 0;
    if (!matters)
        b->lost = fmax(b->lost, fmin(sqrt(square), (double)record->deviation));
    for (int k = 0; matters && k < 3; k++)
        if (record->deviation > b->errors[nearest[k]]) {
            b->errors[nearest[k]] = record->deviation;
            b->witnesses[nearest[k]] = record->interior_first;
        }
    /* it may lie beside the faces: what is along them is no height */
    return vec3_dot(vec3_load_float(record->normal), vec3_sub(witness, foot));
}

/* The squared distance of a chain's vertex from the faces at its sides, of a seam chain from those
 * of the side that is here. */
static double square_beside(const struct small_builder *b, uint32_t chain, uint32_t v)
{
    const bool seam = small_is_seam(b, chain);
    const uint32_t left = seam ? b->block->seam_chains[chain - b->block->chain_count].left
                               : b->block->chains[chain].left;
    const uint32_t right = seam ? NO_PATCH : b->block->chains[chain].right;
    struct vec3 foot;
    double square, other = INFINITY;
    (void)nearest_face(b, left, place_of(b, v), &square, &foot);
    if (right != NO_PATCH)
        (void)nearest_face(b, right, place_of(b, v), &other, &foot);
    return fmin(square, other);
}

/* Chains in planes and nearly so are cut by how they look, which is more than the surface has lost:
 * on parts hundreds of times more. So where it matters the dropped vertices are measured, against
 * the faces on both sides. (All their errors are at most the chain's.) */
void small_measure_chains(struct small_builder *b)
{
    for (uint32_t chain = 0; chain < b->chain_total; chain++) {
        const double dropped = (double)b->dropped[chain];
        double square = 0;
        b->is_cut |= dropped > 0;
        if (!(dropped > b->lost))
            continue;
        for (uint32_t i = 1; i + 1 < small_chain_length(b, chain) && square < dropped * dropped;
             i++) {
            const uint32_t v = small_chain_vertex(b, chain, i);
            if (!b->keep[v])
                square = fmax(square, square_beside(b, chain, v));
        }
        b->lost = fmax(b->lost, fmin(sqrt(square), dropped));
    }
}

/* At the border patches lie on one side alone; vertices of seams the other block has, too. */
void small_hold_rims(struct small_builder *b)
{
    for (uint32_t i = 0; i < b->block->seam_vertex_count; i++)
        bulge_hold(b->bulges, b->block->junction_count + i);
    for (uint32_t chain = 0; chain < b->block->chain_count; chain++)
        for (uint32_t i = 0;
             b->block->chains[chain].right == NO_PATCH && i < small_chain_length(b, chain); i++)
            bulge_hold(b->bulges, small_chain_vertex(b, chain, i));
}
