/*
 * Every option that is out of range is refused before anything is read or written: with SPBM_MISUSE
 * and words that say which. Inputs do not even exist.
 */
#include "test_kit.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "spbm.h"
#include "test_shapes.h"

static const char *const ABSENT = "/nonexistent/in.ply";

static spbm_job *open_job(void)
{
    spbm_job *job;
    assert_int_equal(spbm_job_open(NULL, &job), SPBM_OK);
    return job;
}

static void said(spbm_job *job, spbm_status status, const char *words)
{
    if (status != SPBM_MISUSE || !strstr(spbm_job_error(job), words))
        fail_msg("status %d, '%s' is not in '%s'", (int)status, words, spbm_job_error(job));
}

static spbm_simplify_options fair(void)
{
    spbm_simplify_options options;
    spbm_simplify_defaults(&options);
    options.target.count = 1;
    options.target.values[0] = 9;
    return options;
}

static void refused(spbm_job *job, const spbm_simplify_options *options, const char *output,
                    const char *words)
{
    said(job, spbm_simplify(job, &ABSENT, 1, output, options, NULL), words);
}

static void options_of_simplify(void **state)
{
    (void)state;
    spbm_job *job = open_job();
    const char *output = test_path("out.ply");
    spbm_simplify_options options = fair();
    assert_int_equal(spbm_simplify(job, &ABSENT, 1, output, &options, NULL), SPBM_IO);
    options.target.mode = (spbm_mode)2;
    refused(job, &options, output, "mode");
    options = fair();
    options.target.kind = (spbm_target_kind)3;
    refused(job, &options, output, "target");
    options = fair();
    options.target.count = SPBM_TARGETS_MAX + 1;
    refused(job, &options, output, "targets");
    options = fair();
    options.target.kind = SPBM_BY_ERROR;
    options.target.values[0] = INFINITY;
    refused(job, &options, output, "not an error");
    options = fair();
    options.lod.place = (spbm_place)3;
    refused(job, &options, output, "placement");
    options = fair();
    options.lod.format = (spbm_format)7;
    refused(job, &options, output, "format");
    options = fair();
    refused(job, &options, "-", "standard output");
    refused(job, &options, "", "name of the output");
    for (unsigned i = 0; i < 2; i++) {
        static const double angles[] = {181, NAN, INFINITY};
        for (unsigned j = 0; j < 3; j++) {
            options = fair();
            options.patch.patch_angle[i] = angles[j];
            refused(job, &options, output, "angle");
            options = fair();
            options.patch.face_angle[i] = angles[j];
            refused(job, &options, output, "angle");
        }
    }
    options = fair();
    options.patch.smoothings = 101;
    refused(job, &options, output, "smoothed");
    options = fair();
    options.patch.chain_tolerance = INFINITY;
    refused(job, &options, output, "tolerance");
    spbm_job_close(&job);
}

static void names_that_are_too_long(void **state)
{
    (void)state;
    enum { LENGTH = 9000 };
    static char name[LENGTH + 1];
    memset(name, 'a', LENGTH);
    memcpy(name + LENGTH - 4, ".ply", 5);
    spbm_job *job = open_job();
    spbm_simplify_options options = fair();
    refused(job, &options, name,
            "the name of the output is too long"); /* the reason is not cut off */
    assert_memory_equal(spbm_job_error(job), "aaaa", 4);
    options.keep_dir = name;
    assert_int_not_equal(spbm_simplify(job, &ABSENT, 1, test_path("out.ply"), &options, NULL),
                         SPBM_OK);
    assert_true(strlen(spbm_job_error(job)) > 0 && strlen(spbm_job_error(job)) < 2048);
    assert_non_null(strstr(spbm_job_error(job), " [...] "));
    options.keep_dir = NULL;
    options.resume_dir = name;
    assert_int_not_equal(spbm_simplify(job, &ABSENT, 1, test_path("out.ply"), &options, NULL),
                         SPBM_OK);
    assert_int_not_equal(spbm_import(job, &ABSENT, 1, name, NULL, NULL), SPBM_OK);
    assert_int_not_equal(spbm_info(job, name, &(spbm_file_figures){0}), SPBM_OK);
    assert_true(strlen(spbm_job_error(job)) < 2048);
    spbm_job_close(&job);
}

