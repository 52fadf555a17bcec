/*
 * Surveying the surface slab by slab.
 *
 * A walk over the whole surface from vertex to vertex is simple and touches memory everywhere. Here
 * a slab's worker walks the fans of its vertices as far as they lie in the slab, unites its faces
 * to components, and follows its borders. What is whole within the slab is settled there. What goes
 * on in another slab is handed on as a few records: for each fan at a shared vertex where it leaves
 * the slab, for each open component, for each piece of a border loop. They are matched by sorting
 * and united outside, in memory in proportion to the seams.
 */
#include "mesh/survey.h"

#include <math.h>
#include <string.h>

#include "base/external_sort.h"
#include "base/memory.h"
#include "base/parallel.h"

/* One end of an edge between two slabs, as one of the two faces sees it. */
struct half_link {
    uint64_t
        key; /* the edge, by its lower face: (face << 2 | edge) << 1 | 1 at the higher vertex */
    uint32_t fan; /* at that end */
    uint32_t component;
    uint32_t runs; /* 1 if a face of parity 0 would run from the lower to the higher vertex */
    uint32_t unused;
};

struct rim_fan { /* a fan of a slab at a shared vertex */
    uint32_t vertex;
    uint32_t face;
    uint32_t corner;
    uint32_t up; /* united with */
};

struct border_path { /* a piece of a border loop from one shared vertex to another */
    uint64_t start;
    uint32_t end;
    uint32_t component;
};

struct border_edge { /* in local vertex numbers */
    uint32_t from, to;
    uint32_t component;
    bool is_used;
};

struct surveyor { /* one a worker */
    struct slab_scope scope;
    struct components components;
    uint8_t *visited; /* a bit a corner, a byte a face */
    size_t visited_capacity;
    uint8_t *seen; /* the own vertices that have had a fan */
    size_t seen_capacity;
    struct border_edge *borders;
    size_t border_capacity;
    uint32_t *leaving; /* local vertex -> border edge that starts there */
    size_t leaving_capacity;
    uint8_t *is_entered; /* local vertex: a border edge ends there */
    size_t entered_capacity;
};

struct part { /* what a slab hands on */
    struct fan_record *fans;
    size_t fan_count, fan_capacity;
    struct rim_fan *rims;
    size_t rim_count, rim_capacity;
    struct half_link *links;
    size_t link_count, link_capacity;
    struct open_component *open;
    size_t open_count, open_capacity;
    struct border_path *paths;
    size_t path_count, path_capacity;
    uint64_t shared_vertices; /* own ones */
    uint64_t borders, loops, components, floor;
    bool is_turned;
};

struct work {
    struct draft *draft;
    struct survey *survey;
    struct surveyor *surveyors;
    struct part *parts;
    unsigned in_flight;
    struct sorter *links;
    struct sorter *paths;
    struct spool rim_spool;
    struct rim_fan *rims;
    uint64_t rim_count;
    uint64_t shared_vertices;
};

/* Room for one more element of a vector. */
static inline enum status make_room(struct context *ctx, void *list, size_t count, size_t *capacity,
                                    size_t size)
{
    if (count < *capacity)
        return STATUS_OK;
    return memory_reserve(ctx, list, capacity, count + 256, size);
}

/* ---- floor ---- */

/* Least number of vertices of a triangulated closed orientable surface (Jungerman & Ringel 1980):
 * the least n with (n-3)(n-4) >= 12 genus, but 10 for genus 2. */
static uint64_t fewest_vertices(uint64_t genus)
{
    if (genus == 0)
        return 4;
    if (genus == 2)
        return 10;
    uint64_t n = (uint64_t)((7.0 + sqrt(1.0 + 48.0 * (double)genus)) / 2.0);
    n = n > 8 ? n - 1 : 7;
    while ((n - 3) * (n - 4) < 12 * genus)
        n++;
    return n;
}

