/*
 * Patches are grown face by face, breadth first, from a seed: section 4.2.2 of the dissertation
 * tells what to do by the number of free neighbours of the face at hand, section 4.2.3 which face
 * may be added.
 *
 * What must hold after every step: the patch P is a disk and its boundary, a single loop, passes no
 * vertex twice. Adding a free face F that shares edges with P keeps this in two cases only:
 *   - one shared edge, and F's third vertex (its apex) is not in P: the boundary grows by one edge;
 *   - two shared edges: the boundary passes their common vertex once, so they follow each other on
 *     it, and F turns the two into one. The boundary had more than three edges before, else two
 *     edges with the same ends would be left.
 * With one shared edge and the apex in P the boundary would pass the apex twice (the paper's pinch
 * test (a)); with three shared edges F is all that is left of a closed surface. The argument uses
 * no property of the mesh round a vertex, so it holds at mesh borders and at the slab's border,
 * too.
 *
 * Faces are taken away in one place only: the face T at hand has two free neighbours of which one
 * is infeasible. Then T shares one edge with the rest of P: a face that has been expanded stays for
 * good, and T's parent has been. No other face of P touches T's apex, for it could have come only
 * over one of T's two edges there, which are free. So taking T away and unmarking its apex gives
 * back a patch that was allowed before. Each face is added by one that stays, over one of its
 * edges, so all this ends, in linear time. The seed is never taken away: with two free neighbours
 * it adds those that are feasible.
 *
 * Seeds by the plain reading of the paper (some neighbour of the last patch, first in first out)
 * run round the whole surface; here the front stays where the store's order is: the lowest face
 * beside a finished patch comes next.
 *
 * On scans patches have ten faces or so, and what a processor guesses wrong costs more than all
 * arithmetic, and so does memory that is waited for: the neighbours of a face are asked for when it
 * joins the queue. So vertices are marked with the patch's number, which needs no unmarking; what
 * is beyond the slab has labels and normals like any face; and where a test would be a coin's toss,
 * both outcomes are computed or written, and one is kept.
 */
#include "simplify/patchify.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "simplify/face_normals.h"
#include "simplify/float4.h"

/* Every face of a patch adds at most two others, the seed three, and each is added by one that
 * stays. */
enum { QUEUE_SIZE = 3 * PATCH_FACES_MAX + 4 };

/* Edges that so many faces can have, whatever the adjacency says, and a place that is written but
 * not kept. */
enum { BOUNDARY_SIZE = 3 * PATCH_FACES_MAX + 1 };

struct queued {
    uint32_t face;
    uint32_t apex; /* the vertex that came in with it; NO_INDEX: none */
};

/* ---- one patch ---- */

/* A patch while it is grown: what every face asks for and changes, in a place of its own that
 * stores through the slab's arrays can't change, so that it stays in registers. */
struct sprout {
    uint32_t *faces; /* these are growth's */
    const uint32_t *links;
    const float *normals;
    uint32_t *marks;
    struct queued *queue;
    const struct growth_bounds *bounds;
    uint32_t most_faces;
    uint32_t patch;
    uint32_t size;     /* faces */
    uint32_t boundary; /* edges of its loop */
    uint32_t tail;     /* of the queue */
    float4 sum;        /* of the normals, weighted by area */
    float length;      /* of it */
    double area;
};

static inline uint32_t label_of(const struct sprout *sprout, uint32_t link)
{
    return sprout->faces[link | LABEL];
}

static inline bool is_free(const struct sprout *sprout, uint32_t link)
{
    return label_of(sprout, link) == NO_PATCH;
}

/* Edges that the face behind `link` shares with the patch. */
static inline unsigned shared_edges(const struct sprout *sprout, uint32_t link)
{
    const uint32_t *links = sprout->links + (link & ~3u);
    const uint32_t patch = sprout->patch;
    return (unsigned)(label_of(sprout, links[0]) == patch) + (label_of(sprout, links[1]) == patch) +
           (label_of(sprout, links[2]) == patch);
}

/*
 * Whether adding the free face behind `link` leaves a disk with a simple boundary: test (a) and
 * what the head of this file adds to it. *shared: the edges that it shares with the patch. With a
 * new apex that is the one it is reached over, and its other neighbours need not be looked at.
 */
static inline bool keeps_disk(const struct sprout *sprout, uint32_t link, unsigned *shared)
{
    *shared = 1;
    if (sprout->marks[sprout->faces[link]] != sprout->patch)
        return true;
    *shared = shared_edges(sprout, link);
    return *shared == 2 && sprout->boundary > 3;
}

