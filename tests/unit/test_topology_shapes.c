/*
 * Features that chapter 5 cannot tell apart or finds no sharp loops for: pipes, mushrooms,
 * chamfered and filleted rims, stepped bores; and cracks and specks. Solids of revolution, for
 * which the answer is plain.
 */
#include "test_kit.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "test_parts.h"
#include "test_topology_kit.h"

enum { AROUND = 24 };

/* Turns a closed profile (radius, height), counter-clockwise with the axis on its left side, round
 * the z axis; points on the axis become one vertex. An open profile that begins and ends on the
 * axis gives a ball, a closed one off the axis a ring. */
static struct shape revolve(const double (*profile)[2], unsigned points)
{
    struct shape shape = {0};
    uint32_t rings[64][AROUND];
    bool is_ring = profile[0][0] > 0;
    for (unsigned p = 0; p < points; p++)
        for (unsigned i = 0; i < AROUND; i++) {
            double angle = 6.283185307179586 * i / AROUND;
            if (profile[p][0] > 0 || i == 0)
                rings[p][i] = shape_vertex(&shape, (float)(profile[p][0] * cos(angle)),
                                           (float)(profile[p][0] * sin(angle)), profile[p][1]);
            else
                rings[p][i] = rings[p][0];
        }
    for (unsigned p = 0; p + 1 < points + is_ring; p++)
        for (unsigned i = 0; i < AROUND; i++) {
            const uint32_t *low = rings[p], *high = rings[(p + 1) % points];
            unsigned j = (i + 1) % AROUND;
            if (low[i] != low[j])
                shape_triangle(&shape, low[i], low[j], high[j]);
            if (high[i] != high[j])
                shape_triangle(&shape, low[i], high[j], high[i]);
        }
    return shape;
}

static void expect(const struct shape *shape, const struct topology_options *options, long euler,
                   size_t components, size_t removed)
{
    struct operated out;
    size_t sum = 0;
    operate(shape, options, 0, &out);
    for (unsigned i = 0; i < FEATURE_KINDS; i++)
        sum += out.report.counts[i];
    assert_true(facts_manifold(&out.facts));
    assert_int_equal(out.facts.border_edges, 0);
    assert_int_equal(out.facts.components, components);
    assert_int_equal(out.facts.euler, euler);
    assert_int_equal(sum, removed);
    operated_clear(&out);
}

/* Two weights on a bar: it is no hole, unless asked for. */
static void pipe_stays(void **state)
{
    (void)state;
    static const double profile[][2] = {{0, 0},   {4, 0}, {4, 3},  {0.5, 3},
                                        {0.5, 9}, {4, 9}, {4, 12}, {0, 12}};
    struct shape shape = revolve(profile, 8);
    struct topology_options options;
    topology_defaults(&options);
    options.max_feature.value = 2;
    expect(&shape, &options, 2, 1, 0);
    options.remove_pipes = true;
    expect(&shape, &options, 4, 2, 1);
    shape_free(&shape);
}

/* A knob on a stem goes when it is small all over, and stays whole when its head is not. */
static void mushroom_goes_whole_or_not(void **state)
{
    (void)state;
    static const double profile[][2] = {{0, 0},   {6, 0},   {6, 3},   {0.5, 3},
                                        {0.5, 4}, {1.5, 4}, {1.5, 5}, {0, 5}};
    struct shape shape = revolve(profile, 8);
    struct topology_options options;
    topology_defaults(&options);
    options.max_feature.value = 2;
    expect(&shape, &options, 2, 1, 0);
    options.max_feature.value = 4;
    expect(&shape, &options, 2, 1, 1);
    shape_free(&shape);
}

/* A bore whose rims are chamfered at 45 degrees, which is not sharp, or rounded in steps. */
static void chamfered_bore_goes_by_its_outer_rim(void **state)
{
    (void)state;
    static const double chamfer[][2] = {{1, 0.5}, {1.5, 0}, {6, 0}, {6, 3}, {1.5, 3}, {1, 2.5}};
    static const double fillet[][2] = {{1, 0.5},     {1.04, 0.31}, {1.15, 0.15}, {1.31, 0.04},
                                       {1.5, 0},     {6, 0},       {6, 3},       {1.5, 3},
                                       {1.31, 2.96}, {1.15, 2.85}, {1.04, 2.69}, {1, 2.5}};
    for (unsigned i = 0; i < 2; i++) {
        struct shape shape = i ? revolve(fillet, 12) : revolve(chamfer, 6);
        struct topology_options options;
        topology_defaults(&options);
        options.max_feature.value = 2.5;
        expect(&shape, &options, 0, 1, 0);
        options.max_feature.value = 3.5;
        expect(&shape, &options, 2, 1, 1);
        shape_free(&shape);
    }
}

