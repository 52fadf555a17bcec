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
 * The boundary is kept as a ring of nodes, one a vertex, while the patch grows: a face that is
 * added puts its apex between two of them, or takes one out. So it is there in order at the end,
 * edges of a face's other neighbours to the patch are told by looking at the ring, which is small
 * and hot, in place of the faces over them, and the nodes taken out are the vertices that have come
 * to lie inside. Should the adjacency contradict itself, the ring may be torn, which shows at the
 * end.
 *
 * On scans patches have ten faces or so, and what a processor guesses wrong costs more than all
 * arithmetic, and so does memory that is waited for: the neighbours of a face are asked for when it
 * joins the queue. So vertices are marked with the patch's number, which needs no unmarking; what
 * is beyond the slab has labels and normals like any face; a face's vertices, links and label lie
 * in half a line of the cache, at places that a link gives with no arithmetic (slab_local.h); and
 * where a test would be a coin's toss, both outcomes are computed or written, and one is kept.
 */
#include <math.h>

#include "simplify/patch_internal.h"

/* ---- one patch ---- */

/* A patch while it is grown: what every face asks for and changes, in a place of its own that
 * stores through the slab's arrays can't change, so that it stays in registers. */
struct sprout {
    uint32_t *faces; /* these are growth's */
    const float *normals;
    vertex_mark *marks;
    struct queued *queue;
    struct ring *ring;
    uint32_t *inside;
    const struct growth_bounds *bounds;
    uint32_t nothing; /* a link to what is beyond the slab */
    uint32_t most_faces;
    uint32_t patch;
    uint32_t size;         /* faces */
    struct queued *tail;   /* of the queue */
    uint32_t node_count;   /* some of them may be of vertices taken away */
    uint32_t inside_count; /* vertices inside */
    float4 sum;            /* of the normals, weighted by area */
    float length;          /* of it */
    double area;
};

/* How a face lies to the patch: the edges that it shares with it besides the one it is reached over
 * are none, or the one before that edge or after it on the boundary. */
enum joint { JOINT_ALONE, JOINT_BEFORE, JOINT_AFTER };

struct contact {
    enum joint joint;
    uint32_t apex; /* vertex */
    uint32_t node; /* the apex's, if it is in the patch */
    float4 normal; /* the face's */
};

/* The complement of the label of the face that a link leads to. */
static inline uint32_t *label_of(const struct sprout *sprout, uint32_t link)
{
    return sprout->faces + link_user(link);
}

static inline bool is_free(const struct sprout *sprout, uint32_t link)
{
    return *label_of(sprout, link) == 0;
}

/* Of the patch; where the adjacency is senseless, it may be any number. */
static inline int32_t boundary_edges(const struct sprout *sprout)
{
    return (int32_t)(sprout->size + 2 - 2 * sprout->inside_count);
}

static inline bool is_same_face(uint32_t link, uint32_t other)
{
    return (link ^ other) < FACE_STRIDE;
}

/*
 * Whether adding the free face behind `link`, over the edge that starts at node `from`, leaves a
 * disk with a simple boundary: test (a) and what the head of this file adds to it. With a new apex
 * the edge is the only one that it shares.
 */
static inline bool keeps_disk(const struct sprout *sprout, uint32_t from, uint32_t link,
                              struct contact *contact)
{
    const struct ring *ring = sprout->ring;
    const uint32_t apex = sprout->faces[link];
    const vertex_mark mark = sprout->marks[apex];
    contact->joint = JOINT_ALONE;
    contact->apex = apex;
    contact->node = (uint32_t)mark;
    if (mark >> 32 != sprout->patch)
        return true;
    const bool before = is_same_face(ring->link[(uint32_t)mark], link);
    const bool after = is_same_face(ring->link[ring->next[from]], link);
    contact->joint = before ? JOINT_BEFORE : JOINT_AFTER;
    return (before != after) & (boundary_edges(sprout) > 3);
}

