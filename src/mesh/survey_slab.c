/*
 * A slab's worker walks the fans of its vertices as far as they lie in the slab, unites its faces
 * to components, and follows its borders.
 *
 * To unite the faces first, over all their edges, is a sweep of its own (components.c). But the
 * walks pass each face three times and each edge twice, at hand for nothing: a face that is in no
 * component comes into that of the face which the walk began at, and where a walk meets another
 * component the two are joined. Walks begin in face order, so a component's first face is its
 * lowest. That leaves out which side faces show. Nearly always all of a slab's faces agree; where
 * a walk passes two that don't, the slab is surveyed again with components found beforehand.
 *
 * But where the matching has found a slab plain (slab_match.h), all fans but those at shared
 * vertices are known to be single, and to walk round them would cost more than all the rest. There
 * components are found by vertices (survey_plain.h), and only those fans are walked.
 */
#include "mesh/survey_slab.h"

#include <string.h>

#include "base/forest.h"
#include "base/memory.h"
#include "mesh/survey_plain.h"

/* Room for one more element of a vector. */
static inline enum status make_room(struct context *ctx, void *list, size_t count, size_t *capacity,
                                    size_t size)
{
    if (count < *capacity)
        return STATUS_OK;
    return memory_reserve(ctx, list, capacity, count + 256, size);
}

/* ---- fans of a slab ---- */

/* Hands on that the fan `rim` at vertex v leaves the slab over edge `leave` of f. */
static enum status add_half_link(const struct draft *draft, const struct surveyor *s,
                                 struct part *part, uint32_t v, uint32_t f, unsigned leave)
{
    uint32_t over = draft->neighbours[3 * (size_t)f + leave];
    enum status status = make_room(draft->ctx, &part->links, part->link_count, &part->link_capacity,
                                   sizeof *part->links);
    if (status != STATUS_OK)
        return status;
    uint32_t from = draft->faces[3 * (size_t)f + leave];
    uint32_t to = draft->faces[3 * (size_t)f + next3(leave)];
    const uint32_t i = f - s->scope->face_first;
    uint64_t code = f < over ? code_of(f, leave) : code_of(over, mate_of(draft->mates, f, leave));
    const uint32_t runs = (uint32_t)(from < to) ^ (s->is_labelled ? s->components.label[i] & 1 : 0);
    const bool is_higher = v == (from > to ? from : to);
    part->links[part->link_count++] = (struct half_link){
        .key = code << 2 | (is_higher ? LINK_AT_HIGHER : 0) | (runs ? LINK_RUNS : 0),
        .fan = (uint32_t)(part->rim_count - 1),
        .component = s->marks[i] >> CORNER_BITS, /* until they are settled */
    };
    return STATUS_OK;
}

/* A walk that began in `component` ends at edge `leave` of f, which starts at the walk's vertex. */
static void note_end(const struct draft *draft, struct surveyor *s, uint32_t component, uint32_t f,
                     unsigned leave)
{
    struct component *c = &s->components.list[component];
    if (draft->neighbours[3 * (size_t)f + leave] == NO_INDEX)
        c->borders++;
    else
        c->open_id = 0;
}

/* Marks the corners of the fan that corner k of face f lies in, as far as it is in the slab; the
 * open ends are given as the face and the edge that it ends with. False: it is closed. */
static bool walk_fan(const struct draft *draft, struct surveyor *s, uint32_t f, unsigned k,
                     uint32_t end_face[2], unsigned end_edge[2])
{
    const uint32_t first = s->scope->face_first, count = s->scope->face_count;
    const uint32_t v = draft->faces[3 * (size_t)f + k];
    const uint32_t component = s->marks[f - first] >> CORNER_BITS;
    bool turned = false, is_closed = false;
    uint32_t faces = 0; /* that were in no component */
    s->marks[f - first] |= 1u << k;
    for (unsigned side = 0; side < 2 && !is_closed; side++) {
        uint32_t at = f;
        unsigned corner = k, leave = side == 0 ? k : previous3(k);
        while (fan_step(draft, first, count, v, &at, &corner, &leave)) {
            turned |= (leave == corner) == side;
            if (at == f) {
                is_closed = true;
                break;
            }
            /* No branch on what is new, for that can't be guessed. */
            const uint32_t mark = s->marks[at - first], other = mark >> CORNER_BITS;
            s->marks[at - first] = (mark & 7) | component << CORNER_BITS | 1u << corner;
            faces += other == NO_COMPONENT;
            if ((other != component) & (other != NO_COMPONENT))
                forest_join(s->joined, component, other);
        }
        end_face[side] = at;
        end_edge[side] = leave;
    }
    s->is_turned |= turned;
    s->components.list[component].faces += faces;
    if (!is_closed && s->finds_components)
        note_end(draft, s, component, end_face[0], end_edge[0]);
    return !is_closed;
}

