/*
 * Patches without patchify. Everything is done by sorting and by arrays over the whole mesh, and
 * memory is given back by patch_set_free; nothing here is meant to be fast.
 */
#include "test_patches.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "test_shapes.h"

#define NONE UINT32_MAX

struct cutting {
    const struct mesh *mesh;
    uint32_t faces, vertices;
    uint32_t *neighbours; /* 3 a face: face over edge k */
    uint32_t *labels;     /* a face: its patch */
    uint32_t *slabs;      /* a patch: its slab */
    uint32_t *places;     /* a patch: its number in its slab */
    uint32_t *boundary;   /* a vertex: boundary edges that meet there */
    bool *junction;       /* a vertex */
    bool *seam;           /* a vertex: on a chain between slabs */
    bool *inside;         /* a vertex: strictly inside a patch */
    uint32_t *locals;     /* a vertex: its number in the block that is being made */
    uint32_t patches;
};

static void *need(size_t count, size_t size)
{
    void *memory = calloc(count > 0 ? count : 1, size);
    if (!memory)
        abort();
    return memory;
}

/* ---- adjacency ---- */

struct side {
    uint32_t low, high, corner;
};

static int compare_sides(const void *left, const void *right)
{
    const struct side *a = left, *b = right;
    if (a->low != b->low)
        return a->low < b->low ? -1 : 1;
    if (a->high != b->high)
        return a->high < b->high ? -1 : 1;
    return 0;
}

static uint32_t corner_vertex(const struct cutting *cut, uint32_t face, uint32_t k)
{
    return cut->mesh->faces[3 * (size_t)face + k % 3];
}

static void find_neighbours(struct cutting *cut)
{
    size_t count = 3 * (size_t)cut->faces;
    struct side *sides = need(count, sizeof *sides);
    for (uint32_t c = 0; c < count; c++) {
        uint32_t a = corner_vertex(cut, c / 3, c % 3), b = corner_vertex(cut, c / 3, c % 3 + 1);
        sides[c] = (struct side){a < b ? a : b, a < b ? b : a, c};
    }
    qsort(sides, count, sizeof *sides, compare_sides);
    cut->neighbours = need(count, sizeof *cut->neighbours);
    memset(cut->neighbours, 0xff, count * sizeof *cut->neighbours);
    for (size_t i = 0; i + 1 < count; i++)
        if (compare_sides(&sides[i], &sides[i + 1]) == 0) {
            cut->neighbours[sides[i].corner] = sides[i + 1].corner / 3;
            cut->neighbours[sides[i + 1].corner] = sides[i].corner / 3;
        }
    free(sides);
}

/* ---- growing ---- */

/* May the face join the patch without its boundary passing a vertex twice? `on` tells which
 * vertices the patch has (stamp). */
static bool may_join(const struct cutting *cut, uint32_t face, uint32_t patch, const uint32_t *on)
{
    uint32_t shared = 0, place = 0;
    for (uint32_t k = 0; k < 3; k++) {
        uint32_t other = cut->neighbours[3 * (size_t)face + k];
        if (other != NONE && cut->labels[other] == patch) {
            shared++;
            place = k;
        }
    }
    if (shared == 1)
        return on[corner_vertex(cut, face, place + 2)] != patch + 1;
    return shared == 2;
}

static void grow(struct cutting *cut, uint32_t most_faces, uint64_t *random)
{
    uint32_t *on = need(cut->vertices, sizeof *on), *queue = need(cut->faces, sizeof *queue);
    memset(cut->labels, 0xff, cut->faces * sizeof *cut->labels);
    for (uint32_t i = 0; i < cut->faces; i++) {
        uint32_t seed = (uint32_t)((i + (uint64_t)cut->faces / 3) % cut->faces), size = 1;
        if (cut->labels[seed] != NONE)
            continue;
        uint32_t patch = cut->patches++, limit = 1 + (uint32_t)random_below(random, most_faces);
        cut->labels[seed] = patch;
        queue[0] = seed;
        for (uint32_t k = 0; k < 3; k++)
            on[corner_vertex(cut, seed, k)] = patch + 1;
        for (uint32_t tries = 0; size < limit && tries < 8 * limit; tries++) {
            uint32_t from = queue[random_below(random, size)];
            uint32_t k = (uint32_t)random_below(random, 3);
            uint32_t face = cut->neighbours[3 * (size_t)from + k];
            if (face == NONE || cut->labels[face] != NONE || !may_join(cut, face, patch, on))
                continue;
            cut->labels[face] = patch;
            queue[size++] = face;
            for (uint32_t j = 0; j < 3; j++)
                on[corner_vertex(cut, face, j)] = patch + 1;
        }
    }
    free(on);
    free(queue);
}

