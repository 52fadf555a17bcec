/*
 * From a patch to triangles: its loop is read off its chains as they were cut, and cut along
 * diagonals that nobody else has (the rules are those of small_mesh.c).
 */
#include "base/memory.h"
#include "simplify/small_internal.h"

#define BORDER UINT64_MAX /* instead of a patch */

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

void small_loop_release(struct small_builder *b)
{
    memory_release(b->ctx, &b->triangles, b->loop_room, 3 * sizeof *b->triangles);
    memory_release(b->ctx, &b->points, b->loop_room, 3 * sizeof *b->points);
    memory_release(b->ctx, &b->loop, b->loop_room, sizeof *b->loop);
}

enum status small_loop_reserve(struct small_builder *b, uint32_t vertices)
{
    if (vertices <= b->loop_room)
        return STATUS_OK;
    small_loop_release(b);
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
    status = small_loop_reserve(b, most);
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

enum status small_patch_cut(struct small_builder *b, uint32_t patch)
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
