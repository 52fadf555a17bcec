/*
 * Where store and chain file of a whole run lie: under names in a folder that the user wants them
 * in, or in files without a name, which the stages reach through /proc/self/fd: whatever ends the
 * process, even a SIGKILL, nothing of these stays behind.
 */
#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "api_internal.h"
#include "base/file.h"

enum status workspace_keep(struct workspace *work, const char *keep_dir)
{
    struct context *ctx = work->ctx;
    struct stat info;
    if (mkdir(keep_dir, 0777) != 0 && errno != EEXIST)
        return fail_errno(ctx, errno, "%s: cannot create the directory", keep_dir);
    if (stat(keep_dir, &info) == 0 && !S_ISDIR(info.st_mode))
        return fail(ctx, STATUS_IO, "%s: is not a directory", keep_dir);
    int store = snprintf(work->store, sizeof work->store, "%s/mesh.store", keep_dir);
    int chains = snprintf(work->chains, sizeof work->chains, "%s/mesh.chains", keep_dir);
    if (store >= (int)sizeof work->store || chains >= (int)sizeof work->chains)
        return fail(ctx, STATUS_MISUSE, "%s: the name is too long", keep_dir);
    enum status status = check_writable(ctx, work->store);
    return status == STATUS_OK ? check_writable(ctx, work->chains) : status;
}

void workspace_init(struct workspace *work, struct context *ctx)
{
    *work = (struct workspace){.ctx = ctx,
                               .tmp_dir = ctx->tmp_dir,
                               .store_fd = -1,
                               .chains_fd = -1,
                               .raw_fd = -1,
                               .scratch_fd = -1};
}

/* The stages see no output for temporary files to lie beside, so they are told the place. */
static void choose_folder(struct workspace *work, const char *output)
{
    struct context *ctx = work->ctx;
    struct stat info;
    if (!ctx->tmp_dir && !is_standard_stream(output) &&
        (stat(output, &info) != 0 || S_ISREG(info.st_mode))) {
        folder_of(output, work->folder);
        ctx->tmp_dir = work->folder;
    }
}

/* A file without a name, and the path (PATH_MAX bytes) by which the stages reach it. */
static enum status hide_file(struct context *ctx, int *fd, char *path)
{
    enum status status = temp_open(ctx, NULL, fd);
    if (status != STATUS_OK)
        return status;
    snprintf(path, PATH_MAX, "/proc/self/fd/%d", *fd);
    if (access(path, R_OK | W_OK) != 0)
        return fail_errno(ctx, errno, "%s: cannot be opened (is /proc mounted?)", path);
    return STATUS_OK;
}

enum status workspace_hide(struct workspace *work, const char *output)
{
    choose_folder(work, output);
    enum status status = hide_file(work->ctx, &work->store_fd, work->store);
    return status == STATUS_OK ? hide_file(work->ctx, &work->chains_fd, work->chains) : status;
}

enum status workspace_hide_raw(struct workspace *work, const char *output)
{
    choose_folder(work, output);
    enum status status = hide_file(work->ctx, &work->raw_fd, work->raw);
    return status == STATUS_OK ? hide_file(work->ctx, &work->scratch_fd, work->scratch) : status;
}

/* The files of a workspace that may have no name. */
struct hidden_file {
    int fd;
    const char *path, *words;
};

static void list_hidden(const struct workspace *work, struct hidden_file files[4])
{
    files[0] = (struct hidden_file){work->store_fd, work->store, "mesh store"};
    files[1] = (struct hidden_file){work->chains_fd, work->chains, "chain file"};
    files[2] = (struct hidden_file){work->raw_fd, work->raw, "mesh store"};
    files[3] = (struct hidden_file){work->scratch_fd, work->scratch, "chain file"};
}

void workspace_explain(struct workspace *work)
{
    struct context *ctx = work->ctx;
    struct hidden_file files[4];
    list_hidden(work, files);
    for (unsigned i = 0; i < 4; i++) {
        const char *path = files[i].path;
        char text[sizeof ctx->error + PATH_MAX + 64], *at = strstr(ctx->error, path);
        if (files[i].fd < 0 || !at)
            continue;
        *at = '\0';
        snprintf(text, sizeof text, "%sthe temporary %s in %s%s", ctx->error, files[i].words,
                 ctx->tmp_dir ? ctx->tmp_dir : "/var/tmp", at + strlen(path));
        text[sizeof ctx->error - 1] = '\0';
        memcpy(ctx->error, text, sizeof ctx->error);
    }
}

void close_hidden(int *fd)
{
    if (*fd >= 0)
        close(*fd);
    *fd = -1;
}

void workspace_close(struct workspace *work)
{
    close_hidden(&work->store_fd);
    close_hidden(&work->chains_fd);
    close_hidden(&work->raw_fd);
    close_hidden(&work->scratch_fd);
    work->ctx->tmp_dir = work->tmp_dir;
}
