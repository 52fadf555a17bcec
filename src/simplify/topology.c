/*
 * The driver of topology simplification: chains of the store, features on the chains, surgery on
 * the store, and the result to a file. What can't be filled without making the mesh non-manifold is
 * given back, and the cut made again without it.
 */
#include "simplify/topology.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "mesh/import.h"
#include "simplify/simplify.h"
#include "simplify/topology_cracks.h"
#include "simplify/topology_handles.h"
#include "simplify/topology_planes.h"
#include "simplify/topology_surgery.h"
#include "simplify/topology_zip.h"

/* Patches that the first step of a fillet ends; without features as large as no sharp edge runs
 * through, to keep the graph small. Rings round smooth handles are made of such larger ones, too:
 * single triangles make none that has two sides. */
static const double fine_angle = 4, coarse_angle = 15;

/* Of the diagonal: the noise that must not hide a feature. */
static const double noise_share = 1e-3;

enum { BATCH = 4096 }; /* vertices or faces told at once; the surgery's are no larger */

enum blocking { BLOCKED_NOT = 0, BLOCKED_NOW = 1, BLOCKED_BEFORE = 2 };

struct run {
    struct context *ctx;
    const struct topology_options *options;
    struct topology_report *report;
    const char *output;
    struct store *store;
    const struct store_info *info;
    struct chain_file *chains;
    struct chain_graph graph;
    struct feature_list list;
    uint32_t *of_patch; /* a patch: its feature, or NO_INDEX */
    uint8_t *blocked;   /* a feature: enum blocking */
    size_t blocked_count;
    struct surgery surgery;
    struct exporter *exporter;
    struct mesh mesh;                      /* for merge_coplanar */
    const struct import_options *as_store; /* NULL: the output is a mesh file */
    const struct import_sink *import;
    struct store_info *store_made;
    uint64_t faces_given;
};

void topology_defaults(struct topology_options *options)
{
    *options = (struct topology_options){
        .sharp_angle = {45, 180}, .zip_tolerance = {.value = -1}, .coplanar_angle = 0.5};
}

void topology_report_clear(struct context *ctx, struct topology_report *report)
{
    memory_release(ctx, &report->features, report->feature_capacity, sizeof *report->features);
    memset(report, 0, sizeof *report);
}

static double diagonal_of(const struct store_info *info)
{
    return vec3_distance(vec3_load(info->box_low), vec3_load(info->box_high));
}

static double length_of(const struct run *run, struct length_option option)
{
    return option.value * (option.is_relative ? diagonal_of(run->info) : 1);
}

/* Cosines of two angles, by the one way there is to make them (patch_choose.c). */
static void cosines_of(const struct run *run, const double angles[2], double cosines[2])
{
    const struct target target = {.mode = MODE_CLASSIC, .effort = 1};
    struct patch_request request = {.smoothings = 0};
    struct patch_options chosen;
    memcpy(request.patch_angle, angles, sizeof request.patch_angle);
    patch_choose(run->info, &target, &request, &chosen);
    memcpy(cosines, chosen.patch_cosine, sizeof chosen.patch_cosine);
}

/* ---- chains and features ---- */

static bool needs_chains(const struct run *run)
{
    return run->options->max_feature.value > 0 || run->options->drop_components.value > 0;
}

static enum status open_chains(struct run *run, const char *store_path, const char *chain_path)
{
    const struct target target = {
        .kind = TARGET_FACES, .count = 1, .values = {1}, .mode = MODE_CLASSIC, .effort = 1};
    const struct topology_options *options = run->options;
    const bool is_fine = options->max_feature.value > 0 && !options->smooth_features;
    const double angle = is_fine ? fine_angle : coarse_angle;
    const struct patch_request request = {.patch_angle = {angle, angle},
                                          .face_angle = {angle, angle}};
    enum status status = chain_build(run->ctx, store_path, chain_path, &target, &request, NULL);
    if (status == STATUS_OK)
        status = chain_file_open(run->ctx, chain_path, &run->chains);
    if (status == STATUS_OK)
        status = chain_graph_open(run->ctx, run->chains, run->output, &run->graph);
    if (status == STATUS_OK)
        status =
            memory_take(run->ctx, run->graph.patch_count, sizeof *run->of_patch, &run->of_patch);
    if (status == STATUS_OK)
        memset(run->of_patch, 0xff, run->graph.patch_count * sizeof *run->of_patch);
    return status;
}

