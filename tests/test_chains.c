#include "test_chains.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <math.h>

#include "base/memory.h"
#include "simplify/chain_trace.h"
#include "simplify/patchify.h"
#include "simplify/seam_join.h"
#include "test_kit.h"

#define must(call) assert_int_equal((call), STATUS_OK)

static void *take(size_t count, size_t size)
{
    void *block = calloc(count ? count : 1, size);
    assert_non_null(block);
    return block;
}

struct patch_options test_patch_options(double patch_angle, double face_angle, uint32_t smoothings)
{
    double radian = acos(-1) / 180;
    return (struct patch_options){.patch_cosine = {cos(patch_angle * radian), 0},
                                  .face_cosine = {cos(face_angle * radian), 0},
                                  .smoothings = smoothings,
                                  .most_faces = PATCH_FACES_MAX};
}

/* ---- building ---- */

static void fill_info(struct chain_set *set)
{
    const struct slab_set *slabs = set->slabs;
    struct chain_info *info = &set->info;
    info->topology.vertices = slabs->vertex_count;
    info->topology.faces = slabs->face_count;
    for (size_t c = 0; c < 3 * (size_t)slabs->face_count;
         c++) /* an edge counts at its lower face */
        info->topology.edges += slabs->neighbours[c] > c / 3;
    info->topology.euler = (int64_t)info->topology.vertices - (int64_t)info->topology.edges +
                           (int64_t)info->topology.faces;
    info->slab_count = slabs->slab_count;
    info->is_float32 = true;
    info->options = set->options;
    info->effort = 2;
}

static void count_block(struct chain_info *info, const struct chain_block *block,
                        const struct trace_counts *counts)
{
    info->patches += block->patch_count;
    info->chains += block->chain_count;
    info->junctions += block->junction_count;
    info->chain_vertices += block->junction_count;
    for (uint32_t i = 0; i < block->chain_count; i++)
        info->chain_vertices += block->chains[i].interior_count;
    info->most_faces += counts->most_faces;
}

static void copy_array(struct context *ctx, void *to, const void *from, size_t count, size_t size)
{
    void *copy;
    must(memory_take(ctx, count, size, &copy));
    if (count)
        memcpy(copy, from, count * size);
    memcpy(to, &copy, sizeof copy);
}

/* A block with arrays of its own, as chain_block_read gives them. */
static void copy_block(struct context *ctx, const struct chain_block *from, struct chain_block *to)
{
    *to = *from;
    copy_array(ctx, &to->positions, from->positions, from->vertex_count, 3 * sizeof(float));
    copy_array(ctx, &to->seam_vertices, from->seam_vertices, from->seam_vertex_count,
               sizeof(uint32_t));
    copy_array(ctx, &to->chains, from->chains, from->chain_count, sizeof *from->chains);
    copy_array(ctx, &to->patches, from->patches, from->patch_count, sizeof *from->patches);
    copy_array(ctx, &to->diagonals, from->diagonals, from->diagonal_count, 2 * sizeof(uint32_t));
}

void chain_set_build(struct context *ctx, const struct slab_set *slabs,
                     const struct patch_options *options, struct chain_set *set)
{
    memset(set, 0, sizeof *set);
    set->ctx = ctx;
    set->slabs = slabs;
    set->options = *options;
    set->labels = take(slabs->slab_count, sizeof *set->labels);
    set->patch_counts = take(slabs->slab_count, sizeof *set->patch_counts);
    set->blocks = take(slabs->slab_count, sizeof *set->blocks);
    fill_info(set);

    struct patch_workspace space = {0};
    struct trace_workspace scratch = {0};
    struct seam_join *join;
    must(seam_join_open(ctx, NULL, 1 << 20, slabs->slab_count, &join));
    for (uint32_t i = 0; i < slabs->slab_count; i++) {
        const struct slab *slab = slabs->slabs + i;
        struct slab_seams seams;
        struct trace_counts counts;
        set->labels[i] = take(slab->face_count, sizeof **set->labels);
        struct chain_block block;
        uint32_t patches;
        must(patch_labels(ctx, slab, options, set->labels[i], &patches));
        must(patch_growth_begin(ctx, slab, options, &space));
        must(chain_trace(ctx, NULL, 0, slab, &space, &scratch, &block, &seams, &counts));
        assert_int_equal(block.patch_count, patches);
        set->patch_counts[i] = block.patch_count;
        copy_block(ctx, &block, &set->blocks[i]);
        must(seam_join_add(join, &seams));
        count_block(&set->info, &set->blocks[i], &counts);
        slab_seams_clear(ctx, &seams);
    }
    struct seam_counts counts;
    must(seam_join_link(join, &counts));
    set->info.chains += counts.chains;
    set->info.seam_chains = counts.chains;
    set->info.junctions += counts.junctions;
    set->info.chain_vertices += counts.vertices;
    for (uint32_t i = 0; i < slabs->slab_count; i++) {
        struct chain_block seams;
        must(seam_join_next(join, &seams));
        set->blocks[i].seam_chains = seams.seam_chains;
        set->blocks[i].seam_chain_count = seams.seam_chain_count;
        set->blocks[i].seam_lists = seams.seam_lists;
        set->blocks[i].seam_list_count = seams.seam_list_count;
    }
    seam_join_close(&join);
    patch_workspace_clear(ctx, &space);
    trace_workspace_clear(ctx, &scratch);
}