/* Test (b): the normals of face and neighbour, and of face and patch. */
static inline bool fits(const struct sprout *sprout, float4 neighbour, uint32_t link,
                        unsigned shared)
{
    const struct growth_bounds *bounds = &sprout->bounds[shared == 2];
    float4 normal = float4_load(sprout->normals + (link & ~3u));
    float4 dots = float4_dots(normal, neighbour, normal, sprout->sum);
    return (dots[0] >= bounds->face) & (dots[1] >= bounds->patch * sprout->length);
}

static inline bool is_feasible(const struct sprout *sprout, float4 neighbour, uint32_t link,
                               unsigned *shared)
{
    return keeps_disk(sprout, link, shared) && fits(sprout, neighbour, link, *shared);
}

static inline float4 normal_of(const struct sprout *sprout, uint32_t face)
{
    return float4_load(sprout->normals + NORMAL_STRIDE * (size_t)face);
}

static inline void add_weighted(struct sprout *sprout, uint32_t face, float sign)
{
    float4 normal = normal_of(sprout, face);
    float weight = sign * normal[3];
    sprout->sum += weight * normal;
    sprout->length = sqrtf(float4_sum3(sprout->sum * sprout->sum));
    sprout->area += weight;
}

/* Asks memory for what a face of the patch will be expanded by. */
static inline void expect(const struct sprout *sprout, uint32_t face)
{
    const uint32_t *links = sprout->links + FACE_STRIDE * (size_t)face;
    for (unsigned k = 0; k < 3; k++) {
        __builtin_prefetch(sprout->faces + (links[k] & ~3u));
        __builtin_prefetch(sprout->normals + (links[k] & ~3u));
    }
}

/* Adds a face that keeps the disk and shares that many edges with it. */
static inline void add(struct sprout *sprout, uint32_t link, unsigned shared)
{
    uint32_t apex = sprout->faces[link];
    expect(sprout, link >> 2);
    sprout->marks[apex] = sprout->patch; /* it is, if two edges are shared */
    sprout->boundary += shared == 1 ? 1 : -1u;
    sprout->faces[link | LABEL] = sprout->patch;
    sprout->queue[sprout->tail++] = (struct queued){link >> 2, shared == 1 ? apex : NO_INDEX};
    sprout->size++;
    add_weighted(sprout, link >> 2, 1);
}

/* The reverse of add, but for the queue. */
static inline void take_away(struct sprout *sprout, uint32_t link, unsigned shared)
{
    if (shared == 1) {
        sprout->marks[sprout->faces[link]] = NO_PATCH;
        sprout->boundary--;
    } else {
        sprout->boundary++;
    }
    sprout->faces[link | LABEL] = NO_PATCH;
    sprout->size--;
    add_weighted(sprout, link >> 2, -1);
}

/*
 * Both free neighbours of the queue's entry `head` are added, or it is taken away itself; `shared`
 * is its edge to the rest of the patch. The second neighbour is looked at again once the first is
 * in: with the same apex it either shares two edges now and closes the ring round a vertex, which
 * is fine, or three, or one and would pinch.
 */
static inline void expand_two(struct sprout *sprout, uint32_t head, unsigned shared)
{
    uint32_t face = sprout->queue[head].face;
    uint32_t one = sprout->links[FACE_STRIDE * (size_t)face + next3(shared)];
    uint32_t two = sprout->links[FACE_STRIDE * (size_t)face + previous3(shared)];
    float4 normal = normal_of(sprout, face);
    unsigned shared_one, shared_two;
    if (is_feasible(sprout, normal, one, &shared_one) &&
        is_feasible(sprout, normal, two, &shared_two)) {
        add(sprout, one, shared_one);
        if (keeps_disk(sprout, two, &shared_two)) {
            add(sprout, two, shared_two);
            return;
        }
        take_away(sprout, one, shared_one);
        sprout->tail--;
    }
    take_away(sprout, face << 2 | shared, 1);
    sprout->queue[head] = (struct queued){NO_INDEX, NO_INDEX};
}

/* Adds what is feasible of the neighbours of `face`, one by one. */
static inline void expand_each(struct sprout *sprout, uint32_t face)
{
    float4 normal = normal_of(sprout, face);
    for (unsigned k = 0; k < 3; k++) {
        uint32_t link = sprout->links[FACE_STRIDE * (size_t)face + k];
        unsigned shared;
        if (is_free(sprout, link) && sprout->size < sprout->most_faces &&
            is_feasible(sprout, normal, link, &shared))
            add(sprout, link, shared);
    }
}

