/*
 * Which patches fit a scan. Constant angles do not: scanner noise shatters patches that are grown on
 * raw normals, and smoothing a clean CAD part rounds off the edges that should bound its patches.
 * What is known of the store is its noise: the RMS distance of a vertex from its neighbours' mean
 * plane, as a fraction of the mean edge. On a clean, densely sampled surface it is about the edge's
 * angle on the curvature (below 0.1); on noisy scans and voxel terraces it is far above.
 *
 * The angles are those that did best on real scans (DESIGN.md, prototype-sweep.tsv): mode collapse
 * wants fine patches, since what a patch loses is its bulge; mode classic the paper's, section 4.2.3.
 *
 * Angles become cosines here, once, by a series in a fixed order: a libm may differ in the last bit
 * from machine to machine, and so would the patches.
 */
#include <math.h>

#include "simplify/simplify.h"

/* Noise above which face normals are smoothed before patches grow on them. */
static const double noise_smooth = 0.08;
static const double noise_heavy = 0.16;

/* cos(x) or sin(x) for 0 <= x <= pi / 4, to rounding: Taylor's series, smallest terms first. */
static double cosine_series(double x)
{
    double square = x * x, sum = 0;
    for (int n = 20; n >= 2; n -= 2)
        sum = (1 + sum) * (-square / (n * (n - 1)));
    return 1 + sum;
}

static double sine_series(double x)
{
    double square = x * x, sum = 0;
    for (int n = 21; n >= 3; n -= 2)
        sum = (1 + sum) * (-square / (n * (n - 1)));
    return x * (1 + sum);
}

/* Of an angle in degrees; angles outside [0, 180] count as the nearer end. Exact at 0, 90, 180. */
static double cosine_of_degrees(double degrees)
{
    const double radian = 0.017453292519943295;
    if (!(degrees > 0))
        return 1;
    if (degrees >= 180)
        return -1;
    if (degrees > 90)
        return -cosine_of_degrees(180 - degrees);
    if (degrees <= 45)
        return cosine_series(degrees * radian);
    return sine_series((90 - degrees) * radian);
}

/* Angles in degrees and smoothings that fit the store. */
struct choice {
    double patch_angle[2];
    double face_angle[2];
    uint32_t smoothings;
};

static struct choice choose_classic(double noise)
{
    return (struct choice){.patch_angle = {25, 90},
                           .face_angle = {20, 90},
                           .smoothings = noise > noise_smooth};
}

static struct choice choose_collapse(double noise)
{
    if (noise > noise_heavy)
        return (struct choice){
            .patch_angle = {9, 90}, .face_angle = {8, 90}, .smoothings = 3};
    return (struct choice){.patch_angle = {6, 90}, .face_angle = {5, 90}, .smoothings = 1};
}

static double diagonal(const struct store_info *info)
{
    double sum = 0;
    for (unsigned c = 0; c < 3; c++) {
        double side = info->box_high[c] - info->box_low[c];
        sum += side * side;
    }
    return sqrt(sum);
}

void patch_choose(const struct store_info *info, const struct target *target,
                  const struct patch_request *request, struct patch_options *options)
{
    struct choice choice = target->mode == MODE_CLASSIC ? choose_classic(info->noise)
                                                        : choose_collapse(info->noise);
    for (unsigned i = 0; i < 2; i++) {
        double patch = request->patch_angle[i], face = request->face_angle[i];
        options->patch_cosine[i] = cosine_of_degrees(patch >= 0 ? patch : choice.patch_angle[i]);
        options->face_cosine[i] = cosine_of_degrees(face >= 0 ? face : choice.face_angle[i]);
    }
    options->smoothings =
        request->smoothings >= 0 ? (uint32_t)request->smoothings : choice.smoothings;
    options->most_faces = PATCH_FACES_MAX;
    options->chain_tolerance = 0; /* all chain vertices are kept; lod simplifies them */
    if (request->chain_tolerance > 0)
        options->chain_tolerance =
            request->chain_tolerance *
            (request->chain_tolerance_is_relative ? diagonal(info) : 1);
}