uint64_t component_floor(uint64_t vertices, uint64_t faces, uint64_t borders, uint64_t loops)
{
    int64_t edges = (int64_t)((3 * faces + borders) / 2);
    int64_t euler = (int64_t)vertices - edges + (int64_t)faces;
    if (loops) {
        int64_t floor = 3 * (int64_t)loops - 2 * euler;
        return floor > 1 ? (uint64_t)floor : 1;
    }
    uint64_t genus = euler < 2 ? (uint64_t)(2 - euler) / 2 : 0;
    return 2 * (fewest_vertices(genus) + 2 * genus - 2);
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
    uint32_t label = s->components.label[f - s->scope.face_first];
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
    const uint32_t first = s->scope.face_first, count = s->scope.face_count;
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
    const struct slab_scope *scope = &s->scope;
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
    const struct slab_scope *scope = &s->scope;
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
            (struct border_path){global_vertex(&s->scope, borders[i].from),
                                 global_vertex(&s->scope, borders[last].to), open_id};
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
            (struct open_component){.lowest_face = s->scope.face_first + c->lowest,
                                    .is_twisted = c->is_twisted,
                                    .faces = c->faces,
                                    .turned = c->turned,
                                    .vertices = c->vertices,
                                    .borders = c->borders,
                                    .loops = c->loops};
    }
    return STATUS_OK;
}

static enum status survey_slab(void *user, uint64_t job, unsigned worker)
{
    struct work *work = user;
    struct draft *draft = work->draft;
    struct surveyor *s = &work->surveyors[worker];
    struct part *part = &work->parts[job % work->in_flight];
    part->fan_count = part->rim_count = part->link_count = 0;
    part->open_count = part->path_count = 0;
    part->shared_vertices = part->borders = part->loops = part->components = part->floor = 0;
    part->is_turned = false;
    enum status status = scope_enter(draft, (uint32_t)job, &s->scope);
    if (status == STATUS_OK)
        status = components_find(draft, &s->scope, &s->components);
    if (status == STATUS_OK)
        status =
            memory_reserve(draft->ctx, &s->visited, &s->visited_capacity, s->scope.face_count, 1);
    if (status == STATUS_OK)
        status = memory_reserve(draft->ctx, &s->seen, &s->seen_capacity, s->scope.own_count, 1);
    if (status == STATUS_OK)
        status = find_fans(draft, s, part);
    if (status == STATUS_OK)
        status = find_loops(draft, s, part);
    if (status == STATUS_OK)
        status = hand_on_components(draft, s, part);
    return status;
}

/* Numbers within the slab become numbers of the whole. */
static enum status finish_part(void *user, uint64_t job)
{
    struct work *work = user;
    struct survey *survey = work->survey;
    struct part *part = &work->parts[job % work->in_flight];
    const uint64_t rim_base = work->rim_count, open_base = survey->open_count;
    work->rim_count += part->rim_count;
    survey->open_count += part->open_count;
    if (work->rim_count > UINT32_MAX - 1 || survey->open_count > UINT32_MAX - 1)
        return fail(work->draft->ctx, STATUS_BAD_INPUT,
                    "the mesh falls into too many pieces for a store");
    for (size_t i = 0; i < part->rim_count; i++)
        part->rims[i].up = (uint32_t)(rim_base + i);
    for (size_t i = 0; i < part->open_count; i++)
        part->open[i].up = (uint32_t)(open_base + i);
    for (size_t i = 0; i < part->link_count; i++) {
        part->links[i].fan += (uint32_t)rim_base;
        part->links[i].component += (uint32_t)open_base;
    }
    for (size_t i = 0; i < part->path_count; i++)
        part->paths[i].component += (uint32_t)open_base;
    survey->open_first[job] = (uint32_t)open_base;
    survey->open_first[job + 1] = (uint32_t)survey->open_count;
    survey->fan_count += part->fan_count;
    survey->is_turned = survey->is_turned || part->is_turned;
    survey->topology.border_edges += part->borders;
    survey->topology.border_loops += part->loops;
    survey->topology.components += part->components;
    survey->topology.floor += part->floor;
    work->shared_vertices += part->shared_vertices;

