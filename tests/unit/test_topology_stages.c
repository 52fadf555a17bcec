/*
 * Topology simplification as a part of a whole run: the same bytes as topology first and the stages
 * after it, fewer faces than any run that keeps the topology can reach, and words about what went.
 */
#include "test_kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "spbm.h"
#include "test_alike.h"
#include "test_files.h"
#include "test_parts.h"

struct place {
    char folder[TEST_PATH], part[TEST_PATH], plain[TEST_PATH], one[TEST_PATH], two[TEST_PATH];
    spbm_job *job;
    spbm_topology_options topology;
    spbm_simplify_options simplify;
    spbm_simplify_report *report;
    unsigned heard;
};

static void hear(void *user, const spbm_feature *feature)
{
    struct place *place = user;
    assert_int_equal(feature->kind, SPBM_HOLE);
    assert_int_equal(feature->loops, 2);
    place->heard++;
}

static int set_up(void **state)
{
    struct place *place = calloc(1, sizeof *place);
    struct part_plate plate = part_fixture(4);
    struct shape shape = plate_shape(&plate);
    folder_make(place->folder);
    shape_write(&shape, SHAPE_PLY_LITTLE, folder_path(place->part, place->folder, "part.ply"));
    folder_path(place->plain, place->folder, "plain.ply");
    folder_path(place->one, place->folder, "one.ply");
    folder_path(place->two, place->folder, "two.ply");
    shape_free(&shape);
    plate_free(&plate);
    place->report = calloc(1, sizeof *place->report);
    spbm_topology_defaults(&place->topology);
    place->topology.max_feature.value = 0.7;
    spbm_simplify_defaults(&place->simplify);
    place->simplify.target.count = 1;
    assert_int_equal(spbm_job_open(NULL, &place->job), SPBM_OK);
    *state = place;
    return 0;
}

static int tear_down(void **state)
{
    struct place *place = *state;
    spbm_job_close(&place->job);
    folder_remove(place->folder);
    free(place->report);
    free(place);
    return 0;
}

static spbm_status simplify(struct place *place, const char *from, const char *to, double faces)
{
    place->simplify.target.values[0] = faces;
    return spbm_simplify(place->job, &from, 1, to, &place->simplify, place->report);
}

static void a_run_is_its_steps(void **state)
{
    struct place *place = *state;
    const char *part = place->part;
    for (int merge = 0; merge < 2; merge++) {
        place->topology.merge_coplanar = merge;
        assert_int_equal(
            spbm_simplify_topology(place->job, &part, 1, place->plain, &place->topology, NULL),
            SPBM_OK);
        for (int mode = SPBM_COLLAPSE; mode <= SPBM_CLASSIC; mode++) {
            double faces = merge ? 12 : 60;
            place->simplify.target.mode = (spbm_mode)mode;
            place->simplify.topology = NULL;
            assert_int_equal(simplify(place, place->plain, place->one, faces), SPBM_OK);
            assert_int_equal(place->report->stage_count, 3);
            assert_false(place->report->has_topology);
            place->simplify.topology = &place->topology;
            assert_int_equal(simplify(place, place->part, place->two, faces), SPBM_OK);
            assert_int_equal(place->report->stage_count, 4);
            files_must_be_alike(place->one, place->two);
        }
    }
}

static void counts_below_the_floor(void **state)
{
    struct place *place = *state;
    for (int mode = SPBM_COLLAPSE; mode <= SPBM_CLASSIC; mode++) {
        place->simplify.target.mode = (spbm_mode)mode;
        place->simplify.topology = NULL;
        assert_int_equal(simplify(place, place->part, place->one, 12), SPBM_TARGET_MISSED);
        const spbm_level *level = &place->report->levels.levels[0];
        assert_int_equal(level->stop, SPBM_STOP_TOPOLOGY);
        assert_true(level->faces >= place->report->levels.floor);
        assert_true(place->report->levels.floor > 12);

        place->simplify.topology = &place->topology;
        place->topology.removed = hear;
        place->topology.user = place;
        place->heard = 0;
        assert_int_equal(simplify(place, place->part, place->two, 12), SPBM_OK);
        assert_in_range(level->faces, 11, 12);
        assert_true(place->report->has_topology);
        assert_int_equal(place->heard, 16);
        assert_int_equal(place->report->removal.counts[SPBM_HOLE], 16);
        assert_int_equal(place->report->store.topology.euler, 2 - 2 * 16);
        assert_int_equal(place->report->chains.topology.euler, 2);
        assert_int_equal(place->report->removal.faces, place->report->chains.topology.faces);
        assert_int_equal(spbm_check(place->job, place->two, NULL), SPBM_OK);
    }
    assert_int_equal(folder_count(place->folder), 3);
}

