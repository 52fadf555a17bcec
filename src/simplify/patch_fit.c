/*
 * Which angles give as many patches as a level needs?
 *
 * Constant angles give some scans a hundred patches for each face of the level, which costs time,
 * and others three, which costs accuracy: what a patch loses is its bulge. Curvature, noise and
 * sampling all have a say, and no figure of the store predicts the number well. So patches are
 * grown on a sample, a few connected pieces, with angles from a table, until the number of
 * patches, scaled up to the whole, is known for the largest angle that gives enough. The sample is
 * small, so that the trials cost a few milliseconds.
 *
 * How many are enough was measured (mean error against quadric collapse and Lindstrom-Turk's of the
 * full mesh; bunnies, koala, skull, elephant, dragon, generated scans of several noises, all
 * smoothings): at equal numbers of patches the errors are nearly equal, whatever the angles and
 * smoothings that gave them. With the bulge given back (small_bulge.h), at 2 % and below, to the
 * better quadric collapse's: smooth scans have 1.0 to 1.4 with 4 patches a face of the level, 0.80
 * to 0.94 with 12, 0.70 to 0.79 with 30; noisy ones 0.7 to 1.1 with 4, 0.68 to 0.93 with 5 to 7.
 *
 * An error bound E has no number of patches, but a patch of size s that turns by the angle A bulges
 * by about s A / 8, which is kept under a part of E.
 */
#include "simplify/patch_fit.h"

#include <math.h>
#include <string.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "base/ranked_bits.h"
#include "mesh/draft.h"
#include "simplify/patchify.h"

enum { EXCERPTS = 4, EXCERPT_FACES = 1 << 13 };

/* Patches for each face of the finest level, by effort; mode classic needs them to begin with.
 * Smooth scans need more of them: where noise breaks patches up, the small ones do no harm, and the
 * large ones are few. Between the two bounds of noise, in mean edges, it is in proportion. Levels
 * of many faces want up to FINE_MORE times as many: a patch of a few faces has no inner vertex that
 * would tell its bulge, and what looks like noise is also the terraces of voxels. */
static const double patches_a_face[4] = {0, 2.4, 4.5, 12};
static const double patches_a_smooth_face[4] = {0, 5, 12, 32};
static const double smooth_below = 0.037, noisy_above = 0.065;
static const double few_faces = 0.02, many_faces = 0.1; /* of the surface's */
static const double FINE_MORE = 1.7;
/* So few patches cost nothing, and a level of a few hundred faces is better for them. */
static const double patches_least[4] = {0, 4096, 8192, 8192};
/* A small mesh of nearly all faces is hardly better: this part of the faces is enough patches, or
 * so many a face of the level. */
static const double most_part = 0.6;
static const double most_a_face = 8;
static const double classic_patches_a_face = 0.6;
/* The part of an error bound that a mean patch's bulge may take, by effort. */
static const double bulge_part[4] = {0, 0.03, 0.025, 0.02};

/* Patch angles to choose from, degrees, ascending; the face angle is FACE_PART of it. */
static const double angles[] = {0.25, 0.5,  0.75, 1,  1.4, 1.7, 2,   2.4, 2.8, 3.1, 3.5, 3.8, 4.2,
                                4.6,  5,    5.5,  6,  6.5, 7,   7.5, 8,   8.5, 9,   9.5, 10,  10.5,
                                11,   11.5, 12,   13, 14,  15,  16,  17,  18,  19,  20};
enum { ANGLES = sizeof angles / sizeof *angles };
static const double FACE_PART = 0.85;
/* Trials whose angles are guessed; after them the range is halved. */
enum { GUESSED_TRIALS = 5 };
/* By which power of the angle the number of patches falls, in quarters: at first, and bounds. */
enum { POWER_FIRST = 7, POWER_LEAST = 2, POWER_MOST = 20 };

/*
 * Terraces of voxels have few slopes. The number of patches leaps at the angles between them and
 * hardly changes elsewhere, and patches that take a step in lose the shape. So where the angle of
 * this place in the table gives few more patches, it is taken: fewer times as many than it is
 * smaller. (A CT skull's number grows by its angle's power of 0.83 to 0.87; on other scans it is
 * 1.3 to 2.5.)
 */
enum { TERRACE_INDEX = 14 };
static const double TERRACE_MORE = 1.75;
static const double TERRACE_REACH = 10; /* from larger angles it would be many more */