/* A bore with a countersink or a fillet of many steps on one side is as large as its outer rim: it
 * goes with all of it, or stays with all of it, however sharp the inner edge is. */
static void countersinks_go_as_one(void **state)
{
    (void)state;
    static const double angles[] = {20, 30, 44.9, 45, 45.1, 60};
    static const double quarter = 1.5707963267948966;
    for (unsigned i = 0; i < 6 + 5; i++) {
        double profile[16][2] = {{1, 0}, {6, 0}, {6, 3}, {1.5, 3}};
        unsigned points = 4, steps = i < 6 ? 1 : i - 4;
        for (unsigned k = 1; k <= steps; k++, points++) {
            double turn = quarter * k / steps;
            profile[points][0] = i < 6 ? 1 : 1.5 - 0.5 * sin(turn);
            profile[points][1] =
                i < 6 ? 3 - 0.5 * tan(angles[i] * quarter / 90) : 2.5 + 0.5 * cos(turn);
        }
        struct shape shape = revolve((const double(*)[2])profile, points);
        struct topology_options options;
        struct operated out;
        topology_defaults(&options);
        options.max_feature.value = 2.9;
        expect(&shape, &options, 0, 1, 0);
        options.max_feature.value = 3.1;
        operate(&shape, &options, 0, &out);
        assert_int_equal(out.report.counts[FEATURE_HOLE], 1);
        assert_true(facts_manifold(&out.facts));
        double disk = 0.5 * AROUND * sin(4 * quarter / AROUND) * 36;
        assert_true(fabs(mesh_volume(&out.mesh) - 3 * disk) < 1e-5 * disk);
        operated_clear(&out);
        shape_free(&shape);
    }
}

/* A wide bore from above, a narrow one from below. */
static void stepped_bore_goes_by_steps(void **state)
{
    (void)state;
    static const double profile[][2] = {{0.5, 0}, {6, 0}, {6, 3}, {2, 3}, {2, 2}, {0.5, 2}};
    struct shape shape = revolve(profile, 6);
    struct topology_options options;
    topology_defaults(&options);
    options.max_feature.value = 0.9;
    expect(&shape, &options, 0, 1, 0);
    options.max_feature.value = 2;
    expect(&shape, &options, 2, 1, 1);
    options.max_feature.value = 4.5;
    options.merge_coplanar = true;
    struct operated out;
    operate(&shape, &options, 0, &out);
    assert_int_equal(out.facts.euler, 2);
    assert_int_equal(out.facts.faces, 4 * AROUND - 4);
    operated_clear(&out);
    shape_free(&shape);
}

enum { GRID = 20 };

/* A block of cubes without three square bores through its middle, of which the widest is 6. */
static bool is_solid(int x, int y, int z)
{
    int a = abs(2 * x - GRID + 1), b = abs(2 * y - GRID + 1), c = abs(2 * z - GRID + 1);
    bool is_inside = x >= 0 && y >= 0 && z >= 0 && x < GRID && y < GRID && z < GRID;
    return is_inside && !(a < 4 && b < 4) && !(b < 6 && c < 6) && !(a < 6 && c < 4);
}

