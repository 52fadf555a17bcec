/* A context, a folder and a path in it, with cmocka's set-up and tear-down: what tests of files
 * need. */
#ifndef SPBM_TEST_PLACE_H
#define SPBM_TEST_PLACE_H

#include "base/report.h"
#include "test_files.h"

struct place {
    struct context ctx;
    char folder[TEST_PATH];
    char path[TEST_PATH]; /* "file" in the folder; not there yet */
    int warnings;         /* that the context was given */
};

int place_set_up(void **state);
/* Fails when memory is counted still. */
int place_tear_down(void **state);

#define PLACE_TEST(name) cmocka_unit_test_setup_teardown(name, place_set_up, place_tear_down)

#endif
