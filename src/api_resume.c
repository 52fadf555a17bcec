/*
 * Runs that can be taken up again.
 *
 * The plain way, a folder with a fixed name and a file that says which process owns it, mistakes
 * another job's files for its own, and a dead owner for a living one when the number has been given
 * to another process. Here the name is a digest of all that the result depends on (the inputs'
 * paths, sizes and times, the options, the program's version, the output), the state file repeats
 * all of it and is compared as a whole, and the owner is who holds flock(2) on the folder, which
 * ends with its process however that ends.
 *
 * A stage's file appears under its name only when it is whole and synced (base/file.h), so to be
 * there is to be finished. What the state file says is not trusted: it is a section file with
 * checksums, it must repeat the job's key to the byte, and one that can't be read is the state of
 * no job.
 */
#include "api_resume.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "base/section_file.h"

static const char STATE_MAGIC[8] = {'s', 'p', 'b', 'm', 'J', 'O', 'B', '1'};
static const char STATE_NAME[] = "job.state", FOLDER_PREFIX[] = "spbm-run-";

enum {
    STATE_VERSION = 1,
    STATE_KEY = FOURCC('J', 'K', 'E', 'Y'),
    KEY_MAX = 16 << 20,
    DIGITS = 16, /* of the digest in the folder's name */
    LOCK_TRIES = 50,
    LOCK_PAUSE = 20000000 /* nanoseconds */
};

/* ---- the key: text, so that a person can read what a folder is for ---- */

struct key {
    struct context *ctx;
    char *text;
    size_t size, capacity;
    enum status status;
};