/* A fan at a vertex that other slabs use too. */
static enum status add_rim_fan(const struct draft *draft, struct surveyor *s, struct part *part,
                               uint32_t v, uint32_t f, unsigned k)
{
    enum status status = make_room(draft->ctx, &part->rims, part->rim_count, &part->rim_capacity,
                                   sizeof *part->rims);
    if (status != STATUS_OK)
        return status;
    part->rims[part->rim_count++] = (struct rim_fan){v, f, k, 0};
    uint32_t end_face[2];
    unsigned end_edge[2];
    if (!walk_fan(draft, s, f, k, end_face, end_edge))
        return STATUS_OK;
    for (int side = 0; side < 2 && status == STATUS_OK; side++) {
        if (draft->neighbours[3 * (size_t)end_face[side] + end_edge[side]] != NO_INDEX)
            status = add_half_link(draft, s, part, v, end_face[side], end_edge[side]);
    }
    return status;
}

static enum status add_extra_fan(const struct draft *draft, struct part *part, uint32_t v,
                                 uint32_t f, unsigned k)
{
    enum status status = make_room(draft->ctx, &part->fans, part->fan_count, &part->fan_capacity,
                                   sizeof *part->fans);
    if (status == STATUS_OK)
        part->fans[part->fan_count++] = (struct fan_record){v, f, k};
    return status;
}

/* Corner k of the slab's face i, which no walk has passed. */
static enum status add_fan(const struct draft *draft, struct surveyor *s, struct part *part,
                           uint32_t i, unsigned k)
{
    const uint32_t f = s->scope->face_first + i, v = draft->faces[3 * (size_t)f + k];
    const uint32_t own = v - s->scope->vertex_first;
    const bool shared = is_shared(draft, v);
    const bool is_first = own < s->scope->own_count && !s->seen[own];
    uint32_t end_face[2];
    unsigned end_edge[2];
    if (is_first) {
        s->seen[own] = 1;
        s->components.list[s->marks[i] >> CORNER_BITS].vertices++;
        part->shared_vertices += shared;
    }
    if (shared)
        return add_rim_fan(draft, s, part, v, f, k);
    (void)walk_fan(draft, s, f, k, end_face, end_edge);
    return is_first ? STATUS_OK : add_extra_fan(draft, part, v, f, k);
}

static enum status find_fans(const struct draft *draft, struct surveyor *s, struct part *part)
{
    part->fan_count = part->rim_count = part->link_count = 0;
    part->shared_vertices = 0;
    s->is_turned = false;
    if (s->scope->own_count)
        memset(s->seen, 0, s->scope->own_count);
    enum status status = STATUS_OK;
    for (uint32_t i = 0; i < s->scope->face_count && status == STATUS_OK; i++) {
        unsigned left = ~s->marks[i] & 7; /* walks from a face do not pass its other corners */
        if (s->marks[i] >> CORNER_BITS == NO_COMPONENT)
            status = surveyor_begin_component(s, i);
        for (; left && status == STATUS_OK; left &= left - 1)
            status = add_fan(draft, s, part, i, (unsigned)__builtin_ctz(left));
    }
    return status;
}

/* ---- components of a slab ---- */

/* Joined ones become one in the list, which stays in the order of their lowest faces. */
static void settle_components(struct surveyor *s, struct part *part)
{
    struct components *components = &s->components;
    uint32_t count = 0;
    for (uint32_t i = 0; i < components->count; i++) {
        const struct component *from = &components->list[i];
        if (s->joined[i] == i) {
            s->joined[i] = count;
            components->list[count++] = *from;
            continue;
        }
        s->joined[i] = s->joined[s->joined[i]]; /* a place already: */
        struct component *to = &components->list[s->joined[i]];
        to->faces += from->faces;
        to->vertices += from->vertices;
        to->borders += from->borders;
        to->open_id = to->open_id < from->open_id ? to->open_id : from->open_id;
    }
    components->count = count;
    components_number_open(components);
    for (size_t i = 0; i < part->link_count; i++) {
        uint32_t *component = &part->links[i].component;
        *component = components->list[s->joined[*component]].open_id;
    }
}

/* All zero before the first use. */
static enum status reserve(struct context *ctx, struct surveyor *s)
{
    s->components.ctx = ctx;
    enum status status =
        memory_reserve(ctx, &s->marks, &s->mark_capacity, s->scope->face_count, sizeof *s->marks);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &s->seen, &s->seen_capacity, s->scope->own_count, 1);
    return status;
}

