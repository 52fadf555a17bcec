/*
 * Random meshes through store_build, against a checker that is slow and simple: it works on whole
 * lists of edges and corners with no slabs, no sorting, and shares no code with the builder.
 *
 * Soups of random triangles on few vertices give every kind of non-manifoldness at once; shapes
 * with random faces turned, dropped and added, and vertices merged, give what scans have. Each
 * vertex has its number as a coordinate, so that a stored vertex tells which input vertex it was.
 */
#include "test_kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/cpu.h"
#include "base/memory.h"
#include "mesh/store.h"
#include "test_alike.h"
#include "test_facts.h"
#include "test_shapes.h"

/* SCANT_MEMORY: tables are read by buckets of a few elements, sorts have runs of a few records. */
enum { MAX_SHIFTS = 4, CURVE_SHIFT = 6, SCANT_MEMORY = 8192 };

/* ---- what must come out ---- */

struct side {
    uint32_t face;
    uint32_t edge;
};

struct expected {
    size_t face_count;
    uint32_t *faces; /* kept, by input vertex */
    size_t degenerate, duplicate;
    uint32_t *fan;       /* corner -> representative corner of its fan */
    struct side *over;   /* corner's edge -> the side over it, face UINT32_MAX: none */
    uint32_t *component; /* face -> representative */
    bool *is_turned;     /* face, relative to its component's lowest */
    bool *is_twisted;    /* by representative */
    size_t nonmanifold_edges, nonmanifold_vertices, extra_fans, flipped, twisted;
};

static void *take(size_t count, size_t size)
{
    void *block = calloc(count + 1, size);
    assert_non_null(block);
    return block;
}

static bool same_vertices(const uint32_t *a, const uint32_t *b)
{
    for (int i = 0; i < 3; i++) {
        if (a[i] != b[0] && a[i] != b[1] && a[i] != b[2])
            return false;
    }
    return true;
}

static void keep_faces(const struct shape *shape, struct expected *e)
{
    e->faces = take(3 * shape->face_count, sizeof *e->faces);
    for (size_t f = 0; f < shape->face_count; f++) {
        const uint32_t *face = shape->indices + 3 * f;
        if (face[0] == face[1] || face[1] == face[2] || face[2] == face[0]) {
            e->degenerate++;
            continue;
        }
        bool is_new = true;
        for (size_t g = 0; g < e->face_count; g++)
            is_new = is_new && !same_vertices(face, e->faces + 3 * g);
        if (is_new)
            memcpy(e->faces + 3 * e->face_count++, face, 3 * sizeof *face);
        else
            e->duplicate++;
    }
}

static uint32_t root(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i)
        i = parent[i];
    return i;
}

static void unite(uint32_t *parent, uint32_t a, uint32_t b)
{
    a = root(parent, a);
    b = root(parent, b);
    parent[a > b ? a : b] = a < b ? a : b;
}

/* All sides with the ends of side (f, k); returns how many. */
static size_t sides_of(const struct expected *e, size_t f, unsigned k, struct side *list)
{
    uint32_t a = e->faces[3 * f + k], b = e->faces[3 * f + (k + 1) % 3];
    size_t count = 0;
    for (size_t g = 0; g < e->face_count; g++) {
        for (unsigned m = 0; m < 3; m++) {
            uint32_t c = e->faces[3 * g + m], d = e->faces[3 * g + (m + 1) % 3];
            if ((a == c && b == d) || (a == d && b == c))
                list[count++] = (struct side){(uint32_t)g, m};
        }
    }
    return count;
}

/* The corner of side s at vertex v. */
static uint32_t corner_at(const struct expected *e, struct side s, uint32_t v)
{
    uint32_t c = 3 * s.face + s.edge;
    return e->faces[c] == v ? c : 3 * s.face + (s.edge + 1) % 3;
}

static void link_sides(struct expected *e, struct side a, struct side b)
{
    e->over[3 * a.face + a.edge] = b;
    e->over[3 * b.face + b.edge] = a;
}

