/*
 * Light that shows shape: a main lamp from the upper left that follows the eye, a weak cool one
 * from the right, sky and ground, a little gloss, and a rim where the surface turns away. Faces
 * seen from behind have a warm colour of their own.
 *
 * Samples of one face in a pixel are shaded together, at their mean. Edges need no lines: a sample
 * that is closer to an edge of its own face than half a line's width belongs to the line, so the
 * z-buffer hides lines as it hides faces, and the samples make them smooth.
 *
 * Hollows are darkened by what the picture itself knows, the distances of the pixels round about
 * (after M. Mittring, "Finding next gen: CryEngine 2", 2007): the share of the sky that higher
 * neighbours hide, against the pixel's own tangent plane.
 */
#include "inspect/shade.h"

#include <string.h>

#include "base/memory.h"

enum { PIXEL_SAMPLES = RASTER_SAMPLES * RASTER_SAMPLES };

static const float line_half_width = 0.55f; /* pixels */
static const float line_strength = 0.8f;
static const float crease_cosine = 0.72f; /* smooth normals farther off stay with their face */

struct colour {
    float red, green, blue;
};

struct vec3f {
    float x, y, z;
};

static struct colour colour_of(uint32_t rgb)
{
    return (struct colour){light_of(rgb >> 16), light_of(rgb >> 8), light_of(rgb)};
}

static struct colour mix(struct colour a, struct colour b, float share)
{
    return (struct colour){a.red + share * (b.red - a.red), a.green + share * (b.green - a.green),
                           a.blue + share * (b.blue - a.blue)};
}

static float dot(struct vec3f a, struct vec3f b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static struct vec3f unit(struct vec3f a)
{
    float length = sqrtf(dot(a, a));
    return length > 0 ? (struct vec3f){a.x / length, a.y / length, a.z / length}
                      : (struct vec3f){0, 0, 1};
}

enum status layer_create(struct context *ctx, uint32_t width, uint32_t height, struct layer *layer)
{
    size_t pixels = (size_t)width * height;
    *layer = (struct layer){.width = width, .height = height};
    enum status status = memory_take_zeroed(ctx, pixels, 3 * sizeof(float), &layer->colour);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, pixels, sizeof(float), &layer->coverage);
    if (status == STATUS_OK)
        status = memory_take_zeroed(ctx, pixels, sizeof(float), &layer->distance);
    return status;
}

void layer_clear(struct context *ctx, struct layer *layer)
{
    size_t pixels = (size_t)layer->width * layer->height;
    memory_release(ctx, &layer->colour, pixels, 3 * sizeof(float));
    memory_release(ctx, &layer->coverage, pixels, sizeof(float));
    memory_release(ctx, &layer->distance, pixels, sizeof(float));
    memset(layer, 0, sizeof *layer);
}

/* ---- one face in one pixel ---- */

/* Unit vectors to the lamps, in the eye's frame: x right, y up, z to the eye. */
static const struct vec3f main_lamp = {-0.4472f, 0.5963f, 0.6666f};
static const struct vec3f side_lamp = {0.8305f, 0.0830f, 0.5508f};
static const struct vec3f gloss_half = {-0.2450f, 0.3266f, 0.9129f}; /* between main lamp and eye */

/* `is_data`: the colour means something and is to be found in a legend, so light changes it less.
 */
static struct colour lit(struct colour base, struct vec3f normal, bool is_data)
{
    float lamp = dot(normal, main_lamp), side = dot(normal, side_lamp);
    float half = dot(normal, gloss_half);
    lamp = lamp > -0.15f ? (lamp + 0.15f) / 1.15f : 0;
    side = side > 0 ? side : 0;
    float sky = 0.5f + 0.5f * normal.y;
    float gloss = half > 0 ? half * half : 0;
    gloss *= gloss;
    gloss *= gloss;
    gloss *= gloss;
    gloss *= gloss; /* to the 32nd */
    float away = normal.z > 0 ? 1 - normal.z : 1, rim = away * away * away;
    struct colour light = {0.98f * lamp + 0.09f * side + 0.05f + 0.12f * sky,
                           0.95f * lamp + 0.11f * side + 0.055f + 0.14f * sky,
                           0.89f * lamp + 0.17f * side + 0.065f + 0.17f * sky};
    if (is_data)
        light = mix((struct colour){1, 1, 1}, light, 0.7f);
    float shine = 0.07f * gloss + 0.10f * rim;
    return (struct colour){base.red * light.red + shine, base.green * light.green + shine,
                           base.blue * light.blue + shine};
}

