/*
 * Is this mesh a manifold, and which one? For any soup of indexed faces: this is the checker of
 * other programs' outputs and of our own, and shares nothing with the code that builds stores.
 *
 * The naive way puts edges into a hash map, with a cache miss an edge and memory in proportion to
 * the mesh. Here every corner becomes a record (vertex, face, next, previous); sorted by vertex,
 * outside of memory where it must be, they bring all faces round a vertex together, and everything
 * that is asked can be told there: how many faces share an edge and which way they run, how many
 * fans there are, which border edges follow each other, which faces are the same. Each edge and
 * face is counted at its lowest vertex. Components are a union-find over the vertices.
 *
 * Border loops are chained through fans (border_loops.c): at a bow-tie vertex a loop goes on in its
 * own fan, so the count is that of the surface after the vertex is separated.
 */
#include "inspect/quality.h"

#include <string.h>

#include "base/bytes.h"
#include "base/external_sort.h"
#include "base/forest.h"
#include "base/memory.h"
#include "geom/vec.h"
#include "inspect/border_loops.h"
#include "inspect/coincident.h"
#include "inspect/precise_sum.h"
#include "inspect/vertex_link.h"

enum {
    SORT_MEMORY = 40 << 20,    /* bytes */
    SCRATCH_MEMORY = 64 << 20, /* bytes a scratch array may have before it is a file */
    FACE_BATCH = 1 << 18
};

enum component_flag {
    COMPONENT_MISORIENTED = 1,   /* an edge that two faces run along the same way */
    COMPONENT_BRANCHED = 2,      /* an edge of more than two faces, or a vertex of several fans */
    COMPONENT_NONORIENTABLE = 4, /* turning faces round would not help */
};

struct component {
    int64_t euler;
    uint64_t loops;
    uint64_t flags;
};

struct scan {
    struct context *ctx;
    const struct quality_input *input;
    struct quality *quality;
    uint64_t sort_memory;

    uint32_t *label; /* first union-find parents of the vertices, then component numbers */
    unsigned char *referenced;
    uint64_t component_count;
    struct component *components;
    uint64_t *parity; /* union-find over faces: 2f as it is, 2f+1 turned round */
    struct spool label_spool, referenced_spool, component_spool, parity_spool;

    struct border_loops loops;
    struct vertex_link link;
};

/* One corner as sorted: `key` is vertex << 32 | face. */
struct corner_record {
    uint64_t key;
    uint32_t next, previous;
};

static void load_corners(const struct quality_input *input, uint64_t face, uint32_t corner[3])
{
    memcpy(corner, input->faces + 3 * face, 3 * sizeof *corner);
}

static bool is_degenerate(const uint32_t corner[3])
{
    return corner[0] == corner[1] || corner[1] == corner[2] || corner[2] == corner[0];
}

static bool is_referenced(const struct scan *scan, uint64_t vertex)
{
    return scan->referenced[vertex / 8] >> vertex % 8 & 1;
}

static enum status end_batch(struct scan *scan, const char *stage, uint64_t done)
{
    if (scan->input->rest)
        scan->input->rest(scan->input->user);
    return step(scan->ctx, stage, done, scan->input->face_count);
}

/* ---- first look at the faces: what each face tells alone, and components ---- */

static enum status scan_faces(struct scan *scan)
{
    const struct quality_input *input = scan->input;
    struct quality *quality = scan->quality;
    struct precise_sum area = {0, 0}, volume = {0, 0};
    struct vec3 base = {0, 0, 0}; /* tetrahedra have their tip here, close to the mesh */

