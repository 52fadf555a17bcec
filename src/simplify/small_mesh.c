/*
 * From chains and patches of a block to triangles.
 *
 * Each chain keeps the vertices that its halving error puts above the tolerance, each patch is cut
 * along diagonals. Doing this chain by chain and patch by patch can make the same edge twice: two
 * chains may shrink to one segment, a diagonal may repeat a segment or another patch's diagonal, in
 * the same block or in the next one. So all edges of the block are entered in lists by their lower
 * vertex, which are short, and:
 *
 *   1. a chain between two seam vertices, and a seam chain, keeps at least one of its inner
 * vertices if it has any: no segment between seam vertices can then be met from another block;
 *   2. chains whose segments coincide get all their vertices back, until none do (a seam chain's
 *      segment stays, the other one goes): edges of the store are unique, so this ends;
 *   3. a diagonal is not to repeat an edge, nor to join two seam vertices, nor to be one of another
 *      patch's own diagonals;
 *   4. a patch for which no diagonals are left is cut into a fan round a vertex of its own: one
 * from its inside, or one that its chains have dropped; else all its vertices are there still, and
 *      its own diagonals, which rule 3 has reserved, are taken.
 */
#include "simplify/small_mesh.h"

#include <string.h>

#include "base/memory.h"
#include "simplify/chain_loops.h"
#include "simplify/small_internal.h"

/* ---- edges ---- */

static enum status reserve_diagonals(struct small_builder *b)
{
    for (uint32_t p = 0; p < b->block->patch_count; p++) {
        const struct patch *patch = &b->block->patches[p];
        for (uint32_t i = 0; i < patch->diagonal_count; i++) {
            const uint32_t *d = b->block->diagonals + 2 * ((size_t)patch->diagonal_first + i);
            enum status status = small_edge_add(b, d[0], d[1], p, NO_INDEX);
            if (status != STATUS_OK)
                return status;
        }
    }
    return STATUS_OK;
}

/* A segment of `chain` that is there already as `entry`: the chains involved get their vertices
 * back and *clash is set. Seam chains stay as they are, as the other block has them so. (What a
 * chain that was given back has entered may meet others still; these get theirs for nothing.) */
static enum status resolve_clash(struct small_builder *b, uint32_t chain, struct edge_entry *entry,
                                 bool *clash)
{
    if (entry->chain == NO_INDEX && small_is_seam(b, chain)) {
        entry->owner = OWNER_TAKEN; /* a patch's own diagonal: that patch must do without */
        return STATUS_OK;
    }
    const bool fixed = small_is_seam(b, chain) || b->states[chain] >= CHAIN_WHOLE;
    const bool other_fixed = entry->chain == NO_INDEX || small_is_seam(b, entry->chain) ||
                             b->states[entry->chain] >= CHAIN_WHOLE;
    if (fixed && other_fixed)
        return fail(b->ctx, STATUS_BAD_INPUT, "slab %u: two chains have an edge in common",
                    b->block->slab);
    if (!other_fixed)
        small_chain_give_back(b, entry->chain);
    if (!fixed)
        small_chain_give_back(b, chain);
    *clash = true;
    return STATUS_OK;
}

static inline enum status enter_segment(struct small_builder *b, uint32_t chain, uint32_t from,
                                        uint32_t to, bool *clash)
{
    struct edge_entry *entry = small_edge_find(b, from, to);
    return entry ? resolve_clash(b, chain, entry, clash)
                 : small_edge_add(b, from, to, OWNER_TAKEN, chain);
}

static enum status enter_chain(struct small_builder *b, uint32_t chain, bool *clash)
{
    const struct chain_line line = small_chain_line(b, chain);
    uint32_t from = line.start;
    for (uint32_t i = 0; i < line.interior_count; i++) {
        const uint32_t to = small_line_interior(&line, i);
        if (!b->keep[to])
            continue;
        enum status status = enter_segment(b, chain, from, to, clash);
        if (status != STATUS_OK)
            return status;
        from = to;
    }
    return enter_segment(b, chain, from, line.end, clash);
}

