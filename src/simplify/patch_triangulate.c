/*
 * Triangulating the patches of a level.
 *
 * Each patch by itself is easy: geom/triangulate.h cuts its ears in the plane of its normal. But
 * two patches that have two vertices in common, which is usual at coarse levels, may both want the
 * diagonal between them, or one may want what is an edge of the graph already; then four faces
 * meet at an edge. Triangulating first and mending afterwards has no end that one could prove. So
 * patches are cut one after the other, lowest number first, and each is told which diagonals are
 * taken: those of patches before it, edges of the graph, and the own diagonals of patches that are
 * at full resolution and have no vertex inside, which are reserved beforehand because such a patch
 * may have no other way. A patch that finds no triangulation is cut into a fan round a vertex that
 * nobody else uses, which always is one.
 *
 * Where two patches have three vertices in a row in common and both could cut that ear, the
 * patch whose normal the triangle agrees with more may (end of section 4.2.8).
 *
 * With few patches left the pairs would fit in a matrix, with many a list at each vertex would do,
 * but a hub of many diagonals makes lists slow: so one flat table of pairs.
 */
#include "simplify/patch_triangulate.h"

#include <string.h>

#include "base/memory.h"

enum { SEARCH_PATCHES_MAX = 256 }; /* patches looked at for a spare vertex */

/* ---- the table of pairs ---- */

static uint64_t pair_of(uint32_t a, uint32_t b)
{
    return a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
}

static size_t pair_place(const struct pair_table *table, uint64_t pair)
{
    uint64_t mixed = pair * UINT64_C(0x9e3779b97f4a7c15);
    size_t mask = table->capacity - 1, place = (size_t)(mixed >> 20) & mask;
    while (table->pairs[place] != UINT64_MAX && table->pairs[place] != pair)
        place = (place + 1) & mask;
    return place;
}

/* The pair's owner, or NO_PATCH. */
static uint32_t pair_owner(const struct pair_table *table, uint64_t pair)
{
    if (table->capacity == 0)
        return NO_PATCH;
    size_t place = pair_place(table, pair);
    return table->pairs[place] == pair ? table->owners[place] : NO_PATCH;
}

static enum status pair_make_room(struct context *ctx, struct pair_table *table, size_t more)
{
    size_t capacity = table->capacity > 0 ? table->capacity : 64;
    while (3 * capacity < 4 * (table->count + more))
        capacity *= 2;
    if (capacity == table->capacity)
        return STATUS_OK;
    struct pair_table larger = {.capacity = capacity, .count = table->count};
    enum status status = memory_take(ctx, capacity, sizeof *larger.pairs, &larger.pairs);
    if (status != STATUS_OK)
        return status;
    status = memory_take(ctx, capacity, sizeof *larger.owners, &larger.owners);
    if (status != STATUS_OK) {
        memory_release(ctx, &larger.pairs, capacity, sizeof *larger.pairs);
        return status;
    }
    memset(larger.pairs, 0xff, capacity * sizeof *larger.pairs);
    for (size_t i = 0; i < table->capacity; i++)
        if (table->pairs[i] != UINT64_MAX) {
            size_t place = pair_place(&larger, table->pairs[i]);
            larger.pairs[place] = table->pairs[i];
            larger.owners[place] = table->owners[i];
        }
    memory_release(ctx, &table->pairs, table->capacity, sizeof *table->pairs);
    memory_release(ctx, &table->owners, table->capacity, sizeof *table->owners);
    *table = larger;
    return STATUS_OK;
}

static enum status pair_claim(struct context *ctx, struct pair_table *table, uint64_t pair,
                              uint32_t owner)
{
    enum status status = pair_make_room(ctx, table, 1);
    if (status != STATUS_OK)
        return status;
    size_t place = pair_place(table, pair);
    table->count += table->pairs[place] != pair;
    table->pairs[place] = pair;
    table->owners[place] = owner;
    return STATUS_OK;
}

/* ---- which diagonals a patch may use ---- */

struct asking {
    const struct level_faces *level;
    uint32_t patch;
    uint32_t n;
    bool shares_ears; /* the rule for an ear that both neighbours claim is kept */
    bool own_only;    /* only what is reserved for the patch */
};

