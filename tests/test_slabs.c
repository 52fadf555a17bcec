/* Adjacency by sorting all edges: simple, and independent of src/mesh. */
#include "test_slabs.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

struct edge {
    uint32_t low, high, place; /* place: 3 * face + edge */
};

static int compare_edges(const void *left, const void *right)
{
    const struct edge *a = left, *b = right;
    if (a->low != b->low)
        return a->low < b->low ? -1 : 1;
    if (a->high != b->high)
        return a->high < b->high ? -1 : 1;
    return a->place < b->place ? -1 : a->place > b->place;
}

static int compare_numbers(const void *left, const void *right)
{
    uint32_t a = *(const uint32_t *)left, b = *(const uint32_t *)right;
    return a < b ? -1 : a > b;
}

static void *take(size_t count, size_t size)
{
    void *block = calloc(count ? count : 1, size);
    if (!block)
        abort();
    return block;
}

static void number_vertices(const struct mesh *mesh, struct slab_set *set)
{
    uint32_t *number = take(mesh->vertex_count, sizeof *number);
    memset(number, 0xff, mesh->vertex_count * sizeof *number);
    for (size_t i = 0; i < 3 * mesh->face_count; i++) {
        uint32_t vertex = mesh->faces[i];
        if (number[vertex] == NO_INDEX) {
            number[vertex] = set->vertex_count;
            for (unsigned c = 0; c < 3; c++)
                set->positions[3 * set->vertex_count + c] =
                    (float)mesh->positions[3 * (size_t)vertex + c];
            set->vertex_count++;
        }
        set->faces[i] = number[vertex];
    }
    free(number);
}

static void join_edges(struct slab_set *set)
{
    size_t count = 3 * (size_t)set->face_count;
    struct edge *edges = take(count, sizeof *edges);
    for (size_t i = 0; i < count; i++) {
        uint32_t a = set->faces[i], b = set->faces[i % 3 == 2 ? i - 2 : i + 1];
        edges[i] = (struct edge){a < b ? a : b, a < b ? b : a, (uint32_t)i};
        set->neighbours[i] = NO_INDEX;
    }
    qsort(edges, count, sizeof *edges, compare_edges);
    for (size_t i = 0; i + 1 < count; i++) {
        const struct edge *a = edges + i, *b = edges + i + 1;
        if (a->low != b->low || a->high != b->high)
            continue;
        if (set->faces[a->place] == set->faces[b->place] ||
            (i + 2 < count && edges[i + 2].low == a->low && edges[i + 2].high == a->high)) {
            fprintf(stderr, "test_slabs: edge %u %u is not manifold or not oriented\n", a->low,
                    a->high);
            abort();
        }
        set->neighbours[a->place] = b->place / 3;
        set->neighbours[b->place] = a->place / 3;
        set->mates[a->place / 3] |= (uint8_t)(b->place % 3 << 2 * (a->place % 3));
        set->mates[b->place / 3] |= (uint8_t)(a->place % 3 << 2 * (b->place % 3));
    }
    free(edges);
}

/* Own and foreign vertices of one slab; `next` is the first vertex that no earlier slab uses. */
static void cut_slab(struct slab_set *set, uint32_t index, uint32_t slab_faces, uint32_t next)
{
    struct slab *slab = set->slabs + index;
    uint32_t first = index * slab_faces;
    slab->index = index;
    slab->face_first = first;
    slab->face_count = set->face_count - first < slab_faces ? set->face_count - first : slab_faces;
    slab->vertex_first = slab->vertex_end = next;
    slab->faces = set->faces + 3 * (size_t)first;
    slab->neighbours = set->neighbours + 3 * (size_t)first;
    slab->mates = set->mates + first;

    size_t corners = 3 * (size_t)slab->face_count, count = 0;
    uint32_t *foreign = take(corners, sizeof *foreign);
    for (size_t i = 0; i < corners; i++) {
        uint32_t vertex = slab->faces[i];
        if (vertex >= slab->vertex_end)
            slab->vertex_end = vertex + 1;
        if (vertex < next)
            foreign[count++] = vertex;
    }
    qsort(foreign, count, sizeof *foreign, compare_numbers);
    float *positions = take(3 * count, sizeof *positions);
    for (size_t i = 0; i < count; i++) {
        if (i && foreign[i] == foreign[i - 1])
            continue;
        foreign[slab->foreign_count] = foreign[i];
        memcpy(positions + 3 * (size_t)slab->foreign_count, set->positions + 3 * (size_t)foreign[i],
               3 * sizeof(float));
        slab->foreign_count++;
    }
    slab->foreign = foreign;
    slab->foreign_positions = positions;
    slab->positions = set->positions + 3 * (size_t)slab->vertex_first;
}

void slab_set_build(const struct mesh *mesh, uint32_t slab_faces, struct slab_set *set)
{
    memset(set, 0, sizeof *set);
    set->face_count = (uint32_t)mesh->face_count;
    set->faces = take(3 * mesh->face_count, sizeof *set->faces);
    set->neighbours = take(3 * mesh->face_count, sizeof *set->neighbours);
    set->mates = take(mesh->face_count, 1);
    set->positions = take(3 * mesh->vertex_count, sizeof *set->positions);
    number_vertices(mesh, set);
    join_edges(set);
    set->slab_count = (set->face_count + slab_faces - 1) / slab_faces;
    set->slabs = take(set->slab_count, sizeof *set->slabs);
    uint32_t next = 0;
    for (uint32_t i = 0; i < set->slab_count; i++) {
        cut_slab(set, i, slab_faces, next);
        next = set->slabs[i].vertex_end;
    }
}

void slab_set_free(struct slab_set *set)
{
    for (uint32_t i = 0; i < set->slab_count; i++) {
        free((void *)(uintptr_t)set->slabs[i].foreign);
        free((void *)(uintptr_t)set->slabs[i].foreign_positions);
    }
    free(set->slabs);
    free(set->positions);
    free(set->mates);
    free(set->neighbours);
    free(set->faces);
    memset(set, 0, sizeof *set);
}
