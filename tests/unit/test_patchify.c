/*
 * Patch growth, section 4.2.2 and 4.2.3 of the dissertation: against a slow reference that follows
 * the text literally, and each of its cases and DESIGN.md's traps by itself.
 */
#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include <math.h>

#include "base/memory.h"
#include "simplify/face_normals.h"
#include "simplify/patchify.h"
#include "simplify/unit_code.h"
#include "test_chains.h"
#include "test_kit.h"
#include "test_shapes.h"

/* ---- a mesh as one slab ---- */

struct fixture {
    struct context ctx;
    struct mesh mesh;
    struct slab_set slabs;
    uint32_t *labels;
    uint32_t count;
};

static void begin(struct fixture *fixture, struct shape shape, uint32_t slab_faces)
{
    memset(fixture, 0, sizeof *fixture);
    context_init(&fixture->ctx);
    shape_into_mesh(&fixture->ctx, &shape, &fixture->mesh);
    slab_set_build(&fixture->mesh, slab_faces, &fixture->slabs);
    fixture->labels = calloc(fixture->mesh.face_count, sizeof *fixture->labels);
    assert_non_null(fixture->labels);
}

static void grow(struct fixture *fixture, const struct patch_options *options)
{
    const struct slab *slab = fixture->slabs.slabs;
    enum status status =
        patch_labels(&fixture->ctx, slab, options, fixture->labels, &fixture->count);
    assert_int_equal(status, STATUS_OK);
    patches_must_be_disks(slab, fixture->labels, fixture->count,
                          options->most_faces ? options->most_faces : PATCH_FACES_MAX);
}

static void end(struct fixture *fixture)
{
    free(fixture->labels);
    slab_set_free(&fixture->slabs);
    mesh_clear(&fixture->ctx, &fixture->mesh);
    assert_int_equal(fixture->ctx.memory_now, 0);
    context_clear(&fixture->ctx);
}

static uint32_t patch_size(const struct fixture *fixture, uint32_t patch)
{
    uint32_t size = 0;
    for (uint32_t f = 0; f < fixture->slabs.slabs[0].face_count; f++)
        size += fixture->labels[f] == patch;
    return size;
}

/* ---- the reference: quadratic, with nothing remembered ---- */

struct reference {
    const struct slab *slab;
    const float *normals;
    const struct patch_options *options;
    uint32_t *labels;
    uint32_t *queue;
    uint32_t tail;
    uint32_t patch;
    double sum[3];
};

static uint32_t neighbour(const struct slab *slab, uint32_t face, unsigned k)
{
    uint32_t other = slab->neighbours[3 * (size_t)face + k];
    return other == NO_INDEX || other - slab->face_first >= slab->face_count
               ? NO_INDEX
               : other - slab->face_first;
}

static bool free_face(const struct reference *reference, uint32_t face)
{
    return face != NO_INDEX && reference->labels[face] == NO_PATCH;
}

/* Whether the patch is a disk with a simple boundary: by V - E + F and by its boundary's vertices
 * (edge-connected it is). */
static bool is_disk(const struct reference *reference)
{
    const struct slab *slab = reference->slab;
    long faces = 0, inner = 0, boundary = 0, vertices = 0;
    size_t limit = slab->vertex_end;
    int *out = calloc(limit + 1, sizeof *out), *used = calloc(limit + 1, sizeof *used);
    bool simple = true;
    for (uint32_t f = 0; f < slab->face_count; f++) {
        if (reference->labels[f] != reference->patch)
            continue;
        faces++;
        for (unsigned k = 0; k < 3; k++) {
            uint32_t vertex = slab->faces[3 * (size_t)f + k], over = neighbour(slab, f, k);
            vertices += used[vertex]++ == 0;
            if (over != NO_INDEX && reference->labels[over] == reference->patch) {
                inner++;
            } else {
                boundary++;
                simple &= ++out[vertex] == 1;
            }
        }
    }
    free(out);
    free(used);
    return simple && boundary >= 3 && vertices - (inner / 2 + boundary) + faces == 1;
}

static unsigned shared_edges(const struct reference *reference, uint32_t face)
{
    unsigned count = 0;
    for (unsigned k = 0; k < 3; k++) {
        uint32_t over = neighbour(reference->slab, face, k);
        count += over != NO_INDEX && reference->labels[over] == reference->patch;
    }
    return count;
}

