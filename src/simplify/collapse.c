/*
 * Simplifying a mesh by collapsing its edges, the cheap ones first.
 *
 * The plain method keeps a heap of all edges and, after each collapse, brings every cost up to date
 * that could have changed, thirty or forty of them. Two things make it slow: most of those costs
 * change again before anyone asks, and the heap's order jumps all over the mesh, so that each look
 * is a cache miss. Here the vertices are swept in the order of their numbers (which is local in
 * space), again and again, with a threshold that lets the cheapest few per cent through; whatever
 * is below it is evaluated afresh before it is believed. Measured against the exact order of a
 * heap, the errors differ by less than the heap's own change when the costs are multiplied by
 * noise.
 */
#include "collapse.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "collapse_internal.h"

static const double BORDER_WEIGHT = 1;
/* What effort changes. Measured on bunny, koala, dragon and a noisy scan against sweeps of 2 to 10
 * % of the vertices that make each cost anew as soon as it may have changed: mean and RMS error
 * within 1 %, a third to a quarter of the costs worked out. */
static const struct pace {
    double part; /* of the vertices that one sweep lets through */
    float wait;  /* a vertex just moved is looked at again at so many times the threshold: its edges
                    are seldom cheaper */
} PACES[] = {{0.7, 3}, {0.4, 3}, {0.3, 2}};
/* A new vertex may be this part of the typical error away from the faces it replaces. */
static const double OVERSHOOT = 0.4;

/* ---- beginning and end ---- */

void collapse_end(struct collapse **collapse)
{
    struct collapse *c = *collapse;
    if (!c)
        return;
    struct context *ctx = c->ctx;
    const size_t vertices = (size_t)c->vertex_count, faces = (size_t)c->face_count;
    memory_release(ctx, &c->records, vertices, c->attributes.stride);
    memory_release(ctx, &c->keys, vertices, sizeof *c->keys);
    memory_release(ctx, &c->vertices, vertices, sizeof *c->vertices);
    memory_release(ctx, &c->corners, faces, 3 * sizeof *c->corners);
    memory_release(ctx, collapse, 1, sizeof *c);
}

/* The power of two that makes the mean edge of a surface of that size about 1: half the box over
 * the root of the faces. */
static double choose_scale(uint64_t face_count, const double low[3], const double high[3])
{
    double extent = 0;
    for (int k = 0; k < 3; k++)
        extent += high[k] - low[k] > 0 ? high[k] - low[k] : 0;
    int exponent = 0;
    const double edge = extent / (2 * sqrt((double)face_count + 1));
    if (edge > 0 && edge < INFINITY)
        (void)frexp(edge, &exponent);
    return ldexp(1, -exponent);
}

static void widen_box(double low[3], double high[3], size_t i, double x)
{
    const size_t k = i % 3;
    low[k] = x < low[k] ? x : low[k];
    high[k] = x > high[k] ? x : high[k];
}

/* Origin and scale. Positions are kept as float32: as they are when all are float32, else relative
 * to the middle of the bounding box. Exactly one of `doubles` and `floats` is given. */
static void choose_frame(struct collapse *c, const double *doubles, const float *floats)
{
    const size_t count = (size_t)c->vertex_count * 3;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    c->is_float32 = true;
    for (size_t i = 0; i < count; i++) {
        const double x = doubles ? doubles[i] : (double)floats[i];
        if ((double)(float)x != x)
            c->is_float32 = false;
        widen_box(low, high, i, x);
    }
    for (int k = 0; k < 3; k++)
        c->origin[k] = c->is_float32 ? 0 : low[k] + (high[k] - low[k]) / 2;
    c->scale = choose_scale(c->face_count, low, high);
    for (size_t i = 0; i < count && c->is_float32; i++) {
        const double scaled = (doubles ? doubles[i] : (double)floats[i]) * c->scale;
        if ((double)(float)scaled != scaled)
            c->scale = 1; /* would lose bits of a tiny number: rather be exact */
    }
}

/* The cost of v's cheapest edge, INFINITY when it has none. */
static float cheapest(const struct vertex_edges *edges, uint32_t *best)
{
    float least = INFINITY;
    *best = 0;
    for (uint32_t i = 0; i < edges->look.ring.count; i++)
        if (edges->costs[i] < least) {
            least = edges->costs[i];
            *best = i;
        }
    return least;
}