    for (uint64_t f = 0; f < input->face_count; f++) {
        uint32_t corner[3];
        load_corners(input, f, corner);
        for (unsigned k = 0; k < 3; k++)
            if (corner[k] >= input->vertex_count)
                return fail(scan->ctx, STATUS_BAD_INPUT,
                            "face %llu: vertex %llu does not exist (there are %llu)",
                            (unsigned long long)f, (unsigned long long)corner[k],
                            (unsigned long long)input->vertex_count);
        if (f == 0)
            base = position_of(input, corner[0]);
        if (is_degenerate(corner)) {
            quality->degenerate_faces++;
        } else {
            for (unsigned k = 0; k < 3; k++)
                scan->referenced[corner[k] / 8] |= (unsigned char)(1u << corner[k] % 8);
            forest_join(scan->label, corner[0], corner[1]);
            forest_join(scan->label, corner[1], corner[2]);
            struct vec3 a = vec3_sub(position_of(input, corner[0]), base);
            struct vec3 b = vec3_sub(position_of(input, corner[1]), base);
            struct vec3 c = vec3_sub(position_of(input, corner[2]), base);
            struct vec3 normal = triangle_normal(a, b, c);
            double twice_area = vec3_length(normal);
            quality->zero_area_faces += !(twice_area > 0);
            precise_add(&area, twice_area * 0.5);
            precise_add(&volume, vec3_dot(a, normal) / 6);
        }
        if (f % FACE_BATCH == FACE_BATCH - 1) {
            enum status status = end_batch(scan, "components", f + 1);
            if (status != STATUS_OK)
                return status;
        }
    }
    quality->area = precise_value(&area);
    quality->volume = precise_value(&volume);
    return STATUS_OK;
}

/* Counts the vertices, finds the box, turns union-find parents into component numbers. */
static void scan_vertices(struct scan *scan)
{
    struct quality *quality = scan->quality;
    struct vec3 low = {INFINITY, INFINITY, INFINITY}, high = {-INFINITY, -INFINITY, -INFINITY};
    for (uint64_t v = 0; v < scan->input->vertex_count; v++) {
        if (!is_referenced(scan, v)) {
            quality->unreferenced_vertices++;
            continue;
        }
        scan->label[v] =
            scan->label[v] == v ? (uint32_t)scan->component_count++ : scan->label[scan->label[v]];
        struct vec3 p = position_of(scan->input, v);
        low = (struct vec3){fmin(low.x, p.x), fmin(low.y, p.y), fmin(low.z, p.z)};
        high = (struct vec3){fmax(high.x, p.x), fmax(high.y, p.y), fmax(high.z, p.z)};
    }
    if (scan->component_count == 0)
        low = high = (struct vec3){0, 0, 0};
    vec3_store(quality->box_low, low);
    vec3_store(quality->box_high, high);
    quality->topology.components = scan->component_count;
    quality->topology.vertices = scan->input->vertex_count - quality->unreferenced_vertices;
}

/* ---- the corners by vertex ---- */

static enum status sort_corners(struct scan *scan, struct sorter *sorter)
{
    enum { BATCH = 1024 };
    struct corner_record records[3 * BATCH];
    size_t used = 0;
    for (uint64_t f = 0; f < scan->input->face_count; f++) {
        uint32_t corner[3];
        load_corners(scan->input, f, corner);
        if (!is_degenerate(corner)) {
            for (unsigned k = 0; k < 3; k++) {
                struct corner_record *record = &records[used++];
                store_u64(&record->key, (uint64_t)corner[k] << 32 | f);
                record->next = corner[next3(k)];
                record->previous = corner[previous3(k)];
            }
        }
        enum status status = STATUS_OK;
        if (used > 3 * BATCH - 3) {
            status = sorter_add(sorter, records, used);
            used = 0;
        }
        if (status == STATUS_OK && f % FACE_BATCH == FACE_BATCH - 1)
            status = end_batch(scan, "corners", f + 1);
        if (status != STATUS_OK)
            return status;
    }
    enum status status = sorter_add(sorter, records, used);
    return status == STATUS_OK ? sorter_finish(sorter) : status;
}

static enum status finish_vertex(struct scan *scan,
                                 enum status (*visit)(struct scan *scan, uint32_t fans))
{
    uint32_t fans;
    if (scan->link.degree == 0)
        return STATUS_OK;
    enum status status = vertex_link_finish(&scan->link, &fans);
    return status == STATUS_OK ? visit(scan, fans) : status;
}

/* Sorts, and calls visit with scan->link complete for every referenced vertex in ascending order.
 */
static enum status for_each_vertex(struct scan *scan,
                                   enum status (*visit)(struct scan *scan, uint32_t fans))
{
    struct sorter *sorter = NULL;
    enum status status = sorter_open(scan->ctx, sizeof(struct corner_record), sizeof(uint64_t),
                                     scan->sort_memory, scan->input->beside, &sorter);
    if (status == STATUS_OK)
        status = sort_corners(scan, sorter);

