/*
 * Cutting features out of a store and filling what is left open.
 *
 * The walk round a vertex that a loop needs would touch the store at random. But it only passes
 * through faces that go, and these few are gathered while the slabs stream by. So a loop turns, at
 * each of its vertices, through what goes from one of its edges to the next; the fill takes the
 * place of just that sector. The turn of faces round a vertex stays one turn, whatever loops meet
 * there: the result is a manifold as long as no diagonal repeats an edge. For that, the edges of
 * what stays between vertices on loops are gathered in a second sweep.
 */
#include "simplify/topology_surgery.h"

#include <string.h>

#include "base/memory.h"
#include "base/radix_sort.h"
#include "geom/triangulate.h"
#include "simplify/patchify.h"

enum { BATCH = 4096 };

/* ---- pairs ---- */

static uint64_t pair_of(uint32_t a, uint32_t b)
{
    return a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
}

static size_t pair_place(const struct pair_set *set, uint64_t pair)
{
    size_t at = (size_t)((pair ^ pair >> 29) * UINT64_C(0x9e3779b97f4a7c15) >> 20);
    for (at &= set->capacity - 1; set->pairs[at] != 0 && set->pairs[at] != pair;)
        at = (at + 1) & (set->capacity - 1);
    return at;
}

void pair_set_clear(struct context *ctx, struct pair_set *set)
{
    memory_release(ctx, &set->pairs, set->capacity, sizeof *set->pairs);
    memset(set, 0, sizeof *set);
}

static enum status pair_set_grow(struct context *ctx, struct pair_set *set)
{
    struct pair_set larger = {.capacity = set->capacity ? 2 * set->capacity : 256,
                              .count = set->count};
    enum status status =
        memory_take_zeroed(ctx, larger.capacity, sizeof *larger.pairs, &larger.pairs);
    if (status != STATUS_OK)
        return status;
    for (size_t i = 0; i < set->capacity; i++)
        if (set->pairs[i])
            larger.pairs[pair_place(&larger, set->pairs[i])] = set->pairs[i];
    memory_release(ctx, &set->pairs, set->capacity, sizeof *set->pairs);
    *set = larger;
    return STATUS_OK;
}

enum status pair_set_add(struct context *ctx, struct pair_set *set, uint32_t a, uint32_t b)
{
    if (2 * (set->count + 1) > set->capacity) {
        enum status status = pair_set_grow(ctx, set);
        if (status != STATUS_OK)
            return status;
    }
    uint64_t pair = pair_of(a, b);
    size_t at = pair_place(set, pair);
    set->count += set->pairs[at] == 0;
    set->pairs[at] = pair;
    return STATUS_OK;
}

bool pair_set_has(const struct pair_set *set, uint32_t a, uint32_t b)
{
    uint64_t pair = pair_of(a, b);
    return set->capacity > 0 && set->pairs[pair_place(set, pair)] == pair;
}

/* ---- beginning and end ---- */

static size_t words_of(uint64_t bits)
{
    return (size_t)((bits + 63) / 64) + 1;
}

enum status surgery_begin(struct surgery *surgery)
{
    const struct topology *topology = &store_info(surgery->store)->topology;
    enum status status = memory_take_zeroed(surgery->ctx, words_of(topology->faces),
                                            sizeof *surgery->dropped, &surgery->dropped);
    if (status == STATUS_OK)
        status = memory_take_zeroed(surgery->ctx, words_of(topology->vertices),
                                    sizeof *surgery->used, &surgery->used);
    return status;
}

