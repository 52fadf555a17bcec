/*
 * The chain file: what is written comes back, every flipped bit and every truncation is found, and
 * contents that someone has forged, checksums and all, are refused or harmless.
 */
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <math.h>

#include "base/block_stream.h"
#include "base/bytes.h"
#include "base/checksum.h"
#include "base/memory.h"
#include "simplify/chain_code.h"
#include "simplify/chain_frame.h"
#include "simplify/chain_loops.h"
#include "simplify/chain_trace.h"
#include "test_chains.h"
#include "test_files.h"
#include "test_kit.h"
#include "test_shapes.h"

#define must(call) assert_int_equal((call), STATUS_OK)

struct fixture {
    struct context ctx;
    struct mesh mesh;
    struct slab_set slabs;
    struct chain_set set;
    char path[256];
};

static void begin(struct fixture *fixture, struct shape shape, uint32_t slab_faces,
                  const struct patch_options *options)
{
    memset(fixture, 0, sizeof *fixture);
    context_init(&fixture->ctx);
    shape_into_mesh(&fixture->ctx, &shape, &fixture->mesh);
    slab_set_build(&fixture->mesh, slab_faces, &fixture->slabs);
    chain_set_build(&fixture->ctx, &fixture->slabs, options, &fixture->set);
    snprintf(fixture->path, sizeof fixture->path, "%s", test_path("test.chains"));
}

static void end(struct fixture *fixture)
{
    chain_set_free(&fixture->set);
    slab_set_free(&fixture->slabs);
    mesh_clear(&fixture->ctx, &fixture->mesh);
    assert_int_equal(fixture->ctx.memory_now, 0);
    context_clear(&fixture->ctx);
}

/* A sphere in a few slabs, with patches of all kinds. */
static void begin_sphere(struct fixture *fixture)
{
    struct patch_options options = test_patch_options(15, 12, 1);
    begin(fixture, shape_noisy_sphere(3, 0.02, 1), 256, &options);
}

/* Opens, reads all blocks; the first failure. */
static enum status read_all(const char *path, char *error, size_t error_size)
{
    struct context ctx;
    context_init(&ctx);
    struct chain_file *file;
    enum status status = chain_file_open(&ctx, path, &file);
    for (uint32_t i = 0; !status && i < chain_file_info(file)->slab_count; i++) {
        struct chain_block block;
        status = chain_block_read(file, i, &block);
        if (!status)
            chain_block_clear(&ctx, chain_file_info(file)->attributes.stride, &block);
    }
    chain_file_close(&file);
    snprintf(error, error_size, "%s", ctx.error);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return status;
}

static enum status check(const char *path, char *error, size_t error_size)
{
    struct context ctx;
    context_init(&ctx);
    enum status status = chain_file_check(&ctx, path);
    snprintf(error, error_size, "%s", ctx.error);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return status;
}

/* ---- what is written comes back ---- */

static void blocks_come_back(void **unused)
{
    (void)unused;
    struct fixture fixture;
    begin_sphere(&fixture);
    chains_must_hold(&fixture.set);
    for (int level = 0; level <= 12; level += 6) {
        chain_set_write(&fixture.set, fixture.path, level);
        struct chain_file *file;
        must(chain_file_open(&fixture.ctx, fixture.path, &file));
        struct chain_info info = *chain_file_info(file);
        assert_memory_equal(&info, &fixture.set.info, sizeof info);
        for (uint32_t i = fixture.slabs.slab_count; i-- > 0;) { /* in any order */
            struct chain_block block;
            must(chain_block_read(file, i, &block));
            blocks_must_agree(&fixture.set.blocks[i], &block, 0);
            chain_block_clear(&fixture.ctx, 0, &block);
        }
        chain_file_close(&file);
    }
    end(&fixture);
}

static void add_attribute(struct attributes *attributes, const char *name, enum scalar_type type)
{
    struct attribute *attribute = attributes->list + attributes->count++;
    snprintf(attribute->name, sizeof attribute->name, "%s", name);
    attribute->type = type;
    attribute->offset = attributes->stride;
    attributes->stride += scalar_size(type);
}

