/* What patch_choose makes of a store and of what the user asked for. */
#include <math.h>
#include <string.h>

#include "simplify/simplify.h"
#include "test_kit.h"

static struct store_info info_of(double noise, uint64_t faces, double evenness)
{
    struct store_info info = {.noise = noise, .mean_edge = 0.5};
    info.topology.faces = faces;
    info.area = evenness * (double)faces * 0.25;
    info.box_high[0] = 3;
    info.box_high[1] = 4;
    return info;
}

static struct patch_request open_request(void)
{
    return (struct patch_request){
        .patch_angle = {-1, -1}, .face_angle = {-1, -1}, .smoothings = -1, .chain_tolerance = -1};
}

/* Cosines are libm's to the last bit or the one before, and exact where they are simple. */
static void cosines_are_right(void **unused)
{
    (void)unused;
    struct store_info info = info_of(0.01, 1000, 0.4);
    struct target target = {.mode = MODE_CLASSIC};
    struct patch_options options;
    for (unsigned i = 0; i <= 3600; i++) {
        double degrees = i * 0.05;
        struct patch_request request = open_request();
        request.patch_angle[0] = degrees;
        patch_choose(&info, &target, &request, &options);
        assert_true(fabs(options.patch_cosine[0] - cos(degrees * (acos(-1) / 180))) < 4e-16);
        assert_true(options.patch_cosine[0] >= -1 && options.patch_cosine[0] <= 1);
    }
    static const double simple[][2] = {{0, 1}, {90, 0}, {180, -1}, {1000, -1}};
    for (unsigned i = 0; i < 4; i++) {
        struct patch_request request = open_request();
        request.face_angle[1] = simple[i][0];
        patch_choose(&info, &target, &request, &options);
        assert_true(options.face_cosine[1] == simple[i][1]);
    }
}

static void defaults_fit_mode_and_noise(void **unused)
{
    (void)unused;
    static const struct {
        double noise, evenness;
        uint64_t faces;
        bool noisy;
    } cases[] = {
        {0.037, 0.406, 871414, false},  /* a clean dense scan */
        {0.0659, 0.36, 1087716, true},  /* a noisy one */
        {0.1175, 0.363, 3062768, true}, /* voxel terraces */
        {0.1347, 0.399, 12946, false},  /* a part with sharp edges, evenly triangulated */
        {0.3441, 0.135, 43368, false},  /* a part of long thin triangles */
        {0, 0, 0, false},               /* nothing */
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        struct store_info info = info_of(cases[i].noise, cases[i].faces, cases[i].evenness);
        struct patch_request request = open_request();
        struct patch_options classic, collapse;
        struct target target = {.mode = MODE_CLASSIC};
        patch_choose(&info, &target, &request, &classic);
        /* 25 and 20 degrees, or 15 and 12 */
        const double patch = cases[i].noisy ? 0.9063077870366499 : 0.9659258262890683;
        const double face = cases[i].noisy ? 0.9396926207859084 : 0.9781476007338057;
        assert_true(fabs(classic.patch_cosine[0] - patch) < 1e-15);
        assert_true(fabs(classic.face_cosine[0] - face) < 1e-15);
        assert_true(classic.patch_cosine[1] == 0 && classic.face_cosine[1] == 0);
        assert_int_equal(classic.smoothings, cases[i].noisy);
        assert_int_equal(classic.most_faces, PATCH_FACES_MAX);
        target.mode = MODE_COLLAPSE;
        patch_choose(&info, &target, &request, &collapse);
        assert_true(collapse.patch_cosine[0] > classic.patch_cosine[0]);
        assert_true(collapse.smoothings > classic.smoothings);
    }
}

static void requests_win(void **unused)
{
    (void)unused;
    struct store_info info = info_of(0.2, 1000000, 0.4);
    struct target target = {.mode = MODE_COLLAPSE};
    struct patch_request request = {.patch_angle = {60, 120},
                                    .face_angle = {-1, 0},
                                    .smoothings = 0,
                                    .chain_tolerance = 0.01,
                                    .chain_tolerance_is_relative = true};
    struct patch_options options;
    patch_choose(&info, &target, &request, &options);
    assert_true(fabs(options.patch_cosine[0] - 0.5) < 1e-15);
    assert_true(fabs(options.patch_cosine[1] + 0.5) < 1e-15);
    assert_true(options.face_cosine[1] == 1);
    assert_int_equal(options.smoothings, 0);
    assert_true(fabs(options.chain_tolerance - 0.05) < 1e-15); /* the diagonal is 5 */
    request.chain_tolerance_is_relative = false;
    patch_choose(&info, &target, &request, &options);
    assert_true(options.chain_tolerance == 0.01);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cosines_are_right),
        cmocka_unit_test(defaults_fit_mode_and_noise),
        cmocka_unit_test(requests_win),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
