/* The same bytes whatever carries them: file, pipe one byte at a time, gzip of one or many members;
 * and words for every kind of damage. */
#include "test_kit.h"

#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/checksum.h"
#include "base/instream.h"
#include "base/memory.h"
#include "test_gzip.h"
#include "test_place.h"

/* Text that gzip makes about a third of. */
static unsigned char *pattern(size_t size)
{
    unsigned char *data = malloc(size + 1);
    uint32_t seed = 7;
    for (size_t i = 0; i < size; i++) {
        seed = seed * 1664525 + 1013904223;
        data[i] = (unsigned char)"0123456789 .-\nev"[seed >> 28];
    }
    return data;
}

/* Reads all of a stream, taking `take` bytes at a time after peeking at `peek`. */
static void read_all(struct instream *stream, const unsigned char *data, size_t size, size_t peek,
                     size_t take)
{
    size_t seen = 0;
    for (;;) {
        const unsigned char *visible;
        size_t available;
        assert_int_equal(instream_peek(stream, peek, &visible, &available), STATUS_OK);
        assert_true(available <= size - seen);
        if (available < peek)
            assert_int_equal(available, size - seen);
        if (memcmp(visible, data + seen, available) != 0)
            fail_msg("wrong bytes after %zu", seen);
        assert_int_equal(instream_position(stream), seen);
        if (available == 0)
            break;
        size_t now = take < available ? take : available;
        instream_take(stream, now);
        seen += now;
    }
    assert_int_equal(seen, size);
}

static void expect_bytes(struct place *place, const char *path, const unsigned char *data,
                         size_t size)
{
    static const size_t ways[][2] = {{1, SIZE_MAX}, {1, 100003}, {2000000, 70000},
                                     {100, 99},     {5, 300000}, {1100000, 1050000}};
    for (size_t w = 0; w < sizeof ways / sizeof ways[0]; w++) {
        struct instream *stream;
        if (ways[w][1] < 1000 && size > 1000000)
            continue;
        place->ctx.threads = 1 + w % 2; /* gzip: inflated by the way, or ahead, or at once */
        assert_int_equal(instream_open(&place->ctx, path, &stream), STATUS_OK);
        read_all(stream, data, size, ways[w][0], ways[w][1]);
        size_t raw_size;
        unsigned char *raw = file_read(path, &raw_size);
        assert_int_equal(instream_raw_size(stream), raw_size);
        assert_int_equal(instream_digest(stream), checksum(0, raw, raw_size));
        assert_string_equal(instream_name(stream), path);
        free(raw);
        instream_close(&stream);
        assert_null(stream);
        assert_int_equal(place->ctx.memory_now, 0);
    }
}

static void plain_files_arrive(void **state)
{
    struct place *place = *state;
    static const size_t sizes[] = {0, 1, 2, 1000, 1 << 20, (1 << 20) + 65536, 3500000};
    for (size_t s = 0; s < sizeof sizes / sizeof sizes[0]; s++) {
        unsigned char *data = pattern(sizes[s]);
        file_write(place->path, data, sizes[s]);
        expect_bytes(place, place->path, data, sizes[s]);
        free(data);
    }
}

static void gzip_members_are_joined(void **state)
{
    struct place *place = *state;
    size_t size = 3000000, room = 4000000;
    unsigned char *data = pattern(size);
    unsigned char *packed = malloc(room);
    /* Cuts: none; an empty member in the middle; many small ones at the start. */
    static const size_t cuts[][4] = {
        {3000000, 0, 0, 0}, {1000000, 0, 2000000, 0}, {1, 2, 3, 2999994}};
    for (size_t c = 0; c < 3; c++) {
        size_t used = 0, taken = 0;
        for (int m = 0; m < 4; m++) {
            used += gzip_pack(data + taken, cuts[c][m], 6, packed + used, room - used);
            taken += cuts[c][m];
        }
        assert_int_equal(taken, size);
        file_write(place->path, packed, used);
        expect_bytes(place, place->path, data, size);

        /* Zeros behind are padding; other bytes get a warning. Both are read to the end. */
        memset(packed + used, 0, 1000);
        file_write(place->path, packed, used + 1000);
        place->warnings = 0;
        expect_bytes(place, place->path, data, size);
        assert_int_equal(place->warnings, 0);
        packed[used + 999] = 0x1f;
        file_write(place->path, packed, used + 1000);
        expect_bytes(place, place->path, data, size);
        assert_true(place->warnings > 0);
        place->warnings = 0;
        packed[used] = 0x1f; /* the first byte of a member that never was */
        file_write(place->path, packed, used + 1);
        expect_bytes(place, place->path, data, size);
        assert_true(place->warnings > 0);
    }
    free(packed);
    free(data);
}