    enum status status =
        spool_append(&survey->fan_spool, part->fans, part->fan_count * sizeof *part->fans);
    if (status == STATUS_OK)
        status = spool_append(&work->rim_spool, part->rims, part->rim_count * sizeof *part->rims);
    if (status == STATUS_OK)
        status =
            spool_append(&survey->open_spool, part->open, part->open_count * sizeof *part->open);
    if (status == STATUS_OK)
        status = sorter_add(work->links, part->links, part->link_count);
    if (status == STATUS_OK)
        status = sorter_add(work->paths, part->paths, part->path_count);
    if (status == STATUS_OK)
        status = step(work->draft->ctx, "import: survey", job, work->draft->slab_count);
    return status;
}

/* ---- across slabs ---- */

static uint32_t rim_root(struct rim_fan *rims, uint32_t id)
{
    while (rims[id].up != id) {
        rims[id].up = rims[rims[id].up].up;
        id = rims[id].up;
    }
    return id;
}

uint32_t open_root(struct open_component *open, uint32_t id, uint32_t *turned)
{
    uint32_t parity = 0;
    while (open[id].up != id) {
        struct open_component *at = &open[id];
        at->up_turned ^= open[at->up].up_turned; /* 0 in roots */
        at->up = open[at->up].up;
        parity ^= at->up_turned;
        id = at->up;
    }
    *turned = parity;
    return id;
}

/* Two components meet in an edge; `turn`: they show different sides there. */
static void unite_open(struct survey *survey, uint32_t a, uint32_t b, uint32_t turn)
{
    struct open_component *open = survey->open;
    uint32_t turned_a, turned_b;
    a = open_root(open, a, &turned_a);
    b = open_root(open, b, &turned_b);
    turn ^= turned_a ^ turned_b;
    if (a == b) {
        if (turn) {
            open[a].is_twisted = true;
            survey->is_turned = true;
        }
        return;
    }
    uint32_t low = a < b ? a : b, high = a < b ? b : a;
    open[high].up = low;
    open[high].up_turned = turn;
    open[low].is_twisted = open[low].is_twisted || open[high].is_twisted;
}

/* Each edge between slabs gives two half links at each of its ends. */
static enum status join_links(struct work *work, uint64_t *unions)
{
    struct survey *survey = work->survey;
    struct half_link first = {0};
    bool has_first = false;
    enum status status = sorter_finish(work->links);
    while (status == STATUS_OK) {
        const void *data;
        size_t count;
        status = sorter_next(work->links, &data, &count);
        if (status != STATUS_OK || count == 0)
            break;
        const struct half_link *links = data;
        for (size_t i = 0; i < count; i++) {
            if (!has_first) {
                first = links[i];
                has_first = true;
                continue;
            }
            if (links[i].key != first.key)
                return fail(work->draft->ctx, STATUS_INTERNAL,
                            "an edge between slabs has one side");
            has_first = false;
            uint32_t a = rim_root(work->rims, first.fan), b = rim_root(work->rims, links[i].fan);
            if (a != b) {
                work->rims[a < b ? b : a].up = a < b ? a : b;
                ++*unions;
            }
            if ((first.key & 1) == 0)
                unite_open(survey, first.component, links[i].component,
                           1 ^ first.runs ^ links[i].runs);
        }
    }
    if (status == STATUS_OK && has_first)
        return fail(work->draft->ctx, STATUS_INTERNAL, "an edge between slabs has one side");
    return status;
}

