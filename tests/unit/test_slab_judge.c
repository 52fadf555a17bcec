/*
 * What slab_judge and slab_judge_stars let pass and what they refuse. Slabs are made in memory, so
 * that each lie is told alone.
 */
#include "mesh/draft.h"
#include "mesh/slab_judge.h"
#include "test_kit.h"
#include "test_shapes.h"
#include "test_slabs.h"

#include <math.h>
#include <string.h>

static struct slab_set slabs_of_shape(struct shape shape, uint32_t slab_faces)
{
    struct context ctx;
    struct mesh mesh;
    struct slab_set set;
    context_init(&ctx);
    shape_into_mesh(&ctx, &shape, &mesh);
    slab_set_build(&mesh, slab_faces, &set);
    mesh_clear(&ctx, &mesh);
    context_clear(&ctx);
    return set;
}

static const char *judge_stars(const struct slab *slab)
{
    struct context ctx;
    const char *wrong;
    context_init(&ctx);
    assert_int_equal(slab_judge_stars(&ctx, slab, &wrong), STATUS_OK);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return wrong;
}

/* The sum of what all slabs say of their seams; each must pass by itself. */
static uint64_t judge_all(const struct slab_set *set)
{
    uint64_t sum = 0;
    for (uint32_t i = 0; i < set->slab_count; i++) {
        uint64_t seams;
        const char *wrong = slab_judge(&set->slabs[i], set->face_count, &seams);
        if (wrong)
            fail_msg("slab %u: %s", i, wrong);
        sum += seams;
    }
    return sum;
}

static void sound_slabs_pass(void **state)
{
    (void)state;
    for (unsigned which = 0; which < 5; which++)
        for (uint32_t slab_faces = 3; slab_faces < 4000; slab_faces = 5 * slab_faces + 1) {
            struct shape shape = which == 0   ? shape_icosphere(2)
                                 : which == 1 ? shape_grid_with_holes(16, 8)
                                 : which == 2 ? shape_torus(30, 3)
                                 : which == 3 ? shape_single_triangle()
                                              : shape_tetrahedron();
            struct slab_set set = slabs_of_shape(shape, slab_faces);
            assert_true(judge_all(&set) == 0);
            for (uint32_t i = 0; i < set.slab_count; i++)
                assert_null(judge_stars(&set.slabs[i]));
            slab_set_free(&set);
        }
}

/* One number of the only slab is another for a moment. */
static void refused(struct slab_set *set, void *at, size_t size, uint32_t value, const char *words)
{
    uint32_t old = 0;
    uint64_t seams;
    memcpy(&old, at, size);
    memcpy(at, &value, size);
    const char *wrong = slab_judge(&set->slabs[0], set->face_count, &seams);
    if (!wrong || !strstr(wrong, words))
        fail_msg("'%s' is not in '%s'", words, wrong ? wrong : "(passed)");
    memcpy(at, &old, size);
    assert_null(slab_judge(&set->slabs[0], set->face_count, &seams));
}

static void each_lie_in_a_slab_is_seen(void **state)
{
    (void)state;
    struct slab_set set = slabs_of_shape(shape_icosphere(1), 1000);
    const uint32_t last = set.vertex_count - 1;
    refused(&set, &set.faces[0], 4, set.vertex_count, "does not have");
    refused(&set, &set.faces[0], 4, 1, "first use");
    refused(&set, &set.faces[5], 4, last, "first use");
    refused(&set, &set.faces[1], 4, 0, "");
    refused(&set, &set.neighbours[0], 4, set.face_count, "impossible");
    refused(&set, &set.mates[0], 1, 3, "impossible");
    refused(&set, &set.neighbours[0], 4, 0, "do not agree");
    for (uint32_t c = 12; c < 3 * set.face_count; c++) {
        /* A vertex that has been used already: only the neighbours see that it is the wrong one. */
        uint32_t other = set.faces[c] == 0 ? 1 : set.faces[c] - 1;
        refused(&set, &set.faces[c], 4, other, "");
        refused(&set, &set.neighbours[c], 4, NO_INDEX, "");
        refused(&set, &set.neighbours[c], 4, set.face_count, "");
        refused(&set, &set.neighbours[c], 4, c / 3, "");
        uint8_t mates = set.mates[c / 3];
        refused(&set, &set.mates[c / 3], 1, mates ^ 1u << (2 * (c % 3)), "");
        refused(&set, &set.mates[c / 3], 1, mates | 0x40, "not zero");
    }
    refused(&set, &set.positions[7], 4, 0x7f800000, "not finite");
    refused(&set, &set.positions[7], 4, 0xffc00000, "not finite");
    slab_set_free(&set);
}