void chain_set_free(struct chain_set *set)
{
    for (uint32_t i = 0; i < set->slabs->slab_count; i++) {
        free(set->labels[i]);
        chain_block_clear(set->ctx, 0, &set->blocks[i]);
    }
    free(set->labels);
    free(set->patch_counts);
    free(set->blocks);
    memset(set, 0, sizeof *set);
}

void chain_set_write(const struct chain_set *set, const char *path, int level)
{
    struct chain_writer *writer;
    uint32_t count = set->slabs->slab_count, stride = set->info.attributes.stride;
    must(chain_writer_open(set->ctx, path, level, count, stride, &writer));
    for (uint32_t i = 0; i < count; i++) {
        unsigned char *packed;
        size_t size;
        must(chain_block_pack(set->ctx, &set->blocks[i], stride, level, NULL, 0, &packed, &size));
        must(chain_writer_block(writer, packed, size));
        memory_release(set->ctx, &packed, size, 1);
    }
    for (uint32_t i = 0; i < count; i++)
        must(chain_writer_seams(writer, &set->blocks[i]));
    must(chain_writer_commit(&writer, &set->info, false));
}

/* ---- patches ---- */

static int compare_u32(const void *left, const void *right)
{
    uint32_t a = *(const uint32_t *)left, b = *(const uint32_t *)right;
    return a < b ? -1 : a > b;
}

/* Sorts and drops repeats; returns how many are left. */
static size_t unique(uint32_t *numbers, size_t count)
{
    qsort(numbers, count, sizeof *numbers, compare_u32);
    size_t kept = 0;
    for (size_t i = 0; i < count; i++)
        if (kept == 0 || numbers[i] != numbers[kept - 1])
            numbers[kept++] = numbers[i];
    return kept;
}

/* The label over an edge of the slab's face; NO_PATCH at the border and at the slab's border. */
static uint32_t label_over(const struct slab *slab, const uint32_t *labels, size_t edge)
{
    uint32_t face = slab->neighbours[edge] - slab->face_first;
    return slab->neighbours[edge] != NO_INDEX && face < slab->face_count ? labels[face] : NO_PATCH;
}

static void patch_must_be_disk(const struct slab *slab, const uint32_t *labels, uint32_t patch,
                               const uint32_t *faces, uint32_t count)
{
    uint32_t *vertices = take(3 * (size_t)count, sizeof *vertices);
    uint32_t *starts = take(3 * (size_t)count, sizeof *starts);
    uint32_t *ends = take(3 * (size_t)count, sizeof *ends);
    size_t inner = 0, boundary = 0;
    for (uint32_t i = 0; i < count; i++) {
        for (unsigned k = 0; k < 3; k++) {
            size_t edge = 3 * (size_t)faces[i] + k;
            vertices[3 * i + k] = slab->faces[edge];
            if (label_over(slab, labels, edge) == patch) {
                inner++;
            } else {
                starts[boundary] = slab->faces[edge];
                ends[boundary++] = slab->faces[3 * (size_t)faces[i] + next3(k)];
            }
        }
    }
    /* Euler: V - E + F = 1, each inner edge seen twice. */
    assert_int_equal(inner % 2, 0);
    size_t vertex_count = unique(vertices, 3 * (size_t)count);
    assert_int_equal(vertex_count + count, inner / 2 + boundary + 1);

    /* One loop: following from start to start comes round after all boundary edges, no sooner. */
    uint32_t at = ends[0];
    size_t steps = 1;
    while (at != starts[0]) {
        size_t next = boundary;
        for (size_t i = 0; i < boundary; i++) {
            if (starts[i] != at)
                continue;
            assert_int_equal(next, boundary); /* a second edge leaves this vertex */
            next = i;
        }
        assert_true(next < boundary);
        at = ends[next];
        assert_true(++steps <= boundary);
    }
    assert_int_equal(steps, boundary);
    assert_int_equal(unique(starts, boundary), boundary);
    free(vertices);
    free(starts);
    free(ends);
}

