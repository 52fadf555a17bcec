/* Outputs that appear whole or not at all, spools on both sides of their limit, windows. */
#include "test_kit.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/checksum.h"
#include "base/file.h"
#include "base/memory.h"
#include "test_place.h"

static unsigned char *pattern(size_t size)
{
    unsigned char *data = malloc(size + 1);
    for (size_t i = 0; i < size; i++)
        data[i] = (unsigned char)(i * 131 + (i >> 9));
    return data;
}

static void assert_file_is(const char *path, const void *data, size_t size)
{
    size_t got;
    unsigned char *found = file_read(path, &got);
    assert_non_null(found);
    assert_int_equal(got, size);
    assert_memory_equal(found, data, size);
    free(found);
}

/* Pieces of all sizes round that of the buffer. */
static void written_bytes_arrive(void **state)
{
    struct place *place = *state;
    size_t size = 3000000;
    unsigned char *data = pattern(size);
    static const size_t pieces[] = {1, 1000, 262143, 262144, 262145, 800000};
    for (size_t p = 0; p < sizeof pieces / sizeof pieces[0]; p++) {
        struct output out;
        assert_int_equal(output_open(&place->ctx, place->path, &out), STATUS_OK);
        out.keeps_crc = true;
        size_t written = pieces[p] == 1 ? 5000 : size;
        for (size_t done = 0; done < written;) {
            size_t now = written - done < pieces[p] ? written - done : pieces[p];
            assert_int_equal(output_append(&out, data + done, now), STATUS_OK);
            done += now;
        }
        assert_int_equal(out.position, written);
        assert_int_equal(out.crc, checksum(0, data, written));
        assert_int_equal(output_commit(&out, p % 2), STATUS_OK);
        assert_file_is(place->path, data, written);
        assert_int_equal(folder_count(place->folder), 1);
    }
    free(data);
}

static void nothing_is_seen_before_commit(void **state)
{
    struct place *place = *state;
    file_write(place->path, "old", 3);
    struct output out;
    assert_int_equal(output_open(&place->ctx, place->path, &out), STATUS_OK);
    unsigned char *data = pattern(600000);
    assert_int_equal(output_append(&out, data, 600000), STATUS_OK);
    assert_file_is(place->path, "old", 3);
    output_discard(&out);
    assert_file_is(place->path, "old", 3);
    assert_int_equal(folder_count(place->folder), 1);
    output_discard(&out);

    struct output never;
    memset(&never, 0, sizeof never);
    output_discard(&never);
    free(data);
}

/* A process that is killed in the middle leaves nothing (where the file system has O_TMPFILE). */
static void a_killed_writer_leaves_nothing(void **state)
{
    struct place *place = *state;
    int fd = open(place->folder, O_TMPFILE | O_RDWR, 0600);
    if (fd < 0)
        skip();
    close(fd);
    pid_t child = fork();
    if (child == 0) {
        struct output out;
        char bytes[1000] = {0};
        if (output_open(&place->ctx, place->path, &out) == STATUS_OK)
            for (int i = 0; i < 1000; i++)
                if (output_append(&out, bytes, sizeof bytes) != STATUS_OK)
                    break;
        _exit(7); /* nothing of ours runs on this way out */
    }
    int how;
    assert_int_equal(waitpid(child, &how, 0), child);
    assert_int_equal(WEXITSTATUS(how), 7);
    assert_int_equal(folder_count(place->folder), 0);
}

/* A name that a killed writer left goes when the same output is written again; not one of a writer
 * that lives, nor of another output, nor what only looks like one. */
static void dead_writers_names_are_removed(void **state)
{
    static const char *const names[] = {".file.spbm-77-0~", ".file.spbm-78-12~",
                                        ".file.spbm-1-2-3~", ".other.spbm-77-0~",
                                        ".file.spbm-77-0"};
    struct place *place = *state;
    struct output out;
    char paths[5][TEST_PATH];
    for (unsigned i = 0; i < 5; i++) {
        folder_path(paths[i], place->folder, names[i]);
        file_write(paths[i], "half", 4);
    }
    int alive = open(paths[1], O_RDONLY | O_CLOEXEC);
    assert_int_equal(flock(alive, LOCK_EX | LOCK_NB), 0);
    assert_int_equal(output_open(&place->ctx, place->path, &out), STATUS_OK);
    assert_int_equal(output_append(&out, "whole", 5), STATUS_OK);
    assert_int_equal(output_commit(&out, true), STATUS_OK);
    assert_int_not_equal(access(paths[0], F_OK), 0);
    for (unsigned i = 1; i < 5; i++)
        assert_int_equal(access(paths[i], F_OK), 0);
    close(alive);
    assert_int_equal(output_open(&place->ctx, place->path, &out), STATUS_OK);
    output_discard(&out);
    assert_int_not_equal(access(paths[1], F_OK), 0);
    assert_file_is(place->path, "whole", 5);
}