static struct sprout plant(const struct growth *growth, uint32_t seed)
{
    const uint32_t *vertices = growth->faces + FACE_STRIDE * (size_t)seed;
    struct sprout sprout = {.faces = growth->faces,
                            .links = growth->links,
                            .normals = growth->normals,
                            .marks = growth->marks,
                            .queue = growth->queue,
                            .bounds = growth->bounds,
                            .most_faces = growth->most_faces,
                            .patch = growth->patch,
                            .size = 1,
                            .boundary = 3,
                            .tail = 1};
    sprout.queue[0] = (struct queued){seed, NO_INDEX};
    sprout.faces[FACE_STRIDE * (size_t)seed + LABEL] = sprout.patch;
    add_weighted(&sprout, seed, 1);
    for (unsigned k = 0; k < 3; k++)
        sprout.marks[vertices[k]] = sprout.patch;
    return sprout;
}

/* Returns the length of the queue; *area: of the patch. */
static uint32_t grow_from(const struct growth *growth, uint32_t seed, double *area)
{
    struct sprout sprout = plant(growth, seed);
    expand_each(&sprout, seed);
    for (uint32_t head = 1; head < sprout.tail && sprout.size < sprout.most_faces; head++) {
        uint32_t face = sprout.queue[head].face;
        const uint32_t *links = sprout.links + FACE_STRIDE * (size_t)face;
        unsigned free = (unsigned)is_free(&sprout, links[0]) | is_free(&sprout, links[1]) << 1 |
                        is_free(&sprout, links[2]) << 2;
        if (free == 0)
            continue;
        if ((free & (free - 1)) == 0) {
            unsigned shared;
            uint32_t link = links[free >> 1];
            if (is_feasible(&sprout, normal_of(&sprout, face), link, &shared))
                add(&sprout, link, shared);
        } else if (sprout.size + 2 <= sprout.most_faces) {
            expand_two(&sprout, head, free == 6 ? 0 : free == 5 ? 1 : 2);
        }
    }
    *area = sprout.area;
    return sprout.tail;
}

/* Asks memory for what a boundary will be followed and traced by. */
static inline void expect_vertex(const struct patch_workspace *space, uint32_t vertex)
{
    const struct slab_local *local = &space->local;
    __builtin_prefetch(local->positions + 3 * (size_t)vertex);
    __builtin_prefetch(space->vertex_room + vertex);
    __builtin_prefetch(space->vertex_room + (size_t)local->vertex_count + vertex);
}

/* Ends the patch: gathers it from the queue, and the free faces beside it become candidates. */
static void gather(struct patch_workspace *space, uint32_t tail, struct grown_patch *patch)
{
    struct growth *growth = &space->growth;
    const struct queued *queue = growth->queue;
    const uint32_t number = growth->patch;
    uint32_t *faces = space->lists, *vertices = faces + QUEUE_SIZE, face_count = 0;
    struct boundary_edge *boundary = space->boundary;
    uint32_t vertex_count = 3, edge_count = 0;
    memcpy(vertices, growth->faces + FACE_STRIDE * (size_t)queue[0].face, 3 * sizeof *vertices);
    for (uint32_t i = 0; i < tail; i++) {
        faces[face_count] = queue[i].face;
        face_count += queue[i].face != NO_INDEX;
        vertices[vertex_count] = queue[i].apex;
        vertex_count += queue[i].apex != NO_INDEX;
    }
    for (uint32_t i = 0; i < face_count; i++) {
        const uint32_t *apex = growth->faces + FACE_STRIDE * (size_t)faces[i];
        const uint32_t *links = growth->links + FACE_STRIDE * (size_t)faces[i];
        for (unsigned k = 0; k < 3; k++) {
            uint32_t over = growth->faces[links[k] | LABEL];
            boundary[edge_count] =
                (struct boundary_edge){apex[next3(k)], apex[previous3(k)], over, links[k]};
            edge_count += over != number;
        }
    }
    for (uint32_t i = 0; i < edge_count; i++) {
        bit_tree_set_if(&growth->candidates, boundary[i].link >> 2, boundary[i].over == NO_PATCH);
        expect_vertex(space, boundary[i].start);
    }
    *patch = (struct grown_patch){.number = number,
                                  .face_count = face_count,
                                  .vertex_count = vertex_count,
                                  .edge_count = edge_count,
                                  .faces = faces,
                                  .vertices = vertices,
                                  .boundary = boundary};
}