/* Test (b): the normals of face and neighbour, and of face and patch. */
static inline bool fits(const struct sprout *sprout, float4 neighbour, float4 normal,
                        enum joint joint)
{
    const struct growth_bounds *bounds = &sprout->bounds[joint != JOINT_ALONE];
    const float4 dots = float4_dots(normal, neighbour, normal, sprout->sum);
    const float4 least = {bounds->face, bounds->patch * sprout->length};
    return (float4_bits((float4)(dots >= least)) & 3) == 3;
}

static inline bool is_feasible(const struct sprout *sprout, float4 neighbour, uint32_t from,
                               uint32_t link, struct contact *contact)
{
    contact->normal = link_normal(sprout->normals, link);
    return keeps_disk(sprout, from, link, contact) &&
           fits(sprout, neighbour, contact->normal, contact->joint);
}

static inline void add_normal(struct sprout *sprout, float4 normal, float weight)
{
    sprout->sum += weight * normal;
    sprout->length = sqrtf(float4_sum3(sprout->sum * sprout->sum));
    sprout->area += weight;
}

/* Asks memory for what the face behind a link will be looked at by first. */
static inline void expect(const struct sprout *sprout, uint32_t link)
{
    __builtin_prefetch(sprout->faces + link);
}

/* The node whose edge a face changes that is added over the edge from node `from`. */
static inline uint32_t changed_node(const struct contact *contact, uint32_t from)
{
    return contact->joint == JOINT_BEFORE ? contact->node : from;
}

/* Adds a face that keeps the disk. */
static inline void add(struct sprout *sprout, uint32_t from, uint32_t link,
                       const struct contact *contact)
{
    struct ring *ring = sprout->ring;
    struct queued *entry = sprout->tail++;
    /* the edge from the one it is reached over to the apex, and the one from there back */
    const uint32_t to = sprout->faces[link + FACE_NEXT], back = sprout->faces[link + FACE_PREVIOUS];
    expect(sprout, to);
    expect(sprout, back);
    if (contact->joint == JOINT_ALONE) {
        const uint32_t node = sprout->node_count++;
        ring->vertex[node] = contact->apex;
        ring->next[node] = ring->next[from];
        ring->link[node] = back;
        ring->next[from] = node;
        ring->link[from] = to;
        sprout->marks[contact->apex] = (vertex_mark)sprout->patch << 32 | node;
        entry->over[0] = to;
        entry->over[1] = back;
        entry->from[0] = from;
        entry->from[1] = node;
    } else {
        const bool is_before = contact->joint == JOINT_BEFORE;
        const uint32_t changed = changed_node(contact, from), gone = ring->next[changed];
        const uint32_t left = is_before ? back : to;
        sprout->inside[sprout->inside_count++] = ring->vertex[gone];
        ring->next[changed] = ring->next[gone];
        ring->link[changed] = left;
        entry->over[0] = left;
        entry->over[1] = sprout->nothing;
        entry->from[0] = changed;
    }
    entry->link = link;
    *label_of(sprout, link) = ~sprout->patch;
    sprout->size++;
    add_normal(sprout, contact->normal, contact->normal[3]);
}

/* The reverse of add for the face added last; `next` and `link`: of the node that it changed, as
 * they were. */
static inline void undo(struct sprout *sprout, uint32_t from, const struct contact *contact,
                        uint32_t next, uint32_t link)
{
    const struct queued *entry = --sprout->tail;
    const uint32_t changed = changed_node(contact, from);
    sprout->ring->next[changed] = next;
    sprout->ring->link[changed] = link;
    if (contact->joint == JOINT_ALONE) {
        sprout->marks[contact->apex] = NO_MARK;
        sprout->node_count--;
    } else {
        sprout->inside_count--;
    }
    sprout->size--;
    *label_of(sprout, entry->link) = 0;
    add_normal(sprout, contact->normal, -contact->normal[3]);
}

/* Takes away the queue's entry, both of whose edges are still on the boundary. */
static inline void take_away(struct sprout *sprout, struct queued *entry, float4 normal)
{
    struct ring *ring = sprout->ring;
    const uint32_t from = entry->from[0], apex = entry->from[1];
    ring->next[from] = ring->next[apex];
    ring->link[from] = entry->link;
    sprout->marks[ring->vertex[apex]] = NO_MARK;
    sprout->size--;
    *label_of(sprout, entry->link) = 0;
    add_normal(sprout, normal, -normal[3]);
    entry->link = NO_INDEX;
}