    vertex_link_begin(&scan->link, 0);
    uint64_t done = 0;
    while (status == STATUS_OK) {
        const void *batch;
        size_t count;
        status = sorter_next(sorter, &batch, &count);
        if (status != STATUS_OK || count == 0)
            break;
        const struct corner_record *records = batch;
        for (size_t i = 0; i < count && status == STATUS_OK; i++) {
            uint64_t key = load_u64(&records[i].key);
            if (key >> 32 != scan->link.vertex) {
                status = finish_vertex(scan, visit);
                vertex_link_begin(&scan->link, (uint32_t)(key >> 32));
            }
            struct link_face face = {records[i].next, records[i].previous, (uint32_t)key};
            if (status == STATUS_OK)
                status = vertex_link_add(&scan->link, face);
        }
        done += count;
        if (status == STATUS_OK)
            status = step(scan->ctx, "fans", done, sorter_count(sorter));
    }
    if (status == STATUS_OK)
        status = finish_vertex(scan, visit);
    sorter_close(&sorter);
    return status;
}

/* Which of the face's edges the end is: the edges are numbered by their opposite vertex's rank, so
 * that both ends of an edge give it the same name. */
static uint64_t half_edge_of(const struct vertex_link *link, const struct link_end *end)
{
    uint64_t rank = (end->other > link->vertex) + (unsigned)(end->other > end->neighbour);
    return 3 * (uint64_t)link->faces[end->place].face + rank;
}

/* The faces of one edge, ends[0, count), at its lower vertex. */
static enum status count_edge(struct scan *scan, const struct link_end *ends, size_t count)
{
    struct quality *quality = scan->quality;
    uint32_t component = scan->label[scan->link.vertex];
    quality->topology.edges++;
    scan->components[component].euler--;
    if (count == 1) {
        quality->topology.border_edges++;
        return border_loops_edge(&scan->loops, half_edge_of(&scan->link, ends), component);
    }
    if (count > 2) {
        quality->nonmanifold_edges++;
        scan->components[component].flags |= COMPONENT_BRANCHED;
    } else if (ends[0].is_outgoing == ends[1].is_outgoing) {
        quality->misoriented_edges++;
        scan->components[component].flags |= COMPONENT_MISORIENTED;
    }
    /* Equal faces stand side by side; each is met at its lowest edge only. */
    for (size_t i = 1; i < count; i++)
        quality->duplicate_faces +=
            ends[i].other == ends[i - 1].other && ends[i].other > ends[i].neighbour;
    return STATUS_OK;
}

/* Joins the border edges that are ends of the same fan. */
static enum status join_border(struct scan *scan)
{
    struct vertex_link *link = &scan->link;
    size_t count = 2 * (size_t)link->degree, step_size;
    /* faces[root].next has done its work and now keeps the fan's last border end, as place + 1. */
    for (uint32_t i = 0; i < link->degree; i++)
        link->faces[i].next = 0;
    for (size_t i = 0; i < count; i += step_size) {
        step_size = vertex_link_group(link, i);
        if (step_size != 1)
            continue;
        struct link_face *root = &link->faces[link->fan[link->ends[i].place]];
        if (root->next != 0) {
            enum status status =
                border_loops_join(&scan->loops, half_edge_of(link, &link->ends[root->next - 1]),
                                  half_edge_of(link, &link->ends[i]));
            if (status != STATUS_OK)
                return status;
        }
        root->next = (uint32_t)i + 1;
    }
    return STATUS_OK;
}

static enum status count_vertex(struct scan *scan, uint32_t fans)
{
    struct vertex_link *link = &scan->link;
    struct component *component = &scan->components[scan->label[link->vertex]];
    component->euler++;
    if (fans > 1) {
        scan->quality->nonmanifold_vertices++;
        component->flags |= COMPONENT_BRANCHED;
    }
    for (uint32_t i = 0; i < link->degree; i++)
        if (link->vertex < link->faces[i].next && link->vertex < link->faces[i].previous)
            component->euler++;

