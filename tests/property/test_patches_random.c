/*
 * Patches and chains of meshes, angles and slab sizes drawn at random: every patch is a disk with a
 * simple boundary, P1 to P4 of patch.h hold, and the chain file gives the blocks back.
 */
#include <stdio.h>
#include <string.h>

#include "test_chains.h"
#include "test_kit.h"
#include "test_shapes.h"

/* Small closed meshes often: there the last face of a patch can close the surface. */
static struct shape random_shape(uint64_t *state)
{
    double noise = random_below(state, 3) ? 0.1 * random_unit(state) : 0;
    unsigned a = 3 + (unsigned)random_below(state, 14), b = 3 + (unsigned)random_below(state, 14);
    switch (random_below(state, 9)) {
    case 0:
        return shape_tetrahedron();
    case 1:
        return shape_noisy_sphere(0, noise, random_next(state));
    case 2:
        return shape_noisy_sphere((unsigned)random_below(state, 5), noise, random_next(state));
    case 3:
        return shape_noisy_torus(a, b, noise, random_next(state));
    case 4:
        return shape_grid(1 + a, 1 + b);
    case 5:
        return shape_grid_with_holes(4 * (1 + a / 4), 4 * (1 + b / 4));
    case 6:
        return shape_noisy_slab(2 + a, noise, random_next(state));
    case 7:
        return shape_spiral_ramp(1 + a / 3, 6 + b);
    default:
        return shape_single_triangle();
    }
}

/* Moves vertices off each other, so that a position names one vertex. */
static void shake(struct shape *shape, uint64_t *state)
{
    for (size_t i = 0; i < 3 * shape->vertex_count; i++)
        shape->positions[i] = (float)(shape->positions[i] + 1e-3 * random_unit(state));
}

static struct patch_options random_options(uint64_t *state)
{
    static const double angles[] = {0, 5, 12, 25, 60, 90, 120, 180};
    double patch = angles[random_below(state, 8)], face = angles[random_below(state, 8)];
    struct patch_options options =
        test_patch_options(patch, face, (uint32_t)random_below(state, 4));
    if (random_below(state, 3) == 0)
        options.patch_cosine[1] = options.face_cosine[1] = -1;
    if (random_below(state, 3) == 0)
        options.most_faces = 1 + (uint32_t)random_below(state, 20);
    return options;
}

static void check_file(struct context *ctx, const struct chain_set *set, int level)
{
    char path[256];
    snprintf(path, sizeof path, "%s", test_path("random.chains"));
    chain_set_write(set, path, level);
    enum status status = chain_file_check(ctx, path);
    if (status)
        print_message("%s\n", ctx->error);
    assert_int_equal(status, STATUS_OK);
    struct chain_file *file;
    assert_int_equal(chain_file_open(ctx, path, &file), STATUS_OK);
    for (uint32_t i = 0; i < set->slabs->slab_count; i++) {
        struct chain_block block;
        assert_int_equal(chain_block_read(file, i, &block), STATUS_OK);
        blocks_must_agree(&set->blocks[i], &block, 0);
        chain_block_clear(ctx, 0, &block);
    }
    chain_file_close(&file);
}

static void random_mesh_test(uint64_t seed)
{
    uint64_t state = seed;
    struct context ctx;
    context_init(&ctx);
    struct shape shape = random_shape(&state);
    shake(&shape, &state);
    if (random_below(&state, 2))
        shape_shuffle(&shape, random_next(&state));
    struct mesh mesh;
    shape_into_mesh(&ctx, &shape, &mesh);
    struct slab_set slabs;
    uint32_t slab_faces = random_below(&state, 3) ? 1u << (2 + random_below(&state, 8)) : 1u << 18;
    slab_set_build(&mesh, slab_faces, &slabs);
    struct patch_options options = random_options(&state);
    struct chain_set set;
    chain_set_build(&ctx, &slabs, &options, &set);
    for (uint32_t i = 0; i < slabs.slab_count; i++)
        patches_must_be_disks(&slabs.slabs[i], set.labels[i], set.patch_counts[i],
                              options.most_faces);
    chains_must_hold(&set);
    check_file(&ctx, &set, (int)(seed % 3) * 3);
    chain_set_free(&set);
    slab_set_free(&slabs);
    mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void random_meshes(void **unused)
{
    (void)unused;
    for (uint64_t seed = 1; seed <= 600; seed++)
        random_mesh_test(seed);
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(random_meshes)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
