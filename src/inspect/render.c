/*
 * The road of a picture: a box round all meshes, a camera that fits them; for each mesh the
 * vertices on the screen, the faces by bands of rows, and then band by band (several at once) the
 * z-buffer and the shading; hollows; onto the background; captions and legend.
 *
 * Memory: the picture (3 bytes a pixel), one mesh's layer (20 bytes a pixel), 12 bytes a vertex (24
 * if smooth), 4 bytes a face and a band a thread. Pixels depend on neither threads nor band
 * borders.
 */
#include "inspect/render.h"

#include <stdio.h>
#include <string.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "inspect/font.h"
#include "inspect/shade.h"

/* Of what is written: titles and details, on a light background and on a dark one. */
static const uint32_t inks[2][2] = {{0x2b3038, 0x6a7180}, {0xe6e9ee, 0x9aa3b2}};

/* Sizes in pixels that follow from the picture's. */
struct layout {
    double text;    /* height of capitals */
    uint32_t strip; /* below all pictures: captions, legend */
    uint32_t margin;
};

struct drawing {
    struct context *ctx;
    const struct render_options *options;
    struct picture *picture;

    /* The item being drawn. */
    struct camera camera;
    struct vec3 centre;
    uint32_t column; /* its first column in the picture */
    struct surface surface;
    struct screen_vertex *vertices;
    float *normals;
    struct raster_bins bins;
    struct layer layer;
    struct raster_band *bands; /* one a worker */
};

void render_defaults(struct render_options *options)
{
    *options =
        (struct render_options){.width = 1000, .height = 800, .flat = true, .background = 0xffffff};
}

/* ---- boxes and colours ---- */

struct box {
    double low[3], high[3];
};

static void box_add(struct box *box, const struct mesh *mesh)
{
    for (uint64_t i = 0; i < 3 * mesh->face_count; i++) {
        const double *p = mesh->positions + 3 * (size_t)mesh->faces[i];
        for (unsigned k = 0; k < 3; k++) {
            box->low[k] = fmin(box->low[k], p[k]);
            box->high[k] = fmax(box->high[k], p[k]);
        }
    }
}

