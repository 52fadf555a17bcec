/*
 * Every allocation and every guarded system call of the base, made to fail one after the other: the
 * failure is reported with words, nothing leaks, no file is left behind, and an existing output is
 * either the old or the new one.
 */
#include "test_kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/block_stream.h"
#include "base/external_sort.h"
#include "base/file.h"
#include "base/instream.h"
#include "base/memory.h"
#include "base/section_file.h"
#include "test_files.h"

struct place {
    char folder[TEST_PATH];
    char path[TEST_PATH];
    char input[TEST_PATH];
};

static int set_up(void **state)
{
    struct place *place = calloc(1, sizeof *place);
    folder_make(place->folder);
    folder_path(place->path, place->folder, "out");
    folder_path(place->input, place->folder, "in");
    *state = place;
    return 0;
}

static int tear_down(void **state)
{
    struct place *place = *state;
    folder_remove(place->folder);
    free(place);
    return 0;
}

/*
 * Runs `job` with the n-th guarded call failing, for n from 0 until it is not reached any more. The
 * job may succeed all the same where a way round the failure exists.
 */
static void fail_everywhere(struct place *place, int files,
                            enum status (*job)(struct context *ctx, struct place *place))
{
    int open_files = folder_count("/proc/self/fd");
    for (uint64_t after = 0;; after++) {
        struct context ctx;
        context_init(&ctx);
        ctx.fault_after = after;
        enum status status = job(&ctx, place);
        bool reached = ctx.fault_after == UINT64_MAX;
        if (!reached)
            assert_int_equal(status, STATUS_OK);
        if (status != STATUS_OK) {
            assert_int_equal(ctx.failed, status);
            assert_true(strlen(ctx.error) > 10);
            assert_true(status == STATUS_NO_MEMORY || status == STATUS_NO_SPACE ||
                        status == STATUS_IO);
        }
        assert_int_equal(ctx.memory_now, 0);
        assert_int_equal(folder_count(place->folder), files);
        assert_int_equal(folder_count("/proc/self/fd"), open_files);
        context_clear(&ctx);
        if (!reached) {
            assert_true(after >= 2);
            return;
        }
        assert_true(after < 100000);
    }
}

static enum status write_output(struct context *ctx, struct place *place)
{
    file_write(place->path, "old", 3);
    struct output out;
    enum status status = output_open(ctx, place->path, &out);
    if (status != STATUS_OK)
        return status;
    static char bytes[600000];
    memset(bytes, 'n', sizeof bytes);
    status = output_append(&out, bytes, 100000);
    if (status == STATUS_OK)
        status = output_append(&out, bytes, 500000);
    if (status == STATUS_OK)
        status = output_patch(&out, 5, "n", 1);
    if (status != STATUS_OK)
        output_discard(&out);
    else
        status = output_commit(&out, true);

    size_t size;
    unsigned char *found = file_read(place->path, &size);
    assert_non_null(found);
    assert_int_equal(size, status == STATUS_OK ? 600000 : 3);
    free(found);
    return status;
}

static void outputs(void **state)
{
    fail_everywhere(*state, 1, write_output);
}

static enum status use_spools(struct context *ctx, struct place *place)
{
    char bytes[3000] = {0};
    struct spool spool, scratch = {0};
    spool_init(ctx, &spool, place->path, 10000);
    enum status status = STATUS_OK;
    for (int i = 0; i < 1000 && status == STATUS_OK; i++)
        status = spool_append(&spool, bytes, sizeof bytes);
    void *data;
    if (status == STATUS_OK)
        status = spool_seal(&spool, &data);
    if (status == STATUS_OK)
        status = spool_scratch(ctx, &scratch, place->path, 1000, 50000, &data);
    spool_clear(&scratch);
    if (status == STATUS_OK)
        status = spool_scratch(ctx, &scratch, place->path, 100000, 50000, &data);
    spool_clear(&scratch);
    spool_clear(&spool);
    return status;
}

static void spools(void **state)
{
    fail_everywhere(*state, 0, use_spools);
}

