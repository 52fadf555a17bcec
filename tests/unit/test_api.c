/* The public interface: jobs, defaults, names of levels, words and clean-up of failures, callbacks.
 */
#include "test_kit.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "spbm.h"
#include "test_alike.h"
#include "test_files.h"

/* A closed strip of 2 n triangles round an axis, with two caps of n: a drum of 4 n faces. */
static void write_drum(const char *path, unsigned n)
{
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fprintf(file, "OFF\n%u %u 0\n", 2 * n + 2, 4 * n);
    for (unsigned i = 0; i < n; i++) {
        /* A square's outline: round enough, and exact in every arithmetic. */
        double t = 4.0 * i / n, x = t < 1 ? t : t < 2 ? 1 : t < 3 ? 3 - t : 0;
        double y = t < 1 ? 0 : t < 2 ? t - 1 : t < 3 ? 1 : 4 - t;
        fprintf(file, "%.9g %.9g 0\n%.9g %.9g 1\n", x, y, x, y);
    }
    fprintf(file, "0.5 0.5 0\n0.5 0.5 1\n");
    for (unsigned i = 0; i < n; i++) {
        unsigned low = 2 * i, next = 2 * ((i + 1) % n);
        fprintf(file, "3 %u %u %u\n3 %u %u %u\n", low, next, next + 1, low, next + 1, low + 1);
        fprintf(file, "3 %u %u %u\n3 %u %u %u\n", next, low, 2 * n, low + 1, next + 1, 2 * n + 1);
    }
    assert_int_equal(fclose(file), 0);
}

static void test_words(void **state)
{
    (void)state;
    for (int status = SPBM_OK; status <= SPBM_INTERNAL + 1; status++)
        assert_true(strlen(spbm_status_text((spbm_status)status)) > 0);
    for (int stop = SPBM_STOP_REACHED; stop <= SPBM_STOP_ERROR + 1; stop++)
        assert_true(strlen(spbm_stop_text((spbm_stop)stop)) > 0);
    assert_string_equal(spbm_version(), SPBM_VERSION);
}

static void test_job(void **state)
{
    (void)state;
    spbm_settings settings;
    spbm_job *job = NULL;
    spbm_settings_defaults(&settings);
    settings.threads = 0;
    assert_int_equal(spbm_job_open(&settings, &job), SPBM_MISUSE);
    assert_null(job);
    assert_int_equal(spbm_job_open(NULL, &job), SPBM_OK);
    assert_string_equal(spbm_job_error(job), "");
    spbm_job_close(&job);
    assert_null(job);
    spbm_job_close(&job);
}

static void test_level_names(void **state)
{
    (void)state;
    char name[32];
    assert_int_equal(spbm_level_name("a-%d.ply", 3, 5, name, sizeof name), SPBM_OK);
    assert_string_equal(name, "a-3.ply");
    assert_int_equal(spbm_level_name("100%%-%d.ply", 12, 16, name, sizeof name), SPBM_OK);
    assert_string_equal(name, "100%-12.ply");
    assert_int_equal(spbm_level_name("a.ply", 0, 1, name, sizeof name), SPBM_OK);
    assert_string_equal(name, "a.ply");
    assert_int_equal(spbm_level_name("a.ply", 0, 2, name, sizeof name), SPBM_MISUSE);
    assert_int_equal(spbm_level_name("%d%d.ply", 0, 2, name, sizeof name), SPBM_MISUSE);
    assert_int_equal(spbm_level_name("%%d.ply", 0, 2, name, sizeof name), SPBM_MISUSE);
    assert_int_equal(spbm_level_name("100%.ply", 0, 1, name, sizeof name), SPBM_MISUSE);
    assert_int_equal(spbm_level_name("a%", 0, 1, name, sizeof name), SPBM_MISUSE);
    assert_int_equal(spbm_level_name("a-%d.ply", 3, 5, name, 7), SPBM_MISUSE);
    assert_int_equal(spbm_level_name("a-%d.ply", 3, 5, name, 8), SPBM_OK);
}