void surgery_clear(struct surgery *surgery)
{
    struct context *ctx = surgery->ctx;
    if (!surgery->store)
        return;
    const struct topology *topology = &store_info(surgery->store)->topology;
    memory_release(ctx, &surgery->dropped, words_of(topology->faces), sizeof *surgery->dropped);
    memory_release(ctx, &surgery->used, words_of(topology->vertices), sizeof *surgery->used);
    memory_release(ctx, &surgery->walls, surgery->wall_capacity, sizeof *surgery->walls);
    memory_release(ctx, &surgery->borders, surgery->border_capacity, sizeof *surgery->borders);
    memory_release(ctx, &surgery->corners, surgery->corner_capacity, sizeof *surgery->corners);
    memory_release(ctx, &surgery->loops, surgery->loop_capacity, sizeof *surgery->loops);
    memory_release(ctx, &surgery->rim_vertices, surgery->rim_capacity,
                   sizeof *surgery->rim_vertices);
    memory_release(ctx, &surgery->rim_positions, surgery->rim_position_capacity,
                   sizeof *surgery->rim_positions);
    memory_release(ctx, &surgery->small_faces, surgery->small_face_capacity,
                   sizeof *surgery->small_faces);
    memory_release(ctx, &surgery->fills, surgery->fill_capacity, sizeof *surgery->fills);
    pair_set_clear(ctx, &surgery->taken);
    memset(surgery, 0, sizeof *surgery);
}

/* ---- first sweep: what goes ---- */

static enum status add_wall(struct surgery *surgery, const struct slab *slab, uint32_t face,
                            uint32_t feature)
{
    enum status status = memory_reserve(surgery->ctx, &surgery->walls, &surgery->wall_capacity,
                                        surgery->wall_count + 1, sizeof *surgery->walls);
    if (status != STATUS_OK)
        return status;
    struct wall_face *wall = &surgery->walls[surgery->wall_count++];
    wall->face = slab->face_first + face;
    wall->feature = feature;
    wall->mates = slab->mates[face];
    memcpy(wall->vertices, slab->faces + 3 * (size_t)face, sizeof wall->vertices);
    memcpy(wall->neighbours, slab->neighbours + 3 * (size_t)face, sizeof wall->neighbours);
    return STATUS_OK;
}

static enum status cut_slab(struct surgery *surgery, const struct slab *slab,
                            const uint32_t *labels, const uint32_t *of_patch,
                            const struct feature_list *list)
{
    enum status status = STATUS_OK;
    for (uint32_t f = 0; f < slab->face_count && status == STATUS_OK; f++) {
        uint32_t feature = of_patch[labels[f]];
        if (feature == NO_INDEX)
            continue;
        bit_set(surgery->dropped, slab->face_first + f);
        surgery->dropped_count++;
        if (list->features[feature].kind != FEATURE_COMPONENT)
            status = add_wall(surgery, slab, f, feature);
    }
    return status;
}

/* Border edges of what stays. */
static enum status gather_borders(struct surgery *surgery, const struct slab *slab)
{
    for (uint32_t f = 0; f < slab->face_count; f++) {
        if (bit_is_set(surgery->dropped, slab->face_first + f))
            continue;
        for (unsigned k = 0; k < 3; k++) {
            if (slab->neighbours[3 * (size_t)f + k] != NO_INDEX)
                continue;
            enum status status =
                memory_reserve(surgery->ctx, &surgery->borders, &surgery->border_capacity,
                               surgery->border_count + 1, sizeof *surgery->borders);
            if (status != STATUS_OK)
                return status;
            struct border_edge *edge = &surgery->borders[surgery->border_count++];
            edge->from = slab->faces[3 * (size_t)f + k];
            edge->to = slab->faces[3 * (size_t)f + next3(k)];
            memcpy(edge->position, slab_position(slab, edge->from), sizeof edge->position);
        }
    }
    return STATUS_OK;
}