/* Some faces of a slab with numbers of their own: a slab to patch_grow. */
struct excerpt {
    uint32_t face_count;
    uint32_t vertex_count;
    uint32_t *faces;
    uint32_t *neighbours; /* NO_INDEX at the border, face_count: a face outside */
    uint8_t *mates;
    float *positions;
    uint32_t patch_count; /* of the last trial */
    bool has_begun;       /* with the normals smoothed so many times: */
    uint32_t smoothings;
    struct patch_workspace space;
};

struct sample {
    struct context *ctx;
    struct store *store;
    struct excerpt excerpts[EXCERPTS];
    uint32_t excerpt_count;
    uint64_t faces;
    const struct patch_options *options; /* of the present trial */
};

static enum status take_excerpt(struct context *ctx, struct excerpt *excerpt, uint32_t faces)
{
    excerpt->face_count = faces;
    enum status status = memory_take(ctx, faces, 3 * sizeof *excerpt->faces, &excerpt->faces);
    if (!status)
        status = memory_take(ctx, faces, 3 * sizeof *excerpt->neighbours, &excerpt->neighbours);
    if (!status)
        status = memory_take(ctx, faces, sizeof *excerpt->mates, &excerpt->mates);
    if (!status)
        status = memory_take(ctx, faces, 9 * sizeof *excerpt->positions, &excerpt->positions);
    return status;
}

static void clear_excerpt(struct context *ctx, struct excerpt *excerpt)
{
    const size_t faces = excerpt->face_count;
    memory_release(ctx, &excerpt->positions, faces, 9 * sizeof *excerpt->positions);
    memory_release(ctx, &excerpt->mates, faces, sizeof *excerpt->mates);
    memory_release(ctx, &excerpt->neighbours, faces, 3 * sizeof *excerpt->neighbours);
    memory_release(ctx, &excerpt->faces, faces, 3 * sizeof *excerpt->faces);
    patch_workspace_clear(ctx, &excerpt->space);
}

/* Chooses the excerpt's faces: those first met breadth-first from face `first` of an open slab,
 * over edges, so that they hang together even where the order is not local. `list` gets them,
 * ascending; it has room for one more, since every neighbour is written, and counts if it is new.
 */
static void choose_faces(const struct slab *slab, uint32_t first, uint32_t wanted,
                         struct ranked_bits *faces, uint32_t *list)
{
    uint32_t count = 0, head = 0, next = first;
    while (count < wanted) {
        if (head == count) { /* a component is used up: the next free face, round the slab */
            while (bit_is_set(faces->bits, next))
                next = next + 1 == slab->face_count ? 0 : next + 1;
            bit_set(faces->bits, next);
            list[count++] = next;
            continue;
        }
        const uint32_t *neighbours = slab->neighbours + 3 * (size_t)list[head++];
        for (unsigned k = 0; k < 3; k++) {
            const uint32_t face = neighbours[k] - slab->face_first;
            if (neighbours[k] == NO_INDEX || face >= slab->face_count)
                continue;
            const bool is_new = !bit_is_set(faces->bits, face) & (count < wanted);
            faces->bits[face / 64] |= (uint64_t)is_new << face % 64;
            list[count] = face;
            count += is_new;
        }
    }
    ranked_bits_sum(faces);
    bits_list(faces->bits, faces->words, list);
}

/* A vertex of a slab by its place among all of them, which is the store's order: foreign ones are
 * lower than the slab's own. */
static uint32_t place_in_slab(const struct slab *slab, uint32_t vertex)
{
    return vertex >= slab->vertex_first ? slab->foreign_count + (vertex - slab->vertex_first)
                                        : foreign_rank(slab->foreign, slab->foreign_count, vertex);
}

static const float *position_in_slab(const struct slab *slab, uint32_t place)
{
    return place < slab->foreign_count
               ? slab->foreign_positions + 3 * (size_t)place
               : slab->positions + 3 * (size_t)(place - slab->foreign_count);
}

/* Copies the listed faces with numbers of the excerpt's own. `places` has room for all their
 * corners. */
