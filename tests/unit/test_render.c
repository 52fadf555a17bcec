/*
 * Pictures: where the mesh is and where not, what hides what, colours, captions, and that the same
 * bytes come out every time. Pictures are read back with libpng.
 */
#include <math.h>
#include <png.h>
#include <stdlib.h>
#include <string.h>

#include "inspect/font.h"
#include "inspect/render.h"
#include "test_files.h"
#include "test_kit.h"
#include "test_shapes.h"

struct pixels {
    uint32_t width, height;
    unsigned char *rgb;
};

static struct pixels read_png(const char *path)
{
    png_image image = {.version = PNG_IMAGE_VERSION};
    struct pixels pixels = {0, 0, NULL};
    assert_true(png_image_begin_read_from_file(&image, path));
    image.format = PNG_FORMAT_RGB;
    pixels.width = image.width;
    pixels.height = image.height;
    pixels.rgb = malloc(PNG_IMAGE_SIZE(image));
    assert_non_null(pixels.rgb);
    assert_true(png_image_finish_read(&image, NULL, pixels.rgb, 0, NULL));
    return pixels;
}

static const unsigned char *pixel_at(const struct pixels *pixels, uint32_t x, uint32_t y)
{
    return pixels->rgb + 3 * ((size_t)y * pixels->width + x);
}

static bool is_colour(const unsigned char *pixel, uint32_t colour)
{
    return pixel[0] == colour >> 16 && pixel[1] == (colour >> 8 & 255) &&
           pixel[2] == (colour & 255);
}

/* Pixels of a rectangle that are not the background. */
static size_t count_ink(const struct pixels *pixels, uint32_t x0, uint32_t y0, uint32_t x1,
                        uint32_t y1, uint32_t background)
{
    size_t count = 0;
    for (uint32_t y = y0; y < y1; y++)
        for (uint32_t x = x0; x < x1; x++)
            count += !is_colour(pixel_at(pixels, x, y), background);
    return count;
}

/* Renders meshes of one context; `threads` 0: one. */
static struct pixels render(struct context *ctx, const struct render_item *items, size_t count,
                            const struct render_options *options)
{
    if (render_png(ctx, test_path("picture.png"), items, count, options) != STATUS_OK)
        fail_msg("%s", ctx->error);
    return read_png(test_path("picture.png"));
}

static struct render_options small_options(void)
{
    struct render_options options;
    render_defaults(&options);
    options.width = 200;
    options.height = 160;
    options.background = 0x203040;
    return options;
}

struct fixture {
    struct context ctx;
    struct mesh mesh;
};

static void begin(struct fixture *fixture, struct shape shape)
{
    context_init(&fixture->ctx);
    shape_into_mesh(&fixture->ctx, &shape, &fixture->mesh);
}

static void end(struct fixture *fixture)
{
    mesh_clear(&fixture->ctx, &fixture->mesh);
    assert_int_equal(fixture->ctx.memory_now, 0);
    context_clear(&fixture->ctx);
}

static void sphere_fills_a_disk(void **state)
{
    (void)state;
    struct fixture f;
    begin(&f, shape_icosphere(4));
    struct render_options options = small_options();
    struct render_item item = {.mesh = &f.mesh};
    struct pixels p = render(&f.ctx, &item, 1, &options);
    assert_int_equal(p.width, 200);
    assert_int_equal(p.height, 160);
    assert_true(is_colour(pixel_at(&p, 0, 0), 0x203040));
    assert_true(is_colour(pixel_at(&p, 199, 159), 0x203040));
    /* The disk touches the margins above and below: its area is that of a circle. */
    size_t ink = count_ink(&p, 0, 0, 200, 160, 0x203040);
    double radius = (160 - 2 * (200 / 32 + 2)) / 2.0;
    assert_true(fabs((double)ink / (3.14159265 * radius * radius) - 1) < 0.05);
    /* No holes inside, and light comes from the upper left. */
    for (uint32_t y = 40; y < 120; y++)
        for (uint32_t x = 70; x < 130; x++)
            assert_false(is_colour(pixel_at(&p, x, y), 0x203040));
    assert_true(pixel_at(&p, 75, 50)[1] > pixel_at(&p, 125, 110)[1] + 40);
    free(p.rgb);

    options.flat = false;
    p = render(&f.ctx, &item, 1, &options);
    assert_true(count_ink(&p, 0, 0, 200, 160, 0x203040) == ink);
    free(p.rgb);
    end(&f);
}

/* Two squares one behind the other, seen along z; the nearer one hides the other whatever their
 * order. */
