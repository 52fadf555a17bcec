/*
 * Pixels and PNG. libpng reports errors by longjmp; everything that must survive one lives in a
 * struct that the jump cannot clobber. Neither time nor software is written into the file.
 */
#include "inspect/picture.h"

#include <math.h>
#include <png.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"

unsigned char byte_of(float light)
{
    float value = light > 0 ? sqrtf(light) * 255 + 0.5f : 0;
    return value >= 255 ? 255 : (unsigned char)value;
}

enum status picture_create(struct context *ctx, uint64_t width, uint64_t height, uint32_t colour,
                           struct picture *picture)
{
    memset(picture, 0, sizeof *picture);
    if (width == 0 || height == 0 || width > PICTURE_SIDE_MAX || height > PICTURE_SIDE_MAX)
        return fail(ctx, STATUS_MISUSE, "a picture of %llu x %llu pixels is not possible",
                    (unsigned long long)width, (unsigned long long)height);
    enum status status = memory_take(ctx, (size_t)(width * height), 3, &picture->rgb);
    if (status != STATUS_OK)
        return status;
    picture->width = (uint32_t)width;
    picture->height = (uint32_t)height;
    picture_rectangle(picture, 0, 0, (int64_t)width, (int64_t)height, colour);
    return STATUS_OK;
}

void picture_clear(struct context *ctx, struct picture *picture)
{
    memory_release(ctx, &picture->rgb, (size_t)picture->width * picture->height, 3);
    memset(picture, 0, sizeof *picture);
}

void picture_blend(struct picture *picture, int64_t x, int64_t y, uint32_t colour, double share)
{
    if (x < 0 || y < 0 || x >= picture->width || y >= picture->height)
        return;
    unsigned char *at = picture->rgb + 3 * ((size_t)y * picture->width + (size_t)x);
    for (unsigned k = 0; k < 3; k++) {
        float below = light_of(at[k]), above = light_of(colour >> (16 - 8 * k));
        at[k] = byte_of(below + (float)share * (above - below));
    }
}

void picture_rectangle(struct picture *picture, int64_t x, int64_t y, int64_t width, int64_t height,
                       uint32_t colour)
{
    for (int64_t row = y < 0 ? 0 : y; row < y + height && row < picture->height; row++) {
        unsigned char *at = picture->rgb + 3 * (size_t)row * picture->width;
        for (int64_t column = x < 0 ? 0 : x; column < x + width && column < picture->width;
             column++)
            for (unsigned k = 0; k < 3; k++)
                at[3 * column + k] = (unsigned char)(colour >> (16 - 8 * k));
    }
}

/* ---- PNG ---- */

struct png_job {
    struct context *ctx;
    struct output output;
    enum status status; /* of the output; the first failure */
    char text[128];     /* libpng's own complaint */
};

static void write_bytes(png_structp png, png_bytep data, png_size_t size)
{
    struct png_job *job = png_get_io_ptr(png);
    job->status = output_append(&job->output, data, size);
    if (job->status != STATUS_OK)
        png_error(png, "writing failed");
}

static void flush_bytes(png_structp png)
{
    (void)png;
}

static void note_error(png_structp png, png_const_charp text)
{
    struct png_job *job = png_get_error_ptr(png);
    snprintf(job->text, sizeof job->text, "%s", text);
    png_longjmp(png, 1);
}

static void ignore_warning(png_structp png, png_const_charp text)
{
    (void)png;
    (void)text;
}

/* False after an error of libpng; job->status or job->text then tells which. */
static bool encode(struct png_job *job, const struct picture *picture)
{
    png_structp png =
        png_create_write_struct(PNG_LIBPNG_VER_STRING, job, note_error, ignore_warning);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    if (!info) {
        png_destroy_write_struct(&png, NULL);
        job->status = fail(job->ctx, STATUS_NO_MEMORY, "not enough memory for a PNG");
        return false;
    }
    if (setjmp(png_jmpbuf(png))) {
        png_destroy_write_struct(&png, &info);
        return false;
    }
    png_set_write_fn(png, job, write_bytes, flush_bytes);
    png_set_IHDR(png, info, picture->width, picture->height, 8, PNG_COLOR_TYPE_RGB,
                 PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_compression_level(png, 6);
    png_write_info(png, info);
    for (uint32_t row = 0; row < picture->height; row++)
        png_write_row(png, picture->rgb + 3 * (size_t)row * picture->width);
    png_write_end(png, info);
    png_destroy_write_struct(&png, &info);
    return true;
}

enum status picture_write_png(struct context *ctx, const char *path, const struct picture *picture)
{
    struct png_job job = {.ctx = ctx, .status = STATUS_OK};
    enum status status = output_open(ctx, path, &job.output);
    if (status != STATUS_OK)
        return status;
    if (!encode(&job, picture)) {
        if (job.status == STATUS_OK)
            job.status = fail(ctx, STATUS_INTERNAL, "%s: libpng: %s", path, job.text);
        output_discard(&job.output);
        return job.status;
    }
    return output_commit(&job.output, true);
}