static struct box box_empty(void)
{
    return (struct box){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
}

static double box_diagonal(const struct box *box)
{
    return box->low[0] <= box->high[0] ? vec3_distance(vec3_load(box->low), vec3_load(box->high))
                                       : 0;
}

static struct vec3 box_centre(const struct box *box)
{
    if (!(box->low[0] <= box->high[0]))
        return vec3_make(0, 0, 0);
    return vec3_scale(vec3_add(vec3_load(box->low), vec3_load(box->high)), 0.5);
}

/* The mesh's own red, green and blue, if they are bytes. */
static void find_colours(struct surface *surface)
{
    const struct attributes *attributes = &surface->mesh->attributes;
    static const char *const names[3] = {"red", "green", "blue"};
    const unsigned char *found[3] = {NULL, NULL, NULL};
    for (uint32_t i = 0; surface->mesh->records && i < attributes->count; i++)
        for (unsigned k = 0; k < 3; k++)
            if (attributes->list[i].type == SCALAR_UINT8 &&
                strcmp(attributes->list[i].name, names[k]) == 0)
                found[k] = surface->mesh->records + attributes->list[i].offset;
    if (!found[0] || !found[1] || !found[2])
        return;
    surface->red = found[0];
    surface->green = found[1];
    surface->blue = found[2];
    surface->colour_stride = attributes->stride;
}

/* ---- one mesh ---- */

static enum status smooth_normals(struct drawing *drawing)
{
    const struct mesh *mesh = drawing->surface.mesh;
    enum status status = memory_take_zeroed(drawing->ctx, (size_t)mesh->vertex_count,
                                            3 * sizeof(float), &drawing->normals);
    if (status != STATUS_OK)
        return status;
    for (uint64_t f = 0; f < mesh->face_count; f++) {
        const uint32_t *c = mesh->faces + 3 * f;
        struct vec3 normal =
            vec3_normalized(triangle_normal(vec3_load(mesh->positions + 3 * (size_t)c[0]),
                                            vec3_load(mesh->positions + 3 * (size_t)c[1]),
                                            vec3_load(mesh->positions + 3 * (size_t)c[2])));
        for (unsigned k = 0; k < 3; k++) {
            float *sum = drawing->normals + 3 * (size_t)c[k];
            sum[0] += (float)normal.x;
            sum[1] += (float)normal.y;
            sum[2] += (float)normal.z;
        }
    }
    drawing->surface.normals = drawing->normals;
    return STATUS_OK;
}

static enum status draw_band(void *user, uint64_t band, unsigned worker)
{
    struct drawing *drawing = user;
    const struct surface *surface = &drawing->surface;
    raster_draw(surface->vertices, surface->mesh->faces, &drawing->bins, (uint32_t)band,
                &drawing->bands[worker]);
    shade_band(surface, &drawing->camera, &drawing->bands[worker], &drawing->layer);
    return STATUS_OK;
}

/* Puts the rows of a band onto the background. */
static enum status finish_band(void *user, uint64_t band, unsigned worker)
{
    struct drawing *drawing = user;
    const struct layer *layer = &drawing->layer;
    uint32_t background = drawing->options->background;
    float *light = drawing->bands[worker].nearness; /* 16 floats a pixel of a row: 3 are enough */
    uint32_t first = (uint32_t)band * RASTER_BAND, end = first + RASTER_BAND;
    for (uint32_t row = first; row < end && row < layer->height; row++) {
        shade_hollows(layer, &drawing->camera, row, light);
        for (uint32_t column = 0; column < layer->width; column++) {
            float open = 1 - layer->coverage[(size_t)row * layer->width + column];
            unsigned char *to = drawing->picture->rgb + 3 * ((size_t)row * drawing->picture->width +
                                                             drawing->column + column);
            for (unsigned k = 0; k < 3; k++)
                to[k] = byte_of(light[3 * (size_t)column + k] +
                                open * light_of(background >> (16 - 8 * k)));
        }
    }
    return STATUS_OK;
}

static enum status draw_layers(struct drawing *drawing, uint32_t height)
{
    struct context *ctx = drawing->ctx;
    const struct mesh *mesh = drawing->surface.mesh;
    uint32_t width = drawing->options->width;
    uint32_t bands = (height + (RASTER_BAND - 1)) / RASTER_BAND;
    for (uint64_t v = 0; v < mesh->vertex_count; v++)
        drawing->vertices[v] =
            camera_project(&drawing->camera, drawing->centre, vec3_load(mesh->positions + 3 * v));
    drawing->surface.vertices = drawing->vertices;
    enum status status =
        raster_bin(ctx, drawing->vertices, mesh->faces, mesh->face_count, height, &drawing->bins);
    if (status == STATUS_OK)
        status = layer_create(ctx, width, height, &drawing->layer);
    if (status == STATUS_OK)
        status = parallel_for(ctx, bands, draw_band, drawing);
    if (status == STATUS_OK)
        status = parallel_for(ctx, bands, finish_band, drawing);
    return status;
}

static enum status draw_item(struct drawing *drawing, const struct render_item *item,
                             uint32_t height)
{
    struct context *ctx = drawing->ctx;
    size_t vertices = (size_t)item->mesh->vertex_count;
    drawing->surface = (struct surface){.mesh = item->mesh,
                                        .face_colours = item->face_colours,
                                        .wireframe = drawing->options->wireframe};
    if (!item->face_colours)
        find_colours(&drawing->surface);
    enum status status = memory_take(ctx, vertices, sizeof *drawing->vertices, &drawing->vertices);
    if (status == STATUS_OK && !drawing->options->flat)
        status = smooth_normals(drawing);
    if (status == STATUS_OK)
        status = draw_layers(drawing, height);
    layer_clear(ctx, &drawing->layer);
    raster_bins_clear(ctx, &drawing->bins);
    memory_release(ctx, &drawing->normals, vertices, 3 * sizeof(float));
    memory_release(ctx, &drawing->vertices, vertices, sizeof *drawing->vertices);
    return status;
}

/* ---- captions and legend ---- */

static uint32_t ink(const struct drawing *drawing, bool is_detail)
{
    uint32_t background = drawing->options->background;
    uint32_t lightness =
        299 * (background >> 16 & 255) + 587 * (background >> 8 & 255) + 114 * (background & 255);
    return inks[lightness < 128 * 1000][is_detail];
}

/* A line, centred at x; smaller if it would be wider than `width`, and cut if that is not enough.
 */
static void draw_line(struct picture *picture, const char *text, size_t length, double x, double y,
                      double size, double width, uint32_t colour)
{
    char line[256];
    length = length < sizeof line - 1 ? length : sizeof line - 1;
    memcpy(line, text, length);
    line[length] = 0;
    double needed = text_width(line, size);
    if (needed > width) {
        size = fmax(size * width / needed, 0.6 * size);
        while (length > 4 && text_width(line, size) > width) {
            length--;
            memcpy(line + length - 3, "...", 4);
        }
    }
    text_draw(picture, line, x - text_width(line, size) / 2, y, size, colour);
}

static void draw_caption(const struct drawing *drawing, const char *caption,
                         const struct layout *layout, double x, double y)
{
    double width = drawing->options->width - 2.0 * layout->margin, size = layout->text;
    uint32_t colour = ink(drawing, false);
    for (const char *at = caption; at && *at;) {
        size_t length = strcspn(at, "\n");
        draw_line(drawing->picture, at, length, x, y, size, width, colour);
        at += length + (at[length] == '\n');
        size = layout->text * 0.85; /* lines after the first are details */
        colour = ink(drawing, true);
        y += layout->text * 2;
    }
}

static void draw_legend(const struct drawing *drawing, const struct layout *layout, double y)
{
    const struct render_options *options = drawing->options;
    struct picture *picture = drawing->picture;
    int64_t length = (int64_t)(fmin(picture->width * 0.5, 40 * layout->text));
    int64_t left = ((int64_t)picture->width - length) / 2, top = (int64_t)y;
    int64_t height = (int64_t)(layout->text * 0.9) + 1;
    for (int64_t i = 0; i < length; i++)
        picture_rectangle(picture, left + i, top, 1, height,
                          colour_map((double)i / (double)(length - 1)));
    double label_y = (double)(top + height) + layout->text * 1.55, size = layout->text * 0.8;
    for (int i = 0; i <= 4; i++) {
        char label[32];
        double value = options->legend_low + (options->legend_high - options->legend_low) * i / 4;
        snprintf(label, sizeof label, "%.3g", value);
        double x = (double)left + (double)length * i / 4;
        picture_rectangle(picture, (int64_t)x - (i > 0), top + height, 1,
                          (int64_t)(layout->text * 0.3) + 1, ink(drawing, true));
        text_draw(picture, label, x - text_width(label, size) / 2, label_y, size,
                  ink(drawing, true));
    }
    draw_line(picture, options->legend_name, strlen(options->legend_name),
              (double)picture->width / 2, label_y + layout->text * 1.9, layout->text * 0.9,
              picture->width - 2.0 * layout->margin, ink(drawing, false));
}

static struct layout lay_out(const struct render_item *items, size_t count,
                             const struct render_options *options)
{
    struct layout layout = {.text = 6 + 0.008 * options->height};
    size_t lines = 0;
    for (size_t i = 0; i < count; i++) {
        size_t own = items[i].caption && items[i].caption[0] ? 1 : 0;
        for (const char *at = items[i].caption; at && *at; at++)
            own += *at == '\n' && at[1];
        lines = own > lines ? own : lines;
    }
    double strip = lines ? layout.text * (2.0 * (double)lines + 1.2) : 0;
    if (options->legend_name)
        strip += layout.text * 6.2;
    layout.strip = (uint32_t)strip;
    layout.margin = options->width / 32 + 2;
    return layout;
}

/* ---- the whole ---- */

/* What an item is looked at with. */
struct sight {
    struct vec3 centre;
    double radius;
    struct box box;
};

enum { SCALES_APART = 3 }; /* models that differ more in size are different things */

/* A common centre where the items lie in the same place, as levels of one model do; else their own.
 * *is_common_scale: one scale for all. */
static void choose_sights(const struct render_item *items, size_t count, struct sight *sights,
                          bool *is_common_scale)
{
    double largest = 0, smallest = INFINITY;
    struct box all = box_empty();
    for (size_t i = 0; i < count; i++) {
        struct box box = box_empty();
        box_add(&box, items[i].mesh);
        box_add(&all, items[i].mesh);
        double diagonal = box_diagonal(&box);
        sights[i] = (struct sight){box_centre(&box), diagonal / 2, box};
        largest = fmax(largest, diagonal);
        smallest = fmin(smallest, items[i].mesh->face_count ? diagonal : smallest);
    }
    *is_common_scale = largest <= SCALES_APART * smallest;
    if (!*is_common_scale)
        return;
    bool is_common_place = box_diagonal(&all) < 1.1 * largest;
    for (size_t i = 0; i < count; i++) {
        if (is_common_place)
            sights[i].centre = box_centre(&all);
        sights[i].radius = (is_common_place ? box_diagonal(&all) : largest) / 2;
        sights[i].box = all;
    }
}

static struct camera aim_at(const struct render_options *options, const struct sight *sight)
{
    struct camera camera;
    double view[3], up[3];
    memcpy(view, options->view, sizeof view);
    memcpy(up, options->up, sizeof up);
    camera_choose(sight->box.low, sight->box.high, view, up);
    camera_aim(&camera, view, up, sight->radius);
    return camera;
}

/* The camera for items [first, end), which have one scale. */
static struct camera fit_items(const struct render_options *options,
                               const struct render_item *items, const struct sight *sights,
                               size_t first, size_t end, double margin, double height)
{
    struct camera camera = aim_at(options, &sights[first]);
    struct frame frame = {INFINITY, INFINITY, -INFINITY, -INFINITY};
    for (size_t i = first; i < end; i++)
        camera_measure(&camera, items[i].mesh, sights[i].centre, &frame);
    if (!(frame.low_x <= frame.high_x))
        frame = (struct frame){-1, -1, 1, 1}; /* no faces at all */
    camera_fit(&camera, &frame, margin, margin, fmax(options->width - 2 * margin, 1),
               fmax(height - 2 * margin, 1));
    return camera;
}

static enum status draw_all(struct drawing *drawing, const struct render_item *items, size_t count,
                            struct sight *sights)
{
    const struct render_options *options = drawing->options;
    struct layout layout = lay_out(items, count, options);
    uint32_t height = options->height > layout.strip + 4 ? options->height - layout.strip : 4;
    bool is_common_scale;
    choose_sights(items, count, sights, &is_common_scale);