static void find_fans(struct expected *e)
{
    struct side *list = take(e->face_count, sizeof *list);
    e->fan = take(3 * e->face_count, sizeof *e->fan);
    e->over = take(3 * e->face_count, sizeof *e->over);
    for (uint32_t c = 0; c < 3 * e->face_count; c++) {
        e->fan[c] = c;
        e->over[c].face = UINT32_MAX;
    }
    for (size_t f = 0; f < e->face_count; f++) {
        for (unsigned k = 0; k < 3; k++) {
            size_t count = sides_of(e, f, k, list);
            if (count > 2 && list[0].face == f)
                e->nonmanifold_edges++;
            if (count != 2)
                continue;
            link_sides(e, list[0], list[1]);
            uint32_t a = e->faces[3 * f + k], b = e->faces[3 * f + (k + 1) % 3];
            unite(e->fan, corner_at(e, list[0], a), corner_at(e, list[1], a));
            unite(e->fan, corner_at(e, list[0], b), corner_at(e, list[1], b));
        }
    }
    for (uint32_t c = 0; c < 3 * e->face_count; c++)
        e->fan[c] = root(e->fan, c);
    /* Sides of cut edges that have both fans in common belong together. */
    for (size_t f = 0; f < e->face_count; f++) {
        for (unsigned k = 0; k < 3; k++) {
            size_t count = sides_of(e, f, k, list);
            if (count <= 2)
                continue;
            uint32_t a = e->faces[3 * f + k], b = e->faces[3 * f + (k + 1) % 3];
            struct side own = {(uint32_t)f, k};
            size_t mates = 0;
            for (size_t i = 0; i < count; i++) {
                if (list[i].face == f ||
                    e->fan[corner_at(e, own, a)] != e->fan[corner_at(e, list[i], a)] ||
                    e->fan[corner_at(e, own, b)] != e->fan[corner_at(e, list[i], b)])
                    continue;
                mates++;
                link_sides(e, own, list[i]);
            }
            assert_true(mates <= 1);
        }
    }
    free(list);
}

static void count_fans(struct expected *e)
{
    for (uint32_t c = 0; c < 3 * e->face_count; c++) {
        size_t fans = 0;
        bool is_first = true;
        for (uint32_t d = 0; d < 3 * e->face_count; d++) {
            if (e->faces[d] != e->faces[c])
                continue;
            is_first = is_first && d >= c;
            fans += e->fan[d] == d;
        }
        if (!is_first)
            continue;
        e->extra_fans += fans - 1;
        e->nonmanifold_vertices += fans > 1;
    }
}

/* Spreads orientation from the lowest face of each component. */
static void find_components(struct expected *e)
{
    uint32_t *queue = take(e->face_count, sizeof *queue);
    e->component = take(e->face_count, sizeof *e->component);
    e->is_turned = take(e->face_count, sizeof *e->is_turned);
    e->is_twisted = take(e->face_count, sizeof *e->is_twisted);
    memset(e->component, 0xff, e->face_count * sizeof *e->component);
    for (uint32_t start = 0; start < e->face_count; start++) {
        if (e->component[start] != UINT32_MAX)
            continue;
        size_t head = 0, tail = 0, turned = 0;
        e->component[start] = start;
        queue[tail++] = start;
        while (head < tail) {
            uint32_t f = queue[head++];
            turned += e->is_turned[f];
            for (unsigned k = 0; k < 3; k++) {
                struct side over = e->over[3 * f + k];
                if (over.face == UINT32_MAX)
                    continue;
                bool alike = e->faces[3 * f + k] == e->faces[3 * over.face + over.edge];
                bool turn = e->is_turned[f] ^ alike;
                if (e->component[over.face] == UINT32_MAX) {
                    e->component[over.face] = start;
                    e->is_turned[over.face] = turn;
                    queue[tail++] = over.face;
                } else if (e->is_turned[over.face] != turn) {
                    e->is_twisted[start] = true;
                }
            }
        }
        e->twisted += e->is_twisted[start];
        if (e->is_twisted[start])
            continue;
        if (2 * turned > tail) {
            for (size_t i = 0; i < tail; i++)
                e->is_turned[queue[i]] = !e->is_turned[queue[i]];
            turned = tail - turned;
        }
        e->flipped += turned;
    }
    free(queue);
}

static void expect(const struct shape *shape, struct expected *e)
{
    memset(e, 0, sizeof *e);
    keep_faces(shape, e);
    find_fans(e);
    count_fans(e);
    find_components(e);
}

