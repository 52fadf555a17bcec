/*
 * Running a command: limits, job, callbacks, signals, exit code.
 *
 * SIGINT and SIGTERM only set a flag, which the library asks for between batches; it then cleans up
 * behind itself and the run ends with 128 + the signal's number. A second signal ends it at once:
 * what a run has on disk until then has no name, or one that is told from a finished file's.
 *
 * A mapped file that someone makes shorter is a SIGBUS where it is touched next; it could be met
 * only by copying every page before it is looked at. There is no way back from there, but there are
 * words and an exit code instead of a crash.
 */
#include "run.h"

#include <errno.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include "values.h"

static volatile sig_atomic_t caught_signal;

static void note_signal(int number)
{
    caught_signal = number;
}

/* Only write and _exit: nothing else is safe here. */
static void end_by_lost_page(int number)
{
    static const char words[] =
        "spbm: error: a file was made shorter by someone else while it was read\n";
    (void)number;
    if (write(STDERR_FILENO, words, sizeof words - 1) >= 0)
        _exit(EXIT_FAILED);
    _exit(EXIT_FAILED); /* nobody listens */
}

static void catch_signals(void)
{
    static const int numbers[] = {SIGINT, SIGTERM, SIGHUP};
    struct sigaction action = {.sa_handler = note_signal, .sa_flags = (int)SA_RESETHAND};
    sigemptyset(&action.sa_mask);
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) {
        struct sigaction before;
        /* What was started to be left alone (nohup) is left alone. */
        if (sigaction(numbers[i], NULL, &before) == 0 && before.sa_handler != SIG_IGN)
            sigaction(numbers[i], &action, NULL);
    }
    signal(SIGPIPE, SIG_IGN); /* a closed pipe is a failed write, with words */
    signal(SIGXFSZ, SIG_IGN); /* and so is a file that may not grow */
    struct sigaction lost = {.sa_handler = end_by_lost_page};
    sigemptyset(&lost.sa_mask);
    sigaction(SIGBUS, &lost, NULL);
}

/* ---- callbacks ---- */

static void show_progress(void *user, const char *stage, uint64_t done, uint64_t total)
{
    struct run *run = user;
    progress_show(&run->progress, stage, done, total);
}

static void show_message(void *user, spbm_message_kind kind, const char *text)
{
    struct run *run = user;
    const char *word = kind == SPBM_WARNING ? "warning" : "note";
    if (!report_message(&run->report, word, text))
        return;
    if (kind == SPBM_WARNING || !run->options->quiet)
        progress_message(&run->progress, word, text);
}

static int is_cancelled(void *user)
{
    (void)user;
    return caught_signal != 0;
}

/* ---- the run ---- */

static const char *temporary_folder(const struct options *options)
{
    if (options->tmp_dir)
        return options->tmp_dir;
    const char *folder = getenv("TMPDIR");
    return folder && *folder ? folder : NULL;
}

/* False, with words, when the place for temporary files is none. */
static bool check_folder(struct run *run, const char *folder)
{
    enum { TMPFS = 0x01021994 };
    struct stat info;
    struct statfs system;
    if (!folder)
        return true;
    if (stat(folder, &info) != 0 || !S_ISDIR(info.st_mode)) {
        fprintf(stderr, "spbm: error: %s %s: %s\n", run->options->tmp_dir ? "--tmp" : "$TMPDIR",
                folder, errno ? strerror(errno) : "not a directory");
        return false;
    }
    if (run->options->tmp_dir && statfs(folder, &system) == 0 && system.f_type == TMPFS)
        show_message(run, SPBM_NOTE, "the temporary files' place is in memory (tmpfs)");
    return true;
}

static bool is_same_file(const char *one, const char *other)
{
    struct stat a, b;
    if (strcmp(one, "-") == 0 || strcmp(other, "-") == 0)
        return false;
    if (strcmp(one, other) == 0)
        return true;
    return stat(one, &a) == 0 && stat(other, &b) == 0 && S_ISREG(a.st_mode) &&
           a.st_dev == b.st_dev && a.st_ino == b.st_ino;
}

/* False, with words, when the JSON would replace an input or the output. */
static bool check_json(const struct options *options)
{
    if (!options->json)
        return true;
    const char *error_ply = options->measure.error_ply;
    bool is_free = (!options->output || !is_same_file(options->json, options->output)) &&
                   (!error_ply || !is_same_file(options->json, error_ply));
    for (size_t i = 0; i < options->input_count && is_free; i++)
        is_free = !is_same_file(options->json, options->inputs[i]);
    if (!is_free)
        fprintf(stderr, "spbm: error: --json %s: is also an input or the output\n", options->json);
    return is_free;
}

static int exit_code_of(spbm_status status)
{
    switch (status) {
    case SPBM_OK:
        return EXIT_DONE;
    case SPBM_MISUSE:
        return EXIT_MISUSE;
    case SPBM_TARGET_MISSED:
        return EXIT_MISSED;
    case SPBM_NO_MEMORY:
    case SPBM_NO_SPACE:
        return EXIT_FULL;
    case SPBM_CANCELLED:
        return caught_signal ? 128 + caught_signal : EXIT_FAILED;
    case SPBM_BAD_INPUT:
    case SPBM_IO:
    case SPBM_INTERNAL:
        break;
    }
    return EXIT_FAILED;
}

static spbm_status open_job(struct run *run)
{
    spbm_settings settings;
    spbm_settings_defaults(&settings);
    settings.memory = run->limits.memory;
    settings.threads = run->limits.threads;
    settings.tmp_dir = temporary_folder(run->options);
    settings.progress = show_progress;
    settings.message = show_message;
    settings.cancelled = is_cancelled;
    settings.user = run;
    return spbm_job_open(&settings, &run->job);
}

int run_command(const struct command *command, const struct options *options)
{
    struct run run = {.command = command, .options = options};
    if (!check_json(options))
        return EXIT_MISUSE;
    limits_find(&run.limits);
    if (options->memory) {
        run.limits.memory = options->memory;
        run.limits.memory_from = "--memory";
    }
    if (options->threads) {
        run.limits.threads = options->threads;
        run.limits.threads_from = "--threads";
    }
    catch_signals();
    progress_begin(&run.progress, options->quiet);
    report_begin(&run.report, command, options, &run.limits);

    spbm_status status = SPBM_MISUSE;
    const char *error = "no place for temporary files";
    if (check_folder(&run, temporary_folder(options))) {
        status = open_job(&run);
        error = spbm_status_text(status);
    }
    if (run.job) {
        status = command->work(&run);
        error = spbm_job_error(run.job);
        error = *error ? error : spbm_status_text(status);
        progress_clear(&run.progress);
    }
    int exit_code = exit_code_of(status);
    bool has_failed = exit_code != EXIT_DONE && exit_code != EXIT_MISSED;
    if (run.job && caught_signal && has_failed)
        error = caught_signal == SIGINT ? "interrupted" : "ended by a signal";
    if (run.job && has_failed)
        progress_message(&run.progress, "error", error);
    else if (exit_code == EXIT_MISSED)
        progress_message(&run.progress, "warning", error);
    exit_code = report_finish(&run.report, options, command->name, spbm_status_text(status),
                              exit_code, exit_code == EXIT_DONE ? NULL : error);
    spbm_job_close(&run.job);
    if (fflush(stdout) != 0 && exit_code == EXIT_DONE) {
        fprintf(stderr, "spbm: error: standard output: %s\n", strerror(errno));
        exit_code = EXIT_FAILED;
    }
    return exit_code;
}