static bool keeps_disk_if_added(const struct reference *reference, uint32_t face)
{
    reference->labels[face] = reference->patch;
    bool result = is_disk(reference);
    reference->labels[face] = NO_PATCH;
    return result;
}

static bool feasible(const struct reference *reference, uint32_t from, uint32_t face)
{
    if (!keeps_disk_if_added(reference, face))
        return false;
    unsigned two = shared_edges(reference, face) == 2;
    const float *a = reference->normals + NORMAL_STRIDE * (size_t)face;
    const float *b = reference->normals + NORMAL_STRIDE * (size_t)from;
    const double *sum = reference->sum;
    if (a[0] * b[0] + a[1] * b[1] + a[2] * b[2] < (float)reference->options->face_cosine[two])
        return false;
    double length = sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
    double dot = a[0] * sum[0] + a[1] * sum[1] + a[2] * sum[2];
    return dot >= reference->options->patch_cosine[two] * length * (1 - 1e-15);
}

static void change(struct reference *reference, uint32_t face, bool add)
{
    const float *normal = reference->normals + NORMAL_STRIDE * (size_t)face;
    double weight = add ? normal[3] : -(double)normal[3];
    for (unsigned c = 0; c < 3; c++)
        reference->sum[c] += weight * normal[c];
    reference->labels[face] = add ? reference->patch : NO_PATCH;
    if (add)
        reference->queue[reference->tail++] = face;
}

static void expand(struct reference *reference, uint32_t face, bool is_seed)
{
    uint32_t list[3];
    unsigned count = 0, shared = 0;
    for (unsigned k = 0; k < 3; k++)
        if (!free_face(reference, neighbour(reference->slab, face, k)))
            shared = k;
    for (unsigned i = 0; i < 3; i++) { /* in the order of the edges, after the shared one if removal
                                          is possible */
        unsigned k = is_seed ? i : (shared + 1 + i) % 3;
        uint32_t over = neighbour(reference->slab, face, k);
        if (free_face(reference, over))
            list[count++] = over;
    }
    if (count == 2 && !is_seed) {
        if (feasible(reference, face, list[0]) && feasible(reference, face, list[1])) {
            change(reference, list[0], true);
            if (keeps_disk_if_added(reference, list[1])) {
                change(reference, list[1], true);
                return;
            }
            change(reference, list[0], false);
            reference->tail--;
        }
        change(reference, face, false);
        return;
    }
    for (unsigned i = 0; i < count; i++)
        if (feasible(reference, face, list[i]))
            change(reference, list[i], true);
}

static uint32_t reference_seed(const struct reference *reference)
{
    uint32_t lowest = NO_INDEX;
    for (uint32_t f = 0; f < reference->slab->face_count; f++) {
        if (!free_face(reference, f))
            continue;
        if (lowest == NO_INDEX)
            lowest = f;
        for (unsigned k = 0; k < 3; k++) {
            uint32_t over = neighbour(reference->slab, f, k);
            if (over != NO_INDEX && reference->labels[over] != NO_PATCH)
                return f;
        }
    }
    return lowest;
}

static uint32_t grow_reference(const struct slab *slab, const float *normals,
                               const struct patch_options *options, uint32_t *labels)
{
    struct reference reference = {
        .slab = slab, .normals = normals, .options = options, .labels = labels};
    reference.queue = calloc(4 * (size_t)slab->face_count + 4, sizeof *reference.queue);
    assert_non_null(reference.queue);
    memset(labels, 0xff, slab->face_count * sizeof *labels);
    for (uint32_t seed; (seed = reference_seed(&reference)) != NO_INDEX; reference.patch++) {
        memset(reference.sum, 0, sizeof reference.sum);
        reference.tail = 0;
        change(&reference, seed, true);
        for (uint32_t head = 0; head < reference.tail; head++)
            expand(&reference, reference.queue[head], head == 0);
    }
    free(reference.queue);
    return reference.patch;
}

static struct shape small_shape(uint64_t *state)
{
    double noise = 0.15 * random_unit(state);
    unsigned a = 3 + (unsigned)random_below(state, 6), b = 3 + (unsigned)random_below(state, 6);
    switch (random_below(state, 6)) {
    case 0:
        return shape_tetrahedron();
    case 1:
        return shape_noisy_sphere((unsigned)random_below(state, 3), noise, random_next(state));
    case 2:
        return shape_noisy_torus(a, b, noise, random_next(state));
    case 3:
        return shape_grid_with_holes(4 * (a / 3), 4 * (b / 3));
    case 4:
        return shape_noisy_slab(2 + a / 2, noise, random_next(state));
    default:
        return shape_grid(a, b);
    }
}