/* The roots at each vertex, by number: all but the first are further fans. */
static enum status list_rim_fans(struct work *work)
{
    struct draft *draft = work->draft;
    struct survey *survey = work->survey;
    struct sorter *sorter = NULL;
    enum status status = sorter_open(draft->ctx, 8, 8, draft->sorter_limit, draft->beside, &sorter);
    for (uint64_t i = 0; i < work->rim_count && status == STATUS_OK; i++) {
        uint64_t key = (uint64_t)work->rims[i].vertex << 32 | i;
        if (work->rims[i].up == i)
            status = sorter_add(sorter, &key, 1);
    }
    if (status == STATUS_OK)
        status = sorter_finish(sorter);
    uint64_t last = UINT64_MAX;
    while (status == STATUS_OK) {
        const void *data;
        size_t count;
        status = sorter_next(sorter, &data, &count);
        if (status != STATUS_OK || count == 0)
            break;
        const uint64_t *keys = data;
        for (size_t i = 0; i < count && status == STATUS_OK; i++) {
            const struct rim_fan *rim = &work->rims[(uint32_t)keys[i]];
            if (keys[i] >> 32 == last >> 32) {
                struct fan_record fan = {rim->vertex, rim->face, rim->corner};
                status = spool_append(&survey->fan_spool, &fan, sizeof fan);
                survey->fan_count++;
            }
            last = keys[i];
        }
    }
    sorter_close(&sorter);
    return status;
}

/* Sums of each set of open components go to its root. */
static void sum_open(struct survey *survey)
{
    struct open_component *open = survey->open;
    for (uint32_t i = 0; i < survey->open_count; i++) {
        uint32_t turned;
        uint32_t root = open_root(open, i, &turned);
        if (root == i)
            continue;
        open[root].faces += open[i].faces;
        open[root].turned += turned ? open[i].faces - open[i].turned : open[i].turned;
        open[root].vertices += open[i].vertices;
        open[root].borders += open[i].borders;
        open[root].loops += open[i].loops;
    }
    for (uint32_t i = 0; i < survey->open_count; i++) {
        if (open[i].up == i && open[i].turned)
            survey->is_turned = true;
    }
}

/* Paths become loops by following each to the one that starts where it ends. */
static enum status join_paths(struct work *work)
{
    struct draft *draft = work->draft;
    struct survey *survey = work->survey;
    const uint64_t count = sorter_count(work->paths);
    struct spool spool;
    spool_init(draft->ctx, &spool, draft->beside, draft->spool_limit);
    enum status status = sorter_finish(work->paths);
    for (size_t got = 1; status == STATUS_OK && got;) {
        const void *data;
        status = sorter_next(work->paths, &data, &got);
        if (status == STATUS_OK)
            status = spool_append(&spool, data, got * sizeof(struct border_path));
    }
    void *sealed = NULL;
    if (status == STATUS_OK)
        status = spool_seal(&spool, &sealed);
    struct border_path *paths = sealed;
    for (uint64_t i = 0; i < count && status == STATUS_OK; i++) {
        uint64_t at = i;
        if (paths[at].end == NO_INDEX)
            continue;
        uint32_t turned;
        survey->open[open_root(survey->open, paths[i].component, &turned)].loops++;
        while (at < count && paths[at].end != NO_INDEX) {
            uint32_t wanted = paths[at].end;
            paths[at].end = NO_INDEX; /* taken */
            uint64_t low = 0, high = count;
            while (low < high) {
                uint64_t middle = low + (high - low) / 2;
                if (paths[middle].start < wanted)
                    low = middle + 1;
                else
                    high = middle;
            }
            at = low < count && paths[low].start == wanted ? low : count;
        }
    }
    spool_clear(&spool);
    return status;
}

static enum status join_parts(struct work *work)
{
    struct survey *survey = work->survey;
    void *data;
    enum status status = spool_seal(&work->rim_spool, &data);
    if (status != STATUS_OK)
        return status;
    work->rims = data;
    status = spool_seal(&survey->open_spool, &data);
    if (status != STATUS_OK)
        return status;
    survey->open = data;
    uint64_t unions = 0;
    status = join_links(work, &unions);
    if (status == STATUS_OK && work->rim_count - unions > work->shared_vertices)
        status = list_rim_fans(work);
    if (status != STATUS_OK)
        return status;
    sum_open(survey);
    status = join_paths(work);
    for (uint32_t i = 0; i < survey->open_count && status == STATUS_OK; i++) {
        const struct open_component *c = &survey->open[i];
        if (c->up != i)
            continue;
        survey->topology.components++;
        survey->topology.border_loops += c->loops;
        survey->topology.floor += component_floor(c->vertices, c->faces, c->borders, c->loops);
    }
    return status;
}

