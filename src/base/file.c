/*
 * Outputs that appear whole or not at all, and temporary files.
 *
 * Writing straight into the final name leaves half a file behind whenever something stops the
 * program. So a regular output is written into a file that has no name yet (O_TMPFILE, so that even
 * SIGKILL leaves nothing), or, where the file system can't do that, under a dotted name beside the
 * final one; at the end it is synced, named and renamed over whatever was there before. What is not
 * a regular file is written directly, as a shell's redirection would be.
 *
 * A SIGKILL between naming and renaming leaves a dotted name behind. A file that has one is locked
 * (flock) by its writer, so that the next one who writes the same output can tell the dead writers'
 * from the living, and removes them. (A process number in the name would not tell: numbers are used
 * again.)
 *
 * Every system call that can fail asks fault_due() first.
 */
#include "base/file.h"

#include <ctype.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/bytes.h"
#include "base/checksum.h"
#include "base/descriptor.h"
#include "base/memory.h"

enum {
    OUTPUT_BUFFER = 256 << 10,
    NAME_TRIES = 10000,
};

static size_t at_most(size_t size, size_t limit)
{
    return size < limit ? size : limit;
}

/* ---- names ---- */

static enum status copy_text(struct context *ctx, const char *text, char **out)
{
    size_t size = strlen(text) + 1;
    enum status status = memory_take(ctx, size, 1, out);
    if (status == STATUS_OK)
        memcpy(*out, text, size);
    return status;
}

static void release_text(struct context *ctx, char **text)
{
    if (*text)
        memory_release(ctx, text, strlen(*text) + 1, 1);
}

/* Length of the directory part of `path` with its last slash; 0 when there is none. */
static size_t directory_length(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? (size_t)(slash - path) + 1 : 0;
}

/* The directory of `path` in a text that open(2) takes: "." when there is none. */
static enum status directory_of(struct context *ctx, const char *path, char **out)
{
    size_t length = directory_length(path);
    if (length == 0)
        return copy_text(ctx, ".", out);
    enum status status = memory_take(ctx, length + 1, 1, out);
    if (status == STATUS_OK) {
        memcpy(*out, path, length);
        (*out)[length] = '\0';
    }
    return status;
}

/* A dotted name in the directory of `path`, the `counter`th one to try. */
static enum status make_temp_name(struct context *ctx, const char *path, unsigned counter,
                                  char **out)
{
    size_t folder = directory_length(path);
    char tail[64];
    snprintf(tail, sizeof tail, ".spbm-%ld-%u~", (long)getpid(), counter);
    /* The name may have NAME_MAX bytes with its dot and tail. */
    size_t stem = at_most(strlen(path + folder), NAME_MAX - 1 - strlen(tail));
    size_t size = folder + 1 + stem + strlen(tail) + 1;

    char *name;
    enum status status = memory_take(ctx, size, 1, &name);
    if (status != STATUS_OK)
        return status;
    memcpy(name, path, folder);
    name[folder] = '.';
    memcpy(name + folder + 1, path + folder, stem);
    memcpy(name + folder + 1 + stem, tail, strlen(tail) + 1);
    *out = name;
    return STATUS_OK;
}

/*
 * Calls `make` with dotted names until one is free; the name stays in *name. `make` returns a
 * number >= 0, or -1 with errno.
 */
static enum status with_free_name(struct context *ctx, const char *path,
                                  int (*make)(struct context *ctx, const char *name, int argument),
                                  int argument, int *result, char **name)
{
    for (unsigned counter = 0;; counter++) {
        enum status status = make_temp_name(ctx, path, counter, name);
        if (status != STATUS_OK)
            return status;
        *result = make(ctx, *name, argument);
        if (*result >= 0)
            return STATUS_OK;
        int error = errno;
        release_text(ctx, name);
        if (error != EEXIST || counter == NAME_TRIES)
            return fail_errno(ctx, error, "%s: cannot create a file beside it", path);
    }
}

/* Where locks are not supported no one else can get one either, and nothing is ever removed. */
static void lock_by_writer(int fd)
{
    (void)!flock(fd, LOCK_EX | LOCK_NB);
}

static int create_exclusively(struct context *ctx, const char *name, int mode)
{
    struct stat info;
    int fd = descriptor_open(ctx, name, O_RDWR | O_CREAT | O_EXCL | O_NOFOLLOW, (mode_t)mode);
    if (fd < 0)
        return -1;
    lock_by_writer(fd);
    if (fstat(fd, &info) == 0 && info.st_nlink > 0)
        return fd;
    close(fd); /* taken for a dead writer's before it was locked: the next name */
    errno = EEXIST;
    return -1;
}