static void the_mode_is_that_of_the_umask(void **state)
{
    struct place *place = *state;
    mode_t before = umask(027);
    struct output out;
    assert_int_equal(output_open(&place->ctx, place->path, &out), STATUS_OK);
    assert_int_equal(output_commit(&out, false), STATUS_OK);
    umask(before);
    struct stat info;
    assert_int_equal(stat(place->path, &info), 0);
    assert_int_equal(info.st_mode & 07777, 0640);
}

static void patches_change_what_was_written(void **state)
{
    struct place *place = *state;
    unsigned char *data = pattern(700000);
    struct output out;
    assert_int_equal(output_open(&place->ctx, place->path, &out), STATUS_OK);
    assert_int_equal(output_append(&out, data, 700000), STATUS_OK);
    for (size_t at = 0; at < 700000; at += 99999) {
        memset(data + at, 0xEE, 5);
        assert_int_equal(output_patch(&out, at, data + at, 5), STATUS_OK);
    }
    assert_int_equal(output_append(&out, "end", 3), STATUS_OK);
    assert_int_equal(output_commit(&out, false), STATUS_OK);
    data = realloc(data, 700003);
    memcpy(data + 700000, "end", 3);
    assert_file_is(place->path, data, 700003);
    assert_int_equal(output_open(&place->ctx, place->path, &out), STATUS_OK);
    assert_int_equal(output_patch(&out, 0, data, 1), STATUS_INTERNAL);
    output_discard(&out);
    free(data);
}

static void links_lead_to_what_is_replaced(void **state)
{
    struct place *place = *state;
    char link_path[TEST_PATH];
    folder_path(link_path, place->folder, "link");
    file_write(place->path, "old", 3);
    assert_int_equal(symlink("file", link_path), 0);
    struct output out;
    assert_int_equal(output_open(&place->ctx, link_path, &out), STATUS_OK);
    assert_int_equal(output_append(&out, "newer", 5), STATUS_OK);
    assert_int_equal(output_commit(&out, true), STATUS_OK);
    struct stat info;
    assert_int_equal(lstat(link_path, &info), 0);
    assert_true(S_ISLNK(info.st_mode));
    assert_file_is(place->path, "newer", 5);
}

static void long_names_have_temporary_ones_too(void **state)
{
    struct place *place = *state;
    char name[256], path[TEST_PATH];
    memset(name, 'n', 255);
    name[255] = '\0';
    struct output out;
    assert_int_equal(output_open(&place->ctx, folder_path(path, place->folder, name), &out),
                     STATUS_OK);
    assert_int_equal(output_commit(&out, false), STATUS_OK);
    assert_file_is(path, "", 0);
}

static void impossible_outputs_are_refused(void **state)
{
    struct place *place = *state;
    struct output out;
    char path[TEST_PATH];
    assert_int_equal(output_open(&place->ctx, place->folder, &out), STATUS_IO);
    assert_non_null(strstr(place->ctx.error, "is a directory"));
    output_discard(&out);
    folder_path(path, place->folder, "no/such/folder");
    assert_int_equal(output_open(&place->ctx, path, &out), STATUS_IO);
    assert_int_equal(output_open(&place->ctx, "", &out), STATUS_MISUSE);
    assert_int_equal(folder_count(place->folder), 0);
}

static void a_full_disk_is_an_error(void **state)
{
    struct place *place = *state;
    if (access("/dev/full", W_OK) != 0)
        skip();
    struct output out;
    assert_int_equal(output_open(&place->ctx, "/dev/full", &out), STATUS_OK);
    assert_false(out.is_regular);
    assert_int_equal(output_append(&out, "x", 1), STATUS_OK);
    assert_int_equal(output_commit(&out, true), STATUS_NO_SPACE);
    assert_string_equal(place->ctx.error, "/dev/full: cannot write: No space left on device");
    assert_int_equal(access("/dev/full", W_OK), 0);
}

