/*
 * The shapes themselves. Grids of any topology (torus, Klein bottle, Möbius strip, ramp) are made
 * by one function from a table of vertex numbers, spheres by subdividing an icosahedron with the
 * edge midpoints found by search in a sorted table. Nothing here uses the code under test but
 * memory.h, for the arrays of a struct mesh.
 */
#include "test_files.h"
#include "test_shapes.h"

#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/memory.h"

static const double two_pi = 6.283185307179586;

static void check(bool good, const char *what)
{
    if (!good) {
        fprintf(stderr, "test_shapes: %s failed\n", what);
        abort();
    }
}

/* Room for `count` elements; arrays grow one element at a time, to powers of two from 16 on. */
static void *grow(void *block, size_t count, size_t size)
{
    size_t before = count - 1;
    if (block && (before < 16 || (before & (before - 1)) != 0))
        return block;
    block = realloc(block, (before < 16 ? 16 : 2 * before) * size);
    check(block != NULL, "allocation");
    return block;
}

/* ---- random numbers ---- */

uint64_t random_next(uint64_t *state)
{
    uint64_t z = (*state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

double random_unit(uint64_t *state)
{
    return (double)(random_next(state) >> 11) * 0x1p-53;
}

uint64_t random_below(uint64_t *state, uint64_t limit)
{
    return random_next(state) % limit;
}

/* ---- building ---- */

void shape_free(struct shape *shape)
{
    free(shape->positions);
    free(shape->sizes);
    free(shape->indices);
    memset(shape, 0, sizeof *shape);
}

uint32_t shape_vertex(struct shape *shape, double x, double y, double z)
{
    size_t at = shape->vertex_count;
    shape->positions = grow(shape->positions, at + 1, 3 * sizeof(double));
    shape->positions[3 * at] = (double)(float)x;
    shape->positions[3 * at + 1] = (double)(float)y;
    shape->positions[3 * at + 2] = (double)(float)z;
    shape->vertex_count++;
    return (uint32_t)at;
}

uint32_t shape_face(struct shape *shape, size_t corners, const uint32_t *indices)
{
    size_t at = shape->face_count;
    shape->sizes = grow(shape->sizes, at + 1, sizeof(uint32_t));
    shape->sizes[at] = (uint32_t)corners;
    for (size_t i = 0; i < corners; i++) {
        shape->indices = grow(shape->indices, shape->index_count + 1, sizeof(uint32_t));
        shape->indices[shape->index_count++] = indices[i];
    }
    shape->face_count++;
    return (uint32_t)at;
}

uint32_t shape_triangle(struct shape *shape, uint32_t a, uint32_t b, uint32_t c)
{
    return shape_face(shape, 3, (const uint32_t[]){a, b, c});
}

uint32_t shape_quad(struct shape *shape, uint32_t a, uint32_t b, uint32_t c, uint32_t d)
{
    return shape_face(shape, 4, (const uint32_t[]){a, b, c, d});
}

/*
 * Two triangles for each cell of a grid of columns x rows cells; vertex(user, i, j) gives the
 * number of the grid's vertex in column i of [0, columns] and row j of [0, rows].
 */
static void add_cells(struct shape *shape, unsigned columns, unsigned rows,
                      uint32_t (*vertex)(const void *user, unsigned i, unsigned j),
                      const void *user)
{
    for (unsigned j = 0; j < rows; j++)
        for (unsigned i = 0; i < columns; i++) {
            uint32_t a = vertex(user, i, j), b = vertex(user, i + 1, j);
            uint32_t c = vertex(user, i + 1, j + 1), d = vertex(user, i, j + 1);
            shape_triangle(shape, a, b, c);
            shape_triangle(shape, a, c, d);
        }
}

struct wrapping {
    unsigned around, across;
};

/* ---- closed ---- */

struct shape shape_tetrahedron(void)
{
    struct shape shape = {0};
    shape_vertex(&shape, 1, 1, 1);
    shape_vertex(&shape, -1, -1, 1);
    shape_vertex(&shape, -1, 1, -1);
    shape_vertex(&shape, 1, -1, -1);
    shape_triangle(&shape, 0, 2, 1);
    shape_triangle(&shape, 0, 1, 3);
    shape_triangle(&shape, 0, 3, 2);
    shape_triangle(&shape, 1, 2, 3);
    return shape;
}

struct shape shape_cube_quads(void)
{
    struct shape shape = {0};
    for (unsigned i = 0; i < 8; i++)
        shape_vertex(&shape, i & 1, i >> 1 & 1, i >> 2);
    shape_quad(&shape, 0, 2, 3, 1);
    shape_quad(&shape, 4, 5, 7, 6);
    shape_quad(&shape, 0, 1, 5, 4);
    shape_quad(&shape, 2, 6, 7, 3);
    shape_quad(&shape, 0, 4, 6, 2);
    shape_quad(&shape, 1, 3, 7, 5);
    return shape;
}

struct edge_middle {
    uint64_t key; /* smaller vertex in the high half */
    uint32_t vertex;
};

static int compare_keys(const void *left, const void *right)
{
    uint64_t a = ((const struct edge_middle *)left)->key;
    uint64_t b = ((const struct edge_middle *)right)->key;
    return (a > b) - (a < b);
}

static uint64_t edge_key(uint32_t a, uint32_t b)
{
    return a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
}

static uint32_t add_on_sphere(struct shape *shape, double x, double y, double z)
{
    double length = sqrt(x * x + y * y + z * z);
    return shape_vertex(shape, x / length, y / length, z / length);
}

static uint32_t middle_of(const struct edge_middle *edges, size_t count, uint32_t a, uint32_t b)
{
    struct edge_middle wanted = {.key = edge_key(a, b)};
    const struct edge_middle *found = bsearch(&wanted, edges, count, sizeof *edges, compare_keys);
    check(found != NULL, "midpoint");
    return found->vertex;
}

/* Every triangle into four, new vertices on the unit sphere. */
static void subdivide(struct shape *shape)
{
    size_t count = 0;
    struct edge_middle *edges = malloc(3 * shape->face_count * sizeof *edges);
    check(edges != NULL, "allocation");
    for (size_t f = 0; f < shape->face_count; f++)
        for (unsigned k = 0; k < 3; k++) {
            const uint32_t *face = shape->indices + 3 * f;
            edges[count++].key = edge_key(face[k], face[next3(k)]);
        }
    qsort(edges, count, sizeof *edges, compare_keys);
    size_t kept = 0;
    for (size_t i = 0; i < count; i++)
        if (i == 0 || edges[i].key != edges[i - 1].key)
            edges[kept++].key = edges[i].key;
    for (size_t i = 0; i < kept; i++) {
        const double *a = shape->positions + 3 * (edges[i].key >> 32);
        const double *b = shape->positions + 3 * (edges[i].key & UINT32_MAX);
        edges[i].vertex = add_on_sphere(shape, a[0] + b[0], a[1] + b[1], a[2] + b[2]);
    }
    struct shape old = *shape;
    shape->face_count = shape->index_count = 0;
    shape->sizes = shape->indices = NULL;
    for (size_t f = 0; f < old.face_count; f++) {
        uint32_t a = old.indices[3 * f], b = old.indices[3 * f + 1], c = old.indices[3 * f + 2];
        uint32_t ab = middle_of(edges, kept, a, b);
        uint32_t bc = middle_of(edges, kept, b, c);
        uint32_t ca = middle_of(edges, kept, c, a);
        shape_triangle(shape, a, ab, ca);
        shape_triangle(shape, b, bc, ab);
        shape_triangle(shape, c, ca, bc);
        shape_triangle(shape, ab, bc, ca);
    }
    free(old.sizes);
    free(old.indices);
    free(edges);
}

struct shape shape_icosphere(unsigned level)
{
    static const uint8_t faces[20][3] = {
        {0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
        {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
        {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}};
    const double golden = (1 + sqrt(5)) / 2;
    struct shape shape = {0};
    for (unsigned axis = 0; axis < 3; axis++)
        for (unsigned i = 0; i < 4; i++) {
            double one = i & 1 ? 1 : -1, phi = i & 2 ? -golden : golden;
            if (axis == 0)
                add_on_sphere(&shape, one, phi, 0);
            else if (axis == 1)
                add_on_sphere(&shape, 0, one, phi);
            else
                add_on_sphere(&shape, phi, 0, one);
        }
    for (unsigned f = 0; f < 20; f++)
        shape_triangle(&shape, faces[f][0], faces[f][1], faces[f][2]);
    for (unsigned i = 0; i < level; i++)
        subdivide(&shape);
    return shape;
}

static uint32_t torus_vertex(const void *user, unsigned i, unsigned j)
{
    const struct wrapping *size = user;
    return j % size->across * size->around + i % size->around;
}

struct shape shape_torus(unsigned around, unsigned across)
{
    struct shape shape = {0};
    for (unsigned j = 0; j < across; j++)
        for (unsigned i = 0; i < around; i++) {
            double u = two_pi * i / around, v = two_pi * j / across;
            double radius = 1 + 0.4 * cos(v);
            shape_vertex(&shape, radius * cos(u), radius * sin(u), 0.4 * sin(v));
        }
    add_cells(&shape, around, across, torus_vertex, &(struct wrapping){around, across});
    return shape;
}

static void add_noise(struct shape *shape, double noise, uint64_t seed)
{
    for (size_t i = 0; i < 3 * shape->vertex_count; i++)
        shape->positions[i] =
            (double)(float)(shape->positions[i] + noise * (2 * random_unit(&seed) - 1));
}

struct shape shape_noisy_sphere(unsigned level, double noise, uint64_t seed)
{
    struct shape shape = shape_icosphere(level);
    add_noise(&shape, noise, seed);
    return shape;
}

struct shape shape_noisy_torus(unsigned around, unsigned across, double noise, uint64_t seed)
{
    struct shape shape = shape_torus(around, across);
    add_noise(&shape, noise, seed);
    return shape;
}

static uint32_t grid_vertex(const void *user, unsigned i, unsigned j)
{
    return j * (*(const unsigned *)user + 1) + i;
}

struct shape shape_noisy_slab(unsigned cells, double noise, uint64_t seed)
{
    struct shape shape = shape_grid(cells, cells);
    for (size_t v = 0; v < shape.vertex_count; v++) {
        double *p = shape.positions + 3 * v;
        double x = two_pi * p[0] / cells, y = two_pi * p[1] / cells;
        p[0] = (double)(float)(p[0] / cells);
        p[1] = (double)(float)(p[1] / cells);
        p[2] = (double)(float)(0.5 + 0.1 * sin(2 * x) * cos(3 * y) + 0.03 * sin(7 * x + 5 * y) +
                               noise * (2 * random_unit(&seed) - 1));
    }
    /* One point below closes it: a fan over the border, which runs counter-clockwise. */
    uint32_t apex = shape_vertex(&shape, 0.5, 0.5, -0.5);
    uint32_t last = 0;
    for (unsigned i = 1; i <= 4 * cells; i++) {
        unsigned side = (i - 1) / cells, t = i - side * cells;
        unsigned column = side == 0 ? t : side == 1 ? cells : side == 2 ? cells - t : 0;
        unsigned row = side == 0 ? 0 : side == 1 ? t : side == 2 ? cells : cells - t;
        uint32_t here = grid_vertex(&cells, column, row);
        shape_triangle(&shape, here, last, apex);
        last = here;
    }
    return shape;
}

/* ---- with border ---- */

struct shape shape_single_triangle(void)
{
    struct shape shape = {0};
    shape_vertex(&shape, 0, 0, 0);
    shape_vertex(&shape, 1, 0, 0);
    shape_vertex(&shape, 0, 1, 0);
    shape_triangle(&shape, 0, 1, 2);
    return shape;
}

struct shape shape_grid(unsigned columns, unsigned rows)
{
    struct shape shape = {0};
    for (unsigned j = 0; j <= rows; j++)
        for (unsigned i = 0; i <= columns; i++)
            shape_vertex(&shape, i, j, 0);
    add_cells(&shape, columns, rows, grid_vertex, &columns);
    return shape;
}

struct shape shape_grid_with_holes(unsigned columns, unsigned rows)
{
    struct shape shape = {0};
    for (unsigned j = 0; j <= rows; j++)
        for (unsigned i = 0; i <= columns; i++)
            shape_vertex(&shape, i, j, 0);
    for (unsigned j = 0; j < rows; j++)
        for (unsigned i = 0; i < columns; i++) {
            if (i % 4 == 1 && j % 4 == 1 && i / 4 < columns / 4 && j / 4 < rows / 4)
                continue;
            uint32_t a = grid_vertex(&columns, i, j), b = a + 1, d = a + columns + 1, c = d + 1;
            shape_triangle(&shape, a, b, c);
            shape_triangle(&shape, a, c, d);
        }
    return shape;
}

static uint32_t strip_vertex(const void *user, unsigned i, unsigned j)
{
    (void)user;
    return 2 * i + j;
}

struct shape shape_spiral_ramp(unsigned turns, unsigned cells_a_turn)
{
    struct shape shape = {0};
    unsigned cells = turns * cells_a_turn;
    for (unsigned i = 0; i <= cells; i++) {
        double angle = two_pi * i / cells_a_turn, height = 0.5 * i / cells_a_turn;
        shape_vertex(&shape, 2 * cos(angle), 2 * sin(angle), height);
        shape_vertex(&shape, cos(angle), sin(angle), height);
    }
    add_cells(&shape, cells, 1, strip_vertex, NULL);
    return shape;
}

static void add_polygon_of_all(struct shape *shape)
{
    uint32_t *corners = malloc(shape->vertex_count * sizeof *corners);
    check(corners != NULL, "allocation");
    for (size_t i = 0; i < shape->vertex_count; i++)
        corners[i] = (uint32_t)i;
    shape_face(shape, shape->vertex_count, corners);
    free(corners);
}

struct shape shape_comb(unsigned teeth)
{
    struct shape shape = {0};
    shape_vertex(&shape, 0, -1, 0);
    shape_vertex(&shape, 2.0 * teeth - 1, -1, 0);
    for (unsigned i = teeth; i-- > 0;) {
        if (i + 1 < teeth)
            shape_vertex(&shape, 2.0 * i + 1.5, 0.1, 0);
        shape_vertex(&shape, 2.0 * i + 1, 10, 0);
        shape_vertex(&shape, 2.0 * i, 10, 0);
        if (i > 0)
            shape_vertex(&shape, 2.0 * i - 0.25, 0, 0);
    }
    add_polygon_of_all(&shape);
    return shape;
}

struct shape shape_star_polygon(unsigned corners, uint64_t seed)
{
    struct shape shape = {0};
    for (unsigned i = 0; i < corners; i++) {
        double angle = two_pi * i / corners, radius = 0.2 + 0.8 * random_unit(&seed);
        shape_vertex(&shape, radius * cos(angle), radius * sin(angle), 0);
    }
    add_polygon_of_all(&shape);
    return shape;
}

/* ---- not orientable ---- */

static uint32_t mobius_vertex(const void *user, unsigned i, unsigned j)
{
    const struct wrapping *size = user;
    if (i == size->around)
        return size->across - j;
    return i * (size->across + 1) + j;
}

struct shape shape_mobius(unsigned around, unsigned across)
{
    struct shape shape = {0};
    for (unsigned i = 0; i < around; i++)
        for (unsigned j = 0; j <= across; j++) {
            double u = two_pi * i / around, w = (double)j / across - 0.5;
            double radius = 1 + w * cos(u / 2);
            shape_vertex(&shape, radius * cos(u), radius * sin(u), w * sin(u / 2));
        }
    add_cells(&shape, around, across, mobius_vertex, &(struct wrapping){around, across});
    return shape;
}

static uint32_t klein_vertex(const void *user, unsigned i, unsigned j)
{
    const struct wrapping *size = user;
    j %= size->across;
    if (i == size->around)
        return (size->across - j) % size->across;
    return i * size->across + j;
}

struct shape shape_klein_bottle(unsigned around, unsigned across)
{
    struct shape shape = {0};
    for (unsigned i = 0; i < around; i++)
        for (unsigned j = 0; j < across; j++) {
            double u = two_pi * i / around, v = two_pi * j / across;
            double radius = 2 + cos(u / 2) * sin(v) - sin(u / 2) * sin(2 * v);
            shape_vertex(&shape, radius * cos(u), radius * sin(u),
                         sin(u / 2) * sin(v) + cos(u / 2) * sin(2 * v));
        }
    add_cells(&shape, around, across, klein_vertex, &(struct wrapping){around, across});
    return shape;
}

/* ---- not manifold ---- */

/* Adds the mirror image in the plane {p : p.normal = distance}; the vertices `shared` are common.
 */
static void add_mirrored(struct shape *shape, const double normal[3], double distance,
                         const uint32_t *shared, unsigned shared_count)
{
    size_t vertices = shape->vertex_count, faces = shape->face_count;
    uint32_t *number = malloc(vertices * sizeof *number);
    check(number != NULL, "allocation");
    for (size_t v = 0; v < vertices; v++) {
        const double *p = shape->positions + 3 * v;
        double q[3], t = p[0] * normal[0] + p[1] * normal[1] + p[2] * normal[2] - distance;
        for (unsigned k = 0; k < 3; k++)
            q[k] = p[k] - 2 * t * normal[k];
        bool is_shared = false;
        for (unsigned i = 0; i < shared_count; i++)
            is_shared |= shared[i] == v;
        number[v] = is_shared ? (uint32_t)v : shape_vertex(shape, q[0], q[1], q[2]);
    }
    for (size_t f = 0; f < faces; f++) {
        uint32_t face[3];
        memcpy(face, shape->indices + 3 * f, sizeof face);
        shape_triangle(shape, number[face[0]], number[face[2]], number[face[1]]);
    }
    free(number);
}

struct shape shape_spheres_touching_vertex(unsigned level)
{
    struct shape shape = shape_icosphere(level);
    double normal[3];
    memcpy(normal, shape.positions, sizeof normal);
    add_mirrored(&shape, normal, 1, (const uint32_t[]){0}, 1);
    return shape;
}

struct shape shape_spheres_touching_edge(unsigned level)
{
    struct shape shape = shape_icosphere(level);
    uint32_t edge[2] = {shape.indices[0], shape.indices[1]};
    double middle[3], length = 0;
    for (unsigned k = 0; k < 3; k++) {
        middle[k] = (shape.positions[3 * edge[0] + k] + shape.positions[3 * edge[1] + k]) / 2;
        length += middle[k] * middle[k];
    }
    length = sqrt(length);
    for (unsigned k = 0; k < 3; k++)
        middle[k] /= length;
    add_mirrored(&shape, middle, length, edge, 2);
    return shape;
}

/* ---- changes ---- */

void shape_append(struct shape *shape, const struct shape *other)
{
    uint32_t base = (uint32_t)shape->vertex_count;
    size_t at = 0, vertices = other->vertex_count, faces = other->face_count;
    for (size_t v = 0; v < vertices; v++) {
        uint32_t added = shape_vertex(shape, 0, 0, 0);
        memcpy(shape->positions + 3 * (size_t)added, other->positions + 3 * v, 3 * sizeof(double));
    }
    for (size_t f = 0; f < faces; f++) {
        uint32_t size = other->sizes[f];
        shape_face(shape, size, other->indices + at);
        for (uint32_t i = 0; i < size; i++)
            shape->indices[shape->index_count - size + i] += base;
        at += size;
    }
}

static uint32_t *permutation(size_t count, uint64_t *seed)
{
    uint32_t *order = malloc((count + 1) * sizeof *order);
    check(order != NULL, "allocation");
    for (size_t i = 0; i < count; i++)
        order[i] = (uint32_t)i;
    for (size_t i = count; i > 1; i--) {
        size_t j = random_below(seed, i);
        uint32_t swap = order[i - 1];
        order[i - 1] = order[j];
        order[j] = swap;
    }
    return order;
}

void shape_shuffle(struct shape *shape, uint64_t seed)
{
    struct shape old = *shape;
    uint32_t *vertices = permutation(old.vertex_count, &seed);
    uint32_t *faces = permutation(old.face_count, &seed);
    size_t *first = malloc((old.face_count + 1) * sizeof *first);
    check(first != NULL, "allocation");
    first[0] = 0;
    for (size_t f = 0; f < old.face_count; f++)
        first[f + 1] = first[f] + old.sizes[f];

    memset(shape, 0, sizeof *shape);
    for (size_t v = 0; v < old.vertex_count; v++)
        shape_vertex(shape, 0, 0, 0);
    for (size_t v = 0; v < old.vertex_count; v++)
        memcpy(shape->positions + 3 * (size_t)vertices[v], old.positions + 3 * v,
               3 * sizeof(double));
    for (size_t f = 0; f < old.face_count; f++) {
        const uint32_t *from = old.indices + first[faces[f]];
        uint32_t size = old.sizes[faces[f]], turn = (uint32_t)random_below(&seed, size);
        shape_face(shape, size, from);
        for (uint32_t i = 0; i < size; i++)
            shape->indices[shape->index_count - size + i] = vertices[from[(i + turn) % size]];
    }
    free(first);
    free(faces);
    free(vertices);
    shape_free(&old);
}

void shape_flip(struct shape *shape, size_t face)
{
    uint32_t *corners = shape->indices, size = shape->sizes[face];
    for (size_t f = 0; f < face; f++)
        corners += shape->sizes[f];
    for (uint32_t i = 0; i < size / 2; i++) {
        uint32_t swap = corners[i];
        corners[i] = corners[size - 1 - i];
        corners[size - 1 - i] = swap;
    }
}

void shape_move(struct shape *shape, double scale, double x, double y, double z)
{
    const double offset[3] = {x, y, z};
    for (size_t i = 0; i < 3 * shape->vertex_count; i++)
        shape->positions[i] = shape->positions[i] * scale + offset[i % 3];
}

void shape_fan(struct shape *shape)
{
    struct shape old = *shape;
    const uint32_t *corners = old.indices;
    shape->face_count = shape->index_count = 0;
    shape->sizes = shape->indices = NULL;
    for (size_t f = 0; f < old.face_count; f++) {
        for (uint32_t i = 2; i < old.sizes[f]; i++)
            shape_triangle(shape, corners[0], corners[i - 1], corners[i]);
        corners += old.sizes[f];
    }
    free(old.sizes);
    free(old.indices);
}

/* ---- to the product's types ---- */

static bool shape_is_float32(const struct shape *shape)
{
    for (size_t i = 0; i < 3 * shape->vertex_count; i++)
        if ((double)(float)shape->positions[i] != shape->positions[i])
            return false;
    return true;
}

void shape_to_mesh(struct context *ctx, const struct shape *shape, struct mesh *mesh)
{
    memset(mesh, 0, sizeof *mesh);
    mesh->vertex_count = shape->vertex_count;
    for (size_t f = 0; f < shape->face_count; f++)
        mesh->face_count += shape->sizes[f] - 2;
    check(memory_take(ctx, 3 * mesh->vertex_count, sizeof(double), &mesh->positions) == STATUS_OK &&
              memory_take(ctx, 3 * mesh->face_count, sizeof(uint32_t), &mesh->faces) == STATUS_OK,
          "allocation");
    if (shape->vertex_count)
        memcpy(mesh->positions, shape->positions, 3 * shape->vertex_count * sizeof(double));
    const uint32_t *corners = shape->indices;
    uint32_t *out = mesh->faces;
    for (size_t f = 0; f < shape->face_count; f++) {
        for (uint32_t i = 2; i < shape->sizes[f]; i++) {
            *out++ = corners[0];
            *out++ = corners[i - 1];
            *out++ = corners[i];
        }
        corners += shape->sizes[f];
    }
    mesh->is_float32 = shape_is_float32(shape);
}

void shape_into_mesh(struct context *ctx, struct shape *shape, struct mesh *mesh)
{
    shape_to_mesh(ctx, shape, mesh);
    shape_free(shape);
}

/* ---- encoders ---- */

struct bytes {
    unsigned char *data;
    size_t size, capacity;
};

static void put(struct bytes *out, const void *data, size_t size)
{
    if (out->size + size + 1 > out->capacity) {
        out->capacity = 2 * out->capacity + size + 64;
        out->data = realloc(out->data, out->capacity);
        check(out->data != NULL, "allocation");
    }
    memcpy(out->data + out->size, data, size);
    out->size += size;
    out->data[out->size] = 0;
}

__attribute__((format(printf, 2, 3))) static void put_text(struct bytes *out, const char *format,
                                                           ...)
{
    char line[512];
    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf(line, sizeof line, format, arguments);
    va_end(arguments);
    check(length >= 0 && (size_t)length < sizeof line, "formatting");
    put(out, line, (size_t)length);
}

static void put_integer(struct bytes *out, uint64_t value, unsigned size, bool is_big)
{
    unsigned char data[8];
    for (unsigned i = 0; i < size; i++)
        data[is_big ? size - 1 - i : i] = (unsigned char)(value >> 8 * i);
    put(out, data, size);
}

static void put_real(struct bytes *out, double value, bool as_float, bool is_big)
{
    float single = (float)value;
    uint32_t bits32;
    uint64_t bits64;
    memcpy(&bits32, &single, sizeof bits32);
    memcpy(&bits64, &value, sizeof bits64);
    put_integer(out, as_float ? bits32 : bits64, as_float ? 4 : 8, is_big);
}

static void encode_ply(const struct shape *shape, enum shape_format format, struct bytes *out)
{
    bool as_float = shape_is_float32(shape), is_big = format == SHAPE_PLY_BIG;
    const char *type = as_float ? "float" : "double";
    put_text(out, "ply\nformat %s 1.0\n",
             format == SHAPE_PLY_ASCII    ? "ascii"
             : format == SHAPE_PLY_LITTLE ? "binary_little_endian"
                                          : "binary_big_endian");
    put_text(out, "element vertex %zu\nproperty %s x\nproperty %s y\nproperty %s z\n",
             shape->vertex_count, type, type, type);
    put_text(out, "element face %zu\nproperty list uchar int vertex_indices\nend_header\n",
             shape->face_count);
    for (size_t v = 0; v < shape->vertex_count; v++) {
        const double *p = shape->positions + 3 * v;
        if (format == SHAPE_PLY_ASCII)
            put_text(out, as_float ? "%.9g %.9g %.9g\n" : "%.17g %.17g %.17g\n", p[0], p[1], p[2]);
        else
            for (unsigned k = 0; k < 3; k++)
                put_real(out, p[k], as_float, is_big);
    }
    const uint32_t *corner = shape->indices;
    for (size_t f = 0; f < shape->face_count; f++) {
        check(shape->sizes[f] < 256, "uchar list size");
        if (format == SHAPE_PLY_ASCII)
            put_text(out, "%u", shape->sizes[f]);
        else
            put_integer(out, shape->sizes[f], 1, is_big);
        for (uint32_t i = 0; i < shape->sizes[f]; i++, corner++) {
            if (format == SHAPE_PLY_ASCII)
                put_text(out, " %u", *corner);
            else
                put_integer(out, *corner, 4, is_big);
        }
        if (format == SHAPE_PLY_ASCII)
            put_text(out, "\n");
    }
}

static void encode_obj_or_off(const struct shape *shape, bool is_obj, struct bytes *out)
{
    bool as_float = shape_is_float32(shape);
    if (!is_obj)
        put_text(out, "OFF\n%zu %zu 0\n", shape->vertex_count, shape->face_count);
    for (size_t v = 0; v < shape->vertex_count; v++) {
        const double *p = shape->positions + 3 * v;
        put_text(out, is_obj ? "v " : "");
        put_text(out, as_float ? "%.9g %.9g %.9g\n" : "%.17g %.17g %.17g\n", p[0], p[1], p[2]);
    }
    const uint32_t *corner = shape->indices;
    for (size_t f = 0; f < shape->face_count; f++) {
        if (is_obj)
            put_text(out, "f");
        else
            put_text(out, "%u", shape->sizes[f]);
        for (uint32_t i = 0; i < shape->sizes[f]; i++, corner++)
            put_text(out, " %u", *corner + (is_obj ? 1 : 0));
        put_text(out, "\n");
    }
}

static void encode_stl(const struct shape *polygons, bool is_text, struct bytes *out)
{
    struct shape shape = {0};
    shape_append(&shape, polygons);
    shape_fan(&shape);
    static const char header[80] = "made by test_shapes";
    if (is_text) {
        put_text(out, "solid shape\n");
    } else {
        put(out, header, sizeof header);
        put_integer(out, shape.face_count, 4, false);
    }
    for (size_t f = 0; f < shape.face_count; f++) {
        if (is_text)
            put_text(out, "  facet normal 0 0 0\n    outer loop\n");
        else
            put(out, (const char[12]){0}, 12);
        for (unsigned k = 0; k < 3; k++) {
            const double *p = shape.positions + 3 * (size_t)shape.indices[3 * f + k];
            if (is_text)
                put_text(out, "      vertex %.9g %.9g %.9g\n", p[0], p[1], p[2]);
            else
                for (unsigned i = 0; i < 3; i++)
                    put_real(out, p[i], true, false);
        }
        if (is_text)
            put_text(out, "    endloop\n  endfacet\n");
        else
            put(out, (const char[2]){0}, 2);
    }
    if (is_text)
        put_text(out, "endsolid shape\n");
    shape_free(&shape);
}

unsigned char *shape_encode(const struct shape *shape, enum shape_format format, size_t *size)
{
    struct bytes out = {0};
    if (format == SHAPE_PLY_ASCII || format == SHAPE_PLY_LITTLE || format == SHAPE_PLY_BIG)
        encode_ply(shape, format, &out);
    else if (format == SHAPE_OBJ || format == SHAPE_OFF)
        encode_obj_or_off(shape, format == SHAPE_OBJ, &out);
    else
        encode_stl(shape, format == SHAPE_STL_ASCII, &out);
    *size = out.size;
    return out.data;
}

void shape_write(const struct shape *shape, enum shape_format format, const char *path)
{
    size_t size;
    unsigned char *data = shape_encode(shape, format, &size);
    file_write(path, data, size);
    free(data);
}

/* ---- files ---- */

static char folder[4096];
static pid_t folder_owner;

static void remove_folder(void)
{
    char name[8192];
    if (getpid() != folder_owner)
        return; /* a forked child must not take its parent's files */
    DIR *list = opendir(folder);
    for (struct dirent *entry; list && (entry = readdir(list));) {
        snprintf(name, sizeof name, "%s/%s", folder, entry->d_name);
        if (unlink(name) != 0)
            rmdir(name);
    }
    if (list)
        closedir(list);
    rmdir(folder);
}

const char *test_folder(void)
{
    if (!folder[0]) {
        const char *parent = getenv("TMPDIR");
        snprintf(folder, sizeof folder, "%s/spbm-test-XXXXXX", parent ? parent : "/tmp");
        check(mkdtemp(folder) != NULL, "making a test folder");
        folder_owner = getpid();
        atexit(remove_folder);
    }
    return folder;
}

static char *next_path_buffer(size_t *size)
{
    static char buffers[8][8192];
    static unsigned turn;
    *size = sizeof buffers[0];
    return buffers[turn++ % 8];
}

const char *test_path(const char *name)
{
    size_t size;
    char *buffer = next_path_buffer(&size);
    snprintf(buffer, size, "%s/%s", test_folder(), name);
    return buffer;
}

const char *test_data(const char *name)
{
    static const char *const folders[] = {"../shared/data", "../../shared/data",
                                          "../../../shared/data"};
    size_t size;
    char *buffer = next_path_buffer(&size);
    const char *given = getenv("SPBM_DATA");
    if (given) {
        snprintf(buffer, size, "%s/%s", given, name);
        return access(buffer, R_OK) == 0 ? buffer : NULL;
    }
    for (size_t i = 0; i < sizeof folders / sizeof *folders; i++) {
        snprintf(buffer, size, "%s/%s", folders[i], name);
        if (access(buffer, R_OK) == 0)
            return buffer;
    }
    return NULL;
}