/* Reads to the end or the first failure. */
static enum status drain(struct context *ctx, const char *path)
{
    struct instream *stream;
    enum status status = instream_open(ctx, path, &stream);
    const unsigned char *data;
    size_t available = 1;
    while (status == STATUS_OK && available > 0) {
        status = instream_peek(stream, 1, &data, &available);
        if (status == STATUS_OK)
            instream_take(stream, available);
    }
    instream_close(&stream);
    return status;
}

/* ---- headers ---- */

enum { HEADER_CRC = 2, EXTRA = 4, NAME = 8, COMMENT = 16 };

/* A member whose header has the fields of `flags`; its size. *header: of that. */
static size_t pack_with_fields(unsigned flags, const unsigned char *data, size_t size,
                               unsigned char *to, size_t *header)
{
    static const unsigned char fixed[] = {0x1f, 0x8b, 8, 0, 1, 2, 3, 4, 0, 3};
    unsigned char member[2000];
    size_t used = sizeof fixed, packed = gzip_pack(data, size, 6, member, sizeof member);
    memcpy(to, fixed, used);
    to[3] = (unsigned char)flags;
    if (flags & EXTRA) {
        const size_t extra = flags & NAME ? 300 : 0;
        to[used++] = (unsigned char)(extra & 255);
        to[used++] = (unsigned char)(extra >> 8);
        memset(to + used, flags & COMMENT ? 0 : 7, extra);
        used += extra;
    }
    if (flags & NAME)
        used += strlen(strcpy((char *)to + used, "a name")) + 1;
    if (flags & COMMENT)
        used += strlen(strcpy((char *)to + used, flags & NAME ? "" : "words\n")) + 1;
    if (flags & HEADER_CRC) {
        const uint32_t crc = checksum(0, to, used);
        to[used++] = (unsigned char)(crc & 255);
        to[used++] = (unsigned char)(crc >> 8 & 255);
    }
    *header = used;
    memcpy(to + used, member + sizeof fixed, packed - sizeof fixed);
    return used + packed - sizeof fixed;
}