static void a_pipe_is_written_directly(void **state)
{
    struct place *place = *state;
    assert_int_equal(mkfifo(place->path, 0600), 0);
    size_t size = 1000000;
    unsigned char *data = pattern(size);
    pid_t child = fork();
    if (child == 0) {
        int fd = open(place->path, O_RDONLY);
        size_t got = 0;
        uint32_t crc = 0;
        unsigned char buffer[4099];
        for (ssize_t now; (now = read(fd, buffer, sizeof buffer)) > 0; got += (size_t)now)
            crc = checksum(crc, buffer, (size_t)now);
        _exit(got == size && crc == checksum(0, data, size) ? 0 : 1);
    }
    struct output out;
    assert_int_equal(output_open(&place->ctx, place->path, &out), STATUS_OK);
    assert_int_equal(output_append(&out, data, size), STATUS_OK);
    assert_int_equal(output_patch(&out, 0, data, 1), STATUS_INTERNAL);
    assert_int_equal(output_commit(&out, true), STATUS_OK);
    int how;
    assert_int_equal(waitpid(child, &how, 0), child);
    assert_int_equal(how, 0);
    struct stat info;
    assert_int_equal(stat(place->path, &info), 0);
    assert_true(S_ISFIFO(info.st_mode));
    free(data);
}

static void same_files_are_noticed(void **state)
{
    struct place *place = *state;
    char other[TEST_PATH];
    folder_path(other, place->folder, "other");
    file_write(place->path, "x", 1);
    assert_int_equal(paths_must_differ(&place->ctx, place->path, other), STATUS_OK);
    assert_int_equal(link(place->path, other), 0);
    assert_int_equal(paths_must_differ(&place->ctx, place->path, other), STATUS_MISUSE);
    assert_int_equal(paths_must_differ(&place->ctx, "/dev/null", "/dev/null"), STATUS_OK);
}

/* ---- spools ---- */

static void spools_keep_their_bytes(void **state)
{
    struct place *place = *state;
    static const uint64_t limits[] = {0, 1000, 100000, 2600000, UINT64_MAX};
    static const size_t pieces[] = {700, 1 << 20, 2500000};
    size_t size = 2500000;
    unsigned char *data = pattern(size);
    for (size_t l = 0; l < 5; l++)
        for (size_t p = 0; p < 3; p++) {
            struct spool spool;
            spool_init(&place->ctx, &spool, place->path, limits[l]);
            for (size_t done = 0; done < size;) {
                size_t now = size - done < pieces[p] ? size - done : pieces[p];
                assert_int_equal(spool_append(&spool, data + done, now), STATUS_OK);
                done += now;
            }
            void *all;
            assert_int_equal(spool.fd >= 0, limits[l] < size);
            assert_int_equal(spool_seal(&spool, &all), STATUS_OK);
            assert_memory_equal(all, data, size);
            memset(all, 3, size);
            void *again;
            assert_int_equal(spool_seal(&spool, &again), STATUS_OK);
            assert_ptr_equal(all, again);
            assert_int_equal(spool_append(&spool, data, 1), STATUS_INTERNAL);
            if (limits[l] < size)
                assert_int_equal(place->ctx.memory_now, 0);
            spool_clear(&spool);
            spool_clear(&spool);
            assert_int_equal(folder_count(place->folder), 0);
        }
    free(data);
}

static void empty_spools_have_a_pointer(void **state)
{
    struct place *place = *state;
    for (uint64_t limit = 0; limit < 2; limit++) {
        struct spool spool;
        void *data = NULL;
        spool_init(&place->ctx, &spool, NULL, limit);
        assert_int_equal(spool_append(&spool, NULL, 0), STATUS_OK);
        assert_int_equal(spool_seal(&spool, &data), STATUS_OK);
        assert_non_null(data);
        spool_clear(&spool);
        assert_int_equal(spool_scratch(&place->ctx, &spool, NULL, limit, 0, &data), STATUS_OK);
        assert_non_null(data);
        spool_clear(&spool);
    }
}