static void key_add(struct key *key, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void key_add(struct key *key, const char *format, ...)
{
    char piece[PATH_MAX + 256];
    va_list arguments;
    va_start(arguments, format);
    int length = vsnprintf(piece, sizeof piece, format, arguments);
    va_end(arguments);
    if (key->status == STATUS_OK && (length < 0 || (size_t)length >= sizeof piece))
        key->status = fail(key->ctx, STATUS_MISUSE, "a name is too long to be resumed");
    if (key->status == STATUS_OK)
        key->status =
            memory_reserve(key->ctx, &key->text, &key->capacity, key->size + (size_t)length, 1);
    if (key->status != STATUS_OK)
        return;
    memcpy(key->text + key->size, piece, (size_t)length);
    key->size += (size_t)length;
}

static void key_clear(struct key *key)
{
    memory_release(key->ctx, &key->text, key->capacity, 1);
    key->size = key->capacity = 0;
}

/* One line an input: all that tells whether it is still the same. */
static void add_input(struct key *key, const char *path)
{
    struct stat info;
    char *resolved = realpath(path, NULL);
    if (is_standard_stream(path))
        key->status = fail(key->ctx, STATUS_MISUSE,
                           "standard input is gone when a run is resumed: name a file");
    else if (!resolved || stat(resolved, &info) != 0)
        key->status = fail_errno(key->ctx, errno, "%s: cannot open", path);
    else if (!S_ISREG(info.st_mode))
        key->status = fail(key->ctx, STATUS_MISUSE,
                           "%s: is not a regular file, and cannot be read again when a run is "
                           "resumed",
                           path);
    else
        key_add(key, "input %llu %lld %ld %zu:%s\n", (unsigned long long)info.st_size,
                (long long)info.st_mtim.tv_sec, (long)info.st_mtim.tv_nsec, strlen(resolved),
                resolved);
    free(resolved);
}

static void add_inputs(struct key *key, const char *const *inputs, size_t count)
{
    for (size_t i = 0; i < count && key->status == STATUS_OK; i++)
        add_input(key, inputs[i]);
}

static void add_topology(struct key *key, const spbm_topology_options *topology)
{
    const spbm_length *lengths[] = {&topology->max_feature, &topology->drop_components,
                                    &topology->close_cracks};
    for (unsigned i = 0; i < 3; i++)
        key_add(key, "feature %a %d\n", lengths[i]->value, lengths[i]->is_relative != 0);
    key_add(key, "topology %d %a %a %d %d %d\n", (int)topology->size, topology->sharp_angle[0],
            topology->sharp_angle[1], topology->remove_pipes != 0, topology->crack_inscribed != 0,
            topology->merge_coplanar != 0);
}

static void add_options(struct key *key, const char *output, const spbm_simplify_options *options)
{
    const spbm_target *target = &options->target;
    const spbm_patch_options *patch = &options->patch;
    char folder[PATH_MAX];
    folder_of(output, folder);
    char *resolved = realpath(folder, NULL);
    const char *slash = strrchr(output, '/');
    key_add(key, "output %s/%s\n", resolved ? resolved : folder, slash ? slash + 1 : output);
    free(resolved);
    key_add(key, "weld %d\n", options->import.weld != 0);
    key_add(key, "target %d %u %d %d %u %a %d\n", (int)target->kind, target->count,
            target->error_is_relative != 0, (int)target->mode, target->effort, target->error_bound,
            target->bound_is_relative != 0);
    for (uint32_t i = 0; i < target->count && i < SPBM_TARGETS_MAX; i++)
        key_add(key, "value %a\n", target->values[i]);
    key_add(key, "patch %a %a %a %a %d %a %d\n", patch->patch_angle[0], patch->patch_angle[1],
            patch->face_angle[0], patch->face_angle[1], (int)patch->smoothings,
            patch->chain_tolerance, patch->tolerance_is_relative != 0);
    if (options->topology)
        add_topology(key, options->topology);
    key_add(key, "place %d\nformat %d\n", (int)options->lod.place, (int)options->lod.format);
}

static enum status make_key(struct context *ctx, const char *const *inputs, size_t input_count,
                            const char *output, const spbm_simplify_options *options,
                            struct key *key)
{
    *key = (struct key){.ctx = ctx};
    key_add(key, "spbm %s\n", SPBM_VERSION);
    add_inputs(key, inputs, input_count);
    add_options(key, output, options);
    return key->status;
}

/* FNV-1a. Equal digests of different keys are told apart by the state file. */
static uint64_t digest_of(const struct key *key)
{
    uint64_t digest = UINT64_C(0xcbf29ce484222325);
    for (size_t i = 0; i < key->size; i++)
        digest = (digest ^ (unsigned char)key->text[i]) * UINT64_C(0x100000001b3);
    return digest;
}

/* ---- the state file ---- */

static bool join_path(char *path, const char *folder, const char *name)
{
    size_t length = strlen(folder), size = strlen(name) + 1;
    if (length + 1 + size > PATH_MAX)
        return false;
    memcpy(path, folder, length);
    path[length] = '/';
    memcpy(path + length + 1, name, size);
    return true;
}

static enum status write_state(struct context *ctx, const char *folder, const struct key *key)
{
    char path[PATH_MAX];
    struct section_writer writer;
    if (!join_path(path, folder, STATE_NAME))
        return fail(ctx, STATUS_MISUSE, "%s: the name is too long", folder);
    enum status status = section_file_create(ctx, path, STATE_MAGIC, STATE_VERSION, &writer);
    if (status != STATUS_OK)
        return status;
    status = section_begin(&writer, STATE_KEY);
    if (status == STATUS_OK)
        status = section_append(&writer, key->text, key->size);
    if (status == STATUS_OK)
        status = section_end(&writer);
    if (status == STATUS_OK)
        return section_file_finish(&writer, true);
    section_file_discard(&writer);
    return status;
}

static enum status load_key(struct context *ctx, struct section_reader *reader, struct key *key)
{
    const struct section *section = section_find(reader, STATE_KEY);
    unsigned char *data;
    if (!section)
        return fail(ctx, STATUS_BAD_INPUT, "a job's state without its key");
    size_t size = (size_t)section->length;
    enum status status = section_load(reader, section, KEY_MAX, &data);
    if (status != STATUS_OK)
        return status;
    status = memory_reserve(ctx, &key->text, &key->capacity, size + 1, 1);
    if (status == STATUS_OK) {
        memcpy(key->text, data, size);
        key->text[size] = '\0';
        key->size = size;
    }
    memory_release(ctx, &data, size, 1);
    return status;
}

/* The key in a folder's state file. *found is false when there is none, or it is damaged: that is
 * no failure. */
static enum status read_state(struct context *ctx, const char *folder, struct key *key, bool *found)
{
    char path[PATH_MAX];
    struct section_reader reader;
    *key = (struct key){.ctx = ctx};
    *found = false;
    if (!join_path(path, folder, STATE_NAME) || access(path, F_OK) != 0)
        return STATUS_OK;
    enum status status =
        section_file_open(ctx, path, STATE_MAGIC, STATE_VERSION, "a job's state", &reader);
    if (status == STATUS_OK) {
        status = load_key(ctx, &reader, key);
        section_file_close(&reader);
    }
    *found = status == STATUS_OK;
    if (status != STATUS_BAD_INPUT)
        return status;
    failure_forget(ctx);
    return STATUS_OK;
}

/* Whether all inputs that a key names are as they were. */
static bool inputs_are_same(const struct key *key)
{
    static const char word[] = "\ninput ";
    const char *end = key->text + key->size;
    unsigned found = 0;
    for (const char *at = strstr(key->text, word); at; at = strstr(at, word)) {
        unsigned long long size;
        long long seconds;
        long nanoseconds;
        size_t length;
        int used = 0;
        char path[PATH_MAX];
        struct stat info;
        at += sizeof word - 1;
        if (sscanf(at, "%llu %lld %ld %zu:%n", &size, &seconds, &nanoseconds, &length, &used) !=
                4 ||
            used <= 0 || length >= sizeof path || length >= (size_t)(end - at) - (size_t)used)
            return false;
        memcpy(path, at + used, length);
        path[length] = '\0';
        if (stat(path, &info) != 0 || (unsigned long long)info.st_size != size ||
            (long long)info.st_mtim.tv_sec != seconds || info.st_mtim.tv_nsec != nanoseconds)
            return false;
        at += (size_t)used + length;
        found++;
    }
    return found > 0;
}

/* ---- folders ---- */

/* Only files of our own making are in it: it is 0700 and was checked to be ours. */
static void remove_files(int fd)
{
    int copy = openat(fd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *list = copy >= 0 ? fdopendir(copy) : NULL;
    struct dirent *entry;
    if (!list && copy >= 0)
        close(copy);
    while (list && (entry = readdir(list)))
        if (strcmp(entry->d_name, ".") != 0 && strcmp(entry->d_name, "..") != 0)
            (void)!unlinkat(fd, entry->d_name, 0);
    if (list)
        closedir(list);
}

/* Opens and locks a folder: its descriptor; -1 with errno: it is not there, is no folder of ours
 * (EPERM), or locked by another (EWOULDBLOCK). */
static int lock_folder(const char *path)
{
    struct stat held, named;
    int fd = open(path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (fd < 0)
        return -1;
    int error = 0;
    if (fstat(fd, &held) != 0 || held.st_uid != geteuid() || (held.st_mode & 077) != 0)
        error = EPERM;
    else if (flock(fd, LOCK_EX | LOCK_NB) != 0)
        error = errno;
    else if (lstat(path, &named) != 0 || named.st_dev != held.st_dev || named.st_ino != held.st_ino)
        error = ENOENT; /* removed by who held it before */
    if (!error)
        return fd;
    close(fd);
    errno = error;
    return -1;
}

static bool is_folder_name(const char *name)
{
    size_t prefix = sizeof FOLDER_PREFIX - 1;
    return strncmp(name, FOLDER_PREFIX, prefix) == 0 && strlen(name) == prefix + DIGITS &&
           strspn(name + prefix, "0123456789abcdef") == DIGITS;
}

/* Removes a folder if its run is dead and can't be resumed. */
static void sweep_folder(struct context *ctx, const char *path)
{
    int fd = lock_folder(path);
    struct key key;
    bool found;
    if (fd < 0)
        return;
    bool is_known = read_state(ctx, path, &key, &found) == STATUS_OK;
    bool is_useful = !is_known || (found && inputs_are_same(&key));
    key_clear(&key);
    if (!is_known)
        failure_forget(ctx); /* another time */
    if (!is_useful) {
        remove_files(fd);
        (void)!rmdir(path);
    }
    close(fd);
}

static void sweep(struct context *ctx, const char *dir, const char *except)
{
    DIR *list = opendir(dir);
    struct dirent *entry;
    char path[PATH_MAX];
    while (list && (entry = readdir(list)))
        if (is_folder_name(entry->d_name) && join_path(path, dir, entry->d_name) &&
            strcmp(path, except) != 0)
            sweep_folder(ctx, path);
    if (list)
        closedir(list);
}

/* A sweeper or a process that is just ending may hold the lock for a moment. */
static enum status make_and_lock(struct run_folder *folder)
{
    const struct timespec pause = {.tv_nsec = LOCK_PAUSE};
    struct context *ctx = folder->ctx;
    for (unsigned tries = 0;; tries++) {
        if (fault_due(ctx))
            return fail_errno(ctx, EACCES, "%s: cannot create the folder", folder->path);
        if (mkdir(folder->path, 0700) != 0 && errno != EEXIST)
            return fail_errno(ctx, errno, "%s: cannot create the folder", folder->path);
        folder->fd = lock_folder(folder->path);
        if (folder->fd >= 0)
            return STATUS_OK;
        if (errno == EWOULDBLOCK && tries >= LOCK_TRIES)
            return fail(ctx, STATUS_IO, "%s: another process runs the same job", folder->path);
        if (errno == EPERM)
            return fail(ctx, STATUS_IO, "%s: is not this user's own folder (its mode must be 0700)",
                        folder->path);
        if (errno != EWOULDBLOCK && errno != ENOENT)
            return fail_errno(ctx, errno, "%s: cannot be used", folder->path);
        enum status status = step(ctx, "waiting", 0, 0);
        if (status != STATUS_OK)
            return status;
        nanosleep(&pause, NULL);
    }
}

/* What a dead run left is taken over if it is of this very job. */
static enum status take_over(struct run_folder *folder, const struct key *key)
{
    struct key old;
    bool found;
    enum status status = read_state(folder->ctx, folder->path, &old, &found);
    folder->is_resumed =
        found && old.size == key->size && memcmp(old.text, key->text, key->size) == 0;
    key_clear(&old);
    if (status != STATUS_OK || folder->is_resumed)
        return status;
    remove_files(folder->fd);
    return write_state(folder->ctx, folder->path, key);
}

enum status run_folder_open(struct context *ctx, const char *dir, const char *const *inputs,
                            size_t input_count, const char *output,
                            const spbm_simplify_options *options, struct run_folder *folder)
{
    struct key key;
    char name[sizeof FOLDER_PREFIX + DIGITS];
    *folder = (struct run_folder){.ctx = ctx, .fd = -1};
    enum status status = make_key(ctx, inputs, input_count, output, options, &key);
    snprintf(name, sizeof name, "%s%016llx", FOLDER_PREFIX, (unsigned long long)digest_of(&key));
    if (status == STATUS_OK &&
        (!join_path(folder->path, dir, name) || strlen(folder->path) + 64 > sizeof folder->path))
        status = fail(ctx, STATUS_MISUSE, "%s: the name is too long", dir);
    if (status == STATUS_OK) {
        sweep(ctx, dir, folder->path);
        status = make_and_lock(folder);
    }
    if (status == STATUS_OK)
        status = take_over(folder, &key);
    key_clear(&key);
    if (status != STATUS_OK)
        run_folder_close(folder, folder->is_resumed);
    return status;
}

enum status run_folder_verify(struct run_folder *folder)
{
    struct key key;
    bool found;
    enum status status = read_state(folder->ctx, folder->path, &key, &found);
    if (status == STATUS_OK && !(found && inputs_are_same(&key)))
        status = fail(folder->ctx, STATUS_BAD_INPUT, "an input was changed while it was read");
    key_clear(&key);
    return status;
}

bool run_folder_file(const struct run_folder *folder, const char *name, char *path)
{
    struct stat info;
    (void)join_path(path, folder->path, name); /* fits: run_folder_open left room */
    return stat(path, &info) == 0 && S_ISREG(info.st_mode);
}

void run_folder_drop(struct run_folder *folder, const char *name)
{
    (void)!unlinkat(folder->fd, name, 0);
}

void run_folder_close(struct run_folder *folder, bool keep)
{
    if (folder->fd < 0)
        return;
    if (!keep) {
        remove_files(folder->fd);
        (void)!rmdir(folder->path);
    }
    close(folder->fd);
    folder->fd = -1;
}