static void attributes_come_back(void **unused)
{
    (void)unused;
    struct fixture fixture;
    begin_sphere(&fixture);
    struct chain_info info = fixture.set.info;
    add_attribute(&info.attributes, "red", SCALAR_UINT8);
    add_attribute(&info.attributes,
                  "a_rather_long_name_of_a_property,_63_characters_of_it_in_all_63",
                  SCALAR_FLOAT64);
    add_attribute(&info.attributes, "id", SCALAR_INT16);
    uint32_t stride = info.attributes.stride, count = fixture.slabs.slab_count;
    assert_int_equal(stride, 11);
    struct chain_writer *writer;
    must(chain_writer_open(&fixture.ctx, fixture.path, 6, count, stride, &writer));
    for (uint32_t i = 0; i < count; i++) {
        struct chain_block *block = &fixture.set.blocks[i];
        must(memory_take(&fixture.ctx, block->vertex_count, stride, &block->records));
        for (uint32_t v = 0; v < block->vertex_count; v++) { /* by position, so that seams agree */
            uint32_t seed = checksum(0, block->positions + 3 * (size_t)v, 12);
            for (uint32_t b = 0; b < stride; b++)
                block->records[(size_t)v * stride + b] = (unsigned char)(seed >> b % 24);
        }
        unsigned char *packed;
        size_t size;
        must(chain_block_pack(&fixture.ctx, block, stride, 6, NULL, 0, &packed, &size));
        must(chain_writer_block(writer, packed, size));
        memory_release(&fixture.ctx, &packed, size, 1);
    }
    for (uint32_t i = 0; i < count; i++)
        must(chain_writer_seams(writer, &fixture.set.blocks[i]));
    must(chain_writer_commit(&writer, &info, false));
    must(chain_file_check(&fixture.ctx, fixture.path));
    struct chain_file *file;
    must(chain_file_open(&fixture.ctx, fixture.path, &file));
    assert_memory_equal(chain_file_info(file), &info, sizeof info);
    for (uint32_t i = 0; i < count; i++) {
        struct chain_block block;
        must(chain_block_read(file, i, &block));
        blocks_must_agree(&fixture.set.blocks[i], &block, stride);
        chain_block_clear(&fixture.ctx, stride, &block);
        struct chain_block *own = &fixture.set.blocks[i];
        memory_release(&fixture.ctx, &own->records, own->vertex_count, stride);
    }
    chain_file_close(&file);
    end(&fixture);
}

static void empty_file(void **unused)
{
    (void)unused;
    struct context ctx;
    context_init(&ctx);
    struct chain_info info = {.effort = 2, .options = test_patch_options(25, 20, 0)};
    struct chain_writer *writer;
    const char *path = test_path("empty.chains");
    must(chain_writer_open(&ctx, path, 6, 0, 0, &writer));
    must(chain_writer_commit(&writer, &info, true));
    must(chain_file_check(&ctx, path));
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

/* Written into a pipe, the file is the same: nothing goes back to the beginning. */
struct pipe_reader {
    const char *path;
    unsigned char *bytes;
    size_t size;
};

static void *read_pipe(void *user)
{
    struct pipe_reader *reader = user;
    reader->bytes = file_read(reader->path, &reader->size);
    return NULL;
}

static void a_pipe_gets_the_same_bytes(void **unused)
{
    (void)unused;
    struct fixture fixture;
    begin_sphere(&fixture);
    chain_set_write(&fixture.set, fixture.path, 6);
    struct pipe_reader reader = {.path = test_path("pipe")};
    assert_int_equal(mkfifo(reader.path, 0600), 0);
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, read_pipe, &reader), 0);
    char path[256];
    snprintf(path, sizeof path, "%s", reader.path);
    chain_set_write(&fixture.set, path, 6);
    pthread_join(thread, NULL);
    size_t size;
    unsigned char *bytes = file_read(fixture.path, &size);
    assert_int_equal(size, reader.size);
    assert_memory_equal(bytes, reader.bytes, size);
    free(bytes);
    free(reader.bytes);
    end(&fixture);
}