static void patch_must_be_connected(const struct slab *slab, const uint32_t *labels, uint32_t patch,
                                    uint32_t first, uint32_t count)
{
    uint32_t *stack = take(3 * (size_t)count + 1, sizeof *stack), met = 0;
    uint8_t *seen = take(slab->face_count, 1);
    size_t height = 0;
    stack[height++] = first;
    seen[first] = 1;
    while (height) {
        uint32_t face = stack[--height];
        met++;
        for (unsigned k = 0; k < 3; k++) {
            size_t edge = 3 * (size_t)face + k;
            uint32_t other = slab->neighbours[edge] - slab->face_first;
            if (label_over(slab, labels, edge) == patch && !seen[other]) {
                seen[other] = 1;
                stack[height++] = other;
            }
        }
    }
    assert_int_equal(met, count);
    free(stack);
    free(seen);
}

void patches_must_be_disks(const struct slab *slab, const uint32_t *labels, uint32_t count,
                           uint32_t most_faces)
{
    uint32_t *first = take((size_t)count + 1, sizeof *first);
    uint32_t *faces = take(slab->face_count, sizeof *faces);
    for (uint32_t f = 0; f < slab->face_count; f++) {
        assert_true(labels[f] < count);
        first[labels[f] + 1]++;
    }
    for (uint32_t p = 0; p < count; p++) {
        assert_true(first[p + 1] >= 1);
        assert_true(first[p + 1] <= most_faces);
        first[p + 1] += first[p];
    }
    uint32_t *next = take(count, sizeof *next);
    for (uint32_t f = 0; f < slab->face_count; f++)
        faces[first[labels[f]] + next[labels[f]]++] = f;
    for (uint32_t p = 0; p < count; p++) {
        patch_must_be_disk(slab, labels, p, faces + first[p], first[p + 1] - first[p]);
        if (slab->face_count < 20000)
            patch_must_be_connected(slab, labels, p, faces[first[p]], first[p + 1] - first[p]);
    }
    free(first);
    free(faces);
    free(next);
}

/* ---- chains ---- */

/* A boundary edge from the labels, or from the chains: walked with its patch on the left. Vertices
 * are store vertices. */
struct side {
    uint32_t slab, patch, from, to;
    uint32_t other_slab, other_patch;
};

static int compare_sides(const void *left, const void *right)
{
    return memcmp(left, right, sizeof(struct side));
}

struct sides {
    struct side *list;
    size_t count, capacity;
};

static void add_side(struct sides *sides, struct side side)
{
    if (sides->count == sides->capacity) {
        sides->capacity = 2 * sides->capacity + 64;
        sides->list = realloc(sides->list, sides->capacity * sizeof side);
        assert_non_null(sides->list);
    }
    sides->list[sides->count++] = side;
}

static void sides_from_labels(const struct chain_set *set, struct sides *sides)
{
    const struct slab_set *slabs = set->slabs;
    uint32_t slab_faces = slabs->slab_count ? slabs->slabs[0].face_count : 1;
    for (uint32_t f = 0; f < slabs->face_count; f++) {
        uint32_t slab = f / slab_faces, patch = set->labels[slab][f % slab_faces];
        for (unsigned k = 0; k < 3; k++) {
            uint32_t neighbour = slabs->neighbours[3 * (size_t)f + k];
            uint32_t other_slab = slab, other = NO_PATCH;
            if (neighbour != NO_INDEX) {
                other_slab = neighbour / slab_faces;
                other = set->labels[other_slab][neighbour % slab_faces];
            }
            if (other_slab != slab || other != patch)
                add_side(sides,
                         (struct side){slab, patch, slabs->faces[3 * (size_t)f + k],
                                       slabs->faces[3 * (size_t)f + next3(k)], other_slab, other});
        }
    }
}

