/*
 * Public options: their defaults, whether they make sense, and the stages' form of them.
 *
 * A run can take hours, so what can be known to fail at its end is refused at its beginning: an
 * output that cannot be written or is an input, a name without a format, a target out of range.
 */
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "api_internal.h"
#include "base/file.h"

/* ---- what must be known before the work begins ---- */

/* Expands %d and %% of a level's file name; see spbm_level_name. */
static bool expand_name(const char *output, uint32_t level, uint32_t level_count, char *name,
                        size_t size)
{
    size_t used = 0;
    unsigned numbers = 0;
    for (const char *from = output; *from; from++) {
        char text[16] = {*from, '\0'};
        if (from[0] == '%' && from[1] == 'd') {
            snprintf(text, sizeof text, "%u", (unsigned)level);
            numbers++;
            from++;
        } else if (from[0] == '%' && from[1] == '%') {
            from++;
        } else if (from[0] == '%') {
            return false;
        }
        size_t length = strlen(text);
        if (used + length >= size)
            return false;
        memcpy(name + used, text, length);
        used += length;
    }
    if (size == 0)
        return false;
    name[used] = '\0';
    return level_count <= 1 ? numbers <= 1 : numbers == 1;
}

spbm_status spbm_level_name(const char *output, uint32_t level, uint32_t level_count, char *name,
                            size_t size)
{
    return expand_name(output, level, level_count, name, size) ? SPBM_OK : SPBM_MISUSE;
}

bool is_standard_stream(const char *path)
{
    return strcmp(path, "-") == 0;
}

/* The directory that `path` lies in, in `folder` (PATH_MAX bytes). */
void folder_of(const char *path, char *folder)
{
    const char *slash = strrchr(path, '/');
    if (!slash)
        snprintf(folder, PATH_MAX, ".");
    else if (slash == path)
        snprintf(folder, PATH_MAX, "/");
    else
        snprintf(folder, PATH_MAX, "%.*s", (int)(slash - path), path);
}

/* Fails early where the output could not be written late. */
enum status check_writable(struct context *ctx, const char *output)
{
    struct stat info;
    char folder[PATH_MAX];
    if (is_standard_stream(output))
        return STATUS_OK;
    if (output[0] == '\0')
        return fail(ctx, STATUS_MISUSE, "the name of the output is empty");
    if (strlen(output) >= sizeof folder)
        return fail(ctx, STATUS_MISUSE, "%.99s...: the name of the output is too long", output);
    if (stat(output, &info) == 0) {
        if (S_ISDIR(info.st_mode))
            return fail(ctx, STATUS_IO, "%s: is a directory", output);
        if (!S_ISREG(info.st_mode)) /* written directly */
            return access(output, W_OK) == 0
                       ? STATUS_OK
                       : fail_errno(ctx, errno, "%s: cannot be written", output);
    } else if (errno == ENAMETOOLONG) {
        return fail_errno(ctx, errno, "%s: cannot be created", output);
    }
    folder_of(output, folder);
    if (access(folder, W_OK | X_OK) != 0)
        return fail_errno(ctx, errno, "%s: cannot be created in %s", output, folder);
    return STATUS_OK;
}

/* Fails early for a format that could not be written late. */
enum status check_format(struct context *ctx, const char *output, spbm_format format)
{
    static const char *const endings[] = {".ply", ".obj", ".stl", ".off"};
    if (format < SPBM_FORMAT_BY_NAME || format > SPBM_FORMAT_OFF)
        return fail(ctx, STATUS_MISUSE, "there is no such format");
    if (format != SPBM_FORMAT_BY_NAME)
        return STATUS_OK;
    if (is_standard_stream(output))
        return fail(ctx, STATUS_MISUSE, "standard output has no ending: a format must be given");
    size_t length = strlen(output);
    for (size_t i = 0; i < sizeof endings / sizeof endings[0]; i++) {
        if (length >= 4 && strcasecmp(output + length - 4, endings[i]) == 0)
            return STATUS_OK;
    }
    return fail(ctx, STATUS_MISUSE,
                "%s: the ending must be .ply, .obj, .stl or .off, or a format be given", output);
}

enum status check_inputs(struct context *ctx, const char *const *inputs, size_t input_count,
                         const char *output)
{
    if (input_count == 0)
        return fail(ctx, STATUS_MISUSE, "no input is given");
    unsigned streams = 0;
    for (size_t i = 0; i < input_count; i++) {
        streams += is_standard_stream(inputs[i]);
        if (streams > 1)
            return fail(ctx, STATUS_MISUSE, "standard input can be read once only");
        enum status status =
            is_standard_stream(inputs[i]) ? STATUS_OK : paths_must_differ(ctx, inputs[i], output);
        if (status != STATUS_OK)
            return status;
    }
    return STATUS_OK;
}