/* Every target out of range is refused before anything is read: the input does not even exist. */
static void test_targets_are_checked_first(void **state)
{
    (void)state;
    static const struct {
        spbm_target_kind kind;
        double value;
    } bad[] = {{SPBM_BY_FACES, 0},    {SPBM_BY_FACES, -1}, {SPBM_BY_FACES, 1.5},
               {SPBM_BY_FACES, 1e12}, {SPBM_BY_RATIO, 0},  {SPBM_BY_RATIO, 1.01},
               {SPBM_BY_ERROR, -0.1}};
    const char *input = "/nonexistent/in.ply";
    spbm_job *job;
    spbm_simplify_options options;
    assert_int_equal(spbm_job_open(NULL, &job), SPBM_OK);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        spbm_simplify_defaults(&options);
        options.target.kind = bad[i].kind;
        options.target.count = 1;
        options.target.values[0] = bad[i].value;
        assert_int_equal(spbm_simplify(job, &input, 1, "/tmp/x.ply", &options, NULL), SPBM_MISUSE);
        assert_true(strlen(spbm_job_error(job)) > 0);
    }
    spbm_simplify_defaults(&options);
    assert_int_equal(spbm_simplify(job, &input, 1, "/tmp/x.ply", &options, NULL), SPBM_MISUSE);
    options.target.count = 1;
    options.target.values[0] = 9;
    options.target.effort = 4;
    assert_int_equal(spbm_simplify(job, &input, 1, "/tmp/x.ply", &options, NULL), SPBM_MISUSE);
    options.target.effort = 2;
    static const struct {
        spbm_target_kind kind;
        double bound;
    } bad_bounds[] = {{SPBM_BY_FACES, -1}, {SPBM_BY_FACES, NAN}, {SPBM_BY_ERROR, 0.5}};
    for (size_t i = 0; i < sizeof bad_bounds / sizeof bad_bounds[0]; i++) {
        options.target.kind = bad_bounds[i].kind;
        options.target.error_bound = bad_bounds[i].bound;
        assert_int_equal(spbm_simplify(job, &input, 1, "/tmp/x.ply", &options, NULL), SPBM_MISUSE);
    }
    options.target.kind = SPBM_BY_FACES;
    options.target.error_bound = 0;
    assert_int_equal(spbm_simplify(job, NULL, 0, "/tmp/x.ply", &options, NULL), SPBM_MISUSE);
    assert_int_equal(spbm_simplify(job, &input, 1, "/tmp/x.nothing", &options, NULL), SPBM_MISUSE);
    assert_int_equal(spbm_simplify(job, &input, 1, "/tmp/x.ply", &options, NULL), SPBM_IO);
    assert_non_null(strstr(spbm_job_error(job), "/nonexistent/in.ply"));
    spbm_job_close(&job);
}

struct heard {
    unsigned steps, messages, polls, stop_at; /* cancel at the poll `stop_at` */
};

static void hear_progress(void *user, const char *stage, uint64_t done, uint64_t total)
{
    struct heard *heard = user;
    assert_true(strlen(stage) > 0);
    assert_true(total == 0 || done <= total);
    heard->steps++;
}

static void hear_message(void *user, spbm_message_kind kind, const char *text)
{
    struct heard *heard = user;
    assert_true(kind == SPBM_NOTE || kind == SPBM_WARNING);
    assert_null(strchr(text, '\n'));
    heard->messages++;
}

static int ask_cancel(void *user)
{
    struct heard *heard = user;
    return ++heard->polls == heard->stop_at;
}

static spbm_status simplify_drum(struct heard *heard, const char *folder, const char *in,
                                 const char *out, spbm_simplify_report *report)
{
    char from[TEST_PATH], to[TEST_PATH];
    spbm_settings settings;
    spbm_simplify_options options;
    spbm_job *job;
    spbm_settings_defaults(&settings);
    settings.progress = hear_progress;
    settings.message = hear_message;
    settings.cancelled = ask_cancel;
    settings.user = heard;
    assert_int_equal(spbm_job_open(&settings, &job), SPBM_OK);
    spbm_simplify_defaults(&options);
    options.target.count = 1;
    options.target.values[0] = 100;
    const char *input = folder_path(from, folder, in);
    spbm_status status =
        spbm_simplify(job, &input, 1, folder_path(to, folder, out), &options, report);
    if (status != SPBM_OK)
        assert_true(strlen(spbm_job_error(job)) > 0);
    spbm_job_close(&job);
    return status;
}

