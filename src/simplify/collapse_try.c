/*
 * A vertex at its turn: its cheapest edge is collapsed, if nothing speaks against it.
 *
 * Its edges are evaluated afresh. The cheapest is tried: whether the topology allows it, whether
 * faces stay sound, and whether the error is no larger than what is usual; else it becomes dearer,
 * and the next one may be the cheapest. Only what lies in the vertex's territory is looked at or
 * changed.
 */
#include <math.h>
#include <string.h>

#include "base/bytes.h"
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
/* Errors below, in mean edges, are rounding. */
static const double ERROR_LEAST = 1e-3;
/* Of the first sweep, mean edges: where nothing is thinned before, a mesh has far more faces than
 * its level, and tips of borders must not go by its edges. */
static const double USUAL_FIRST = 0.12;
/* Estimated errors that the reference is asked about, as parts of what is usual: below they are
 * harmless, above there is no hope. What it refuses counts as so many times what is usual. */
static const double HARMLESS = 0.7;
static const double HOPELESS = 2;
static const double REFUSED = 1.25;

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

/* ---- what moves ---- */

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

void vertex_work_on(struct collapse *c, struct territory *t, uint32_t v, float threshold)
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