/* From a chain file on, too: features go in both modes, and ratios are of the first store. */
static void chains_lose_features(void **state)
{
    struct place *place = *state;
    char store[TEST_PATH], chains[TEST_PATH];
    spbm_simplify_report *report = place->report;
    const char *part = place->part;
    spbm_target target = place->simplify.target;
    folder_path(store, place->folder, "part.store");
    folder_path(chains, place->folder, "part.chains");
    assert_int_equal(spbm_import(place->job, &part, 1, store, NULL, NULL), SPBM_OK);
    place->topology.removed = hear;
    place->topology.user = place;
    for (int mode = SPBM_COLLAPSE; mode <= SPBM_CLASSIC; mode++) {
        target.mode = (spbm_mode)mode;
        target.kind = SPBM_BY_FACES;
        target.values[0] = 12;
        assert_int_equal(spbm_patchify(place->job, store, chains, &target, NULL, NULL), SPBM_OK);
        for (int by_ratio = 0; by_ratio < 2; by_ratio++) {
            place->heard = 0;
            assert_int_equal(spbm_lod_topology(place->job, chains, place->two, &target, NULL,
                                               &place->topology, report),
                             SPBM_OK);
            assert_string_equal(report->stages[0].name, "unfold");
            assert_int_equal(report->stage_count, 4);
            assert_in_range(report->levels.levels[0].faces, 11, 12);
            assert_int_equal(place->heard, 16);
            assert_int_equal(report->removal.counts[SPBM_HOLE], 16);
            assert_int_equal(report->chains.topology.euler, 2);
            assert_int_equal(spbm_check(place->job, place->two, NULL), SPBM_OK);
            target.kind = SPBM_BY_RATIO;
            target.values[0] = 12.5 / (double)report->levels.original_faces;
        }
        target.kind = SPBM_BY_FACES;
        target.values[0] = 12;
        assert_int_equal(
            spbm_lod_topology(place->job, store, place->two, &target, NULL, &place->topology, NULL),
            SPBM_BAD_INPUT);
    }
    assert_int_equal(folder_count(place->folder), 4);
}

/* One job of each kind on the part, all topology options in it. */
static void run_with(struct place *place, unsigned threads, uint64_t memory,
                     const char *const out[3])
{
    const char *part = place->part;
    char store[TEST_PATH], chains[TEST_PATH];
    spbm_settings settings;
    spbm_job *job;
    spbm_settings_defaults(&settings);
    settings.threads = threads;
    settings.memory = memory;
    assert_int_equal(spbm_job_open(&settings, &job), SPBM_OK);
    folder_path(store, place->folder, "part.store");
    folder_path(chains, place->folder, "part.chains");
    place->simplify.topology = &place->topology;
    place->simplify.target.values[0] = 12;
    assert_int_equal(spbm_import(job, &part, 1, store, NULL, NULL), SPBM_OK);
    assert_int_equal(spbm_patchify(job, store, chains, &place->simplify.target, NULL, NULL),
                     SPBM_OK);
    assert_int_equal(spbm_simplify_topology(job, &part, 1, out[0], &place->topology, NULL),
                     SPBM_OK);
    assert_int_equal(spbm_simplify(job, &part, 1, out[1], &place->simplify, NULL), SPBM_OK);
    assert_int_equal(spbm_lod_topology(job, chains, out[2], &place->simplify.target, NULL,
                                       &place->topology, NULL),
                     SPBM_OK);
    spbm_job_close(&job);
}

static void threads_and_memory_change_no_byte(void **state)
{
    struct place *place = *state;
    static const unsigned threads[] = {1, 2, 3, 8};
    static const uint64_t memories[] = {0, UINT64_C(160) << 20};
    char names[6][TEST_PATH];
    for (unsigned i = 0; i < 6; i++) {
        char name[] = "out0.ply";
        name[3] = (char)('0' + i);
        folder_path(names[i], place->folder, name);
    }
    const char *first[] = {names[0], names[1], names[2]}, *other[] = {names[3], names[4], names[5]};
    place->topology.drop_components.value = 0.1;
    place->topology.close_cracks.value = 0.1;
    place->topology.smooth_features = 1;
    place->topology.merge_coplanar = 1;
    run_with(place, 1, 0, first);
    for (unsigned i = 0; i < 8; i++) {
        run_with(place, threads[i % 4], memories[i / 4], other);
        for (unsigned k = 0; k < 3; k++)
            files_must_be_alike(first[k], other[k]);
    }
}

/* What is kept is a store and a chain file of what is left. */
static void kept_files_are_of_what_is_left(void **state)
{
    struct place *place = *state;
    char kept[TEST_PATH], store[TEST_PATH];
    spbm_file_figures *figures = calloc(1, sizeof *figures);
    place->simplify.keep_dir = folder_path(kept, place->folder, "kept");
    place->simplify.topology = &place->topology;
    assert_int_equal(simplify(place, place->part, place->one, 50), SPBM_OK);
    folder_path(store, kept, "mesh.store");
    assert_int_equal(spbm_check(place->job, store, NULL), SPBM_OK);
    assert_int_equal(spbm_info(place->job, store, figures), SPBM_OK);
    assert_int_equal(figures->store.topology.euler, 2);
    assert_string_equal(figures->store.input_name, "part.ply");
    assert_int_equal(figures->store.input_digest, place->report->store.input_digest);
    free(figures);
    assert_int_equal(folder_remove(kept), 2);
}

static void nonsense_is_refused_first(void **state)
{
    struct place *place = *state;
    place->simplify.topology = &place->topology;
    place->topology.max_feature.value = 0;
    assert_int_equal(simplify(place, "/nonexistent.ply", place->one, 50), SPBM_MISUSE);
    place->topology.max_feature.value = -1;
    assert_int_equal(simplify(place, "/nonexistent.ply", place->one, 50), SPBM_MISUSE);
    assert_int_equal(folder_count(place->folder), 1);
}

#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)

int main(void)
{
    const struct CMUnitTest tests[] = {
        TEST(a_run_is_its_steps),
        TEST(counts_below_the_floor),
        TEST(chains_lose_features),
        TEST(threads_and_memory_change_no_byte),
        TEST(kept_files_are_of_what_is_left),
        TEST(nonsense_is_refused_first),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
