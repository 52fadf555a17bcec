/*
 * Every call of the public interface on small files, with one allocation or guarded system call
 * failing: it ends with a status and one line of words, without a leak, an open descriptor or a
 * file that was not there before, and the same call again succeeds, with the bytes of an
 * undisturbed one. The stages by themselves are in test_pipeline_faults.c; here are the whole run
 * (plain and resumable), all that looks at files, and what comes between calls and stages.
 *
 * The first calls are tried one by one, later ones in growing strides; every one with
 * SPBM_EVERY_FAULT=1.
 */
#include "test_kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "api_internal.h"
#include "test_files.h"
#include "test_shapes.h"

enum { ONE_BY_ONE = 30 };

struct place {
    char folder[TEST_PATH], work[TEST_PATH];
    char scan[TEST_PATH], store[TEST_PATH], chains[TEST_PATH], small[TEST_PATH];
    char output[TEST_PATH];
    int files; /* in the folder between calls */
};

/* One call of the interface; what it writes, if anything, is `output`. */
typedef spbm_status call_function(spbm_job *job, struct place *place);

static void want_faces(spbm_target *target, spbm_mode mode)
{
    spbm_target_defaults(target);
    target->mode = mode;
    target->effort = 1;
    target->count = 1;
    target->values[0] = 200;
}

static spbm_status simplify(spbm_job *job, struct place *place, spbm_mode mode, bool resumable)
{
    spbm_simplify_options options;
    const char *input = place->scan;
    spbm_simplify_defaults(&options);
    want_faces(&options.target, mode);
    options.resume_dir = resumable ? place->work : NULL;
    spbm_status status = spbm_simplify(job, &input, 1, place->output, &options, NULL);
    return status == SPBM_TARGET_MISSED ? SPBM_OK : status;
}

static spbm_status call_collapse(spbm_job *job, struct place *place)
{
    return simplify(job, place, SPBM_COLLAPSE, false);
}

static spbm_status call_classic(spbm_job *job, struct place *place)
{
    return simplify(job, place, SPBM_CLASSIC, false);
}

static spbm_status call_resumable(spbm_job *job, struct place *place)
{
    return simplify(job, place, SPBM_COLLAPSE, true);
}

static spbm_status call_import(spbm_job *job, struct place *place)
{
    const char *input = place->scan;
    return spbm_import(job, &input, 1, place->output, NULL, NULL);
}

static spbm_status call_patchify(spbm_job *job, struct place *place)
{
    spbm_target target;
    want_faces(&target, SPBM_COLLAPSE);
    return spbm_patchify(job, place->store, place->output, &target, NULL, NULL);
}

static spbm_status call_lod(spbm_job *job, struct place *place)
{
    spbm_target target;
    want_faces(&target, SPBM_COLLAPSE);
    spbm_status status = spbm_lod(job, place->chains, place->output, &target, NULL, NULL);
    return status == SPBM_TARGET_MISSED ? SPBM_OK : status;
}

static spbm_status call_topology(spbm_job *job, struct place *place)
{
    spbm_topology_options options;
    const char *input = place->scan;
    spbm_topology_defaults(&options);
    options.drop_components = (spbm_length){.value = 0.5, .is_relative = 1};
    options.merge_coplanar = 1;
    return spbm_simplify_topology(job, &input, 1, place->output, &options, NULL);
}

static spbm_status call_lod_topology(spbm_job *job, struct place *place)
{
    spbm_target target;
    spbm_topology_options options;
    want_faces(&target, SPBM_COLLAPSE);
    spbm_topology_defaults(&options);
    options.max_feature = (spbm_length){.value = 0.1, .is_relative = 1};
    spbm_status status =
        spbm_lod_topology(job, place->chains, place->output, &target, NULL, &options, NULL);
    return status == SPBM_TARGET_MISSED ? SPBM_OK : status;
}

static spbm_status call_export(spbm_job *job, struct place *place)
{
    return spbm_export(job, place->store, place->output, SPBM_FORMAT_STL);
}

static spbm_status call_export_text(spbm_job *job, struct place *place)
{
    return spbm_export(job, place->store, place->output, SPBM_FORMAT_OBJ);
}

static spbm_status call_info(spbm_job *job, struct place *place)
{
    spbm_file_figures *figures = calloc(1, sizeof *figures);
    spbm_status status = spbm_info(job, place->scan, figures);
    if (status == SPBM_OK)
        status = spbm_info(job, place->store, figures);
    if (status == SPBM_OK)
        status = spbm_info(job, place->chains, figures);
    free(figures);
    return status;
}

static spbm_status call_check(spbm_job *job, struct place *place)
{
    spbm_status status = spbm_check(job, place->scan, NULL);
    if (status == SPBM_OK)
        status = spbm_check(job, place->store, NULL);
    return status == SPBM_OK ? spbm_check(job, place->chains, NULL) : status;
}

static spbm_status call_measure(spbm_job *job, struct place *place)
{
    spbm_measure_options options;
    spbm_measurement measurement;
    spbm_measure_defaults(&options);
    options.self_intersections = 1;
    options.error_ply = place->output;
    return spbm_measure(job, place->store, place->small, &options, &measurement);
}

static spbm_status call_render(spbm_job *job, struct place *place)
{
    const char *paths[] = {place->scan, place->store, place->chains};
    spbm_render_options options;
    spbm_render_defaults(&options);
    options.width = options.height = 64;
    options.wireframe = 1;
    return spbm_render(job, paths, 3, place->output, &options);
}

/* ---- one call with one fault ---- */