/* Where faces do not agree: components first. */
static enum status find_fans_in_labels(const struct draft *draft, struct surveyor *s,
                                       struct part *part)
{
    s->is_labelled = true;
    s->finds_components = false;
    enum status status = components_find(draft, s->scope, &s->components);
    if (status == STATUS_OK)
        status = memory_reserve(draft->ctx, &s->joined, &s->joined_capacity, s->components.count,
                                sizeof *s->joined);
    if (status != STATUS_OK)
        return status;
    for (uint32_t i = 0; i < s->components.count; i++)
        s->joined[i] = i;
    for (uint32_t i = 0; i < s->scope->face_count; i++)
        s->marks[i] = s->components.label[i] >> 1 << CORNER_BITS;
    return find_fans(draft, s, part);
}

/* ---- a plain slab ---- */

/* The fans at shared vertices, in the order of their first corners. */
static enum status walk_shared(const struct draft *draft, struct surveyor *s, struct part *part)
{
    enum status status = STATUS_OK;
    for (uint32_t at = 0; at < s->rim_face_count && status == STATUS_OK; at++) {
        const uint32_t i = s->rim_faces[at], f = s->scope->face_first + i;
        const uint32_t *face = draft->faces + 3 * (size_t)f;
        for (unsigned k = 0; k < 3 && status == STATUS_OK; k++)
            if (is_shared(draft, face[k]) && !(s->marks[i] >> k & 1))
                status = add_rim_fan(draft, s, part, face[k], f, k);
    }
    return status;
}

static enum status walk_rims(const struct draft *draft, struct surveyor *s, struct part *part)
{
    s->finds_components = false;
    part->fan_count = part->rim_count = part->link_count = 0;
    enum status status = plain_components(draft, s);
    part->shared_vertices = s->shared_own;
    if (status == STATUS_OK)
        status = walk_shared(draft, s, part);
    if (status == STATUS_OK)
        settle_components(s, part);
    return status;
}

/* ---- all ---- */

/* Fans and components. */
static enum status walk_all(const struct draft *draft, struct surveyor *s, struct part *part)
{
    enum status status = reserve(draft->ctx, s);
    if (status != STATUS_OK)
        return status;
    s->is_labelled = false;
    s->components.count = 0;
    if (draft->is_plain && draft->is_plain[s->scope->face_first >> draft->slab_shift])
        return walk_rims(draft, s, part);
    for (uint32_t i = 0; i < s->scope->face_count; i++)
        s->marks[i] = NO_COMPONENT << CORNER_BITS;
    s->finds_components = true;
    status = find_fans(draft, s, part);
    if (status == STATUS_OK && s->is_turned)
        status = find_fans_in_labels(draft, s, part);
    if (status == STATUS_OK)
        settle_components(s, part);
    return status;
}

/* Of the slab's face i, once they are settled. */
static uint32_t component_of(const struct surveyor *s, uint32_t i)
{
    return s->joined[s->marks[i] >> CORNER_BITS];
}

/* ---- borders of a slab ---- */

static enum status collect_borders(const struct draft *draft, struct surveyor *s, size_t count)
{
    const struct slab_scope *scope = s->scope;
    const uint32_t locals = scope_local_count(scope);
    enum status status =
        memory_reserve(draft->ctx, &s->borders, &s->border_capacity, count, sizeof *s->borders);
    if (status == STATUS_OK)
        status = memory_reserve(draft->ctx, &s->leaving, &s->leaving_capacity, locals,
                                sizeof *s->leaving);
    if (status == STATUS_OK)
        status = memory_reserve(draft->ctx, &s->is_entered, &s->entered_capacity, locals, 1);
    if (status != STATUS_OK)
        return status;
    memset(s->leaving, 0xff, (size_t)locals * sizeof *s->leaving);
    memset(s->is_entered, 0, locals);
    uint32_t found = 0;
    for (uint32_t i = 0; i < scope->face_count; i++) {
        const size_t f = (size_t)scope->face_first + i;
        for (unsigned k = 0; k < 3; k++) {
            if (draft->neighbours[3 * f + k] != NO_INDEX)
                continue;
            uint32_t from = scope_local(scope, draft->faces[3 * f + k]);
            uint32_t to = scope_local(scope, draft->faces[3 * f + next3(k)]);
            s->borders[found] = (struct border_edge){from, to, component_of(s, i), false};
            s->leaving[from] = found++;
            s->is_entered[to] = 1;
        }
    }
    return STATUS_OK;
}

static uint32_t global_vertex(const struct slab_scope *scope, uint32_t local)
{
    return local < scope->own_count ? scope->vertex_first + local
                                    : scope->foreign[local - scope->own_count];
}

