/*
 * Edges are found by sorting all corners by vertex pair; fans by union-find over the corners of
 * each vertex along two-sided edges: a vertex is manifold when all its corners are one set.
 */
#include "test_facts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct half_edge {
    uint32_t low, high;
    uint32_t corner;  /* where it starts */
    bool is_reversed; /* runs from high to low */
};

static void *take(size_t count, size_t size)
{
    void *block = calloc(count + 1, size);
    if (!block)
        abort();
    return block;
}

static int compare_half_edges(const void *left, const void *right)
{
    const struct half_edge *a = left, *b = right;
    if (a->low != b->low)
        return a->low < b->low ? -1 : 1;
    if (a->high != b->high)
        return a->high < b->high ? -1 : 1;
    return (a->corner > b->corner) - (a->corner < b->corner);
}

static uint32_t root_of(uint32_t *parent, uint32_t i)
{
    while (parent[i] != i)
        i = parent[i] = parent[parent[i]];
    return i;
}

static void join(uint32_t *parent, uint32_t a, uint32_t b)
{
    a = root_of(parent, a);
    b = root_of(parent, b);
    if (a < b)
        parent[b] = a;
    else
        parent[a] = b;
}

static size_t count_roots(uint32_t *parent, size_t count)
{
    size_t roots = 0;
    for (size_t i = 0; i < count; i++)
        roots += parent[i] == i;
    return roots;
}

static uint32_t *singletons(size_t count)
{
    uint32_t *parent = take(count, sizeof *parent);
    for (size_t i = 0; i < count; i++)
        parent[i] = (uint32_t)i;
    return parent;
}

static int compare_triples(const void *left, const void *right)
{
    return memcmp(left, right, 3 * sizeof(uint32_t));
}

static void count_faces(const struct mesh *mesh, struct facts *facts)
{
    uint32_t(*sorted)[3] = take(mesh->face_count, sizeof *sorted);
    for (size_t f = 0; f < mesh->face_count; f++) {
        uint32_t a = mesh->faces[3 * f], b = mesh->faces[3 * f + 1], c = mesh->faces[3 * f + 2];
        facts->out_of_range +=
            a >= mesh->vertex_count || b >= mesh->vertex_count || c >= mesh->vertex_count;
        facts->degenerate += a == b || b == c || c == a;
        uint32_t low = a < b ? a : b, high = a < b ? b : a;
        sorted[f][0] = c < low ? c : low;
        sorted[f][2] = c > high ? c : high;
        sorted[f][1] = a ^ b ^ c ^ sorted[f][0] ^ sorted[f][2];
    }
    qsort(sorted, mesh->face_count, sizeof *sorted, compare_triples);
    for (size_t f = 1; f < mesh->face_count; f++)
        facts->duplicate += compare_triples(sorted[f - 1], sorted[f]) == 0;
    free(sorted);
}

/* Joins what lies along an edge of exactly two faces; counts edges by their number of faces. */
static void count_edges(const struct mesh *mesh, struct facts *facts, uint32_t *fans,
                        uint32_t *pieces, struct half_edge *edges)
{
    size_t count = 3 * mesh->face_count;
    for (size_t c = 0; c < count; c++) {
        uint32_t a = mesh->faces[c], b = mesh->faces[c - c % 3 + next3((unsigned)(c % 3))];
        edges[c] = (struct half_edge){a < b ? a : b, a < b ? b : a, (uint32_t)c, a > b};
    }
    qsort(edges, count, sizeof *edges, compare_half_edges);
    for (size_t i = 0, end; i < count; i = end) {
        for (end = i + 1;
             end < count && edges[end].low == edges[i].low && edges[end].high == edges[i].high;)
            end++;
        facts->edges++;
        facts->border_edges += end - i == 1;
        facts->nonmanifold_edges += end - i > 2;
        for (size_t j = i + 1; j < end; j++)
            join(pieces, edges[i].corner / 3, edges[j].corner / 3);
        if (end - i != 2)
            continue;
        facts->misoriented_edges += edges[i].is_reversed == edges[i + 1].is_reversed;
        uint32_t ends[2][2]; /* of both faces: the corner at low, the corner at high */
        for (unsigned j = 0; j < 2; j++) {
            uint32_t from = edges[i + j].corner;
            uint32_t to = from - from % 3 + next3(from % 3);
            ends[j][0] = edges[i + j].is_reversed ? to : from;
            ends[j][1] = edges[i + j].is_reversed ? from : to;
        }
        join(fans, ends[0][0], ends[1][0]);
        join(fans, ends[0][1], ends[1][1]);
    }
}