static void reference_test(uint64_t seed)
{
    static const double angles[] = {10, 25, 50, 90, 130, 180};
    uint64_t state = seed;
    struct shape shape = small_shape(&state);
    for (size_t i = 0; i < 3 * shape.vertex_count; i++)
        shape.positions[i] = (float)(shape.positions[i] + 0.05 * random_unit(&state));
    if (random_below(&state, 2))
        shape_shuffle(&shape, random_next(&state));
    struct fixture fixture;
    begin(&fixture, shape, 1u << (5 + random_below(&state, 5)));
    struct patch_options options =
        test_patch_options(angles[random_below(&state, 6)], angles[random_below(&state, 6)],
                           (uint32_t)random_below(&state, 3));
    if (random_below(&state, 2))
        options.patch_cosine[1] = options.face_cosine[1] = -1;
    for (uint32_t i = 0; i < fixture.slabs.slab_count; i++) {
        const struct slab *slab = &fixture.slabs.slabs[i];
        struct patch_workspace space = {0};
        uint32_t count, *labels = calloc(slab->face_count, sizeof *labels);
        assert_int_equal(patch_grow(&fixture.ctx, slab, &options, &space, labels, &count),
                         STATUS_OK);
        assert_int_equal(patch_growth_begin(&fixture.ctx, slab, &options, &space), STATUS_OK);
        assert_int_equal(grow_reference(slab, space.normals, &options, fixture.labels), count);
        assert_memory_equal(labels, fixture.labels, slab->face_count * sizeof *labels);
        free(labels);
        patch_workspace_clear(&fixture.ctx, &space);
    }
    end(&fixture);
}

static void same_as_the_reference(void **unused)
{
    (void)unused;
    for (uint64_t seed = 1; seed <= 500; seed++)
        reference_test(seed);
}

/* ---- the cases one by one ---- */

static struct patch_options everything(void)
{
    struct patch_options options = test_patch_options(180, 180, 0);
    options.patch_cosine[1] = options.face_cosine[1] = -1;
    return options;
}

/* Three faces of a tetrahedron fit whatever their angles; the fourth would close it. */
static void closing_a_surface(void **unused)
{
    (void)unused;
    struct patch_options options = everything();
    struct fixture fixture;
    begin(&fixture, shape_tetrahedron(), 1 << 18);
    grow(&fixture, &options);
    assert_int_equal(fixture.count, 2);
    assert_int_equal(patch_size(&fixture, 0), 3);
    end(&fixture);
    for (unsigned level = 0; level < 4; level++) {
        begin(&fixture, shape_icosphere(level), 1 << 18);
        grow(&fixture, &options);
        assert_true(fixture.count >= 2);
        end(&fixture);
    }
}

/* A pyramid over n corners and one below it. */
static struct shape double_pyramid(unsigned n)
{
    struct shape shape = {0};
    shape_vertex(&shape, 0, 0, 1);
    shape_vertex(&shape, 0, 0, -1);
    for (unsigned i = 0; i < n; i++)
        shape_vertex(&shape, (float)cos(2 * acos(-1) * i / n), (float)sin(2 * acos(-1) * i / n), 0);
    for (uint32_t i = 0; i < n; i++) {
        shape_triangle(&shape, 0, 2 + i, 2 + (i + 1) % n);
        shape_triangle(&shape, 1, 2 + (i + 1) % n, 2 + i);
    }
    return shape;
}

/* The two free neighbours of a face may be the last two faces of a closed surface: each fits by
 * itself, both together would close it, so neither comes in and the face goes. */
static void closing_a_surface_with_two(void **unused)
{
    (void)unused;
    struct patch_options options = everything();
    for (uint64_t seed = 0; seed < 300; seed++) {
        struct shape shape = double_pyramid(3 + (unsigned)(seed % 5));
        shape_shuffle(&shape, seed);
        struct fixture fixture;
        begin(&fixture, shape, 1 << 18);
        grow(&fixture, &options);
        assert_in_range(fixture.count, 2, 3);
        end(&fixture);
    }
}

static void flat_grid_is_one_patch(void **unused)
{
    (void)unused;
    struct patch_options options = test_patch_options(1, 1, 0);
    struct fixture fixture;
    begin(&fixture, shape_grid(9, 7), 1 << 18);
    grow(&fixture, &options);
    assert_int_equal(fixture.count, 1);
    end(&fixture);
}