/* ---- boundary ---- */

static bool is_boundary(const struct cutting *cut, uint32_t corner)
{
    uint32_t other = cut->neighbours[corner];
    return other == NONE || cut->labels[other] != cut->labels[corner / 3];
}

/* The boundary edge after `corner` round its patch, as the corner that it starts at: turns round
 * the edge's end through the patch's faces. */
static uint32_t boundary_after(const struct cutting *cut, uint32_t corner)
{
    uint32_t next = corner - corner % 3 + (corner + 1) % 3;
    uint32_t vertex = cut->mesh->faces[next];
    while (!is_boundary(cut, next)) {
        uint32_t face = cut->neighbours[next];
        next = 3 * face;
        while (cut->mesh->faces[next] != vertex)
            next++;
    }
    return next;
}

static void mark_vertices(struct cutting *cut)
{
    size_t corners = 3 * (size_t)cut->faces;
    for (uint32_t v = 0; v < cut->vertices; v++)
        cut->inside[v] = true;
    for (uint32_t c = 0; c < corners; c++)
        if (is_boundary(cut, c)) {
            uint32_t a = corner_vertex(cut, c / 3, c % 3), b = corner_vertex(cut, c / 3, c % 3 + 1);
            uint32_t other = cut->neighbours[c];
            bool once = other == NONE || cut->labels[c / 3] < cut->labels[other];
            cut->boundary[a] += once;
            cut->boundary[b] += once;
            cut->inside[a] = cut->inside[b] = false;
            if (other != NONE && cut->slabs[cut->labels[other]] != cut->slabs[cut->labels[c / 3]])
                cut->seam[a] = cut->seam[b] = true;
        }
    for (uint32_t v = 0; v < cut->vertices; v++)
        cut->junction[v] = cut->boundary[v] > 2;
    /* Loops without a junction get three: the first vertex met, and two more a third further on. */
    bool *seen = need(corners, sizeof *seen);
    for (uint32_t c = 0; c < corners; c++) {
        uint32_t length = 0, g = c;
        bool has = false;
        if (!is_boundary(cut, c) || seen[c])
            continue;
        do {
            seen[g] = true;
            has = has || cut->junction[cut->mesh->faces[g]];
            length++;
            g = boundary_after(cut, g);
        } while (g != c);
        for (uint32_t i = 0; i < length && !has; i++, g = boundary_after(cut, g))
            if (i == 0 || i == length / 3 || i == 2 * length / 3)
                cut->junction[cut->mesh->faces[g]] = true;
        /* The other side of the same loop must not get others: its vertices are junctions now. */
    }
    free(seen);
}

/* ---- blocks ---- */

struct list {
    uint32_t *items;
    size_t count, capacity;
};

static void list_add(struct list *list, uint32_t item)
{
    if (list->count == list->capacity) {
        list->capacity = list->capacity > 0 ? 2 * list->capacity : 64;
        list->items = realloc(list->items, list->capacity * sizeof *list->items);
        if (!list->items)
            abort();
    }
    list->items[list->count++] = item;
}

struct block_lists {
    struct list vertices; /* mesh vertices in block order */
    struct list own;      /* own chains: left, right, count, then mesh vertices */
    struct list seams;    /* seam chains: left, slab, right, count, then mesh vertices */
    struct list diagonals;
};

/* Follows the chain that starts with the boundary edge at `corner`; adds its record. Returns true
 * if this patch is the one that keeps it. */
static void add_chain(struct cutting *cut, uint32_t corner, struct block_lists *lists)
{
    uint32_t patch = cut->labels[corner / 3], other = cut->neighbours[corner];
    uint32_t over = other == NONE ? NONE : cut->labels[other];
    bool is_seam = over != NONE && cut->slabs[over] != cut->slabs[patch];
    if (!is_seam && over != NONE && over < patch)
        return;
    struct list *list = is_seam ? &lists->seams : &lists->own;
    list_add(list, cut->places[patch]);
    if (is_seam)
        list_add(list, cut->slabs[over]);
    list_add(list, over == NONE ? NONE : cut->places[over]);
    size_t count_at = list->count;
    list_add(list, 0);
    uint32_t g = corner, count = 1;
    list_add(list, cut->mesh->faces[g]);
    do {
        list_add(list, corner_vertex(cut, g / 3, g % 3 + 1));
        count++;
        g = boundary_after(cut, g);
    } while (!cut->junction[cut->mesh->faces[g]]);
    list->items[count_at] = count;
}

static void number_vertex(struct cutting *cut, struct block_lists *lists, uint32_t v)
{
    cut->locals[v] = (uint32_t)lists->vertices.count;
    list_add(&lists->vertices, v);
}