static void standard_input_is_there_once(void **state)
{
    (void)state;
    static const char *const twice[] = {"-", "-"};
    spbm_job *job = open_job();
    spbm_simplify_options options = fair();
    spbm_measurement measurement;
    said(job, spbm_simplify(job, twice, 2, test_path("out.ply"), &options, NULL), "once");
    said(job, spbm_import(job, twice, 2, test_path("out.store"), NULL, NULL), "once");
    said(job, spbm_measure(job, "-", "-", NULL, &measurement), "once");
    said(job, spbm_import(job, twice, 0, test_path("out.store"), NULL, NULL), "no input");
    spbm_job_close(&job);
}

static void options_of_topology(void **state)
{
    (void)state;
    spbm_job *job = open_job();
    const char *output = test_path("out.ply");
    spbm_topology_options options;
    spbm_topology_defaults(&options);
    said(job, spbm_simplify_topology(job, &ABSENT, 1, output, &options, NULL), "nothing is asked");
    spbm_length *lengths[] = {&options.max_feature, &options.drop_components,
                              &options.close_cracks};
    static const double bad[] = {-1, NAN, INFINITY};
    for (unsigned i = 0; i < 3; i++)
        for (unsigned j = 0; j < 3; j++) {
            lengths[i]->value = bad[j];
            said(job, spbm_simplify_topology(job, &ABSENT, 1, output, &options, NULL), "length");
            lengths[i]->value = 0;
        }
    options.max_feature.value = 1;
    options.size = (spbm_loop_size)4;
    said(job, spbm_simplify_topology(job, &ABSENT, 1, output, &options, NULL), "measure");
    options.size = SPBM_SIZE_EXACT;
    static const double angles[][2] = {{0, 90}, {90, 90}, {90, 45}, {45, 181}, {NAN, 90}};
    for (unsigned i = 0; i < 5; i++) {
        memcpy(options.sharp_angle, angles[i], sizeof options.sharp_angle);
        said(job, spbm_simplify_topology(job, &ABSENT, 1, output, &options, NULL), "angles");
    }
    spbm_job_close(&job);
}

static void options_of_the_stages(void **state)
{
    (void)state;
    spbm_job *job = open_job();
    spbm_target target;
    spbm_target_defaults(&target);
    said(job, spbm_patchify(job, ABSENT, test_path("out.chains"), &target, NULL, NULL), "targets");
    said(job, spbm_lod(job, ABSENT, test_path("out.ply"), &target, NULL, NULL), "targets");
    target.count = 2;
    target.values[0] = target.values[1] = 10;
    said(job, spbm_lod(job, ABSENT, test_path("out.ply"), &target, NULL, NULL), "%d");
    said(job, spbm_export(job, ABSENT, test_path("out.xyz"), SPBM_FORMAT_BY_NAME), "ending");
    const char *many[SPBM_RENDER_MAX + 1];
    struct shape shape = shape_tetrahedron();
    const char *mesh = test_path("mesh.ply");
    shape_write(&shape, SHAPE_PLY_LITTLE, mesh);
    shape_free(&shape);
    for (unsigned i = 0; i <= SPBM_RENDER_MAX; i++)
        many[i] = mesh;
    said(job, spbm_render(job, many, SPBM_RENDER_MAX + 1, test_path("out.png"), NULL), "at most");
    assert_int_equal(spbm_render(job, many, 1, test_path("out.png"), NULL), SPBM_OK);
    spbm_job_close(&job);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(options_of_simplify),          cmocka_unit_test(names_that_are_too_long),
        cmocka_unit_test(standard_input_is_there_once), cmocka_unit_test(options_of_topology),
        cmocka_unit_test(options_of_the_stages),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