static void copy_faces(const struct slab *slab, const uint32_t *list,
                       const struct ranked_bits *faces, struct ranked_bits *vertices,
                       uint32_t *places, struct excerpt *excerpt)
{
    for (size_t i = 0; i < excerpt->face_count; i++) {
        excerpt->mates[i] = slab->mates[list[i]];
        for (unsigned k = 0; k < 3; k++) {
            const size_t from = 3 * (size_t)list[i] + k;
            const uint32_t neighbour = slab->neighbours[from], face = neighbour - slab->face_first;
            const bool is_inside = face < slab->face_count && bit_is_set(faces->bits, face);
            const uint32_t place = place_in_slab(slab, slab->faces[from]);
            excerpt->neighbours[3 * i + k] = neighbour == NO_INDEX ? NO_INDEX
                                             : is_inside           ? rank_of(faces, face)
                                                                   : excerpt->face_count;
            excerpt->faces[3 * i + k] = place;
            bit_set(vertices->bits, place);
        }
    }
    excerpt->vertex_count = ranked_bits_sum(vertices);
    bits_list(vertices->bits, vertices->words, places);
    for (size_t i = 0; i < 3 * (size_t)excerpt->face_count; i++)
        excerpt->faces[i] = rank_of(vertices, excerpt->faces[i]);
    for (uint32_t v = 0; v < excerpt->vertex_count; v++)
        memcpy(excerpt->positions + 3 * (size_t)v, position_in_slab(slab, places[v]),
               3 * sizeof(float));
}

static enum status copy_excerpt(struct context *ctx, const struct slab *slab, uint32_t first,
                                struct excerpt *excerpt)
{
    const size_t corners = 3 * (size_t)excerpt->face_count;
    const size_t slab_vertices =
        (size_t)(slab->vertex_end - slab->vertex_first) + slab->foreign_count;
    struct ranked_bits faces = {0}, vertices = {0};
    uint32_t *list = NULL, *places = NULL;
    enum status status = memory_take(ctx, (size_t)excerpt->face_count + 1, sizeof *list, &list);
    if (!status)
        status = memory_take(ctx, corners, sizeof *places, &places);
    if (!status)
        status = ranked_bits_take(ctx, slab->face_count, &faces);
    if (!status)
        status = ranked_bits_take(ctx, slab_vertices, &vertices);
    if (!status) {
        choose_faces(slab, first, excerpt->face_count, &faces, list);
        copy_faces(slab, list, &faces, &vertices, places, excerpt);
    }
    ranked_bits_clear(ctx, &vertices);
    ranked_bits_clear(ctx, &faces);
    memory_release(ctx, &places, corners, sizeof *places);
    memory_release(ctx, &list, (size_t)excerpt->face_count + 1, sizeof *list);
    return status;
}

/* The first face of an excerpt: they are spread evenly. */
static uint64_t excerpt_first(const struct sample *sample, uint64_t index)
{
    if (sample->excerpt_count == 1)
        return 0;
    return (2 * index + 1) * (sample->faces - EXCERPT_FACES) / (2 * sample->excerpt_count);
}

static enum status fill_excerpt(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct sample *sample = user;
    struct slab slab = {0};
    struct excerpt *excerpt = &sample->excerpts[job];
    const uint64_t first = excerpt_first(sample, job);
    enum status status =
        slab_open(sample->store, (uint32_t)(first >> store_info(sample->store)->slab_shift), &slab);
    if (!status) {
        const uint32_t most = sample->excerpt_count == 1 ? EXCERPTS * EXCERPT_FACES : EXCERPT_FACES;
        status =
            take_excerpt(sample->ctx, excerpt, slab.face_count < most ? slab.face_count : most);
        if (!status)
            status = copy_excerpt(sample->ctx, &slab, (uint32_t)(first - slab.face_first), excerpt);
    }
    slab_close(&slab);
    return status;
}

static enum status fill_sample(struct sample *sample)
{
    sample->faces = store_info(sample->store)->topology.faces;
    sample->excerpt_count = sample->faces > EXCERPTS * EXCERPT_FACES ? EXCERPTS : 1;
    return parallel_for(sample->ctx, sample->excerpt_count, fill_excerpt, sample);
}

/* Trials differ in their angles, hardly ever in their normals. */
static enum status begin_excerpt(struct sample *sample, struct excerpt *excerpt)
{
    if (excerpt->has_begun && excerpt->smoothings == sample->options->smoothings) {
        patch_growth_again(&excerpt->space, sample->options);
        return STATUS_OK;
    }
    const struct slab slab = {.face_count = excerpt->face_count,
                              .vertex_end = excerpt->vertex_count,
                              .faces = excerpt->faces,
                              .neighbours = excerpt->neighbours,
                              .mates = excerpt->mates,
                              .positions = excerpt->positions};
    excerpt->has_begun = true;
    excerpt->smoothings = sample->options->smoothings;
    return patch_growth_begin(sample->ctx, &slab, sample->options, &excerpt->space);
}