/* Whatever one side of a seam says differently, the sum is not 0. */
static void a_lie_about_a_seam_is_seen(void **state)
{
    (void)state;
    struct slab_set set = slabs_of_shape(shape_torus(12, 6), 40);
    uint32_t tried = 0;
    assert_true(judge_all(&set) == 0);
    for (uint32_t f = 0; f < set.face_count; f++)
        for (unsigned k = 0; k < 3; k++) {
            uint32_t over = set.neighbours[3 * f + k], slab = f / 40;
            unsigned mate = mate_of(set.mates, f, k);
            if (over / 40 == slab)
                continue;
            tried++;
            /* Another face of the other slab, or another edge of the right one. */
            set.neighbours[3 * f + k] = over % 40 ? over - 1 : over + 1;
            assert_true(judge_all(&set) != 0);
            set.neighbours[3 * f + k] = over;
            mate_set(set.mates, f, k, (mate + 1) % 3);
            assert_true(judge_all(&set) != 0);
            mate_set(set.mates, f, k, mate);
        }
    assert_true(tried > 20);
    assert_true(judge_all(&set) == 0);
    slab_set_free(&set);
}

static void two_fans_at_a_vertex_are_seen(void **state)
{
    (void)state;
    struct shape shape = shape_tetrahedron(), other = shape_tetrahedron();
    shape_append(&shape, &other);
    shape_free(&other);
    struct slab_set set = slabs_of_shape(shape, 100);
    uint64_t seams;
    struct slab *slab = &set.slabs[0];
    assert_null(judge_stars(slab));
    for (uint32_t c = 0; c < 3 * set.face_count; c++) /* the last vertex becomes the first */
        if (set.faces[c] == 7)
            set.faces[c] = 0;
    slab->vertex_end = 7;
    assert_null(slab_judge(slab, set.face_count, &seams));
    assert_non_null(judge_stars(slab));
    slab_set_free(&set);

    set = slabs_of_shape(shape_grid(2, 1), 100); /* two open fans: a strip bent to touch itself */
    slab = &set.slabs[0];
    for (uint32_t c = 0; c < 3 * set.face_count; c++)
        if (set.faces[c] == 5)
            set.faces[c] = 0;
    slab->vertex_end = 5;
    if (!slab_judge(slab, set.face_count, &seams))
        assert_non_null(judge_stars(slab));
    slab_set_free(&set);
}

/* Two faces with the same vertices, joined all round: every edge is seen alike from both sides. */
static void a_pillow_of_two_faces_is_seen(void **state)
{
    (void)state;
    static const uint32_t faces[] = {0, 1, 2, 0, 2, 1}, neighbours[] = {1, 1, 1, 0, 0, 0};
    static const float positions[] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    uint8_t mates[2] = {0};
    for (unsigned k = 0; k < 3; k++) { /* edges 01 12 20 and 02 21 10 */
        mate_set(mates, 0, k, 2 - k);
        mate_set(mates, 1, k, 2 - k);
    }
    const struct slab slab = {.face_count = 2,
                              .vertex_end = 3,
                              .faces = faces,
                              .neighbours = neighbours,
                              .mates = mates,
                              .positions = positions};
    uint64_t seams;
    assert_null(slab_judge(&slab, 2, &seams));
    assert_non_null(judge_stars(&slab));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sound_slabs_pass),
        cmocka_unit_test(each_lie_in_a_slab_is_seen),
        cmocka_unit_test(a_lie_about_a_seam_is_seen),
        cmocka_unit_test(two_fans_at_a_vertex_are_seen),
        cmocka_unit_test(a_pillow_of_two_faces_is_seen),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
