/*
 * A bar is redrawn in place by a carriage return; a log file or a pipe would collect thousands of
 * them, so there it is left out. A "dumb" terminal cannot erase a line and is treated like a file.
 */
#include "progress.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "values.h"

static double now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

void progress_begin(struct progress *progress, bool quiet)
{
    const char *terminal = getenv("TERM"), *no_colour = getenv("NO_COLOR");
    bool can_erase = isatty(STDERR_FILENO) && terminal && strcmp(terminal, "dumb") != 0;
    memset(progress, 0, sizeof *progress);
    progress->shows_bar = can_erase && !quiet;
    progress->has_colours = can_erase && !(no_colour && *no_colour);
}

void progress_clear(struct progress *progress)
{
    if (progress->is_drawn)
        fputs("\r\033[K", stderr);
    progress->is_drawn = false;
}

void progress_show(struct progress *progress, const char *stage, uint64_t done, uint64_t total)
{
    enum { WIDTH = 30 };
    if (!progress->shows_bar)
        return;
    double time = now();
    if (strncmp(progress->stage, stage, sizeof progress->stage - 1) != 0) {
        snprintf(progress->stage, sizeof progress->stage, "%s", stage);
        progress->stage_began = time;
        progress->last_drawn = 0;
    }
    if (time - progress->last_drawn < 0.1)
        return;
    progress->last_drawn = time;

    struct text elapsed = seconds_text(time - progress->stage_began);
    if (total > 0) {
        double part = done < total ? (double)done / (double)total : 1.0;
        char bar[WIDTH + 1];
        int filled = (int)(part * WIDTH);
        memset(bar, '.', WIDTH);
        memset(bar, '#', (size_t)filled);
        bar[WIDTH] = '\0';
        fprintf(stderr, "\r\033[K%-20.20s [%s] %3d %%  %s", progress->stage, bar, (int)(100 * part),
                elapsed.s);
    } else {
        fprintf(stderr, "\r\033[K%-20.20s %s  %s", progress->stage, count_text(done).s, elapsed.s);
    }
    fflush(stderr);
    progress->is_drawn = true;
}

void progress_message(struct progress *progress, const char *kind, const char *text)
{
    bool is_error = strcmp(kind, "error") == 0;
    const char *colour = !progress->has_colours ? "" : is_error ? "\033[31m" : "\033[33m";
    progress_clear(progress);
    if (*kind)
        fprintf(stderr, "spbm: %s%s:%s %s\n", colour, kind, *colour ? "\033[0m" : "", text);
    else
        fprintf(stderr, "spbm: %s\n", text);
}