static enum status find_features(struct run *run)
{
    const struct topology_options *options = run->options;
    struct rim_options rims = {.size = length_of(run, options->max_feature),
                               .noise = noise_share * diagonal_of(run->info),
                               .measure = options->measure};
    enum status status = STATUS_OK;
    /* Chamfers of exactly 45 degrees are everywhere: rounding must not make them sharp. */
    const double sharp[2] = {options->sharp_angle[0] + 0.1, options->sharp_angle[1]};
    cosines_of(run, sharp, rims.sharp_cosine);
    if (options->sharp_angle[1] >= 180)
        rims.sharp_cosine[1] = -2;
    if (options->drop_components.value > 0)
        status = specks_find(&run->graph, length_of(run, options->drop_components), run->of_patch,
                             &run->list);
    if (status == STATUS_OK && rims.size > 0)
        status =
            features_find(&run->graph, &rims, !options->remove_pipes, run->of_patch, &run->list);
    if (status == STATUS_OK && rims.size > 0 && options->smooth_features)
        status = handles_find(&run->graph, rims.size, run->of_patch, &run->list);
    return status;
}

/* ---- surgery ---- */

/* Features that could not be filled stay: their patches are no one's. Cracks just stay open. */
static bool give_back_blocked(struct run *run, size_t features)
{
    bool any = false;
    for (size_t i = 0; i < features; i++)
        any |= run->blocked[i] == BLOCKED_NOW;
    if (!any)
        return false;
    for (uint32_t p = 0; p < run->graph.patch_count; p++)
        if (run->of_patch[p] != NO_INDEX && run->blocked[run->of_patch[p]])
            run->of_patch[p] = NO_INDEX;
    for (size_t i = 0; i < features; i++)
        if (run->blocked[i])
            run->blocked[i] = BLOCKED_BEFORE;
    return true;
}

/* Marks of features that cracks add to the list come with it. */
static enum status reserve_blocked(struct run *run)
{
    size_t old = run->blocked_count;
    if (run->list.count <= old)
        return STATUS_OK;
    enum status status =
        memory_resize(run->ctx, &run->blocked, old, run->list.count, sizeof *run->blocked);
    if (status == STATUS_OK) {
        memset(run->blocked + old, 0, run->list.count - old);
        run->blocked_count = run->list.count;
    }
    return status;
}

/* Cracks are added to the list; of the surgery's loops only what zipping leaves of them. */
static enum status find_cracks(struct run *run, const struct crack_options *cracks)
{
    double tolerance = length_of(run, run->options->zip_tolerance);
    enum status status = cracks_find(&run->surgery, cracks, &run->list);
    if (status == STATUS_OK && run->options->zip_tolerance.value < 0)
        status = zip_tolerance_choose(&run->surgery, &tolerance);
    run->report->zipped = 0;
    if (status == STATUS_OK && tolerance > 0)
        status = cracks_zip(&run->surgery, tolerance, &run->report->zipped);
    return status;
}

static enum status operate(struct run *run)
{
    const struct topology_options *options = run->options;
    const struct patch_options *growth =
        run->chains ? &chain_file_info(run->chains)->options : NULL;
    const struct crack_options cracks = {.size = length_of(run, options->close_cracks),
                                         .inscribed = options->crack_inscribed};
    enum status status = STATUS_OK;
    size_t features = run->list.count; /* without cracks */
    do {
        run->list.count = features;
        if (run->blocked_count > features)
            memset(run->blocked + features, BLOCKED_NOT, run->blocked_count - features);
        status = reserve_blocked(run);
        if (status == STATUS_OK)
            status = surgery_cut(&run->surgery, growth, run->of_patch, &run->list);
        if (status == STATUS_OK)
            status = surgery_loops(&run->surgery, run->blocked);
        if (status == STATUS_OK && cracks.size > 0)
            status = find_cracks(run, &cracks);
        if (status == STATUS_OK)
            status = reserve_blocked(run);
        if (status == STATUS_OK)
            status = surgery_fill(&run->surgery, run->blocked);
    } while (status == STATUS_OK && give_back_blocked(run, features));
    return status;
}

/* ---- the result ---- */

static enum status begin_file(void *user, uint64_t vertices, uint64_t faces)
{
    struct run *run = user;
    struct export_options export = run->options->export;
    export.as_float32 = run->info->is_float32;
    run->report->vertices = vertices;
    run->report->faces = faces;
    return export_open(run->ctx, run->output, &export, vertices, faces, &run->info->attributes,
                       &run->exporter);
}