static enum status try_excerpt(void *user, uint64_t job, unsigned worker)
{
    (void)worker;
    struct sample *sample = user;
    struct excerpt *excerpt = &sample->excerpts[job];
    struct grown_patch patch;
    enum status status = begin_excerpt(sample, excerpt);
    excerpt->patch_count = 0;
    while (!status && patch_growth_next(&excerpt->space, &patch))
        excerpt->patch_count++;
    return status;
}

/* Patches of the whole mesh with these options, as the sample has it. */
static enum status estimate(struct sample *sample, const struct patch_options *options,
                            double *patches)
{
    uint64_t faces = 0, count = 0;
    sample->options = options;
    enum status status = parallel_for(sample->ctx, sample->excerpt_count, try_excerpt, sample);
    for (uint32_t i = 0; i < sample->excerpt_count; i++) {
        faces += sample->excerpts[i].face_count;
        count += sample->excerpts[i].patch_count;
    }
    *patches = faces ? (double)count * (double)sample->faces / (double)faces : 0;
    return status;
}

/* What the finest level asks for: faces, or an error in model units. */
struct fineness {
    double faces; /* 0: none */
    double error; /* 0: none */
};

static struct fineness find_finest(const struct store_info *info, const struct target *target)
{
    struct fineness finest = {0, 0};
    double square = 0;
    for (unsigned c = 0; c < 3; c++) {
        const double side = info->box_high[c] - info->box_low[c];
        square += side * side;
    }
    const double diagonal = sqrt(square);
    if (target->error_bound > 0)
        finest.error = target->error_bound * (target->bound_is_relative ? diagonal : 1);
    for (uint32_t i = 0; i < target->count && i < TARGETS_MAX; i++) {
        const double value = target->values[i];
        if (target->kind == TARGET_ERROR) {
            const double error = value * (target->error_is_relative ? diagonal : 1);
            if (finest.error <= 0 || error < finest.error)
                finest.error = error;
        } else {
            const double faces =
                target->kind == TARGET_RATIO ? value * (double)info->topology.faces : value;
            finest.faces = faces > finest.faces ? faces : finest.faces;
        }
    }
    return finest;
}

/* Where x lies between low and high: 0 to 1. */
static double part_between(double x, double low, double high)
{
    return fmin(fmax((x - low) / (high - low), 0), 1);
}

static double patches_wanted(const struct store_info *info, const struct target *target,
                             double faces)
{
    if (target->mode == MODE_CLASSIC)
        return classic_patches_a_face * faces;
    const uint32_t effort = target->effort;
    const double noisy = part_between(info->noise, smooth_below, noisy_above);
    const double fine = part_between(faces / (double)info->topology.faces, few_faces, many_faces);
    const double rough = patches_a_face[effort], smooth = patches_a_smooth_face[effort];
    const double a_face = (smooth + noisy * (rough - smooth)) * (1 + (FINE_MORE - 1) * fine);
    return fmax(a_face * faces, patches_least[effort]);
}

static bool are_fine_enough(const struct store_info *info, const struct target *target,
                            const struct fineness *finest, double angle, double patches)
{
    const double wanted = patches_wanted(info, target, finest->faces);
    const double most = fmax(most_a_face * finest->faces, most_part * (double)info->topology.faces);
    if (finest->faces > 0 && patches < wanted && patches < most)
        return false;
    if (finest->error <= 0 || patches <= 0)
        return true;
    const double radian = 0.017453292519943295;
    return sqrt(info->area / patches) * angle * radian / 8 <=
           bulge_part[target->effort] * finest->error;
}

/* The options for one of the table's angles. */
static void make_options(const struct store_info *info, const struct target *target,
                         const struct patch_request *request, uint32_t index,
                         struct patch_options *options)
{
    struct patch_request asked = *request;
    if (asked.patch_angle[0] < 0)
        asked.patch_angle[0] = angles[index];
    if (asked.face_angle[0] < 0)
        asked.face_angle[0] = FACE_PART * angles[index];
    patch_choose(info, target, &asked, options);
}

