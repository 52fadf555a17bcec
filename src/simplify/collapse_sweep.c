/*
 * One sweep over the vertices of a mesh whose edges are collapsed: what is cheap enough is done.
 *
 * A vertex's key is the cost of its cheapest edge when it was last looked at. Keys are not brought
 * up to date when something changes near them: a vertex whose key lets it through is looked at
 * afresh before it is believed.
 */
#include <math.h>
#include <string.h>

#include "base/bytes.h"
#include "base/parallel.h"
#include "collapse_internal.h"

/* What effort changes. Measured on bunny, koala, dragon and a noisy scan against sweeps of 2 to 10
 * % of the vertices that make each cost anew as soon as it may have changed: mean and RMS error
 * within 1 %, a third to a quarter of the costs worked out. */
static const struct pace {
    double part; /* of the vertices that one sweep lets through */
    float wait;  /* a vertex just moved is looked at again at so many times the threshold: its edges
                    are seldom cheaper */
} PACES[] = {{0.7, 3}, {0.4, 3}, {0.3, 2}};
/* Orders to choose from where a level is made several times. Waiting keeps the largest distance of
 * nearly all shapes down; but where all is thin walls, nothing but those is left to be collapsed in
 * the end (rotor_small at 2 %: 3.7 times the quadrics' largest distance, 1.8 without). */
static const struct variant {
    double part; /* times that of the pace */
    bool waits;  /* edges wait for their error */
} VARIANTS[] = {{1, true}, {0.7, false}, {0.7, true}, {1, false}, {0.85, true}};
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
static const double ERROR_LEAST = 1e-3; /* mean edges */
/* Of the first sweep, mean edges: where nothing is thinned before, a mesh has far more faces than
 * its level, and tips of borders must not go by its edges. */
static const double USUAL_FIRST = 0.12;
/* A sweep of fewer collapses than this part of the faces counts in proportion: the last ones before
 * a target are few and dear, and must not raise what is usual. */
static const double TYPICAL_PART = 0.0625;
/* Estimated errors that the reference is asked about, as parts of what is usual: below they are
 * harmless, above there is no hope. What it refuses counts as so many times what is usual. */
static const double HARMLESS = 0.7;
static const double HOPELESS = 2;
static const double REFUSED = 1.25;

/* ---- keys ---- */

enum { KEYS_STRETCH = 4096 };

/* (What is done roughly is done at the first pace: no finer order shows in the end.) */
static const struct pace *pace_of(const struct collapse *c)
{
    if (c->options.roughly)
        return &PACES[0];
    return &PACES[c->options.effort >= 3 ? 2 : c->options.effort == 2 ? 1 : 0];
}

static const struct variant *variant_of(const struct collapse *c)
{
    return &VARIANTS[c->options.variant % (sizeof VARIANTS / sizeof *VARIANTS)];
}

double sweep_part(const struct collapse *c)
{
    return pace_of(c)->part * variant_of(c)->part;
}

/* Edge i costs so much more now that another may be the cheapest. */
static void raise_cost(struct vertex_edges *edges, uint32_t i, float cost)
{
    edges->costs[i] = cost;
    edges->least = INFINITY;
    edges->cheapest = 0;
    for (uint32_t k = 0; k < edges->look.ring.count; k++)
        if (edges->costs[k] < edges->least) {
            edges->least = edges->costs[k];
            edges->cheapest = k;
        }
}

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

/* ---- one collapse ---- */

static double scalar_read(enum scalar_type type, const unsigned char *from)
{
    return type == SCALAR_FLOAT32 ? (double)load_f32(from) : load_f64(from);
}

/* Record of `kept` := between it and `other`'s, t of the way: floats linearly, integers the nearer.
 */
static void blend_records(struct collapse *c, uint32_t kept, uint32_t other, double t)
{
    const size_t stride = c->attributes.stride;
    unsigned char *to = c->records + kept * stride;
    const unsigned char *from = c->records + other * stride;
    for (uint32_t i = 0; i < c->attributes.count; i++) {
        const struct attribute *attribute = &c->attributes.list[i];
        unsigned char *a = to + attribute->offset;
        const unsigned char *b = from + attribute->offset;
        if (attribute->type != SCALAR_FLOAT32 && attribute->type != SCALAR_FLOAT64) {
            if (t > 0.5)
                memcpy(a, b, scalar_size(attribute->type));
            continue;
        }
        const double x = scalar_read(attribute->type, a);
        const double value = x + t * (scalar_read(attribute->type, b) - x);
        if (attribute->type == SCALAR_FLOAT32)
            store_f32(a, (float)value);
        else
            store_f64(a, value);
    }
}

