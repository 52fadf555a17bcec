/*
 * A resumable run that is killed (SIGKILL) at a write, sync, rename or any other guarded system
 * call, and the same run again: it ends well, with the bytes of an undisturbed run, and nothing but
 * the result is left. The killing is done by the library's own fault injection in a child process.
 *
 * A small run has a thousand such calls. Of these a few are tried in growing strides; all of them,
 * and two kills one after the other, with SPBM_EVERY_FAULT=1 (minutes).
 */
#include "test_kit.h"

#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "api_internal.h"
#include "test_files.h"
#include "test_shapes.h"

enum { KEPT = 2, LEVELS = 2 };

struct place {
    char folder[TEST_PATH], work[TEST_PATH];
    char scan[TEST_PATH], output[TEST_PATH];
    unsigned char *good[LEVELS];
    size_t sizes[LEVELS];
};

static int set_up(void **state)
{
    struct place *place = calloc(1, sizeof *place);
    folder_make(place->folder);
    folder_path(place->work, place->folder, "work");
    folder_path(place->scan, place->folder, "scan.ply");
    folder_path(place->output, place->folder, "level-%d.ply");
    mkdir(place->work, 0700);
    struct shape shape = shape_noisy_torus(24, 12, 0.005, 3);
    shape_write(&shape, SHAPE_PLY_LITTLE, place->scan);
    shape_free(&shape);
    *state = place;
    return 0;
}

static int tear_down(void **state)
{
    struct place *place = *state;
    for (int i = 0; i < LEVELS; i++)
        free(place->good[i]);
    rmdir(place->work);
    folder_remove(place->folder);
    free(place);
    return 0;
}

/* One run; `after` UINT64_MAX: undisturbed. Returns its status. */
static spbm_status run(const struct place *place, spbm_mode mode, uint64_t after)
{
    spbm_settings settings;
    spbm_simplify_options options;
    spbm_job *job;
    const char *input = place->scan;
    spbm_settings_defaults(&settings);
    settings.tmp_dir = place->work;
    spbm_simplify_defaults(&options);
    options.target.count = LEVELS;
    options.target.values[0] = 200;
    options.target.values[1] = 100;
    options.target.mode = mode;
    options.target.effort = 1;
    options.resume_dir = place->work;
    assert_int_equal(spbm_job_open(&settings, &job), SPBM_OK);
    job->ctx.fault_kills = true;
    job->ctx.fault_after = after;
    spbm_status status = spbm_simplify(job, &input, 1, place->output, &options, NULL);
    if (status != SPBM_OK && status != SPBM_TARGET_MISSED)
        fail_msg("%s", spbm_job_error(job));
    spbm_job_close(&job);
    return status;
}

/* True if the run was killed, false if it had no so many calls and ended well. */
static bool run_and_kill(const struct place *place, spbm_mode mode, uint64_t after)
{
    int ended;
    fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        (void)run(place, mode, after);
        _exit(0);
    }
    assert_int_equal(waitpid(child, &ended, 0), child);
    if (WIFSIGNALED(ended) && WTERMSIG(ended) == SIGKILL)
        return true;
    assert_true(WIFEXITED(ended) && WEXITSTATUS(ended) == 0);
    return false;
}

static void level_path(const struct place *place, int level, char path[TEST_PATH])
{
    char name[32];
    snprintf(name, sizeof name, "level-%d.ply", level);
    folder_path(path, place->folder, name);
}

/* All levels are right, and only they and the scan are there. */
static void check_result(struct place *place, uint64_t after)
{
    for (int level = 0; level < LEVELS; level++) {
        char path[TEST_PATH];
        size_t size;
        level_path(place, level, path);
        unsigned char *bytes = file_read(path, &size);
        assert_non_null(bytes);
        if (!place->good[level]) {
            place->good[level] = bytes;
            place->sizes[level] = size;
        } else {
            if (size != place->sizes[level] || memcmp(bytes, place->good[level], size) != 0)
                fail_msg("killed at call %llu: level %d is another one", (unsigned long long)after,
                         level);
            free(bytes);
        }
        remove(path);
    }
    if (folder_count(place->work) != 0)
        fail_msg("killed at call %llu: a folder is left", (unsigned long long)after);
    assert_int_equal(folder_count(place->folder), KEPT);
}

static void kill_everywhere(struct place *place, spbm_mode mode)
{
    const bool all = getenv("SPBM_EVERY_FAULT") != NULL;
    (void)run(place, mode, UINT64_MAX);
    check_result(place, UINT64_MAX);
    uint64_t after = 0, kills = 0;
    while (run_and_kill(place, mode, after)) {
        kills++;
        if (all && after % 7 == 3) /* the resumed run is killed too */
            (void)run_and_kill(place, mode, after / 2);
        (void)run(place, mode, UINT64_MAX);
        check_result(place, after);
        after += all ? 1 : 1 + after / 12;
    }
    check_result(place, after);
    assert_true(kills > 15);
    print_message("%llu kills, %llu calls\n", (unsigned long long)kills, (unsigned long long)after);
}

static void collapse_goes_on_after_a_kill(void **state)
{
    kill_everywhere(*state, SPBM_COLLAPSE);
}

static void classic_goes_on_after_a_kill(void **state)
{
    kill_everywhere(*state, SPBM_CLASSIC);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(collapse_goes_on_after_a_kill),
        TEST(classic_goes_on_after_a_kill),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
