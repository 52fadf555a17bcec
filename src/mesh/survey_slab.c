/*
 * A slab's worker walks the fans of its vertices as far as they lie in the slab, unites its faces
 * to components, and follows its borders, each a few sweeps over arrays that stay in the cache.
 */
#include "mesh/survey_slab.h"

#include <string.h>

#include "base/memory.h"

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
    uint32_t label = s->components.label[f - s->scope->face_first];
    uint64_t code = f < over ? code_of(f, leave) : code_of(over, mate_of(draft->mates, f, leave));
    part->links[part->link_count++] = (struct half_link){
        .key = code << 1 | (v == (from > to ? from : to)),
        .fan = (uint32_t)(part->rim_count - 1),
        .component = s->components.list[label >> 1].open_id,
        .runs = (uint32_t)(from < to) ^ (label & 1),
    };
    return STATUS_OK;
}

/* Marks the corners of the fan that corner k of face f lies in, as far as it is in the slab; the
 * open ends are given as the face and the edge that it ends with. False: it is closed. */
static bool walk_fan(const struct draft *draft, const struct surveyor *s, uint32_t f, unsigned k,
                     uint32_t end_face[2], unsigned end_edge[2])
{
    const uint32_t first = s->scope->face_first, count = s->scope->face_count;
    const uint32_t v = draft->faces[3 * (size_t)f + k];
    s->visited[f - first] |= (uint8_t)(1u << k);
    for (int side = 0; side < 2; side++) {
        uint32_t at = f;
        unsigned corner = k, leave = side == 0 ? k : previous3(k);
        while (fan_step(draft, first, count, v, &at, &corner, &leave)) {
            if (at == f)
                return false;
            s->visited[at - first] |= (uint8_t)(1u << corner);
        }
        end_face[side] = at;
        end_edge[side] = leave;
    }
    return true;
}

/* A fan at a vertex that other slabs use too. */
static enum status add_rim_fan(const struct draft *draft, const struct surveyor *s,
                               struct part *part, uint32_t v, uint32_t f, unsigned k)
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

static enum status find_fans(const struct draft *draft, struct surveyor *s, struct part *part)
{
    const struct slab_scope *scope = s->scope;
    struct component *list = s->components.list;
    uint32_t end_face[2];
    unsigned end_edge[2];
    memset(s->visited, 0, scope->face_count);
    if (scope->own_count)
        memset(s->seen, 0, scope->own_count);
    for (uint32_t i = 0; i < scope->face_count; i++) {
        const uint32_t f = scope->face_first + i;
        for (unsigned k = 0; k < 3; k++) {
            if (s->visited[i] >> k & 1)
                continue;
            const uint32_t v = draft->faces[3 * (size_t)f + k];
            const uint32_t own = v - scope->vertex_first;
            const bool shared = is_shared(draft, v);
            const bool is_first = own < scope->own_count && !s->seen[own];
            enum status status = STATUS_OK;
            if (is_first) {
                s->seen[own] = 1;
                list[s->components.label[i] >> 1].vertices++;
                part->shared_vertices += shared;
            }
            if (shared) {
                status = add_rim_fan(draft, s, part, v, f, k);
            } else {
                (void)walk_fan(draft, s, f, k, end_face, end_edge);
                if (!is_first)
                    status = add_extra_fan(draft, part, v, f, k);
            }
            if (status != STATUS_OK)
                return status;
        }
    }
    return STATUS_OK;
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
            s->borders[found] = (struct border_edge){from, to, s->components.label[i] >> 1, false};
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

/* ---- components of a slab ---- */

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

/* ---- the whole ---- */

enum status survey_slab(const struct draft *draft, const struct slab_scope *scope,
                        struct surveyor *s, struct part *part)
{
    s->scope = scope;
    part->fan_count = part->rim_count = part->link_count = 0;
    part->open_count = part->path_count = 0;
    part->shared_vertices = part->borders = part->loops = part->components = part->floor = 0;
    part->is_turned = false;
    enum status status = components_find(draft, scope, &s->components);
    if (status == STATUS_OK)
        status =
            memory_reserve(draft->ctx, &s->visited, &s->visited_capacity, scope->face_count, 1);
    if (status == STATUS_OK)
        status = memory_reserve(draft->ctx, &s->seen, &s->seen_capacity, scope->own_count, 1);
    if (status == STATUS_OK)
        status = find_fans(draft, s, part);
    if (status == STATUS_OK)
        status = find_loops(draft, s, part);
    if (status == STATUS_OK)
        status = hand_on_components(draft, s, part);
    return status;
}

void surveyor_clear(struct context *ctx, struct surveyor *s)
{
    components_clear(&s->components);
    memory_release(ctx, &s->visited, s->visited_capacity, 1);
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
