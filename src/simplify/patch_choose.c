/*
 * Which patches fit a scan. Constant angles do not: scanner noise shatters patches that are grown
 * on raw normals, and smoothing a CAD part rounds off the edges that should bound its patches.
 *
 * What a store knows of this is its noise: the RMS distance of a vertex from its neighbours' mean
 * plane, in mean edges. Sharp edges count into it just as scanner noise does, but their share of
 * the vertices falls with the square root of the number of faces F, and the RMS with the fourth
 * root; so noise * F^(1/4) tells the two apart. It is 0.3 to 1.7 on clean scans and parts of all
 * sizes, 2.1 for noise of 0.05 edges on a million faces, above 3.4 for 0.15 edges and for voxel
 * terraces. Parts of long thin triangles reach the same values by their geometry, but not a scan's
 * even triangles: the mean face measures 0.35 to 0.49 squared mean edges on scans, and 0.09 to 0.31
 * on such parts.
 *
 * The angles are those that did best on real scans (DESIGN.md, prototype-sweep.tsv): mode collapse
 * wants fine patches, since what a patch loses is its bulge; mode classic the paper's of section
 * 4.2.3 on noisy scans, and finer ones on parts, so that fillets are cut along their length and the
 * sharp edges of fandisk stay within 0.5 % of the diagonal at 266 faces.
 *
 * Angles become cosines here, once, by a series in a fixed order: a libm may differ in the last bit
 * from machine to machine, and so would the patches.
 */
#include <math.h>

#include "simplify/simplify.h"

static const double noisy_from = 1.9; /* noise * F^(1/4) */
static const double even_from = 0.33; /* area / (F * mean edge squared) */

/* Whether it is scanner noise (or voxel terraces) that makes the surface rough. */
static bool is_noisy_scan(const struct store_info *info)
{
    double faces = (double)info->topology.faces;
    double even_area = even_from * faces * info->mean_edge * info->mean_edge;
    return info->noise * sqrt(sqrt(faces)) > noisy_from && info->area > even_area;
}

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

static struct choice choose_classic(bool noisy)
{
    return noisy ? (struct choice){{25, 90}, {20, 90}, 1} : (struct choice){{15, 90}, {12, 90}, 0};
}

static struct choice choose_collapse(bool noisy)
{
    return noisy ? (struct choice){{9, 90}, {8, 90}, 3} : (struct choice){{6, 90}, {5, 90}, 1};
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
    bool noisy = is_noisy_scan(info);
    struct choice choice =
        target->mode == MODE_CLASSIC ? choose_classic(noisy) : choose_collapse(noisy);
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
            request->chain_tolerance * (request->chain_tolerance_is_relative ? diagonal(info) : 1);
}
