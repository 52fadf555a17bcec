/* Section files: what goes in comes out; every flipped bit, every cut and every lie in the table is
 * found, with right CRCs too. */
#include "test_kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <fcntl.h>
#include <unistd.h>

#include "base/bytes.h"
#include "base/checksum.h"
#include "base/memory.h"
#include "base/section_file.h"
#include "test_place.h"

static const char magic[8] = "TESTFILE";
enum { KIND_A = FOURCC('a', 'a', 'a', 'a'), KIND_B = FOURCC('b', '2', ' ', 'x'), KIND_C = 77 };

/* Three sections: 100 bytes, none, 64 bytes. */
static void write_small(struct context *ctx, const char *path)
{
    struct section_writer writer;
    unsigned char data[100];
    for (size_t i = 0; i < sizeof data; i++)
        data[i] = (unsigned char)(i * 3 + 1);
    assert_int_equal(section_file_create(ctx, path, magic, 3, &writer), STATUS_OK);
    assert_int_equal(section_begin(&writer, KIND_A), STATUS_OK);
    assert_int_equal(section_append(&writer, data, 60), STATUS_OK);
    assert_int_equal(section_append(&writer, data + 60, 40), STATUS_OK);
    assert_int_equal(section_end(&writer), STATUS_OK);
    assert_int_equal(section_begin(&writer, KIND_B), STATUS_OK);
    assert_int_equal(section_end(&writer), STATUS_OK);
    assert_int_equal(section_begin(&writer, KIND_C), STATUS_OK);
    assert_int_equal(section_append(&writer, data, 64), STATUS_OK);
    assert_int_equal(section_end(&writer), STATUS_OK);
    assert_int_equal(section_file_finish(&writer, false), STATUS_OK);
}

/* Opens and verifies everything; the words of a failure are in `error` when it is not NULL. */
static enum status check(const char *path, char *error)
{
    struct context ctx;
    context_init(&ctx);
    struct section_reader reader;
    enum status status = section_file_open(&ctx, path, magic, 3, "a test file", &reader);
    for (unsigned i = 0; i < reader.count && status == STATUS_OK; i++)
        status = section_verify(&reader, &reader.table[i]);
    if (status == STATUS_OK)
        status = section_check_padding(&reader);
    section_file_close(&reader);
    if (error)
        strcpy(error, ctx.error);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return status;
}

static void what_goes_in_comes_out(void **state)
{
    struct place *place = *state;
    write_small(&place->ctx, place->path);
    struct section_reader reader;
    assert_int_equal(section_file_open(&place->ctx, place->path, magic, 3, "a test", &reader),
                     STATUS_OK);
    assert_int_equal(reader.count, 3);
    assert_int_equal(reader.version, 3);
    assert_null(section_find(&reader, 5));
    static const uint32_t kinds[3] = {KIND_A, KIND_B, KIND_C};
    static const size_t lengths[3] = {100, 0, 64};
    for (int k = 0; k < 3; k++) {
        const struct section *section = section_find(&reader, kinds[k]);
        assert_non_null(section);
        assert_int_equal(section->length, lengths[k]);
        assert_int_equal(section->offset % SECTION_ALIGN, 0);
        assert_int_equal(section_verify(&reader, section), STATUS_OK);
        unsigned char *data;
        assert_int_equal(section_load(&reader, section, 100, &data), STATUS_OK);
        for (size_t i = 0; i < lengths[k]; i++)
            assert_int_equal(data[i], (unsigned char)(i * 3 + 1));
        memory_release(&place->ctx, &data, lengths[k], 1);
    }
    unsigned char *data;
    assert_int_equal(section_load(&reader, &reader.table[0], 99, &data), STATUS_BAD_INPUT);
    assert_null(data);
    section_file_close(&reader);
}

static void every_flipped_bit_is_found(void **state)
{
    struct place *place = *state;
    write_small(&place->ctx, place->path);
    assert_int_equal(check(place->path, NULL), STATUS_OK);
    size_t size;
    unsigned char *bytes = file_read(place->path, &size);
    assert_int_equal(size, 64 + 128 + 64 + 3 * 24 + 32);
    for (size_t bit = 0; bit < 8 * size; bit++) {
        bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
        file_write(place->path, bytes, size);
        if (check(place->path, NULL) != STATUS_BAD_INPUT)
            fail_msg("bit %zu of byte %zu can flip unseen", bit % 8, bit / 8);
        bytes[bit / 8] ^= (unsigned char)(1 << bit % 8);
    }
    free(bytes);
}