/* Where the borders are not those of a manifold the counts mean nothing, but it ends. */
static enum status find_loops(const struct draft *draft, struct surveyor *s, struct part *part)
{
    size_t count = 0;
    for (uint32_t c = 0; c < s->components.count; c++)
        count += s->components.list[c].borders;
    part->borders = count;
    if (count == 0)
        return STATUS_OK;
    enum status status = collect_borders(draft, s, count);
    if (status != STATUS_OK)
        return status;
    struct border_edge *borders = s->borders;
    for (size_t i = 0; i < count; i++) { /* pieces that begin in another slab's border */
        if (s->is_entered[borders[i].from] || borders[i].is_used)
            continue;
        uint32_t at = (uint32_t)i, last = at;
        while (at != NO_INDEX && !borders[at].is_used) {
            borders[at].is_used = true;
            last = at;
            at = s->leaving[borders[at].to];
        }
        uint32_t open_id = s->components.list[borders[i].component].open_id;
        if (open_id == NO_INDEX)
            continue;
        status = make_room(draft->ctx, &part->paths, part->path_count, &part->path_capacity,
                           sizeof *part->paths);
        if (status != STATUS_OK)
            return status;
        part->paths[part->path_count++] =
            (struct border_path){global_vertex(s->scope, borders[i].from),
                                 global_vertex(s->scope, borders[last].to), open_id};
    }
    for (size_t i = 0; i < count; i++) {
        if (borders[i].is_used)
            continue;
        for (uint32_t at = (uint32_t)i; at != NO_INDEX && !borders[at].is_used;
             at = s->leaving[borders[at].to])
            borders[at].is_used = true;
        s->components.list[borders[i].component].loops++;
    }
    return STATUS_OK;
}

/* ---- the whole ---- */

static enum status hand_on_components(const struct draft *draft, const struct surveyor *s,
                                      struct part *part)
{
    for (uint32_t i = 0; i < s->components.count; i++) {
        const struct component *c = &s->components.list[i];
        part->is_turned = part->is_turned || c->turned || c->is_twisted;
        if (c->open_id == NO_INDEX) {
            part->components++;
            part->loops += c->loops;
            part->floor += component_floor(c->vertices, c->faces, c->borders, c->loops);
            continue;
        }
        enum status status = make_room(draft->ctx, &part->open, part->open_count,
                                       &part->open_capacity, sizeof *part->open);
        if (status != STATUS_OK)
            return status;
        part->open[part->open_count++] =
            (struct open_component){.lowest_face = s->scope->face_first + c->lowest,
                                    .is_twisted = c->is_twisted,
                                    .faces = c->faces,
                                    .turned = c->turned,
                                    .vertices = c->vertices,
                                    .borders = c->borders,
                                    .loops = c->loops};
    }
    return STATUS_OK;
}

enum status survey_slab(const struct draft *draft, const struct slab_scope *scope,
                        struct surveyor *s, struct part *part)
{
    s->scope = scope;
    part->open_count = part->path_count = 0;
    part->borders = part->loops = part->components = part->floor = 0;
    part->is_turned = false;
    enum status status = walk_all(draft, s, part);
    if (status == STATUS_OK)
        status = find_loops(draft, s, part);
    if (status == STATUS_OK)
        status = hand_on_components(draft, s, part);
    return status;
}

void surveyor_clear(struct context *ctx, struct surveyor *s)
{
    components_clear(&s->components);
    memory_release(ctx, &s->marks, s->mark_capacity, sizeof *s->marks);
    memory_release(ctx, &s->said, s->said_capacity, sizeof *s->said);
    memory_release(ctx, &s->rim_faces, s->rim_face_capacity, sizeof *s->rim_faces);
    memory_release(ctx, &s->joined, s->joined_capacity, sizeof *s->joined);
    memory_release(ctx, &s->seen, s->seen_capacity, 1);
    memory_release(ctx, &s->borders, s->border_capacity, sizeof *s->borders);
    memory_release(ctx, &s->leaving, s->leaving_capacity, sizeof *s->leaving);
    memory_release(ctx, &s->is_entered, s->entered_capacity, 1);
}

void part_clear(struct context *ctx, struct part *part)
{
    memory_release(ctx, &part->fans, part->fan_capacity, sizeof *part->fans);
    memory_release(ctx, &part->rims, part->rim_capacity, sizeof *part->rims);
    memory_release(ctx, &part->links, part->link_capacity, sizeof *part->links);
    memory_release(ctx, &part->open, part->open_capacity, sizeof *part->open);
    memory_release(ctx, &part->paths, part->path_capacity, sizeof *part->paths);
}