static void expected_free(struct expected *e)
{
    free(e->faces);
    free(e->fan);
    free(e->over);
    free(e->component);
    free(e->is_turned);
    free(e->is_twisted);
}

/* ---- what came out ---- */

struct stored {
    struct store_info info;
    struct mesh mesh;
    uint32_t *neighbours;
    uint8_t *mates;
};

/* The slabs, each by itself: foreign vertices are just those used, with their positions. */
static void read_slabs(struct store *store, struct stored *s)
{
    const struct store_info *info = store_info(store);
    s->neighbours = take(3 * s->mesh.face_count, sizeof *s->neighbours);
    s->mates = take(s->mesh.face_count, 1);
    bool *used = take(s->mesh.vertex_count, sizeof *used);
    for (uint32_t i = 0; i < info->slab_count; i++) {
        struct slab slab;
        assert_int_equal(slab_open(store, i, &slab), STATUS_OK);
        assert_int_equal(slab.face_first, (uint64_t)i << info->slab_shift);
        memcpy(s->neighbours + 3 * (size_t)slab.face_first, slab.neighbours,
               12 * (size_t)slab.face_count);
        memcpy(s->mates + slab.face_first, slab.mates, slab.face_count);
        memset(used, 0, s->mesh.vertex_count);
        for (size_t c = 0; c < 3 * (size_t)slab.face_count; c++)
            used[slab.faces[c]] = true;
        size_t foreign = 0;
        for (uint32_t v = 0; v < s->mesh.vertex_count; v++) {
            bool is_own = v >= slab.vertex_first && v < slab.vertex_end;
            assert_true(!is_own || used[v]);
            if (used[v] && !is_own) {
                assert_true(foreign < slab.foreign_count);
                assert_int_equal(slab.foreign[foreign++], v);
            }
            for (int k = 0; used[v] && k < 3; k++)
                assert_true(info->origin[k] + (double)slab_position(&slab, v)[k] ==
                            s->mesh.positions[3 * v + (size_t)k]);
        }
        assert_int_equal(foreign, slab.foreign_count);
        slab_close(&slab);
    }
    free(used);
}

/* The store has the same bytes on a machine without vector instructions. */
static void compare_scalar(const char *input, const char *store, struct import_options options)
{
    const char *output = test_path("scalar.store");
    struct context ctx;
    context_init(&ctx);
    ctx.cpu_level_cap = CPU_SCALAR;
    ctx.threads = 1;
    assert_int_equal(store_build(&ctx, &input, 1, output, &options, NULL), STATUS_OK);
    context_clear(&ctx);
    files_must_be_alike(store, output);
}

static void build(const struct shape *shape, unsigned shift, uint64_t working_memory,
                  struct stored *s)
{
    const char *input = test_path("in.ply"), *output = test_path("out.store");
    struct context ctx;
    context_init(&ctx);
    ctx.threads = 1 + shift % 3;
    shape_write(shape, SHAPE_PLY_LITTLE, input);
    struct import_options options = {.slab_shift = shift, .working_memory = working_memory};
    memset(s, 0, sizeof *s);
    assert_int_equal(store_build(&ctx, &input, 1, output, &options, &s->info), STATUS_OK);
    if (shift % 2)
        compare_scalar(input, output, options);
    if (store_check(&ctx, output) != STATUS_OK)
        fail_msg("store_check: %s", ctx.error);
    struct store *store;
    assert_int_equal(store_open(&ctx, output, true, &store), STATUS_OK);
    assert_int_equal(store_load(store, &s->mesh), STATUS_OK);
    read_slabs(store, s);
    store_close(&store);
    context_clear(&ctx);
}

static void stored_free(struct stored *s)
{
    struct context ctx;
    context_init(&ctx);
    ctx.memory_now = UINT64_MAX / 2;
    mesh_clear(&ctx, &s->mesh);
    context_clear(&ctx);
    free(s->neighbours);
    free(s->mates);
}

/* ---- the comparison ---- */

static uint32_t input_vertex(const struct stored *s, uint32_t v)
{
    return (uint32_t)s->mesh.positions[3 * (size_t)v];
}