/* Corner `middle` lies between two edges that the same two patches share: does the patch on the
 * other side agree more with the ear? */
static bool ear_is_the_others(const struct asking *asking, uint32_t middle)
{
    const struct level_faces *level = asking->level;
    const struct chain_graph *graph = level->graph;
    uint32_t v = level->corners[middle], n = asking->n;
    uint32_t h = graph->outgoing[v], other = half_edge_turn(graph, h);
    if (half_edge_turn(graph, other) != h)
        return false;
    uint32_t patch = graph->half_edges[h].patch == asking->patch ? graph->half_edges[other].patch
                                                                 : graph->half_edges[h].patch;
    if (patch == NO_PATCH)
        return false;
    struct vec3 ear = triangle_normal(vec3_load(level->points + 3 * (size_t)((middle + n - 1) % n)),
                                      vec3_load(level->points + 3 * (size_t)middle),
                                      vec3_load(level->points + 3 * (size_t)((middle + 1) % n)));
    double mine = vec3_dot(ear, patch_normal(graph, asking->patch));
    double others = -vec3_dot(ear, patch_normal(graph, patch));
    return others > mine || (others == mine && patch < asking->patch);
}

static bool diagonal_allowed(void *user, uint32_t i, uint32_t j)
{
    const struct asking *asking = user;
    const struct level_faces *level = asking->level;
    uint32_t a = level->corners[i], b = level->corners[j], n = asking->n;
    uint32_t owner = pair_owner(&level->diagonals, pair_of(a, b));
    if (owner != NO_PATCH && owner != asking->patch)
        return false;
    if (asking->own_only)
        return owner == asking->patch;
    if (vertices_joined(level->graph, a, b))
        return false;
    if (asking->shares_ears && (((j + n - i) % n == 2 && ear_is_the_others(asking, (i + 1) % n)) ||
                                ((i + n - j) % n == 2 && ear_is_the_others(asking, (j + 1) % n))))
        return false;
    return true;
}

/* ---- own diagonals ---- */

static enum status reserve_pair(struct level_faces *level, uint32_t patch, uint32_t a, uint32_t b,
                                bool only_count, uint32_t *count)
{
    const struct chain_graph *graph = level->graph;
    if (!vertex_is_live(graph, a) || !vertex_is_live(graph, b) || vertices_joined(graph, a, b))
        return STATUS_OK;
    ++*count;
    if (only_count)
        return STATUS_OK;
    return pair_claim(graph->ctx, &level->diagonals, pair_of(a, b), patch);
}

/* All diagonals that the patch had in the store, or that were chains which merging dissolved. */
static enum status each_own_diagonal(struct level_faces *level, uint32_t patch, bool only_count,
                                     uint32_t *count)
{
    const struct chain_graph *graph = level->graph;
    uint32_t member = patch;
    enum status status = STATUS_OK;
    *count = 0;
    do {
        const struct graph_patch *from = &graph->patches[member];
        const uint32_t *pair = graph->diagonals + 2 * (size_t)from->diagonal_first;
        for (uint32_t i = 0; i < from->diagonal_count && status == STATUS_OK; i++)
            status = reserve_pair(level, patch, pair[2 * i], pair[2 * i + 1], only_count, count);
        member = from->member;
    } while (member != patch && status == STATUS_OK);
    for (uint32_t e = graph->patches[patch].dissolved; e != NO_INDEX && status == STATUS_OK;
         e = graph->half_edges[2 * e].next)
        status = reserve_pair(level, patch, graph->half_edges[2 * e].origin,
                              graph->half_edges[2 * e + 1].origin, only_count, count);
    return status;
}

/* A patch at full resolution without a vertex inside has a whole triangulation of its own. */
static enum status reserve_own(struct level_faces *level, uint32_t patch)
{
    const struct graph_patch *p = &level->graph->patches[patch];
    if (p->size < 4 || (p->diagonal_count == 0 && p->dissolved == NO_INDEX) ||
        p->interior_count > 0)
        return STATUS_OK;
    uint32_t count;
    enum status status = each_own_diagonal(level, patch, true, &count);
    if (status == STATUS_OK && count == p->size - 3)
        status = each_own_diagonal(level, patch, false, &count);
    return status;
}

/* ---- spare vertices ---- */