/*
 * Both free neighbours of a queue's entry are added, or it is taken away itself. The second
 * neighbour is looked at again once the first is in: with the same apex it either shares two edges
 * now and closes the ring round a vertex, which is fine, or three, or one and would pinch.
 */
static inline void expand_two(struct sprout *sprout, struct queued *entry)
{
    const float4 normal = link_normal(sprout->normals, entry->link);
    const uint32_t one = entry->over[0], two = entry->over[1];
    const uint32_t from_one = entry->from[0], from_two = entry->from[1];
    struct contact contact_one, contact_two;
    if (is_feasible(sprout, normal, from_one, one, &contact_one) &&
        is_feasible(sprout, normal, from_two, two, &contact_two)) {
        const uint32_t changed = changed_node(&contact_one, from_one);
        const uint32_t next_before = sprout->ring->next[changed];
        const uint32_t link_before = sprout->ring->link[changed];
        add(sprout, from_one, one, &contact_one);
        if (is_free(sprout, two) && keeps_disk(sprout, from_two, two, &contact_two)) {
            add(sprout, from_two, two, &contact_two);
            return;
        }
        undo(sprout, from_one, &contact_one, next_before, link_before);
    }
    take_away(sprout, entry, normal);
}

/* The seed becomes a patch, and what is feasible of its neighbours is added, one by one. */
static struct sprout plant(const struct growth *growth, uint32_t seed)
{
    const uint32_t link = FACE_STRIDE * seed;
    const uint32_t *face = growth->faces + link;
    const uint32_t vertices[3] = {face[0], face[2], face[4]};
    const uint32_t links[3] = {face[5], face[1], face[3]};
    struct sprout sprout = {.faces = growth->faces,
                            .normals = growth->normals,
                            .marks = growth->marks,
                            .queue = growth->queue,
                            .ring = growth->ring,
                            .inside = growth->inside,
                            .bounds = growth->bounds,
                            .nothing = growth->face_count * FACE_STRIDE,
                            .most_faces = growth->most_faces,
                            .patch = growth->patch,
                            .size = 1,
                            .tail = growth->queue + 1,
                            .node_count = 3};
    sprout.queue[0].link = link;
    const float4 normal = link_normal(sprout.normals, link);
    *label_of(&sprout, link) = ~sprout.patch;
    add_normal(&sprout, normal, normal[3]);
    for (unsigned k = 0; k < 3; k++) { /* edge k runs from the next vertex to the one before */
        sprout.ring->vertex[k] = vertices[k];
        sprout.ring->next[k] = next3(k);
        sprout.ring->link[k] = links[previous3(k)];
        sprout.marks[vertices[k]] = (vertex_mark)sprout.patch << 32 | k;
    }
    for (unsigned k = 0; k < 3; k++) {
        struct contact contact;
        if (is_free(&sprout, links[k]) && sprout.size < sprout.most_faces &&
            is_feasible(&sprout, normal, next3(k), links[k], &contact))
            add(&sprout, next3(k), links[k], &contact);
    }
    return sprout;
}

static struct sprout grow_from(const struct growth *growth, uint32_t seed)
{
    struct sprout sprout = plant(growth, seed);
    for (struct queued *entry = sprout.queue + 1;
         entry < sprout.tail && sprout.size < sprout.most_faces; entry++) {
        const bool one = is_free(&sprout, entry->over[0]), two = is_free(&sprout, entry->over[1]);
        if (one & two) {
            if (sprout.size + 2 <= sprout.most_faces)
                expand_two(&sprout, entry);
        } else if (one | two) {
            const uint32_t link = entry->over[two], from = entry->from[two];
            struct contact contact;
            const float4 normal = link_normal(sprout.normals, entry->link);
            if (is_feasible(&sprout, normal, from, link, &contact))
                add(&sprout, from, link, &contact);
        }
    }
    return sprout;
}