    size_t count = 2 * (size_t)link->degree, group;
    bool has_border = false;
    for (size_t i = 0; i < count; i += group) {
        group = vertex_link_group(link, i);
        has_border |= group == 1;
        if (link->vertex > link->ends[i].neighbour)
            continue;
        enum status status = count_edge(scan, &link->ends[i], group);
        if (status != STATUS_OK)
            return status;
    }
    return has_border ? join_border(scan) : STATUS_OK;
}

static void count_loop(void *user, uint32_t component)
{
    struct scan *scan = user;
    scan->components[component].loops++;
    scan->quality->topology.border_loops++;
}

/* ---- can it be oriented? asked only where it is not ---- */

static uint64_t find_parity(uint64_t *parent, uint64_t node)
{
    while (parent[node] != node) {
        parent[node] = parent[parent[node]];
        node = parent[node];
    }
    return node;
}

static void unite_parity(uint64_t *parent, uint64_t a, uint64_t b)
{
    a = find_parity(parent, a);
    b = find_parity(parent, b);
    parent[a > b ? a : b] = a > b ? b : a;
}

static enum status join_parity(struct scan *scan, uint32_t fans)
{
    const struct vertex_link *link = &scan->link;
    size_t count = 2 * (size_t)link->degree, group;
    (void)fans;
    for (size_t i = 0; i < count; i += group) {
        group = vertex_link_group(link, i);
        if (group != 2 || link->vertex > link->ends[i].neighbour)
            continue;
        uint64_t turned = link->ends[i].is_outgoing == link->ends[i + 1].is_outgoing;
        uint64_t a = 2 * (uint64_t)link->faces[link->ends[i].place].face;
        uint64_t b = 2 * (uint64_t)link->faces[link->ends[i + 1].place].face;
        unite_parity(scan->parity, a, b + turned);
        unite_parity(scan->parity, a + 1, b + 1 - turned);
    }
    return STATUS_OK;
}

static enum status find_nonorientable(struct scan *scan)
{
    uint64_t faces = scan->input->face_count;
    void *data;
    enum status status = spool_scratch(scan->ctx, &scan->parity_spool, scan->input->beside,
                                       SCRATCH_MEMORY, 2 * faces * sizeof *scan->parity, &data);
    if (status != STATUS_OK)
        return status;
    scan->parity = data;
    for (uint64_t i = 0; i < 2 * faces; i++)
        scan->parity[i] = i;
    status = for_each_vertex(scan, join_parity);
    if (status != STATUS_OK)
        return status;
    for (uint64_t f = 0; f < faces; f++) {
        uint32_t corner[3];
        load_corners(scan->input, f, corner);
        if (!is_degenerate(corner) &&
            find_parity(scan->parity, 2 * f) == find_parity(scan->parity, 2 * f + 1))
            scan->components[scan->label[corner[0]]].flags |= COMPONENT_NONORIENTABLE;
    }
    return STATUS_OK;
}

/* ---- sums over components ---- */

/* Fewest faces of a triangulated surface of this Euler number and number of border loops. Closed
 * ones: Jungerman & Ringel, "Minimal triangulations on orientable surfaces" (1980). */
static uint64_t floor_of(int64_t euler, uint64_t loops)
{
    if (loops > 0)
        return 3 * loops + (uint64_t)(-2 * euler);
    uint64_t square = (uint64_t)(49 - 24 * euler), vertices = 4;
    if (euler == -2)
        vertices = 10;
    else
        for (vertices = (uint64_t)((7 + sqrt((double)square)) / 2) - 1;
             (2 * vertices - 7) * (2 * vertices - 7) < square || vertices < 4;)
            vertices++;
    return 2 * (uint64_t)((int64_t)vertices - euler);
}

static void sum_components(struct scan *scan)
{
    struct quality *quality = scan->quality;
    struct topology *topology = &quality->topology;
    quality->is_manifold = quality->degenerate_faces == 0 && quality->duplicate_faces == 0 &&
                           quality->nonmanifold_edges == 0 && quality->misoriented_edges == 0 &&
                           quality->nonmanifold_vertices == 0;
    for (uint64_t i = 0; i < scan->component_count; i++) {
        const struct component *component = &scan->components[i];
        topology->euler += component->euler;
        if (quality->is_manifold)
            topology->floor += floor_of(component->euler, component->loops);
        if (!(component->flags & (COMPONENT_BRANCHED | COMPONENT_NONORIENTABLE)))
            quality->genus += (2 - component->euler - (int64_t)component->loops) / 2;
    }
}

