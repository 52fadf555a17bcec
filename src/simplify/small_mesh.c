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

enum { OWNER_TAKEN = UINT32_MAX }; /* else the patch for which an edge is reserved */

#define BORDER UINT64_MAX /* instead of a patch */

/* ---- edges ---- */

static enum status reserve_diagonals(struct small_builder *b)
{
    small_edges_forget(b);
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
    for (uint32_t chain = 0; chain < b->chain_total; chain++)
        small_chain_cut(b, chain);
    enum status status =
        small_edges_reserve(b, (size_t)b->block->diagonal_count + b->segment_count);
    if (status == STATUS_OK)
        status = small_edges_take_seen(b, b->block->diagonal_count + 2 * (size_t)b->segment_count);
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

/* ---- patches ---- */

/* Slab and patch on the other side of a use. */
static uint64_t patch_beyond(const struct small_builder *b, uint32_t use)
{
    const uint32_t chain = use >> 1;
    uint64_t slab = b->block->slab;
    uint32_t patch;
    if (small_is_seam(b, chain)) {
        slab = b->block->seam_chains[chain - b->block->chain_count].other_slab;
        patch = b->block->seam_chains[chain - b->block->chain_count].right;
    } else {
        patch = use & 1 ? b->block->chains[chain].left : b->block->chains[chain].right;
    }
    return patch == NO_PATCH ? BORDER : slab << 32 | patch;
}

/* Whether the same patch lies beyond all chains of a patch. */
static bool is_alone(const struct small_builder *b, uint32_t patch)
{
    const uint32_t first = b->use_first[patch], end = b->use_first[patch + 1];
    const uint64_t beyond = patch_beyond(b, b->uses[first]);
    for (uint32_t i = first + 1; i < end && beyond != BORDER; i++)
        if (patch_beyond(b, b->uses[i]) != beyond)
            return false;
    return beyond != BORDER;
}

static void release_loop(struct small_builder *b)
{
    memory_release(b->ctx, &b->triangles, b->loop_room, 3 * sizeof *b->triangles);
    memory_release(b->ctx, &b->points, b->loop_room, 3 * sizeof *b->points);
    memory_release(b->ctx, &b->loop, b->loop_room, sizeof *b->loop);
}

/* Room for a loop of so many vertices; what was on it is lost when there is not. */
static enum status reserve_loop(struct small_builder *b, uint32_t vertices)
{
    if (vertices <= b->loop_room)
        return STATUS_OK;
    release_loop(b);
    b->loop_room = 2 * vertices;
    enum status status = memory_take(b->ctx, b->loop_room, sizeof *b->loop, &b->loop);
    if (status == STATUS_OK)
        status = memory_take(b->ctx, b->loop_room, 3 * sizeof *b->points, &b->points);
    if (status == STATUS_OK)
        status = memory_take(b->ctx, b->loop_room, 3 * sizeof *b->triangles, &b->triangles);
    return status;
}

static enum status reserve_lines(struct small_builder *b, uint32_t uses)
{
    if (uses <= b->line_room)
        return STATUS_OK;
    memory_release(b->ctx, &b->lines, b->line_room, sizeof *b->lines);
    b->line_room = 2 * uses;
    return memory_take(b->ctx, b->line_room, sizeof *b->lines, &b->lines);
}

static inline struct use_line use_line_of(const struct small_builder *b, uint32_t use)
{
    const struct chain_line line = small_chain_line(b, use >> 1);
    const bool is_backwards = use & 1;
    return (struct use_line){is_backwards ? line.end : line.start,
                             is_backwards ? line.start : line.end,
                             line.interior_count,
                             line.interior_first,
                             line.list,
                             is_backwards};
}

/* Puts a vertex on the loop, which is soon asked where it lies. */
static inline void put_on_loop(struct small_builder *b, uint32_t v, uint32_t *count)
{
    __builtin_prefetch(b->block->positions + 3 * (size_t)v);
    if (*count < b->loop_room)
        b->loop[(*count)++] = v;
}

/* What a use puts on the loop of its patch: all but its end. */
static inline void walk_line(struct small_builder *b, const struct use_line *line, uint32_t *count)
{
    put_on_loop(b, line->start, count);
    for (uint32_t i = 0; i < line->count; i++) {
        const uint32_t at = line->is_backwards ? line->count - 1 - i : i;
        const uint32_t v = line->list ? line->list[at] : line->first + at;
        if (b->keep[v])
            put_on_loop(b, v, count);
    }
}

/* The patch's kept vertices in order (its uses are searched for each next one: a patch has at most
 * PATCH_FACES_MAX faces and commonly six chains). */
static enum status gather_loop(struct small_builder *b, uint32_t patch, uint32_t *count)
{
    const uint32_t *uses = b->uses + b->use_first[patch];
    const uint32_t use_count = b->use_first[patch + 1] - b->use_first[patch];
    uint32_t n = 0, at = 0, most = use_count;
    enum status status = reserve_lines(b, use_count);
    if (status != STATUS_OK)
        return status;
    for (uint32_t i = 0; i < use_count; i++) {
        b->lines[i] = use_line_of(b, uses[i]);
        most += b->lines[i].count;
    }
    status = reserve_loop(b, most);
    if (status != STATUS_OK)
        return status;
    for (uint32_t done = 0; done < use_count; done++) {
        const uint32_t last = b->lines[at].end;
        walk_line(b, &b->lines[at], &n);
        at = 0;
        while (at < use_count && b->lines[at].start != last)
            at++;
        if (at == use_count)
            return fail(b->ctx, STATUS_BAD_INPUT, "slab %u: patch %u: its chains do not close",
                        b->block->slab, patch);
    }
    *count = b->loop_count = n;
    return STATUS_OK;
}

static bool diagonal_allowed(void *user, uint32_t i, uint32_t j)
{
    const struct small_builder *b = user;
    const uint32_t u = b->loop[i], v = b->loop[j];
    const struct edge_entry *entry = small_edge_find(b, u, v);
    if (entry)
        return entry->owner == b->patch;
    return !small_on_seam(b, u) || !small_on_seam(b, v);
}

static enum status add_face(struct small_builder *b, uint32_t u, uint32_t v, uint32_t w)
{
    if (b->face_count == b->face_capacity) {
        size_t capacity = b->face_capacity;
        enum status status = memory_reserve(b->ctx, &b->faces, &capacity, (size_t)b->face_count + 1,
                                            3 * sizeof *b->faces);
        if (status != STATUS_OK)
            return status;
        b->face_capacity = (uint32_t)capacity;
    }
    uint32_t *face = b->faces + 3 * (size_t)b->face_count++;
    face[0] = u;
    face[1] = v;
    face[2] = w;
    return STATUS_OK;
}

/* A side of the loop or a diagonal? Diagonals are entered, once. */
static enum status take_side(struct small_builder *b, uint32_t n, uint32_t i, uint32_t j)
{
    if (i > j || j - i == 1 || (i == 0 && j == n - 1))
        return STATUS_OK; /* each diagonal is met in both directions: enter it going up */
    struct edge_entry *entry = small_edge_find(b, b->loop[i], b->loop[j]);
    if (entry) {
        entry->owner = OWNER_TAKEN;
        return STATUS_OK;
    }
    return small_edge_add(b, b->loop[i], b->loop[j], OWNER_TAKEN, NO_INDEX);
}

static enum status take_triangles(struct small_builder *b, uint32_t n, const uint32_t *triangles)
{
    enum status status = STATUS_OK;
    for (uint32_t t = 0; t + 2 < n && status == STATUS_OK; t++) {
        const uint32_t *corner = triangles + 3 * (size_t)t;
        for (int k = 0; k < 3 && status == STATUS_OK; k++)
            status = take_side(b, n, corner[k], corner[(k + 1) % 3]);
        if (status == STATUS_OK)
            status = add_face(b, b->loop[corner[0]], b->loop[corner[1]], b->loop[corner[2]]);
    }
    return status;
}

/* A vertex that only this patch may use: inside it, or dropped from one of its own chains. Dropped
 * seam vertices are not to be had: the other block could take them too. */
static uint32_t find_spare(const struct small_builder *b, uint32_t patch)
{
    const struct patch *record = &b->block->patches[patch];
    if (record->interior_count > 0)
        return record->interior_first + record->interior_count / 2;
    for (uint32_t i = b->use_first[patch]; i < b->use_first[patch + 1]; i++) {
        const uint32_t chain = b->uses[i] >> 1;
        for (uint32_t k = 0; !small_is_seam(b, chain) && k < small_chain_length(b, chain); k++)
            if (!b->keep[small_chain_vertex(b, chain, k)])
                return small_chain_vertex(b, chain, k);
    }
    return NO_INDEX;
}

static enum status add_copy(struct small_builder *b, uint32_t patch, uint32_t *copy)
{
    size_t capacity = b->copy_capacity;
    enum status status =
        memory_reserve(b->ctx, &b->copies, &capacity, (size_t)b->copy_count + 1, sizeof *b->copies);
    if (status != STATUS_OK)
        return status;
    b->copy_capacity = (uint32_t)capacity;
    uint32_t source = b->loop[0];
    for (uint32_t i = b->use_first[patch]; i < b->use_first[patch + 1]; i++)
        for (uint32_t k = 0; k < small_chain_length(b, b->uses[i] >> 1); k++)
            if (!b->keep[small_chain_vertex(b, b->uses[i] >> 1, k)])
                source = small_chain_vertex(b, b->uses[i] >> 1, k);
    *copy = b->block->vertex_count + b->copy_count;
    b->copies[b->copy_count++] = source;
    return STATUS_OK;
}

static enum status cut_fan(struct small_builder *b, uint32_t n, uint32_t centre)
{
    if (centre < b->block->vertex_count)
        b->keep[centre] = 1;
    enum status status = STATUS_OK;
    for (uint32_t i = 0; i < n && status == STATUS_OK; i++)
        status = add_face(b, centre, b->loop[i], b->loop[i + 1 == n ? 0 : i + 1]);
    return status;
}

static bool own_diagonal_allowed(void *user, uint32_t i, uint32_t j)
{
    const struct small_builder *b = user;
    const struct edge_entry *entry = small_edge_find(b, b->loop[i], b->loop[j]);
    return entry && entry->owner == b->patch;
}

/* Asks for the chains of the patch that comes next: half of them are an earlier patch's, which lie
 * far away. */
static void ask_for_chains(const struct small_builder *b, uint32_t patch)
{
    if (patch >= b->block->patch_count)
        return;
    for (uint32_t i = b->use_first[patch]; i < b->use_first[patch + 1]; i++)
        if (!small_is_seam(b, b->uses[i] >> 1))
            __builtin_prefetch(&b->block->chains[b->uses[i] >> 1]);
}

static enum status cut_patch(struct small_builder *b, uint32_t patch)
{
    uint32_t n = 0;
    enum triangulation_quality quality = TRIANGULATION_PLANAR;
    ask_for_chains(b, patch + 1);
    enum status status = gather_loop(b, patch, &n);
    if (status != STATUS_OK)
        return status;
    const struct patch *record = &b->block->patches[patch];
    const double normal[3] = {(double)record->normal[0], (double)record->normal[1],
                              (double)record->normal[2]};
    b->patch = patch;
    if (n == 3) {
        /* it must not be the same triangle as the patch beyond */
        const uint32_t centre = is_alone(b, patch) ? find_spare(b, patch) : NO_INDEX;
        return centre != NO_INDEX ? cut_fan(b, n, centre)
                                  : add_face(b, b->loop[0], b->loop[1], b->loop[2]);
    }
    for (uint32_t i = 0; i < n; i++) {
        const float *p = b->block->positions + 3 * (size_t)b->loop[i];
        for (int k = 0; k < 3; k++)
            b->points[3 * (size_t)i + k] = (double)p[k];
    }
    status = triangulate(b->ctx, &b->space->triangulation, b->points, n, normal, diagonal_allowed,
                         b, b->triangles, &quality);
    if (status != STATUS_OK)
        return status;
    if (quality != TRIANGULATION_BLOCKED)
        return take_triangles(b, n, b->triangles);
    const uint32_t spare = find_spare(b, patch);
    if (spare != NO_INDEX)
        return cut_fan(b, n, spare);
    status = triangulate(b->ctx, &b->space->triangulation, b->points, n, normal,
                         own_diagonal_allowed, b, b->triangles, &quality);
    if (status != STATUS_OK || quality != TRIANGULATION_BLOCKED)
        return status == STATUS_OK ? take_triangles(b, n, b->triangles) : status;
    uint32_t copy;
    status = add_copy(b, patch, &copy);
    return status == STATUS_OK ? cut_fan(b, n, copy) : status;
}

/* ---- the result ---- */

/* Gives vertices their numbers by first use and copies what belongs to them. */
static enum status finish(struct small_builder *b, uint32_t stride, struct small_mesh *mesh)
{
    const struct chain_block *block = b->block;
    const uint32_t total = block->vertex_count + b->copy_count;
    uint32_t count = 0, seams = 0;
    enum status status = memory_resize(b->ctx, &b->heads, b->heads_count, total, sizeof *b->heads);
    if (status != STATUS_OK)
        return status;
    b->heads_count = total;
    uint32_t *numbers = b->heads;
    memset(numbers, 0xff, total * sizeof *numbers);
    for (size_t i = 0; i < 3 * (size_t)b->face_count; i++) {
        uint32_t *number = &numbers[b->faces[i]];
        if (*number == NO_INDEX) {
            *number = count++;
            seams += small_on_seam(b, b->faces[i]);
        }
    }
    struct collapse_mesh *to = &mesh->triangles;
    to->vertex_count = count;
    to->face_count = b->face_count;
    mesh->seam_count = seams;
    status = memory_take(b->ctx, count, 3 * sizeof *to->positions, &to->positions);
    if (status == STATUS_OK)
        status = memory_take(b->ctx, b->face_count, 3 * sizeof *to->faces, &to->faces);
    if (status == STATUS_OK)
        status = memory_take(b->ctx, count, 3 * sizeof *to->witnesses, &to->witnesses);
    if (status == STATUS_OK)
        status = memory_take(b->ctx, seams, sizeof *mesh->seams, &mesh->seams);
    if (status == STATUS_OK && stride > 0)
        status = memory_take(b->ctx, count, stride, &to->records);
    if (status != STATUS_OK)
        return status;
    for (size_t i = 0; i < 3 * (size_t)b->face_count; i++)
        to->faces[i] = numbers[b->faces[i]];
    seams = 0;
    for (uint32_t i = 0; i < total; i++) {
        const size_t number = numbers[i];
        const uint32_t v = i < block->vertex_count ? i : b->copies[i - block->vertex_count];
        if (number == NO_INDEX)
            continue;
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
    enum status status = reserve_loop(b, b->block->seam_vertex_count);
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
        status = memory_take(ctx, vertices, sizeof *b->heads, &b->heads);
    b->heads_count = b->heads ? vertices : 0;
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
    memory_release(ctx, &b->seen, b->seen_words, sizeof *b->seen);
    memory_release(ctx, &b->entries, b->entry_capacity, sizeof *b->entries);
    release_loop(b);
    memory_release(ctx, &b->lines, b->line_room, sizeof *b->lines);
    memory_release(ctx, &b->line_errors, b->line_capacity, sizeof *b->line_errors);
    memory_release(ctx, &b->line, b->line_capacity, 3 * sizeof *b->line);
    memory_release(ctx, &b->bulges, vertices, sizeof *b->bulges);
    memory_release(ctx, &b->witnesses, vertices, sizeof *b->witnesses);
    memory_release(ctx, &b->errors, vertices, sizeof *b->errors);
    memory_release(ctx, &b->heads, b->heads_count, sizeof *b->heads);
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
        status = cut_patch(&b, patch);
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
