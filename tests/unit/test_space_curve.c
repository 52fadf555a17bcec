/* The Hilbert curve visits every cell once, and always steps to a cell that shares a side. */
#include "test_kit.h"

#include <stdlib.h>

#include "geom/space_curve.h"

static void every_cell_once_and_in_steps_of_one(void **state)
{
    (void)state;
    struct space_curve curve;
    space_curve_init(&curve);
    for (unsigned bits = 1; bits <= 5; bits++) {
        const uint32_t side = 1u << bits;
        const size_t cells = (size_t)side * side * side;
        uint32_t(*at)[3] = calloc(cells, sizeof *at);
        unsigned char *seen = calloc(cells, 1);
        assert_non_null(at);
        assert_non_null(seen);
        for (uint32_t x = 0; x < side; x++) {
            for (uint32_t y = 0; y < side; y++) {
                for (uint32_t z = 0; z < side; z++) {
                    uint64_t key = space_curve_key(&curve, x, y, z, bits);
                    assert_true(key < cells);
                    assert_int_equal(seen[key]++, 0);
                    at[key][0] = x;
                    at[key][1] = y;
                    at[key][2] = z;
                }
            }
        }
        for (size_t i = 1; i < cells; i++) {
            int steps = 0;
            for (int k = 0; k < 3; k++)
                steps += abs((int)at[i][k] - (int)at[i - 1][k]);
            assert_int_equal(steps, 1);
        }
        free(at);
        free(seen);
    }
}

/* The curve of a finer grid passes through the cells of the coarser one in its order. */
static void finer_grids_refine_coarser_ones(void **state)
{
    (void)state;
    struct space_curve curve;
    space_curve_init(&curve);
    uint32_t seed = 1;
    for (int i = 0; i < 1000; i++) {
        uint32_t cell[3];
        for (int k = 0; k < 3; k++) {
            seed = seed * 1664525 + 1013904223;
            cell[k] = seed >> 11;
        }
        uint64_t fine = space_curve_key(&curve, cell[0], cell[1], cell[2], 21);
        for (unsigned drop = 1; drop < 21; drop++) {
            uint64_t coarse = space_curve_key(&curve, cell[0] >> drop, cell[1] >> drop,
                                              cell[2] >> drop, 21 - drop);
            /* Orientation alternates with the number of levels unless all are counted. */
            uint64_t rotated =
                space_curve_key(&curve, cell[0] >> drop << drop, cell[1] >> drop << drop,
                                cell[2] >> drop << drop, 21);
            assert_int_equal(rotated >> 3 * drop, fine >> 3 * drop);
            assert_true(coarse < (uint64_t)1 << 3 * (21 - drop));
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_cell_once_and_in_steps_of_one),
        cmocka_unit_test(finer_grids_refine_coarser_ones),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
