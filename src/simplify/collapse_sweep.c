/*
 * One sweep over the vertices of a mesh whose edges are collapsed: what is cheap enough is done.
 *
 * A vertex's key is the cost of its cheapest edge when it was last looked at. Keys are not brought
 * up to date when something changes near them: a vertex whose key lets it through is looked at
 * afresh before it is believed.
 */
#include <math.h>
#include <string.h>

#include "base/parallel.h"
#include "collapse_internal.h"

/*
 * An edge waits when its error would be more than so many times the last sweep's typical one. (Not
 * the present sweep's so far: on parts the first thousands of collapses cost nothing, and all that
 * have a price would wait.) The largest distance in the end is about this bound, so the lower the
 * better; but how low it can be differs: errors of a smooth shape lie close together, and where the
 * bound is below nearly all of them, what is let through in the end is the worst. So with a
 * reference the bound moves, sweep by sweep, to where REFUSED_SHARE of the tried edges wait.
 * Without one it stays: estimates are not worth more.
 */
static const double ASTRAY = 2.5;
static const double ASTRAY_LEAST = 1.25;
static const double REFUSED_SHARE = 0.5;
static const double ASTRAY_PACE = 0.3;
/* A sweep of fewer collapses than this part of the faces counts in proportion: the last ones before
 * a target are few and dear, and must not raise what is usual. */
static const double TYPICAL_PART = 0.0625;

/* ---- keys ---- */

enum { KEYS_STRETCH = 4096 };

/* One stretch of vertices for keys_sample. */
static enum status sample_stretch(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct collapse *c = user;
    const struct territory whole = {.end = (uint32_t)c->vertex_slots};
    const uint64_t first = job * KEYS_STRETCH;
    const uint64_t end = first + KEYS_STRETCH < c->vertex_slots ? first + KEYS_STRETCH : whole.end;
    struct vertex_edges edges;
    for (uint32_t v = (uint32_t)first; v < end; v++) {
        c->keys[v] = c->vertices[v].corner == NO_INDEX ? INFINITY : 0;
        if (v % c->key_step != 0 || c->vertices[v].corner == NO_INDEX)
            continue;
        vertex_evaluate(c, &whole, v, &edges);
        c->keys[v] = edges.least;
    }
    return STATUS_OK;
}

/* (Few vertices are all looked at.) */
enum status keys_sample(struct collapse *c)
{
    enum { SAMPLE_STEP = 8, FEW = 4096 };
    const uint64_t stretches = (c->vertex_slots + KEYS_STRETCH - 1) / KEYS_STRETCH;
    enum status status = STATUS_OK;
    c->key_step = c->vertex_slots > FEW ? SAMPLE_STEP : 1;
    if (c->options.together)
        return parallel_for(c->ctx, stretches, sample_stretch, c);
    for (uint64_t job = 0; job < stretches && status == STATUS_OK; job++)
        status = sample_stretch(c, job, 0);
    return status;
}

/* The threshold of the next sweep: the cost below which `wanted` of the vertices' keys lie, to
 * three bits of mantissa; INFINITY when no vertex has a key. */
float keys_threshold(const struct collapse *c, uint64_t wanted)
{
    enum { BIN_SHIFT = 20, BINS = 1 << (31 - BIN_SHIFT) };
    uint32_t counts[BINS] = {0}, bits;
    uint64_t sum = 0;
    float key;
    wanted /= c->key_step;
    for (uint64_t v = 0; v < c->vertex_slots; v += c->key_step) {
        memcpy(&bits, &c->keys[v], sizeof bits);
        counts[bits >> BIN_SHIFT]++;
    }
    const uint32_t infinite = 0x7f800000u >> BIN_SHIFT;
    uint32_t bin = 0, last = BINS;
    for (; bin < infinite; bin++) {
        sum += counts[bin];
        if (counts[bin])
            last = bin;
        if (sum >= wanted && sum > 0)
            break;
    }
    if (last == BINS)
        return INFINITY;
    bits = (last + 1) << BIN_SHIFT;
    memcpy(&key, &bits, sizeof key);
    return key;
}

/* ---- sweeps ---- */

