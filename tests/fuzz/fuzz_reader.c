/*
 * A reader of mesh files (TARGET_READER: import_ply, import_obj, import_stl, import_off,
 * import_read) on any bytes. What it hands on must keep the promises of import.h; and whatever
 * import takes must become a store that passes its check and holds a manifold.
 */
#include "target.h"

#include <math.h>
#include <stdlib.h>

#include "mesh/import.h"
#include "mesh/store.h"
#include "test_shapes.h"

const bool target_keeps_length = false;

/* ---- a sink that checks ---- */

struct watch {
    bool has_begun;
    uint32_t stride;
    uint32_t sum; /* every byte is looked at */
};

static enum status begin(void *user, const struct attributes *attributes, bool is_soup,
                         uint64_t expected_vertices, uint64_t expected_faces)
{
    struct watch *watch = user;
    (void)is_soup;
    (void)expected_vertices;
    (void)expected_faces;
    require(!watch->has_begun, "reading begins once");
    require(attributes->count <= ATTRIBUTE_MAX, "not too many attributes");
    uint32_t stride = 0;
    for (uint32_t i = 0; i < attributes->count; i++) {
        require(attributes->list[i].offset == stride, "records are packed");
        stride += scalar_size(attributes->list[i].type);
    }
    require(stride == attributes->stride, "the stride is the sum of the sizes");
    watch->has_begun = true;
    watch->stride = stride;
    return STATUS_OK;
}

static enum status vertices(void *user, size_t count, const float *floats, const double *doubles,
                            const unsigned char *records)
{
    struct watch *watch = user;
    require(watch->has_begun && !floats != !doubles,
            "vertices come in one kind, after the beginning");
    require(!records == !watch->stride || count == 0, "records come if there are any");
    for (size_t i = 0; i < 3 * count; i++)
        require(isfinite(floats ? (double)floats[i] : doubles[i]), "coordinates are finite");
    for (size_t i = 0; i < count * watch->stride; i++)
        watch->sum += records[i];
    return STATUS_OK;
}

static enum status faces(void *user, uint64_t first_face, size_t count, const uint32_t *sizes,
                         const uint32_t *indices)
{
    struct watch *watch = user;
    (void)first_face;
    require(watch->has_begun, "faces come after the beginning");
    size_t at = 0;
    for (size_t i = 0; i < count; i++) {
        uint32_t size = sizes ? sizes[i] : 3;
        require(size >= 3, "a face has three corners or more");
        for (uint32_t k = 0; k < size; k++)
            watch->sum += indices[at++];
    }
    return STATUS_OK;
}

static enum status watch_reader(const char *path)
{
    struct context ctx;
    target_context(&ctx);
    struct watch watch = {.has_begun = false};
    struct import_sink sink = {
        .user = &watch, .begin = begin, .vertices = vertices, .faces = faces};
    struct instream *stream = NULL;
    enum status status = instream_open(&ctx, path, &stream);
    if (status == STATUS_OK)
        status = TARGET_READER(&ctx, stream, &sink);
    instream_close(&stream);
    target_end(&ctx, status);
    return status;
}

/* ---- the whole import ---- */

static void import_and_check(const char *path, bool weld)
{
    struct context ctx;
    target_context(&ctx);
    struct import_options options = {.weld = weld, .slab_shift = 4};
    enum status status = store_build(&ctx, &path, 1, target_path("store"), &options, NULL);
    target_end(&ctx, status);
    if (status == STATUS_OK)
        require_manifold_store(target_path("store"));
    target_clear(status == STATUS_OK ? "store" : NULL);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    if (size > 1u << 20)
        return 0;
    struct byte_file file = byte_file_open(data, size);
    if (watch_reader(file.path) == STATUS_OK)
        import_and_check(file.path, size % 2 == 0);
    byte_file_close(&file);
    return 0;
}

void target_seeds(const struct seed_taker *taker)
{
    static const char *const texts[] = {
        "ply\nformat ascii 1.0\ncomment c\nobj_info o\nelement first 2\nproperty list uchar short "
        "a\n"
        "element vertex 3\nproperty uchar red\nproperty double z\nproperty list ushort float w\n"
        "property short x\nproperty float y\nelement face 1\nproperty list ushort uchar "
        "vertex_indices\nproperty list char int e\nelement tristrips 1\nproperty list int int "
        "vertex_indices\nend_header\n2 1 2\n0\n1 2 1 5 3 4\n7 8 0 9 10\n1 2 0 3 4\n3 0 1 2 1 9\n"
        "5 0 1 2 -1 0\n",
        "# c\nmtllib m\nv 0 0 0 1 0.5 1\nv 1 0 0\nv 1 1 0\nv 0 1e0 0\nvt 0 0\nvn 0 0 1\no a\ng "
        "b\ns 1\n"
        "usemtl m\nf 1/1/1 2//1 3 -1\nl 1 2\np 1\nf 1 2 \\\n4\n",
        "COFF\n# c\n4 2 0\n0 0 0 1 0 0 1\n1 0 0 0.5 1 0 1\n1 1 0 1 0 0 1\n0 1 0 1 1 1 1\n"
        "4 0 1 2 3 255 0 0\n3 0 1 3\n",
        "OFF 3 1 0\n0 0 0 1 0 0 0 1 0 3 0 1 2",
        "solid a b\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\n"
        "endloop\nendfacet\nendsolid a b\nsolid\nendsolid\n"};
    for (unsigned which = 0; which < TARGET_SHAPES; which++)
        for (int format = SHAPE_PLY_ASCII; format <= SHAPE_STL_ASCII; format++) {
            struct shape shape = target_shape(which);
            size_t size;
            unsigned char *data = shape_encode(&shape, (enum shape_format)format, &size);
            taker->take(taker->user, data, size);
            free(data);
            shape_free(&shape);
        }
    for (size_t i = 0; i < sizeof texts / sizeof *texts; i++) {
        size_t size = 0;
        while (texts[i][size])
            size++;
        taker->take(taker->user, texts[i], size);
    }
}