/* Store vertices of a block's vertices, found by position; all positions must differ. */
struct place {
    float position[3];
    uint32_t vertex;
};

static int compare_places(const void *left, const void *right)
{
    const struct place *a = left, *b = right;
    for (unsigned c = 0; c < 3; c++)
        if (a->position[c] != b->position[c])
            return a->position[c] < b->position[c] ? -1 : 1;
    return 0;
}

static struct place *sort_places(const struct slab_set *slabs)
{
    struct place *places = take(slabs->vertex_count, sizeof *places);
    for (uint32_t v = 0; v < slabs->vertex_count; v++) {
        memcpy(places[v].position, slabs->positions + 3 * (size_t)v, sizeof places[v].position);
        places[v].vertex = v;
    }
    qsort(places, slabs->vertex_count, sizeof *places, compare_places);
    for (uint32_t v = 1; v < slabs->vertex_count; v++)
        assert_true(compare_places(&places[v - 1], &places[v]) < 0);
    return places;
}

static uint32_t *store_vertices(const struct chain_set *set, const struct place *places,
                                const struct chain_block *block)
{
    uint32_t *vertices = take(block->vertex_count, sizeof *vertices);
    for (uint32_t v = 0; v < block->vertex_count; v++) {
        struct place key;
        memcpy(key.position, block->positions + 3 * (size_t)v, sizeof key.position);
        const struct place *found =
            bsearch(&key, places, set->slabs->vertex_count, sizeof key, compare_places);
        assert_non_null(found);
        vertices[v] = found->vertex;
    }
    for (uint32_t i = 0; i < block->seam_vertex_count; i++)
        assert_int_equal(vertices[block->junction_count + i], block->seam_vertices[i]);
    uint32_t *copy = take(block->vertex_count, sizeof *copy);
    memcpy(copy, vertices, block->vertex_count * sizeof *copy);
    assert_int_equal(unique(copy, block->vertex_count), block->vertex_count);
    free(copy);
    return vertices;
}

/* How many boundary edges end at each store vertex; each edge between two patches is two sides, one
 * leaving each of its ends; a border edge is one. */
static uint32_t *boundary_degrees(const struct chain_set *set, const struct sides *sides)
{
    uint32_t *degrees = take(set->slabs->vertex_count, sizeof *degrees);
    for (size_t i = 0; i < sides->count; i++) {
        degrees[sides->list[i].from]++;
        if (sides->list[i].other_patch == NO_PATCH)
            degrees[sides->list[i].to]++;
    }
    return degrees;
}

/* Chain vertices from start to end as store vertices. P3: those inside have two boundary edges, the
 * ends another number, but for the ends of closed loops' chains, which are counted. */
static void take_chain(const uint32_t *list, uint32_t count, struct side side, bool both_sides,
                       const uint32_t *degrees, struct sides *sides, size_t *soft_ends)
{
    assert_true(count >= 2);
    assert_int_not_equal(list[0], list[count - 1]);
    for (uint32_t i = 0; i < count; i++) {
        if (i > 0 && i + 1 < count)
            assert_int_equal(degrees[list[i]], 2);
        else
            *soft_ends += degrees[list[i]] == 2;
        if (i == 0)
            continue;
        side.from = list[i - 1];
        side.to = list[i];
        add_side(sides, side);
        if (both_sides && side.other_patch != NO_PATCH)
            add_side(sides, (struct side){side.other_slab, side.other_patch, list[i], list[i - 1],
                                          side.slab, side.patch});
    }
}

static void take_block(const struct chain_block *block, const uint32_t *vertices,
                       const uint32_t *degrees, struct sides *sides, size_t *soft_ends)
{
    uint32_t *list = take((size_t)block->vertex_count + 1, sizeof *list);
    for (uint32_t i = 0; i < block->chain_count; i++) {
        const struct chain *chain = block->chains + i;
        uint32_t count = 0;
        list[count++] = vertices[chain->start];
        for (uint32_t j = 0; j < chain->interior_count; j++)
            list[count++] = vertices[chain->interior_first + j];
        list[count++] = vertices[chain->end];
        struct side side = {.slab = block->slab,
                            .patch = chain->left,
                            .other_slab = block->slab,
                            .other_patch = chain->right};
        take_chain(list, count, side, true, degrees, sides, soft_ends);
    }
    for (uint32_t i = 0; i < block->seam_chain_count; i++) {
        const struct seam_chain *chain = block->seam_chains + i;
        for (uint32_t j = 0; j < chain->vertex_count; j++)
            list[j] = vertices[block->seam_lists[chain->vertex_first + j]];
        struct side side = {.slab = block->slab,
                            .patch = chain->left,
                            .other_slab = chain->other_slab,
                            .other_patch = chain->right};
        take_chain(list, chain->vertex_count, side, false, degrees, sides, soft_ends);
    }
    free(list);
}