/* ---- a slab ---- */

/* The lowest free face beside a finished patch, else the lowest free one; NO_INDEX at the end.
 * Candidates that are free no more are found out here. */
static uint32_t next_seed(struct growth *growth)
{
    uint32_t seed;
    while (bit_tree_lowest(&growth->candidates, &seed)) {
        if (growth->faces[FACE_STRIDE * (size_t)seed + LABEL] == NO_PATCH)
            return seed;
        bit_tree_clear(&growth->candidates, seed);
    }
    while (growth->lowest < growth->face_count &&
           growth->faces[FACE_STRIDE * (size_t)growth->lowest + LABEL] != NO_PATCH)
        growth->lowest++;
    return growth->lowest < growth->face_count ? growth->lowest : NO_INDEX;
}

bool patch_growth_next(struct patch_workspace *space, struct grown_patch *patch)
{
    uint32_t seed = next_seed(&space->growth);
    if (seed == NO_INDEX)
        return false;
    double area;
    const uint32_t tail = grow_from(&space->growth, seed, &area);
    gather(space, tail, patch);
    patch->area = area * space->growth.area_factor;
    space->growth.patch++;
    return true;
}

static void set_options(struct growth *growth, const struct patch_options *options)
{
    for (unsigned i = 0; i < 2; i++) {
        growth->bounds[i].face = (float)options->face_cosine[i];
        growth->bounds[i].patch = (float)options->patch_cosine[i];
    }
    growth->most_faces = options->most_faces;
    if (growth->most_faces == 0 || growth->most_faces > PATCH_FACES_MAX)
        growth->most_faces = PATCH_FACES_MAX;
}

/* Makes room for a slab of so many faces and vertices, and its bytes. */
static enum status reserve(struct context *ctx, struct patch_workspace *space, size_t faces,
                           size_t vertices, size_t slab_bytes)
{
    faces += BEYOND_COUNT;
    size_t half = NORMAL_STRIDE * sizeof(float) * faces; /* all parts on multiples of 16 */
    if (half < 3 * sizeof(uint32_t) * vertices)
        half = 4 * sizeof(uint32_t) * vertices;
    const size_t links_at = 2 * half < slab_bytes ? (slab_bytes + 15) / 16 * 16 : 2 * half;
    const size_t bytes = links_at + FACE_STRIDE * sizeof(uint32_t) * faces;
    enum status status = STATUS_OK;
    if (bytes > space->room_capacity) {
        memory_release(ctx, &space->room, space->room_capacity, 1);
        space->room_capacity = 0;
        status = memory_take(ctx, bytes, 1, &space->room);
        space->room_capacity = status ? 0 : bytes;
        if (!status)
            memory_use_whole(space->room, bytes, 1);
    }
    if (!status)
        status = memory_reserve(ctx, &space->candidates, &space->candidate_capacity,
                                bit_tree_words(faces), sizeof *space->candidates);
    if (!status && !space->queue)
        status = memory_take(ctx, QUEUE_SIZE, sizeof *space->queue, &space->queue);
    if (!status && !space->lists) /* as many vertices as faces, and the seed's other two */
        status = memory_take(ctx, 2 * QUEUE_SIZE + 3, sizeof *space->lists, &space->lists);
    if (!status && !space->boundary)
        status = memory_take(ctx, BOUNDARY_SIZE, sizeof *space->boundary, &space->boundary);
    if (!status) {
        space->spare = (float *)(void *)space->room;
        space->normals = (float *)(void *)(space->room + half);
        space->links = (uint32_t *)(void *)(space->room + links_at);
    }
    return status;
}

void patch_workspace_clear(struct context *ctx, struct patch_workspace *space)
{
    memory_release(ctx, &space->room, space->room_capacity, 1);
    memory_release(ctx, &space->candidates, space->candidate_capacity, sizeof *space->candidates);
    memory_release(ctx, &space->queue, QUEUE_SIZE, sizeof *space->queue);
    memory_release(ctx, &space->lists, 2 * QUEUE_SIZE + 3, sizeof *space->lists);
    memory_release(ctx, &space->boundary, BOUNDARY_SIZE, sizeof *space->boundary);
    slab_local_clear(ctx, &space->local);
    memset(space, 0, sizeof *space);
}