static void discarded_file_does_not_appear(void **unused)
{
    (void)unused;
    struct context ctx;
    context_init(&ctx);
    struct chain_writer *writer;
    const char *path = test_path("discarded.chains");
    must(chain_writer_open(&ctx, path, 6, 3, 0, &writer));
    chain_writer_discard(&writer);
    assert_null(writer);
    assert_int_not_equal(access(path, F_OK), 0);
    must(chain_writer_open(&ctx, path, 6, 3, 0, &writer));
    struct chain_info info = {.slab_count = 3, .effort = 2};
    assert_int_equal(chain_writer_commit(&writer, &info, false), STATUS_INTERNAL);
    assert_null(writer);
    assert_int_not_equal(access(path, F_OK), 0);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

/* ---- damage ---- */

static void every_flipped_bit_is_found(void **unused)
{
    (void)unused;
    struct fixture fixture;
    struct patch_options options = test_patch_options(60, 60, 0);
    begin(&fixture, shape_icosphere(1), 32, &options);
    chain_set_write(&fixture.set, fixture.path, 6);
    char error[1024];
    must(check(fixture.path, error, sizeof error));
    size_t size;
    unsigned char *bytes = file_read(fixture.path, &size);
    int fd = open(fixture.path, O_WRONLY); /* changed in place: thousands of new files are slow */
    assert_true(fd >= 0);
    for (size_t bit = 0; bit < 8 * size; bit++) {
        unsigned char flipped = (unsigned char)(bytes[bit / 8] ^ 1 << bit % 8);
        assert_int_equal(pwrite(fd, &flipped, 1, (off_t)(bit / 8)), 1);
        assert_int_equal(check(fixture.path, error, sizeof error), STATUS_BAD_INPUT);
        assert_int_not_equal(error[0], 0);
        if (bit % 8 == 7)
            assert_int_equal(pwrite(fd, &bytes[bit / 8], 1, (off_t)(bit / 8)), 1);
    }
    must(check(fixture.path, error, sizeof error));
    while (size-- > 0) {
        assert_int_equal(ftruncate(fd, (off_t)size), 0);
        assert_int_equal(check(fixture.path, error, sizeof error), STATUS_BAD_INPUT);
        assert_int_equal(read_all(fixture.path, error, sizeof error), STATUS_BAD_INPUT);
    }
    close(fd);
    free(bytes);
    end(&fixture);
}

/* ---- forgery: right checksums, wrong contents ---- */

/* Writes the set's blocks with block `which` (or its seams) replaced by other raw bytes. */
static void write_forged(struct fixture *fixture, uint32_t which, const unsigned char *raw,
                         size_t size, const struct chain_info *info)
{
    struct context *ctx = &fixture->ctx;
    uint32_t count = fixture->slabs.slab_count;
    struct chain_writer *writer;
    must(chain_writer_open(ctx, fixture->path, 0, count, 0, &writer));
    for (uint32_t i = 0; i < count; i++) {
        unsigned char *packed;
        size_t packed_size;
        if (raw && i == which)
            must(block_pack(ctx, raw, size, 0, &packed, &packed_size));
        else
            must(chain_block_pack(ctx, &fixture->set.blocks[i], 0, 0, NULL, 0, &packed,
                                  &packed_size));
        must(chain_writer_block(writer, packed, packed_size));
        memory_release(ctx, &packed, packed_size, 1);
    }
    for (uint32_t i = 0; i < count; i++)
        must(chain_writer_seams(writer, &fixture->set.blocks[i]));
    must(chain_writer_commit(&writer, info, false));
}

static void forged_bytes_do_no_harm(void **unused)
{
    (void)unused;
    struct fixture fixture;
    begin_sphere(&fixture);
    unsigned char *raw;
    size_t capacity, size, accepted = 0;
    uint64_t state = 3;
    must(chain_block_encode(&fixture.ctx, &fixture.set.blocks[2], 0, NULL, 0, &raw, &capacity,
                            &size));
    unsigned char *forged = malloc(size + 8);
    assert_non_null(forged);
    size_t structure = size - 12 * (size_t)fixture.set.blocks[2].vertex_count;
    for (unsigned round = 0; round < 6000; round++) {
        struct context ctx;
        struct chain_block block;
        size_t length = size;
        memcpy(forged, raw, size);
        for (uint64_t i = 1 + random_below(&state, 3); i > 0; i--) {
            size_t place = random_below(&state, round % 4 ? structure : size);
            forged[place] = random_below(&state, 2) ? (unsigned char)random_next(&state)
                                                    : (unsigned char)(forged[place] + 1);
        }
        if (random_below(&state, 8) == 0)
            length = random_below(&state, size);
        context_init(&ctx);
        enum status status = chain_block_decode(&ctx, "forged", forged, length, 2, 0, &block);
        uint64_t faces = 0;
        if (!status) {
            accepted++;
            status = chain_loops_check(&ctx, "forged", &block, &faces);
            chain_block_clear(&ctx, 0, &block);
        }
        assert_true(status == STATUS_OK || status == STATUS_BAD_INPUT);
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
    }
    assert_true(accepted > 50);
    free(forged);
    memory_release(&fixture.ctx, &raw, capacity, 1);
    end(&fixture);
}

static void forged_seams_do_no_harm(void **unused)
{
    (void)unused;
    struct fixture fixture;
    begin_sphere(&fixture);
    unsigned char *raw;
    size_t capacity, size;
    uint64_t state = 4;
    const struct chain_block *block = &fixture.set.blocks[2];
    must(seam_chains_encode(&fixture.ctx, block, &raw, &capacity, &size));
    for (unsigned round = 0; round < 6000; round++) {
        struct context ctx;
        struct chain_block copy = *block;
        copy.seam_chains = NULL;
        copy.seam_lists = NULL;
        unsigned char *place = raw + random_below(&state, size), old = *place;
        *place = (unsigned char)random_next(&state);
        context_init(&ctx);
        enum status status =
            seam_chains_decode(&ctx, "forged", raw, size, fixture.slabs.slab_count, &copy);
        uint64_t faces = 0;
        if (!status)
            status = chain_loops_check(&ctx, "forged", &copy, &faces);
        assert_true(status == STATUS_OK || status == STATUS_BAD_INPUT);
        memory_release(&ctx, &copy.seam_chains, copy.seam_chain_count, sizeof *copy.seam_chains);
        memory_release(&ctx, &copy.seam_lists, copy.seam_list_count, sizeof(uint32_t));
        assert_int_equal(ctx.memory_now, 0);
        context_clear(&ctx);
        *place = old;
    }
    memory_release(&fixture.ctx, &raw, capacity, 1);
    end(&fixture);
}

/* One field of block 2 changed, then back: reading must tell `words`. */
static void forged_field_is_told(struct fixture *fixture, void *field, const void *forged,
                                 size_t size, const char *words)
{
    unsigned char old[64];
    char error[1024];
    memcpy(old, field, size);
    memcpy(field, forged, size);
    write_forged(fixture, 0, NULL, 0, &fixture->set.info);
    assert_int_equal(read_all(fixture->path, error, sizeof error), STATUS_BAD_INPUT);
    if (!strstr(error, words) || !strstr(error, "block 2"))
        fail_msg("\"%s\" does not say \"%s\"", error, words);
    memcpy(field, old, size);
}

/* A chain between junctions that earlier chains have named: both can be changed without the block's
 * numbering being out of order. */
static struct chain *chain_of_known_junctions(struct chain_block *block)
{
    uint32_t named = 0;
    for (uint32_t i = 0; i < block->chain_count; i++) {
        struct chain *chain = block->chains + i;
        if (chain->start < named && chain->end < named)
            return chain;
        named += chain->start == named;
        named += chain->end == named;
    }
    fail_msg("no such chain");
    return NULL;
}

static void forged_fields_are_told(void **unused)
{
    (void)unused;
    struct fixture fixture;
    begin_sphere(&fixture);
    struct chain_block *block = &fixture.set.blocks[2];
    uint32_t patch = 0;
    while (block->patches[patch].diagonal_count == 0)
        patch++;
    float nan_value = NAN, minus = -1;
    forged_field_is_told(&fixture, &block->positions[30], &nan_value, 4, "not finite");
    forged_field_is_told(&fixture, &block->patches[1].area, &minus, 4, "negative");
    forged_field_is_told(&fixture, &block->patches[1].deviation, &nan_value, 4, "not finite");
    struct chain *known = chain_of_known_junctions(block);
    forged_field_is_told(&fixture, &known->end, &known->start, 4, "equal");
    uint32_t *diagonal = block->diagonals + 2 * (size_t)block->patches[patch].diagonal_first;
    forged_field_is_told(&fixture, diagonal, &block->vertex_count, 4, "diagonal's vertex");
    forged_field_is_told(&fixture, diagonal, diagonal + 1, 4, "triangulate");
    struct seam_chain *seam = block->seam_chains;
    uint32_t slabs = fixture.slabs.slab_count, zero = 0;
    forged_field_is_told(&fixture, &seam->other_slab, &slabs, 4, "other side");
    forged_field_is_told(&fixture, &seam->other_slab, &block->slab, 4, "other side");
    forged_field_is_told(&fixture, block->seam_lists, &zero, 4,
                         block->junction_count ? "no seam vertex" : "");
    seam += block->seam_chain_count - 1;
    forged_field_is_told(&fixture, &seam->left, &block->patch_count, 4, "left patch");
    end(&fixture);
}

/* No block can have a right patch out of range, so its byte in the column is forged. */
static void forged_right_patch_is_told(void **unused)
{
    (void)unused;
    struct fixture fixture;
    begin_sphere(&fixture);
    const struct chain_block *block = &fixture.set.blocks[2];
    unsigned char *raw;
    size_t capacity, size;
    char error[1024];
    must(chain_block_encode(&fixture.ctx, block, 0, NULL, 0, &raw, &capacity, &size));
    unsigned char *at = raw; /* behind seven counts, the seam vertices and the left patches */
    for (uint32_t numbers = 7 + block->seam_vertex_count + block->chain_count; numbers > 0; at++)
        numbers -= *at < 128;
    assert_true(block->chains[0].left < 127 && *at < 127);
    *at = 127;
    write_forged(&fixture, 2, raw, size, &fixture.set.info);
    assert_int_equal(read_all(fixture.path, error, sizeof error), STATUS_BAD_INPUT);
    assert_non_null(strstr(error, "right patch"));
    memory_release(&fixture.ctx, &raw, capacity, 1);
    end(&fixture);
}

/* A loop that closes by chance in another patch, a junction of two fans: forged by swapping. */
static void forged_loops_are_told(void **unused)
{
    (void)unused;
    struct fixture fixture;
    begin_sphere(&fixture);
    struct chain_block *block = &fixture.set.blocks[1];
    uint64_t faces = 0;
    must(chain_loops_check(&fixture.ctx, "block", block, &faces));
    for (uint32_t i = 0; i < block->chain_count; i++) {
        struct chain *chain = block->chains + i, old = *chain;
        chain->start = old.end;
        chain->end = old.start;
        assert_int_equal(chain_loops_check(&fixture.ctx, "block", block, &faces), STATUS_BAD_INPUT);
        *chain = old;
        if (old.right == NO_PATCH)
            continue;
        chain->right = NO_PATCH;
        assert_int_equal(chain_loops_check(&fixture.ctx, "block", block, &faces), STATUS_BAD_INPUT);
        *chain = old;
    }
    for (uint32_t i = 0; i < block->seam_chain_count; i++) {
        struct seam_chain *chain = block->seam_chains + i, old = *chain;
        chain->left = (old.left + 1) % block->patch_count;
        assert_int_equal(chain_loops_check(&fixture.ctx, "block", block, &faces), STATUS_BAD_INPUT);
        *chain = old;
    }
    end(&fixture);
}

/*
 * Two fans that touch in one junction: patch 0 and patch 1 are squares with a common corner, each
 * alone sound.
 */
static void touching_fans_are_told(void **unused)
{
    (void)unused;
    struct context ctx;
    context_init(&ctx);
    float positions[3 * 7] = {0};
    struct chain chains[6] = {
        {0, 1, 0, NO_PATCH, 5, 0}, {1, 2, 0, NO_PATCH, 5, 0}, {2, 0, 0, NO_PATCH, 5, 0},
        {0, 3, 1, NO_PATCH, 5, 0}, {3, 4, 1, NO_PATCH, 5, 0}, {4, 0, 1, NO_PATCH, 5, 0},
    };
    struct patch patches[2] = {0};
    struct chain_block block = {.vertex_count = 5,
                                .junction_count = 5,
                                .chain_count = 6,
                                .patch_count = 2,
                                .positions = positions,
                                .chains = chains,
                                .patches = patches};
    uint64_t faces = 0;
    assert_int_equal(chain_loops_check(&ctx, "block", &block, &faces), STATUS_BAD_INPUT);
    assert_non_null(strstr(ctx.error, "junction 0 form no single fan"));
    context_clear(&ctx);
    context_init(&ctx);
    chains[3].start = chains[5].end = 5; /* apart, they are fine */
    block.junction_count = block.vertex_count = 6;
    faces = 0;
    must(chain_loops_check(&ctx, "block", &block, &faces));
    assert_int_equal(faces, 2);
    context_clear(&ctx);
}

/* What reading a block alone can't see, chain_file_check does. */
static void check_compares_blocks_and_counts(void **unused)
{
    (void)unused;
    struct fixture fixture;
    begin_sphere(&fixture);
    char error[1024];
    struct chain_block *block = &fixture.set.blocks[2];
    float *seam = block->positions + 3 * (size_t)block->junction_count;
    float old = *seam;
    *seam += 1e-3f;
    write_forged(&fixture, 0, NULL, 0, &fixture.set.info);
    must(read_all(fixture.path, error, sizeof error));
    assert_int_equal(check(fixture.path, error, sizeof error), STATUS_BAD_INPUT);
    assert_non_null(strstr(error, "seam chain"));
    *seam = old;

    uint64_t *counts[] = {&fixture.set.info.patches, &fixture.set.info.chains,
                          &fixture.set.info.junctions, &fixture.set.info.chain_vertices,
                          &fixture.set.info.most_faces};
    for (unsigned i = 0; i < 5; i++) {
        *counts[i] -= 1;
        write_forged(&fixture, 0, NULL, 0, &fixture.set.info);
        assert_int_equal(check(fixture.path, error, sizeof error), STATUS_BAD_INPUT);
        assert_non_null(strstr(error, "count"));
        *counts[i] += 1;
    }
    fixture.set.info.topology.euler -= 2;
    write_forged(&fixture, 0, NULL, 0, &fixture.set.info);
    assert_int_equal(check(fixture.path, error, sizeof error), STATUS_BAD_INPUT);
    assert_non_null(strstr(error, "another surface"));
    fixture.set.info.topology.euler += 2;
    write_forged(&fixture, 0, NULL, 0, &fixture.set.info);
    must(check(fixture.path, error, sizeof error));
    end(&fixture);
}

static void forged_info_is_refused(void **unused)
{
    (void)unused;
    unsigned char bytes[CHAIN_INFO_MAX], forged[CHAIN_INFO_MAX];
    struct chain_info info = {.effort = 2,
                              .slab_count = 3,
                              .topology = {.faces = 1000, .vertices = 500},
                              .options = test_patch_options(25, 20, 0)},
                      back;
    add_attribute(&info.attributes, "red", SCALAR_UINT8);
    add_attribute(&info.attributes, "green", SCALAR_UINT16);
    size_t size = chain_info_encode(&info, bytes);
    assert_int_equal(size, CHAIN_INFO_FIXED + 2 * CHAIN_INFO_ATTRIBUTE);
    assert_null(chain_info_decode(bytes, size, &back));
    assert_memory_equal(&info, &back, sizeof info);
    static const struct {
        size_t at;
        uint32_t value;
    } forgeries[] = {
        {0, 1001}, /* more slabs than faces */
        {4, 2},    /* is_float32 */
        {12, 2},   /* mode */
        {16, 0},   /* effort */
        {16, 4},
        {20, 3},    /* kind of target */
        {24, 17},   /* targets */
        {28, 2000}, /* smoothings */
        {32, 0},    /* most faces of a patch */
        {32, 4097},
        {36, 1}, /* attributes */
        {36, 65},
        {60, 1},           /* 2^32 faces */
        {108, 0x7ff00000}, /* origin */
        {132, 0xfff00000}, /* box */
        {180, 0x7ff80000}, /* mean edge */
        {204, 0x40000000}, /* a cosine of 2 */
        {236, 0xbff00000}, /* a negative tolerance */
        {252, 0x7ff00000}, /* a target */
        {376, 1001},       /* patches */
        {400, 1},          /* junctions without vertices */
        {408, 501},        /* more vertices than the store has */
        {416, 1001},       /* faces, too */
        {424, 0},          /* an empty name */
        {424 + 60, 1},     /* something behind a name */
        {424 + 64, 8},     /* type */
        {424 + 68, 1},     /* offset */
        {424 + 72 + 68, 2},
    };
    for (size_t i = 0; i < sizeof forgeries / sizeof *forgeries; i++) {
        memcpy(forged, bytes, size);
        store_u32(forged + forgeries[i].at, forgeries[i].value);
        if (!chain_info_decode(forged, size, &back))
            fail_msg("forgery %zu is not noticed", i);
    }
    for (size_t length = 0; length < size; length++)
        assert_non_null(chain_info_decode(bytes, length, &back));
}

static void other_files_are_refused(void **unused)
{
    (void)unused;
    char error[1024];
    const char *path = test_path("other");
    file_write(path, "ply\nformat ascii 1.0\n", 21);
    assert_int_equal(read_all(path, error, sizeof error), STATUS_BAD_INPUT);
    assert_non_null(strstr(error, "chain file"));
    assert_int_equal(read_all(test_path("absent"), error, sizeof error), STATUS_IO);
}

/* ---- three junctions of a loop ---- */

static void three_of_a_loop(void **unused)
{
    (void)unused;
    static const float square[] = {1, 0, 0, 0, 0, 0, 0, 1, 0, 1, 1, 0};
    static const uint32_t numbers[] = {7, 9, 3, 8};
    size_t chosen[3];
    loop_choose_three(4, square, numbers, chosen); /* 3 at (0,1); far (1,0); then 8 before 9 */
    assert_int_equal(chosen[0], 0);
    assert_int_equal(chosen[1], 2);
    assert_int_equal(chosen[2], 3);
    static const float line[] = {0, 0, 0, 1, 0, 0, 2, 0, 0, 3, 0, 0, 2, 5, 0};
    static const uint32_t ascending[] = {0, 1, 2, 3, 4};
    loop_choose_three(5, line, ascending, chosen);
    assert_int_equal(chosen[2], 4);                /* off the line, or there would be no area */
    loop_choose_three(4, line, ascending, chosen); /* no area to be had: any three */
    assert_true(chosen[0] < chosen[1] && chosen[1] < chosen[2] && chosen[2] < 4);
    static const float point[9] = {0};
    loop_choose_three(3, point, ascending, chosen);
    assert_true(chosen[0] == 0 && chosen[1] == 1 && chosen[2] == 2);
}

/* Loops without junctions: two patches on a sphere, in one slab and in two; a disk by itself. */
static void closed_loops_get_three_junctions(void **unused)
{
    (void)unused;
    struct patch_options options = test_patch_options(180, 180, 0);
    options.patch_cosine[1] = options.face_cosine[1] = -1;
    struct fixture fixture;
    begin(&fixture, shape_tetrahedron(), 1 << 18, &options);
    assert_int_equal(fixture.set.blocks[0].chain_count, 3);
    assert_int_equal(fixture.set.info.junctions, 3);
    end(&fixture);
    begin(&fixture, shape_tetrahedron(), 3, &options);
    assert_int_equal(fixture.set.info.seam_chains, 3);
    assert_int_equal(fixture.set.info.chains, 3);
    assert_int_equal(fixture.set.info.junctions, 3);
    chain_set_write(&fixture.set, fixture.path, 6);
    must(chain_file_check(&fixture.ctx, fixture.path));
    end(&fixture);
    begin(&fixture, shape_grid(5, 5), 1 << 18, &options);
    assert_int_equal(fixture.set.blocks[0].chain_count, 3);
    assert_int_equal(fixture.set.blocks[0].chains[0].right, NO_PATCH);
    assert_int_equal(fixture.set.info.most_faces, 20 - 2);
    end(&fixture);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(blocks_come_back),
        cmocka_unit_test(attributes_come_back),
        cmocka_unit_test(empty_file),
        cmocka_unit_test(a_pipe_gets_the_same_bytes),
        cmocka_unit_test(discarded_file_does_not_appear),
        cmocka_unit_test(every_flipped_bit_is_found),
        cmocka_unit_test(forged_bytes_do_no_harm),
        cmocka_unit_test(forged_seams_do_no_harm),
        cmocka_unit_test(forged_fields_are_told),
        cmocka_unit_test(forged_right_patch_is_told),
        cmocka_unit_test(forged_loops_are_told),
        cmocka_unit_test(touching_fans_are_told),
        cmocka_unit_test(check_compares_blocks_and_counts),
        cmocka_unit_test(forged_info_is_refused),
        cmocka_unit_test(other_files_are_refused),
        cmocka_unit_test(three_of_a_loop),
        cmocka_unit_test(closed_loops_get_three_junctions),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