static void compare_faces(const struct expected *e, const struct stored *s)
{
    assert_int_equal(s->mesh.face_count, e->face_count);
    for (size_t f = 0; f < e->face_count; f++) {
        const uint32_t *want = e->faces + 3 * f;
        uint32_t got[3];
        for (size_t k = 0; k < 3; k++)
            got[k] = input_vertex(s, s->mesh.faces[3 * f + k]);
        assert_int_equal(got[0], want[0]);
        bool turned = got[1] == want[2];
        assert_int_equal(got[1], turned ? want[2] : want[1]);
        assert_int_equal(got[2], turned ? want[1] : want[2]);
        if (!e->is_twisted[e->component[f]])
            assert_int_equal(turned, e->is_turned[f]);
    }
}

/* The stored corner that expected corner c of face f has become. */
static unsigned stored_corner(const struct expected *e, const struct stored *s, size_t f,
                              unsigned k)
{
    uint32_t v = e->faces[3 * f + k];
    for (unsigned m = 0; m < 3; m++) {
        if (input_vertex(s, s->mesh.faces[3 * f + m]) == v)
            return m;
    }
    fail_msg("a face lost vertex %u", v);
    return 0;
}

/* Corners of one fan have one vertex, corners of different ones different vertices; only surfaces
 * that are not orientable are cut further. */
static void compare_fans(const struct expected *e, const struct stored *s)
{
    for (uint32_t c = 0; c < 3 * e->face_count; c++) {
        uint32_t v = s->mesh.faces[c / 3 * 3 + stored_corner(e, s, c / 3, c % 3)];
        for (uint32_t d = 0; d < c; d++) {
            if (e->faces[c] != e->faces[d])
                continue;
            uint32_t w = s->mesh.faces[d / 3 * 3 + stored_corner(e, s, d / 3, d % 3)];
            if (e->fan[c] != e->fan[d])
                assert_int_not_equal(v, w);
            else if (!e->is_twisted[e->component[c / 3]])
                assert_int_equal(v, w);
        }
    }
}

static void compare_links(const struct expected *e, const struct stored *s)
{
    size_t missing = 0;
    for (size_t f = 0; f < e->face_count; f++) {
        for (unsigned k = 0; k < 3; k++) {
            unsigned a = stored_corner(e, s, f, k), b = stored_corner(e, s, f, (k + 1) % 3);
            unsigned edge = (a + 1) % 3 == b ? a : b; /* stored edge between those two */
            uint32_t got = s->neighbours[3 * f + edge];
            struct side want = e->over[3 * f + k];
            if (want.face == got)
                continue;
            assert_int_equal(got, NO_INDEX);
            assert_true(e->is_twisted[e->component[f]]);
            missing++;
        }
    }
    assert_int_equal(missing, 2 * s->info.cleaning.cut_edges);
}

/* Two sides of the stored mesh with the same ends are neighbours, and nothing else is. */
static void compare_adjacency(const struct stored *s)
{
    const struct mesh *mesh = &s->mesh;
    for (size_t f = 0; f < mesh->face_count; f++) {
        for (unsigned k = 0; k < 3; k++) {
            uint32_t a = mesh->faces[3 * f + k], b = mesh->faces[3 * f + (k + 1) % 3];
            uint32_t over = NO_INDEX;
            unsigned mate = 0;
            for (size_t g = 0; g < mesh->face_count; g++) {
                for (unsigned m = 0; m < 3; m++) {
                    if (mesh->faces[3 * g + m] == b && mesh->faces[3 * g + (m + 1) % 3] == a) {
                        over = (uint32_t)g;
                        mate = m;
                    }
                }
            }
            assert_int_equal(s->neighbours[3 * f + k], over);
            assert_int_equal(s->mates[f] >> (2 * k) & 3, mate);
        }
    }
}