enum status surgery_cut(struct surgery *surgery, const struct patch_options *options,
                        const uint32_t *of_patch, const struct feature_list *list)
{
    struct context *ctx = surgery->ctx;
    const struct store_info *info = store_info(surgery->store);
    struct patch_workspace space = {0};
    uint32_t *labels = NULL;
    size_t label_capacity = 0;
    uint64_t base = 0;
    enum status status = STATUS_OK;
    memset(surgery->dropped, 0, words_of(info->topology.faces) * sizeof *surgery->dropped);
    surgery->dropped_count = surgery->wall_count = surgery->border_count = 0;
    surgery->corner_count = surgery->loop_count = 0;
    for (uint32_t i = 0; i < info->slab_count && status == STATUS_OK; i++) {
        struct slab slab;
        uint32_t patch_count = 0;
        status = step(ctx, "cut", i, info->slab_count);
        if (status == STATUS_OK)
            status = slab_open(surgery->store, i, &slab);
        if (status != STATUS_OK)
            break;
        if (of_patch) {
            status = memory_reserve(ctx, &labels, &label_capacity, slab.face_count, sizeof *labels);
            if (status == STATUS_OK)
                status = patch_grow(ctx, &slab, options, &space, labels, &patch_count);
            if (status == STATUS_OK)
                status = cut_slab(surgery, &slab, labels, of_patch + base, list);
            base += patch_count;
        }
        if (status == STATUS_OK)
            status = gather_borders(surgery, &slab);
        slab_close(&slab);
    }
    patch_workspace_clear(ctx, &space);
    memory_release(ctx, &labels, label_capacity, sizeof *labels);
    return status;
}

/* ---- loops round what goes ---- */

static bool is_dropped(const struct surgery *surgery, uint32_t face)
{
    return face != NO_INDEX && bit_is_set(surgery->dropped, face);
}

/* Walls come in the order of the faces. */
static size_t wall_at(const struct surgery *surgery, uint32_t face)
{
    size_t low = 0, high = surgery->wall_count;
    while (high - low > 1) {
        size_t middle = low + (high - low) / 2;
        if (surgery->walls[middle].face <= face)
            low = middle;
        else
            high = middle;
    }
    return low;
}

enum status surgery_add_loop(struct surgery *surgery, const uint32_t *corners, uint32_t count,
                             uint32_t feature)
{
    struct context *ctx = surgery->ctx;
    enum status status = memory_reserve(ctx, &surgery->corners, &surgery->corner_capacity,
                                        surgery->corner_count + count, sizeof *surgery->corners);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &surgery->loops, &surgery->loop_capacity,
                                surgery->loop_count + 1, sizeof *surgery->loops);
    if (status != STATUS_OK)
        return status;
    surgery->loops[surgery->loop_count++] =
        (struct fill_loop){surgery->corner_count, count, feature};
    memcpy(surgery->corners + surgery->corner_count, corners, count * sizeof *corners);
    surgery->corner_count += count;
    return STATUS_OK;
}

struct wall_edge {
    size_t wall;
    unsigned edge;
};

/* The edge of the loop that follows: round the end of `at` through walls. False at a border. */
static bool next_wall_edge(const struct surgery *surgery, struct wall_edge *at)
{
    for (;;) {
        const struct wall_face *wall = &surgery->walls[at->wall];
        at->edge = next3(at->edge);
        uint32_t neighbour = wall->neighbours[at->edge];
        if (neighbour == NO_INDEX)
            return false;
        if (!is_dropped(surgery, neighbour))
            return true;
        unsigned mate = wall->mates >> (2 * at->edge) & 3;
        at->wall = wall_at(surgery, neighbour);
        at->edge = mate;
    }
}

static enum status walk_wall_loop(struct surgery *surgery, struct wall_edge first, uint8_t *visited,
                                  uint32_t **corners, size_t *capacity, uint8_t *blocked)
{
    struct wall_edge at = first;
    uint32_t count = 0, feature = surgery->walls[first.wall].feature;
    do {
        enum status status =
            memory_reserve(surgery->ctx, corners, capacity, (size_t)count + 1, sizeof **corners);
        if (status != STATUS_OK)
            return status;
        (*corners)[count++] = surgery->walls[at.wall].vertices[at.edge];
        visited[at.wall] |= (uint8_t)(1 << at.edge);
        if (!next_wall_edge(surgery, &at)) {
            blocked[feature] = 1; /* the feature meets the border of the mesh */
            return STATUS_OK;
        }
    } while (at.wall != first.wall || at.edge != first.edge);
    if (count < 3) {
        blocked[feature] = 1;
        return STATUS_OK;
    }
    return surgery_add_loop(surgery, *corners, count, feature);
}