static void count_vertices(const struct mesh *mesh, struct facts *facts, uint32_t *fans)
{
    uint32_t *fan_count = take(mesh->vertex_count, sizeof *fan_count);
    for (size_t c = 0; c < 3 * mesh->face_count; c++)
        fan_count[mesh->faces[c]] += fans[c] == c;
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        facts->vertices += fan_count[v] > 0;
        facts->unused += fan_count[v] == 0;
        facts->nonmanifold_vertices += fan_count[v] > 1;
    }
    free(fan_count);
}

/* Every vertex on the border of a manifold has two border edges: loops are connected sets. */
static size_t count_loops(const struct mesh *mesh, const struct half_edge *edges)
{
    size_t count = 3 * mesh->face_count, border_vertices = 0;
    uint32_t *loops = singletons(mesh->vertex_count);
    bool *on_border = take(mesh->vertex_count, sizeof *on_border);
    for (size_t i = 0, end; i < count; i = end) {
        for (end = i + 1;
             end < count && edges[end].low == edges[i].low && edges[end].high == edges[i].high;)
            end++;
        if (end - i == 1) {
            join(loops, edges[i].low, edges[i].high);
            on_border[edges[i].low] = on_border[edges[i].high] = true;
        }
    }
    for (size_t v = 0; v < mesh->vertex_count; v++)
        border_vertices += !on_border[v];
    size_t roots = count_roots(loops, mesh->vertex_count) - border_vertices;
    free(on_border);
    free(loops);
    return roots;
}

struct facts facts_of(const struct mesh *mesh)
{
    struct facts facts = {.faces = mesh->face_count};
    count_faces(mesh, &facts);
    if (facts.out_of_range)
        return facts;
    size_t corners = 3 * mesh->face_count;
    uint32_t *fans = singletons(corners), *pieces = singletons(mesh->face_count);
    struct half_edge *edges = take(corners, sizeof *edges);
    count_edges(mesh, &facts, fans, pieces, edges);
    count_vertices(mesh, &facts, fans);
    facts.components = count_roots(pieces, mesh->face_count);
    if (facts.nonmanifold_vertices == 0)
        facts.border_loops = count_loops(mesh, edges);
    facts.euler = (long)facts.vertices - (long)facts.edges + (long)facts.faces;
    free(edges);
    free(pieces);
    free(fans);
    return facts;
}

static bool is_zero(size_t count, const char *what)
{
    if (count)
        fprintf(stderr, "mesh has %zu %s\n", count, what);
    return count == 0;
}

bool facts_manifold(const struct facts *facts)
{
    bool good = is_zero(facts->out_of_range, "faces with an index out of range");
    good &= is_zero(facts->degenerate, "degenerate faces");
    good &= is_zero(facts->duplicate, "duplicate faces");
    good &= is_zero(facts->nonmanifold_edges, "edges of more than two faces");
    good &= is_zero(facts->nonmanifold_vertices, "vertices with several fans");
    good &= is_zero(facts->misoriented_edges, "misoriented edges");
    return good;
}

bool facts_same_topology(const struct facts *a, const struct facts *b)
{
    bool same = a->components == b->components && a->border_loops == b->border_loops &&
                a->euler == b->euler;
    if (!same)
        fprintf(stderr,
                "topology differs: %zu and %zu components, %zu and %zu border loops, Euler "
                "characteristic %ld and %ld\n",
                a->components, b->components, a->border_loops, b->border_loops, a->euler, b->euler);
    return same;
}

double mesh_volume(const struct mesh *mesh)
{
    double sum = 0;
    for (size_t f = 0; f < mesh->face_count; f++) {
        const double *a = mesh->positions + 3 * (size_t)mesh->faces[3 * f];
        const double *b = mesh->positions + 3 * (size_t)mesh->faces[3 * f + 1];
        const double *c = mesh->positions + 3 * (size_t)mesh->faces[3 * f + 2];
        sum += a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
               a[2] * (b[0] * c[1] - b[1] * c[0]);
    }
    return sum / 6;
}

double mesh_area(const struct mesh *mesh)
{
    double sum = 0;
    for (size_t f = 0; f < mesh->face_count; f++) {
        const double *a = mesh->positions + 3 * (size_t)mesh->faces[3 * f];
        const double *b = mesh->positions + 3 * (size_t)mesh->faces[3 * f + 1];
        const double *c = mesh->positions + 3 * (size_t)mesh->faces[3 * f + 2];
        double u[3], v[3];
        for (unsigned k = 0; k < 3; k++) {
            u[k] = b[k] - a[k];
            v[k] = c[k] - a[k];
        }
        double x = u[1] * v[2] - u[2] * v[1], y = u[2] * v[0] - u[0] * v[2],
               z = u[0] * v[1] - u[1] * v[0];
        sum += sqrt(x * x + y * y + z * z);
    }
    return sum / 2;
}