/* The floor, from components and loops found anew. */
static uint64_t floor_of(const struct stored *s)
{
    const struct mesh *mesh = &s->mesh;
    uint32_t *part = take(mesh->vertex_count, sizeof *part);
    uint32_t *ring = take(mesh->vertex_count, sizeof *ring);
    for (uint32_t v = 0; v < mesh->vertex_count; v++)
        part[v] = ring[v] = v;
    for (size_t c = 0; c < 3 * mesh->face_count; c++) {
        size_t next = c / 3 * 3 + (c + 1) % 3;
        unite(part, mesh->faces[c], mesh->faces[next]);
        if (s->neighbours[c] == NO_INDEX)
            unite(ring, mesh->faces[c], mesh->faces[next]);
    }
    uint64_t floor = 0;
    for (uint32_t p = 0; p < mesh->vertex_count; p++) {
        if (root(part, p) != p)
            continue;
        long euler = 0, twice_edges = 0, loops = 0;
        for (uint32_t v = 0; v < mesh->vertex_count; v++)
            euler += root(part, v) == p;
        for (size_t c = 0; c < 3 * mesh->face_count; c++) {
            if (root(part, mesh->faces[c]) != p)
                continue;
            bool is_border = s->neighbours[c] == NO_INDEX;
            twice_edges += is_border ? 2 : 1;
            euler += c % 3 == 0;
            loops += is_border && root(ring, mesh->faces[c]) == mesh->faces[c];
        }
        euler -= twice_edges / 2;
        if (loops) {
            long least = 3 * loops - 2 * euler;
            floor += (uint64_t)(least > 1 ? least : 1);
        } else {
            static const long fewest[] = {4, 7, 10, 10, 11, 12, 12, 13, 14};
            long genus = (2 - euler) / 2;
            assert_true(genus >= 0 && genus < 9);
            floor += (uint64_t)(2 * (fewest[genus] - euler));
        }
    }
    free(part);
    free(ring);
    return floor;
}

static void compare_counts(const struct shape *shape, const struct expected *e,
                           const struct stored *s)
{
    const struct cleaning *c = &s->info.cleaning;
    assert_int_equal(c->input_vertices, shape->vertex_count);
    assert_int_equal(c->input_faces, shape->face_count);
    assert_int_equal(c->degenerate_faces, e->degenerate);
    assert_int_equal(c->duplicate_faces, e->duplicate);
    assert_int_equal(c->nonmanifold_edges, e->nonmanifold_edges);
    assert_int_equal(c->nonmanifold_vertices, e->nonmanifold_vertices);
    assert_int_equal(c->nonorientable_components, e->twisted);
    if (e->twisted == 0) {
        assert_int_equal(c->vertices_added, e->extra_fans);
        assert_int_equal(c->flipped_faces, e->flipped);
        assert_int_equal(c->cut_edges, 0);
    }
    assert_int_equal(c->input_vertices - c->unreferenced_vertices + c->vertices_added,
                     s->mesh.vertex_count);
}

static void compare_topology(const struct stored *s)
{
    const struct topology *t = &s->info.topology;
    struct facts facts = facts_of(&s->mesh);
    assert_true(facts_manifold(&facts));
    assert_int_equal(facts.unused, 0);
    assert_int_equal(t->vertices, facts.vertices);
    assert_int_equal(t->edges, facts.edges);
    assert_int_equal(t->faces, facts.faces);
    assert_int_equal(t->border_edges, facts.border_edges);
    assert_int_equal(t->border_loops, facts.border_loops);
    assert_int_equal(t->components, facts.components);
    assert_int_equal(t->euler, facts.euler);
    assert_int_equal(t->floor, floor_of(s));
    uint32_t next = 0;
    for (size_t c = 0; c < 3 * s->mesh.face_count; c++) {
        assert_true(s->mesh.faces[c] <= next);
        next += s->mesh.faces[c] == next;
    }
    assert_int_equal(next, s->mesh.vertex_count);
}

/* All slab sizes give the same mesh and counts. */
static void compare_stored(const struct stored *a, const struct stored *b)
{
    assert_int_equal(a->mesh.vertex_count, b->mesh.vertex_count);
    assert_int_equal(a->mesh.face_count, b->mesh.face_count);
    assert_memory_equal(a->mesh.faces, b->mesh.faces, 12 * (size_t)a->mesh.face_count);
    assert_memory_equal(a->mesh.positions, b->mesh.positions, 24 * (size_t)a->mesh.vertex_count);
    assert_memory_equal(a->neighbours, b->neighbours, 12 * (size_t)a->mesh.face_count);
    assert_memory_equal(a->mates, b->mates, (size_t)a->mesh.face_count);
    assert_memory_equal(&a->info.cleaning, &b->info.cleaning, sizeof a->info.cleaning);
    assert_memory_equal(&a->info.topology, &b->info.topology, sizeof a->info.topology);
}