/* What lies in a patch: interior vertices (at most two are kept), else diagonals. */
static void fill_patch(struct cutting *cut, uint32_t patch, struct patch *record,
                       struct block_lists *lists)
{
    struct vec3 normal = {0, 0, 0};
    double area = 0;
    record->interior_first = (uint32_t)lists->vertices.count;
    for (uint32_t f = 0; f < cut->faces; f++) {
        if (cut->labels[f] != patch)
            continue;
        const uint32_t *face = cut->mesh->faces + 3 * (size_t)f;
        struct vec3 n = triangle_normal(vec3_load(cut->mesh->positions + 3 * (size_t)face[0]),
                                        vec3_load(cut->mesh->positions + 3 * (size_t)face[1]),
                                        vec3_load(cut->mesh->positions + 3 * (size_t)face[2]));
        normal = vec3_add(normal, n);
        area += vec3_length(n) / 2;
        for (int k = 0; k < 3; k++)
            if (cut->inside[face[k]] && record->interior_count < 2 &&
                cut->locals[face[k]] == NONE) {
                number_vertex(cut, lists, face[k]);
                record->interior_count++;
            }
    }
    normal = vec3_normalized(normal);
    record->normal[0] = (float)normal.x;
    record->normal[1] = (float)normal.y;
    record->normal[2] = (float)normal.z;
    record->area = (float)area;
    record->diagonal_first = (uint32_t)(lists->diagonals.count / 2);
    for (uint32_t f = 0; f < cut->faces && record->interior_count == 0; f++)
        for (uint32_t k = 0; k < 3 && cut->labels[f] == patch; k++) {
            uint32_t c = 3 * f + k;
            if (is_boundary(cut, c) || cut->neighbours[c] < f)
                continue;
            list_add(&lists->diagonals, cut->locals[cut->mesh->faces[c]]);
            list_add(&lists->diagonals, cut->locals[corner_vertex(cut, f, k + 1)]);
            record->diagonal_count++;
        }
}

static void fill_chains(struct cutting *cut, struct chain_block *block, struct block_lists *lists)
{
    struct chain *chain = block->chains = need(lists->own.count, sizeof *chain);
    for (size_t i = 0; i < lists->own.count; chain++) {
        const uint32_t *item = lists->own.items + i;
        uint32_t count = item[2];
        *chain = (struct chain){cut->locals[item[3]],
                                cut->locals[item[3 + count - 1]],
                                item[0],
                                item[1],
                                (uint32_t)lists->vertices.count,
                                count - 2};
        for (uint32_t k = 1; k + 1 < count; k++)
            number_vertex(cut, lists, item[3 + k]);
        i += 3 + count;
    }
    block->chain_count = (uint32_t)(chain - block->chains);
    struct seam_chain *seam = block->seam_chains = need(lists->seams.count, sizeof *seam);
    block->seam_lists = need(lists->seams.count, sizeof *block->seam_lists);
    for (size_t i = 0; i < lists->seams.count; seam++) {
        const uint32_t *item = lists->seams.items + i;
        uint32_t count = item[3];
        *seam = (struct seam_chain){item[0], item[1], item[2], block->seam_list_count, count};
        for (uint32_t k = 0; k < count; k++)
            block->seam_lists[block->seam_list_count++] = cut->locals[item[4 + k]];
        i += 4 + count;
    }
    block->seam_chain_count = (uint32_t)(seam - block->seam_chains);
}

