/*
 * Numbering by first use, and what a slab's worker needs to know about its vertices.
 *
 * First use in face order makes the numbers of a slab's own vertices one range, so that positions
 * can be cut with the faces, a vertex is local by one subtraction, and only the few vertices that
 * the slab shares with earlier ones need a list. The numbering is one sweep over the faces with an
 * array from old to new numbers; where faces come in an order local in space, which store_build
 * sees to, the part of the array that is in use at a time is small.
 */
#include "mesh/draft.h"

#include <string.h>

#include "base/external_sort.h"
#include "base/memory.h"

void draft_init(struct context *ctx, struct draft *draft, const char *beside, unsigned slab_shift)
{
    memset(draft, 0, sizeof *draft);
    draft->ctx = ctx;
    draft->beside = beside;
    draft->slab_shift = slab_shift ? slab_shift : SLAB_SHIFT;
    draft->spool_limit = ctx->memory_budget == UINT64_MAX ? UINT64_MAX : ctx->memory_budget / 8;
    draft->sorter_limit = draft->spool_limit;
}

static void release_slabs(struct draft *draft)
{
    memory_release(draft->ctx, &draft->vertex_first, (size_t)draft->slab_count + 1, 4);
    draft->slab_count = 0;
    spool_clear(&draft->shared_spool);
    draft->shared = NULL;
}

void draft_forget_adjacency(struct draft *draft)
{
    spool_clear(&draft->neighbour_spool);
    spool_clear(&draft->mate_spool);
    draft->neighbours = NULL;
    draft->mates = NULL;
}

void draft_clear(struct draft *draft)
{
    if (!draft->ctx)
        return;
    release_slabs(draft);
    draft_forget_adjacency(draft);
    spool_clear(&draft->face_spool);
    spool_clear(&draft->source_spool);
    memset(draft, 0, sizeof *draft);
}

enum status draft_scratch(struct draft *draft, struct spool *spool, uint64_t size, void *data)
{
    void *bytes;
    enum status status =
        spool_scratch(draft->ctx, spool, draft->beside, draft->spool_limit, size, &bytes);
    if (status == STATUS_OK)
        memcpy(data, &bytes, sizeof bytes);
    return status;
}

enum status draft_adopt_faces(struct draft *draft, struct spool *faces)
{
    void *data;
    enum status status = spool_seal(faces, &data);
    if (status != STATUS_OK)
        return status;
    draft->face_spool = *faces;
    memset(faces, 0, sizeof *faces);
    draft->faces = data;
    draft->face_count = draft->face_spool.size / (3 * sizeof(uint32_t));
    return STATUS_OK;
}

/* ---- residency ---- */

void draft_forget_slab(const struct draft *draft, uint64_t slab)
{
    const uint64_t faces = (uint64_t)1 << draft->slab_shift;
    spool_forget(&draft->face_spool, slab * faces * 12, faces * 12);
    spool_forget(&draft->neighbour_spool, slab * faces * 12, faces * 12);
    spool_forget(&draft->mate_spool, slab * faces, faces);
}

/* ---- numbering ---- */

struct numbering {
    struct spool number_spool;
    struct spool id_spool;
    uint32_t *number_of; /* id -> new number + 1, 0: not used yet */
    uint32_t *id_of;     /* new number -> id */
    unsigned char *shared;
    uint32_t next;
    uint32_t slab_first; /* the slab's first own vertex */
    uint64_t foreign_corners;
};

static inline uint32_t number_vertex(struct numbering *n, uint32_t id)
{
    uint32_t number = n->number_of[id];
    if (number == 0) {
        n->id_of[n->next] = id;
        n->number_of[id] = ++n->next;
        return n->next - 1;
    }
    number--;
    if (number < n->slab_first) {
        n->shared[number >> 3] |= (unsigned char)(1u << (number & 7));
        n->foreign_corners++;
    }
    return number;
}

/* Faces up to `read` have been read, and `kept` of them written. Ids of a slab lie close together
 * where the input is local in space; elsewhere their pages come back. */
static void forget_numbered(const struct draft *draft, const struct numbering *n, uint64_t kept,
                            uint64_t read)
{
    const uint64_t slab = (uint64_t)1 << draft->slab_shift;
    uint64_t from = kept > slab ? kept - slab : 0;
    spool_forget(&draft->face_spool, from * 12, (read - from) * 12);
    spool_forget_all(&n->number_spool);
    spool_forget(&n->id_spool, 0, (uint64_t)n->next * 4);
    spool_forget_all(&draft->shared_spool);
}

