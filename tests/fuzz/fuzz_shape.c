/*
 * Any surface, through the whole of the program. The bytes are not a file but the mesh itself
 * (options, vertices on a small grid, so that they meet, line up and fold; faces), so that changes
 * are changes of geometry and topology and nothing is lost to a parser. Whatever it is: import
 * makes a manifold of it; every level has the store's components, border loops and Euler
 * characteristic; topology simplification gives a manifold; measures are numbers.
 */
#include "target.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "inspect/measure.h"
#include "mesh/import.h"
#include "simplify/simplify.h"
#include "simplify/topology.h"
#include "test_shapes.h"

const bool target_keeps_length = false;

enum { HEAD = 5, MOST_FACES = 600 };

/* Options are bytes 0 to 3, the number of vertices byte 4; then three bytes a vertex, three a face.
 */
static struct shape shape_of(const uint8_t *data, size_t size)
{
    struct shape shape = {0};
    size_t vertices = 3 + (size_t)data[4];
    const uint8_t *at = data + HEAD, *end = data + size;
    for (size_t v = 0; v < vertices; v++) {
        double p[3] = {0, 0, 0};
        for (unsigned k = 0; k < 3 && at < end; k++)
            p[k] = (double)(int8_t)*at++ / 8;
        shape_vertex(&shape, p[0], p[1], p[2]);
    }
    for (size_t f = 0; end - at >= 3 && f < MOST_FACES; f++, at += 3)
        shape_triangle(&shape, (uint32_t)(at[0] % vertices), (uint32_t)(at[1] % vertices),
                       (uint32_t)(at[2] % vertices));
    return shape;
}

struct paths {
    char store[128], chains[128], output[128];
};

static void use_path(char path[128], const char *name)
{
    snprintf(path, 128, "%s", target_path(name));
}

static bool import_it(const char *input, struct paths *paths, unsigned slab_shift,
                      struct facts *facts)
{
    struct context ctx;
    target_context(&ctx);
    struct import_options options = {.slab_shift = slab_shift};
    enum status status = store_build(&ctx, &input, 1, paths->store, &options, NULL);
    target_end(&ctx, status);
    if (status != STATUS_OK)
        return false;
    *facts = require_manifold_store(paths->store);
    return true;
}

static void must(const struct context *ctx, enum status status, const char *what)
{
    if (status != STATUS_OK && status != STATUS_TARGET_MISSED)
        fprintf(stderr, "%s\n", ctx->error);
    require(status == STATUS_OK || status == STATUS_TARGET_MISSED, what);
    require(ctx->memory_now == 0, "all memory is given back");
}

static void simplify_it(const uint8_t *data, const struct paths *paths, const struct facts *facts)
{
    struct context ctx;
    target_context(&ctx);
    struct target target = {.kind = data[0] & 2 ? TARGET_ERROR : TARGET_FACES,
                            .count = 1,
                            .values = {data[0] & 2 ? data[2] / 1024.0 : 1 + data[2]},
                            .error_is_relative = true,
                            .mode = data[0] & 4 ? MODE_CLASSIC : MODE_COLLAPSE,
                            .effort = 1 + data[1] % 3};
    struct patch_request request = {.patch_angle = {-1, -1},
                                    .face_angle = {-1, -1},
                                    .smoothings = -1,
                                    .chain_tolerance = data[0] & 8 ? data[3] / 256.0 : -1};
    must(&ctx, chain_build(&ctx, paths->store, paths->chains, &target, &request, NULL),
         "a store can be patchified");
    must(&ctx, chain_file_check(&ctx, paths->chains), "the chain file passes its check");
    bool is_subset = data[0] & 16;
    struct lod_options options = {.target = target,
                                  .place = is_subset ? PLACE_SUBSET : PLACE_DEFAULT,
                                  .output = paths->output,
                                  .export = {.format = EXPORT_PLY}};
    struct lod_report report;
    must(&ctx, lod_build(&ctx, paths->chains, &options, &report), "chains give their levels");
    context_clear(&ctx);
    struct facts found = require_manifold_file(paths->output);
    require(facts_same_topology(&found, facts), "a level has the topology of the store");
    require(found.faces <= facts->faces && found.faces == report.levels[0].faces,
            "a level has as many faces as was said, and not more than the store");
}