/* Enters the chains anew that were given back; *clash: others are now. */
static enum status enter_again(struct small_builder *b, bool *clash)
{
    enum status status = STATUS_OK;
    *clash = false;
    small_edges_drop(b);
    for (uint32_t chain = 0; chain < b->chain_total; chain++)
        if (b->states[chain] == CHAIN_GIVEN_BACK)
            b->states[chain] = CHAIN_WHOLE;
    for (uint32_t chain = 0; chain < b->chain_total && status == STATUS_OK; chain++)
        if (b->states[chain] == CHAIN_WHOLE) {
            b->states[chain] = CHAIN_ENTERED;
            status = enter_chain(b, chain, clash);
        }
    return status;
}

/* A loop of n corners is cut into n - 2 faces by n - 3 diagonals; nearly all segments are on two.
 */
static enum status reserve_faces(struct small_builder *b)
{
    const size_t corners = 2 * (size_t)b->segment_count, patches = b->block->patch_count;
    const size_t diagonals = corners > 3 * patches ? corners - 3 * patches : 0;
    size_t capacity = b->face_capacity;
    enum status status = small_edges_reserve(b, b->entry_count + diagonals);
    if (status == STATUS_OK)
        status =
            memory_reserve(b->ctx, &b->faces, &capacity, diagonals + patches, 3 * sizeof *b->faces);
    b->face_capacity = (uint32_t)capacity;
    return status;
}

static enum status cut_chains(struct small_builder *b)
{
    small_chains_cut(b);
    enum status status =
        small_edges_reserve(b, (size_t)b->block->diagonal_count + b->segment_count);
    if (status != STATUS_OK)
        return status;
    bool clash = false;
    status = reserve_diagonals(b);
    for (uint32_t chain = 0; chain < b->chain_total && status == STATUS_OK; chain++)
        status = enter_chain(b, chain, &clash);
    while (clash && status == STATUS_OK)
        status = enter_again(b, &clash);
    if (status != STATUS_OK)
        return status;
    return reserve_faces(b);
}

/* ---- the result ---- */

/* Gives vertices their numbers by first use, in the lists of edges, which nobody asks any more, and
 * the faces to the mesh; *seams of them are on seams. */
static enum status number_vertices(struct small_builder *b, struct collapse_mesh *to,
                                   uint32_t *seams)
{
    const uint32_t total = b->block->vertex_count + b->copy_count;
    const size_t faces = b->face_count;
    uint32_t count = 0;
    enum status status = memory_resize(b->ctx, &b->lists, b->list_count, total, sizeof *b->lists);
    if (status != STATUS_OK)
        return status;
    b->list_count = total;
    memset(b->lists, 0, total * sizeof *b->lists);
    *seams = 0;
    for (size_t i = 0; i < 3 * faces; i++) {
        const uint32_t v = b->faces[i];
        struct edge_list *list = &b->lists[v];
        if (list->first == 0) {
            list->first = ++count;
            *seams += small_on_seam(b, v);
        }
        b->faces[i] = list->first - 1;
    }
    status = memory_resize(b->ctx, &b->faces, b->face_capacity, faces, 3 * sizeof *b->faces);
    if (status != STATUS_OK)
        return status;
    to->vertex_count = count;
    to->face_count = faces;
    to->faces = b->faces;
    b->faces = NULL;
    return STATUS_OK;
}