static enum status vertices_to_file(void *user, size_t count, const double *positions,
                                    const unsigned char *records)
{
    return export_vertices(((struct run *)user)->exporter, count, positions, records);
}

static enum status faces_to_file(void *user, size_t count, const uint32_t *faces)
{
    return export_faces(((struct run *)user)->exporter, count, faces);
}

static enum status begin_mesh(void *user, uint64_t vertices, uint64_t faces)
{
    struct run *run = user;
    struct mesh *mesh = &run->mesh;
    uint32_t stride = run->info->attributes.stride;
    *mesh = (struct mesh){.vertex_count = vertices,
                          .face_count = faces,
                          .attributes = run->info->attributes,
                          .is_float32 = run->info->is_float32};
    enum status status =
        memory_take(run->ctx, 3 * vertices, sizeof *mesh->positions, &mesh->positions);
    if (status == STATUS_OK)
        status = memory_take(run->ctx, 3 * faces, sizeof *mesh->faces, &mesh->faces);
    if (status == STATUS_OK && stride)
        status = memory_take(run->ctx, vertices, stride, &mesh->records);
    run->report->vertices = run->report->faces = 0;
    return status;
}

static enum status vertices_to_mesh(void *user, size_t count, const double *positions,
                                    const unsigned char *records)
{
    struct run *run = user;
    size_t stride = run->info->attributes.stride, at = run->report->vertices;
    memcpy(run->mesh.positions + 3 * at, positions, 3 * count * sizeof *positions);
    if (stride)
        memcpy(run->mesh.records + at * stride, records, count * stride);
    run->report->vertices += count;
    return STATUS_OK;
}

static enum status faces_to_mesh(void *user, size_t count, const uint32_t *faces)
{
    struct run *run = user;
    memcpy(run->mesh.faces + 3 * run->report->faces, faces, 3 * count * sizeof *faces);
    run->report->faces += count;
    return STATUS_OK;
}

static size_t batch_size(uint64_t left)
{
    return left < BATCH ? (size_t)left : BATCH;
}

/* The mesh in memory, vertices first, in batches. */
static enum status give_mesh(struct run *run, const struct surgery_sink *sink)
{
    const struct mesh *mesh = &run->mesh;
    size_t stride = mesh->attributes.stride;
    enum status status = sink->begin(sink->user, mesh->vertex_count, mesh->face_count);
    for (uint64_t i = 0; i < mesh->vertex_count && status == STATUS_OK; i += BATCH)
        status =
            sink->add_vertices(sink->user, batch_size(mesh->vertex_count - i),
                               mesh->positions + 3 * i, stride ? mesh->records + i * stride : NULL);
    for (uint64_t i = 0; i < mesh->face_count && status == STATUS_OK; i += BATCH)
        status = sink->add_faces(sink->user, batch_size(mesh->face_count - i), mesh->faces + 3 * i);
    return status;
}

/* Tells the result to the sink, planes merged first if that is asked for. */
static enum status give_result(struct run *run, const struct surgery_sink *sink)
{
    const struct surgery_sink to_mesh = {begin_mesh, vertices_to_mesh, faces_to_mesh, run};
    const double angles[2] = {run->options->coplanar_angle, 0};
    double cosines[2];
    if (!run->options->merge_coplanar)
        return surgery_write(&run->surgery, sink);
    cosines_of(run, angles, cosines);
    enum status status = surgery_write(&run->surgery, &to_mesh);
    if (status == STATUS_OK)
        status = planes_merge(run->ctx, &run->mesh, cosines[0], 1e-5 * diagonal_of(run->info));
    return status == STATUS_OK ? give_mesh(run, sink) : status;
}

static enum status write_file(struct run *run)
{
    const struct surgery_sink sink = {begin_file, vertices_to_file, faces_to_file, run};
    enum status status = give_result(run, &sink);
    if (status == STATUS_OK)
        return export_commit(&run->exporter);
    if (run->exporter)
        export_discard(&run->exporter);
    return status;
}

/* ---- the result as a store ---- */

static enum status begin_store(void *user, uint64_t vertices, uint64_t faces)
{
    struct run *run = user;
    run->report->vertices = vertices;
    run->report->faces = faces;
    return run->import->begin(run->import->user, &run->info->attributes, false, vertices, faces);
}

