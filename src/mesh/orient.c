/*
 * Mending orientation.
 *
 * A spread from face to face over the whole mesh would do, but it runs all over the memory. The
 * survey has already joined the open components of the slabs and their parities; here each slab
 * finds its components again, looks up what was decided, and marks its faces to be turned.
 *
 * A surface that is not orientable has no parities. Any orientation of its faces then contradicts
 * itself along closed curves, and the surface is cut there. The parities of union-find would give
 * fractal curves; a breadth-first spread from the lowest face has short fronts, and cuts where they
 * meet. Such meshes are rare, and only they pay for it. Round a vertex inside the surface the
 * number of cut edges is even, so never one: all copies come apart, and no slit closes onto itself.
 */
#include "mesh/orient.h"

#include "base/memory.h"
#include "base/parallel.h"

enum { TURN_NOT = 0, TURN = 1, TURN_UNKNOWN = 2 }; /* of a face */

struct turning {
    struct draft *draft;
    struct survey *survey;
    struct slab_scope *scopes; /* one a worker */
    struct components *components;
    struct spool turn_spool;
    uint8_t *turn; /* a face */
};

/* ---- what to turn ---- */

/* Which parity is to be turned, or TURN_UNKNOWN for a component that is not orientable. */
static unsigned parity_to_turn(uint64_t faces, uint64_t turned, bool is_twisted)
{
    if (is_twisted)
        return TURN_UNKNOWN;
    return 2 * turned > faces ? 0 : 1;
}

static unsigned decide(struct turning *t, const struct component *c, uint32_t open_first)
{
    if (c->open_id == NO_INDEX)
        return parity_to_turn(c->faces, c->turned, c->is_twisted);
    struct open_component *open = t->survey->open;
    /* Without halving paths: all threads read. survey_draft has left every set flat. */
    const struct open_component *own = &open[open_first + c->open_id];
    const struct open_component *root = &open[own->up];
    unsigned turn = parity_to_turn(root->faces, root->turned, root->is_twisted);
    return turn == TURN_UNKNOWN ? turn : turn ^ own->up_turned;
}

static enum status mark_slab(void *user, uint64_t job, unsigned worker)
{
    struct turning *t = user;
    struct slab_scope *scope = &t->scopes[worker];
    struct components *components = &t->components[worker];
    enum status status = scope_enter(t->draft, (uint32_t)job, scope);
    if (status == STATUS_OK)
        status = components_find(t->draft, scope, components);
    if (status != STATUS_OK)
        return status;
    uint8_t *turn = t->turn + scope->face_first;
    /* open_id of a component is done with: from here on it holds the decision. */
    for (uint32_t i = 0; i < components->count; i++)
        components->list[i].open_id = decide(t, &components->list[i], t->survey->open_first[job]);
    for (uint32_t f = 0; f < scope->face_count; f++) {
        uint32_t label = components->label[f];
        uint32_t decision = components->list[label >> 1].open_id;
        turn[f] = decision == TURN_UNKNOWN ? TURN_UNKNOWN : (label & 1) == decision;
    }
    return STATUS_OK;
}

static enum status forget_slab(void *user, uint64_t job)
{
    struct turning *t = user;
    draft_forget_slab(t->draft, job);
    spool_forget_all(&t->turn_spool);
    return step(t->draft->ctx, "import: orient", job, t->draft->slab_count);
}

/* ---- surfaces that are not orientable ---- */

/* The front of a spread may lie anywhere: after so many faces, what they brought in is forgotten.
 */
enum { FORGET_FACES = 64 };

static void forget_all(const struct turning *t, const struct spool *queue_spool)
{
    draft_forget_all(t->draft);
    spool_forget_all(&t->turn_spool);
    spool_forget_all(queue_spool);
}

/* From face `start` on, breadth first; `queue` has room for all that are unknown. */
static void spread(struct turning *t, uint32_t start, const struct spool *queue_spool,
                   uint32_t *queue)
{
    const struct draft *draft = t->draft;
    uint64_t head = 0, tail = 0;
    t->turn[start] = TURN_NOT;
    queue[tail++] = start;
    while (head < tail) {
        uint32_t f = queue[head++];
        if (head % FORGET_FACES == 0)
            forget_all(t, queue_spool);
        for (unsigned k = 0; k < 3; k++) {
            uint32_t over = draft->neighbours[3 * (size_t)f + k];
            if (over == NO_INDEX || t->turn[over] != TURN_UNKNOWN)
                continue;
            unsigned mate = mate_of(draft->mates, f, k);
            t->turn[over] = t->turn[f] ^ (uint8_t)run_alike(draft->faces, f, k, over, mate);
            queue[tail++] = over;
        }
    }
}