/* A vertex that is soon to be worked on, and how far its ring has been asked for. */
struct expected {
    uint32_t vertex, corner;
};

/* One step of asking for a ring: the memory that this step reads was asked for by the one before.
 */
static inline void ask_for_ring(const struct collapse *c, struct expected *e)
{
    if (e->corner == NO_INDEX)
        return;
    const struct collapse_corner corner = c->corners[e->corner];
    if (corner.end != NO_INDEX)
        __builtin_prefetch(&c->vertices[corner.end]);
    if (corner.swing != NO_INDEX)
        __builtin_prefetch(&c->corners[corner.swing]);
    e->corner = corner.swing;
}

/*
 * Works on all vertices of a territory whose key is not above the threshold, in the order of their
 * numbers. Most of the time would go by waiting for memory, step by step round each vertex; so the
 * next vertices are found in advance, and before each is worked on the rings of those behind it are
 * followed by one step each.
 */
static void sweep_territory(struct collapse *c, struct territory *t, float threshold)
{
    enum { AHEAD = 8 };
    struct expected queue[AHEAD];
    uint32_t next = t->first, taken = 0, put = 0;
    while (t->taken < t->most_taken) {
        for (uint32_t i = taken; i != put; i++)
            ask_for_ring(c, &queue[i % AHEAD]);
        for (; put - taken < AHEAD && next < t->end; next++)
            if (c->keys[next] <= threshold) {
                const uint32_t corner = c->vertices[next].corner;
                if (corner == NO_INDEX)
                    continue;
                queue[put++ % AHEAD] = (struct expected){next, corner};
                __builtin_prefetch(&c->corners[corner]);
            }
        if (put == taken)
            return;
        const uint32_t v = queue[taken++ % AHEAD].vertex;
        if (c->keys[v] <= threshold)
            vertex_work_on(c, t, v, threshold);
    }
}

/* ---- a sweep in several threads ---- */

/* Runs are long, as what reaches out of them is left over, but there are some for every thread of a
 * small machine. (Of the root's sweeps a tenth is left at the end with runs of 3000, a sixth with
 * runs of 750. Means and largest distances of 18 meshes at 2,600 to 12,000 faces, all efforts, are
 * the same even with runs of 512 as with one thread's order; on meshes of a few thousand faces,
 * where threads gain nothing, the worst largest distances were worse with those.) */
enum {
    TERRITORIES_MIN = 4,
    TERRITORIES_MAX = 64,
    TERRITORY_VERTICES = 8192,
    TERRITORY_VERTICES_LEAST = 1024,
    TERRITORY_FACES_LEAST = 32
};

struct shared_sweep {
    struct collapse *collapse;
    float threshold;
    struct territory territories[TERRITORIES_MAX + 1];
    uint32_t order[TERRITORIES_MAX + 1]; /* in which they are begun */
};

static enum status sweep_job(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct shared_sweep *shared = user;
    struct territory *territory = &shared->territories[shared->order[job]];
    sweep_territory(shared->collapse, territory, shared->threshold);
    return STATUS_OK;
}

/* What was done in a territory, added to the whole. */
static void account_for(struct collapse *c, const struct territory *t)
{
    c->live_faces -= t->taken;
    c->error_sum += t->error_sum;
    c->error_count += t->error_count;
    c->refused_count += t->refused_count;
    c->held_back |= t->held_back;
}

/* Into how many runs of vertices a sweep is cut; 0: it is too small. No run may take more than its
 * part of the faces still to go, which is about twice what it will take. */
static uint64_t count_territories(const struct collapse *c, uint64_t most_faces)
{
    uint64_t count = c->vertex_slots / TERRITORY_VERTICES;
    count = count > TERRITORIES_MIN ? count : TERRITORIES_MIN;
    count = count < TERRITORIES_MAX ? count : TERRITORIES_MAX;
    const bool is_large = c->vertex_slots >= count * TERRITORY_VERTICES_LEAST &&
                          c->live_faces - most_faces >= count * TERRITORY_FACES_LEAST;
    return c->options.together && is_large ? count : 0;
}

