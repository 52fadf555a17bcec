/*
 * The stream of bytes under the readers: plain, gzip of several members, cut off, damaged. Looking
 * ahead by sizes that the input chooses must show the same bytes as taking all at once, and a
 * member that libdeflate understands must be made the same bytes of.
 */
#include "target.h"

#include <libdeflate.h>
#include <stdlib.h>
#include <string.h>

#include "base/checksum.h"
#include "base/instream.h"
#include "test_gzip.h"

const bool target_keeps_length = false;

/* A bomb is fair input; the target has no time for it. */
enum { MOST_BYTES = 4 << 20 };

static uint32_t read_in_steps(const char *path, uint32_t whole, const uint8_t *steps,
                              size_t step_count, enum status *status, uint64_t *total,
                              uint8_t *kept)
{
    struct context ctx;
    target_context(&ctx);
    struct instream *stream = NULL;
    uint32_t crc = 0;
    size_t step = 0;
    *total = 0;
    *status = instream_open(&ctx, path, &stream);
    while (*status == STATUS_OK && *total < MOST_BYTES) {
        const unsigned char *bytes;
        size_t available;
        size_t wanted = step_count ? (size_t)steps[step++ % step_count] * 37 + 1 : 1u << 16;
        *status = instream_peek(stream, wanted, &bytes, &available);
        if (*status != STATUS_OK || available == 0)
            break;
        size_t taken = available < wanted ? available : wanted;
        if (taken > MOST_BYTES - *total)
            taken = (size_t)(MOST_BYTES - *total);
        crc = checksum(crc, bytes, taken);
        require(instream_position(stream) == *total, "the position is what was taken");
        memcpy(kept + *total, bytes, taken);
        instream_take(stream, taken);
        *total += taken;
    }
    if (*status == STATUS_OK && *total < MOST_BYTES)
        require(instream_digest(stream) == whole, "the digest is that of the file");
    instream_close(&stream);
    require_fair_end(&ctx, *status);
    require(ctx.memory_now == 0, "all memory is given back");
    context_clear(&ctx);
    return crc;
}

/* The first member's data, if its header has no fields, by libdeflate; not what it refuses: ISA-L
 * takes codes that are not complete. */
static void compare_member(const uint8_t *data, size_t size, const uint8_t *kept, uint64_t total,
                           enum status status)
{
    static const uint8_t header[] = {0x1f, 0x8b, 8, 0};
    if (size < 18 || memcmp(data, header, sizeof header) != 0)
        return;
    struct libdeflate_decompressor *decompressor = libdeflate_alloc_decompressor();
    uint8_t *wanted = malloc(MOST_BYTES);
    size_t used, made = 0;
    require(decompressor && wanted, "there is memory");
    if (libdeflate_deflate_decompress_ex(decompressor, data + 10, size - 10, wanted, MOST_BYTES,
                                         &used, &made) == LIBDEFLATE_SUCCESS)
        require((total >= made || status != STATUS_OK) &&
                    memcmp(kept, wanted, total < made ? (size_t)total : made) == 0,
                "two libraries make the same of a member");
    free(wanted);
    libdeflate_free_decompressor(decompressor);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct byte_file file = byte_file_open(data, size);
    uint32_t whole = checksum(0, data, size);
    enum status once_status, steps_status;
    uint64_t once_total, steps_total;
    uint8_t *kept = malloc(MOST_BYTES);
    require(kept, "there is memory");
    uint32_t steps = read_in_steps(file.path, whole, data, size < 64 ? size : 64, &steps_status,
                                   &steps_total, kept);
    uint32_t once = read_in_steps(file.path, whole, NULL, 0, &once_status, &once_total, kept);
    compare_member(data, size, kept, once_total, once_status);
    free(kept);
    require(once_status == steps_status, "an input is good or bad however it is read");
    require(once_status != STATUS_OK || (once == steps && once_total == steps_total),
            "an input holds the same bytes however it is read");
    byte_file_close(&file);
    return 0;
}

void target_seeds(const struct seed_taker *taker)
{
    uint8_t raw[3000], packed[8192];
    for (size_t i = 0; i < sizeof raw; i++)
        raw[i] = (uint8_t)(i < 1000 ? i * i >> 3 : i & 3);
    taker->take(taker->user, raw, 100);
    taker->take(taker->user, raw, 0);
    for (int level = 0; level <= 9; level += 3) {
        size_t size = gzip_pack(raw, sizeof raw, level, packed, sizeof packed);
        taker->take(taker->user, packed, size);
        taker->take(taker->user, packed, size / 2);
        if (level > 0) {
            size += gzip_pack(raw, 50, level, packed + size, sizeof packed - size);
            taker->take(taker->user, packed, size);
        }
    }
    /* A header with every field: extra, name, comment, CRC flag. */
    static const uint8_t fields[] = {0x1f, 0x8b, 8,   0x1e, 0,   0, 0,   0, 0, 3,
                                     2,    0,    'x', 'y',  'n', 0, 'c', 0, 9, 9};
    size_t size =
        gzip_pack(raw, 200, 6, packed + sizeof fields - 10, sizeof packed - sizeof fields);
    memcpy(packed, fields, sizeof fields);
    taker->take(taker->user, packed, size + sizeof fields - 10);
}
