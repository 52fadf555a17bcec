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
 * run round the whole surface; here the front stays where the store's order is, by a tree of
 * bitmaps that gives the lowest candidate in constant time.
 */
#include "simplify/patchify.h"

#include <string.h>

#include "base/memory.h"
#include "simplify/face_normals.h"

/* Every face of a patch adds at most two others, the seed three, and each is added by one that
 * stays. */
enum { QUEUE_SIZE = 3 * PATCH_FACES_MAX + 4 };

/* ---- the lowest set bit of many: bitmaps of 64-fold branching ---- */

enum { BIT_LEVELS_MAX = 6 };

struct bit_tree {
    uint64_t *levels[BIT_LEVELS_MAX]; /* bit i of level n + 1: word i of level n is not zero */
    unsigned depth;
};

static size_t words_for(size_t bits)
{
    return bits / 64 + 1;
}

/* Words of the whole tree. */
static size_t bit_tree_words(size_t bits)
{
    size_t words = words_for(bits), sum = words;
    while (words > 1) {
        words = words_for(words - 1);
        sum += words;
    }
    return sum;
}

static void bit_tree_init(struct bit_tree *tree, uint64_t *memory, size_t bits)
{
    memset(memory, 0, bit_tree_words(bits) * sizeof *memory);
    size_t words = words_for(bits);
    tree->levels[0] = memory;
    tree->depth = 1;
    while (words > 1) {
        memory += words;
        tree->levels[tree->depth++] = memory;
        words = words_for(words - 1);
    }
}

static inline void bit_tree_set(struct bit_tree *tree, uint32_t bit)
{
    for (unsigned level = 0; level < tree->depth; level++) {
        uint64_t *word = tree->levels[level] + bit / 64;
        uint64_t before = *word;
        *word = before | (uint64_t)1 << bit % 64;
        if (before)
            return;
        bit /= 64;
    }
}

static inline void bit_tree_clear(struct bit_tree *tree, uint32_t bit)
{
    for (unsigned level = 0; level < tree->depth; level++) {
        uint64_t *word = tree->levels[level] + bit / 64;
        uint64_t mask = (uint64_t)1 << bit % 64;
        if (!(*word & mask))
            return;
        *word &= ~mask;
        if (*word)
            return;
        bit /= 64;
    }
}

/* False when no bit is set. */
static inline bool bit_tree_lowest(const struct bit_tree *tree, uint32_t *bit)
{
    uint32_t index = 0;
    if (!tree->levels[tree->depth - 1][0])
        return false;
    for (unsigned level = tree->depth; level-- > 0;)
        index = 64 * index + (uint32_t)__builtin_ctzll(tree->levels[level][index]);
    *bit = index;
    return true;
}

/* ---- one patch ---- */

struct growth {
    const uint32_t *corners;
    const uint32_t *links;
    const float *normals;
    uint32_t *labels; /* NO_PATCH: free */
    uint32_t *queue;
    uint64_t *marked;
    struct bit_tree candidates;
    uint32_t face_count;
    uint32_t most_faces;
    float face_cosine[2];
    double patch_cosine[2];
    double patch_cosine_squared[2];

    /* the patch being grown */
    uint32_t patch;
    uint32_t size;     /* faces */
    uint32_t boundary; /* edges of its loop */
    uint32_t tail;     /* of the queue */
    double sum[3];     /* of its faces' normals, weighted by area */
};

static inline bool is_free(const struct growth *growth, uint32_t link)
{
    return link_is_face(link) && growth->labels[link >> 2] == NO_PATCH;
}

static inline bool is_marked(const struct growth *growth, uint32_t vertex)
{
    return growth->marked[vertex / 64] >> vertex % 64 & 1;
}

static inline void mark(struct growth *growth, uint32_t vertex)
{
    growth->marked[vertex / 64] |= (uint64_t)1 << vertex % 64;
}