static void name_vertices(struct shape *shape)
{
    for (size_t v = 0; v < shape->vertex_count; v++) {
        shape->positions[3 * v] = (double)v;
        shape->positions[3 * v + 1] = (double)(v * v % 101);
        shape->positions[3 * v + 2] = (double)(v * v * v % 103);
    }
}

/* Everything about one mesh. */
static void check_shape(struct shape *shape)
{
    static const unsigned shifts[MAX_SHIFTS] = {18, 2, 3, 5};
    struct expected e;
    struct stored first, other;
    name_vertices(shape);
    expect(shape, &e);
    if (e.face_count == 0) {
        expected_free(&e);
        return;
    }
    build(shape, shifts[0], 0, &first);
    compare_counts(shape, &e, &first);
    compare_faces(&e, &first);
    compare_fans(&e, &first);
    compare_links(&e, &first);
    compare_adjacency(&first);
    compare_topology(&first);
    for (int i = 1; i < MAX_SHIFTS; i++) {
        build(shape, shifts[i], i == 2 ? SCANT_MEMORY : 0, &other);
        compare_stored(&first, &other);
        stored_free(&other);
    }
    build(shape, CURVE_SHIFT, 0, &other); /* in another order if it has several slabs */
    compare_counts(shape, &e, &other);
    compare_adjacency(&other);
    compare_topology(&other);
    stored_free(&other);
    stored_free(&first);
    expected_free(&e);
}

/* ---- the meshes ---- */

static void random_faces(struct shape *shape, size_t count, uint64_t *seed)
{
    for (size_t i = 0; i < count; i++) {
        uint32_t face[3];
        for (int k = 0; k < 3; k++)
            face[k] = (uint32_t)random_below(seed, shape->vertex_count);
        shape_face(shape, 3, face);
    }
}

static void soups_of_random_triangles(void **state)
{
    (void)state;
    for (uint64_t round = 0; round < 150; round++) {
        uint64_t seed = 1000 + round;
        struct shape shape = {0};
        size_t vertices = 3 + random_below(&seed, round % 3 ? 12 : 60);
        for (size_t v = 0; v < vertices; v++)
            shape_vertex(&shape, 0, 0, 0);
        random_faces(&shape, 1 + random_below(&seed, 100), &seed);
        check_shape(&shape);
        shape_free(&shape);
    }
}

/* Few faces meet in each edge: long fans, many bow-ties. */
static void sparse_soups(void **state)
{
    (void)state;
    for (uint64_t round = 0; round < 60; round++) {
        uint64_t seed = 77000 + round;
        struct shape shape = {0};
        for (size_t v = 0; v < 25; v++)
            shape_vertex(&shape, 0, 0, 0);
        for (size_t i = 0; i < 60; i++) {
            uint32_t a = (uint32_t)random_below(&seed, 25), step = 1 + (uint32_t)(round % 3);
            uint32_t b = (a + step) % 25, c = (uint32_t)random_below(&seed, 25);
            shape_triangle(&shape, a, b, c);
        }
        check_shape(&shape);
        shape_free(&shape);
    }
}

/* Takes a shape apart a little. */
static void damage(struct shape *shape, uint64_t *seed)
{
    size_t faces = shape->face_count;
    for (size_t i = 0; i < faces / 10; i++)
        shape_flip(shape, random_below(seed, faces));
    for (size_t i = 0; i < 1 + faces / 40; i++) { /* merge two vertices */
        uint32_t a = (uint32_t)random_below(seed, shape->vertex_count);
        uint32_t b = (uint32_t)random_below(seed, shape->vertex_count);
        for (size_t c = 0; c < shape->index_count; c++)
            shape->indices[c] = shape->indices[c] == a ? b : shape->indices[c];
    }
    random_faces(shape, faces / 20, seed);
    for (size_t i = 0; i < faces / 20; i++) { /* repeat faces */
        size_t f = random_below(seed, faces);
        uint32_t *corner = shape->indices + 3 * f;
        uint32_t copy[3] = {corner[1], corner[i % 2 ? 2 : 0], corner[i % 2 ? 0 : 2]};
        shape_face(shape, 3, copy);
    }
    shape_shuffle(shape, *seed);
}