enum status surgery_loops(struct surgery *surgery, uint8_t *blocked)
{
    struct context *ctx = surgery->ctx;
    uint8_t *visited;
    uint32_t *corners = NULL;
    size_t capacity = 0;
    enum status status = memory_take_zeroed(ctx, surgery->wall_count, 1, &visited);
    for (size_t w = 0; w < surgery->wall_count && status == STATUS_OK; w++)
        for (unsigned k = 0; k < 3 && status == STATUS_OK; k++) {
            uint32_t neighbour = surgery->walls[w].neighbours[k];
            if (neighbour == NO_INDEX || is_dropped(surgery, neighbour) || visited[w] >> k & 1)
                continue;
            status = walk_wall_loop(surgery, (struct wall_edge){w, k}, visited, &corners, &capacity,
                                    blocked);
        }
    memory_release(ctx, &visited, surgery->wall_count, 1);
    memory_release(ctx, &corners, capacity, sizeof *corners);
    return status;
}

/* ---- second sweep: what stays near the loops ---- */

static size_t rim_place(const struct surgery *surgery, uint32_t vertex)
{
    size_t low = 0, high = surgery->rim_count;
    while (high - low > 1) {
        size_t middle = low + (high - low) / 2;
        if (surgery->rim_vertices[middle] <= vertex)
            low = middle;
        else
            high = middle;
    }
    return low;
}

const float *surgery_position(const struct surgery *surgery, uint32_t vertex)
{
    return surgery->rim_positions + 3 * rim_place(surgery, vertex);
}

/* Marks the vertices on loops and lists them in order: a bit map sorts them. */
static enum status list_rim_vertices(struct surgery *surgery)
{
    struct context *ctx = surgery->ctx;
    size_t words = words_of(store_info(surgery->store)->topology.vertices);
    memset(surgery->used, 0, words * sizeof *surgery->used);
    for (size_t i = 0; i < surgery->corner_count; i++)
        bit_set(surgery->used, surgery->corners[i]);
    enum status status = memory_reserve(ctx, &surgery->rim_vertices, &surgery->rim_capacity,
                                        surgery->corner_count, sizeof *surgery->rim_vertices);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &surgery->rim_positions, &surgery->rim_position_capacity,
                                3 * surgery->corner_count, sizeof *surgery->rim_positions);
    if (status != STATUS_OK)
        return status;
    surgery->rim_count = 0;
    for (size_t w = 0; w < words; w++)
        for (uint64_t left = surgery->used[w]; left; left &= left - 1)
            surgery->rim_vertices[surgery->rim_count++] =
                (uint32_t)(64 * w + (size_t)__builtin_ctzll(left));
    return STATUS_OK;
}

static enum status add_small_face(struct surgery *surgery, const uint32_t *face)
{
    enum status status =
        memory_reserve(surgery->ctx, &surgery->small_faces, &surgery->small_face_capacity,
                       3 * (surgery->small_face_count + 1), sizeof *surgery->small_faces);
    if (status == STATUS_OK)
        memcpy(surgery->small_faces + 3 * surgery->small_face_count++, face, 3 * sizeof *face);
    return status;
}

static enum status survey_slab(struct surgery *surgery, const struct slab *slab)
{
    enum status status = STATUS_OK;
    for (size_t i = rim_place(surgery, slab->vertex_first);
         i < surgery->rim_count && surgery->rim_vertices[i] < slab->vertex_end; i++)
        if (surgery->rim_vertices[i] >= slab->vertex_first)
            memcpy(surgery->rim_positions + 3 * i,
                   slab->positions + 3 * (size_t)(surgery->rim_vertices[i] - slab->vertex_first),
                   3 * sizeof(float));
    for (uint32_t f = 0; f < slab->face_count && status == STATUS_OK; f++) {
        const uint32_t *face = slab->faces + 3 * (size_t)f;
        if (bit_is_set(surgery->dropped, slab->face_first + f))
            continue;
        unsigned on = 0;
        for (unsigned k = 0; k < 3; k++)
            on |= (unsigned)bit_is_set(surgery->used, face[k]) << k;
        for (unsigned k = 0; k < 3 && status == STATUS_OK; k++)
            if ((on >> k & 1) && (on >> next3(k) & 1))
                status = pair_set_add(surgery->ctx, &surgery->taken, face[k], face[next3(k)]);
        if (on == 7 && status == STATUS_OK)
            status = add_small_face(surgery, face);
    }
    return status;
}