/* Where the boundary is walked from: the first edge on it of the first face that has one. NODES:
 * there is none, or it has no node. */
static uint32_t first_node(const struct sprout *sprout)
{
    for (const struct queued *entry = sprout->queue; entry < sprout->tail; entry++) {
        const uint32_t *face = sprout->faces + FACE_STRIDE * (size_t)link_face(entry->link);
        if (entry->link == NO_INDEX)
            continue;
        for (unsigned k = 0; k < 3; k++)
            if (*label_of(sprout, face[2 * previous3(k) + 1]) != ~sprout->patch) {
                const vertex_mark mark = sprout->marks[face[2 * next3(k)]];
                return mark >> 32 == sprout->patch ? (uint32_t)mark : NODES;
            }
    }
    return NODES;
}

/* Ends the patch: lists its boundary, and the free faces beside it become candidates. Returns how
 * many edges it has; 0: it is no closed loop. */
static uint32_t list_boundary(struct patch_workspace *space, const struct sprout *sprout,
                              uint32_t *vertices, uint32_t *others)
{
    const struct slab_local *local = &space->local;
    const struct ring *ring = sprout->ring;
    struct bit_tree *candidates = &space->growth.candidates;
    const int32_t edges = boundary_edges(sprout);
    const uint32_t first = first_node(sprout), count = (uint32_t)edges;
    uint32_t at = first, i = 0;
    if (edges < 3 || edges > BOUNDARY_MAX || first == NODES)
        return 0;
    do {
        const uint32_t link = ring->link[at], vertex = ring->vertex[at];
        const uint32_t over = ~*label_of(sprout, link);
        vertices[i] = vertices[i + count] = vertex;
        others[i] = others[i + count] = over;
        bit_tree_set_if(candidates, link_face(link), over == NO_PATCH);
        __builtin_prefetch(local->positions + 3 * (size_t)vertex);
        __builtin_prefetch(space->vertex_room + vertex);
        at = ring->next[at];
    } while (++i < count && at != first);
    return i == count && at == first ? count : 0;
}

/* ---- a slab ---- */

static bool is_free_face(const struct growth *growth, uint32_t face)
{
    return growth->faces[FACE_STRIDE * (size_t)face + FACE_USER] == 0;
}

/* The lowest free face beside a finished patch, else the lowest free one; NO_INDEX at the end.
 * Candidates that are free no more are found out here. */
static uint32_t next_seed(struct growth *growth)
{
    uint32_t seed;
    while (bit_tree_lowest(&growth->candidates, &seed)) {
        if (is_free_face(growth, seed))
            return seed;
        bit_tree_clear(&growth->candidates, seed);
    }
    if (growth->left == 0)
        return NO_INDEX;
    while (!is_free_face(growth, growth->lowest))
        growth->lowest++;
    return growth->lowest;
}

bool patch_growth_next(struct patch_workspace *space, struct grown_patch *patch)
{
    uint32_t seed = next_seed(&space->growth);
    if (seed == NO_INDEX)
        return false;
    struct growth *growth = &space->growth;
    const struct sprout sprout = grow_from(growth, seed);
    uint32_t *vertices = space->lists, *others = vertices + 2 * BOUNDARY_MAX;
    *patch = (struct grown_patch){.number = growth->patch,
                                  .face_count = sprout.size,
                                  .edge_count = list_boundary(space, &sprout, vertices, others),
                                  .inside_count = sprout.inside_count,
                                  .vertices = vertices,
                                  .others = others,
                                  .inside = growth->inside,
                                  .area = sprout.area * growth->area_factor};
    growth->tail = sprout.tail;
    growth->left -= sprout.size;
    growth->patch++;
    return true;
}

const uint32_t *patch_growth_faces(struct patch_workspace *space)
{
    uint32_t *faces = space->lists + 4 * BOUNDARY_MAX + INSIDE_MAX, count = 0;
    for (const struct queued *entry = space->queue; entry < space->growth.tail; entry++)
        if (entry->link != NO_INDEX)
            faces[count++] = link_face(entry->link);
    return faces;
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
        labels[f] = patch_growth_label(space, (uint32_t)f);
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
