/*
 * What a file's beginning tells of its size: right where the file tells it, near where it must be
 * scaled up, and never more than the bytes could hold.
 */
#include "mesh/estimate.h"
#include "test_kit.h"
#include "test_files.h"
#include "test_gzip.h"
#include "test_shapes.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static struct mesh_estimate estimate_of(const char *path)
{
    struct context ctx;
    struct mesh_estimate estimate;
    context_init(&ctx);
    assert_int_equal(mesh_estimate(&ctx, path, &estimate), STATUS_OK);
    assert_string_equal(ctx.error, "");
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
    return estimate;
}

static void within(uint64_t found, uint64_t right, uint64_t factor)
{
    if (found > right * factor || found * factor < right)
        fail_msg("%llu is not within a factor of %llu of %llu", (unsigned long long)found,
                 (unsigned long long)factor, (unsigned long long)right);
}

static void formats_that_tell(void **state)
{
    (void)state;
    static const enum shape_format formats[] = {SHAPE_PLY_ASCII, SHAPE_PLY_LITTLE, SHAPE_OFF,
                                                SHAPE_STL_BINARY};
    const char *path = test_path("mesh");
    struct shape shape = shape_icosphere(3);
    for (unsigned i = 0; i < 4; i++) {
        shape_write(&shape, formats[i], path);
        struct mesh_estimate found = estimate_of(path);
        assert_true(found.is_counted);
        assert_int_equal(found.faces, shape.face_count);
        assert_int_equal(found.is_soup, formats[i] == SHAPE_STL_BINARY);
        assert_int_equal(found.is_text, i == 0 || i == 2);
        if (!found.is_soup)
            assert_int_equal(found.vertices, shape.vertex_count);
    }
    shape_free(&shape);
}

/* 200,000 vertices before the first face, and a soup of text. */
static void formats_that_do_not_tell(void **state)
{
    (void)state;
    const char *plain = test_path("mesh.obj"), *zipped = test_path("mesh.obj.gz");
    struct shape shape = shape_grid(500, 400);
    size_t size;
    unsigned char *data = shape_encode(&shape, SHAPE_OBJ, &size);
    file_write(plain, data, size);
    gzip_write(zipped, data, size);
    free(data);
    const char *const paths[] = {plain, zipped};
    for (unsigned i = 0; i < 2; i++) {
        struct mesh_estimate found = estimate_of(paths[i]);
        assert_false(found.is_counted);
        assert_true(found.is_text);
        assert_int_equal(found.is_gzip, i);
        within(found.vertices, shape.vertex_count, 3);
        within(found.faces, shape.face_count, 3);
    }
    shape_write(&shape, SHAPE_STL_ASCII, plain);
    struct mesh_estimate found = estimate_of(plain);
    assert_true(found.is_soup);
    within(found.faces, shape.face_count, 2);
    shape_free(&shape);
}

static void claims_are_not_believed(void **state)
{
    (void)state;
    static const char text[] =
        "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\n"
        "property float x\nproperty float y\nproperty float z\nelement face 4000000000\n"
        "property list uchar int vertex_indices\nend_header\n0000";
    const char *plain = test_path("lie.ply"), *zipped = test_path("lie.ply.gz");
    file_write(plain, text, sizeof text);
    gzip_write(zipped, text, sizeof text);
    assert_in_range(estimate_of(plain).faces, 0, sizeof text);
    assert_in_range(estimate_of(plain).vertices, 0, 3 * sizeof text);
    assert_in_range(estimate_of(zipped).faces, 0, 1032 * sizeof text);
}

static void what_is_no_mesh_is_nothing(void **state)
{
    (void)state;
    const char *path = test_path("notes.txt");
    file_write(path, "Dear colleague\n", 15);
    const char *const paths[] = {path, "-", "/", "/dev/zero", "/nonexistent/in.ply", ""};
    for (unsigned i = 0; i < sizeof paths / sizeof *paths; i++) {
        struct mesh_estimate found = estimate_of(paths[i]);
        assert_int_equal(found.faces, 0);
        assert_int_equal(found.vertices, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(formats_that_tell),
        cmocka_unit_test(formats_that_do_not_tell),
        cmocka_unit_test(claims_are_not_believed),
        cmocka_unit_test(what_is_no_mesh_is_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