/* A ring of 2 n faces round a hole: the pinch test must leave it open somewhere. */
static void ring_does_not_close(void **unused)
{
    (void)unused;
    struct shape ring = {0};
    const unsigned n = 12;
    for (unsigned i = 0; i < n; i++) {
        double angle = 2 * acos(-1) * i / n;
        shape_vertex(&ring, (float)cos(angle), (float)sin(angle), 0);
        shape_vertex(&ring, (float)(2 * cos(angle)), (float)(2 * sin(angle)), 0);
    }
    for (unsigned i = 0; i < n; i++) {
        uint32_t inner = 2 * i, outer = inner + 1, next = 2 * ((i + 1) % n);
        shape_triangle(&ring, inner, outer, next + 1);
        shape_triangle(&ring, inner, next + 1, next);
    }
    struct patch_options options = everything();
    struct fixture fixture;
    begin(&fixture, ring, 1 << 18);
    grow(&fixture, &options);
    assert_true(fixture.count >= 2);
    end(&fixture);
}

/* Angles of zero: on a sphere nothing fits, and each triangle is a patch (section 4.2.3). */
static void zero_angle_gives_triangles(void **unused)
{
    (void)unused;
    struct patch_options options = test_patch_options(0, 0, 0);
    struct fixture fixture;
    begin(&fixture, shape_noisy_sphere(3, 0.05, 7), 1 << 18);
    grow(&fixture, &options);
    assert_int_equal(fixture.count, fixture.mesh.face_count);
    end(&fixture);
}

static void patches_are_no_larger_than_asked(void **unused)
{
    (void)unused;
    struct patch_options options = everything();
    for (uint32_t most = 1; most <= 9; most++) {
        struct fixture fixture;
        options.most_faces = most;
        begin(&fixture, shape_grid(20, 20), 1 << 18);
        grow(&fixture, &options);
        for (uint32_t p = 0; p < fixture.count; p++)
            assert_true(patch_size(&fixture, p) <= most);
        assert_true(patch_size(&fixture, 0) + 1 >= most); /* two at a time may not fit */
        end(&fixture);
    }
    struct fixture fixture; /* beyond PATCH_FACES_MAX there is no asking */
    options.most_faces = UINT32_MAX;
    begin(&fixture, shape_grid(100, 100), 1 << 18);
    grow(&fixture, &options);
    for (uint32_t p = 0; p < fixture.count; p++)
        assert_true(patch_size(&fixture, p) <= PATCH_FACES_MAX);
    end(&fixture);
}

/*
 * Figure 15: a face with two free neighbours of which one is infeasible goes out again. Seed 0 and
 * face 1 are flat; face 1 has a flat neighbour 2 and a steep neighbour 3. Without the rule, 0, 1
 * and 2 would be one patch.
 */
static void bridge_triangle_is_removed(void **unused)
{
    (void)unused;
    struct shape shape = {0};
    shape_vertex(&shape, 0, 0, 0);
    shape_vertex(&shape, 1, 0, 0);
    shape_vertex(&shape, 0, 1, 0);
    shape_vertex(&shape, 1, 1, 0);
    shape_vertex(&shape, 0, 2, 0);
    shape_vertex(&shape, 1, 0.5, 2);
    shape_triangle(&shape, 0, 1, 2); /* the seed */
    shape_triangle(&shape, 1, 3, 2); /* the bridge */
    shape_triangle(&shape, 2, 3, 4); /* flat */
    shape_triangle(&shape, 3, 1, 5); /* steep */
    struct patch_options options = test_patch_options(25, 20, 0);
    struct fixture fixture;
    begin(&fixture, shape, 1 << 18);
    grow(&fixture, &options);
    static const uint32_t expected[] = {0, 1, 1, 2};
    assert_int_equal(fixture.count, 3);
    assert_memory_equal(fixture.labels, expected, sizeof expected);
    end(&fixture);
}