static void scratch_is_zero(void **state)
{
    struct place *place = *state;
    place->ctx.tmp_dir = place->folder;
    for (int on_disk = 0; on_disk < 2; on_disk++) {
        struct spool spool;
        void *data;
        size_t size = 1234567;
        assert_int_equal(
            spool_scratch(&place->ctx, &spool, NULL, on_disk ? 100 : size, size, &data), STATUS_OK);
        assert_int_equal(spool.fd >= 0, on_disk);
        for (size_t i = 0; i < size; i++)
            if (((unsigned char *)data)[i] != 0)
                fail_msg("byte %zu is not zero", i);
        memset(data, 5, size);
        spool_clear(&spool);
        assert_int_equal(folder_count(place->folder), 0);
    }
    struct spool spool;
    void *data;
    assert_int_equal(spool_scratch(&place->ctx, &spool, NULL, 0, UINT64_MAX, &data),
                     STATUS_NO_SPACE);
    place->ctx.tmp_dir = "/no/such/folder";
    assert_int_equal(spool_scratch(&place->ctx, &spool, NULL, 0, 1, &data), STATUS_IO);
    assert_non_null(strstr(place->ctx.error, "would be too large"));
}

/* ---- windows ---- */

static void windows_show_any_part(void **state)
{
    struct place *place = *state;
    size_t size = 50001;
    unsigned char *data = pattern(size);
    file_write(place->path, data, size);
    struct input_file file;
    assert_int_equal(input_open(&place->ctx, place->path, &file), STATUS_OK);
    assert_int_equal(file.size, size);
    for (size_t offset = 0; offset <= size; offset += 977)
        for (size_t length = 0; length <= size - offset; length += 7919) {
            struct window window;
            assert_int_equal(window_open(&file, offset, length, &window), STATUS_OK);
            assert_non_null(window.data);
            assert_memory_equal(window.data, data + offset, length);
            window_close(&window);
            window_close(&window);
        }
    struct window window;
    assert_int_equal(window_open(&file, size - 5, 6, &window), STATUS_BAD_INPUT);
    assert_int_equal(window_open(&file, UINT64_MAX, 2, &window), STATUS_BAD_INPUT);
    unsigned char some[10];
    assert_int_equal(input_read(&file, size - 10, some, 10), STATUS_OK);
    assert_memory_equal(some, data + size - 10, 10);
    assert_int_equal(input_read(&file, size - 9, some, 10), STATUS_BAD_INPUT);

    /* Someone shortens the file: no window beyond its new end, no read beyond it. */
    assert_int_equal(truncate(place->path, 100), 0);
    assert_int_equal(window_open(&file, 50, 100, &window), STATUS_BAD_INPUT);
    assert_int_equal(input_read(&file, 95, some, 10), STATUS_BAD_INPUT);
    input_close(&file);
    input_close(&file);
    free(data);
}

static void what_is_no_file_is_refused(void **state)
{
    struct place *place = *state;
    struct input_file file;
    assert_int_equal(input_open(&place->ctx, place->folder, &file), STATUS_BAD_INPUT);
    assert_non_null(strstr(place->ctx.error, "is a directory"));
    assert_int_equal(input_open(&place->ctx, place->path, &file), STATUS_IO);
    input_close(&file);
    assert_int_equal(mkfifo(place->path, 0600), 0);
    assert_int_equal(input_open(&place->ctx, place->path, &file), STATUS_BAD_INPUT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        PLACE_TEST(written_bytes_arrive),
        PLACE_TEST(nothing_is_seen_before_commit),
        PLACE_TEST(a_killed_writer_leaves_nothing),
        PLACE_TEST(dead_writers_names_are_removed),
        PLACE_TEST(the_mode_is_that_of_the_umask),
        PLACE_TEST(patches_change_what_was_written),
        PLACE_TEST(links_lead_to_what_is_replaced),
        PLACE_TEST(long_names_have_temporary_ones_too),
        PLACE_TEST(impossible_outputs_are_refused),
        PLACE_TEST(a_full_disk_is_an_error),
        PLACE_TEST(a_pipe_is_written_directly),
        PLACE_TEST(same_files_are_noticed),
        PLACE_TEST(spools_keep_their_bytes),
        PLACE_TEST(empty_spools_have_a_pointer),
        PLACE_TEST(scratch_is_zero),
        PLACE_TEST(windows_show_any_part),
        PLACE_TEST(what_is_no_file_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