static enum status survey(struct surgery *surgery)
{
    uint32_t slab_count = store_info(surgery->store)->slab_count;
    enum status status = list_rim_vertices(surgery);
    pair_set_clear(surgery->ctx, &surgery->taken);
    surgery->small_face_count = 0;
    for (uint32_t i = 0; i < slab_count && status == STATUS_OK; i++) {
        struct slab slab;
        status = slab_open(surgery->store, i, &slab);
        if (status != STATUS_OK)
            break;
        status = survey_slab(surgery, &slab);
        slab_close(&slab);
    }
    return status;
}

/* ---- filling ---- */

struct filler {
    struct surgery *surgery;
    const uint32_t *corners; /* of the loop in hand */
    double *points;
    uint32_t *triangles;
    size_t point_capacity, triangle_capacity;
    struct triangulation_workspace workspace;
};

static bool diagonal_is_free(void *user, uint32_t i, uint32_t j)
{
    const struct filler *filler = user;
    uint32_t a = filler->corners[i], b = filler->corners[j];
    return a != b && !pair_set_has(&filler->surgery->taken, a, b);
}

/* A loop of three may be just the outline of a face that stays, seen from behind. */
static bool repeats_face(const struct surgery *surgery, const uint32_t *corners)
{
    for (size_t i = 0; i < surgery->small_face_count; i++) {
        const uint32_t *face = surgery->small_faces + 3 * i;
        unsigned same = 0;
        for (unsigned a = 0; a < 3; a++)
            for (unsigned b = 0; b < 3; b++)
                same += face[a] == corners[b];
        if (same == 3)
            return true;
    }
    return false;
}

/* A corner that comes twice in a row, or between two equal ones, leaves nothing to fill. */
static bool repeats_corner(const uint32_t *corners, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++)
        if (corners[i] == corners[(i + 1) % count] || corners[i] == corners[(i + 2) % count])
            return true;
    return false;
}

static enum status keep_fill(struct filler *filler, uint32_t count)
{
    struct surgery *surgery = filler->surgery;
    size_t faces = count - 2;
    enum status status = memory_reserve(surgery->ctx, &surgery->fills, &surgery->fill_capacity,
                                        3 * (surgery->fill_count + faces), sizeof *surgery->fills);
    for (size_t i = 0; i < 3 * faces && status == STATUS_OK; i++) {
        uint32_t from = filler->triangles[i];
        uint32_t to = filler->triangles[i % 3 == 2 ? i - 2 : i + 1];
        surgery->fills[3 * surgery->fill_count + i] = filler->corners[from];
        status =
            pair_set_add(surgery->ctx, &surgery->taken, filler->corners[from], filler->corners[to]);
    }
    surgery->fill_count += faces;
    return status;
}

/*
 * Do two corners of the filled polygon that are the same vertex meet in one diagonal? The
 * triangulator knows corners only: two diagonals between the same two vertices must be found here.
 */
static enum status fill_is_simple(struct filler *filler, uint32_t count, bool *simple)
{
    struct pair_set seen = {0};
    enum status status = STATUS_OK;
    uint64_t edges = 0;
    for (size_t i = 0; i < 3 * ((size_t)count - 2) && status == STATUS_OK; i++) {
        uint32_t from = filler->triangles[i];
        uint32_t to = filler->triangles[i % 3 == 2 ? i - 2 : i + 1];
        bool is_diagonal = (from + 1) % count != to && (to + 1) % count != from;
        if (is_diagonal && from < to) {
            edges++;
            status = pair_set_add(filler->surgery->ctx, &seen, filler->corners[from],
                                  filler->corners[to]);
        }
    }
    *simple = seen.count == edges;
    pair_set_clear(filler->surgery->ctx, &seen);
    return status;
}