static bool is_unused(const struct chain_graph *graph, uint32_t v)
{
    return !vertex_is_live(graph, v) && !(graph->flags[v] & VERTEX_TAKEN);
}

static uint32_t spare_in_list(const struct chain_graph *graph, uint32_t edge)
{
    for (uint32_t v = graph->edges[edge].first; v != NO_INDEX; v = graph->list[v])
        if (is_unused(graph, v))
            return v;
    return NO_INDEX;
}

/* A vertex of the patch that nobody uses: inside it, or one that its chains replace. */
static uint32_t spare_of_patch(const struct chain_graph *graph, uint32_t patch)
{
    uint32_t member = patch, v;
    do {
        const struct graph_patch *from = &graph->patches[member];
        for (uint32_t i = 0; i < from->interior_count; i++)
            if (is_unused(graph, from->interior_first + i))
                return from->interior_first + i;
        member = from->member;
    } while (member != patch);
    for (uint32_t e = graph->patches[patch].dissolved; e != NO_INDEX;
         e = graph->half_edges[2 * e].next)
        if ((v = spare_in_list(graph, e)) != NO_INDEX)
            return v;
    uint32_t first = graph->patches[patch].half_edge, h = first;
    do {
        if ((v = spare_in_list(graph, h / 2)) != NO_INDEX)
            return v;
        h = graph->half_edges[h].next;
    } while (h != first);
    return NO_INDEX;
}

/* Looks round the patch in rings of neighbours. */
static uint32_t spare_near(const struct chain_graph *graph, uint32_t patch)
{
    uint32_t seen[SEARCH_PATCHES_MAX], count = 1;
    seen[0] = patch;
    for (uint32_t i = 0; i < count; i++) {
        uint32_t v = spare_of_patch(graph, seen[i]);
        if (v != NO_INDEX)
            return v;
        uint32_t first = graph->patches[seen[i]].half_edge, h = first;
        do {
            uint32_t other = graph->half_edges[h ^ 1].patch, k = 0;
            while (k < count && seen[k] != other)
                k++;
            if (other != NO_PATCH && k == count && count < SEARCH_PATCHES_MAX)
                seen[count++] = other;
            h = graph->half_edges[h].next;
        } while (h != first);
    }
    return NO_INDEX;
}

static enum status take_spare(struct level_faces *level, uint32_t v)
{
    enum status status = memory_reserve(level->graph->ctx, &level->spares, &level->spare_capacity,
                                        level->spare_count + 1, sizeof *level->spares);
    if (status != STATUS_OK)
        return status;
    level->spares[level->spare_count++] = v;
    level->graph->flags[v] |= VERTEX_TAKEN;
    return STATUS_OK;
}

static void give_back_spares(struct level_faces *level)
{
    for (size_t i = 0; i < level->spare_count; i++)
        level->graph->flags[level->spares[i]] &= (uint8_t)~VERTEX_TAKEN;
    level->spare_count = 0;
}

/* ---- one patch ---- */

static enum status read_loop(struct level_faces *level, uint32_t patch)
{
    const struct chain_graph *graph = level->graph;
    struct context *ctx = graph->ctx;
    uint32_t n = graph->patches[patch].size, first = graph->patches[patch].half_edge, h = first;
    enum status status =
        memory_reserve(ctx, &level->corners, &level->corner_capacity, n, sizeof *level->corners);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &level->points, &level->point_capacity, 3 * (size_t)n,
                                sizeof *level->points);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &level->triangles, &level->triangle_capacity,
                                3 * ((size_t)n - 2), sizeof *level->triangles);
    if (status != STATUS_OK)
        return status;
    for (uint32_t i = 0; i < n; i++, h = graph->half_edges[h].next) {
        level->corners[i] = graph->half_edges[h].origin;
        vec3_store(level->points + 3 * (size_t)i, vertex_point(graph, level->corners[i]));
    }
    return STATUS_OK;
}

static enum status add_face(struct level_faces *level, uint32_t a, uint32_t b, uint32_t c)
{
    enum status status = memory_reserve(level->graph->ctx, &level->faces, &level->capacity,
                                        3 * (level->count + 1), sizeof *level->faces);
    if (status != STATUS_OK)
        return status;
    uint32_t *face = level->faces + 3 * level->count++;
    face[0] = a;
    face[1] = b;
    face[2] = c;
    return STATUS_OK;
}

