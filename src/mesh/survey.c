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
#include "mesh/survey_slab.h"

#include <math.h>
#include <string.h>

#include "base/external_sort.h"
#include "base/memory.h"
#include "base/parallel.h"

struct surveying {
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
    struct slab_scope *scopes; /* one a worker, where no other loop has them */
};

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

/* ---- slab by slab ---- */

enum status survey_take(struct surveying *work, const struct slab_scope *scope, uint64_t slab,
                        unsigned worker)
{
    return survey_slab(work->draft, scope, &work->surveyors[worker],
                       &work->parts[slab % work->in_flight]);
}

/* Numbers within the slab become numbers of the whole. */
enum status survey_add(struct surveying *work, uint64_t job)
{
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
static enum status join_links(struct surveying *work, uint64_t *unions)
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
            if ((links[i].key ^ first.key) > LINK_RUNS)
                return fail(work->draft->ctx, STATUS_INTERNAL,
                            "an edge between slabs has one side");
            has_first = false;
            uint32_t a = rim_root(work->rims, first.fan), b = rim_root(work->rims, links[i].fan);
            if (a != b) {
                work->rims[a < b ? b : a].up = a < b ? a : b;
                ++*unions;
            }
            if ((first.key & LINK_AT_HIGHER) == 0)
                unite_open(survey, first.component, links[i].component,
                           1 ^ (uint32_t)((first.key ^ links[i].key) & LINK_RUNS));
        }
    }
    if (status == STATUS_OK && has_first)
        return fail(work->draft->ctx, STATUS_INTERNAL, "an edge between slabs has one side");
    return status;
}

/* The roots at each vertex, by number: all but the first are further fans. */
static enum status list_rim_fans(struct surveying *work)
{
    struct draft *draft = work->draft;
    struct survey *survey = work->survey;
    struct sorter *sorter = NULL;
    enum status status =
        sorter_open(draft->ctx, 8, 8, room_left(&draft->room) / 4, draft->room.beside, &sorter);
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
static enum status join_paths(struct surveying *work)
{
    struct draft *draft = work->draft;
    struct survey *survey = work->survey;
    const uint64_t count = sorter_count(work->paths);
    struct spool spool;
    spool_init(draft->ctx, &spool, draft->room.beside, room_spool_limit(&draft->room, 4));
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

static enum status join_parts(struct surveying *work)
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

static enum status prepare(struct surveying *work)
{
    struct draft *draft = work->draft;
    struct survey *survey = work->survey;
    struct context *ctx = draft->ctx;
    spool_init(ctx, &survey->fan_spool, draft->room.beside, room_spool_limit(&draft->room, 4));
    spool_init(ctx, &survey->open_spool, draft->room.beside, room_spool_limit(&draft->room, 4));
    spool_init(ctx, &work->rim_spool, draft->room.beside, room_spool_limit(&draft->room, 4));
    enum status status = memory_take_zeroed(ctx, (size_t)draft->slab_count + 1,
                                            sizeof *survey->open_first, &survey->open_first);
    if (status == STATUS_OK)
        survey->slab_count = draft->slab_count;
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, ctx->threads, sizeof *work->surveyors, &work->surveyors);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, work->in_flight, sizeof *work->parts, &work->parts);
    if (status == STATUS_OK)
        status = sorter_open(ctx, sizeof(struct half_link), 8, draft->room.sorter,
                             draft->room.beside, &work->links);
    if (status == STATUS_OK)
        status = sorter_open(ctx, sizeof(struct border_path), 8, draft->room.sorter,
                             draft->room.beside, &work->paths);
    return status;
}

static void release(struct surveying *work)
{
    struct context *ctx = work->draft->ctx;
    for (unsigned i = 0; work->scopes && i < ctx->threads; i++)
        scope_clear(&work->scopes[i]);
    memory_release(ctx, &work->scopes, ctx->threads, sizeof *work->scopes);
    for (unsigned i = 0; work->surveyors && i < ctx->threads; i++)
        surveyor_clear(ctx, &work->surveyors[i]);
    memory_release(ctx, &work->surveyors, ctx->threads, sizeof *work->surveyors);
    for (unsigned i = 0; work->parts && i < work->in_flight; i++)
        part_clear(ctx, &work->parts[i]);
    memory_release(ctx, &work->parts, work->in_flight, sizeof *work->parts);
    sorter_close(&work->links);
    sorter_close(&work->paths);
    spool_clear(&work->rim_spool);
}

enum status survey_begin(struct draft *draft, unsigned in_flight, struct survey *survey,
                         struct surveying **out)
{
    memset(survey, 0, sizeof *survey);
    survey->ctx = draft->ctx;
    *out = NULL;
    struct surveying *work;
    enum status status = memory_take_zeroed(draft->ctx, 1, sizeof *work, &work);
    if (status != STATUS_OK)
        return status;
    work->draft = draft;
    work->survey = survey;
    work->in_flight = in_flight;
    *out = work;
    return prepare(work);
}

enum status survey_end(struct surveying *work)
{
    enum status status = join_parts(work);
    struct draft *draft = work->draft;
    struct topology *t = &work->survey->topology;
    t->vertices = draft->vertex_count;
    t->faces = draft->face_count;
    t->edges = (3 * draft->face_count + t->border_edges) / 2;
    t->euler = (int64_t)t->vertices - (int64_t)t->edges + (int64_t)t->faces;
    return status;
}

void survey_close(struct surveying **surveying)
{
    struct surveying *work = *surveying;
    *surveying = NULL;
    if (!work)
        return;
    release(work);
    memory_release(work->draft->ctx, &work, 1, sizeof *work);
}

/* ---- a loop of its own ---- */

static enum status survey_job(void *user, uint64_t job, unsigned worker)
{
    struct surveying *work = user;
    struct slab_scope *scope = &work->scopes[worker];
    draft_enter_slab(work->draft, job);
    enum status status = scope_enter(work->draft, (uint32_t)job, scope);
    return status == STATUS_OK ? survey_take(work, scope, job, worker) : status;
}

static enum status finish_job(void *user, uint64_t job)
{
    struct surveying *work = user;
    struct draft *draft = work->draft;
    enum status status = survey_add(work, job);
    draft_forget_slab(draft, job);
    return status == STATUS_OK ? step(draft->ctx, "import: survey", job, draft->slab_count)
                               : status;
}

enum status survey_draft(struct draft *draft, struct survey *survey)
{
    struct context *ctx = draft->ctx;
    struct surveying *work;
    enum status status = survey_begin(draft, draft->room.in_flight, survey, &work);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, ctx->threads, sizeof *work->scopes, &work->scopes);
    if (status == STATUS_OK)
        status =
            parallel_ordered(ctx, draft->slab_count, work->in_flight, survey_job, finish_job, work);
    if (status == STATUS_OK)
        status = survey_end(work);
    survey_close(&work);
    if (status != STATUS_OK)
        survey_clear(survey);
    return status;
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