/* ---- the whole ---- */

static enum status take_scratch(struct scan *scan)
{
    uint64_t vertices = scan->input->vertex_count;
    void *data;
    enum status status = spool_scratch(scan->ctx, &scan->label_spool, scan->input->beside,
                                       SCRATCH_MEMORY, vertices * sizeof *scan->label, &data);
    if (status != STATUS_OK)
        return status;
    scan->label = data;
    for (uint64_t v = 0; v < vertices; v++)
        scan->label[v] = (uint32_t)v;
    scan->referenced = scan->input->referenced;
    if (scan->referenced)
        return STATUS_OK;
    status = spool_scratch(scan->ctx, &scan->referenced_spool, scan->input->beside, SCRATCH_MEMORY,
                           (vertices + 7) / 8, &data);
    if (status == STATUS_OK)
        scan->referenced = data;
    return status;
}

static enum status run(struct scan *scan)
{
    enum status status = take_scratch(scan);
    if (status == STATUS_OK)
        status = scan_faces(scan);
    if (status != STATUS_OK)
        return status;
    scan->quality->topology.faces = scan->input->face_count - scan->quality->degenerate_faces;
    scan_vertices(scan);
    void *data;
    status = spool_scratch(scan->ctx, &scan->component_spool, scan->input->beside, SCRATCH_MEMORY,
                           scan->component_count * sizeof *scan->components, &data);
    if (status != STATUS_OK)
        return status;
    scan->components = data;
    status = for_each_vertex(scan, count_vertex);
    if (status == STATUS_OK)
        status = border_loops_finish(&scan->loops, 3 * scan->input->face_count, count_loop, scan);
    if (status == STATUS_OK && scan->quality->misoriented_edges > 0)
        status = find_nonorientable(scan);
    if (status == STATUS_OK)
        status = coincident_count(scan->ctx, scan->input, scan->sort_memory,
                                  &scan->quality->coincident_vertices);
    if (status == STATUS_OK)
        sum_components(scan);
    return status;
}

enum status quality_of_arrays(struct context *ctx, const struct quality_input *input,
                              struct quality *quality)
{
    memset(quality, 0, sizeof *quality);
    if (input->vertex_count > UINT32_MAX - 1u || input->face_count > UINT32_MAX - 1u)
        return fail(ctx, STATUS_BAD_INPUT, "the mesh has more than 2^32-2 vertices or faces");
    struct scan scan = {.ctx = ctx, .input = input, .quality = quality};
    scan.sort_memory = SORT_MEMORY;
    if (ctx->memory_budget / 4 < scan.sort_memory)
        scan.sort_memory = ctx->memory_budget / 4;
    spool_init(ctx, &scan.label_spool, input->beside, SCRATCH_MEMORY);
    spool_init(ctx, &scan.referenced_spool, input->beside, SCRATCH_MEMORY);
    spool_init(ctx, &scan.component_spool, input->beside, SCRATCH_MEMORY);
    spool_init(ctx, &scan.parity_spool, input->beside, SCRATCH_MEMORY);
    border_loops_init(ctx, input->beside, SCRATCH_MEMORY / 8, &scan.loops);
    vertex_link_init(ctx, &scan.link);

    enum status status = run(&scan);

    vertex_link_clear(&scan.link);
    border_loops_clear(&scan.loops);
    spool_clear(&scan.parity_spool);
    spool_clear(&scan.component_spool);
    spool_clear(&scan.referenced_spool);
    spool_clear(&scan.label_spool);
    return status;
}

enum status quality_of_mesh(struct context *ctx, const struct mesh *mesh, struct quality *quality)
{
    struct quality_input input = {.vertex_count = mesh->vertex_count,
                                  .face_count = mesh->face_count,
                                  .doubles = mesh->positions,
                                  .faces = mesh->faces};
    return quality_of_arrays(ctx, &input, quality);
}