static void nearer_hides_farther(void **state)
{
    (void)state;
    for (int swapped = 0; swapped < 2; swapped++) {
        struct shape shape = {0};
        for (int i = 0; i < 2; i++) {
            float z = (i ^ swapped) ? 1 : 0, half = z > 0 ? 0.5f : 1;
            uint32_t a = shape_vertex(&shape, -half, -half, z),
                     b = shape_vertex(&shape, half, -half, z),
                     c = shape_vertex(&shape, half, half, z),
                     d = shape_vertex(&shape, -half, half, z);
            shape_triangle(&shape, a, b, c);
            shape_triangle(&shape, a, c, d);
        }
        struct fixture f;
        begin(&f, shape);
        uint32_t near = 0xff0000, far = 0x0000ff;
        uint32_t colours[4] = {swapped ? near : far, swapped ? near : far, swapped ? far : near,
                               swapped ? far : near};
        struct render_options options = small_options();
        options.view[2] = 1;
        options.up[1] = 1;
        struct render_item item = {.mesh = &f.mesh, .face_colours = colours};
        struct pixels p = render(&f.ctx, &item, 1, &options);
        const unsigned char *middle = pixel_at(&p, 100, 80);
        assert_true(middle[0] > 100 && middle[2] < middle[0] / 2);
        const unsigned char *edge = pixel_at(&p, 100, 12);
        assert_true(edge[2] > 100 && edge[0] < edge[2] / 2);
        free(p.rgb);
        end(&f);
    }
}

static void back_faces_are_tinted(void **state)
{
    (void)state;
    struct shape inside = shape_icosphere(2);
    for (size_t i = 0; i < inside.face_count; i++)
        shape_flip(&inside, i);
    struct fixture f, g;
    begin(&f, shape_icosphere(2));
    begin(&g, inside);
    struct render_options options = small_options();
    struct render_item item = {.mesh = &f.mesh};
    struct pixels front = render(&f.ctx, &item, 1, &options);
    item.mesh = &g.mesh;
    struct pixels back = render(&g.ctx, &item, 1, &options);
    const unsigned char *p = pixel_at(&front, 90, 70), *q = pixel_at(&back, 90, 70);
    assert_true(p[0] < p[2] + 40);
    assert_true(q[0] > q[2] + 60);
    free(front.rgb);
    free(back.rgb);
    end(&f);
    end(&g);
}

static void vertex_colours_are_used(void **state)
{
    (void)state;
    struct fixture f;
    begin(&f, shape_icosphere(2));
    f.mesh.attributes = (struct attributes){
        .count = 3,
        .stride = 3,
        .list = {{"blue", SCALAR_UINT8, 0}, {"green", SCALAR_UINT8, 1}, {"red", SCALAR_UINT8, 2}}};
    unsigned char *records = calloc((size_t)f.mesh.vertex_count, 3);
    for (uint64_t v = 0; v < f.mesh.vertex_count; v++)
        records[3 * v + 1] = 200;
    f.mesh.records = records;
    struct render_options options = small_options();
    struct render_item item = {.mesh = &f.mesh};
    struct pixels p = render(&f.ctx, &item, 1, &options);
    const unsigned char *middle = pixel_at(&p, 100, 80);
    assert_true(middle[1] > 100 && middle[0] < 90 && middle[2] < 90);
    free(p.rgb);
    free(records);
    f.mesh.records = NULL;
    f.mesh.attributes = (struct attributes){.count = 0};
    end(&f);
}

static double mean_light(const struct pixels *pixels)
{
    double sum = 0;
    for (size_t i = 0; i < (size_t)3 * pixels->width * pixels->height; i++)
        sum += pixels->rgb[i];
    return sum / 3 / pixels->width / pixels->height;
}

static void wireframe_darkens(void **state)
{
    (void)state;
    struct fixture f;
    begin(&f, shape_icosphere(2));
    struct render_options options = small_options();
    struct render_item item = {.mesh = &f.mesh};
    struct pixels plain = render(&f.ctx, &item, 1, &options);
    options.wireframe = true;
    struct pixels lines = render(&f.ctx, &item, 1, &options);
    assert_true(mean_light(&lines) < mean_light(&plain) - 5);
    assert_int_equal(count_ink(&lines, 0, 0, 200, 160, 0x203040),
                     count_ink(&plain, 0, 0, 200, 160, 0x203040));
    free(plain.rgb);
    free(lines.rgb);
    end(&f);
}