/* *index, whose angle gives so many patches, becomes that of terraces where it gives few more. */
static enum status prefer_steps(struct sample *sample, const struct target *target,
                                const struct patch_request *request, double patches,
                                uint32_t *index)
{
    struct patch_options options;
    double there = 0;
    make_options(store_info(sample->store), target, request, TERRACE_INDEX, &options);
    const enum status status = estimate(sample, &options, &there);
    const double more = there / patches, smaller = angles[*index] / angles[TERRACE_INDEX];
    if (status == STATUS_OK && more <= TERRACE_MORE && more <= smaller)
        *index = TERRACE_INDEX;
    return status;
}

/* A trial that is over: its angle and how many patches it gave. */
struct trial {
    uint32_t index;
    double patches;
};

/* ratio^(quarters / 4), without a libm's rounding. */
static double quarter_power(double ratio, unsigned quarters)
{
    const double fourth = sqrt(sqrt(ratio));
    double power = 1;
    for (unsigned i = 0; i < quarters; i++)
        power *= fourth;
    return power;
}

/* By which power of the angle the number of patches fell between two trials, in quarters. */
static unsigned find_power(const struct trial *one, const struct trial *other)
{
    const bool ascends = one->index < other->index;
    const struct trial *finer = ascends ? one : other, *coarser = ascends ? other : one;
    const double ratio = angles[coarser->index] / angles[finer->index];
    unsigned quarters = POWER_LEAST;
    while (quarters < POWER_MOST &&
           finer->patches > coarser->patches * quarter_power(ratio, quarters))
        quarters++;
    return quarters;
}

/*
 * Which angle to try next: angles[low] is fine enough, those above high are not. The number of
 * patches goes by some power of the angle, about 7/4 of it in general, and what the last two trials
 * say once there are two. So the last trial tells where the answer lies, and often only its
 * neighbour is left to be tried then: four trials where halving takes five.
 */
static uint32_t choose_trial(const struct store_info *info, const struct target *target,
                             const struct fineness *finest, const struct trial *last,
                             unsigned quarters, uint32_t low, uint32_t high)
{
    uint32_t next = high;
    for (; next > low + 1; next--) {
        const double finer = quarter_power(angles[last->index] / angles[next], quarters);
        if (are_fine_enough(info, target, finest, angles[next], last->patches * finer))
            break;
    }
    return next;
}

enum status patch_fit(struct context *ctx, struct store *store, const struct target *target,
                      const struct patch_request *request, struct patch_options *options)
{
    const struct store_info *info = store_info(store);
    const struct fineness finest = find_finest(info, target);
    patch_choose(info, target, request, options);
    if (request->patch_angle[0] >= 0 || info->topology.faces == 0 ||
        target->effort >= sizeof patches_a_face / sizeof *patches_a_face)
        return STATUS_OK;
    struct sample sample = {.ctx = ctx, .store = store};
    double patches = 0, chosen = 0; /* of mode classic, with angles[low] */
    enum status status = fill_sample(&sample);
    /* mode classic has the paper's angles unless they are too coarse */
    bool enough = false;
    if (!status && target->mode == MODE_CLASSIC) {
        status = estimate(&sample, options, &patches);
        enough = are_fine_enough(info, target, &finest, 25, patches);
    }
    uint32_t low = 0, high = enough ? 0 : ANGLES - 1;
    struct trial last = {0}, before;
    unsigned quarters = POWER_FIRST;
    for (uint32_t trials = 0; !status && low < high; trials++) {
        /* angles[low] is fine enough, or nothing is; those above high are not */
        const bool halves = trials == 0 || trials >= GUESSED_TRIALS;
        before = last;
        last.index = halves ? (low + high + 1) / 2
                            : choose_trial(info, target, &finest, &last, quarters, low, high);
        make_options(info, target, request, last.index, options);
        status = estimate(&sample, options, &last.patches);
        quarters = trials > 0 ? find_power(&before, &last) : quarters;
        if (are_fine_enough(info, target, &finest, angles[last.index], last.patches)) {
            low = last.index;
            chosen = last.patches;
        } else {
            high = last.index - 1;
        }
    }
    if (!status && !enough && target->mode != MODE_CLASSIC && low > TERRACE_INDEX &&
        angles[low] <= TERRACE_REACH)
        status = prefer_steps(&sample, target, request, chosen, &low);
    if (!status && !enough)
        make_options(info, target, request, low, options);
    for (uint32_t i = 0; i < sample.excerpt_count; i++)
        clear_excerpt(ctx, &sample.excerpts[i]);
    return status;
}