/* The third edge of a face that shares two with the patch has angles of its own. */
static void two_shared_edges_have_their_own_angles(void **unused)
{
    (void)unused;
    /* A pyramid without its base: six sides round the top, one of them bent by moving a corner. */
    struct shape shape = {0};
    shape_vertex(&shape, 0, 0, 0);
    for (unsigned i = 0; i < 6; i++)
        shape_vertex(&shape, (float)cos(i * acos(-1) / 3), (float)sin(i * acos(-1) / 3), 0);
    shape.positions[3 * 4 + 2] = 0.6f; /* faces 3 and 4 of the fan are steep now */
    for (uint32_t i = 0; i < 6; i++)
        shape_triangle(&shape, 0, 1 + i, 1 + (i + 1) % 6);
    struct patch_options options = test_patch_options(25, 25, 0);
    struct fixture fixture;
    struct shape copy = {0};
    shape_append(&copy, &shape);
    begin(&fixture, copy, 1 << 18);
    grow(&fixture, &options);
    assert_int_equal(patch_size(&fixture, 0), 4); /* neither steep face shares two edges */
    end(&fixture);
    options = test_patch_options(50, 50, 0);
    options.patch_cosine[1] = options.face_cosine[1] = cos(0.1);
    begin(&fixture, shape, 1 << 18);
    grow(&fixture, &options);
    assert_int_equal(patch_size(&fixture, 0), 5); /* the last one shares two and fails at these */
    end(&fixture);
}

/* Patches are the same whatever the unit of length. */
static void scale_does_not_matter(void **unused)
{
    (void)unused;
    struct patch_options options = test_patch_options(25, 20, 1);
    struct fixture one, other;
    static const double scales[] = {0x1p-100, 0x1p-40, 0x1p30, 0x1p90};
    begin(&one, shape_noisy_sphere(3, 0.1, 3), 1 << 18);
    grow(&one, &options);
    for (unsigned i = 0; i < 4; i++) {
        struct shape shape = shape_noisy_sphere(3, 0.1, 3);
        for (size_t j = 0; j < 3 * shape.vertex_count; j++)
            shape.positions[j] *= scales[i];
        begin(&other, shape, 1 << 18);
        grow(&other, &options);
        assert_int_equal(one.count, other.count);
        assert_memory_equal(one.labels, other.labels, one.mesh.face_count * sizeof *one.labels);
        end(&other);
    }
    end(&one);
}

static void every_slab_ends_its_patches(void **unused)
{
    (void)unused;
    struct patch_options options = test_patch_options(10, 10, 0);
    struct fixture fixture;
    begin(&fixture, shape_grid(16, 16), 64);
    assert_int_equal(fixture.slabs.slab_count, 8);
    for (uint32_t i = 0; i < 8; i++) {
        const struct slab *slab = fixture.slabs.slabs + i;
        uint32_t labels[64], count;
        assert_int_equal(patch_labels(&fixture.ctx, slab, &options, labels, &count), STATUS_OK);
        patches_must_be_disks(slab, labels, count, PATCH_FACES_MAX);
        assert_int_equal(count, 1);
    }
    end(&fixture);
}