/* Renumbers the faces in place and cuts the slabs; faces that repeat a vertex close up. */
static enum status number_faces(struct draft *draft, struct numbering *n, const uint32_t *merged,
                                uint64_t *degenerate)
{
    uint32_t *faces = draft->faces;
    const uint64_t slab_mask = ((uint64_t)1 << draft->slab_shift) - 1;
    uint64_t kept = 0;
    for (uint64_t f = 0; f < draft->face_count; f++) {
        uint32_t a = faces[3 * f], b = faces[3 * f + 1], c = faces[3 * f + 2];
        if (merged) {
            a = merged[a];
            b = merged[b];
            c = merged[c];
        }
        if (a == b || b == c || a == c)
            continue;
        if ((kept & slab_mask) == 0) {
            forget_numbered(draft, n, kept, f);
            n->slab_first = n->next;
            draft->vertex_first[kept >> draft->slab_shift] = n->next;
            enum status status = step(draft->ctx, "import: number", f, draft->face_count);
            if (status != STATUS_OK)
                return status;
        }
        faces[3 * kept] = number_vertex(n, a);
        faces[3 * kept + 1] = number_vertex(n, b);
        faces[3 * kept + 2] = number_vertex(n, c);
        kept++;
    }
    *degenerate = draft->face_count - kept;
    draft->face_count = kept;
    return STATUS_OK;
}

/* From numbers to input vertices, through copies and the numbering before. Dropped again when it
 * says nothing. */
static void compose_source(struct draft *draft, struct spool *new_spool, uint32_t *id_of,
                           uint64_t base_count, const uint32_t *copy_of)
{
    bool is_identity = true;
    for (uint64_t v = 0; v < draft->vertex_count; v++) {
        uint32_t id = id_of[v];
        if (id >= base_count)
            id = copy_of[id - base_count];
        if (draft->source)
            id = draft->source[id];
        id_of[v] = id;
        is_identity = is_identity && id == v;
        if (v % FORGET_EVERY == 0) {
            spool_forget(new_spool, 0, v * 4);
            spool_forget_all(&draft->source_spool);
        }
    }
    spool_forget_all(new_spool);
    spool_clear(&draft->source_spool);
    draft->source = NULL;
    if (is_identity) {
        spool_clear(new_spool);
    } else {
        draft->source_spool = *new_spool;
        draft->source = id_of;
    }
    memset(new_spool, 0, sizeof *new_spool);
}

/* Room for the slab table of all faces, some of which may yet be dropped. */
static enum status begin_slabs(struct draft *draft, uint64_t id_count)
{
    release_slabs(draft);
    uint64_t slabs =
        (draft->face_count + ((uint64_t)1 << draft->slab_shift) - 1) >> draft->slab_shift;
    enum status status = memory_take(draft->ctx, (size_t)slabs + 1, 4, &draft->vertex_first);
    if (status != STATUS_OK)
        return status;
    draft->slab_count = (uint32_t)slabs;
    return draft_scratch(draft, &draft->shared_spool, id_count / 8 + 1, &draft->shared);
}

static enum status end_slabs(struct draft *draft, const struct numbering *n)
{
    uint64_t slabs =
        (draft->face_count + ((uint64_t)1 << draft->slab_shift) - 1) >> draft->slab_shift;
    enum status status = memory_resize(draft->ctx, &draft->vertex_first,
                                       (size_t)draft->slab_count + 1, (size_t)slabs + 1, 4);
    if (status != STATUS_OK)
        return status;
    draft->slab_count = (uint32_t)slabs;
    draft->vertex_first[slabs] = n->next;
    draft->vertex_count = n->next;
    draft->foreign_corners = n->foreign_corners;
    return STATUS_OK;
}

enum status draft_number(struct draft *draft, uint64_t base_count, const uint32_t *merged,
                         const uint32_t *copy_of, uint64_t copy_count, uint64_t *degenerate)
{
    uint64_t id_count = base_count + copy_count;
    if (id_count > (uint64_t)UINT32_MAX - 1)
        return fail(draft->ctx, STATUS_BAD_INPUT,
                    "the mesh has %llu vertices; a store holds at most 4294967294",
                    (unsigned long long)id_count);
    struct numbering n = {0};
    enum status status = begin_slabs(draft, id_count);
    if (status == STATUS_OK)
        status = draft_scratch(draft, &n.number_spool, id_count * 4, &n.number_of);
    if (status == STATUS_OK)
        status = draft_scratch(draft, &n.id_spool, id_count * 4, &n.id_of);
    if (status == STATUS_OK) {
        n.shared = draft->shared;
        status = number_faces(draft, &n, merged, degenerate);
    }
    spool_clear(&n.number_spool);
    if (status == STATUS_OK)
        status = end_slabs(draft, &n);
    if (status == STATUS_OK)
        compose_source(draft, &n.id_spool, n.id_of, base_count, copy_of);
    spool_clear(&n.id_spool);
    return status;
}

void draft_drop_faces(struct draft *draft, const unsigned char *dropped)
{
    uint32_t *faces = draft->faces;
    uint64_t kept = 0;
    for (uint64_t f = 0; f < draft->face_count; f++) {
        if (dropped[f >> 3] >> (f & 7) & 1)
            continue;
        memmove(faces + 3 * kept, faces + 3 * f, 3 * sizeof *faces);
        kept++;
    }
    draft->face_count = kept;
    draft_forget_adjacency(draft);
}