/* A face as set up for the pixels that see it. */
struct seen_face {
    uint32_t number;
    const uint32_t *corner;
    const struct screen_vertex *at[3];
    float inverse_area; /* of the face on the screen, signed */
    bool is_front;
    struct vec3f normal; /* towards the eye */
};

static struct vec3f to_eye(const struct camera *camera, struct vec3 normal)
{
    return unit((struct vec3f){(float)vec3_dot(normal, camera->right),
                               (float)vec3_dot(normal, camera->up),
                               (float)vec3_dot(normal, camera->back)});
}

static void set_up_face(const struct surface *surface, const struct camera *camera, uint32_t number,
                        struct seen_face *face)
{
    const struct mesh *mesh = surface->mesh;
    face->number = number;
    face->corner = mesh->faces + 3 * (size_t)number;
    struct vec3 p[3];
    for (unsigned k = 0; k < 3; k++) {
        face->at[k] = &surface->vertices[face->corner[k]];
        p[k] = vec3_load(mesh->positions + 3 * (size_t)face->corner[k]);
    }
    float area = (face->at[1]->x - face->at[0]->x) * (face->at[2]->y - face->at[0]->y) -
                 (face->at[1]->y - face->at[0]->y) * (face->at[2]->x - face->at[0]->x);
    face->is_front = area < 0; /* y is down */
    face->inverse_area = area != 0 ? 1 / area : 0;
    struct vec3 normal = vec3_normalized(triangle_normal(p[0], p[1], p[2]));
    face->normal = to_eye(camera, face->is_front ? normal : vec3_scale(normal, -1));
}

/* Weights of the corners at a place on the screen; true to the perspective. */
static void weights_at(const struct seen_face *face, float x, float y, float weight[3])
{
    float sum = 0;
    for (unsigned k = 0; k < 3; k++) {
        const struct screen_vertex *b = face->at[k == 2 ? 0 : k + 1];
        const struct screen_vertex *c = face->at[k == 0 ? 2 : k - 1];
        float w = ((c->x - b->x) * (y - b->y) - (c->y - b->y) * (x - b->x)) * face->inverse_area;
        weight[k] = (w > 0 ? w : 0) * face->at[k]->nearness;
        sum += weight[k];
    }
    for (unsigned k = 0; k < 3; k++)
        weight[k] = sum > 0 ? weight[k] / sum : 1.0f / 3;
}

static struct vec3f normal_at(const struct surface *surface, const struct camera *camera,
                              const struct seen_face *face, const float weight[3])
{
    struct vec3f sum = {0, 0, 0};
    for (unsigned k = 0; k < 3; k++) {
        struct vec3 smooth = vec3_load_float(surface->normals + 3 * (size_t)face->corner[k]);
        struct vec3f normal = to_eye(camera, face->is_front ? smooth : vec3_scale(smooth, -1));
        if (dot(normal, face->normal) < crease_cosine)
            normal = face->normal;
        sum.x += weight[k] * normal.x;
        sum.y += weight[k] * normal.y;
        sum.z += weight[k] * normal.z;
    }
    return unit(sum);
}

static struct colour base_colour(const struct surface *surface, const struct seen_face *face,
                                 const float weight[3])
{
    struct colour colour = colour_of(0xcfc8bd);
    bool has_own = surface->face_colours || surface->red;
    if (surface->face_colours) {
        colour = colour_of(surface->face_colours[face->number]);
    } else if (surface->red) {
        colour = (struct colour){0, 0, 0};
        for (unsigned k = 0; k < 3; k++) {
            size_t at = surface->colour_stride * face->corner[k];
            colour.red += weight[k] * light_of(surface->red[at]);
            colour.green += weight[k] * light_of(surface->green[at]);
            colour.blue += weight[k] * light_of(surface->blue[at]);
        }
    }
    return face->is_front ? colour : mix(colour, colour_of(0xb4553f), has_own ? 0.55f : 0.9f);
}