/* Makes keys anew: of every SAMPLE_STEP-th vertex, for choosing a threshold by; the others are 0,
 * so that the next sweep looks at them. (Few vertices are all looked at.) */
static void sample_keys(struct collapse *c)
{
    enum { SAMPLE_STEP = 8, FEW = 4096 };
    struct vertex_edges edges;
    uint32_t best;
    c->key_step = c->vertex_slots > FEW ? SAMPLE_STEP : 1;
    for (uint32_t v = 0; v < c->vertex_slots; v++) {
        c->keys[v] = c->vertices[v].corner == NO_INDEX ? INFINITY : 0;
        if (v % c->key_step != 0 || c->vertices[v].corner == NO_INDEX)
            continue;
        vertex_evaluate(c, v, &edges);
        c->keys[v] = cheapest(&edges, &best);
    }
}

static enum status start(struct context *ctx, const struct collapse_options *options,
                         uint64_t vertex_count, uint64_t face_count,
                         const struct attributes *attributes, struct collapse **out)
{
    *out = NULL;
    if (face_count > (UINT32_MAX - 2) / 3 || vertex_count > UINT32_MAX - 2)
        return fail(ctx, STATUS_INTERNAL, "edge collapse of %llu faces is beyond 32-bit corners",
                    (unsigned long long)face_count);
    enum status status = memory_take_zeroed(ctx, 1, sizeof **out, out);
    if (status != STATUS_OK)
        return status;
    struct collapse *c = *out;
    c->ctx = ctx;
    c->level = cpu_level(ctx);
    c->options = *options;
    if (!(c->options.border_weight > 0))
        c->options.border_weight = BORDER_WEIGHT;
    c->vertex_count = c->vertex_slots = vertex_count;
    c->face_count = c->face_slots = c->live_faces = face_count;
    if (attributes)
        c->attributes = *attributes;
    return STATUS_OK;
}

static enum status take_faces(struct collapse *c, const uint32_t *faces)
{
    enum status status =
        memory_take(c->ctx, (size_t)c->face_count, 3 * sizeof *c->corners, &c->corners);
    for (size_t i = 0; status == STATUS_OK && i < (size_t)c->face_count * 3; i++)
        c->corners[i].end = faces[corner_next((uint32_t)i)];
    return status;
}

static enum status take_vertices(struct collapse *c, const double *doubles, const float *floats,
                                 const unsigned char *locked, const float *errors)
{
    const size_t count = (size_t)c->vertex_count;
    enum status status = memory_take(c->ctx, count, sizeof *c->vertices, &c->vertices);
    if (status != STATUS_OK)
        return status;
    choose_frame(c, doubles, floats);
    for (uint32_t v = 0; v < count; v++) {
        struct collapse_vertex *vertex = &c->vertices[v];
        for (size_t k = 0; k < 3; k++) {
            const double x =
                doubles ? doubles[3 * (size_t)v + k] : (double)floats[3 * (size_t)v + k];
            vertex->position[k] = (float)((x - c->origin[k]) * c->scale);
        }
        vertex->source = v;
        vertex->error = errors ? (float)((double)errors[v] * c->scale) : 0;
        if ((double)vertex->error > c->largest_error)
            c->largest_error = (double)vertex->error;
        vertex->flags = locked && locked[v] ? VERTEX_LOCKED : 0;
    }
    return STATUS_OK;
}

/* Adjacency, fans and keys. */
static enum status make_ready(struct collapse *c)
{
    enum status status = topology_build(c);
    if (status == STATUS_OK)
        status = memory_take(c->ctx, (size_t)c->vertex_count, sizeof *c->keys, &c->keys);
    if (status != STATUS_OK)
        return status;
    fans_build(c);
    sample_keys(c);
    return STATUS_OK;
}

enum status collapse_begin(struct context *ctx, const struct collapse_options *options,
                           uint64_t vertex_count, uint64_t face_count, const double *positions,
                           const uint32_t *faces, const struct attributes *attributes,
                           const unsigned char *records, const unsigned char *locked,
                           const float *base_error, struct collapse **out)
{
    const struct attributes *kept = attributes && records ? attributes : NULL;
    enum status status = start(ctx, options, vertex_count, face_count, kept, out);
    if (status == STATUS_OK)
        status = take_faces(*out, faces);
    if (status == STATUS_OK)
        status = take_vertices(*out, positions, NULL, locked, base_error);
    if (status == STATUS_OK && kept) {
        const size_t stride = kept->stride;
        status = memory_take(ctx, (size_t)vertex_count, stride, &(*out)->records);
        if (status == STATUS_OK)
            memcpy((*out)->records, records, (size_t)vertex_count * stride);
    }
    if (status == STATUS_OK)
        status = make_ready(*out);
    if (status != STATUS_OK)
        collapse_end(out);
    return status;
}