/* Triangles made of a patch's own diagonals and its sides: V - 2 of them, when E = 2 V - 3. */
static void check_patches(const struct chain_set *set, uint32_t slab, const uint32_t *vertices,
                          const uint32_t *degrees)
{
    const struct slab *view = set->slabs->slabs + slab;
    const struct chain_block *block = set->blocks + slab;
    double *areas = take(block->patch_count, sizeof *areas);
    uint8_t *has_inside = take(block->patch_count, 1);
    for (uint32_t f = 0; f < view->face_count; f++) {
        const float *p[3];
        uint32_t label = set->labels[slab][f];
        for (unsigned k = 0; k < 3; k++) {
            uint32_t vertex = view->faces[3 * (size_t)f + k];
            p[k] = set->slabs->positions + 3 * (size_t)vertex;
            has_inside[label] |= degrees[vertex] == 0;
        }
        double u[3], v[3];
        for (unsigned c = 0; c < 3; c++) {
            u[c] = (double)p[1][c] - p[0][c];
            v[c] = (double)p[2][c] - p[0][c];
        }
        double x = u[1] * v[2] - u[2] * v[1], y = u[2] * v[0] - u[0] * v[2],
               z = u[0] * v[1] - u[1] * v[0];
        areas[label] += 0.5 * sqrt(x * x + y * y + z * z);
    }
    for (uint32_t p = 0; p < block->patch_count; p++) {
        const struct patch *patch = block->patches + p;
        assert_true(fabs(areas[p] - patch->area) <= 1e-6 * areas[p]);
        double length2 = 0;
        for (unsigned c = 0; c < 3; c++)
            length2 += (double)patch->normal[c] * patch->normal[c];
        assert_true(fabs(length2 - 1) < 1e-6);
        assert_true(patch->deviation >= 0);
        assert_int_equal(patch->interior_count, has_inside[p]);
        for (uint32_t i = 0; i < patch->interior_count; i++)
            assert_int_equal(degrees[vertices[patch->interior_first + i]], 0);
    }
    free(areas);
    free(has_inside);
}

/* Each diagonal is an edge of the mesh with the patch on both sides, and none is missing. */
static void check_diagonals(const struct chain_set *set, uint32_t slab, const uint32_t *vertices)
{
    const struct slab *view = set->slabs->slabs + slab;
    const struct chain_block *block = set->blocks + slab;
    struct sides wanted = {0}, found = {0};
    for (size_t e = 0; e < 3 * (size_t)view->face_count; e++) {
        uint32_t label = set->labels[slab][e / 3];
        uint32_t a = view->faces[e], b = view->faces[e - e % 3 + next3((unsigned)(e % 3))];
        if (block->patches[label].interior_count == 0 &&
            label_over(view, set->labels[slab], e) == label && a < b)
            add_side(&wanted, (struct side){.patch = label, .from = a, .to = b});
    }
    for (uint32_t p = 0; p < block->patch_count; p++) {
        const struct patch *patch = block->patches + p;
        for (uint32_t i = 0; i < patch->diagonal_count; i++) {
            const uint32_t *diagonal = block->diagonals + 2 * (patch->diagonal_first + (size_t)i);
            uint32_t a = vertices[diagonal[0]], b = vertices[diagonal[1]];
            add_side(&found, (struct side){.patch = p, .from = a < b ? a : b, .to = a < b ? b : a});
        }
    }
    assert_int_equal(wanted.count, found.count);
    if (wanted.count) {
        qsort(wanted.list, wanted.count, sizeof(struct side), compare_sides);
        qsort(found.list, found.count, sizeof(struct side), compare_sides);
        assert_memory_equal(wanted.list, found.list, wanted.count * sizeof(struct side));
    }
    free(wanted.list);
    free(found.list);
}