static void expect_refusal(struct place *place, const unsigned char *bytes, size_t size,
                           unsigned threads, const char *words)
{
    struct context ctx;
    context_init(&ctx);
    ctx.threads = threads;
    file_write(place->path, bytes, size);
    assert_int_equal(drain(&ctx, place->path), STATUS_BAD_INPUT);
    if (!strstr(ctx.error, words) || !strstr(ctx.error, place->path))
        fail_msg("\"%s\" is not among: %s", words, ctx.error);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static void headers_may_have_every_field(void **state)
{
    struct place *place = *state;
    unsigned char *data = pattern(500), member[4000];
    for (unsigned flags = 0; flags < 32; flags++) {
        size_t header, size = pack_with_fields(flags, data, 500, member, &header);
        if (flags & 1) /* "text", which changes nothing, and a member without it behind */
            size += pack_with_fields(flags & ~1u, NULL, 0, member + size, &header);
        file_write(place->path, member, size);
        expect_bytes(place, place->path, data, 500);
        for (size_t cut = 2; cut < size && flags == 30; cut += cut < header + 9 ? 1 : 31)
            expect_refusal(place, member, cut, 1 + cut % 2, "cut off");
    }
    size_t header;
    const size_t size = pack_with_fields(31, data, 500, member, &header);
    static const struct {
        int at, to;
        const char *words;
    } changes[] = {{2, 9, "method"},       {3, 0x3f, "flags"},      {3, 0x9f, "flags"},
                   {4, 9, "header check"}, {14, 9, "header check"}, {-1, 0, "header check"}};
    for (size_t i = 0; i < sizeof changes / sizeof *changes; i++) {
        unsigned char *at = &member[changes[i].at < 0 ? header - 1 : (size_t)changes[i].at];
        const unsigned char before = *at;
        *at = changes[i].at < 0 ? *at ^ 1 : (unsigned char)changes[i].to;
        expect_refusal(place, member, size, 1 + i % 2, changes[i].words);
        *at = before;
    }
    free(data);
}

/* Standard input is a pipe that gives one byte a read. */
static void drip(const unsigned char *data, size_t size, int pipe_end)
{
    for (size_t i = 0; i < size; i++)
        if (write(pipe_end, data + i, 1) != 1)
            _exit(1);
    _exit(0);
}

static void pipes_may_give_one_byte_at_a_time(void **state)
{
    struct place *place = *state;
    size_t size = 20000;
    unsigned char *data = pattern(size);
    unsigned char *packed = malloc(size + 1000);
    size_t header, used = pack_with_fields(31, data, 500, packed, &header);
    used += gzip_pack(data + 500, 6500, 6, packed + used, size);
    used += gzip_pack(data + 7000, size - 7000, 6, packed + used, size);
    int before = dup(STDIN_FILENO);
    for (int gzip = 0; gzip < 2; gzip++) {
        int ends[2];
        /* O_DIRECT: a packet a write, so that no two bytes come in one read. */
        assert_int_equal(pipe2(ends, O_DIRECT), 0);
        pid_t child = fork();
        if (child == 0) {
            close(ends[0]);
            drip(gzip ? packed : data, gzip ? used : size, ends[1]);
        }
        close(ends[1]);
        dup2(ends[0], STDIN_FILENO);
        close(ends[0]);
        struct instream *stream;
        assert_int_equal(instream_open(&place->ctx, "-", &stream), STATUS_OK);
        assert_string_equal(instream_name(stream), "standard input");
        assert_int_equal(instream_is_gzip(stream), gzip);
        read_all(stream, data, size, 37, 29);
        assert_int_equal(instream_raw_size(stream), gzip ? used : size);
        assert_int_equal(instream_digest(stream),
                         gzip ? checksum(0, packed, used) : checksum(0, data, size));
        instream_close(&stream);
        int how;
        assert_int_equal(waitpid(child, &how, 0), child);
        assert_int_equal(how, 0);
        dup2(before, STDIN_FILENO);
    }
    close(before);
    free(packed);
    free(data);
}

static void damaged_gzip_is_refused(void **state)
{
    struct place *place = *state;
    size_t size = 3000;
    unsigned char *data = pattern(size);
    unsigned char packed[4000];
    size_t used = gzip_pack(data, size, 6, packed, sizeof packed);
    for (size_t cut = 2; cut < used; cut++) {
        struct context ctx;
        context_init(&ctx);
        ctx.threads = 1 + cut % 2;
        file_write(place->path, packed, cut);
        assert_int_equal(drain(&ctx, place->path), STATUS_BAD_INPUT);
        assert_non_null(strstr(ctx.error, "cut off"));
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
    /* Any flipped bit behind the header's free fields shows: by deflate's rules, CRC or length. */
    for (size_t at = 10; at < used; at++) {
        struct context ctx;
        context_init(&ctx);
        ctx.threads = 1 + at % 2;
        packed[at] ^= (unsigned char)(1 << at % 8);
        file_write(place->path, packed, used);
        assert_int_equal(drain(&ctx, place->path), STATUS_BAD_INPUT);
        packed[at] ^= (unsigned char)(1 << at % 8);
        const char *place_told = strstr(ctx.error, " byte ");
        assert_non_null(place_told);
        assert_true(strtoull(place_told + 6, NULL, 10) <= used);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
    free(data);
}

/* Damage far behind is not told before what stands in front of it has been read, and a reader may
 * stop anywhere. */
static void inflating_ahead_is_not_seen(void **state)
{
    struct place *place = *state;
    size_t size = 5000000;
    unsigned char *data = pattern(size), *packed = malloc(size);
    size_t used = gzip_pack(data, size, 6, packed, size);
    file_write(place->path, packed, used / 2);
    uint64_t ends[2];
    for (unsigned threads = 1; threads <= 2; threads++) {
        for (int stop = 0; stop < 2; stop++) {
            struct context ctx;
            struct instream *stream;
            context_init(&ctx);
            ctx.threads = threads;
            assert_int_equal(instream_open(&ctx, place->path, &stream), STATUS_OK);
            enum status status = STATUS_OK;
            while (status == STATUS_OK && !(stop && instream_position(stream) > 1000000)) {
                const unsigned char *visible;
                size_t available;
                assert_int_equal(ctx.failed, STATUS_OK);
                status = instream_peek(stream, 1, &visible, &available);
                if (status == STATUS_OK)
                    instream_take(stream, available < 1000 ? available : 1000);
            }
            assert_int_equal(status, stop ? STATUS_OK : STATUS_BAD_INPUT);
            assert_int_equal(ctx.failed, status);
            if (!stop)
                assert_non_null(strstr(ctx.error, "cut off"));
            if (!stop)
                ends[threads - 1] = instream_position(stream);
            instream_close(&stream);
            assert_int_equal(ctx.memory_now, 0);
            context_clear(&ctx);
        }
    }
    assert_int_equal(ends[0], ends[1]);
    free(data);
    free(packed);
}

/* What is damaged shows at the same place and in the same words, however it is read. */
static enum status read_in_steps(const char *path, unsigned threads, size_t step, uint64_t *seen,
                                 char *words, size_t room)
{
    struct context ctx;
    struct instream *stream;
    context_init(&ctx);
    ctx.threads = threads;
    enum status status = instream_open(&ctx, path, &stream);
    size_t available = 1;
    for (*seen = 0; status == STATUS_OK && available > 0;) {
        const unsigned char *visible;
        status = instream_peek(stream, 1, &visible, &available);
        if (status == STATUS_OK) {
            available = available < step ? available : step;
            instream_take(stream, available);
            *seen += available;
        }
    }
    assert_true(ctx.memory_peak < 4 << 20); /* whatever the size */
    memcpy(words, ctx.error, room);
    instream_close(&stream);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return status;
}

static void damage_is_told_alike(void **state)
{
    struct place *place = *state;
    const size_t size = 5000000;
    unsigned char *data = pattern(size), *packed = malloc(size);
    const size_t used = gzip_pack(data, size, 6, packed, size);
    static const char *const words[] = {"",
                                        "cut off at byte",
                                        "length check",
                                        "length check",
                                        "data check",
                                        "damaged gzip data near byte"};
    for (int damage = 0; damage < 6; damage++) {
        unsigned char *bytes = malloc(used);
        memcpy(bytes, packed, used);
        if (damage == 2 || damage == 3)
            memcpy(bytes + used - 4, damage == 2 ? "\0\0\0\1" : "\377\377\377\377", 4);
        if (damage == 4)
            bytes[used - 5] ^= 1;
        if (damage == 5)
            memset(bytes + used / 2, 0x5a, 1000);
        file_write(place->path, bytes, damage == 1 ? used / 3 : used);
        char told[4][sizeof((struct context *)0)->error];
        uint64_t seen[4];
        for (unsigned way = 0; way < 4; way++) {
            enum status status = read_in_steps(place->path, 1 + way % 2, way < 2 ? 1000 : SIZE_MAX,
                                               &seen[way], told[way], sizeof told[0]);
            assert_int_equal(status, damage == 0 ? STATUS_OK : STATUS_BAD_INPUT);
            assert_int_equal(seen[way], seen[0]);
            assert_string_equal(told[way], told[0]);
            assert_non_null(strstr(told[way], words[damage]));
        }
        assert_true(damage == 1 || damage == 5 || seen[0] == size);
        free(bytes);
    }
    free(data);
    free(packed);
}

/* Bytes that become visible behind others, which stay where they are while some of them are taken.
 */
static void streams_are_extended(void **state)
{
    struct place *place = *state;
    const size_t size = 6000000, room = 2 << 20;
    unsigned char *data = pattern(size), *packed = malloc(size);
    for (int way = 0; way < 6; way++) {
        struct context *ctx = &place->ctx;
        struct instream *stream;
        size_t used = gzip_pack(data, size, 6, packed, size);
        file_write(place->path, way < 3 ? packed : data, way < 3 ? used : size);
        ctx->threads = 1 + way % 2;
        assert_int_equal(instream_open(ctx, place->path, &stream), STATUS_OK);
        uint64_t position = 0;
        size_t available = 1;
        while (available > 0) {
            const unsigned char *visible, *at;
            /* Read singly first, in the last way as far as a thread runs ahead. */
            assert_int_equal(
                instream_peek(stream, way % 3 == 2 ? 1300000 : 100, &visible, &available),
                STATUS_OK);
            assert_int_equal(instream_reserve(stream, room, &at, &available), STATUS_OK);
            assert_memory_equal(at, data + position, available);
            size_t got = 1, taken = 0;
            while (got > 0) {
                assert_int_equal(instream_extend(stream, 200000, &got), STATUS_OK);
                assert_true(got <= 200000 && available + got <= size - position);
                assert_memory_equal(at + available, data + position + available, got);
                available += got;
                if (available - taken > 100000) {
                    instream_take(stream, 70000);
                    taken += 70000;
                }
            }
            assert_true(available >= room / 2 || available == size - position);
            assert_int_equal(instream_position(stream), position + taken);
            position += taken;
            /* What is left is small enough to move. */
            while (available - taken > room / 4) {
                instream_take(stream, 100000);
                taken += 100000;
                position += 100000;
            }
            if (position + (available - taken) == size) {
                instream_take(stream, available - taken);
                position = size;
            }
            available = position < size;
        }
        assert_int_equal(instream_peek(stream, 1, &(const unsigned char *){NULL}, &available),
                         STATUS_OK);
        assert_int_equal(available, 0);
        assert_int_equal(instream_digest(stream),
                         way < 3 ? checksum(0, packed, used) : checksum(0, data, size));
        instream_close(&stream);
    }
    free(data);
    free(packed);
}

static void what_cannot_be_read_has_words(void **state)
{
    struct place *place = *state;
    struct context ctx;
    struct instream *stream;
    context_init(&ctx);
    assert_int_equal(instream_open(&ctx, place->folder, &stream), STATUS_BAD_INPUT);
    assert_null(stream);
    assert_non_null(strstr(ctx.error, "is a directory"));
    assert_int_equal(instream_open(&ctx, place->path, &stream), STATUS_IO);
    context_clear(&ctx);

    context_init(&ctx);
    file_write(place->path, "\x1f\x8b\x07........", 11);
    assert_int_equal(instream_open(&ctx, place->path, &stream), STATUS_BAD_INPUT);
    assert_non_null(strstr(ctx.error, "damaged gzip"));
    context_clear(&ctx);

    context_init(&ctx);
    file_write(place->path, "abc", 3);
    assert_int_equal(instream_open(&ctx, place->path, &stream), STATUS_OK);
    const unsigned char *data;
    size_t available;
    assert_int_equal(instream_peek(stream, 64 << 20, &data, &available), STATUS_OK);
    assert_int_equal(available, 3);
    /* The claim alone has cost nothing. */
    assert_true(ctx.memory_peak < 3 << 20);
    assert_int_equal(instream_peek(stream, (64 << 20) + 1, &data, &available), STATUS_BAD_INPUT);
    assert_non_null(strstr(ctx.error, "64 MiB"));
    instream_close(&stream);
    instream_close(&stream);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        PLACE_TEST(plain_files_arrive),
        PLACE_TEST(gzip_members_are_joined),
        PLACE_TEST(headers_may_have_every_field),
        PLACE_TEST(streams_are_extended),
        PLACE_TEST(pipes_may_give_one_byte_at_a_time),
        PLACE_TEST(damaged_gzip_is_refused),
        PLACE_TEST(inflating_ahead_is_not_seen),
        PLACE_TEST(damage_is_told_alike),
        PLACE_TEST(what_cannot_be_read_has_words),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