static inline void unmark(struct growth *growth, uint32_t vertex)
{
    growth->marked[vertex / 64] &= ~((uint64_t)1 << vertex % 64);
}

/* The vertex of the face behind `link` that lies opposite the shared edge. */
static inline uint32_t apex_of(const struct growth *growth, uint32_t link)
{
    return growth->corners[3 * (size_t)(link >> 2) + previous3(link & 3)];
}

/* Edges that the face behind `link` shares with the patch besides the one it is reached over. */
static inline unsigned further_edges(const struct growth *growth, uint32_t link)
{
    const uint32_t *links = growth->links + 3 * (size_t)(link >> 2);
    uint32_t one = links[next3(link & 3)], other = links[previous3(link & 3)];
    return (link_is_face(one) && growth->labels[one >> 2] == growth->patch) +
           (link_is_face(other) && growth->labels[other >> 2] == growth->patch);
}

/* Whether adding the free face behind `link`, with that many further shared edges, leaves a disk
 * with a simple boundary: test (a) and what the head of this file adds to it. */
static inline bool keeps_disk(const struct growth *growth, uint32_t link, unsigned further)
{
    if (further == 0)
        return !is_marked(growth, apex_of(growth, link));
    return further == 1 && growth->boundary > 3;
}

/* Test (b): the normals of face and patch, and of face and neighbour, without roots: the sum of the
 * patch is compared unnormalised, by squares with their sign. */
static inline bool fits(const struct growth *growth, uint32_t from, uint32_t link, unsigned further)
{
    const float *normal = growth->normals + NORMAL_STRIDE * (size_t)(link >> 2);
    const float *neighbour = growth->normals + NORMAL_STRIDE * (size_t)from;
    float face_dot = normal[0] * neighbour[0] + normal[1] * neighbour[1] + normal[2] * neighbour[2];
    if (!(face_dot >= growth->face_cosine[further]))
        return false;

    const double *sum = growth->sum;
    double dot = normal[0] * sum[0] + normal[1] * sum[1] + normal[2] * sum[2];
    double length2 = sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2];
    double bound = growth->patch_cosine_squared[further] * length2;
    if (growth->patch_cosine[further] >= 0)
        return dot >= 0 && dot * dot >= bound;
    return dot >= 0 || dot * dot <= bound;
}

/* *further is set in any case. */
static inline bool is_feasible(const struct growth *growth, uint32_t from, uint32_t link,
                               unsigned *further)
{
    *further = further_edges(growth, link);
    return keeps_disk(growth, link, *further) && fits(growth, from, link, *further);
}

static inline void add_weighted(struct growth *growth, uint32_t face, double sign)
{
    const float *normal = growth->normals + NORMAL_STRIDE * (size_t)face;
    double weight = sign * normal[3];
    for (unsigned c = 0; c < 3; c++)
        growth->sum[c] += weight * normal[c];
}

/* Adds a face that keeps the disk and shares `further` edges with it besides the one of `link`. */
static inline void add(struct growth *growth, uint32_t link, unsigned further)
{
    uint32_t face = link >> 2;
    if (further == 0) {
        mark(growth, apex_of(growth, link));
        growth->boundary++;
    } else {
        growth->boundary--;
    }
    growth->labels[face] = growth->patch;
    growth->queue[growth->tail++] = face;
    growth->size++;
    add_weighted(growth, face, 1);
}

/* Undoes add() for a face that shares the same edges with the patch as then. */
static inline void take_away(struct growth *growth, uint32_t link, unsigned further)
{
    uint32_t face = link >> 2;
    if (further == 0) {
        unmark(growth, apex_of(growth, link));
        growth->boundary--;
    } else {
        growth->boundary++;
    }
    growth->labels[face] = NO_PATCH;
    growth->size--;
    add_weighted(growth, face, -1);
}