static void every_cut_is_found(void **state)
{
    struct place *place = *state;
    write_small(&place->ctx, place->path);
    size_t size;
    unsigned char *bytes = file_read(place->path, &size);
    for (size_t cut = 0; cut < size; cut++) {
        file_write(place->path, bytes, cut);
        char error[1024];
        assert_int_equal(check(place->path, error), STATUS_BAD_INPUT);
        assert_non_null(strstr(error, place->path));
    }
    bytes = realloc(bytes, size + 1);
    bytes[size] = 0;
    file_write(place->path, bytes, size + 1);
    assert_int_equal(check(place->path, NULL), STATUS_BAD_INPUT);
    free(bytes);
}

/* ---- lies with right CRCs ---- */

enum { TABLE = 256, MARKER = TABLE + 3 * 24 };

/* Makes the frame's CRC right again. */
static void sign(unsigned char *bytes, size_t size, size_t table, size_t count)
{
    unsigned char *marker = bytes + size - 32;
    store_u32(marker + 12, 0);
    uint32_t crc = checksum(0, bytes, 32);
    crc = checksum(crc, bytes + table, 24 * count);
    store_u32(marker + 12, checksum(crc, marker, 32));
}

static void expect_lie_found(struct place *place, unsigned char *bytes, size_t size,
                             const char *words)
{
    char error[1024];
    sign(bytes, size, TABLE, 3);
    file_write(place->path, bytes, size);
    assert_int_equal(check(place->path, error), STATUS_BAD_INPUT);
    if (!strstr(error, words))
        fail_msg("'%s' does not say '%s'", error, words);
}

static void lies_are_found(void **state)
{
    struct place *place = *state;
    write_small(&place->ctx, place->path);
    size_t size;
    unsigned char *good = file_read(place->path, &size);
    unsigned char *bytes = malloc(size);
    struct {
        size_t at;
        unsigned width;
        uint64_t value;
        const char *words;
    } lies[] = {
        {8, 4, 4, "version 4"},
        {12, 4, 1, "should be 0"},
        {31, 1, 1, "should be 0"},
        {TABLE, 4, 0, "none"},
        {TABLE + 24, 4, KIND_A, "there already"},
        {TABLE + 8, 8, 0, "begins at"},
        {TABLE + 8, 8, 65, "begins at"},
        {TABLE + 8, 8, 128, "begins at"},
        {TABLE + 16, 8, 101, "is damaged"},
        {TABLE + 16, 8, 64, "section 'b2.x' begins at"},
        {TABLE + 16, 8, UINT64_MAX - 60, "reaches beyond"},
        {TABLE + 16, 8, 200, "reaches beyond"},
        {TABLE + 24 + 16, 8, 1, "begins at"},
        {TABLE + 48 + 8, 8, 64, "begins at"},
        {TABLE + 48 + 8, 8, UINT64_MAX - 63, "begins at"},
        {TABLE + 48 + 16, 8, 65, "reaches beyond"},
        {TABLE + 48 + 16, 8, 0, "section table is at"},
        {MARKER, 8, 0, "end marker"},
        {MARKER, 8, UINT64_MAX, "end marker"},
        {MARKER + 8, 4, 2, "end marker"},
        {MARKER + 8, 4, UINT32_MAX, "end marker"},
        {MARKER + 16, 8, 10, "end marker says 10"},
    };
    for (size_t i = 0; i < sizeof lies / sizeof lies[0]; i++) {
        memcpy(bytes, good, size);
        for (unsigned k = 0; k < lies[i].width; k++)
            bytes[lies[i].at + k] = (unsigned char)(lies[i].value >> 8 * k);
        expect_lie_found(place, bytes, size, lies[i].words);
    }
    memcpy(bytes, good, size);
    bytes[0] ^= 1;
    expect_lie_found(place, bytes, size, "is not a test file");
    memcpy(bytes, good, size);
    bytes[64 + 100 + 27] = 1;
    expect_lie_found(place, bytes, size, "is padding");
    free(bytes);
    free(good);
}

static void an_empty_file_of_sections_is_valid(void **state)
{
    struct place *place = *state;
    struct section_writer writer;
    assert_int_equal(section_file_create(&place->ctx, place->path, magic, 3, &writer), STATUS_OK);
    assert_int_equal(section_file_finish(&writer, false), STATUS_OK);
    assert_int_equal(check(place->path, NULL), STATUS_OK);
}