static spbm_job *open_job(const struct place *place)
{
    spbm_settings settings;
    spbm_job *job;
    spbm_settings_defaults(&settings);
    settings.tmp_dir = place->work;
    assert_int_equal(spbm_job_open(&settings, &job), SPBM_OK);
    return job;
}

static unsigned char *run_well(struct place *place, call_function *call, size_t *size)
{
    spbm_job *job = open_job(place);
    if (call(job, place) != SPBM_OK)
        fail_msg("an undisturbed call fails: %s", spbm_job_error(job));
    spbm_job_close(&job);
    assert_int_equal(folder_count(place->work), 0);
    unsigned char *bytes = file_read(place->output, size);
    remove(place->output);
    assert_int_equal(folder_count(place->folder), place->files);
    return bytes;
}

static void check_words(const spbm_job *job, spbm_status status, unsigned long long after)
{
    const char *words = spbm_job_error(job);
    bool is_known = status == SPBM_NO_MEMORY || status == SPBM_NO_SPACE || status == SPBM_IO;
    if (!is_known || strlen(words) < 10 || strchr(words, '\n'))
        fail_msg("call %llu: status %d, '%s'", after, (int)status, words);
}

/* True if there are so many calls. */
static bool run_and_fail(struct place *place, call_function *call, uint64_t after,
                         const unsigned char *good, size_t good_size)
{
    spbm_job *job = open_job(place);
    int descriptors = folder_count("/proc/self/fd");
    job->ctx.fault_after = after;
    spbm_status status = call(job, place);
    bool is_reached = job->ctx.fault_after == UINT64_MAX;
    unsigned long long number = after;
    if (status != SPBM_OK)
        check_words(job, status, number);
    if (status != SPBM_OK && !is_reached)
        fail_msg("fails by itself: %s", spbm_job_error(job));
    if (job->ctx.memory_now != 0)
        fail_msg("call %llu leaks %llu bytes", number, (unsigned long long)job->ctx.memory_now);
    if (folder_count("/proc/self/fd") != descriptors)
        fail_msg("call %llu leaks a descriptor", number);
    spbm_job_close(&job);

    size_t size = 0;
    unsigned char *bytes = file_read(place->output, &size);
    if (status != SPBM_OK && bytes)
        fail_msg("call %llu leaves an output", number);
    if (status == SPBM_OK &&
        (!bytes != !good || size != good_size || (good && memcmp(bytes, good, size) != 0)))
        fail_msg("call %llu changes the output", number);
    free(bytes);
    remove(place->output);
    if (folder_count(place->folder) != place->files)
        fail_msg("call %llu leaves a file", number);
    return is_reached;
}

static void fail_everywhere(struct place *place, call_function *call)
{
    const bool all = getenv("SPBM_EVERY_FAULT") != NULL;
    size_t size = 0, again_size = 0;
    unsigned char *good = run_well(place, call, &size);
    uint64_t after = 0, runs = 0;
    while (run_and_fail(place, call, after, good, size)) {
        if (all || runs++ % 8 == 0) {
            unsigned char *again = run_well(place, call, &again_size);
            assert_int_equal(again_size, size);
            if (good)
                assert_memory_equal(again, good, size);
            free(again);
        }
        after += all || after < ONE_BY_ONE ? 1 : 1 + after / 20;
    }
    assert_true(after > 5);
    print_message("%llu calls\n", (unsigned long long)after);
    free(good);
    free(run_well(place, call, &again_size));
}

/* ---- the place ---- */

static int set_up(void **state)
{
    struct place *place = calloc(1, sizeof *place);
    size_t size;
    folder_make(place->folder);
    folder_path(place->work, place->folder, "work");
    folder_path(place->scan, place->folder, "scan.ply");
    folder_path(place->store, place->folder, "a.store");
    folder_path(place->chains, place->folder, "a.chains");
    folder_path(place->small, place->folder, "small.ply");
    folder_path(place->output, place->folder, "out.ply");
    mkdir(place->work, 0700);
    struct shape shape = shape_noisy_torus(24, 12, 0.005, 3);
    shape_write(&shape, SHAPE_PLY_LITTLE, place->scan);
    shape_free(&shape);

    struct {
        call_function *call;
        char *kept;
    } steps[] = {
        {call_import, place->store}, {call_patchify, place->chains}, {call_lod, place->small}};
    for (unsigned i = 0; i < 3; i++) {
        place->files = folder_count(place->folder);
        unsigned char *bytes = run_well(place, steps[i].call, &size);
        file_write(steps[i].kept, bytes, size);
        free(bytes);
    }
    place->files = folder_count(place->folder);
    *state = place;
    return 0;
}

static int tear_down(void **state)
{
    struct place *place = *state;
    rmdir(place->work);
    folder_remove(place->folder);
    free(place);
    return 0;
}

#define FAULTS(name) \
    static void name##_fails_cleanly(void **state) \
    { \
        fail_everywhere(*state, call_##name); \
    }

FAULTS(collapse)
FAULTS(classic)
FAULTS(resumable)
FAULTS(import)
FAULTS(patchify)
FAULTS(lod)
FAULTS(lod_topology)
FAULTS(topology)
FAULTS(export)
FAULTS(export_text)
FAULTS(info)
FAULTS(check)
FAULTS(measure)

static void render_fails_cleanly(void **state)
{
    struct place *place = *state;
    folder_path(place->output, place->folder, "out.png");
    fail_everywhere(place, call_render);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name##_fails_cleanly, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(collapse), TEST(classic),      TEST(resumable), TEST(import), TEST(patchify),
        TEST(lod),      TEST(lod_topology), TEST(topology),  TEST(export), TEST(export_text),
        TEST(info),     TEST(check),        TEST(measure),   TEST(render),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