static void operate(const uint8_t *data, const struct paths *paths)
{
    struct context ctx;
    target_context(&ctx);
    struct topology_options options;
    topology_defaults(&options);
    options.max_feature = (struct length_option){data[2] / 128.0, true};
    options.measure = (enum loop_measure)(data[1] & 3);
    options.remove_pipes = data[1] & 4;
    options.smooth_features = data[1] & 8;
    options.drop_components = (struct length_option){data[1] & 16 ? data[3] / 512.0 : 0, true};
    options.close_cracks = (struct length_option){data[1] & 32 ? data[3] / 128.0 : 0, true};
    options.crack_inscribed = data[0] & 32;
    options.merge_coplanar = data[1] & 64;
    options.zip_tolerance = (struct length_option){data[1] & 128 ? data[3] / 2048.0 : 0, true};
    options.export.format = EXPORT_PLY;
    struct topology_report report = {0};
    enum status status =
        topology_run(&ctx, paths->store, paths->chains, paths->output, &options, &report);
    topology_report_clear(&ctx, &report);
    if (status == STATUS_BAD_INPUT && strstr(ctx.error, "nothing would be left")) {
        context_clear(&ctx);
        return;
    }
    must(&ctx, status, "a store can be operated on");
    context_clear(&ctx);
    require_manifold_file(paths->output);
}

static void measure_it(const char *input, const char *output)
{
    struct context ctx;
    target_context(&ctx);
    struct measure_options options = {.samples_per_face = 1, .self_intersections = true};
    struct measurement result;
    struct mesh mesh;
    enum status status = measure(&ctx, input, output, &options, &result, &mesh);
    require_fair_end(&ctx, status);
    if (status == STATUS_OK) {
        require(isfinite(result.hausdorff) && result.hausdorff >= 0 && isfinite(result.diagonal),
                "distances are numbers");
        measurement_clear(&ctx, &result);
        mesh_clear(&ctx, &mesh);
    }
    target_end(&ctx, STATUS_OK);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const unsigned slab_shifts[] = {0, 2, 3, 5};
    if (size < HEAD + 3)
        return 0;
    struct shape shape = shape_of(data, size);
    size_t length;
    unsigned char *ply = shape_encode(&shape, SHAPE_PLY_LITTLE, &length);
    struct byte_file file = byte_file_open(ply, length);
    struct facts facts;
    struct paths paths;
    use_path(paths.store, "store");
    use_path(paths.chains, "chains");
    use_path(paths.output, "out.ply");
    if (import_it(file.path, &paths, slab_shifts[data[0] >> 6], &facts)) {
        if (data[0] & 1)
            operate(data, &paths);
        else
            simplify_it(data, &paths, &facts);
        if (data[3] % 4 == 0)
            measure_it(file.path, paths.output);
        remove(paths.chains);
        remove(paths.output);
        target_clear("store");
    }
    target_clear(NULL);
    byte_file_close(&file);
    free(ply);
    shape_free(&shape);
    return 0;
}

static void take_shape(const struct seed_taker *taker, struct shape *shape, uint8_t how)
{
    static uint8_t bytes[HEAD + 3 * 258 + 3 * MOST_FACES];
    size_t size = HEAD;
    shape_fan(shape);
    if (shape->vertex_count >= 3 && shape->vertex_count <= 258) {
        bytes[0] = how;
        bytes[1] = (uint8_t)(how * 37);
        bytes[2] = 20;
        bytes[3] = (uint8_t)(how / 3);
        bytes[4] = (uint8_t)(shape->vertex_count - 3);
        for (size_t i = 0; i < 3 * shape->vertex_count; i++)
            bytes[size++] = (uint8_t)(int8_t)rint(shape->positions[i] * 8);
        for (size_t i = 0; i < shape->index_count && i < 3 * MOST_FACES; i++)
            bytes[size++] = (uint8_t)shape->indices[i];
        taker->take(taker->user, bytes, size);
    }
    shape_free(shape);
}

void target_seeds(const struct seed_taker *taker)
{
    for (unsigned which = 0; which < TARGET_SHAPES; which++)
        for (unsigned how = which; how < 256; how += 131) {
            struct shape shape = target_shape(which);
            take_shape(taker, &shape, (uint8_t)how);
        }
    for (unsigned how = 1; how < 256; how += 84) {
        struct shape shape = shape_grid_with_holes(8, 8);
        take_shape(taker, &shape, (uint8_t)how);
        shape = shape_torus(12, 6);
        take_shape(taker, &shape, (uint8_t)(how + 20));
    }
}