static enum status vertices_to_store(void *user, size_t count, const double *positions,
                                     const unsigned char *records)
{
    struct run *run = user;
    float floats[3 * BATCH];
    if (!run->info->is_float32)
        return run->import->vertices(run->import->user, count, NULL, positions, records);
    for (size_t i = 0; i < 3 * count; i++)
        floats[i] = (float)positions[i];
    return run->import->vertices(run->import->user, count, floats, NULL, records);
}

static enum status faces_to_store(void *user, size_t count, const uint32_t *faces)
{
    struct run *run = user;
    run->faces_given += count;
    return run->import->faces(run->import->user, run->faces_given - count, count, NULL, faces);
}

static enum status feed_store(void *user, const struct import_sink *import)
{
    struct run *run = user;
    const struct surgery_sink sink = {begin_store, vertices_to_store, faces_to_store, run};
    run->import = import;
    return give_result(run, &sink);
}

static enum status write_store(struct run *run)
{
    const struct store_feed feed = {feed_store, run, run->info};
    return store_build_from(run->ctx, &feed, run->output, run->as_store, run->store_made);
}

static enum status fill_report(struct run *run)
{
    struct topology_report *report = run->report;
    const struct vec3 origin = vec3_load(run->info->origin);
    for (size_t i = 0; i < run->list.count; i++) {
        if (run->blocked[i]) {
            report->blocked++;
            continue;
        }
        enum status status = memory_reserve(run->ctx, &report->features, &report->feature_capacity,
                                            report->feature_count + 1, sizeof *report->features);
        if (status != STATUS_OK)
            return status;
        struct feature *feature = &report->features[report->feature_count++];
        *feature = run->list.features[i];
        vec3_store(feature->place, vec3_add(origin, vec3_load(feature->place)));
        report->counts[feature->kind]++;
    }
    report->dropped_faces = run->surgery.dropped_count;
    report->added_faces = run->surgery.mended_count + run->surgery.fill_count;
    return STATUS_OK;
}

static void run_clear(struct run *run)
{
    struct context *ctx = run->ctx;
    surgery_clear(&run->surgery);
    memory_release(ctx, &run->of_patch, run->graph.patch_count, sizeof *run->of_patch);
    memory_release(ctx, &run->blocked, run->blocked_count, sizeof *run->blocked);
    feature_list_clear(ctx, &run->list);
    if (run->graph.ctx)
        chain_graph_clear(&run->graph);
    chain_file_close(&run->chains);
    store_close(&run->store);
    mesh_clear(ctx, &run->mesh);
}

static enum status run_all(struct run *run, const char *store_path, const char *chain_path)
{
    struct context *ctx = run->ctx;
    enum status status = paths_must_differ(ctx, store_path, run->output);
    if (status == STATUS_OK)
        status = store_open(ctx, store_path, true, &run->store);
    if (status != STATUS_OK)
        return status;
    run->info = store_info(run->store);
    run->surgery.ctx = ctx;
    run->surgery.store = run->store;
    if (needs_chains(run)) {
        status = open_chains(run, store_path, chain_path);
        if (status == STATUS_OK)
            status = find_features(run);
    }
    if (status == STATUS_OK)
        status = surgery_begin(&run->surgery);
    if (status == STATUS_OK)
        status = operate(run);
    if (status == STATUS_OK && surgery_faces(&run->surgery) == 0)
        status = fail(ctx, STATUS_BAD_INPUT, "all components are small: nothing would be left");
    if (status == STATUS_OK)
        status = fill_report(run);
    if (status == STATUS_OK) /* last of all: a failure must not leave an output */
        status = run->as_store ? write_store(run) : write_file(run);
    run_clear(run);
    return status;
}

enum status topology_run(struct context *ctx, const char *store_path, const char *chain_path,
                         const char *output, const struct topology_options *options,
                         struct topology_report *report)
{
    struct run run = {.ctx = ctx, .options = options, .report = report, .output = output};
    return run_all(&run, store_path, chain_path);
}

enum status topology_rebuild(struct context *ctx, const char *store_path, const char *chain_path,
                             const char *output, const struct import_options *import,
                             const struct topology_options *options, struct topology_report *report,
                             struct store_info *info)
{
    struct run run = {.ctx = ctx,
                      .options = options,
                      .report = report,
                      .output = output,
                      .as_store = import,
                      .store_made = info};
    return run_all(&run, store_path, chain_path);
}