static enum status fill_loop(struct filler *filler, const struct fill_loop *loop, bool *filled)
{
    struct surgery *surgery = filler->surgery;
    struct context *ctx = surgery->ctx;
    uint32_t n = loop->count;
    enum triangulation_quality quality;
    filler->corners = surgery->corners + loop->first;
    *filled = false;
    if (repeats_corner(filler->corners, n) || (n == 3 && repeats_face(surgery, filler->corners)))
        return STATUS_OK;
    enum status status = memory_reserve(ctx, &filler->points, &filler->point_capacity,
                                        3 * (size_t)n, sizeof *filler->points);
    if (status == STATUS_OK)
        status = memory_reserve(ctx, &filler->triangles, &filler->triangle_capacity,
                                3 * ((size_t)n - 2), sizeof *filler->triangles);
    if (status != STATUS_OK)
        return status;
    for (uint32_t i = 0; i < n; i++) {
        const float *at = surgery_position(surgery, filler->corners[i]);
        for (unsigned c = 0; c < 3; c++)
            filler->points[3 * (size_t)i + c] = (double)at[c];
    }
    status = triangulate(ctx, &filler->workspace, filler->points, n, NULL, diagonal_is_free, filler,
                         filler->triangles, &quality);
    if (status != STATUS_OK || quality == TRIANGULATION_BLOCKED)
        return status;
    status = fill_is_simple(filler, n, filled);
    return status == STATUS_OK && *filled ? keep_fill(filler, n) : status;
}

enum status surgery_fill(struct surgery *surgery, uint8_t *blocked)
{
    struct context *ctx = surgery->ctx;
    struct filler filler = {.surgery = surgery};
    surgery->fill_count = 0;
    enum status status = survey(surgery);
    for (size_t i = 0; i < surgery->loop_count && status == STATUS_OK; i++) {
        bool filled = false;
        status = fill_loop(&filler, &surgery->loops[i], &filled);
        if (status == STATUS_OK && !filled)
            blocked[surgery->loops[i].feature] = 1;
    }
    triangulation_workspace_clear(ctx, &filler.workspace);
    memory_release(ctx, &filler.points, filler.point_capacity, sizeof *filler.points);
    memory_release(ctx, &filler.triangles, filler.triangle_capacity, sizeof *filler.triangles);
    return status;
}

/* ---- the result ---- */

static void mark_used(struct surgery *surgery, const struct slab *slab)
{
    for (uint32_t f = 0; f < slab->face_count; f++)
        if (!bit_is_set(surgery->dropped, slab->face_first + f))
            for (unsigned k = 0; k < 3; k++)
                bit_set(surgery->used, slab->faces[3 * (size_t)f + k]);
}

struct writing {
    struct surgery *surgery;
    const struct surgery_sink *sink;
    uint32_t *ranks; /* a word of `used`: vertices before it */
    double positions[3 * BATCH];
    unsigned char *records; /* BATCH */
    uint32_t faces[3 * BATCH];
};

static uint32_t new_number(const struct writing *writing, uint32_t vertex)
{
    uint64_t word = writing->surgery->used[vertex >> 6];
    uint64_t before = word & (((uint64_t)1 << (vertex & 63)) - 1);
    return writing->ranks[vertex >> 6] + (uint32_t)__builtin_popcountll(before);
}

static enum status write_slab_vertices(struct writing *writing, const struct slab *slab)
{
    const struct store_info *info = store_info(writing->surgery->store);
    size_t stride = info->attributes.stride, count = 0;
    enum status status = STATUS_OK;
    for (uint32_t v = slab->vertex_first; v < slab->vertex_end && status == STATUS_OK; v++) {
        if (!bit_is_set(writing->surgery->used, v))
            continue;
        size_t own = v - slab->vertex_first;
        for (unsigned c = 0; c < 3; c++)
            writing->positions[3 * count + c] =
                info->origin[c] + (double)slab->positions[3 * own + c];
        if (stride)
            memcpy(writing->records + count * stride, slab->records + own * stride, stride);
        if (++count == BATCH) {
            status = writing->sink->add_vertices(writing->sink->user, count, writing->positions,
                                                 writing->records);
            count = 0;
        }
    }
    if (status == STATUS_OK && count > 0)
        status = writing->sink->add_vertices(writing->sink->user, count, writing->positions,
                                             writing->records);
    return status;
}