enum status collapse_begin_giving(struct context *ctx, const struct collapse_options *options,
                                  struct collapse_mesh *mesh, const struct attributes *attributes,
                                  struct collapse **out)
{
    const struct attributes *kept = attributes && mesh->records ? attributes : NULL;
    const uint32_t stride = attributes ? attributes->stride : 0;
    const size_t vertices = (size_t)mesh->vertex_count;
    enum status status = start(ctx, options, mesh->vertex_count, mesh->face_count, kept, out);
    if (status == STATUS_OK)
        status = take_faces(*out, mesh->faces);
    memory_release(ctx, &mesh->faces, (size_t)mesh->face_count, 3 * sizeof *mesh->faces);
    if (status == STATUS_OK)
        status = take_vertices(*out, NULL, mesh->positions, mesh->locked, mesh->errors);
    if (status == STATUS_OK) {
        (*out)->records = mesh->records;
        mesh->records = NULL;
    }
    memory_release(ctx, &mesh->positions, vertices, 3 * sizeof *mesh->positions);
    memory_release(ctx, &mesh->errors, vertices, sizeof *mesh->errors);
    if (status == STATUS_OK)
        status = make_ready(*out);
    collapse_mesh_clear(ctx, stride, mesh);
    if (status != STATUS_OK)
        collapse_end(out);
    return status;
}

void collapse_mesh_clear(struct context *ctx, uint32_t stride, struct collapse_mesh *mesh)
{
    const size_t vertices = (size_t)mesh->vertex_count;
    memory_release(ctx, &mesh->positions, vertices, 3 * sizeof *mesh->positions);
    memory_release(ctx, &mesh->faces, (size_t)mesh->face_count, 3 * sizeof *mesh->faces);
    memory_release(ctx, &mesh->errors, vertices, sizeof *mesh->errors);
    memory_release(ctx, &mesh->locked, vertices, 1);
    memory_release(ctx, &mesh->records, vertices, stride);
    memset(mesh, 0, sizeof *mesh);
}

/* ---- one collapse ---- */

static const struct pace *pace_of(const struct collapse *c)
{
    return &PACES[c->options.effort >= 3 ? 2 : c->options.effort == 2 ? 1 : 0];
}

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
 * What a cost is multiplied by because the new vertex would stick out. Volumes say little about
 * thin tips, so that a memoryless cost lets single vertices go far astray: where one would be
 * further from the surface than OVERSHOOT of the present typical error, its edge waits for the
 * typical error to grow. The largest distance falls by a quarter to a half for 1 to 2 % of the mean
 * (koala, elephant and bunny at 1 and 2 %).
 */