static struct shape any_shape(uint64_t which)
{
    switch (which % 7) {
    case 0:
        return shape_icosphere(2);
    case 1:
        return shape_torus(9, 7);
    case 2:
        return shape_grid_with_holes(8, 8);
    case 3:
        return shape_mobius(15, 3);
    case 4:
        return shape_klein_bottle(9, 7);
    case 5:
        return shape_spheres_touching_edge(1);
    default:
        return shape_grid(9, 8);
    }
}

static void shapes_as_they_are(void **state)
{
    (void)state;
    for (uint64_t which = 0; which < 7; which++) {
        struct shape shape = any_shape(which);
        shape_fan(&shape);
        check_shape(&shape);
        shape_shuffle(&shape, which);
        check_shape(&shape);
        shape_free(&shape);
    }
}

static void damaged_shapes(void **state)
{
    (void)state;
    for (uint64_t round = 0; round < 70; round++) {
        uint64_t seed = 4200 + round;
        struct shape shape = any_shape(round);
        shape_fan(&shape);
        damage(&shape, &seed);
        check_shape(&shape);
        shape_free(&shape);
    }
}

/* `size` faces round vertex 0, the last only if `closed`. */
static void add_fan(struct shape *shape, uint32_t size, bool closed)
{
    const uint32_t first = (uint32_t)shape->vertex_count;
    for (uint32_t i = 0; i < size; i++)
        shape_vertex(shape, 0, 0, 0);
    for (uint32_t i = 0; i + !closed < size; i++)
        shape_triangle(shape, 0, first + i, first + (i + 1) % size);
}

/* Vertices of few, some and many faces are matched in three ways, and have to agree where the edges
 * of one have their ends at another. */
static void fans_of_all_sizes(void **state)
{
    static const uint32_t sizes[] = {2, 3, 4, 8, 15, 16, 17, 18, 63, 64, 65, 66, 90};
    (void)state;
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; s++)
        for (unsigned kind = 0; kind < 6; kind++) {
            const uint32_t size = sizes[s];
            struct shape shape = {0};
            shape_vertex(&shape, 0, 0, 0);
            add_fan(&shape, size, kind != 1);
            if (kind == 2) /* one turned */
                shape_flip(&shape, size / 2);
            if (kind == 3) /* an edge of three faces */
                shape_triangle(&shape, 0, 1, 1 + size / 2);
            if (kind == 4) /* a second fan */
                add_fan(&shape, size, true);
            if (kind == 5) { /* another vertex of as many, round the same ring */
                shape_vertex(&shape, 0, 0, 0);
                for (uint32_t i = 0; i < size; i++)
                    shape_triangle(&shape, size + 1, 1 + (i + 1) % size, 1 + i);
            }
            shape_shuffle(&shape, size);
            check_shape(&shape);
            shape_free(&shape);
        }
}

