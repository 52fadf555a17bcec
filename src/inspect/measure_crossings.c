/*
 * Faces of the simplified mesh that go through each other.
 *
 * Each face asks the tree for the faces whose boxes touch its own; a pair is tried once, by the
 * face of the lower number. Faces that share a vertex or an edge get no special treatment in
 * triangles_cross: what they share gives signs of zero there. One thing it does not see is two
 * neighbours folded flat onto each other, which is told here. Coplanar faces that overlap
 * otherwise are not counted.
 */
#include "inspect/comparison.h"

#include "base/memory.h"
#include "base/parallel.h"

enum { JOB_FACES = 1 << 13 };

struct crossings {
    struct comparison *comparison;
    _Atomic uint8_t *crosses; /* one a face */
};

struct crossing_query {
    struct crossings *crossings;
    uint32_t face;
    struct triangle triangle;
};

/* The part of `p` - a that is square to the edge ab. */
static struct vec3 off_edge(struct vec3 p, struct vec3 a, struct vec3 b)
{
    struct vec3 along = vec3_sub(b, a), ap = vec3_sub(p, a);
    double length_squared = vec3_length_squared(along);
    return length_squared > 0 ? vec3_add_scaled(ap, -vec3_dot(ap, along) / length_squared, along)
                              : ap;
}

/* Two faces that share exactly two vertices lie flat on each other. */
static bool is_folded(const struct mesh *mesh, uint32_t f, uint32_t g)
{
    const uint32_t *s = mesh->faces + 3 * (size_t)f, *t = mesh->faces + 3 * (size_t)g;
    unsigned alone_s = 3, alone_t = 3, shared = 0;
    for (unsigned k = 0; k < 3; k++) {
        bool in_t = s[k] == t[0] || s[k] == t[1] || s[k] == t[2];
        bool in_s = t[k] == s[0] || t[k] == s[1] || t[k] == s[2];
        shared += in_t;
        alone_s = in_t ? alone_s : k;
        alone_t = in_s ? alone_t : k;
    }
    if (shared != 2 || alone_s == 3 || alone_t == 3)
        return false;
    struct vec3 a = vec3_load(mesh->positions + 3 * (size_t)s[next3(alone_s)]);
    struct vec3 b = vec3_load(mesh->positions + 3 * (size_t)s[previous3(alone_s)]);
    struct vec3 p = vec3_load(mesh->positions + 3 * (size_t)s[alone_s]);
    struct vec3 q = vec3_load(mesh->positions + 3 * (size_t)t[alone_t]);
    struct vec3 p_off = off_edge(p, a, b), q_off = off_edge(q, a, b);
    return plane_side(a, b, p, q) == 0 && vec3_dot(p_off, q_off) > 0 &&
           vec3_length(triangle_normal(a, b, p)) > 0 && vec3_length(triangle_normal(a, b, q)) > 0;
}

static bool try_pair(void *user, uint32_t other)
{
    struct crossing_query *query = user;
    struct crossings *crossings = query->crossings;
    if (other <= query->face)
        return true;
    struct triangle t = bvh_triangle(&crossings->comparison->tree, other);
    if (triangles_cross(&query->triangle, &t) ||
        is_folded(crossings->comparison->mesh, query->face, other)) {
        atomic_store_explicit(&crossings->crosses[query->face], 1, memory_order_relaxed);
        atomic_store_explicit(&crossings->crosses[other], 1, memory_order_relaxed);
    }
    return true;
}

static enum status crossing_work(void *user, uint64_t job, unsigned worker)
{
    struct crossings *crossings = user;
    const struct bvh *tree = &crossings->comparison->tree;
    uint64_t first = job * JOB_FACES, end = first + JOB_FACES;
    (void)worker;
    for (uint64_t i = first; i < end && i < tree->count; i++) {
        struct crossing_query query = {crossings, tree->order[i],
                                       bvh_triangle(tree, tree->order[i])};
        struct bounds box = bounds_empty();
        bounds_add(&box, query.triangle.a);
        bounds_add(&box, query.triangle.b);
        bounds_add(&box, query.triangle.c);
        bvh_touching(tree, box.low, box.high, try_pair, &query);
    }
    return STATUS_OK;
}

enum status measure_crossings(struct comparison *comparison, uint64_t *faces)
{
    struct context *ctx = comparison->ctx;
    size_t count = comparison->tree.count;
    struct crossings crossings = {comparison, NULL};
    enum status status =
        memory_take_zeroed(ctx, count, sizeof *crossings.crosses, &crossings.crosses);
    if (status == STATUS_OK)
        status =
            parallel_for(ctx, (count + (JOB_FACES - 1)) / JOB_FACES, crossing_work, &crossings);
    for (size_t i = 0; status == STATUS_OK && i < count; i++)
        *faces += crossings.crosses[i];
    memory_release(ctx, &crossings.crosses, count, sizeof *crossings.crosses);
    return status;
}