static enum status use_sections(struct context *ctx, struct place *place)
{
    struct section_writer writer;
    enum status status = section_file_create(ctx, place->path, "MAGICxyz", 1, &writer);
    if (status != STATUS_OK)
        goto done;
    status = section_begin(&writer, 7);
    if (status == STATUS_OK)
        status = section_append(&writer, "hello", 5);
    if (status == STATUS_OK)
        status = section_end(&writer);
    if (status == STATUS_OK)
        status = section_file_finish(&writer, true);
    else
        section_file_discard(&writer);
    if (status != STATUS_OK)
        goto done;

    struct section_reader reader;
    status = section_file_open(ctx, place->path, "MAGICxyz", 1, "a test", &reader);
    if (status != STATUS_OK)
        goto done;
    unsigned char *data;
    struct window window = {0};
    status = section_verify(&reader, &reader.table[0]);
    if (status == STATUS_OK)
        status = window_open(&reader.file, 64, 5, &window);
    window_close(&window);
    if (status == STATUS_OK)
        status = section_load(&reader, &reader.table[0], 100, &data);
    if (status == STATUS_OK)
        memory_release(ctx, &data, 5, 1);
    section_file_close(&reader);
done:
    remove(place->path);
    return status;
}

static void sections(void **state)
{
    fail_everywhere(*state, 0, use_sections);
}

static enum status read_input(struct context *ctx, struct place *place)
{
    struct instream *stream;
    enum status status = instream_open(ctx, place->input, &stream);
    const unsigned char *data;
    size_t available = 1;
    while (status == STATUS_OK && available > 0) {
        status = instream_peek(stream, 1500000, &data, &available);
        if (status == STATUS_OK)
            instream_take(stream, available);
    }
    instream_close(&stream);
    return status;
}

static void plain_streams(void **state)
{
    struct place *place = *state;
    size_t size = 4000000;
    char *bytes = calloc(size, 1);
    file_write(place->input, bytes, size);
    free(bytes);
    fail_everywhere(place, 1, read_input);
}

static void gzip_streams(void **state)
{
    struct place *place = *state;
    char command[3 * TEST_PATH];
    snprintf(command, sizeof command, "head -c 2000000 /dev/zero | gzip > %s", place->input);
    assert_int_equal(system(command), 0);
    fail_everywhere(place, 1, read_input);
}

static enum status use_sorter(struct context *ctx, struct place *place)
{
    struct sorter *sorter;
    enum status status = sorter_open(ctx, 16, 8, 2000, place->path, &sorter);
    for (uint64_t i = 0; i < 800 && status == STATUS_OK; i++) {
        uint64_t record[2] = {i * 7919 % 1000, i};
        status = sorter_add(sorter, record, 1);
    }
    if (status == STATUS_OK)
        status = sorter_finish(sorter);
    const void *records;
    size_t count = 1, seen = 0;
    while (status == STATUS_OK && count > 0) {
        status = sorter_next(sorter, &records, &count);
        seen += count;
    }
    if (status == STATUS_OK)
        assert_int_equal(seen, 800);
    sorter_close(&sorter);
    return status;
}

static void sorters(void **state)
{
    fail_everywhere(*state, 0, use_sorter);
}

static enum status use_blocks(struct context *ctx, struct place *place)
{
    (void)place;
    char raw[5000] = {0};
    unsigned char *block = NULL, *back;
    size_t size = 0, back_size, taken;
    enum status status = block_pack(ctx, raw, sizeof raw, 6, &block, &size);
    if (status == STATUS_OK)
        status = block_unpack(ctx, "a block", block, size, &back, &back_size, &taken);
    if (status == STATUS_OK)
        memory_release(ctx, &back, back_size, 1);
    memory_release(ctx, &block, size, 1);
    return status;
}

static void blocks(void **state)
{
    fail_everywhere(*state, 0, use_blocks);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(outputs),      TEST(spools),  TEST(sections), TEST(plain_streams),
        TEST(gzip_streams), TEST(sorters), TEST(blocks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