/* Vertices of random faces coincide on a coarse grid; -0 and 0 are one. */
static void welding(void **state)
{
    (void)state;
    for (uint64_t round = 0; round < 40; round++) {
        uint64_t seed = 900 + round;
        const bool doubles = round % 2;
        struct shape soup = {0}, indexed = {0};
        uint32_t grid[27], corners[3];
        memset(grid, 0xff, sizeof grid);
        uint64_t coincident = 0;
        for (uint32_t v = 0; v < 3 * (5 + round); v++) {
            uint32_t cell = (uint32_t)random_below(&seed, 27);
            double at[3] = {cell % 3, cell / 3 % 3, cell / 9};
            for (int k = 0; k < 3; k++) {
                at[k] = (at[k] - 1) * (doubles ? 0.1 : 0.125);
                if (at[k] == 0 && random_below(&seed, 2))
                    at[k] = -0.0;
            }
            shape_vertex(&soup, 0, 0, 0);
            shape_vertex(&indexed, 0, 0, 0);
            memcpy(soup.positions + 3 * v, at, sizeof at);
            memcpy(indexed.positions + 3 * v, at, sizeof at);
            coincident += grid[cell] != UINT32_MAX;
            if (grid[cell] == UINT32_MAX)
                grid[cell] = v;
            corners[v % 3] = grid[cell];
            if (v % 3 == 2) {
                shape_triangle(&soup, v - 2, v - 1, v);
                shape_face(&indexed, 3, corners);
            }
        }
        /* Welding the soup is the same as having it indexed. */
        const char *paths[2] = {test_path("soup.ply"), test_path("indexed.ply")};
        const char *stores[2] = {test_path("soup.store"), test_path("indexed.store")};
        struct store_info info[2];
        struct mesh mesh[2];
        struct context ctx;
        context_init(&ctx);
        shape_write(&soup, SHAPE_PLY_LITTLE, paths[0]);
        shape_write(&indexed, SHAPE_PLY_LITTLE, paths[1]);
        enum status status[2];
        for (int i = 0; i < 2; i++) {
            struct import_options options = {
                .weld = i == 0, .slab_shift = 3, .working_memory = round % 3 ? SCANT_MEMORY : 0};
            status[i] = store_build(&ctx, &paths[i], 1, stores[i], &options, &info[i]);
        }
        assert_int_equal(status[0], status[1]);
        if (status[0] == STATUS_OK) {
            assert_int_equal(info[0].cleaning.welded_vertices, coincident);
            assert_int_equal(info[0].is_float32, !doubles);
            for (int i = 0; i < 2; i++) {
                struct store *store;
                assert_int_equal(store_open(&ctx, stores[i], true, &store), STATUS_OK);
                assert_int_equal(store_load(store, &mesh[i]), STATUS_OK);
                store_close(&store);
            }
            assert_int_equal(mesh[0].vertex_count, mesh[1].vertex_count);
            assert_int_equal(mesh[0].face_count, mesh[1].face_count);
            assert_memory_equal(mesh[0].faces, mesh[1].faces, 12 * (size_t)mesh[0].face_count);
            for (size_t i = 0; i < 3 * mesh[0].vertex_count; i++)
                assert_true(mesh[0].positions[i] == mesh[1].positions[i]);
            for (int i = 0; i < 2; i++)
                mesh_clear(&ctx, &mesh[i]);
        }
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
        shape_free(&soup);
        shape_free(&indexed);
    }
}

/* In Hilbert order it is the same mesh: the same triangles by position, and the same topology. */
static void curve_order_changes_nothing(void **state)
{
    (void)state;
    struct shape shape = shape_noisy_torus(120, 60, 0.01, 5);
    shape_fan(&shape);
    for (size_t f = 0; f < 3000; f += 3) /* some duplicates, turned */
        shape_triangle(&shape, shape.indices[3 * f + 1], shape.indices[3 * f],
                       shape.indices[3 * f + 2]);
    shape_shuffle(&shape, 11);
    struct stored whole, slabs;
    build(&shape, 18, 0, &whole);
    build(&shape, 8, 0, &slabs);
    struct stored scant; /* everything that can go to disk does */
    build(&shape, 8, 8 * SCANT_MEMORY, &scant);
    compare_stored(&slabs, &scant);
    stored_free(&scant);
    assert_int_equal(whole.info.cleaning.hilbert_ordered, 0);
    assert_int_equal(slabs.info.cleaning.hilbert_ordered, 1);
    assert_int_equal(slabs.info.cleaning.duplicate_faces, 1000);
    assert_int_equal(whole.info.cleaning.duplicate_faces, 1000);
    assert_memory_equal(&whole.info.topology, &slabs.info.topology, sizeof whole.info.topology);
    compare_topology(&slabs);
    assert_true(mesh_area(&whole.mesh) - mesh_area(&slabs.mesh) < 1e-9);
    assert_true(mesh_volume(&whole.mesh) - mesh_volume(&slabs.mesh) < 1e-9);
    stored_free(&whole);
    stored_free(&slabs);
    shape_free(&shape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(soups_of_random_triangles),   cmocka_unit_test(sparse_soups),
        cmocka_unit_test(shapes_as_they_are),          cmocka_unit_test(damaged_shapes),
        cmocka_unit_test(fans_of_all_sizes),           cmocka_unit_test(welding),
        cmocka_unit_test(curve_order_changes_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