static struct shape drilled_block(void)
{
    static uint32_t numbers[GRID + 1][GRID + 1][GRID + 1];
    static const int corners[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    struct shape shape = {0};
    memset(numbers, 0xff, sizeof numbers);
    for (int i = 0; i < GRID * GRID * GRID * 6; i++) {
        int cell[3] = {i / 6 % GRID, i / 6 / GRID % GRID, i / 6 / GRID / GRID};
        unsigned axis = (unsigned)(i % 3), u = (axis + 1) % 3, v = (axis + 2) % 3;
        int side = i % 6 / 3, beside[3] = {cell[0], cell[1], cell[2]};
        uint32_t face[4];
        beside[axis] += side ? 1 : -1;
        if (!is_solid(cell[0], cell[1], cell[2]) || is_solid(beside[0], beside[1], beside[2]))
            continue;
        for (unsigned k = 0; k < 4; k++) {
            int at[3] = {cell[0], cell[1], cell[2]};
            at[axis] += side;
            at[u] += corners[k][0];
            at[v] += corners[k][1];
            uint32_t *number = &numbers[at[0]][at[1]][at[2]];
            if (*number == UINT32_MAX)
                *number = shape_vertex(&shape, at[0], at[1], at[2]);
            face[side ? k : 3 - k] = *number;
        }
        shape_triangle(&shape, face[0], face[1], face[2]);
        shape_triangle(&shape, face[0], face[2], face[3]);
    }
    return shape;
}

/* Bores that meet inside go together, though the loops where they meet are larger than their rims;
 * a narrow one that ends in wider ones goes without them. */
static void cross_drilled_bores(void **state)
{
    (void)state;
    struct shape shape = drilled_block();
    struct topology_options options;
    struct operated out;
    topology_defaults(&options);
    options.max_feature.value = 5.5; /* the rims have 5.66, 7.21 and 8.49 */
    expect(&shape, &options, 2 - 2 * 5, 1, 0);
    options.max_feature.value = 5.8;
    expect(&shape, &options, 2 - 2 * 3, 1, 2);
    options.max_feature.value = 8.6;
    options.merge_coplanar = true;
    operate(&shape, &options, 0, &out);
    assert_true(facts_manifold(&out.facts));
    assert_int_equal(out.facts.faces, 12);
    assert_int_equal(out.report.counts[FEATURE_HOLE], 1);
    assert_int_equal(out.report.features[0].loops, 6);
    operated_clear(&out);
    shape_free(&shape);
}

/* A pin is small by its loops and large by its extent. */
static void long_pin_stays_by_extent(void **state)
{
    (void)state;
    static const double profile[][2] = {{0, 0}, {6, 0}, {6, 3}, {0.5, 3}, {0.5, 9}, {0, 9}};
    struct shape shape = revolve(profile, 6);
    struct topology_options options;
    topology_defaults(&options);
    options.max_feature.value = 2;
    expect(&shape, &options, 2, 1, 1);
    options.measure = LOOP_EXTENT;
    expect(&shape, &options, 2, 1, 0);
    options.measure = LOOP_BOX;
    expect(&shape, &options, 2, 1, 1);
    options.measure = LOOP_SAMPLED;
    expect(&shape, &options, 2, 1, 1);
    shape_free(&shape);
}

static void cracks_close_below_their_size_only(void **state)
{
    (void)state;
    struct shape shape = shape_grid_with_holes(12, 12);
    struct topology_options options;
    struct operated out;
    topology_defaults(&options);
    for (unsigned i = 0; i < 2; i++) {
        /* holes of side 1: diameter 1.41, inscribed 1 */
        options.crack_inscribed = i;
        options.close_cracks.value = i ? 0.9 : 1.3;
        operate(&shape, &options, 0, &out);
        assert_int_equal(out.facts.border_loops, 10);
        operated_clear(&out);
        options.close_cracks.value = i ? 1.1 : 1.5;
        operate(&shape, &options, 0, &out);
        assert_true(facts_manifold(&out.facts));
        assert_int_equal(out.facts.border_loops, 1);
        assert_int_equal(out.facts.euler, 1);
        assert_int_equal(out.report.counts[FEATURE_CRACK], 9);
        operated_clear(&out);
    }
    shape_free(&shape);
}

static void specks_are_dropped(void **state)
{
    (void)state;
    struct shape shape = shape_icosphere(3), speck = shape_icosphere(1);
    struct topology_options options;
    struct operated out;
    shape_move(&speck, 0.125, 3, 0, 0);
    shape_append(&shape, &speck);
    topology_defaults(&options);
    options.drop_components.value = 0.4;
    operate(&shape, &options, 6, &out);
    assert_int_equal(out.facts.components, 2);
    operated_clear(&out);
    options.drop_components.value = 0.5;
    operate(&shape, &options, 6, &out);
    assert_int_equal(out.facts.components, 1);
    assert_int_equal(out.facts.faces, 1280);
    assert_int_equal(out.report.counts[FEATURE_COMPONENT], 1);
    operated_clear(&out);
    shape_free(&speck);
    shape_free(&shape);
}

/* With nothing asked for that is there, nothing changes. */
static void smooth_shapes_stay(void **state)
{
    (void)state;
    struct shape shape = shape_noisy_sphere(4, 0.01, 7);
    struct topology_options options;
    topology_defaults(&options);
    options.max_feature.value = 1;
    expect(&shape, &options, 2, 1, 0);
    shape_free(&shape);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pipe_stays),
        cmocka_unit_test(mushroom_goes_whole_or_not),
        cmocka_unit_test(chamfered_bore_goes_by_its_outer_rim),
        cmocka_unit_test(countersinks_go_as_one),
        cmocka_unit_test(stepped_bore_goes_by_steps),
        cmocka_unit_test(cross_drilled_bores),
        cmocka_unit_test(long_pin_stays_by_extent),
        cmocka_unit_test(cracks_close_below_their_size_only),
        cmocka_unit_test(specks_are_dropped),
        cmocka_unit_test(smooth_shapes_stay),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