/* ---- what dead writers left ---- */

/* Is it a dotted name of the file `stem`, as make_temp_name makes them? */
static bool is_temp_name(const char *name, const char *stem)
{
    static const char mark[] = ".spbm-";
    size_t length = strlen(stem);
    if (name[0] != '.' || strncmp(name + 1, stem, length) != 0 ||
        strncmp(name + 1 + length, mark, sizeof mark - 1) != 0)
        return false;
    const char *at = name + 1 + length + sizeof mark - 1;
    unsigned numbers = 0;
    for (; numbers < 2; numbers++) {
        if (!isdigit((unsigned char)*at))
            return false;
        while (isdigit((unsigned char)*at))
            at++;
        if (*at++ != "-~"[numbers])
            return false;
    }
    return *at == '\0';
}

static void remove_if_dead(int folder, const char *name)
{
    struct stat info;
    int fd = openat(folder, name, O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0)
        return;
    if (fstat(fd, &info) == 0 && S_ISREG(info.st_mode) && info.st_uid == geteuid() &&
        flock(fd, LOCK_EX | LOCK_NB) == 0)
        (void)!unlinkat(folder, name, 0);
    close(fd);
}

/* Removes what dead writers of `path` left beside it. (A name that was cut to fit is not found.) */
static void sweep_dead(const char *folder, const char *path)
{
    DIR *list = opendir(folder);
    struct dirent *entry;
    while (list && (entry = readdir(list)))
        if (is_temp_name(entry->d_name, path + directory_length(path)))
            remove_if_dead(dirfd(list), entry->d_name);
    if (list)
        closedir(list);
}

/* The name under which /proc shows an open file, so that one without a name can get one. */
static void name_by_descriptor(char name[32], int fd)
{
    snprintf(name, 32, "/proc/self/fd/%d", fd);
}

static int link_descriptor(struct context *ctx, const char *name, int fd)
{
    if (fault_due(ctx)) {
        errno = EIO;
        return -1;
    }
    char self[32];
    name_by_descriptor(self, fd);
    return linkat(AT_FDCWD, self, AT_FDCWD, name, AT_SYMLINK_FOLLOW);
}

/*
 * A new file in `folder` without a name that can get one later, or -1: the file system can't, or
 * /proc is not there to give it one.
 */
static int create_nameless(const char *folder, mode_t mode)
{
    int fd = open(folder, O_TMPFILE | O_RDWR | O_CLOEXEC, mode);
    if (fd < 0)
        return -1;
    char self[32];
    name_by_descriptor(self, fd);
    if (access(self, F_OK) == 0) {
        lock_by_writer(fd);
        return fd;
    }
    close(fd);
    return -1;
}

/* ---- outputs ---- */

/* Names that stand for what is open already: they are written to, never replaced. */
static bool names_a_descriptor(const char *path)
{
    return strcmp(path, "-") == 0 || strcmp(path, "/dev/stdout") == 0 ||
           strcmp(path, "/dev/stderr") == 0 || strncmp(path, "/dev/fd/", 8) == 0 ||
           strncmp(path, "/proc/", 6) == 0;
}

static enum status open_directly(struct output *out, const char *path)
{
    struct context *ctx = out->ctx;
    bool is_stdout = strcmp(path, "-") == 0;
    enum status status = copy_text(ctx, is_stdout ? "standard output" : path, &out->path);
    if (status != STATUS_OK)
        return status;
    if (is_stdout)
        out->fd = fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, 3);
    else
        out->fd = descriptor_open(ctx, path, O_WRONLY, 0);
    if (out->fd < 0)
        return fail_errno(ctx, errno, "%s: cannot open for writing", out->path);
    return STATUS_OK;
}

/* `path` is that of a regular file, or of nothing yet. */
static enum status open_beside(struct output *out, const char *path, bool exists)
{
    struct context *ctx = out->ctx;
    out->is_regular = true;

    /* Replace the file that a link leads to, not the link. */
    char *resolved = exists ? realpath(path, NULL) : NULL;
    enum status status = copy_text(ctx, resolved ? resolved : path, &out->path);
    free(resolved);
    if (status != STATUS_OK)
        return status;
    if (exists && access(out->path, W_OK) != 0)
        return fail_errno(ctx, errno, "%s: cannot replace", path);

    char *folder = NULL;
    status = directory_of(ctx, out->path, &folder);
    if (status != STATUS_OK)
        return status;
    sweep_dead(folder, out->path);
    out->fd = fault_due(ctx) ? -1 : create_nameless(folder, 0666);
    release_text(ctx, &folder);
    if (out->fd >= 0)
        return STATUS_OK;
    return with_free_name(ctx, out->path, create_exclusively, 0666, &out->fd, &out->temp_path);
}