static void no_faces(void **unused)
{
    (void)unused;
    struct slab slab = {0};
    struct context ctx;
    context_init(&ctx);
    struct patch_options options = test_patch_options(25, 20, 3);
    uint32_t label, count = 7;
    assert_int_equal(patch_labels(&ctx, &slab, &options, &label, &count), STATUS_OK);
    assert_int_equal(count, 0);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

/* ---- the set that gives its lowest ---- */

/* Against an array of flags, for sizes round the ends of words and levels. */
static void bit_tree_gives_the_lowest(void **unused)
{
    (void)unused;
    static const uint32_t sizes[] = {1, 2, 63, 64, 65, 4095, 4096, 4097, 300000};
    uint64_t state = 21;
    for (unsigned s = 0; s < sizeof sizes / sizeof *sizes; s++) {
        const uint32_t size = sizes[s];
        uint64_t *memory = malloc(bit_tree_words(size) * sizeof *memory);
        bool *flags = calloc(size, sizeof *flags);
        assert_true(memory && flags);
        struct bit_tree tree;
        bit_tree_init(&tree, memory, size);
        for (unsigned round = 0; round < 400; round++) {
            uint32_t number = (uint32_t)random_below(&state, size), lowest = 0, found;
            bool is_wanted = random_below(&state, 3) != 0;
            bit_tree_set_if(&tree, number, is_wanted);
            flags[number] |= is_wanted;
            if (random_below(&state, 2) && bit_tree_lowest(&tree, &found)) {
                bit_tree_clear(&tree, found);
                flags[found] = false;
            }
            while (lowest < size && !flags[lowest])
                lowest++;
            assert_int_equal(bit_tree_lowest(&tree, &found), lowest < size);
            if (lowest < size)
                assert_int_equal(found, lowest);
        }
        free(memory);
        free(flags);
    }
}

/* Angles tried one after the other on one slab give what each gives alone. */
static void growing_again_is_growing_anew(void **unused)
{
    (void)unused;
    struct fixture fixture;
    begin(&fixture, shape_noisy_sphere(4, 0.03, 9), 1 << 18);
    const uint32_t faces = fixture.slabs.slabs[0].face_count;
    struct patch_workspace space = {0};
    static const double tried[] = {20, 5, 60, 5};
    for (unsigned i = 0; i < 4; i++) {
        struct patch_options options = test_patch_options(tried[i], tried[i], 2);
        struct grown_patch patch;
        uint32_t count = 0;
        if (i == 0)
            assert_int_equal(
                patch_growth_begin(&fixture.ctx, fixture.slabs.slabs, &options, &space), STATUS_OK);
        else
            patch_growth_again(&space, &options);
        while (patch_growth_next(&space, &patch)) {
            assert_int_equal(patch.number, count++);
            assert_int_equal(patch.inside_count,
                             (patch.face_count + 2 - patch.edge_count) / 2); /* a disk */
        }
        grow(&fixture, &options);
        assert_int_equal(count, fixture.count);
        for (uint32_t f = 0; f < faces; f++)
            assert_int_equal(patch_growth_label(&space, f), fixture.labels[f]);
    }
    patch_workspace_clear(&fixture.ctx, &space);
    end(&fixture);
}

/* ---- normals ---- */

static void fill_normals(struct fixture *fixture, uint32_t smoothings, float *normals)
{
    struct patch_workspace space = {0};
    struct patch_options options = test_patch_options(25, 20, smoothings);
    assert_int_equal(patch_growth_begin(&fixture->ctx, fixture->slabs.slabs, &options, &space),
                     STATUS_OK);
    memcpy(normals, space.normals, fixture->mesh.face_count * NORMAL_STRIDE * sizeof *normals);
    patch_workspace_clear(&fixture->ctx, &space);
}

static void smoothing_averages_neighbours(void **unused)
{
    (void)unused;
    struct fixture fixture;
    begin(&fixture, shape_noisy_sphere(2, 0.1, 5), 1 << 18);
    size_t size = fixture.mesh.face_count * NORMAL_STRIDE;
    float *raw = calloc(size, sizeof *raw), *once = calloc(size, sizeof *once);
    float *thrice = calloc(size, sizeof *thrice);
    fill_normals(&fixture, 0, raw);
    fill_normals(&fixture, 1, once);
    fill_normals(&fixture, 3, thrice);
    double change = 0;
    for (uint32_t f = 0; f < fixture.mesh.face_count; f++) {
        double sum[3] = {raw[4 * f], raw[4 * f + 1], raw[4 * f + 2]}, length2 = 0;
        for (unsigned k = 0; k < 3; k++)
            for (unsigned c = 0; c < 3; c++)
                sum[c] += raw[4 * fixture.slabs.neighbours[3 * f + k] + c];
        for (unsigned c = 0; c < 3; c++)
            length2 += sum[c] * sum[c];
        for (unsigned c = 0; c < 3; c++) {
            assert_true(fabs(once[4 * f + c] - sum[c] / sqrt(length2)) < 1e-5);
            change += fabs(thrice[4 * f + c] - once[4 * f + c]);
        }
        assert_true(raw[4 * f + 3] == once[4 * f + 3] && raw[4 * f + 3] == thrice[4 * f + 3]);
    }
    assert_true(change > 0);
    free(raw);
    free(once);
    free(thrice);
    end(&fixture);
}

/* What face_normals.h says of one face's own normal, a face at a time; false: it has no area. The
 * area is not scaled. */
static bool plain_normal(const struct mesh *mesh, uint32_t f, float normal[4])
{
    const double *p[3];
    double u[3], v[3], cross[3], square = 0, u_square = 0, v_square = 0;
    for (unsigned k = 0; k < 3; k++)
        p[k] = mesh->positions + 3 * (size_t)mesh->faces[3 * (size_t)f + k];
    for (unsigned c = 0; c < 3; c++) {
        u[c] = (double)(float)p[1][c] - (double)(float)p[0][c];
        v[c] = (double)(float)p[2][c] - (double)(float)p[0][c];
    }
    for (unsigned c = 0; c < 3; c++) {
        cross[c] = u[(c + 1) % 3] * v[(c + 2) % 3] - u[(c + 2) % 3] * v[(c + 1) % 3];
        square += cross[c] * cross[c];
        u_square += u[c] * u[c];
        v_square += v[c] * v[c];
    }
    const double length = sqrt(square), inverse = 1 / length;
    for (unsigned c = 0; c < 3; c++)
        normal[c] = (float)(cross[c] * inverse);
    normal[3] = (float)(length / 2);
    return square > 1e-28 * (u_square * v_square);
}

static float *normals_at(struct fixture *fixture, unsigned cap, uint32_t smoothings)
{
    float *normals = calloc(fixture->mesh.face_count * NORMAL_STRIDE, sizeof *normals);
    assert_non_null(normals);
    fixture->ctx.cpu_level_cap = cap;
    fill_normals(fixture, smoothings, normals);
    return normals;
}

/* Batches and their ends, faces of no area among them: the scalar form and this machine's best have
 * the same bits, those of one face at a time. */
static void normals_are_the_same_on_any_machine(void **unused)
{
    (void)unused;
    uint64_t state = 7;
    for (unsigned round = 0; round < 60; round++) {
        struct shape shape = shape_noisy_slab(1 + round / 6, 0.2, round);
        for (size_t v = 0; v + 1 < shape.vertex_count; v++)
            if (round % 3 == 0 && random_below(&state, 9) == 0)
                memcpy(shape.positions + 3 * v, shape.positions + 3 * v + 3, 3 * sizeof(double));
        struct fixture fixture;
        begin(&fixture, shape, 1 << 18);
        const size_t faces = fixture.mesh.face_count, bytes = faces * NORMAL_STRIDE * sizeof(float);
        float *smoothed[2] = {normals_at(&fixture, CPU_SCALAR, 2),
                              normals_at(&fixture, UINT_MAX, 2)};
        float *raw[2] = {normals_at(&fixture, CPU_SCALAR, 0), normals_at(&fixture, UINT_MAX, 0)};
        assert_memory_equal(smoothed[0], smoothed[1], bytes);
        assert_memory_equal(raw[0], raw[1], bytes);
        float scale = 0;
        for (uint32_t f = 0; f < faces; f++) {
            float plain[4];
            const float *made = raw[0] + NORMAL_STRIDE * (size_t)f;
            if (!plain_normal(&fixture.mesh, f, plain)) {
                assert_true(made[3] == 0);
                continue;
            }
            scale = scale > 0 ? scale : made[3] / plain[3]; /* a power of two */
            plain[3] *= scale;
            assert_memory_equal(plain, made, sizeof plain);
        }
        assert_true(scale > 0);
        for (unsigned i = 0; i < 2; i++) {
            free(smoothed[i]);
            free(raw[i]);
        }
        end(&fixture);
    }
}

/* A strip whose middle faces have no area takes the normals from its ends; all else stays flat. */
static void zero_area_faces_take_their_neighbours_normals(void **unused)
{
    (void)unused;
    struct fixture fixture;
    struct shape shape = shape_grid(12, 1);
    for (size_t v = 0; v < shape.vertex_count; v++) /* columns 3 to 8 shrink to a line */
        if (shape.positions[3 * v] >= 3 && shape.positions[3 * v] <= 8)
            shape.positions[3 * v + 1] = 0;
    begin(&fixture, shape, 1 << 18);
    float normals[24 * NORMAL_STRIDE];
    fill_normals(&fixture, 0, normals);
    for (uint32_t f = 0; f < 24; f++)
        assert_true(fabsf(normals[4 * f + 2] - 1) < 1e-6f);
    struct patch_options options = test_patch_options(5, 5, 0);
    grow(&fixture, &options);
    assert_int_equal(fixture.count, 1);
    end(&fixture);
    shape = shape_grid(3, 3); /* nothing has an area */
    for (size_t i = 0; i < shape.vertex_count; i++)
        shape.positions[3 * i + 1] = shape.positions[3 * i + 2] = 0;
    begin(&fixture, shape, 1 << 18);
    grow(&fixture, &options);
    assert_int_equal(fixture.count, 1);
    end(&fixture);
}

static void unit_vectors_keep_their_code(void **unused)
{
    (void)unused;
    uint64_t state = 11;
    for (unsigned i = 0; i < 200000; i++) {
        double vector[3], length2 = 0, dot = 0;
        for (unsigned c = 0; c < 3; c++) {
            vector[c] = random_below(&state, 8) ? 2 * random_unit(&state) - 1 : 0;
            length2 += vector[c] * vector[c];
        }
        if (length2 == 0)
            continue;
        uint32_t code = unit_encode(vector);
        float unit[3];
        assert_true(unit_decode(code, unit));
        double again[3] = {unit[0], unit[1], unit[2]}, unit2 = 0;
        for (unsigned c = 0; c < 3; c++) {
            dot += vector[c] * unit[c];
            unit2 += again[c] * again[c];
            assert_true(unit[c] != 0 || !signbit(unit[c]));
        }
        assert_true(dot / sqrt(length2) > 1 - 2e-9 - 1e-7);
        assert_true(fabs(unit2 - 1) < 1e-6);
        assert_int_equal(unit_encode(again), code);
    }
    float unit[3];
    assert_false(unit_decode(0x8000, unit));               /* -32768 is no step */
    assert_false(unit_decode(0x7fff0000u | 0xffff, unit)); /* (-1, rim) is (1, rim) */
    assert_true(unit_decode(0x7fff0000u | 0x0001, unit));
}

/* ---- slabs that contradict themselves ---- */

static void damaged_slabs_are_refused(void **unused)
{
    (void)unused;
    struct fixture fixture;
    struct patch_options options = test_patch_options(25, 20, 1);
    begin(&fixture, shape_grid(16, 16), 64);
    struct slab slab = fixture.slabs.slabs[3];
    slab.foreign_count -= 1;
    assert_int_equal(patch_labels(&fixture.ctx, &slab, &options, fixture.labels, &fixture.count),
                     STATUS_BAD_INPUT);
    assert_non_null(strstr(fixture.ctx.error, "slab 3"));
    slab = fixture.slabs.slabs[3];
    uint8_t mates[64];
    memset(mates, 0xff, sizeof mates);
    slab.mates = mates;
    assert_int_equal(patch_labels(&fixture.ctx, &slab, &options, fixture.labels, &fixture.count),
                     STATUS_BAD_INPUT);
    end(&fixture);
}

/* Neighbours drawn at random: whatever comes out, nothing is read or written out of bounds, and it
 * ends. (The sanitizers look on.) */
static void senseless_adjacency_does_no_harm(void **unused)
{
    (void)unused;
    uint64_t state = 5;
    for (unsigned round = 0; round < 100; round++) {
        struct fixture fixture;
        begin(&fixture, shape_noisy_sphere(3, 0.1, round), 256);
        for (size_t i = 0; i < fixture.mesh.face_count; i++) {
            for (unsigned k = 0; k < 3; k++)
                if (random_below(&state, 4) == 0)
                    fixture.slabs.neighbours[3 * i + k] =
                        (uint32_t)random_below(&state, fixture.mesh.face_count);
            if (random_below(&state, 4) == 0)
                fixture.slabs.mates[i] = (uint8_t)(random_below(&state, 3) * 21);
        }
        struct patch_options options =
            random_below(&state, 2) ? everything() : test_patch_options(60, 60, 1);
        for (uint32_t i = 0; i < fixture.slabs.slab_count; i++)
            assert_int_equal(patch_labels(&fixture.ctx, &fixture.slabs.slabs[i], &options,
                                          fixture.labels, &fixture.count),
                             STATUS_OK);
        end(&fixture);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(same_as_the_reference),
        cmocka_unit_test(closing_a_surface),
        cmocka_unit_test(closing_a_surface_with_two),
        cmocka_unit_test(flat_grid_is_one_patch),
        cmocka_unit_test(ring_does_not_close),
        cmocka_unit_test(zero_angle_gives_triangles),
        cmocka_unit_test(patches_are_no_larger_than_asked),
        cmocka_unit_test(bridge_triangle_is_removed),
        cmocka_unit_test(two_shared_edges_have_their_own_angles),
        cmocka_unit_test(scale_does_not_matter),
        cmocka_unit_test(every_slab_ends_its_patches),
        cmocka_unit_test(no_faces),
        cmocka_unit_test(bit_tree_gives_the_lowest),
        cmocka_unit_test(growing_again_is_growing_anew),
        cmocka_unit_test(smoothing_averages_neighbours),
        cmocka_unit_test(normals_are_the_same_on_any_machine),
        cmocka_unit_test(zero_area_faces_take_their_neighbours_normals),
        cmocka_unit_test(unit_vectors_keep_their_code),
        cmocka_unit_test(damaged_slabs_are_refused),
        cmocka_unit_test(senseless_adjacency_does_no_harm),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