/* Share of the samples that lie on an edge of the face, less for faces as small as the line. */
static float line_share(const struct seen_face *face, const float (*places)[2], unsigned count)
{
    float size = face->inverse_area != 0 ? fabsf(1 / face->inverse_area) : 0, longest = 0;
    float length[3];
    for (unsigned k = 0; k < 3; k++) {
        const struct screen_vertex *a = face->at[k], *b = face->at[k == 2 ? 0 : k + 1];
        float dx = b->x - a->x, dy = b->y - a->y;
        length[k] = sqrtf(dx * dx + dy * dy);
        longest = length[k] > longest ? length[k] : longest;
    }
    float thickness = longest > 0 ? size / longest / RASTER_SAMPLES : 0; /* pixels */
    float fade = (thickness - 1.2f) / 4;
    fade = fade < 0 ? 0 : fade > 1 ? 1 : fade;
    unsigned on_line = 0;
    for (unsigned i = 0; i < count; i++) {
        for (unsigned k = 0; k < 3; k++) {
            const struct screen_vertex *a = face->at[k], *b = face->at[k == 2 ? 0 : k + 1];
            float beyond =
                (b->x - a->x) * (places[i][1] - a->y) - (b->y - a->y) * (places[i][0] - a->x);
            if (fabsf(beyond) < line_half_width * RASTER_SAMPLES * length[k]) {
                on_line++;
                break;
            }
        }
    }
    return count ? fade * line_strength * (float)on_line / (float)count : 0;
}

static struct colour shade_face(const struct surface *surface, const struct camera *camera,
                                const struct seen_face *face, const float (*places)[2],
                                unsigned count)
{
    float x = 0, y = 0, weight[3] = {1.0f / 3, 1.0f / 3, 1.0f / 3};
    if (surface->normals || surface->red) {
        for (unsigned i = 0; i < count; i++) {
            x += places[i][0];
            y += places[i][1];
        }
        weights_at(face, x / (float)count, y / (float)count, weight);
    }
    struct vec3f normal = face->normal;
    if (surface->normals)
        normal = normal_at(surface, camera, face, weight);
    struct colour colour =
        lit(base_colour(surface, face, weight), normal, surface->face_colours != NULL);
    if (surface->wireframe)
        colour = mix(colour, colour_of(0x1f2636), line_share(face, places, count));
    return colour;
}

/* ---- a band ---- */

/* The samples of one pixel, face by face. */
static void shade_pixel(const struct surface *surface, const struct camera *camera,
                        const struct raster_band *band, uint32_t column, uint32_t row_in_band,
                        struct seen_face *last, float colour[3], float *coverage, float *distance)
{
    uint32_t faces[PIXEL_SAMPLES];
    float places[PIXEL_SAMPLES][2], nearness = 0;
    unsigned left = 0;
    for (unsigned j = 0; j < RASTER_SAMPLES; j++) {
        uint32_t y = row_in_band * RASTER_SAMPLES + j;
        for (unsigned i = 0; i < RASTER_SAMPLES; i++) {
            uint32_t x = column * RASTER_SAMPLES + i;
            size_t sample = (size_t)y * band->width + x;
            if (band->face[sample] == NO_INDEX)
                continue;
            faces[left] = band->face[sample];
            places[left][0] = (float)x + 0.5f;
            places[left++][1] = (float)(band->top + y) + 0.5f;
            nearness += band->nearness[sample];
        }
    }
    if (left == 0)
        return;
    *coverage = (float)left / PIXEL_SAMPLES;
    *distance = (float)left / nearness;
    while (left > 0) {
        float group[PIXEL_SAMPLES][2];
        unsigned count = 0, kept = 0;
        uint32_t face = faces[0];
        for (unsigned i = 0; i < left; i++) {
            if (faces[i] == face) {
                memcpy(group[count++], places[i], sizeof group[0]);
            } else {
                faces[kept] = faces[i];
                memmove(places[kept++], places[i], sizeof places[0]);
            }
        }
        left = kept;
        if (last->number != face)
            set_up_face(surface, camera, face, last);
        struct colour shaded = shade_face(surface, camera, last, (const float(*)[2])group, count);
        float share = (float)count / PIXEL_SAMPLES;
        colour[0] += share * shaded.red;
        colour[1] += share * shaded.green;
        colour[2] += share * shaded.blue;
    }
}