/*
 * Both free neighbours of `face` are added, or it is taken away itself; `shared` is its edge to the
 * rest of the patch. The second neighbour is looked at again once the first is in: with the same
 * apex it either shares two edges now and closes the ring round a vertex, which is fine, or three,
 * or one and would pinch.
 */
static inline void expand_two(struct growth *growth, uint32_t face, unsigned shared)
{
    uint32_t one = growth->links[3 * (size_t)face + next3(shared)];
    uint32_t two = growth->links[3 * (size_t)face + previous3(shared)];
    unsigned further_one, further_two;
    if (is_feasible(growth, face, one, &further_one) &&
        is_feasible(growth, face, two, &further_two)) {
        add(growth, one, further_one);
        further_two = further_edges(growth, two);
        if (keeps_disk(growth, two, further_two)) {
            add(growth, two, further_two);
            return;
        }
        take_away(growth, one, further_one);
        growth->tail--;
    }
    take_away(growth, face << 2 | shared, 0);
}

/* Adds what is feasible of the neighbours of `face`, one by one. */
static inline void expand_each(struct growth *growth, uint32_t face)
{
    for (unsigned k = 0; k < 3; k++) {
        uint32_t link = growth->links[3 * (size_t)face + k];
        unsigned further;
        if (is_free(growth, link) && growth->size < growth->most_faces &&
            is_feasible(growth, face, link, &further))
            add(growth, link, further);
    }
}

static void grow_patch(struct growth *growth, uint32_t seed)
{
    const uint32_t *corner = growth->corners + 3 * (size_t)seed;
    growth->size = 1;
    growth->boundary = 3;
    growth->tail = 0;
    growth->queue[growth->tail++] = seed;
    growth->labels[seed] = growth->patch;
    memset(growth->sum, 0, sizeof growth->sum);
    add_weighted(growth, seed, 1);
    for (unsigned k = 0; k < 3; k++)
        mark(growth, corner[k]);

    expand_each(growth, seed);
    for (uint32_t head = 1; head < growth->tail && growth->size < growth->most_faces; head++) {
        uint32_t face = growth->queue[head];
        const uint32_t *links = growth->links + 3 * (size_t)face;
        bool free[3];
        for (unsigned k = 0; k < 3; k++)
            free[k] = is_free(growth, links[k]);
        unsigned count = (unsigned)free[0] + free[1] + free[2];
        if (count == 0)
            continue;
        unsigned shared = !free[0] ? 0 : !free[1] ? 1 : 2;
        if (count == 1)
            expand_each(growth, face);
        else if (growth->size + 2 <= growth->most_faces)
            expand_two(growth, face, shared);
    }
}

/* Ends the patch: its vertices are unmarked, its faces are candidates no more, the free faces
 * beside it are. */
static void finish_patch(struct growth *growth)
{
    for (uint32_t i = 0; i < growth->tail; i++) {
        uint32_t face = growth->queue[i];
        const uint32_t *corner = growth->corners + 3 * (size_t)face;
        const uint32_t *links = growth->links + 3 * (size_t)face;
        for (unsigned k = 0; k < 3; k++)
            unmark(growth, corner[k]);
        if (growth->labels[face] != growth->patch)
            continue;
        bit_tree_clear(&growth->candidates, face);
        for (unsigned k = 0; k < 3; k++)
            if (is_free(growth, links[k]))
                bit_tree_set(&growth->candidates, links[k] >> 2);
    }
}

/* ---- a slab ---- */

/* The lowest free face beside a finished patch, else the lowest free one; NO_INDEX at the end. Free
 * faces only become fewer from patch to patch, so `*lowest` only moves up. */
static uint32_t next_seed(const struct growth *growth, uint32_t *lowest)
{
    uint32_t seed;
    if (bit_tree_lowest(&growth->candidates, &seed))
        return seed;
    while (*lowest < growth->face_count && growth->labels[*lowest] != NO_PATCH)
        ++*lowest;
    return *lowest < growth->face_count ? *lowest : NO_INDEX;
}