/* Side by side: the same mesh twice is the same picture twice; a smaller mesh is drawn smaller. */
static void side_by_side(void **state)
{
    (void)state;
    struct fixture f, g;
    begin(&f, shape_icosphere(3));
    struct shape half = shape_icosphere(3);
    shape_move(&half, 0.5, 0, 0, 0);
    begin(&g, half);
    struct render_options options = small_options();
    struct render_item items[3] = {{.mesh = &f.mesh}, {.mesh = &f.mesh}, {.mesh = &g.mesh}};
    struct pixels p = render(&f.ctx, items, 3, &options);
    assert_int_equal(p.width, 600);
    for (uint32_t y = 0; y < 160; y++)
        assert_memory_equal(pixel_at(&p, 0, y), pixel_at(&p, 200, y), 600);
    double large = (double)count_ink(&p, 0, 0, 200, 160, 0x203040);
    double small = (double)count_ink(&p, 400, 0, 600, 160, 0x203040);
    assert_true(small / large > 0.22 && small / large < 0.29);
    free(p.rgb);
    end(&f);
    end(&g);
}

static void captions_and_legend(void **state)
{
    (void)state;
    struct fixture f;
    begin(&f, shape_icosphere(1));
    struct render_options options = small_options();
    options.height = 300;
    struct render_item item = {.mesh = &f.mesh, .caption = "One\n80 faces"};
    struct pixels p = render(&f.ctx, &item, 1, &options);
    assert_true(count_ink(&p, 0, 265, 200, 300, 0x203040) > 60);
    free(p.rgb);

    options.legend_name = "distance";
    options.legend_high = 0.25;
    p = render(&f.ctx, &item, 1, &options);
    /* Both ends of the colour map are to be found. */
    size_t low = 0, high = 0;
    for (uint32_t y = 200; y < 300; y++) {
        for (uint32_t x = 0; x < 200; x++) {
            low += is_colour(pixel_at(&p, x, y), colour_map(0));
            high += is_colour(pixel_at(&p, x, y), colour_map(1));
        }
    }
    assert_true(low > 3 && high > 3);
    free(p.rgb);

    /* Captions of any length and bytes do no harm. */
    char text[400];
    for (size_t i = 0; i < sizeof text - 1; i++)
        text[i] = (char)(1 + i % 255);
    text[sizeof text - 1] = 0;
    item.caption = text;
    p = render(&f.ctx, &item, 1, &options);
    free(p.rgb);
    end(&f);
}

static void same_bytes_for_any_threads(void **state)
{
    (void)state;
    struct fixture f;
    begin(&f, shape_noisy_torus(60, 40, 0.02, 9));
    struct render_options options = small_options();
    options.wireframe = true;
    struct render_item item = {.mesh = &f.mesh, .caption = "torus"};
    unsigned char *first = NULL;
    size_t first_size = 0;
    for (unsigned threads = 1; threads < 5; threads++) {
        f.ctx.threads = threads;
        size_t size;
        assert_int_equal(render_png(&f.ctx, test_path("picture.png"), &item, 1, &options),
                         STATUS_OK);
        unsigned char *bytes = file_read(test_path("picture.png"), &size);
        if (first) {
            assert_int_equal(size, first_size);
            assert_memory_equal(bytes, first, size);
            free(bytes);
        } else {
            first = bytes;
            first_size = size;
        }
    }
    free(first);
    end(&f);
}

/* Every glyph has ink, stays within its cell, and letters differ from each other. */
static void every_letter_is_drawn(void **state)
{
    (void)state;
    struct context ctx;
    struct picture cells[95];
    context_init(&ctx);
    for (int i = 0; i < 95; i++) {
        char text[2] = {(char)(32 + i), 0};
        assert_int_equal(picture_create(&ctx, 60, 60, 0xffffff, &cells[i]), STATUS_OK);
        text_draw(&cells[i], text, 10, 40, 24, 0);
        struct pixels p = {60, 60, cells[i].rgb};
        size_t ink = count_ink(&p, 0, 0, 60, 60, 0xffffff);
        assert_true(i == 0 ? ink == 0 : ink > 8);
        double width = text_width(text, 24);
        assert_true(width > 0 && width < 34);
        assert_int_equal(count_ink(&p, 10 + (uint32_t)ceil(width) + 2, 0, 60, 60, 0xffffff), 0);
        for (int j = 0; j < i; j++)
            assert_true(memcmp(cells[i].rgb, cells[j].rgb, 60 * 60 * 3) != 0);
    }
    for (int i = 0; i < 95; i++)
        picture_clear(&ctx, &cells[i]);
    assert_int_equal(ctx.memory_now, 0);
    context_clear(&ctx);
}