/* Which of the edge's ends stays: the one whose place is kept, else the lower number. */
static uint32_t choose_kept(const struct collapse *c, const struct edge_change *change)
{
    const uint32_t v = change->v, w = change->w;
    const float *to = change->to[0];
    if (c->vertices[v].flags & VERTEX_LOCKED)
        return v;
    if (c->vertices[w].flags & VERTEX_LOCKED)
        return w;
    if (c->options.subset)
        return to[0] == 0 && to[1] == 0 && to[2] == 0 ? v : w;
    return v < w ? v : w;
}

static void move_vertex(struct collapse *c, const struct edge_change *change, uint32_t kept)
{
    const uint32_t v = change->v, w = change->w;
    if (c->options.subset || (c->vertices[kept].flags & VERTEX_LOCKED))
        return;
    if (c->records) {
        const struct vertex_look *look = change->looks[0];
        double to[3], edge[3];
        for (int k = 0; k < 3; k++) {
            to[k] = (double)change->to[0][k];
            edge[k] = (double)look->at[k][change->place[0]];
        }
        double t = dot_product(to, edge) / dot_product(edge, edge);
        t = t > 0 ? (t < 1 ? t : 1) : 0;
        blend_records(c, kept, kept == v ? w : v, kept == v ? t : 1 - t);
    }
    const float *from = c->vertices[v].position;
    float place[3];
    for (int k = 0; k < 3; k++)
        place[k] = from[k] + change->to[0][k];
    memcpy(c->vertices[kept].position, place, sizeof place);
}

/* Sets the keys round a vertex that has just moved. Its costs and its neighbours' have changed;
 * they are found out when their turn comes, which is after most of them have changed again. The
 * vertex itself, and a neighbour that had no edge left, are given a guess. */
static void renew_keys(struct collapse *c, const struct edge_change *change, uint32_t kept,
                       float threshold)
{
    const float later = threshold * pace_of(c)->wait;
    const float guess = later < INFINITY ? later : threshold;
    for (int end = 0; end < 2; end++) {
        const struct ring *ring = &change->looks[end]->ring;
        for (uint32_t i = 0; i < ring->count; i++) {
            const uint32_t r = ring->vertices[i];
            if (!(c->keys[r] < INFINITY) && c->vertices[r].corner != NO_INDEX)
                c->keys[r] = guess;
        }
    }
    c->keys[kept] = guess;
}

/*
 * What a cost is multiplied by because of its error. Volumes say little about thin tips, borders
 * and bridges, so that a memoryless cost lets single places go far astray: where the error would be
 * more than `usual`, the edge waits for the typical error to grow. The mean error hardly changes;
 * the largest of the dragon at 10 % of its faces was 3.3 times CGAL's Garland-Heckbert's without,
 * and is 0.9 times.
 */
static double error_price(double error, double usual)
{
    if (error <= usual)
        return 1;
    /* bounded, so that where all have waited the costs still tell the order */
    const double times = fmin(error / usual, 32);
    return 1e6 * times * times * times * times;
}

/* Where edge i of v leads, its vertex rounded to what can be stored. */
static void prepare_change(const struct collapse *c, uint32_t v, const struct vertex_edges *edges,
                           uint32_t i, const struct vertex_look *other, struct edge_change *change)
{
    const float *from = c->vertices[v].position;
    change->v = v;
    change->w = edges->look.ring.vertices[i];
    change->looks[0] = &edges->look;
    change->looks[1] = other;
    change->place[0] = i;
    change->place[1] = 0;
    while (other->ring.count && other->ring.vertices[change->place[1]] != v)
        change->place[1]++;
    const bool at_end =
        c->options.subset ||
        ((c->vertices[v].flags | c->vertices[change->w].flags) & VERTEX_LOCKED) != 0;
    for (int k = 0; k < 3; k++) {
        const float step = edges->places[k][i], place = from[k] + step;
        change->to[0][k] = at_end ? step : place - from[k];
        change->to[1][k] =
            at_end ? step - edges->look.at[k][i] : place - c->vertices[change->w].position[k];
    }
}

/* What became of trying an edge. */
enum trial {
    TRIAL_DONE,
    TRIAL_DEAR,      /* a guard forbids it, or it costs more than was thought */
    TRIAL_ELSEWHERE, /* its other end reaches out of the territory */
};

/* Up to this error collapses need not wait. */
static double usual_error(const struct collapse *c)
{
    const double edge = 1 / (double)c->unit;
    if (!(c->typical_error > 0))
        return USUAL_FIRST * edge;
    /* rounding on flat faces is no error to go by */
    const double typical = fmax(c->typical_error, ERROR_LEAST * edge);
    return c->astray * typical;
}

/* The error that a collapse is to be judged by. What the estimate finds harmless is believed; else
 * the reference tells, if there is one. */