static enum status spread_twisted(struct turning *t, struct orient_counts *counts)
{
    struct draft *draft = t->draft;
    uint64_t unknown = 0;
    for (uint64_t f = 0; f < draft->face_count; f++)
        unknown += t->turn[f] == TURN_UNKNOWN;
    spool_forget_all(&t->turn_spool);
    if (unknown == 0)
        return STATUS_OK;
    struct spool queue_spool = {0};
    uint32_t *queue;
    enum status status = room_scratch(&draft->room, &queue_spool, unknown * sizeof *queue, &queue);
    for (uint64_t f = 0; f < draft->face_count && status == STATUS_OK; f++) {
        if (t->turn[f] != TURN_UNKNOWN)
            continue;
        status = step(draft->ctx, "import: orient", f, draft->face_count);
        forget_all(t, &queue_spool);
        spread(t, (uint32_t)f, &queue_spool, queue);
        counts->twisted++;
    }
    spool_clear(&queue_spool);
    return status;
}

/* Opens the edges along which the orientation still contradicts itself. */
static void cut_twisted(struct draft *draft, struct orient_counts *counts)
{
    for (uint64_t f = 0; f < draft->face_count; f++) {
        for (unsigned k = 0; k < 3; k++) {
            uint32_t over = draft->neighbours[3 * f + k];
            if (over == NO_INDEX || over < f)
                continue;
            unsigned mate = mate_of(draft->mates, f, k);
            if (!run_alike(draft->faces, f, k, over, mate))
                continue;
            draft->neighbours[3 * f + k] = NO_INDEX;
            draft->neighbours[3 * (uint64_t)over + mate] = NO_INDEX;
            mate_set(draft->mates, f, k, 0);
            mate_set(draft->mates, over, mate, 0);
            if (counts->cut++ % FORGET_FACES == 0)
                draft_forget_all(draft);
        }
        if (f % FORGET_EVERY == 0) {
            draft_forget_all(draft);
            draft_expect_slab(draft, f >> draft->slab_shift);
        }
    }
    draft_forget_all(draft);
}

/* ---- turning ---- */

/* A turned face a, b, c becomes a, c, b, so that its edge k becomes its edge 2 - k. */
static enum status turn_slab(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct turning *t = user;
    struct draft *draft = t->draft;
    uint64_t first = job << draft->slab_shift;
    draft_expect_slab(draft, job);
    uint64_t end = first + ((uint64_t)1 << draft->slab_shift);
    if (end > draft->face_count)
        end = draft->face_count;
    for (uint64_t f = first; f < end; f++) {
        uint32_t *over = draft->neighbours + 3 * f;
        for (unsigned k = 0; k < 3; k++) {
            if (over[k] != NO_INDEX && t->turn[over[k]])
                mate_set(draft->mates, f, k, 2 - mate_of(draft->mates, f, k));
        }
        if (!t->turn[f])
            continue;
        uint32_t *face = draft->faces + 3 * f;
        uint32_t vertex = face[1], neighbour = over[0];
        unsigned mate = mate_of(draft->mates, f, 0);
        face[1] = face[2];
        face[2] = vertex;
        over[0] = over[2];
        over[2] = neighbour;
        mate_set(draft->mates, f, 0, mate_of(draft->mates, f, 2));
        mate_set(draft->mates, f, 2, mate);
    }
    return STATUS_OK;
}

/* ---- the whole ---- */

static enum status prepare(struct turning *t)
{
    struct context *ctx = t->draft->ctx;
    enum status status = memory_take_zeroed(ctx, ctx->threads, sizeof *t->scopes, &t->scopes);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, ctx->threads, sizeof *t->components, &t->components);
    if (status == STATUS_OK)
        status = room_scratch(&t->draft->room, &t->turn_spool, t->draft->face_count, &t->turn);
    return status;
}

static void release(struct turning *t)
{
    struct context *ctx = t->draft->ctx;
    for (unsigned i = 0; t->scopes && i < ctx->threads; i++)
        scope_clear(&t->scopes[i]);
    for (unsigned i = 0; t->components && i < ctx->threads; i++)
        components_clear(&t->components[i]);
    memory_release(ctx, &t->scopes, ctx->threads, sizeof *t->scopes);
    memory_release(ctx, &t->components, ctx->threads, sizeof *t->components);
    spool_clear(&t->turn_spool);
}

enum status orient_draft(struct draft *draft, struct survey *survey, struct orient_counts *counts)
{
    struct turning t = {.draft = draft, .survey = survey};
    uint64_t degenerate;
    enum status status = prepare(&t);
    if (status == STATUS_OK)
        status = parallel_ordered(draft->ctx, draft->slab_count, draft->room.in_flight, mark_slab,
                                  forget_slab, &t);
    if (status == STATUS_OK)
        status = spread_twisted(&t, counts);
    if (status == STATUS_OK) {
        for (uint64_t f = 0; f < draft->face_count; f++)
            counts->flipped += t.turn[f];
        spool_forget_all(&t.turn_spool);
        status = parallel_ordered(draft->ctx, draft->slab_count, draft->room.in_flight, turn_slab,
                                  forget_slab, &t);
    }
    if (status == STATUS_OK && counts->twisted)
        cut_twisted(draft, counts);
    release(&t);
    if (status == STATUS_OK)
        status = draft_number(draft, draft->vertex_count, NULL, NULL, 0, &degenerate);
    return status;
}