void shade_band(const struct surface *surface, const struct camera *camera,
                const struct raster_band *band, struct layer *layer)
{
    struct seen_face last = {.number = NO_INDEX};
    uint32_t top = band->top / RASTER_SAMPLES;
    for (uint32_t row = 0; row < RASTER_BAND && top + row < layer->height; row++) {
        for (uint32_t column = 0; column < layer->width; column++) {
            size_t pixel = (size_t)(top + row) * layer->width + column;
            shade_pixel(surface, camera, band, column, row, &last, layer->colour + 3 * pixel,
                        &layer->coverage[pixel], &layer->distance[pixel]);
        }
    }
}

/* ---- hollows ---- */

enum { RING_PLACES = 12, RINGS = 5 };

/* Unit circle in twelfths. */
static const float circle[RING_PLACES][2] = {
    {1, 0},  {0.8660f, 0.5f},   {0.5f, 0.8660f},   {0, 1},  {-0.5f, 0.8660f}, {-0.8660f, 0.5f},
    {-1, 0}, {-0.8660f, -0.5f}, {-0.5f, -0.8660f}, {0, -1}, {0.5f, -0.8660f}, {0.8660f, -0.5f}};

/* Rings' radii as shares of the picture's height. */
static const float rings[RINGS] = {0.004f, 0.009f, 0.019f, 0.038f, 0.07f};

static float distance_at(const struct layer *layer, int64_t x, int64_t y)
{
    if (x < 0 || y < 0 || x >= layer->width || y >= layer->height)
        return 0;
    return layer->distance[(size_t)y * layer->width + (size_t)x];
}

/* The distance's slope per pixel: of the two sides the flatter one, which is the same surface. */
static float slope(float before, float here, float after)
{
    float left = before > 0 ? here - before : 0, right = after > 0 ? after - here : 0;
    if (!(before > 0))
        return right;
    if (!(after > 0))
        return left;
    return fabsf(left) < fabsf(right) ? left : right;
}

static float openness(const struct layer *layer, const struct camera *camera, int64_t x, int64_t y)
{
    float here = distance_at(layer, x, y), hidden = 0;
    float slope_x = slope(distance_at(layer, x - 1, y), here, distance_at(layer, x + 1, y));
    float slope_y = slope(distance_at(layer, x, y - 1), here, distance_at(layer, x, y + 1));
    /* A pixel's width in eye distances, like the distances themselves. */
    float pixel = here / (float)camera->scale;
    for (unsigned ring = 0; ring < RINGS; ring++) {
        float radius = rings[ring] * (float)layer->height;
        radius = radius > 1.5f ? radius : 1.5f;
        for (unsigned i = 0; i < RING_PLACES; i++) {
            /* Every other ring is turned by half a step. */
            const float *a = circle[i], *b = circle[(i + ring % 2) % RING_PLACES];
            float dx = radius * 0.5f * (a[0] + b[0]), dy = radius * 0.5f * (a[1] + b[1]);
            int64_t ix = (int64_t)floorf(dx + 0.5f), iy = (int64_t)floorf(dy + 0.5f);
            float there = distance_at(layer, x + ix, y + iy);
            if (!(there > 0))
                continue;
            float height = here + slope_x * (float)ix + slope_y * (float)iy - there;
            float width = radius * pixel;
            float rise = height / sqrtf(height * height + width * width) - 0.12f;
            if (rise <= 0)
                continue;
            /* What is far in front belongs to something else. */
            float apart = height / (6 * width);
            hidden += rise / (1 + apart * apart);
        }
    }
    float open = 1 - 1.25f * hidden / (RINGS * RING_PLACES);
    return open < 0.25f ? 0.25f : open;
}

void shade_hollows(const struct layer *layer, const struct camera *camera, uint32_t row, float *out)
{
    for (uint32_t column = 0; column < layer->width; column++) {
        size_t pixel = (size_t)row * layer->width + column;
        float open = layer->coverage[pixel] > 0 ? openness(layer, camera, column, row) : 1;
        for (unsigned k = 0; k < 3; k++)
            out[3 * (size_t)column + k] = open * layer->colour[3 * pixel + k];
    }
}