enum status output_open(struct context *ctx, const char *path, struct output *out)
{
    memset(out, 0, sizeof *out);
    out->ctx = ctx;
    out->fd = out->lock_fd = -1;
    out->is_open = true;

    if (path[0] == '\0') {
        out->is_open = false;
        return fail(ctx, STATUS_MISUSE, "the name of an output is empty");
    }
    enum status status = memory_take(ctx, OUTPUT_BUFFER, 1, &out->buffer);
    if (status != STATUS_OK)
        goto failed;

    struct stat info;
    bool exists = !names_a_descriptor(path) && stat(path, &info) == 0;
    if (exists && S_ISDIR(info.st_mode))
        status = fail(ctx, STATUS_IO, "%s: is a directory", path);
    else if (names_a_descriptor(path) || (exists && !S_ISREG(info.st_mode)))
        status = open_directly(out, path);
    else
        status = open_beside(out, path, exists);
    if (status == STATUS_OK)
        return STATUS_OK;
failed:
    output_discard(out);
    return status;
}

static enum status flush(struct output *out)
{
    size_t used = out->used;
    out->used = 0;
    return descriptor_write(out->ctx, out->fd, out->path, out->buffer, used);
}

enum status output_append(struct output *out, const void *data, size_t size)
{
    if (size == 0)
        return STATUS_OK;
    if (out->keeps_crc)
        out->crc = checksum(out->crc, data, size);
    out->position += size;

    size_t room = OUTPUT_BUFFER - out->used;
    if (size <= room) {
        memcpy(out->buffer + out->used, data, size);
        out->used += size;
        return STATUS_OK;
    }
    /* Fill up, write, and let what is larger than the buffer pass by it. */
    const unsigned char *from = data;
    if (out->used > 0) {
        memcpy(out->buffer + out->used, from, room);
        out->used += room;
        from += room;
        size -= room;
        enum status status = flush(out);
        if (status != STATUS_OK)
            return status;
    }
    if (size >= OUTPUT_BUFFER) {
        size_t direct = size - size % OUTPUT_BUFFER;
        enum status status = descriptor_write(out->ctx, out->fd, out->path, from, direct);
        if (status != STATUS_OK)
            return status;
        from += direct;
        size -= direct;
    }
    memcpy(out->buffer, from, size);
    out->used = size;
    return STATUS_OK;
}

enum status output_patch(struct output *out, uint64_t position, const void *data, size_t size)
{
    uint64_t end;
    if (!out->is_regular || add_overflows(position, size, &end) || end > out->position)
        return fail(out->ctx, STATUS_INTERNAL, "%s: bytes not yet written were to be changed",
                    out->path);
    enum status status = flush(out);
    if (status != STATUS_OK)
        return status;
    return descriptor_write_at(out->ctx, out->fd, out->path, position, data, size);
}

/* The refusal of a system call on `out`: the injected one, or what errno says. */
static enum status refuse(struct output *out, bool injected, const char *verb)
{
    return fail_errno(out->ctx, injected ? EIO : errno, "%s: cannot %s", out->path, verb);
}

/* What is written directly may be a file that others put something in before. */
bool output_can_restart(const struct output *out)
{
    struct stat info;
    const off_t written = (off_t)(out->position - out->used);
    return out->is_regular || (fstat(out->fd, &info) == 0 && S_ISREG(info.st_mode) &&
                               info.st_size == written && lseek(out->fd, 0, SEEK_CUR) == written);
}

enum status output_restart(struct output *out)
{
    out->used = 0;
    out->position = 0;
    out->crc = 0;
    bool injected = fault_due(out->ctx);
    if (injected || ftruncate(out->fd, 0) != 0 || lseek(out->fd, 0, SEEK_SET) != 0)
        return refuse(out, injected, "write again");
    return STATUS_OK;
}

/* Syncs and closes the file, and sees to it that it has a temporary name. */
static enum status settle(struct output *out, bool sync)
{
    struct context *ctx = out->ctx;
    bool injected = false;
    if (sync && ((injected = fault_due(ctx)) || fsync(out->fd) != 0))
        return refuse(out, injected, "sync");
    if (!out->temp_path) {
        int linked;
        enum status status =
            with_free_name(ctx, out->path, link_descriptor, out->fd, &linked, &out->temp_path);
        if (status != STATUS_OK)
            return status;
    }
    /* Some file systems tell of failed writes only now. The lock stays until the rename. */
    out->lock_fd = fcntl(out->fd, F_DUPFD_CLOEXEC, 3);
    injected = fault_due(ctx);
    int closed = close(out->fd);
    out->fd = -1;
    if (injected || (closed != 0 && errno != EINTR))
        return refuse(out, injected, "close");
    return STATUS_OK;
}