/* P4 for one seam chain: the other block has it, too, the other way round. */
static void find_twin(const struct chain_set *set, const struct chain_block *block,
                      const struct seam_chain *chain)
{
    const struct chain_block *other = set->blocks + chain->other_slab;
    const uint32_t *list = block->seam_lists + chain->vertex_first;
    unsigned found = 0;
    for (uint32_t i = 0; i < other->seam_chain_count; i++) {
        const struct seam_chain *twin = other->seam_chains + i;
        const uint32_t *twin_list = other->seam_lists + twin->vertex_first;
        if (twin->left != chain->right || twin->other_slab != block->slab ||
            twin->right != chain->left || twin->vertex_count != chain->vertex_count)
            continue;
        bool same = true;
        for (uint32_t j = 0; j < chain->vertex_count; j++) {
            uint32_t a = list[j], b = twin_list[chain->vertex_count - 1 - j];
            same &= block->seam_vertices[a - block->junction_count] ==
                        other->seam_vertices[b - other->junction_count] &&
                    memcmp(block->positions + 3 * (size_t)a, other->positions + 3 * (size_t)b,
                           3 * sizeof(float)) == 0;
        }
        found += same;
    }
    assert_int_equal(found, 1);
}

void chains_must_hold(const struct chain_set *set)
{
    struct sides expected = {0}, found = {0};
    struct place *places = sort_places(set->slabs);
    sides_from_labels(set, &expected);
    uint32_t *degrees = boundary_degrees(set, &expected);
    size_t soft_ends = 0;
    for (uint32_t i = 0; i < set->slabs->slab_count; i++) {
        const struct chain_block *block = set->blocks + i;
        uint32_t *vertices = store_vertices(set, places, block);
        assert_int_equal(block->slab, i);
        assert_int_equal(block->patch_count, set->patch_counts[i]);
        take_block(block, vertices, degrees, &found, &soft_ends);
        check_patches(set, i, vertices, degrees);
        check_diagonals(set, i, vertices);
        for (uint32_t j = 0; j < block->seam_chain_count; j++)
            find_twin(set, block, block->seam_chains + j);
        free(vertices);
    }
    assert_int_equal(expected.count, found.count);
    if (expected.count) {
        qsort(expected.list, expected.count, sizeof(struct side), compare_sides);
        qsort(found.list, found.count, sizeof(struct side), compare_sides);
        assert_memory_equal(expected.list, found.list, expected.count * sizeof(struct side));
    }
    assert_int_equal(soft_ends % 6, 0); /* three junctions, each the end of two chains */
    uint64_t most_faces = 0;
    most_faces += expected.count - 2 * set->info.patches;
    assert_int_equal(set->info.most_faces, most_faces);
    free(expected.list);
    free(found.list);
    free(degrees);
    free(places);
}

void blocks_must_agree(const struct chain_block *one, const struct chain_block *two,
                       uint32_t stride)
{
    assert_int_equal(one->slab, two->slab);
    assert_int_equal(one->vertex_count, two->vertex_count);
    assert_int_equal(one->junction_count, two->junction_count);
    assert_int_equal(one->seam_vertex_count, two->seam_vertex_count);
    assert_int_equal(one->chain_count, two->chain_count);
    assert_int_equal(one->patch_count, two->patch_count);
    assert_int_equal(one->diagonal_count, two->diagonal_count);
    assert_int_equal(one->seam_chain_count, two->seam_chain_count);
    assert_int_equal(one->seam_list_count, two->seam_list_count);
    assert_memory_equal(one->positions, two->positions, 12 * (size_t)one->vertex_count);
    if (stride)
        assert_memory_equal(one->records, two->records, (size_t)stride * one->vertex_count);
    assert_memory_equal(one->seam_vertices, two->seam_vertices, 4 * (size_t)one->seam_vertex_count);
    assert_memory_equal(one->chains, two->chains, sizeof *one->chains * one->chain_count);
    assert_memory_equal(one->patches, two->patches, sizeof *one->patches * one->patch_count);
    assert_memory_equal(one->diagonals, two->diagonals, 8 * (size_t)one->diagonal_count);
    assert_memory_equal(one->seam_chains, two->seam_chains,
                        sizeof *one->seam_chains * one->seam_chain_count);
    assert_memory_equal(one->seam_lists, two->seam_lists, 4 * (size_t)one->seam_list_count);
}