static void as_many_sections_as_there_may_be(void **state)
{
    struct place *place = *state;
    struct section_writer writer;
    assert_int_equal(section_file_create(&place->ctx, place->path, magic, 3, &writer), STATUS_OK);
    for (uint32_t i = 0; i < SECTION_MAX; i++) {
        assert_int_equal(section_begin(&writer, i + 1), STATUS_OK);
        assert_int_equal(section_append(&writer, &i, i % 5 == 0 ? 0 : 4), STATUS_OK);
        assert_int_equal(section_end(&writer), STATUS_OK);
    }
    assert_int_equal(section_begin(&writer, 1000), STATUS_INTERNAL);
    assert_int_equal(section_file_finish(&writer, false), STATUS_OK);
    assert_int_equal(check(place->path, NULL), STATUS_OK);
}

static void turns_are_kept(void **state)
{
    struct place *place = *state;
    struct section_writer writer;
    assert_int_equal(section_file_create(&place->ctx, place->path, magic, 3, &writer), STATUS_OK);
    assert_int_equal(section_append(&writer, "x", 1), STATUS_INTERNAL);
    assert_int_equal(section_end(&writer), STATUS_INTERNAL);
    assert_int_equal(section_begin(&writer, 0), STATUS_INTERNAL);
    assert_int_equal(section_begin(&writer, 1), STATUS_OK);
    assert_int_equal(section_begin(&writer, 2), STATUS_INTERNAL);
    assert_int_equal(section_end(&writer), STATUS_OK);
    assert_int_equal(section_begin(&writer, 1), STATUS_INTERNAL);
    assert_int_equal(section_begin(&writer, 2), STATUS_OK);
    assert_int_equal(section_file_finish(&writer, false), STATUS_INTERNAL);
    section_file_discard(&writer);
    assert_int_equal(folder_count(place->folder), 0);
}

/* Through a pipe the same bytes come as into a file. */
static void a_pipe_gets_the_same_bytes(void **state)
{
    struct place *place = *state;
    char pipe_path[TEST_PATH], copy_path[TEST_PATH];
    folder_path(pipe_path, place->folder, "pipe");
    folder_path(copy_path, place->folder, "copy");
    assert_int_equal(mkfifo(pipe_path, 0600), 0);
    pid_t child = fork();
    if (child == 0) {
        unsigned char buffer[4096];
        size_t used = 0;
        int fd = open(pipe_path, O_RDONLY);
        for (ssize_t got; (got = read(fd, buffer + used, sizeof buffer - used)) > 0;)
            used += (size_t)got;
        file_write(copy_path, buffer, used);
        _exit(0);
    }
    write_small(&place->ctx, pipe_path);
    int how;
    assert_int_equal(waitpid(child, &how, 0), child);
    write_small(&place->ctx, place->path);
    size_t size, copy_size;
    unsigned char *bytes = file_read(place->path, &size);
    unsigned char *copy = file_read(copy_path, &copy_size);
    assert_non_null(copy);
    assert_int_equal(size, copy_size);
    assert_memory_equal(bytes, copy, size);
    free(bytes);
    free(copy);
}

static void large_sections_are_verified_in_pieces(void **state)
{
    struct place *place = *state;
    struct section_writer writer;
    size_t size = 2500001;
    unsigned char *data = malloc(size);
    memset(data, 9, size);
    assert_int_equal(section_file_create(&place->ctx, place->path, magic, 3, &writer), STATUS_OK);
    assert_int_equal(section_begin(&writer, KIND_A), STATUS_OK);
    assert_int_equal(section_append(&writer, data, size), STATUS_OK);
    assert_int_equal(section_end(&writer), STATUS_OK);
    assert_int_equal(section_file_finish(&writer, true), STATUS_OK);
    assert_int_equal(check(place->path, NULL), STATUS_OK);
    FILE *file = fopen(place->path, "r+b");
    assert_int_equal(fseek(file, 64 + 2500000, SEEK_SET), 0);
    assert_int_equal(fputc(8, file), 8);
    assert_int_equal(fclose(file), 0);
    char error[1024];
    assert_int_equal(check(place->path, error), STATUS_BAD_INPUT);
    assert_non_null(strstr(error, "section 'aaaa' (2500001 bytes at 64) is damaged"));
    free(data);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        PLACE_TEST(what_goes_in_comes_out),
        PLACE_TEST(every_flipped_bit_is_found),
        PLACE_TEST(every_cut_is_found),
        PLACE_TEST(lies_are_found),
        PLACE_TEST(an_empty_file_of_sections_is_valid),
        PLACE_TEST(as_many_sections_as_there_may_be),
        PLACE_TEST(turns_are_kept),
        PLACE_TEST(a_pipe_gets_the_same_bytes),
        PLACE_TEST(large_sections_are_verified_in_pieces),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