/* Puts the settled file under its name. The directory is opened before: nothing but the sync of the
 * directory can fail once the name stands. One that can't be opened or synced (some network file
 * systems) is no error. */
static enum status give_name(struct output *out, bool sync)
{
    struct context *ctx = out->ctx;
    char *folder = NULL;
    enum status status = directory_of(ctx, out->path, &folder);
    if (status != STATUS_OK)
        return status;
    int fd = sync ? descriptor_open(ctx, folder, O_RDONLY | O_DIRECTORY, 0) : -1;
    release_text(ctx, &folder);

    bool injected = fault_due(ctx);
    if (injected || rename(out->temp_path, out->path) != 0) {
        status = refuse(out, injected, "rename");
    } else {
        release_text(ctx, &out->temp_path);
        if (fd >= 0 && fsync(fd) != 0 && errno != EINVAL && errno != EROFS)
            status = refuse(out, false, "sync the directory");
    }
    if (fd >= 0)
        close(fd);
    return status;
}

enum status output_commit(struct output *out, bool sync)
{
    enum status status = flush(out);
    if (status == STATUS_OK && out->is_regular) {
        status = settle(out, sync);
        if (status == STATUS_OK)
            status = give_name(out, sync);
    } else if (status == STATUS_OK) {
        int closed = close(out->fd);
        out->fd = -1;
        if (closed != 0 && errno != EINTR)
            status = refuse(out, false, "close");
    }
    output_discard(out);
    return status;
}

void output_discard(struct output *out)
{
    if (!out->is_open)
        return;
    if (out->fd >= 0)
        close(out->fd);
    if (out->temp_path)
        unlink(out->temp_path);
    if (out->lock_fd >= 0)
        close(out->lock_fd);
    release_text(out->ctx, &out->temp_path);
    release_text(out->ctx, &out->path);
    memory_release(out->ctx, &out->buffer, OUTPUT_BUFFER, 1);
    out->fd = out->lock_fd = -1;
    out->used = 0;
    out->is_open = false;
}

static bool describe(const char *path, int standard, struct stat *info)
{
    return (strcmp(path, "-") == 0 ? fstat(standard, info) : stat(path, info)) == 0;
}

enum status paths_must_differ(struct context *ctx, const char *input, const char *output)
{
    struct stat from, to;
    if (!describe(input, STDIN_FILENO, &from) || !describe(output, STDOUT_FILENO, &to))
        return STATUS_OK;
    if (S_ISREG(from.st_mode) && from.st_dev == to.st_dev && from.st_ino == to.st_ino)
        return fail(ctx, STATUS_MISUSE, "%s and %s are the same file: input and output must differ",
                    input, output);
    return STATUS_OK;
}

/* ---- temporary files ---- */

/* A text that has the right directory in front: that of `beside`, or of a name in tmp_dir. */
static enum status choose_place(struct context *ctx, const char *beside, char **out)
{
    static const char tail[] = "/spool";
    if (!ctx->tmp_dir) {
        struct stat info;
        bool is_file = beside && !names_a_descriptor(beside) &&
                       (stat(beside, &info) != 0 || S_ISREG(info.st_mode));
        return copy_text(ctx, is_file ? beside : "/var/tmp/spool", out);
    }
    size_t length = strlen(ctx->tmp_dir);
    enum status status = memory_take(ctx, length + sizeof tail, 1, out);
    if (status == STATUS_OK) {
        memcpy(*out, ctx->tmp_dir, length);
        memcpy(*out + length, tail, sizeof tail);
    }
    return status;
}

enum status temp_open(struct context *ctx, const char *beside, int *fd)
{
    *fd = -1;
    char *place = NULL, *folder = NULL, *name = NULL;
    enum status status = choose_place(ctx, beside, &place);
    if (status == STATUS_OK)
        status = directory_of(ctx, place, &folder);
    if (status != STATUS_OK)
        goto done;

    if (fault_due(ctx)) {
        status = fail_errno(ctx, EACCES, "%s: cannot create a temporary file here", folder);
        goto done;
    }
    *fd = open(folder, O_TMPFILE | O_EXCL | O_RDWR | O_CLOEXEC, 0600);
    if (*fd < 0) {
        sweep_dead(folder, place);
        status = with_free_name(ctx, place, create_exclusively, 0600, fd, &name);
        if (status == STATUS_OK)
            unlink(name);
    }
done:
    release_text(ctx, &name);
    release_text(ctx, &folder);
    release_text(ctx, &place);
    return status;
}