static void make_block(struct cutting *cut, uint32_t slab, struct chain_block *block)
{
    struct block_lists lists = {0};
    bool *in_slab = need(cut->vertices, sizeof *in_slab);
    memset(cut->locals, 0xff, cut->vertices * sizeof *cut->locals);
    block->slab = slab;
    for (uint32_t c = 0; c < 3 * cut->faces; c++)
        if (cut->slabs[cut->labels[c / 3]] == slab)
            in_slab[cut->mesh->faces[c]] = true;
    for (uint32_t v = 0; v < cut->vertices; v++)
        if (in_slab[v] && cut->junction[v] && !cut->seam[v])
            number_vertex(cut, &lists, v);
    block->junction_count = (uint32_t)lists.vertices.count;
    for (uint32_t v = 0; v < cut->vertices; v++)
        if (in_slab[v] && cut->seam[v])
            number_vertex(cut, &lists, v);
    block->seam_vertex_count = (uint32_t)lists.vertices.count - block->junction_count;
    block->seam_vertices = need(block->seam_vertex_count, sizeof *block->seam_vertices);
    if (block->seam_vertex_count > 0)
        memcpy(block->seam_vertices, lists.vertices.items + block->junction_count,
               block->seam_vertex_count * sizeof *block->seam_vertices);
    for (uint32_t c = 0; c < 3 * cut->faces; c++)
        if (cut->slabs[cut->labels[c / 3]] == slab && is_boundary(cut, c) &&
            cut->junction[cut->mesh->faces[c]])
            add_chain(cut, c, &lists);
    fill_chains(cut, block, &lists);
    for (uint32_t p = 0; p < cut->patches; p++)
        block->patch_count += cut->slabs[p] == slab;
    block->patches = need(block->patch_count, sizeof *block->patches);
    for (uint32_t p = 0; p < cut->patches; p++)
        if (cut->slabs[p] == slab)
            fill_patch(cut, p, &block->patches[cut->places[p]], &lists);
    block->vertex_count = (uint32_t)lists.vertices.count;
    block->positions = need(3 * (size_t)block->vertex_count, sizeof *block->positions);
    for (size_t i = 0; i < 3 * (size_t)block->vertex_count; i++)
        block->positions[i] =
            (float)cut->mesh->positions[3 * (size_t)lists.vertices.items[i / 3] + i % 3];
    block->diagonals = lists.diagonals.items;
    block->diagonal_count = (uint32_t)(lists.diagonals.count / 2);
    free(lists.vertices.items);
    free(lists.own.items);
    free(lists.seams.items);
    free(in_slab);
}

void patch_set_build(const struct mesh *mesh, uint32_t most_faces, uint32_t block_count,
                     uint64_t seed, struct patch_set *set)
{
    struct cutting cut = {.mesh = mesh,
                          .faces = (uint32_t)mesh->face_count,
                          .vertices = (uint32_t)mesh->vertex_count};
    uint64_t random = seed;
    cut.labels = need(cut.faces, sizeof *cut.labels);
    cut.boundary = need(cut.vertices, sizeof *cut.boundary);
    cut.junction = need(cut.vertices, sizeof *cut.junction);
    cut.seam = need(cut.vertices, sizeof *cut.seam);
    cut.inside = need(cut.vertices, sizeof *cut.inside);
    cut.locals = need(cut.vertices, sizeof *cut.locals);
    find_neighbours(&cut);
    grow(&cut, most_faces, &random);
    cut.slabs = need(cut.patches, sizeof *cut.slabs);
    cut.places = need(cut.patches, sizeof *cut.places);
    uint32_t *counts = need(block_count, sizeof *counts);
    for (uint32_t p = 0; p < cut.patches; p++) {
        cut.slabs[p] = (uint32_t)((uint64_t)p * block_count / cut.patches);
        cut.places[p] = counts[cut.slabs[p]]++;
    }
    mark_vertices(&cut);
    *set = (struct patch_set){.block_count = block_count};
    set->blocks = need(block_count, sizeof *set->blocks);
    uint64_t boundary_corners = 0;
    for (uint32_t c = 0; c < 3 * cut.faces; c++)
        boundary_corners += is_boundary(&cut, c);
    set->loop_faces = boundary_corners - 2 * (uint64_t)cut.patches;
    for (uint32_t i = 0; i < block_count; i++)
        make_block(&cut, i, &set->blocks[i]);
    free(counts);
    free(cut.neighbours);
    free(cut.labels);
    free(cut.slabs);
    free(cut.places);
    free(cut.boundary);
    free(cut.junction);
    free(cut.seam);
    free(cut.inside);
    free(cut.locals);
}

void patch_set_free(struct patch_set *set)
{
    for (uint32_t i = 0; i < set->block_count; i++) {
        struct chain_block *block = &set->blocks[i];
        free(block->positions);
        free(block->seam_vertices);
        free(block->chains);
        free(block->patches);
        free(block->diagonals);
        free(block->seam_chains);
        free(block->seam_lists);
    }
    free(set->blocks);
    *set = (struct patch_set){0};
}

static enum status give_block(void *user, uint32_t index, struct chain_block *block)
{
    const struct patch_set *set = user;
    *block = set->blocks[index];
    return STATUS_OK;
}

static void keep_block(void *user, struct chain_block *block)
{
    (void)user;
    (void)block;
}

struct block_source patch_set_source(struct patch_set *set)
{
    return (struct block_source){set->block_count, 0, give_block, keep_block, set};
}

void patch_set_graph(struct context *ctx, struct patch_set *set, struct chain_graph *graph)
{
    struct block_source source = patch_set_source(set);
    if (chain_graph_build(ctx, &source, test_path("records"), graph) != STATUS_OK) {
        fprintf(stderr, "chain graph: %s\n", ctx->error);
        abort();
    }
}