    enum status status = STATUS_OK;
    for (size_t i = 0; i < count && status == STATUS_OK; i++) {
        if (i == 0 || !is_common_scale)
            drawing->camera = fit_items(options, items, sights, i, is_common_scale ? count : i + 1,
                                        layout.margin, height);
        drawing->centre = sights[i].centre;
        drawing->column = (uint32_t)i * options->width;
        status = draw_item(drawing, &items[i], height);
        if (status == STATUS_OK)
            status = step(drawing->ctx, "picture", i + 1, count);
    }
    double below = height + layout.text * 1.2;
    for (size_t i = 0; i < count && status == STATUS_OK; i++)
        draw_caption(drawing, items[i].caption, &layout, ((double)i + 0.5) * options->width, below);
    if (status == STATUS_OK && options->legend_name)
        draw_legend(drawing, &layout, (double)drawing->picture->height - layout.text * 6.2);
    return status;
}

static enum status check_options(struct context *ctx, const struct render_item *items,
                                 size_t item_count, const struct render_options *options)
{
    if (item_count == 0)
        return fail(ctx, STATUS_MISUSE, "a picture needs at least one mesh");
    if (options->width < 16 || options->height < 16)
        return fail(ctx, STATUS_MISUSE, "a picture of %u x %u pixels is too small", options->width,
                    options->height);
    for (size_t i = 0; i < item_count; i++)
        for (uint64_t k = 0; k < 3 * items[i].mesh->face_count; k++)
            if (items[i].mesh->faces[k] >= items[i].mesh->vertex_count)
                return fail(ctx, STATUS_BAD_INPUT, "face %llu: vertex %u does not exist",
                            (unsigned long long)(k / 3), items[i].mesh->faces[k]);
    return STATUS_OK;
}

enum status render_png(struct context *ctx, const char *path, const struct render_item *items,
                       size_t item_count, const struct render_options *options)
{
    struct picture picture = {0};
    struct drawing drawing = {.ctx = ctx, .options = options, .picture = &picture};
    struct sight *sights = NULL;
    enum status status = check_options(ctx, items, item_count, options);
    if (status != STATUS_OK)
        return status;
    uint64_t width = item_count > PICTURE_SIDE_MAX ? UINT64_MAX : item_count * options->width;
    status = picture_create(ctx, width, options->height, options->background, &picture);
    if (status == STATUS_OK)
        status = memory_take(ctx, item_count, sizeof *sights, &sights);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, ctx->threads, sizeof *drawing.bands, &drawing.bands);
    for (unsigned i = 0; i < ctx->threads && status == STATUS_OK; i++)
        status = raster_band_create(ctx, options->width, &drawing.bands[i]);
    if (status == STATUS_OK)
        status = draw_all(&drawing, items, item_count, sights);
    if (status == STATUS_OK)
        status = picture_write_png(ctx, path, &picture);

    for (unsigned i = 0; drawing.bands && i < ctx->threads; i++)
        raster_band_clear(ctx, &drawing.bands[i]);
    memory_release(ctx, &drawing.bands, ctx->threads, sizeof *drawing.bands);
    memory_release(ctx, &sights, item_count, sizeof *sights);
    picture_clear(ctx, &picture);
    return status;
}