static void begin(struct patch_workspace *space, const struct patch_options *options,
                  double area_factor)
{
    const struct slab_local *local = &space->local;
    uint32_t *marks = (uint32_t *)(void *)space->spare;
    memset(marks, 0xff, local->vertex_count * sizeof *marks);
    space->vertex_room = marks + local->vertex_count;
    space->rest = space->vertex_room + 2 * (size_t)local->vertex_count;
    space->rest_size = (size_t)((unsigned char *)space->normals - (unsigned char *)space->rest);
    local->faces[link_beyond(local, BEYOND_BORDER) | LABEL] = OVER_BORDER;
    local->faces[link_beyond(local, BEYOND_SEAM) | LABEL] = OVER_SEAM;
    space->growth = (struct growth){.faces = local->faces,
                                    .links = local->links,
                                    .normals = space->normals,
                                    .marks = marks,
                                    .queue = space->queue,
                                    .face_count = local->face_count,
                                    .area_factor = area_factor};
    set_options(&space->growth, options);
    bit_tree_init(&space->growth.candidates, space->candidates,
                  (size_t)local->face_count + BEYOND_COUNT);
}

/* All that comes after filling the local slab. */
static void begin_growth(struct context *ctx, const struct patch_options *options,
                         struct patch_workspace *space)
{
    if (options->smoothings % 2) { /* each swaps them; the normals are to be behind the spare */
        float *swap = space->normals;
        space->normals = space->spare;
        space->spare = swap;
    }
    begin(space, options,
          face_normals_fill(cpu_level(ctx), &space->local, options->smoothings, &space->normals,
                            &space->spare));
}

enum status patch_growth_begin(struct context *ctx, const struct slab *slab,
                               const struct patch_options *options, struct patch_workspace *space)
{
    const size_t own = slab->vertex_end - slab->vertex_first;
    enum status status = reserve(ctx, space, slab->face_count, own + slab->foreign_count, 0);
    if (!status)
        status = slab_local_fill(ctx, slab, space->links, &space->local);
    if (!status)
        begin_growth(ctx, options, space);
    return status;
}

enum status patch_growth_open(struct context *ctx, struct store *store, uint32_t index,
                              const struct patch_options *options, struct patch_workspace *space,
                              struct slab *slab)
{
    const bool has_records =
        store_info(store)->attributes.stride; /* they are asked for to the end */
    enum status status = STATUS_OK;
    uint32_t faces, vertices;
    const uint64_t size = slab_size(store, index, &faces, &vertices);
    memset(slab, 0, sizeof *slab);
    if (has_records)
        status = slab_open(store, index, slab);
    if (!status)
        status = reserve(ctx, space, faces, vertices, has_records ? 0 : (size_t)size);
    if (!status && !has_records)
        status = slab_read(store, index, space->room, slab);
    if (!status)
        status = slab_local_fill(ctx, slab, space->links, &space->local);
    slab_forget(store, index);
    if (!status)
        begin_growth(ctx, options, space);
    slab->faces = slab->neighbours = slab->foreign = NULL;
    slab->positions = slab->foreign_positions = NULL;
    slab->mates = NULL;
    return status;
}

void patch_growth_again(struct patch_workspace *space, const struct patch_options *options)
{
    for (size_t f = 0; f < space->local.face_count; f++)
        space->local.faces[FACE_STRIDE * f + LABEL] = NO_PATCH;
    begin(space, options, space->growth.area_factor);
}

enum status patch_grow(struct context *ctx, const struct slab *slab,
                       const struct patch_options *options, struct patch_workspace *space,
                       uint32_t *labels, uint32_t *patch_count)
{
    struct grown_patch patch;
    enum status status = patch_growth_begin(ctx, slab, options, space);
    if (status)
        return status;
    *patch_count = 0;
    while (patch_growth_next(space, &patch))
        ++*patch_count;
    for (size_t f = 0; f < slab->face_count; f++)
        labels[f] = space->local.faces[FACE_STRIDE * f + LABEL];
    return STATUS_OK;
}

enum status patch_labels(struct context *ctx, const struct slab *slab,
                         const struct patch_options *options, uint32_t *labels,
                         uint32_t *patch_count)
{
    struct patch_workspace space = {0};
    enum status status = patch_grow(ctx, slab, options, &space, labels, patch_count);
    patch_workspace_clear(ctx, &space);
    return status;
}