static enum status add_fan(struct level_faces *level, uint32_t n, uint32_t spare)
{
    enum status status = take_spare(level, spare);
    for (uint32_t i = 0; i < n && status == STATUS_OK; i++)
        status = add_face(level, level->corners[i], level->corners[(i + 1) % n], spare);
    level->fans++;
    return status;
}

/* Adds the triangles of the patch and claims their diagonals. */
static enum status add_triangles(struct level_faces *level, uint32_t patch, uint32_t n)
{
    struct context *ctx = level->graph->ctx;
    enum status status = pair_make_room(ctx, &level->diagonals, n);
    for (uint32_t t = 0; t < n - 2 && status == STATUS_OK; t++) {
        const uint32_t *corner = level->triangles + 3 * (size_t)t;
        for (int k = 0; k < 3 && status == STATUS_OK; k++) {
            uint32_t i = corner[k], j = corner[(k + 1) % 3];
            if ((i + 1) % n != j)
                status = pair_claim(ctx, &level->diagonals,
                                    pair_of(level->corners[i], level->corners[j]), patch);
        }
        if (status == STATUS_OK)
            status = add_face(level, level->corners[corner[0]], level->corners[corner[1]],
                              level->corners[corner[2]]);
    }
    return status;
}

/* The other patch has the same three corners and comes first. */
static bool is_double(const struct chain_graph *graph, uint32_t patch)
{
    uint32_t h = graph->patches[patch].half_edge, n = graph->half_edges[h].next;
    uint32_t other = graph->half_edges[h ^ 1].patch;
    return other < patch && graph->patches[other].size == 3 &&
           graph->half_edges[n ^ 1].patch == other &&
           graph->half_edges[graph->half_edges[n].next ^ 1].patch == other;
}

static enum status cut_patch(struct level_faces *level, uint32_t patch)
{
    struct chain_graph *graph = level->graph;
    struct asking asking = {.level = level, .patch = patch, .n = graph->patches[patch].size};
    uint32_t n = asking.n;
    enum triangulation_quality quality = TRIANGULATION_BLOCKED;
    enum status status = read_loop(level, patch);
    if (status != STATUS_OK)
        return status;
    if (n == 3 && !is_double(graph, patch))
        return add_face(level, level->corners[0], level->corners[1], level->corners[2]);
    double normal[3];
    vec3_store(normal, patch_normal(graph, patch));
    /* With the rule of shared ears, without it, and with nothing but its own diagonals. */
    for (int attempt = 0; attempt < 3 && quality == TRIANGULATION_BLOCKED && n > 3; attempt++) {
        asking.shares_ears = attempt == 0;
        asking.own_only = attempt == 2;
        status = triangulate(graph->ctx, &level->workspace, level->points, n, normal,
                             diagonal_allowed, &asking, level->triangles, &quality);
        if (status != STATUS_OK)
            return status;
    }
    if (quality != TRIANGULATION_BLOCKED) {
        level->bad += quality == TRIANGULATION_FORCED;
        status = patch_flip(graph->ctx, &level->flips, level->points, n, normal, diagonal_allowed,
                            &asking, level->triangles);
        return status == STATUS_OK ? add_triangles(level, patch, n) : status;
    }
    uint32_t spare = spare_near(graph, patch);
    if (spare != NO_INDEX)
        return add_fan(level, n, spare);
    level->blocked++;
    return STATUS_OK;
}

enum status patch_triangulate(struct chain_graph *graph, struct level_faces *level)
{
    struct context *ctx = graph->ctx;
    size_t faces = (size_t)chain_graph_faces(graph), patches = graph->patch_count;
    enum status status = STATUS_OK;
    level->graph = graph;
    level->count = 0;
    level->fans = level->blocked = level->bad = 0;
    give_back_spares(level);
    level->diagonals.count = 0;
    if (level->diagonals.capacity > 0)
        memset(level->diagonals.pairs, 0xff,
               level->diagonals.capacity * sizeof *level->diagonals.pairs);
    if (!level->first_faces)
        status = memory_take(ctx, patches, sizeof *level->first_faces, &level->first_faces);
    if (status == STATUS_OK)
        status =
            memory_reserve(ctx, &level->faces, &level->capacity, 3 * faces, sizeof *level->faces);
    for (uint32_t i = 0; i < patches && status == STATUS_OK; i++)
        if (graph->patches[i].half_edge != NO_INDEX)
            status = reserve_own(level, i);
    for (uint32_t i = 0; i < patches && status == STATUS_OK; i++) {
        level->first_faces[i] = level->count;
        if (graph->patches[i].half_edge != NO_INDEX)
            status = cut_patch(level, i);
        if (status == STATUS_OK && i % 4096 == 4095)
            status = step(ctx, "triangulating", i + 1, patches);
    }
    return status;
}