/* Begins with the territory where most vertices are let through, so that all threads end at about
 * the same time. (The order does not matter to what comes out.) */
static void order_territories(struct shared_sweep *shared, uint32_t count)
{
    uint32_t dues[TERRITORIES_MAX + 1] = {0};
    for (uint32_t i = 0; i < count; i++) {
        const struct territory *t = &shared->territories[i];
        uint32_t due = 0, at = i;
        for (uint32_t v = t->first; v < t->end; v++)
            due += shared->collapse->keys[v] <= shared->threshold;
        for (; at > 0 && dues[at - 1] < due; at--) {
            dues[at] = dues[at - 1];
            shared->order[at] = shared->order[at - 1];
        }
        dues[at] = due;
        shared->order[at] = i;
    }
}

/* Works in all runs at once; `halves` is 1 when they are shifted by half a run. */
static enum status sweep_runs(struct shared_sweep *shared, uint64_t count, uint64_t halves,
                              uint64_t most_faces)
{
    struct collapse *c = shared->collapse;
    const uint64_t runs = count + halves, slots = c->vertex_slots;
    const uint64_t most_taken = (c->live_faces - most_faces) / runs;
    for (uint64_t i = 0, first = 0; i < runs; i++) {
        const uint64_t end = i + 1 < runs ? slots * (2 * (i + 1) - halves) / (2 * count) : slots;
        shared->territories[i] =
            (struct territory){.first = (uint32_t)first,
                               .end = (uint32_t)end,
                               .most_taken = most_taken > 0 ? most_taken - 1 : 0,
                               .leaf = UINT32_MAX};
        first = end;
    }
    order_territories(shared, (uint32_t)runs);
    enum status status = parallel_for(c->ctx, runs, sweep_job, shared);
    for (uint64_t i = 0; i < runs; i++)
        account_for(c, &shared->territories[i]);
    return status;
}

/*
 * Cuts the vertices into equal runs of numbers, which do not depend on the threads, and works in
 * all of them at once. An edge is collapsed only where the rings of both its ends lie in one run:
 * then whatever it reads or writes belongs to vertices of that run alone. The others keep their
 * keys; what lies between two runs is in the middle of one when they are shifted by half their
 * length, and the little that is left then is to be done afterwards.
 */
static enum status sweep_together(struct collapse *c, float threshold, uint64_t count,
                                  uint64_t most_faces)
{
    struct shared_sweep shared = {.collapse = c, .threshold = threshold};
    enum status status = sweep_runs(&shared, count, 0, most_faces);
    return status == STATUS_OK ? sweep_runs(&shared, count, 1, most_faces) : status;
}

/* What the last sweep's errors say about the present one's. */
static void learn_errors(struct collapse *c)
{
    if (c->error_count > 0) {
        const double mean = c->error_sum / (double)c->error_count;
        const double enough = TYPICAL_PART * (double)c->live_faces;
        const double weight = c->typical_error > 0 ? fmin(1, (double)c->error_count / enough) : 1;
        c->typical_error += weight * (mean - c->typical_error);
    }
    const uint64_t tried = c->error_count + c->refused_count;
    if (c->reference.face_count == 0) {
        c->astray = ASTRAY;
    } else if (tried > 0) {
        const double share = (double)c->refused_count / (double)tried;
        c->astray *= 1 + ASTRAY_PACE * (share - REFUSED_SHARE);
        c->astray = fmin(fmax(c->astray, ASTRAY_LEAST), ASTRAY);
    }
    c->error_sum = 0;
    c->error_count = c->refused_count = 0;
}

enum status sweep(struct collapse *c, float threshold, uint64_t most_faces)
{
    enum status status = STATUS_OK;
    learn_errors(c);
    const uint64_t territories = count_territories(c, most_faces);
    if (territories > 0)
        status = sweep_together(c, threshold, territories, most_faces);
    struct territory whole = {.end = (uint32_t)c->vertex_slots,
                              .most_taken = c->live_faces - most_faces,
                              .leaf = UINT32_MAX};
    if (status == STATUS_OK)
        sweep_territory(c, &whole, threshold);
    account_for(c, &whole);
    c->key_step = 1;
    return status;
}