static double judge_error(const struct collapse *c, struct territory *t,
                          const struct edge_change *change, double bound, struct edge_error *found)
{
    const double offset = fabs((double)found->offset);
    const double error = fmax(found->forward, fmax(offset, found->between));
    if (c->reference.face_count == 0 || found->forward > bound || error <= HARMLESS * bound ||
        error > HOPELESS * bound)
        return error;
    if (!reference_allows(c, change, bound, &t->leaf))
        return fmax(error, REFUSED * bound);
    if (offset > bound)
        found->offset = found->offset < 0 ? -(float)bound : (float)bound;
    return fmin(error, bound);
}

/* Tips of borders have hardly a cost, so that errors are measured there even where others are not:
 * a few edges. */
static bool at_border(const struct collapse *c, const struct edge_change *change)
{
    return ((c->vertices[change->v].flags | c->vertices[change->w].flags) & VERTEX_BORDER) != 0;
}

/* Whether the new vertex is farther from the edge's middle than the edge is long. Where faces are
 * thin, a volume is preserved by places far off the surface: a component of a few faces became a
 * needle seven times as long as its edges. One collapse in a hundred of a scan is so. */
static bool is_far(const struct edge_change *change)
{
    float edge = 0, away = 0;
    for (int k = 0; k < 3; k++) {
        const float along = change->to[0][k] - change->to[1][k];
        const float twice = change->to[0][k] + change->to[1][k];
        edge += along * along;
        away += twice * twice;
    }
    return away > 4 * edge;
}

/* Tries edge i of v. When it turned out dearer than the threshold its cost says so now. */
static enum trial try_edge(struct collapse *c, struct territory *t, uint32_t v,
                           struct vertex_edges *edges, uint32_t i, float threshold)
{
    const uint32_t w = edges->look.ring.vertices[i];
    struct vertex_look other;
    struct edge_change change;
    struct edge_error found;
    vertex_look_round(c, t, w, &other);
    if (other.reaches_out)
        return TRIAL_ELSEWHERE;
    if (!topology_allows(c, v, &edges->look.ring, i, &other.ring))
        return TRIAL_DEAR;
    prepare_change(c, v, edges, i, &other, &change);
    /* edges of 1e37 overflow */
    if (!isfinite(change.to[0][0] + change.to[0][1] + change.to[0][2]) ||
        !edge_shape_allows(c, &change))
        return TRIAL_DEAR;
    const double usual = usual_error(c), bound = fmin(usual, c->error_bound);
    const bool guessed = c->options.roughly && !at_border(c, &change) && !is_far(&change);
    if (guessed)
        edge_guess_error(c, &change, &found);
    else
        edge_find_error(c, &change, fmin(c->typical_error, bound), bound, &found);
    const double error = judge_error(c, t, &change, bound, &found);
    if (error > c->error_bound ||
        (c->error_bound < INFINITY && !edge_keeps_witnesses(c, &change, c->error_bound))) {
        t->held_back = true;
        return TRIAL_DEAR;
    }
    const double dearer = variant_of(c)->waits ? error_price(error, usual) : 1;
    if (dearer > 1 && (double)edges->costs[i] * dearer > (double)threshold) {
        t->refused_count++;
        edges->costs[i] *= (float)dearer;
        return TRIAL_DEAR;
    }
    const uint32_t kept = choose_kept(c, &change), gone = kept == v ? w : v;
    move_vertex(c, &change, kept);
    t->taken += topology_collapse(c, v, &edges->look.ring, i, &other.ring, gone);
    edge_update_fans(c, &change, kept);
    witness_set(c, kept, found.witness);
    offset_set(c, kept, found.offset);
    t->error_sum += guessed ? 0 : error;
    t->error_count += !guessed;
    reference_merge(c, kept, gone);
    c->keys[gone] = INFINITY;
    renew_keys(c, &change, kept, threshold);
    return TRIAL_DONE;
}

/* Looks at v and collapses its cheapest edge that may be, if it costs no more than the threshold.
 * A vertex whose ring reaches out of the territory keeps its key. */
static void work_on(struct collapse *c, struct territory *t, uint32_t v, float threshold)
{
    struct vertex_edges edges;
    vertex_evaluate(c, t, v, &edges);
    while (!edges.look.reaches_out) {
        const uint32_t best = edges.cheapest;
        const float cost = edges.least;
        c->keys[v] = cost;
        if (!(cost <= threshold) || !(cost < INFINITY) ||
            try_edge(c, t, v, &edges, best, threshold) != TRIAL_DEAR)
            return;
        raise_cost(&edges, best, edges.costs[best] > cost ? edges.costs[best] : INFINITY);
    }
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
            work_on(c, t, v, threshold);
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