static void set_options(struct growth *growth, const struct patch_options *options)
{
    for (unsigned i = 0; i < 2; i++) {
        growth->face_cosine[i] = (float)options->face_cosine[i];
        growth->patch_cosine[i] = options->patch_cosine[i];
        growth->patch_cosine_squared[i] = options->patch_cosine[i] * options->patch_cosine[i];
    }
    growth->most_faces = options->most_faces;
    if (growth->most_faces == 0 || growth->most_faces > PATCH_FACES_MAX)
        growth->most_faces = PATCH_FACES_MAX;
}

static void release_arrays(struct context *ctx, struct patch_workspace *space)
{
    size_t faces = space->face_capacity;
    memory_release(ctx, &space->normals, faces, NORMAL_STRIDE * sizeof(float));
    memory_release(ctx, &space->spare, faces, NORMAL_STRIDE * sizeof(float));
    memory_release(ctx, &space->candidates, bit_tree_words(faces), sizeof(uint64_t));
    memory_release(ctx, &space->queue, faces + QUEUE_SIZE, sizeof(uint32_t));
    memory_release(ctx, &space->marked, words_for(space->vertex_capacity), sizeof(uint64_t));
    space->face_capacity = space->vertex_capacity = 0;
}

static enum status reserve(struct context *ctx, struct patch_workspace *space)
{
    size_t faces = space->local.face_count, vertices = space->local.vertex_count;
    if (faces <= space->face_capacity && vertices <= space->vertex_capacity && space->queue)
        return STATUS_OK;
    if (faces < space->face_capacity)
        faces = space->face_capacity;
    if (vertices < space->vertex_capacity)
        vertices = space->vertex_capacity;
    release_arrays(ctx, space);
    space->face_capacity = faces;
    space->vertex_capacity = vertices;
    enum status status = memory_take(ctx, faces, NORMAL_STRIDE * sizeof(float), &space->normals);
    if (!status)
        status = memory_take(ctx, faces, NORMAL_STRIDE * sizeof(float), &space->spare);
    if (!status)
        status = memory_take(ctx, bit_tree_words(faces), sizeof(uint64_t), &space->candidates);
    if (!status)
        status = memory_take(ctx, faces + QUEUE_SIZE, sizeof(uint32_t), &space->queue);
    if (!status)
        status = memory_take(ctx, words_for(vertices), sizeof(uint64_t), &space->marked);
    if (status)
        release_arrays(ctx, space);
    return status;
}

void patch_workspace_clear(struct context *ctx, struct patch_workspace *space)
{
    release_arrays(ctx, space);
    slab_local_clear(ctx, &space->local);
}

enum status patch_grow(struct context *ctx, const struct slab *slab,
                       const struct patch_options *options, struct patch_workspace *space,
                       uint32_t *labels, uint32_t *patch_count)
{
    enum status status = slab_local_fill(ctx, slab, &space->local);
    if (!status)
        status = reserve(ctx, space);
    if (status)
        return status;
    face_normals_fill(&space->local, options->smoothings, &space->normals, &space->spare,
                      space->queue);

    struct growth growth = {.corners = space->local.corners,
                            .links = space->local.links,
                            .normals = space->normals,
                            .labels = labels,
                            .queue = space->queue,
                            .marked = space->marked,
                            .face_count = slab->face_count};
    set_options(&growth, options);
    bit_tree_init(&growth.candidates, space->candidates, slab->face_count);
    memset(space->marked, 0, words_for(space->local.vertex_count) * sizeof(uint64_t));
    memset(labels, 0xff, slab->face_count * sizeof *labels);

    uint32_t lowest = 0;
    for (;;) {
        uint32_t seed = next_seed(&growth, &lowest);
        if (seed == NO_INDEX)
            break;
        grow_patch(&growth, seed);
        finish_patch(&growth);
        growth.patch++;
    }
    *patch_count = growth.patch;
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