static void test_callbacks(void **state)
{
    (void)state;
    char folder[TEST_PATH], path[TEST_PATH];
    spbm_simplify_report *report = calloc(1, sizeof *report);
    assert_non_null(report);
    folder_make(folder);
    write_drum(folder_path(path, folder, "in.off"), 400);

    struct heard heard = {0};
    assert_int_equal(simplify_drum(&heard, folder, "in.off", "out.ply", report), SPBM_OK);
    assert_true(heard.steps > 0);
    assert_true(heard.polls > 0);
    assert_int_equal(report->stage_count, 3);
    assert_int_equal(report->store.topology.faces, 1600);
    assert_int_equal(report->store.topology.euler, 2);
    assert_int_equal(report->levels.count, 1);
    assert_in_range(report->levels.levels[0].faces, 99, 100);
    assert_int_equal(report->levels.levels[0].stop, SPBM_STOP_REACHED);

    /* Cancelled at every poll there was: nothing is left, whatever point it was. */
    unsigned polls = heard.polls;
    for (unsigned stop = 1; stop <= polls; stop += 1 + polls / 40) {
        struct heard again = {.stop_at = stop};
        assert_int_equal(simplify_drum(&again, folder, "in.off", "never.ply", report),
                         SPBM_CANCELLED);
        assert_int_equal(folder_count(folder), 2);
    }
    free(report);
    assert_int_equal(folder_remove(folder), 2);
}

/* A job that failed does its next call as if nothing had been. */
static void test_job_after_failure(void **state)
{
    (void)state;
    char folder[TEST_PATH], in[TEST_PATH], store[TEST_PATH], chains[TEST_PATH], out[TEST_PATH];
    spbm_job *job;
    spbm_target target;
    spbm_levels levels;
    spbm_file_figures *figures = calloc(1, sizeof *figures);
    assert_non_null(figures);
    folder_make(folder);
    const char *input = folder_path(in, folder, "in.off");
    folder_path(store, folder, "a.store");
    folder_path(chains, folder, "a.chains");
    folder_path(out, folder, "a.ply");
    write_drum(input, 100);
    spbm_target_defaults(&target);
    target.count = 1;
    target.values[0] = 60;

    assert_int_equal(spbm_job_open(NULL, &job), SPBM_OK);
    assert_int_equal(spbm_patchify(job, store, chains, &target, NULL, NULL), SPBM_IO);
    assert_int_equal(spbm_import(job, &input, 1, input, NULL, NULL), SPBM_MISUSE);
    assert_int_equal(spbm_import(job, &input, 1, store, NULL, NULL), SPBM_OK);
    assert_string_equal(spbm_job_error(job), "");
    assert_int_equal(spbm_lod(job, store, out, &target, NULL, &levels), SPBM_BAD_INPUT);
    assert_int_equal(spbm_patchify(job, store, chains, &target, NULL, NULL), SPBM_OK);
    assert_int_equal(spbm_lod(job, chains, out, &target, NULL, &levels), SPBM_OK);
    assert_int_equal(levels.original_faces, 400);
    assert_int_equal(spbm_info(job, chains, figures), SPBM_OK);
    assert_int_equal(figures->kind, SPBM_FILE_CHAINS);
    assert_int_equal(spbm_info(job, store, figures), SPBM_OK);
    assert_int_equal(figures->kind, SPBM_FILE_STORE);
    assert_int_equal(spbm_info(job, out, figures), SPBM_OK);
    assert_int_equal(figures->kind, SPBM_FILE_MESH);
    assert_int_equal(figures->mesh.topology.euler, 2);
    assert_int_equal(spbm_check(job, out, NULL), SPBM_OK);
    assert_true(spbm_job_memory_peak(job) > 0);
    spbm_job_close(&job);
    free(figures);
    assert_int_equal(folder_remove(folder), 4);
}

static void read_corner(const char *path, unsigned *width, unsigned *height)
{
    size_t size;
    unsigned char *data = file_read(path, &size);
    assert_non_null(data);
    assert_true(size > 24);
    *width = (unsigned)(data[18] << 8 | data[19]);
    *height = (unsigned)(data[22] << 8 | data[23]);
    free(data);
}