enum status count_distinct(struct sorter *sorter, uint64_t *count)
{
    enum status status = sorter_finish(sorter);
    uint64_t last = 0;
    *count = 0;
    while (status == STATUS_OK) {
        const void *data;
        size_t got;
        status = sorter_next(sorter, &data, &got);
        if (status != STATUS_OK || got == 0)
            break;
        const uint64_t *keys = data;
        for (size_t i = 0; i < got; i++) {
            *count += *count == 0 || keys[i] != last;
            last = keys[i];
        }
    }
    return status;
}

/* ---- a slab ---- */

enum { RUN = 64 }; /* corners looked at together */

/* Least significant digit first, 11 bits a digit; the digits that are all alike are skipped. */
void sort_u32(uint32_t *values, uint32_t *temp, size_t count)
{
    enum { BITS = 11, SIZE = 1 << BITS };
    if (count < 2)
        return;
    uint32_t *from = values, *to = temp;
    for (unsigned shift = 0; shift < 32; shift += BITS) {
        size_t start[SIZE] = {0};
        for (size_t i = 0; i < count; i++)
            start[from[i] >> shift & (SIZE - 1)]++;
        if (start[from[0] >> shift & (SIZE - 1)] == count)
            continue;
        size_t sum = 0;
        for (size_t d = 0; d < SIZE; d++) {
            size_t size = start[d];
            start[d] = sum;
            sum += size;
        }
        for (size_t i = 0; i < count; i++)
            to[start[from[i] >> shift & (SIZE - 1)]++] = from[i];
        uint32_t *swap = from;
        from = to;
        to = swap;
    }
    if (from != values)
        memcpy(values, from, count * sizeof *values);
}

uint32_t foreign_rank(const uint32_t *foreign, uint32_t count, uint32_t vertex)
{
    const uint32_t *base = foreign;
    while (count > 1) {
        uint32_t half = count / 2;
        base = base[half - 1] < vertex ? base + half : base;
        count -= half;
    }
    return (uint32_t)(base - foreign);
}

/* Appends the vertices below `first` among `count` corners. */
static enum status collect_foreign(struct slab_scope *scope, const uint32_t *corners, size_t count,
                                   size_t *found)
{
    enum status status = memory_reserve(scope->ctx, &scope->foreign, &scope->foreign_capacity,
                                        *found + count, sizeof(uint32_t));
    if (status != STATUS_OK)
        return status;
    for (size_t i = 0; i < count; i++) {
        if (corners[i] < scope->vertex_first)
            scope->foreign[(*found)++] = corners[i];
    }
    return STATUS_OK;
}

static bool any_below(const uint32_t *corners, size_t count, uint32_t first)
{
    uint32_t any = 0;
    for (size_t i = 0; i < count; i++)
        any |= corners[i] < first;
    return any;
}

enum status scope_enter(struct draft *draft, uint32_t slab, struct slab_scope *scope)
{
    scope->ctx = draft->ctx;
    uint64_t first = (uint64_t)slab << draft->slab_shift;
    uint64_t left = draft->face_count - first;
    uint64_t full = (uint64_t)1 << draft->slab_shift;
    scope->face_first = (uint32_t)first;
    scope->face_count = (uint32_t)(left < full ? left : full);
    scope->vertex_first = draft->vertex_first[slab];
    scope->own_count = draft->vertex_first[slab + 1] - scope->vertex_first;

    /* Nearly all runs of corners have none, which vector instructions tell at once. */
    const uint32_t *corners = draft->faces + 3 * first;
    const size_t count = 3 * (size_t)scope->face_count;
    enum status status = STATUS_OK;
    size_t found = 0;
    for (size_t i = 0; i < count && status == STATUS_OK; i += RUN) {
        size_t run = count - i < RUN ? count - i : RUN;
        if (any_below(corners + i, run, scope->vertex_first))
            status = collect_foreign(scope, corners + i, run, &found);
    }
    if (status == STATUS_OK)
        status = memory_reserve(scope->ctx, &scope->temp, &scope->temp_capacity, found,
                                sizeof(uint32_t));
    if (status != STATUS_OK)
        return status;
    sort_u32(scope->foreign, scope->temp, found);
    uint32_t unique = 0;
    for (size_t i = 0; i < found; i++) {
        if (i == 0 || scope->foreign[i] != scope->foreign[unique - 1])
            scope->foreign[unique++] = scope->foreign[i];
    }
    scope->foreign_count = unique;
    return STATUS_OK;
}

void scope_clear(struct slab_scope *scope)
{
    if (!scope->ctx)
        return;
    memory_release(scope->ctx, &scope->foreign, scope->foreign_capacity, sizeof(uint32_t));
    memory_release(scope->ctx, &scope->temp, scope->temp_capacity, sizeof(uint32_t));
    memset(scope, 0, sizeof *scope);
}