static double lightness(uint32_t colour)
{
    return 0.2126 * (colour >> 16) + 0.7152 * (colour >> 8 & 255) + 0.0722 * (colour & 255);
}

static void colours(void **state)
{
    (void)state;
    assert_int_equal(colour_map(0), 0x440154);
    assert_int_equal(colour_map(0.5), 0x21918c);
    assert_int_equal(colour_map(1), 0xfde725);
    assert_int_equal(colour_map(-3), colour_map(0));
    assert_int_equal(colour_map(7), colour_map(1));
    assert_int_equal(colour_map((double)NAN), colour_map(0));
    for (int i = 1; i <= 1000; i++)
        assert_true(lightness(colour_map(i / 1000.0)) >=
                    lightness(colour_map((i - 1) / 1000.0)) - 1);
    for (uint32_t i = 0; i < 2000; i++) {
        for (uint32_t j = 1; j < 8; j++) {
            uint32_t a = colour_distinct(i), b = colour_distinct(i + j);
            int apart = abs((int)(a >> 16) - (int)(b >> 16)) +
                        abs((int)(a >> 8 & 255) - (int)(b >> 8 & 255)) +
                        abs((int)(a & 255) - (int)(b & 255));
            assert_true(apart > 20);
        }
    }
}

static void misuse_and_emptiness(void **state)
{
    (void)state;
    struct fixture f;
    struct shape empty = {0};
    begin(&f, empty);
    struct render_options options = small_options();
    struct render_item item = {.mesh = &f.mesh};
    struct pixels p = render(&f.ctx, &item, 1, &options);
    assert_int_equal(count_ink(&p, 0, 0, 200, 160, 0x203040), 0);
    free(p.rgb);
    assert_int_equal(render_png(&f.ctx, test_path("none.png"), &item, 0, &options), STATUS_MISUSE);
    options.width = 4;
    assert_int_equal(render_png(&f.ctx, test_path("none.png"), &item, 1, &options), STATUS_MISUSE);
    options.width = 1000000;
    assert_int_equal(render_png(&f.ctx, test_path("none.png"), &item, 1, &options), STATUS_MISUSE);
    size_t size;
    assert_null(file_read(test_path("none.png"), &size));
    end(&f);

    /* A flat mesh seen from its edge, a point-like one, one far away: no crash, and a picture. */
    struct shape odd[3] = {shape_grid(3, 3), shape_single_triangle(), shape_icosphere(1)};
    shape_move(&odd[1], 1e-30, 0, 0, 0);
    shape_move(&odd[2], 10, 5e6, 4e6, 100);
    for (int i = 0; i < 3; i++) {
        begin(&f, odd[i]);
        options = small_options();
        if (i == 0)
            options.view[0] = options.up[0] = 1;
        item.mesh = &f.mesh;
        p = render(&f.ctx, &item, 1, &options);
        assert_true(i == 0 || count_ink(&p, 0, 0, 200, 160, 0x203040) > 1000);
        free(p.rgb);
        end(&f);
    }
}

static void failing_calls(void **state)
{
    (void)state;
    bool done = false;
    for (uint64_t n = 0; !done; n++) {
        struct fixture f;
        begin(&f, shape_icosphere(1));
        struct render_options options = small_options();
        options.flat = false;
        struct render_item item = {.mesh = &f.mesh, .caption = "a"};
        atomic_store(&f.ctx.fault_after, n);
        enum status status = render_png(&f.ctx, test_path("faulty.png"), &item, 1, &options);
        done = status == STATUS_OK;
        assert_true(done || f.ctx.error[0]);
        size_t size;
        unsigned char *bytes = file_read(test_path("faulty.png"), &size);
        assert_true(!bytes == !done);
        free(bytes);
        end(&f);
        assert_true(n < 1000);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sphere_fills_a_disk),   cmocka_unit_test(nearer_hides_farther),
        cmocka_unit_test(back_faces_are_tinted), cmocka_unit_test(vertex_colours_are_used),
        cmocka_unit_test(wireframe_darkens),     cmocka_unit_test(side_by_side),
        cmocka_unit_test(captions_and_legend),   cmocka_unit_test(same_bytes_for_any_threads),
        cmocka_unit_test(every_letter_is_drawn), cmocka_unit_test(colours),
        cmocka_unit_test(misuse_and_emptiness),  cmocka_unit_test(failing_calls),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