/* Makes the mesh: numbers, and copies what belongs to the vertices. */
static enum status finish(struct small_builder *b, uint32_t stride, struct small_mesh *mesh)
{
    const struct chain_block *block = b->block;
    struct collapse_mesh *to = &mesh->triangles;
    uint32_t seams;
    enum status status = number_vertices(b, to, &seams);
    if (status != STATUS_OK)
        return status;
    const size_t count = (size_t)to->vertex_count;
    mesh->seam_count = seams;
    status = memory_take(b->ctx, count, 3 * sizeof *to->positions, &to->positions);
    if (status == STATUS_OK)
        status = memory_take(b->ctx, count, 3 * sizeof *to->witnesses, &to->witnesses);
    if (status == STATUS_OK)
        status = memory_take(b->ctx, seams, sizeof *mesh->seams, &mesh->seams);
    if (status == STATUS_OK && stride > 0)
        status = memory_take(b->ctx, count, stride, &to->records);
    if (status != STATUS_OK)
        return status;
    seams = 0;
    for (uint32_t i = 0; i < b->list_count; i++) {
        if (b->lists[i].first == 0)
            continue;
        const size_t number = b->lists[i].first - 1;
        const uint32_t v = i < block->vertex_count ? i : b->copies[i - block->vertex_count];
        memcpy(to->positions + 3 * number, block->positions + 3 * (size_t)v, 3 * sizeof(float));
        if (b->bulges && i < block->vertex_count)
            bulge_move(&b->bulges[v], b->given_back, to->positions + 3 * number);
        const size_t witness = b->witnesses[v] != NO_INDEX ? b->witnesses[v] : v;
        memcpy(to->witnesses + 3 * number, block->positions + 3 * witness, 3 * sizeof(float));
        if (stride > 0)
            memcpy(to->records + number * stride, block->records + (size_t)v * stride, stride);
        if (small_on_seam(b, i))
            mesh->seams[seams++] =
                (struct seam_tag){block->seam_vertices[v - block->junction_count], (uint32_t)number,
                                  block->slab, block->slab};
    }
    return STATUS_OK;
}

/* Widens the tags by the slabs beyond each seam chain. */
static enum status tag_seams(struct small_builder *b, struct small_mesh *mesh)
{
    enum status status = small_loop_reserve(b, b->block->seam_vertex_count);
    if (status != STATUS_OK)
        return status;
    uint32_t *tags = b->loop; /* by seam vertex */
    const uint32_t first = b->block->junction_count;
    for (uint32_t i = 0; i < b->block->seam_vertex_count; i++)
        tags[i] = NO_INDEX;
    for (uint32_t i = 0, v = 0; i < mesh->seam_count; i++) {
        while (b->block->seam_vertices[v] != mesh->seams[i].number)
            v++;
        tags[v] = i;
    }
    for (uint32_t i = 0; i < b->block->seam_chain_count; i++) {
        const struct seam_chain *seam = &b->block->seam_chains[i];
        for (uint32_t k = 0; k < seam->vertex_count; k++) {
            const uint32_t tag = tags[b->block->seam_lists[seam->vertex_first + k] - first];
            if (tag == NO_INDEX)
                continue;
            struct seam_tag *t = &mesh->seams[tag];
            t->lowest = seam->other_slab < t->lowest ? seam->other_slab : t->lowest;
            t->highest = seam->other_slab > t->highest ? seam->other_slab : t->highest;
        }
    }
    return STATUS_OK;
}

/* ---- memory ---- */

static void measure_block(struct small_builder *b)
{
    uint32_t longest = 2;
    for (uint32_t chain = 0; chain < b->chain_total; chain++) {
        const uint32_t length = small_chain_length(b, chain);
        longest = length > longest ? length : longest;
        b->use_count +=
            !small_is_seam(b, chain) && b->block->chains[chain].right != NO_PATCH ? 2 : 1;
    }
    b->line_capacity = longest;
}

static enum status take_arrays(struct small_builder *b)
{
    struct context *ctx = b->ctx;
    const size_t vertices = b->block->vertex_count;
    enum status status = memory_take_zeroed(ctx, (size_t)b->block->patch_count + 1,
                                            sizeof *b->use_first, &b->use_first);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, (size_t)b->block->patch_count + 1, sizeof *b->face_first,
                                    &b->face_first);
    if (status == STATUS_OK)
        status = memory_take(ctx, b->use_count, sizeof *b->uses, &b->uses);
    if (status != STATUS_OK)
        return status;
    (void)chain_uses_count(b->block, b->use_first);
    chain_uses_sort(b->block, b->use_first, b->uses);
    status = memory_take_zeroed(ctx, vertices, 1, &b->keep);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, b->chain_total, 1, &b->states);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, b->chain_total, sizeof *b->dropped, &b->dropped);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, vertices, sizeof *b->lists, &b->lists);
    b->list_count = b->lists ? (uint32_t)vertices : 0;
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, vertices, sizeof *b->errors, &b->errors);
    if (status == STATUS_OK)
        status = memory_take(ctx, vertices, sizeof *b->witnesses, &b->witnesses);
    if (status == STATUS_OK)
        memset(b->witnesses, 0xff, vertices * sizeof *b->witnesses);
    if (status == STATUS_OK && b->given_back > 0)
        status = memory_take_zeroed(ctx, vertices, sizeof *b->bulges, &b->bulges);
    if (b->bulges)
        small_hold_rims(b);
    if (status == STATUS_OK)
        status = memory_take(ctx, b->line_capacity, 3 * sizeof *b->line, &b->line);
    if (status == STATUS_OK)
        status = memory_take(ctx, b->line_capacity, sizeof *b->line_errors, &b->line_errors);
    return status;
}