/* Measuring writes the errors, and a picture of them beside the plain mesh has two panes. */
static void test_errors_and_picture(void **state)
{
    (void)state;
    char folder[TEST_PATH], in[TEST_PATH], out[TEST_PATH], errors[TEST_PATH], picture[TEST_PATH];
    unsigned width, height;
    spbm_job *job;
    spbm_measurement *measurement = calloc(1, sizeof *measurement);
    spbm_file_figures *figures = calloc(1, sizeof *figures);
    spbm_measure_options options;
    spbm_render_options render;
    struct heard heard = {0};
    assert_non_null(measurement);
    assert_non_null(figures);
    folder_make(folder);
    write_drum(folder_path(in, folder, "in.off"), 100);
    folder_path(out, folder, "out.ply");
    folder_path(errors, folder, "errors.ply");
    folder_path(picture, folder, "picture.png");
    assert_int_equal(simplify_drum(&heard, folder, "in.off", "out.ply", NULL), SPBM_OK);

    assert_int_equal(spbm_job_open(NULL, &job), SPBM_OK);
    spbm_measure_defaults(&options);
    options.error_ply = folder_path(picture, folder, "errors.obj");
    assert_int_equal(spbm_measure(job, in, out, &options, measurement), SPBM_MISUSE);
    options.error_ply = out;
    assert_int_equal(spbm_measure(job, in, out, &options, measurement), SPBM_MISUSE);
    options.error_ply = errors;
    assert_int_equal(spbm_measure(job, in, out, &options, measurement), SPBM_OK);
    assert_int_equal(spbm_info(job, errors, figures), SPBM_OK);
    assert_int_equal(figures->mesh.topology.faces, measurement->simplified.topology.faces);
    assert_int_equal(figures->mesh.attribute_count, 4); /* quality, red, green, blue */

    const char *meshes[2] = {errors, out};
    folder_path(picture, folder, "picture.png");
    spbm_render_defaults(&render);
    render.width = 80;
    render.height = 60;
    assert_int_equal(spbm_render(job, meshes, 2, in, &render), SPBM_MISUSE);
    assert_int_equal(spbm_render(job, meshes, 2, picture, &render), SPBM_OK);
    read_corner(picture, &width, &height);
    assert_int_equal(width, 160);
    assert_int_equal(height, 60);
    spbm_job_close(&job);
    free(figures);
    free(measurement);
    assert_int_equal(folder_remove(folder), 4);
}

struct runner {
    const char *folder;
    char out[16];
    spbm_status status;
};

static void *run_drum(void *user)
{
    struct runner *runner = user;
    struct heard heard = {0};
    runner->status = simplify_drum(&heard, runner->folder, "in.off", runner->out, NULL);
    return NULL;
}

static void test_jobs_are_independent(void **state)
{
    (void)state;
    enum { JOBS = 4 };
    char folder[TEST_PATH], path[TEST_PATH];
    struct runner runners[JOBS];
    pthread_t threads[JOBS];
    struct first_bytes first = {NULL, 0};
    folder_make(folder);
    write_drum(folder_path(path, folder, "in.off"), 400);
    for (unsigned i = 0; i < JOBS; i++) {
        runners[i].folder = folder;
        snprintf(runners[i].out, sizeof runners[i].out, "%u.ply", i);
        assert_int_equal(pthread_create(&threads[i], NULL, run_drum, &runners[i]), 0);
    }
    for (unsigned i = 0; i < JOBS; i++)
        assert_int_equal(pthread_join(threads[i], NULL), 0);
    for (unsigned i = 0; i < JOBS; i++) {
        size_t size;
        assert_int_equal(runners[i].status, SPBM_OK);
        unsigned char *bytes = file_read(folder_path(path, folder, runners[i].out), &size);
        assert_non_null(bytes);
        first_bytes_compare(&first, bytes, size);
    }
    free(first.bytes);
    assert_int_equal(folder_remove(folder), JOBS + 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_words),
        cmocka_unit_test(test_job),
        cmocka_unit_test(test_level_names),
        cmocka_unit_test(test_targets_are_checked_first),
        cmocka_unit_test(test_callbacks),
        cmocka_unit_test(test_job_after_failure),
        cmocka_unit_test(test_errors_and_picture),
        cmocka_unit_test(test_jobs_are_independent),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