/* ---- the whole ---- */

static enum status prepare(struct work *work)
{
    struct draft *draft = work->draft;
    struct survey *survey = work->survey;
    struct context *ctx = draft->ctx;
    spool_init(ctx, &survey->fan_spool, draft->beside, draft->spool_limit);
    spool_init(ctx, &survey->open_spool, draft->beside, draft->spool_limit);
    spool_init(ctx, &work->rim_spool, draft->beside, draft->spool_limit);
    enum status status = memory_take_zeroed(ctx, (size_t)draft->slab_count + 1,
                                            sizeof *survey->open_first, &survey->open_first);
    if (status == STATUS_OK)
        survey->slab_count = draft->slab_count;
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, ctx->threads, sizeof *work->surveyors, &work->surveyors);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, work->in_flight, sizeof *work->parts, &work->parts);
    if (status == STATUS_OK)
        status = sorter_open(ctx, sizeof(struct half_link), 8, draft->sorter_limit, draft->beside,
                             &work->links);
    if (status == STATUS_OK)
        status = sorter_open(ctx, sizeof(struct border_path), 8, draft->sorter_limit, draft->beside,
                             &work->paths);
    return status;
}

static void release(struct work *work)
{
    struct context *ctx = work->draft->ctx;
    for (unsigned i = 0; work->surveyors && i < ctx->threads; i++) {
        struct surveyor *s = &work->surveyors[i];
        scope_clear(&s->scope);
        components_clear(&s->components);
        memory_release(ctx, &s->visited, s->visited_capacity, 1);
        memory_release(ctx, &s->seen, s->seen_capacity, 1);
        memory_release(ctx, &s->borders, s->border_capacity, sizeof *s->borders);
        memory_release(ctx, &s->leaving, s->leaving_capacity, sizeof *s->leaving);
        memory_release(ctx, &s->is_entered, s->entered_capacity, 1);
    }
    memory_release(ctx, &work->surveyors, ctx->threads, sizeof *work->surveyors);
    for (unsigned i = 0; work->parts && i < work->in_flight; i++) {
        struct part *part = &work->parts[i];
        memory_release(ctx, &part->fans, part->fan_capacity, sizeof *part->fans);
        memory_release(ctx, &part->rims, part->rim_capacity, sizeof *part->rims);
        memory_release(ctx, &part->links, part->link_capacity, sizeof *part->links);
        memory_release(ctx, &part->open, part->open_capacity, sizeof *part->open);
        memory_release(ctx, &part->paths, part->path_capacity, sizeof *part->paths);
    }
    memory_release(ctx, &work->parts, work->in_flight, sizeof *work->parts);
    sorter_close(&work->links);
    sorter_close(&work->paths);
    spool_clear(&work->rim_spool);
}

enum status survey_draft(struct draft *draft, struct survey *survey)
{
    memset(survey, 0, sizeof *survey);
    survey->ctx = draft->ctx;
    struct work work = {.draft = draft, .survey = survey, .in_flight = 2 * draft->ctx->threads};
    enum status status = prepare(&work);
    if (status == STATUS_OK)
        status = parallel_ordered(draft->ctx, draft->slab_count, work.in_flight, survey_slab,
                                  finish_part, &work);
    if (status == STATUS_OK)
        status = join_parts(&work);
    release(&work);
    if (status != STATUS_OK) {
        survey_clear(survey);
        return status;
    }
    struct topology *t = &survey->topology;
    t->vertices = draft->vertex_count;
    t->faces = draft->face_count;
    t->edges = (3 * draft->face_count + t->border_edges) / 2;
    t->euler = (int64_t)t->vertices - (int64_t)t->edges + (int64_t)t->faces;
    return STATUS_OK;
}

void survey_clear(struct survey *survey)
{
    if (!survey->ctx)
        return;
    memory_release(survey->ctx, &survey->open_first, (size_t)survey->slab_count + 1,
                   sizeof *survey->open_first);
    spool_clear(&survey->fan_spool);
    spool_clear(&survey->open_spool);
    memset(survey, 0, sizeof *survey);
}