/* Faces [0, count) of the list but those dropped; `dropped_from`: the number of the first one, or
 * NO_INDEX when none can be. */
static enum status write_faces(struct writing *writing, const uint32_t *faces, size_t count,
                               uint32_t dropped_from)
{
    size_t held = 0;
    enum status status = STATUS_OK;
    for (size_t f = 0; f < count && status == STATUS_OK; f++) {
        if (dropped_from != NO_INDEX && bit_is_set(writing->surgery->dropped, dropped_from + f))
            continue;
        for (unsigned k = 0; k < 3; k++)
            writing->faces[3 * held + k] = new_number(writing, faces[3 * f + k]);
        if (++held == BATCH) {
            status = writing->sink->add_faces(writing->sink->user, held, writing->faces);
            held = 0;
        }
    }
    if (status == STATUS_OK && held > 0)
        status = writing->sink->add_faces(writing->sink->user, held, writing->faces);
    return status;
}

enum sweep { SWEEP_MARK, SWEEP_VERTICES, SWEEP_FACES };

static enum status sweep_slabs(struct writing *writing, enum sweep sweep)
{
    struct surgery *surgery = writing->surgery;
    uint32_t slab_count = store_info(surgery->store)->slab_count;
    enum status status = STATUS_OK;
    for (uint32_t i = 0; i < slab_count && status == STATUS_OK; i++) {
        struct slab slab;
        status =
            step(surgery->ctx, "write", i + (uint64_t)sweep * slab_count, 3 * (uint64_t)slab_count);
        if (status == STATUS_OK)
            status = slab_open(surgery->store, i, &slab);
        if (status != STATUS_OK)
            break;
        if (sweep == SWEEP_MARK)
            mark_used(surgery, &slab);
        else if (sweep == SWEEP_VERTICES)
            status = write_slab_vertices(writing, &slab);
        else
            status = write_faces(writing, slab.faces, slab.face_count, slab.face_first);
        slab_close(&slab);
    }
    return status;
}

enum status surgery_write(struct surgery *surgery, const struct surgery_sink *sink)
{
    struct context *ctx = surgery->ctx;
    const struct store_info *info = store_info(surgery->store);
    size_t words = words_of(info->topology.vertices), stride = info->attributes.stride;
    struct writing *writing;
    uint32_t *ranks = NULL, total = 0;
    enum status status = memory_take(ctx, 1, sizeof *writing, &writing);
    if (status != STATUS_OK)
        return status;
    *writing = (struct writing){.surgery = surgery, .sink = sink};
    memset(surgery->used, 0, words * sizeof *surgery->used);
    status = sweep_slabs(writing, SWEEP_MARK);
    for (size_t i = 0; i < 3 * surgery->fill_count; i++)
        bit_set(surgery->used, surgery->fills[i]);
    if (status == STATUS_OK)
        status = memory_take(ctx, words, sizeof *ranks, &ranks);
    if (status == STATUS_OK && stride)
        status = memory_take(ctx, BATCH, stride, &writing->records);
    if (status != STATUS_OK)
        goto done;
    for (size_t w = 0; w < words; w++) {
        ranks[w] = total;
        total += (uint32_t)__builtin_popcountll(surgery->used[w]);
    }
    writing->ranks = ranks;
    status = sink->begin(sink->user, total,
                         info->topology.faces - surgery->dropped_count + surgery->fill_count);
    if (status == STATUS_OK)
        status = sweep_slabs(writing, SWEEP_VERTICES);
    if (status == STATUS_OK)
        status = sweep_slabs(writing, SWEEP_FACES);
    if (status == STATUS_OK)
        status = write_faces(writing, surgery->fills, surgery->fill_count, NO_INDEX);
done:
    memory_release(ctx, &ranks, words, sizeof *ranks);
    memory_release(ctx, &writing->records, stride ? BATCH : 0, stride);
    memory_release(ctx, &writing, 1, sizeof *writing);
    return status;
}