enum status check_target(struct context *ctx, const spbm_target *target)
{
    if (target->count < 1 || target->count > TARGETS_MAX)
        return fail(ctx, STATUS_MISUSE, "between 1 and %d targets are possible, not %u",
                    (int)TARGETS_MAX, target->count);
    if (target->effort < 1 || target->effort > 3)
        return fail(ctx, STATUS_MISUSE, "the effort must be 1, 2 or 3");
    if (target->mode != SPBM_COLLAPSE && target->mode != SPBM_CLASSIC)
        return fail(ctx, STATUS_MISUSE, "there is no such mode");
    if (!(target->error_bound >= 0) || (target->error_bound > 0 && target->kind == SPBM_BY_ERROR))
        return fail(ctx, STATUS_MISUSE, "an error bound goes together with a count or a ratio");
    for (uint32_t i = 0; i < target->count; i++) {
        double value = target->values[i];
        switch (target->kind) {
        case SPBM_BY_FACES:
            if (!(value >= 1 && value <= 4294967294.0) || value != floor(value))
                return fail(ctx, STATUS_MISUSE, "%g is not a number of faces", value);
            break;
        case SPBM_BY_RATIO:
            if (!(value > 0 && value <= 1))
                return fail(ctx, STATUS_MISUSE, "the ratio %g is not in (0,1]", value);
            break;
        case SPBM_BY_ERROR:
            if (!(value >= 0 && value <= 1e300))
                return fail(ctx, STATUS_MISUSE, "%g is not an error", value);
            break;
        default:
            return fail(ctx, STATUS_MISUSE, "there is no such kind of target");
        }
    }
    return STATUS_OK;
}

/* The names of all levels: can they be written, and is none of them the input? */
enum status check_levels(struct context *ctx, const char *const *inputs, size_t input_count,
                         const char *output, const spbm_target *target,
                         const spbm_lod_options *options)
{
    enum status status = check_target(ctx, target);
    if (status != STATUS_OK)
        return status;
    if (options->place < SPBM_PLACE_DEFAULT || options->place > SPBM_PLACE_OPTIMAL)
        return fail(ctx, STATUS_MISUSE, "there is no such placement");
    if (options->place == SPBM_PLACE_OPTIMAL && target->mode == SPBM_CLASSIC)
        return fail(ctx, STATUS_MISUSE,
                    "mode classic keeps vertices where they are: placement optimal needs mode "
                    "collapse");
    char name[PATH_MAX];
    if (strlen(output) >= sizeof name)
        return fail(ctx, STATUS_MISUSE, "%.99s...: the name of the output is too long", output);
    if (!expand_name(output, 0, target->count, name, sizeof name))
        return fail(ctx, STATUS_MISUSE, "%s: the output's name %s%%d, and %%%% for a percent sign",
                    output, target->count > 1 ? "needs one " : "may hold one ");
    for (uint32_t i = 0; i < target->count; i++) {
        (void)expand_name(output, i, target->count, name, sizeof name);
        status = check_writable(ctx, name);
        if (status == STATUS_OK)
            status = check_format(ctx, name, options->format);
        if (status == STATUS_OK)
            status = check_inputs(ctx, inputs, input_count, name);
        if (status != STATUS_OK)
            return status;
    }
    return STATUS_OK;
}

enum status check_patch_options(struct context *ctx, const spbm_patch_options *options)
{
    for (unsigned i = 0; i < 2; i++) {
        if (!(options->patch_angle[i] <= 180) || !(options->face_angle[i] <= 180))
            return fail(ctx, STATUS_MISUSE, "an angle must be at most 180 degrees");
    }
    if (options->smoothings > 100)
        return fail(ctx, STATUS_MISUSE, "the normals can be smoothed 100 times at most");
    if (!(options->chain_tolerance <= 1e300))
        return fail(ctx, STATUS_MISUSE, "the chain tolerance is not a length");
    return STATUS_OK;
}

/* ---- options: defaults, and public ones to internal ones ---- */

void spbm_import_defaults(spbm_import_options *options)
{
    *options = (spbm_import_options){.sync = 1};
}

void spbm_target_defaults(spbm_target *target)
{
    *target = (spbm_target){.kind = SPBM_BY_FACES, .mode = SPBM_COLLAPSE, .effort = 2};
}

void spbm_patch_defaults(spbm_patch_options *options)
{
    *options = (spbm_patch_options){
        .patch_angle = {-1, -1},
        .face_angle = {-1, -1},
        .smoothings = -1,
        .chain_tolerance = -1,
        .sync = 1,
    };
}

void spbm_lod_defaults(spbm_lod_options *options)
{
    *options = (spbm_lod_options){.sync = 1};
}

void spbm_simplify_defaults(spbm_simplify_options *options)
{
    *options = (spbm_simplify_options){.keep_dir = NULL};
    spbm_import_defaults(&options->import);
    spbm_target_defaults(&options->target);
    spbm_patch_defaults(&options->patch);
    spbm_lod_defaults(&options->lod);
}

struct target make_target(const spbm_target *from)
{
    struct target target = {
        .kind = (enum target_kind)from->kind,
        .count = from->count,
        .error_is_relative = from->error_is_relative != 0,
        .mode = (enum lod_mode)from->mode,
        .effort = from->effort,
        .error_bound = from->error_bound,
        .bound_is_relative = from->bound_is_relative != 0,
    };
    memcpy(target.values, from->values, sizeof target.values);
    return target;
}

struct patch_request make_request(const spbm_patch_options *from, int level, bool sync)
{
    return (struct patch_request){
        .patch_angle = {from->patch_angle[0], from->patch_angle[1]},
        .face_angle = {from->face_angle[0], from->face_angle[1]},
        .smoothings = from->smoothings,
        .chain_tolerance = from->chain_tolerance,
        .chain_tolerance_is_relative = from->tolerance_is_relative != 0,
        .level = level,
        .sync = sync,
    };
}