static double overshoot_price(const struct collapse *c, const struct edge_change *change)
{
    const double usual = OVERSHOOT * c->typical_error;
    const double overshoot = usual > 0 ? edge_overshoot(change, usual) : 0;
    if (overshoot <= usual)
        return 1;
    return overshoot / usual * (overshoot / usual);
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

/* Tries edge i of v; false when a guard forbids it (its cost is as it was) or when it turned out
 * dearer than the threshold (its cost says so now). */
static bool try_edge(struct collapse *c, uint32_t v, struct vertex_edges *edges, uint32_t i,
                     float threshold)
{
    const uint32_t w = edges->look.ring.vertices[i];
    struct vertex_look other;
    struct edge_change change;
    double deviation;
    vertex_look_round(c, w, &other);
    if (!topology_allows(c, v, &edges->look.ring, i, &other.ring))
        return false;
    prepare_change(c, v, edges, i, &other, &change);
    if (!edge_shape_allows(c, &change, &deviation))
        return false;
    const float before =
        c->vertices[v].error > c->vertices[w].error ? c->vertices[v].error : c->vertices[w].error;
    const double error = (double)before + deviation;
    if (error > c->error_bound) {
        c->held_back = true;
        return false;
    }
    const double dearer = overshoot_price(c, &change);
    if (dearer > 1 && (double)edges->costs[i] * dearer > (double)threshold) {
        edges->costs[i] *= (float)dearer;
        return false;
    }
    c->error_sum += error;
    c->error_count++;
    const uint32_t kept = choose_kept(c, &change), gone = kept == v ? w : v;
    move_vertex(c, &change, kept);
    c->live_faces -= topology_collapse(c, v, &edges->look.ring, i, &other.ring, gone);
    edge_update_fans(c, &change, kept);
    c->vertices[kept].error = (float)error;
    if (error > c->largest_error)
        c->largest_error = error;
    c->keys[gone] = INFINITY;
    renew_keys(c, &change, kept, threshold);
    return true;
}

/* Looks at v and collapses its cheapest edge that may be, if it costs no more than the threshold.
 */
static void work_on(struct collapse *c, uint32_t v, float threshold)
{
    struct vertex_edges edges;
    uint32_t best;
    vertex_evaluate(c, v, &edges);
    for (;;) {
        const float cost = cheapest(&edges, &best);
        c->keys[v] = cost;
        if (!(cost <= threshold) || !(cost < INFINITY) || try_edge(c, v, &edges, best, threshold))
            return;
        if (!(edges.costs[best] > cost))
            edges.costs[best] = INFINITY;
    }
}

/* The threshold of the next sweep: the cost below which `wanted` of the vertices' keys lie, to
 * three bits of mantissa; INFINITY when no vertex has a key. */
static float choose_threshold(const struct collapse *c, uint64_t wanted)
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
 * Works on all vertices whose key is not above the threshold, in the order of their numbers. Most
 * of the time would go by waiting for memory, step by step round each vertex; so the next vertices
 * are found in advance, and before each is worked on the rings of those behind it are followed by
 * one step each.
 */
static void sweep(struct collapse *c, float threshold, uint64_t most_faces)
{
    enum { AHEAD = 8 };
    struct expected queue[AHEAD];
    uint32_t next = 0, taken = 0, put = 0;
    while (c->live_faces > most_faces) {
        for (uint32_t i = taken; i != put; i++)
            ask_for_ring(c, &queue[i % AHEAD]);
        for (; put - taken < AHEAD && next < c->vertex_slots; next++)
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
            work_on(c, v, threshold);
    }
}

enum status collapse_run(struct collapse *c, uint64_t most_faces, double most_error)
{
    const double part = pace_of(c)->part;
    most_error *= c->scale;
    if (c->held_back && most_error > c->error_bound) {
        c->held_back = false;
        sample_keys(c);
    }
    c->error_bound = most_error;
    while (c->live_faces > most_faces) {
        const uint64_t left = c->live_faces - most_faces;
        uint64_t wanted = (uint64_t)((double)c->live_faces / 2 * part);
        wanted = wanted < left / 2 ? wanted : left / 2;
        float threshold = choose_threshold(c, wanted);
        if (!(threshold < INFINITY) && c->key_step > 1)
            threshold = FLT_MIN; /* those that were not looked at may have one */
        if (!(threshold < INFINITY)) {
            if (c->held_back || c->options.keep_guards || c->guard == GUARD_NONE)
                break;
            c->guard++;
            sample_keys(c);
            continue;
        }
        if (c->error_count > 0)
            c->typical_error = c->error_sum / (double)c->error_count;
        c->error_sum = 0;
        c->error_count = 0;
        sweep(c, threshold, most_faces);
        c->key_step = 1;
        enum status status = STATUS_OK;
        if (c->live_faces < c->face_slots / 2)
            status = topology_compact(c);
        if (status == STATUS_OK)
            status =
                step(c->ctx, "collapse", c->face_count - c->live_faces, c->face_count - most_faces);
        if (status != STATUS_OK)
            return status;
    }
    return STATUS_OK;
}

uint64_t collapse_faces(const struct collapse *c)
{
    return c->live_faces;
}

double collapse_error(const struct collapse *c)
{
    return c->largest_error / c->scale;
}

bool collapse_exhausted(const struct collapse *c)
{
    for (uint32_t v = 0; v < c->vertex_slots; v++)
        if (c->keys[v] < INFINITY)
            return false;
    return !c->held_back && (c->guard == GUARD_NONE || c->options.keep_guards);
}

/* ---- the result ---- */

/* Live vertices in the order of their first use; *order is theirs, `faces` get the numbers. */
static enum status number_vertices(const struct collapse *c, uint32_t *faces, uint32_t **order,
                                   size_t *live)
{
    const size_t slots = (size_t)c->vertex_slots;
    uint32_t *numbers = NULL, count = 0;
    size_t to = 0;
    *live = 0;
    for (size_t v = 0; v < slots; v++)
        *live += c->vertices[v].corner != NO_INDEX;
    enum status status = memory_take(c->ctx, *live, sizeof **order, order);
    if (status == STATUS_OK)
        status = memory_take(c->ctx, slots, sizeof *numbers, &numbers);
    if (status != STATUS_OK)
        return status;
    memset(numbers, 0xff, slots * sizeof *numbers);
    for (size_t i = 0; i < (size_t)c->face_slots * 3; i++) {
        const uint32_t v = corner_vertex(c, (uint32_t)i);
        if (v == NO_INDEX)
            continue;
        if (numbers[v] == NO_INDEX) {
            numbers[v] = count;
            (*order)[count++] = v;
        }
        faces[to++] = numbers[v];
    }
    memory_release(c->ctx, &numbers, slots, sizeof *numbers);
    return STATUS_OK;
}

/* Copies records, and turns slots into input numbers. */
static void finish_vertices(const struct collapse *c, uint32_t *order, size_t live,
                            unsigned char *records)
{
    const size_t stride = c->attributes.stride;
    for (size_t i = 0; i < live; i++) {
        if (records)
            memcpy(records + i * stride, c->records + order[i] * stride, stride);
        order[i] = c->vertices[order[i]].source;
    }
}

enum status collapse_extract(struct collapse *c, struct mesh *mesh, uint32_t **sources)
{
    struct context *ctx = c->ctx;
    size_t live = 0;
    uint32_t *order = NULL;
    memset(mesh, 0, sizeof *mesh);
    mesh->attributes = c->attributes;
    mesh->is_float32 = c->is_float32;
    mesh->face_count = c->live_faces;
    enum status status =
        memory_take(ctx, (size_t)c->live_faces, 3 * sizeof *mesh->faces, &mesh->faces);
    if (status == STATUS_OK)
        status = number_vertices(c, mesh->faces, &order, &live);
    mesh->vertex_count = live;
    if (status == STATUS_OK)
        status = memory_take(ctx, live, 3 * sizeof *mesh->positions, &mesh->positions);
    if (status == STATUS_OK && c->records)
        status = memory_take(ctx, live, c->attributes.stride, &mesh->records);
    if (status != STATUS_OK) {
        memory_release(ctx, &order, live, sizeof *order);
        mesh_clear(ctx, mesh);
        return status;
    }
    for (size_t i = 0; i < live; i++)
        for (int k = 0; k < 3; k++)
            mesh->positions[3 * i + k] =
                c->origin[k] + (double)c->vertices[order[i]].position[k] / c->scale;
    finish_vertices(c, order, live, mesh->records);
    if (sources)
        *sources = order;
    else
        memory_release(ctx, &order, live, sizeof *order);
    return STATUS_OK;
}

enum status collapse_extract_compact(struct collapse *c, struct collapse_mesh *mesh,
                                     uint32_t **sources)
{
    struct context *ctx = c->ctx;
    size_t live = 0;
    *sources = NULL;
    memset(mesh, 0, sizeof *mesh);
    mesh->face_count = c->live_faces;
    enum status status =
        memory_take(ctx, (size_t)c->live_faces, 3 * sizeof *mesh->faces, &mesh->faces);
    if (status == STATUS_OK)
        status = number_vertices(c, mesh->faces, sources, &live);
    mesh->vertex_count = live;
    if (status == STATUS_OK)
        status = memory_take(ctx, live, 3 * sizeof *mesh->positions, &mesh->positions);
    if (status == STATUS_OK)
        status = memory_take(ctx, live, sizeof *mesh->errors, &mesh->errors);
    if (status == STATUS_OK && c->records)
        status = memory_take(ctx, live, c->attributes.stride, &mesh->records);
    if (status != STATUS_OK) {
        memory_release(ctx, sources, live, sizeof **sources);
        collapse_mesh_clear(ctx, c->attributes.stride, mesh);
        return status;
    }
    for (size_t i = 0; i < live; i++) {
        const struct collapse_vertex *vertex = &c->vertices[(*sources)[i]];
        for (int k = 0; k < 3; k++)
            mesh->positions[3 * i + k] = (float)((double)vertex->position[k] / c->scale);
        mesh->errors[i] = (float)((double)vertex->error / c->scale);
    }
    finish_vertices(c, *sources, live, mesh->records);
    return STATUS_OK;
}
