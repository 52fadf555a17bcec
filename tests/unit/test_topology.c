/*
 * Topology simplification on the parts of the dissertation's table 2, built in code: what is left
 * is what the construction says, counted and measured.
 */
#include "test_kit.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "mesh/import.h"
#include "simplify/topology.h"
#include "test_facts.h"
#include "test_parts.h"
#include "test_topology_kit.h"

/* As it is; turned; stretched, which leaves loops as large as they are; with noise. */
enum pose { POSE_PLAIN, POSE_TURNED, POSE_STRETCHED, POSE_NOISY, POSES };

static double diagonal_of(const struct shape *shape)
{
    double square = 0;
    for (unsigned c = 0; c < 3; c++) {
        double low = INFINITY, high = -INFINITY;
        for (size_t i = 0; i < shape->vertex_count; i++) {
            low = fmin(low, shape->positions[3 * i + c]);
            high = fmax(high, shape->positions[3 * i + c]);
        }
        square += (high - low) * (high - low);
    }
    return sqrt(square);
}

static void take_pose(struct shape *shape, enum pose pose)
{
    double noise = 1e-4 * diagonal_of(shape) / sqrt(3);
    if (pose == POSE_TURNED || pose == POSE_NOISY)
        shape_rotate(shape, 0.3, 1.1, -2);
    if (pose == POSE_STRETCHED)
        shape_scale(shape, 1, 1, 1.7);
    if (pose == POSE_NOISY)
        shape_noise(shape, noise, 4);
}

static void expect_plate(const struct part_plate *plate, double size)
{
    struct part_plate left = plate_copy(plate);
    struct part_counts gone = plate_reduce(&left, size, false);
    struct topology_options options;
    topology_defaults(&options);
    options.max_feature.value = size;
    for (unsigned i = 0; i < 2 * POSES; i++) {
        struct shape shape = plate_shape(plate);
        struct operated out;
        bool merge = options.merge_coplanar = i & 1;
        take_pose(&shape, i / 2);
        operate(&shape, &options, 0, &out);
        assert_true(facts_manifold(&out.facts));
        assert_int_equal(out.facts.border_edges, 0);
        assert_int_equal(out.facts.euler, 2 - 2 * (long)plate_genus(&left));
        assert_int_equal(out.report.counts[FEATURE_HOLE], gone.holes);
        assert_int_equal(out.report.counts[FEATURE_CAVITY], gone.cavities);
        assert_int_equal(out.report.counts[FEATURE_BUMP], gone.bumps);
        if (merge && i / 2 != POSE_NOISY)
            assert_int_equal(out.facts.faces, plate_fewest_faces(&left));
        shape_free(&shape);
        operated_clear(&out);
    }
    plate_free(&left);
}

static void box_becomes_twelve(void **state)
{
    (void)state;
    struct part_plate plate = part_box();
    struct shape shape = plate_shape(&plate);
    assert_int_equal(shape.face_count, 1612);
    shape_free(&shape);
    expect_plate(&plate, 0.6);
    expect_plate(&plate, 0.4);
    plate_free(&plate);
}

static void fixtures_become_twelve(void **state)
{
    (void)state;
    static const size_t faces[] = {18796, 74396};
    for (unsigned i = 0; i < 2; i++) {
        struct part_plate plate = part_fixture(10 * (i + 1));
        struct shape shape = plate_shape(&plate);
        assert_int_equal(shape.face_count, faces[i]);
        shape_free(&shape);
        expect_plate(&plate, 0.7);
        plate_free(&plate);
    }
}

static void battery_loses_its_bumps_by_size(void **state)
{
    (void)state;
    struct part_plate plate = part_battery();
    expect_plate(&plate, 0.1);
    expect_plate(&plate, 0.3);
    expect_plate(&plate, 0.5);
    expect_plate(&plate, 0.8);
    plate_free(&plate);
}

static void blocks_become_their_outlines(void **state)
{
    (void)state;
    static const unsigned fewest[] = {28, 44, 44};
    for (unsigned number = 1; number <= 3; number++) {
        struct part_plate plate = part_block(number), left = plate_copy(&plate);
        plate_reduce(&left, 0.6, false);
        assert_int_equal(plate_fewest_faces(&left), fewest[number - 1]);
        expect_plate(&plate, 0.6);
        plate_free(&left);
        plate_free(&plate);
    }
}

/* In all poses. `faces`: with planes merged (but for noise); 0: not asked for. */
static void expect_shape(struct shape (*make)(void), double size, bool merge, long euler,
                         size_t holes, size_t cavities, size_t faces)
{
    struct topology_options options;
    topology_defaults(&options);
    options.max_feature.value = size;
    options.merge_coplanar = merge;
    for (enum pose pose = POSE_PLAIN; pose < POSES; pose++) {
        struct shape shape = make();
        struct operated out;
        take_pose(&shape, pose);
        operate(&shape, &options, 0, &out);
        assert_true(facts_manifold(&out.facts));
        assert_int_equal(out.facts.border_edges, 0);
        assert_int_equal(out.facts.euler, euler);
        assert_int_equal(out.report.counts[FEATURE_HOLE], holes);
        assert_int_equal(out.report.counts[FEATURE_CAVITY], cavities);
        if (faces && pose != POSE_NOISY)
            assert_int_equal(out.facts.faces, faces);
        operated_clear(&out);
        shape_free(&shape);
    }
}

/* 752 triangles, 152 without the small holes, 72 without the large one: as in the table. */
static void disk_in_two_steps(void **state)
{
    (void)state;
    struct shape shape = part_disk();
    assert_int_equal(shape.face_count, 752);
    shape_free(&shape);
    expect_shape(part_disk, 0.5, true, 2 - 2 * 11, 0, 0, 752);
    expect_shape(part_disk, 2, true, 0, 10, 0, 152);
    expect_shape(part_disk, 9, true, 2, 11, 0, 72);
}

static void gear_loses_pockets_then_holes(void **state)
{
    (void)state;
    expect_shape(part_gear, 1, false, 2 - 20, 0, 30, 0);
    expect_shape(part_gear, 2, false, 2, 10, 30, 0);
    expect_shape(part_gear, 2, true, 2, 10, 30, 4 * 120 - 4);
}

/* 50 radial holes and the bore that they lead to: genus 51. */
static void tube_loses_radial_holes_then_the_bore(void **state)
{
    (void)state;
    expect_shape(part_cylinder, 1, false, 2 - 2 * 51, 0, 0, 0);
    expect_shape(part_cylinder, 5, false, 0, 50, 0, 0);
    /* The bore and the holes into it are one feature. */
    expect_shape(part_cylinder, 13, false, 2, 1, 0, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(box_becomes_twelve),
        cmocka_unit_test(fixtures_become_twelve),
        cmocka_unit_test(battery_loses_its_bumps_by_size),
        cmocka_unit_test(blocks_become_their_outlines),
        cmocka_unit_test(disk_in_two_steps),
        cmocka_unit_test(gear_loses_pockets_then_holes),
        cmocka_unit_test(tube_loses_radial_holes_then_the_bore),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