/* ---- a few faces more ---- */

/* The live patch that deviates most and has a spare vertex; NO_PATCH: none has. */
static uint32_t worst_patch(const struct level_faces *level)
{
    const struct chain_graph *graph = level->graph;
    uint32_t worst = NO_PATCH;
    for (uint32_t i = 0; i < graph->patch_count; i++)
        if (graph->patches[i].half_edge != NO_INDEX &&
            (worst == NO_PATCH || graph->patches[i].deviation > graph->patches[worst].deviation) &&
            spare_of_patch(graph, i) != NO_INDEX)
            worst = i;
    return worst;
}

/* Puts the vertex into the triangle of [first, end) that is nearest to it, by its centre. */
static enum status split_nearest(struct level_faces *level, size_t first, size_t end, uint32_t v)
{
    const struct chain_graph *graph = level->graph;
    size_t nearest = first;
    double least = INFINITY;
    for (size_t f = first; f < end; f++) {
        const uint32_t *face = level->faces + 3 * f;
        struct vec3 sum =
            vec3_add(vec3_add(vertex_point(graph, face[0]), vertex_point(graph, face[1])),
                     vertex_point(graph, face[2]));
        double distance = vec3_distance_squared(vec3_scale(sum, 1.0 / 3), vertex_point(graph, v));
        if (distance < least) {
            least = distance;
            nearest = f;
        }
    }
    uint32_t a = level->faces[3 * nearest], b = level->faces[3 * nearest + 1];
    uint32_t c = level->faces[3 * nearest + 2];
    level->faces[3 * nearest + 2] = v;
    enum status status = take_spare(level, v);
    if (status == STATUS_OK)
        status = add_face(level, b, c, v);
    if (status == STATUS_OK)
        status = add_face(level, c, a, v);
    return status;
}

enum status patch_refine(struct level_faces *level, uint64_t pairs)
{
    const struct chain_graph *graph = level->graph;
    size_t whole = level->count;
    enum status status = STATUS_OK;
    for (uint64_t i = 0; i < pairs && status == STATUS_OK; i++) {
        uint32_t patch = worst_patch(level), after = patch + 1;
        if (patch == NO_PATCH)
            break;
        size_t end = after < graph->patch_count ? level->first_faces[after] : whole;
        if (end > level->first_faces[patch])
            status =
                split_nearest(level, level->first_faces[patch], end, spare_of_patch(graph, patch));
    }
    return status;
}

void level_faces_clear(struct context *ctx, struct level_faces *level)
{
    if (level->graph) {
        give_back_spares(level);
        memory_release(ctx, &level->first_faces, level->graph->patch_count,
                       sizeof *level->first_faces);
    }
    memory_release(ctx, &level->faces, level->capacity, sizeof *level->faces);
    memory_release(ctx, &level->diagonals.pairs, level->diagonals.capacity,
                   sizeof *level->diagonals.pairs);
    memory_release(ctx, &level->diagonals.owners, level->diagonals.capacity,
                   sizeof *level->diagonals.owners);
    memory_release(ctx, &level->corners, level->corner_capacity, sizeof *level->corners);
    memory_release(ctx, &level->points, level->point_capacity, sizeof *level->points);
    memory_release(ctx, &level->triangles, level->triangle_capacity, sizeof *level->triangles);
    memory_release(ctx, &level->spares, level->spare_capacity, sizeof *level->spares);
    triangulation_workspace_clear(ctx, &level->workspace);
    flip_room_clear(ctx, &level->flips);
    *level = (struct level_faces){0};
}