static void release_arrays(struct small_builder *b)
{
    struct context *ctx = b->ctx;
    const size_t vertices = b->block->vertex_count;
    memory_release(ctx, &b->faces, b->face_capacity, 3 * sizeof *b->faces);
    memory_release(ctx, &b->entries, b->entry_capacity, sizeof *b->entries);
    small_loop_release(b);
    memory_release(ctx, &b->lines, b->line_room, sizeof *b->lines);
    memory_release(ctx, &b->line_errors, b->line_capacity, sizeof *b->line_errors);
    memory_release(ctx, &b->line, b->line_capacity, 3 * sizeof *b->line);
    memory_release(ctx, &b->bulges, vertices, sizeof *b->bulges);
    memory_release(ctx, &b->witnesses, vertices, sizeof *b->witnesses);
    memory_release(ctx, &b->errors, vertices, sizeof *b->errors);
    memory_release(ctx, &b->lists, b->list_count, sizeof *b->lists);
    memory_release(ctx, &b->copies, b->copy_capacity, sizeof *b->copies);
    memory_release(ctx, &b->dropped, b->chain_total, sizeof *b->dropped);
    memory_release(ctx, &b->states, b->chain_total, 1);
    memory_release(ctx, &b->keep, vertices, 1);
    memory_release(ctx, &b->uses, b->use_count, sizeof *b->uses);
    memory_release(ctx, &b->face_first, (size_t)b->block->patch_count + 1, sizeof *b->face_first);
    memory_release(ctx, &b->use_first, (size_t)b->block->patch_count + 1, sizeof *b->use_first);
}

enum status small_mesh_build(struct context *ctx, struct small_workspace *space, uint32_t stride,
                             const struct chain_block *block, double tolerance, double given_back,
                             struct small_mesh *mesh)
{
    struct small_builder b = {.ctx = ctx,
                              .space = space,
                              .block = block,
                              .tolerance = tolerance,
                              .given_back = given_back,
                              .chain_total = block->chain_count + block->seam_chain_count};
    memset(mesh, 0, sizeof *mesh);
    measure_block(&b);
    enum status status = take_arrays(&b);
    if (status == STATUS_OK)
        status = cut_chains(&b);
    for (uint32_t patch = 0; patch < block->patch_count && status == STATUS_OK; patch++) {
        const uint32_t copies = b.copy_count;
        status = small_patch_cut(&b, patch);
        if (status != STATUS_OK)
            break;
        b.face_first[patch + 1] = b.face_count;
        const double height = copies == b.copy_count ? small_note_witness(&b, patch) : 0;
        const struct patch *record = &block->patches[patch];
        if (b.bulges)
            bulge_note(b.bulges, b.loop, b.loop_count, record->normal, record->area, height);
    }
    if (status == STATUS_OK) {
        small_measure_chains(&b);
        status = finish(&b, stride, mesh);
    }
    if (status == STATUS_OK)
        status = tag_seams(&b, mesh);
    if (status != STATUS_OK)
        small_mesh_clear(ctx, stride, mesh);
    mesh->lost = b.lost;
    mesh->is_cut = b.is_cut;
    release_arrays(&b);
    return status;
}

void small_mesh_clear(struct context *ctx, uint32_t stride, struct small_mesh *mesh)
{
    memory_release(ctx, &mesh->seams, mesh->seam_count, sizeof *mesh->seams);
    collapse_mesh_clear(ctx, stride, &mesh->triangles);
    memset(mesh, 0, sizeof *mesh);
}

void small_workspace_clear(struct context *ctx, struct small_workspace *space)
{
    triangulation_workspace_clear(ctx, &space->triangulation);
}
